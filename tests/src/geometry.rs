//! Triangle lists and the shapes that scenes consist of.

use glam::{Affine3A, Vec2, Vec3, Vec4};

/// Indexed triangles with optional attributes (an empty vector means absent); metres,
/// counter-clockwise fronts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Unit normals; absent means flat faces.
    pub normals: Vec<Vec3>,
    /// `TEXCOORD_0`.
    pub uv: Vec<Vec2>,
    /// `TEXCOORD_1`.
    pub uv1: Vec<Vec2>,
    /// `COLOR_0`, linear RGBA.
    pub colors: Vec<Vec4>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Geometry {
    /// Appends `other`; both must have the same attributes unless one is empty.
    pub fn append(&mut self, other: &Geometry) -> &mut Self {
        let base = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uv.extend_from_slice(&other.uv);
        self.uv1.extend_from_slice(&other.uv1);
        self.colors.extend_from_slice(&other.colors);
        self.triangles
            .extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
        self
    }

    /// All of `parts` in one list.
    pub fn union<'a>(parts: impl IntoIterator<Item = &'a Geometry>) -> Geometry {
        let mut out = Geometry::default();
        for part in parts {
            out.append(part);
        }
        out
    }

    /// The same surface with fronts and backs swapped.
    pub fn flipped(mut self) -> Geometry {
        for t in &mut self.triangles {
            t.swap(1, 2);
        }
        for n in &mut self.normals {
            *n = -*n;
        }
        self
    }

    /// Transformed by a motion or scaling that does not mirror.
    pub fn transformed(mut self, m: Affine3A) -> Geometry {
        let normal = m.matrix3.inverse().transpose();
        for p in &mut self.positions {
            *p = m.transform_point3(*p);
        }
        for n in &mut self.normals {
            *n = (normal * *n).normalize();
        }
        self
    }

    /// Translated by `t` metres.
    pub fn moved(self, t: Vec3) -> Geometry {
        self.transformed(Affine3A::from_translation(t))
    }

    /// Without normals and texture coordinates, for scenes that need neither.
    pub fn bare(mut self) -> Geometry {
        self.normals.clear();
        self.uv.clear();
        self
    }

    /// Area in m², summed in `f64`.
    pub fn area(&self) -> f64 {
        let p = |i: u32| self.positions[i as usize].as_dvec3();
        self.triangles
            .iter()
            .map(|&[a, b, c]| (p(b) - p(a)).cross(p(c) - p(a)).length() / 2.0)
            .sum()
    }
}

/// A planar quadrilateral a, b, c, d, front on the side from which the corners run
/// counter-clockwise.
///
/// Texture coordinates are metres along a→b and a→d, so that a tile of one metre repeats without
/// distortion.
pub fn quad(corners: [Vec3; 4]) -> Geometry {
    let [a, b, c, d] = corners;
    let normal = (b - a).cross(c - a).normalize();
    let x = (b - a).normalize();
    let y = normal.cross(x);
    Geometry {
        positions: corners.to_vec(),
        normals: vec![normal; 4],
        uv: [a, b, c, d]
            .iter()
            .map(|&p| Vec2::new((p - a).dot(x), -(p - a).dot(y)))
            .collect(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Geometry::default()
    }
}

/// A parallelogram `origin + s·u + t·v`, s and t in 0..=1, in `n[0] × n[1]` cells; front along u ×
/// v. Uv in metres.
///
/// Cell borders are shared vertices, so there is no T-junction inside. Zero cells count as one.
pub fn grid(origin: Vec3, u: Vec3, v: Vec3, n: [u32; 2]) -> Geometry {
    let [nu, nv] = n.map(|k| k.max(1));
    let normal = u.cross(v).normalize();
    let mut out = Geometry::default();
    for j in 0..=nv {
        for i in 0..=nu {
            let (s, t) = (i as f32 / nu as f32, j as f32 / nv as f32);
            out.positions.push(origin + u * s + v * t);
            out.normals.push(normal);
            out.uv.push(Vec2::new(s * u.length(), -t * v.length()));
        }
    }
    let row = nu + 1;
    for j in 0..nv {
        for i in 0..nu {
            let k = j * row + i;
            out.triangles.push([k, k + 1, k + row + 1]);
            out.triangles.push([k, k + row + 1, k + row]);
        }
    }
    out
}

/// The six faces of an axis-parallel box, in the order −X, +X, −Y, +Y, −Z, +Z, fronts outside, `n`
/// cells an edge.
pub fn box_faces(min: Vec3, max: Vec3, n: u32) -> [Geometry; 6] {
    let d = max - min;
    let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
    let n = [n, n];
    [
        grid(min, z, y, n),
        grid(min + x + z, -z, y, n),
        grid(min, x, z, n),
        grid(min + y + z, x, -z, n),
        grid(min + x, -x, y, n),
        grid(min + z, x, y, n),
    ]
}

/// An axis-parallel box with fronts outside, `n` cells an edge.
pub fn cuboid(min: Vec3, max: Vec3, n: u32) -> Geometry {
    Geometry::union(&box_faces(min, max, n))
}

/// An axis-parallel room: fronts inside.
pub fn room(min: Vec3, max: Vec3, n: u32) -> Geometry {
    cuboid(min, max, n).flipped()
}

/// A sphere as a subdivided icosahedron, fronts outside, flat-shaded: `20·4^level` triangles whose
/// vertices lie on it.
pub fn icosphere(centre: Vec3, radius: f32, level: u32) -> Geometry {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points: Vec<glam::DVec3> = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ]
    .map(|p| glam::DVec3::from(p).normalize())
    .to_vec();
    let mut triangles: Vec<[u32; 3]> = vec![
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
        let mut middle = std::collections::BTreeMap::new();
        let mut next = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let mut split = |i: u32, j: u32| {
                *middle.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    points.push((points[i as usize] + points[j as usize]).normalize());
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (split(a, b), split(b, c), split(c, a));
            next.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = next;
    }
    Geometry {
        positions: points
            .iter()
            .map(|p| centre + p.as_vec3() * radius)
            .collect(),
        triangles,
        ..Geometry::default()
    }
}

/// A prism over the polygon `outline` (x, z; counter-clockwise seen from above) between two
/// heights; fronts outside.
///
/// The outline must be convex (its caps are fans). Uv in metres.
pub fn prism(outline: &[Vec2], bottom: f32, top: f32) -> Geometry {
    let at = |p: Vec2, y: f32| Vec3::new(p.x, y, p.y);
    let n = outline.len();
    let mut out = Geometry::default();
    for i in 0..n {
        let (p, q) = (outline[i], outline[(i + 1) % n]);
        out.append(&quad([
            at(p, bottom),
            at(q, bottom),
            at(q, top),
            at(p, top),
        ]));
    }
    let mut cap = |y: f32, normal: Vec3, order: fn([u32; 3]) -> [u32; 3]| {
        out.append(&Geometry {
            positions: outline.iter().map(|&p| at(p, y)).collect(),
            normals: vec![normal; n],
            uv: outline.to_vec(),
            triangles: (1..n as u32 - 1).map(|i| order([0, i, i + 1])).collect(),
            ..Geometry::default()
        });
    };
    cap(top, Vec3::Y, |t| t);
    cap(bottom, Vec3::NEG_Y, |[a, b, c]| [a, c, b]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signed volume by the divergence theorem: positive when fronts lie outside.
    fn volume(g: &Geometry) -> f64 {
        let p = |i: u32| g.positions[i as usize].as_dvec3();
        g.triangles
            .iter()
            .map(|&[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0)
            .sum()
    }

    #[test]
    fn fronts_lie_outside() {
        let (a, b) = (Vec3::new(-1.0, 2.0, 3.0), Vec3::new(1.0, 3.0, 6.0));
        // 6 m³ in f32 coordinates that are exact: only the f64 sum rounds.
        assert!((volume(&cuboid(a, b, 3)) - 6.0).abs() < 1e-9);
        assert!((volume(&room(a, b, 2)) + 6.0).abs() < 1e-9);
        let sphere = volume(&icosphere(Vec3::ZERO, 1.0, 4)) / (4.0 / 3.0 * std::f64::consts::PI);
        // An inscribed polyhedron of 5120 faces loses about 0.3 % of the volume.
        assert!((0.995..1.0).contains(&sphere), "{sphere}");
        let outline = [
            Vec2::new(0.0, 0.0),
            Vec2::new(0.0, 1.0),
            Vec2::new(1.0, 1.0),
            Vec2::new(1.0, 0.0),
        ];
        let v = volume(&prism(&outline, 0.0, 2.0));
        assert!((v - 2.0).abs() < 1e-9, "{v}");
    }

    #[test]
    fn stored_normals_agree_with_the_winding() {
        let outline = [
            Vec2::new(0.0, 0.0),
            Vec2::new(0.0, 1.0),
            Vec2::new(1.0, 1.0),
            Vec2::new(1.0, 0.0),
        ];
        for g in [
            cuboid(Vec3::ZERO, Vec3::ONE, 2),
            room(Vec3::ZERO, Vec3::ONE, 2),
            prism(&outline, 0.0, 1.0),
        ] {
            for t in &g.triangles {
                let [a, b, c] = t.map(|i| g.positions[i as usize]);
                let n = (b - a).cross(c - a).normalize();
                assert!(n.dot(g.normals[t[0] as usize]) > 0.999);
            }
        }
    }
}
