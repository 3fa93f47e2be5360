//! Edges of the sharp shadows that suns cast on flat surfaces.
//!
//! Where such an edge runs along the border of a chart, light is discontinuous there, and the border
//! is what makes it sharp in the lightmap.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use crate::world::{SurfacePoint, World, luminance};

/// Halvings of the distance between a lit and a shaded point: to a thousandth of it.
const HALVINGS: u32 = 10;

/// A shadow's edge belongs to an edge of a triangle that is at most this far from it, as a fraction
/// of the distance between the lit and the shaded point.
const OFF: f32 = 0.02;

/// A sun stands at least this high above a surface (sine).
const GRAZING: f32 = 0.05;

/// The suns of a scene, for their shadows' edges.
pub struct Suns {
    suns: Vec<Sun>,
    /// A distance beyond the whole scene, metres.
    far: f32,
}

struct Sun {
    /// Unit vector towards it.
    toward: Vec3,
    /// Angular diameter, radians.
    width: f32,
}

/// A point of a shadow's edge.
#[derive(Debug, Clone, Copy)]
pub struct ShadowEdge {
    /// The point, metres: where the shade is complete.
    pub at: Vec3,
    /// Unit normal of the edge, in the plane of the surface, into the shade.
    pub normal: Vec3,
}

impl Suns {
    /// Those of the world's scene that shine without a cookie, and whose light or shadow is baked.
    pub fn new(world: &World) -> Suns {
        let is_stored = |&(k, l): &(usize, &Light)| {
            luminance(l.intensity) > 0.0
                && l.cookie.is_none()
                && (!world.leaves_out(k) || world.is_masked(k))
        };
        let suns: Vec<Sun> = (world.scene.lights.iter().enumerate())
            .filter(is_stored)
            .filter_map(|(_, l)| match l.kind {
                LightKind::Directional { direction, angle } => Some(Sun {
                    toward: -direction,
                    width: 2.0 * angle,
                }),
                _ => None,
            })
            .collect();
        let corners = world.soup.triangles.iter().flatten();
        let size = match suns.is_empty() {
            true => 0.0,
            false => corners.fold(0.0f32, |far, p| far.max(p.abs().max_element())),
        };
        Suns {
            suns,
            far: 4.0 * size,
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.suns.is_empty()
    }

    /// Whether the edge of a shadow runs along a line on a flat surface: `beside` metres from it one
    /// side is shaded, by something so near that the penumbra is at most `soft` metres wide, and
    /// the other is lit beyond the penumbra. `on` is a point of the line, lifted off the surface,
    /// and `across` are the directions away from it.
    pub fn part(
        &self,
        world: &World,
        on: Vec3,
        (across, normal): ([Vec3; 2], Vec3),
        beside: f32,
        soft: f32,
    ) -> bool {
        self.suns.iter().any(|sun| {
            let height = normal.dot(sun.toward);
            let part = |[lit, shaded]: [Vec3; 2]| {
                let Some((_, distance)) = self.blocker(world, sun, on + shaded * beside) else {
                    return false;
                };
                let penumbra = distance * sun.width;
                let beyond = beside + penumbra / height;
                penumbra <= soft && self.blocker(world, sun, on + lit * beyond).is_none()
            };
            let [a, b] = across;
            height >= GRAZING && (part([a, b]) || part([b, a]))
        })
    }

    /// The edges of shadows between two points on a flat surface, if straight edges of triangles
    /// cast them, with penumbras of at most `soft` metres.
    pub fn edges(&self, world: &World, ends: &[SurfacePoint; 2], soft: f32) -> Vec<ShadowEdge> {
        let edges = self
            .suns
            .iter()
            .map(|sun| self.edge(world, sun, ends, soft));
        edges.flatten().collect()
    }

    fn edge(
        &self,
        world: &World,
        sun: &Sun,
        ends: &[SurfacePoint; 2],
        soft: f32,
    ) -> Option<ShadowEdge> {
        let up = ends[0].geometric;
        if up.dot(sun.toward) < GRAZING {
            return None;
        }
        let [a, b] = ends.map(|p| p.origin);
        let hits = [a, b].map(|p| self.blocker(world, sun, p));
        let (mut lit, mut shaded, mut hit) = match hits {
            [None, Some(hit)] => (a, b, hit),
            [Some(hit), None] => (b, a, hit),
            _ => return None,
        };
        for _ in 0..HALVINGS {
            let middle = lit.midpoint(shaded);
            match self.blocker(world, sun, middle) {
                Some(nearer) => (shaded, hit) = (middle, nearer),
                None => lit = middle,
            }
        }
        let (triangle, distance) = hit;
        if distance * sun.width > soft {
            return None;
        }
        let at = lit.midpoint(shaded);
        let corners = world.soup.triangles[triangle as usize];
        // The planes through the sun and each edge of the triangle.
        let planes = [0, 1, 2].map(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let plane = (to - from).cross(sun.toward).normalize_or_zero();
            (plane.dot(at - from), plane)
        });
        let (off, plane) = (planes.into_iter())
            .filter(|p| p.1 != Vec3::ZERO)
            .min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
        let level = plane - up * plane.dot(up);
        let length = level.length();
        if off.abs() > OFF * a.distance(b) || length < GRAZING {
            return None;
        }
        let level = level / length;
        // Exactly on the plane, and beyond the penumbra.
        let normal = level * level.dot(shaded - lit).signum();
        let penumbra = 0.5 * distance * sun.width / length;
        let at = at - level * (off / length) + normal * penumbra;
        Some(ShadowEdge { at, normal })
    }

    /// The first opaque triangle from a point towards a sun, with its distance, metres.
    fn blocker(&self, world: &World, sun: &Sun, from: Vec3) -> Option<(u32, f32)> {
        let hit = world.first_between(from, from + sun.toward * self.far)?;
        Some((hit.triangle, hit.t * self.far))
    }
}
