//! Finds flat pieces of surface with nothing above them.

use atlas::{Lumels, TexelIndex};
use radiosity::{SurfacePoint, World};
use rayon::prelude::*;

/// Nothing may rise above the surface within this many lumels of an interpolated one. Light from an
/// object at distance R varies over distances of R, and the window of the quadratic fit extends
/// seven lumels at most.
pub(crate) const CLEAR: f32 = 4.0;

/// Least cosine between normals of neighbours on a flat piece: 1.8°.
const FLAT: f32 = 0.9995;

/// A lumel with less coverage may consist of pieces that are not adjacent on the surface.
const WHOLE: f32 = 0.999;

/// Lumels along the side of a cell.
pub(crate) const CELL: usize = 8;

/// Lumels from one sample of a cell to the next. Even, because lumels in odd rows or columns are
/// interpolated.
pub(crate) const STEP: usize = CELL / 2;

/// Whether lumel `j` is whole, and in the plane of `i`, so many steps from it.
pub(crate) fn is_flat(
    lumels: &Lumels,
    places: &[(SurfacePoint, f32)],
    (i, j): (usize, usize),
    steps: f32,
) -> bool {
    let (own, size) = &places[i];
    let place = &places[j].0;
    let way = place.position - own.position;
    lumels.lumels[j].coverage >= WHOLE
        && place.geometric.dot(own.geometric) >= FLAT
        && place.normal.dot(own.normal) >= FLAT
        && way.dot(own.geometric).abs() <= 0.02 * size
        && way.length() <= 1.2 * steps * size
}

/// Whether the lumel at this texel is a sample of its cell.
pub(crate) fn is_sample(texel: [u32; 2]) -> bool {
    texel.iter().all(|&x| (x as usize).is_multiple_of(STEP))
}

/// Flags the lumels of clear cells. `places` are points and sizes of all lumels.
pub(crate) fn clear_cells(
    world: &World,
    lumels: &Lumels,
    (index, places): (&TexelIndex, &[(SurfacePoint, f32)]),
) -> Vec<bool> {
    let clear: Vec<Vec<usize>> = (0..lumels.lumels.len())
        .into_par_iter()
        .with_min_len(1024)
        .filter(|&i| {
            lumels.lumels[i]
                .texel
                .iter()
                .all(|&x| (x as usize).is_multiple_of(CELL))
        })
        .filter_map(|i| clear_cell(world, lumels, (index, places), i))
        .collect();
    let mut out = vec![false; lumels.lumels.len()];
    clear.into_iter().flatten().for_each(|i| out[i] = true);
    out
}

/// The lumels of the cell with the first corner `i`, if all of them exist, lie in a plane, and have
/// nothing above them.
fn clear_cell(
    world: &World,
    lumels: &Lumels,
    (index, places): (&TexelIndex, &[(SurfacePoint, f32)]),
    i: usize,
) -> Option<Vec<usize>> {
    let l = &lumels.lumels[i];
    let [x, y] = l.texel.map(i64::from);
    let at = |dx: usize, dy: usize| index.at(l.page, x + dx as i64, y + dy as i64);
    let middle = at(STEP, STEP)?;
    let mut own = Vec::with_capacity(CELL * CELL);
    for [dx, dy] in (0..=CELL).flat_map(|dy| (0..=CELL).map(move |dx| [dx, dy])) {
        let j = at(dx, dy)?;
        let [ax, ay] = [dx, dy].map(|d| d.abs_diff(STEP) as f32);
        let same = lumels.lumels[j].instance == l.instance;
        if !same || !is_flat(lumels, places, (middle, j), (ax * ax + ay * ay).sqrt()) {
            return None;
        }
        if dx < CELL && dy < CELL {
            own.push(j);
        }
    }
    let (point, size) = &places[middle];
    let reach = CELL as f32 * 0.5f32.sqrt() + CLEAR;
    (!world.anything_above(point, reach * size)).then_some(own)
}
