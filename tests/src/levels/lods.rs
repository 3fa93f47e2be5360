//! Objects with three levels of detail in one place, and variants of an object, in a lit room, as
//! exporters write them.

use glam::Vec3;

use super::kit::Kit;
use super::plan::Plan;
use super::shapes::{Palette, Parts, chair, cupboard, frustums, rock_of, table};
use crate::geometry::Geometry;

pub(super) fn make(kit: &mut Kit) {
    let height = kit.rng.metres(2.6, 4.0);
    let cells = if kit.small() {
        [1, 1]
    } else {
        kit.rng.pick(&[[1, 1], [2, 1]])
    };
    let mut plan = Plan::draw(kit, cells, [4.0, 6.5], height);
    plan.paint(kit, [0.5, 0.85], 0.1);
    let both = plan.style.double_sided && kit.rng.chance(0.5);
    let p = Palette::draw(kit, both);
    let built = plan.build(kit);
    for (i, mut room) in built.rooms.into_iter().enumerate() {
        let target = kit.rng.range(0.3, 1.0);
        room.light(kit, &format!("lamp_{i}"), target);
        for k in 0..kit.count(2, [3, 8]) {
            let name = format!("thing_{i}_{k}");
            let paint = kit.rng.pick(&[p.wood, p.pale, p.accent, p.cloth]);
            // Coarser levels are inside, outside or across the finest one.
            let grow = kit.rng.pick(&[0.0, 0.0, 0.01, -0.02]);
            if kit.rng.chance(0.25) {
                variants(kit, &p, &mut room, &name);
                continue;
            }
            let kind = kit.rng.int(0, 2);
            let (r, h) = (kit.rng.metres(0.25, 0.6), kit.rng.metres(0.6, 1.6));
            let seed = kit.rng.int(0, 1 << 20);
            let squeeze = Vec3::new(1.0, kit.rng.range(0.6, 1.2), kit.rng.range(0.8, 1.2));
            let lod = |level: u32| -> Geometry {
                let r = r + grow * level as f32;
                match kind {
                    0 => {
                        let g = rock_of(seed, squeeze * r, 3 - level);
                        g.moved(Vec3::Y * r * 0.6)
                    }
                    1 => frustums(
                        24 >> level,
                        r * 0.6,
                        h,
                        &[
                            (0.0, 1.0),
                            (0.08, 1.0),
                            (0.12, 0.6),
                            (0.5, 0.75),
                            (0.9, 0.55),
                            (1.0, 0.9),
                        ],
                    ),
                    _ => frustums(20 >> level, r, h, &[(0.0, 0.8), (0.5, 1.0), (1.0, 0.8)]),
                }
            };
            let lods: Vec<Parts> = (0..3)
                .map(|l| vec![(lod(l).moved(Vec3::Z * (r * 1.4)), paint)])
                .collect();
            let gap = kit.rng.pick(&[0.0, 0.05, 0.3]);
            let free = kit.rng.chance(0.5);
            let first = room.stand(kit, &format!("{name}_LOD0"), &lods[0], gap, 0.0, free);
            if let Some(to) = first {
                for (l, parts) in lods.iter().enumerate().skip(1) {
                    kit.item(&format!("{name}_LOD{l}"), parts, to);
                }
            }
        }
    }
}

/// Two or three variants of one piece of furniture in one place.
fn variants(kit: &mut Kit, p: &Palette, room: &mut super::plan::Room, name: &str) {
    type Make = fn(&mut super::random::Random, &Palette) -> Parts;
    let make = kit.rng.pick(&[table as Make, chair, cupboard]);
    let first = make(&mut kit.rng, p);
    let Some(to) = room.stand(kit, &format!("{name}_variant_a"), &first, 0.0, 0.0, false) else {
        return;
    };
    for letter in ["b", "c"] {
        let mut other = make(&mut kit.rng, p);
        if letter == "c" {
            // The same shape in another paint.
            other = first.iter().map(|(g, _)| (g.clone(), p.accent)).collect();
        }
        kit.item(&format!("{name}_variant_{letter}"), &other, to);
    }
}
