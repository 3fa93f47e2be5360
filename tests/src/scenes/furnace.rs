//! Furnaces: closed rooms in which every surface has the same emission and reflectance, so that the
//! light is known for any shape.

use glam::{Affine3A, Quat, Vec3};

use crate::geometry::{Geometry, cuboid, grid, icosphere, room};
use crate::gltf::{GltfBuilder, Material, Node};

/// Shape of a furnace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FurnaceShape {
    /// A 2 m cube of twelve triangles.
    Cube,
    /// A sphere of radius 1 m, 1280 facets.
    Sphere,
    /// An L-shaped room of three 2 m squares, 2 m high, with a rotated box floating in it, whose
    /// corners do not see each other.
    NonConvex,
}

/// A closed furnace as GLB: every surface emits radiance `emission` (W/(m² sr)) and reflects `rho`.
///
/// Then B = M_e + ρE and E = B everywhere, with M_e = πL, so E = πL/(1−ρ) at every point, for any
/// shape: each point sees radiance B/π in every direction. Source: the "furnace test", e.g. Goral
/// et al. 1984 with F row sums of 1.
pub fn furnace(rho: f32, emission: f32, shape: FurnaceShape) -> Vec<u8> {
    let surface = match shape {
        FurnaceShape::Cube => room(Vec3::splat(-1.0), Vec3::ONE, 1),
        FurnaceShape::Sphere => icosphere(Vec3::ZERO, 1.0, 3).flipped(),
        FurnaceShape::NonConvex => l_room(),
    };
    let mut b = GltfBuilder::new();
    let glow = b.material(&Material::emitter("glow", [emission; 3], [rho; 3]));
    let mesh = b.mesh("furnace", &[(&surface.bare(), glow)]);
    b.node(Node::of_mesh("furnace", mesh));
    b.finish()
}

fn l_room() -> Geometry {
    let s = 2.0;
    let h = Vec3::Y * s;
    let (x, z) = (Vec3::X * s, Vec3::Z * s);
    let mut out = Geometry::default();
    for cell in [Vec3::ZERO, x, z] {
        out.append(&grid(cell, z, x, [1, 1]));
        out.append(&grid(cell + h, x, z, [1, 1]));
    }
    // The outline, counter-clockwise seen from above (−Z is north): each wall faces inside.
    let outline = [
        Vec3::ZERO,
        x,
        x * 2.0,
        x * 2.0 + z,
        x + z,
        x + z * 2.0,
        z * 2.0,
        z,
        Vec3::ZERO,
    ];
    for w in outline.windows(2) {
        out.append(&grid(w[0], w[1] - w[0], h, [1, 1]));
    }
    let turn = Quat::from_rotation_y(0.5) * Quat::from_rotation_x(0.3);
    let place = Affine3A::from_rotation_translation(turn, Vec3::new(1.0, 1.0, 1.0));
    out.append(&cuboid(Vec3::splat(-0.3), Vec3::splat(0.3), 1).transformed(place));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_l_room_is_closed_and_faces_inside() {
        let g = l_room();
        let p = |i: u32| g.positions[i as usize].as_dvec3();
        let volume: f64 = g
            .triangles
            .iter()
            .map(|&[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0)
            .sum();
        // Three cells of 8 m³ seen from inside, minus a box of 0.216 m³; the f32 rounding of the
        // rotated box is below 1e-5.
        assert!((volume + 24.0 - 0.216).abs() < 1e-5, "{volume}");
        // Every edge of a closed surface occurs once in each direction.
        let key = |i: u32| p(i).to_array().map(|x| (x * 1e4).round() as i64);
        let mut edges = std::collections::BTreeMap::new();
        for t in &g.triangles {
            for k in 0..3 {
                *edges.entry((key(t[k]), key(t[(k + 1) % 3]))).or_insert(0) += 1;
            }
        }
        assert!(
            edges
                .iter()
                .all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1))
        );
    }
}
