//! Gathering rays taken from records: the light of paths that an earlier bake found.

use glam::Vec3;
use patch_subdivision::PatchId;
use radiosity::{Sky, SurfacePoint, World, cosine_hemisphere, hash_u32, sample_2d};
use visibility::Hit;

use crate::gather::{Found, Gatherer, MOST_NEAR_BOUNCES, Ray, add};
use crate::recall::{End, Head, Tape};

/// The way of a recorded path, found again hit by hit as far as it is needed.
pub(crate) struct Retrace<'g, 'a, S, D> {
    world: &'g World<'a>,
    start: S,
    toward: D,
    /// The ray's number and the footprint's seed.
    ray: (u32, u32),
    /// What it met.
    triangles: [u32; MOST_NEAR_BOUNCES as usize + 1],
    /// The hit that was found last, with its number.
    last: Option<(usize, Hit)>,
}

impl<'g, 'a, 'p, S: Fn() -> &'p SurfacePoint, D: Fn() -> Vec3> Retrace<'g, 'a, S, D> {
    pub(crate) fn new(world: &'g World<'a>, start: S, toward: D, ray: (u32, u32)) -> Self {
        Retrace {
            world,
            start,
            toward,
            ray,
            triangles: [0; MOST_NEAR_BOUNCES as usize + 1],
            last: None,
        }
    }

    /// The hit after `bounce` others, whose triangles are known; `None` where one is not where it was recorded.
    #[cold]
    fn hit(&mut self, bounce: usize) -> Option<Hit> {
        let (i, seed) = self.ray;
        let world = self.world;
        loop {
            let (next, origin, direction) = match self.last {
                None => (0, (self.start)().origin, (self.toward)()),
                Some((k, hit)) if k == bounce => return Some(hit),
                Some((k, hit)) => {
                    let p = world.surface_point(hit.triangle, hit.u, hit.v, hit.back, false);
                    let [u, v] = sample_2d(i, 40 + k as u32, seed);
                    (k + 1, p.origin, cosine_hemisphere(p.normal, u, v))
                }
            };
            let triangle = *self.triangles.get(next)?;
            self.last = Some((next, world.known_hit(origin, direction, triangle)?));
        }
    }
}

impl Gatherer<'_, '_> {
    /// What a ray finds that was recorded, by the light that there is now; `None` where it is to be cast anew. Takes its record off `bytes`.
    ///
    /// The same operations in the same order as in [`arriving`](Self::arriving). Where another light is to be sampled than was recorded, or one that
    /// has changed, the hit is found again by its triangle.
    #[inline]
    pub(crate) fn again<'p, S: Fn() -> &'p SurfacePoint, D: Fn() -> Vec3>(
        &self,
        bytes: &mut &[u8],
        (bounds, share): ([f32; 2], f32),
        mut places: Retrace<S, D>,
        groups: &mut [Vec3],
        tape: &mut Tape,
    ) -> Option<Ray> {
        let (solution, world) = (self.solution, self.world);
        let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        let (i, seed) = places.ray;
        let random = |bounce: usize| hash_u32(seed ^ i ^ (bounce as u32) << 24);
        let head = Head::read(bounds, bytes)?;
        let (mut lost, mut left_out) = (false, false);
        for bounce in 0..head.near {
            let hit = head.near_hit(bytes)?;
            places.triangles[bounce.min(4)] = hit.surface.triangle;
            let patch = PatchId(hit.patch);
            let random = random(bounce);
            let known = (self.direct).sample_on_again(&solution.cut, patch, random, &hit.drawn);
            let sampled = match known {
                Some(known) => Some(known),
                None => places.hit(bounce).map(|hit| {
                    tape.cast += 1;
                    let p = world.surface_point(hit.triangle, hit.u, hit.v, hit.back, false);
                    self.direct.sample_on(&solution.cut, patch, &p, random)
                }),
            };
            let Some((direct, group)) = sampled else {
                // The rest of the record is still to be taken.
                lost = true;
                continue;
            };
            let glow = hit.surface.glow;
            if glow.0 != Vec3::ZERO {
                add(throughput * glow.0, glow.1, &mut sum, groups);
            }
            throughput *= hit.surface.reflectance(world);
            let reflected = throughput * direct * std::f32::consts::FRAC_1_PI;
            add(reflected, group, &mut sum, groups);
        }
        let end = head.end(bytes)?;
        if lost {
            return None;
        }
        match end {
            End::Below => return Some(Ray::Below),
            End::Black => return Some(Ray::Black),
            End::Unknown => return None,
            End::Stopped => {}
            End::Escaped(direction) => {
                let radiance = match &world.sky {
                    Sky::Constant(radiance) => *radiance,
                    sky => sky.radiance(direction.unwrap_or_else(&places.toward)),
                };
                let sky = throughput * radiance;
                add(sky, world.sky_group(), &mut sum, groups);
            }
            End::Far(seen) => {
                let (lights, random) = (&self.direct, random(head.near));
                let anew = |patch| {
                    places.triangles[head.near.min(4)] = seen.surface.triangle;
                    let hit = places.hit(head.near)?;
                    tape.cast += 1;
                    let p = world.inset_point(hit.triangle, hit.u, hit.v, hit.back, false);
                    Some(lights.sample_on(&solution.cut, patch, &p, random))
                };
                let of = self.of_hit(seen.far, head.near as u32, seen.surface.triangle, share);
                let sent = solution
                    .radiance_again(world, lights, &seen, random, of, throughput, groups, anew)?;
                sum += sent.light;
                left_out = sent.left_out;
            }
        }
        Some(Ray::Found(Found {
            radiance: sum,
            distance: head.distance,
            back: head.back,
            left_out,
        }))
    }
}
