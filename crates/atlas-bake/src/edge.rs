//! Footprints that an edge crosses: many points, sorted by what can be seen and what a wall cuts off.

use glam::Vec3;
use radiosity::{DirectEstimate, DirectOptions, Known, SurfacePoint, World, hash_u32, luminance};

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
    /// Luminance of the light.
    fn light(&self) -> f32 {
        luminance(self.direct.irradiance + self.indirect.mean)
    }
}

/// The dark part of a footprint that a wall divides stands for all of it where it has less than this of the bright part's light: what
/// comes through a wall is seen in the dark. Where both have about the same light, both count.
const DARK_PART: f32 = 0.5;

/// The same for what lies beyond a wall and is too little to hold one of the first points: few rays tell only what is black.
const DARK_SLIVER: f32 = 0.02;

/// A footprint of which less than this can be seen counts as hidden: what so little of it says is all noise, and its neighbours know better.
const LEAST_OPEN: f32 = 1.0 / 32.0;

/// What touches a footprint throws a shadow on a part of it, which so many points do not miss as easily as [`DirectOptions::scouts`].
const LEAST_SCOUTS: u32 = 32;

/// Further rays of a point whose few all met black backs. An open point near the backs of things sees them in half of its hemisphere at most.
const CONFIRM: u32 = 6;

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
        // The part of each point, and whether it is open.
        let mut part: Vec<(usize, bool)> = Vec::with_capacity(count);
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
            let of = parts.as_ref().map_or(0, |parts| parts.of[k] as usize);
            let inside = parts.is_some()
                && sum.inside()
                && self.confirmed_inside(point, k as u32, seed, &mut rays, tape);
            if !inside {
                lit.reach(point, (k as u32, seed), sum, &mut own);
            }
            let to = if inside {
                &mut nowhere
            } else {
                &mut planes[of]
            };
            to.take(&mut own);
            part.push((of, !inside));
        }
        tape.keep_rays(Topic::EdgeRays, 0, records);
        rays += lit.keep(tape);
        let near = sums.iter().any(|s| s.near);
        let mut seen: Vec<(Seen, f32)> = Vec::with_capacity(number);
        let mut hidden = vec![false; number];
        let dark: Vec<[f32; 2]> = (0..number)
            .map(|k| {
                let of = sums.iter().zip(&part).filter(|x| x.1.0 == k);
                Point::dark_shares(of.map(|x| x.0))
            })
            .collect();
        let some_before = dark.iter().any(|d| d[0] < BEHIND && d[1] < MOSTLY_INSIDE);
        for (k, planes) in planes.iter().enumerate() {
            let of = || {
                sums.iter()
                    .zip(&part)
                    .filter(move |x| x.1.0 == k)
                    .map(|x| x.0)
            };
            let mask: Vec<bool> = part.iter().map(|p| *p == (k, true)).collect();
            let behind = some_before && dark[k][0] >= BEHIND;
            if parts.is_some() && (behind || dark[k][1] >= MOSTLY_INSIDE) {
                hidden[k] = true;
            } else if mask.contains(&true) {
                let one = self.see(footprint, &points, &sums, mask, seed, planes, tape);
                rays += u64::from(one.direct.rays);
                let walled = parts.as_ref().is_some_and(|p| p.count > 1);
                if walled && one.light() == 0.0 && Point::in_the_void(of()) {
                    // The end of a wall, say, that reaches through the room's shell to where nobody will ever be. Without a wall it is shade.
                    hidden[k] = true;
                    continue;
                }
                let sliver = parts.as_ref().is_some_and(|p| p.count == k);
                seen.push((one, if sliver { DARK_SLIVER } else { DARK_PART }));
            }
        }
        let part: Vec<bool> = part.iter().map(|p| p.1 && !hidden[p.0]).collect();
        let brightest = seen.iter().map(|s| s.0.light()).fold(0.0, f32::max);
        let cut = seen.len() > 1;
        let whole = !cut && !seen.is_empty();
        seen.retain(|(part, share)| whole || part.light() < share * brightest);
        seen.sort_by(|a, b| a.0.light().total_cmp(&b.0.light()));
        let mut seen: Vec<Seen> = seen.into_iter().map(|s| s.0).collect();
        if seen.is_empty() {
            // No part is dark beside another: all of what is open; all of it where nothing is.
            let mut all = nowhere;
            if cut {
                all = PlaneSums::new(self.wanted);
                let open = planes.iter_mut().zip(&hidden).filter(|x| !x.1);
                open.for_each(|(p, _)| all.take(p));
            }
            let mask: Vec<bool> = part.iter().map(|open| !cut || *open).collect();
            seen.push(self.see(footprint, &points, &sums, mask, seed, &all, tape));
            rays += u64::from(seen[0].direct.rays);
        }
        let Seen {
            mask,
            direct,
            place,
            indirect,
            planes,
        } = seen.swap_remove(0);
        let inside = |s: &Point| s.inside();
        let open = match &parts {
            None => sums.iter().filter(|s| !inside(s)).count(),
            Some(_) => part.iter().filter(|open| **open).count(),
        };
        let open = open as f32 / count as f32;
        Received {
            edge: Edge::Contact,
            near,
            behind: {
                let counted = || sums.iter().zip(&mask).filter(|x| *x.1).map(|x| x.0);
                let dark = direct.irradiance == Vec3::ZERO && indirect.mean == Vec3::ZERO;
                (dark && Point::in_the_void(counted()))
                    || Point::dark_shares(counted())[0] >= BEHIND
            },
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

    /// Whether some more rays from a point that seems to be inside something meet nothing but backs too.
    fn confirmed_inside<'p>(
        &self,
        point: impl Fn() -> &'p SurfacePoint,
        k: u32,
        seed: u32,
        rays: &mut u64,
        tape: &mut Tape,
    ) -> bool {
        let mut planes = PlaneSums::new(Wanted::default());
        let seed = hash_u32(seed ^ k ^ 0x9e37_79b9);
        let mut records = tape.rays(Topic::Confirm, k);
        let inside = (0..CONFIRM).all(|i| {
            let mut one = Point::default();
            let samples = (i..i + 1, seed);
            self.indirect(&point, samples, &mut one, &mut planes, (tape, &mut records));
            *rays += 1;
            one.inside()
        });
        tape.keep_rays(Topic::Confirm, k, records);
        inside
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
                probe.black == 0
            })
        })
    }
}
