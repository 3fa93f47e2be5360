//! A stylised dungeon of stone blocks, slabs, barrels and arches under torches; blocks touch face
//! to face or intersect.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{Room, draw_sky};
use super::shapes::{Palette, arch, barrel, block, frustums, post};
use crate::geometry::Geometry;
use crate::gltf::Light;

/// How stones are laid.
struct Stones {
    length: f32,
    course: f32,
    depth: f32,
    /// How far faces protrude from the wall's plane, at most.
    rough: f32,
    /// Gap between stones; negative if they intersect.
    gap: f32,
}

pub(super) fn make(kit: &mut Kit) {
    let rng = &mut kit.rng;
    let mut stones = Stones {
        length: rng.metres(0.5, 1.2),
        course: rng.metres(0.35, 0.6),
        depth: rng.pick(&[0.2, 0.3, 0.4]),
        rough: rng.pick(&[0.0, 0.02, 0.06]),
        gap: rng.pick(&[0.0, 0.0, 0.001, -0.02]),
    };
    if kit.small() {
        (stones.length, stones.course) = (1.4, 0.6);
    }
    let rooms = kit.count(1, [1, 3]);
    let (d, courses) = (kit.rng.metres(3.5, 6.5), kit.count(5, [5, 8]));
    let height = stones.course * courses as f32;
    let both = kit.rng.chance(0.2);
    let level = kit.rng.range(0.25, 0.55);
    let paints = [0.9, 1.0, 1.15].map(|k| {
        let rho = kit.rng.colour(level * k, 0.1);
        kit.paint_sided("stone", rho, both)
    });
    let p = Palette::draw(kit, false);
    let open = kit.rng.chance(0.25);
    if open {
        kit.sky = Some(draw_sky(kit).map(|c| c * 0.3));
    }
    let door = 1.4;
    let mut x = 0.0;
    for i in 0..rooms {
        let w = kit.rng.metres(3.5, 6.0);
        let (min, max) = (Vec3::new(x, 0.0, 0.0), Vec3::new(x + w, height, d));
        let t = stones.depth;
        wall(
            kit,
            &stones,
            &paints,
            &format!("wall_north_{i}"),
            [w, height],
            None,
            |s| place(Vec3::new(x + s, 0.0, 0.0), 0.0),
        );
        wall(
            kit,
            &stones,
            &paints,
            &format!("wall_south_{i}"),
            [w, height],
            None,
            |s| place(Vec3::new(x + w - s, 0.0, d), 180.0),
        );
        // Walls across; an arch leads to the next room.
        let hole = (i + 1 < rooms).then_some(door);
        wall(
            kit,
            &stones,
            &paints,
            &format!("wall_east_{i}"),
            [d, height],
            hole,
            |s| place(Vec3::new(x + w, 0.0, s), 270.0),
        );
        if i == 0 {
            wall(kit, &stones, &paints, "wall_west", [d, height], None, |s| {
                place(Vec3::new(0.0, 0.0, d - s), 90.0)
            });
        }
        if hole.is_some() {
            let g = arch(7, door, 1.5, t * 1.2, 0.3);
            let at = Vec3::new(x + w + t / 2.0, 0.0, d / 2.0);
            kit.item(&format!("arch_{i}"), &[(g, paints[2])], place(at, 90.0));
        }
        slabs(kit, &paints, min, max, i);
        if !open {
            ceiling(kit, &p, paints[0], min, max, t, i);
        }
        let mut room = Room {
            min: min + Vec3::new(stones.rough, 0.0, stones.rough),
            max: max - Vec3::new(stones.rough, 0.0, stones.rough),
            taken: vec![
                [x - 1.0, x + 0.9, d / 2.0 - 0.8, d / 2.0 + 0.8],
                [x + w - 0.9, x + w + 1.0, d / 2.0 - 0.8, d / 2.0 + 0.8],
            ],
        };
        for k in 0..kit.count(2, [3, 8]) {
            let parts = match kit.rng.int(0, 2) {
                0 => {
                    let s = kit.rng.metres(0.3, 0.9);
                    vec![(post([0.0, s / 2.0], 0.0, [s, s, s]), p.wood)]
                }
                1 => pile(kit, paints[1], height),
                _ => barrel(&mut kit.rng, &p),
            };
            let gap = kit.rng.pick(&[0.0, 0.02, -0.03, 0.2]);
            let lift = kit.rng.pick(&[0.0, 0.0, -0.02, 0.02]);
            room.stand(kit, &format!("thing_{i}_{k}"), &parts, gap, lift, false);
        }
        let inset = Vec3::new(0.6, 0.0, 0.6);
        kit.space(min + inset, max - inset);
        torches(kit, &p, &room, i);
        x += w + t;
    }
}

/// Stones in courses with their faces near z = 0, looking along +z; `to` places the start of the
/// wall.
fn wall(
    kit: &mut Kit,
    s: &Stones,
    paints: &[usize; 3],
    name: &str,
    [length, height]: [f32; 2],
    hole: Option<f32>,
    to: impl Fn(f32) -> super::kit::Place,
) {
    let courses = (height / s.course).round() as u32;
    let mut parts: Vec<(Geometry, usize)> = Vec::new();
    for j in 0..courses {
        let y = s.course * j as f32;
        // Every other course begins with half a stone; walls reach into the corners.
        let mut x = -s.depth - if j % 2 == 1 { s.length / 2.0 } else { 0.0 };
        while x < length + s.depth {
            let l = s.length * kit.rng.pick(&[0.75, 1.0, 1.0, 1.25]);
            let (a, b) = (x.max(-s.depth), (x + l - s.gap).min(length + s.depth));
            x += l;
            if b - a < 0.02 {
                continue;
            }
            let out = kit.rng.range(-s.rough, s.rough);
            let paint = kit.rng.pick(paints);
            // The hole ends under an arch: stones in its way are left out or cut.
            let spans: Vec<[f32; 2]> = match hole {
                Some(w) if y < 1.5 + w / 2.0 => {
                    let (lo, hi) = ((length - w) / 2.0, (length + w) / 2.0);
                    vec![[a, b.min(lo)], [a.max(hi), b]]
                }
                _ => vec![[a, b]],
            };
            for [a, b] in spans {
                if b - a > 0.02 {
                    let top = y + s.course - s.gap.max(0.0);
                    parts.push((block([a, y, -s.depth], [b, top, out]), paint));
                }
            }
        }
    }
    kit.item(name, &parts, to(0.0));
}

/// Slabs of the floor, each a little higher or lower.
fn slabs(kit: &mut Kit, paints: &[usize; 3], min: Vec3, max: Vec3, room: u32) {
    let side = kit.rng.metres(if kit.small() { 1.1 } else { 0.6 }, 1.2);
    let rough = kit.rng.pick(&[0.0, 0.01, 0.03]);
    let mut parts = Vec::new();
    let mut z = min.z - 0.1;
    while z < max.z + 0.1 {
        let mut x = min.x - 0.1;
        while x < max.x + 0.45 {
            let y = kit.rng.range(-rough, rough);
            let g = block([x, -0.3, z], [x + side, y, z + side]);
            parts.push((g, kit.rng.pick(paints)));
            x += side;
        }
        z += side;
    }
    kit.item(&format!("slabs_{room}"), &parts, place(Vec3::ZERO, 0.0));
}

fn ceiling(kit: &mut Kit, p: &Palette, stone: usize, min: Vec3, max: Vec3, t: f32, i: u32) {
    let y = max.y;
    let e = Vec3::new(t, 0.0, t);
    let (a, b) = (min - e, max + e);
    let boards = kit.rng.chance(0.5);
    let mut parts = Vec::new();
    if boards {
        let n = (((b.x - a.x) / 0.35) as u32).max(1);
        let w = (b.x - a.x) / n as f32;
        for k in 0..n {
            let x = a.x + w * k as f32;
            parts.push((block([x, y, a.z], [x + w, y + 0.05, b.z]), p.wood));
        }
        for k in 0..4 {
            let z = min.z + (max.z - min.z) * (k as f32 + 0.5) / 4.0;
            parts.push((
                block([a.x, y - 0.18, z - 0.09], [b.x, y + 0.01, z + 0.09]),
                p.wood,
            ));
        }
    } else {
        parts.push((block([a.x, y, a.z], [b.x, y + 0.3, b.z]), stone));
    }
    kit.item(&format!("ceiling_{i}"), &parts, place(Vec3::ZERO, 0.0));
}

/// A pillar of drums, or a heap of intersecting stones.
fn pile(kit: &mut Kit, paint: usize, height: f32) -> Vec<(Geometry, usize)> {
    if kit.rng.chance(0.5) {
        let (r, n) = (kit.rng.metres(0.2, 0.35), kit.rng.int(3, 6));
        let h = height / n as f32;
        return (0..n)
            .map(|i| {
                let g = frustums(
                    10,
                    r,
                    h,
                    &[(0.0, 0.95), (0.1, 1.0), (0.9, 1.0), (1.0, 0.95)],
                );
                (g.moved(Vec3::new(0.0, h * i as f32, r)), paint)
            })
            .collect();
    }
    (0..kit.rng.int(2, 5))
        .map(|_| {
            let s = kit.rng.metres(0.2, 0.5);
            let at = [kit.rng.range(-0.3, 0.3), kit.rng.range(0.3, 0.6)];
            let y = kit.rng.pick(&[0.0, 0.0, 0.2]);
            (post(at, y, [s * 1.3, s * 0.8, s]), paint)
        })
        .collect()
}

/// Torches on the long walls: a bracket and a small bright flame, or a point of light.
fn torches(kit: &mut Kit, p: &Palette, room: &Room, i: u32) {
    let n = kit.count(2, [2, 4]);
    let target = kit.rng.range(0.3, 1.0) * room.surface() / n as f32;
    let tint = [1.0, kit.rng.range(0.5, 0.7), kit.rng.range(0.15, 0.4)];
    let points = kit.rng.chance(0.4);
    let flame = frustums(6, 0.045, 0.16, &[(0.0, 0.5), (0.35, 1.0), (1.0, 0.1)]);
    let glow = kit.glow("flame", tint.map(|c| c * target / 0.05));
    let dull = kit.paint("ember", tint.map(|c| c * 0.9));
    let bracket = Geometry::union(&[
        block([-0.02, -0.25, -0.02], [0.02, 0.0, 0.14]),
        post([0.0, 0.12], -0.02, [0.09, 0.03, 0.09]),
    ]);
    for k in 0..n {
        let x = room.min.x + (room.max.x - room.min.x) * (k as f32 + 0.5) / n as f32;
        let north = k % 2 == 0;
        let z = if north { room.min.z } else { room.max.z };
        let turn = if north { 0.0 } else { 180.0 };
        let y = 1.7_f32.min(room.max.y - 0.5);
        let fire = flame.clone().moved(Vec3::new(0.0, 0.01, 0.12));
        let paint = if points { dull } else { glow };
        let parts = [(bracket.clone(), p.metal), (fire, paint)];
        kit.item(
            &format!("torch_{i}_{k}"),
            &parts,
            place(Vec3::new(x, y, z), turn),
        );
        if points {
            let at = Vec3::new(x, y + 0.3, if north { z + 0.12 } else { z - 0.12 });
            let cd = tint.map(|c| c * target / 5.0);
            kit.add_lamp(&format!("fire_{i}_{k}"), at, -Vec3::Y, Light::Point(cd));
        }
    }
}
