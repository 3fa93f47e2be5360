//! Sums over the samples of one light at a receiver.

use glam::Vec3;

use super::{DirectEstimate, DirectParts, Kind};
use crate::world::luminance;

/// One sample of a light.
pub(super) struct Sample {
    /// Unoccluded irradiance that the sample stands for. With a closed form: the sample's weight in
    /// it times the radiance.
    pub value: Vec3,
    /// Share of it that arrives, per channel.
    pub passed: Vec3,
    /// Unit direction towards the light.
    pub direction: Vec3,
    /// Cosine between that direction and the receiver's normal, above 0.
    pub cos: f32,
    /// Light group.
    pub group: usize,
}

/// Sums over the samples of one light.
#[derive(Default)]
pub(super) struct Tally {
    /// Number of samples that count, and the mean and mean square of their transmittance
    /// (luminance).
    count: u32,
    passed: f32,
    squares: f32,
    least: f32,
    most: f32,
    /// Transmittance of the last sample that counts.
    last: Vec3,
    /// Transmittance assumed for later samples, without a ray.
    assumed: Option<Vec3>,
    /// What is recorded of the light.
    pub kind: Kind,
    pub rays: u32,
    /// Sums for lights that are estimated sample by sample.
    plain: Sums,
    /// Sums for lights with a closed form: the form per unit radiance, and the samples' weights in
    /// it.
    closed: Sums,
    unoccluded: f32,
    weight: f32,
    /// Use the samples as they are. The ratio estimator has a bias of order 1/n at shadow edges,
    /// which is negligible for the many samples of a lumel but not for the single one of
    /// `sample_one`.
    pub plainly: bool,
    /// See [`Known::beside`](super::Known::beside).
    pub beside: f32,
    /// Light group of the last sample.
    pub group: usize,
}

/// Sums over a light's samples so far, as luminances.
#[derive(Clone, Copy, Default)]
pub(super) struct Mark {
    /// Number of points.
    n: u32,
    plain: f32,
    closed: f32,
    weight: f32,
}

impl Mark {
    /// Squared difference between the estimates from these samples and from the further ones up to
    /// `later`, times the shares of both. `unoccluded` is the mean of the closed form.
    fn difference(&self, later: &Mark, unoccluded: f32) -> f32 {
        if self.n == 0 || later.n <= self.n {
            return 0.0;
        }
        let (a, b) = (self.n as f32, (later.n - self.n) as f32);
        let say = |n: f32, plain: f32, closed: f32, weight: f32| {
            plain / n
                + if weight > 0.0 {
                    unoccluded * closed / weight
                } else {
                    0.0
                }
        };
        let first = say(a, self.plain, self.closed, self.weight);
        let rest = say(
            b,
            later.plain - self.plain,
            later.closed - self.closed,
            later.weight - self.weight,
        );
        let share = a / (a + b);
        (first - rest) * (first - rest) * share * (1.0 - share)
    }
}

/// What is added up.
#[derive(Default)]
struct Sums {
    /// Light that arrives, and light that would arrive without occlusion.
    lit: Vec3,
    all: Vec3,
    /// `lit` by light group, if samples of one light belong to several groups; otherwise empty.
    groups: Vec<Vec3>,
    /// ∫ L dω and ∫ L ω dω.
    moments: Option<[Vec3; 4]>,
}

impl Sums {
    fn add(&mut self, s: &Sample, value: Vec3) {
        let lit = value * s.passed;
        self.all += value;
        self.lit += lit;
        if let Some(group) = self.groups.get_mut(s.group) {
            *group += lit;
        }
        if let Some(m) = &mut self.moments {
            // From irradiance back to radiance over solid angle.
            let flux = lit / s.cos;
            m[0] += flux;
            for k in 0..3 {
                m[k + 1] += flux * s.direction[k];
            }
        }
    }
}

impl Tally {
    /// For a light whose samples belong to `groups` groups; 1 unless light groups are requested.
    pub(super) fn new(parts: &DirectParts, groups: usize, kind: Kind) -> Self {
        let sums = || Sums {
            groups: if groups > 1 && !parts.groups.is_empty() {
                vec![Vec3::ZERO; groups]
            } else {
                Vec::new()
            },
            moments: (parts.moments)
                .filter(|_| !(kind.left_out && parts.kept.is_some()))
                .map(|_| [Vec3::ZERO; 4]),
            ..Sums::default()
        };
        Tally {
            plain: sums(),
            closed: sums(),
            kind,
            ..Tally::default()
        }
    }

    /// For the one sample of [`DirectLight::sample_one`](super::DirectLight::sample_one).
    pub(super) fn single() -> Self {
        Tally {
            plainly: true,
            ..Tally::default()
        }
    }

    /// After `scouts` samples, assumes for the rest what all of them saw; does nothing if they
    /// disagree.
    #[inline]
    pub(super) fn assume(&mut self, scouts: u32) {
        self.assumed = (self.count >= scouts && !self.mixed()).then_some(self.last);
    }

    /// Transmittance for a sample, by calling `cast` unless it is assumed.
    #[inline]
    pub(super) fn passed(&mut self, cast: impl FnOnce() -> Vec3) -> Vec3 {
        self.assumed.unwrap_or_else(|| {
            self.rays += 1;
            cast()
        })
    }

    /// Luminance that arrives, and that would arrive without occlusion, after samples at `n`
    /// points.
    pub(super) fn luminances(&self, n: u32) -> [f32; 2] {
        let (plain, closed) = self.scales(n);
        [
            luminance(self.plain.lit * plain + self.closed.lit * closed),
            luminance(self.plain.all * plain + self.closed.all * closed),
        ]
    }

    /// Whether at least one sample saw the light, and whether at least one did not.
    pub(super) fn seen(&self) -> [bool; 2] {
        [
            self.count > 0 && self.most > 0.0,
            self.count > 0 && self.least == 0.0,
        ]
    }

    /// Factors for the sums of plain samples and of samples with a closed form.
    fn scales(&self, n: u32) -> (f32, f32) {
        let plain = 1.0 / n as f32;
        let closed = if self.weight > 0.0 {
            self.unoccluded / n as f32 / self.weight
        } else {
            0.0
        };
        (plain, closed)
    }

    /// The sums now, after samples at `n` points.
    pub(super) fn mark(&self, n: u32) -> Mark {
        Mark {
            n,
            plain: luminance(self.plain.lit),
            closed: luminance(self.closed.lit),
            weight: self.weight,
        }
    }

    fn count_in(&mut self, passed: Vec3) {
        self.last = passed;
        let share = luminance(passed);
        if self.count == 0 {
            (self.least, self.most) = (share, share);
        }
        self.count += 1;
        self.passed += share;
        self.squares += share * share;
        self.least = self.least.min(share);
        self.most = self.most.max(share);
    }

    /// Whether samples disagree about visibility.
    pub(super) fn mixed(&self) -> bool {
        self.most > self.least
    }

    /// Light that arrived from all plain samples.
    pub(super) fn lit(&self) -> Vec3 {
        self.plain.lit
    }

    /// Adds a sample that stands for itself.
    pub(super) fn plain(&mut self, s: &Sample) {
        self.group = s.group;
        self.count_in(s.passed);
        self.plain.add(s, s.value);
    }

    /// Adds a point whose closed form is `unoccluded` (per unit radiance), with a sample whose
    /// weight in it is `weight`. The value of the sample is its weight times the radiance.
    pub(super) fn weighted(&mut self, unoccluded: f32, weight: f32, s: &Sample) {
        if self.plainly {
            self.plain(s);
            return;
        }
        self.group = s.group;
        self.unoccluded += unoccluded;
        self.count_in(s.passed);
        self.weight += weight;
        self.closed.add(s, s.value);
    }

    /// Adds a point whose closed form is `unoccluded` and whose sample has no weight.
    pub(super) fn unweighted(&mut self, unoccluded: f32) {
        self.unoccluded += unoccluded;
    }

    /// Adds the light to `out` and `parts`, after samples at `n` points.
    ///
    /// `marks` are the sums after about a quarter and about half of the samples, for
    /// [`DirectEstimate::doubt`].
    pub(super) fn finish(
        self,
        n: u32,
        marks: &[Mark; 2],
        out: &mut DirectEstimate,
        parts: &mut DirectParts,
    ) {
        out.rays += self.rays;
        let (plain, closed) = self.scales(n);
        let lit = self.plain.lit * plain + self.closed.lit * closed;
        out.irradiance += lit;
        if self.mixed() {
            let m = self.count as f32;
            let p = self.passed / m;
            let full = luminance(self.plain.all * plain + self.closed.all * closed);
            out.variance += full * full * (self.squares / m - p * p).max(0.0) / m;
            let unoccluded = self.unoccluded / n as f32;
            let [quarter, half] = marks;
            let whole = self.mark(n);
            out.doubt[0] += half.difference(&whole, unoccluded);
            out.doubt[1] += quarter.difference(half, unoccluded);
        }
        if let [one] = &mut parts.groups[..] {
            *one += lit;
        } else if !self.plain.groups.is_empty() {
            for (k, group) in parts.groups.iter_mut().enumerate() {
                *group += self.plain.groups[k] * plain + self.closed.groups[k] * closed;
            }
        } else if let Some(group) = parts.groups.get_mut(self.group) {
            *group += lit;
        }
        if let (Some(into), Some(a), Some(b)) =
            (&mut parts.moments, self.plain.moments, self.closed.moments)
        {
            for k in 0..4 {
                into[k] += a[k] * plain + b[k] * closed;
            }
        }
        let all = luminance(self.plain.all * plain + self.closed.all * closed);
        if let Some(sun) = parts.sun.as_mut().filter(|_| self.kind.sun) {
            sun[0] += luminance(lit);
            sun[1] += all;
        }
        if let Some(kept) = parts.kept.as_mut().filter(|_| !self.kind.left_out) {
            *kept += lit;
        }
        if let (Some((_, masks)), Some(c)) = (&mut parts.masks, self.kind.channel) {
            masks[c] = [luminance(lit), all];
        }
    }
}
