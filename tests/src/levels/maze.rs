//! An office maze: desks between panels that coincide or stand back to back, under ceiling lamps or
//! emissive strips.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{Edge, Plan, draw_sky};
use super::shapes::{Palette, block, chair, table};

pub(super) fn make(kit: &mut Kit) {
    let n = if kit.small() {
        [2, 1]
    } else {
        [kit.rng.int(3, 7), kit.rng.int(2, 5)]
    };
    let cell = kit.rng.metres(2.0, 2.8);
    let aisle = kit.rng.metres(1.2, 1.8);
    let height = kit.rng.metres(2.5, 3.2);
    let mut plan = Plan::draw(kit, [1, 1], [5.0, 6.0], height);
    plan.xs = vec![0.0, n[0] as f32 * cell + 2.0 * aisle];
    plan.zs = vec![0.0, n[1] as f32 * (cell + aisle) + aisle];
    plan.paint(kit, [0.5, 0.9], 0.05);
    if kit.rng.chance(0.3) {
        kit.sky = Some(draw_sky(kit));
        plan.along_x[0][0] = Edge::Windows(kit.rng.int(2, 4), 0.9, 2.2);
    }
    let room = plan.build(kit).rooms.remove(0);
    let t = kit.rng.pick(&[0.0, 0.02, 0.04, 0.06]);
    let (high, lift) = (kit.rng.metres(1.2, 2.1), kit.rng.pick(&[0.0, 0.0, 0.1]));
    let level = kit.rng.range(0.3, 0.8);
    let rho = kit.rng.colour(level, 0.2);
    // Panels without thickness have two sides.
    let both = t == 0.0 || kit.rng.chance(0.3);
    let paint = kit.paint_sided("panel", rho, both);
    let panel = if t > 0.0 {
        block([0.0, lift, -t / 2.0], [cell, high, t / 2.0])
    } else {
        let p = |x: f32, y: f32| Vec3::new(x, y, 0.0);
        crate::geometry::quad([p(0.0, lift), p(cell, lift), p(cell, high), p(0.0, high)])
    };
    let panel = kit.mesh("panel", &[(panel, paint)]);
    // Each cell has its own panels: at the common border they coincide, or stand back to back.
    let back = kit.rng.pick(&[0.0, 0.0, t / 2.0, t / 2.0 + 0.001]);
    let palette = Palette::draw(kit, false);
    let desk_parts = table(&mut kit.rng, &palette);
    let desk = kit.mesh("desk", &desk_parts);
    let seat_parts = chair(&mut kit.rng, &palette);
    let seat = kit.mesh("seat", &seat_parts);
    let screen = kit.mesh(
        "screen",
        &[
            (block([-0.3, 0.1, 0.0], [0.3, 0.45, 0.03]), palette.metal),
            (block([-0.1, 0.0, -0.08], [0.1, 0.12, 0.1]), palette.metal),
        ],
    );
    let desk_top = super::shapes::bounds(&desk_parts).1.y;
    for j in 0..n[1] {
        for i in 0..n[0] {
            let x = aisle + i as f32 * cell;
            let z = aisle + j as f32 * (cell + aisle);
            let name = |what: &str| format!("{what}_{i}_{j}");
            kit.put(
                &name("back"),
                panel,
                place(Vec3::new(x, 0.0, z + back), 0.0),
            );
            let side = |x: f32| place(Vec3::new(x, 0.0, z + cell), 90.0);
            kit.put(&name("left"), panel, side(x + back));
            kit.put(&name("right"), panel, side(x + cell - back));
            if kit.rng.chance(0.35) {
                // Closed to the aisle: half of the front.
                let mut front = place(Vec3::new(x, 0.0, z + cell), 0.0);
                front.scale.x = 0.5;
                kit.put(&name("front"), panel, front);
            }
            if kit.rng.chance(0.85) {
                let gap = kit.rng.pick(&[0.0, 0.01, 0.03]) + back + t / 2.0;
                let at = Vec3::new(x + cell / 2.0, 0.0, z + gap);
                kit.put(&name("desk"), desk, place(at, 0.0));
                let at = at + Vec3::new(0.0, desk_top, 0.25);
                kit.put(&name("screen"), screen, place(at, 0.0));
                let at = Vec3::new(x + cell * 0.5, 0.0, z + cell * 0.7);
                let turn = kit.rng.range(0.0, 360.0).round();
                kit.put(&name("seat"), seat, place(at, turn));
            }
        }
    }
    // Lamps of the ceiling grid, or strips along the aisles.
    let strips = kit.rng.chance(0.4);
    let tint = [1.0, kit.rng.range(0.85, 1.0), kit.rng.range(0.75, 1.05)];
    let d = room.max - room.min;
    let (w, l) = if strips {
        (0.08, d.x * 0.9)
    } else {
        (0.6, 0.6)
    };
    let rows = ((d.z / 2.4) as u32).max(1);
    let columns = if strips {
        1
    } else {
        ((d.x / 2.4) as u32).max(1)
    };
    let target = kit.rng.range(0.3, 1.0);
    let radiance = target * room.surface() * 0.7 / (w * l * (rows * columns) as f32);
    let glow = kit.glow("light", tint.map(|c| c * radiance));
    let y = kit.rng.pick(&[0.05, 0.001, 0.3]);
    let lamp = block([-l / 2.0, -y, -w / 2.0], [l / 2.0, 0.04 - y, w / 2.0]);
    let lamp = kit.mesh("light", &[(lamp, glow)]);
    for j in 0..rows {
        for i in 0..columns {
            let at = Vec3::new(
                room.min.x + d.x * (i as f32 + 0.5) / columns as f32,
                room.max.y,
                room.min.z + d.z * (j as f32 + 0.5) / rows as f32,
            );
            kit.put(&format!("light_{i}_{j}"), lamp, place(at, 0.0));
        }
    }
}
