//! Tunnels and domes displaced by noise: inward-facing shells with lamps, crystals, or an opening
//! to the sky.

use glam::Vec3;

use super::kit::{Kit, place};
use super::nets::surface;
use super::plan::{draw_sky, draw_sun};
use super::random::{fractal, noise};
use super::shapes::{block, faceted, frustums, rock};
use crate::gltf::Light;

pub(super) fn make(kit: &mut Kit) {
    let n = kit.count(2, [3, 6]) as usize;
    // Domes in a row that winds, with tunnels between them.
    let mut domes: Vec<(Vec3, f32)> = Vec::new();
    let mut at = Vec3::ZERO;
    for _ in 0..n {
        let r = kit.rng.range(1.8, 3.2);
        domes.push((at, r));
        let side = kit.rng.range(-3.5, 3.5);
        at += Vec3::new(kit.rng.range(4.0, 6.0), kit.rng.range(-0.8, 0.8), side);
    }
    let tunnel = kit.rng.range(1.3, 1.8);
    let open = kit.rng.chance(0.5);
    let hole = kit.rng.int(0, n as u32 - 1) as usize;
    let seed = kit.rng.int(0, 1 << 20);
    let bump = kit.rng.range(0.15, 0.6);
    let flat = kit.rng.chance(0.5);
    let reach = Vec3::new(4.5, 4.5, 4.5);
    let lo = (domes.iter().map(|d| d.0)).fold(Vec3::INFINITY, Vec3::min) - reach;
    let hi = (domes.iter().map(|d| d.0)).fold(Vec3::NEG_INFINITY, Vec3::max) + reach;
    let cell = if kit.small() {
        0.8
    } else {
        kit.rng.range(0.4, 0.75)
    };
    let cells = ((hi - lo) / cell).ceil();
    let grid = [cells.x as usize, cells.y as usize, cells.z as usize];
    let shaft = domes[hole].0;
    // Positive in air.
    let field = |p: Vec3| {
        let ball = |(c, r): &(Vec3, f32)| r - ((p - *c) * Vec3::new(1.0, 1.15, 1.0)).length();
        let mut air = domes.iter().map(ball).fold(f32::NEG_INFINITY, f32::max);
        for w in domes.windows(2) {
            let (a, d) = (w[0].0, w[1].0 - w[0].0);
            let t = ((p - a).dot(d) / d.length_squared()).clamp(0.0, 1.0);
            air = air.max(tunnel - (p - a - d * t).length());
        }
        if open {
            let d = p - shaft;
            air = air.max(1.2 - (d * Vec3::new(1.0, 0.0, 1.0)).length() - (-d.y).max(0.0));
        }
        // A floor flat enough to walk on.
        let floor = p.y + 1.4 - 0.2 * noise(p * 0.7, seed + 9);
        air.min(floor) + bump * fractal(p * 0.6, seed)
    };
    let mut shell = surface(lo, cell, grid, field);
    if flat {
        shell = faceted(shell);
    }
    let both = kit.rng.chance(0.4);
    let level = kit.rng.range(0.3, 0.7);
    let rho = kit.rng.colour(level, 0.2);
    let stone = kit.paint_sided("stone", rho, both);
    kit.solid = false;
    kit.part("cave", &shell, stone);
    kit.solid = true;
    if open {
        kit.sky = Some(draw_sky(kit));
        if kit.rng.chance(0.7) {
            draw_sun(kit, [0.0, 360.0], [50.0, 85.0]);
        }
    }
    let dark = kit.paint("rock", rho.map(|c| c * 0.8));
    if kit.rng.chance(0.4) {
        // Water: a plane that continues behind the walls.
        let water = kit.paint("water", [0.05, 0.12, 0.15]);
        let y = -1.4 + kit.rng.range(-0.1, 0.2);
        let g = block([lo.x, y - 0.05, lo.z], [hi.x, y, hi.z]);
        kit.part("water", &g, water);
    }
    for (i, &(c, r)) in domes.iter().enumerate() {
        let around = Vec3::new(r * 0.55, 0.0, r * 0.55);
        kit.space(c - around - Vec3::Y * 1.5, c + around + Vec3::Y * 0.9);
        for k in 0..kit.count(2, [2, 7]) {
            let mut d = kit.rng.direction().with_y(0.0);
            d *= r * 0.8;
            let at = c + d - Vec3::Y * (1.4 + kit.rng.range(0.0, 0.3) + c.y * 0.8);
            if kit.rng.chance(0.6) {
                let size = kit.rng.range(0.2, 0.7);
                let g = rock(&mut kit.rng, size, 1);
                let turn = kit.rng.range(0.0, 360.0).round();
                kit.item(&format!("rock_{i}_{k}"), &[(g, dark)], place(at, turn));
            } else {
                let (h, w) = (kit.rng.range(0.5, 1.6), kit.rng.range(0.15, 0.35));
                let g = frustums(7, w, h, &[(0.0, 1.0), (0.4, 0.55), (1.0, 0.1)]);
                kit.item(&format!("stalagmite_{i}_{k}"), &[(g, dark)], place(at, 0.0));
            }
        }
        if open && i == hole {
            continue;
        }
        let target = kit.rng.range(0.2, 1.0);
        let tint = kit.rng.colour(0.7, 0.4);
        if kit.rng.chance(0.5) {
            let cd = tint.map(|t| t * target * r * r * 3.0);
            kit.add_lamp(&format!("lamp_{i}"), c, -Vec3::Y, Light::Point(cd));
        } else {
            let radiance = tint.map(|t| t * target * r * r * 25.0);
            let glow = kit.glow(&format!("crystal_{i}"), radiance);
            let g = frustums(6, 0.14, 0.9, &[(0.0, 0.7), (0.7, 1.0), (1.0, 0.1)]);
            let at = c + Vec3::new(r * 0.4, -1.5 - c.y * 0.8, -r * 0.3);
            kit.item(&format!("crystal_{i}"), &[(g, glow)], place(at, 0.0));
        }
    }
}
