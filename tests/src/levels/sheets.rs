//! Rooms whose walls, floors and roofs have no thickness, but a face for each side, as of brushes that
//! were merged or of a level from a grid of tiles: both faces are single-sided and lie in one plane,
//! each divided in its own way, so that no triangle of one is the other's turned round.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{draw_sky, draw_sun};
use super::shapes::{Palette, chair, post, table};
use crate::geometry::{Geometry, quad};
use crate::gltf::Light;

/// A wall's place: a corner, and two edges of it. Its front is on the side of `u` × `v`.
#[derive(Clone, Copy)]
struct Sheet {
    corner: Vec3,
    u: Vec3,
    v: Vec3,
}

/// Openings of a wall, along `u` and `v`, in metres.
type Holes = Vec<[[f32; 2]; 2]>;

pub(super) fn make(kit: &mut Kit) {
    let rooms = kit.count(2, [3, 5]) as usize;
    let (depth, height) = (kit.rng.metres(3.0, 6.0), kit.rng.metres(2.4, 3.4));
    let widths: Vec<f32> = (0..rooms).map(|_| kit.rng.metres(2.5, 5.0)).collect();
    let white = kit.rng.chance(0.5);
    let level = if white {
        kit.rng.range(0.9, 0.98)
    } else {
        kit.rng.range(0.4, 0.8)
    };
    let [inside, outside] = [0.1, 0.3].map(|spread| {
        let spread = if white { 0.02 } else { spread };
        let rho = kit.rng.colour(level, spread);
        kit.paint("wall", rho)
    });
    kit.sky = Some(draw_sky(kit));
    if kit.rng.chance(0.6) {
        draw_sun(kit, [-50.0, 50.0], [20.0, 60.0]);
    }
    kit.solid = false;
    let up = Vec3::Y * height;
    let mut left = 0.0;
    for (i, &w) in widths.iter().enumerate() {
        let at = Vec3::new(left, 0.0, 0.0);
        let (across, deep) = (Vec3::X * w, Vec3::Z * depth);
        let wide = kit.rng.metres(0.8, w - 1.0);
        let x = kit.rng.metres(0.4, w - wide - 0.4);
        let window = vec![[[x, x + wide], [0.9, kit.rng.metres(1.7, 2.2)]]];
        let sheet = |corner, u, v| Sheet { corner, u, v };
        let front = if kit.rng.chance(0.7) {
            window
        } else {
            Vec::new()
        };
        // Fronts look into the room; the other face looks out.
        let walls = [
            ("front", sheet(at, across, up), front),
            ("back", sheet(at + across + deep, -across, up), Vec::new()),
            ("floor", sheet(at, deep, across), Vec::new()),
            ("roof", sheet(at + up, across, deep), Vec::new()),
        ];
        for (name, sheet, holes) in walls {
            both_faces(
                kit,
                &format!("{name}_{i}"),
                sheet,
                &holes,
                [inside, outside],
            );
        }
        // Towards the room before, with a door, or the outside.
        let z = kit.rng.metres(0.4, depth - 1.4);
        let door = if i > 0 {
            vec![[[z, z + 1.0], [0.0, 2.1]]]
        } else {
            Vec::new()
        };
        // Along −Z, so that holes are counted from the back.
        let side = sheet(at + deep, -deep, up);
        both_faces(kit, &format!("side_{i}"), side, &door, [inside, outside]);
        kit.space(
            at + Vec3::splat(0.4),
            at + across + deep + up - Vec3::splat(0.4),
        );
        left += w;
    }
    let end = Sheet {
        corner: Vec3::X * left,
        u: Vec3::Z * depth,
        v: up,
    };
    both_faces(kit, "end", end, &Vec::new(), [inside, outside]);
    kit.solid = true;
    let ground = kit.rng.ground();
    let ground = kit.paint("ground", ground);
    let p = |x: f32, z: f32| Vec3::new(x, -0.02, z);
    let far = [
        p(-6.0, -6.0),
        p(-6.0, depth + 6.0),
        p(left + 6.0, depth + 6.0),
        p(left + 6.0, -6.0),
    ];
    kit.part("ground", &quad(far), ground);
    let palette = Palette::draw(kit, false);
    let mut left = 0.0;
    for (i, &w) in widths.iter().enumerate() {
        let middle = Vec3::new(left + w / 2.0, 0.0, depth / 2.0);
        let turn = kit.rng.pick(&[0.0, 90.0, 35.0]);
        let parts = match kit.rng.int(0, 2) {
            0 => table(&mut kit.rng, &palette),
            1 => chair(&mut kit.rng, &palette),
            _ => vec![(post([0.0, 0.0], 0.0, [0.6, 0.5, 0.6]), palette.wood)],
        };
        kit.item(&format!("thing_{i}"), &parts, place(middle, turn));
        if kit.rng.chance(0.5) {
            let tint = kit.rng.colour(0.8, 0.2);
            let target = kit.rng.range(0.1, 0.6) * depth * w;
            let at = middle + Vec3::Y * (height - 0.4) + Vec3::X * (w * 0.2);
            let lamp = Light::Point(tint.map(|c| c * target));
            kit.add_lamp(&format!("lamp_{i}"), at, -Vec3::Y, lamp);
        }
        left += w;
    }
}

/// A face for each side, each a mesh of its own or both in one.
fn both_faces(kit: &mut Kit, name: &str, sheet: Sheet, holes: &Holes, paints: [usize; 2]) {
    let [shown, hidden] = [false, true].map(|turned| {
        let g = face(kit, sheet, holes);
        if turned { g.flipped() } else { g }
    });
    if kit.rng.chance(0.5) {
        kit.item(
            name,
            &[(shown, paints[0]), (hidden, paints[1])],
            place(Vec3::ZERO, 0.0),
        );
    } else {
        kit.part(name, &shown, paints[0]);
        kit.part(&format!("{name}_out"), &hidden, paints[1]);
    }
}

/// One face of a wall: cells between drawn lines and the edges of its holes.
fn face(kit: &mut Kit, sheet: Sheet, holes: &Holes) -> Geometry {
    let mut lines = |length: f32, axis: usize| {
        let mut all = vec![0.0, length];
        all.extend(holes.iter().flat_map(|h| h[axis]));
        for _ in 0..kit.rng.int(0, 3) {
            all.push(kit.rng.metres(0.1, length - 0.1));
        }
        all.sort_by(f32::total_cmp);
        all.dedup_by(|a, b| (*a - *b).abs() < 1e-3);
        all
    };
    let (us, vs) = (lines(sheet.u.length(), 0), lines(sheet.v.length(), 1));
    let (along, upwards) = (sheet.u.normalize(), sheet.v.normalize());
    let at = |u: f32, v: f32| sheet.corner + along * u + upwards * v;
    let mut out = Geometry::default();
    for u in us.windows(2) {
        for v in vs.windows(2) {
            let middle = [(u[0] + u[1]) / 2.0, (v[0] + v[1]) / 2.0];
            let open =
                |h: &[[f32; 2]; 2]| (0..2).all(|k| h[k][0] < middle[k] && middle[k] < h[k][1]);
            if !holes.iter().any(open) {
                out.append(&quad([
                    at(u[0], v[0]),
                    at(u[1], v[0]),
                    at(u[1], v[1]),
                    at(u[0], v[1]),
                ]));
            }
        }
    }
    out
}
