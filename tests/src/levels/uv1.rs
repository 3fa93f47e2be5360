//! Levels with their own lightmap coordinates: valid ones, and ones that overlap, leave the unit
//! square, are mirrored, or lack padding.

use glam::{Vec2, Vec3};

use super::kit::{Kit, place};
use super::plan::Room;
use super::shapes::{Palette, Parts, barrel, block, chair, column, cupboard, shelf, sofa, table};
use crate::geometry::{Geometry, grid};

/// Fault of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    /// All islands fill the whole square.
    Overlap,
    /// Beyond 0..1.
    Beyond,
    /// Every other island mirrored.
    Mirrored,
    /// Islands touch.
    Tight,
    /// Each triangle an island.
    Shattered,
}

pub(super) fn make(kit: &mut Kit) {
    let faults = [
        Fault::None,
        Fault::None,
        Fault::Overlap,
        Fault::Beyond,
        Fault::Mirrored,
        Fault::Tight,
        Fault::Shattered,
    ];
    // The same fault for all, or one per object.
    let all = kit.rng.pick(&faults);
    let mixed = kit.rng.chance(0.4);
    let fault = |kit: &mut Kit| if mixed { kit.rng.pick(&faults) } else { all };
    let (w, d, h) = (
        kit.rng.metres(3.5, 7.0),
        kit.rng.metres(3.5, 7.0),
        kit.rng.metres(2.4, 3.5),
    );
    let level = kit.rng.range(0.4, 0.9);
    let rho = kit.rng.colour(level, 0.1);
    let paint = kit.paint("room", rho);
    let n = kit.count(2, [2, 9]);
    // The room in one mesh, subdivided as modellers do, or its boxes.
    let mut parts: Parts = Vec::new();
    if kit.rng.chance(0.5) {
        let (x, y, z) = (Vec3::X * w, Vec3::Y * h, Vec3::Z * d);
        for (o, u, v) in [
            (Vec3::ZERO, y, z),
            (x, z, y),
            (Vec3::ZERO, z, x),
            (y, x, z),
            (Vec3::ZERO, x, y),
            (z, y, x),
        ] {
            parts.push((grid(o, u, v, [n, n]), paint));
        }
    } else {
        let t = kit.rng.pick(&[0.05, 0.2]);
        parts.push((block([-t, -t, -t], [w + t, 0.0, d + t]), paint));
        parts.push((block([-t, h, -t], [w + t, h + t, d + t]), paint));
        parts.push((block([-t, 0.0, -t], [w + t, h, 0.0]), paint));
        parts.push((block([-t, 0.0, d], [w + t, h, d + t]), paint));
        parts.push((block([-t, 0.0, 0.0], [0.0, h, d]), paint));
        parts.push((block([w, 0.0, 0.0], [w + t, h, d]), paint));
    }
    kit.solid = false;
    let wrong = fault(kit);
    let parts = unwrapped(kit, &parts, wrong);
    kit.item("room", &parts, place(Vec3::ZERO, 0.0));
    kit.solid = true;
    let mut room = Room {
        min: Vec3::ZERO,
        max: Vec3::new(w, h, d),
        taken: Vec::new(),
    };
    kit.space(Vec3::new(0.4, 0.0, 0.4), Vec3::new(w - 0.4, h, d - 0.4));
    let target = kit.rng.range(0.3, 1.0);
    room.light(kit, "lamp", target);
    let p = Palette::draw(kit, false);
    type Make = fn(&mut super::random::Random, &Palette) -> Parts;
    for k in 0..kit.count(2, [4, 12]) {
        let make = kit
            .rng
            .pick(&[table as Make, chair, cupboard, shelf, sofa, barrel]);
        let mut parts = make(&mut kit.rng, &p);
        if kit.rng.chance(0.2) {
            parts = vec![(column(24, 0.3, [0.0, h]).moved(Vec3::Z * 0.3), p.pale)];
        }
        let wrong = fault(kit);
        let parts = unwrapped(kit, &parts, wrong);
        let gap = kit.rng.pick(&[0.0, 0.01, 0.2]);
        room.stand(kit, &format!("thing_{k}"), &parts, gap, 0.0, false);
    }
}

/// The island of each triangle: triangles that share vertices belong together.
fn islands(g: &Geometry) -> Vec<Vec<usize>> {
    let mut parent: Vec<usize> = (0..g.positions.len()).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    for t in &g.triangles {
        let [a, b, c] = t.map(|i| root(&mut parent, i as usize));
        let least = a.min(b).min(c);
        for i in [a, b, c] {
            parent[i] = least;
        }
    }
    let mut of = vec![usize::MAX; g.positions.len()];
    let mut out: Vec<Vec<usize>> = Vec::new();
    for (k, t) in g.triangles.iter().enumerate() {
        let r = root(&mut parent, t[0] as usize);
        if of[r] == usize::MAX {
            of[r] = out.len();
            out.push(Vec::new());
        }
        out[of[r]].push(k);
    }
    out
}

/// With islands laid out in rows of equal cells, and `fault` applied to them.
fn unwrapped(kit: &mut Kit, parts: &Parts, fault: Fault) -> Parts {
    let mut parts: Parts = (parts.iter())
        .map(|(g, m)| {
            let mut g = g.clone();
            if fault == Fault::Shattered {
                g = super::shapes::faceted(g);
            }
            (g, *m)
        })
        .collect();
    let count: usize = parts.iter().map(|(g, _)| islands(g).len()).sum();
    let row = (1..).find(|n| n * n >= count).unwrap_or(1);
    let cell = 1.0 / row as f32;
    let padding = match fault {
        Fault::Tight => 0.0,
        _ => cell * kit.rng.pick(&[0.05, 0.1, 0.2]),
    };
    let mut k = 0;
    for (g, _) in &mut parts {
        if g.uv.is_empty() {
            g.uv = vec![Vec2::ZERO; g.positions.len()];
        }
        g.uv1 = vec![Vec2::ZERO; g.positions.len()];
        for island in islands(g) {
            let [a, b, c] = g.triangles[island[0]].map(|i| g.positions[i as usize]);
            let n = (b - a).cross(c - a).normalize_or(Vec3::Y);
            let x = n.any_orthonormal_vector();
            let y = n.cross(x);
            let flat = |p: Vec3| Vec2::new(p.dot(x), p.dot(y));
            let corners = || island.iter().flat_map(|t| g.triangles[*t]);
            let (lo, hi) = corners().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(l, h), i| {
                let p = flat(g.positions[i as usize]);
                (l.min(p), h.max(p))
            });
            let size = (hi - lo).max(Vec2::splat(1e-4));
            let mirror = fault == Fault::Mirrored && k % 2 == 1;
            let origin = Vec2::new((k % row) as f32, (k / row) as f32) * cell + padding / 2.0;
            let all: Vec<u32> = corners().collect();
            for i in all {
                let mut q = (flat(g.positions[i as usize]) - lo) / size;
                if mirror {
                    q.x = 1.0 - q.x;
                }
                g.uv1[i as usize] = match fault {
                    Fault::Overlap => q,
                    Fault::Beyond => (origin + q * (cell - padding)) * 2.5 - 0.7,
                    _ => origin + q * (cell - padding),
                };
            }
            k += 1;
        }
    }
    parts
}
