//! Footprints at contacts: many points, sorted into visible, hidden and walled-off parts.

use radiosity::{
    DirectEstimate, DirectOptions, Incoming, SurfacePoint, cosine_hemisphere, hash_u32, luminance,
    sample_4d,
};

use crate::estimate::{Around, BEHIND, Estimate, MOSTLY_INSIDE, Point, mean_and_spread};
use crate::footprint::Footprint;
use crate::gatherer::{Gatherer, known};
use crate::parts::{GAP, Parts};
use crate::planes::{Plane, PlaneSums};
use crate::points::{OpenPoints, Place, Sampling, spread};
use crate::received::{Edge, Received};

/// Rays per point of a footprint that an edge crosses. The position of the edge matters more there
/// than the accuracy of single points.
const EDGE_RAYS: u32 = 2;

/// The gathered light of a part of a footprint.
struct Seen {
    /// The points that count.
    mask: Vec<bool>,
    direct: DirectEstimate,
    place: Place,
    indirect: Estimate,
    planes: Vec<Plane>,
    /// Its number of points times the fraction of their rays that go far: how much it is seen. The
    /// slit between a book and the wall may be larger than what is seen beside the book.
    seen: f32,
}

impl Seen {
    /// Luminance of the light.
    fn light(&self) -> f32 {
        luminance(self.direct.irradiance + self.indirect.mean)
    }
}

/// A footprint with a smaller visible fraction counts as hidden: its few samples are mostly noise,
/// and its neighbours know better.
const LEAST_OPEN: f32 = 1.0 / 32.0;

/// Least fraction of rays that go far, for parts of which none does: there, size decides.
const LEAST_FAR: f32 = 0.02;

/// An object that touches a footprint shadows part of it. This many scouts find that more reliably
/// than [`DirectOptions::scouts`].
const LEAST_SCOUTS: u32 = 32;

/// A footprint's points with their sums, sorted into parts.
struct Sorted<'f, F> {
    footprint: &'f F,
    points: Vec<SurfacePoint>,
    sums: Vec<Point>,
    /// The part of each point; `None` where nobody sees it.
    part: Vec<Option<usize>>,
    /// Sums for planes by part, followed by those of points that nobody sees.
    planes: Vec<PlaneSums>,
    seed: u32,
    /// Whether walls split the footprint into several parts.
    walled: bool,
}

impl<F> Sorted<'_, F> {
    /// Parts of the footprint.
    fn parts(&self) -> usize {
        self.planes.len() - 1
    }

    /// The points of part `k`.
    fn of(&self, k: usize) -> impl Iterator<Item = &Point> {
        (self.sums.iter().zip(&self.part))
            .filter(move |x| *x.1 == Some(k))
            .map(|x| x.0)
    }

    /// Which points are in part `k`.
    fn mask(&self, k: usize) -> Vec<bool> {
        self.part.iter().map(|p| *p == Some(k)).collect()
    }
}

impl Gatherer<'_, '_> {
    /// Mean irradiance over a footprint that an edge crosses, or over its visible part: many points
    /// with few rays each, and as many shadow rays as in a penumbra.
    pub(crate) fn gather_edge(&self, footprint: &impl Footprint, seed: u32) -> Received {
        // New random numbers: those that made the first points disagree must not decide again.
        let seed = hash_u32(seed ^ 0x2545_f491);
        let (mut all, mut rays) = self.sort(footprint, seed);
        let count = all.points.len();
        let apart = self.options.open_only;
        let (mut seen, hidden) = match apart {
            true => self.seen_parts(&all),
            false => (Vec::new(), vec![false; all.parts()]),
        };
        rays += (seen.iter().map(|s| u64::from(s.direct.rays))).sum::<u64>();
        let cut = seen.len() > 1;
        let open = match apart {
            false => all.sums.iter().filter(|s| !s.inside()).count(),
            true => (all.part.iter())
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
            ..
        } = seen.pop().unwrap_or_else(|| {
            // Either nothing is visible, or visible parts are not separated: use the whole
            // footprint.
            let mut whole = PlaneSums::new(self.wanted);
            all.planes.iter_mut().for_each(|p| whole.take(p));
            let one = self.see(&all, vec![true; count], &whole);
            rays += u64::from(one.direct.rays);
            one
        });
        let counted = || all.sums.iter().zip(&mask).filter(|x| *x.1).map(|x| x.0);
        let dark = (self.tracer).is_dark(luminance(direct.irradiance + indirect.mean));
        Received {
            edge: Edge::Contact,
            rays,
            near: all.sums.iter().any(|s| s.near),
            around: Point::around(counted()),
            far: Point::far(counted()),
            behind: (dark && Point::in_the_void(counted()))
                || Point::dark_shares(counted())[0] >= BEHIND,
            // A lumel that a wall cuts is not whole.
            open: if apart && open < LEAST_OPEN {
                0.0
            } else if cut {
                open.min(1.0 - 1.0 / count as f32)
            } else {
                open
            },
            ..Received::of(direct, &indirect, planes, (place, footprint.size()))
        }
    }

    /// Gathers at a footprint's points and sorts them into the parts that walls separate; also
    /// returns the number of rays.
    fn sort<'f, F: Footprint>(&self, footprint: &'f F, seed: u32) -> (Sorted<'f, F>, u64) {
        let world = self.tracer.world;
        let count = self.options.edge_points.max(self.options.points) as usize;
        let points = spread(footprint, count);
        let parts =
            (self.options.open_only).then(|| Parts::find(world, &points, footprint.reach()));
        // Plus one part for slivers and one for what nobody sees.
        let number = parts.as_ref().map_or(1, |p| p.count + 1);
        let mut planes: Vec<PlaneSums> =
            (0..=number).map(|_| PlaneSums::new(self.wanted)).collect();
        let sampling = Sampling {
            rays: EDGE_RAYS,
            ..self.sampling(footprint, seed)
        };
        let gap = GAP * footprint.reach();
        let mut part: Vec<Option<usize>> = Vec::with_capacity(count);
        let sampled = self.sample(&points, sampling, |k, sum, of_point| {
            let p = &points[k];
            let own = match &parts {
                None => Some(0),
                Some(_) if sum.may_be_buried() && world.out_of_sight(p, gap) => None,
                Some(parts) => Some(parts.of(world, p)),
            };
            planes[own.unwrap_or(number)].take(of_point);
            part.push(own);
        });
        let sorted = Sorted {
            footprint,
            points,
            sums: sampled.sums,
            part,
            planes,
            seed,
            walled: parts.is_some_and(|p| p.count > 1),
        };
        (sorted, sampled.rays)
    }

    /// The visible parts, the one that is seen most last, and a flag for each part that is hidden.
    /// Parts outside the level are hidden if others are in a room.
    fn seen_parts<F: Footprint>(&self, all: &Sorted<F>) -> (Vec<Seen>, Vec<bool>) {
        let mut hidden = vec![false; all.parts()];
        let dark: Vec<[f32; 2]> = (0..all.parts())
            .map(|k| Point::dark_shares(all.of(k)))
            .collect();
        let some_before = dark.iter().any(|d| d[0] < BEHIND && d[1] < MOSTLY_INSIDE);
        let mut seen: Vec<Seen> = Vec::with_capacity(all.parts());
        let around: Vec<Around> = (0..all.parts()).map(|k| Point::around(all.of(k))).collect();
        let some_in_a_room = all.walled && around.contains(&Around::Room);
        let mut found: Vec<(usize, Seen, bool)> = Vec::with_capacity(all.parts());
        for (k, hidden) in hidden.iter_mut().enumerate() {
            let mask = all.mask(k);
            if !mask.contains(&true) {
                continue;
            }
            let outside = some_in_a_room && around[k] == Around::Outside;
            *hidden =
                outside || some_before && dark[k][0] >= BEHIND || Point::inside_together(all.of(k));
            if !*hidden {
                let one = self.see(all, mask, &all.planes[k]);
                let unlit = self.tracer.is_dark(one.light());
                found.push((k, one, unlit));
            }
        }
        let some_lit = found.iter().any(|f| !f.2);
        for (k, one, unlit) in found {
            // For example, the end of a wall may extend through the room's shell into space that is
            // never visible. Without a wall it is just shade.
            let lost = all.walled && unlit && Point::in_the_void(all.of(k));
            // The hollow of a wall that is open at its foot: dark, with backs around. Beside a lit
            // part it would be a black line along the corner of a room.
            let hollow = all.walled && unlit && some_lit && dark[k][1] >= BEHIND;
            // The rim of a floor outside of the room's walls, where it is night.
            let night = unlit && some_lit && some_in_a_room && around[k] != Around::Room;
            hidden[k] = lost || hollow || night || Point::shut(all.of(k), unlit);
            if !hidden[k] {
                seen.push(one);
            }
        }
        seen.sort_by(|a, b| a.seen.total_cmp(&b.seen));
        (seen, hidden)
    }

    /// Light over the points of `mask`.
    fn see<F: Footprint>(&self, all: &Sorted<F>, mask: Vec<bool>, planes: &PlaneSums) -> Seen {
        let mut planes = planes.finish();
        // As many points as there are, up to the number in a penumbra.
        let count = mask.iter().filter(|m| **m).count() as u32;
        let own = &self.options.direct;
        let most = match count as usize == mask.len() {
            true => own.penumbra.max(count),
            false => count,
        };
        let options = DirectOptions {
            base: match self.options.contacts {
                true => most,
                false => most.min(own.base),
            },
            penumbra: most,
            scouts: own.scouts.max(LEAST_SCOUTS),
        };
        let indirect = mean_and_spread(&all.sums, &mask);
        let known = known(luminance(indirect.mean), 0);
        let points = OpenPoints::new(all.footprint, &all.points, &mask);
        let place = points.place();
        let direct = self.direct_light(points, all.seed, &options, &known, &mut planes);
        let counted = || all.sums.iter().zip(&mask).filter(|x| *x.1).map(|x| x.0);
        let seen = count as f32 * Point::far(counted()).max(LEAST_FAR);
        Seen {
            seen,
            indirect,
            direct,
            place,
            planes,
            mask,
        }
    }

    /// Whether any ray from the points of a contact footprint hits anything but black backfaces.
    pub(crate) fn anything_open(&self, footprint: &impl Footprint, seed: u32) -> bool {
        let world = self.tracer.world;
        (self.options.points..self.options.edge_points).any(|i| {
            footprint.candidate(i).is_some_and(|p| {
                let s = sample_4d(i, 0, seed ^ 0x9e37_79b9);
                let toward = cosine_hemisphere(p.normal, s[0], s[1]);
                let black = || matches!(world.incoming(p.origin, toward).0, Incoming::Black);
                !world.out_of_sight(&p, GAP * footprint.reach())
                    && (p.geometric.dot(toward) <= 0.0 || !black())
            })
        })
    }
}
