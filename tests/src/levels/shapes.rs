//! Furnishings as parts in metres: base at y = 0, back at z = 0, facing +z, centred at x = 0.

use glam::{Affine3A, Mat3, Vec2, Vec3};

use super::random::{Random, sin_cos};
use crate::geometry::{Geometry, cuboid, icosphere, prism, quad};

/// Geometry, and the palette's paint for it.
pub(super) type Parts = Vec<(Geometry, usize)>;

/// Paints of furniture; [`Palette::draw`] chooses some.
#[derive(Debug, Clone, Copy)]
pub(super) struct Palette {
    pub wood: usize,
    pub cloth: usize,
    pub pale: usize,
    pub metal: usize,
    pub accent: usize,
}

impl Palette {
    pub fn draw(kit: &mut super::kit::Kit, double_sided: bool) -> Palette {
        let mut paint = |name: &str, from: f32, to: f32, spread: f32| {
            let level = kit.rng.range(from, to);
            let rho = kit.rng.colour(level, spread);
            kit.paint_sided(name, rho, double_sided)
        };
        Palette {
            wood: paint("wood", 0.2, 0.6, 0.35),
            cloth: paint("cloth", 0.1, 0.6, 0.5),
            pale: paint("pale", 0.7, 0.9, 0.03),
            metal: paint("metal", 0.3, 0.6, 0.05),
            accent: paint("accent", 0.2, 0.5, 0.8),
        }
    }
}

/// A box.
pub(super) fn block(min: [f32; 3], max: [f32; 3]) -> Geometry {
    cuboid(min.into(), max.into(), 1)
}

/// A box about x = z = `at`, `size` metres, its base at `y`.
pub(super) fn post(at: [f32; 2], y: f32, size: [f32; 3]) -> Geometry {
    let [w, h, d] = size.map(|s| s / 2.0);
    block(
        [at[0] - w, y, at[1] - d],
        [at[0] + w, y + 2.0 * h, at[1] + d],
    )
}

/// Turned by `degrees` about +Y, then moved.
pub(super) fn turned(degrees: f32, to: Vec3) -> Affine3A {
    let (s, c) = sin_cos(degrees);
    let m = Mat3::from_cols(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c));
    Affine3A::from_mat3_translation(m, to)
}

/// Tilted by `degrees` about +X.
pub(super) fn tilted(degrees: f32) -> Affine3A {
    let (s, c) = sin_cos(degrees);
    Affine3A::from_mat3(Mat3::from_cols(
        Vec3::X,
        Vec3::new(0.0, c, s),
        Vec3::new(0.0, -s, c),
    ))
}

/// A regular outline of `n` corners, in the order that [`prism`] wants.
pub(super) fn ring(n: u32, radius: f32) -> Vec<Vec2> {
    (0..n)
        .map(|i| {
            let (s, c) = sin_cos(-(i as f32) / n as f32 * 360.0);
            Vec2::new(c * radius, s * radius)
        })
        .collect()
}

/// A column on the y axis with as many sides.
pub(super) fn column(sides: u32, radius: f32, y: [f32; 2]) -> Geometry {
    prism(&ring(sides, radius), y[0], y[1])
}

pub(super) fn table(rng: &mut Random, p: &Palette) -> Parts {
    let (w, d, h) = (
        rng.metres(0.7, 2.0),
        rng.metres(0.6, 1.0),
        rng.metres(0.4, 0.78),
    );
    let (t, leg) = (rng.metres(0.02, 0.06), rng.metres(0.03, 0.09));
    let mut out = vec![(block([-w / 2.0, h - t, 0.0], [w / 2.0, h, d]), p.wood)];
    // Legs end under the top, or go into it.
    let up = if rng.chance(0.5) { h - t } else { h - t / 2.0 };
    for x in [-w / 2.0 + leg, w / 2.0 - leg] {
        for z in [leg, d - leg] {
            out.push((post([x, z], 0.0, [leg, up, leg]), p.metal));
        }
    }
    out
}

pub(super) fn chair(rng: &mut Random, p: &Palette) -> Parts {
    let (w, h, t) = (rng.metres(0.4, 0.5), rng.metres(0.42, 0.48), 0.04);
    let mut out = vec![
        (block([-w / 2.0, h - t, 0.0], [w / 2.0, h, w]), p.wood),
        (block([-w / 2.0, h, 0.0], [w / 2.0, h + 0.45, 0.03]), p.wood),
    ];
    for x in [-w / 2.0 + 0.02, w / 2.0 - 0.02] {
        for z in [0.02, w - 0.02] {
            out.push((post([x, z], 0.0, [0.04, h - t, 0.04]), p.wood));
        }
    }
    out
}

pub(super) fn sofa(rng: &mut Random, p: &Palette) -> Parts {
    let (w, d) = (rng.metres(1.2, 2.4), rng.metres(0.75, 1.0));
    let sunk = rng.pick(&[0.0, 0.02, 0.05]);
    vec![
        (block([-w / 2.0, 0.06, 0.0], [w / 2.0, 0.3, d]), p.cloth),
        // Cushions sunk into the frame, or lying on it.
        (
            block([-w / 2.0 + 0.15, 0.3 - sunk, 0.15], [-0.005, 0.45, d]),
            p.accent,
        ),
        (
            block([0.005, 0.3 - sunk, 0.15], [w / 2.0 - 0.15, 0.45, d]),
            p.accent,
        ),
        (block([-w / 2.0, 0.06, 0.0], [w / 2.0, 0.8, 0.2]), p.cloth),
        (
            block([-w / 2.0, 0.06, 0.0], [-w / 2.0 + 0.15, 0.6, d]),
            p.cloth,
        ),
        (
            block([w / 2.0 - 0.15, 0.06, 0.0], [w / 2.0, 0.6, d]),
            p.cloth,
        ),
        (post([-w / 2.0 + 0.1, 0.1], 0.0, [0.06, 0.06, 0.06]), p.wood),
        (post([w / 2.0 - 0.1, 0.1], 0.0, [0.06, 0.06, 0.06]), p.wood),
    ]
}

pub(super) fn bed(rng: &mut Random, p: &Palette) -> Parts {
    let (w, l) = (rng.metres(0.9, 2.0), 2.05);
    vec![
        (block([-w / 2.0, 0.0, 0.0], [w / 2.0, 0.3, l]), p.wood),
        (
            block(
                [-w / 2.0 + 0.02, 0.28, 0.05],
                [w / 2.0 - 0.02, 0.5, l - 0.02],
            ),
            p.pale,
        ),
        (
            block(
                [-w / 2.0 - 0.02, 0.2, 0.6],
                [w / 2.0 + 0.02, 0.53, l + 0.02],
            ),
            p.cloth,
        ),
        (
            block([-w / 2.0 + 0.1, 0.49, 0.1], [-0.02, 0.6, 0.5]),
            p.pale,
        ),
        (block([0.02, 0.49, 0.1], [w / 2.0 - 0.1, 0.6, 0.5]), p.pale),
        (block([-w / 2.0, 0.0, -0.04], [w / 2.0, 1.0, 0.0]), p.wood),
    ]
}

/// A shelf with intersecting boards and books.
pub(super) fn shelf(rng: &mut Random, p: &Palette) -> Parts {
    let (w, h, d) = (
        rng.metres(0.6, 1.6),
        rng.metres(0.9, 2.2),
        rng.metres(0.25, 0.4),
    );
    let t = rng.pick(&[0.01, 0.02, 0.03]);
    let mut out = vec![
        (block([-w / 2.0, 0.0, 0.0], [-w / 2.0 + t, h, d]), p.wood),
        (block([w / 2.0 - t, 0.0, 0.0], [w / 2.0, h, d]), p.wood),
    ];
    if rng.chance(0.7) {
        out.push((block([-w / 2.0, 0.0, 0.0], [w / 2.0, h, 0.006]), p.wood));
    }
    let n = rng.int(3, 6);
    // Boards abut the sides, or run through them.
    let inset = if rng.chance(0.5) { t } else { 0.0 };
    for i in 0..n {
        let y = (h - t) * i as f32 / (n - 1) as f32;
        let board = block([-w / 2.0 + inset, y, 0.0], [w / 2.0 - inset, y + t, d]);
        out.push((board, p.wood));
        let mut x = -w / 2.0 + t;
        while i + 1 < n && x < w / 2.0 - 0.15 {
            if rng.chance(0.35) {
                x += rng.range(0.05, 0.3);
                continue;
            }
            let (bw, bh) = (rng.range(0.02, 0.06), rng.range(0.6, 0.95));
            let top = y + t + (h - t) / (n - 1) as f32 * bh - t;
            let book = block([x, y + t, 0.02], [x + bw, top.max(y + t + 0.05), d * 0.8]);
            out.push((book, rng.pick(&[p.cloth, p.accent, p.pale])));
            x += bw;
        }
    }
    out
}

/// A closed cupboard: a body and doors that hover slightly in front of it.
pub(super) fn cupboard(rng: &mut Random, p: &Palette) -> Parts {
    let (w, h, d) = (
        rng.metres(0.5, 1.8),
        rng.metres(0.7, 2.3),
        rng.metres(0.35, 0.65),
    );
    let mut out = vec![(block([-w / 2.0, 0.0, 0.0], [w / 2.0, h, d]), p.wood)];
    let gap = rng.pick(&[0.0, 0.001, 0.003]);
    let n = rng.int(1, 3);
    for i in 0..n {
        let at = |k: u32| -w / 2.0 + w * k as f32 / n as f32;
        let leaf = block(
            [at(i) + 0.003, 0.05, d + gap],
            [at(i + 1) - 0.003, h - 0.003, d + gap + 0.018],
        );
        out.push((leaf, p.pale));
        out.push((
            post([at(i) + 0.06, d + 0.03], h / 2.0, [0.02, 0.12, 0.04]),
            p.metal,
        ));
    }
    out
}

/// A barrel of rings with `sides` sides.
pub(super) fn barrel(rng: &mut Random, p: &Palette) -> Parts {
    let (r, h, n) = (rng.metres(0.2, 0.4), rng.metres(0.6, 1.0), rng.int(6, 14));
    let z = Vec3::Z * (r * 1.15);
    let profile = [(0.0, 0.85), (0.3, 1.05), (0.7, 1.05), (1.0, 0.85)];
    let mut out = vec![
        (frustums(n, r, h, &profile).moved(z), p.wood),
        (column(n, r * 1.08, [h * 0.27, h * 0.33]).moved(z), p.metal),
        (column(n, r * 1.08, [h * 0.67, h * 0.73]).moved(z), p.metal),
    ];
    if rng.chance(0.4) {
        out.push((column(n, r * 0.85, [h, h + 0.02]).moved(z), p.wood));
    }
    out
}

/// A closed solid of revolution with flat sides; `profile` holds shares of the height and the
/// radius.
pub(super) fn frustums(n: u32, r: f32, h: f32, profile: &[(f32, f32)]) -> Geometry {
    let at = |(y, k): (f32, f32), i: u32| {
        let q = ring(n, r * k)[(i % n) as usize];
        Vec3::new(q.x, y * h, q.y)
    };
    let mut out = Geometry::default();
    for pair in profile.windows(2) {
        for i in 0..n {
            out.append(&quad([
                at(pair[0], i),
                at(pair[0], i + 1),
                at(pair[1], i + 1),
                at(pair[1], i),
            ]));
        }
    }
    let mut cap = |p: (f32, f32), up: bool| {
        let c = Vec3::Y * p.0 * h;
        for i in 0..n {
            let (a, b) = if up { (i, i + 1) } else { (i + 1, i) };
            let base = out.positions.len() as u32;
            out.positions.extend([c, at(p, a), at(p, b)]);
            out.normals.extend([if up { Vec3::Y } else { -Vec3::Y }; 3]);
            out.uv.extend([Vec2::ZERO; 3]);
            out.triangles.push([base, base + 1, base + 2]);
        }
    };
    cap(profile[profile.len() - 1], true);
    cap(profile[0], false);
    out
}

/// A low-poly rock.
pub(super) fn rock(rng: &mut Random, radius: f32, level: u32) -> Geometry {
    let seed = rng.int(0, 1 << 20);
    let squeeze = Vec3::new(
        rng.range(0.7, 1.3),
        rng.range(0.5, 0.9),
        rng.range(0.7, 1.3),
    );
    rock_of(seed, squeeze * radius, level)
}

/// A sphere with flat facets, squeezed and bumped: the same shape at each `level` of detail.
pub(super) fn rock_of(seed: u32, radii: Vec3, level: u32) -> Geometry {
    let mut g = icosphere(Vec3::ZERO, 1.0, level);
    for p in &mut g.positions {
        let bump = 1.0 + 0.3 * super::random::noise(*p * 1.7, seed);
        *p *= radii * bump;
    }
    faceted(g)
}

/// With a vertex for each corner, flat normals, and placeholder texture coordinates.
pub(super) fn faceted(g: Geometry) -> Geometry {
    let mut out = Geometry::default();
    for t in &g.triangles {
        let [a, b, c] = t.map(|i| g.positions[i as usize]);
        let n = (b - a).cross(c - a);
        if n.length_squared() < 1e-16 {
            continue;
        }
        let base = out.positions.len() as u32;
        out.positions.extend([a, b, c]);
        out.normals.extend([n.normalize(); 3]);
        out.uv.extend([Vec2::ZERO; 3]);
        out.triangles.push([base, base + 1, base + 2]);
    }
    out
}

/// An arch of stones over an opening `w` wide and `d` deep that springs at `y`, centred in x and z.
pub(super) fn arch(stones: u32, w: f32, y: f32, d: f32, t: f32) -> Geometry {
    let mut out = Geometry::default();
    for i in 0..stones {
        let at = |k: u32, r: f32, z: f32| {
            let (s, c) = sin_cos(180.0 * k as f32 / stones as f32);
            Vec3::new(c * r, y + s * r, z)
        };
        let (r0, r1, z0, z1) = (w / 2.0, w / 2.0 + t, -d / 2.0, d / 2.0);
        let corner = |k: u32, outer: bool, front: bool| {
            at(k, if outer { r1 } else { r0 }, if front { z1 } else { z0 })
        };
        let (a, b) = (i, i + 1);
        for q in [
            [
                (a, false, true),
                (a, true, true),
                (b, true, true),
                (b, false, true),
            ],
            [
                (b, false, false),
                (b, true, false),
                (a, true, false),
                (a, false, false),
            ],
            [
                (a, true, true),
                (a, true, false),
                (b, true, false),
                (b, true, true),
            ],
            [
                (b, false, true),
                (b, false, false),
                (a, false, false),
                (a, false, true),
            ],
            [
                (a, false, true),
                (a, false, false),
                (a, true, false),
                (a, true, true),
            ],
            [
                (b, true, true),
                (b, true, false),
                (b, false, false),
                (b, false, true),
            ],
        ] {
            out.append(&quad(q.map(|(k, outer, front)| corner(k, outer, front))));
        }
    }
    out
}

/// Intersecting boxes, each a step higher and extending down to the floor or to the middle of the
/// previous one.
pub(super) fn stairs(
    n: u32,
    rise: f32,
    run: f32,
    w: f32,
    overlap: f32,
    to_floor: bool,
) -> Geometry {
    let mut out = Geometry::default();
    for i in 0..n {
        let (y, z) = (rise * i as f32, run * i as f32);
        let low = if to_floor {
            0.0
        } else {
            (y - rise * 0.5).max(0.0)
        };
        out.append(&block(
            [-w / 2.0, low, z],
            [w / 2.0, y + rise, z + run + overlap],
        ));
    }
    out
}

/// A cabin closed on three sides, with an open top, on a tray; the open side faces +z.
pub(super) fn shower(rng: &mut Random, p: &Palette) -> Parts {
    let (w, h, t) = (
        rng.metres(0.8, 1.1),
        rng.metres(1.9, 2.2),
        rng.pick(&[0.005, 0.01, 0.03]),
    );
    let mut out = vec![
        (block([-w / 2.0, 0.0, 0.0], [w / 2.0, 0.08, w]), p.pale),
        (block([-w / 2.0, 0.08, 0.0], [w / 2.0, h, t]), p.pale),
        (block([-w / 2.0, 0.08, 0.0], [-w / 2.0 + t, h, w]), p.pale),
        (block([w / 2.0 - t, 0.08, 0.0], [w / 2.0, h, w]), p.pale),
    ];
    let door = rng.range(0.4, 0.75);
    out.push((
        block([-w / 2.0, 0.08, w - t], [-w / 2.0 + w * (1.0 - door), h, w]),
        p.pale,
    ));
    if rng.chance(0.3) {
        out.push((block([-w / 2.0, h, 0.0], [w / 2.0, h + t, w]), p.pale));
    }
    out.push((post([0.0, 0.15], h - 0.15, [0.12, 0.02, 0.12]), p.metal));
    out
}

/// A tub of five boards.
pub(super) fn tub(rng: &mut Random, p: &Palette) -> Parts {
    let (w, d, h) = (
        rng.metres(1.4, 1.8),
        rng.metres(0.7, 0.85),
        rng.metres(0.5, 0.6),
    );
    let t = 0.06;
    let rim = |min: [f32; 3], max: [f32; 3]| (block(min, max), p.pale);
    vec![
        rim([-w / 2.0, 0.0, 0.0], [w / 2.0, h, t]),
        rim([-w / 2.0, 0.0, d - t], [w / 2.0, h, d]),
        rim([-w / 2.0, 0.0, t], [-w / 2.0 + t, h, d - t]),
        rim([w / 2.0 - t, 0.0, t], [w / 2.0, h, d - t]),
        rim([-w / 2.0 + t, 0.0, t], [w / 2.0 - t, 0.12, d - t]),
    ]
}

pub(super) fn sink(_: &mut Random, p: &Palette) -> Parts {
    vec![
        (block([-0.25, 0.0, 0.02], [0.25, 0.7, 0.4]), p.wood),
        (block([-0.3, 0.7, 0.0], [0.3, 0.85, 0.5]), p.pale),
        (post([0.0, 0.08], 0.85, [0.03, 0.15, 0.03]), p.metal),
        (block([-0.3, 1.1, 0.0], [0.3, 1.8, 0.01]), p.metal),
    ]
}

pub(super) fn toilet(_: &mut Random, p: &Palette) -> Parts {
    vec![
        (block([-0.2, 0.0, 0.1], [0.2, 0.4, 0.65]), p.pale),
        (block([-0.2, 0.35, 0.0], [0.2, 0.85, 0.18]), p.pale),
        (block([-0.21, 0.4, 0.15], [0.21, 0.43, 0.68]), p.pale),
    ]
}

/// A standing lamp without its light: a foot, a pole and a shade that is open above and below.
pub(super) fn floor_lamp(rng: &mut Random, p: &Palette) -> Parts {
    let (h, n) = (rng.metres(1.3, 1.7), rng.int(6, 16));
    let z = Vec3::Z * 0.25;
    vec![
        (column(n, 0.14, [0.0, 0.02]).moved(z), p.metal),
        (column(6, 0.012, [0.0, h]).moved(z), p.metal),
        (column(n, 0.04, [h - 0.02, h + 0.02]).moved(z), p.metal),
    ]
}

/// A picture or mirror frame, to hang at eye level.
pub(super) fn picture(rng: &mut Random, p: &Palette) -> Parts {
    let (w, h) = (rng.metres(0.3, 1.2), rng.metres(0.3, 0.9));
    vec![
        (
            block([-w / 2.0, -h / 2.0, 0.0], [w / 2.0, h / 2.0, 0.02]),
            p.wood,
        ),
        (
            block(
                [-w / 2.0 + 0.03, -h / 2.0 + 0.03, 0.01],
                [w / 2.0 - 0.03, h / 2.0 - 0.03, 0.022],
            ),
            p.accent,
        ),
    ]
}

/// The extent of parts.
pub(super) fn bounds(parts: &Parts) -> (Vec3, Vec3) {
    (parts.iter().flat_map(|(g, _)| &g.positions))
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| {
            (a.min(*p), b.max(*p))
        })
}
