//! Chooses lumels whose indirect light is interpolated between neighbours.
//!
//! Reflected light varies slowly over a flat piece of surface with nothing on or near it. There
//! every second lumel in either direction is gathered. The three between them first take the mean
//! of their neighbours, and later the value of the smoothing's quadratic at their position. This
//! halves the number of gathering rays, because each gathered lumel gets twice as many. Nearby
//! objects, whose light or shadow varies from lumel to lumel, are found by geometry instead of
//! rays, which miss thin objects. Direct light is computed at every lumel.
//!
//! [`Interpolation::Wide`], the rule of a draft, does this wherever nothing rises within one lumel,
//! even on curves and along chart borders. It also interpolates direct light where neighbours agree
//! about it, and interpolates the smoothed values of gathered lumels by a cubic.
//!
//! After Ward, Rubinstein, Clear, *A ray tracing solution for diffuse interreflection*, 1988 (the
//! irradiance cache: nearby objects limit a sample's range), but on the lightmap's own grid, and
//! with a check of differences between neighbours.
//!
//! Where even the light of [wide cells](crate::calm) hardly changes, fewer lumels are gathered.

use atlas::{Lumels, TexelIndex};
use radiosity::{SurfacePoint, World, luminance};
use rayon::prelude::*;

use crate::clear::{CLEAR, clear_cells, is_flat, is_sample};
use crate::footprint::{Footprint, LumelFootprint};
use crate::options::Interpolation;
use crate::received::{Edge, Received};

/// Largest difference between neighbours, relative to their light, in addition to noise. If light
/// changes that much and the change itself changes as much again, linear interpolation is off by an
/// eighth of it.
const STEADY: f32 = 0.1;

/// Standard errors of noise that are added to that.
const SIGMAS: f32 = 3.0;

/// Limits of clearance, difference and normals for [`Interpolation::Wide`], and the least coverage
/// of a neighbour. Nothing rises within one lumel, because lumels at a contact have light of their
/// own. Normals differ by at most 30°, as in the smoothing's window, which determines the final
/// light of these lumels.
const WIDE_CLEAR: f32 = 1.0;
const WIDE_STEADY: f32 = 0.3;
pub(crate) const WIDE_FACING: f32 = 0.85;
const WIDE_COVERED: f32 = 0.1;

/// The neighbours that a lumel is interpolated between.
pub(crate) type Beside = [Option<u32>; 4];

/// The interpolated lumels and their neighbours.
pub(crate) struct Plan {
    /// For each lumel, its neighbours; all `None` if it is gathered.
    pub beside: Vec<Beside>,
    /// For each lumel, whether others are interpolated from it.
    bears: Vec<bool>,
    /// For each lumel, whether its cell is calm; before the first pass, whether it may be.
    calm: Vec<bool>,
    /// For each lumel, whether it is in an even row and column but not gathered if its cell is
    /// calm.
    held: Vec<bool>,
    pub rule: Interpolation,
}

impl Plan {
    /// Nothing is interpolated.
    pub(crate) fn none(lumels: usize) -> Self {
        Plan {
            beside: vec![[None; 4]; lumels],
            bears: vec![false; lumels],
            calm: vec![false; lumels],
            held: vec![false; lumels],
            rule: Interpolation::Open,
        }
    }

    /// Finds the pieces of surface that have nothing near them.
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
        Plan {
            beside,
            bears: vec![false; n],
            held: (lumels.lumels.iter())
                .map(|l| l.texel.iter().all(|x| x % 2 == 0) && !is_sample(l.texel))
                .collect(),
            calm: clear_cells(world, lumels, (index, &places)),
            rule,
        }
    }

    /// Whether lumel `i` is interpolated.
    #[inline]
    pub(crate) fn is(&self, i: usize) -> bool {
        self.beside[i].iter().any(|j| j.is_some())
    }

    /// Whether lumel `i` is in a calm cell, or before the first pass in one that may be.
    #[inline]
    pub(crate) fn is_calm(&self, i: usize) -> bool {
        self.calm[i]
    }

    /// Whether lumel `i` has the light of its calm cell, or before the first pass may have.
    #[inline]
    pub(crate) fn is_held(&self, i: usize) -> bool {
        self.calm[i] && self.held[i]
    }

    /// Decides which lumels are in calm cells.
    pub(crate) fn set_calm(&mut self, calm: Vec<bool>) {
        self.calm = calm;
    }

    /// Whether lumel `i` is gathered.
    #[inline]
    pub(crate) fn is_gathered(&self, i: usize) -> bool {
        !self.is(i) && !self.is_held(i)
    }

    /// Gathers at lumel `i` after all instead of interpolating it.
    pub(crate) fn drop(&mut self, i: usize) {
        self.beside[i] = [None; 4];
        self.calm[i] = false;
    }

    /// Whether others are interpolated from lumel `i`.
    #[inline]
    pub(crate) fn bears(&self, i: usize) -> bool {
        self.bears[i]
    }

    /// The neighbours that lumel `i` is interpolated between.
    pub(crate) fn of(&self, i: usize) -> impl Iterator<Item = usize> + Clone + '_ {
        self.beside[i].iter().flatten().map(|&j| j as usize)
    }

    /// Factor on the rays of a lumel from which others are interpolated, because its error appears
    /// in four lumels. With [`Interpolation::Wide`] most lumels are like that, so the factor is 1.
    pub(crate) fn bearing(&self, i: usize) -> u32 {
        if self.bears[i] {
            self.most_bearing()
        } else {
            1
        }
    }

    /// Largest value of [`bearing`](Self::bearing).
    pub(crate) fn most_bearing(&self) -> u32 {
        match self.rule {
            Interpolation::Open => 2,
            Interpolation::Wide => 1,
        }
    }

    /// Stops interpolation between neighbours that differ too much; flags the lumels that must now
    /// be gathered.
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

    /// Whether smoothing leaves lumel `i` to interpolation.
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

/// The neighbours that lumel `i` may be interpolated between.
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
            Interpolation::Open => is_flat(lumels, places, (i, j), steps),
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
        // All neighbours must exist, and the lumel itself must be whole.
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
