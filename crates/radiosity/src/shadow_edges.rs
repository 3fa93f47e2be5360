//! Edges of the sharp shadows that suns and lamps cast on flat surfaces.
//!
//! Where such an edge runs along the border of a chart, light is discontinuous there, and the
//! border is what makes it sharp in the lightmap.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use crate::direct::LampTree;
use crate::solids::connected;
use crate::world::{Emission, SurfacePoint, World, luminance};

/// Halvings of the distance between a lit and a shaded point: to a thousandth of it.
const HALVINGS: u32 = 10;

/// Rays towards a light begin this many of their [offsets](World::offset) above a surface, as
/// points on it are computed.
const LIFTED: f32 = 4.0;

/// A light stands at least this high above a surface (sine).
const GRAZING: f32 = 0.05;

/// A lamp's shadow counts where, unoccluded, it would bring this share of all lamps' light: the
/// sides of its edge may differ then, even where most of the others are hidden.
const SHARE: f32 = 0.03;

/// A lamp looks at most this wide, radians. The shadows of wider ones are sharp only where
/// something stands on a surface.
const WIDEST: f32 = 0.15;

/// Edges nearer to a lamp than this fraction of its height above a surface are cut off there: their
/// shadows end a thousand heights away.
const BELOW: f32 = 0.999;

/// The lights of a scene whose shadows may have sharp edges.
pub struct SharpLights {
    /// Those of the scene, and emissive bodies.
    lights: Vec<Light>,
    /// Likewise; `None` if it casts no edges.
    sources: Vec<Option<Source>>,
    lamps: LampTree,
    /// A distance beyond the whole scene, metres.
    far: f32,
}

#[derive(Clone, Copy)]
enum Source {
    Sun {
        /// Unit vector towards it.
        toward: Vec3,
        /// Angular diameter, radians.
        width: f32,
    },
    Lamp {
        at: Vec3,
        /// Metres.
        radius: f32,
        /// Unit axis of its cone and the cosine of half of its angle; −1 if it has none.
        axis: Vec3,
        cone: f32,
    },
}

impl Source {
    /// `None` if its light has edges of its own.
    fn of(light: &Light) -> Option<Source> {
        if luminance(light.intensity) <= 0.0 || light.cookie.is_some() {
            return None;
        }
        Some(match light.kind {
            LightKind::Directional { direction, angle } => Source::Sun {
                toward: -direction,
                width: 2.0 * angle,
            },
            LightKind::Point {
                position, radius, ..
            } => Source::Lamp {
                at: position,
                radius,
                axis: Vec3::Y,
                cone: -1.0,
            },
            LightKind::Spot {
                position,
                radius,
                direction,
                outer,
                ..
            } => Source::Lamp {
                at: position,
                radius,
                axis: direction,
                cone: libm::cosf(outer),
            },
        })
    }

    /// Unit vector towards it from a point.
    fn toward(&self, p: Vec3) -> Vec3 {
        match *self {
            Source::Sun { toward, .. } => toward,
            Source::Lamp { at, .. } => (at - p).normalize_or_zero(),
        }
    }

    /// Whether it may cast sharp shadows at a point: as a lamp, if that is in its cone, and not too
    /// near.
    fn has(&self, p: Vec3) -> bool {
        match *self {
            Source::Sun { .. } => true,
            Source::Lamp {
                at,
                radius,
                axis,
                cone,
            } => 2.0 * radius <= WIDEST * at.distance(p) && -axis.dot(self.toward(p)) >= cone,
        }
    }

    /// Width of a penumbra across the light, metres, this far from what casts it; `p` is in it.
    fn penumbra(&self, p: Vec3, distance: f32) -> f32 {
        match *self {
            Source::Sun { width, .. } => distance * width,
            Source::Lamp { radius: 0.0, .. } => 0.0,
            Source::Lamp { at, radius, .. } => {
                let beyond = p.distance(at) - distance;
                2.0 * radius * distance / beyond.max(radius)
            }
        }
    }

    /// What of an edge casts a shadow on a surface, and where, metres.
    fn project(&self, corners: [Vec3; 2], ground: &Ground) -> Option<[Vec3; 2]> {
        let height = |p: Vec3| ground.height(p);
        // Of an edge that goes through the surface, the part above it.
        let above = below(corners.map(|p| (p, -height(p))), 0.0)?;
        match *self {
            Source::Sun { toward, .. } => {
                let climb = ground.up.dot(toward);
                let cast = |p: Vec3| p - toward * (height(p).max(0.0) / climb);
                (climb >= GRAZING).then(|| above.map(cast))
            }
            Source::Lamp { at, .. } => {
                let lamp = height(at);
                let under = below(above.map(|p| (p, height(p))), BELOW * lamp)?;
                let cast = |p: Vec3| at + (p - at) * (lamp / (lamp - height(p).max(0.0)));
                (lamp > 0.0).then(|| under.map(cast))
            }
        }
    }
}

/// The part of a line on which a value that changes evenly along it is at most `most`.
fn below(mut ends: [(Vec3, f32); 2], most: f32) -> Option<[Vec3; 2]> {
    ends.sort_by(|a, b| a.1.total_cmp(&b.1));
    let [(a, low), (b, high)] = ends;
    let end = match high > most {
        true => a.lerp(b, (most - low) / (high - low)),
        false => b,
    };
    (low < most).then_some([a, end])
}

/// A triangle that ends a light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Caster {
    light: u32,
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

    /// Of the shadow of an edge with this direction, if the light is in this direction from the
    /// edge: its unit normal in the plane, and by how much penumbras are wider there than across
    /// the light. `None` if the shadow grazes the plane.
    fn across(&self, edge: Vec3, toward: Vec3) -> Option<(Vec3, f32)> {
        let across = edge.cross(toward).normalize_or_zero();
        let level = across - self.up * across.dot(self.up);
        let length = level.length();
        (length >= GRAZING).then(|| (level / length, 1.0 / length))
    }

    /// A point of it, as a receiver.
    pub fn point(&self, world: &World, at: Vec3) -> SurfacePoint {
        SurfacePoint {
            position: at,
            origin: at + self.up * (LIFTED * world.offset(at)),
            normal: self.up,
            geometric: self.up,
        }
    }
}

/// The shadow of an edge of a triangle on a surface, as far as it may be the edge of a shadow.
#[derive(Debug, Clone, Copy)]
pub struct Outline {
    light: u32,
    /// Its ends, metres.
    pub ends: [Vec3; 2],
    /// Unit normal in the plane of the surface.
    pub normal: Vec3,
    /// Width of a penumbra across it, by its width across the light.
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

impl SharpLights {
    /// Those of the world's scene that shine without a cookie, and whose light or shadow is baked,
    /// and its emissive bodies.
    pub fn new(world: &World) -> SharpLights {
        let mut lights = world.scene.lights.clone();
        let of_scene = lights.len();
        lights.extend(bodies(world));
        let is_stored = |k: usize| k >= of_scene || !world.leaves_out(k) || world.is_masked(k);
        let sources: Vec<Option<Source>> = (lights.iter().enumerate())
            .map(|(k, light)| Source::of(light).filter(|_| is_stored(k)))
            .collect();
        let is_sun = |s: &Source| matches!(s, Source::Sun { .. });
        let has_suns = sources.iter().flatten().any(is_sun);
        let corners = world.soup.triangles.iter().flatten();
        let size = match has_suns {
            true => corners.fold(0.0f32, |far, p| far.max(p.abs().max_element())),
            false => 0.0,
        };
        SharpLights {
            lamps: LampTree::new(&lights, |_| true),
            sources,
            lights,
            far: 4.0 * size,
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.sources.iter().all(Option::is_none)
    }

    /// Those that may matter at a point.
    fn around(&self, p: Vec3) -> Vec<(u32, Source)> {
        let lamps = self.lamps.strongest(&self.lights, p, SHARE);
        let source = |k: u32| {
            let source = self.sources[k as usize]?;
            source.has(p).then_some((k, source))
        };
        let mut around: Vec<(u32, Source)> = lamps.into_iter().filter_map(source).collect();
        around.sort_unstable_by_key(|(k, _)| *k);
        around
    }

    /// Which of two steps off a line on a surface leads into a light, if the other leads into its
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
        let away = steps[0].normalize_or_zero();
        let ground = Ground { on, up: normal };
        self.around(on).iter().find_map(|(_, light)| {
            let toward = light.toward(on);
            let (_, wider) = ground.across(normal.cross(away), toward)?;
            let parts = |[lit, shaded]: [Vec3; 2]| {
                let Some((_, distance)) = self.blocker(world, light, on + shaded) else {
                    return false;
                };
                let penumbra = light.penumbra(on, distance) * wider;
                let beyond = lit.normalize_or_zero() * penumbra;
                penumbra <= soft && self.blocker(world, light, on + lit + beyond).is_none()
            };
            let [a, b] = steps;
            let mut sides = [[a, b], [b, a]].into_iter();
            (normal.dot(toward) >= GRAZING)
                .then(|| sides.position(parts))
                .flatten()
        })
    }

    /// What casts the edges of shadows between two points on a flat surface, with penumbras of at
    /// most `soft` metres.
    pub fn casters(&self, world: &World, ends: &[SurfacePoint; 2], soft: f32) -> Vec<Caster> {
        (self.around(ends[0].position).into_iter())
            .filter_map(|(light, source)| {
                let triangle = self.caster(world, &source, ends, soft)?;
                Some(Caster { light, triangle })
            })
            .collect()
    }

    fn caster(
        &self,
        world: &World,
        light: &Source,
        ends: &[SurfacePoint; 2],
        soft: f32,
    ) -> Option<u32> {
        let [a, b] = ends.map(|p| p.origin);
        if ends[0].geometric.dot(light.toward(a)) < GRAZING {
            return None;
        }
        let hits = [a, b].map(|p| self.blocker(world, light, p));
        let (mut lit, mut shaded, mut hit) = match hits {
            [None, Some(hit)] => (a, b, hit),
            [Some(hit), None] => (b, a, hit),
            _ => return None,
        };
        for _ in 0..HALVINGS {
            let middle = lit.midpoint(shaded);
            match self.blocker(world, light, middle) {
                Some(nearer) => (shaded, hit) = (middle, nearer),
                None => lit = middle,
            }
        }
        let (triangle, distance) = hit;
        (light.penumbra(shaded, distance) <= soft).then_some(triangle)
    }

    /// The shadows of the edges of a triangle on a surface.
    pub fn outlines(&self, world: &World, caster: Caster, ground: &Ground) -> Vec<Outline> {
        let Some(light) = self.sources[caster.light as usize] else {
            return Vec::new();
        };
        let corners = world.soup.triangles[caster.triangle as usize];
        let outlines = [[0, 1], [1, 2], [2, 0]].into_iter().filter_map(|ends| {
            let corners = ends.map(|k| corners[k]);
            let ends = light.project(corners, ground)?;
            let [a, b] = corners;
            let (normal, wider) = ground.across(b - a, light.toward(a))?;
            Some(Outline {
                light: caster.light,
                ends,
                normal,
                wider,
            })
        });
        outlines.collect()
    }

    /// The edge of a shadow at a point of an outline, if it is one: steps of `beside` metres to
    /// either side part light and shade, both are at least `strip` metres wide, and the penumbra is
    /// at most `soft` metres wide. What is lit is at least half as wide as the penumbra, too, which
    /// light through a slit is not.
    pub fn edge(
        &self,
        world: &World,
        (outline, at): (&Outline, Vec3),
        ground: &Ground,
        [beside, strip, soft]: [f32; 3],
    ) -> Option<ShadowEdge> {
        let light = self.sources[outline.light as usize]?;
        if ground.up.dot(light.toward(at)) < GRAZING {
            return None;
        }
        let blocker = |p: Vec3| self.blocker(world, &light, ground.point(world, p).origin);
        let step = outline.normal * beside;
        let (normal, distance) = match [blocker(at + step), blocker(at - step)] {
            [Some((_, distance)), None] => (outline.normal, distance),
            [None, Some((_, distance))] => (-outline.normal, distance),
            _ => return None,
        };
        let penumbra = 0.5 * light.penumbra(at, distance) * outline.wider;
        let parts = 2.0 * penumbra <= soft
            && blocker(at - normal * penumbra.max(strip)).is_none()
            && blocker(at + normal * strip).is_some();
        parts.then_some(ShadowEdge {
            at,
            normal,
            penumbra,
        })
    }

    /// The first opaque triangle from a point towards a light, with its distance, metres.
    fn blocker(&self, world: &World, light: &Source, from: Vec3) -> Option<(u32, f32)> {
        let (to, reach) = match *light {
            Source::Sun { toward, .. } => (from + toward * self.far, self.far),
            Source::Lamp { at, radius, .. } => {
                let reach = (from.distance(at) - radius).max(0.0);
                (from + light.toward(from) * reach, reach)
            }
        };
        let hit = world.first_between(from, to)?;
        Some((hit.triangle, hit.t * reach))
    }
}

/// Emissive bodies, as lamps with a radius: flames and bulbs cast sharp shadows, too.
fn bodies(world: &World) -> Vec<Light> {
    let soup = world.soup;
    let emissive: Vec<u32> = (0..soup.triangles.len() as u32)
        .filter(|&t| world.emission(t) == Emission::Sampled)
        .collect();
    let corners: Vec<[Vec3; 3]> = (emissive.iter())
        .map(|&t| soup.triangles[t as usize])
        .collect();
    let lamp = |body: Vec<usize>| {
        let power = |k: usize| {
            let t = emissive[k] as usize;
            let material = &world.scene.materials[soup.materials[t] as usize];
            luminance(material.emissive) * soup.areas[t]
        };
        let sum: f32 = body.iter().map(|&k| power(k)).sum();
        let middle = |k: usize| corners[k].iter().sum::<Vec3>() / 3.0;
        let at = body.iter().map(|&k| middle(k) * power(k)).sum::<Vec3>() / sum;
        let far = |k: usize| {
            corners[k]
                .iter()
                .map(|p| p.distance(at))
                .fold(0.0, f32::max)
        };
        Light {
            name: String::new(),
            node: None,
            // A closed body shows half of its faces.
            intensity: Vec3::splat(0.5 * sum),
            kind: LightKind::Point {
                position: at,
                range: None,
                radius: body.iter().map(|&k| far(k)).fold(0.0, f32::max),
            },
            profile: None,
            cookie: None,
        }
    };
    let bodies = connected(&corners).into_iter().map(lamp);
    bodies.filter(|l| l.intensity.x > 0.0).collect()
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

    fn with<T>(of: (f32, f32), f: impl FnOnce(&World, &SharpLights) -> T) -> T {
        let scene = plate(of);
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).expect("a tree");
        f(&world, &SharpLights::new(&world))
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
        with(of, |world, lights| {
            let casters = lights.casters(world, &[on(from), on(to)], soft);
            let outlines =
                (casters.into_iter()).flat_map(|caster| lights.outlines(world, caster, &ground));
            let points = outlines.flat_map(|o| {
                (0..10u8).map(move |k| (o, o.ends[0].lerp(o.ends[1], 0.1 * f32::from(k) + 0.05)))
            });
            points
                .filter_map(|(o, at)| lights.edge(world, (&o, at), &ground, [1e-3, 0.01, soft]))
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

    /// A plate of 1 × 1 m at z = 1 above the plane z = 0, under a light.
    fn under(add: impl FnOnce(&mut Scene)) -> Scene {
        let mut scene = Scene::default();
        let grey = || material(0.5, Vec3::ZERO);
        let mut square = |half: f32, z: f32| {
            let corner = Vec3::new(-half, -half, z);
            let [x, y] = [Vec3::X, Vec3::Y].map(|axis| axis * (2.0 * half));
            add_quad(&mut scene, grey(), corner, x, y);
        };
        square(9.0, 0.0);
        square(0.5, 1.0);
        add(&mut scene);
        scene
    }

    /// Where between two places of the plane, along y = 0.2, shadows have edges, with the
    /// penumbras beyond.
    fn edges_under(scene: &Scene, [from, to]: [f32; 2]) -> Vec<(Vec3, f32)> {
        let soup = Soup::build(scene);
        let world = World::build(scene, &soup, WorldOptions::default()).expect("a tree");
        let lights = SharpLights::new(&world);
        let ground = Ground {
            on: Vec3::ZERO,
            up: Vec3::Z,
        };
        let ends = [from, to].map(|x| {
            let mut point = on(x);
            for p in [&mut point.position, &mut point.origin] {
                p.y = 0.2;
            }
            point
        });
        let casters = lights.casters(&world, &ends, 0.2);
        let outlines = (casters.into_iter()).flat_map(|c| lights.outlines(&world, c, &ground));
        let middles = outlines.map(|o| (o, o.ends[0].midpoint(o.ends[1])));
        middles
            .filter_map(|(o, at)| lights.edge(&world, (&o, at), &ground, [1e-3, 0.01, 0.2]))
            .map(|edge| (edge.at, edge.penumbra))
            .collect()
    }

    /// A lamp of this radius 3 m above the plate's middle.
    fn hanging(radius: f32) -> LightKind {
        LightKind::Point {
            position: Vec3::Z * 4.0,
            range: None,
            radius,
        }
    }

    #[test]
    fn edges_of_a_lamps_shadow_lie_on_rays_from_it() {
        // The plate's rim at 0.5 m is seen 4 : 3 as large on the plane.
        let rim = 0.5 * 4.0 / 3.0;
        let of = |radius| under(|scene| scene.lights.push(light(1.0, hanging(radius))));
        for ends in [[0.3, 1.0], [1.0, 0.3]] {
            let edges = edges_under(&of(0.0), ends);
            assert!(!edges.is_empty());
            for (at, penumbra) in edges {
                let off = at.x.abs().max(at.y.abs()) - rim;
                assert!(off.abs() < 1e-4 && at.z.abs() < 1e-5, "{at}");
                assert!(penumbra < 1e-6, "{penumbra}");
            }
        }
        // A third of the lamp's width, and half of that is beyond the edge.
        let soft = edges_under(&of(0.05), [0.3, 1.0]);
        assert!(!soft.is_empty());
        for (_, penumbra) in soft {
            assert!((penumbra - 0.05 / 3.0).abs() < 1e-3, "{penumbra}");
        }
        assert!(edges_under(&of(0.0), [0.8, 1.2]).is_empty(), "both are lit");
        assert!(edges_under(&of(0.3), [0.3, 1.0]).is_empty(), "too wide");
    }

    #[test]
    fn what_stands_higher_than_a_lamp_has_edges_from_all_corners() {
        // A wall at x = 1, 9 m high, ends at y = 0.2; the lamp is before it, 4 m high.
        for turned in [false, true] {
            let mut scene = Scene::default();
            let grey = || material(0.5, Vec3::ZERO);
            let corner = Vec3::new(-9.0, -9.0, 0.0);
            add_quad(&mut scene, grey(), corner, Vec3::X * 18.0, Vec3::Y * 18.0);
            let (foot, up) = (Vec3::new(1.0, -0.8, 0.0), Vec3::Z * 9.0);
            let (from, up) = if turned { (foot + up, -up) } else { (foot, up) };
            add_quad(&mut scene, grey(), from, up, Vec3::Y);
            let kind = LightKind::Point {
                position: Vec3::new(0.0, 0.0, 4.0),
                range: None,
                radius: 0.0,
            };
            scene.lights.push(light(1.0, kind));
            let soup = Soup::build(&scene);
            let world = World::build(&scene, &soup, WorldOptions::default()).expect("a tree");
            let lights = SharpLights::new(&world);
            let ground = Ground {
                on: Vec3::ZERO,
                up: Vec3::Z,
            };
            // Of the upright edge at y = 0.2, the shadow leaves the lamp's foot along (1, 0.2).
            let on_edge = |o: &Outline| {
                let (at, way) = (
                    Vec3::new(3.0, 0.6, 0.0),
                    Vec3::new(1.0, 0.2, 0.0).normalize(),
                );
                way.cross(o.normal).length() > 0.999 && o.normal.dot(at - o.ends[0]).abs() < 1e-3
            };
            let all = (0..soup.triangles.len() as u32).flat_map(|triangle| {
                lights.outlines(&world, Caster { light: 0, triangle }, &ground)
            });
            let edges = all.filter(on_edge).filter_map(|o| {
                lights.edge(
                    &world,
                    (&o, Vec3::new(3.0, 0.6, 0.0)),
                    &ground,
                    [1e-3, 0.01, 0.2],
                )
            });
            assert_eq!(edges.count(), 1, "turned {turned}");
        }
    }

    #[test]
    fn a_spot_has_edges_in_its_cone_only() {
        let spot = |outer| {
            under(|scene| {
                let kind = LightKind::Spot {
                    position: Vec3::Z * 4.0,
                    direction: -Vec3::Z,
                    range: None,
                    radius: 0.0,
                    inner: 0.0,
                    outer,
                };
                scene.lights.push(light(1.0, kind));
            })
        };
        assert!(!edges_under(&spot(0.5), [0.3, 1.0]).is_empty());
        assert!(edges_under(&spot(0.05), [0.3, 1.0]).is_empty());
    }

    #[test]
    fn an_emissive_body_is_a_lamp_if_it_is_small() {
        let bulb = |half: f32| {
            under(|scene| {
                let glow = material(0.0, Vec3::ONE);
                let corner = Vec3::new(-half, half, 4.0);
                add_quad(
                    scene,
                    glow,
                    corner,
                    Vec3::X * 2.0 * half,
                    -Vec3::Y * 2.0 * half,
                );
            })
        };
        let edges = edges_under(&bulb(0.03), [0.3, 1.0]);
        assert!(!edges.is_empty());
        for (at, _) in edges {
            let off = at.x.abs().max(at.y.abs()) - 0.5 * 4.0 / 3.0;
            assert!(off.abs() < 1e-4, "{at}");
        }
        assert!(edges_under(&bulb(0.3), [0.3, 1.0]).is_empty());
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
            with((angle, OPEN), |world, lights| {
                let [there, back] = [steps, [steps[1], steps[0]]]
                    .map(|steps| lights.lit_side(world, on(x).origin, (steps, Vec3::Z), soft));
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
