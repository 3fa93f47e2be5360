//! Denoises indirect light.
//!
//! Neighbouring lumels on a piece of surface sampled the same smooth function with independent
//! random numbers. A quadratic is fitted to their values by weighted least squares, in which a
//! neighbour counts only as far as its difference can be explained by noise, according to the
//! estimated variances. Where light really changes, differences exceed the noise and the lumel
//! keeps its value. Along a gradient or over a rounded maximum the fit is unbiased. (A plane
//! removed 1.2 % of the light between two facing plates.)
//!
//! Each lumel's rays give two independent estimates, and the weights for one come from the other.
//! Weights from the values themselves would favour likely values. Where light comes from a small
//! region (a sunlit strip seen from a dark hall), few lumels have more than their share and most
//! have less: the demo level's hall lost 6 % of its light.
//!
//! Where bright and dark lumels are neighbours, the bright ones' noise hides the difference, and
//! the dark ones would be brightened. There a second fit uses the first one's values, which have a
//! third of the noise, and the variance of lumels of similar brightness.
//!
//! Based on: Rousselle, Knaus, Zwicker, *Adaptive rendering with non-local means filtering*, 2012
//! (weights from estimated variances and from the other half of the samples, and a first result
//! that guides a second filter); Moon, Carr, Yoon, *Adaptive rendering based on weighted local
//! regression*, 2014 (local fit). Direct light is not filtered: it only has noise in penumbrae,
//! where a filter could not distinguish noise from the shadow edge.

use glam::Vec3;
use radiosity::luminance;
use rayon::prelude::*;

use crate::between::{Taps, taps};
use crate::certainty::Certainty;
use crate::map::LumelMap;
use crate::quadratic::shares_of_fit;
use crate::received::{Edge, Received};
use crate::window::{REACH, Sight, WIDE, Window};

/// Scale of the weights in standard errors: exp(−d²/2K²) = 0.61 at a difference of K.
const SIGMAS: f32 = 2.0;

/// Lumels have similar brightness if neither has more than this many times the other's light.
const ALIKE: f32 = 2.0;

/// The second fit is used where lumels of similar brightness have less than this fraction of all
/// neighbours' variance.
const UNLIKE: f32 = 0.7;

/// Which lumels keep their gathered light.
#[derive(Clone, Copy)]
pub(crate) struct Trust<'t> {
    /// Corrections of the variances.
    pub certainty: &'t Certainty,
    /// Whether a lumel, given by its index, has so many rays that its own estimates can be trusted.
    pub sure: &'t (dyn Fn(usize) -> bool + Sync),
    /// Number of planes, the first ones of a lumel, that are parts of its light and must sum to it.
    pub groups: usize,
}

/// Smooths the map's light in place; only `indirect` and the variances change.
///
/// Fits use the gathered variances; the remaining variance is corrected by [`Trust::certainty`].
///
/// Lumels at contacts, which have many points, and [sure](Trust::sure) lumels keep their gathered
/// light where the fit departs from it by more than noise: otherwise a dark lumel next to a bright
/// one would be brightened (demo level, 57 cm per lumel, `preview`: 18.9 % error from 3,000
/// contacts instead of 4.1 %). Other lumels do not, because most of their few samples may have
/// missed the source of the light; their departure is added to their error.
///
/// Lumels that a wall cuts are smoothed among themselves, and then take a mean of their own light
/// and that of their whole neighbours on the same side, by their certainty ([`settle_cut`]).
/// Unsmoothed, such lumels formed speckles along the foot of walls.
pub(crate) fn smooth_indirect(map: &mut LumelMap, trust: Trust) {
    // Lumels between smoothed ones need no fit.
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
    let settled: Vec<(usize, Smoothed)> = (0..map.len())
        .into_par_iter()
        .with_min_len(256)
        .filter(|&i| Sight::of(&map.received[i]) == Sight::Cut)
        .filter_map(|i| Some((i, settle_cut(map, i)?)))
        .collect();
    for (i, s) in settled {
        set(&mut map.received[i], s);
    }
}

/// Most distance in texels of neighbours that a cut lumel is settled with.
const BESIDE: i64 = 2;

/// How far the light of a cut lumel is expected to be from that of its neighbours, relative to it,
/// as a standard deviation: corners are darker than walls, by a fifth within a lumel or two.
const DIFFERS: f32 = 0.2;

/// The light of lumel `i`, which a wall cuts: between its own and its neighbours', by their
/// certainty, unless they differ by more than noise: a lumel between a cupboard and the back of a
/// chair is not as dark as those behind the chair. `None` without any.
fn settle_cut(map: &LumelMap, i: usize) -> Option<Smoothed> {
    let own = &map.received[i];
    let variance = own.indirect_variance;
    let (around, n) = Window::new(map).connected(i, BESIDE, Sight::Whole);
    let (mut all, mut light, mut of_mean) = (0.0, Vec3::ZERO, 0.0);
    let mut planes = vec![Vec3::ZERO; own.planes.len()];
    for &(j, dx, dy) in &around[..n] {
        if j == i {
            continue;
        }
        let (r, weight) = (&map.received[j], 1.0 / (dx * dx + dy * dy) as f32);
        all += weight;
        light += r.indirect * weight;
        // Smoothed neighbours share their samples.
        of_mean += r.indirect_variance * weight;
        for (sum, plane) in planes.iter_mut().zip(&r.planes) {
            *sum += plane.indirect * weight;
        }
    }
    if all <= 0.0 {
        return None;
    }
    let (light, of_mean) = (light / all, of_mean / all);
    let differs = DIFFERS * luminance(light);
    let apart = luminance(light - own.indirect);
    let expected = of_mean + (differs * differs).max(apart * apart - variance - of_mean);
    let share = expected / (expected + variance).max(f32::MIN_POSITIVE);
    for (plane, of) in planes.iter_mut().zip(&own.planes) {
        *plane = (*plane / all).lerp(of.indirect, share);
    }
    Some(Smoothed {
        indirect: light.lerp(own.indirect, share),
        first_half: own.first_half,
        variance: share * variance,
        least: None,
        planes,
    })
}

/// Stores the result of smoothing.
fn put(map: &mut LumelMap, smoothed: Vec<Option<Smoothed>>) {
    for (r, s) in map.received.iter_mut().zip(smoothed) {
        if let Some(s) = s {
            set(r, s);
        }
    }
}

fn set(r: &mut Received, s: Smoothed) {
    r.indirect = s.indirect;
    r.indirect_variance = s.variance;
    r.least = s.least;
    for (plane, indirect) in r.planes.iter_mut().zip(s.planes) {
        plane.indirect = indirect;
    }
}

/// The part of a fit that lumel `i` takes, with its error.
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

/// A fit for each lumel without taps: based on the gathered values, and repeated where those
/// mislead.
fn fit_all(map: &LumelMap, taps: &[Option<Taps>]) -> Vec<Smoothed> {
    let (window, received) = (Window::new(map), &map.received);
    let of_own = |what: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
        let lumels = taps.par_iter().enumerate().with_min_len(256);
        lumels
            .map(|(i, t)| match t.is_some() || map.plan.is_calm(i) {
                true => 0.0,
                false => what(i),
            })
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
    // Noise remaining after the first fit.
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

/// Removes negative parts of groups that sum to `whole`, and reduces the others in proportion: a
/// fit may be negative for a group that contributes almost nothing, though not for the sum.
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

/// The data that decides whether lumels have the same light.
struct Judge<'j> {
    /// Luminance of each lumel's two halves.
    halves: &'j [[f32; 2]],
    /// Variance of the luminance of both halves' mean.
    noise: &'j [f32],
}

/// A lumel's light after smoothing.
struct Smoothed {
    indirect: Vec3,
    /// The fit of the first half of the samples.
    first_half: Vec3,
    /// Variance of its luminance.
    variance: f32,
    /// See [`Received::least`].
    least: Option<f32>,
    /// Indirect parts of its planes; empty if they stay unchanged.
    planes: Vec<Vec3>,
}

impl Smoothed {
    /// Interpolated between lumels that are already smoothed.
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
            // Neighbours were fitted to the same samples, so their errors are fully correlated.
            out.variance += r.indirect_variance * weight;
            for (sum, plane) in out.planes.iter_mut().zip(&r.planes) {
                *sum += plane.indirect * weight;
            }
        }
        (out.indirect, out.variance) = (out.indirect.max(Vec3::ZERO), out.variance.max(0.0));
        share_out(out.indirect, &mut out.planes[..groups.min(planes)]);
        out
    }

    /// The gathered light.
    fn none(r: &Received, variance: f32) -> Self {
        Smoothed {
            indirect: r.indirect,
            first_half: r.first_half,
            variance,
            least: None,
            planes: Vec::new(),
        }
    }

    /// The fits of the two halves of the samples.
    fn halves(&self) -> [Vec3; 2] {
        [self.first_half, 2.0 * self.indirect - self.first_half]
    }
}

/// Difference between a fit and the gathered light, in standard errors of the latter, from which
/// the fit is considered wrong.
const DEPARTS: f32 = 3.0;

/// Squared error of the fit as far as the lumel's own samples show it: the squared difference minus
/// the part explained by noise.
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
/// of the gathered light.
fn fit(map: &LumelMap, i: usize, by: &Judge, variance: &[f32]) -> Smoothed {
    let (own, received) = (&map.received[i], &map.received);
    let keep = |variance: f32| Smoothed::none(own, variance);
    if variance[i] <= 0.0 || Sight::of(own) == Sight::Hidden {
        return keep(own.indirect_variance);
    }
    let (around, n) = Window::new(map).around(i);
    let halves: Vec<[Vec3; 2]> = around[..n].iter().map(|a| received[a.0].halves()).collect();
    let wide = (around[..n].iter()).any(|a| a.1.abs().max(a.2.abs()) > REACH);
    let reach = if wide { WIDE } else { REACH };
    let (mut sum, mut fitted) = ([Vec3::ZERO; 2], 0f32);
    let mut planes = vec![Vec3::ZERO; own.planes.len()];
    for (judge, judged) in [(0, 1), (1, 0)] {
        let value = by.halves[i][judge];
        let weigh = |k: usize| {
            let (j, dx, dy) = around[k];
            let d = by.halves[j][judge] - value;
            let near = libm::expf(-0.5 * (dx * dx + dy * dy) as f32 / (reach * reach) as f32);
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
            // As if both fits used the same weights, which is true if neighbours are similar.
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

/// Weight of a neighbour whose half of the samples differs by `d`, if the variances of both whole
/// estimates sum to `noise`.
pub(crate) fn likely(d: f32, noise: f32) -> f32 {
    // A half has twice the variance of the whole.
    let noise = (2.0 * noise).max(f32::MIN_POSITIVE);
    libm::expf(-d * d / (2.0 * SIGMAS * SIGMAS * noise))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::barriers::Barriers;
    use crate::plan::Plan;
    use atlas::{Layout, Lumel, Lumels, TexelIndex};

    /// Random numbers with mean 0 and standard deviation 1.
    pub(crate) fn normal_numbers() -> impl FnMut() -> f32 {
        let mut state = 1u32;
        let mut uniform = move || {
            state = radiosity::hash_u32(state);
            state as f32 * 2f32.powi(-32)
        };
        // Sum of twelve, each with a variance of a twelfth.
        move || (0..12).map(|_| uniform()).sum::<f32>() - 6.0
    }

    /// A map of one flat surface with the light of its lumels, row by row.
    pub(crate) fn map_of(received: Vec<Received>, [width, height]: [u32; 2]) -> LumelMap {
        let texels = (0..width * height).map(|k| [k % width, k / width]);
        let mut lumels = Lumels::default();
        lumels.lumels.extend(texels.map(|texel| Lumel {
            page: 0,
            texel,
            instance: 0,
            first: 0,
            count: 1,
            coverage: 1.0,
        }));
        let layout = Layout {
            pages: vec![[width, height]],
            ..Layout::default()
        };
        LumelMap {
            index: TexelIndex::build(&lumels.lumels, &layout),
            plan: Plan::none(received.len()),
            barriers: Barriers::default(),
            times: vec![1; received.len()],
            has: vec![true],
            lumels,
            received,
        }
    }

    /// Rows of luminance after smoothing a surface of so many lumels. `lumel` gives the light of
    /// each column and row, its standard error, and how much of the lumel is visible.
    fn smoothed([width, height]: [u32; 2], lumel: impl Fn(u32, u32) -> [f32; 3]) -> Vec<Vec<f32>> {
        let mut normal = normal_numbers();
        let received = (0..width * height).map(|k| {
            let [x, y] = [k % width, k / width];
            let [light, noise, open] = lumel(x, y);
            // Halves have twice the variance.
            let halves = [0; 2].map(|_| light + noise * 2f32.sqrt() * normal());
            Received {
                indirect: Vec3::splat(0.5 * (halves[0] + halves[1])),
                first_half: Vec3::splat(halves[0]),
                indirect_variance: noise * noise,
                position: Vec3::new(x as f32, y as f32, 0.0),
                normal: Vec3::Z,
                size: 1.0,
                open,
                ..Received::default()
            }
        });
        let mut map = map_of(received.collect(), [width, height]);
        let certainty = Certainty::measure(&map.received, |_| true, 128, 1.0);
        let trust = Trust {
            certainty: &certainty,
            sure: &|_| false,
            groups: 0,
        };
        smooth_indirect(&mut map, trust);
        let light = |r: &Received| luminance(r.indirect);
        let rows = map.received.chunks(width as usize);
        rows.map(|row| row.iter().map(light).collect()).collect()
    }

    /// Standard deviation of a row from this light, without the ends.
    fn deviation(row: &[f32], light: f32) -> f32 {
        let inner = &row[WIDE as usize..row.len() - WIDE as usize];
        let squares: f32 = inner.iter().map(|x| (x - light).powi(2)).sum();
        (squares / inner.len() as f32).sqrt()
    }

    #[test]
    fn narrow_surfaces_are_smoothed_along_their_length() {
        for height in [1, 2, 3] {
            let rows = smoothed([2000, height], |_, _| [1.0, 0.1, 1.0]);
            for row in &rows {
                // Thirteen columns leave 0.42 of one row's noise; weights that differences reduce
                // leave a little more. Without a fit, all of it stays.
                let left = deviation(row, 1.0) / 0.1;
                assert!(left < 0.5, "{height} rows: {left} of the noise");
            }
        }
    }

    #[test]
    fn lumels_along_the_foot_of_a_wall_are_smoothed_among_themselves() {
        // A wall cuts the last row, which is darker, with twice the noise.
        let rows = smoothed([2000, 12], |_, y| match y {
            11 => [0.5, 0.1, 0.6],
            _ => [1.0, 0.05, 1.0],
        });
        let mean = rows[11].iter().sum::<f32>() / 2000.0;
        let left = deviation(&rows[11], mean) / 0.1;
        assert!(left < 0.5, "{left} of the noise");
        // It keeps its light but for a fraction: a fifth of its neighbours' light is what it is
        // expected to differ by, and twice that is what it does.
        assert!((mean - 0.5).abs() < 0.05, "{mean}");
    }

    #[test]
    fn bright_cut_lumels_beside_dark_whole_ones_stay_bright() {
        // The slot between a cupboard, which cuts the last row, and a chair in front of the others.
        let rows = smoothed([2000, 12], |_, y| match y {
            11 => [0.15, 0.05, 0.9],
            _ => [0.01, 0.01, 1.0],
        });
        let mean = rows[11].iter().sum::<f32>() / 2000.0;
        // Of its noise a third is left, 0.016. That is a seventieth of the squared difference, and so
        // much of the difference is given up: 0.002.
        assert!((mean - 0.15).abs() < 0.005, "{mean}");
    }

    #[test]
    fn dark_lumels_beside_noisy_bright_ones_stay_dark() {
        // A floor at the rim of a shaft with the noise of 128 rays: 30 % of the light.
        let light = |x: u32| if x < 24 { 1.0 } else { 0.03 };
        let rows = smoothed([48; 2], |x, _| [light(x), 0.3 * light(x), 1.0]);
        let rows = &rows[REACH as usize..48 - REACH as usize];
        for x in 24..36 {
            let mean = rows.iter().map(|row| row[x]).sum::<f32>() / rows.len() as f32;
            // The window's other dark lumels leave an error of a third of a lumel's light; the mean
            // over rows has a quarter of that. A single fit gives 0.26 in the first column.
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
        // Non-negative groups stay unchanged.
        assert_eq!(groups[2].y, 1.0);
    }
}
