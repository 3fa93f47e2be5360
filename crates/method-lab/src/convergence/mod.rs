//! How fast the baker's errors fall: its own cut, solve, gather and direct light, held against closed forms.
//!
//! An error is of order p in x where it falls as x^−p; on logarithmic axes that is a straight line of slope −p.

mod gather;
mod scene;
mod solve;

pub use gather::{direct_error, indirect_error};
pub use solve::{Bounded, CutErrors, Field, cut_errors, rays_error, residual_and_error};

/// Errors at several settings of one knob.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Which study, for file and figure.
    pub study: &'static str,
    /// Which error.
    pub name: &'static str,
    /// The order that the method promises.
    pub promised: f64,
    /// Setting and relative error, both positive.
    pub points: Vec<(f64, f64)>,
}

impl Series {
    /// The order measured: minus the slope of the straight line that fits the logarithms best (least squares). 0 for fewer than two
    /// different settings.
    pub fn order(&self) -> f64 {
        let n = self.points.len().max(1) as f64;
        let logs = || self.points.iter().map(|(x, y)| (x.ln(), y.ln()));
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
            promised: 0.75,
            points: [1.0f64, 2.0, 8.0, 64.0]
                .map(|x| (x, 3.0 * x.powf(-0.75)))
                .to_vec(),
        };
        assert!((series.order() - 0.75).abs() < 1e-12); // rounding
    }
}
