//! Exact visibility from a point: the part of a polygon that occluders leave visible.

use glam::DVec3;

use super::contour::clip_front;
use super::point::form_factor_polygon;
use crate::Patch;

/// From a differential area at `x` to the part of `target` that `occluders` leave visible, in
/// closed form: the target is clipped by the outline of each occluder as seen from `x`, and
/// Lambert's contour sum is evaluated for the rest. No rays, no noise.
///
/// Occluders block from both sides and need not be disjoint. One in a plane through `x`, or
/// completely on the far side of the target's plane, hides nothing. Exact to rounding; time is
/// proportional to the number of pieces.
///
/// Nishita and Nakamae, *Half-tone representation of 3-D objects illuminated by area sources or
/// polyhedron sources*, 1983.
pub fn form_factor_visible_polygon(
    x: DVec3,
    n_x: DVec3,
    target: &[DVec3],
    occluders: &[&Patch],
) -> f64 {
    let whole = form_factor_polygon(x, n_x, target);
    if whole == 0.0 || occluders.is_empty() {
        return whole;
    }
    let mut pieces = vec![clip_front(target, x, n_x)];
    for occluder in occluders {
        let cuts = cone(x, &occluder.corners);
        let Some((edges, plane)) = cuts else {
            continue;
        };
        let mut left = Vec::with_capacity(pieces.len() + 2);
        for piece in pieces {
            subtract(x, piece, &edges, plane, occluder.corners[0], &mut left);
        }
        pieces = left;
        if pieces.is_empty() {
            return 0.0;
        }
    }
    pieces
        .iter()
        .filter(|p| p.len() >= 3)
        .map(|p| {
            // Clipping may leave more corners than the closed form supports.
            if p.len() <= 8 {
                form_factor_polygon(x, n_x, p)
            } else {
                (1..p.len() - 1)
                    .map(|k| form_factor_polygon(x, n_x, &[p[0], p[k], p[k + 1]]))
                    .sum()
            }
        })
        .sum()
}

/// Planes through `x` and each edge of the polygon, facing inwards, and the polygon's own plane
/// facing away from `x`. `None` if `x` is in that plane.
fn cone(x: DVec3, corners: &[DVec3]) -> Option<(Vec<DVec3>, DVec3)> {
    let n = corners.len();
    let normal = (1..n - 1)
        .map(|k| (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]))
        .sum::<DVec3>()
        .try_normalize()?;
    let d = corners[0] - x;
    let height = normal.dot(d);
    let size = corners
        .iter()
        .map(|c| (*c - x).length())
        .fold(0.0, f64::max);
    if height.abs() <= 1e-13 * size {
        return None;
    }
    let side = height.signum();
    let edges = (0..n)
        .filter_map(|k| {
            let (a, b) = (corners[k] - x, corners[(k + 1) % n] - x);
            (a.cross(b) * side).try_normalize()
        })
        .collect();
    Some((edges, normal * side))
}

/// Pushes the part of `piece` outside the cone, or inside it and on `x`'s side of the occluder.
fn subtract(
    x: DVec3,
    piece: Vec<DVec3>,
    edges: &[DVec3],
    plane: DVec3,
    on_plane: DVec3,
    out: &mut Vec<Vec<DVec3>>,
) {
    // Whole pieces first: most occluders miss most pieces, and uncut pieces keep few corners.
    let inside_all = {
        let mut rest = piece.clone();
        for e in edges {
            rest = clip_front(&rest, x, *e);
            if rest.len() < 3 {
                break;
            }
        }
        if rest.len() >= 3 {
            rest = clip_front(&rest, on_plane, plane);
        }
        rest
    };
    if inside_all.len() < 3 {
        out.push(piece);
        return;
    }
    let mut rest = piece;
    for e in edges {
        let outside = clip_front(&rest, x, -*e);
        if outside.len() >= 3 {
            out.push(outside);
        }
        rest = clip_front(&rest, x, *e);
        if rest.len() < 3 {
            return;
        }
    }
    let nearer = clip_front(&rest, on_plane, -plane);
    if nearer.len() >= 3 {
        out.push(nearer);
    }
}
