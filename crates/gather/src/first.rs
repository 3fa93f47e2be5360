//! The first pass over the map: light at every lumel.

use radiosity::Cancelled;
use rayon::prelude::*;

use crate::between::{between, direct_between};
use crate::calm::calm;
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::options::Interpolation;
use crate::received::Received;
use crate::sheets::turn_unseen;
use crate::work::{Pass, Work};

/// Gathers at all lumels; interpolated ones get at most their own direct light. If neighbours
/// differ too much, the lumels between them are gathered after all.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn gather_first(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    work: &mut Work,
) -> Result<(), Cancelled> {
    let n = map.len();
    let world = gatherer.world();
    let whole = |map: &LumelMap, i: usize, ()| {
        let (footprint, seed) = map.footprint(world, i);
        gatherer.gather(&footprint, seed)
    };
    map.received.resize_with(n, Received::default);
    let first = listed((0..n).filter(|&i| map.plan.is_gathered(i)));
    work.gather(map, Pass::First, &first, whole)?;
    gather_cells(gatherer, map, work)?;
    // A sheet may extend beyond a shard. Shards treat sheets as not turned, and the merge gathers
    // turned sheets again.
    if !work.is_shard() {
        let turned = turn_unseen(gatherer, map, work.monitor)?;
        work.distrust(map, &turned);
    }
    let unsteady = map.plan.drop_unsteady(&map.received);
    let planned = listed((0..n).filter(|&i| map.plan.is(i)));
    work.gather(map, Pass::Between, &planned, |map, i, ()| {
        let (footprint, seed) = map.footprint(world, i);
        let between = between(map, i);
        let direct = match map.plan.rule {
            Interpolation::Open => None,
            Interpolation::Wide => direct_between(map, i),
        };
        direct
            .and_then(|direct| gatherer.gather_nothing(&footprint, seed, &between, direct))
            .unwrap_or_else(|| gatherer.gather_direct(&footprint, seed, &between))
    })?;
    // After the others, which do not read them.
    let unsteady = listed((0..n).filter(|&i| unsteady[i]));
    work.gather(map, Pass::Unsteady, &unsteady, whole)
}

/// Decides which cells are calm, and gathers the rest of the others.
fn gather_cells(gatherer: &Gatherer, map: &mut LumelMap, work: &Work) -> Result<(), Cancelled> {
    let (world, limit) = (gatherer.world(), gatherer.options.calm);
    let held = listed((0..map.len()).filter(|&i| map.plan.is_held(i)));
    let seen = &*map;
    let is_calm = (0..map.len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|i| seen.plan.is_calm(i) && calm(seen, i, limit).is_some())
        .collect();
    map.plan.set_calm(is_calm);
    work.gather(map, Pass::Cells, &held, |map, i, ()| {
        let (footprint, seed) = map.footprint(world, i);
        match calm(map, i, limit) {
            Some(calm) => gatherer.gather_calm(&footprint, seed, &calm),
            None => gatherer.gather(&footprint, seed),
        }
    })
}

/// These lumels, without further data.
fn listed(lumels: impl Iterator<Item = usize>) -> Vec<(usize, ())> {
    lumels.map(|i| (i, ())).collect()
}
