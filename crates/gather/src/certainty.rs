//! Noise model: the error of lumels from the spread of their samples, corrected for stratification.
//!
//! Samples at a lumel are points of scrambled Sobol sequences. The variance of their mean falls
//! faster than with one over their number, but the spread of the samples does not show this: it
//! would claim 1.7 % for the Cornell box at `preview`, where the error is 1.0 %. How much faster
//! depends on the scene (shadow edges, small bright windows, smooth walls). It can be measured in
//! the bake itself, by comparing parts of the samples.
//!
//! Let V(n) be the variance of the mean of n samples, and r = V(n)/V(n/2): ½ for independent
//! samples, 2^(−3/2) for the area on one side of an edge, less for smooth functions. Let A and B be
//! the two halves of a sequence whose mean has V(n). Then E(A − B)² = 4 V(n/2) − 4 V(n), because
//! Var(A + B) + Var(A − B) = 2 Var A + 2 Var B. The two halves of the first half give 4 V(n/4) − 4
//! V(n/2), which is 1/r times as much. G groups of samples, assumed independent, claim (V(n/G) −
//! V(n))/(G − 1). From two of these, summed over all lumels of a kind, follow r and V(n), and from
//! them a correction factor for the claims of that kind of lumel. The sums are of relative squares,
//! like the reported error.

use radiosity::luminance;

use crate::estimate::GROUPS;
use crate::received::{Edge, Received};

/// A lumel is lit if it has more than this fraction of the mean light.
const LIT: f32 = 1e-3;

/// Fraction of the mean light that is added to a lumel's light before errors are divided by it,
/// because small errors are invisible in the dark.
pub(crate) const FLOOR: f32 = 0.01;

/// With fewer lumels of a kind there is no correction, which is on the safe side: from this many
/// differences a variance is known to √(2/64) = 18 %.
const ENOUGH: u32 = 64;

/// r of independent samples, which is the upper limit. The lower limit is that of functions smooth
/// in the two relevant dimensions (Owen's n⁻³ is not reached with as few points as sixteen).
const SLOWEST: f64 = 0.5;
const FASTEST: f64 = 0.125;

/// Light to divide a lumel's error by, or `None` if it is unlit. `mean` is over all lumels.
///
/// If smoothing brightened a lumel, its unsmoothed luminance decides both. Otherwise a black corner
/// filled by a fit would count as lit, with an error of many times its light, although a comparison
/// with the truth excludes it (webxr_garage at `preview`: an eighth of the estimate).
pub(crate) fn scale(r: &Received, mean: f32) -> Option<f32> {
    scale_of(basis(r), mean)
}

/// The light of a lumel that its error is relative to.
pub(crate) fn basis(r: &Received) -> f32 {
    (r.least).unwrap_or_else(|| luminance(r.light()))
}

/// As [`scale`], of [`basis`].
pub(crate) fn scale_of(light: f32, mean: f32) -> Option<f32> {
    (light > LIT * mean).then_some(light + FLOOR * mean)
}

/// A standard error relative to the light that [`scale_of`] returns, at most 1: more than wrong
/// throughout is not worse. Otherwise the claim of a level is that of a few dark lumels in hollows,
/// next to light that one of their rays may have missed: eight of 47,000 lumels made 84 % of it.
pub(crate) fn relative(error: f32, scale: f32) -> f64 {
    f64::from(error / scale).min(1.0)
}

/// Correction factors for variances that assume independent samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Certainty {
    /// For indirect light, away from contacts and at contacts.
    indirect: [f32; 2],
    /// For direct light.
    direct: [f32; 2],
    /// Fraction of a lumel's light that may come from directions that none of its rays sampled.
    pub unseen: f32,
}

/// What none of n samples hit is less than 3/n of the total in 95 of 100 cases: 0.95 = 1 − (1 − p)ⁿ
/// (the rule of three).
const RULE_OF_THREE: f32 = 3.0;

/// Sums over lumels of a kind.
#[derive(Default, Clone, Copy)]
struct Sums {
    claimed: f64,
    halves: f64,
    quarters: f64,
    count: u32,
}

impl Certainty {
    /// Measures gathered lumels before smoothing. `counts` flags those with their own rays, `rays`
    /// is their least number of rays, and `mean` is the mean light of all.
    pub(crate) fn measure(
        received: &[Received],
        counts: impl Fn(usize) -> bool,
        rays: u32,
        mean: f32,
    ) -> Self {
        let mut indirect = [Sums::default(); 2];
        let mut direct = [Sums::default(); 2];
        for (i, r) in received.iter().enumerate() {
            let Some(scale) = scale(r, mean) else {
                continue;
            };
            let weight = 1.0 / f64::from(scale).powi(2);
            let kind = usize::from(r.edge == Edge::Contact);
            if counts(i) && r.indirect_variance > 0.0 {
                let half = f64::from(luminance(r.first_half - r.indirect));
                let sums = &mut indirect[kind];
                sums.claimed += weight * f64::from(r.indirect_variance);
                // A − B is twice A's distance from the mean.
                sums.halves += weight * 4.0 * half * half;
                sums.count += 1;
            }
            if r.direct_doubt[1] > 0.0 {
                let sums = &mut direct[kind];
                sums.claimed += weight * f64::from(r.direct_variance);
                sums.halves += weight * f64::from(r.direct_doubt[0]);
                sums.quarters += weight * f64::from(r.direct_doubt[1]);
                sums.count += 1;
            }
        }
        Certainty {
            indirect: indirect.map(|s| s.of_groups() as f32),
            direct: direct.map(|s| s.of_parts() as f32),
            unseen: (RULE_OF_THREE / rays.max(1) as f32).min(1.0),
        }
    }

    /// Variance of the lumel's direct light, given that of independent samples.
    pub(crate) fn direct(&self, r: &Received, variance: f32) -> f32 {
        self.direct[usize::from(r.edge == Edge::Contact)] * variance
    }

    /// Variance of its indirect light, given that of independent samples.
    pub(crate) fn indirect(&self, r: &Received, variance: f32) -> f32 {
        self.indirect[usize::from(r.edge == Edge::Contact)] * variance
    }
}

impl Sums {
    fn enough(&self) -> bool {
        self.count >= ENOUGH && self.claimed > 0.0 && self.halves > 0.0
    }

    /// V(n) relative to the claim of groups.
    fn of_groups(&self) -> f64 {
        if !self.enough() {
            return 1.0;
        }
        let last = f64::from(GROUPS as u32 - 1);
        // 4 (1/r − 1)(G − 1)/(r^−log₂G − 1), which increases with r.
        let doublings = GROUPS.ilog2() as i32;
        let expected = |r: f64| 4.0 * (1.0 / r - 1.0) * last / (r.powi(-doublings) - 1.0);
        let r = bisect(self.halves / self.claimed, expected);
        last / (r.powi(-doublings) - 1.0)
    }

    /// V(n) relative to that of independent samples.
    fn of_parts(&self) -> f64 {
        if !self.enough() || self.quarters <= 0.0 {
            return 1.0;
        }
        let r = (self.halves / self.quarters).clamp(FASTEST, SLOWEST);
        (self.halves / self.claimed * r / (1.0 - r)).min(1.0)
    }
}

/// The argument at which an increasing function reaches `value`, within the limits of r.
fn bisect(value: f64, grows: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (FASTEST, SLOWEST);
    // More steps than an f64 has bits.
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        if grows(middle) < value {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected statistics if V(n) falls by `r` with each doubling, and V(n) = 1.
    fn sums(r: f64) -> Sums {
        let doublings = GROUPS.ilog2() as i32;
        Sums {
            claimed: (r.powi(-doublings) - 1.0) / (GROUPS as f64 - 1.0),
            halves: 4.0 * (1.0 / r - 1.0),
            quarters: 0.0,
            count: ENOUGH,
        }
    }

    #[test]
    fn more_than_wrong_throughout_is_not_worse() {
        assert_eq!(relative(0.3, 0.02), 1.0);
        // The tolerance is f32's rounding.
        assert!((relative(0.01, 0.5) - 0.02).abs() < 1e-8);
    }

    #[test]
    fn what_groups_claim_is_corrected_by_halves() {
        for r in [0.5, 0.354, 0.25] {
            let s = sums(r);
            // Bisection ends at an f64's last bit; the rest is a few roundings.
            let error = s.of_groups() * s.claimed - 1.0;
            assert!(error.abs() < 1e-12, "r {r}: {error}");
        }
        // Independent samples need no correction.
        assert!((sums(0.5).of_groups() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn parts_of_a_lights_samples_give_the_variance_of_all() {
        // D²/4 of halves and of quarters, for V(n) = 1; the claim is arbitrary.
        let r: f64 = 0.354;
        let s = Sums {
            claimed: 5.0,
            halves: 1.0 / r - 1.0,
            quarters: (1.0 / r - 1.0) / r,
            count: ENOUGH,
        };
        assert!((s.of_parts() * s.claimed - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_lumel_that_smoothing_filled_is_unlit() {
        let lit = |least: Option<f32>| {
            let r = Received {
                indirect: glam::Vec3::splat(0.5),
                least,
                ..Received::default()
            };
            scale(&r, 1.0)
        };
        assert_eq!(lit(None), Some(0.5 + FLOOR));
        assert_eq!(lit(Some(0.25)), Some(0.25 + FLOOR));
        assert_eq!(lit(Some(0.5 * LIT)), None);
    }

    #[test]
    fn few_lumels_say_nothing() {
        let mut s = sums(0.25);
        s.count -= 1;
        assert_eq!(s.of_groups(), 1.0);
        assert_eq!(s.of_parts(), 1.0);
    }
}
