//! Reflection captures: what a mirror at a point sees, and blurred for rougher surfaces.
//!
//! Based on: B. Karis, *Real Shading in Unreal Engine 4*, 2013 (the first of the two sums, with
//! normal = view = reflection); M. Colbert and J. Křivánek, *GPU-Based Importance Sampling*, GPU
//! Gems 3, 2007 (samples read a level as coarse as their share of the lobe).

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use radiosity::{Cancelled, Incoming, Monitor, Phase, Sky, hash_u32, sample_2d};
use rayon::prelude::*;
use serde::Serialize;

use super::bake::{INSIDE, ProbeScene};

/// Texels along a face of the smallest level. Smaller ones show the faces' edges on rough balls.
const SMALLEST: u32 = 4;

/// Samples of the lobe for each texel of a blurred level: twice as many change no 8-bit value in a
/// box with lamps.
const LOBE: u32 = 256;

/// Resolution of reflection captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReflectionOptions {
    /// Texels along a face, a power of two of at least 4.
    pub size: u32,
    /// Rays for each texel.
    pub rays: u32,
}

impl ReflectionOptions {
    /// Rays of a capture.
    pub fn rays_each(&self) -> u64 {
        6 * u64::from(self.size).pow(2) * u64::from(self.rays)
    }
}

/// Radiances around a point, as a cube map with levels for rougher surfaces.
///
/// Level k of n is blurred by the GGX lobe of the perceptual roughness k / (n − 1), as Bevy and
/// the glTF Sample Viewer read it. Faces are +X, −X, +Y, −Y, +Z, −Z as in KTX2 (left-handed): the
/// radiance from direction (x, y, z) of the glTF is at (x, y, −z) of the cube.
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectionCube {
    /// Texels along a face of the first level.
    pub size: u32,
    /// Levels, each half as large as the one before: 6 faces, row-major, row 0 at the top.
    pub levels: Vec<Vec<Vec3>>,
    /// Share of the rays that hit backs of single-sided faces.
    pub backfaces: f32,
}

/// Report on reflection captures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct ReflectionReport {
    /// Number of captures.
    pub captures: u64,
    /// Number of those inside or behind something.
    pub invalid: u64,
    /// Texels along a face.
    pub size: u32,
    /// Rays.
    pub rays: u64,
}

/// Summarises captures that were made with `options`.
pub fn report_reflections(
    cubes: &[ReflectionCube],
    options: &ReflectionOptions,
) -> ReflectionReport {
    let captures = cubes.len() as u64;
    ReflectionReport {
        captures,
        invalid: cubes.iter().filter(|c| c.backfaces >= INSIDE).count() as u64,
        size: options.size,
        rays: captures * options.rays_each(),
    }
}

/// Captures the light around `points` (recentred world space, metres).
///
/// Lamps and area lights are invisible; emissive surfaces, also those that are sampled as lights, and all of the
/// sky are visible. The same for any number of threads.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub fn capture_reflections(
    scene: &ProbeScene,
    points: &[Vec3],
    options: &ReflectionOptions,
    monitor: &dyn Monitor,
) -> Result<Vec<ReflectionCube>, Cancelled> {
    let sky = scene.world.whole_sky();
    let mut out = Vec::with_capacity(points.len());
    for at in points {
        if monitor.cancelled() {
            return Err(Cancelled);
        }
        out.push(scene.capture(*at, &sky, options));
        monitor.progress(Phase::Reflections, out.len() as u64, points.len() as u64);
    }
    Ok(out)
}

impl ProbeScene<'_, '_, '_> {
    fn capture(&self, at: Vec3, sky: &Sky, options: &ReflectionOptions) -> ReflectionCube {
        let at = self.off_faces(at);
        let size = options.size;
        let found: Vec<(Vec3, u32)> = (0..6 * size * size)
            .into_par_iter()
            .map(|texel| {
                let (mut sum, mut black) = (Vec3::ZERO, 0);
                for i in 0..options.rays {
                    let [u, v] = sample_2d(i, 0, hash_u32(texel));
                    let direction = direction(size, texel, Vec2::new(u, v));
                    let seed = hash_u32(texel ^ hash_u32(i));
                    match self.visible(at, direction, sky, seed) {
                        Some(light) => sum += light,
                        None => black += 1,
                    }
                }
                (sum / options.rays as f32, black)
            })
            .collect();
        let black: u32 = found.iter().map(|f| f.1).sum();
        let sharp = found.into_iter().map(|f| f.0).collect();
        ReflectionCube {
            size,
            levels: levels(size, sharp),
            backfaces: black as f32 / (6 * size * size * options.rays) as f32,
        }
    }

    /// Radiance that arrives from `direction`; `None` from a black backface.
    fn visible(&self, at: Vec3, direction: Vec3, sky: &Sky, seed: u32) -> Option<Vec3> {
        let (found, tint) = self.world.incoming(at, direction);
        match found {
            Incoming::Escaped => Some(tint * sky.radiance(direction)),
            Incoming::Black => None,
            Incoming::Surface(hit) => {
                let p = at + direction * hit.t;
                let sent = (self.solution).radiance(self.world, self.direct, &hit, p, seed);
                let [gathered, all] = [
                    self.world.gathered_emission(hit.triangle, hit.u, hit.v),
                    self.world.seen_emission(hit.triangle, hit.u, hit.v),
                ];
                Some(tint * (sent - gathered + all))
            }
        }
    }
}

/// The glTF direction of a place in a texel.
fn direction(size: u32, texel: u32, within: Vec2) -> Vec3 {
    let (face, at) = (texel / (size * size), texel % (size * size));
    let corner = Vec2::new((at % size) as f32, (at / size) as f32);
    let Vec2 { x: s, y: t } = (corner + within) * (2.0 / size as f32) - 1.0;
    // The table of cube maps (OpenGL 4.6, table 8.19) with z negated.
    let d = match face {
        0 => Vec3::new(1.0, -t, s),
        1 => Vec3::new(-1.0, -t, -s),
        2 => Vec3::new(s, 1.0, -t),
        3 => Vec3::new(s, -1.0, t),
        4 => Vec3::new(s, -t, -1.0),
        _ => Vec3::new(-s, -t, 1.0),
    };
    d.normalize()
}

/// The face and the coordinates on it, 0..=1, of a glTF direction: the inverse of [`direction`].
fn face_of(d: Vec3) -> (usize, Vec2) {
    let a = d.abs();
    let (face, s, t, most) = if a.x >= a.y && a.x >= a.z {
        let sign = d.x.signum();
        (usize::from(d.x < 0.0), sign * d.z, -d.y, a.x)
    } else if a.y >= a.z {
        let sign = d.y.signum();
        (2 + usize::from(d.y < 0.0), d.x, -sign * d.z, a.y)
    } else {
        let sign = -d.z.signum();
        (4 + usize::from(d.z > 0.0), sign * d.x, -d.y, a.z)
    };
    (face, Vec2::new(s, t) / (2.0 * most) + 0.5)
}

/// Bilinear within a face of a cube of `size`.
fn lookup(size: u32, texels: &[Vec3], d: Vec3) -> Vec3 {
    let (face, uv) = face_of(d);
    let last = size as f32 - 1.0;
    let place = (uv * size as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
    let (low, part) = (place.floor(), place.fract());
    let [x, y] = [low.x as usize, low.y as usize];
    let n = size as usize;
    let [far_x, far_y] = [x, y].map(|i| (i + 1).min(n - 1));
    let at = |x: usize, y: usize| texels[(face * n + y) * n + x];
    let top = at(x, y).lerp(at(far_x, y), part.x);
    top.lerp(at(x, far_y).lerp(at(far_x, far_y), part.x), part.y)
}

/// Means over 2 × 2 texels.
fn halved(size: u32, texels: &[Vec3]) -> Vec<Vec3> {
    let (n, half) = (size as usize, size as usize / 2);
    (0..6 * half * half)
        .map(|i| {
            let (face, y, x) = (i / (half * half), i / half % half, i % half);
            let at = |dx, dy| texels[(face * n + 2 * y + dy) * n + 2 * x + dx];
            0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1))
        })
        .collect()
}

fn levels(size: u32, sharp: Vec<Vec3>) -> Vec<Vec<Vec3>> {
    // The means that samples of the lobe read.
    let mut means = vec![(size, sharp)];
    while let Some((n, texels)) = means.last()
        && *n > 1
    {
        let half = (n / 2, halved(*n, texels));
        means.push(half);
    }
    let count = (size / SMALLEST).max(1).ilog2() + 1;
    let mut out = vec![means[0].1.clone()];
    for k in 1..count {
        let roughness = k as f32 / (count - 1) as f32;
        let lobe = Lobe::new(roughness, size);
        let n = size >> k;
        let texels = (0..6 * n * n)
            .into_par_iter()
            .map(|texel| lobe.filter(&means, direction(n, texel, Vec2::splat(0.5))))
            .collect();
        out.push(texels);
    }
    out
}

/// Samples of a GGX lobe around +Z: direction, weight, and level of the means.
struct Lobe {
    samples: Vec<(Vec3, f32, f32)>,
}

impl Lobe {
    /// For a perceptual roughness, 0..=1, and faces of `size` texels.
    fn new(roughness: f32, size: u32) -> Lobe {
        let a2 = roughness.powi(4);
        let texel = 4.0 * PI / (6 * size * size) as f32;
        let samples = (0..LOBE)
            .filter_map(|i| {
                let [u, v] = sample_2d(i, 0, 0);
                // Half vector, then its reflection.
                let cos2 = (1.0 - u) / (1.0 + (a2 - 1.0) * u);
                let (cos, sin) = (cos2.sqrt(), (1.0 - cos2).max(0.0).sqrt());
                let (y, x) = libm::sincosf(2.0 * PI * v);
                let half = Vec3::new(sin * x, sin * y, cos);
                let light = 2.0 * cos * half - Vec3::Z;
                if light.z <= 0.0 {
                    return None;
                }
                // With normal = view, the density over directions is D / 4.
                let d = cos2 * (a2 - 1.0) + 1.0;
                let density = a2 / (PI * d * d) / 4.0;
                let level = 0.5 * libm::log2f(1.0 / (LOBE as f32 * density * texel));
                Some((light, light.z, level.max(0.0)))
            })
            .collect();
        Lobe { samples }
    }

    fn filter(&self, means: &[(u32, Vec<Vec3>)], axis: Vec3) -> Vec3 {
        let (x, y) = axis.any_orthonormal_pair();
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for (light, weight, level) in &self.samples {
            let d = x * light.x + y * light.y + axis * light.z;
            let low = (*level as usize).min(means.len() - 1);
            let high = (low + 1).min(means.len() - 1);
            let read = |k: usize| lookup(means[k].0, &means[k].1, d);
            sum += read(low).lerp(read(high), (level - low as f32).min(1.0)) * *weight;
            weights += weight;
        }
        sum / weights
    }
}

#[cfg(test)]
mod tests;
