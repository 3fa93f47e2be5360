//! Small scenes with closed-form irradiance, and the closed forms.
//!
//! Lengths are in metres; floors are at y = 0 and face up. E is in the units of the lights.

mod emissive_texture;
mod exchange;
mod stage;

pub use emissive_texture::*;
pub use exchange::*;
pub use stage::Stage;

use glam::{DVec3, Vec3};

use crate::geometry::{Geometry, box_faces, cuboid, grid, icosphere, quad};
use crate::gltf::{GltfBuilder, Light, Material, Node, look_along};
use crate::textures;

/// A floor of `size` × `size` metres around the origin in `n` × `n` cells; black, so that it
/// reflects nothing.
fn floor(b: &mut GltfBuilder, size: f32, n: u32) {
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let h = size / 2.0;
    let g = grid(
        Vec3::new(-h, 0.0, h),
        Vec3::X * size,
        Vec3::Z * -size,
        [n, n],
    )
    .bare();
    let mesh = b.mesh("floor", &[(&g, black)]);
    b.node(Node::of_mesh("floor", mesh));
}

fn light(b: &mut GltfBuilder, light: Light, at: Vec3, along: Vec3) {
    let index = b.light("light", light);
    b.node(Node {
        name: "light".into(),
        translation: at,
        rotation: look_along(along, Vec3::Y),
        light: Some(index),
        ..Node::default()
    });
}

/// A point light of `candela` at `height` over the middle of a black 4 m floor: see
/// [`point_irradiance`].
pub fn point_over_floor(candela: f32, height: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    floor(&mut b, 4.0, 1);
    light(
        &mut b,
        Light::Point([candela; 3]),
        Vec3::Y * height,
        Vec3::NEG_Y,
    );
    b.finish()
}

/// E = I·cosθ/d² = I·h/(h² + r²)^{3/2} on the floor at distance `r` from the foot of a point light.
pub fn point_irradiance(candela: f64, height: f64, r: f64) -> f64 {
    candela * height / (height * height + r * r).powf(1.5)
}

/// A spot of `candela` at `height` that shines straight down with half-angles `inner` and `outer`
/// (radians).
///
/// E = [`point_irradiance`] × (clamp((cosθ − cos outer)/(cos inner − cos outer), 0, 1))², the
/// falloff that the extension's text recommends (Khronos, `KHR_lights_punctual`, "Inner and Outer
/// Cone Angles").
pub fn spot_over_floor(candela: f32, height: f32, inner: f32, outer: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    floor(&mut b, 4.0, 1);
    light(
        &mut b,
        Light::Spot([candela; 3], inner, outer),
        Vec3::Y * height,
        Vec3::NEG_Y,
    );
    b.finish()
}

/// Parallel light of `lux` travelling along `direction` on a black 4 m floor: E = lux ·
/// (−direction.y)/|direction|.
pub fn sun_over_floor(lux: f32, direction: Vec3) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    floor(&mut b, 4.0, 1);
    light(&mut b, Light::Directional([lux; 3]), Vec3::Y, direction);
    b.finish()
}

/// A square emitter of side `side` and radiance `radiance` at `height` over a black 4 m floor: see
/// [`polygon_irradiance`].
pub fn rectangle_over_floor(radiance: f32, side: f32, height: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    floor(&mut b, 4.0, 1);
    let lamp = b.material(&Material::emitter("lamp", [radiance; 3], [0.0; 3]));
    let mesh = b.mesh(
        "lamp",
        &[(
            &quad(square(side.into(), height.into()).map(|p| p.as_vec3())).bare(),
            lamp,
        )],
    );
    b.node(Node::of_mesh("lamp", mesh));
    b.finish()
}

/// A light of `EXT_lights_area` at `height` over a black floor of 4 m, shining down; its node's
/// scale is `scale`.
pub fn area_light_over_floor(light: serde_json::Value, height: f32, scale: Vec3) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    floor(&mut b, 4.0, 1);
    b.root_extension("EXT_lights_area", serde_json::json!({"lights": [light]}));
    let node = b.node(Node {
        name: "lamp node".into(),
        translation: Vec3::Y * height,
        // Its x axis stays the world's.
        rotation: look_along(Vec3::NEG_Y, Vec3::NEG_Z),
        scale,
        ..Node::default()
    });
    b.node_json(node)["extensions"] = serde_json::json!({"EXT_lights_area": {"light": 0}});
    b.finish()
}

/// Corners of the emitter of [`rectangle_over_floor`], front down.
pub fn square(side: f64, height: f64) -> [DVec3; 4] {
    let s = side / 2.0;
    [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, z)| DVec3::new(x, height, z))
}

/// E at `p` with unit normal `n` from a polygon of uniform radiance that is entirely above p's
/// horizon, with corners in either order.
///
/// E = L/2 · |Σ Γ_i · n|, where Γ_i is the angle that edge i subtends times the unit normal of its
/// plane with p (Lambert 1760; Baum, Rushmeier and Winget 1989). The angle is `atan2(|a×b|, a·b)`.
/// NaN if p is on an edge's line.
pub fn polygon_irradiance(radiance: f64, corners: &[DVec3], p: DVec3, n: DVec3) -> f64 {
    let sum: f64 = (0..corners.len())
        .map(|i| {
            let (a, b) = (corners[i] - p, corners[(i + 1) % corners.len()] - p);
            let c = a.cross(b);
            c.length().atan2(a.dot(b)) * c.normalize().dot(n)
        })
        .sum();
    radiance / 2.0 * sum.abs()
}

/// A black box without a lid, `side` metres square and `depth` deep, under a uniform sky of
/// radiance L; nothing else.
///
/// Its fronts face inwards; the opening is at y = 0. Every point inside sees the sky through the
/// opening only, so E is [`polygon_irradiance`] of [`mouth`], on the floor and on the walls. For a
/// depth near 0, the floor's E tends to πL, and that of the top of a wall to πL/2. One node `box`.
pub fn sky_over_open_box(side: f32, depth: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let h = side / 2.0;
    let [left, right, bottom, _, back, front] =
        box_faces(Vec3::new(-h, -depth, -h), Vec3::new(h, 0.0, h), 1);
    let inside = Geometry::union(&[left, right, bottom, back, front])
        .flipped()
        .bare();
    let mesh = b.mesh("box", &[(&inside, black)]);
    b.node(Node::of_mesh("box", mesh));
    b.finish()
}

/// Corners of the opening of [`sky_over_open_box`].
pub fn mouth(side: f64) -> [DVec3; 4] {
    square(side, 0.0)
}

/// Two 1 m squares that face each other across `gap` metres; the upper one (`lamp`) emits
/// `radiance`, the lower one (`plate`) is black.
///
/// In the middle E = [`polygon_irradiance`], which tends to πL as the gap closes. The mean over the
/// plate is πL·F, where F is the form factor of opposed squares (0.199825 at gap 1; Howell,
/// catalogue of configuration factors, C-11).
pub fn facing_plates(radiance: f32, gap: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let lamp = b.material(&Material::emitter("lamp", [radiance; 3], [0.0; 3]));
    let black = b.material(&Material::diffuse("black", [0.0; 3]));
    let up = grid(Vec3::new(-0.5, 0.0, 0.5), Vec3::X, -Vec3::Z, [1, 1]).bare();
    let down = quad(square(1.0, f64::from(gap)).map(|p| p.as_vec3())).bare();
    for (name, g, m) in [("plate", &up, black), ("lamp", &down, lamp)] {
        let mesh = b.mesh(name, &[(g, m)]);
        b.node(Node::of_mesh(name, mesh));
    }
    b.finish()
}

/// Mean of E/(πL) over one of two opposed unit squares at distance `d` (Howell C-11, a = b = 1).
pub fn form_factor_opposed_squares(d: f64) -> f64 {
    let x = 1.0 / d;
    let s = (1.0 + x * x).sqrt();
    let log = (((1.0 + x * x).powi(2)) / (1.0 + 2.0 * x * x)).sqrt().ln();
    2.0 / (std::f64::consts::PI * x * x) * (log + 2.0 * x * s * (x / s).atan() - 2.0 * x * x.atan())
}

/// A sphere of radius 1 m seen from inside. Its cap of z > `cap` emits `radiance`, and everything
/// reflects `rho`.
///
/// F_ij = A_j/(4πR²) for every pair, so B = M_e + ρ·mean(M_e)/(1−ρ) and E = mean(M_e)/(1−ρ)
/// everywhere, with M_e = πL on the cap. The mean is over the facets; [`sphere_interior`] returns
/// the emitting share of their area. The sphere has `20·4^level` flat facets, so E deviates by the
/// order of their angle squared (4^−level). Returns the GLB and that share.
pub fn sphere_interior(radiance: f32, rho: f32, cap: f32, level: u32) -> (Vec<u8>, f64) {
    let whole = icosphere(Vec3::ZERO, 1.0, level).flipped();
    let high = |g: &Geometry, t: &[u32; 3]| {
        t.iter().map(|&i| g.positions[i as usize].z).sum::<f32>() / 3.0 > cap
    };
    let (mut lit, mut dark) = (whole.clone(), whole.clone());
    lit.triangles.retain(|t| high(&whole, t));
    dark.triangles.retain(|t| !high(&whole, t));
    let share = lit.area() / whole.area();
    let mut b = GltfBuilder::new();
    let lamp = b.material(&Material::emitter("lamp", [radiance; 3], [rho; 3]));
    let grey = b.material(&Material::diffuse("grey", [rho; 3]));
    let mesh = b.mesh("sphere", &[(&dark, grey), (&lit, lamp)]);
    b.node(Node::of_mesh("sphere", mesh));
    (b.finish(), share)
}

/// Sunlight straight down through a horizontal MASK screen (2 m, checker of 8 × 8 squares) 1 m
/// above a black 4 m floor.
///
/// Under a hole E = `lux`, under a square 0; holes are half of the screen. The square with a corner
/// at (−1, ·, −1) is opaque; squares are 25 cm wide. Node names: `floor`, `screen`.
pub fn masked_checker_screen(lux: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    floor(&mut b, 4.0, 1);
    let texture = b.texture("checker", &textures::masked_checker(64, 8), true);
    let screen = b.material(&Material {
        texture: Some(texture),
        mask: Some(0.5),
        double_sided: true,
        ..Material::diffuse("screen", [0.0; 3])
    });
    let mut g = grid(
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::Z * 2.0,
        Vec3::X * 2.0,
        [1, 1],
    );
    // The picture's top left corner is the opaque square: u along +X, v along +Z.
    g.uv = g
        .positions
        .iter()
        .map(|p| glam::Vec2::new((p.x + 1.0) / 2.0, (p.z + 1.0) / 2.0))
        .collect();
    let mesh = b.mesh("screen", &[(&g, screen)]);
    b.node(Node::of_mesh("screen", mesh));
    light(
        &mut b,
        Light::Directional([lux; 3]),
        Vec3::Y * 2.0,
        Vec3::NEG_Y,
    );
    b.finish()
}

/// A wavy field of `2·side²` triangles (one million at side 708) under a sun, in one primitive: a
/// load test, not a closed form.
pub fn many_triangles(side: u32) -> Vec<u8> {
    let mut g = grid(
        Vec3::new(-10.0, 0.0, 10.0),
        Vec3::X * 20.0,
        Vec3::Z * -20.0,
        [side, side],
    )
    .bare();
    for p in &mut g.positions {
        let (x, z) = (f64::from(p.x), f64::from(p.z));
        p.y = ((x * 1.7).sin() * (z * 1.3).cos() * 0.5) as f32;
    }
    let mut b = GltfBuilder::new();
    let grass = b.material(&Material::diffuse("field", [0.4; 3]));
    let mesh = b.mesh("field", &[(&g, grass)]);
    b.node(Node::of_mesh("field", mesh));
    light(
        &mut b,
        Light::Directional([3.0; 3]),
        Vec3::Y * 5.0,
        Vec3::new(-0.3, -0.8, 0.5),
    );
    b.finish()
}

/// One white triangle of 1 m legs on the floor under a sun of 1 lux straight down: E = 1 on it.
pub fn one_triangle() -> Vec<u8> {
    let g = Geometry {
        positions: vec![Vec3::ZERO, Vec3::Z, Vec3::X],
        triangles: vec![[0, 1, 2]],
        ..Geometry::default()
    };
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.8; 3]));
    let mesh = b.mesh("triangle", &[(&g, white)]);
    b.node(Node::of_mesh("triangle", mesh));
    light(&mut b, Light::Directional([1.0; 3]), Vec3::Y, Vec3::NEG_Y);
    b.finish()
}

/// A lamp panel over a floor with a wall between two halves, `thickness` metres thick: light must
/// not cross the wall.
///
/// Both halves are closed, 3 × 3 m and 2.5 m high; only the one at x < 0 has a lamp. E is exactly 0
/// on the faces of node `dark_room`. Node names: `lit_room`, `dark_room`; the rooms' skins are
/// `thickness` apart at x = 0.
pub fn two_rooms(thickness: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let white = b.material(&Material::diffuse("white", [0.7; 3]));
    let lamp = b.material(&Material::emitter("lamp", [5.0; 3], [0.0; 3]));
    let t = thickness / 2.0;
    let lit = cuboid(Vec3::new(-3.0 - t, 0.0, 0.0), Vec3::new(-t, 2.5, 3.0), 1)
        .flipped()
        .bare();
    let dark = cuboid(Vec3::new(t, 0.0, 0.0), Vec3::new(3.0 + t, 2.5, 3.0), 1)
        .flipped()
        .bare();
    let y = 2.45;
    let panel = quad([
        Vec3::new(-2.0, y, 1.0),
        Vec3::new(-1.0, y, 1.0),
        Vec3::new(-1.0, y, 2.0),
        Vec3::new(-2.0, y, 2.0),
    ]);
    let lit_mesh = b.mesh("lit_room", &[(&lit, white), (&panel.bare(), lamp)]);
    b.node(Node::of_mesh("lit_room", lit_mesh));
    let dark_mesh = b.mesh("dark_room", &[(&dark, white)]);
    b.node(Node::of_mesh("dark_room", dark_mesh));
    b.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_forms_for_opposed_squares_agree() {
        // The midpoint rule over 64² points of the plate has an error of order h², about 1e-5 here.
        let n = 64;
        for d in [0.5, 1.0, 2.0, 5.0] {
            let corners = square(1.0, d);
            let mut mean = 0.0;
            for i in 0..n * n {
                let at = |k: i32| (f64::from(k) + 0.5) / f64::from(n) - 0.5;
                mean += polygon_irradiance(
                    1.0,
                    &corners,
                    DVec3::new(at(i % n), 0.0, at(i / n)),
                    DVec3::Y,
                );
            }
            mean /= f64::from(n * n) * std::f64::consts::PI;
            let exact = form_factor_opposed_squares(d);
            assert!((mean / exact - 1.0).abs() < 1e-4, "d {d}: {mean} {exact}");
        }
        assert!((form_factor_opposed_squares(1.0) - 0.199825).abs() < 1e-6);
    }

    #[test]
    fn the_emitter_faces_the_floor() {
        let g = quad(square(1.0, 1.0).map(|p| p.as_vec3()));
        assert!(g.normals[0].y < -0.99);
    }

    #[test]
    fn a_far_point_light_and_a_far_emitter_agree() {
        // To the order of (0.01)², a square of side 0.01 seen from 1 m is a point of I = L·A.
        let e = polygon_irradiance(1.0, &square(0.01, 1.0), DVec3::new(0.3, 0.0, 0.0), DVec3::Y);
        // The emitter's cosine equals the receiver's.
        let cos = 1.0 / 1.09f64.sqrt();
        assert!((e / (point_irradiance(1e-4, 1.0, 0.3) * cos) - 1.0).abs() < 1e-4);
    }
}
