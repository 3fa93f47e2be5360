//! Walls that stand on a surface that has lumels: what lies on their two sides is kept apart.
//!
//! A floor that runs on under a wall has lumels on both sides, and some that the wall cuts. The mean of a lit room and a dark one is wrong in
//! both. So the points of such a lumel are sorted by which of them see each other just above the surface ([`Parts`]), it holds the light of
//! its largest part that can be seen, and lumels do not take light from neighbours behind a wall ([`Barriers`]).

use glam::Vec3;
use radiosity::{SurfacePoint, World, luminance};
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::gather::Received;
use crate::lumels::{Lumels, TexelIndex};
use crate::planes::Plane;

/// Height above the surface at which walls are looked for, in lumels: above thresholds, mats and what else lies flat on a floor.
pub(crate) const LIFT: f32 = 0.15;

/// Points of a lumel that say into which parts it falls. A part that holds none of them is less than about a sixteenth of it.
const SCOUTS: usize = 16;

/// Parts of a footprint that walls keep from each other.
pub(crate) struct Parts {
    /// Points with the number of their part.
    scouts: Vec<(SurfacePoint, u8)>,
    lift: f32,
    /// How many parts there are.
    pub count: usize,
}

impl Parts {
    /// Sorts the first of `points` by which of them see each other.
    pub(crate) fn find(world: &World, points: &[SurfacePoint], size: f32) -> Parts {
        let points = &points[..points.len().min(SCOUTS)];
        let lift = LIFT * size;
        let mut part: Vec<u8> = Vec::with_capacity(points.len());
        for (k, p) in points.iter().enumerate() {
            let mut order = [(0.0, 0); SCOUTS];
            let before = nearest_first(&mut order, points[..k].iter(), p);
            // The nearest two of each part before it: one may hide behind a pebble.
            let (mut tried, mut own) = ([0u8; SCOUTS], None);
            for &(_, j) in before {
                let of = part[j];
                if own == Some(of) || tried[of as usize] == 2 {
                    continue;
                }
                tried[of as usize] += 1;
                if world.wall_between(p, &points[j], lift) {
                    continue;
                }
                match own {
                    None => own = Some(of),
                    // It joins two that did not see each other.
                    Some(one) => {
                        let (low, high) = (one.min(of), one.max(of));
                        part.iter_mut()
                            .filter(|x| **x == high)
                            .for_each(|x| *x = low);
                        own = Some(low);
                    }
                }
            }
            part.push(own.unwrap_or(k as u8));
        }
        let mut names = part.clone();
        names.sort_unstable();
        names.dedup();
        let number = |of: u8| names.binary_search(&of).unwrap_or(0) as u8;
        Parts {
            scouts: points
                .iter()
                .zip(&part)
                .map(|(p, of)| (*p, number(*of)))
                .collect(),
            lift,
            count: names.len(),
        }
    }

    /// The part of a further point of the footprint; the one after the last where it sees none of those that it was sorted by: a sliver
    /// beyond a wall.
    pub(crate) fn of(&self, world: &World, p: &SurfacePoint) -> usize {
        let far = |s: &(SurfacePoint, u8)| s.0.position.distance_squared(p.position);
        let nearest = (self.scouts.iter()).min_by(|a, b| far(a).total_cmp(&far(b)));
        if let Some(s) = nearest.filter(|s| !world.wall_between(p, &s.0, self.lift)) {
            return s.1 as usize;
        }
        let mut order = [(0.0, 0); SCOUTS];
        nearest_first(&mut order, self.scouts.iter().map(|s| &s.0), p)
            .iter()
            .skip(1)
            .map(|&(_, j)| &self.scouts[j])
            .find(|s| !world.wall_between(p, &s.0, self.lift))
            .map_or(self.count, |s| s.1 as usize)
    }
}

/// Squared distances from `p` and numbers of `points` (at most [`SCOUTS`]), the nearest first.
fn nearest_first<'o, 'p>(
    order: &'o mut [(f32, usize); SCOUTS],
    points: impl Iterator<Item = &'p SurfacePoint>,
    p: &SurfacePoint,
) -> &'o [(f32, usize)] {
    let mut n = 0;
    for (slot, q) in order.iter_mut().zip(points) {
        *slot = (q.position.distance_squared(p.position), n);
        n += 1;
    }
    order[..n].sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    &order[..n]
}

/// Between which lumels that touch a wall stands.
#[derive(Debug, Default)]
pub(crate) struct Barriers {
    /// By lumel: bit 0 towards the right, bit 1 downwards. Empty where there is none at all.
    bits: Vec<u8>,
    /// There are barriers, or lumels that a wall cuts.
    matter: bool,
}

impl Barriers {
    /// Looks between lumels near which something stands.
    pub(crate) fn find(
        world: &World,
        lumels: &Lumels,
        index: &TexelIndex,
        received: &[Received],
    ) -> Barriers {
        let bits: Vec<u8> = (0..received.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let (l, own) = (&lumels.lumels[i], &received[i]);
                if !own.near || own.open == 0.0 {
                    return 0;
                }
                let [x, y] = l.texel.map(i64::from);
                let blocked = |x: i64, y: i64| {
                    let Some(j) = index.at(l.page, x, y) else {
                        return false;
                    };
                    let other = &received[j];
                    lumels.lumels[j].instance == l.instance
                        && other.near
                        && other.open > 0.0
                        && world.wall_between(
                            &own.point(world),
                            &other.point(world),
                            LIFT * own.size,
                        )
                };
                u8::from(blocked(x + 1, y)) | u8::from(blocked(x, y + 1)) << 1
            })
            .collect();
        let matter = bits.iter().any(|b| *b != 0) || received.iter().any(|r| r.open < 1.0);
        Barriers { bits, matter }
    }

    /// Whether light might pass from lumel to lumel through a wall.
    pub(crate) fn matter(&self) -> bool {
        self.matter
    }

    /// Whether one stands between two lumels that share an edge.
    pub(crate) fn between(&self, lumels: &Lumels, i: usize, j: usize) -> bool {
        let [a, b] = [i, j].map(|k| lumels.lumels[k].texel);
        let first = if (a[1], a[0]) < (b[1], b[0]) { i } else { j };
        self.after(first, a[1] != b[1])
    }

    /// Whether one stands right of, or below (`down`), lumel `i`.
    #[inline]
    pub(crate) fn after(&self, i: usize, down: bool) -> bool {
        self.bits
            .get(i)
            .is_some_and(|b| b >> u8::from(down) & 1 == 1)
    }
}

impl Received {
    /// The middle of the footprint, as a point of the surface.
    pub(crate) fn point(&self, world: &World) -> SurfacePoint {
        SurfacePoint {
            position: self.position,
            origin: self.position + self.normal * world.offset(self.position),
            normal: self.normal,
            geometric: self.normal,
        }
    }
}

/// Gives lumels of which nothing can be seen the light of their neighbours, `rings` deep, since bilinear lookups beside them read it.
///
/// So do lumels behind a single-sided surface that their neighbours lie before: the first row of a wall that goes on into the ground,
/// where it may see the sky from below. Such a surface shows the neighbour its front and the lumel its back.
pub(crate) fn fill_hidden(
    world: &World,
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
    barriers: &Barriers,
    rings: u32,
) {
    let index = TexelIndex::build(&lumels.lumels, layout);
    let mut filled: Vec<bool> = received.iter().map(|r| r.open > 0.0).collect();
    let behind: Vec<(usize, Received)> = (0..received.len())
        .into_par_iter()
        .with_min_len(1024)
        .filter(|&i| received[i].behind && filled[i])
        .filter_map(|i| {
            let own = received[i].point(world);
            let lift = LIFT * received[i].size;
            let before = |j: usize| {
                filled[j]
                    && !received[j].behind
                    && barriers.between(lumels, i, j)
                    && world.backs_onto(&own, &received[j].point(world), lift)
            };
            let around = beside(lumels, &index, received, &before, i, EDGES);
            Some((i, blend(received, &around, i)?))
        })
        .collect();
    put(received, behind);
    let mut empty: Vec<usize> = (0..received.len()).filter(|&i| !filled[i]).collect();
    for _ in 0..rings {
        let found: Vec<(usize, Received)> = empty
            .par_iter()
            .with_min_len(1024)
            .filter_map(|&i| {
                let of = |j: usize| filled[j];
                let mut around = beside(lumels, &index, received, &of, i, EDGES);
                if around.is_empty() {
                    around = beside(lumels, &index, received, &of, i, CORNERS);
                }
                Some((i, blend(received, &around, i)?))
            })
            .collect();
        if found.is_empty() {
            return;
        }
        for (i, _) in &found {
            filled[*i] = true;
        }
        put(received, found);
        empty.retain(|&i| !filled[i]);
    }
}

const EDGES: [[i64; 2]; 4] = [[0, -1], [-1, 0], [1, 0], [0, 1]];
const CORNERS: [[i64; 2]; 4] = [[-1, -1], [1, -1], [-1, 1], [1, 1]];

fn put(received: &mut [Received], values: Vec<(usize, Received)>) {
    for (i, value) in values {
        received[i] = value;
    }
}

/// The neighbours of lumel `i` at these offsets that `may` serve and face about the same way.
fn beside(
    lumels: &Lumels,
    index: &TexelIndex,
    received: &[Received],
    may: &dyn Fn(usize) -> bool,
    i: usize,
    around: [[i64; 2]; 4],
) -> Vec<usize> {
    let l = &lumels.lumels[i];
    let [x, y] = l.texel.map(i64::from);
    (around.into_iter())
        .filter_map(|[dx, dy]| index.at(l.page, x + dx, y + dy))
        .filter(|&j| lumels.lumels[j].instance == l.instance)
        .filter(|&j| received[j].normal.dot(received[i].normal) > 0.5)
        .filter(|&j| may(j))
        .collect()
}

/// Lumel `i` with the light of some neighbours; `None` of none.
///
/// It lies in a wall, and a neighbour that can be seen up to a share of it ends where the wall begins: lookups in front of the wall read the lumel where
/// that is more than half. A wall of little more than a lumel is read from on both sides, and may have a bright room on one of them and a dark one
/// on the other. The mean of these would be seen as light in the dark room, the darker one as a dark line in the bright room. The square of the
/// mean root lies between the two where eyes have it, which see about the root of light.
fn blend(received: &[Received], around: &[usize], i: usize) -> Option<Received> {
    // Of neighbours that were hidden themselves all count the same.
    let read = |j: usize| (received[j].open - 0.5).max(1e-3);
    let all: f32 = around.iter().map(|&j| read(j)).sum();
    let light = |j: usize| luminance(received[j].direct + received[j].indirect).max(0.0);
    let mean = around.iter().map(|&j| read(j) * light(j)).sum::<f32>() / all;
    let root = around
        .iter()
        .map(|&j| read(j) * light(j).sqrt())
        .sum::<f32>()
        / all;
    let dimmed = if mean > 0.0 { root * root / mean } else { 1.0 };
    let (first, own) = (*around.first()?, &received[i]);
    let mut out = Received {
        position: own.position,
        normal: own.normal,
        open: 0.0,
        rays: own.rays,
        edge: own.edge,
        direct: Vec3::ZERO,
        indirect: Vec3::ZERO,
        first_half: Vec3::ZERO,
        planes: vec![Plane::default(); own.planes.len()].into(),
        ..received[first].clone()
    };
    for &j in around {
        let from = &received[j];
        let weight = dimmed * read(j) / all;
        out.direct += from.direct * weight;
        out.indirect += from.indirect * weight;
        out.first_half += from.first_half * weight;
        for (plane, of) in out.planes.iter_mut().zip(&from.planes) {
            plane.direct += of.direct * weight;
            plane.indirect += of.indirect * weight;
            plane.first_half += of.first_half * weight;
        }
    }
    Some(out)
}
