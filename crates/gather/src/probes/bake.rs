//! Probes at points: rays over the whole sphere, and light arriving directly from lamps.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, Vec3};
use radiosity::{
    Cancelled, DirectLight, Incoming, Monitor, Phase, Solution, World, hash_u32, luminance,
    sample_2d,
};
use rayon::prelude::*;
use serde::Serialize;
use visibility::Ray;

use super::grid::ProbeGrid;
use super::probe::Probe;
use super::sh::{Sh2, basis, on_sphere};

/// A probe is inside something if this fraction of its rays hits black backfaces. Engines use
/// similar thresholds (the validity threshold of Unity's probe volumes, the backface threshold of
/// RTXGI). In typical levels, a point that sees backfaces in a quarter of all directions is behind
/// or in a wall, though its rays may escape where walls do not close.
pub(super) const INSIDE: f32 = 0.25;

/// Number of independent parts of a probe's samples, whose spread gives the error. Fewer give a
/// less certain estimate, more lose more of the stratification. A power of two, like blocks of
/// Sobol points.
const GROUPS: u32 = 8;

/// Probes computed between two checks for cancellation.
const BLOCK: usize = 8;

/// Seed of the random numbers of all probes. They share their directions, so that sampling errors
/// vary slowly from probe to probe, and moving objects do not flicker.
const SEED: u32 = 0x7072_6f62;

/// Accuracy of probes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProbeOptions {
    /// Rays over the sphere, a power of two from 8 to 65536.
    pub rays: u32,
    /// Samples for each light that is not a point, at least 8.
    pub samples: u32,
}

impl Default for ProbeOptions {
    fn default() -> Self {
        ProbeOptions {
            rays: 1024,
            samples: 128,
        }
    }
}

/// Report on probes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ProbeReport {
    /// Number of probes.
    pub probes: u64,
    /// Number of those inside or behind something.
    pub invalid: u64,
    /// Numbers along x, y and z, if they form a grid.
    pub dims: Option<[u32; 3]>,
    /// Gathering rays, without those to lamps.
    pub rays: u64,
    /// Estimated relative error: root mean square over valid probes of standard error / (first
    /// coefficient + 1 % of its mean).
    pub estimated_error: f64,
}

/// The light and surfaces that probes see.
pub struct ProbeScene<'s, 'w, 'a> {
    /// Surfaces and sky.
    pub world: &'w World<'a>,
    /// Solved light.
    pub solution: &'s Solution,
    /// Direct light, at hits and at the probes.
    pub direct: &'s DirectLight<'w, 'a>,
}

/// Bakes probes at `positions` (recentred world space, metres), in their order.
///
/// Deterministic for any number of threads, and each probe is independent of the others.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn bake_probes(
    scene: &ProbeScene,
    positions: &[Vec3],
    options: &ProbeOptions,
    monitor: &dyn Monitor,
) -> Result<Vec<Probe>, Cancelled> {
    let mut probes = vec![Probe::default(); positions.len()];
    let (done, total) = (AtomicU64::new(0), positions.len() as u64);
    let blocks = probes
        .par_chunks_mut(BLOCK)
        .zip(positions.par_chunks(BLOCK));
    blocks.for_each(|(out, at)| {
        for (probe, at) in out.iter_mut().zip(at) {
            if monitor.cancelled() {
                return;
            }
            *probe = scene.probe(*at, options);
        }
        let block = out.len() as u64;
        let now = done.fetch_add(block, Ordering::Relaxed) + block;
        monitor.progress(Phase::Probes, now, total);
    });
    if done.load(Ordering::Relaxed) < total {
        return Err(Cancelled);
    }
    Ok(probes)
}

impl ProbeScene<'_, '_, '_> {
    /// The point, or one right in front of the face if it is (nearly) on a face. Points on a grid
    /// of round numbers are often on floors, where hits would depend on rounding.
    pub(super) fn off_faces(&self, at: Vec3) -> Vec3 {
        let reach = 4.0 * self.world.offset(at);
        let mut p = at;
        for axis in Vec3::AXES {
            let ray = Ray {
                origin: p - axis * reach,
                direction: axis,
                t_min: 0.0,
                t_max: 2.0 * reach,
            };
            if let Some(hit) = self.world.closest_hit(&ray) {
                let corner = self.world.soup.triangles[hit.triangle as usize][0];
                let normal = self.world.soup.normals[hit.triangle as usize];
                p += normal * (reach - normal.dot(p - corner)).max(0.0);
            }
        }
        p
    }

    fn probe(&self, at: Vec3, options: &ProbeOptions) -> Probe {
        let at = self.off_faces(at);
        let rays = (options.rays / GROUPS).max(1);
        let samples = (options.samples / GROUPS).max(1);
        let solid_angle = 4.0 * std::f64::consts::PI / f64::from(rays);
        let mut gathered = [DVec3::ZERO; 9];
        let mut arrived = [DVec3::ZERO; 9];
        // Coefficients estimated for a constant radiance of 1.
        let mut unit = [DVec3::ZERO; 9];
        let mut firsts = [0f64; GROUPS as usize];
        let mut black = 0;
        for (g, first) in firsts.iter_mut().enumerate() {
            let g = g as u32;
            let before = gathered[0] + arrived[0];
            for i in g * rays..(g + 1) * rays {
                let [u, v] = sample_2d(i, 0, SEED);
                let direction = on_sphere(u, v);
                add(&mut unit, direction, DVec3::splat(solid_angle));
                match self.radiance(at, direction, hash_u32(SEED ^ i)) {
                    Some(l) => add(&mut gathered, direction, l.as_dvec3() * solid_angle),
                    None => black += 1,
                }
            }
            let seed = hash_u32(SEED.wrapping_add(g));
            self.direct
                .for_each_arrival(at, samples, seed, &mut |direction, flux| {
                    add(&mut arrived, direction, flux.as_dvec3())
                });
            let part = gathered[0] + arrived[0] - before;
            *first = f64::from(luminance(part.as_vec3()));
        }
        // Most of the light is its mean, for which all but the first coefficient should be 0. The
        // error of the directions for a constant is known, and subtracted.
        let mean = gathered[0] / unit[0];
        for (g, u) in gathered.iter_mut().zip(unit).skip(1) {
            *g -= mean * u;
        }
        let sh = std::array::from_fn(|k| (gathered[k] + arrived[k]).as_vec3() / GROUPS as f32);
        let n = f64::from(GROUPS);
        let mean = firsts.iter().sum::<f64>() / n;
        let square: f64 = firsts.iter().map(|f| (f - mean).powi(2)).sum();
        let backfaces = black as f32 / (rays * GROUPS) as f32;
        Probe {
            sh: Sh2(sh),
            error: (square / (n * (n - 1.0))).sqrt() as f32,
            backfaces,
            valid: backfaces < INSIDE,
        }
    }

    /// Radiance that arrives from `direction`, except directly from lamps; `None` from a black
    /// backface.
    fn radiance(&self, at: Vec3, direction: Vec3, seed: u32) -> Option<Vec3> {
        let (found, tint) = self.world.incoming(at, direction);
        match found {
            Incoming::Escaped => Some(tint * self.world.sky.radiance(direction)),
            Incoming::Black => None,
            Incoming::Surface(hit) => {
                let p = at + direction * hit.t;
                let (world, solution) = (self.world, self.solution);
                let all = solution.radiance(world, self.direct, &hit, p, seed);
                let boost = world.bounce.reflected;
                if boost == 1.0 {
                    return Some(tint * all);
                }
                let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
                Some(tint * (glow + (all - glow) * boost))
            }
        }
    }
}

/// Adds light from a unit direction.
fn add(sum: &mut [DVec3; 9], direction: Vec3, flux: DVec3) {
    for (s, y) in sum.iter_mut().zip(basis(direction)) {
        *s += flux * f64::from(y);
    }
}

/// Report on probes baked with `options`.
pub fn report_probes(
    probes: &[Probe],
    grid: Option<&ProbeGrid>,
    options: &ProbeOptions,
) -> ProbeReport {
    let open = || probes.iter().filter(|p| p.valid);
    let first = |p: &Probe| f64::from(luminance(p.sh.0[0]));
    let n = open().count();
    let per_probe = 1.0 / n.max(1) as f64;
    let mean = open().map(first).sum::<f64>() * per_probe;
    let square = open().fold(0.0, |s, p| {
        let scale = first(p) + 0.01 * mean;
        let relative = f64::from(p.error) / scale;
        s + if scale > 0.0 {
            relative * relative
        } else {
            0.0
        }
    });
    ProbeReport {
        probes: probes.len() as u64,
        invalid: (probes.len() - n) as u64,
        dims: grid.map(|g| g.dims),
        rays: probes.len() as u64 * u64::from((options.rays / GROUPS).max(1) * GROUPS),
        estimated_error: (square * per_probe).sqrt(),
    }
}

#[cfg(test)]
mod tests;
