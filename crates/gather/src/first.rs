//! The first pass over the map: light at every lumel.

use radiosity::{Cancelled, Monitor, Phase};

use crate::between::{between, direct_between};
use crate::blocks::in_blocks;
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::options::Interpolation;
use crate::received::Received;
use crate::sheets::turn_unseen;

/// Gathers at all lumels; interpolated ones get at most their own direct light. If neighbours
/// differ too much, the lumels between them are gathered after all.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn gather_first(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let n = map.len();
    let world = gatherer.world();
    let first: Vec<usize> = (0..n).filter(|&i| !map.plan.is(i)).collect();
    let gathered = in_blocks(first.len(), Phase::Gather, monitor, |k| {
        let (footprint, seed) = map.footprint(world, first[k]);
        gatherer.gather(&footprint, seed)
    })?;
    map.received.resize_with(n, Received::default);
    for (i, r) in first.into_iter().zip(gathered) {
        map.received[i] = r;
    }
    turn_unseen(gatherer, map, monitor)?;
    let unsteady = map.plan.drop_unsteady(&map.received);
    let rest: Vec<usize> = (0..n).filter(|&i| map.plan.is(i) || unsteady[i]).collect();
    let gathered = in_blocks(rest.len(), Phase::Gather, monitor, |k| {
        let i = rest[k];
        let (footprint, seed) = map.footprint(world, i);
        if unsteady[i] {
            return gatherer.gather(&footprint, seed);
        }
        let between = between(map, i);
        let direct = match map.plan.rule {
            Interpolation::Open => None,
            Interpolation::Wide => direct_between(map, i),
        };
        direct
            .and_then(|direct| gatherer.gather_nothing(&footprint, seed, &between, direct))
            .unwrap_or_else(|| gatherer.gather_direct(&footprint, seed, &between))
    })?;
    for (i, r) in rest.into_iter().zip(gathered) {
        map.received[i] = r;
    }
    Ok(())
}
