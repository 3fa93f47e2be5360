//! Shadow rays to the sky where few gathering rays find it.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use radiosity::{Incoming, Opening, Solution, SurfacePoint, World, sample_4d};

use crate::estimate::Point;
use crate::planes::PlaneSums;
use crate::points::Sampling;

/// Index of the set of random numbers for drawing directions.
const SET: u32 = 59;

/// With fewer gathering rays a point, only every second point casts a shadow ray to the sky.
const FEW: u32 = 4;

/// Shadow rays to the sky from the points of a footprint.
#[derive(Clone, Copy)]
pub(crate) struct SkyRays<'o> {
    opening: Opening<'o>,
    /// Gathering rays of each point.
    rays: f32,
    /// Shadow rays of each point: 1, or ½ if there are few gathering rays.
    own: f32,
    seed: u32,
}

impl<'o> SkyRays<'o> {
    /// `None` where gathering rays find the sky often, or never.
    pub(crate) fn new(
        solution: &'o Solution,
        points: &[SurfacePoint],
        sampling: &Sampling,
    ) -> Option<Self> {
        let (triangle, back) = sampling.side?;
        let at = solution.cut.locate(triangle, points[0].position, back)?;
        Some(SkyRays {
            opening: solution.openings.of(at.patch)?,
            rays: sampling.rays as f32,
            own: if sampling.rays < FEW { 0.5 } else { 1.0 },
            seed: sampling.seed,
        })
    }

    /// Density of a point's gathering rays per solid angle: their number times cos/π.
    fn gathering(&self, cos: f32) -> f32 {
        self.rays * cos * FRAC_1_PI
    }

    /// Density of a point's gathering and shadow rays.
    fn all(&self, cos: f32, density: f32) -> f32 {
        self.gathering(cos) + density * self.own
    }

    /// Share of the sky that a gathering ray finds and that counts.
    pub(crate) fn kept(&self, direction: Vec3, cos: f32) -> f32 {
        let all = self.all(cos, self.opening.density(direction));
        self.gathering(cos) / all.max(f32::MIN_POSITIVE)
    }

    /// Adds the sky's light that a shadow ray of point `k` finds; returns the number of rays.
    pub(crate) fn reach(
        &self,
        world: &World,
        p: &SurfacePoint,
        k: u32,
        sum: &mut Point,
        planes: &mut PlaneSums,
    ) -> u32 {
        // Even and odd points lie in two halves of the footprint; those with an even number of bits
        // are spread over all of it.
        let number = match self.own < 1.0 {
            true if k.count_ones() % 2 == 1 => return 0,
            true => k / 2,
            false => k,
        };
        let s = sample_4d(number, SET, self.seed);
        let (direction, density) = self.opening.draw(s[0], s[1]);
        let cos = p.normal.dot(direction);
        if cos <= 0.0 || p.geometric.dot(direction) <= 0.0 {
            return 0;
        }
        if let (Incoming::Escaped, tint) = world.incoming(p.origin, direction) {
            let light = world.sky.radiance(direction) * tint * (cos / self.all(cos, density));
            sum.from_lit += light;
            if !planes.is_empty() {
                if let Some(part) = planes.of_ray.get_mut(world.sky_group()) {
                    *part += light;
                }
                planes.add_lit(light, direction, cos);
            }
        }
        1
    }
}
