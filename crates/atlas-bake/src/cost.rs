//! Estimates the cost of a gather from a few lumels, and the cost of stitching.

use atlas::{Layout, Lumels};
use gather::{Gatherer, LumelMap, Plane, TILE, not_calm, tiles};
use glam::Vec3;
use half::f16;
use radiosity::{Emitters, Solution, World};
use rayon::prelude::*;

use crate::channels::channels;
use crate::options::{BakeOptions, Divided};
use crate::seams::find_samples;
use crate::work_time::WorkTime;

/// Lumels per thread and round. A round takes some milliseconds, so that at least one of its
/// [`TRIES`] likely keeps its caches. Rounds go on until [`ENOUGH`].
const ROUND: usize = 48;

/// Repetitions of a round; the shortest time counts.
const TRIES: usize = 3;

/// Most rounds.
const ROUNDS: usize = 24;

/// Cells of open surfaces that are tried out, over all tiles; nine lumels each.
const CELLS: usize = 24;

/// Seconds, long enough to sample all kinds of lumels, but short compared to reading and unwrapping a
/// level.
const ENOUGH: f64 = 0.5;

/// Cost of gathering.
#[derive(Debug, Clone, Copy, Default)]
pub struct GatherCost {
    /// Lumels that are gathered.
    pub gathered: usize,
    /// Measured seconds per gathered lumel, with all threads of the current rayon pool working.
    pub seconds: f64,
    /// Mean number of rays per gathered lumel, including shadow rays.
    pub rays: f64,
    /// Lumels, and points of seams.
    pub counts: Counts,
    /// Number of stitched channels, including layers.
    pub stitched: usize,
}

/// Numbers that determine the memory of a bake.
#[derive(Debug, Clone, Copy, Default)]
pub struct Counts {
    /// Lumels.
    pub lumels: usize,
    /// Lumels of the largest tile.
    pub in_tile: usize,
    /// Lumels of the largest instance.
    pub in_instance: usize,
    /// Points where lookups on the two sides of a seam are compared.
    pub seam_samples: usize,
}

impl Counts {
    /// Counts what a layout has.
    pub fn of(world: &World, layout: &Layout) -> Counts {
        let (scene, soup) = (world.scene, world.soup);
        let lumels = Lumels::count(scene, soup, layout);
        let all: Vec<usize> = (0..lumels.len()).collect();
        let sum = |counts: &[u32]| counts.iter().map(|&n| n as usize).sum();
        let in_tiles = tiles(layout, &all, TILE).into_iter();
        let corners = Lumels::corners(scene, soup, layout);
        Counts {
            lumels: sum(&lumels),
            in_tile: in_tiles.map(|tile| sum(&lumels[tile])).max().unwrap_or(0),
            in_instance: lumels.iter().max().map_or(0, |&n| n as usize),
            seam_samples: find_samples(world, layout, &corners).len(),
        }
    }
}

/// Bytes of an allocation, with what the allocator adds.
fn allocated(bytes: usize) -> usize {
    match bytes {
        0 => 0,
        _ => (bytes + 8).next_multiple_of(16).max(32),
    }
}

/// Memory of what `options` ask for beyond light: bytes per lumel of a tile, and per texel of a
/// page.
pub fn extra_bytes(options: &BakeOptions, divided: Divided) -> [usize; 2] {
    let planes = options.wanted_of(divided).planes();
    // Smoothing makes two more lists of a part of each plane.
    let kept = allocated(planes * size_of::<Plane>());
    let smoothed = 2 * allocated(planes * size_of::<Vec3>());
    // Files hold at most a half per sample.
    let (value, half) = (size_of::<f32>(), size_of::<f16>());
    let page = 4 * value + 3 * half;
    let channels = channels(options, divided.masks).len() * (value + half);
    let masks = usize::from(divided.masks) * (page + value + half);
    let texel = channels + divided.groups * page + masks;
    [kept + smoothed, texel]
}

/// Gathers at lumels distributed over the scene and measures the time.
///
/// `solution` may be coarse: its paths of rays matter, not its light.
pub fn gather_cost(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    layout: &Layout,
    options: &BakeOptions,
) -> GatherCost {
    let mut cost = GatherCost {
        counts: Counts::of(world, layout),
        ..GatherCost::default()
    };
    if options.stitch {
        let groups = options.wanted(world).groups;
        let directions = if options.directional.is_some() { 4 } else { 0 };
        cost.stitched = 3 * (1 + groups + options.layers.len() + directions);
    }
    let gatherer = options.gatherer(world, emitters, solution);
    let all: Vec<usize> = (0..layout.placements.len()).collect();
    let tiles = tiles(layout, &all, TILE);
    let (mut done, mut rays, mut seconds) = (0, 0, 0.0);
    let (rounds, enough) = (
        ROUNDS.div_ceil(tiles.len().max(1)),
        ENOUGH / tiles.len().max(1) as f64,
    );
    let cells = CELLS.div_ceil(tiles.len().max(1));
    for tile in tiles {
        let map = LumelMap::of(world, layout, options.lumels.interpolation, tile);
        let full: Vec<usize> = (0..map.len()).filter(|&i| map.is_gathered(i)).collect();
        cost.gathered += full.len() + not_calm(&gatherer, &map, cells);
        if !full.is_empty() {
            let trial = try_out(&gatherer, &map, &full, (rounds, enough));
            done += trial.lumels;
            rays += trial.rays;
            seconds += trial.seconds;
        }
    }
    if done > 0 {
        cost.seconds = seconds / done as f64;
        cost.rays = rays as f64 / done as f64;
    }
    cost
}

/// Lumels gathered for a trial, their rays and their time.
struct Trial {
    lumels: usize,
    rays: u64,
    seconds: f64,
}

/// Gathers at some of the lumels `full`, in at most this many rounds and about this time.
fn try_out(
    gatherer: &Gatherer,
    map: &LumelMap,
    full: &[usize],
    (most, enough): (usize, f64),
) -> Trial {
    let gather = |k: usize| -> u64 {
        // Multiples of the golden ratio: every interval of them is evenly distributed over the
        // tile.
        let at = (k as f64 * 0.618_033_988_749_895).fract() * full.len() as f64;
        let i = full[(at as usize).min(full.len() - 1)];
        let (footprint, seed) = map.footprint(gatherer.world(), i);
        gatherer.gather(&footprint, seed).rays
    };
    let size = ROUND * rayon::current_num_threads();
    let round = |r: usize| -> u64 {
        let lumels = r * size..(r + 1) * size;
        lumels.into_par_iter().map(&gather).sum()
    };
    // Warms up threads and caches.
    round(0);
    let start = WorkTime::start();
    let (mut rounds, mut rays, mut seconds) = (0, 0, 0.0);
    while rounds < most && (rounds == 0 || start.parallel() < enough) {
        let mut least = f64::INFINITY;
        for again in 0..TRIES {
            let begin = WorkTime::start();
            let cast = round(rounds);
            least = least.min(begin.parallel());
            rays += if again == 0 { cast } else { 0 };
        }
        seconds += least;
        rounds += 1;
    }
    Trial {
        lumels: rounds * size,
        rays,
        seconds,
    }
}
