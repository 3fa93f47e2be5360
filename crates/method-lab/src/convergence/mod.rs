//! Convergence of the baker's errors: its own subdivision, solve, gather and direct light, compared
//! with closed forms.
//!
//! An error is of order p in x if it falls as x^−p; on logarithmic axes that is a straight line of
//! slope −p.

mod gather;
mod scene;
mod solve;

pub use gather::{direct_error, indirect_error, lit_error};
pub use solve::{Bounded, CutErrors, Field, cut_errors, rays_error, residual_and_error};

/// Errors at several settings of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Which study, for file and figure.
    pub study: &'static str,
    /// Which error.
    pub name: &'static str,
    /// The convergence that the method promises, up to a factor: the error as a function of the
    /// setting.
    pub promise: Promise,
    /// Settings below this are too coarse for the promise, which is asymptotic.
    pub from: f64,
    /// Setting and relative error, both positive.
    pub points: Vec<(f64, f64)>,
}

/// Convergence of an error with a setting x: x^−order, times ln x if `log`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Promise {
    /// The order.
    pub order: f64,
    /// Whether a logarithm of the patch size is a factor: ln √(x/6), with x patches on six faces.
    ///
    /// Next to the edge of two faces irradiance behaves like x ln x in the distance x from it, so
    /// its slope is unbounded.
    pub log: bool,
}

impl Promise {
    /// The promised error, up to a factor.
    pub fn at(&self, x: f64) -> f64 {
        let log = if self.log { 0.5 * (x / 6.0).ln() } else { 1.0 };
        x.powf(-self.order) * log
    }
}

impl Series {
    /// The promised order over the same settings; less than [`Promise::order`] if there is a
    /// logarithm.
    pub fn promised_order(&self) -> f64 {
        let points = self.points.iter().map(|p| (p.0, self.promise.at(p.0)));
        Series {
            points: points.collect(),
            ..self.clone()
        }
        .order()
    }

    /// The measured order: minus the slope of the least-squares line through the logarithms. 0 for
    /// fewer than two different settings. Settings below `from` do not count.
    pub fn order(&self) -> f64 {
        let used = || self.points.iter().filter(|p| p.0 >= self.from);
        let n = used().count().max(1) as f64;
        let logs = || used().map(|(x, y)| (x.ln(), y.ln()));
        let (mx, my) = logs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
        let (xy, xx) = logs().fold((0.0, 0.0), |(a, b), (x, y)| {
            (a + (x - mx) * (y - my), b + (x - mx) * (x - mx))
        });
        if xx > 0.0 { -xy / xx } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_has_its_own_order() {
        let series = Series {
            study: "",
            name: "",
            promise: Promise {
                order: 0.75,
                log: false,
            },
            from: 0.0,
            points: [1.0f64, 2.0, 8.0, 64.0]
                .map(|x| (x, 3.0 * x.powf(-0.75)))
                .to_vec(),
        };
        assert!((series.order() - 0.75).abs() < 1e-12); // rounding
        assert!((series.promised_order() - 0.75).abs() < 1e-12);
    }
}
