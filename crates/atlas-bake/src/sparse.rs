//! Lumels whose indirect light is interpolated between their neighbours'.
//!
//! Light that surfaces reflect changes slowly over a flat piece of surface that nothing stands on or near. There every second lumel in either
//! direction is gathered at. The three between them take the mean of those beside them at first, and then what the smoothing's quadratic says
//! of their place: half of the gathering rays, since each of the few has twice as many. What is near, and throws light or shadow that changes from lumel to lumel, is found by geometry, not by rays, which miss what is thin. Direct light is
//! computed at every lumel.
//!
//! [`Interpolation::Wide`], a draft's rule, does so wherever nothing rises within a lumel: also on curves and along chart borders. There direct light is interpolated too
//! where neighbours agree about it, and what smoothing makes of the gathered lumels is carried to those between by a cubic.
//!
//! After Ward, Rubinstein, Clear, *A ray tracing solution for diffuse interreflection*, 1988 (what is near decides how far a sample
//! counts), on the lightmap's own grid and with a look at the neighbours' differences.

use glam::Vec3;
use radiosity::{Cancelled, Monitor, Phase, Records, SurfacePoint, Topic, World, luminance};
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::bake::{Recorded, in_blocks};
use crate::footprint::Footprint;
use crate::gather::{Edge, Gatherer, Interpolation, Received};
use crate::lumels::{Lumels, TexelIndex};
use crate::recall::{Recall, Stage};

/// Nothing rises above the surface within so many lumels of one whose light is interpolated. Light from what is R away changes over R, and
/// the window that the quadratic is fitted in reaches seven lumels at most.
const CLEAR: f32 = 4.0;

/// Neighbours may differ by this share of their light, beside noise. A straight line through light that changes so much misses an eighth of it
/// where the change itself changes as much again.
const STEADY: f32 = 0.1;

/// Standard errors that noise may add to that.
const SIGMAS: f32 = 3.0;

/// Normals of neighbours on a flat piece: 1.8°.
const FLAT: f32 = 0.9995;

/// [`Interpolation::Wide`]: the same three, and the least that a neighbour is covered. Nothing rises within a lumel, since what touches one has light of its own;
/// normals differ by 30° at most, as in the smoothing's window, which is what gives these lumels their light in the end.
const WIDE_CLEAR: f32 = 1.0;
const WIDE_STEADY: f32 = 0.3;
const WIDE_FACING: f32 = 0.85;
const WIDE_COVERED: f32 = 0.1;

/// Direct light is interpolated where a straight line between two neighbours and a cubic through four differ by no more than this share of the light.
const STRAIGHT: f32 = 0.01;

/// A lumel covered by less may be pieced together of what lies apart.
const WHOLE: f32 = 0.999;

/// The neighbours that a lumel is interpolated between.
type Beside = [Option<u32>; 4];

/// Which lumels are to be interpolated, and between which.
pub(crate) struct Sparse {
    /// By lumel; all `None` for one that is gathered at.
    beside: Vec<Beside>,
    /// By lumel: others are interpolated between it and its like.
    bears: Vec<bool>,
    rule: Interpolation,
}

impl Sparse {
    /// Nothing is interpolated.
    pub(crate) fn none(lumels: usize) -> Self {
        Sparse {
            beside: vec![[None; 4]; lumels],
            bears: vec![false; lumels],
            rule: Interpolation::Open,
        }
    }

    /// Looks for pieces of surface that nothing is near of. Records hold what was found before.
    pub(crate) fn find(
        world: &World,
        lumels: &Lumels,
        layout: &Layout,
        rule: Interpolation,
        recall: Option<&Recall>,
    ) -> Self {
        let index = TexelIndex::build(&lumels.lumels, layout);
        let places: Vec<(SurfacePoint, f32)> = (0..lumels.lumels.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let (footprint, _) = lumels.footprint(world, i);
                (footprint.fallback(), footprint.reach())
            })
            .collect();
        let n = lumels.lumels.len();
        let known = (recall.filter(|r| r.read()))
            .and_then(|r| r.load(Topic::Flat, 0))
            .filter(|bits| bits.len() == n.div_ceil(8));
        let beside: Vec<Beside> = (0..n)
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let flat = known.as_ref().map(|bits| bits[i / 8] >> (i % 8) & 1 != 0);
                candidate(world, lumels, (&index, &places), rule, flat, i)
            })
            .collect();
        if let Some(recall) = recall.filter(|r| !r.read()) {
            let flat = |x: &Beside| u8::from(x.iter().any(Option::is_some));
            let bits = beside.chunks(8).map(|part| {
                let bits = part.iter().enumerate();
                bits.fold(0u8, |byte, (k, x)| byte | flat(x) << k)
            });
            recall.save(Topic::Flat, 0, &bits.collect::<Vec<u8>>());
        }
        let bears = vec![false; lumels.lumels.len()];
        Sparse {
            beside,
            bears,
            rule,
        }
    }

    /// Whether lumel `i` is interpolated.
    #[inline]
    pub(crate) fn is(&self, i: usize) -> bool {
        self.beside[i].iter().any(|j| j.is_some())
    }

    /// Whether others are interpolated between lumel `i` and its like.
    #[inline]
    pub(crate) fn bears(&self, i: usize) -> bool {
        self.bears[i]
    }

    /// What lumel `i` is interpolated between.
    pub(crate) fn of(&self, i: usize) -> impl Iterator<Item = usize> + Clone + '_ {
        self.beside[i].iter().flatten().map(|&j| j as usize)
    }

    /// Times that a lumel has as many rays as others, where others are interpolated between it and its like: what it is wrong by is seen in four. With
    /// [`Interpolation::Wide`] most are such lumels.
    pub(crate) fn bearing(&self, i: usize) -> u32 {
        if self.bears[i] {
            self.most_bearing()
        } else {
            1
        }
    }

    /// The most that [`bearing`](Self::bearing) says.
    pub(crate) fn most_bearing(&self) -> u32 {
        match self.rule {
            Interpolation::Open => 2,
            Interpolation::Wide => 1,
        }
    }

    /// Gathers at all lumels, of which interpolated ones have direct light of their own at most. Neighbours that differ too much are not
    /// interpolated between after all.
    ///
    /// # Errors
    /// [`Cancelled`] when the monitor says so.
    pub(crate) fn gather(
        &mut self,
        gatherer: &Gatherer,
        lumels: &Lumels,
        layout: &Layout,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Received>, Cancelled> {
        let n = lumels.lumels.len();
        let world = gatherer.world;
        let first: Vec<usize> = (0..n).filter(|&i| !self.is(i)).collect();
        let recorded = Recorded {
            recall: gatherer.recall,
            stage: Stage::Gather.round(0),
            item: &|k| first[k] as u32,
            guard: &|_| 0,
        };
        let gathered = in_blocks(first.len(), Phase::Gather, monitor, recorded, |k, tape| {
            let (footprint, seed) = lumels.footprint(world, first[k]);
            gatherer.gather_recalled(&footprint, seed, tape)
        })?;
        let mut received: Vec<Received> = Vec::new();
        received.resize_with(n, Received::default);
        for (i, r) in first.into_iter().zip(gathered) {
            received[i] = r;
        }
        let unsteady: Vec<bool> = (0..n)
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| self.is(i) && !steady(self.of(i).map(|j| &received[j]), self.rule))
            .collect();
        for (beside, unsteady) in self.beside.iter_mut().zip(unsteady.iter()) {
            if *unsteady {
                *beside = [None; 4];
            }
        }
        for &j in self.beside.iter().flatten().flatten() {
            self.bears[j as usize] = true;
        }
        let rest: Vec<usize> = (0..n).filter(|&i| self.is(i) || unsteady[i]).collect();
        let recorded = Recorded {
            recall: gatherer.recall,
            stage: Stage::Between.round(0),
            item: &|k| rest[k] as u32,
            guard: &|_| 0,
        };
        let index = TexelIndex::build(&lumels.lumels, layout);
        let gathered = in_blocks(rest.len(), Phase::Gather, monitor, recorded, |k, tape| {
            let i = rest[k];
            let (footprint, seed) = lumels.footprint(world, i);
            if unsteady[i] {
                return gatherer.gather_recalled(&footprint, seed, tape);
            }
            let between = between(self.of(i).map(|j| &received[j]));
            let direct = match self.rule {
                Interpolation::Open => None,
                Interpolation::Wide => self.direct_between(lumels, &index, &received, i),
            };
            direct
                .and_then(|direct| gatherer.gather_nothing(&footprint, seed, (&between, direct)))
                .unwrap_or_else(|| gatherer.gather_direct(&footprint, seed, &between, tape))
        })?;
        for (i, r) in rest.into_iter().zip(gathered) {
            received[i] = r;
        }
        Ok(received)
    }

    /// What an interpolated lumel's light is made of: its neighbours on both sides and, where surface goes on undisturbed, the next ones in the same
    /// lines, with weights that sum to 1. A cubic through four, a parabola through three, else a straight line. Empty where neighbours are on
    /// one side alone.
    pub(crate) fn taps(
        &self,
        lumels: &Lumels,
        index: &TexelIndex,
        received: &[Received],
        i: usize,
    ) -> Taps {
        let l = &lumels.lumels[i];
        let [x, y] = l.texel.map(i64::from);
        let mut taps = Taps::default();
        let next = |j: usize| -> Option<usize> {
            let [u, v] = lumels.lumels[j].texel.map(i64::from);
            let at = |k: i64| index.at(l.page, x + k * (u - x), y + k * (v - y));
            let (between, far) = (at(2)?, at(3)?);
            let (near, r) = (&received[j], &received[far]);
            let way = r.position - near.position;
            // A chart may hold places that adjoin and surfaces that do not.
            let goes_on = way.length() <= 4.0 * near.size
                && way.dot(near.normal).abs() <= 0.5 * near.size
                && [between, far].into_iter().all(|k| {
                    let r = &received[k];
                    let clear = self.is(k) || (r.open == 1.0 && !r.near);
                    clear && lumels.lumels[k].instance == l.instance
                });
            goes_on.then_some(far)
        };
        // Opposite ones: the first and the second of two, the first and the last, the second and the third of four.
        let [a, b, c, d] = self.beside[i];
        let pairs = if c.or(d).is_some() || (x & y & 1 == 1) {
            [[a, d], [b, c]]
        } else {
            [[a, b], [None; 2]]
        };
        for pair in pairs {
            let [Some(a), Some(b)] = pair.map(|j| j.map(|j| j as usize)) else {
                continue;
            };
            match (next(a), next(b)) {
                (Some(far_a), Some(far_b)) => {
                    taps.add(&[(a, 0.5625), (b, 0.5625), (far_a, -0.0625), (far_b, -0.0625)]);
                }
                (None, Some(far)) => taps.add(&[(a, 0.375), (b, 0.75), (far, -0.125)]),
                (Some(far), None) => taps.add(&[(a, 0.75), (b, 0.375), (far, -0.125)]),
                (None, None) => taps.add(&[(a, 0.5), (b, 0.5)]),
            }
        }
        taps
    }

    /// Direct light of lumel `i` by its taps, where all agree about lamps, no shadow's edge crosses any and it does not bend; `None` elsewhere.
    fn direct_between(
        &self,
        lumels: &Lumels,
        index: &TexelIndex,
        received: &[Received],
        i: usize,
    ) -> Option<DirectBetween> {
        let taps = self.taps(lumels, index, received, i);
        if !taps.bent {
            return None; // nothing to tell by whether it bends
        }
        let first = &received[taps.list().first()?.0];
        let mut out = DirectBetween {
            irradiance: Vec3::ZERO,
            planes: vec![Vec3::ZERO; first.planes.len()],
            variance: 0.0,
            lit: first.lit,
            hidden: first.hidden,
        };
        for &(j, weight) in taps.list() {
            let r = &received[j];
            let same = [r.lit, r.hidden] == [out.lit, out.hidden] && r.mixed == 0;
            if !(same && r.edge == Edge::None && r.open == 1.0) {
                return None;
            }
            out.irradiance += r.direct * weight;
            for (sum, plane) in out.planes.iter_mut().zip(&r.planes) {
                *sum += plane.direct * weight;
            }
        }
        let (mut straight, mut n) = (0f32, 0f32);
        for j in self.of(i) {
            straight += luminance(received[j].direct);
            n += 1.0;
        }
        out.irradiance = out.irradiance.max(Vec3::ZERO);
        let light = luminance(out.irradiance + first.indirect);
        let bend = luminance(out.irradiance) - straight / n;
        out.variance = bend * bend;
        (bend.abs() <= STRAIGHT * light).then_some(out)
    }

    /// Whether smoothing leaves lumel `i` to what its neighbours come to.
    pub(crate) fn follows(&self, i: usize) -> bool {
        self.rule == Interpolation::Wide && self.is(i)
    }

    /// Interpolates anew, after what it is interpolated between has changed.
    pub(crate) fn interpolate(&self, received: &mut [Received]) {
        let between: Vec<Option<Between>> = (0..received.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| (self.is(i)).then(|| between(self.of(i).map(|j| &received[j]))))
            .collect();
        for (r, between) in received.iter_mut().zip(between) {
            let Some(b) = between else { continue };
            let direct = (r.error * r.error - r.indirect_variance).max(0.0);
            (r.indirect, r.first_half) = (b.indirect, b.first_half);
            r.indirect_variance = b.variance;
            r.error = (direct + b.variance).sqrt();
            for (plane, of) in r.planes.iter_mut().zip(b.planes) {
                [plane.indirect, plane.first_half] = of;
            }
        }
    }
}

/// Indirect light between neighbours.
pub(crate) struct Between {
    pub indirect: Vec3,
    pub first_half: Vec3,
    pub variance: f32,
    /// Indirect light and its first half, by plane.
    pub planes: Vec<[Vec3; 2]>,
}

/// What an interpolated lumel's light is made of; see [`Sparse::taps`].
#[derive(Default)]
pub(crate) struct Taps {
    list: [(usize, f32); 8],
    count: usize,
    lines: usize,
    /// All lines have more than two points, which tell a straight line from a bent one.
    bent: bool,
}

impl Taps {
    /// Adds a line of two to four lumels.
    fn add(&mut self, line: &[(usize, f32)]) {
        if self.lines == 1 {
            self.list[..self.count].iter_mut().for_each(|t| t.1 *= 0.5);
        }
        let share = if self.lines == 0 { 1.0 } else { 0.5 };
        for &(j, weight) in line {
            self.list[self.count] = (j, weight * share);
            self.count += 1;
        }
        self.bent = (self.bent || self.lines == 0) && line.len() > 2;
        self.lines += 1;
    }

    /// Lumels and their weights.
    pub(crate) fn list(&self) -> &[(usize, f32)] {
        &self.list[..self.count]
    }
}

/// Direct light between neighbours.
pub(crate) struct DirectBetween {
    pub irradiance: Vec3,
    /// Direct light by plane.
    pub planes: Vec<Vec3>,
    /// Square of what interpolation may be off.
    pub variance: f32,
    /// Lamps that all of them see, and that are hidden from all, as [`Received`] has them.
    pub lit: u32,
    pub hidden: u32,
}

fn between<'r>(beside: impl Iterator<Item = &'r Received>) -> Between {
    let mut out = Between {
        indirect: Vec3::ZERO,
        first_half: Vec3::ZERO,
        variance: 0.0,
        planes: Vec::new(),
    };
    let mut n = 0.0;
    for r in beside {
        n += 1.0;
        out.indirect += r.indirect;
        out.first_half += r.first_half;
        // As if neighbours' errors were one; smoothing finds out what they are.
        out.variance += r.indirect_variance;
        out.planes.resize(r.planes.len(), [Vec3::ZERO; 2]);
        for (sum, plane) in out.planes.iter_mut().zip(&r.planes) {
            sum[0] += plane.indirect;
            sum[1] += plane.first_half;
        }
    }
    let share = 1.0 / f32::max(n, 1.0);
    out.indirect *= share;
    out.first_half *= share;
    out.variance *= share;
    out.planes.iter_mut().flatten().for_each(|p| *p *= share);
    out
}

/// Whether light can be interpolated between these.
fn steady<'r>(beside: impl Iterator<Item = &'r Received>, rule: Interpolation) -> bool {
    let differ = match rule {
        Interpolation::Open => STEADY,
        Interpolation::Wide => WIDE_STEADY,
    };
    let (mut low, mut high, mut sum, mut variance, mut n) = (f32::MAX, 0f32, 0f32, 0f32, 0f32);
    for r in beside {
        if r.open < 1.0 || r.near || r.edge == Edge::Contact {
            return false;
        }
        let light = luminance(r.indirect);
        (low, high) = (low.min(light), high.max(light));
        sum += light;
        variance += r.indirect_variance;
        n += 1.0;
    }
    high - low <= differ * sum / n + SIGMAS * (variance / n).sqrt()
}

/// What lumel `i` may be interpolated between; `flat` is whether nothing rises above it, where that is known.
fn candidate(
    world: &World,
    lumels: &Lumels,
    (index, places): (&TexelIndex, &[(SurfacePoint, f32)]),
    rule: Interpolation,
    flat: Option<bool>,
    i: usize,
) -> Beside {
    let l = &lumels.lumels[i];
    let [x, y] = l.texel.map(i64::from);
    if (x | y) & 1 == 0 {
        return [None; 4];
    }
    let (own, size) = &places[i];
    let at = |dx: i64, dy: i64| -> Option<u32> {
        let j = index.at(l.page, x + dx, y + dy)?;
        let (other, place) = (&lumels.lumels[j], &places[j].0);
        let way = place.position - own.position;
        let steps = ((dx * dx + dy * dy) as f32).sqrt();
        let same = match rule {
            Interpolation::Open => {
                other.coverage >= WHOLE
                    && place.geometric.dot(own.geometric) >= FLAT
                    && place.normal.dot(own.normal) >= FLAT
                    && way.dot(own.geometric).abs() <= 0.02 * size
                    && way.length() <= 1.2 * steps * size
            }
            Interpolation::Wide => {
                other.coverage >= WIDE_COVERED
                    && place.normal.dot(own.normal) >= WIDE_FACING
                    && way.dot(own.normal).abs() <= 0.5 * steps * size
                    && way.length() <= 1.5 * (steps + 0.25) * size
            }
        };
        (same && other.instance == l.instance).then_some(j as u32)
    };
    let line = match (x & 1, y & 1) {
        (1, 0) => [at(-1, 0), at(1, 0), None, None],
        (0, _) => [at(0, -1), at(0, 1), None, None],
        _ => [at(-1, -1), at(1, -1), at(-1, 1), at(1, 1)],
    };
    let good = match rule {
        // All around must be there, and itself whole.
        Interpolation::Open => {
            let all = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
            all.into_iter().all(|(dx, dy)| at(dx, dy).is_some())
        }
        Interpolation::Wide => line.iter().any(|j| j.is_some()),
    };
    let clear = match rule {
        Interpolation::Open => CLEAR,
        Interpolation::Wide => WIDE_CLEAR,
    };
    if good && flat.unwrap_or_else(|| !world.anything_above(own, clear * size)) {
        line
    } else {
        [None; 4]
    }
}
