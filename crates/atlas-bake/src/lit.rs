//! Shadow rays to what lamps and suns shine on.

use glam::Vec3;
use radiosity::{LitCut, SurfacePoint, of_lit, sample_4d};

use crate::estimate::Point;
use crate::gather::Gatherer;
use crate::planes::PlaneSums;
use crate::recall::{RayTape, Tape, Topic, read_answer, write_answer};

/// The set of random numbers that elements are drawn by.
const SET: u32 = 60;

/// Shadow rays from the points of a footprint to lit elements.
pub(crate) struct LitRays<'g, 'b, 'w, 'a> {
    gatherer: &'g Gatherer<'w, 'a>,
    /// Under what its records are kept.
    key: u32,
    /// What the footprint sees, once it was asked for, and the footprint's size.
    cut: LitCut,
    scale: f32,
    share: f32,
    records: RayTape<'b>,
    rays: u64,
    taken: u64,
    cast: u64,
}

impl<'g, 'b, 'w, 'a> LitRays<'g, 'b, 'w, 'a> {
    /// None are cast yet; those of one `key` are recorded together.
    pub(crate) fn new(
        gatherer: &'g Gatherer<'w, 'a>,
        scale: f32,
        key: u32,
        tape: &Tape<'b>,
    ) -> Self {
        LitRays {
            gatherer,
            key,
            cut: LitCut::default(),
            scale,
            share: 0.0,
            records: match gatherer.lit.is_empty() {
                true => RayTape::Off,
                false => tape.rays(Topic::Lit, key),
            },
            rays: 0,
            taken: 0,
            cast: 0,
        }
    }

    /// What gathering rays leave out, `rays` of which each of the points has: for [`of_lit`].
    pub(crate) fn share<'p>(&mut self, points: impl Fn() -> &'p [SurfacePoint], rays: u32) -> f32 {
        let Gatherer { lit, options, .. } = self.gatherer;
        if !lit.is_empty() {
            let points = points();
            let middle = &points[0];
            let bend = (points.iter())
                .map(|p| p.normal.distance_squared(middle.normal))
                .fold(0.0, f32::max);
            self.cut = lit.cut(middle, self.scale, bend.sqrt());
            self.share = lit.share(&self.cut, options.lit as f32 / rays as f32);
        }
        self.share
    }

    /// Adds what lit elements bring to a point, number `k` of its footprint.
    pub(crate) fn reach<'p>(
        &mut self,
        point: impl Fn() -> &'p SurfacePoint,
        (k, seed): (u32, u32),
        sum: &mut Point,
        planes: &mut PlaneSums,
    ) {
        let Gatherer {
            lit,
            solution,
            world,
            options,
            ..
        } = self.gatherer;
        if self.share == 0.0 {
            return;
        }
        if !planes.is_empty() {
            planes.add_point();
        }
        let p = point();
        let share = 1.0 / options.lit as f32;
        for i in k * options.lit..(k + 1) * options.lit {
            let noted = match &mut self.records {
                RayTape::Read(bytes) => read_answer(bytes),
                _ => None,
            };
            let drawn = lit.draw(&self.cut, sample_4d(i, SET, seed)[0]);
            let drawn = drawn.and_then(|d| Some((lit.element(d), lit.arriving(d, p)?)));
            let Some((element, from)) = drawn else {
                if let RayTape::Write(bytes) = &mut self.records {
                    write_answer(None, bytes);
                }
                continue;
            };
            self.rays += 1;
            let passed = match noted {
                Some((known, passed)) if known == element => {
                    self.taken += 1;
                    passed
                }
                _ => {
                    self.cast += 1;
                    world.transmitted(p.origin, from.to, 1.0)
                }
            };
            if let RayTape::Write(bytes) = &mut self.records {
                write_answer(Some((element, passed)), bytes);
            }
            if passed == Vec3::ZERO {
                continue;
            }
            let passed = passed * (share * of_lit(self.share, from.arrives));
            let light = from.light * passed;
            sum.from_lit += light;
            if planes.is_empty() {
                continue;
            }
            match (&solution.groups, &mut planes.of_ray[..]) {
                (_, []) => {}
                (Some(groups), parts) => {
                    let own = &groups.direct[element as usize * groups.count..];
                    let reflects = solution.intensity_of_irradiance(element as usize) * from.kernel;
                    for (part, direct) in parts.iter_mut().zip(own) {
                        *part += *direct * reflects * passed;
                    }
                }
                (None, parts) => parts[0] += light,
            }
            planes.add_lit(light, from.direction, from.cos);
        }
    }

    /// Keeps the records, and says how many rays there were.
    pub(crate) fn keep(self, tape: &mut Tape) -> u64 {
        if matches!(self.records, RayTape::Read(_)) {
            tape.taken += self.taken;
            tape.cast += self.cast;
        }
        tape.keep_rays(Topic::Lit, self.key, self.records);
        self.rays
    }
}
