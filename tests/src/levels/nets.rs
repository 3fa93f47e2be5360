//! Isosurfaces by *surface nets* (Gibson, *Constrained Elastic Surface Nets*, 1998), with one
//! vertex per cell that the surface crosses.

use glam::Vec3;

use crate::geometry::Geometry;

/// The surface where `field` is 0, with fronts on the positive side, in `n` cells of `cell` metres
/// from `min`.
///
/// It is open where it leaves the grid. Normals are smooth, from the field's gradient; there are no
/// texture coordinates.
pub(super) fn surface(
    min: Vec3,
    cell: f32,
    n: [usize; 3],
    field: impl Fn(Vec3) -> f32,
) -> Geometry {
    let at = |x: usize, y: usize, z: usize| min + Vec3::new(x as f32, y as f32, z as f32) * cell;
    let corner = |x: usize, y: usize, z: usize| (z * (n[1] + 1) + y) * (n[0] + 1) + x;
    let mut values = Vec::new();
    for z in 0..=n[2] {
        for y in 0..=n[1] {
            for x in 0..=n[0] {
                values.push(field(at(x, y, z)));
            }
        }
    }
    let mut out = Geometry::default();
    let mut vertex = vec![u32::MAX; n[0] * n[1] * n[2]];
    let index = |x: usize, y: usize, z: usize| (z * n[1] + y) * n[0] + x;
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                let (mut sum, mut count) = (Vec3::ZERO, 0.0);
                for i in 0..8 {
                    for axis in [1, 2, 4] {
                        let j = i | axis;
                        if i == j {
                            continue;
                        }
                        let c = |k: usize| (x + (k & 1), y + (k >> 1 & 1), z + (k >> 2));
                        let ((a, b, d), (e, f, g)) = (c(i), c(j));
                        let (u, v) = (values[corner(a, b, d)], values[corner(e, f, g)]);
                        if (u > 0.0) != (v > 0.0) {
                            sum += at(a, b, d).lerp(at(e, f, g), u / (u - v));
                            count += 1.0;
                        }
                    }
                }
                if count > 0.0 {
                    let p = sum / count;
                    let slope = |d: Vec3| field(p + d * cell) - field(p - d * cell);
                    let normal = Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z));
                    vertex[index(x, y, z)] = out.positions.len() as u32;
                    out.positions.push(p);
                    out.normals.push(normal.normalize_or(Vec3::Y));
                }
            }
        }
    }
    // A quadrilateral around each grid edge that the surface crosses.
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                for axis in 0..3 {
                    let c = [x, y, z];
                    let (b, d) = ((axis + 1) % 3, (axis + 2) % 3);
                    if c[b] == 0 || c[d] == 0 {
                        continue;
                    }
                    let mut far = c;
                    far[axis] += 1;
                    let (u, v) = (
                        values[corner(x, y, z)],
                        values[corner(far[0], far[1], far[2])],
                    );
                    if (u > 0.0) == (v > 0.0) {
                        continue;
                    }
                    let around = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(i, j)| {
                        let mut k = c;
                        k[b] -= i;
                        k[d] -= j;
                        vertex[index(k[0], k[1], k[2])]
                    });
                    let [p, q, r, s] = around;
                    if v > 0.0 {
                        out.triangles.extend([[p, q, r], [p, r, s]]);
                    } else {
                        out.triangles.extend([[p, r, q], [p, s, r]]);
                    }
                }
            }
        }
    }
    out
}
