//! Rooms without closed-form light, for comparing bakes with a path tracer.
//!
//! All are closed, or open only to the sky, plain (without textures, so that the path tracer can
//! read them), a few metres wide, and made of nodes named after what they are, so that differences
//! can be located.

use glam::Vec3;

use crate::carve::{Carver, Face, Space};
use crate::geometry::{Geometry, cuboid, quad};
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};

const ROOM: Space = 1;
const OPENING: Space = 2;
const SECOND: Space = 3;
const SEALED: Space = 4;

/// Reflectances of floors, walls, ceilings and blocks.
struct Paints {
    floor: [f32; 3],
    walls: [f32; 3],
    ceiling: [f32; 3],
}

/// Adds one node per space and part of `carver`'s faces. The outside is left out, because backs
/// block light as well as fronts.
fn add_rooms(b: &mut GltfBuilder, carver: &Carver, paints: &Paints) {
    let part = |f: &Face| {
        let part = match f.normal.y {
            y if y > 0.5 => "floor",
            y if y < -0.5 => "ceiling",
            _ => "walls",
        };
        (f.space != 0).then_some((f.space, part))
    };
    for ((space, part), geometry) in carver.faces(part) {
        let reflectance = match part {
            "floor" => paints.floor,
            "ceiling" => paints.ceiling,
            _ => paints.walls,
        };
        let space = match space {
            ROOM => "room",
            OPENING => "opening",
            SECOND => "second room",
            _ => "sealed",
        };
        add_part(b, &format!("{space} {part}"), &geometry, reflectance);
    }
}

fn add_part(b: &mut GltfBuilder, name: &str, geometry: &Geometry, reflectance: [f32; 3]) {
    let material = b.material(&Material::diffuse(name, reflectance));
    let mesh = b.mesh(name, &[(&geometry.clone().bare(), material)]);
    b.node(Node::of_mesh(name, mesh));
}

fn add_light(b: &mut GltfBuilder, light: Light, at: Vec3, along: Vec3) {
    let light = b.light("lamp", light);
    b.node(Node {
        name: "lamp".into(),
        translation: at,
        rotation: look_along(along, Vec3::Y),
        light: Some(light),
        ..Node::default()
    });
}

/// The sky over [`skylit_room`], radiance in W/(m² sr).
pub const SKY: [f32; 3] = [1.0, 1.4, 2.0];

/// A 4 × 3 × 5 m room with a window of 2 × 1.4 m through a wall 30 cm thick, a block, a floating
/// slab and a spot lamp in a corner.
///
/// The sky ([`SKY`]) comes from the bake's settings. Nodes: `room …`, `opening …` (the window's
/// reveal), each with floor, walls, ceiling.
pub fn skylit_room() -> Vec<u8> {
    let mut c = Carver::new();
    c.fill([-0.3, -0.3, -0.3], [4.3, 3.3, 5.3])
        .carve([0.0, 0.0, 0.0], [4.0, 3.0, 5.0], ROOM)
        .carve([4.0, 1.0, 1.5], [4.3, 2.4, 3.5], OPENING)
        .fill([0.8, 0.0, 1.0], [1.6, 1.2, 1.9])
        .fill([2.2, 0.9, 2.6], [3.2, 1.0, 4.0]);
    let mut b = GltfBuilder::new();
    let paints = Paints {
        floor: [0.5, 0.4, 0.3],
        walls: [0.8, 0.78, 0.7],
        ceiling: [0.85; 3],
    };
    add_rooms(&mut b, &c, &paints);
    let spot = Light::Spot([12.0, 9.0, 5.0], 0.3, 0.6);
    add_light(
        &mut b,
        spot,
        Vec3::new(0.5, 2.8, 4.5),
        Vec3::new(0.5, -1.0, -0.6),
    );
    b.finish()
}

/// A closed 3 m cube with red, green, blue and white walls (ρ of white 0.9), a block, a
/// double-sided screen and a point light.
///
/// Nodes: `red`, `green`, `blue`, `white`, `block`, `screen`.
pub fn coloured_room() -> Vec<u8> {
    let size = 3.0;
    let [left, right, floor, ceiling, back, front] =
        crate::geometry::box_faces(Vec3::ZERO, Vec3::splat(size), 1).map(Geometry::flipped);
    let mut b = GltfBuilder::new();
    add_part(&mut b, "red", &left, [0.85, 0.05, 0.05]);
    add_part(&mut b, "green", &right, [0.05, 0.8, 0.05]);
    add_part(&mut b, "blue", &back, [0.05, 0.05, 0.85]);
    add_part(
        &mut b,
        "white",
        &Geometry::union(&[floor, ceiling, front]),
        [0.9; 3],
    );
    let block = cuboid(Vec3::new(1.7, 0.4, 1.2), Vec3::new(2.3, 1.3, 1.9), 1);
    add_part(&mut b, "block", &block, [0.9, 0.7, 0.2]);
    let screen = b.material(&Material {
        double_sided: true,
        ..Material::diffuse("screen", [0.7, 0.7, 0.8])
    });
    let sheet = quad([
        Vec3::new(0.6, 0.5, 1.0),
        Vec3::new(0.9, 0.5, 2.0),
        Vec3::new(0.9, 1.9, 2.0),
        Vec3::new(0.6, 1.9, 1.0),
    ]);
    let mesh = b.mesh("screen", &[(&sheet.bare(), screen)]);
    b.node(Node::of_mesh("screen", mesh));
    add_light(
        &mut b,
        Light::Point([6.0; 3]),
        Vec3::new(1.4, 2.2, 1.1),
        Vec3::NEG_Y,
    );
    b.finish()
}

/// Two rooms of 3 m with a doorway of 90 cm between them, a lamp panel in the first only, and a
/// sealed chamber behind the second.
///
/// Nodes: `room …`, `second room …` (lit by what the doorway lets through), `opening …` (the
/// doorway), `sealed …` (E is exactly 0), `lamp` (a panel of 1 × 0.6 m that hangs 20 cm under the
/// ceiling and shines down).
pub fn two_rooms_with_a_door() -> Vec<u8> {
    let mut c = Carver::new();
    c.fill([-0.2, -0.2, -0.2], [7.2, 2.7, 3.2])
        .carve([0.0, 0.0, 0.0], [3.0, 2.5, 3.0], ROOM)
        .carve([3.0, 0.0, 1.0], [3.2, 2.0, 1.9], OPENING)
        .carve([3.2, 0.0, 0.0], [6.0, 2.5, 3.0], SECOND)
        .carve([6.2, 0.0, 0.0], [7.0, 2.5, 3.0], SEALED)
        .fill([4.4, 0.0, 0.6], [5.2, 1.0, 1.4]);
    let mut b = GltfBuilder::new();
    let paints = Paints {
        floor: [0.6, 0.5, 0.4],
        walls: [0.75, 0.75, 0.7],
        ceiling: [0.85; 3],
    };
    add_rooms(&mut b, &c, &paints);
    let lamp = b.material(&Material::emitter("lamp", [12.0, 11.0, 9.0], [0.3; 3]));
    let panel = quad([
        Vec3::new(1.0, 2.3, 1.2),
        Vec3::new(2.0, 2.3, 1.2),
        Vec3::new(2.0, 2.3, 1.8),
        Vec3::new(1.0, 2.3, 1.8),
    ]);
    let mesh = b.mesh("lamp", &[(&panel.bare(), lamp)]);
    b.node(Node::of_mesh("lamp", mesh));
    b.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path_tracer::Scene;

    /// Signed volume enclosed by the triangles of these nodes; negative if fronts face inwards.
    fn volume(scene: &Scene, names: &[&str]) -> f64 {
        let mine = |t: &&crate::path_tracer::Triangle| {
            names.iter().any(|n| scene.nodes[t.node].starts_with(n))
        };
        let part = |t: &crate::path_tracer::Triangle| {
            let [a, b, c] = t.corners;
            a.dot(b.cross(c)) / 6.0
        };
        scene.triangles.iter().filter(mine).map(part).sum()
    }

    #[test]
    fn rooms_face_inside() {
        // f32 coordinates of metres: 1e-7 each, some 1e-5 m³ in all.
        let scene = Scene::from_glb(&two_rooms_with_a_door()).expect("a scene");
        assert!((volume(&scene, &["sealed"]) + 0.8 * 2.5 * 3.0).abs() < 1e-5);
        let inside = 3.0 * 2.5 * 3.0 + 2.8 * 2.5 * 3.0 + 0.2 * 2.0 * 0.9 - 0.8 * 1.0 * 0.8;
        assert!((volume(&scene, &["room", "second", "opening"]) + inside).abs() < 1e-5);
        let scene = Scene::from_glb(&coloured_room()).expect("a scene");
        let block = 0.6 * 0.9 * 0.7;
        let v = volume(&scene, &["red", "green", "blue", "white", "block"]);
        assert!((v + 27.0 - block).abs() < 1e-5, "{v}");
        let lamp = Scene::from_glb(&two_rooms_with_a_door()).expect("a scene");
        let down = |t: &crate::path_tracer::Triangle| {
            lamp.surfaces[t.surface].emission.x == 0.0 || t.normal().y < -0.99
        };
        assert!(lamp.triangles.iter().all(down));
    }
}
