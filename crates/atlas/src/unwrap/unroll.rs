//! The default: groups of faces within a cone, each flattened as rigidly as possible.

use glam::{DVec2, Vec2};
use rayon::prelude::*;

use super::charts::{Charts, cross2};
use super::finish::finish;
use super::input::{NONE, UnwrapInput};
use super::rigid::{Group, true_to_area};
use super::segment::segment;
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};
use crate::overlap::Overlaps;

/// Up to this many triangles, overlaps are looked for pair by pair: at most eight million pairs.
const FEW: usize = 4096;

/// Share of a chart's length by which triangles may reach into each other: rounding.
const TOUCH: f64 = 1e-7;

/// Cells per triangle of the grid on which overlaps of more triangles are looked for, and the most
/// along a side.
const CELLS: f64 = 256.0;
const SIDE: f64 = 2048.0;

/// A half with less than this share of a group's faces is too small: halving would take too long.
const SMALL_HALF: usize = 8;

/// Groups of faces within a cone, flattened as rigidly as possible; what would be distorted or
/// cover itself is halved.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unroll;

impl Unwrapper for Unroll {
    fn name(&self) -> &'static str {
        "unroll"
    }

    fn unwrap(
        &self,
        mesh: &UnwrapInput,
        options: &UnwrapOptions,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError> {
        let lumel = 1.0 / f64::from(options.texels_per_unit);
        let groups = segment(mesh, lumel).into_iter().map(|faces| (faces, None));
        let charts = charts_of(mesh, groups.collect(), lumel, cancel)?;
        finish(mesh, charts, options, cancel)
    }
}

/// Faces of one group and, if someone has flattened them, their corners in any unit.
pub(super) type Proposal = (Vec<u32>, Option<Vec<[DVec2; 3]>>);

/// A group that is flat.
struct Piece {
    faces: Vec<u32>,
    corners: Vec<[DVec2; 3]>,
}

/// Charts of connected groups, which hold all triangles of `mesh`; corners that someone proposes
/// are taken if none is turned over or covers another. `lumel` is in metres.
pub(super) fn charts_of(
    mesh: &UnwrapInput,
    groups: Vec<Proposal>,
    lumel: f64,
    cancel: Cancel<'_>,
) -> Result<Charts, UnwrapError> {
    let pieces: Vec<Vec<Piece>> = groups
        .into_par_iter()
        .map(|(faces, flat)| pieces(mesh, faces, flat, lumel, cancel))
        .collect();
    if cancel() {
        return Err(UnwrapError::Cancelled);
    }
    let count = mesh.triangles.len();
    let mut charts = Charts {
        corners: vec![[DVec2::ZERO; 3]; count],
        chart: vec![NONE; count],
        count: 0,
    };
    for (number, piece) in pieces.into_iter().flatten().enumerate() {
        for (&t, corners) in piece.faces.iter().zip(piece.corners) {
            charts.corners[t as usize] = corners;
            charts.chart[t as usize] = number as u32;
        }
    }
    // Triangles without area that have no neighbour with one: a point of the first chart.
    let Some(first) = charts.chart.iter().position(|&c| c != NONE) else {
        return Err(UnwrapError::Failed(
            "no triangle is thick enough for a chart".into(),
        ));
    };
    let (chart, at) = (charts.chart[first], charts.corners[first][0]);
    for (corners, own) in charts.corners.iter_mut().zip(&mut charts.chart) {
        if *own == NONE {
            (*corners, *own) = ([at; 3], chart);
        }
    }
    if charts.corners.iter().flatten().any(|p| !p.is_finite()) {
        return Err(UnwrapError::Failed("a coordinate is not finite".into()));
    }
    charts.renumber();
    Ok(charts)
}

/// The group, or what it has to be cut into, flat. Nothing for faces without area.
fn pieces(
    mesh: &UnwrapInput,
    faces: Vec<u32>,
    flat: Option<Vec<[DVec2; 3]>>,
    lumel: f64,
    cancel: Cancel<'_>,
) -> Vec<Piece> {
    if let Some(corners) = flat
        && let Some(corners) = accepted(mesh, &faces, corners, lumel)
    {
        return vec![Piece { faces, corners }];
    }
    let mut done = Vec::new();
    let mut left = vec![faces];
    while let Some(faces) = left.pop() {
        let group = Group::new(mesh, &faces);
        if group.area() == 0.0 || cancel() {
            continue;
        }
        let corners = group.flatten();
        let overlap = corners.as_ref().and_then(|c| find_overlap(c, lumel));
        match corners {
            Some(corners) if overlap.is_none() => done.push(Piece { faces, corners }),
            _ => left.extend(halves(mesh, &faces, overlap)),
        }
    }
    done
}

/// Corners that someone else made, true to area and not mirrored, unless they are unusable.
fn accepted(
    mesh: &UnwrapInput,
    faces: &[u32],
    mut corners: Vec<[DVec2; 3]>,
    lumel: f64,
) -> Option<Vec<[DVec2; 3]>> {
    if corners.iter().map(cross2).sum::<f64>() < 0.0 {
        corners.iter_mut().flatten().for_each(|p| p.x = -p.x);
    }
    let corners = true_to_area(corners, Group::new(mesh, faces).area());
    let upright = corners.iter().all(|c| cross2(c) > 0.0);
    (upright && find_overlap(&corners, lumel).is_none()).then_some(corners)
}

/// Two of the triangles, by number, that cover each other. Few are compared pair by pair, many on a
/// grid, with cells of at most a `lumel` where that is possible.
pub(super) fn find_overlap(flat: &[[DVec2; 3]], lumel: f64) -> Option<[usize; 2]> {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for &p in flat.iter().flatten() {
        low = low.min(p);
        high = high.max(p);
    }
    let size = high - low;
    let side = size.max_element();
    if side == 0.0 {
        None
    } else if flat.len() <= FEW {
        overlapping_pair(flat, usize::from(size.y > size.x), side * TOUCH)
    } else {
        let cells = (flat.len() as f64 * CELLS).sqrt().max(side / lumel);
        overlap_on_grid(flat, low, size, cells.min(SIDE) / side)
    }
}

/// The first pair of triangles that reach more than `touch` into each other. They are compared in
/// order of their places along `axis`.
fn overlapping_pair(flat: &[[DVec2; 3]], axis: usize, touch: f64) -> Option<[usize; 2]> {
    let range = |c: &[DVec2; 3], axis: usize| {
        let [a, b, c] = c.map(|p| p[axis]);
        (a.min(b).min(c), a.max(b).max(c))
    };
    let mut order: Vec<usize> = (0..flat.len()).collect();
    let start = |&i: &usize| range(&flat[i], axis).0;
    order.sort_by(|a, b| start(a).total_cmp(&start(b)).then(a.cmp(b)));
    for (n, &i) in order.iter().enumerate() {
        let end = range(&flat[i], axis).1;
        let (low, high) = range(&flat[i], 1 - axis);
        for &j in order[n + 1..].iter().take_while(|j| start(j) < end) {
            let (other_low, other_high) = range(&flat[j], 1 - axis);
            if other_low < high && low < other_high && overlap(&flat[i], &flat[j], touch) {
                return Some([i.min(j), i.max(j)]);
            }
        }
    }
    None
}

/// Whether two counter-clockwise triangles reach more than `touch` into each other: no side of one
/// keeps the other off.
fn overlap(a: &[DVec2; 3], b: &[DVec2; 3], touch: f64) -> bool {
    let apart = |a: &[DVec2; 3], b: &[DVec2; 3]| {
        (0..3).any(|k| {
            let side = (a[(k + 1) % 3] - a[k]).normalize_or_zero();
            b.iter().all(|&p| side.perp_dot(p - a[k]) <= touch)
        })
    };
    !apart(a, b) && !apart(b, a)
}

fn overlap_on_grid(
    flat: &[[DVec2; 3]],
    low: DVec2,
    size: DVec2,
    cells_per_metre: f64,
) -> Option<[usize; 2]> {
    let corners: Vec<[Vec2; 3]> = flat
        .iter()
        .map(|c| c.map(|p| ((p - low) * cells_per_metre).as_vec2()))
        .collect();
    let size = (size * cells_per_metre).ceil().max(DVec2::ONE).as_uvec2();
    let found = Overlaps::find(&corners, size.to_array()).first;
    let later = found.iter().position(|&(_, earlier)| earlier != NONE)?;
    Some([found[later].1 as usize, later])
}

/// Two halves of a group: what is nearer to one of two faces, counted in faces. These are the two
/// in `apart`, by number, or two that lie far apart.
fn halves(mesh: &UnwrapInput, faces: &[u32], apart: Option<[usize; 2]>) -> [Vec<u32>; 2] {
    let one = apart.map(|[a, b]| nearer(mesh, faces, a, b));
    let balanced = |halves: &[Vec<u32>; 2]| {
        let smaller = halves[0].len().min(halves[1].len());
        smaller * SMALL_HALF >= faces.len()
    };
    one.filter(balanced)
        .or_else(|| {
            let (_, order) = steps(mesh, faces, 0);
            let one = order[order.len() - 1];
            let (_, order) = steps(mesh, faces, one);
            Some(nearer(mesh, faces, one, order[order.len() - 1]))
        })
        .filter(balanced)
        .unwrap_or_else(|| {
            let (left, right) = faces.split_at(faces.len() / 2);
            [left.to_vec(), right.to_vec()]
        })
}

/// The faces nearer to face number `a` than to `b`, and the others.
fn nearer(mesh: &UnwrapInput, faces: &[u32], a: usize, b: usize) -> [Vec<u32>; 2] {
    let [(near, _), (far, _)] = [a, b].map(|start| steps(mesh, faces, start));
    let mut halves = [Vec::new(), Vec::new()];
    for (i, &t) in faces.iter().enumerate() {
        halves[usize::from(near[i] > far[i])].push(t);
    }
    halves
}

/// How many edges lie between face number `start` and each other one of the group, which is
/// sorted; and the faces' numbers in that order.
fn steps(mesh: &UnwrapInput, faces: &[u32], start: usize) -> (Vec<u32>, Vec<usize>) {
    let mut steps = vec![u32::MAX; faces.len()];
    steps[start] = 0;
    let mut order = vec![start];
    let mut next = 0;
    while let Some(&i) = order.get(next) {
        next += 1;
        let t = faces[i] as usize;
        for k in 0..3 {
            let u = mesh.neighbors[t][k];
            if u == NONE || mesh.seams[t][k] {
                continue;
            }
            if let Ok(j) = faces.binary_search(&u)
                && steps[j] == u32::MAX
            {
                steps[j] = steps[i] + 1;
                order.push(j);
            }
        }
    }
    (steps, order)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64) -> [[DVec2; 3]; 2] {
        let at = |u: f64, v: f64| DVec2::new(x + u, y + v);
        [
            [at(0., 0.), at(1., 0.), at(1., 1.)],
            [at(0., 0.), at(1., 1.), at(0., 1.)],
        ]
    }

    #[test]
    fn what_touches_does_not_overlap_and_what_reaches_into_another_does() {
        let row: Vec<_> = (0..40).flat_map(|i| square(f64::from(i), 0.0)).collect();
        assert_eq!(find_overlap(&row, 1.0), None);
        // A strip a hundredth as wide as a lumel.
        let fold = [row.clone(), square(17.0, 0.99).to_vec()].concat();
        let pair = find_overlap(&fold, 1.0);
        assert!(matches!(pair, Some([34 | 35, 80])), "{pair:?}");
        let beside = [row, square(17.0, 1.0).to_vec()].concat();
        assert_eq!(find_overlap(&beside, 1.0), None);
    }

    #[test]
    fn many_triangles_are_compared_on_a_grid() {
        let at = |i: u32| [f64::from(i % 64), f64::from(i / 64)];
        let sheet: Vec<_> = (0..4096).flat_map(|i| square(at(i)[0], at(i)[1])).collect();
        assert!(sheet.len() > FEW);
        assert_eq!(find_overlap(&sheet, 1.0), None);
        let twice = [sheet, square(30.2, 30.2).to_vec()].concat();
        let [earlier, later] = find_overlap(&twice, 1.0).expect("the last square lies on four");
        assert!(earlier < 8192 && later >= 8192);
    }

    #[test]
    fn halves_are_connected_and_part_two_faces() {
        // A strip of 40 triangles, each next to the one before; those of odd places come last.
        let face = |place: i64| {
            let at = place / 2 + 20 * (place % 2);
            if (0..40).contains(&place) {
                at as u32
            } else {
                NONE
            }
        };
        let mut mesh = UnwrapInput {
            triangles: vec![[0, 1, 2]; 40],
            neighbors: vec![[NONE; 3]; 40],
            seams: vec![[false; 3]; 40],
            ..UnwrapInput::default()
        };
        for place in 0..40 {
            mesh.neighbors[face(place) as usize] = [face(place - 1), face(place + 1), NONE];
        }
        let part = |places: std::ops::Range<i64>| {
            let mut faces: Vec<u32> = places.map(face).collect();
            faces.sort_unstable();
            faces
        };
        let all = part(0..40);
        let number = |places: [i64; 2]| places.map(|p| face(p) as usize);
        let [left, right] = halves(&mesh, &all, Some(number([10, 21])));
        assert_eq!((left, right), (part(0..16), part(16..40)));
        // Between neighbours at the end one half would be a single face.
        let [left, right] = halves(&mesh, &all, Some(number([0, 1])));
        assert!(
            [&left, &right].contains(&&part(0..20)),
            "{left:?} {right:?}"
        );
    }
}
