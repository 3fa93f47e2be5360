//! What a gather will cost, from a few of its lumels, and stitching after it.

use std::time::{Duration, Instant};

use atlas::{Layout, Lumels};
use gather::LumelMap;
use radiosity::{Emitters, Solution, World};
use rayon::prelude::*;

use crate::options::BakeOptions;
use crate::seams::find_samples;

/// Lumels of a round, for each thread: some milliseconds, so that of [`TRIES`] at a round one is
/// likely to be left alone by what else runs on the machine. Rounds go on until [`ENOUGH`].
const ROUND: usize = 48;

/// How often a round is done; the shortest time counts.
const TRIES: usize = 3;

/// Most rounds.
const ROUNDS: usize = 24;

/// Long enough for lumels of all sorts, and no burden beside reading and unwrapping a level.
const ENOUGH: Duration = Duration::from_millis(500);

/// What lumels cost.
#[derive(Debug, Clone, Copy, Default)]
pub struct GatherCost {
    /// Lumels that light is gathered at.
    pub gathered: usize,
    /// Lumels on flat open surfaces, whose indirect light is interpolated where it is steady.
    pub interpolated: usize,
    /// Seconds that one of `gathered` takes, with the threads of the current rayon pool at work
    /// together; as measured just now.
    pub seconds: f64,
    /// Rays, gathering and shadow rays together, that one of them casts in the mean.
    pub rays: f64,
    /// Points where lookups on two sides of a seam are compared.
    pub seam_samples: usize,
    /// Channels, light and layers, that are stitched.
    pub stitched: usize,
}

/// Points where lookups on two sides of a seam would be compared: memory is needed for each.
pub fn seam_samples(world: &World, layout: &Layout) -> usize {
    let lumels = Lumels::find(world.scene, world.soup, layout);
    find_samples(world, layout, &lumels).len()
}

/// Gathers at lumels here and there, and says how long that took.
///
/// `solution` may be a coarse one: it is the ways of rays that count, not the light.
pub fn gather_cost(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    layout: &Layout,
    options: &BakeOptions,
) -> GatherCost {
    let map = LumelMap::new(world, layout, options.lumels.interpolation);
    let full: Vec<usize> = (0..map.len())
        .filter(|&i| !map.is_interpolated(i))
        .collect();
    let mut cost = GatherCost {
        gathered: full.len(),
        interpolated: map.len() - full.len(),
        seam_samples: find_samples(world, layout, map.lumels()).len(),
        ..GatherCost::default()
    };
    if options.stitch {
        let groups = options.wanted(world).groups;
        let directions = if options.directional.is_some() { 4 } else { 0 };
        cost.stitched = 3 * (1 + groups + options.layers.len() + directions);
    }
    if full.is_empty() {
        return cost;
    }
    let gatherer = options.gatherer(world, emitters, solution);
    let gather = |k: usize| -> u64 {
        // Multiples of the golden ratio: every stretch of them lies evenly over the level.
        let at = (k as f64 * 0.618_033_988_749_895).fract() * full.len() as f64;
        let (footprint, seed) = map.footprint(world, full[(at as usize).min(full.len() - 1)]);
        gatherer.gather(&footprint, seed).rays
    };
    let size = ROUND * rayon::current_num_threads();
    let round = |r: usize| -> u64 {
        let lumels = r * size..(r + 1) * size;
        lumels.into_par_iter().map(&gather).sum()
    };
    // Once to wake threads and caches.
    round(0);
    let start = Instant::now();
    let (mut rounds, mut rays, mut seconds) = (0, 0, 0.0);
    while rounds < ROUNDS && start.elapsed() < ENOUGH {
        let mut least = f64::INFINITY;
        for again in 0..TRIES {
            let begin = Instant::now();
            let cast = round(rounds);
            least = least.min(begin.elapsed().as_secs_f64());
            rays += if again == 0 { cast } else { 0 };
        }
        seconds += least;
        rounds += 1;
    }
    let done = (rounds * size) as f64;
    cost.seconds = seconds / done;
    cost.rays = rays as f64 / done;
    cost
}
