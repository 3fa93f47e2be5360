//! Places where the same point of a surface lies at two places of the lightmap.

use atlas::{Layout, Lumels};
use glam::{Vec2, Vec3};
use radiosity::World;
use rayon::prelude::*;

use crate::seams::border::{Piece, border_pieces};
use crate::seams::tree::BoxTree;

/// A point of a seam.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Page and place on it, texels, of either side. Texel (c, r) has its centre at (c + ½, r + ½).
    pub sides: [(u32, Vec2); 2],
    /// Where a texel of the denser side along the seam leads to on either page, texels.
    pub along: [Vec2; 2],
    /// Length of the seam that it stands for, texels of the denser side.
    pub texels: f32,
    /// The same in metres.
    pub metres: f32,
}

/// Borders this far apart still meet, in texels of the denser side: a twentieth of a texel is no
/// gap that one sees.
const TEXELS_APART: f32 = 0.05;

/// Nor may it be more than this share of the shorter edge, or small things would meet their own far
/// side.
const EDGES_APART: f32 = 0.01;

/// Sine of the angle between edges that run along each other; at 1 : 100 of [`EDGES_APART`] they
/// could hardly differ more.
const EDGES_ASKEW: f32 = 0.02;

/// Cosine of 8°: normals that differ by more describe a crease, where light truly jumps.
const SAME_FACING: f32 = 0.990;

/// Cosine of 65°: across a sharper fold each side has its own horizon, and light truly jumps
/// whatever the shading normals say. The same angle at which the unwrapping parts charts.
const SHARPEST_FOLD: f32 = 0.423;

/// Two triangles that lie on the same side of their common edge (a fold back, a double layer) are
/// not each other's continuation: cosine between their directions away from it, at most.
const FOLDED_BACK: f32 = 0.5;

/// The same place on one page: lookups there agree by themselves, texels.
const SAME_PLACE: f32 = 1e-3;

/// Distance of samples along a seam, texels of the denser side. Lookups of either side have a knot
/// per texel: two samples between knots are the least that sees a zigzag.
const SPACING: f32 = 0.125;

/// Samples for each texel of the pages, at most; where seams are longer than half of a texel for
/// each, samples lie farther apart. A level of 1,067 charts with lightmap coordinates of its own
/// has 0.7.
const MOST_SAMPLES: f64 = 4.0;

/// Boxes that are looked at for each piece, at most. Pieces have 5 to 30 near them; thousands where
/// as many surfaces coincide.
const MOST_NEAR: usize = 1024;

/// Times that a piece may meet others over its own length, at most, and how many of them. Where two
/// kits coincide, a border is met twice.
const MOST_LAYERS: f32 = 4.0;
const MOST_MET: usize = 64;

/// What two pieces have in common.
struct Stretch {
    pieces: [usize; 2],
    /// Where it begins and ends, in parameters of either piece.
    ends: [[f32; 2]; 2],
    /// Length of it, texels of the denser side.
    texels: f32,
    /// The same in metres.
    metres: f32,
}

/// Finds the seams and samples them. Deterministic; O(n log n) in border pieces, whatever
/// coincides.
///
/// Of every two borders that run along each other, their common stretch is sampled where the
/// surface goes on across it and nothing stands upon it. Where very many coincide, only some of
/// them are: see [`MOST_NEAR`] and [`MOST_LAYERS`].
pub(crate) fn find_samples(world: &World, layout: &Layout, lumels: &Lumels) -> Vec<Sample> {
    let pieces = border_pieces(world, layout, lumels);
    let boxes: Vec<[Vec3; 2]> = pieces
        .iter()
        .map(|p| [p.world[0].min(p.world[1]), p.world[0].max(p.world[1])])
        .collect();
    let tree = BoxTree::build(&boxes);
    let stretches: Vec<Stretch> = (0..pieces.len())
        .into_par_iter()
        .with_min_len(64)
        .flat_map_iter(|i| {
            let apart = apart(world, &pieces[i]);
            let (mut near, mut looked) = (Vec::new(), 0);
            tree.meet(boxes[i][0] - apart, boxes[i][1] + apart, &mut |j| {
                if j as usize > i {
                    near.push(j as usize);
                }
                looked += 1;
                looked < MOST_NEAR
            });
            near.sort_unstable();
            let (mut out, mut met) = (Vec::new(), 0.0);
            for j in near {
                if let Some(found) = stretch(world, &pieces, [i, j]) {
                    met += found.ends[1][0] - found.ends[0][0];
                    out.push(found);
                }
                if met > MOST_LAYERS - 0.5 || out.len() == MOST_MET {
                    break;
                }
            }
            out
        })
        .collect();
    let texels: f64 = stretches.iter().map(|s| f64::from(s.texels)).sum();
    let spacing = SPACING.max((texels / (MOST_SAMPLES * layout.texels())) as f32);
    (stretches.par_iter())
        .with_min_len(64)
        .flat_map_iter(|s| {
            let mut out = Vec::new();
            sample(world, s.pieces.map(|i| &pieces[i]), s, spacing, &mut out);
            out
        })
        .collect()
}

/// How far from this piece another one may lie to meet it, metres.
fn apart(world: &World, p: &Piece) -> f32 {
    // Rounding of two instances' transforms.
    let rounding = 4.0 * world.offset(p.world[0]);
    (TEXELS_APART * p.texel)
        .min(EDGES_APART * p.edge)
        .max(rounding)
}

/// What two pieces have in common, if they can be a seam.
fn stretch(world: &World, pieces: &[Piece], pair: [usize; 2]) -> Option<Stretch> {
    let [p, q] = pair.map(|i| &pieces[i]);
    let [n, m] = [p, q].map(|p| world.soup.normals[p.triangle as usize]);
    if n.dot(m) < SHARPEST_FOLD || p.inward.dot(q.inward) > FOLDED_BACK {
        return None;
    }
    let apart = apart(world, p).min(apart(world, q));
    let (along, other) = (p.world[1] - p.world[0], q.world[1] - q.world[0]);
    let (length, other_length) = (along.length(), other.length());
    let direction = along / length;
    let cosine = direction.dot(other) / other_length;
    if cosine * cosine < 1.0 - EDGES_ASKEW * EDGES_ASKEW {
        return None;
    }
    let place = |point: Vec3| direction.dot(point - p.world[0]);
    let (a, b) = (place(q.world[0]), place(q.world[1]));
    let (from, to) = (a.min(b).max(0.0), a.max(b).min(length));
    if to - from <= (1e-3 * length.min(other_length)).max(2.0 * apart) {
        return None;
    }
    // Parameters of either piece at a distance along the first.
    let at = |x: f32| [x / length, (x - a) / (b - a)];
    for x in [from, to] {
        let [s, t] = at(x);
        let gap = p.world[0].lerp(p.world[1], s) - q.world[0].lerp(q.world[1], t);
        if gap.length() > apart {
            return None;
        }
    }
    let ends = [at(from), at(to)];
    let [a, b] = ends.map(|params| places([p, q], params));
    let same = |ends: [Vec2; 2]| (ends[0] - ends[1]).length() <= SAME_PLACE;
    if p.page == q.page && same(a) && same(b) {
        return None;
    }
    let texels = (b[0] - a[0]).length().max((b[1] - a[1]).length());
    Some(Stretch {
        pieces: pair,
        ends,
        texels,
        metres: to - from,
    })
}

/// Where the two pieces' parameters lead on their pages, texels.
fn places(pieces: [&Piece; 2], params: [f32; 2]) -> [Vec2; 2] {
    [0, 1].map(|k| pieces[k].texels[0].lerp(pieces[k].texels[1], params[k]))
}

/// Samples of a stretch, `spacing` texels apart at most.
fn sample(world: &World, pieces: [&Piece; 2], s: &Stretch, spacing: f32, out: &mut Vec<Sample>) {
    let [a, b] = s.ends.map(|params| places(pieces, params));
    let along = [b[0] - a[0], b[1] - a[1]].map(|v| v / s.texels);
    let n = (s.texels / spacing).ceil().max(1.0);
    for i in 0..n as u32 {
        let x = (i as f32 + 0.5) / n;
        let params = [0, 1].map(|k| s.ends[0][k] + (s.ends[1][k] - s.ends[0][k]) * x);
        if goes_on(world, pieces, params) {
            let at = places(pieces, params);
            out.push(Sample {
                along,
                sides: [0, 1].map(|k| (pieces[k].page, at[k])),
                texels: s.texels / n,
                metres: s.metres / n,
            });
        }
    }
}

/// Lookups start this far to either side of a seam when they ask whether something stands upon it,
/// in texels.
const BESIDE: f32 = 0.5;

/// And this high above the surface, as a share of the distance from the seam. What is lower casts
/// no shadow that a lumel would show.
const ABOVE: f32 = 0.4;

/// Whether the surface goes on from one piece to the other: normals agree, and nothing is in
/// between. Sides that are buried are known by their lumels later.
fn goes_on(world: &World, pieces: [&Piece; 2], params: [f32; 2]) -> bool {
    let normals = [0, 1].map(|k| {
        let w = pieces[k].weights[0].lerp(pieces[k].weights[1], params[k]);
        world
            .scene
            .shading_normal(world.soup, pieces[k].triangle, w.x, w.y)
    });
    if normals[0].dot(normals[1]) < SAME_FACING {
        return false;
    }
    let beside = pieces.map(|p| (BESIDE * p.texel).min(p.altitude.max(0.1 * p.texel)));
    let geometric = pieces.map(|p| world.soup.normals[p.triangle as usize]);
    let cosine = geometric[0].dot(geometric[1]);
    // The line from slope to slope of a ridge would cut its top off: tan(φ/2) of the angle φ
    // between them lifts it over.
    let top = geometric[0].cross(geometric[1]).length() / (1.0 + cosine).max(0.1);
    let mut ends = [Vec3::ZERO; 2];
    for k in 0..2 {
        let p = pieces[k];
        let on = p.world[0].lerp(p.world[1], params[k]);
        let above = (ABOVE + top) * beside[k] + world.offset(on);
        ends[k] = on + p.inward * beside[k] + geometric[k] * above;
    }
    let free = world.transmitted(ends[0], ends[1] - ends[0], 1.0);
    free.max_element() > 0.0
}
