//! Finds common borders of two charts in space: along whole edges, or along parts of edges
//! (T-junctions).

use glam::{DVec2, DVec3};

use super::charts::Charts;
use super::input::{NONE, UnwrapInput};

/// Faces that meet along part of an edge are neighbours only up to this angle (degrees), i.e. on
/// the same wall with different tessellation.
const FLAT_DEGREES: f64 = 15.0;

/// Number of following edges on the same line that are searched for partners; lines shared by
/// thousands of edges are only partly searched.
const PARTNERS: usize = 32;

/// A stretch of border that two charts share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joint {
    /// The two charts, the lower number first.
    pub charts: [u32; 2],
    /// Both ends of the stretch in the coordinates of either chart, in the direction of the lower
    /// chart's triangle.
    pub ends: [[DVec2; 2]; 2],
    /// Length, metres.
    pub length: f64,
    /// Whether the edge is a hard edge, i.e. a chart border by [`UnwrapInput::seams`].
    pub hard: bool,
}

/// All joints between different charts, in an order that depends only on the mesh.
pub(super) fn joints(mesh: &UnwrapInput, charts: &Charts) -> Vec<Joint> {
    let normals = mesh.face_normals();
    let mut out = Vec::new();
    let mut border = Vec::new();
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let u = mesh.neighbors[t][k];
            if u == NONE {
                if normals[t] != DVec3::ZERO {
                    border.push((t as u32, k as u8));
                }
                continue;
            }
            let u = u as usize;
            let (a, b) = (charts.chart[t], charts.chart[u]);
            if a >= b {
                continue;
            }
            // The neighbour traverses the edge in the other direction.
            let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
            let other = |v: u32| mesh.triangles[u].iter().position(|&w| w == v);
            let (Some(i), Some(j)) = (other(from), other(to)) else {
                continue;
            };
            let [p, q] = [from, to].map(|v| mesh.positions[v as usize].as_dvec3());
            out.push(Joint {
                charts: [a, b],
                ends: [
                    [charts.corners[t][k], charts.corners[t][(k + 1) % 3]],
                    [charts.corners[u][i], charts.corners[u][j]],
                ],
                length: p.distance(q),
                hard: mesh.seams[t][k],
            });
        }
    }
    partial(mesh, charts, &normals, &border, &mut out);
    out
}

/// One open edge on its line.
#[derive(Debug, Clone, Copy)]
struct Open {
    triangle: u32,
    side: u8,
    /// Positions of its ends along the line's direction; the edge runs along it if `forward`.
    from: f64,
    to: f64,
    forward: bool,
}

/// Joints along parts of open edges.
fn partial(
    mesh: &UnwrapInput,
    charts: &Charts,
    normals: &[DVec3],
    border: &[(u32, u8)],
    out: &mut Vec<Joint>,
) {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in &mesh.positions {
        low = low.min(p.as_dvec3());
        high = high.max(p.as_dvec3());
    }
    let (middle, size) = ((low + high) * 0.5, (high - low).length());
    if !(size > 0.0 && size.is_finite()) {
        return;
    }
    let end = |t: u32, k: u8| {
        let v = mesh.triangles[t as usize][k as usize % 3];
        mesh.positions[v as usize].as_dvec3() - middle
    };
    // Coarse keys of lines: the direction, and the point nearest to the centre. Two shifted grids,
    // so that a line on a cell border of one is inside a cell of the other.
    let mut keyed: Vec<([i32; 7], Open)> = Vec::with_capacity(border.len() * 2);
    for &(triangle, side) in border {
        let (p, q) = (end(triangle, side), end(triangle, side + 1));
        let d = (q - p).normalize_or_zero();
        if d == DVec3::ZERO {
            continue;
        }
        // Makes the first clearly non-zero component positive.
        let lead = d
            .to_array()
            .into_iter()
            .find(|x| x.abs() > 1e-3)
            .unwrap_or(1.0);
        let forward = lead > 0.0;
        let d = if forward { d } else { -d };
        let foot = (p - d * p.dot(d)) / size;
        let (s, t) = (p.dot(d), q.dot(d));
        let open = Open {
            triangle,
            side,
            from: s.min(t),
            to: s.max(t),
            forward,
        };
        let primitive = mesh.primitive[triangle as usize] as i32;
        for half in [0.0, 0.5] {
            let d = (d * 256.0 + half).floor().as_ivec3();
            let foot = (foot * 1024.0 + half).floor().as_ivec3();
            let key = [
                primitive * 2 + i32::from(half > 0.0),
                d.x,
                d.y,
                d.z,
                foot.x,
                foot.y,
                foot.z,
            ];
            keyed.push((key, open));
        }
    }
    keyed.sort_by(|a, b| {
        (a.0.cmp(&b.0))
            .then(a.1.from.total_cmp(&b.1.from))
            .then((a.1.triangle, a.1.side).cmp(&(b.1.triangle, b.1.side)))
    });
    let mut found: Vec<(u32, u8, u32, u8)> = Vec::new();
    for line in keyed.chunk_by(|a, b| a.0 == b.0) {
        for (i, (_, e)) in line.iter().enumerate() {
            for (_, f) in line[i + 1..].iter().take(PARTNERS) {
                if f.from >= e.to {
                    break;
                }
                let (e, f) = if (e.triangle, e.side) < (f.triangle, f.side) {
                    (e, f)
                } else {
                    (f, e)
                };
                if e.forward != f.forward {
                    found.push((e.triangle, e.side, f.triangle, f.side));
                }
            }
        }
    }
    found.sort_unstable();
    found.dedup();
    let flat = libm::cos(FLAT_DEGREES.to_radians());
    for (t, k, u, l) in found {
        let (a, b) = (charts.chart[t as usize], charts.chart[u as usize]);
        let cos = normals[t as usize].dot(normals[u as usize]);
        if a == b || cos < flat {
            continue;
        }
        let ([p, q], [r, s]) = ([end(t, k), end(t, k + 1)], [end(u, l), end(u, l + 1)]);
        if let Some((on_first, on_second, length)) = shared_part(p, q, r, s, size) {
            let on = |c: &[DVec2; 3], k: u8, at: [f64; 2]| {
                let (from, to) = (c[k as usize % 3], c[(k as usize + 1) % 3]);
                at.map(|x| from.lerp(to, x))
            };
            let first = on(&charts.corners[t as usize], k, on_first);
            let second = on(&charts.corners[u as usize], l, on_second);
            // Ends follow the direction of the lower chart's triangle.
            let back = |e: [DVec2; 2]| [e[1], e[0]];
            let (charts, ends) = if a < b {
                ([a, b], [first, second])
            } else {
                ([b, a], [back(second), back(first)])
            };
            out.push(Joint {
                charts,
                ends,
                length,
                hard: false,
            });
        }
    }
}

/// The part that the opposite edges p → q and r → s share, as positions 0..1 along each, and its
/// length. `None` if they are not on one line, within the rounding of `f32` positions in a mesh of
/// `size`.
fn shared_part(
    p: DVec3,
    q: DVec3,
    r: DVec3,
    s: DVec3,
    size: f64,
) -> Option<([f64; 2], [f64; 2], f64)> {
    let along = q - p;
    let length = along.length();
    let d = along / length;
    let tolerance = 2e-6 * size;
    let off = |x: DVec3| ((x - p) - d * (x - p).dot(d)).length();
    let (from, to) = ((s - p).dot(d).max(0.0), (r - p).dot(d).min(length));
    if to - from <= 4.0 * tolerance || off(r) > tolerance || off(s) > tolerance {
        return None;
    }
    let other = (s - r).length();
    let back = |x: f64| ((p + d * x - r).dot(s - r) / (other * other)).clamp(0.0, 1.0);
    Some((
        [from / length, to / length],
        [back(from), back(to)],
        to - from,
    ))
}
