//! A hotel suite lit by sky and sun only through its windows: an inner bathroom behind a door ajar,
//! tub, shower, wardrobe.

use super::kit::Kit;
use super::plan::{Edge, Plan, door_leaf, draw_sky, draw_sun, window_frame};
use super::shapes::{self, Palette};

pub(super) fn make(kit: &mut Kit) {
    let cells = if kit.small() { [1, 2] } else { [2, 2] };
    let height = kit.rng.metres(2.4, 2.9);
    let mut plan = Plan::draw(kit, cells, [2.4, 3.6], height);
    // The room at the windows is deeper.
    let deeper = kit.rng.metres(1.0, 2.2);
    for z in &mut plan.zs[1..] {
        *z += deeper;
    }
    let white = kit.rng.chance(0.3);
    plan.paint(kit, if white { [0.92, 0.98] } else { [0.55, 0.85] }, 0.06);
    for edge in &mut plan.along_x[0] {
        let sill = kit.rng.pick(&[0.05, 0.5, 0.9]);
        *edge = Edge::Windows(kit.rng.int(1, 2), sill, height - 0.3);
    }
    if !kit.small() {
        // One bedroom over the whole front; behind it a hall and a bathroom.
        plan.along_z[1][0] = if kit.rng.chance(0.7) {
            Edge::Open
        } else {
            Edge::Door(1.4)
        };
        if kit.rng.chance(0.5) {
            plan.along_x[1][1] = Edge::Wall;
        }
    }
    kit.sky = Some(draw_sky(kit));
    if kit.rng.chance(0.8) {
        draw_sun(kit, [-40.0, 40.0], [15.0, 50.0]);
    }
    let built = plan.build(kit);
    let frame = kit.paint("frame", [0.85, 0.85, 0.82]);
    let p = Palette::draw(kit, false);
    for (i, o) in built.openings.iter().enumerate() {
        if o.window {
            window_frame(kit, o, frame, &format!("window_{i}"));
        } else {
            let degrees = kit.rng.range(20.0, 100.0).round();
            door_leaf(kit, o, p.wood, degrees, &format!("door_{i}"));
        }
    }
    let gaps = [0.0, 0.0, 0.001, 0.01, 0.03];
    let front = cells[0] as usize;
    for (i, mut room) in built.rooms.into_iter().enumerate() {
        let rng = &mut kit.rng;
        let mut list = Vec::new();
        if i < front {
            list.push(("bed", shapes::bed(rng, &p)));
            list.push(("wardrobe", shapes::cupboard(rng, &p)));
            list.push(("table", shapes::table(rng, &p)));
            list.push(("chair", shapes::chair(rng, &p)));
            list.push(("sofa", shapes::sofa(rng, &p)));
        } else if i == front {
            list.push(("tub", shapes::tub(rng, &p)));
            list.push(("shower", shapes::shower(rng, &p)));
            list.push(("sink", shapes::sink(rng, &p)));
            list.push(("toilet", shapes::toilet(rng, &p)));
        } else {
            list.push(("wardrobe", shapes::cupboard(rng, &p)));
            list.push(("shelf", shapes::shelf(rng, &p)));
        }
        for (what, parts) in list {
            let gap = kit.rng.pick(&gaps);
            room.stand(kit, &format!("{what}_{i}"), &parts, gap, 0.0, false);
        }
        for k in 0..kit.rng.int(0, 2) {
            let parts = shapes::picture(&mut kit.rng, &p);
            let lift = kit.rng.metres(1.3, 1.6);
            room.stand(kit, &format!("picture_{i}_{k}"), &parts, 0.001, lift, false);
        }
    }
}
