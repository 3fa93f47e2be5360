//! Architecture carved out of solid boxes.
//!
//! Boxes are filled with rock, and rooms are carved out of them. The result is cut into cells along
//! every box's planes, with a quadrilateral wherever a solid cell meets an empty one. So walls have
//! two faces and a thickness, faces never overlap, and edges match (no T-junctions), whatever the
//! boxes are.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use crate::geometry::Geometry;

/// Number of an empty space: 0 is the outside, others are up to the caller.
pub type Space = u8;

/// A face that the caller of [`Carver::faces`] paints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// The empty space that the face looks into.
    pub space: Space,
    /// Unit normal, along an axis.
    pub normal: Vec3,
    /// Its middle, metres.
    pub centre: Vec3,
}

/// An axis-parallel solid under construction.
#[derive(Debug, Clone, Default)]
pub struct Carver {
    ops: Vec<(Vec3, Vec3, Option<Space>)>,
    lines: [Vec<f32>; 3],
}

impl Carver {
    /// Everything empty (space 0).
    pub fn new() -> Carver {
        Carver::default()
    }

    /// Fills a box with rock.
    pub fn fill(&mut self, min: [f32; 3], max: [f32; 3]) -> &mut Self {
        self.ops.push((min.into(), max.into(), None));
        self
    }

    /// Empties a box and makes it part of `space`.
    pub fn carve(&mut self, min: [f32; 3], max: [f32; 3], space: Space) -> &mut Self {
        self.ops.push((min.into(), max.into(), Some(space)));
        self
    }

    /// Cuts faces at `at` metres along `axis` (0..3), where the paint changes.
    pub fn cut(&mut self, axis: usize, at: f32) -> &mut Self {
        self.lines[axis].push(at);
        self
    }

    /// All faces, grouped by the key that `paint` returns; `None` leaves a face out.
    ///
    /// Corners are shared within a group's plane; normals are flat and uv is in world metres (x, z
    /// on floors; along the wall and downwards on walls).
    pub fn faces<K: Ord>(&self, paint: impl Fn(&Face) -> Option<K>) -> BTreeMap<K, Geometry> {
        let lines = self.sorted_lines();
        let count = [0, 1, 2].map(|k: usize| lines[k].len().saturating_sub(1));
        let mut cells = vec![Some(0); count[0] * count[1] * count[2]];
        let at = |c: [usize; 3]| (c[1] * count[2] + c[2]) * count[0] + c[0];
        for (min, max, value) in &self.ops {
            let range = |k: usize| {
                let find = |x: f32| lines[k].partition_point(|&l| l < x);
                find(min[k])..find(max[k])
            };
            for y in range(1) {
                for z in range(2) {
                    for x in range(0) {
                        cells[at([x, y, z])] = *value;
                    }
                }
            }
        }
        let mut out: BTreeMap<K, Builder> = BTreeMap::new();
        for y in 0..count[1] {
            for z in 0..count[2] {
                for x in 0..count[0] {
                    if cells[at([x, y, z])].is_some() {
                        continue;
                    }
                    for (axis, up) in [
                        (0, false),
                        (0, true),
                        (1, false),
                        (1, true),
                        (2, false),
                        (2, true),
                    ] {
                        let c = [x, y, z];
                        let mut next = c;
                        let inside = if up {
                            c[axis] + 1 < count[axis]
                        } else {
                            c[axis] > 0
                        };
                        next[axis] = if up {
                            c[axis] + 1
                        } else {
                            c[axis].wrapping_sub(1)
                        };
                        let Some(space) = (if inside { cells[at(next)] } else { Some(0) }) else {
                            continue;
                        };
                        let corner = |i: usize, j: usize| {
                            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                            let mut p = Vec3::ZERO;
                            p[axis] = lines[axis][c[axis] + usize::from(up)];
                            p[a] = lines[a][c[a] + i];
                            p[b] = lines[b][c[b] + j];
                            p
                        };
                        let mut normal = Vec3::ZERO;
                        normal[axis] = if up { 1.0 } else { -1.0 };
                        let corners = if up {
                            [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]
                        } else {
                            [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)]
                        };
                        let face = Face {
                            space,
                            normal,
                            centre: (corners[0] + corners[2]) / 2.0,
                        };
                        if let Some(key) = paint(&face) {
                            out.entry(key).or_default().quad(corners, normal);
                        }
                    }
                }
            }
        }
        out.into_iter().map(|(k, b)| (k, b.geometry)).collect()
    }

    fn sorted_lines(&self) -> [Vec<f32>; 3] {
        [0, 1, 2].map(|k| {
            let mut all: Vec<f32> = self.lines[k].clone();
            all.extend(self.ops.iter().flat_map(|(min, max, _)| [min[k], max[k]]));
            all.sort_by(f32::total_cmp);
            all.dedup();
            all
        })
    }
}

#[derive(Default)]
struct Builder {
    geometry: Geometry,
    corners: BTreeMap<[u32; 6], u32>,
}

impl Builder {
    fn quad(&mut self, corners: [Vec3; 4], normal: Vec3) {
        let [a, b, c, d] = corners.map(|p| self.corner(p, normal));
        self.geometry.triangles.extend([[a, b, c], [a, c, d]]);
    }

    fn corner(&mut self, p: Vec3, n: Vec3) -> u32 {
        let bits = |v: Vec3| v.to_array().map(|x| (x + 0.0).to_bits());
        let ([a, b, c], [d, e, f]) = (bits(p), bits(n));
        let g = &mut self.geometry;
        *self.corners.entry([a, b, c, d, e, f]).or_insert_with(|| {
            g.positions.push(p);
            g.normals.push(n);
            g.uv.push(if n.y != 0.0 {
                Vec2::new(p.x, p.z)
            } else if n.x != 0.0 {
                Vec2::new(-p.z * n.x, -p.y)
            } else {
                Vec2::new(p.x * n.z, -p.y)
            });
            g.positions.len() as u32 - 1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_room_with_a_door_is_closed_but_for_nothing() {
        let mut c = Carver::new();
        c.fill([0.0; 3], [4.0, 3.0, 4.0])
            .carve([0.5; 3], [3.5, 2.5, 3.5], 1)
            .carve([3.5, 0.5, 1.0], [4.0, 2.0, 2.0], 2);
        let all = c.faces(|_| Some(()));
        let g = &all[&()];
        let p = |i: u32| g.positions[i as usize];
        let volume: f32 = g
            .triangles
            .iter()
            .map(|t| p(t[0]).dot(p(t[1]).cross(p(t[2]))) / 6.0)
            .sum();
        // 48 m³ of rock minus the room (18) and the door (0.75); exact coordinates, f32 sum.
        assert!((volume - 29.25).abs() < 1e-3, "{volume}");
        let key = |i: u32| p(i).to_array().map(f32::to_bits);
        let mut edges = BTreeMap::new();
        for t in &g.triangles {
            for k in 0..3 {
                *edges.entry((key(t[k]), key(t[(k + 1) % 3]))).or_insert(0) += 1;
            }
        }
        assert!(
            edges
                .iter()
                .all(|((a, b), n)| edges.get(&(*b, *a)) == Some(n)),
            "an edge is open"
        );
        let inside = c.faces(|f| (f.space == 1).then_some(f.normal.y > 0.0));
        assert!((inside[&true].area() - 9.0).abs() < 1e-6);
    }
}
