//! Edges of the sharp shadows that suns cast on flat surfaces.
//!
//! Where such an edge runs along the border of a chart, light is discontinuous there, and the
//! border is what makes it sharp in the lightmap.

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
    /// The point, metres: in the middle of the penumbra.
    pub at: Vec3,
    /// Unit normal of the edge, in the plane of the surface, into the shade.
    pub normal: Vec3,
    /// How far along it the shade is complete, metres.
    pub penumbra: f32,
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

    /// Whether the edge of a shadow runs along a line on a flat surface: `beside` metres from it
    /// one side is shaded, by something so near that the penumbra is at most `soft` metres wide,
    /// and the other is lit beyond the penumbra. `on` is a point of the line, lifted off the
    /// surface, and `across` are the directions away from it.
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
        Some(ShadowEdge {
            at: at - level * (off / length),
            normal: level * level.dot(shaded - lit).signum(),
            penumbra: 0.5 * distance * sun.width / length,
        })
    }

    /// The first opaque triangle from a point towards a sun, with its distance, metres.
    fn blocker(&self, world: &World, sun: &Sun, from: Vec3) -> Option<(u32, f32)> {
        let hit = world.first_between(from, from + sun.toward * self.far)?;
        Some((hit.triangle, hit.t * self.far))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{add_quad, light, material};
    use crate::world::WorldOptions;
    use mesh_ingest::{Scene, Soup};

    /// A plate at z = 2 over x < 0.3, above the plane z = 0, under a sun of this angular radius
    /// that stands above +x at a slope of 1 : 2.
    fn plate(angle: f32) -> Scene {
        let mut scene = Scene::default();
        let grey = || material(0.5, Vec3::ZERO);
        add_quad(
            &mut scene,
            grey(),
            Vec3::new(-9.0, -9.0, 0.0),
            Vec3::X * 18.0,
            Vec3::Y * 18.0,
        );
        add_quad(
            &mut scene,
            grey(),
            Vec3::new(-8.7, -9.0, 2.0),
            Vec3::X * 9.0,
            Vec3::Y * 18.0,
        );
        let direction = Vec3::new(-1.0, 0.0, -2.0).normalize();
        let sun = LightKind::Directional { direction, angle };
        scene.lights.push(light(1.0, sun));
        scene
    }

    fn with<T>(angle: f32, f: impl FnOnce(&World, &Suns) -> T) -> T {
        let scene = plate(angle);
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).expect("a tree");
        f(&world, &Suns::new(&world))
    }

    /// A point of the plane, as a receiver.
    fn on(x: f32) -> SurfacePoint {
        let position = Vec3::new(x, 0.5, 0.0);
        SurfacePoint {
            position,
            origin: position + Vec3::Z * 1e-4,
            normal: Vec3::Z,
            geometric: Vec3::Z,
        }
    }

    #[test]
    fn an_edge_lies_where_the_plane_through_it_and_the_sun_does() {
        // 2 m below the edge at x = 0.3, a slope of 1 : 2 moves the shadow by 1 m to x = −0.7.
        let edges = |angle, from, to, soft| {
            with(angle, |world, suns| {
                suns.edges(world, &[on(from), on(to)], soft)
            })
        };
        for (from, to) in [(-1.0, -0.4), (-0.4, -1.0)] {
            let [edge] = edges(0.0, from, to, 0.1)[..] else {
                panic!("one edge");
            };
            assert!((edge.at.x + 0.7).abs() < 1e-3, "{edge:?}");
            assert!(
                (edge.normal + Vec3::X).length() < 1e-5,
                "into the shade: {edge:?}"
            );
        }
        assert!(edges(0.0, -0.6, -0.1, 0.1).is_empty(), "both are lit");
        assert!(edges(0.0, -0.8, -1.5, 0.1).is_empty(), "both are shaded");
        // The sun's disc of 0.02 rad is 4.5 cm wide at the distance of √5 m, and 5 cm on the plane.
        let [edge] = edges(0.01, -1.0, -0.4, 0.1)[..] else {
            panic!("one edge");
        };
        assert!((edge.at.x + 0.7).abs() < 1e-3, "{edge:?}");
        assert!((edge.penumbra - 0.025).abs() < 1e-3, "{edge:?}");
        assert!(edges(0.01, -1.0, -0.4, 0.03).is_empty(), "too soft");
    }

    #[test]
    fn a_line_parts_sun_and_shade_only_along_the_edge() {
        let part = |angle, x: f32, soft| {
            let across = ([Vec3::X, Vec3::NEG_X], Vec3::Z);
            with(angle, |world, suns| {
                suns.part(world, on(x).origin, across, 0.02, soft)
            })
        };
        assert!(part(0.0, -0.7, 0.1));
        assert!(!part(0.0, -0.6, 0.1) && !part(0.0, -0.8, 0.1));
        // At the far end of a penumbra, too, unless it is soft.
        assert!(part(0.01, -0.725, 0.1));
        assert!(!part(0.01, -0.725, 0.03));
    }
}
