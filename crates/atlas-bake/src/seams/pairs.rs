//! Finds points of surfaces that have two places in the lightmap.

use atlas::{Layout, Lumels};
use glam::{Vec2, Vec3};
use radiosity::{SharpLights, World};
use rayon::prelude::*;

use crate::seams::border::{Piece, border_pieces};
use crate::seams::parted::{Parted, Place, lit_side, may_part};
use crate::seams::tree::BoxTree;

/// A point of a seam.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Page and position on it, texels, of either side. Texel (c, r) has its centre at (c + ½, r +
    /// ½).
    pub sides: [(u32, Vec2); 2],
    /// On either page, the step that corresponds to one texel of the denser side along the seam,
    /// texels.
    pub along: [Vec2; 2],
    /// Length of the seam that it represents, texels of the denser side.
    pub texels: f32,
    /// The same length in metres.
    pub metres: f32,
}

/// Largest gap between borders that meet, in texels of the denser side. A gap of this size is
/// invisible.
const TEXELS_APART: f32 = 0.05;

/// Largest gap as a fraction of the shorter edge, because small objects would otherwise meet their
/// own far side.
const EDGES_APART: f32 = 0.01;

/// Largest sine of the angle between edges that run along each other; at the ratio of 1 : 100 of
/// [`EDGES_APART`] they hardly differ more.
const EDGES_ASKEW: f32 = 0.02;

/// Cosine of 8°: a larger angle between normals is a crease, where light is discontinuous.
const SAME_FACING: f32 = 0.990;

/// Cosine of 65°: across a sharper fold each side has its own horizon, so light is discontinuous
/// whatever the shading normals are. The unwrapper splits charts at the same angle.
const SHARPEST_FOLD: f32 = 0.423;

/// Largest cosine between the directions of two triangles away from their common edge. Triangles on
/// the same side of the edge (a fold back, a double layer) do not continue each other.
const FOLDED_BACK: f32 = 0.5;

/// Positions on a page closer than this, texels, are the same place, where lookups agree anyway.
const SAME_PLACE: f32 = 1e-3;

/// Distance of samples along a seam, texels of the denser side. Lookups of either side have one
/// knot per texel; with fewer than two samples between knots, a zigzag would go unnoticed.
const SPACING: f32 = 0.125;

/// Most samples per texel of the pages; if seams are longer than half a texel per texel, samples
/// are farther apart. A level of 1,067 charts with its own lightmap coordinates has 0.7.
const MOST_SAMPLES: f64 = 4.0;

/// Most boxes that are examined per piece. Pieces have 5 to 30 boxes nearby; thousands only where
/// many surfaces coincide.
const MOST_NEAR: usize = 1024;

/// Most times that a piece may meet others over its own length. Where two kits coincide, a border
/// meets two others.
const MOST_LAYERS: f32 = 4.0;
const MOST_MET: usize = 64;

/// The common stretch of two pieces.
struct Stretch {
    pieces: [usize; 2],
    /// Its ends, in parameters of either piece.
    ends: [[f32; 2]; 2],
    /// Its length, texels of the denser side.
    texels: f32,
    /// Its length in metres.
    metres: f32,
}

impl Stretch {
    /// Parameters of either piece at a fraction of its length.
    fn params(&self, x: f32) -> [f32; 2] {
        [0, 1].map(|k| self.ends[0][k] + (self.ends[1][k] - self.ends[0][k]) * x)
    }
}

/// Finds the seams and samples them. Deterministic; O(n log n) in border pieces, even if many
/// coincide.
///
/// For every two borders that run along each other, their common stretch is sampled if the surface
/// continues across it and nothing stands on it. Where very many borders coincide, only some are
/// sampled: see [`MOST_NEAR`] and [`MOST_LAYERS`].
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
    let parted = parted(world, layout, &pieces, &stretches);
    (stretches.par_iter())
        .with_min_len(64)
        .flat_map_iter(|s| sample(world, s.pieces.map(|i| &pieces[i]), s, spacing, &parted))
        .collect()
}

/// Distance of the places along a seam, texels, at which sun and shade are told apart.
const PARTED: f32 = 0.5;

/// The texels that the edges of shadows part.
fn parted<'l>(
    world: &World,
    layout: &'l Layout,
    pieces: &[Piece],
    stretches: &[Stretch],
) -> Parted<'l> {
    let lights = SharpLights::new(world);
    let places: Vec<[Place; 2]> = (stretches.par_iter())
        .with_min_len(64)
        .flat_map_iter(|s| {
            let pieces = s.pieces.map(|i| &pieces[i]);
            let may = !lights.is_empty() && may_part(world, pieces, SAME_FACING);
            let n = if may {
                (s.texels / PARTED).ceil().max(1.0) as u32
            } else {
                0
            };
            let lights = &lights;
            (0..n).filter_map(move |i| {
                let params = s.params((i as f32 + 0.5) / n as f32);
                let lit = lit_side((world, lights), pieces, params)?;
                let at = places(pieces, params);
                Some([lit, 1 - lit].map(|k| (pieces[k].page, at[k])))
            })
        })
        .collect();
    Parted::new(&layout.pages, &places)
}

/// Largest distance at which another piece meets this one, metres.
fn apart(world: &World, p: &Piece) -> f32 {
    // Rounding of two instances' transforms.
    let rounding = 4.0 * world.offset(p.world[0]);
    (TEXELS_APART * p.texel)
        .min(EDGES_APART * p.edge)
        .max(rounding)
}

/// The common stretch of two pieces, if they can form a seam.
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

/// Positions of the two pieces' parameters on their pages, texels.
fn places(pieces: [&Piece; 2], params: [f32; 2]) -> [Vec2; 2] {
    [0, 1].map(|k| pieces[k].texels[0].lerp(pieces[k].texels[1], params[k]))
}

/// Samples of a stretch, at most `spacing` texels apart.
fn sample(
    world: &World,
    pieces: [&Piece; 2],
    s: &Stretch,
    spacing: f32,
    parted: &Parted,
) -> Vec<Sample> {
    let [a, b] = s.ends.map(|params| places(pieces, params));
    let along = [b[0] - a[0], b[1] - a[1]].map(|v| v / s.texels);
    let n = (s.texels / spacing).ceil().max(1.0);
    let samples = (0..n as u32).filter_map(|i| {
        let params = s.params((i as f32 + 0.5) / n);
        let at = places(pieces, params);
        let sides = [0, 1].map(|k| (pieces[k].page, at[k]));
        let meet = !parted.parts(&sides) && goes_on(world, pieces, params);
        meet.then_some(Sample {
            along,
            sides,
            texels: s.texels / n,
            metres: s.metres / n,
        })
    });
    samples.collect()
}

/// Distance from the seam, texels, at which the test rays for obstacles on the seam start and end.
const BESIDE: f32 = 0.5;

/// Height of these rays above the surface, as a fraction of the distance from the seam. Lower
/// obstacles cast no shadow that a lumel would show.
const ABOVE: f32 = 0.4;

/// Whether the surface continues from one piece to the other: normals agree and nothing stands
/// between. Buried sides are recognised later by their lumels.
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
    // A straight ray from slope to slope would cut through the top of a ridge; tan(φ/2) of the
    // angle φ between them raises it above.
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
