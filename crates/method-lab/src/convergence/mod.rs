//! How fast the baker's errors fall: its own cut, solve, gather and direct light, held against
//! closed forms.
//!
//! An error is of order p in x where it falls as x^−p; on logarithmic axes that is a straight line
//! of slope −p.

mod gather;
mod scene;
mod solve;

pub use gather::{direct_error, indirect_error, lit_error};
pub use solve::{Bounded, CutErrors, Field, cut_errors, rays_error, residual_and_error};

/// Errors at several settings of one knob.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Which study, for file and figure.
    pub study: &'static str,
    /// Which error.
    pub name: &'static str,
    /// What the method promises, up to a factor: the error as a function of the setting.
    pub promise: Promise,
    /// Settings below this are too coarse for the promise, which holds in the limit.
    pub from: f64,
    /// Setting and relative error, both positive.
    pub points: Vec<(f64, f64)>,
}

/// How an error falls with a setting x: x^−order, times ln x where `log` says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Promise {
    /// The order.
    pub order: f64,
    /// A logarithm of the patch size goes with it: ln √(x/6), x patches on six faces.
    ///
    /// Beside the edge of two faces irradiance goes like x ln x in the distance x from it, so that
    /// its slope has no bound.
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
    /// The order that is promised over the same settings: less than [`Promise::order`] where a
    /// logarithm goes with it.
    pub fn promised_order(&self) -> f64 {
        let points = self.points.iter().map(|p| (p.0, self.promise.at(p.0)));
        Series {
            points: points.collect(),
            ..self.clone()
        }
        .order()
    }

    /// The order measured: minus the slope of the straight line that fits the logarithms best
    /// (least squares). 0 for fewer than two different settings. Settings below `from` do not
    /// count.
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
