//! Footprints that an edge crosses: many points, sorted by what can be seen and what a wall cuts off.

use radiosity::{DirectEstimate, DirectOptions, Known, World, hash_u32, luminance};

use crate::estimate::{BEHIND, Estimate, MOSTLY_INSIDE, Point, mean_and_spread};
use crate::footprint::Footprint;
use crate::gather::{Edge, Gatherer, Received, received};
use crate::lit::LitRays;
use crate::planes::{Plane, PlaneSums, Wanted};
use crate::points::{Place, Points};
use crate::recall::{RayTape, Tape, Topic};
use crate::walls::Parts;

/// The parts into which walls cut a footprint.
struct Sorted {
    /// How many there are.
    count: usize,
    /// The part of each point.
    of: Vec<u8>,
}

impl Sorted {
    /// Sorts `points`, or takes it from records.
    fn find<F: Footprint>(
        world: &World,
        points: &Points<F>,
        reach: f32,
        tape: &mut Tape,
    ) -> Sorted {
        let make = || {
            let points = points.get();
            let parts = Parts::find(world, points, reach);
            let mut out = vec![parts.count as u8];
            out.extend(points.iter().map(|p| parts.of(world, p) as u8));
            out
        };
        let mut of = tape.bytes(Topic::Parts, make);
        if of.len() != points.count + 1 {
            of = make();
        }
        Sorted {
            count: of.remove(0) as usize,
            of,
        }
    }
}

/// Rays of each point of a footprint that an edge crosses. Where the edge lies matters more there than what one point sees.
const EDGE_RAYS: u32 = 2;

/// A part of a footprint, its light gathered.
struct Seen {
    /// The points that count.
    mask: Vec<bool>,
    direct: DirectEstimate,
    place: Place,
    indirect: Estimate,
    planes: Vec<Plane>,
}

impl Seen {
    /// How many points count.
    fn size(&self) -> usize {
        self.mask.iter().filter(|m| **m).count()
    }

    /// Luminance of the light.
    fn light(&self) -> f32 {
        luminance(self.direct.irradiance + self.indirect.mean)
    }
}

/// A footprint of which less than this can be seen counts as hidden: what so little of it says is all noise, and its neighbours know better.
const LEAST_OPEN: f32 = 1.0 / 32.0;

/// What touches a footprint throws a shadow on a part of it, which so many points do not miss as easily as [`DirectOptions::scouts`].
const LEAST_SCOUTS: u32 = 32;

impl Gatherer<'_, '_> {
    /// Mean irradiance over a footprint that an edge crosses, or what can be seen of it: many points, few rays each, and as many shadow rays as
    /// a penumbra gets.
    pub(crate) fn gather_edge(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        tape: &mut Tape,
    ) -> Received {
        let count = self.options.edge_points.max(self.options.points) as usize;
        let points = Points::new(footprint, count);
        // Its own random numbers: what made the first points disagree should not decide again.
        let seed = hash_u32(seed ^ 0x2545_f491);
        let parts = (self.options.open_only)
            .then(|| Sorted::find(self.world, &points, footprint.reach(), tape));
        // The part of each point; `None` inside a body.
        let mut part: Vec<Option<usize>> = Vec::with_capacity(count);
        // The last is of slivers.
        let number = parts.as_ref().map_or(1, |p| p.count + 1);
        let mut planes: Vec<PlaneSums> = (0..number).map(|_| PlaneSums::new(self.wanted)).collect();
        let mut own = PlaneSums::new(self.wanted);
        let mut nowhere = PlaneSums::new(self.wanted);
        let mut rays = u64::from(EDGE_RAYS) * count as u64;
        let mut records = tape.rays(Topic::EdgeRays, 0);
        let mut lit = LitRays::new(self, footprint.reach(), u32::MAX, tape);
        let share = lit.share(|| points.get(), EDGE_RAYS);
        let mut sums = vec![Point::new(footprint.reach(), share); count];
        for (k, sum) in sums.iter_mut().enumerate() {
            let point = || &points.get()[k];
            let base = k as u32 * EDGE_RAYS;
            own.first_half = 2 * k < count;
            let samples = (base..base + EDGE_RAYS, seed);
            self.indirect(point, samples, sum, &mut own, (tape, &mut records));
            let of = match &parts {
                None => Some(0),
                Some(_) if self.world.inside_a_body(point()) => None,
                Some(parts) => Some(parts.of[k] as usize),
            };
            if of.is_some() {
                lit.reach(point, (k as u32, seed), sum, &mut own);
            }
            let to = of.map_or(&mut nowhere, |of| &mut planes[of]);
            to.take(&mut own);
            part.push(of);
        }
        tape.keep_rays(Topic::EdgeRays, 0, records);
        rays += lit.keep(tape);
        let near = sums.iter().any(|s| s.near);
        let of = |k: usize| (sums.iter().zip(&part)).filter(move |x| *x.1 == Some(k));
        let dark: Vec<[f32; 2]> = (0..number)
            .map(|k| Point::dark_shares(of(k).map(|x| x.0)))
            .collect();
        let some_before = dark.iter().any(|d| d[0] < BEHIND && d[1] < MOSTLY_INSIDE);
        // What can be seen, the largest part last.
        let mut seen: Vec<Seen> = Vec::with_capacity(number);
        let mut hidden = vec![false; number];
        for (k, planes) in planes.iter().enumerate() {
            let mask: Vec<bool> = part.iter().map(|p| *p == Some(k)).collect();
            if parts.is_none() || !mask.contains(&true) {
                continue;
            }
            hidden[k] = some_before && dark[k][0] >= BEHIND;
            if !hidden[k] {
                let one = self.see(footprint, &points, &sums, mask, seed, planes, tape);
                rays += u64::from(one.direct.rays);
                let dark = self.is_dark(one.light());
                // The end of a wall, say, may reach through the room's shell to where nobody will ever be; without a wall it is shade.
                let walled = parts.as_ref().is_some_and(|p| p.count > 1);
                let lost = walled && dark && Point::in_the_void(of(k).map(|x| x.0));
                hidden[k] = lost || Point::shut(of(k).map(|x| x.0), dark);
                if !hidden[k] {
                    seen.push(one);
                }
            }
        }
        seen.sort_by_key(Seen::size);
        let cut = seen.len() > 1;
        let open = match &parts {
            None => sums.iter().filter(|s| !s.inside()).count(),
            Some(_) => (part.iter())
                .filter(|p| p.is_some_and(|p| !hidden[p]))
                .count(),
        };
        let open = open as f32 / count as f32;
        let Seen {
            mask,
            direct,
            place,
            indirect,
            planes,
        } = seen.pop().unwrap_or_else(|| {
            // Nothing can be seen, or nothing is to be kept apart: all of it.
            let mut all = nowhere;
            planes.iter_mut().for_each(|p| all.take(p));
            let mask = vec![true; count];
            let one = self.see(footprint, &points, &sums, mask, seed, &all, tape);
            rays += u64::from(one.direct.rays);
            one
        });
        let counted = || sums.iter().zip(&mask).filter(|x| *x.1).map(|x| x.0);
        let dark = self.is_dark(luminance(direct.irradiance + indirect.mean));
        Received {
            edge: Edge::Contact,
            near,
            behind: (dark && Point::in_the_void(counted()))
                || Point::dark_shares(counted())[0] >= BEHIND,
            // What a wall cuts is no whole lumel.
            open: if parts.is_some() && open < LEAST_OPEN {
                0.0
            } else if cut {
                open.min(1.0 - 1.0 / count as f32)
            } else {
                open
            },
            ..received(footprint, place, direct, &indirect, open, rays, planes)
        }
    }

    /// Light over the points of `mask`.
    #[allow(
        clippy::too_many_arguments,
        reason = "a footprint, and all that was found there"
    )]
    fn see<F: Footprint>(
        &self,
        footprint: &F,
        points: &Points<F>,
        sums: &[Point],
        mask: Vec<bool>,
        seed: u32,
        planes: &PlaneSums,
        tape: &mut Tape,
    ) -> Seen {
        let mut planes = planes.finish();
        // As many points as there are, at most what a penumbra gets.
        let count = mask.iter().filter(|m| **m).count() as u32;
        let most = if count as usize == mask.len() {
            (self.options.direct.penumbra).max(count)
        } else {
            count
        };
        let options = DirectOptions {
            base: match self.options.contacts {
                true => most,
                false => most.min(self.options.direct.base),
            },
            penumbra: most,
            scouts: self.options.direct.scouts.max(LEAST_SCOUTS),
        };
        let indirect = mean_and_spread(sums, &mask);
        let known = Known {
            light: luminance(indirect.mean),
            look: 0,
        };
        let (direct, place) = self.direct_light(
            footprint,
            points,
            &mask,
            seed,
            (&options, &known),
            &mut planes,
            tape,
        );
        Seen {
            indirect,
            direct,
            place,
            planes,
            mask,
        }
    }

    /// Whether a ray from any of the points that an edge would get meets anything but black back faces.
    pub(crate) fn anything_open(&self, footprint: &impl Footprint, seed: u32) -> bool {
        (self.options.points..self.options.edge_points).any(|i| {
            footprint.candidate(i).is_some_and(|p| {
                let mut probe = Point::default();
                let mut planes = PlaneSums::new(Wanted::default());
                let rays = (i..i + 1, seed ^ 0x9e37_79b9);
                let unrecorded = (&mut Tape::off(), &mut RayTape::Off);
                self.indirect(|| &p, rays, &mut probe, &mut planes, unrecorded);
                probe.black == 0 && !self.world.inside_a_body(&p)
            })
        })
    }
}
