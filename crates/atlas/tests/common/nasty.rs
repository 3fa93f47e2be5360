//! Meshes on which unwrappers hang, crash or give nonsense. Used by the tests and by
//! `examples/unwrap_compare --hard`.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

/// A mesh: name, positions, triangles.
pub type Nasty = (&'static str, Vec<Vec3>, Vec<[u32; 3]>);

/// All of them; `full` makes the largest ones full size (100,000 loose triangles, a blob of
/// 500,000).
pub fn nasty(full: bool) -> Vec<Nasty> {
    let mut out = degenerate();
    out.extend(tangled());
    out.extend(winding());
    out.extend(smooth());
    out.extend(large(full));
    out
}

fn degenerate() -> Vec<Nasty> {
    let triangle = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let line = (0..30).map(|i| Vec3::X * i as f32).collect();
    let (positions, once) = sphere(8);
    let thrice = [once.clone(), once.clone(), once].concat();
    let sliver = |i: u32| Vec3::new((i / 2) as f32, 1e-6 * (i % 2) as f32, 0.0);
    let (grid, mut cells) = surface(6, 6, |u, v| Vec3::new(u, v, 0.0));
    cells.extend((0..20).map(|i| [i, i, i + 1]));
    cells.extend((0..20).map(|i| [i, i + 1, i]));
    vec![
        ("single triangle", triangle.clone(), vec![[0, 1, 2]]),
        ("two sides", triangle, vec![[0, 1, 2], [0, 2, 1]]),
        ("all vertices equal", vec![Vec3::ONE; 60], strip(60)),
        ("all on a line", line, strip(30)),
        ("three times the same", positions, thrice),
        ("slivers of 1e6", (0..200).map(sliver).collect(), strip(200)),
        ("with zero-area triangles", grid, cells),
        ("scale 1e-4", scaled(sphere(10).0, 1e-4), sphere(10).1),
        ("scale 1e6", scaled(sphere(10).0, 1e6), sphere(10).1),
        (
            "details of 1e-3 on a plane of 1e3",
            details().0,
            details().1,
        ),
    ]
}

fn tangled() -> Vec<Nasty> {
    // A thousand pages of a book: all triangles share one edge.
    let mut book = vec![Vec3::ZERO, Vec3::Y];
    book.extend((0..1000).map(|i| around(i as f32 / 1000.0, 1.0, 0.5)));
    // All triangles between some random points: every edge has as many.
    let mut r = random(5);
    let points: Vec<Vec3> = (0..24).map(|_| Vec3::new(r(), r(), r())).collect();
    let n = points.len() as u32;
    let complex = (0..n)
        .flat_map(|a| (a + 1..n).flat_map(move |b| (b + 1..n).map(move |c| [a, b, c])))
        .collect();
    let bow = (0..40)
        .map(|i| {
            if i % 2 == 0 {
                around(i as f32 / 40.0, 1.0, 0.0)
            } else {
                around(i as f32 / 40.0, 1.2, 0.1)
            }
        })
        .chain([Vec3::ZERO])
        .collect();
    let ties = (0..20).map(|i| [40, 2 * i, 2 * i + 1]).collect();
    let mut r = random(11);
    let soup = (0..300).map(|_| Vec3::new(r(), r(), r())).collect();
    let mut pick = random(12);
    let mut corner = || (pick() * 299.9) as u32;
    let soup_triangles = (0..900).map(|_| [corner(), corner(), corner()]).collect();
    let (mut crossing, mut two) = sphere(12);
    let first = crossing.len() as u32;
    crossing.extend(sphere(12).0.iter().map(|p| *p + Vec3::X * 0.7));
    two.extend(sphere(12).1.iter().map(|t| t.map(|v| v + first)));
    let mut shells = (Vec::new(), Vec::new());
    for i in 0..12 {
        let first = shells.0.len() as u32;
        shells.0.extend(scaled(sphere(6).0, 1.0 + 1e-3 * i as f32));
        shells
            .1
            .extend(sphere(6).1.iter().map(|t| t.map(|v| v + first)));
    }
    vec![
        (
            "book of 1000 pages",
            book,
            (0..1000).map(|i| [0, 1, i + 2]).collect(),
        ),
        ("complete complex", points, complex),
        ("bow ties", bow, ties),
        ("soup of shared vertices", soup, soup_triangles),
        ("self-intersecting", crossing, two),
        ("nested shells", shells.0, shells.1),
        ("T-junctions", t_junctions().0, t_junctions().1),
        ("checkerboard holes", checkerboard().0, checkerboard().1),
    ]
}

fn winding() -> Vec<Nasty> {
    let moebius = |u: f32, v: f32| {
        let (a, s) = (TAU * u, v - 0.5);
        let r = 1.0 + s * (a / 2.0).cos();
        Vec3::new(r * a.cos(), s * (a / 2.0).sin(), r * a.sin())
    };
    let klein = |u: f32, v: f32| {
        let (a, b) = (TAU * u, TAU * v);
        let r = 3.0 + (a / 2.0).cos() * b.sin() - (a / 2.0).sin() * (2.0 * b).sin();
        let y = (a / 2.0).sin() * b.sin() + (a / 2.0).cos() * (2.0 * b).sin();
        Vec3::new(r * a.cos(), y, r * a.sin())
    };
    let (band, band_triangles) = welded(surface(64, 4, moebius));
    let (bottle, bottle_triangles) = welded(surface(48, 24, klein));
    let (inverted, faces) = sphere(9);
    let faces = faces.iter().map(|t| [t[0], t[2], t[1]]).collect();
    let (grid, cells) = surface(12, 12, |u, v| Vec3::new(u, 0.1 * u * v, v));
    let back = cells.iter().map(|t| [t[0], t[2], t[1]]);
    let sheet = cells.iter().copied().chain(back).collect();
    let mixed = cells
        .iter()
        .enumerate()
        .map(|(i, t)| if i % 3 == 0 { [t[0], t[2], t[1]] } else { *t })
        .collect();
    // Twice around a point, flat: any one-piece parametrisation overlaps.
    let mut twice = vec![Vec3::ZERO];
    twice.extend((0..=64).map(|i| around(i as f32 / 32.0, 1.0 + 1e-3 * i as f32, 1e-5 * i as f32)));
    let (ribbon, pieces) = surface(400, 1, |u, v| around(6.0 * u, 1.0 + 8.0 * u, 0.4 * v));
    let (helix, steps) = surface(300, 2, |u, v| around(9.0 * u, 0.5 + v, 4.0 * u));
    vec![
        ("Moebius strip", band, band_triangles),
        ("Klein bottle", bottle, bottle_triangles),
        ("inverted", inverted, faces),
        ("sheet with a back", grid.clone(), sheet),
        ("windings mixed", grid, mixed),
        (
            "twice round a point",
            twice,
            (1..65).map(|i| [0, i + 1, i]).collect(),
        ),
        ("rolled-up sheet", ribbon, pieces),
        ("helix", helix, steps),
        ("Hilbert ribbon", hilbert().0, hilbert().1),
    ]
}

fn smooth() -> Vec<Nasty> {
    let torus = |u: f32, v: f32| {
        let tube = 1.0 + 0.4 * (TAU * v).cos();
        around(u, tube, 0.4 * (TAU * v).sin())
    };
    let knot = |u: f32, v: f32| {
        let at = |a: f32| {
            let r = 2.0 + (3.0 * a).cos();
            Vec3::new(r * (2.0 * a).cos(), (3.0 * a).sin(), r * (2.0 * a).sin())
        };
        let (a, b) = (TAU * u, TAU * v);
        let along = (at(a + 1e-2) - at(a - 1e-2)).normalize();
        let side = along.cross(Vec3::Y).normalize();
        at(a) + (side * b.cos() + along.cross(side) * b.sin()) * 0.3
    };
    // Seven hundred degrees of surface around one point: too much to flatten.
    let saddle = |u: f32, v: f32| around(u, v, 0.6 * v * (6.0 * TAU * u).sin());
    let cone = |u: f32, v: f32| around(u, 0.01 * v, 5.0 * v);
    let mut r = random(21);
    let paper: Vec<f32> = (0..40 * 40).map(|_| r()).collect();
    let crumpled = |u: f32, v: f32| {
        let i = (u * 38.9) as usize * 40 + (v * 38.9) as usize;
        Vec3::new(u * 4.0, 0.3 * paper[i], v * 4.0)
    };
    let comb = |u: f32, v: f32| {
        let tooth = (u * 199.0) as u32 % 2;
        Vec3::new(u * 10.0, 0.0, v * if tooth == 0 { 0.1 } else { 5.0 })
    };
    let mut out: Vec<Nasty> = Vec::new();
    for (name, (positions, triangles)) in [
        ("sphere", sphere(40)),
        ("torus", welded(surface(48, 24, torus))),
        ("torus knot", welded(surface(400, 16, knot))),
        ("ruffled saddle", welded(surface(144, 12, saddle))),
        ("needle cone", welded(surface(32, 24, cone))),
        ("crumpled paper", surface(39, 39, crumpled)),
        ("comb", surface(199, 1, comb)),
        ("fan of 1000", fan(1000)),
    ] {
        out.push((name, positions, triangles));
    }
    out
}

fn large(full: bool) -> Vec<Nasty> {
    let mut r = random(3);
    let n = if full { 100_000u32 } else { 5000 };
    let mut loose = Vec::new();
    for _ in 0..n {
        let at = Vec3::new(r(), r(), r()) * 100.0;
        loose.extend((0..3).map(|_| at + Vec3::new(r(), r(), r()) * 0.5));
    }
    let mut r = random(9);
    let side = if full { 200 } else { 60 };
    let noise: Vec<f32> = (0..(side + 1) * (side + 1)).map(|_| r()).collect();
    let at = |u: f32, v: f32| {
        let (x, y) = ((u * side as f32).round(), (v * side as f32).round());
        Vec3::new(
            x,
            2.0 * noise[(x as u32 * (side + 1) + y as u32) as usize],
            y,
        )
    };
    let (terrain, cells) = surface(side, side, at);
    let (lumpy, faces) = blob(if full { 355 } else { 60 });
    vec![
        (
            "loose triangles",
            loose,
            (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        ),
        ("noise terrain", terrain, cells),
        ("blob", lumpy, faces),
    ]
}

/// The point at `turn` turns about y, `radius` from it.
fn around(turn: f32, radius: f32, y: f32) -> Vec3 {
    Vec3::new(radius * (TAU * turn).cos(), y, radius * (TAU * turn).sin())
}

fn scaled(mut positions: Vec<Vec3>, by: f32) -> Vec<Vec3> {
    positions.iter_mut().for_each(|p| *p *= by);
    positions
}

/// Triangles of a strip of `n` vertices with consistent winding.
fn strip(n: u32) -> Vec<[u32; 3]> {
    (0..n - 2)
        .map(|i| {
            if i % 2 == 0 {
                [i, i + 2, i + 1]
            } else {
                [i, i + 1, i + 2]
            }
        })
        .collect()
}

/// A grid of `columns` × `rows` quads on the surface `f` of 0..1 × 0..1.
fn surface(columns: u32, rows: u32, f: impl Fn(f32, f32) -> Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions = (0..=rows)
        .flat_map(|y| (0..=columns).map(move |x| (x, y)))
        .map(|(x, y)| f(x as f32 / columns as f32, y as f32 / rows as f32))
        .collect();
    let mut triangles = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            let a = y * (columns + 1) + x;
            let b = a + columns + 1;
            triangles.extend([[a, b, a + 1], [a + 1, b, b + 1]]);
        }
    }
    (positions, triangles)
}

/// Welds vertices closer than 1e-4, so that surfaces close.
fn welded((positions, triangles): (Vec<Vec3>, Vec<[u32; 3]>)) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut first = std::collections::BTreeMap::new();
    let number: Vec<u32> = (0..positions.len())
        .map(|i| {
            let key = (positions[i] * 1e4).round().as_ivec3().to_array();
            *first.entry(key).or_insert(i as u32)
        })
        .collect();
    let triangles = triangles
        .iter()
        .map(|t| t.map(|v| number[v as usize]))
        .collect();
    (positions, triangles)
}

fn sphere(rings: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    welded(surface(2 * rings, rings, |u, v| {
        around(-u, (PI * v).sin(), (PI * v).cos())
    }))
}

fn fan(n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = vec![Vec3::ZERO];
    positions.extend((0..n).map(|i| around(i as f32 / n as f32, 3.0, 0.0)));
    let triangles = (0..n).map(|i| [0, 1 + (i + 1) % n, 1 + i]).collect();
    (positions, triangles)
}

/// A plane of 1 km with a hundred spheres of a millimetre on it.
fn details() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = surface(2, 2, |u, v| Vec3::new(v, 0.0, u) * 1000.0);
    for i in 0..100 {
        let first = positions.len() as u32;
        let at = Vec3::new((i % 10) as f32, 1.0, (i / 10) as f32);
        positions.extend(sphere(4).0.iter().map(|p| at + *p * 1e-3));
        triangles.extend(sphere(4).1.iter().map(|t| t.map(|v| v + first)));
    }
    (positions, triangles)
}

/// Quads of halving size side by side: no two rows share vertices.
fn t_junctions() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut z = 0.0;
    for level in 0..6 {
        let side = 0.5f32.powi(level);
        for i in 0..(4 << level) {
            let first = positions.len() as u32;
            let p = |x: f32, y: f32| Vec3::new((i as f32 + x) * side, 0.0, z + y * side);
            positions.extend([p(0.0, 0.0), p(0.0, 1.0), p(1.0, 1.0), p(1.0, 0.0)]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        z += side;
    }
    (positions, triangles)
}

/// A grid without every other quad: the rest are connected only by vertices.
fn checkerboard() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (positions, triangles) = surface(30, 30, |u, v| Vec3::new(v, 0.0, u) * 3.0);
    let kept = triangles
        .chunks_exact(2)
        .enumerate()
        .filter(|(i, _)| (i % 30 + i / 30) % 2 == 0)
        .flat_map(|(_, quad)| quad.to_vec())
        .collect();
    (positions, kept)
}

/// A flat ribbon along Hilbert's curve of 4096 steps.
fn hilbert() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let side = 64u32;
    let at = |step: u32| {
        let (mut x, mut y, mut t, mut s) = (0, 0, step, 1);
        while s < side {
            let (rx, ry) = (1 & (t / 2), 1 & (t ^ (1 & (t / 2))));
            if ry == 0 {
                if rx == 1 {
                    (x, y) = (s - 1 - x, s - 1 - y);
                }
                (x, y) = (y, x);
            }
            (x, y) = (x + s * rx, y + s * ry);
            t /= 4;
            s *= 2;
        }
        Vec2::new(x as f32, y as f32)
    };
    let mut positions = Vec::new();
    for i in 0..side * side {
        let before = at(i.saturating_sub(1));
        let after = at((i + 1).min(side * side - 1));
        // Mitred, so that the ribbon keeps its width at corners.
        let along = (at(i) - before)
            .try_normalize()
            .unwrap_or((after - at(i)).normalize_or(Vec2::X));
        let next = (after - at(i)).try_normalize().unwrap_or(along);
        let side = (along.perp() + next.perp()) * if along == next { 0.15 } else { 0.3 };
        let side = if along == next {
            side
        } else {
            side * 0.5 * 1.0
        };
        for s in [side, -side] {
            let p = at(i) + s;
            positions.push(Vec3::new(p.x, 0.0, p.y) * 0.25);
        }
    }
    let n = positions.len() as u32;
    (positions, strip(n))
}

/// A lumpy sphere of about 4 n² triangles.
fn blob(n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (positions, triangles) = welded(surface(2 * n, n, |u, v| {
        around(-u, (PI * v).sin(), (PI * v).cos())
    }));
    let lumpy = |p: Vec3| {
        p * (3.0 + 0.3 * (7.0 * p.x).sin() * (9.0 * p.y).cos() + 0.1 * (31.0 * p.z).sin())
    };
    (positions.into_iter().map(lumpy).collect(), triangles)
}

fn random(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 40) as f32 / (1u64 << 24) as f32
    }
}
