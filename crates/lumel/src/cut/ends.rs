//! Beside the ends of surfaces, where no two elements are on either side of a line: the frame of a
//! window in its reveal, the edge of a bed's patch of sun. A strip there is narrower than a lumel,
//! and would have the light of what lies beyond the line.

use std::ops::Range;

use gather::{Footprint, GatherOptions, Gatherer, Interpolation, TILE, Wanted};
use glam::Vec3;
use radiosity::{
    Caster, DirectLight, DirectOptions, Emitters, Ground, SOFT, SharpLights, SurfacePoint,
    hash_u32, luminance,
};
use rayon::prelude::*;

use super::walls::{self, ROOM, THIN, Wall};
use super::{Level, STRIP, SUNLIT_STRIP};

/// Points are this far from an end, in lumels, and from a wall.
const BESIDE: f32 = 0.5 * SUNLIT_STRIP;

/// A wall is looked for at this height, in lumels.
const LIFT: f32 = 0.25;

/// Shadows are looked for up to a point this far from the end, in lumels, if the surface goes as
/// far. Elements lie closer to each other than the farthest.
const REACHES: [f32; 3] = [2.0, 1.0, 0.5];

/// Cosine of the bend up to which a surface goes on, as in [`mesh_ingest::Cut`]: 45°.
const BEND: f32 = 0.7;

/// Edges of more triangles are left out.
const MOST_ON_AN_EDGE: usize = 16;

/// Most points along an edge.
const MOST_POINTS: usize = 256;

/// Rays that measure the light at a point.
const RAYS: u32 = 64;

/// A point beside the end of a surface.
pub(super) struct End {
    point: SurfacePoint,
    /// Unit vector in the surface, away from its end.
    inward: Vec3,
    /// Length of the end that it stands for, metres.
    pub length: f32,
    /// Edge of the surface's lumels, metres.
    pub lumel: f32,
    pub triangle: u32,
    /// Of its random numbers.
    seed: u32,
}

impl End {
    /// The point this far from the end.
    fn further(&self, metres: f32) -> SurfacePoint {
        let by = self.inward * metres;
        SurfacePoint {
            position: self.point.position + by,
            origin: self.point.origin + by,
            ..self.point
        }
    }

    /// What casts edges of shadows between it and a point farther in.
    pub fn casters(&self, level: &Level, lights: &SharpLights) -> Option<Vec<Caster>> {
        REACHES.into_iter().find_map(|lumels| {
            let points = [self.point, self.further(lumels * self.lumel)];
            let casters = lights.casters(level.world, &points, SOFT * self.lumel);
            let found = !casters.is_empty() && points.iter().all(|p| self.has(level, p));
            found.then_some(casters)
        })
    }

    /// Whether a point is on its surface, where somebody may see it.
    fn has(&self, level: &Level, p: &SurfacePoint) -> bool {
        level.is_on(p.position, self.triangle, &self.ground())
    }

    /// Where it is.
    pub fn ground(&self) -> Ground {
        Ground {
            on: self.point.position,
            up: self.point.geometric,
        }
    }
}

/// The ends of all surfaces that can be cut, on their fronts.
pub(super) struct Ends {
    /// The triangles of each instance.
    instances: Vec<Range<u32>>,
}

impl Ends {
    pub fn find(level: &Level) -> Self {
        let sources = &level.world.soup.sources[..level.world.soup.seen()];
        let mut instances: Vec<Range<u32>> = Vec::new();
        for (t, source) in (0u32..).zip(sources) {
            match instances.last_mut() {
                Some(last) if sources[last.start as usize].instance == source.instance => {
                    last.end = t + 1;
                }
                _ => instances.push(t..t + 1),
            }
        }
        Ends { instances }
    }

    /// What `of` makes of each point beside an end. The points are not kept: a large level may
    /// have millions.
    pub fn map<T: Send>(&self, level: &Level, of: impl Fn(&End) -> Option<T> + Sync) -> Vec<T> {
        let of_edge = |(t, k): (u32, usize)| -> Vec<T> {
            along(level, t, k).filter_map(|end| of(&end)).collect()
        };
        let of_instance = |triangles: &Range<u32>| -> Vec<T> {
            let edges = edges(level, triangles.clone());
            edges.into_par_iter().flat_map_iter(of_edge).collect()
        };
        self.instances.par_iter().flat_map(of_instance).collect()
    }
}

/// Edges at which surfaces end, as triangles and the corners where edges begin: nothing goes on
/// there, or only around a corner. Where a surface bends, its shadows go on. Shorter edges than a
/// lumel are left out: no straight line follows them.
fn edges(level: &Level, triangles: Range<u32>) -> Vec<(u32, usize)> {
    let soup = level.world.soup;
    let mut edges: Vec<([[u32; 3]; 2], u32, usize)> = Vec::new();
    for t in triangles {
        let Some(lumel) = level.lumel_of(t).filter(|_| level.surfaces.of(t).is_some()) else {
            continue;
        };
        let corners = soup.triangles[t as usize];
        for k in 0..3 {
            let ends = [corners[k], corners[(k + 1) % 3]];
            if ends[0].distance(ends[1]) >= lumel {
                let mut bits = ends.map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
                bits.sort_unstable();
                edges.push((bits, t, k));
            }
        }
    }
    edges.sort_unstable();
    let normal = |t: u32| soup.normals[t as usize];
    let mut out = Vec::new();
    let fans = edges.chunk_by(|a, b| a.0 == b.0);
    for same in fans.filter(|same| same.len() <= MOST_ON_AN_EDGE) {
        for &(_, t, k) in same {
            let mut others = same.iter().filter(|other| other.1 != t);
            if !others.any(|other| normal(t).dot(normal(other.1)) > BEND) {
                out.push((t, k));
            }
        }
    }
    out
}

/// Points along an edge of a triangle.
fn along(level: &Level, triangle: u32, k: usize) -> impl Iterator<Item = End> {
    let soup = level.world.soup;
    let corners = soup.triangles[triangle as usize];
    let (from, to) = (corners[k], corners[(k + 1) % 3]);
    let up = soup.normals[triangle as usize];
    let inward = up.cross(to - from).normalize_or_zero();
    let inward = inward * inward.dot(corners[(k + 2) % 3] - from).signum();
    let lumel = level.lumel_of(triangle).unwrap_or(f32::INFINITY);
    let length = from.distance(to);
    let count = ((length / lumel).ceil() as usize).clamp(1, MOST_POINTS);
    let end = move |i: usize| {
        let at = from.lerp(to, (i as f32 + 0.5) / count as f32) + inward * (BESIDE * lumel);
        let point = SurfacePoint {
            position: at,
            origin: at + up * level.world.offset(at),
            normal: up,
            geometric: up,
        };
        End {
            point,
            inward,
            length: length / count as f32,
            lumel,
            triangle,
            seed: hash_u32(triangle ^ hash_u32(i as u32)),
        }
    };
    (0..count).map(end)
}

/// The thin walls that stand within [`STRIP`] of ends.
pub(super) fn walls(level: &Level, ends: &Ends, light: &Light) -> Vec<Wall> {
    ends.map(level, |end| wall(level, end, light))
}

fn wall(level: &Level, end: &End, light: &Light) -> Option<Wall> {
    let (world, lumel) = (level.world, end.lumel);
    let here = end.point;
    let up = here.geometric;
    let lifted = |lumels: f32| here.position + (end.inward * lumels + up * LIFT) * lumel;
    // Its near side from here, then its far side from beyond.
    let [from, to] = [0.0, STRIP].map(lifted);
    let hit = world.first_between(from, to)?;
    let normal = walls::upright(world, hit.triangle, up)?;
    let near = from.lerp(to, hit.t);
    let beyond = near + end.inward * (THIN * lumel);
    let hit = world.first_between(beyond, near)?;
    walls::upright(world, hit.triangle, up)?;
    let far = beyond.lerp(near, hit.t);
    let there = end.further(end.inward.dot(far - from) + BESIDE * lumel);
    let mut points = [here, there];
    if !points.iter().all(|p| end.has(level, p)) {
        return None;
    }
    let differ = light.difference(level, &points, lumel)?;
    if normal.dot(here.position - there.position) < 0.0 {
        points.reverse();
    }
    let sides = points.map(|p| walls::look(world, &p, end.seed, ROOM * lumel));
    Some(Wall {
        normal,
        ends: [near, far],
        sides,
        differ,
        lumel,
        triangle: end.triangle,
        length: end.length,
    })
}

/// Measures light where there is no element.
pub(super) struct Light<'l>(Gatherer<'l, 'l>);

impl<'l> Light<'l> {
    pub fn new(level: &Level<'l>, emitters: &'l Emitters) -> Self {
        let options = GatherOptions {
            rays: RAYS,
            points: 1,
            edge_points: 0,
            most_rays: RAYS,
            error: 0.0,
            direct: DirectOptions::every(1, 1),
            contacts: false,
            follow: 0,
            interpolation: Interpolation::Open,
            calm: 0.0,
            near: 1.0,
            lit: 0,
            open_only: false,
            tile: TILE,
        };
        let direct = DirectLight::new(level.world, emitters);
        let wanted = Wanted::default();
        Light(Gatherer::new(
            level.world,
            level.solution,
            direct,
            options,
            wanted,
        ))
    }

    /// Relative difference of the light at two points of a surface with these lumels, if it counts.
    pub fn difference(&self, level: &Level, points: &[SurfacePoint; 2], lumel: f32) -> Option<f32> {
        let light = points.map(|point| {
            let size = BESIDE * lumel;
            // The same directions on both sides.
            let got = self.0.gather(&Spot { point, size }, 0);
            luminance(got.direct + got.indirect)
        });
        level.relative(light)
    }
}

/// A point, with the size of what it stands for, metres.
struct Spot {
    point: SurfacePoint,
    size: f32,
}

impl Footprint for Spot {
    fn candidate(&self, _: u32) -> Option<SurfacePoint> {
        Some(self.point)
    }

    fn fallback(&self) -> SurfacePoint {
        self.point
    }

    fn size(&self) -> f32 {
        self.size
    }
}
