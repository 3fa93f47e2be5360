//! Trees, bushes, grass and ivy made of leaf cards around garden walls, under sky and sun.
//!
//! Cards of a full level have a texture with alpha; those of a small one are opaque leaves.

use glam::{Vec2, Vec3};
use image::{Rgba, RgbaImage};

use super::kit::{Kit, Mesh, Place, place};
use super::plan::{draw_sky, draw_sun};
use super::random::noise;
use super::shapes::{block, frustums, post, turned};
use crate::geometry::{Geometry, quad};
use crate::gltf::Material;

pub(super) fn make(kit: &mut Kit) {
    kit.sky = Some(draw_sky(kit));
    if kit.rng.chance(0.9) {
        draw_sun(kit, [0.0, 360.0], [25.0, 65.0]);
    }
    let half = if kit.small() {
        4.0
    } else {
        kit.rng.metres(6.0, 11.0)
    };
    let rho = kit.rng.ground();
    let ground = kit.paint("ground", rho);
    kit.part(
        "ground",
        &block([-half, -0.2, -half], [half, 0.0, half]),
        ground,
    );
    let level = kit.rng.range(0.4, 0.8);
    let rho = kit.rng.colour(level, 0.15);
    let stone = kit.paint("garden_wall", rho);
    let t = kit.rng.pick(&[0.1, 0.2, 0.3, 0.4]);
    let h = kit.rng.metres(1.0, 2.6);
    // Two walls at an angle, and a free-standing one.
    let a = half * 0.6;
    kit.part("wall_back", &block([-a, -0.05, -a], [a, h, -a + t]), stone);
    kit.part(
        "wall_left",
        &block([-a, -0.05, -a], [-a + t, h, a * 0.6]),
        stone,
    );
    kit.part(
        "wall_free",
        &block([a * 0.2, 0.0, a * 0.4], [a, h * 0.7, a * 0.4 + t]),
        stone,
    );
    let cap = kit.paint("cap", [0.5, 0.48, 0.45]);
    kit.part(
        "cap",
        &block(
            [-a - 0.05, h, -a - 0.05],
            [a + 0.05, h + 0.06, -a + t + 0.05],
        ),
        cap,
    );
    let leaf = leaves(kit);
    let bark = kit.paint("bark", [0.22, 0.16, 0.11]);
    let kinds: Vec<Mesh> = (0..kit.count(1, [1, 3]))
        .map(|i| tree(kit, leaf, bark, i))
        .collect();
    let bush = crowns(kit, 7, Vec3::Y * 0.4, 0.45, 0.9);
    let bush = kit.mesh("bush", &[(bush, leaf)]);
    let tuft = tuft(kit);
    let tuft = kit.mesh("grass", &[(tuft, leaf)]);
    let spread = |kit: &mut Kit, scale: f32| -> Place {
        let at = Vec3::new(
            kit.rng.range(-half, half) * 0.9,
            0.0,
            kit.rng.range(-half, half) * 0.9,
        );
        let mut to = place(at, kit.rng.range(0.0, 360.0).round());
        to.scale = Vec3::splat(kit.rng.range(0.7, 1.3) * scale);
        to
    };
    for k in 0..kit.count(1, [2, 6]) {
        let (mesh, to) = (kit.rng.pick(&kinds), spread(kit, 1.0));
        kit.put(&format!("tree_{k}"), mesh, to);
    }
    for k in 0..kit.count(2, [4, 14]) {
        let mut to = spread(kit, 1.0);
        if kit.rng.chance(0.5) {
            // Against the wall behind.
            to.at.z = -a + t + 0.3;
        }
        kit.put(&format!("bush_{k}"), bush, to);
    }
    for k in 0..kit.count(6, [20, 120]) {
        let to = spread(kit, 1.0);
        kit.put(&format!("grass_{k}"), tuft, to);
    }
    ivy(kit, leaf, [-a, -a + t, a, h]);
    kit.space(
        Vec3::new(-a + t + 0.5, 0.0, -a + t + 0.8),
        Vec3::new(a, 2.5, a * 0.35),
    );
    kit.space(Vec3::new(-a, 0.0, a * 0.7), Vec3::new(a, 2.5, half * 0.9));
}

/// The material of all cards.
fn leaves(kit: &mut Kit) -> usize {
    let rho = kit.rng.colour(0.3, 0.3);
    let green = [rho[0] * 0.5, rho[1], rho[2] * 0.3];
    let seed = kit.rng.int(0, 1 << 20);
    let mut m = Material {
        double_sided: true,
        ..Material::diffuse("leaves", green)
    };
    if !kit.small() {
        let picture = RgbaImage::from_fn(64, 64, |x, y| {
            let p = Vec2::new(x as f32 - 31.5, y as f32 - 31.5) / 32.0;
            let n = noise(Vec3::new(p.x, p.y, 0.0) * 5.0, seed) + 0.75 - p.length();
            let shade = (200.0 + 50.0 * noise(Vec3::new(p.x, p.y, 3.0) * 8.0, seed)) as u8;
            Rgba([shade, shade, shade, if n > 0.0 { 255 } else { 0 }])
        });
        m.texture = Some(kit.b.texture("leaves", &picture, false));
        m.mask = Some(0.5);
    }
    kit.material(&m)
}

/// A card about `middle` across `u` and `v`.
fn card(kit: &Kit, middle: Vec3, u: Vec3, v: Vec3) -> Geometry {
    let corners = if kit.small() {
        [-u, -v, u, v]
    } else {
        [-u - v, u - v, u + v, -u + v]
    };
    let mut g = quad(corners.map(|c| middle + c));
    g.uv = vec![
        Vec2::new(0.0, 1.0),
        Vec2::new(1.0, 1.0),
        Vec2::new(1.0, 0.0),
        Vec2::new(0.0, 0.0),
    ];
    g
}

/// Cards that cross each other in a ball.
fn crowns(kit: &mut Kit, n: u32, middle: Vec3, radius: f32, size: f32) -> Geometry {
    let mut out = Geometry::default();
    for _ in 0..n {
        let at = middle + kit.rng.direction() * radius * kit.rng.range(0.2, 0.8);
        let n = kit.rng.direction();
        let u = n.cross(Vec3::new(0.3, 0.9, 0.2)).normalize_or(Vec3::X);
        let half = size * kit.rng.range(0.35, 0.6);
        out.append(&card(kit, at, u * half, n.cross(u) * half));
    }
    out
}

fn tree(kit: &mut Kit, leaf: usize, bark: usize, i: u32) -> Mesh {
    let (h, r) = (kit.rng.metres(2.0, 3.5), kit.rng.metres(0.08, 0.18));
    let trunk = frustums(8, r, h, &[(-0.05, 1.3), (0.1, 1.0), (1.0, 0.6)]);
    let n = kit.count(8, [14, 40]);
    let crown = crowns(kit, n, Vec3::Y * (h + 0.3), 1.1, 1.3);
    kit.mesh(&format!("tree_{i}"), &[(trunk, bark), (crown, leaf)])
}

/// Three intersecting cards, slightly sunk in the ground.
fn tuft(kit: &mut Kit) -> Geometry {
    let mut out = Geometry::default();
    let (w, h) = (kit.rng.metres(0.15, 0.3), kit.rng.metres(0.1, 0.3));
    for i in 0..3 {
        let g = card(kit, Vec3::Y * (h - 0.02), Vec3::X * w, Vec3::Y * h);
        out.append(&g.transformed(turned(60.0 * i as f32, Vec3::ZERO)));
    }
    out
}

/// Cards on the wall or hovering in front of it, and pots at its foot.
fn ivy(kit: &mut Kit, leaf: usize, [x0, z, x1, h]: [f32; 4]) {
    let n = kit.count(3, [6, 40]);
    let off = kit.rng.pick(&[0.001, 0.01, 0.03]);
    let mut all = Geometry::default();
    for _ in 0..n {
        let at = Vec3::new(
            kit.rng.range(x0 + 0.5, x1 - 0.3),
            kit.rng.range(0.3, h - 0.2),
            z + off * kit.rng.range(1.0, 2.0),
        );
        let half = kit.rng.range(0.15, 0.4);
        all.append(&card(kit, at, Vec3::X * half, Vec3::Y * half));
    }
    kit.part("ivy", &all, leaf);
    let clay = kit.paint("clay", [0.55, 0.28, 0.18]);
    for k in 0..2 {
        let x = kit.rng.range(x0 + 0.5, x1 - 0.5);
        let g = post(
            [x, z + 0.4],
            kit.rng.pick(&[0.0, -0.02, 0.002]),
            [0.4, 0.4, 0.4],
        );
        kit.part(&format!("pot_{k}"), &g, clay);
    }
}
