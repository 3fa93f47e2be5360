//! White rooms with windows to sky and sun: frames, sills, skirtings, curtain boxes, furniture.

use glam::Vec3;

use super::kit::Kit;
use super::plan::{Edge, Joint, Plan, draw_sky, draw_sun, window_frame};
use super::shapes::{Palette, block, picture};

pub(super) fn make(kit: &mut Kit) {
    let cells = if kit.small() {
        [1, 1]
    } else {
        [kit.rng.int(1, 3), 1]
    };
    let height = kit.rng.metres(2.5, 3.4);
    let mut plan = Plan::draw(kit, cells, [3.5, 6.5], height);
    let white = kit.rng.pick(&[0.8, 0.9, 0.95, 0.98]);
    plan.paint(kit, [white, white], 0.005);
    if kit.rng.chance(0.4) {
        plan.ground = kit.paint_sided("white_floor", [white; 3], plan.style.double_sided);
    }
    for edge in &mut plan.along_x[0] {
        let sill = kit.rng.pick(&[0.0, 0.4, 0.9]);
        *edge = Edge::Windows(kit.rng.int(1, 3), sill, height - kit.rng.metres(0.2, 0.5));
    }
    if kit.rng.chance(0.3) {
        plan.along_z[0][0] = Edge::Windows(1, 0.9, 2.0);
    }
    if plan.style.joint == Joint::Short && kit.rng.chance(0.5) {
        plan.style.joint = Joint::Abut;
    }
    kit.sky = Some(draw_sky(kit));
    if kit.rng.chance(0.75) {
        draw_sun(kit, [-45.0, 45.0], [15.0, 55.0]);
    }
    if kit.rng.chance(0.3) {
        let ground = kit.paint("ground", [0.3, 0.32, 0.25]);
        let y = -plan.style.thickness - 0.01;
        let g = block([-30.0, y - 0.1, -30.0], [40.0, y, 30.0]);
        kit.part("ground", &g, ground);
    }
    let built = plan.build(kit);
    let frame = kit.paint("frame", [0.9, 0.9, 0.88]);
    for (i, o) in built.openings.iter().enumerate() {
        if o.window && kit.rng.chance(0.85) {
            window_frame(kit, o, frame, &format!("window_{i}"));
        }
    }
    let palette = Palette::draw(kit, false);
    for (i, mut room) in built.rooms.into_iter().enumerate() {
        curtain_box(kit, room.min, room.max, frame, i);
        skirting(kit, room.min, room.max, frame, i);
        if kit.rng.chance(0.3) {
            let target = kit.rng.range(0.05, 0.4);
            room.light(kit, &format!("lamp_{i}"), target);
        }
        let n = kit.count(2, [3, 9]);
        room.furnish(kit, &palette, n, &[0.0, 0.001, 0.02, 0.1], &[0.0]);
        for k in 0..kit.count(1, [0, 3]) {
            let parts = picture(&mut kit.rng, &palette);
            let lift = kit.rng.metres(1.3, 1.7);
            let gap = kit.rng.pick(&[0.0, 0.001, 0.01]);
            // Only where no furniture stands before it.
            room.stand(kit, &format!("picture_{i}_{k}"), &parts, gap, lift, false);
        }
    }
}

/// A board below the ceiling that hides curtain rails: a slot that light hardly enters.
fn curtain_box(kit: &mut Kit, min: Vec3, max: Vec3, paint: usize, i: usize) {
    if kit.rng.chance(0.5) {
        return;
    }
    let (drop, off) = (kit.rng.metres(0.08, 0.2), kit.rng.metres(0.1, 0.25));
    let t = kit.rng.pick(&[0.01, 0.02]);
    let z = min.z + off;
    let board = block([min.x, max.y - drop, z], [max.x, max.y, z + t]);
    kit.part(&format!("curtain_box_{i}"), &board, paint);
}

/// Boards along the foot of the two walls that have no doors.
fn skirting(kit: &mut Kit, min: Vec3, max: Vec3, paint: usize, i: usize) {
    if kit.rng.chance(0.4) {
        return;
    }
    let (t, h) = (0.012, kit.rng.metres(0.05, 0.12));
    let board = block([min.x, min.y, max.z - t], [max.x, min.y + h, max.z]);
    kit.part(&format!("skirting_{i}"), &board, paint);
}
