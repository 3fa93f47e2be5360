//! The first pass over the map: light at every lumel.

use radiosity::Cancelled;

use crate::between::{between, direct_between};
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
    let first = listed((0..n).filter(|&i| !map.plan.is(i)));
    work.gather(map, Pass::First, &first, whole)?;
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

/// These lumels, without further data.
fn listed(lumels: impl Iterator<Item = usize>) -> Vec<(usize, ())> {
    lumels.map(|i| (i, ())).collect()
}
