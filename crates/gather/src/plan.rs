//! Lumels whose indirect light is interpolated between their neighbours'.
//!
//! Light that surfaces reflect changes slowly over a flat piece of surface that nothing stands on
//! or near. There every second lumel in either direction is gathered at. The three between them
//! take the mean of those beside them at first, and then what the smoothing's quadratic says of
//! their place: half of the gathering rays, since each of the few has twice as many. What is near,
//! and throws light or shadow that changes from lumel to lumel, is found by geometry, not by rays,
//! which miss what is thin. Direct light is computed at every lumel.
//!
//! [`Interpolation::Wide`], a draft's rule, does so wherever nothing rises within a lumel: also on
//! curves and along chart borders. There direct light is interpolated too where neighbours agree
//! about it, and what smoothing makes of the gathered lumels is carried to those between by a
//! cubic.
//!
//! After Ward, Rubinstein, Clear, *A ray tracing solution for diffuse interreflection*, 1988 (what
//! is near decides how far a sample counts), on the lightmap's own grid and with a look at the
//! neighbours' differences.

use atlas::{Lumels, TexelIndex};
use radiosity::{SurfacePoint, World, luminance};
use rayon::prelude::*;

use crate::footprint::{Footprint, LumelFootprint};
use crate::options::Interpolation;
use crate::received::{Edge, Received};

/// Nothing rises above the surface within so many lumels of one whose light is interpolated. Light
/// from what is R away changes over R, and the window that the quadratic is fitted in reaches seven
/// lumels at most.
const CLEAR: f32 = 4.0;

/// Neighbours may differ by this share of their light, beside noise. A straight line through light
/// that changes so much misses an eighth of it where the change itself changes as much again.
const STEADY: f32 = 0.1;

/// Standard errors that noise may add to that.
const SIGMAS: f32 = 3.0;

/// Normals of neighbours on a flat piece: 1.8°.
const FLAT: f32 = 0.9995;

/// [`Interpolation::Wide`]: the same three, and the least that a neighbour is covered. Nothing rises within a lumel, since what touches one has light of its own;
/// normals differ by 30° at most, as in the smoothing's window, which is what gives these lumels
/// their light in the end.
const WIDE_CLEAR: f32 = 1.0;
const WIDE_STEADY: f32 = 0.3;
const WIDE_FACING: f32 = 0.85;
const WIDE_COVERED: f32 = 0.1;

/// A lumel covered by less may be pieced together of what lies apart.
const WHOLE: f32 = 0.999;

/// The neighbours that a lumel is interpolated between.
pub(crate) type Beside = [Option<u32>; 4];

/// Which lumels are to be interpolated, and between which.
pub(crate) struct Plan {
    /// By lumel; all `None` for one that is gathered at.
    pub beside: Vec<Beside>,
    /// By lumel: others are interpolated between it and its like.
    bears: Vec<bool>,
    pub rule: Interpolation,
}

impl Plan {
    /// Nothing is interpolated.
    pub(crate) fn none(lumels: usize) -> Self {
        Plan {
            beside: vec![[None; 4]; lumels],
            bears: vec![false; lumels],
            rule: Interpolation::Open,
        }
    }

    /// Looks for pieces of surface that nothing is near of.
    pub(crate) fn find(
        world: &World,
        lumels: &Lumels,
        index: &TexelIndex,
        rule: Interpolation,
    ) -> Self {
        let places: Vec<(SurfacePoint, f32)> = (0..lumels.lumels.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let (footprint, _) = LumelFootprint::of(world, lumels, i);
                (footprint.fallback(), footprint.reach())
            })
            .collect();
        let n = lumels.lumels.len();
        let beside: Vec<Beside> = (0..n)
            .into_par_iter()
            .with_min_len(256)
            .map(|i| candidate(world, lumels, (index, &places), rule, i))
            .collect();
        let bears = vec![false; lumels.lumels.len()];
        Plan {
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

    /// Lumel `i` is gathered at after all.
    pub(crate) fn drop(&mut self, i: usize) {
        self.beside[i] = [None; 4];
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

    /// Times that a lumel has as many rays as others, where others are interpolated between it and
    /// its like: what it is wrong by is seen in four. With [`Interpolation::Wide`] most are such
    /// lumels.
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

    /// Neighbours that differ too much are not interpolated between after all: which lumels that
    /// makes gathered ones, by lumel.
    pub(crate) fn drop_unsteady(&mut self, received: &[Received]) -> Vec<bool> {
        let unsteady: Vec<bool> = (0..received.len())
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
        unsteady
    }

    /// Whether smoothing leaves lumel `i` to what its neighbours come to.
    pub(crate) fn follows(&self, i: usize) -> bool {
        self.rule == Interpolation::Wide && self.is(i)
    }
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

/// What lumel `i` may be interpolated between.
fn candidate(
    world: &World,
    lumels: &Lumels,
    (index, places): (&TexelIndex, &[(SurfacePoint, f32)]),
    rule: Interpolation,
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
    if good && !world.anything_above(own, clear * size) {
        line
    } else {
        [None; 4]
    }
}
