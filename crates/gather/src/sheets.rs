//! Double-sided sheets take the light of the visible side.
//!
//! A face has one place in the lightmap for both of its sides. Usually, that place holds the light
//! on the front. If a panel is right in front of another one, or a wall was modelled inside out,
//! nobody sees the front, and the visible back would be drawn black.

use radiosity::{Cancelled, Monitor, Phase};

use crate::blocks::in_blocks;
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::received::Received;

/// Number of lumels that test whether the back of a sheet is visible.
const PROBES: usize = 16;

/// The lumels of a region.
struct Sheet {
    region: usize,
    lumels: Vec<usize>,
}

/// Fraction of a front that must be unseen. Not all, because a few lumels at the rims see past
/// what covers the others. A floor that is half under carpets is seen from its front.
const UNSEEN: f32 = 0.95;

/// Regathers sheets on their backs if their front is unseen and most of their back is not.
/// Must run after the gathered lumels of `map` have their light. Returns the turned ones.
///
/// # Errors
/// [`Cancelled`] if the monitor cancels.
pub(crate) fn turn_unseen(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    monitor: &dyn Monitor,
) -> Result<Vec<usize>, Cancelled> {
    let sheets = mostly_unseen(gatherer, map);
    if sheets.is_empty() {
        return Ok(Vec::new());
    }
    let world = gatherer.world();
    sheets.iter().for_each(|sheet| turn(gatherer, map, sheet));
    let gather = |map: &LumelMap, which: &[usize]| {
        in_blocks(which.len(), Phase::Gather, monitor, |k| {
            let (footprint, seed) = map.footprint(world, which[k]);
            gatherer.gather(&footprint, seed)
        })
    };
    let probes: Vec<Vec<usize>> = sheets.iter().map(Sheet::probes).collect();
    let mut found = gather(map, &probes.concat())?.into_iter();
    let mut again = Vec::new();
    for (sheet, probes) in sheets.into_iter().zip(probes) {
        let of_back: Vec<Received> = found.by_ref().take(probes.len()).collect();
        if share(of_back.iter().map(|r| (r.is_unseen(), 1.0))) > 0.5 {
            // Restores the front.
            turn(gatherer, map, &sheet);
        } else {
            again.extend(sheet.lumels);
        }
    }
    let light = gather(map, &again)?;
    for (&i, r) in again.iter().zip(light) {
        map.plan.drop(i);
        map.received[i] = r;
    }
    Ok(again)
}

impl Sheet {
    /// Lumels spread evenly over it.
    fn probes(&self) -> Vec<usize> {
        let step = self.lumels.len().div_ceil(PROBES);
        self.lumels.iter().step_by(step).copied().collect()
    }
}

/// Double-sided regions whose front is unseen at [`UNSEEN`] of their gathered lumels, by area.
/// Lumels on duplicates, which have their own side, are excluded, and so are faces whose back such
/// a duplicate shows.
fn mostly_unseen(gatherer: &Gatherer, map: &LumelMap) -> Vec<Sheet> {
    let (world, cut) = (gatherer.world(), &gatherer.tracer.solution.cut);
    let backed = world.soup.backed();
    let region_of = |i: usize| {
        let first = map.lumels.fragments(map.lumel(i)).next()?;
        let own = first.face == first.triangle && !backed.contains(&first.triangle);
        (own && world.two_sided(first.triangle)).then(|| cut.region_of(first.triangle))?
    };
    let mut by_region: Vec<(usize, usize)> = (0..map.len())
        .filter_map(|i| Some((region_of(i)?, i)))
        .collect();
    by_region.sort_unstable();
    (by_region.chunk_by(|a, b| a.0 == b.0))
        .filter(|run| {
            let gathered = run.iter().filter(|(_, i)| !map.plan.is(*i));
            let unseen =
                |&(_, i): &(usize, usize)| (map.received[i].is_unseen(), map.lumel(i).coverage);
            share(gathered.map(unseen)) >= UNSEEN
        })
        .map(|run| Sheet {
            region: run[0].0,
            lumels: run.iter().map(|&(_, i)| i).collect(),
        })
        .collect()
}

/// Fraction of the weight that has the value `true`; 0 without any.
fn share(all: impl Iterator<Item = (bool, f32)>) -> f32 {
    let (mut so, mut sum) = (0.0, 0.0);
    for (yes, weight) in all {
        so += if yes { weight } else { 0.0 };
        sum += weight;
    }
    if sum > 0.0 { so / sum } else { 0.0 }
}

/// Turns the faces of a sheet over.
fn turn(gatherer: &Gatherer, map: &mut LumelMap, sheet: &Sheet) {
    let cut = &gatherer.tracer.solution.cut;
    let mut faces: Vec<u32> = (sheet.lumels.iter())
        .flat_map(|&i| map.lumels.fragments(map.lumel(i)))
        .filter(|f| f.face == f.triangle && cut.region_of(f.triangle) == Some(sheet.region))
        .map(|f| f.face)
        .collect();
    faces.sort_unstable();
    faces.dedup();
    map.lumels.turn(&faces);
}
