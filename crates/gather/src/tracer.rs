//! What one gathering ray finds: the way of light from a lumel to what shines on it.

use glam::Vec3;
use radiosity::{
    DirectLight, Incoming, LitElements, Look, Reflected, Solution, SurfacePoint, World,
    cosine_hemisphere, hash_u32, luminance, sample_2d,
};
use visibility::Hit;

/// After so many near bounces a path reads the solution: light that has gone to and fro in a gap
/// so often has lost what told its places apart.
const MOST_NEAR_BOUNCES: u32 = 4;

/// A hit is near within this share of a patch's size, by the bounces before it. What a path meets
/// after its first bounce is seen with the others' beside it; there the elements, a quarter of a
/// patch, are fine enough.
const NEAR: [f32; MOST_NEAR_BOUNCES as usize + 1] = [1.0, 0.5, 0.25, 0.25, 0.0];

/// Radiance under this share of the scene's mean is none.
const DIM: f32 = 1e-3;

/// A hit right above a point does not close it in if it brings this share of the scene's mean
/// radiance: the gap behind a tube of light is no dark one.
const SHADE: f32 = 0.1;

/// A scene with its solved light, ready for gathering rays.
pub(crate) struct Tracer<'w, 'a> {
    /// Scene.
    pub world: &'w World<'a>,
    /// Its solved light.
    pub solution: &'w Solution,
    /// Its direct light.
    pub direct: DirectLight<'w, 'a>,
    /// What direct light falls on, if that is sampled.
    pub lit: LitElements,
    /// Less radiance than this on the back of a double-sided face is none: the inside of something.
    dim: f32,
}

/// A gathering ray.
#[derive(Clone, Copy)]
pub(crate) struct Ray {
    /// Unit direction.
    pub toward: Vec3,
    /// Its number in the footprint's sequence, and the sequence's seed.
    pub sample: u32,
    pub seed: u32,
    /// What of a far hit's direct light lit elements bring; see [`radiosity::of_lit`].
    pub lit_share: f32,
    /// Hits nearer than so many patches' size are followed as paths.
    pub near: f32,
}

/// What a gathering ray found.
#[derive(Default)]
pub(crate) struct Found {
    pub radiance: Vec3,
    /// To the first surface; infinite where there is none, 0 where nothing can arrive.
    pub distance: f32,
    /// The first surface turns its back.
    pub back: bool,
    /// It is lit, and that is left out.
    pub left_out: bool,
}

impl<'w, 'a> Tracer<'w, 'a> {
    /// `lit` asks for shadow rays to what direct light falls on.
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

    /// Whether so much irradiance (luminance) is none.
    pub(crate) fn is_dark(&self, irradiance: f32) -> bool {
        irradiance <= std::f32::consts::PI * self.dim
    }

    /// Whether so much radiance (luminance) is none.
    pub(crate) fn is_dim(&self, radiance: f32) -> bool {
        radiance <= self.dim
    }

    /// Whether so much radiance (luminance) right above a point leaves it closed in.
    pub(crate) fn is_shade(&self, radiance: f32) -> bool {
        radiance <= SHADE / DIM * self.dim
    }

    /// What arrives at `p` along a ray; `None` from a black back face. Light is added to `groups`
    /// too, unless that is empty.
    ///
    /// What a ray hits far away is read from the solution. What it hits within an element's size
    /// is not: there one value stands for places that differ as much as those of the gather itself
    /// (the inside of a corner, the gap behind a picture). There the ray goes on as a path, with
    /// direct light by a shadow ray of its own (after Jensen, *Global illumination using photon
    /// maps*, 1996, who does so for near hits of his final gather).
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

    /// What of the light of a hit counts, after so many bounces: lit elements' is sampled besides
    /// from where rays are gathered, but not where light passes through them.
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

/// Adds radiance to its group's part and to the sum.
#[inline]
fn add(radiance: Vec3, group: usize, sum: &mut Vec3, groups: &mut [Vec3]) {
    *sum += radiance;
    if let Some(part) = groups.get_mut(group) {
        *part += radiance;
    }
}
