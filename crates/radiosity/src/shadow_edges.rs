//! Edges of the sharp shadows that suns cast on flat surfaces.
//!
//! Where such an edge runs along the border of a chart, light is discontinuous there, and the
//! border is what makes it sharp in the lightmap.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use crate::world::{SurfacePoint, World, luminance};

/// Halvings of the distance between a lit and a shaded point: to a thousandth of it.
const HALVINGS: u32 = 10;

/// Rays towards a sun begin this many of their [offsets](World::offset) above a surface, as points
/// on it are computed.
const LIFTED: f32 = 4.0;

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

/// A triangle that ends a sun's light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Caster {
    sun: u32,
    /// Of the soup.
    triangle: u32,
}

/// A flat surface on which shadows are cast.
#[derive(Debug, Clone, Copy)]
pub struct Ground {
    /// A point of its plane, metres.
    pub on: Vec3,
    /// Unit normal of the side that is looked at.
    pub up: Vec3,
}

impl Ground {
    fn height(&self, p: Vec3) -> f32 {
        self.up.dot(p - self.on)
    }
}

/// The shadow of an edge of a triangle on a surface, as far as it may be the edge of a shadow.
#[derive(Debug, Clone, Copy)]
pub struct Outline {
    sun: u32,
    /// Its ends, metres.
    pub ends: [Vec3; 2],
    /// Unit normal in the plane of the surface.
    pub normal: Vec3,
    /// Width of a penumbra across it, by the distance from what casts it.
    wider: f32,
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

/// Widest penumbra of an edge of a shadow, in lumels. Lookups blur narrower ones, in teeth where
/// they cross lumels at an angle; wider ones are gradients that lumels can hold.
pub const SOFT: f32 = 2.0;

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

    /// Which of two steps off a line on a surface leads into the sun, if the other leads into the
    /// shade and the edge of a shadow runs along the line: what shades is so near that the penumbra
    /// is at most `soft` metres wide, and beyond the penumbra it is lit. `on` is a point of the
    /// line, lifted off the surface, and the steps are in metres.
    pub fn lit_side(
        &self,
        world: &World,
        on: Vec3,
        (steps, normal): ([Vec3; 2], Vec3),
        soft: f32,
    ) -> Option<usize> {
        self.suns.iter().find_map(|sun| {
            let height = normal.dot(sun.toward);
            let parts = |[lit, shaded]: [Vec3; 2]| {
                let Some((_, distance)) = self.blocker(world, sun, on + shaded) else {
                    return false;
                };
                let penumbra = distance * sun.width;
                let beyond = lit.normalize_or_zero() * (penumbra / height);
                penumbra <= soft && self.blocker(world, sun, on + lit + beyond).is_none()
            };
            let [a, b] = steps;
            let mut sides = [[a, b], [b, a]].into_iter();
            (height >= GRAZING).then(|| sides.position(parts)).flatten()
        })
    }

    /// What casts the edges of shadows between two points on a flat surface, with penumbras of at
    /// most `soft` metres.
    pub fn casters(&self, world: &World, ends: &[SurfacePoint; 2], soft: f32) -> Vec<Caster> {
        let casters = (0u32..)
            .zip(&self.suns)
            .filter_map(|(k, sun)| Some((k, self.caster(world, sun, ends, soft)?)));
        let casters = casters.map(|(sun, triangle)| Caster { sun, triangle });
        casters.collect()
    }

    fn caster(&self, world: &World, sun: &Sun, ends: &[SurfacePoint; 2], soft: f32) -> Option<u32> {
        if ends[0].geometric.dot(sun.toward) < GRAZING {
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
        (distance * sun.width <= soft).then_some(triangle)
    }

    /// The shadows of the edges of a triangle on a surface.
    pub fn outlines(&self, world: &World, caster: Caster, ground: &Ground) -> Vec<Outline> {
        let toward = self.suns[caster.sun as usize].toward;
        let climb = ground.up.dot(toward);
        if climb < GRAZING {
            return Vec::new();
        }
        let corners = world.soup.triangles[caster.triangle as usize];
        let outlines = [[0, 1], [1, 2], [2, 0]].into_iter().filter_map(|ends| {
            // Of an edge that goes through the surface, the part above it.
            let [(a, low), (b, high)] = {
                let mut ends = ends.map(|k| (corners[k], ground.height(corners[k])));
                ends.sort_by(|a, b| a.1.total_cmp(&b.1));
                ends
            };
            if high <= 0.0 {
                return None;
            }
            let (a, low) = match low < 0.0 {
                true => (a.lerp(b, low / (low - high)), 0.0),
                false => (a, low),
            };
            let ends = [(a, low), (b, high)].map(|(p, height)| p - toward * (height / climb));
            let across = (b - a).cross(toward).normalize_or_zero();
            let level = across - ground.up * across.dot(ground.up);
            let length = level.length();
            (length >= GRAZING).then(|| Outline {
                sun: caster.sun,
                ends,
                normal: level / length,
                wider: 1.0 / length,
            })
        });
        outlines.collect()
    }

    /// The edge of a shadow at a point of an outline, if it is one: steps of `beside` metres to
    /// either side part sun and shade, both are at least `strip` metres wide, and the penumbra is
    /// at most `soft` metres wide. What is lit is at least half as wide as the penumbra, too, which
    /// light through a slit is not.
    pub fn edge(
        &self,
        world: &World,
        (outline, at): (&Outline, Vec3),
        ground: &Ground,
        [beside, strip, soft]: [f32; 3],
    ) -> Option<ShadowEdge> {
        let sun = &self.suns[outline.sun as usize];
        let blocker = |p: Vec3| {
            let lifted = p + ground.up * (LIFTED * world.offset(p));
            self.blocker(world, sun, lifted)
        };
        let step = outline.normal * beside;
        let (normal, distance) = match [blocker(at + step), blocker(at - step)] {
            [Some((_, distance)), None] => (outline.normal, distance),
            [None, Some((_, distance))] => (-outline.normal, distance),
            _ => return None,
        };
        let penumbra = 0.5 * distance * sun.width * outline.wider;
        let parts = distance * sun.width <= soft
            && blocker(at - normal * penumbra.max(strip)).is_none()
            && blocker(at + normal * strip).is_some();
        parts.then_some(ShadowEdge {
            at,
            normal,
            penumbra,
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
    /// that stands above +x at a slope of 1 : 2; and another beyond a slit of this width.
    fn plate((angle, slit): (f32, f32)) -> Scene {
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
        if slit < 1.0 {
            add_quad(
                &mut scene,
                grey(),
                Vec3::new(0.3 + slit, -9.0, 2.0),
                Vec3::X * 8.0,
                Vec3::Y * 18.0,
            );
        }
        let direction = Vec3::new(-1.0, 0.0, -2.0).normalize();
        let sun = LightKind::Directional { direction, angle };
        scene.lights.push(light(1.0, sun));
        scene
    }

    const OPEN: f32 = f32::INFINITY;

    fn with<T>(of: (f32, f32), f: impl FnOnce(&World, &Suns) -> T) -> T {
        let scene = plate(of);
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

    /// The edges of shadows between two places along the middle of the plane, as they are met along
    /// outlines in steps of a tenth; those at the plane's border aside.
    fn edges(of: (f32, f32), from: f32, to: f32, soft: f32) -> Vec<ShadowEdge> {
        let ground = Ground {
            on: Vec3::ZERO,
            up: Vec3::Z,
        };
        with(of, |world, suns| {
            let casters = suns.casters(world, &[on(from), on(to)], soft);
            let outlines =
                (casters.into_iter()).flat_map(|caster| suns.outlines(world, caster, &ground));
            let points = outlines.flat_map(|o| {
                (0..10u8).map(move |k| (o, o.ends[0].lerp(o.ends[1], 0.1 * f32::from(k) + 0.05)))
            });
            points
                .filter_map(|(o, at)| suns.edge(world, (&o, at), &ground, [1e-3, 0.01, soft]))
                .filter(|edge| edge.at.y.abs() < 8.9)
                .collect()
        })
    }

    #[test]
    fn edges_lie_where_the_plane_through_an_edge_and_the_sun_does() {
        // 2 m below the edge at x = 0.3, a slope of 1 : 2 moves the shadow by 1 m to x = −0.7.
        for (from, to) in [(-1.0, -0.4), (-0.4, -1.0)] {
            let edges = edges((0.0, OPEN), from, to, 0.1);
            // Of the triangle there, the edge at x = 0.3; its diagonal casts none.
            assert_eq!(edges.len(), 10, "{edges:?}");
            for edge in &edges {
                assert!((edge.at.x + 0.7).abs() < 1e-3, "{edge:?}");
                assert!(
                    (edge.normal + Vec3::X).length() < 1e-5,
                    "into the shade: {edge:?}"
                );
            }
        }
        assert!(
            edges((0.0, OPEN), -0.6, -0.1, 0.1).is_empty(),
            "both are lit"
        );
        assert!(
            edges((0.0, OPEN), -0.8, -1.5, 0.1).is_empty(),
            "both are shaded"
        );
        // The sun's disc of 0.02 rad is 4.5 cm wide at the distance of √5 m, and 5 cm on the plane.
        let soft = edges((0.01, OPEN), -1.0, -0.4, 0.1);
        assert!((soft[0].penumbra - 0.025).abs() < 1e-3, "{soft:?}");
        assert!(edges((0.01, OPEN), -1.0, -0.4, 0.03).is_empty(), "too soft");
    }

    #[test]
    fn light_through_a_slit_has_no_edges() {
        // Two centimetres of hard light; a penumbra is wider by far.
        assert_eq!(edges((0.0, 0.02), -1.0, -0.69, 0.1).len(), 10);
        assert!(edges((0.01, 0.02), -1.0, -0.69, 0.1).is_empty());
        assert!(edges((0.0, 0.005), -1.0, -0.6975, 0.1).is_empty());
    }

    #[test]
    fn a_line_parts_sun_and_shade_only_along_the_edge() {
        let part = |angle, x: f32, soft| {
            let steps = [0.02, -0.02].map(|x| Vec3::X * x);
            with((angle, OPEN), |world, suns| {
                let [there, back] = [steps, [steps[1], steps[0]]]
                    .map(|steps| suns.lit_side(world, on(x).origin, (steps, Vec3::Z), soft));
                // Towards +x is lit.
                assert_eq!(there, back.map(|k| 1 - k));
                assert_ne!(there, Some(1));
                there.is_some()
            })
        };
        assert!(part(0.0, -0.7, 0.1));
        assert!(!part(0.0, -0.6, 0.1) && !part(0.0, -0.8, 0.1));
        // At the far end of a penumbra, too, unless it is soft.
        assert!(part(0.01, -0.725, 0.1));
        assert!(!part(0.01, -0.725, 0.03));
    }
}
