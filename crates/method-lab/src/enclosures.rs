//! Makers of the laboratory's scenes. Every patch has reflectance 0.5 and emits nothing; change
//! either afterwards.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DVec3, dvec3};

use crate::{Enclosure, Patch};

fn patch(corners: Vec<DVec3>) -> Patch {
    Patch {
        corners,
        exitance: DVec3::ZERO,
        reflectance: DVec3::splat(0.5),
    }
}

/// A parallelogram or other flat convex quadrilateral in `n` × `m` cells, row by row: `n` along the
/// first edge, `m` along the second. Corners are counter-clockwise as seen from the front.
///
/// Corners of cells on a shared edge are bitwise equal for both neighbours, so that no ray passes
/// between them.
pub fn grid(corners: [DVec3; 4], n: usize, m: usize) -> Vec<Patch> {
    // Weights k/n and (n−k)/n instead of 1 − k/n, because the same edge traversed backwards then
    // gives the same bits.
    let at = |i: usize, j: usize| {
        let (s, s1) = (i as f64 / n as f64, (n - i) as f64 / n as f64);
        let (t, t1) = (j as f64 / m as f64, (m - j) as f64 / m as f64);
        let [a, b, c, d] = corners;
        (a * s1 + b * s) * t1 + (d * s1 + c * s) * t
    };
    let mut patches = Vec::with_capacity(n * m);
    for j in 0..m {
        for i in 0..n {
            patches.push(patch(vec![
                at(i, j),
                at(i + 1, j),
                at(i + 1, j + 1),
                at(i, j + 1),
            ]));
        }
    }
    patches
}

/// The four corners of each face of the box from `low` to `high`, seen from inside: floor (−z),
/// ceiling, then −x, +x, −y, +y.
fn box_faces(low: DVec3, high: DVec3) -> [[DVec3; 4]; 6] {
    let c = |i: usize| {
        dvec3(
            if i & 1 == 0 { low.x } else { high.x },
            if i & 2 == 0 { low.y } else { high.y },
            if i & 4 == 0 { low.z } else { high.z },
        )
    };
    [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
    ]
    .map(|f| f.map(c))
}

/// The unit cube seen from inside, `n` × `n` patches a face: floor (z = 0), ceiling, x = 0, x = 1,
/// y = 0, y = 1.
pub fn cube(n: usize) -> Enclosure {
    Enclosure {
        patches: box_faces(DVec3::ZERO, DVec3::ONE)
            .iter()
            .flat_map(|f| grid(*f, n, n))
            .collect(),
    }
}

/// Two unit squares that face each other at `distance`, `n` × `n` patches each, the lower one
/// first.
pub fn opposed_plates(distance: f64, n: usize) -> Enclosure {
    let [floor, ceiling, ..] = box_faces(DVec3::ZERO, dvec3(1.0, 1.0, distance));
    let mut patches = grid(floor, n, n);
    patches.extend(grid(ceiling, n, n));
    Enclosure { patches }
}

/// A rectangle of depth `width` on the floor and one of height `height` on the wall, with a common
/// edge of length 1 at right angles; `n` × `n` patches each, the floor first.
pub fn perpendicular_plates(width: f64, height: f64, n: usize) -> Enclosure {
    let [floor, _, wall, ..] = box_faces(DVec3::ZERO, dvec3(width, 1.0, height));
    let mut patches = grid(floor, n, n);
    patches.extend(grid(wall, n, n));
    Enclosure { patches }
}

/// Two coaxial discs of radius 1 at distance 1 as regular polygons of `sides` sides of the disc's
/// area, cut in triangles from the centre; `sides` patches each, the lower one first.
pub fn coaxial_discs(sides: usize) -> Enclosure {
    let step = TAU / sides as f64;
    // Area of the polygon of circumradius r: sides/2 · r² sin(step).
    let r = (step / step.sin()).sqrt();
    let rim = |k: usize, z: f64| {
        let a = step * (k % sides) as f64;
        dvec3(r * a.cos(), r * a.sin(), z)
    };
    let mut patches = Vec::with_capacity(2 * sides);
    for k in 0..sides {
        patches.push(patch(vec![DVec3::ZERO, rim(k, 0.0), rim(k + 1, 0.0)]));
    }
    for k in 0..sides {
        patches.push(patch(vec![DVec3::Z, rim(k + 1, 1.0), rim(k, 1.0)]));
    }
    Enclosure { patches }
}

/// A room of 3 × 3 × 2 m with a box of 1 × 1 × 0.8 m in the middle of the floor; walls in `3n` ×
/// `3n` patches, the box's faces in `n` × `n`. The floor under the box is left out, so the
/// enclosure is closed.
///
/// Order: floor, ceiling and four walls as in [`cube`], then the box's top and its four sides.
pub fn room_with_box(n: usize) -> Enclosure {
    let faces = box_faces(DVec3::ZERO, dvec3(3.0, 3.0, 2.0));
    let mut patches = Vec::new();
    for (k, face) in faces.iter().enumerate() {
        for (cell, p) in grid(*face, 3 * n, 3 * n).into_iter().enumerate() {
            let (i, j) = (cell % (3 * n), cell / (3 * n));
            let under = k == 0 && (n..2 * n).contains(&i) && (n..2 * n).contains(&j);
            if !under {
                patches.push(p);
            }
        }
    }
    let solid = box_faces(dvec3(1.0, 1.0, 0.0), dvec3(2.0, 2.0, 0.8));
    for [a, b, c, d] in &solid[1..] {
        patches.extend(grid([*d, *c, *b, *a], n, n));
    }
    Enclosure { patches }
}

/// A sphere about the origin as an icosahedron whose triangles are cut in four `level` times, each
/// corner on the sphere: 20 · 4^level triangles, seen from inside or from outside.
pub fn sphere(radius: f64, level: u32, from_inside: bool) -> Enclosure {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points: Vec<DVec3> = [
        (-1.0, g, 0.0),
        (1.0, g, 0.0),
        (-1.0, -g, 0.0),
        (1.0, -g, 0.0),
        (0.0, -1.0, g),
        (0.0, 1.0, g),
        (0.0, -1.0, -g),
        (0.0, 1.0, -g),
        (g, 0.0, -1.0),
        (g, 0.0, 1.0),
        (-g, 0.0, -1.0),
        (-g, 0.0, 1.0),
    ]
    .iter()
    .map(|&(x, y, z)| dvec3(x, y, z).normalize())
    .collect();
    let mut triangles: Vec<[usize; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..level {
        // One midpoint per edge, shared by both triangles.
        let mut middle: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        let mut cut = Vec::with_capacity(4 * triangles.len());
        for [a, b, c] in triangles {
            let mut mid = |p: usize, q: usize| {
                *middle.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    points.push((points[p] + points[q]).normalize());
                    points.len() - 1
                })
            };
            let (ab, bc, ca) = (mid(a, b), mid(b, c), mid(c, a));
            cut.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = cut;
    }
    Enclosure {
        patches: triangles
            .iter()
            .map(|&[a, b, c]| {
                let t = if from_inside { [a, c, b] } else { [a, b, c] };
                patch(t.iter().map(|&k| points[k] * radius).collect())
            })
            .collect(),
    }
}

/// A sphere of radius `inner` seen from outside in a sphere of radius 1 seen from inside, both of
/// 20 · 4^level triangles, the inner one first. Closed if `inner` is below 0.79, the inradius of
/// the icosahedron.
pub fn concentric_spheres(inner: f64, level: u32) -> Enclosure {
    let mut both = sphere(inner, level, false);
    both.patches.extend(sphere(1.0, level, true).patches);
    both
}

/// An L-shaped room, closed and not convex: the 2 × 2 m square without its far quarter, 1 m high,
/// in squares of 1/n m. Every patch emits 1 W/m². For any reflectance ρ that is equal everywhere,
/// the radiosity is 1/(1 − ρ) everywhere.
pub fn furnace_l(n: usize) -> Enclosure {
    // Outline, counter-clockwise from above, in steps of 1 m.
    let outline = [
        (0., 0.),
        (1., 0.),
        (2., 0.),
        (2., 1.),
        (1., 1.),
        (1., 2.),
        (0., 2.),
        (0., 1.),
    ];
    let mut patches = Vec::new();
    for (x, y) in [(0., 0.), (1., 0.), (0., 1.)] {
        let [floor, ceiling, ..] = box_faces(dvec3(x, y, 0.0), dvec3(x + 1.0, y + 1.0, 1.0));
        patches.extend(grid(floor, n, n));
        patches.extend(grid(ceiling, n, n));
    }
    for (k, &(x, y)) in outline.iter().enumerate() {
        let (x1, y1) = outline[(k + 1) % outline.len()];
        // From inside, the outline runs to the left with z up: start at its end for a
        // counter-clockwise wall.
        patches.extend(grid(
            [
                dvec3(x1, y1, 0.0),
                dvec3(x, y, 0.0),
                dvec3(x, y, 1.0),
                dvec3(x1, y1, 1.0),
            ],
            n,
            n,
        ));
    }
    for p in &mut patches {
        p.exitance = DVec3::ONE;
    }
    Enclosure { patches }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Σ of the vector areas, which is 0 for a closed surface, and the volume on the front side,
    /// (−1/3) Σ c·A.
    fn closure(e: &Enclosure) -> (DVec3, f64) {
        let sum = e.patches.iter().map(Patch::vector_area).sum();
        let volume: f64 = e
            .patches
            .iter()
            .map(|p| -p.corners[0].dot(p.vector_area()) / 3.0)
            .sum();
        (sum, volume)
    }

    #[test]
    fn closed_makers_are_closed_and_face_inwards() {
        // Rounding of some thousand terms of size 1.
        for (e, volume) in [
            (cube(3), 1.0),
            (room_with_box(2), 18.0 - 0.8),
            (furnace_l(3), 3.0),
        ] {
            let (sum, v) = closure(&e);
            assert!(
                sum.length() < 1e-12 && (v - volume).abs() < 1e-12,
                "{sum} {v}"
            );
        }
        let (sum, v) = closure(&concentric_spheres(0.5, 2));
        let (_, inner) = closure(&sphere(0.5, 2, true));
        let (_, outer) = closure(&sphere(1.0, 2, true));
        assert!(sum.length() < 1e-12 && (v - (outer - inner)).abs() < 1e-12);
        // Volume of the inscribed polyhedron: 4π/3 minus O(4^-level).
        assert!(
            outer < 2.0 * TAU / 3.0 && outer > 0.95 * 2.0 * TAU / 3.0,
            "{outer}"
        );
    }

    #[test]
    fn discs_keep_their_area() {
        for sides in [6, 24] {
            let area: f64 = coaxial_discs(sides).patches.iter().map(Patch::area).sum();
            assert!((area - TAU).abs() < 1e-12);
        }
    }
}
