//! Traces one gathering ray: the path of light from a lumel back to its source.

use glam::Vec3;
use radiosity::{
    DirectLight, Incoming, LitElements, Look, Reflected, Solution, SurfacePoint, World,
    cosine_hemisphere, hash_u32, luminance, sample_2d,
};
use visibility::Hit;

/// After this many near bounces a path reads the solution: light that was reflected so often in a
/// gap no longer varies from place to place.
const MOST_NEAR_BOUNCES: u32 = 4;

/// A hit is near within this fraction of a patch's size, by the number of previous bounces. Later
/// hits are averaged with those of other paths, so the elements, a quarter of a patch, are fine
/// enough.
const NEAR: [f32; MOST_NEAR_BOUNCES as usize + 1] = [1.0, 0.5, 0.25, 0.25, 0.0];

/// Radiance below this fraction of the scene's mean counts as none.
const DIM: f32 = 1e-3;

/// A hit right above a point does not mark it as hidden if it contributes more than this fraction
/// of the scene's mean radiance: the gap behind a fluorescent tube is not dark.
const SHADE: f32 = 0.1;

/// A scene with its solution, prepared for gathering rays.
pub(crate) struct Tracer<'w, 'a> {
    /// Scene.
    pub world: &'w World<'a>,
    /// Its solution.
    pub solution: &'w Solution,
    /// Its direct light.
    pub direct: DirectLight<'w, 'a>,
    /// The elements lit by direct light, if they are sampled.
    pub lit: LitElements,
    /// Radiance below this on the back of a double-sided face counts as none, i.e. as the inside of
    /// something.
    dim: f32,
}

/// A gathering ray.
#[derive(Clone, Copy)]
pub(crate) struct Ray {
    /// Unit direction.
    pub toward: Vec3,
    /// Its index in the footprint's sequence, and the sequence's seed.
    pub sample: u32,
    pub seed: u32,
    /// Fraction of a far hit's direct light that shadow rays to lit elements contribute; see
    /// [`radiosity::of_lit`].
    pub lit_share: f32,
    /// Hits within this many patch sizes continue as paths.
    pub near: f32,
}

/// Result of a gathering ray.
#[derive(Default)]
pub(crate) struct Found {
    pub radiance: Vec3,
    /// Distance to the first surface; infinite if there is none, 0 if nothing can arrive.
    pub distance: f32,
    /// Whether the first surface is seen from its back.
    pub back: bool,
    /// Whether the surface is lit, and its light left out because it is sampled separately.
    pub left_out: bool,
}

impl<'w, 'a> Tracer<'w, 'a> {
    /// `lit` enables shadow rays to elements lit by direct light.
    pub(crate) fn new(
        world: &'w World<'a>,
        solution: &'w Solution,
        direct: DirectLight<'w, 'a>,
        lit: bool,
    ) -> Self {
        let mean = luminance(solution.mean_irradiance().as_vec3());
        let lit = match lit {
            false => LitElements::default(),
            true => LitElements::collect(world, solution),
        };
        Tracer {
            world,
            solution,
            direct: direct.on_patches(&solution.cut),
            lit,
            dim: DIM * mean * std::f32::consts::FRAC_1_PI,
        }
    }

    /// Whether this irradiance (luminance) counts as none.
    pub(crate) fn is_dark(&self, irradiance: f32) -> bool {
        irradiance <= std::f32::consts::PI * self.dim
    }

    /// Whether this radiance (luminance) counts as none.
    pub(crate) fn is_dim(&self, radiance: f32) -> bool {
        radiance <= self.dim
    }

    /// Whether this radiance (luminance) right above a point marks it as hidden.
    pub(crate) fn is_shade(&self, radiance: f32) -> bool {
        radiance <= SHADE / DIM * self.dim
    }

    /// Radiance that arrives at `p` along a ray; `None` from a black backface. Light is also added
    /// to `groups`, unless that is empty.
    ///
    /// Far hits read the solution. Hits within an element's size do not: there a single value would
    /// represent places that differ as much as those of the gather itself (the inside of a corner,
    /// the gap behind a picture). Such a ray continues as a path, with its own shadow ray for
    /// direct light (after Jensen, *Global illumination using photon maps*, 1996, who treats near
    /// hits of his final gather like this).
    pub(crate) fn arriving(
        &self,
        p: &SurfacePoint,
        ray: Ray,
        groups: &mut [Vec3],
    ) -> Option<Found> {
        let (world, solution) = (self.world, self.solution);
        let cut = &solution.cut;
        let (mut point, mut direction) = (*p, ray.toward);
        let mut throughput = Vec3::ONE;
        let mut out = Found {
            distance: f32::INFINITY,
            ..Found::default()
        };
        for bounce in 0.. {
            let (found, tint) = world.incoming(point.origin, direction);
            throughput *= tint;
            let hit = match found {
                Incoming::Escaped => {
                    let sky = throughput * world.sky.radiance(direction);
                    add(sky, world.sky_group(), &mut out.radiance, groups);
                    break;
                }
                Incoming::Black if bounce == 0 => return None,
                Incoming::Black => break,
                Incoming::Surface(hit) => hit,
            };
            if bounce == 0 {
                (out.distance, out.back) = (hit.t, hit.back);
            }
            let at = point.origin + direction * hit.t;
            let random = hash_u32(ray.seed ^ ray.sample ^ (bounce << 24));
            let edge = cut.patch_edge(hit.triangle);
            if bounce == MOST_NEAR_BOUNCES || hit.t > ray.near * NEAR[bounce as usize] * edge {
                let look = Look {
                    hit,
                    at,
                    seed: random,
                    of: self.counted(&ray, &hit, bounce, edge),
                };
                let sent =
                    solution.radiance_by_group(world, &self.direct, &look, throughput, groups);
                out.radiance += sent.light;
                out.left_out = sent.left_out;
                break;
            }
            point = world.surface_point(hit.triangle, hit.u, hit.v, hit.back, false);
            let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
            if glow != Vec3::ZERO {
                let group = world.emission_group(hit.triangle);
                add(throughput * glow, group, &mut out.radiance, groups);
            }
            throughput *= world.reflectance(hit.triangle, hit.u, hit.v);
            let (direct, group) = match cut.locate(hit.triangle, at, hit.back) {
                Some(place) => self.direct.sample_on(cut, place.patch, &point, random),
                None => self.direct.sample_one(&point, random),
            };
            let reflected = throughput * direct * std::f32::consts::FRAC_1_PI;
            add(reflected, group, &mut out.radiance, groups);
            let [u, v] = sample_2d(ray.sample, 40 + bounce, ray.seed);
            direction = cosine_hemisphere(point.normal, u, v);
            if point.geometric.dot(direction) <= 0.0 {
                break;
            }
        }
        Some(out)
    }

    /// The part of a hit's light that counts after this many bounces. Light of lit elements is
    /// sampled separately from points that gather, but not where light passes through the elements.
    #[inline]
    fn counted(&self, ray: &Ray, hit: &Hit, bounce: u32, edge: f32) -> Reflected {
        match hit.t > LitElements::FROM * edge {
            true if bounce == 0 && !self.world.lets_light_through(hit.triangle) => {
                Reflected::Afar(ray.lit_share)
            }
            true => Reflected::Afar(0.0),
            false => Reflected::All,
        }
    }
}

/// Adds radiance to its group and to the sum.
#[inline]
fn add(radiance: Vec3, group: usize, sum: &mut Vec3, groups: &mut [Vec3]) {
    *sum += radiance;
    if let Some(part) = groups.get_mut(group) {
        *part += radiance;
    }
}
