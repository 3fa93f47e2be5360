//! A kit: a few pieces on a grid, each placed many times, rotated, mirrored, back to back.

use std::collections::BTreeSet;

use glam::Vec3;

use super::kit::{Kit, Mesh, Place, place};
use super::plan::{draw_sky, draw_sun};
use super::random::sin_cos;
use super::shapes::{Palette, Parts, barrel, block, column, post, stairs};

type Cell = (i32, i32);

struct Pieces {
    side: f32,
    walls: Vec<Mesh>,
    door: Mesh,
    window: Mesh,
    floor: Mesh,
    top: Mesh,
    pillar: Mesh,
    props: Vec<Mesh>,
}

pub(super) fn make(kit: &mut Kit) {
    let outside = kit.rng.chance(0.5);
    if outside {
        kit.sky = Some(draw_sky(kit));
        if kit.rng.chance(0.6) {
            draw_sun(kit, [0.0, 360.0], [20.0, 60.0]);
        }
    }
    let height = kit.rng.pick(&[2.5, 3.0, 4.0]);
    let p = pieces(kit, height);
    let cells = grow(kit);
    let two_sides = kit.rng.range(0.1, 0.5);
    let mirror = kit.rng.chance(0.7);
    let mut names = 0..;
    let mut put = |kit: &mut Kit, what: &str, mesh: Mesh, to: Place| {
        kit.put(&format!("{what}_{}", names.next().unwrap_or(0)), mesh, to);
    };
    for &(x, z) in &cells {
        let middle = Vec3::new(x as f32, 0.0, z as f32) * p.side;
        let turn = kit.rng.pick(&[0.0, 90.0, 180.0, 270.0]);
        put(kit, "floor", p.floor, place(middle, turn));
        put(kit, "ceiling", p.top, place(middle, turn));
        for (turn, to) in [
            (0.0, (0, -1)),
            (90.0, (-1, 0)),
            (180.0, (0, 1)),
            (270.0, (1, 0)),
        ] {
            let (s, c) = sin_cos(turn);
            let at = middle - Vec3::new(s, 0.0, c) * p.side / 2.0;
            let open = cells.contains(&(x + to.0, z + to.1));
            let mut to = place(at, turn);
            if mirror && kit.rng.chance(0.5) {
                to.scale.x = -1.0;
            }
            let wall = kit.rng.pick(&p.walls);
            // At an inner border that is not open, both cells have their own walls.
            let piece = match open {
                false if outside && kit.rng.chance(0.3) => Some(p.window),
                false => Some(wall),
                true if kit.rng.chance(two_sides) => Some(p.door),
                true => None,
            };
            if let Some(piece) = piece {
                put(kit, "wall", piece, to);
            }
            if kit.rng.chance(0.5) {
                let corner = at + Vec3::new(c, 0.0, -s) * p.side / 2.0;
                put(kit, "pillar", p.pillar, place(corner, turn));
            }
        }
        for _ in 0..kit.rng.int(0, 2) {
            let prop = kit.rng.pick(&p.props);
            let (a, b) = (kit.rng.range(-0.3, 0.3), kit.rng.range(-0.3, 0.3));
            let mut to = place(middle + Vec3::new(a, 0.0, b) * p.side, turn);
            if mirror && kit.rng.chance(0.3) {
                to.scale.z = -1.0;
            }
            put(kit, "prop", prop, to);
        }
        let h = Vec3::new(p.side * 0.5 - 0.5, 0.0, p.side * 0.5 - 0.5);
        kit.space(middle - h, middle + h.with_y(height));
    }
    lamps(kit, &cells, &p, height, outside);
}

fn pieces(kit: &mut Kit, height: f32) -> Pieces {
    let both = kit.rng.chance(0.3);
    let palette = Palette::draw(kit, both);
    let level = kit.rng.range(0.4, 0.9);
    let rho = kit.rng.colour(level, 0.1);
    let wall = kit.paint_sided("kit_wall", rho, both);
    let rho = kit.rng.colour(0.35, 0.3);
    let ground = kit.paint_sided("kit_floor", rho, both);
    let side = kit.rng.pick(&[2.0, 3.0, 4.0]);
    let t = kit.rng.pick(&[0.05, 0.1, 0.2]);
    // Walls are inside their cell with their backs on its border, or centred on the border.
    let back = kit.rng.pick(&[0.0, -t / 2.0]);
    let w = side / 2.0;
    let bar =
        |x0: f32, x1: f32, y0: f32, y1: f32| (block([x0, y0, back], [x1, y1, back + t]), wall);
    let trim = |x0: f32, x1: f32, y0: f32, y1: f32| {
        (
            block([x0, y0, back + t - 0.01], [x1, y1, back + t + 0.04]),
            palette.wood,
        )
    };
    let mut mesh = |name: &str, parts: Parts| kit.mesh(name, &parts);
    let plain = mesh("wall", vec![bar(-w, w, 0.0, height)]);
    let trimmed = mesh(
        "wall_trim",
        vec![
            bar(-w, w, 0.0, height),
            trim(-w, w, 0.0, 0.15),
            trim(-w, -w + 0.15, 0.15, height),
            trim(-w * 0.5, 0.0, 1.0, 1.8),
        ],
    );
    let door = mesh(
        "wall_door",
        vec![
            bar(-w, -0.5, 0.0, height),
            bar(0.5, w, 0.0, height),
            bar(-0.5, 0.5, 2.1, height),
        ],
    );
    let window = mesh(
        "wall_window",
        vec![
            bar(-w, -w * 0.5, 0.0, height),
            bar(w * 0.5, w, 0.0, height),
            bar(-w * 0.5, w * 0.5, 2.0, height),
            bar(-w * 0.5, w * 0.5, 0.0, 0.9),
            trim(-w * 0.55, w * 0.55, 0.85, 0.9),
        ],
    );
    let floor = mesh("floor", vec![(block([-w, -0.1, -w], [w, 0.0, w]), ground)]);
    let top = mesh(
        "ceiling",
        vec![(block([-w, height, -w], [w, height + 0.1, w]), wall)],
    );
    let pillar = mesh(
        "pillar",
        vec![
            (column(8, 0.15, [0.0, height]), palette.pale),
            (post([0.0, 0.0], 0.0, [0.4, 0.2, 0.4]), palette.pale),
            (
                post([0.0, 0.0], height - 0.2, [0.4, 0.2, 0.4]),
                palette.pale,
            ),
        ],
    );
    let steps = stairs(5, 0.2, 0.25, 1.0, 0.1, true);
    let steps = mesh("stairs", vec![(steps, palette.pale)]);
    let cask = barrel(&mut kit.rng, &palette);
    let cask = kit.mesh("barrel", &cask);
    let boxes = vec![
        (post([0.0, 0.0], 0.0, [0.7, 0.7, 0.7]), palette.wood),
        (post([0.5, 0.3], 0.0, [0.4, 0.4, 0.4]), palette.accent),
    ];
    let boxes = kit.mesh("crates", &boxes);
    Pieces {
        side,
        walls: vec![plain, trimmed, trimmed],
        door,
        window,
        floor,
        top,
        pillar,
        props: vec![steps, cask, boxes],
    }
}

/// Connected cells of the grid, in an order that does not depend on hashes.
fn grow(kit: &mut Kit) -> BTreeSet<Cell> {
    let n = kit.count(3, [12, 45]) as usize;
    let mut cells = BTreeSet::from([(0, 0)]);
    while cells.len() < n {
        let list: Vec<Cell> = cells.iter().copied().collect();
        let (x, z) = kit.rng.pick(&list);
        let (dx, dz) = kit.rng.pick(&[(0, 1), (0, -1), (1, 0), (-1, 0)]);
        cells.insert((x + dx, z + dz));
    }
    cells
}

fn lamps(kit: &mut Kit, cells: &BTreeSet<Cell>, p: &Pieces, height: f32, outside: bool) {
    let share = if outside { 0.2 } else { 0.6 };
    let area = p.side * p.side * 2.0 + p.side * height;
    let target = kit.rng.range(0.3, 1.0);
    let glow = kit.glow(
        "lamp",
        [1.0, 0.9, 0.75].map(|c| c * target * area / share / 0.12),
    );
    let lamp = block([-0.2, -0.12, -0.3], [0.2, -0.1, 0.3]);
    let lamp = kit.mesh("lamp", &[(lamp, glow)]);
    for (k, &(x, z)) in cells.iter().enumerate() {
        if kit.rng.chance(share) || (k == 0 && !outside) {
            let at = Vec3::new(x as f32 * p.side, height, z as f32 * p.side);
            kit.put(&format!("lamp_{k}"), lamp, place(at, 0.0));
        }
    }
}
