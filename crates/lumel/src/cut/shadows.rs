//! Straight edges of the shadows of suns.
//!
//! A lumel that such an edge crosses holds the mean of sun and shade. In a room the sun is a
//! hundred times as bright as the shade, so its patch on a wall grows by a lumel and gets teeth, at
//! any density. If charts end where the edge is, both sides are as they should be.
//!
//! Neighbouring elements of which one is in the sun tell which triangles cast edges. Where these
//! begin and end is a matter of geometry: the edges of the triangles are projected along the sun,
//! and looked at point by point.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use radiosity::{Caster, Ground, Outline, ShadowEdge, Suns};
use rayon::prelude::*;

use super::{Level, SUNLIT_STRIP};

/// Edges of shadows whose penumbra is wider than this, in lumels, are soft: a lumel that they cross
/// shows them well.
pub(super) const SOFT: f32 = 0.75;

/// So far beside an outline, in lumels, sun and shade are told apart.
const BESIDE: f32 = 0.005;

/// An outline is looked at this often in a lumel …
const POINTS: f32 = 2.0;

/// … and at most this often in all.
const MOST_POINTS: usize = 1024;

/// A straight edge of a shadow.
pub(super) struct Edge {
    /// Its ends, of which parts may be no edge.
    pub ends: [Vec3; 2],
    /// Unit normal of it, in the plane of the surface, into the shade.
    pub normal: Vec3,
    /// What of it was found, in steps of this length, metres.
    pub points: Vec<ShadowEdge>,
    pub step: f32,
    pub on: Shaded,
}

/// A surface with a shadow on it.
#[derive(Clone, Copy)]
pub(super) struct Shaded {
    pub ground: Ground,
    /// Relative difference of the light.
    pub differ: f32,
    /// Edge of its lumels, metres.
    pub lumel: f32,
    /// A triangle of it.
    pub triangle: u32,
}

/// All of them, surface by surface.
pub(super) fn find(level: &Level) -> Vec<Edge> {
    let suns = Suns::new(level.world);
    if suns.is_empty() {
        return Vec::new();
    }
    let outlines = outlines(level, &suns);
    let bounds = bounds(level, &outlines);
    let edges = (outlines.par_iter())
        .flat_map_iter(|(region, on, outline)| along(level, &suns, on, outline, bounds[region]));
    edges.collect()
}

/// The outlines that may be edges of shadows, by surface.
fn outlines(level: &Level, suns: &Suns) -> Vec<(usize, Shaded, Outline)> {
    let cut = &level.solution.cut;
    let of_pair = |&pair: &[u32; 2]| {
        let triangle = cut.elements()[pair[0] as usize].triangle;
        let known = level
            .difference(pair)
            .and_then(|differ| Some((differ, level.lumel_of(triangle)?, cut.region_of(triangle)?)));
        let Some((differ, lumel, region)) = known else {
            return Vec::new();
        };
        let points = level.points(pair);
        let ground = Ground {
            on: points[0].position,
            up: points[0].geometric,
        };
        let on = Shaded {
            ground,
            differ,
            lumel,
            triangle,
        };
        let back = level.back[pair[0] as usize];
        let casters = suns.casters(level.world, &points, SOFT * lumel);
        let found = casters.into_iter().map(|c| ((region, back, c), on));
        found.collect()
    };
    let pairs = cut.neighbours();
    let pairs = pairs.par_iter().with_min_len(1024).flat_map_iter(of_pair);
    let found: Vec<((usize, bool, Caster), Shaded)> = pairs.collect();
    let mut casters: BTreeMap<(usize, bool, Caster), Shaded> = BTreeMap::new();
    for (key, on) in found {
        let differ = &mut casters.entry(key).or_insert(on).differ;
        // Elements in the penumbra differ less.
        *differ = differ.max(on.differ);
    }
    let mut out = Vec::new();
    let mut known = BTreeSet::new();
    for ((region, back, caster), on) in casters {
        for outline in suns.outlines(level.world, caster, &on.ground) {
            // Triangles share edges.
            let mut ends = outline.ends.map(|p| p.to_array().map(f32::to_bits));
            ends.sort_unstable();
            if known.insert((region, back, ends)) {
                out.push((region, on, outline));
            }
        }
    }
    out
}

/// The corners of the boxes around the surfaces.
fn bounds(level: &Level, outlines: &[(usize, Shaded, Outline)]) -> BTreeMap<usize, [Vec3; 2]> {
    let none = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let mut bounds: BTreeMap<usize, [Vec3; 2]> = outlines
        .iter()
        .map(|(region, ..)| (*region, none))
        .collect();
    for (triangle, corners) in (0u32..).zip(&level.world.soup.triangles) {
        let region = level.solution.cut.region_of(triangle);
        if let Some([low, high]) = region.and_then(|region| bounds.get_mut(&region)) {
            for p in corners {
                (*low, *high) = (low.min(*p), high.max(*p));
            }
        }
    }
    bounds
}

/// What of an outline is the edge of a shadow, with the shade on either side of it.
fn along(
    level: &Level,
    suns: &Suns,
    on: &Shaded,
    outline: &Outline,
    bounds: [Vec3; 2],
) -> Vec<Edge> {
    let Some(ends) = within(outline.ends, bounds, on.lumel) else {
        return Vec::new();
    };
    let length = ends[0].distance(ends[1]);
    let count = ((POINTS * length / on.lumel).ceil() as usize).clamp(1, MOST_POINTS);
    let reach = [BESIDE, SUNLIT_STRIP, SOFT].map(|lumels| lumels * on.lumel);
    let is_on = |p: Vec3| level.is_on(p, on.triangle, &on.ground);
    let points = (0..count).filter_map(|k| {
        let at = ends[0].lerp(ends[1], (k as f32 + 0.5) / count as f32);
        let edge = suns.edge(level.world, (outline, at), &on.ground, reach)?;
        let strip = edge.normal * reach[1];
        (is_on(at - strip) && is_on(at + strip)).then_some(edge)
    });
    let (one, other): (Vec<_>, Vec<_>) = points.partition(|p| p.normal == outline.normal);
    let edges = [(outline.normal, one), (-outline.normal, other)];
    (edges.into_iter())
        .filter(|(_, points)| !points.is_empty())
        .map(|(normal, points)| Edge {
            ends,
            normal,
            points,
            step: length / count as f32,
            on: *on,
        })
        .collect()
}

/// The part of a line in a box, with this much around it.
fn within([a, b]: [Vec3; 2], [low, high]: [Vec3; 2], around: f32) -> Option<[Vec3; 2]> {
    let (mut from, mut to) = (0.0f32, 1.0f32);
    for k in 0..3 {
        let (start, way) = (a[k], b[k] - a[k]);
        let [one, other] = [low[k] - around, high[k] + around].map(|side| (side - start) / way);
        if one.is_finite() && other.is_finite() {
            from = from.max(one.min(other));
            to = to.min(one.max(other));
        } else if start < low[k] - around || start > high[k] + around {
            return None;
        }
    }
    (from < to).then(|| [a.lerp(b, from), a.lerp(b, to)])
}
