//! Light at all lumels of a scene: the passes of a bake, in order.

use atlas::Layout;
use radiosity::{Cancelled, Monitor};

use crate::barriers::Barriers;
use crate::first::gather_first;
use crate::gatherer::Gatherer;
use crate::hidden::fill_hidden;
use crate::map::LumelMap;
use crate::options::LightOptions;
use crate::reach::{Reached, reach, settle};
use crate::refine::{add_rays, follow_edges};
use crate::tiles::{OfTile, tiles};
use crate::totals::{LightReport, Totals};
use crate::work::{Records, Shard, Work};

/// What a bake gathers.
#[derive(Clone, Copy)]
pub struct LightBake<'b> {
    /// The instances, in rising order. If some are missing, a part of the level is baked anew, in
    /// the light of the whole level.
    pub instances: &'b [usize],
    /// Passes after the gather.
    pub options: LightOptions,
    /// Light that [`gather_shard`] has gathered, to be reused. The result does not depend on which
    /// records exist. Only for bakes of all instances.
    pub records: Option<&'b dyn Records>,
}

/// Receives the finished lumels of a tile, and a monitor for what it does with them.
pub type EachTile<'e> = dyn FnMut(LumelMap, &dyn Monitor) -> Result<(), Cancelled> + 'e;

/// Gathers light at all lumels of some instances, tile by tile, and passes each tile on.
///
/// Deterministic for any number of threads: every footprint is computed independently, with random
/// numbers that depend on its place.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn bake_light(
    gatherer: &Gatherer,
    layout: &Layout,
    bake: LightBake,
    monitor: &dyn Monitor,
    each: &mut EachTile,
) -> Result<LightReport, Cancelled> {
    let tiles = tiles(layout, bake.instances, gatherer.options.tile);
    let monitors = OfTile::each(monitor, layout, bake.instances, &tiles);
    let (mut totals, mut base) = (Totals::default(), 0);
    for (tile, monitor) in tiles.into_iter().zip(monitors) {
        let instances = bake.instances[tile].iter().copied();
        let rule = gatherer.options.interpolation;
        let mut map = LumelMap::of(gatherer.world(), layout, rule, instances);
        let work = Work::whole(&monitor, gatherer.options.follow);
        let work = match bake.records {
            None => work,
            Some(records) => work.rest(records, base),
        };
        base += map.len();
        let reached = bake_tile(gatherer, &mut map, bake.options, work)?;
        totals.add(&map, reached);
        each(map, &monitor)?;
    }
    Ok(totals.report(bake.options.error))
}

/// Gathers the light of a shard into `records`, with the passes of [`bake_light`] that do not need
/// all lumels of a tile.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn gather_shard(
    gatherer: &Gatherer,
    layout: &Layout,
    shard: &Shard,
    records: &dyn Records,
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let careful = &gatherer.options;
    let all: Vec<usize> = (0..layout.placements.len()).collect();
    let own = shard.tiles(&tiles(layout, &all, careful.tile));
    let touched: Vec<_> = own.iter().map(|tile| tile.instances.clone()).collect();
    let monitors = OfTile::each(monitor, layout, &all, &touched);
    for (tile, monitor) in own.into_iter().zip(monitors) {
        let instances = tile.instances.clone();
        let mut map = LumelMap::of(gatherer.world(), layout, careful.interpolation, instances);
        let mut work = Work::whole(&monitor, careful.follow).shard(tile, records);
        gather_passes(gatherer, &mut map, &mut work)?;
    }
    Ok(())
}

/// The passes that a shard can run.
fn gather_passes(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    work: &mut Work,
) -> Result<(), Cancelled> {
    gather_first(gatherer, map, work)?;
    follow_edges(gatherer, map, work)?;
    if gatherer.options.open_only {
        map.barriers = Barriers::find(gatherer.world(), &map.lumels, &map.index, &map.received);
    }
    add_rays(gatherer, map, work)
}

/// All passes over a tile, in order.
fn bake_tile(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    options: LightOptions,
    mut work: Work,
) -> Result<Reached, Cancelled> {
    let (world, careful) = (gatherer.world(), &gatherer.options);
    gather_passes(gatherer, map, &mut work)?;
    let fill = careful.open_only;
    // Hidden lumels take their neighbours' light.
    let finish = |map: &mut LumelMap| {
        if fill {
            fill_hidden(world, map, options.rings);
        }
    };
    let reached = match options.error {
        Some(wanted) => reach(gatherer, map, wanted, &finish, work.monitor)?,
        None => Reached::default(),
    };
    let asked = options.error.is_some();
    settle(map, careful.rays, gatherer.wanted.groups, asked);
    finish(map);
    Ok(reached)
}
