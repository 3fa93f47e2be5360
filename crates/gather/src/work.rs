//! Divides the passes of a bake among processes.
//!
//! A shard gathers a range of lumels, as far as it can decide each pass by itself: lumels whose
//! pass reads neighbours beyond the range are left out. The results go to [`Records`]. The merge
//! runs all passes over all lumels. It decides each pass again, which costs no rays, reuses the
//! light in the records, and gathers the rest itself. So missing records cost time but never change
//! the result.
//!
//! Lumels are ordered by instance, row and column, and passes read neighbours of the same instance
//! only. The lumels of a shard whose neighbours are all known therefore form a range too.

use std::ops::Range;

use radiosity::{Cancelled, Monitor, Phase};

use crate::blocks::{IN_RUN, part_in_blocks};
use crate::clear::CELL;
use crate::map::LumelMap;
use crate::received::Received;
use crate::window::WIDE;

/// A pass that gathers light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pass {
    /// The first, at lumels that are gathered in any case.
    First,
    /// The other lumels of clear cells, after the cells' samples.
    Cells,
    /// Direct light at interpolated lumels.
    Between,
    /// Lumels that were to be interpolated, between neighbours that differ too much.
    Unsteady,
    /// A round of following edges, from 0.
    Edges(u32),
    /// More rays, where neighbours show a need.
    More,
}

/// Number of rows around a lumel on which its plan between the first and the second pass depends:
/// the taps of interpolation are three lumels away, and whether a tap is itself interpolated
/// depends on its neighbours.
const BETWEEN: u32 = 4;

/// The same for a round of following edges, and for walls.
const BESIDE: u32 = 1;

impl Pass {
    /// Number of rows around a lumel that its light after this pass depends on, over all passes so
    /// far. `follow` is the number of rounds of [`Pass::Edges`].
    fn depth(self, follow: u32) -> u32 {
        match self {
            Pass::First => 0,
            Pass::Cells => CELL as u32,
            Pass::Between | Pass::Unsteady => CELL as u32 + BETWEEN,
            Pass::Edges(round) => CELL as u32 + BETWEEN + (round + 1) * BESIDE,
            Pass::More => CELL as u32 + BETWEEN + follow * BESIDE + BESIDE + WIDE as u32,
        }
    }

    /// The phase that progress shows.
    fn phase(self) -> Phase {
        match self {
            Pass::First | Pass::Cells | Pass::Between | Pass::Unsteady => Phase::Gather,
            Pass::Edges(_) | Pass::More => Phase::Refine,
        }
    }
}

/// Stores the light that shards gather.
pub trait Records: Sync {
    /// Stores the light of these lumels after a pass. Lumels are numbered over the whole layout.
    fn put(&self, pass: Pass, lumels: &[u32], light: &[Received]);

    /// Passes on what was stored for a pass, at least of these lumels.
    fn take(&self, pass: Pass, lumels: Range<u32>, to: &mut dyn FnMut(u32, Received));
}

/// The part of a layout that a shard gathers.
#[derive(Debug, Clone, Copy)]
pub struct Shard<'c> {
    /// Number of lumels of each instance, [`atlas::Lumels::count`].
    pub counts: &'c [u32],
    /// Its number, from 0.
    pub number: u32,
    /// Number of shards.
    pub of: u32,
}

impl Shard<'_> {
    /// The shard's lumels, numbered over the whole layout.
    pub fn lumels(&self) -> Range<usize> {
        let all: u64 = self.counts.iter().map(|&c| u64::from(c)).sum();
        let cut = |i: u32| (all * u64::from(i) / u64::from(self.of.max(1))) as usize;
        cut(self.number)..cut(self.number + 1)
    }

    /// The shard's parts of tiles, which are ranges of instances.
    pub(crate) fn tiles(&self, tiles: &[Range<usize>]) -> Vec<TileOfShard> {
        let (lumels, mut base, mut out) = (self.lumels(), 0, Vec::new());
        for instances in tiles {
            let counts = &self.counts[instances.clone()];
            let n = counts.iter().map(|&c| c as usize).sum::<usize>();
            let own = lumels.start.max(base)..lumels.end.min(base + n);
            if own.start < own.end {
                out.push(TileOfShard {
                    instances: instances.clone(),
                    own: own.start - base..own.end - base,
                    base,
                });
            }
            base += n;
        }
        out
    }
}

/// The part of a tile that a shard gathers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TileOfShard {
    /// The tile's instances.
    pub instances: Range<usize>,
    /// The shard's lumels in the tile, from 0.
    pub own: Range<usize>,
    /// Number of the tile's first lumel over the whole layout.
    pub base: usize,
}

/// What a process gathers.
enum Role<'r> {
    /// Everything.
    Whole,
    /// A shard's part of a tile.
    Shard {
        tile: TileOfShard,
        records: &'r dyn Records,
    },
    /// Everything that no shard has gathered, in a map whose first lumel is number `base` of the
    /// layout.
    Rest {
        base: usize,
        records: &'r dyn Records,
    },
}

/// The share of the gathering that one process does.
pub(crate) struct Work<'r> {
    pub monitor: &'r dyn Monitor,
    role: Role<'r>,
    /// Rounds of [`Pass::Edges`].
    follow: u32,
    /// Instances for which shards could not know the outcome of earlier passes; empty if there are
    /// none.
    stale: Vec<bool>,
}

/// Lumels gathered at a time, to bound the memory for results.
const BATCH: usize = 1 << 16;

impl<'r> Work<'r> {
    pub(crate) fn whole(monitor: &'r dyn Monitor, follow: u32) -> Self {
        Work {
            monitor,
            role: Role::Whole,
            follow,
            stale: Vec::new(),
        }
    }

    /// The rest of a bake whose shards have put light into `records`, in a map that begins with
    /// lumel `base` of the layout.
    pub(crate) fn rest(self, records: &'r dyn Records, base: usize) -> Self {
        Work {
            role: Role::Rest { base, records },
            ..self
        }
    }

    /// A shard's part of a tile.
    pub(crate) fn shard(self, tile: TileOfShard, records: &'r dyn Records) -> Self {
        Work {
            role: Role::Shard { tile, records },
            ..self
        }
    }

    pub(crate) fn is_shard(&self) -> bool {
        matches!(self.role, Role::Shard { .. })
    }

    /// Declares records of passes after the first invalid for the instances of these lumels.
    pub(crate) fn distrust(&mut self, map: &LumelMap, lumels: &[usize]) {
        for &i in lumels {
            let instance = map.lumel(i).instance as usize;
            if self.stale.len() <= instance {
                self.stale.resize(instance + 1, false);
            }
            self.stale[instance] = true;
        }
    }

    /// Gathers at `items` (lumels in ascending order, with further data for `one`) and stores the
    /// light in the map. `one` sees some of that light and must not depend on it.
    ///
    /// # Errors
    /// [`Cancelled`] if the monitor asks for it.
    pub(crate) fn gather<T: Copy + Sync>(
        &self,
        map: &mut LumelMap,
        pass: Pass,
        items: &[(usize, T)],
        one: impl Fn(&LumelMap, usize, T) -> Received + Sync,
    ) -> Result<(), Cancelled> {
        let left;
        let items = match &self.role {
            Role::Whole => items,
            Role::Shard { tile, .. } => {
                let known = known(map, &tile.own, pass.depth(self.follow));
                let start = items.partition_point(|item| item.0 < known.start);
                let end = items.partition_point(|item| item.0 < known.end);
                &items[start..end.max(start)]
            }
            Role::Rest { base, records } => {
                left = self.take(map, pass, items, (*base, *records));
                &left
            }
        };
        let (mut before, runs) = (0, items.len().div_ceil(IN_RUN));
        let batches = items.len().div_ceil(BATCH);
        for b in 0..batches {
            // Each batch takes runs from everywhere, so that its pace tells that of the rest.
            let batch: Vec<(usize, T)> = (b..runs)
                .step_by(batches)
                .flat_map(|run| &items[run * IN_RUN..items.len().min((run + 1) * IN_RUN)])
                .copied()
                .collect();
            let (phase, seen, done) = (pass.phase(), &*map, (before, items.len()));
            let light = part_in_blocks(batch.len(), done, phase, self.monitor, |k| {
                let (i, what) = batch[k];
                one(seen, i, what)
            })?;
            before += batch.len();
            if let Role::Shard { tile, records } = &self.role {
                let number = |i: usize| (tile.base + i) as u32;
                let lumels: Vec<u32> = batch.iter().map(|item| number(item.0)).collect();
                records.put(pass, &lumels, &light);
            }
            for (item, light) in batch.iter().zip(light) {
                map.received[item.0] = light;
            }
        }
        Ok(())
    }

    /// Takes the light that shards have recorded for these items; returns the other items.
    fn take<T: Copy>(
        &self,
        map: &mut LumelMap,
        pass: Pass,
        items: &[(usize, T)],
        (base, records): (usize, &dyn Records),
    ) -> Vec<(usize, T)> {
        let mut there = vec![false; items.len()];
        // Both are in ascending order.
        let mut at = 0;
        let own = base as u32..(base + map.len()) as u32;
        records.take(pass, own.clone(), &mut |lumel, light| {
            if !own.contains(&lumel) {
                return;
            }
            let lumel = lumel as usize - base;
            if at > 0 && items.get(at - 1).is_some_and(|item| item.0 > lumel) {
                at = 0;
            }
            at += items[at..].partition_point(|item| item.0 < lumel);
            if items.get(at).is_none_or(|item| item.0 != lumel) {
                return;
            }
            let instance = map.lumel(lumel).instance as usize;
            let stale = pass > Pass::Cells && self.stale.get(instance) == Some(&true);
            if !stale {
                map.received[lumel] = light;
                there[at] = true;
            }
        });
        (items.iter().zip(there))
            .filter(|(_, there)| !there)
            .map(|(item, _)| *item)
            .collect()
    }
}

/// The lumels of the range `own` that have no lumel of their instance outside it within `depth`
/// rows.
fn known(map: &LumelMap, own: &Range<usize>, depth: u32) -> Range<usize> {
    let lumels = &map.lumels.lumels;
    let row = |i: usize| (lumels[i].instance, lumels[i].texel[1]);
    let Range { mut start, mut end } = own.clone();
    if depth == 0 || start >= end {
        return own.clone();
    }
    if start > 0 {
        let (instance, y) = row(start - 1);
        let is_near = |i: usize| row(i) <= (instance, y + depth);
        start += (start..end).take_while(|&i| is_near(i)).count();
    }
    if end < lumels.len() {
        let (instance, y) = row(end);
        let is_near = |i: usize| row(i).0 == instance && row(i).1 + depth >= y;
        end -= (start..end).rev().take_while(|&i| is_near(i)).count();
    }
    start..end.max(start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_divide_all_lumels_among_them() {
        let counts = [10, 0, 7, 33];
        for of in [1, 3, 8, 60] {
            let shard = |number| Shard {
                counts: &counts,
                number,
                of,
            };
            let mut next = 0;
            for number in 0..of {
                let lumels = shard(number).lumels();
                assert_eq!(lumels.start, next);
                next = lumels.end;
                // Instances 0 to 2 are a tile, 3 another.
                let parts = shard(number).tiles(&[0..3, 3..4]);
                let whole = parts.iter().flat_map(|part| {
                    assert_eq!(part.base, if part.instances.start == 0 { 0 } else { 17 });
                    part.own.clone().map(|i| i + part.base)
                });
                assert!(whole.eq(lumels));
            }
            assert_eq!(next, 50);
        }
    }
}
