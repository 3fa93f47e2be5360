//! The common last steps of all unwrappers.

use glam::DVec2;

use super::charts::Charts;
use super::input::UnwrapInput;
use super::join::join_small;
use super::pack_charts::pack_charts;
use super::split::split_hollow;
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh};
use super::weld::weld_slits;
use crate::overlap::Overlaps;

/// Splits hollow charts, joins small ones, welds slits and packs all of them.
pub(super) fn finish(
    mesh: &UnwrapInput,
    mut charts: Charts,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
) -> Result<UnwrappedMesh, UnwrapError> {
    let lumel = 1.0 / f64::from(options.texels_per_unit);
    split_hollow(mesh, &mut charts, lumel);
    join_small(mesh, &mut charts, lumel);
    let apart = charts.corners.clone();
    weld_slits(mesh, &mut charts, lumel);
    if cancel() {
        return Err(UnwrapError::Cancelled);
    }
    let packed = pack_charts(&charts, options, cancel)?;
    // Welding can make charts overlap themselves. This shows only on the page; such charts are
    // reset.
    if undo_overlaps(&packed, &apart, &mut charts) {
        return pack_charts(&charts, options, cancel);
    }
    Ok(packed)
}

/// Resets charts with texels that two triangles cover to the corners `before`; returns whether
/// anything changed.
fn undo_overlaps(packed: &UnwrappedMesh, before: &[[DVec2; 3]], charts: &mut Charts) -> bool {
    let overlaps = Overlaps::find(&packed.corners, packed.size);
    if overlaps.twice == 0 {
        return false;
    }
    let mut overlapping = vec![false; charts.count as usize];
    for (t, n) in overlaps.by_triangle.iter().enumerate() {
        if *n > 0 {
            overlapping[charts.chart[t] as usize] = true;
        }
    }
    let mut changed = false;
    for ((now, was), chart) in charts.corners.iter_mut().zip(before).zip(&charts.chart) {
        if overlapping[*chart as usize] && now != was {
            *now = *was;
            changed = true;
        }
    }
    changed
}
