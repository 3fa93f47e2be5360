//! Closes slits in charts that are narrower than about a lumel.
//!
//! Joined charts, and charts that an unwrapper opened slightly, have edges that coincide in space
//! but are a fraction of a lumel apart on the page. Lookups on the two sides then read the same
//! texels at different positions and differ by slope times distance, a seam that cannot be
//! stitched. Instead, each side is moved by half the distance, which stretches the adjacent
//! triangles by no more than that.

use std::collections::BTreeMap;

use glam::DVec2;

use super::charts::{Charts, cross2};
use super::input::UnwrapInput;

/// Positions of one vertex in one chart that are closer than this, lumels, become one. Each moves
/// by half the distance. Joining leaves no wider slits except short ones.
const WELD_DISTANCE: f64 = 1.0;

/// Positions closer than this, lumels, differ by rounding only; moving them would take charts off
/// their grid alignment.
const APART: f64 = 1e-4;

/// Least and largest area of an adjacent triangle, relative to its original area. Only triangles of
/// about one lumel reach these limits.
const AREA: [f64; 2] = [0.4, 2.5];

/// Triangles of at most this area, lumels², before and after, may grow without limit and shrink to
/// [`SHRUNK`], because they show no light of their own.
const TINY: f64 = 0.5;

/// Least remaining area of tiny triangles, relative to the original, so that readers can still
/// invert the mapping.
const SHRUNK: f64 = 0.1;

/// How far a flat triangle may be inverted, lumels of height: rounding, which packing repairs.
const FLAT: f64 = 1e-4;

/// Welds the corners of `charts` of `mesh`; a lumel is `lumel` metres wide.
pub(super) fn weld_slits(mesh: &UnwrapInput, charts: &mut Charts, lumel: f64) {
    if !(lumel > 0.0 && lumel.is_finite()) {
        return;
    }
    // Corners of one vertex in one chart, in the order of the triangles.
    let mut corners: Vec<(u32, u32, u32)> = Vec::with_capacity(charts.corners.len() * 3);
    for (t, (triangle, &chart)) in mesh.triangles.iter().zip(&charts.chart).enumerate() {
        for (k, &vertex) in triangle.iter().enumerate() {
            corners.push((chart, vertex, (3 * t + k) as u32));
        }
    }
    corners.sort_unstable();
    for group in corners.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        for places in clusters(charts, group, lumel) {
            weld(charts, &places, lumel);
        }
    }
}

fn place(charts: &Charts, corner: u32) -> DVec2 {
    charts.corners[corner as usize / 3][corner as usize % 3]
}

/// Sets of corners that are close to each other, but not at the same position. Few corners share a
/// vertex, so each is compared with the first of each set.
fn clusters(charts: &Charts, group: &[(u32, u32, u32)], lumel: f64) -> Vec<Vec<u32>> {
    // A fan of thousands has its vertex at few positions.
    let mut distinct: BTreeMap<[u64; 2], Vec<u32>> = BTreeMap::new();
    for &(_, _, corner) in group {
        let p = place(charts, corner);
        let key = [p.x.to_bits(), p.y.to_bits()];
        distinct.entry(key).or_default().push(corner);
    }
    if distinct.len() < 2 || distinct.len() > MOST_PLACES {
        return Vec::new();
    }
    let mut sets: Vec<Vec<u32>> = Vec::new();
    // By first corner, not by position, so that the result does not depend on where the chart is.
    let mut places: Vec<Vec<u32>> = distinct.into_values().collect();
    places.sort();
    for list in places {
        let p = place(charts, list[0]);
        let near = sets
            .iter_mut()
            .find(|set| p.distance(place(charts, set[0])) < WELD_DISTANCE * lumel);
        match near {
            Some(set) => set.extend(list),
            None => sets.push(list),
        }
    }
    sets.retain(|set| {
        let first = place(charts, set[0]);
        set.iter()
            .any(|&c| place(charts, c).distance(first) > APART * lumel)
    });
    sets
}

/// A vertex with more positions than this in one chart is not a slit.
const MOST_PLACES: usize = 16;

/// Moves these corners to their centre, unless that folds or stretches a triangle too much.
fn weld(charts: &mut Charts, corners: &[u32], lumel: f64) {
    let middle = corners.iter().map(|&c| place(charts, c)).sum::<DVec2>() / corners.len() as f64;
    let fits = corners.iter().all(|&c| {
        let triangle = &charts.corners[c as usize / 3];
        let mut moved = *triangle;
        moved[c as usize % 3] = middle;
        let [before, after] = [cross2(triangle), cross2(&moved)];
        // Collapsed triangles have no lumels, but must not fold over others.
        if before <= 0.0 {
            let side = |k: usize| moved[k].distance(moved[(k + 1) % 3]);
            return after >= -FLAT * lumel * side(0).max(side(1)).max(side(2));
        }
        if after >= SHRUNK * before && before.max(after) < 2.0 * TINY * lumel * lumel {
            return true;
        }
        (AREA[0]..=AREA[1]).contains(&(after / before))
    });
    if !fits {
        return;
    }
    for &c in corners {
        charts.corners[c as usize / 3][c as usize % 3] = middle;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Two triangles of a unit square, separated by `gap` along their diagonal.
    fn opened(gap: f64) -> (UnwrapInput, Charts) {
        let mesh = UnwrapInput {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..UnwrapInput::default()
        };
        let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(DVec2::from);
        let off = DVec2::new(-gap, gap) * 0.5f64.sqrt();
        let charts = Charts {
            corners: vec![[a, b, c], [a, c, d].map(|p| p + off)],
            chart: vec![0, 0],
            count: 1,
        };
        (mesh, charts)
    }

    #[test]
    fn narrow_slits_close_and_wide_ones_stay() {
        for (gap, closed) in [(1e-6, false), (0.02, true), (0.09, true), (0.11, false)] {
            let (mesh, mut charts) = opened(gap);
            let before = charts.corners.clone();
            weld_slits(&mesh, &mut charts, 0.1);
            let [first, second] = [charts.corners[0], charts.corners[1]];
            assert_eq!(
                first[0] == second[0] && first[2] == second[1],
                closed,
                "{gap}"
            );
            assert_eq!(charts.corners == before, !closed, "{gap}");
        }
    }

    #[test]
    fn other_charts_are_none_of_its_business() {
        let (mesh, mut charts) = opened(0.02);
        charts.chart = vec![0, 1];
        charts.count = 2;
        let before = charts.corners.clone();
        weld_slits(&mesh, &mut charts, 0.1);
        assert_eq!(charts.corners, before);
    }

    #[test]
    fn slivers_grow_to_half_a_lumel_at_most() {
        // A triangle with a height of 1.4 mm and a base of 1.4 m; a lumel is 10 cm. The base moves
        // by half of the slit.
        for (gap, grows) in [(0.01, true), (0.09, false)] {
            let (mesh, mut charts) = opened(gap);
            let middle = charts.corners[1][0].lerp(charts.corners[1][1], 0.5);
            charts.corners[1][2] = middle + DVec2::new(-1e-3, 1e-3);
            let before = charts.corners.clone();
            weld_slits(&mesh, &mut charts, 0.1);
            assert_eq!(charts.corners != before, grows, "{gap}");
        }
    }

    #[test]
    fn nothing_folds() {
        // The midpoint towards the other triangle's corner is beyond this one's far side.
        let (mesh, mut charts) = opened(0.0);
        charts.corners[1] = [(-0.05, 0.0), (-0.03, -0.01), (-0.03, 0.01)].map(DVec2::from);
        let before = charts.corners.clone();
        assert!(cross2(&before[1]) > 0.0);
        weld_slits(&mesh, &mut charts, 0.1);
        assert_eq!(charts.corners, before);
    }

    #[test]
    fn what_is_smaller_than_half_a_lumel_may_change_more() {
        // Both triangles cover a third of a lumel, and the slit between them is a fifth of their
        // side.
        let (mesh, mut charts) = opened(0.2);
        weld_slits(&mesh, &mut charts, 1.3);
        assert_eq!(charts.corners[0][0], charts.corners[1][0]);
        assert_eq!(charts.corners[0][2], charts.corners[1][1]);
    }
}
