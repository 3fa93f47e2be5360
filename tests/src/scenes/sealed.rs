//! A bright room with a sealed box that is dark inside.

use glam::{Vec3, Vec3Swizzles};

use crate::geometry::{Geometry, box_faces, cuboid, room};
use crate::gltf::{GltfBuilder, Material, Node};

/// A bright room with a sealed box inside it, as GLB; E is exactly 0 on every face of
/// `dark_inside`.
///
/// The room is 6 × 3 × 6 m with a lamp panel in its ceiling (radiance 10 W/(m² sr), 2 × 2 m) and
/// walls of reflectance 0.7. The box floats at its centre, 1.5 m wide, its walls `wall` metres
/// thick (> 0; less than a lumel is the hard case), with faces modelled on both sides of the walls.
/// Node names: `room`, `box_outside`, `dark_inside`.
pub fn sealed_dark_box(wall: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.7; 3]));
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let lamp = b.material(&Material::emitter("lamp", [10.0; 3], [0.0; 3]));
    // The lamp is the middle square of the ceiling's three by three: nothing is hidden behind it,
    // and no edge is split.
    let mut faces =
        box_faces(Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 3.0, 3.0), 3).map(Geometry::flipped);
    let mut panel = faces[3].clone();
    let middle = |g: &Geometry, t: &[u32; 3]| {
        t.iter()
            .all(|&i| g.positions[i as usize].xz().abs().max_element() < 1.5)
    };
    panel.triangles.retain(|t| middle(&faces[3], t));
    let ceiling = faces[3].clone();
    faces[3].triangles.retain(|t| !middle(&ceiling, t));
    let (shell, panel) = (Geometry::union(&faces), quad_of(&panel));
    let centre = Vec3::new(0.0, 1.25, 0.0);
    let half = Vec3::splat(0.75);
    let outside = cuboid(centre - half, centre + half, 1);
    let inner = half - Vec3::splat(wall);
    let inside = room(centre - inner, centre + inner, 1);
    let room_mesh = b.mesh("room", &[(&shell, white), (&panel, lamp)]);
    b.node(Node::of_mesh("room", room_mesh));
    let parts: [(&str, &Geometry); 2] = [("box_outside", &outside), ("dark_inside", &inside)];
    for (name, g) in parts {
        let mesh = b.mesh(name, &[(g, grey)]);
        b.node(Node::of_mesh(name, mesh));
    }
    super::add_camera(
        &mut b,
        Vec3::new(2.7, 2.2, 2.7),
        Vec3::new(0.0, 1.1, 0.0),
        70.0,
    );
    b.finish()
}

/// `g` without unused vertices.
fn quad_of(g: &Geometry) -> Geometry {
    let mut used: Vec<u32> = g.triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let at = |i: u32| used.binary_search(&i).unwrap_or(0) as u32;
    Geometry {
        positions: used.iter().map(|&i| g.positions[i as usize]).collect(),
        normals: used.iter().map(|&i| g.normals[i as usize]).collect(),
        uv: used.iter().map(|&i| g.uv[i as usize]).collect(),
        triangles: g.triangles.iter().map(|t| t.map(at)).collect(),
        ..Geometry::default()
    }
}
