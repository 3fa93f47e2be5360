//! Takes sampling noise out of indirect light, and nothing else.
//!
//! Neighbouring lumels of one piece of surface gathered the same smooth function with independent random numbers. A quadratic is
//! fitted through their values by weighted least squares, in which a neighbour counts only as far as its difference can be
//! noise, by the estimated variances. Where light truly changes, differences exceed the noise and the lumel keeps its
//! value; along a gradient or over a rounded maximum the fit has no bias. (A plane cut 1.2 % off the light between two facing plates.)
//!
//! Each lumel's rays make two independent estimates, and the weights for one come from the other. Weights from the values themselves would
//! favour the likely ones, and where light comes from little (a sunlit strip seen from a dark hall), few lumels have more than their share and most
//! have less: the demo level's hall lost 6 % of its light that way.
//!
//! Where bright and dark lumels lie side by side, the bright ones' noise hides the difference, and the dark ones would be lightened. There a second fit goes
//! by the first one's values, which have a third of the noise, and by the variance of the lumels that are about as bright.
//!
//! Based on: Rousselle, Knaus, Zwicker, *Adaptive rendering with non-local means filtering*, 2012 (weights from estimated variances, and
//! from the other half of the samples; a first result that guides a second filter is theirs too);
//! Moon, Carr, Yoon, *Adaptive rendering based on weighted local regression*, 2014 (local fit). Direct light is not
//! touched: it has no noise but in penumbrae, where a filter could not tell a shadow's edge from it.

use glam::Vec3;
use radiosity::luminance;
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::certainty::Certainty;
use crate::gather::{Edge, Received};
use crate::lumels::{Lumel, Lumels, TexelIndex};
use crate::sparse::{Sparse, Taps};
use crate::walls::Barriers;

/// Texels on each side of a lumel that take part: 48 neighbours for a fit of six unknowns, which leaves about a tenth of the
/// variance, a third of the noise.
const REACH: i64 = 3;

/// Unknowns of a quadratic in two variables.
const TERMS: usize = 6;

/// A difference of this many standard errors halves a neighbour's weight and more: exp(−d²/2K²) = 0.61 at K.
const SIGMAS: f32 = 2.0;

/// Lumels of less light than this times each other's are about as bright.
const ALIKE: f32 = 2.0;

/// Where lumels that are about as bright have less than this share of all neighbours' variance, the second fit takes place.
const UNLIKE: f32 = 0.7;

/// Cosine between normals below which two lumels see too different hemispheres. About 30°: along a curve light changes steadily, which
/// the plane follows, and pillars are a few lumels around.
pub(crate) const SAME_FACING: f32 = 0.85;

/// Lumels of a window.
pub(crate) const SIDE: usize = (2 * REACH + 1) as usize;

/// Smooths `received` in place; only `indirect`, its variance and `error` change.
///
/// The first `groups` planes of a lumel are shares of its light, and stay so. Fits go by variances as they were gathered; what is left afterwards is by `certainty`.
/// Lumels at contacts, which have many points, and those that are `sure` of themselves keep what they gathered where the fit departs from it by more than
/// its noise: next to a bright lumel a dark one would be lightened (demo level, 57 cm a lumel, `preview`: 18.9 % of error from 3,000 contacts, 4.1 % without). The
/// others do not: of few samples, most may have missed what all of the light comes from. What they depart by goes into their error. A lumel that a wall cuts is
/// fitted to its whole neighbours on the same side, and is no surer of itself than they are: its part had fewer rays. Left as they were gathered, such lumels
/// drew speckles along the foot of walls.
#[allow(
    clippy::too_many_arguments,
    reason = "what a bake holds when it has gathered"
)]
pub(crate) fn smooth_indirect(
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
    barriers: &Barriers,
    sparse: &Sparse,
    groups: usize,
    certainty: &Certainty,
    sure: &(dyn Fn(usize) -> bool + Sync),
) {
    let window = Window::new(lumels, layout, received, barriers, sparse);
    // Lumels between smoothed ones need no fit of their own.
    let taps: Vec<Option<Taps>> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|i| {
            let follows = sparse.follows(i);
            let taps = follows.then(|| sparse.taps(lumels, &window.index, received, i));
            taps.filter(|t| !t.list().is_empty())
        })
        .collect();
    let fits = fit_all(&window, &taps);
    let smoothed: Vec<Smoothed> = (fits.into_par_iter().enumerate())
        .with_min_len(256)
        .map(|(i, mut smoothed)| {
            let r = &received[i];
            if taps[i].is_some() {
                return smoothed;
            }
            let claimed = match r.open < 1.0 {
                true => window.pooled_variance(i),
                false => r.indirect_variance,
            };
            let own = certainty.indirect(r, claimed);
            smoothed.variance = certainty.indirect(r, smoothed.variance);
            let departure = if sparse.is(i) {
                0.0
            } else {
                departure(r, smoothed.indirect, own)
            };
            if departure > 0.0 && (r.edge == Edge::Contact || sure(i)) {
                smoothed = Smoothed::none(r, own);
            } else {
                smoothed.variance += departure;
                let gathered = luminance(r.indirect);
                let darker = departure > 0.0 && gathered < luminance(smoothed.indirect);
                let whole = luminance(r.direct + smoothed.indirect);
                let least = (luminance(r.direct) + gathered).max(certainty.unseen * whole);
                smoothed.least = darker.then_some(least);
            }
            let of_groups = groups.min(smoothed.planes.len());
            share_out(smoothed.indirect, &mut smoothed.planes[..of_groups]);
            smoothed
        })
        .collect();
    for (r, s) in received.iter_mut().zip(smoothed) {
        let direct = certainty.direct(r, r.direct_variance());
        r.indirect = s.indirect;
        r.indirect_variance = s.variance;
        r.least = s.least;
        r.error = (direct + s.variance).sqrt();
        for (plane, indirect) in r.planes.iter_mut().zip(s.planes) {
            plane.indirect = indirect;
        }
    }
    let between: Vec<Option<Smoothed>> = (taps.par_iter())
        .with_min_len(256)
        .map(|taps| {
            taps.as_ref()
                .map(|t| Smoothed::between(t, received, groups))
        })
        .collect();
    for (r, s) in received.iter_mut().zip(between) {
        let Some(s) = s else { continue };
        let direct = certainty.direct(r, r.direct_variance());
        r.indirect = s.indirect;
        r.indirect_variance = s.variance;
        r.error = (direct + s.variance).sqrt();
        for (plane, indirect) in r.planes.iter_mut().zip(s.planes) {
            plane.indirect = indirect;
        }
    }
}

/// A fit for each lumel that `taps` has none for: all by what was gathered, and once more where that misleads.
fn fit_all(window: &Window, taps: &[Option<Taps>]) -> Vec<Smoothed> {
    let received = window.received;
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
            None => window.fit(i, &by_gathered, &pooled),
            Some(_) => Smoothed::none(&received[i], received[i].indirect_variance),
        })
        .collect();
    let light: Vec<f32> = fits.iter().map(|s| luminance(s.indirect)).collect();
    let alike = of_own(&|i| window.variance_of_alike(i, &light));
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
        .map(|i| (i, window.fit(i, &by_first, &alike)))
        .collect();
    for (i, fit) in again {
        fits[i] = fit;
    }
    fits
}

/// Takes away what is below zero from groups that sum to `whole`, and from the others in proportion what that adds: a fit may dip below
/// zero for a group that brings next to nothing, though not for their sum.
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

/// What a fit may differ by from what was gathered, in standard errors of that, before the difference is the fit's fault.
const DEPARTS: f32 = 3.0;

/// Square of what the fit is off, as far as the lumel's own samples tell: the squared difference less what noise has of it.
fn departure(r: &Received, fitted: Vec3, own: f32) -> f32 {
    let difference = luminance(fitted - r.indirect);
    let square = difference * difference;
    if square > DEPARTS * DEPARTS * own {
        square - own
    } else {
        0.0
    }
}

/// A neighbour and its offset in texels.
pub(crate) type Neighbour = (usize, i64, i64);

/// Looks up lumels by their neighbours.
pub(crate) struct Window<'a> {
    lumels: &'a [Lumel],
    index: TexelIndex,
    received: &'a [Received],
    barriers: &'a Barriers,
    sparse: &'a Sparse,
}

impl<'a> Window<'a> {
    pub(crate) fn new(
        lumels: &'a Lumels,
        layout: &Layout,
        received: &'a [Received],
        barriers: &'a Barriers,
        sparse: &'a Sparse,
    ) -> Self {
        Window {
            lumels: &lumels.lumels,
            index: TexelIndex::build(&lumels.lumels, layout),
            received,
            barriers,
            sparse,
        }
    }

    /// Lumels that were gathered at about `i`, itself among them if it was, on the same piece of surface and wholly in the open. Where light is
    /// interpolated, every second lumel of a window twice as wide: as many as elsewhere.
    pub(crate) fn around(&self, i: usize) -> ([Neighbour; SIDE * SIDE], usize) {
        let mut found = [(0, 0, 0); SIDE * SIDE];
        if self.sparse.bears(i) || self.sparse.is(i) {
            let n = self.on_grid(i, 2, &mut found);
            let n = self.over_clear_ground(i, &mut found, n);
            if 2 * n >= SIDE * SIDE {
                return (found, n);
            }
        }
        let mut n = self.on_grid(i, 1, &mut found);
        if self.barriers.matter() {
            n = self.on_this_side(&mut found, n);
        }
        (found, n)
    }

    /// Lumels in the window about `i` whose column and row are multiples of `stride`, or any if that is 1. With more than one, what is near
    /// something is left out: between such, barriers are not looked for.
    fn on_grid(&self, i: usize, stride: i64, found: &mut [Neighbour; SIDE * SIDE]) -> usize {
        let (l, own) = (&self.lumels[i], &self.received[i]);
        let [cx, cy] = l.texel.map(i64::from);
        // From an odd lumel one column less fits in than from an even one.
        let side = |c: i64| {
            let odd = c.rem_euclid(stride);
            let steps = REACH * stride - odd;
            (-steps..=steps).step_by(stride as usize)
        };
        let mut n = 0;
        for dy in side(cy) {
            for dx in side(cx) {
                let (x, y) = (cx + dx, cy + dy);
                let Some(j) = self.index.at(l.page, x, y) else {
                    continue;
                };
                let r = &self.received[j];
                let steps = ((dx * dx + dy * dy) as f32).sqrt();
                let between = r.position - own.position;
                if self.lumels[j].instance == l.instance
                    && !self.sparse.is(j)
                    && (r.open == 1.0 || j == i)
                    && (stride == 1 || j == i || !r.near)
                    && r.normal.dot(own.normal) >= SAME_FACING
                    && between.length() <= 1.5 * (steps + 0.5) * own.size
                    && between.dot(own.normal).abs() <= 0.5 * (steps + 1.0) * own.size
                {
                    found[n] = (j, dx, dy);
                    n += 1;
                }
            }
        }
        n
    }

    /// Keeps those of the first `n` lumels, which lie on every second column and row, that one comes to from the middle by steps over lumels near
    /// which nothing stands: a floor that a wall passes through lies within or beside one of them.
    fn over_clear_ground(&self, i: usize, found: &mut [Neighbour; SIDE * SIDE], n: usize) -> usize {
        const WIDE: i64 = 2 * REACH;
        const ACROSS: usize = (2 * WIDE + 1) as usize;
        let l = &self.lumels[i];
        let [cx, cy] = l.texel.map(i64::from);
        let place = |dx: i64, dy: i64| ((dy + WIDE) * ACROSS as i64 + dx + WIDE) as usize;
        let mut there = [false; ACROSS * ACROSS];
        let mut reached = [false; ACROSS * ACROSS];
        let mut next = [(0i64, 0i64); SIDE * SIDE];
        let mut waiting = 0;
        for &(_, dx, dy) in &found[..n] {
            there[place(dx, dy)] = true;
            // What the lumel lies between; itself, if it was gathered at.
            if dx.abs() <= 1 && dy.abs() <= 1 {
                reached[place(dx, dy)] = true;
                next[waiting] = (dx, dy);
                waiting += 1;
            }
        }
        while waiting > 0 {
            waiting -= 1;
            let (x, y) = next[waiting];
            for (sx, sy) in [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)] {
                let (u, v) = (x + 2 * sx, y + 2 * sy);
                if u.abs() > WIDE || v.abs() > WIDE || !there[place(u, v)] || reached[place(u, v)] {
                    continue;
                }
                let between = self.index.at(l.page, cx + x + sx, cy + y + sy);
                let clear = |j: usize| {
                    let r = &self.received[j];
                    self.lumels[j].instance == l.instance && r.open == 1.0 && !r.near
                };
                if between.is_some_and(clear) {
                    reached[place(u, v)] = true;
                    next[waiting] = (u, v);
                    waiting += 1;
                }
            }
        }
        keep(found, n, |dx, dy| reached[place(dx, dy)])
    }

    /// Keeps those of the first `n` that one comes to from the middle without crossing a barrier, in their order, and says how many.
    fn on_this_side(&self, found: &mut [Neighbour; SIDE * SIDE], n: usize) -> usize {
        // What a wall cuts is not among the neighbours, what it runs between has something near.
        if !found[..n].iter().any(|f| self.received[f.0].near) {
            return n;
        }
        let place = |dx: i64, dy: i64| ((dy + REACH) * SIDE as i64 + dx + REACH) as usize;
        let mut slot = [usize::MAX; SIDE * SIDE];
        for &(j, dx, dy) in &found[..n] {
            slot[place(dx, dy)] = j;
        }
        let mut reached = [false; SIDE * SIDE];
        let mut next = Vec::with_capacity(n);
        next.push((0i64, 0i64));
        reached[place(0, 0)] = true;
        while let Some((x, y)) = next.pop() {
            let own = slot[place(x, y)];
            for (dx, dy) in [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)] {
                let (u, v) = (x + dx, y + dy);
                if u.abs() > REACH || v.abs() > REACH || reached[place(u, v)] {
                    continue;
                }
                let other = slot[place(u, v)];
                // The middle itself may not be among those found.
                let before = if dx + dy > 0 { own } else { other };
                let free = other != usize::MAX
                    && (before == usize::MAX || !self.barriers.after(before, dy != 0));
                if free {
                    reached[place(u, v)] = true;
                    next.push((u, v));
                }
            }
        }
        keep(found, n, |dx, dy| reached[place(dx, dy)])
    }

    /// Mean variance of the lumels about `i`. A lumel's own estimate will not do: where light comes from little (a cave's mouth), one that
    /// chanced to miss it finds itself dark and certain, and would stay a dark dot.
    fn pooled_variance(&self, i: usize) -> f32 {
        let (around, n) = self.around(i);
        let sum: f32 = around[..n]
            .iter()
            .map(|a| self.received[a.0].indirect_variance)
            .sum();
        let own = &self.received[i];
        if n == 0 {
            own.indirect_variance
        } else if own.open < 1.0 {
            // A part of a lumel has fewer rays than its neighbours.
            own.indirect_variance.max(sum / n as f32)
        } else {
            sum / n as f32
        }
    }

    /// [`pooled_variance`](Self::pooled_variance) of those lumels about `i` that have about its light.
    fn variance_of_alike(&self, i: usize, light: &[f32]) -> f32 {
        let (around, n) = self.around(i);
        let (mut sum, mut count) = (0.0, 0.0);
        for &(j, ..) in &around[..n] {
            if light[j] <= ALIKE * light[i] && light[i] <= ALIKE * light[j] {
                sum += self.received[j].indirect_variance;
                count += 1.0;
            }
        }
        if count > 0.0 {
            sum / count
        } else {
            self.received[i].indirect_variance
        }
    }

    /// Smoothed indirect irradiance of lumel `i`, and the variance of its luminance. `variance` is that of what was gathered.
    fn fit(&self, i: usize, by: &Judge, variance: &[f32]) -> Smoothed {
        let own = &self.received[i];
        let keep = |variance: f32| Smoothed::none(own, variance);
        if variance[i] <= 0.0 || own.open == 0.0 {
            return keep(own.indirect_variance);
        }
        let (around, n) = self.around(i);
        if n < 2 * TERMS {
            return keep(variance[i]);
        }
        let halves: Vec<[Vec3; 2]> = around[..n]
            .iter()
            .map(|a| self.received[a.0].halves())
            .collect();
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
                likely(d, by.noise[i] + by.noise[j]) * near * self.lumels[j].coverage.max(0.05)
            };
            let Some(shares) = shares_of_fit(&around[..n], weigh) else {
                return keep(variance[i]);
            };
            for (k, share) in shares[..n].iter().enumerate() {
                sum[judged] += halves[k][judged] * *share;
                for (plane, of) in planes.iter_mut().zip(&self.received[around[k].0].planes) {
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
}

/// How much a neighbour counts whose half of the samples differs by `d`, where the variances of both wholes sum to `noise`.
pub(crate) fn likely(d: f32, noise: f32) -> f32 {
    // A half has twice the variance of the whole.
    let noise = (2.0 * noise).max(f32::MIN_POSITIVE);
    (-d * d / (2.0 * SIGMAS * SIGMAS * noise)).exp()
}

/// What share each neighbour has in the value at the lumel of the quadratic fitted with these weights; they sum to 1.
fn shares_of_fit(around: &[Neighbour], weigh: impl Fn(usize) -> f32) -> Option<[f32; SIDE * SIDE]> {
    let mut rows = [([0f64; TERMS], 0f64); SIDE * SIDE];
    let mut matrix = [[0f64; TERMS]; TERMS];
    for (k, &(_, dx, dy)) in around.iter().enumerate() {
        let w = f64::from(weigh(k));
        let (x, y) = (dx as f64, dy as f64);
        let row = [1.0, x, y, x * x, x * y, y * y];
        for a in 0..TERMS {
            for b in 0..=a {
                matrix[a][b] += w * row[a] * row[b];
            }
        }
        rows[k] = (row, w);
    }
    // The value at the lumel is the first unknown: its weights are the first row of the inverse times the rows.
    let first = first_of_inverse(matrix)?;
    let mut shares = [0f32; SIDE * SIDE];
    for (share, (row, w)) in shares.iter_mut().zip(&rows[..around.len()]) {
        let dot: f64 = row.iter().zip(&first).map(|(a, b)| a * b).sum();
        *share = (dot * w) as f32;
    }
    Some(shares)
}

/// First row of the inverse of a symmetric positive definite matrix, of which the lower triangle is given; `None` where it is near singular
/// (too few neighbours, or all in a line). By Cholesky's factorisation.
fn first_of_inverse(mut m: [[f64; TERMS]; TERMS]) -> Option<[f64; TERMS]> {
    let dot = |a: &[f64; TERMS], b: &[f64; TERMS], n: usize| -> f64 {
        a[..n].iter().zip(&b[..n]).map(|(x, y)| x * y).sum()
    };
    for c in 0..TERMS {
        let scale = m[c][c];
        let pivot = scale - dot(&m[c], &m[c], c);
        // A column that the ones before explain but for a millionth adds noise and no information.
        if pivot <= 1e-6 * scale || scale <= 0.0 {
            return None;
        }
        let root = pivot.sqrt();
        m[c][c] = root;
        for r in c + 1..TERMS {
            m[r][c] = (m[r][c] - dot(&m[r], &m[c], c)) / root;
        }
    }
    let mut x = [0.0; TERMS];
    x[0] = 1.0;
    for r in 0..TERMS {
        for k in 0..r {
            x[r] -= m[r][k] * x[k];
        }
        x[r] /= m[r][r];
    }
    for r in (0..TERMS).rev() {
        for k in r + 1..TERMS {
            x[r] -= m[k][r] * x[k];
        }
        x[r] /= m[r][r];
    }
    Some(x)
}

/// Keeps those of the first `n` whose place was `reached`, in their order, and says how many.
fn keep(
    found: &mut [Neighbour; SIDE * SIDE],
    n: usize,
    reached: impl Fn(i64, i64) -> bool,
) -> usize {
    let mut kept = 0;
    for k in 0..n {
        let (_, dx, dy) = found[k];
        if reached(dx, dy) {
            found[kept] = found[k];
            kept += 1;
        }
    }
    kept
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

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

    /// Rows of luminance after smoothing, on a floor with `light(x)` at column x, which was gathered with standard errors `noise(x)`.
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
        let (barriers, sparse) = (Barriers::default(), Sparse::none(received.len()));
        let certainty = Certainty::measure(&received, |_| true, 128, 1.0);
        let surely = |_: usize| false;
        smooth_indirect(
            &lumels,
            &layout,
            &mut received,
            &barriers,
            &sparse,
            0,
            &certainty,
            &surely,
        );
        let row = |y: u32| &received[(y * SIZE) as usize..((y + 1) * SIZE) as usize];
        (REACH as u32..SIZE - REACH as u32)
            .map(|y| row(y).iter().map(|r| luminance(r.indirect)).collect())
            .collect()
    }

    #[test]
    fn dark_lumels_beside_noisy_bright_ones_stay_dark() {
        // A floor by the rim of a shaft, with what 128 rays leave of noise: three tenths of the light.
        let light = |x: u32| if x < 24 { 1.0 } else { 0.03 };
        let rows = smoothed(light, |x| 0.3 * light(x));
        for x in 24..36 {
            let mean = rows.iter().map(|row| row[x]).sum::<f32>() / rows.len() as f32;
            // The window's other dark lumels leave an error of a third of a lumel's light; over the rows a quarter of that. One fit makes 0.26 of the first column.
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

    #[test]
    fn the_inverse_times_the_matrix_is_one() {
        // A Hilbert-like matrix plus the identity: symmetric, positive definite, far from diagonal.
        let at = |r: usize, c: usize| 1.0 / (1 + r + c) as f64 + f64::from(u8::from(r == c));
        let mut m = [[0.0; TERMS]; TERMS];
        for (r, row) in m.iter_mut().enumerate() {
            for (c, x) in row.iter_mut().enumerate().take(r + 1) {
                *x = at(r, c);
            }
        }
        let x = first_of_inverse(m).expect("regular");
        for r in 0..TERMS {
            let dot: f64 = (0..TERMS).map(|c| at(r, c) * x[c]).sum();
            // Condition number below 10: a few ulp.
            assert!((dot - f64::from(u8::from(r == 0))).abs() < 1e-14, "{dot}");
        }
        assert!(
            first_of_inverse([[1.0; TERMS]; TERMS]).is_none(),
            "singular"
        );
    }
}
