//! A room with finely tessellated objects, for measuring the cost of many triangles.

use glam::{Vec3, Vec3A};

use super::classic::ceiling;
use crate::geometry::{Geometry, box_faces, icosphere};
use crate::gltf::{GltfBuilder, Material, Node};

/// Level of the balls' icospheres: 2 × 20·4⁶ = 163,840 triangles, the size of a scanned statue
/// after clean-up.
const LEVEL: u32 = 6;

/// A closed room of 4 m with two knobbly balls of 81,920 triangles each under a lamp panel set into
/// the ceiling, as GLB.
///
/// Walls reflect 0.7, one wall is red (0.6, 0.1, 0.1), the floor reflects 0.4, the ceiling 0.8, and
/// the balls 0.65 and (0.3, 0.5, 0.7). The panel (the middle third of the ceiling in both
/// directions, 1.33 m) emits 5 W/(m² sr). The balls float 1 cm above the floor and apart from each
/// other. No back face is visible from anywhere, so renderers that treat surfaces as two-sided must
/// agree with those that do not. 163,868 triangles with smooth normals on the balls; nodes `room`,
/// `ball_fine`, `ball_coarse`. Not committed (3 MB): `make-assets --dense DIR` writes it.
pub fn dense_room() -> Vec<u8> {
    let size = 4.0;
    let [left, right, floor, _, back, front] =
        box_faces(Vec3::ZERO, Vec3::splat(size), 1).map(Geometry::flipped);
    let (rim, lamp) = ceiling(3, size);
    let mut b = GltfBuilder::new();
    let wall_m = b.material(&Material::diffuse("wall", [0.7; 3]));
    let red_m = b.material(&Material::diffuse("red_wall", [0.6, 0.1, 0.1]));
    let floor_m = b.material(&Material::diffuse("floor", [0.4; 3]));
    let ceiling_m = b.material(&Material::diffuse("ceiling", [0.8; 3]));
    let lamp_m = b.material(&Material::emitter("lamp", [5.0; 3], [0.0; 3]));
    let chalk_m = b.material(&Material::diffuse("chalk", [0.65; 3]));
    let blue_m = b.material(&Material::diffuse("blue", [0.3, 0.5, 0.7]));
    let walls = Geometry::union(&[right, back, front]).bare();
    let mesh = b.mesh(
        "room",
        &[
            (&walls, wall_m),
            (&left.bare(), red_m),
            (&floor.bare(), floor_m),
            (&rim, ceiling_m),
            (&lamp, lamp_m),
        ],
    );
    b.node(Node::of_mesh("room", mesh));
    let balls = [
        (
            "ball_fine",
            knobbly_ball(Vec3::new(1.25, 0.86, 1.5), 0.8, 0.05, 9.0),
            chalk_m,
        ),
        (
            "ball_coarse",
            knobbly_ball(Vec3::new(2.85, 0.76, 2.5), 0.65, 0.1, 4.0),
            blue_m,
        ),
    ];
    for (name, ball, material) in &balls {
        let mesh = b.mesh(name, &[(ball, *material)]);
        b.node(Node::of_mesh(name, mesh));
    }
    super::add_camera(
        &mut b,
        Vec3::new(3.8, 1.8, 0.3),
        Vec3::new(1.5, 0.9, 2.2),
        75.0,
    );
    b.finish()
}

/// An icosphere whose radius varies by ± `depth` metres with `waves` waves around, fronts outside,
/// smooth normals.
///
/// r(d) = radius + depth · sin(w·x) · sin(w·y) · sin(w·z) · 1.5 of the direction d, clamped to ±
/// depth: no vertex is farther out than radius + depth.
fn knobbly_ball(centre: Vec3, radius: f32, depth: f32, waves: f32) -> Geometry {
    let mut g = icosphere(Vec3::ZERO, 1.0, LEVEL).bare();
    for p in &mut g.positions {
        // In f64, so that the bytes do not depend on the platform's sinf.
        let [x, y, z] = p.to_array().map(|x| (f64::from(x * waves)).sin());
        let swing = (1.5 * x * y * z).clamp(-1.0, 1.0) as f32;
        *p = centre + p.normalize() * (radius + depth * swing);
    }
    let mut normals = vec![Vec3A::ZERO; g.positions.len()];
    for t in &g.triangles {
        let [a, b, c] = t.map(|i| Vec3A::from(g.positions[i as usize]));
        for i in t {
            normals[*i as usize] += (b - a).cross(c - a);
        }
    }
    g.normals = normals.iter().map(|n| n.normalize().into()).collect();
    g
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_balls_are_closed_and_touch_nothing() {
        let fine = knobbly_ball(Vec3::new(1.25, 0.86, 1.5), 0.8, 0.05, 9.0);
        let coarse = knobbly_ball(Vec3::new(2.85, 0.76, 2.5), 0.65, 0.1, 4.0);
        for ball in [&fine, &coarse] {
            assert_eq!(ball.triangles.len(), 81_920);
            assert!(ball.positions.iter().all(|p| p.min_element() > 0.005));
            // Every edge occurs once in each direction: closed and consistently wound.
            let mut edges: Vec<_> = ball
                .triangles
                .iter()
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
                .collect();
            edges.sort_unstable();
            let turned = |&(a, b): &(u32, u32)| edges.binary_search(&(b, a)).is_ok();
            assert!(edges.windows(2).all(|w| w[0] != w[1]) && edges.iter().all(turned));
        }
        // Their bounding spheres have radii of 0.85 and 0.75 m at a distance of 1.89 m.
        assert!(Vec3::new(1.6, -0.1, 1.0).length() > 0.85 + 0.75);
    }
}
