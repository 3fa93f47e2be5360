//! Takes sampling noise out of indirect light, and nothing else.
//!
//! Neighbouring lumels of one piece of surface gathered the same smooth function with independent
//! random numbers. A quadratic is fitted through their values by weighted least squares, in which a
//! neighbour counts only as far as its difference can be noise, by the estimated variances. Where
//! light truly changes, differences exceed the noise and the lumel keeps its value; along a
//! gradient or over a rounded maximum the fit has no bias. (A plane cut 1.2 % off the light between
//! two facing plates.)
//!
//! Each lumel's rays make two independent estimates, and the weights for one come from the other.
//! Weights from the values themselves would favour the likely ones, and where light comes from
//! little (a sunlit strip seen from a dark hall), few lumels have more than their share and most
//! have less: the demo level's hall lost 6 % of its light that way.
//!
//! Where bright and dark lumels lie side by side, the bright ones' noise hides the difference, and
//! the dark ones would be lightened. There a second fit goes by the first one's values, which have
//! a third of the noise, and by the variance of the lumels that are about as bright.
//!
//! Based on: Rousselle, Knaus, Zwicker, *Adaptive rendering with non-local means filtering*, 2012
//! (weights from estimated variances, and from the other half of the samples; a first result that
//! guides a second filter is theirs too); Moon, Carr, Yoon, *Adaptive rendering based on weighted
//! local regression*, 2014 (local fit). Direct light is not touched: it has no noise but in
//! penumbrae, where a filter could not tell a shadow's edge from it.

use glam::Vec3;
use radiosity::luminance;
use rayon::prelude::*;

use crate::between::{Taps, taps};
use crate::certainty::Certainty;
use crate::map::LumelMap;
use crate::quadratic::{TERMS, shares_of_fit};
use crate::received::{Edge, Received};
use crate::window::{REACH, Window};

/// A difference of this many standard errors halves a neighbour's weight and more: exp(−d²/2K²) =
/// 0.61 at K.
const SIGMAS: f32 = 2.0;

/// Lumels of less light than this times each other's are about as bright.
const ALIKE: f32 = 2.0;

/// Where lumels that are about as bright have less than this share of all neighbours' variance, the
/// second fit takes place.
const UNLIKE: f32 = 0.7;

/// Who keeps what it gathered.
#[derive(Clone, Copy)]
pub(crate) struct Trust<'t> {
    /// What variances are worth.
    pub certainty: &'t Certainty,
    /// By lumel's number: it has so many rays that what it says of itself can be trusted.
    pub sure: &'t (dyn Fn(usize) -> bool + Sync),
    /// The first planes of a lumel, which are shares of its light, and stay so.
    pub groups: usize,
}

/// Smooths the map's light in place; only `indirect` and the variances change.
///
/// Fits go by variances as they were gathered; what is left afterwards is by [`Trust::certainty`].
/// Lumels at contacts, which have many points, and those that are [sure](Trust::sure) of themselves
/// keep what they gathered where the fit departs from it by more than its noise: next to a bright
/// lumel a dark one would be lightened (demo level, 57 cm a lumel, `preview`: 18.9 % of error from
/// 3,000 contacts, 4.1 % without). The others do not: of few samples, most may have missed what all
/// of the light comes from. What they depart by goes into their error. A lumel that a wall cuts is
/// fitted to its whole neighbours on the same side, and is no surer of itself than they are: its
/// part had fewer rays. Left as they were gathered, such lumels drew speckles along the foot of
/// walls.
pub(crate) fn smooth_indirect(map: &mut LumelMap, trust: Trust) {
    // Lumels between smoothed ones need no fit of their own.
    let taps: Vec<Option<Taps>> = (0..map.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|i| {
            let taps = map.plan.follows(i).then(|| taps(map, i));
            taps.filter(|t| !t.list().is_empty())
        })
        .collect();
    let smoothed: Vec<Option<Smoothed>> = (fit_all(map, &taps).into_par_iter().enumerate())
        .with_min_len(256)
        .map(|(i, fitted)| (taps[i].is_none()).then(|| accept(map, i, fitted, trust)))
        .collect();
    for r in &mut map.received {
        r.direct_variance = trust.certainty.direct(r, r.direct_variance);
    }
    put(map, smoothed);
    let between: Vec<Option<Smoothed>> = (taps.par_iter())
        .with_min_len(256)
        .map(|taps| {
            let taps = taps.as_ref()?;
            Some(Smoothed::between(taps, &map.received, trust.groups))
        })
        .collect();
    put(map, between);
}

/// Gives lumels what smoothing made of them.
fn put(map: &mut LumelMap, smoothed: Vec<Option<Smoothed>>) {
    for (r, s) in map.received.iter_mut().zip(smoothed) {
        let Some(s) = s else { continue };
        r.indirect = s.indirect;
        r.indirect_variance = s.variance;
        r.least = s.least;
        for (plane, indirect) in r.planes.iter_mut().zip(s.planes) {
            plane.indirect = indirect;
        }
    }
}

/// What of a fit lumel `i` takes, with its error.
fn accept(map: &LumelMap, i: usize, mut smoothed: Smoothed, trust: Trust) -> Smoothed {
    let (r, certainty) = (&map.received[i], trust.certainty);
    let claimed = match r.open < 1.0 {
        true => Window::new(map).pooled_variance(i),
        false => r.indirect_variance,
    };
    let own = certainty.indirect(r, claimed);
    smoothed.variance = certainty.indirect(r, smoothed.variance);
    let departure = match map.plan.is(i) {
        true => 0.0,
        false => departure(r, smoothed.indirect, own),
    };
    if departure > 0.0 && (r.edge == Edge::Contact || (trust.sure)(i)) {
        smoothed = Smoothed::none(r, own);
    } else {
        smoothed.variance += departure;
        let gathered = luminance(r.indirect);
        let darker = departure > 0.0 && gathered < luminance(smoothed.indirect);
        let whole = luminance(r.direct + smoothed.indirect);
        let least = (luminance(r.direct) + gathered).max(certainty.unseen * whole);
        smoothed.least = darker.then_some(least);
    }
    let of_groups = trust.groups.min(smoothed.planes.len());
    share_out(smoothed.indirect, &mut smoothed.planes[..of_groups]);
    smoothed
}

/// A fit for each lumel that `taps` has none for: all by what was gathered, and once more where
/// that misleads.
fn fit_all(map: &LumelMap, taps: &[Option<Taps>]) -> Vec<Smoothed> {
    let (window, received) = (Window::new(map), &map.received);
    let of_own = |what: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
        let lumels = taps.par_iter().enumerate().with_min_len(256);
        lumels
            .map(|(i, t)| t.as_ref().map_or_else(|| what(i), |_| 0.0))
            .collect()
    };
    let pooled = of_own(&|i| window.pooled_variance(i));
    let gathered: Vec<[f32; 2]> = (received.iter())
        .map(|r| r.halves().map(luminance))
        .collect();
    let by_gathered = Judge {
        halves: &gathered,
        noise: &pooled,
    };
    let mut fits: Vec<Smoothed> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|i| match &taps[i] {
            None => fit(map, i, &by_gathered, &pooled),
            Some(_) => Smoothed::none(&received[i], received[i].indirect_variance),
        })
        .collect();
    let light: Vec<f32> = fits.iter().map(|s| luminance(s.indirect)).collect();
    let alike = of_own(&|i| window.variance_of_alike(i, &light, ALIKE));
    let halves: Vec<[f32; 2]> = fits.iter().map(|s| s.halves().map(luminance)).collect();
    // What the first fit left of the noise.
    let left: Vec<f32> = (fits.iter().zip(&pooled).zip(&alike))
        .map(|((s, pooled), alike)| match *pooled > 0.0 {
            true => alike * s.variance / pooled,
            false => 0.0,
        })
        .collect();
    let by_first = Judge {
        halves: &halves,
        noise: &left,
    };
    let again: Vec<(usize, Smoothed)> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .filter(|&i| alike[i] < UNLIKE * pooled[i])
        .map(|i| (i, fit(map, i, &by_first, &alike)))
        .collect();
    for (i, fit) in again {
        fits[i] = fit;
    }
    fits
}

/// Takes away what is below zero from groups that sum to `whole`, and from the others in proportion
/// what that adds: a fit may dip below zero for a group that brings next to nothing, though not for
/// their sum.
fn share_out(whole: Vec3, groups: &mut [Vec3]) {
    if groups.iter().all(|g| g.min_element() >= 0.0) {
        return;
    }
    for channel in 0..3 {
        let left: f32 = groups.iter().map(|g| g[channel].max(0.0)).sum();
        let scale = if left > 0.0 {
            whole[channel] / left
        } else {
            0.0
        };
        for g in groups.iter_mut() {
            g[channel] = g[channel].max(0.0) * scale;
        }
    }
}

/// By what it is decided whether lumels have the same light.
struct Judge<'j> {
    /// Luminance of each lumel's two halves.
    halves: &'j [[f32; 2]],
    /// Variance of the luminance of both halves' mean.
    noise: &'j [f32],
}

/// A lumel's light after smoothing.
struct Smoothed {
    indirect: Vec3,
    /// The same from the first half of the samples.
    first_half: Vec3,
    /// Of its luminance.
    variance: f32,
    /// See [`Received::least`].
    least: Option<f32>,
    /// Indirect parts of its planes; empty where they stay as they are.
    planes: Vec<Vec3>,
}

impl Smoothed {
    /// Between lumels that are smoothed already.
    fn between(taps: &Taps, received: &[Received], groups: usize) -> Self {
        let planes = received[taps.list()[0].0].planes.len();
        let mut out = Smoothed {
            indirect: Vec3::ZERO,
            first_half: Vec3::ZERO,
            variance: 0.0,
            least: None,
            planes: vec![Vec3::ZERO; planes],
        };
        for &(j, weight) in taps.list() {
            let r = &received[j];
            out.indirect += r.indirect * weight;
            // Neighbours were fitted to the same samples: their errors are one.
            out.variance += r.indirect_variance * weight;
            for (sum, plane) in out.planes.iter_mut().zip(&r.planes) {
                *sum += plane.indirect * weight;
            }
        }
        (out.indirect, out.variance) = (out.indirect.max(Vec3::ZERO), out.variance.max(0.0));
        share_out(out.indirect, &mut out.planes[..groups.min(planes)]);
        out
    }

    /// What was gathered.
    fn none(r: &Received, variance: f32) -> Self {
        Smoothed {
            indirect: r.indirect,
            first_half: r.first_half,
            variance,
            least: None,
            planes: Vec::new(),
        }
    }

    /// From the two halves of the samples.
    fn halves(&self) -> [Vec3; 2] {
        [self.first_half, 2.0 * self.indirect - self.first_half]
    }
}

/// What a fit may differ by from what was gathered, in standard errors of that, before the
/// difference is the fit's fault.
const DEPARTS: f32 = 3.0;

/// Square of what the fit is off, as far as the lumel's own samples tell: the squared difference
/// less what noise has of it.
fn departure(r: &Received, fitted: Vec3, own: f32) -> f32 {
    let difference = luminance(fitted - r.indirect);
    let square = difference * difference;
    if square > DEPARTS * DEPARTS * own {
        square - own
    } else {
        0.0
    }
}

/// Smoothed indirect irradiance of lumel `i`, and the variance of its luminance. `variance` is that
/// of what was gathered.
fn fit(map: &LumelMap, i: usize, by: &Judge, variance: &[f32]) -> Smoothed {
    let (own, received) = (&map.received[i], &map.received);
    let keep = |variance: f32| Smoothed::none(own, variance);
    if variance[i] <= 0.0 || own.open == 0.0 {
        return keep(own.indirect_variance);
    }
    let (around, n) = Window::new(map).around(i);
    if n < 2 * TERMS {
        return keep(variance[i]);
    }
    let halves: Vec<[Vec3; 2]> = around[..n].iter().map(|a| received[a.0].halves()).collect();
    let wide = (around[..n].iter()).any(|a| a.1.abs().max(a.2.abs()) > REACH);
    let reach = if wide { 2 * REACH } else { REACH };
    let (mut sum, mut fitted) = ([Vec3::ZERO; 2], 0f32);
    let mut planes = vec![Vec3::ZERO; own.planes.len()];
    for (judge, judged) in [(0, 1), (1, 0)] {
        let value = by.halves[i][judge];
        let weigh = |k: usize| {
            let (j, dx, dy) = around[k];
            let d = by.halves[j][judge] - value;
            let near = (-0.5 * (dx * dx + dy * dy) as f32 / (reach * reach) as f32).exp();
            likely(d, by.noise[i] + by.noise[j]) * near * map.lumel(j).coverage.max(0.05)
        };
        let Some(shares) = shares_of_fit(&around[..n], weigh) else {
            return keep(variance[i]);
        };
        for (k, share) in shares[..n].iter().enumerate() {
            sum[judged] += halves[k][judged] * *share;
            for (plane, of) in planes.iter_mut().zip(&received[around[k].0].planes) {
                *plane += of.halves()[judged] * (0.5 * share);
            }
            // As if both fits went by the same weights, which holds where neighbours are alike.
            fitted += 0.5 * share * share * variance[around[k].0];
        }
    }
    let indirect = 0.5 * (sum[0] + sum[1]);
    if !(fitted < variance[i] && indirect.is_finite() && indirect.min_element() >= 0.0) {
        return keep(variance[i]);
    }
    Smoothed {
        indirect,
        first_half: sum[0],
        variance: fitted,
        least: None,
        planes,
    }
}

/// How much a neighbour counts whose half of the samples differs by `d`, where the variances of
/// both wholes sum to `noise`.
pub(crate) fn likely(d: f32, noise: f32) -> f32 {
    // A half has twice the variance of the whole.
    let noise = (2.0 * noise).max(f32::MIN_POSITIVE);
    (-d * d / (2.0 * SIGMAS * SIGMAS * noise)).exp()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::barriers::Barriers;
    use crate::plan::Plan;
    use crate::window::REACH;
    use atlas::{Layout, Lumel, Lumels, TexelIndex};

    /// Random numbers about 0 with a standard deviation of one.
    pub(crate) fn normal_numbers() -> impl FnMut() -> f32 {
        let mut state = 1u32;
        let mut uniform = move || {
            state = radiosity::hash_u32(state);
            state as f32 * 2f32.powi(-32)
        };
        // Sum of twelve, each with a variance of a twelfth.
        move || (0..12).map(|_| uniform()).sum::<f32>() - 6.0
    }

    /// Rows of luminance after smoothing, on a floor with `light(x)` at column x, which was
    /// gathered with standard errors `noise(x)`.
    fn smoothed(light: impl Fn(u32) -> f32, noise: impl Fn(u32) -> f32) -> Vec<Vec<f32>> {
        const SIZE: u32 = 48;
        let mut normal = normal_numbers();
        let (mut lumels, mut received) = (Lumels::default(), Vec::new());
        for [x, y] in (0..SIZE * SIZE).map(|k| [k % SIZE, k / SIZE]) {
            lumels.lumels.push(Lumel {
                page: 0,
                texel: [x, y],
                instance: 0,
                first: 0,
                count: 1,
                coverage: 1.0,
            });
            // Halves have twice the variance.
            let halves = [0; 2].map(|_| light(x) + noise(x) * 2f32.sqrt() * normal());
            received.push(Received {
                indirect: Vec3::splat(0.5 * (halves[0] + halves[1])),
                first_half: Vec3::splat(halves[0]),
                indirect_variance: noise(x) * noise(x),
                position: Vec3::new(x as f32, y as f32, 0.0),
                normal: Vec3::Z,
                size: 1.0,
                open: 1.0,
                ..Received::default()
            });
        }
        let layout = Layout {
            pages: vec![[SIZE; 2]],
            ..Layout::default()
        };
        let certainty = Certainty::measure(&received, |_| true, 128, 1.0);
        let mut map = LumelMap {
            index: TexelIndex::build(&lumels.lumels, &layout),
            plan: Plan::none(received.len()),
            barriers: Barriers::default(),
            times: vec![1; received.len()],
            lumels,
            received,
        };
        let trust = Trust {
            certainty: &certainty,
            sure: &|_| false,
            groups: 0,
        };
        smooth_indirect(&mut map, trust);
        let row = |y: u32| &map.received[(y * SIZE) as usize..((y + 1) * SIZE) as usize];
        (REACH as u32..SIZE - REACH as u32)
            .map(|y| row(y).iter().map(|r| luminance(r.indirect)).collect())
            .collect()
    }

    #[test]
    fn dark_lumels_beside_noisy_bright_ones_stay_dark() {
        // A floor by the rim of a shaft, with what 128 rays leave of noise: three tenths of the
        // light.
        let light = |x: u32| if x < 24 { 1.0 } else { 0.03 };
        let rows = smoothed(light, |x| 0.3 * light(x));
        for x in 24..36 {
            let mean = rows.iter().map(|row| row[x]).sum::<f32>() / rows.len() as f32;
            // The window's other dark lumels leave an error of a third of a lumel's light; over the
            // rows a quarter of that. One fit makes 0.26 of the first column.
            assert!((mean - 0.03).abs() < 0.01, "{x}: {mean}");
        }
    }

    #[test]
    fn groups_stay_shares_of_their_sum() {
        let whole = Vec3::new(1.0, 2.0, 0.0);
        let mut groups = [
            Vec3::new(1.1, 0.5, 0.0),
            Vec3::new(-0.1, 0.5, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
        ];
        share_out(whole, &mut groups);
        assert!(groups.iter().all(|g| g.min_element() >= 0.0));
        // One rounding of each share.
        let sum: Vec3 = groups.iter().sum();
        assert!((sum - whole).abs().max_element() <= 3e-7, "{sum}");
        assert_eq!(groups[1].x, 0.0);
        // What is not below zero is left alone.
        assert_eq!(groups[2].y, 1.0);
    }
}
