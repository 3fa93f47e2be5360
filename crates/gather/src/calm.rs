//! Light that hardly changes over wide open surfaces.
//!
//! On the ground under a sky, and on a closed level's dark outside, hundreds of lumels have the
//! same indirect light. Flat, clear surfaces are divided into cells of 8 × 8 lumels. Nine of a
//! cell's lumels are gathered first. If they agree, the others that would be gathered take the
//! bilinear interpolation of these nine; else they are gathered, too.

use radiosity::luminance;
use rayon::prelude::*;

use crate::between::{Between, mean_of};
use crate::clear::{CELL, STEP};
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::received::{Edge, Received};

/// The light of a lumel in a calm cell, with what else the cell's samples agree about.
pub(crate) struct Calm<'m> {
    pub indirect: Between,
    /// One of the samples.
    pub like: &'m Received,
}

/// Indirect light of lumel `i` of a clear cell, if the cell's samples differ by at most `limit`,
/// relative to their light.
pub(crate) fn calm(map: &LumelMap, i: usize, limit: f32) -> Option<Calm<'_>> {
    let samples = samples(map, i)?.map(|j| &map.received[j]);
    agreed(samples, place(map, i), limit)
}

/// Estimated number of lumels that have to be gathered because their cell, though clear, is not
/// calm: from so many cells.
pub fn not_calm(gatherer: &Gatherer, map: &LumelMap, cells: usize) -> usize {
    let held: Vec<usize> = (0..map.len()).filter(|&i| map.plan.is_held(i)).collect();
    let gather = |i: usize| {
        let (footprint, seed) = map.footprint(gatherer.world(), i);
        gatherer.gather(&footprint, seed)
    };
    let is_calm = |i: usize| {
        let light = samples(map, i)?.map(gather);
        let light = std::array::from_fn(|k| &light[k]);
        agreed(light, place(map, i), gatherer.options.calm).map(|_| ())
    };
    let tried = held.par_iter().step_by(held.len().div_ceil(cells).max(1));
    let calm: Vec<bool> = tried.map(|&i| is_calm(i).is_some()).collect();
    let not = calm.iter().filter(|&&calm| !calm).count();
    held.len() * not / calm.len().max(1)
}

/// The column and row of lumel `i` in its cell.
fn place(map: &LumelMap, i: usize) -> [usize; 2] {
    map.lumel(i).texel.map(|x| x as usize % CELL)
}

/// The samples of the cell of lumel `i`, row by row.
fn samples(map: &LumelMap, i: usize) -> Option<[usize; 9]> {
    let l = map.lumel(i);
    let [x, y] = l.texel.map(|x| (x as usize / CELL * CELL) as i64);
    let mut out = [0; 9];
    for (k, sample) in out.iter_mut().enumerate() {
        let [dx, dy] = [k % 3, k / 3].map(|steps| (steps * STEP) as i64);
        *sample = map.index.at(l.page, x + dx, y + dy)?;
    }
    Some(out)
}

/// The light at this column and row of a cell, if its samples agree.
fn agreed<'r>(samples: [&'r Received; 9], at: [usize; 2], limit: f32) -> Option<Calm<'r>> {
    let like = samples[4];
    let (mut low, mut high, mut least, mut variance) = (f32::MAX, 0f32, f32::MAX, 0f32);
    for r in samples {
        let agrees = (r.void, r.around) == (like.void, like.around);
        if r.open < 1.0 || r.near || r.behind || r.edge == Edge::Contact || !agrees {
            return None;
        }
        let light = luminance(r.indirect);
        (low, high) = (low.min(light), high.max(light));
        least = least.min(luminance(r.light()));
        variance += r.indirect_variance / samples.len() as f32;
    }
    // Nine values lie within three standard deviations of each other, on average.
    let limit = limit * least;
    if high - low > limit || 3.0 * variance.sqrt() > 2.0 * limit {
        return None;
    }
    // Bilinear in the quarter of the cell.
    let [column, row] = at.map(|x| x / STEP);
    let [u, v] = at.map(|x| (x % STEP) as f32 / STEP as f32);
    let first = 3 * row + column;
    let corners = [
        (first, (1.0 - u) * (1.0 - v)),
        (first + 1, u * (1.0 - v)),
        (first + 3, (1.0 - u) * v),
        (first + 4, u * v),
    ];
    Some(Calm {
        indirect: mean_of(corners.into_iter().map(|(k, weight)| (samples[k], weight))),
        like,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Nine samples whose light rises by `slope` from one to the next in both directions, with this
    /// standard error.
    fn rising(slope: f32, noise: f32) -> [Received; 9] {
        std::array::from_fn(|k| Received {
            indirect: Vec3::splat(1.0 + slope * (k % 3 + k / 3) as f32),
            indirect_variance: noise * noise,
            open: 1.0,
            ..Received::default()
        })
    }

    fn light(samples: &[Received; 9], at: [usize; 2]) -> Option<f32> {
        let calm = agreed(std::array::from_fn(|k| &samples[k]), at, 0.03)?;
        Some(calm.indirect.indirect.x)
    }

    #[test]
    fn light_between_samples_that_agree_is_linear() {
        let samples = rising(0.007, 0.01);
        for at in [[0, 0], [3, 6], [7, 7], [4, 1]] {
            let expected = 1.0 + 0.007 * (at[0] + at[1]) as f32 / STEP as f32;
            let found = light(&samples, at).expect("they differ by 0.028");
            assert!((found - expected).abs() < 1e-6, "{at:?}: {found}");
        }
    }

    #[test]
    fn samples_that_differ_or_are_noisy_decide_nothing() {
        assert!(light(&rising(0.008, 0.01), [1, 1]).is_none());
        assert!(light(&rising(0.007, 0.03), [1, 1]).is_none());
        for change in [
            |r: &mut Received| r.open = 0.9,
            |r: &mut Received| r.near = true,
            |r: &mut Received| r.behind = true,
            |r: &mut Received| r.void = true,
            |r: &mut Received| r.edge = Edge::Contact,
        ] {
            let mut samples = rising(0.0, 0.0);
            change(&mut samples[7]);
            assert!(light(&samples, [1, 1]).is_none());
        }
    }
}
