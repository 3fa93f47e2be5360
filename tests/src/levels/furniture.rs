//! Rooms full of furniture that is flush with walls, sunk in them, hovering by 1 mm to 2 cm, and
//! intersecting other furniture.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{Edge, Plan, draw_sky, draw_sun, window_frame};
use super::shapes::{self, Palette, block, column, post};
use crate::geometry::quad;
use crate::gltf::Light;

pub(super) fn make(kit: &mut Kit) {
    let cells = if kit.small() {
        [1, 1]
    } else {
        [kit.rng.int(1, 2), 1]
    };
    let height = kit.rng.metres(2.4, 3.0);
    let mut plan = Plan::draw(kit, cells, [3.8, 6.0], height);
    plan.paint(kit, [0.5, 0.95], 0.1);
    let day = kit.rng.chance(0.5);
    if day {
        kit.sky = Some(draw_sky(kit));
        if kit.rng.chance(0.6) {
            draw_sun(kit, [-40.0, 40.0], [20.0, 50.0]);
        }
        plan.along_x[0][0] = Edge::Windows(kit.rng.int(1, 2), 0.8, 2.1);
    }
    let built = plan.build(kit);
    let p = Palette::draw(kit, plan.style.double_sided);
    for (k, o) in built.openings.iter().enumerate() {
        if o.window {
            window_frame(kit, o, p.pale, &format!("window_{k}"));
        }
    }
    let gaps = [-0.05, -0.01, 0.0, 0.0, 0.001, 0.005, 0.02];
    let lifts = [-0.03, -0.005, 0.0, 0.0, 0.001, 0.005, 0.02];
    for (i, mut room) in built.rooms.into_iter().enumerate() {
        if !day || i > 0 || kit.rng.chance(0.4) {
            let target = kit.rng.range(0.2, 0.9);
            room.light(kit, &format!("lamp_{i}"), target);
        }
        if kit.rng.chance(0.6) {
            let parts = shapes::shower(&mut kit.rng, &p);
            let gap = kit.rng.pick(&gaps);
            room.stand(kit, &format!("booth_{i}"), &parts, gap, 0.0, false);
        }
        let n = kit.count(3, [5, 14]);
        room.furnish(kit, &p, n, &gaps, &lifts);
        carpet(kit, &p, room.min, room.max, i);
        standing_lamp(kit, &p, &mut room, i);
        for k in 0..kit.count(1, [2, 5]) {
            let parts = shapes::picture(&mut kit.rng, &p);
            let lift = kit.rng.metres(1.3, 1.7);
            let gap = kit.rng.pick(&[0.0, 0.001, 0.005, 0.01, -0.01]);
            room.stand(kit, &format!("picture_{i}_{k}"), &parts, gap, lift, false);
        }
        // Boxes that intersect whatever is there.
        for k in 0..kit.count(1, [1, 5]) {
            let (w, h) = (kit.rng.metres(0.2, 0.5), kit.rng.metres(0.2, 0.9));
            let Some(t) = room
                .taken
                .get(kit.rng.int(0, room.taken.len() as u32) as usize)
            else {
                continue;
            };
            let at = Vec3::new(t[0], room.min.y, t[2]);
            let g = post([0.0, 0.0], 0.0, [w, h, w]);
            let at = at.clamp(room.min, room.max);
            let turn = kit.rng.pick(&[0.0, 0.0, 20.0, 45.0]);
            kit.item(&format!("box_{i}_{k}"), &[(g, p.accent)], place(at, turn));
        }
    }
}

/// A carpet: a hovering plane, or a thin box, flush with a wall or not.
fn carpet(kit: &mut Kit, p: &Palette, min: Vec3, max: Vec3, i: usize) {
    let d = max - min;
    let a = Vec3::new(kit.rng.range(0.0, 0.3), 0.0, kit.rng.range(0.1, 0.3)) * d + min;
    let b = a + d * Vec3::new(0.5, 0.0, 0.5);
    let y = min.y;
    let g = match kit.rng.int(0, 2) {
        0 => {
            let y = y + kit.rng.pick(&[0.001, 0.003, 0.01]);
            let q = |x: f32, z: f32| Vec3::new(x, y, z);
            quad([q(a.x, a.z), q(a.x, b.z), q(b.x, b.z), q(b.x, a.z)])
        }
        1 => block([a.x, y, a.z], [b.x, y + 0.01, b.z]),
        _ => block([a.x, y - 0.01, a.z], [b.x, y + 0.005, b.z]),
    };
    kit.part(&format!("carpet_{i}"), &g, p.cloth);
}

/// A lamp with a shade open above and below, and a bulb or a point in it.
fn standing_lamp(kit: &mut Kit, p: &Palette, room: &mut super::plan::Room, i: usize) {
    let mut parts = shapes::floor_lamp(&mut kit.rng, p);
    let h = shapes::bounds(&parts).1.y;
    let n = kit.rng.int(6, 14);
    let shade = kit.paint_sided("shade", [0.8, 0.75, 0.65], true);
    let mut open = column(n, 0.2, [h - 0.1, h + 0.2]).moved(Vec3::Z * 0.25);
    open.triangles
        .retain(|t| open.normals[t[0] as usize].y.abs() < 0.5);
    parts.push((open, shade));
    let target = kit.rng.range(0.05, 0.3) * room.surface();
    let bulb = kit.rng.chance(0.6);
    if bulb {
        let glow = kit.glow("bulb", [1.0, 0.8, 0.55].map(|c| c * target / 0.03));
        let g = crate::geometry::icosphere(Vec3::new(0.0, h + 0.06, 0.25), 0.04, 1);
        parts.push((shapes::faceted(g), glow));
    }
    let name = format!("standing_lamp_{i}");
    let Some(to) = room.stand(kit, &name, &parts, 0.05, 0.0, false) else {
        return;
    };
    if !bulb {
        let (s, c) = super::random::sin_cos(to.turn);
        let at = to.at + Vec3::new(s * 0.25, h + 0.06, c * 0.25);
        let cd = [1.0, 0.8, 0.55].map(|c| c * target / 6.0);
        kit.add_lamp(&format!("light_{i}"), at, -Vec3::Y, Light::Point(cd));
    }
}
