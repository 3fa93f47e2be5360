//! The only loop over a footprint's points: gathering rays from each, as one batch, and shadow rays
//! to lit elements.

use glam::Vec3;
use radiosity::{SurfacePoint, cosine_hemisphere, sample_4d};

use crate::batch::Traced;
use crate::estimate::{Point, ROOM};
use crate::gatherer::Gatherer;
use crate::lit::LitRays;
use crate::planes::PlaneSums;
use crate::points::Sampling;
use crate::sky::SkyRays;
use crate::tracer::{Common, Found, Ray};

/// A ray that hits something closer than this many footprints is in a gap that is not visible from
/// outside, e.g. under a crate that hovers by a millimetre.
const TOUCHING: f32 = 0.2;

/// Result of sampling a footprint's points.
pub(crate) struct Sampled {
    /// Sums by point.
    pub sums: Vec<Point>,
    /// Gathering and shadow rays.
    pub rays: u64,
}

impl Gatherer<'_, '_> {
    /// Gathers at points of a footprint. `taken` receives each point's index, sums, and sums for
    /// planes, and resets the latter.
    pub(crate) fn sample(
        &self,
        points: &[SurfacePoint],
        sampling: Sampling,
        mut taken: impl FnMut(usize, &Point, &mut PlaneSums),
    ) -> Sampled {
        let lit = LitRays::new(self, points, &sampling);
        let sky = SkyRays::new(self.tracer.solution, points, &sampling);
        let rays = generate(points, &sampling);
        let common = Common {
            seed: sampling.seed,
            lit_share: lit.share,
            near: self.options.near,
            groups: self.wanted.groups,
            sky,
        };
        let traced = self.tracer.trace(points, &rays, common);
        let mut planes = PlaneSums::new(self.wanted);
        planes.batch = rays.len() as u32;
        let mut cast = rays.len() as u64;
        let each = sampling.rays as usize;
        let sums = (points.iter().enumerate())
            .map(|(k, point)| {
                planes.first_half = 2 * k < points.len();
                let mut sum = Point::new(sampling.reach);
                for (i, ray) in rays.iter().enumerate().skip(k * each).take(each) {
                    self.add(point, ray.toward, (&traced, i), &mut sum, &mut planes);
                }
                let number = sampling.before + k as u32;
                if !planes.is_empty() && (lit.share > 0.0 || sky.is_some()) {
                    planes.add_point();
                }
                cast += u64::from(lit.reach(point, number, &mut sum, &mut planes));
                if let Some(sky) = &sky {
                    cast +=
                        u64::from(sky.reach(self.world(), point, number, &mut sum, &mut planes));
                }
                taken(k, &sum, &mut planes);
                sum
            })
            .collect();
        Sampled { sums, rays: cast }
    }

    /// Adds what ray `i` of a batch found to the sums of its point.
    fn add(
        &self,
        point: &SurfacePoint,
        toward: Vec3,
        (traced, i): (&Traced, usize),
        sum: &mut Point,
        planes: &mut PlaneSums,
    ) {
        sum.rays += 1;
        let found = traced.found[i];
        if point.geometric.dot(toward) > 0.0 {
            self.count(found, sum);
        }
        if !planes.is_empty() {
            let Found {
                radiance, distance, ..
            } = found.unwrap_or_default();
            planes.of_ray.copy_from_slice(traced.groups(i));
            planes.add(radiance, toward, point.normal, distance);
        }
    }

    /// Counts a ray's hit; a black backface contributes nothing.
    #[inline]
    fn count(&self, found: Option<Found>, out: &mut Point) {
        let Some(found) = found else {
            out.black += 1;
            out.backs += 1;
            out.void += 1;
            out.near = true;
            return;
        };
        let light = out.add(found.radiance);
        out.backs += u32::from(found.back);
        out.fronts += u32::from(!found.back && found.distance.is_finite());
        out.near |= found.distance < out.reach;
        out.far += u32::from(found.distance > ROOM * out.reach);
        let open_only = self.options.open_only;
        let unlit = open_only && found.back && self.tracer.is_dim(light) && !found.left_out;
        let touching =
            open_only && found.distance < TOUCHING * out.reach && self.tracer.is_shade(light);
        out.unlit += u32::from(touching || unlit);
        let lost = found.distance == f32::INFINITY && found.radiance == Vec3::ZERO;
        out.void += u32::from(unlit || lost);
    }
}

/// The gathering rays of some points of a footprint, point by point.
fn generate(points: &[SurfacePoint], sampling: &Sampling) -> Vec<Ray> {
    (points.iter().enumerate())
        .flat_map(|(k, point)| {
            let first = (sampling.before + k as u32) * sampling.rays;
            (first..first + sampling.rays).map(move |sample| {
                let s = sample_4d(sample, 0, sampling.seed);
                Ray {
                    point: k as u32,
                    toward: cosine_hemisphere(point.normal, s[0], s[1]),
                    sample,
                }
            })
        })
        .collect()
}
