//! Lumels whose indirect light is interpolated between their neighbours'.
//!
//! Light that surfaces reflect changes slowly over a flat piece of surface that nothing stands on or near. There every second lumel in either
//! direction is gathered at. The three between them take the mean of those beside them at first, and then what the smoothing's quadratic says
//! of their place: half of the gathering rays, since each of the few has twice as many. What is near, and throws light or shadow that changes from lumel to lumel, is found by geometry, not by rays, which miss what is thin. Direct light is
//! computed at every lumel.
//!
//! After Ward, Rubinstein, Clear, *A ray tracing solution for diffuse interreflection*, 1988 (what is near decides how far a sample
//! counts), on the lightmap's own grid and with a look at the neighbours' differences.

use glam::Vec3;
use radiosity::{Cancelled, Monitor, Phase, Records, SurfacePoint, Topic, World, luminance};
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::bake::{Recorded, in_blocks};
use crate::footprint::Footprint;
use crate::gather::{Edge, Gatherer, Received};
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
}

impl Sparse {
    /// Nothing is interpolated.
    pub(crate) fn none(lumels: usize) -> Self {
        Sparse {
            beside: vec![[None; 4]; lumels],
            bears: vec![false; lumels],
        }
    }

    /// Looks for flat pieces of surface that nothing is near of. Records hold what was found before.
    pub(crate) fn find(
        world: &World,
        lumels: &Lumels,
        layout: &Layout,
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
                candidate(world, lumels, &index, &places, flat, i)
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
        Sparse { beside, bears }
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

    /// Gathers at all lumels, of which interpolated ones have direct light of their own alone. Neighbours that differ too much are not
    /// interpolated between after all.
    ///
    /// # Errors
    /// [`Cancelled`] when the monitor says so.
    pub(crate) fn gather(
        &mut self,
        gatherer: &Gatherer,
        lumels: &Lumels,
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
            .map(|i| self.is(i) && !steady(self.of(i).map(|j| &received[j])))
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
        let gathered = in_blocks(rest.len(), Phase::Gather, monitor, recorded, |k, tape| {
            let i = rest[k];
            let (footprint, seed) = lumels.footprint(world, i);
            if unsteady[i] {
                return gatherer.gather_recalled(&footprint, seed, tape);
            }
            let between = between(self.of(i).map(|j| &received[j]));
            gatherer.gather_direct(&footprint, seed, between, tape)
        })?;
        for (i, r) in rest.into_iter().zip(gathered) {
            received[i] = r;
        }
        Ok(received)
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
fn steady<'r>(beside: impl Iterator<Item = &'r Received>) -> bool {
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
    high - low <= STEADY * sum / n + SIGMAS * (variance / n).sqrt()
}

/// What lumel `i` may be interpolated between; `flat` is whether nothing rises above it, where that is known.
fn candidate(
    world: &World,
    lumels: &Lumels,
    index: &TexelIndex,
    places: &[(SurfacePoint, f32)],
    flat: Option<bool>,
    i: usize,
) -> Beside {
    let l = &lumels.lumels[i];
    let [x, y] = l.texel.map(i64::from);
    let (odd_x, odd_y) = (x & 1 == 1, y & 1 == 1);
    if !(odd_x || odd_y) {
        return [None; 4];
    }
    let (own, size) = &places[i];
    let mut at = [[0u32; 3]; 3];
    for (dy, row) in (-1..=1).zip(&mut at) {
        for (dx, slot) in (-1..=1).zip(row) {
            let Some(j) = index.at(l.page, x + dx, y + dy) else {
                return [None; 4];
            };
            let (other, place) = (&lumels.lumels[j], &places[j].0);
            let way = place.position - own.position;
            let steps = ((dx * dx + dy * dy) as f32).sqrt();
            let same = other.instance == l.instance
                && other.coverage >= WHOLE
                && place.geometric.dot(own.geometric) >= FLAT
                && place.normal.dot(own.normal) >= FLAT
                && way.dot(own.geometric).abs() <= 0.02 * size
                && way.length() <= 1.2 * steps * size;
            if !same {
                return [None; 4];
            }
            *slot = j as u32;
        }
    }
    if !flat.unwrap_or_else(|| !world.anything_above(own, CLEAR * size)) {
        return [None; 4];
    }
    match (odd_x, odd_y) {
        (true, false) => [Some(at[1][0]), Some(at[1][2]), None, None],
        (false, _) => [Some(at[0][1]), Some(at[2][1]), None, None],
        _ => [at[0][0], at[0][2], at[2][0], at[2][2]].map(Some),
    }
}
