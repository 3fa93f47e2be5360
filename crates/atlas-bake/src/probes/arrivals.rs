//! Light that arrives at points in the air straight from lamps and emissive surfaces.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};
use radiosity::{Incoming, World, hash_u32, sample_2d};

use super::on_sphere;

/// Brings the light that gathering rays leave out.
pub trait Arrivals: Sync {
    /// Calls `f` with a unit direction towards a light and ∫ L dω over the part of the sphere that this sample stands for: the
    /// illuminance of a surface that faces it (lx or W/m², RGB), shadows included. Every light gets up to `samples` samples, of
    /// which `seed` decides the random numbers.
    fn for_each_arrival(&self, at: Vec3, samples: u32, seed: u32, f: &mut impl FnMut(Vec3, Vec3));
}

/// Arrivals from points and parallel light, in closed form with a shadow ray, and from emissive surfaces by rays that happen to hit them.
///
/// Unbiased but for the size of lights, and noisy where an emissive surface is small: what samples lights themselves does better.
pub struct TracedArrivals<'w, 'a> {
    /// Scene.
    pub world: &'w World<'a>,
}

impl Arrivals for TracedArrivals<'_, '_> {
    fn for_each_arrival(&self, at: Vec3, samples: u32, seed: u32, f: &mut impl FnMut(Vec3, Vec3)) {
        let world = self.world;
        for light in &world.scene.lights {
            if let Some((to, t_max, value)) = punctual(light, at)
                && !world.occluded(at, to, t_max)
            {
                f(to.normalize(), value);
            }
        }
        let shines = |m: &mesh_ingest::Material| m.emissive != Vec3::ZERO;
        if !world.scene.materials.iter().any(shines) {
            return;
        }
        let solid_angle = 4.0 * std::f32::consts::PI / samples as f32;
        for i in 0..samples {
            let [u, v] = sample_2d(i, 0, hash_u32(seed));
            let direction = on_sphere(u, v);
            if let Incoming::Surface(hit) = world.incoming(at, direction)
                && world.gathered_emission(hit.triangle, hit.u, hit.v) == Vec3::ZERO
            {
                let l = world.scene.emission(world.soup, hit.triangle, hit.u, hit.v);
                f(direction, l * solid_angle);
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
