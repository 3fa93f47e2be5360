//! Halls and corridors with columns under few or many lamps: points, spots, bulbs, long strips,
//! white and coloured.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::Plan;
use super::shapes::{Palette, block, column, faceted, post};
use crate::geometry::icosphere;
use crate::gltf::Light;

pub(super) fn make(kit: &mut Kit) {
    let corridor = kit.rng.chance(0.4);
    let (w, d) = if kit.small() {
        (4.0, 5.0)
    } else if corridor {
        (kit.rng.metres(2.0, 3.0), kit.rng.metres(12.0, 28.0))
    } else {
        (kit.rng.metres(6.0, 14.0), kit.rng.metres(8.0, 18.0))
    };
    let height = if corridor {
        kit.rng.metres(2.4, 3.2)
    } else {
        kit.rng.metres(3.0, 6.0)
    };
    let mut plan = Plan::draw(kit, [1, 1], [3.0, 4.0], height);
    (plan.xs, plan.zs) = (vec![0.0, w], vec![0.0, d]);
    plan.paint(kit, [0.4, 0.9], 0.08);
    let mut room = plan.build(kit).rooms.remove(0);
    let p = Palette::draw(kit, false);
    // Columns in two rows, or pilasters along the walls.
    let step = kit.rng.metres(2.2, 3.5);
    let sides = kit.rng.pick(&[4, 8, 12, 24]);
    let r = kit.rng.metres(0.12, 0.35);
    let mut parts = vec![(column(sides, r, [0.0, height]), p.pale)];
    if kit.rng.chance(0.6) {
        let base = [r * 2.6, 0.2, r * 2.6];
        parts.push((post([0.0, 0.0], 0.0, base), p.pale));
        parts.push((post([0.0, 0.0], height - 0.2, base), p.pale));
    }
    let pillar = kit.mesh("column", &parts);
    let inset = if corridor { 0.0 } else { w * 0.25 };
    let n = (d / step) as u32;
    for k in 0..n {
        let z = d * (k as f32 + 0.5) / n as f32;
        for (side, x) in [("left", inset), ("right", w - inset)] {
            let at = Vec3::new(x, 0.0, z);
            kit.put(&format!("column_{side}_{k}"), pillar, place(at, 0.0));
            let e = r * 1.3;
            room.taken.push([x - e, x + e, z - e, z + e]);
        }
    }
    let n = kit.count(2, [1, 6]);
    room.furnish(kit, &p, n, &[0.0, 0.02], &[0.0]);
    let n = if kit.small() {
        kit.rng.int(3, 8)
    } else {
        kit.rng.pick(&[1, 2, 4, 8, 16, 40, 80, 150])
    };
    let target = kit.rng.range(0.3, 1.2) * room.surface() / n as f32;
    let coloured = kit.rng.chance(0.4);
    // One kind for all, or any.
    let kind = kit.rng.int(0, 4);
    for k in 0..n {
        let tint = if coloured {
            kit.rng.colour(0.6, 0.9)
        } else {
            [1.0, 0.92, 0.8]
        };
        let kind = if kind == 4 { kit.rng.int(0, 3) } else { kind };
        // One in the middle, rows along the hall, or at random.
        let z = d * (k as f32 + 0.5) / n as f32;
        let x = w * kit.rng.pick(&[0.5, 0.15, 0.85, 0.4]);
        let at = Vec3::new(x.clamp(0.35, w - 0.35), height, z);
        lamp(kit, k, kind, at, tint.map(|c| c * target));
    }
}

/// One lamp under the ceiling at `at`; `light` is approximately the flux over 4π.
fn lamp(kit: &mut Kit, k: u32, kind: u32, at: Vec3, light: [f32; 3]) {
    let name = format!("lamp_{k}");
    match kind {
        0 => {
            let at = at - Vec3::Y * kit.rng.range(0.2, 0.8);
            let cd = light.map(|c| c / 5.0);
            kit.add_lamp(&name, at, -Vec3::Y, Light::Point(cd));
        }
        1 => {
            let lean = kit.rng.direction() * 0.5;
            let outer = kit.rng.range(0.4, 1.1);
            let inner = outer * kit.rng.range(0.3, 0.9);
            let cd = light.map(|c| c / (5.0 * outer * outer));
            let spot = Light::Spot(cd, inner, outer);
            kit.add_lamp(&name, at - Vec3::Y * 0.1, lean - Vec3::Y, spot);
        }
        2 => {
            let r = kit.rng.range(0.02, 0.08);
            let radiance = light.map(|c| c * 0.6 / (12.6 * r * r));
            let glow = kit.glow(&name, radiance);
            let g = faceted(icosphere(Vec3::ZERO, r, 1));
            let at = at - Vec3::Y * (r + kit.rng.range(0.02, 0.6));
            kit.item(&name, &[(g, glow)], place(at, 0.0));
        }
        _ => {
            let l = kit.rng.range(0.5, 2.5);
            let radiance = light.map(|c| c * 0.6 / (l * 0.04));
            let glow = kit.glow(&name, radiance);
            let g = block([-0.02, -0.02, -l / 2.0], [0.02, 0.0, l / 2.0]);
            let turn = kit.rng.pick(&[0.0, 90.0]);
            // Strips end short of the walls only by chance, because people let them intersect
            // walls.
            let at = at - Vec3::Y * kit.rng.pick(&[0.0, 0.001, 0.3]);
            kit.item(&name, &[(g, glow)], place(at, turn));
        }
    }
}
