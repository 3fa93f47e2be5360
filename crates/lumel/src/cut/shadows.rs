//! Straight edges of the sharp shadows of suns and lamps.
//!
//! A lumel that such an edge crosses holds the mean of light and shade. In a room the sun is a
//! hundred times as bright as the shade, so its patch on a wall grows by a lumel and gets teeth, at
//! any density. If charts end where the edge is, both sides are as they should be.
//!
//! Neighbouring elements of which one is lit tell which triangles cast edges. Where these
//! begin and end is a matter of geometry: the edges of the triangles are projected along the light,
//! and looked at point by point.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use radiosity::{Caster, Ground, Outline, SOFT, ShadowEdge, SharpLights, SurfacePoint};
use rayon::prelude::*;

use super::ends::{End, Ends, Light};
use super::{Level, SUNLIT_STRIP};

/// So far beside an outline, in lumels, light and shade are told apart.
const BESIDE: f32 = 0.005;

/// An outline is looked at this often in a lumel …
const POINTS: f32 = 4.0;

/// … and at most this often in all.
const MOST_POINTS: usize = 1024;

/// Light and shade beside an edge are measured at one of this many points of it.
const MEASURED: usize = 16;

/// What casts shadows is followed over the bends of surfaces until this many casters and surfaces
/// were looked at, each with each: a finely divided hill under a wood has more of them than edges
/// that anybody sees.
const MOST_CASTS: usize = 1 << 18;

/// A straight edge of a shadow.
pub(super) struct Edge {
    /// Its ends, of which parts may be no edge.
    pub ends: [Vec3; 2],
    /// Unit normal of it, in the plane of the surface, into the shade.
    pub normal: Vec3,
    /// What of it was found, with the relative difference of the light, in steps of this length,
    /// metres.
    pub points: Vec<(ShadowEdge, f32)>,
    pub step: f32,
    pub on: Shaded,
}

/// A surface with a shadow on it.
#[derive(Clone, Copy)]
pub(super) struct Shaded {
    pub ground: Ground,
    /// Edge of its lumels, metres.
    pub lumel: f32,
    /// A triangle of it.
    pub triangle: u32,
}

/// A side of a surface, and what may cast the edge of a shadow on it.
type Cast = (u32, bool, Caster);

/// Outlines, by the ends' bits: triangles share edges.
type Known = BTreeSet<(u32, bool, [[u32; 3]; 2])>;

/// All of them.
pub(super) fn find(level: &Level, lights: &SharpLights, ends: &Ends, light: &Light) -> Vec<Edge> {
    if lights.is_empty() {
        return Vec::new();
    }
    let surfaces = surfaces(level);
    let mut edges = Vec::new();
    let mut next = casts(level, lights, ends);
    let (mut looked_at, mut known) = (BTreeSet::new(), Known::new());
    while !next.is_empty() {
        looked_at.extend(next.keys().copied());
        let outlines = outlines(level, lights, &next, &mut known);
        let found: Vec<(Cast, Outline, Vec<Edge>)> = (outlines.into_par_iter())
            .map(|(cast, on, outline)| {
                let surface = &surfaces[cast.0 as usize];
                let found = along(level, (lights, light), &on, &outline, surface);
                (cast, outline, found)
            })
            .filter(|(.., found)| !found.is_empty())
            .collect();
        // Where a surface bends, its shadows do, and go on.
        next = BTreeMap::new();
        let goes_on = looked_at.len() < MOST_CASTS;
        for ((surface, back, caster), outline, found) in found {
            let beside = level.surfaces.beside(surface);
            for &other in beside.iter().filter(|_| goes_on) {
                let cast = (other, back, caster);
                if let Some(on) = surfaces[other as usize].shaded(level, back)
                    && !looked_at.contains(&cast)
                    && within(outline.ends, &surfaces[other as usize], on.lumel).is_some()
                {
                    next.entry(cast).or_insert(on);
                }
            }
            edges.extend(found);
        }
    }
    edges
}

/// Those points of an edge where light and shade differ, with how much.
fn where_light_differs(
    level: &Level,
    light: &Light,
    on: &Shaded,
    points: &[ShadowEdge],
) -> Vec<(ShadowEdge, f32)> {
    let of_some = |points: &[ShadowEdge]| -> Vec<(ShadowEdge, f32)> {
        let p = &points[points.len() / 2];
        let beyond = p.normal * p.penumbra.max(SUNLIT_STRIP * on.lumel);
        let sides = [p.at - beyond, p.at + beyond].map(|at| on.ground.point(level.world, at));
        let Some(differ) = light.difference(level, &sides, on.lumel) else {
            return Vec::new();
        };
        points.iter().map(|p| (*p, differ)).collect()
    };
    points.chunks(MEASURED).flat_map(of_some).collect()
}

/// What may cast edges of shadows, by pairs of elements and beside the ends of surfaces.
fn casts(level: &Level, lights: &SharpLights, ends: &Ends) -> BTreeMap<Cast, Shaded> {
    let cut = &level.solution.cut;
    let on = |e: u32, p: &SurfacePoint| {
        let triangle = cut.elements()[e as usize].triangle;
        let ground = Ground {
            on: p.position,
            up: p.geometric,
        };
        let on = Shaded {
            ground,
            lumel: level.lumel_of(triangle)?,
            triangle,
        };
        Some((level.surfaces.of(triangle)?, on))
    };
    let of_pair = |&pair: &[u32; 2]| {
        if level.difference(pair).is_none() {
            return Vec::new();
        }
        let points = level.points(pair);
        // Of rough ground, each may be on a surface of its own.
        let mut sides: Vec<(u32, Shaded)> = (pair.iter().zip(&points))
            .filter_map(|(&e, p)| on(e, p))
            .collect();
        sides.dedup_by_key(|(surface, _)| *surface);
        let Some((_, first)) = sides.first() else {
            return Vec::new();
        };
        let back = level.back[pair[0] as usize];
        let casters = lights.casters(level.world, &points, SOFT * first.lumel);
        let sides = &sides;
        (casters.into_iter())
            .flat_map(|c| sides.iter().map(move |&(s, on)| ((s, back, c), on)))
            .collect()
    };
    let pairs = cut.neighbours();
    let pairs = pairs.par_iter().with_min_len(1024).flat_map_iter(of_pair);
    let beside = |end: &End| {
        let casters = end.casters(level, lights)?;
        let on = Shaded {
            ground: end.ground(),
            lumel: end.lumel,
            triangle: end.triangle,
        };
        let surface = level.surfaces.of(end.triangle)?;
        Some(casters.into_iter().map(move |c| ((surface, false, c), on)))
    };
    let mut found: Vec<(Cast, Shaded)> = pairs.collect();
    found.extend(ends.map(level, beside).into_iter().flatten());
    // The first counts.
    found.into_iter().rev().collect()
}

/// The outlines that may be edges of shadows and are not known yet.
fn outlines(
    level: &Level,
    lights: &SharpLights,
    casts: &BTreeMap<Cast, Shaded>,
    known: &mut Known,
) -> Vec<(Cast, Shaded, Outline)> {
    let mut out = Vec::new();
    for (&(surface, back, caster), on) in casts {
        for outline in lights.outlines(level.world, caster, &on.ground) {
            let mut ends = outline.ends.map(|p| p.to_array().map(f32::to_bits));
            ends.sort_unstable();
            if known.insert((surface, back, ends)) {
                out.push(((surface, back, caster), *on, outline));
            }
        }
    }
    out
}

/// A flat piece of surface.
#[derive(Clone)]
struct Surface {
    /// The corners of the box around it.
    low: Vec3,
    high: Vec3,
    /// A triangle of it.
    triangle: u32,
}

impl Surface {
    /// As the ground of a shadow that is on another surface, too; `None` if it is not cut.
    fn shaded(&self, level: &Level, back: bool) -> Option<Shaded> {
        let soup = level.world.soup;
        let up = soup.normals[self.triangle as usize];
        Some(Shaded {
            ground: Ground {
                on: soup.triangles[self.triangle as usize][0],
                up: if back { -up } else { up },
            },
            lumel: level.lumel_of(self.triangle)?,
            triangle: self.triangle,
        })
    }
}

/// All surfaces.
fn surfaces(level: &Level) -> Vec<Surface> {
    let none = Surface {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        triangle: 0,
    };
    let mut surfaces = vec![none; level.surfaces.len()];
    for (triangle, corners) in (0u32..).zip(level.world.soup.seen_triangles()) {
        if let Some(surface) = level.surfaces.of(triangle) {
            let Surface { low, high, .. } = surfaces[surface as usize];
            surfaces[surface as usize] = Surface {
                low: corners.iter().fold(low, |low, p| low.min(*p)),
                high: corners.iter().fold(high, |high, p| high.max(*p)),
                triangle,
            };
        }
    }
    surfaces
}

/// What of an outline is the edge of a shadow, with the shade on either side of it.
fn along(
    level: &Level,
    (lights, light): (&SharpLights, &Light),
    on: &Shaded,
    outline: &Outline,
    surface: &Surface,
) -> Vec<Edge> {
    let Some(ends) = within(outline.ends, surface, on.lumel) else {
        return Vec::new();
    };
    let length = ends[0].distance(ends[1]);
    let count = ((POINTS * length / on.lumel).ceil() as usize).clamp(1, MOST_POINTS);
    let reach = [BESIDE, SUNLIT_STRIP, SOFT].map(|lumels| lumels * on.lumel);
    let is_on = |p: Vec3| level.is_on(p, on.triangle, &on.ground);
    let points = (0..count).filter_map(|k| {
        let at = ends[0].lerp(ends[1], (k as f32 + 0.5) / count as f32);
        let edge = lights.edge(level.world, (outline, at), &on.ground, reach)?;
        let strip = edge.normal * reach[1];
        (is_on(at - strip) && is_on(at + strip)).then_some(edge)
    });
    let (one, other): (Vec<_>, Vec<_>) = points.partition(|p| p.normal == outline.normal);
    let edges = [(outline.normal, one), (-outline.normal, other)];
    (edges.into_iter())
        .map(|(normal, points)| Edge {
            ends,
            normal,
            points: where_light_differs(level, light, on, &points),
            step: length / count as f32,
            on: *on,
        })
        .filter(|edge| !edge.points.is_empty())
        .collect()
}

/// The part of a line in the box of a surface, with this much around it.
fn within([a, b]: [Vec3; 2], surface: &Surface, around: f32) -> Option<[Vec3; 2]> {
    let Surface { low, high, .. } = *surface;
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
