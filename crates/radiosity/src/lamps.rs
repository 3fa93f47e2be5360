//! The flux of punctual lights and where it goes, measured with rays from them.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use mesh_ingest::{Light, LightKind};

use crate::sampling::{hash_u32, sample_4d};
use crate::sky::{BrightSky, SkyCell};
use crate::world::{Incoming, World};

/// Approximate number of rays from all lamps together, and the maximum and minimum per lamp.
const RAYS: usize = 1 << 18;
const MOST: usize = 1 << 13;
const LEAST: usize = 1 << 7;

/// Number of sets of Sobol points per lamp, each scrambled independently. The spread between the
/// sets gives the error of their mean, including the effect of stratification. With 15 degrees of
/// freedom, the error exceeds four standard errors once in 900 cases.
const SETS: u32 = 16;

/// Where the light of all punctual lights goes (RGB, in W or lm).
#[derive(Debug, Default)]
pub(crate) struct LampFlux {
    /// Flux emitted. For suns and for lamps with a range, the flux that reaches a surface.
    pub emitted: DVec3,
    /// Flux that hits the backs of single-sided faces.
    pub behind: DVec3,
    /// Flux that hits nothing.
    pub escaped: DVec3,
    /// Flux absorbed by glass on the way.
    pub taken: DVec3,
    /// Variance of the luminous flux that reaches surfaces.
    pub variance: f64,
}

/// Sums over the rays of one lamp.
#[derive(Default)]
struct Tally {
    all: f64,
    front: DVec3,
    behind: DVec3,
    escaped: DVec3,
    taken: DVec3,
}

impl LampFlux {
    /// Casts rays from every lamp, and from the bright parts of the sky.
    pub(crate) fn measure(world: &World) -> Self {
        let lamps = world.scene.lights.iter().map(Source::Lamp);
        let cells = world
            .bright
            .iter()
            .flat_map(|b| b.cells.iter().map(move |c| Source::Sky(b, c)));
        let sources: Vec<Source> = lamps.chain(cells).collect();
        let mut out = LampFlux::default();
        if sources.is_empty() {
            return out;
        }
        let n = (RAYS / sources.len()).clamp(LEAST, MOST) as u32 / SETS;
        let bounds = Bounds::of(world);
        for (k, source) in sources.iter().enumerate() {
            let seed = hash_u32(k as u32 ^ 0x6c61_6d70);
            out.add(world, source, &bounds, n, seed);
        }
        out
    }

    fn add(&mut self, world: &World, source: &Source, bounds: &Bounds, n: u32, seed: u32) {
        let mut t = Tally::default();
        let mut sets = [0f64; SETS as usize];
        let range = source.range();
        for i in 0..n * SETS {
            let set = i / n;
            let random = sample_4d(i % n, 0, seed ^ hash_u32(set));
            let sent = source.ray(world, bounds, random);
            let (found, tint) = world.incoming(sent.origin, sent.direction);
            let tint = tint.as_dvec3();
            // A lamp with a range loses light on the way, and only the light that arrives is known.
            // For other lamps, the distance to a backface does not matter.
            let (share, into) = match found {
                Incoming::Escaped | Incoming::Black if range.is_some() => continue,
                Incoming::Escaped => (1.0, &mut t.escaped),
                Incoming::Black => (1.0, &mut t.behind),
                Incoming::Surface(hit) => (window(hit.t as f64, range), &mut t.front),
            };
            let light = sent.colour * (sent.weight * share);
            *into += tint * light;
            t.taken += (DVec3::ONE - tint) * light;
            t.all += sent.weight * share;
            if matches!(found, Incoming::Surface(_)) {
                sets[set as usize] += lum(tint * light);
            }
        }
        // Per ray. A known total flux replaces its estimate.
        let each = match (source.exact(), t.all > 0.0) {
            (Some(flux), true) => flux / t.all,
            // The flux that corresponds to a weight of 1 in all rays.
            _ => source.whole(bounds) / (n * SETS) as f64,
        };
        let escaped = if source.is_far() {
            DVec3::ZERO
        } else {
            t.escaped
        };
        self.emitted += (t.front + t.behind + escaped + t.taken) * each;
        self.behind += t.behind * each;
        self.escaped += escaped * each;
        self.taken += t.taken * each;
        let mean = sets.iter().sum::<f64>() / SETS as f64;
        let squares: f64 = sets.iter().map(|s| (s - mean).powi(2)).sum();
        self.variance += squares * (SETS as f64 / (SETS as f64 - 1.0)) * (each * each);
    }
}

/// The source of rays.
enum Source<'w> {
    Lamp(&'w Light),
    Sky(&'w BrightSky, &'w SkyCell),
}

/// A ray from a lamp.
struct Sent {
    origin: Vec3,
    /// Unit.
    direction: Vec3,
    /// Relative intensity in this direction.
    weight: f64,
    /// Intensity.
    colour: DVec3,
}

impl Source<'_> {
    /// Whether it shines from outside the scene. Only the light that reaches the scene then counts.
    fn is_far(&self) -> bool {
        match self {
            Source::Lamp(light) => matches!(light.kind, LightKind::Directional { .. }),
            Source::Sky(..) => true,
        }
    }

    fn range(&self) -> Option<f32> {
        match self {
            Source::Lamp(light) => range(light),
            Source::Sky(..) => None,
        }
    }

    /// Flux per unit of intensity that corresponds to a weight of 1 in all directions.
    fn whole(&self, bounds: &Bounds) -> f64 {
        let across = PI * bounds.radius * bounds.radius;
        match self {
            Source::Sky(..) => across,
            Source::Lamp(light) => match light.kind {
                // The direction is sampled uniformly over the solid angle of the disc.
                LightKind::Directional { angle, .. } => {
                    across * 2.0 / (1.0 + libm::cos(angle as f64))
                }
                LightKind::Point { .. } => 4.0 * PI,
                LightKind::Spot { outer, .. } => 2.0 * PI * (1.0 - libm::cos(outer as f64)),
            },
        }
    }

    fn exact(&self) -> Option<f64> {
        match self {
            Source::Lamp(light) => exact(light),
            Source::Sky(..) => None,
        }
    }

    fn ray(&self, world: &World, bounds: &Bounds, random: [f32; 4]) -> Sent {
        match self {
            Source::Lamp(light) => {
                let (origin, direction, weight) = bounds.ray(world, light, random);
                let at = match light.kind {
                    // A lamp's picture depends on the direction only.
                    LightKind::Point { position, .. } | LightKind::Spot { position, .. } => {
                        position + direction
                    }
                    LightKind::Directional { .. } => origin,
                };
                let cookie = world.scene.cookie_factor(light, at);
                let colour = (light.intensity * cookie).as_dvec3();
                Sent {
                    origin,
                    direction,
                    weight,
                    colour,
                }
            }
            Source::Sky(sky, cell) => {
                let (towards, light) = sky.sample(cell, random[0], random[1]);
                Sent {
                    origin: bounds.start_afar(-towards, random),
                    direction: -towards,
                    weight: 1.0,
                    colour: light.as_dvec3(),
                }
            }
        }
    }
}

fn lum(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

fn range(light: &Light) -> Option<f32> {
    match light.kind {
        LightKind::Point { range, .. } | LightKind::Spot { range, .. } => {
            range.filter(|r| *r > 0.0)
        }
        LightKind::Directional { .. } => None,
    }
}

/// The window of KHR_lights_punctual: max(1 − (d/r)⁴, 0).
fn window(d: f64, range: Option<f32>) -> f64 {
    range.map_or(1.0, |r| (1.0 - (d / r as f64).powi(4)).max(0.0))
}

/// The cone of a spotlight: ((cosθ − cos outer)/(cos inner − cos outer))², at most 1.
fn cone(cos: f64, inner: f32, outer: f32) -> f64 {
    let (i, o) = (libm::cos(inner as f64), libm::cos(outer as f64));
    ((cos - o) / (i - o).max(1e-3)).clamp(0.0, 1.0).powi(2)
}

/// Flux per unit of intensity, in sr, for lamps with a closed form: 4π, or 2π ∫ cone dcosθ. As in
/// direct light, the cone's falloff spans at least `1e-3` in cosine.
fn exact(light: &Light) -> Option<f64> {
    if range(light).is_some() || light.profile.is_some() || light.cookie.is_some() {
        return None;
    }
    match light.kind {
        LightKind::Directional { .. } => None,
        LightKind::Point { .. } => Some(4.0 * PI),
        LightKind::Spot { inner, outer, .. } => {
            let (i, o) = (libm::cos(inner as f64), libm::cos(outer as f64));
            let blend = (i - o).max(1e-3);
            // The integral of t² over the falloff is a third of it; the part beyond the axis (cosθ
            // > 1) is subtracted.
            let over = ((o + blend - 1.0) / blend).max(0.0);
            let inside = (1.0 - o - blend).max(0.0);
            Some(2.0 * PI * (inside + blend * (1.0 - over).powi(3) / 3.0))
        }
    }
}

/// The bounding sphere of the scene.
struct Bounds {
    centre: Vec3,
    radius: f64,
}

impl Bounds {
    fn of(world: &World) -> Self {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in world.soup.seen_triangles().iter().flatten() {
            low = low.min(*p);
            high = high.max(*p);
        }
        if world.soup.is_empty() {
            (low, high) = (Vec3::ZERO, Vec3::ZERO);
        }
        Bounds {
            centre: (low + high) * 0.5,
            radius: 0.5 * (high - low).as_dvec3().length(),
        }
    }

    /// A ray of the lamp: origin, unit direction, and relative intensity in that direction.
    fn ray(&self, world: &World, light: &Light, random: [f32; 4]) -> (Vec3, Vec3, f64) {
        let about = |axis: Vec3, cos: f32, phi: f32| -> Vec3 {
            let (x, y) = axis.any_orthonormal_pair();
            let sine = (1.0 - cos * cos).max(0.0).sqrt();
            x * (sine * libm::cosf(phi)) + y * (sine * libm::sinf(phi)) + axis * cos
        };
        // From the surface of a lamp with a radius: from a distance, it looks like a uniform disc.
        let from = |position: Vec3, direction: Vec3, radius: f32| -> Vec3 {
            if radius <= 0.0 {
                return position;
            }
            let (offset, r) = aside(direction, radius, random);
            position + offset + direction * (radius * radius - r * r).max(0.0).sqrt()
        };
        let [u, v, ..] = random;
        let phi = std::f32::consts::TAU * v;
        match light.kind {
            LightKind::Point {
                position, radius, ..
            } => {
                let direction = about(Vec3::Y, 1.0 - 2.0 * u, phi);
                let weight = world.scene.profile_factor(light, direction) as f64;
                (from(position, direction, radius), direction, weight)
            }
            LightKind::Spot {
                position,
                direction,
                radius,
                inner,
                outer,
                ..
            } => {
                let cos = 1.0 - u * (1.0 - libm::cosf(outer));
                let direction = about(direction, cos, phi);
                let weight = cone(cos as f64, inner, outer)
                    * world.scene.profile_factor(light, direction) as f64;
                (from(position, direction, radius), direction, weight)
            }
            LightKind::Directional { direction, angle } => {
                let direction = about(direction, 1.0 - u * (1.0 - libm::cosf(angle)), phi);
                (self.start_afar(direction, random), direction, 1.0)
            }
        }
    }

    /// A starting point for a ray along `direction` that may hit any part of the scene.
    fn start_afar(&self, direction: Vec3, random: [f32; 4]) -> Vec3 {
        let (offset, _) = aside(direction, self.radius as f32, random);
        self.centre - direction * (1.01 * self.radius as f32) + offset
    }
}

/// A point on the disc of this radius perpendicular to the direction, and its distance from the
/// centre.
fn aside(direction: Vec3, radius: f32, random: [f32; 4]) -> (Vec3, f32) {
    let (x, y) = direction.any_orthonormal_pair();
    let r = radius * random[2].sqrt();
    let (sin, cos) = libm::sincosf(std::f32::consts::TAU * random[3]);
    (x * (r * cos) + y * (r * sin), r)
}
