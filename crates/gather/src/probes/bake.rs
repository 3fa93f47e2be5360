//! Probes at points: rays over the whole sphere, and the arrivals from lamps.

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

/// A probe is inside of something when this share of its rays meets black back faces. Engines draw
/// the line there too (the validity threshold of Unity's probe volumes, the back-face threshold of
/// RTXGI): what has a back to it in a quarter of all directions is, in levels as they are built,
/// behind a wall or in it, though its rays may slip out where walls do not close.
const INSIDE: f32 = 0.25;

/// Independent parts of a probe's samples; the spread among them tells the error. Fewer know less
/// about it, more see less of the stratification. A power of two, as blocks of Sobol points are.
const GROUPS: u32 = 8;

/// Probes computed between two looks at the monitor.
const BLOCK: usize = 8;

/// Decides the random numbers of all probes. They share their directions, so that what sampling
/// leaves of error changes slowly from probe to probe, and things that move do not flicker.
const SEED: u32 = 0x7072_6f62;

/// How carefully probes are baked.
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

/// What was baked, for the report.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ProbeReport {
    /// Probes.
    pub probes: u64,
    /// Those inside or behind things.
    pub invalid: u64,
    /// Along x, y and z, where they are a grid.
    pub dims: Option<[u32; 3]>,
    /// Gathering rays; those to lamps come on top.
    pub rays: u64,
    /// Estimated relative error: root mean square over valid probes of standard error / (first
    /// coefficient + 1 % of its mean).
    pub estimated_error: f64,
}

/// Light and surfaces that probes see.
pub struct ProbeScene<'s, 'w, 'a> {
    /// Surfaces and sky.
    pub world: &'w World<'a>,
    /// Solved light.
    pub solution: &'s Solution,
    /// Direct light, at what rays hit and at the probes.
    pub direct: &'s DirectLight<'w, 'a>,
}

/// Bakes probes at `positions` (recentred world space, metres), in their order.
///
/// Deterministic for any number of threads, and each probe is independent of the others.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
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
    /// The point, or where it lies on a face or nearly so, one right in front of it. Points on a
    /// grid of round numbers hit floors: what rays from there meet is up to rounding.
    fn off_faces(&self, at: Vec3) -> Vec3 {
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
        // What a radiance of 1 from everywhere would give.
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
        // Most of what arrives from all around is its mean, of which all but the first coefficient
        // are 0. What the directions make of it instead is known, and taken off.
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

    /// Radiance that arrives from `direction`, but for what comes straight from lamps; `None` from
    /// a black back face.
    fn radiance(&self, at: Vec3, direction: Vec3, seed: u32) -> Option<Vec3> {
        let (found, tint) = self.world.incoming(at, direction);
        match found {
            Incoming::Escaped => Some(tint * self.world.sky.radiance(direction)),
            Incoming::Black => None,
            Incoming::Surface(hit) => {
                let p = at + direction * hit.t;
                let solution = self.solution;
                Some(tint * solution.radiance(self.world, self.direct, &hit, p, seed))
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

/// Counts what was baked with `options`.
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
