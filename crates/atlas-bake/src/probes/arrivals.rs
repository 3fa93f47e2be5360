//! Light that arrives at points in the air straight from lamps and emissive surfaces.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};
use radiosity::{World, luminance, sample_2d, sample_4d};

/// Brings the light that gathering rays leave out.
pub trait Arrivals: Sync {
    /// Calls `f` with a unit direction towards a light and ∫ L dω over the part of the sphere that this sample stands for: the
    /// illuminance of a surface that faces it (lx or W/m², RGB), shadows included. Every light gets up to `samples` samples, of
    /// which `seed` decides the random numbers.
    fn for_each_arrival(&self, at: Vec3, samples: u32, seed: u32, f: &mut impl FnMut(Vec3, Vec3));
}

/// Arrivals from points and parallel light, in closed form with a shadow ray, and from emissive surfaces by points on them, drawn by
/// the power of their triangles.
///
/// Unbiased, but lights that have a size count as points, and an emissive surface close by makes noise, like 1/d².
pub struct SampledArrivals<'w, 'a> {
    world: &'w World<'a>,
    /// Triangles whose emission gathering rays do not count, and the running sum of their power, each included.
    emitters: Vec<(u32, f64)>,
}

/// Points at which a triangle's emission is looked at.
const LOOKS: u32 = 64;

impl<'w, 'a> SampledArrivals<'w, 'a> {
    /// Finds the emitters of a world.
    pub fn new(world: &'w World<'a>) -> Self {
        let (scene, soup) = (world.scene, world.soup);
        let glows = |t: u32| {
            let m = soup.materials[t as usize];
            scene.materials[m as usize].emissive != Vec3::ZERO
        };
        let is_gathered = |t: u32| {
            (0..LOOKS).any(|i| {
                let [u, v] = folded(sample_2d(i, 0, 0));
                world.gathered_emission(t, u, v) != Vec3::ZERO
            })
        };
        let mut sum = 0.0;
        let emitters = (0..soup.triangles.len() as u32)
            .filter(|&t| glows(t) && !is_gathered(t))
            .filter_map(|t| {
                let mean = luminance(scene.mean_emission(soup, t, LOOKS));
                let power = f64::from(mean * soup.areas[t as usize]);
                sum += power;
                (power > 0.0).then_some((t, sum))
            })
            .collect();
        SampledArrivals { world, emitters }
    }

    /// The triangle at the share `x` of the power, and its own share.
    fn pick(&self, x: f32) -> Option<(u32, f64)> {
        let total = self.emitters.last()?.1;
        let at = f64::from(x) * total;
        let k = self.emitters.partition_point(|e| e.1 <= at);
        let k = k.min(self.emitters.len() - 1);
        let before = k.checked_sub(1).map_or(0.0, |k| self.emitters[k].1);
        let (triangle, after) = self.emitters[k];
        Some((triangle, (after - before) / total))
    }

    /// Direction to a point of an emitter and what comes from there, as if it stood for all emitters; `None` where nothing does.
    fn drawn_emitter(&self, at: Vec3, random: [f32; 4]) -> Option<(Vec3, Vec3)> {
        let world = self.world;
        let (t, share) = self.pick(random[2])?;
        let [u, v] = folded([random[0], random[1]]);
        let [a, b, c] = world.soup.triangles[t as usize];
        let q = a + (b - a) * u + (c - a) * v;
        let to = q - at;
        let d2 = to.length_squared();
        let direction = to.try_normalize()?;
        let normal = world.soup.normals[t as usize];
        let cos = -normal.dot(direction);
        let cos = if world.two_sided(t) { cos.abs() } else { cos };
        if cos <= 0.0 {
            return None;
        }
        // The ray ends as far off the emitter's plane as a receiver there would start.
        let stop = 2.0 * world.offset(q) / normal.dot(to).abs();
        if stop < 1.0 && world.occluded(at, to, 1.0 - stop) {
            return None;
        }
        let solid_angle = cos / d2 * world.soup.areas[t as usize];
        let l = world.scene.emission(world.soup, t, u, v);
        let value = l * (f64::from(solid_angle) / share) as f32;
        value.is_finite().then_some((direction, value))
    }
}

/// Barycentrics, uniform over the triangle.
fn folded([x, y]: [f32; 2]) -> [f32; 2] {
    let s = x.sqrt();
    [s * (1.0 - y), s * y]
}

impl Arrivals for SampledArrivals<'_, '_> {
    fn for_each_arrival(&self, at: Vec3, samples: u32, seed: u32, f: &mut impl FnMut(Vec3, Vec3)) {
        let world = self.world;
        for light in &world.scene.lights {
            if let Some((to, t_max, value)) = punctual(light, at)
                && !world.occluded(at, to, t_max)
            {
                f(to.normalize(), value);
            }
        }
        if self.emitters.is_empty() {
            return;
        }
        for i in 0..samples {
            if let Some((direction, value)) = self.drawn_emitter(at, sample_4d(i, 0, seed)) {
                f(direction, value / samples as f32);
            }
        }
    }
}

/// Shadow ray's direction and end, and ∫ L dω without it; `None` where that is 0.
fn punctual(light: &Light, at: Vec3) -> Option<(Vec3, f32, Vec3)> {
    let falloff = |d: Vec3, range: Option<f32>| {
        let d2 = d.length_squared();
        let q = range.map_or(0.0, |r| d2 / (r * r));
        (1.0 - q * q).clamp(0.0, 1.0) / d2
    };
    let (to, t_max, factor) = match light.kind {
        LightKind::Directional { direction, .. } => (-direction, f32::INFINITY, 1.0),
        LightKind::Point {
            position, range, ..
        } => (position - at, 1.0, falloff(position - at, range)),
        LightKind::Spot {
            position,
            direction,
            range,
            inner,
            outer,
            ..
        } => {
            let to = position - at;
            let cos = -direction.dot(to.normalize_or_zero());
            let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
            let cone = ((cos - outer.cos()) * scale).clamp(0.0, 1.0);
            (to, 1.0, cone * cone * falloff(to, range))
        }
    };
    // At the light itself there is no direction, and no limit to what arrives.
    let sound = to.try_normalize().is_some() && factor.is_finite();
    let value = light.intensity * factor;
    (sound && value != Vec3::ZERO).then_some((to, t_max, value))
}
