//! Rooms of wall boxes that overlap, abut or fall short by a millimetre, with crates and ramps: the
//! first draft of a level designer.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{Edge, Plan, draw_sky, draw_sun};
use super::shapes::{block, post, stairs, tilted};

pub(super) fn make(kit: &mut Kit) {
    let cells = if kit.small() {
        [1, 1]
    } else {
        kit.rng.pick(&[[1, 1], [2, 1], [1, 2], [2, 2], [3, 1]])
    };
    let height = kit.rng.metres(2.4, 4.0);
    let mut plan = Plan::draw(kit, cells, [3.0, 7.0], height);
    let white = kit.rng.chance(0.25);
    let level = if white { [0.9, 0.98] } else { [0.35, 0.8] };
    plan.paint(kit, level, if white { 0.01 } else { 0.15 });
    let sky = kit.rng.chance(0.35);
    if sky {
        kit.sky = Some(draw_sky(kit));
        plan.along_x[0][0] = Edge::Windows(kit.rng.int(1, 2), 0.9, 2.1);
        if kit.rng.chance(0.6) {
            draw_sun(kit, [-40.0, 40.0], [20.0, 55.0]);
        }
    }
    let both = plan.style.double_sided;
    let built = plan.build(kit);
    let crates = [0.25, 0.45, 0.65].map(|level| {
        let rho = kit.rng.colour(level, 0.4);
        kit.paint_sided("crate", rho, both)
    });
    for (i, mut room) in built.rooms.into_iter().enumerate() {
        if !sky || i > 0 || kit.rng.chance(0.4) {
            let target = kit.rng.range(0.2, 1.2);
            room.light(kit, &format!("lamp_{i}"), target);
        }
        let n = kit.count(3, [2, 9]);
        for k in 0..n {
            let paint = kit.rng.pick(&crates);
            let (w, h) = (kit.rng.metres(0.3, 1.2), kit.rng.metres(0.3, 1.5));
            let parts = match kit.rng.int(0, 5) {
                0 => {
                    let (n, w) = (kit.rng.int(3, 8), kit.rng.metres(0.8, 1.4));
                    let overlap = kit.rng.pick(&[0.0, 0.05, 0.3]);
                    vec![(stairs(n, 0.18, 0.28, w, overlap, true), paint)]
                }
                1 => {
                    // A ramp stands in the floor.
                    let ramp = block([-w / 2.0, -0.1, 0.0], [w / 2.0, 0.0, 1.6]);
                    let ramp = ramp.transformed(tilted(20.0)).moved(Vec3::Y * 0.547);
                    vec![(ramp, paint)]
                }
                2 => {
                    let pillar = post([0.0, 0.2], 0.0, [0.4, height, 0.4]);
                    vec![(pillar, paint)]
                }
                _ => vec![(post([0.0, w / 2.0], 0.0, [w, h, w]), paint)],
            };
            let gap = kit.rng.pick(&[0.0, 0.0, 0.001, 0.02, -0.05, 0.3]);
            let lift = kit.rng.pick(&[0.0, 0.0, 0.0, 0.001, -0.02]);
            let free = kit.rng.chance(0.4);
            let to = room.stand(kit, &format!("crate_{i}_{k}"), &parts, gap, lift, free);
            // Crates on crates.
            if let Some(to) = to
                && kit.rng.chance(0.3)
            {
                let top = post([0.0, w / 2.0], 0.0, [w * 0.7, w * 0.6, w * 0.6]);
                let turn = to.turn + kit.rng.pick(&[0.0, 15.0]);
                let at = to.at + Vec3::Y * h;
                let name = format!("crate_{i}_{k}_top");
                if parts[0].0.positions.len() == 24 {
                    kit.item(&name, &[(top, paint)], place(at, turn));
                }
            }
        }
    }
}
