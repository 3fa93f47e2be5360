//! Stairs of intersecting boxes, in a room or under a vault whose shell may be modelled inside out.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{Plan, Room};
use super::random::sin_cos;
use super::shapes::{Parts, block, column, post, stairs, turned};
use crate::geometry::{Geometry, quad};

pub(super) fn make(kit: &mut Kit) {
    let (w, d) = (kit.rng.metres(5.0, 8.0), kit.rng.metres(6.0, 10.0));
    let height = kit.rng.metres(3.6, 5.5);
    let mut plan = Plan::draw(kit, [1, 1], [3.0, 4.0], height);
    (plan.xs, plan.zs) = (vec![0.0, w], vec![0.0, d]);
    plan.paint(kit, [0.4, 0.85], 0.12);
    let vault = kit.rng.chance(0.5);
    let mut room = if vault {
        let t = 0.1;
        let slab = block([-t, -t, -t], [w + t, 0.0, d + t]);
        kit.part("floor", &slab, plan.ground);
        shell(kit, w, d, plan.wall);
        let (min, max) = (Vec3::ZERO, Vec3::new(w, w / 2.0, d));
        let inset = Vec3::new(1.0, 0.0, 0.6);
        kit.space(min + inset, (max - inset).with_y(2.4));
        Room {
            min: min + Vec3::new(0.6, 0.0, 0.0),
            max: max - Vec3::new(0.6, 0.3, 0.0),
            taken: Vec::new(),
        }
    } else {
        plan.build(kit).rooms.remove(0)
    };
    let paints = [0.4, 0.6].map(|level| {
        let rho = kit.rng.colour(level, 0.2);
        kit.paint_sided("steps", rho, plan.style.double_sided)
    });
    for k in 0..kit.count(1, [2, 4]) {
        let paint = kit.rng.pick(&paints);
        let parts = match kit.rng.int(0, 2) {
            0 => spiral(kit, height * 0.8, paint),
            _ => flight(kit, paint),
        };
        let gap = kit.rng.pick(&[0.0, 0.0, -0.05, 0.2]);
        room.stand(kit, &format!("stairs_{k}"), &parts, gap, 0.0, false);
    }
    for k in 0..kit.count(1, [1, 5]) {
        let (s, h) = (kit.rng.metres(0.3, 0.8), kit.rng.metres(0.3, 1.0));
        let parts = vec![(post([0.0, s / 2.0], 0.0, [s, h, s]), paints[0])];
        room.stand(kit, &format!("block_{k}"), &parts, 0.0, -0.01, true);
    }
    let target = kit.rng.range(0.3, 1.2);
    room.light(kit, "lamp", target);
}

/// A flight, sometimes with a landing and side walls that intersect the steps.
fn flight(kit: &mut Kit, paint: usize) -> Parts {
    let rng = &mut kit.rng;
    let n = rng.int(4, 12);
    let (rise, run) = (rng.metres(0.15, 0.2), rng.metres(0.24, 0.32));
    let w = rng.metres(0.9, 1.8);
    let overlap = rng.pick(&[0.0, 0.02, 0.1, run]);
    let to_floor = rng.chance(0.6);
    // Upwards to the wall: the highest step at z = 0.
    let length = run * n as f32;
    let steps = stairs(n, rise, run, w, overlap, to_floor);
    let steps = steps.transformed(turned(180.0, Vec3::Z * (length + overlap)));
    let mut out = vec![(steps, paint)];
    if rng.chance(0.4) {
        let t = rng.pick(&[0.05, 0.15]);
        let (h, high) = (w / 2.0, rise * n as f32 + 0.9);
        for x in [-h - t / 2.0, h - t / 2.0] {
            out.push((block([x, 0.0, 0.0], [x + t, high, length]), paint));
        }
    }
    out
}

/// Boxes around a column, each rotated a little further and intersecting the previous one.
fn spiral(kit: &mut Kit, height: f32, paint: usize) -> Parts {
    let rng = &mut kit.rng;
    let (r, core) = (rng.metres(0.9, 1.4), rng.metres(0.1, 0.2));
    let n = rng.int(8, 18);
    let (rise, t) = (height / n as f32, rng.pick(&[0.05, 0.1, 0.2]));
    let (turn, depth) = (rng.range(18.0, 28.0).round(), r * 0.45);
    let middle = Vec3::Z * (r + 0.02);
    let mut all = column(10, core, [0.0, height + 0.8]).moved(middle);
    for i in 0..n {
        let y = rise * (i + 1) as f32;
        let low = if t > 0.15 { 0.0 } else { y - t };
        let step = block([0.0, low, -depth / 2.0], [r, y, depth / 2.0]);
        all.append(&step.transformed(turned(turn * i as f32, middle)));
    }
    vec![(all, paint)]
}

/// A half-cylinder with ends on straight feet: a single skin, facing inwards or modelled inside
/// out.
fn shell(kit: &mut Kit, w: f32, d: f32, paint: usize) {
    let n = kit.rng.int(6, 24);
    let inside_out = kit.rng.chance(0.35);
    // Only the vault is inside out; otherwise nothing of the room would be visible.
    let foot = kit.rng.pick(if inside_out {
        &[1.8, 2.2, 2.6]
    } else {
        &[0.0, 0.8, 1.6]
    });
    let r = w / 2.0;
    let mut outline = vec![Vec3::new(w, 0.0, 0.0)];
    for i in 0..=n {
        let (s, c) = sin_cos(180.0 * i as f32 / n as f32);
        outline.push(Vec3::new(r + r * c, foot + r * s, 0.0));
    }
    outline.push(Vec3::ZERO);
    let back = Vec3::Z * d;
    let mut g = Geometry::default();
    let mut ends = Geometry::default();
    for p in outline.windows(2) {
        if (p[1] - p[0]).length() < 1e-5 {
            continue;
        }
        let strip = quad([p[0], p[1], p[1] + back, p[0] + back]);
        // The first wall is at the largest x, and inwards is −x.
        let inwards = strip.normals[0].dot(Vec3::new(r, foot, 0.0) - (p[0] + p[1]) / 2.0) > 0.0;
        let curved = p[0].y.min(p[1].y) >= foot;
        g.append(&if inwards == (inside_out && curved) {
            strip.flipped()
        } else {
            strip
        });
        let middle = Vec3::new(r, 0.0, 0.0);
        if (p[0].y + p[1].y) > 1e-5 {
            let base = ends.positions.len() as u32;
            for (z, n) in [(Vec3::ZERO, Vec3::Z), (back, -Vec3::Z)] {
                ends.positions.extend([middle + z, p[0] + z, p[1] + z]);
                ends.normals.extend([n; 3]);
                ends.uv.extend([glam::Vec2::ZERO; 3]);
            }
            let b = base;
            ends.triangles
                .extend([[b, b + 1, b + 2], [b + 3, b + 5, b + 4]]);
        }
    }
    kit.solid = false;
    kit.item("vault", &[(g, paint)], place(Vec3::ZERO, 0.0));
    kit.item("ends", &[(ends, paint)], place(Vec3::ZERO, 0.0));
    kit.solid = true;
}
