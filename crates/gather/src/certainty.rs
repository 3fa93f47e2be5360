//! How sure lumels are: what their samples say of their error, with what stratification brings.
//!
//! Samples at a lumel are points of scrambled Sobol sequences. Their mean's variance falls faster
//! than with one over their number, which the spread between them does not show: it would claim 1.7
//! % for the Cornell box at `preview` where the error is 1.0 %. How much faster hangs on the scene
//! (edges of shadows, small bright windows, smooth walls), and can be seen in the bake itself, by
//! holding parts of the samples against each other.
//!
//! Let V(n) be the variance of the mean of n samples, and r = V(n)/V(n/2): ½ for independent
//! samples, 2^(−3/2) for the area on one side of an edge, less for smooth functions. Two halves A
//! and B of a sequence whose mean has V(n) have E(A − B)² = 4 V(n/2) − 4 V(n), since Var(A + B) +
//! Var(A − B) = 2 Var A + 2 Var B; the two halves of the first half have 4 V(n/4) − 4 V(n/2), which
//! is 1/r as much. G groups of samples, taken for independent, claim (V(n/G) − V(n))/(G − 1). From
//! two of these over all lumels of a kind, r and V(n) follow, and with them one factor for what the
//! lumels of that kind claim. Sums are of relative squares, as the error that is reported.

use radiosity::luminance;

use crate::estimate::GROUPS;
use crate::received::{Edge, Received};

/// A lumel is lit above this share of the mean light.
const LIT: f32 = 1e-3;

/// Share of the mean light that is added to a lumel's before errors are divided by it: in the dark
/// a small error is not seen.
const FLOOR: f32 = 0.01;

/// Fewer lumels of a kind than this say nothing, and are taken at their word, which is on the safe
/// side: a variance from so many differences is known to √(2/64) = 18 %.
const ENOUGH: u32 = 64;

/// r of independent samples, and of what is smooth in the two dimensions that matter (Owen's n⁻³ is
/// not reached with so few points as sixteen).
const SLOWEST: f64 = 0.5;
const FASTEST: f64 = 0.125;

/// Light to divide a lumel's error by, or `None` where it is unlit. `mean` is of all lumels.
///
/// Where smoothing lightened a lumel, what its own samples say decides both: a black corner that a
/// fit filled would else count as lit, with an error of many times its light, which a measurement
/// against the truth leaves out (webxr_garage at `preview`: an eighth of the estimate).
pub(crate) fn scale(r: &Received, mean: f32) -> Option<f32> {
    let light = (r.least).unwrap_or_else(|| luminance(r.light()));
    (light > LIT * mean).then_some(light + FLOOR * mean)
}

/// Factors by which variances that take samples for independent are too large.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Certainty {
    /// Of indirect light, away from contacts and at them.
    indirect: [f32; 2],
    /// Of direct light.
    direct: [f32; 2],
    /// The share of a lumel's light that may come from where none of its rays went.
    pub unseen: f32,
}

/// What is in none of n samples makes less than 3/n of all, in 95 of 100 cases: 0.95 = 1 − (1 − p)ⁿ
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
    /// From lumels as they were gathered, before smoothing. `counts` says which have rays of their
    /// own, `rays` is how many at least, `mean` is the mean light of all.
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
                // A − B is twice what A is off the mean.
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

    /// Variance of the lumel's direct light, from what independent samples would have.
    pub(crate) fn direct(&self, r: &Received, variance: f32) -> f32 {
        self.direct[usize::from(r.edge == Edge::Contact)] * variance
    }

    /// The same of its indirect light.
    pub(crate) fn indirect(&self, r: &Received, variance: f32) -> f32 {
        self.indirect[usize::from(r.edge == Edge::Contact)] * variance
    }
}

impl Sums {
    fn enough(&self) -> bool {
        self.count >= ENOUGH && self.claimed > 0.0 && self.halves > 0.0
    }

    /// V(n) over what groups claim.
    fn of_groups(&self) -> f64 {
        if !self.enough() {
            return 1.0;
        }
        let last = f64::from(GROUPS as u32 - 1);
        // 4 (1/r − 1)(G − 1)/(r^−log₂G − 1), which grows with r.
        let doublings = GROUPS.ilog2() as i32;
        let expected = |r: f64| 4.0 * (1.0 / r - 1.0) * last / (r.powi(-doublings) - 1.0);
        let r = bisect(self.halves / self.claimed, expected);
        last / (r.powi(-doublings) - 1.0)
    }

    /// V(n) over what independent samples would have.
    fn of_parts(&self) -> f64 {
        if !self.enough() || self.quarters <= 0.0 {
            return 1.0;
        }
        let r = (self.halves / self.quarters).clamp(FASTEST, SLOWEST);
        (self.halves / self.claimed * r / (1.0 - r)).min(1.0)
    }
}

/// Where a growing function reaches `value`, between the extremes of r.
fn bisect(value: f64, grows: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (FASTEST, SLOWEST);
    // An f64 has no more bits.
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

    /// What parts of samples are expected to say where V(n) falls by `r` with each doubling, and
    /// V(n) = 1.
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
    fn what_groups_claim_is_corrected_by_halves() {
        for r in [0.5, 0.354, 0.25] {
            let s = sums(r);
            // Bisection stops at an f64's last bit; the rest is a few roundings.
            let error = s.of_groups() * s.claimed - 1.0;
            assert!(error.abs() < 1e-12, "r {r}: {error}");
        }
        // Independent samples are taken at their word.
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
