//! A heightfield with houses sunk in it, rocks, sky and sun.

use glam::Vec3;

use super::kit::{Kit, place};
use super::plan::{Edge, Plan, draw_sky, draw_sun, window_frame};
use super::random::fractal;
use super::shapes::{Palette, block, rock, tilted};
use crate::geometry::Geometry;

/// Height of the ground.
struct Hills {
    seed: u32,
    height: f32,
    width: f32,
}

impl Hills {
    fn at(&self, x: f32, z: f32) -> f32 {
        self.height * fractal(Vec3::new(x, 0.0, z) / self.width, self.seed)
    }
}

pub(super) fn make(kit: &mut Kit) {
    let hills = Hills {
        seed: kit.rng.int(0, 1 << 20),
        height: kit.rng.range(0.5, 2.5),
        width: kit.rng.range(9.0, 20.0),
    };
    let half = if kit.small() {
        7.0
    } else {
        kit.rng.metres(14.0, 26.0)
    };
    let n = kit.count(14, [40, 90]);
    let rho = kit.rng.ground();
    let both = kit.rng.chance(0.3);
    let grass = kit.paint_sided("grass", rho, both);
    kit.solid = false;
    kit.part("terrain", &field(&hills, half, n), grass);
    kit.solid = true;
    kit.sky = Some(draw_sky(kit));
    if kit.rng.chance(0.85) {
        draw_sun(kit, [0.0, 360.0], [15.0, 65.0]);
    }
    let houses = kit.count(1, [2, 4]);
    for i in 0..houses {
        // Each in its own quarter.
        let (sx, sz) = [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)][i as usize];
        let (x, z) = if houses == 1 {
            (-2.0, -2.0)
        } else {
            (half * 0.45 * sx - 3.0, half * 0.45 * sz - 3.0)
        };
        house(kit, &hills, [x, z], i);
    }
    let stone = kit.paint("rock", [0.42, 0.4, 0.38]);
    for k in 0..kit.count(4, [12, 40]) {
        let (x, z) = (kit.rng.range(-half, half), kit.rng.range(-half, half));
        let size = kit.rng.range(0.2, 1.4);
        let level = kit.rng.int(1, 2);
        let g = rock(&mut kit.rng, size, level);
        let sunk = kit.rng.range(-0.4, 0.3) * size;
        let at = Vec3::new(x * 0.95, hills.at(x, z) + sunk, z * 0.95);
        kit.item(&format!("rock_{k}"), &[(g, stone)], place(at, 0.0));
    }
}

fn field(hills: &Hills, half: f32, n: u32) -> Geometry {
    let step = 2.0 * half / n as f32;
    let mut g = Geometry::default();
    for j in 0..=n {
        for i in 0..=n {
            let (x, z) = (i as f32 * step - half, j as f32 * step - half);
            g.positions.push(Vec3::new(x, hills.at(x, z), z));
            let slope = |dx: f32, dz: f32| hills.at(x - dx, z - dz) - hills.at(x + dx, z + dz);
            let normal = Vec3::new(slope(step, 0.0), 2.0 * step, slope(0.0, step));
            g.normals.push(normal.normalize());
        }
    }
    let row = n + 1;
    for j in 0..n {
        for i in 0..n {
            let k = j * row + i;
            g.triangles.push([k, k + row, k + 1]);
            g.triangles.push([k + 1, k + row, k + row + 1]);
        }
    }
    g
}

fn house(kit: &mut Kit, hills: &Hills, [x, z]: [f32; 2], i: u32) {
    let cells = if kit.small() || kit.rng.chance(0.5) {
        [1, 1]
    } else {
        [2, 1]
    };
    let height = kit.rng.metres(2.4, 3.0);
    let mut plan = Plan::draw(kit, cells, [3.0, 4.5], height);
    for v in &mut plan.xs {
        *v += x;
    }
    for v in &mut plan.zs {
        *v += z;
    }
    plan.paint(kit, [0.4, 0.85], 0.1);
    plan.style.skins = false;
    let (x1, z1) = (plan.xs[plan.xs.len() - 1], plan.zs[1]);
    let (cx, cz) = ((x + x1) / 2.0, (z + z1) / 2.0);
    // The ground may rise through the floor.
    let highest = [(x, z), (x1, z), (x, z1), (x1, z1), (cx, cz)]
        .map(|(x, z)| hills.at(x, z))
        .into_iter()
        .fold(f32::MIN, f32::max);
    plan.floor = highest + kit.rng.range(-0.1, 0.25);
    plan.along_x[1][0] = Edge::Door(kit.rng.metres(0.9, 1.4));
    plan.along_x[0][0] = Edge::Windows(kit.rng.int(1, 2), 0.9, 2.0);
    plan.along_z[0][0] = Edge::Windows(1, 0.8, 2.0);
    let t = plan.style.thickness;
    let built = plan.build(kit);
    // Walls continue into the ground.
    let deep = kit.rng.range(0.8, 1.6);
    let base = block(
        [x - t / 2.0, plan.floor - deep, z - t / 2.0],
        [x1 + t / 2.0, plan.floor - t * 0.9, z1 + t / 2.0],
    );
    kit.part(&format!("base_{i}"), &base, plan.wall);
    let p = Palette::draw(kit, false);
    for (k, o) in built.openings.iter().enumerate() {
        if o.window && kit.rng.chance(0.7) {
            window_frame(kit, o, p.pale, &format!("window_{i}_{k}"));
        }
    }
    // Two boards lean against each other and intersect the walls.
    let (w, half) = ((x1 - x) / 2.0 + 0.4, (z1 - z) / 2.0);
    let slope = kit.rng.range(25.0, 45.0).round();
    let (s, c) = super::random::sin_cos(slope);
    let length = (half + 0.5) / c;
    let rise = half * s / c;
    for (turn, side) in [(0.0, "front"), (180.0, "back")] {
        let board = block([-w, -0.08, 0.0], [w, 0.0, length]).transformed(tilted(slope));
        let at = Vec3::new(cx, plan.floor + height + rise + 0.05, cz);
        let name = format!("roof_{i}_{side}");
        kit.item(&name, &[(board, p.wood)], place(at, turn));
    }
    for mut room in built.rooms {
        if kit.rng.chance(0.3) {
            room.light(kit, &format!("lamp_{i}"), 0.3);
        }
        let n = kit.count(1, [1, 4]);
        room.furnish(kit, &p, n, &[0.0, 0.02], &[0.0]);
    }
    for (dx, dz) in [(0.0, 1.0), (1.0, 0.0), (-1.0, 0.0), (0.7, 0.7), (-0.7, 0.7)] {
        let at = Vec3::new(cx + dx * (w + 2.0), 0.0, cz + dz * (half + 2.5));
        let y = hills.at(at.x, at.z);
        let e = Vec3::new(0.7, 0.0, 0.7);
        kit.space(at.with_y(y) - e, at.with_y(y + 2.5) + e);
    }
}
