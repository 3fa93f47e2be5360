//! Divides the lumels of a bake into tiles, which bound its memory: only one tile's lumels exist at
//! a time.
//!
//! Passes read neighbours of the same instance only, so a tile is a run of whole instances. What a
//! pass judges over many lumels (mean light, noise) it judges over a tile. So the division must not
//! depend on the machine: it depends on the layout alone.

use std::ops::Range;

use atlas::Layout;
use radiosity::{Monitor, Phase};

/// Texels of a tile. With some 550 bytes a lumel these are at most 290 MB; a single larger instance
/// is a tile of its own. Far more lumels than the statistics of noise need (hundreds), and enough
/// to keep all threads busy.
pub const TILE: u64 = 1 << 19;

/// The tiles of these instances, of this many texels: ranges of the list.
pub fn tiles(layout: &Layout, instances: &[usize], tile: u64) -> Vec<Range<usize>> {
    divide(instances.iter().map(|&i| texels(layout, i)), tile)
}

/// Upper bound on the number of an instance's lumels.
fn texels(layout: &Layout, instance: usize) -> u64 {
    let rect = layout.placements[instance].rect;
    u64::from(rect.w) * u64::from(rect.h)
}

fn divide(sizes: impl Iterator<Item = u64>, tile: u64) -> Vec<Range<usize>> {
    let (mut out, mut start, mut sum, mut n) = (Vec::new(), 0, 0, 0);
    for (i, size) in sizes.enumerate() {
        if sum > 0 && sum + size > tile {
            out.push(start..i);
            (start, sum) = (i, 0);
        }
        sum += size;
        n = i + 1;
    }
    if n > start {
        out.push(start..n);
    }
    out
}

/// Shows a tile's progress as part of that of all.
pub(crate) struct OfTile<'m> {
    pub monitor: &'m dyn Monitor,
    /// Texels of the tiles before it, of this tile, and of all.
    pub texels: [u64; 3],
}

impl<'m> OfTile<'m> {
    /// The monitors of these tiles, in order.
    pub(crate) fn each(
        monitor: &'m dyn Monitor,
        layout: &Layout,
        instances: &[usize],
        tiles: &[Range<usize>],
    ) -> Vec<OfTile<'m>> {
        let size = |tile: &Range<usize>| -> u64 {
            let own = &instances[tile.clone()];
            own.iter().map(|&i| texels(layout, i)).sum()
        };
        let all = tiles.iter().map(size).sum();
        let before = tiles.iter().scan(0, |sum, tile| {
            let before = *sum;
            *sum += size(tile);
            Some([before, size(tile), all])
        });
        before.map(|texels| OfTile { monitor, texels }).collect()
    }
}

impl Monitor for OfTile<'_> {
    fn progress(&self, phase: Phase, done: u64, total: u64) {
        let [before, own, all] = self.texels;
        if own == all {
            self.monitor.progress(phase, done, total);
            return;
        }
        // With several tiles, phases follow each other many times. They are shown as one.
        let part = match phase {
            Phase::Lumels | Phase::Gather => 0.0..GATHER,
            Phase::Refine => GATHER..REFINE,
            _ => REFINE..1.0,
        };
        let share = done as f64 / total.max(1) as f64;
        let within = part.start + share.min(1.0) * (part.end - part.start);
        let done = before + (own as f64 * within) as u64;
        self.monitor.progress(Phase::Gather, done, all);
    }

    fn residual(&self, residual: f64) {
        self.monitor.residual(residual);
    }

    fn cancelled(&self) -> bool {
        self.monitor.cancelled()
    }
}

/// Share of a tile's time after its gather, and after more rays; the rest is for vertices. Rough
/// means over scenes at `preview`.
const GATHER: f64 = 0.5;
const REFINE: f64 = 0.85;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_hold_all_instances_once_and_are_bounded() {
        let of = |sizes: &[u64]| divide(sizes.iter().copied(), 100);
        assert_eq!(of(&[]), []);
        assert_eq!(of(&[1, 2, 100]), [0..2, 2..3]);
        assert_eq!(of(&[50, 50, 1]), [0..2, 2..3]);
        // An instance that is too large stands alone.
        assert_eq!(of(&[1, 200, 0, 5]), [0..1, 1..2, 2..4]);
    }
}
