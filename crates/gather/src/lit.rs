//! Shadow rays to surface elements lit by lamps and suns.

use glam::Vec3;
use radiosity::{LitCut, SurfacePoint, of_lit, sample_4d};

use crate::estimate::Point;
use crate::gatherer::Gatherer;
use crate::planes::PlaneSums;
use crate::points::Sampling;

/// Index of the set of random numbers for drawing elements.
const SET: u32 = 60;

/// Shadow rays from the points of a footprint to lit elements.
pub(crate) struct LitRays<'g, 'w, 'a> {
    gatherer: &'g Gatherer<'w, 'a>,
    /// The lit elements as seen from the footprint.
    cut: LitCut,
    /// Fraction that gathering rays leave out, for [`of_lit`]; with 0 no shadow rays are cast.
    pub share: f32,
    seed: u32,
}

impl<'g, 'w, 'a> LitRays<'g, 'w, 'a> {
    pub(crate) fn new(
        gatherer: &'g Gatherer<'w, 'a>,
        points: &[SurfacePoint],
        sampling: &Sampling,
    ) -> Self {
        let lit = &gatherer.tracer.lit;
        let mut out = LitRays {
            gatherer,
            cut: LitCut::default(),
            share: 0.0,
            seed: sampling.seed,
        };
        if !lit.is_empty() {
            let middle = &points[0];
            let bend = (points.iter())
                .map(|p| p.normal.distance_squared(middle.normal))
                .fold(0.0, f32::max);
            out.cut = lit.cut(middle, sampling.reach, bend.sqrt());
            let per_ray = gatherer.options.lit as f32 / sampling.rays as f32;
            out.share = lit.share(&out.cut, per_ray);
        }
        out
    }

    /// Adds the light from lit elements to point `k` of the footprint; returns the number of shadow
    /// rays.
    pub(crate) fn reach(
        &self,
        p: &SurfacePoint,
        k: u32,
        sum: &mut Point,
        planes: &mut PlaneSums,
    ) -> u32 {
        if self.share == 0.0 {
            return 0;
        }
        let (tracer, each) = (&self.gatherer.tracer, self.gatherer.options.lit);
        let lit = &tracer.lit;
        let mut rays = 0;
        for i in k * each..(k + 1) * each {
            let drawn = lit.draw(&self.cut, sample_4d(i, SET, self.seed)[0]);
            let Some((drawn, from)) = drawn.and_then(|d| Some((d, lit.arriving(d, p)?))) else {
                continue;
            };
            rays += 1;
            let passed = tracer.world.transmitted(p.origin, from.to, 1.0);
            if passed == Vec3::ZERO {
                continue;
            }
            let boost = tracer.world.bounce.reflected;
            let passed = passed * (boost * of_lit(self.share, from.arrives) / each as f32);
            let light = from.light * passed;
            sum.from_lit += light;
            if planes.is_empty() {
                continue;
            }
            match (&tracer.solution.groups, &mut planes.of_ray[..]) {
                (_, []) => {}
                (Some(groups), parts) => {
                    let element = lit.element(drawn) as usize;
                    let own = &groups.direct[element * groups.count..];
                    let reflects = tracer.solution.intensity_of_irradiance(element) * from.kernel;
                    for (part, direct) in parts.iter_mut().zip(own) {
                        *part += *direct * reflects * passed;
                    }
                }
                (None, parts) => parts[0] += light,
            }
            planes.add_lit(light, from.direction, from.cos);
        }
        rays
    }
}
