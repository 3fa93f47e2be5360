//! The empty room of the classic radiosity studies.

use glam::Vec3;

use crate::geometry::{Geometry, box_faces, grid};
use crate::gltf::{GltfBuilder, Material, Node};

/// An empty room of square patches with a lamp panel in its ceiling, as GLB.
///
/// The room is a cube of 4 m whose six faces are `n` × `n` squares (two triangles each), so there
/// are 6n² patches: n = 13 gives 1014 and n = 31 gives 5766, the sizes at which the solvers of the
/// classic studies were compared. Walls reflect 0.7, the floor 0.4, the ceiling 0.8 and one wall is
/// red (0.6, 0.1, 0.1). The middle third of the ceiling's squares (rounded to the nearest number
/// that keeps it centred) emits 5 W/(m² sr) and reflects nothing. Sources for this kind of scene:
/// Cohen, Chen, Wallace and Greenberg, *A Progressive Refinement Approach to Fast Radiosity Image
/// Generation*, 1988; Gortler, Cohen and Slusallek, *Radiosity and Relaxation Methods*, 1994. One
/// mesh `room` has the primitives walls, red wall, floor, ceiling and lamp. There are no
/// T-junctions.
pub fn classic_room(n: u32) -> Vec<u8> {
    let n = n.max(3);
    let size = 4.0;
    let [left, right, floor, _, back, front] =
        box_faces(Vec3::ZERO, Vec3::splat(size), n).map(Geometry::flipped);
    let (ceiling, lamp) = ceiling(n, size);
    let mut b = GltfBuilder::new();
    let wall_m = b.material(&Material::diffuse("wall", [0.7; 3]));
    let red_m = b.material(&Material::diffuse("red_wall", [0.6, 0.1, 0.1]));
    let floor_m = b.material(&Material::diffuse("floor", [0.4; 3]));
    let ceiling_m = b.material(&Material::diffuse("ceiling", [0.8; 3]));
    let lamp_m = b.material(&Material::emitter("lamp", [5.0; 3], [0.0; 3]));
    let walls = Geometry::union(&[right, back, front]).bare();
    let (left, floor) = (left.bare(), floor.bare());
    let parts = [
        (&walls, wall_m),
        (&left, red_m),
        (&floor, floor_m),
        (&ceiling, ceiling_m),
        (&lamp, lamp_m),
    ];
    let mesh = b.mesh("room", &parts);
    b.node(Node::of_mesh("room", mesh));
    super::add_camera(
        &mut b,
        Vec3::new(3.8, 1.8, 3.8),
        Vec3::new(0.6, 1.6, 0.6),
        75.0,
    );
    b.finish()
}

/// The ceiling's squares outside and inside the lamp.
pub(super) fn ceiling(n: u32, size: f32) -> (Geometry, Geometry) {
    let third = n / 3;
    let width = if (n - third).is_multiple_of(2) {
        third
    } else {
        third + 1
    };
    let from = (n - width) / 2;
    let all = grid(
        Vec3::new(0.0, size, 0.0),
        Vec3::X * size,
        Vec3::Z * size,
        [n, n],
    );
    let (mut rim, mut lamp) = (all.clone(), all);
    let lit = |square: u32| {
        let inside = |k: u32| (from..from + width).contains(&k);
        inside(square % n) && inside(square / n)
    };
    let split = |g: &mut Geometry, want: bool| {
        let mut k = 0;
        g.triangles.retain(|_| {
            k += 1;
            lit((k - 1) / 2) == want
        });
    };
    split(&mut rim, false);
    split(&mut lamp, true);
    (compact(rim).bare(), compact(lamp).bare())
}

/// Drops vertices that no triangle uses.
fn compact(g: Geometry) -> Geometry {
    let mut new = vec![u32::MAX; g.positions.len()];
    let mut out = Geometry::default();
    for t in &g.triangles {
        let t = t.map(|i| {
            let slot = &mut new[i as usize];
            if *slot == u32::MAX {
                *slot = out.positions.len() as u32;
                out.positions.push(g.positions[i as usize]);
            }
            *slot
        });
        out.triangles.push(t);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lamp_faces_down_and_the_ceiling_stays_whole() {
        for n in [3, 13, 31] {
            let (rim, lamp) = ceiling(n, 4.0);
            // f32 coordinates for an n that is not a power of two: relative 1e-6 is a few ulp.
            assert!((rim.area() + lamp.area() - 16.0).abs() < 16e-6);
            assert!(lamp.area() > 0.9 && lamp.area() < 4.0, "{}", lamp.area());
            for g in [rim, lamp] {
                for t in &g.triangles {
                    let [a, b, c] = t.map(|i| g.positions[i as usize]);
                    assert!((b - a).cross(c - a).y < 0.0);
                }
            }
        }
    }
}
