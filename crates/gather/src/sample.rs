//! The only loop over a footprint's points: gathering rays from each, and shadow rays to lit
//! elements.

use glam::Vec3;
use radiosity::{SurfacePoint, cosine_hemisphere, sample_4d};

use crate::estimate::Point;
use crate::gatherer::Gatherer;
use crate::lit::LitRays;
use crate::planes::PlaneSums;
use crate::points::Sampling;
use crate::tracer::{Found, Ray};

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
    /// Gathers at points of a footprint. `taken` receives each point's sums for planes, with the
    /// point's index, and resets them.
    pub(crate) fn sample(
        &self,
        points: &[SurfacePoint],
        sampling: Sampling,
        mut taken: impl FnMut(usize, &mut PlaneSums),
    ) -> Sampled {
        let lit = LitRays::new(self, points, &sampling);
        let mut planes = PlaneSums::new(self.wanted);
        let mut rays = u64::from(sampling.rays) * points.len() as u64;
        let sums = (points.iter().enumerate())
            .map(|(k, point)| {
                let number = sampling.before + k as u32;
                planes.first_half = 2 * k < points.len();
                let mut sum = Point::new(sampling.reach, lit.share);
                let samples = number * sampling.rays..(number + 1) * sampling.rays;
                self.indirect(point, samples, sampling.seed, &mut sum, &mut planes);
                rays += u64::from(lit.reach(point, number, &mut sum, &mut planes));
                taken(k, &mut planes);
                sum
            })
            .collect();
        Sampled { sums, rays }
    }

    /// Casts the gathering rays of `samples` from a point.
    pub(crate) fn indirect(
        &self,
        point: &SurfacePoint,
        samples: std::ops::Range<u32>,
        seed: u32,
        out: &mut Point,
        planes: &mut PlaneSums,
    ) {
        for sample in samples {
            out.rays += 1;
            let s = sample_4d(sample, 0, seed);
            let toward = cosine_hemisphere(point.normal, s[0], s[1]);
            // An interpolated normal's hemisphere extends below the face itself, from where nothing
            // arrives.
            let found = if point.geometric.dot(toward) <= 0.0 {
                Found::default()
            } else {
                let ray = Ray {
                    toward,
                    sample,
                    seed,
                    lit_share: out.share,
                    near: self.options.near,
                };
                let found = self.tracer.arriving(point, ray, &mut planes.of_ray);
                self.count(found, out)
            };
            if !planes.is_empty() {
                let cos = point.normal.dot(toward);
                planes.add(found.radiance, toward, cos, found.distance);
            }
        }
    }

    /// Counts a ray's hit; a black backface contributes nothing.
    #[inline]
    fn count(&self, found: Option<Found>, out: &mut Point) -> Found {
        let Some(found) = found else {
            out.black += 1;
            out.backs += 1;
            out.void += 1;
            out.near = true;
            return Found::default();
        };
        let light = out.add(found.radiance);
        out.backs += u32::from(found.back);
        out.near |= found.distance < out.reach;
        let open_only = self.options.open_only;
        let unlit = open_only && found.back && self.tracer.is_dim(light) && !found.left_out;
        let touching =
            open_only && found.distance < TOUCHING * out.reach && self.tracer.is_shade(light);
        out.unlit += u32::from(touching || unlit);
        let lost = found.distance == f32::INFINITY && found.radiance == Vec3::ZERO;
        out.void += u32::from(unlit || lost);
        found
    }
}
