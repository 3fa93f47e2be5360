//! The flux of punctual lights and where it goes, by rays from them.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use mesh_ingest::{Light, LightKind};

use crate::sampling::{hash_u32, sample_2d};
use crate::world::{Incoming, World};

/// Rays from all lamps together, about, and from one at most and at least.
const RAYS: usize = 1 << 18;
const MOST: usize = 1 << 13;
const LEAST: usize = 1 << 7;

/// Each lamp's rays are this many sets of Sobol points, scrambled independently: the spread among the sets tells the error of their
/// mean, stratification included. With 15 degrees of freedom the error passes four standard errors once in 900 times.
const SETS: u32 = 16;

/// Where the light of all punctual lights goes (RGB, W or lm).
#[derive(Debug, Default)]
pub(crate) struct LampFlux {
    /// Sent out, or, of suns and of lamps with a range, what meets a surface.
    pub emitted: DVec3,
    /// Met the back of a single-sided face.
    pub behind: DVec3,
    /// Met nothing.
    pub escaped: DVec3,
    /// Variance of the luminous flux that meets surfaces.
    pub variance: f64,
}

/// Sums over one lamp's rays.
#[derive(Default)]
struct Tally {
    all: f64,
    front: f64,
    behind: f64,
    escaped: f64,
}

impl LampFlux {
    /// Casts rays from every lamp.
    pub(crate) fn measure(world: &World) -> Self {
        let lights = &world.scene.lights;
        let mut out = LampFlux::default();
        if lights.is_empty() {
            return out;
        }
        let n = (RAYS / lights.len()).clamp(LEAST, MOST) as u32 / SETS;
        let bounds = Bounds::of(world);
        for (k, light) in lights.iter().enumerate() {
            let seed = hash_u32(k as u32 ^ 0x6c61_6d70);
            out.add(world, light, &bounds, n, seed);
        }
        out
    }

    fn add(&mut self, world: &World, light: &Light, bounds: &Bounds, n: u32, seed: u32) {
        let mut t = Tally::default();
        let mut sets = [0f64; SETS as usize];
        for i in 0..n * SETS {
            let set = i / n;
            let [u, v] = sample_2d(i % n, 0, seed ^ hash_u32(set));
            let (origin, direction, weight) = bounds.ray(light, u, v);
            let range = range(light);
            match world.incoming(origin, direction) {
                Incoming::Escaped => {
                    let w = if range.is_some() { 0.0 } else { weight };
                    t.escaped += w;
                    t.all += w;
                }
                Incoming::Black => {
                    // How far off does not matter for lamps without a range.
                    let w = weight * if range.is_some() { 0.0 } else { 1.0 };
                    t.behind += w;
                    t.all += w;
                }
                Incoming::Surface(hit) => {
                    let w = weight * window(hit.t as f64, range);
                    t.front += w;
                    sets[set as usize] += w;
                    t.all += w;
                }
            }
        }
        // The flux that a weight of 1 in all rays stands for.
        let rays = (n * SETS) as f64;
        let whole = match light.kind {
            LightKind::Directional { .. } => PI * bounds.radius * bounds.radius,
            LightKind::Point { .. } => 4.0 * PI,
            LightKind::Spot { outer, .. } => 2.0 * PI * (1.0 - (outer as f64).cos()),
        };
        // Per ray; where all of the flux is known it takes the place of its estimate.
        let each = match (exact(light), t.all > 0.0) {
            (Some(flux), true) => flux / t.all,
            _ => whole / rays,
        };
        let colour = light.intensity.as_dvec3();
        let sun = matches!(light.kind, LightKind::Directional { .. });
        let escaped = if sun { 0.0 } else { t.escaped };
        self.emitted += colour * ((t.front + t.behind + escaped) * each);
        self.behind += colour * (t.behind * each);
        self.escaped += colour * (escaped * each);
        let l = colour.dot(DVec3::new(0.2126, 0.7152, 0.0722));
        let mean = t.front / SETS as f64;
        let squares: f64 = sets.iter().map(|s| (s - mean).powi(2)).sum();
        self.variance += squares * (SETS as f64 / (SETS as f64 - 1.0)) * (l * each).powi(2);
    }
}

fn range(light: &Light) -> Option<f32> {
    match light.kind {
        LightKind::Point { range, .. } | LightKind::Spot { range, .. } => {
            range.filter(|r| *r > 0.0)
        }
        LightKind::Directional { .. } => None,
    }
}

/// KHR_lights_punctual's window: max(1 − (d/r)⁴, 0).
fn window(d: f64, range: Option<f32>) -> f64 {
    range.map_or(1.0, |r| (1.0 - (d / r as f64).powi(4)).max(0.0))
}

/// The spot's cone: ((cosθ − cos outer)/(cos inner − cos outer))², at most 1.
fn cone(cos: f64, inner: f32, outer: f32) -> f64 {
    let (i, o) = ((inner as f64).cos(), (outer as f64).cos());
    ((cos - o) / (i - o).max(1e-3)).clamp(0.0, 1.0).powi(2)
}

/// Flux per unit of intensity, sr, where the lamp has one: 4π, or 2π ∫ cone dcosθ. The cone's blend ends `1e-3` in cosine from
/// its edge at the narrowest, as direct light has it.
fn exact(light: &Light) -> Option<f64> {
    if range(light).is_some() {
        return None;
    }
    match light.kind {
        LightKind::Directional { .. } => None,
        LightKind::Point { .. } => Some(4.0 * PI),
        LightKind::Spot { inner, outer, .. } => {
            let (i, o) = ((inner as f64).cos(), (outer as f64).cos());
            let blend = (i - o).max(1e-3);
            // ∫ t² over the blend is a third of it; what of it lies beyond the axis (cosθ > 1) is not there.
            let over = ((o + blend - 1.0) / blend).max(0.0);
            let inside = (1.0 - o - blend).max(0.0);
            Some(2.0 * PI * (inside + blend * (1.0 - over).powi(3) / 3.0))
        }
    }
}

/// A ball about the scene.
struct Bounds {
    centre: Vec3,
    radius: f64,
}

impl Bounds {
    fn of(world: &World) -> Self {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in world.soup.triangles.iter().flatten() {
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

    /// A ray of the lamp: origin, unit direction, and relative intensity there.
    fn ray(&self, light: &Light, u: f32, v: f32) -> (Vec3, Vec3, f64) {
        let about = |axis: Vec3, cos: f32, phi: f32| -> Vec3 {
            let (x, y) = axis.any_orthonormal_pair();
            let sine = (1.0 - cos * cos).max(0.0).sqrt();
            x * (sine * phi.cos()) + y * (sine * phi.sin()) + axis * cos
        };
        let phi = std::f32::consts::TAU * v;
        match light.kind {
            LightKind::Point { position, .. } => {
                (position, about(Vec3::Y, 1.0 - 2.0 * u, phi), 1.0)
            }
            LightKind::Spot {
                position,
                direction,
                inner,
                outer,
                ..
            } => {
                let cos = 1.0 - u * (1.0 - outer.cos());
                let weight = cone(cos as f64, inner, outer);
                (position, about(direction, cos, phi), weight)
            }
            LightKind::Directional { direction, .. } => {
                let (x, y) = direction.any_orthonormal_pair();
                let r = self.radius as f32 * u.sqrt();
                let offset = x * (r * phi.cos()) + y * (r * phi.sin());
                let start = self.centre - direction * (1.01 * self.radius as f32);
                (start + offset, direction, 1.0)
            }
        }
    }
}
