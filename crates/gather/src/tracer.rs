//! Traces one gathering ray: the path of light from a lumel back to its source.

use glam::Vec3;
use radiosity::{
    DirectLight, Incoming, LitElements, Look, Reflected, Solution, SurfacePoint, World,
    cosine_hemisphere, hash_u32, luminance, sample_2d,
};
use visibility::Hit;

use crate::sky::SkyRays;

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
    /// Index of the point that it starts from.
    pub point: u32,
    /// Unit direction.
    pub toward: Vec3,
    /// Its index in the footprint's sequence.
    pub sample: u32,
}

/// Parameters of all rays of a batch.
#[derive(Clone, Copy)]
pub(crate) struct Common<'o> {
    /// Seed of their random numbers.
    pub seed: u32,
    /// Fraction of a far hit's direct light that shadow rays to lit elements contribute; see
    /// [`radiosity::of_lit`].
    pub lit_share: f32,
    /// Hits within this many patch sizes continue as paths.
    pub near: f32,
    /// Number of light groups.
    pub groups: usize,
    /// Shadow rays to the sky, which take a share of what gathering rays find of it.
    pub sky: Option<SkyRays<'o>>,
}

/// A gathering ray on its way.
pub(crate) struct Path {
    /// Index of the ray in its batch.
    pub ray: u32,
    /// Its index in the footprint's sequence.
    sample: u32,
    /// Where the path is, and its unit direction.
    pub point: SurfacePoint,
    pub direction: Vec3,
    /// Fraction of the light found next that reaches the footprint.
    throughput: Vec3,
}

impl Path {
    /// Ray `i` of its batch, starting at `point`. `None` if it starts below the face: an interpolated
    /// normal's hemisphere extends there, but nothing arrives from there.
    pub(crate) fn start(i: usize, ray: &Ray, point: &SurfacePoint) -> Option<Path> {
        (point.geometric.dot(ray.toward) > 0.0).then_some(Path {
            ray: i as u32,
            sample: ray.sample,
            point: *point,
            direction: ray.toward,
            throughput: Vec3::ONE,
        })
    }

    /// Where it meets what it hits.
    fn at(&self, hit: &Hit) -> Vec3 {
        self.point.origin + self.direction * hit.t
    }

    /// Determines the random choices after this many bounces.
    fn random(&self, common: &Common, bounce: u32) -> u32 {
        hash_u32(common.seed ^ self.sample ^ (bounce << 24))
    }
}

/// What a gathering ray found.
#[derive(Clone, Copy, Default)]
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

    /// Mean irradiance of the scene (luminance).
    pub(crate) fn mean(&self) -> f32 {
        std::f32::consts::PI / DIM * self.dim
    }

    /// Whether this radiance (luminance) counts as none.
    pub(crate) fn is_dim(&self, radiance: f32) -> bool {
        radiance <= self.dim
    }

    /// Whether this radiance (luminance) right above a point marks it as hidden.
    pub(crate) fn is_shade(&self, radiance: f32) -> bool {
        radiance <= SHADE / DIM * self.dim
    }

    /// Shades the hit that a path found: adds the radiance to `found`, and returns the path if it
    /// continues. Light is also added to `groups`, unless that is empty.
    ///
    /// Far hits read the solution. Hits within an element's size do not: there a single value would
    /// represent places that differ as much as those of the gather itself (the inside of a corner,
    /// the gap behind a picture). Such a ray continues as a path, with its own shadow ray for
    /// direct light (after Jensen, *Global illumination using photon maps*, 1996, who treats near
    /// hits of his final gather like this).
    pub(crate) fn shade(
        &self,
        mut path: Path,
        (incoming, tint): (Incoming, Vec3),
        bounce: u32,
        common: &Common,
        found: &mut Option<Found>,
        groups: &mut [Vec3],
    ) -> Option<Path> {
        let world = self.world;
        path.throughput *= tint;
        let hit = match incoming {
            Incoming::Black if bounce == 0 => {
                *found = None;
                return None;
            }
            Incoming::Black => return None,
            Incoming::Escaped => {
                let out = found.as_mut()?;
                if bounce == 0 {
                    out.distance = f32::INFINITY;
                }
                let mut sky = path.throughput * world.sky.radiance(path.direction);
                if let Some(rays) = common.sky.as_ref().filter(|_| bounce == 0) {
                    sky *= rays.kept(path.direction, path.point.normal.dot(path.direction));
                }
                add(sky, world.sky_group(), &mut out.radiance, groups);
                return None;
            }
            Incoming::Surface(hit) => hit,
        };
        let out = found.as_mut()?;
        if bounce == 0 {
            (out.distance, out.back) = (hit.t, hit.back);
        }
        let edge = self.solution.cut.patch_edge(hit.triangle);
        let is_far = hit.t > common.near * NEAR[bounce as usize] * edge;
        if bounce == MOST_NEAR_BOUNCES || is_far {
            self.read(&path, hit, bounce, common, out, groups);
            return None;
        }
        self.reflect(path, hit, bounce, common, out, groups)
    }

    /// Adds what the solution knows about a far hit.
    fn read(
        &self,
        path: &Path,
        hit: Hit,
        bounce: u32,
        common: &Common,
        out: &mut Found,
        groups: &mut [Vec3],
    ) {
        let world = self.world;
        let look = Look {
            hit,
            at: path.at(&hit),
            seed: path.random(common, bounce),
            of: self.counted(common.lit_share, &hit, bounce),
        };
        let boost = boost(world, bounce);
        let throughput = path.throughput * boost;
        let sent =
            (self.solution).radiance_by_group(world, &self.direct, &look, throughput, groups);
        out.radiance += sent.light;
        out.left_out = sent.left_out;
        if boost != 1.0 {
            // What the surface emits is not reflected.
            let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
            let excess = path.throughput * glow * (1.0 - boost);
            let group = world.emission_group(hit.triangle);
            add(excess, group, &mut out.radiance, groups);
        }
    }

    /// Adds a near hit's emission and reflected direct light, and returns the path that goes on.
    fn reflect(
        &self,
        mut path: Path,
        hit: Hit,
        bounce: u32,
        common: &Common,
        out: &mut Found,
        groups: &mut [Vec3],
    ) -> Option<Path> {
        let (world, cut) = (self.world, &self.solution.cut);
        let (at, random) = (path.at(&hit), path.random(common, bounce));
        path.point = world.surface_point(hit.triangle, hit.u, hit.v, hit.back, false);
        let glow = world.gathered_emission(hit.triangle, hit.u, hit.v);
        if glow != Vec3::ZERO {
            let group = world.emission_group(hit.triangle);
            add(path.throughput * glow, group, &mut out.radiance, groups);
        }
        path.throughput *= world.reflectance(hit.triangle, hit.u, hit.v) * boost(world, bounce);
        let (direct, group) = match cut.locate(hit.triangle, at, hit.back) {
            Some(place) => (self.direct).sample_on(cut, place.patch, &path.point, random),
            None => self.direct.sample_one(&path.point, random),
        };
        let reflected = path.throughput * direct * std::f32::consts::FRAC_1_PI;
        add(reflected, group, &mut out.radiance, groups);
        let [u, v] = sample_2d(path.sample, 40 + bounce, common.seed);
        path.direction = cosine_hemisphere(path.point.normal, u, v);
        (path.point.geometric.dot(path.direction) > 0.0).then_some(path)
    }

    /// The part of a hit's light that counts after this many bounces. Light of lit elements is
    /// sampled separately from points that gather, but not where light passes through the elements.
    #[inline]
    fn counted(&self, lit_share: f32, hit: &Hit, bounce: u32) -> Reflected {
        let edge = self.solution.cut.patch_edge(hit.triangle);
        match hit.t > LitElements::FROM * edge {
            true if bounce == 0 && !self.world.lets_light_through(hit.triangle) => {
                Reflected::Afar(lit_share)
            }
            true => Reflected::Afar(0.0),
            false => Reflected::All,
        }
    }
}

/// Factor on the light that a path's hit reflects. Only the first hit applies it, so that it counts
/// once.
#[inline]
fn boost(world: &World, bounce: u32) -> f32 {
    if bounce == 0 {
        world.bounce.reflected
    } else {
        1.0
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
