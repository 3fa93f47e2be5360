//! Final gather: the light that a footprint receives.

use radiosity::{DirectEstimate, Known, SurfacePoint, luminance};

use crate::between::{Between, DirectBetween};
use crate::calm::Calm;
use crate::estimate::{BEHIND, Estimate, Point, mean_and_spread};
use crate::footprint::Footprint;
use crate::gatherer::{Gatherer, known};
use crate::parts::{GAP, Parts};
use crate::planes::{Plane, PlaneSums};
use crate::points::{OpenPoints, Place, Sampling, spread};
use crate::received::Received;

/// Fewest points for detecting a wall that splits a footprint.
const PARTED_POINTS: usize = 16;

/// Under a cover, rays are fewer by this factor.
const UNDER_COVERS: u32 = 4;

/// Most [`GatherOptions::points`].
const MOST_POINTS: usize = 64;

/// A lamp that would contribute less than this fraction of a lumel's light needs no shadow ray if
/// all neighbours agree about it.
const MATTERS: f32 = 0.01;

/// What the first points of a footprint found.
struct First {
    points: Vec<SurfacePoint>,
    /// By point.
    sums: Vec<Point>,
    /// Whether a point is in a body or under a cover.
    buried: Vec<bool>,
    /// Whether its light counts.
    open: Vec<bool>,
    /// Number of points in the open. If it is 0, the light of all counts.
    in_the_open: usize,
    /// Whether there is something within the footprint's size.
    near: bool,
    estimate: Estimate,
    rays: u64,
}

impl Gatherer<'_, '_> {
    /// Mean irradiance over the footprint.
    ///
    /// At first a few points share many rays. If they disagree (some are inside a closed body, or
    /// see much more light than others), an edge crosses the footprint, and the mean is only as
    /// accurate as the fraction of points on either side. Such footprints are gathered again, with
    /// [`GatherOptions::edge_points`](crate::GatherOptions::edge_points) points of two rays each.
    ///
    /// Sample points count as inside if they are in a body, less than a twentieth of a lumel below
    /// something opaque, or if nearly all of their rays hit black backfaces; if only visible parts
    /// count, also unlit backs of double-sided faces. If the whole footprint is inside, the mean is
    /// over all of it, whatever [`GatherOptions::open_only`](crate::GatherOptions::open_only) says.
    pub fn gather(&self, footprint: &impl Footprint, seed: u32) -> Received {
        let (world, options) = (self.tracer.world, &self.options);
        // Openness is needed even without light.
        if world.is_dark() && self.wanted.openness.is_none() {
            return Received {
                open: 1.0,
                planes: vec![Plane::default(); self.wanted.planes()].into(),
                ..Received::default()
            };
        }
        let points = spread(footprint, self.points());
        let count = points.len();
        let gap = GAP * footprint.reach();
        let mut sampling = self.sampling(footprint, seed);
        if options.open_only
            && options.edge_points > 0
            && points.iter().all(|p| world.out_of_sight(p, gap))
            && !self.anything_open(footprint, seed)
        {
            if points.iter().all(|p| world.inside_a_body(p)) {
                return self.nothing_seen(footprint, &points);
            }
            // Hardly anybody looks under a cover.
            sampling.rays = (sampling.rays / UNDER_COVERS).max(1);
        }
        let mut planes = PlaneSums::new(self.wanted);
        let mut first = self.look(points, sampling, gap, &mut planes);
        if options.edge_points > 0 {
            if first.in_the_open == 0 {
                first.rays += u64::from(options.edge_points.saturating_sub(options.points));
            }
            if self.is_crossed(footprint, seed, &first) {
                let mut out = self.gather_edge(footprint, seed);
                out.rays += first.rays;
                if first.in_the_open < count {
                    // For the smoothing, which must not treat a lumel as whole because a sliver was
                    // missed.
                    out.open = out.open.min(1.0 - 1.0 / count as f32);
                }
                return out;
            }
        }
        self.settle(footprint, seed, first, planes)
    }

    /// Gathers at the first points of a footprint, and tells which of them are open.
    fn look(
        &self,
        points: Vec<SurfacePoint>,
        sampling: Sampling,
        gap: f32,
        planes: &mut PlaneSums,
    ) -> First {
        let world = self.tracer.world;
        let open_only = self.options.open_only;
        let sampled = self.sample(&points, sampling, |_, _, of_point| {
            planes.take(of_point);
        });
        let sums = sampled.sums;
        // Inside a wall or under a carpet, light is irrelevant, whatever the rays find.
        let buried: Vec<bool> = (points.iter().zip(&sums))
            .map(|(p, s)| open_only && s.may_be_buried() && world.out_of_sight(p, gap))
            .collect();
        // Together points know more than the few rays of each.
        let inside = Point::inside_together(sums.iter());
        let mut open: Vec<bool> = (sums.iter().zip(&buried))
            .map(|(s, buried)| !(inside || *buried || s.inside()))
            .collect();
        let in_the_open = open.iter().filter(|&&o| o).count();
        if in_the_open == 0 || !open_only {
            open.fill(true);
        }
        First {
            near: sums.iter().any(|s| s.near),
            estimate: mean_and_spread(&sums, &open),
            rays: sampled.rays,
            points,
            sums,
            buried,
            open,
            in_the_open,
        }
    }

    /// Adds direct light to what the first points of a footprint found.
    fn settle(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        first: First,
        planes: PlaneSums,
    ) -> Received {
        let (points, sums, estimate) = (&first.points, &first.sums, &first.estimate);
        let mut planes = planes.finish();
        let counted = OpenPoints::new(footprint, points, &first.open);
        let known = known(luminance(estimate.mean), 0);
        let direct = self.direct_light(counted, seed, &self.options.direct, &known, &mut planes);
        let dark = (self.tracer).is_dark(luminance(direct.irradiance + estimate.mean));
        // Applies to ends of objects that extend through a room's shell, but also to surfaces in
        // the shade of a lamp in an otherwise empty scene. Only a wall between the lumel and its
        // neighbours distinguishes them ([`fill_hidden`](crate::hidden::fill_hidden)).
        let void = self.options.open_only && dark && Point::in_the_void(sums.iter());
        // The light is that of the visible part; the position is that of the whole footprint.
        let place = (Place::of(points), footprint.size());
        let mut out = Received::of(direct, estimate, planes, place);
        out.rays += first.rays;
        out.near = first.near;
        out.void = void;
        out.around = Point::around(sums.iter());
        out.far = Point::far(sums.iter());
        out.behind = void && first.near || Point::dark_shares(sums.iter())[0] >= BEHIND;
        out.open = match first.in_the_open {
            0 if !first.buried.contains(&true) && !Point::shut(sums.iter(), dark) => 1.0,
            n => n as f32 / points.len() as f32,
        };
        out
    }

    /// A footprint in a body, where nobody sees it. Neighbours lend it their light.
    fn nothing_seen(&self, footprint: &impl Footprint, points: &[SurfacePoint]) -> Received {
        let place = Place::of(points);
        Received {
            position: place.position,
            normal: place.normal,
            size: footprint.size(),
            near: true,
            planes: vec![Plane::default(); self.wanted.planes()].into(),
            ..Received::default()
        }
    }

    /// Whether the first points of a footprint show that an edge crosses it.
    fn is_crossed(&self, footprint: &impl Footprint, seed: u32, first: &First) -> bool {
        let (options, count) = (&self.options, first.points.len());
        let more = options.contacts && options.edge_points > count as u32;
        if first.in_the_open == 0 {
            // A sliver of light next to a wall hardly matters on screen, but a lot for relative
            // errors.
            return self.anything_open(footprint, seed);
        }
        if first.in_the_open < count {
            return more || options.open_only;
        }
        // A few points may all be on the same side of a wall.
        let parted = || {
            let points = spread(footprint, count.max(PARTED_POINTS));
            Parts::find(self.tracer.world, &points, footprint.reach()).count > 1
        };
        (options.open_only && first.near && parted()) || (more && first.estimate.disagree)
    }

    /// Number of points of the first gather.
    fn points(&self) -> usize {
        (self.options.points as usize).clamp(1, MOST_POINTS)
    }

    /// Only direct light; the rest comes from neighbours. The footprint must be in the open, with
    /// nothing near.
    pub(crate) fn gather_direct(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        indirect: &Between,
    ) -> Received {
        let mut planes = vec![Plane::default(); self.wanted.planes()];
        for (plane, [all, first]) in planes.iter_mut().zip(&indirect.planes) {
            (plane.indirect, plane.first_half) = (*all, *first);
        }
        let estimate = Estimate {
            mean: indirect.indirect,
            first_half: indirect.first_half,
            variance: indirect.variance,
            disagree: false,
        };
        let points = spread(footprint, self.points());
        let known = known(luminance(indirect.indirect), 0);
        let direct = self.direct_on_all(footprint, &points, seed, &known, &mut planes);
        let place = (Place::of(&points), footprint.size());
        Received::of(direct, &estimate, planes, place)
    }

    /// Only direct light; the rest is that of a calm cell.
    pub(crate) fn gather_calm(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        calm: &Calm,
    ) -> Received {
        Received {
            far: calm.like.far,
            around: calm.like.around,
            void: calm.like.void,
            ..self.gather_direct(footprint, seed, &calm.indirect)
        }
    }

    /// Takes all light from neighbours, including `direct`, if shadow rays from the footprint's
    /// centre to lamps agree with them; else `None`.
    pub(crate) fn gather_nothing(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        indirect: &Between,
        direct: DirectBetween,
    ) -> Option<Received> {
        let point = footprint.fallback();
        let light = luminance(direct.irradiance + indirect.indirect);
        let (least, expected) = (MATTERS * light, [direct.lit, direct.hidden]);
        let lights = &self.tracer.direct;
        let rays = lights.lamps_seen_as(&point, expected, least, seed)?;
        let planes = (indirect.planes.iter().zip(direct.planes))
            .map(|([indirect, first_half], direct)| Plane {
                direct,
                indirect: *indirect,
                first_half: *first_half,
            })
            .collect();
        Some(Received {
            direct: direct.irradiance,
            indirect: indirect.indirect,
            first_half: indirect.first_half,
            direct_variance: direct.variance,
            indirect_variance: indirect.variance,
            position: point.position,
            normal: point.normal,
            size: footprint.size(),
            open: 1.0,
            far: 1.0,
            rays: rays.into(),
            lit: direct.lit,
            hidden: direct.hidden,
            planes,
            ..Received::default()
        })
    }

    /// Gathers with `times` as many gathering rays as [`gather`](Self::gather); `first` already
    /// contains `done` times as many. Both are powers of two.
    pub(crate) fn gather_more(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        first: &Received,
        (done, times): (u32, u32),
    ) -> Received {
        // Continues the sequences of both points and directions.
        let points = spread(footprint, self.points() * times as usize);
        let before = self.points() * done as usize;
        let sampling = Sampling {
            before: before as u32,
            ..self.sampling(footprint, seed)
        };
        let mut planes = PlaneSums::new(self.wanted);
        let sampled = self.sample(&points[before..], sampling, |_, _, of_point| {
            planes.take(of_point);
        });
        let more = mean_and_spread(&sampled.sums, &vec![true; sampled.sums.len()]);
        let a = done as f32 / times as f32;
        let b = 1.0 - a;
        let planes = (first.planes.iter().zip(planes.finish()))
            .map(|(first, more)| Plane {
                direct: first.direct,
                indirect: first.indirect * a + more.indirect * b,
                first_half: first.first_half * a + more.first_half * b,
            })
            .collect();
        Received {
            planes,
            indirect: first.indirect * a + more.mean * b,
            first_half: first.first_half * a + more.first_half * b,
            indirect_variance: a * a * first.indirect_variance + b * b * more.variance,
            rays: first.rays + sampled.rays,
            ..first.clone()
        }
    }

    /// Computes direct light again, with as many points as in a penumbra for the lights of `look`:
    /// for footprints next to one that the shadow edges of these lights cross, because the edges
    /// may cut a corner.
    pub(crate) fn refine_direct(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        first: &Received,
        look: u32,
    ) -> Received {
        let points = spread(footprint, self.options.points as usize);
        let known = known(luminance(first.indirect), look);
        let mut planes = first.planes.clone();
        let direct = self.direct_on_all(footprint, &points, seed, &known, &mut planes);
        Received {
            looked: first.looked | look,
            ..first.clone()
        }
        .with_direct(direct, planes)
    }

    /// Direct light on a footprint in the open.
    fn direct_on_all<F: Footprint>(
        &self,
        footprint: &F,
        points: &[SurfacePoint],
        seed: u32,
        known: &Known,
        planes: &mut [Plane],
    ) -> DirectEstimate {
        let open = vec![true; points.len()];
        let points = OpenPoints::new(footprint, points, &open);
        self.direct_light(points, seed, &self.options.direct, known, planes)
    }
}
