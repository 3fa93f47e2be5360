//! Compares two lists of irradiances of the same footprints: do they agree within their known
//! errors?

use std::fmt;

use glam::DVec3;

use super::trace::{Estimate, luminance};

/// One footprint's irradiance by the two methods.
#[derive(Debug, Clone)]
pub struct Pair {
    /// What the footprint belongs to; differences are also summed by this label.
    pub label: String,
    /// Its centre, metres.
    pub position: DVec3,
    /// Irradiance to be judged, linear RGB.
    pub judged: DVec3,
    /// Claimed standard error of its luminance.
    pub claimed: f64,
    /// The path tracer's answer.
    pub traced: Estimate,
}

impl Pair {
    /// Judged minus traced luminance.
    pub fn difference(&self) -> f64 {
        luminance(self.judged) - luminance(self.traced.mean)
    }

    /// [`difference`](Pair::difference) in standard errors of both; 0 if both are exactly equal.
    pub fn z(&self) -> f64 {
        let d = self.difference();
        if d == 0.0 {
            0.0
        } else {
            d / self.claimed.hypot(self.traced.luminance_error)
        }
    }
}

/// A sum's relative difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bias {
    /// Σ judged / Σ traced − 1.
    pub relative: f64,
    /// Its standard error from the path tracer's noise alone.
    pub error: f64,
}

impl fmt::Display for Bias {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:+.3} % ± {:.3} %",
            100.0 * self.relative,
            100.0 * self.error
        )
    }
}

/// All pairs of one scene.
#[derive(Debug, Clone, Default)]
pub struct Comparison {
    /// The pairs.
    pub pairs: Vec<Pair>,
}

impl Comparison {
    /// Relative difference of the sums of `channel` over pairs whose label `label` accepts.
    ///
    /// The path tracer's estimates have independent errors, so their variances add. NaN if
    /// everything is black.
    fn bias(
        &self,
        label: impl Fn(&str) -> bool,
        channel: impl Fn(DVec3) -> f64,
        error: impl Fn(&Estimate) -> f64,
    ) -> Bias {
        let (mut judged, mut traced, mut variance) = (0.0, 0.0, 0.0);
        for p in self.pairs.iter().filter(|p| label(&p.label)) {
            judged += channel(p.judged);
            traced += channel(p.traced.mean);
            variance += error(&p.traced).powi(2);
        }
        Bias {
            relative: judged / traced - 1.0,
            error: variance.sqrt() / traced,
        }
    }

    /// Difference of the sums of channel 0, 1 or 2.
    pub fn channel_bias(&self, channel: usize) -> Bias {
        self.bias(|_| true, |rgb| rgb[channel], |e| e.error[channel])
    }

    /// Difference of the luminances' sums over pairs of one label.
    pub fn label_bias(&self, label: &str) -> Bias {
        self.bias(|l| l == label, luminance, |e| e.luminance_error)
    }

    /// The labels, each once.
    pub fn labels(&self) -> Vec<&str> {
        let mut labels: Vec<&str> = self.pairs.iter().map(|p| p.label.as_str()).collect();
        labels.sort_unstable();
        labels.dedup();
        labels
    }

    /// Evidence against the judged values; empty if there is no evidence.
    ///
    /// 1. The sum of a channel differs by more than `bias_bound` (relative) plus 3 standard errors
    ///    of the path tracer's sum.
    /// 2. The sum over one label differs by more than 4 standard errors. The claimed errors are
    ///    added linearly, because neighbours' errors are not independent.
    /// 3. χ²/n of the pairs ([`chi_square`](Comparison::chi_square)) is more than 3 standard
    ///    deviations √(2/n) above 1: errors are larger than claimed.
    /// 4. A pair differs by more than 4.5 standard errors, which happens by chance once in 150,000
    ///    pairs.
    ///
    /// Criteria 2 and 4 are tested many times, hence the higher bounds. All together reject a
    /// correct list for about 1 of 100 choices of random numbers.
    pub fn objections(&self, bias_bound: f64) -> Vec<String> {
        let mut out = Vec::new();
        for (k, name) in ["red", "green", "blue"].into_iter().enumerate() {
            let b = self.channel_bias(k);
            // If everything is black, the ratio is NaN and pairs must be equal, which criterion 4
            // checks.
            if b.relative.abs() > bias_bound + 3.0 * b.error {
                out.push(format!("{name} differs by {b}"));
            }
        }
        for label in self.labels() {
            let (mut difference, mut claimed, mut variance) = (0.0, 0.0, 0.0);
            for p in self.pairs.iter().filter(|p| p.label == label) {
                difference += p.difference();
                claimed += p.claimed;
                variance += p.traced.luminance_error.powi(2);
            }
            if difference.abs() > 4.0 * claimed.hypot(variance.sqrt()) {
                out.push(format!("{label} differs by {}", self.label_bias(label)));
            }
        }
        let chi = self.chi_square();
        let n = self.uncertain().count().max(1) as f64;
        if chi > 1.0 + 3.0 * (2.0 / n).sqrt() {
            out.push(format!("chi²/n is {chi}"));
        }
        if self.worst() > 4.5 {
            out.push(format!(
                "a pair differs by {} standard errors",
                self.worst()
            ));
        }
        out
    }

    /// Pairs with any uncertainty; exact pairs do not count.
    fn uncertain(&self) -> impl Iterator<Item = &Pair> {
        let certain = |p: &&Pair| p.z() == 0.0 && p.claimed + p.traced.luminance_error == 0.0;
        self.pairs.iter().filter(move |p| !certain(p))
    }

    /// Σz²/n over uncertain pairs. If errors are normal, independent and as claimed, its mean is 1
    /// and its standard deviation √(2/n).
    pub fn chi_square(&self) -> f64 {
        let sum: f64 = self.uncertain().map(|p| p.z().powi(2)).sum();
        sum / self.uncertain().count().max(1) as f64
    }

    /// The largest |z|.
    pub fn worst(&self) -> f64 {
        self.pairs.iter().fold(0.0, |w, p| w.max(p.z().abs()))
    }
}

impl fmt::Display for Comparison {
    /// Sums, sums by label, and a line per pair, worst first.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} pairs, chi²/n {:.3}, worst |z| {:.2}",
            self.pairs.len(),
            self.chi_square(),
            self.worst()
        )?;
        for (k, name) in ["R", "G", "B"].iter().enumerate() {
            writeln!(f, "{name:>20} {}", self.channel_bias(k))?;
        }
        for label in self.labels() {
            writeln!(f, "{label:>20} {}", self.label_bias(label))?;
        }
        let mut order: Vec<&Pair> = self.pairs.iter().collect();
        order.sort_by(|a, b| b.z().abs().total_cmp(&a.z().abs()));
        writeln!(
            f,
            "{:>20} {:>24} {:>11} {:>11} {:>11} {:>11} {:>6}",
            "", "position", "judged Y", "claimed", "traced Y", "s.e.", "z"
        )?;
        for p in order {
            let at = format!(
                "{:.3} {:.3} {:.3}",
                p.position.x, p.position.y, p.position.z
            );
            writeln!(
                f,
                "{:>20} {at:>24} {:>11.5e} {:>11.2e} {:>11.5e} {:>11.2e} {:>6.2}",
                p.label,
                luminance(p.judged),
                p.claimed,
                luminance(p.traced.mean),
                p.traced.luminance_error,
                p.z()
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::Random;
    use super::*;

    /// 400 pairs in two places whose judged values are correct times `factor`, with noise of
    /// `noise` claimed standard errors; both sides have one standard error.
    fn made_up(noise: f64, factor: f64) -> Comparison {
        let mut rng = Random::new(1, 1);
        // The sum of twelve uniform numbers is nearly normal, with variance 1.
        let mut normal = || (0..12).map(|_| rng.next()).sum::<f64>() - 6.0;
        let pair = |i: usize| {
            let truth = 1.0 + (i % 10) as f64;
            let error = 0.01 * truth;
            Pair {
                label: ["here", "there"][i % 2].into(),
                position: DVec3::ZERO,
                judged: DVec3::splat(truth * factor + noise * error * normal()),
                claimed: error,
                traced: Estimate {
                    mean: DVec3::splat(truth + error * normal()),
                    error: DVec3::splat(error),
                    luminance_error: error,
                },
            }
        };
        Comparison {
            pairs: (0..400).map(pair).collect(),
        }
    }

    #[test]
    fn a_right_list_passes() {
        let c = made_up(1.0, 1.0);
        assert_eq!(c.objections(0.0), Vec::<String>::new(), "{c}");
        // Standard deviation √(2/400) = 0.07.
        assert!((c.chi_square() - 1.0).abs() < 0.21, "{}", c.chi_square());
    }

    #[test]
    fn each_fault_is_named() {
        let of = |c: &Comparison, bound: f64| c.objections(bound).join("; ");
        // The sum is known to 0.01/√400 = 0.05 % on both sides; detection needs 3 of these plus the
        // bound.
        assert!(of(&made_up(1.0, 1.005), 0.0).contains("red differs by"));
        assert!(of(&made_up(1.0, 0.995), 0.0).contains("blue differs by"));
        assert!(!of(&made_up(1.0, 1.005), 0.01).contains("red differs by"));
        // Errors twice as large as claimed: χ²/n becomes (4 + 1)/2.
        assert!(of(&made_up(2.0, 1.0), 0.0).contains("chi²/n"));
        let mut c = made_up(1.0, 1.0);
        c.pairs[7].judged *= 1.2;
        assert!(of(&c, 0.0).contains("a pair differs"));
        let mut c = made_up(1.0, 1.0);
        for p in c.pairs.iter_mut().filter(|p| p.label == "here") {
            p.judged *= 1.06;
        }
        assert!(of(&c, 0.1).contains("here differs") && !of(&c, 0.1).contains("there differs"));
    }

    #[test]
    fn darkness_must_be_dark() {
        let mut c = made_up(1.0, 1.0);
        for p in &mut c.pairs {
            (p.judged, p.claimed, p.traced) = (DVec3::ZERO, 0.0, Estimate::default());
        }
        assert_eq!(c.objections(0.0), Vec::<String>::new());
        c.pairs[3].judged.y = 1e-6;
        assert!(c.objections(0.0).iter().any(|o| o.starts_with("a pair")));
    }
}
