//! The estimator.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::footprint::Footprint;
use super::random::Random;
use super::scene::{Light, Scene, Triangle};
use super::tree::{Hit, Ray, Tree};

/// Highest survival probability of Russian roulette, so that paths end even between surfaces that
/// absorb nothing.
const MOST_SURVIVAL: f64 = 0.99;

/// How the light of emissive triangles is found. All three methods are unbiased and count every
/// emitter once; they differ in variance.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EmitterSampling {
    /// By paths that happen to hit them.
    Hits,
    /// By a point drawn on one of them at each vertex of the path; hits do not count. The variance
    /// is infinite where a surface touches an emitter.
    Points,
    /// By both, weighted by the balance heuristic (Veach 1997, §9.2.2), with low variance
    /// everywhere.
    #[default]
    Both,
}

/// Amount and method of work for an estimate.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Paths per footprint, at least 2.
    pub paths: u32,
    /// Seed of the random numbers; the same seed gives the same estimate for any number of threads.
    pub seed: u64,
    /// How emitters are found.
    pub emitters: EmitterSampling,
    /// Number of reflections after which paths are cut off. `None`, the default, cuts none. A
    /// number biases the estimate, to check that a comparison notices the bias.
    pub bounces: Option<u32>,
}

impl Effort {
    /// Unbiased, with [`EmitterSampling::Both`].
    pub fn new(paths: u32, seed: u64) -> Effort {
        Effort {
            paths,
            seed,
            emitters: EmitterSampling::Both,
            bounces: None,
        }
    }
}

/// An estimated irradiance, W/m², with standard errors.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Estimate {
    /// Mean, linear RGB.
    pub mean: DVec3,
    /// Standard error of each channel's mean.
    pub error: DVec3,
    /// Standard error of the mean's luminance (the channels share their paths, so it does not
    /// follow from `error`).
    pub luminance_error: f64,
}

/// The light of the part of a footprint that can be seen from elsewhere: its points from which at
/// least a twentieth of the rays end in the sky or on a front, farther away than three times the
/// footprint's size, and at most half of them on backs. So neither slits nor the inside of solids
/// count.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Mean irradiance of this part, linear RGB; 0 if there is none.
    pub light: DVec3,
    /// Standard error of its luminance.
    pub luminance_error: f64,
    /// This part's fraction of the footprint.
    pub part: f64,
    /// Fraction of all rays that go far.
    pub far: f64,
}

/// Sizes of a footprint that a ray must go to be far, and the fraction of such rays that a point
/// must have.
const FAR: f64 = 3.0;
const SLIT: f64 = 0.05;
/// Points of a footprint, and rays from each that look around.
const POINTS: u32 = 256;
const DIRECTIONS: u32 = 40;

/// Rec.709 luminance of linear RGB.
pub fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// A point of a path, on triangle `triangle`; `normal` is on the side that the path is on.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    position: DVec3,
    normal: DVec3,
    triangle: usize,
}

/// Traces paths through one scene.
#[derive(Debug)]
pub struct PathTracer {
    scene: Scene,
    tree: Tree,
    normals: Vec<DVec3>,
    /// Emissive triangles with the running sum of their weights, which ends at 1.
    emitters: Vec<(usize, f64)>,
    /// Density per m² with which a point of each triangle is drawn; 0 if it does not emit.
    density: Vec<f64>,
}

impl PathTracer {
    /// Prepares `scene`.
    pub fn new(scene: Scene) -> PathTracer {
        let power = |t: &Triangle| t.area() * scene.surfaces[t.surface].emission.max_element();
        let total: f64 = scene.triangles.iter().map(power).sum();
        let mut emitters = Vec::new();
        let mut density = vec![0.0; scene.triangles.len()];
        let mut running = 0.0;
        for (i, t) in scene.triangles.iter().enumerate() {
            let share = power(t) / total;
            if share > 0.0 {
                running += share;
                emitters.push((i, running));
                density[i] = share / t.area();
            }
        }
        PathTracer {
            tree: Tree::new(scene.triangles.clone()),
            normals: scene.triangles.iter().map(Triangle::normal).collect(),
            emitters,
            density,
            scene,
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Mean irradiance of the front over each footprint, in their order.
    ///
    /// Every footprint has its own random numbers, so its estimate does not depend on the others.
    pub fn irradiance(&self, footprints: &[Footprint], effort: Effort) -> Vec<Estimate> {
        each(footprints, |footprint, i| {
            self.estimate(footprint, i, effort)
        })
    }

    /// What can be seen of each footprint, in their order. `effort.paths` are spread over
    /// 256 points.
    pub fn seen(&self, footprints: &[Footprint], effort: Effort) -> Vec<Seen> {
        each(footprints, |footprint, i| {
            self.seen_of(footprint, i, effort)
        })
    }

    fn seen_of(&self, footprint: &Footprint, stream: u64, effort: Effort) -> Seen {
        let mut rng = Random::new(effort.seed, stream);
        let beyond = FAR * footprint.area.sqrt();
        let (mut sum, mut square, mut seen) = (DVec3::ZERO, 0.0, 0.0);
        let mut values = Vec::new();
        let mut all_far = 0;
        for _ in 0..POINTS {
            let start = self.start(footprint, &mut rng);
            let [far, backs] = self.look_around(&start, beyond, &mut rng);
            all_far += far;
            if f64::from(far) < SLIT * f64::from(DIRECTIONS) || 2 * backs > DIRECTIONS {
                continue;
            }
            let paths = effort.paths.div_ceil(POINTS);
            let mut light = DVec3::ZERO;
            for _ in 0..paths {
                light += self.path(start, &mut rng, effort) / f64::from(paths);
            }
            seen += 1.0;
            sum += light;
            values.push(luminance(light));
        }
        let light = sum / f64::max(seen, 1.0);
        for v in values {
            square += (v - luminance(light)).powi(2);
        }
        Seen {
            light,
            luminance_error: (square / f64::max(seen * (seen - 1.0), 1.0)).sqrt(),
            part: seen / f64::from(POINTS),
            far: f64::from(all_far) / f64::from(POINTS * DIRECTIONS),
        }
    }

    /// How many random rays from `x` end in the sky or on a front, farther than `beyond`; and how
    /// many on backs.
    fn look_around(&self, x: &Vertex, beyond: f64, rng: &mut Random) -> [u32; 2] {
        let (mut far, mut backs) = (0, 0);
        for _ in 0..DIRECTIONS {
            let direction = cosine_direction(x.normal, rng);
            let hit = self.tree.closest(&Ray {
                origin: x.position,
                direction,
                t_max: f64::INFINITY,
                skip: [x.triangle; 2],
            });
            let is_back = hit
                .as_ref()
                .is_some_and(|h| self.normals[h.triangle].dot(direction) >= 0.0);
            backs += u32::from(is_back);
            far += u32::from(!is_back && hit.is_none_or(|h| h.t > beyond));
        }
        [far, backs]
    }

    fn estimate(&self, footprint: &Footprint, stream: u64, effort: Effort) -> Estimate {
        let mut rng = Random::new(effort.seed, stream);
        // Welford's running mean and squared deviations; luminance as a fourth channel.
        let (mut mean, mut square) = (DVec3::ZERO, DVec3::ZERO);
        let mut luminance_square = 0.0;
        for k in 1..=effort.paths {
            let start = self.start(footprint, &mut rng);
            let value = self.path(start, &mut rng, effort);
            let before = value - mean;
            mean += before / f64::from(k);
            let after = value - mean;
            square += before * after;
            luminance_square += luminance(before) * luminance(after);
        }
        let n = f64::from(effort.paths);
        let error = |s: f64| (s / (n * (n - 1.0))).sqrt();
        Estimate {
            mean,
            error: DVec3::from_array(square.to_array().map(error)),
            luminance_error: error(luminance_square),
        }
    }

    /// A random point of a footprint.
    fn start(&self, footprint: &Footprint, rng: &mut Random) -> Vertex {
        let (triangle, position) =
            footprint.point(&self.scene, rng.next(), [rng.next(), rng.next()]);
        Vertex {
            position,
            normal: self.normals[triangle],
            triangle,
        }
    }

    /// One sample of the irradiance at `start`.
    ///
    /// E(x) = Σ lights + ∫ L_e cosθ dω + ∫ (ρ/π)·E(y) cosθ dω over the points y that x sees. A
    /// direction drawn with density cosθ/π turns the last term into ρ·E(y), i.e. into a recursion.
    fn path(&self, start: Vertex, rng: &mut Random, effort: Effort) -> DVec3 {
        let mut sum = DVec3::ZERO;
        // Weight of E at `x` in E at the start.
        let mut weight = DVec3::ONE;
        let mut x = start;
        let mut bounces = 0;
        loop {
            sum += weight * self.punctual(&x, rng);
            if effort.emitters != EmitterSampling::Hits {
                sum += weight * self.emitter_point(&x, rng, effort.emitters);
            }
            let direction = cosine_direction(x.normal, rng);
            let ray = Ray {
                origin: x.position,
                direction,
                t_max: f64::INFINITY,
                skip: [x.triangle; 2],
            };
            let Some(hit) = self.tree.closest(&ray) else {
                return sum + weight * self.scene.sky * PI;
            };
            if self.is_black(&hit, direction) {
                return sum;
            }
            let surface = self.scene.surfaces[self.scene.triangles[hit.triangle].surface];
            let facing = -self.normals[hit.triangle].dot(direction);
            let share = match effort.emitters {
                EmitterSampling::Hits => 1.0,
                EmitterSampling::Points => 0.0,
                EmitterSampling::Both => {
                    let by_direction = x.normal.dot(direction) / PI;
                    // Area to solid angle: dω = dA·cosθ'/r².
                    let by_point = self.density[hit.triangle] * hit.t * hit.t / facing.abs();
                    by_direction / (by_direction + by_point)
                }
            };
            sum += weight * surface.emission * (PI * share);
            if effort.bounces.is_some_and(|most| bounces >= most) {
                return sum;
            }
            bounces += 1;
            // Roulette by what the surface absorbs, from the first bounce.
            let survival = surface.reflectance.max_element().min(MOST_SURVIVAL);
            if rng.next() >= survival {
                return sum;
            }
            weight *= surface.reflectance / survival;
            x = Vertex {
                position: x.position + direction * hit.t,
                normal: self.normals[hit.triangle] * facing.signum(),
                triangle: hit.triangle,
            };
        }
    }

    /// Whether a hit shows the back of a single-sided face.
    fn is_black(&self, hit: &Hit, direction: DVec3) -> bool {
        let surface = self.scene.surfaces[self.scene.triangles[hit.triangle].surface];
        self.normals[hit.triangle].dot(direction) >= 0.0 && !surface.double_sided
    }

    /// Irradiance at `x` from every punctual light.
    fn punctual(&self, x: &Vertex, rng: &mut Random) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for light in &self.scene.lights {
            let (direction, t_max, arriving) = match *light {
                Light::Directional {
                    direction,
                    irradiance,
                    radius,
                } => {
                    let towards = direction_around(-direction, radius.sin(), rng);
                    let facing = towards.dot(-direction);
                    (towards, f64::INFINITY, irradiance / facing)
                }
                Light::Point {
                    position,
                    intensity,
                } => {
                    let d = position - x.position;
                    (d.normalize(), d.length(), intensity / d.length_squared())
                }
                Light::Spot {
                    position,
                    direction,
                    intensity,
                    inner,
                    outer,
                } => {
                    let d = position - x.position;
                    let cosine = -direction.dot(d.normalize());
                    let ramp =
                        ((cosine - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
                    (
                        d.normalize(),
                        d.length(),
                        intensity * (ramp * ramp / d.length_squared()),
                    )
                }
            };
            let cosine = x.normal.dot(direction);
            if cosine > 0.0 && arriving != DVec3::ZERO {
                let ray = Ray {
                    origin: x.position,
                    direction,
                    t_max,
                    skip: [x.triangle; 2],
                };
                if !self.tree.blocked(&ray) {
                    sum += arriving * cosine;
                }
            }
        }
        sum
    }

    /// A sample of the irradiance at `x` from emissive triangles, by a point on one of them.
    fn emitter_point(&self, x: &Vertex, rng: &mut Random, sampling: EmitterSampling) -> DVec3 {
        let Some(&(last, _)) = self.emitters.last() else {
            return DVec3::ZERO;
        };
        let pick = rng.next();
        let at = self.emitters.partition_point(|e| e.1 <= pick);
        let index = self.emitters.get(at).map_or(last, |e| e.0);
        let triangle = &self.scene.triangles[index];
        // Uniform on the triangle: fold the unit square along its diagonal.
        let (mut u, mut v) = (rng.next(), rng.next());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        if index == x.triangle {
            return DVec3::ZERO;
        }
        let d = triangle.at(u, v) - x.position;
        let distance = d.length();
        let direction = d / distance;
        let surface = self.scene.surfaces[triangle.surface];
        let cosine = x.normal.dot(direction);
        let mut facing = -self.normals[index].dot(direction);
        if surface.double_sided {
            facing = facing.abs();
        }
        // Not `<=`: a distance of 0 gives NaN, which must not count either.
        if !(cosine > 0.0 && facing > 0.0) {
            return DVec3::ZERO;
        }
        let ray = Ray {
            origin: x.position,
            direction,
            t_max: distance,
            skip: [x.triangle, index],
        };
        if self.tree.blocked(&ray) {
            return DVec3::ZERO;
        }
        let by_point = self.density[index] * distance * distance / facing;
        let by_direction = match sampling {
            EmitterSampling::Both => cosine / PI,
            EmitterSampling::Hits | EmitterSampling::Points => 0.0,
        };
        surface.emission * (cosine / (by_point + by_direction))
    }
}

/// `of` each footprint and its number, in their order.
fn each<T: Send>(footprints: &[Footprint], of: impl Fn(&Footprint, u64) -> T + Sync) -> Vec<T> {
    let all = footprints.par_iter().enumerate();
    all.map(|(i, footprint)| of(footprint, i as u64)).collect()
}

/// A unit vector with density cosθ/π about the unit `normal`: a uniform point of the unit disc,
/// raised to the sphere.
fn cosine_direction(normal: DVec3, rng: &mut Random) -> DVec3 {
    direction_around(normal, 1.0, rng)
}

/// A random direction in a cone around `axis` whose half angle has this sine, with a density in
/// proportion to the cosine.
fn direction_around(axis: DVec3, sine: f64, rng: &mut Random) -> DVec3 {
    let (r2, angle) = (rng.next() * sine * sine, TAU * rng.next());
    // Any vector that is not near the axis gives a frame.
    let other = if axis.x.abs() < 0.7 {
        DVec3::X
    } else {
        DVec3::Y
    };
    let tangent = axis.cross(other).normalize();
    let bitangent = axis.cross(tangent);
    let r = r2.sqrt();
    tangent * (r * angle.cos()) + bitangent * (r * angle.sin()) + axis * (1.0 - r2).sqrt()
}
