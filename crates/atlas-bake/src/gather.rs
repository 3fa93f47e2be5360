//! Final gather: the light that a footprint receives.

use std::cell::OnceCell;

use glam::Vec3;
use radiosity::{
    DirectEstimate, DirectLight, DirectOptions, Incoming, Known, LitElements, Reflected, Shade,
    Solution, SurfacePoint, World, cosine_hemisphere, hash_u32, luminance, sample_2d, sample_4d,
};

use crate::again::Retrace;
use crate::estimate::{BEHIND, Estimate, Point, mean_and_spread};
use crate::footprint::Footprint;
use crate::lit::LitRays;
use crate::planes::{Plane, PlaneSums, Wanted};
use crate::points::{Place, Points, nearest_is_open};
use crate::recall::{Deaf, End, Listening, Notes, RayTape, Recall, Tape, Topic, key_of};
use crate::sparse::{Between, DirectBetween};
use crate::walls::Parts;

/// How carefully light is gathered.
#[derive(Debug, Clone, Copy)]
pub struct GatherOptions {
    /// Gathering rays a footprint gets at least; a multiple of `points`.
    pub rays: u32,
    /// Points of the footprint that share those rays, at most 64, a power of two. Contacts smaller than one part in so many go unseen.
    pub points: u32,
    /// Points of a footprint that an edge crosses; see [`Gatherer::gather`]. None are looked for with 0.
    pub edge_points: u32,
    /// Footprints whose first `points` disagree are such too, and those beside them are looked at again. Else only those that lie in part inside or behind something.
    pub contacts: bool,
    /// So many lumels from where it was found a shadow's edge is followed.
    pub follow: u32,
    /// Rays that a lumel gets at most where neighbours say that `rays` are too few; a power of two times `rays`.
    pub most_rays: u32,
    /// Good enough: estimated standard error of the indirect light over the total.
    pub error: f32,
    /// Direct light.
    pub direct: DirectOptions,
    /// Shadow rays of each point to elements that direct light falls on; with 0 gathering rays find them.
    pub lit: u32,
    /// Where lumels are interpolated instead.
    pub interpolation: Interpolation,
    /// A ray's hit is near, and the ray goes on as a path, within this many patches' size. Less is quicker, and blurs what stands close to each other.
    pub near: f32,
    /// Only what can be seen counts: sub-points inside closed things are left out of the mean, and of a footprint that a wall divides
    /// into a bright and a dark part, the bright one is. Else the mean is over all of the footprint, buried or not.
    pub open_only: bool,
}

/// Which lumels are not gathered at, but lie between others that are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Those on flat surfaces that nothing rises from within four lumels: their indirect light.
    #[default]
    Open,
    /// Those that nothing stands right beside: their indirect light, and the direct light too where no shadow's edge is near and shadow rays
    /// to lamps agree with the neighbours'.
    Wide,
}

/// Light that a footprint receives.
#[derive(Debug, Clone, Default)]
pub struct Received {
    /// Irradiance straight from lamps and emitters.
    pub direct: Vec3,
    /// Irradiance reflected from surfaces, from the sky, and from wide dim emitters.
    pub indirect: Vec3,
    /// `indirect` from the first half of the points alone; the other half has 2 × `indirect` − this. The two are independent estimates.
    pub first_half: Vec3,
    /// Estimated standard error of the sum's luminance.
    pub error: f32,
    /// The part of `error`² that comes from `indirect`.
    pub indirect_variance: f32,
    /// Where smoothing made more of it than its own samples allow: luminance that these say, or what they may have missed. An error is large against
    /// that. `None` elsewhere.
    pub least: Option<f32>,
    /// [`DirectEstimate::doubt`] of `direct`.
    pub direct_doubt: [f32; 2],
    /// Mean position of the footprint's points, metres, recentred.
    pub position: Vec3,
    /// Mean shading normal, unit.
    pub normal: Vec3,
    /// Size of the footprint, metres.
    pub size: f32,
    /// Share of the footprint that lies in the open, 0..=1; 0 if all of it is inside or behind something.
    pub open: f32,
    /// Gathering and shadow rays cast.
    pub rays: u64,
    /// Something stands within the footprint's size of it.
    pub near: bool,
    /// Many of its rays meet black backs: it lies behind what others lie before.
    pub behind: bool,
    /// What crosses the footprint.
    pub edge: Edge,
    /// Lights whose shadow's edge does, as [`DirectEstimate::mixed`] names them.
    pub mixed: u32,
    /// Lamps that a point of it sees, and lamps that are hidden from one, by the same bits.
    pub lit: u32,
    /// See `lit`.
    pub hidden: u32,
    /// Lights at whose shadows it was looked as closely as at most.
    pub looked: u32,
    /// What [`Gatherer::wanted`] asks for, in its order; empty where that is nothing.
    pub planes: Box<[Plane]>,
}

/// An edge across a footprint.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Edge {
    /// None was seen.
    #[default]
    None,
    /// Of a shadow: a light is seen from a part of the footprint, or partly.
    Shadow,
    /// Of a thing that touches the surface or stands close to it: what is seen from the points of the footprint differs. It got
    /// [`GatherOptions::edge_points`].
    Contact,
}

impl Received {
    /// The part of `error`² that comes from `direct`.
    pub(crate) fn direct_variance(&self) -> f32 {
        (self.error * self.error - self.indirect_variance).max(0.0)
    }

    /// Two independent estimates of `indirect`.
    pub(crate) fn halves(&self) -> [Vec3; 2] {
        [self.first_half, 2.0 * self.indirect - self.first_half]
    }
}

/// Points at least by which a wall is looked for that parts a footprint.
const PARTED_POINTS: usize = 16;

/// Most [`GatherOptions::points`].
const MOST_POINTS: usize = 64;

/// After so many near bounces a path reads the solution: light that has gone to and fro in a gap so often has lost what told its places apart.
pub(crate) const MOST_NEAR_BOUNCES: u32 = 4;

/// A hit is near within this share of a patch's size, by the bounces before it. What a path meets after its first bounce is seen with the others' beside it;
/// there the elements, a quarter of a patch, are fine enough.
const NEAR: [f32; MOST_NEAR_BOUNCES as usize + 1] = [1.0, 0.5, 0.25, 0.25, 0.0];

/// Gathers light at footprints.
pub struct Gatherer<'w, 'a> {
    /// Scene.
    pub world: &'w World<'a>,
    /// Its solved light.
    pub solution: &'w Solution,
    /// Its direct light.
    pub direct: DirectLight<'w, 'a>,
    /// How carefully.
    pub options: GatherOptions,
    /// What to keep beside the irradiance.
    pub wanted: Wanted,
    /// What direct light falls on, if that is sampled.
    pub(crate) lit: LitElements,
    /// Records of an earlier bake, or for a later one.
    pub(crate) recall: Option<&'w Recall>,
    /// Less radiance than this on the back of a double-sided face is none: the inside of something.
    dim: f32,
}

/// What a gathering ray found.
#[derive(Default)]
pub(crate) struct Found {
    pub radiance: Vec3,
    /// To the first surface, infinite if there is none; 0 where nothing can arrive.
    pub distance: f32,
    /// The first surface turns its back.
    pub back: bool,
    /// It is lit, and that is left out.
    pub left_out: bool,
}

/// What came of a gathering ray.
pub(crate) enum Ray {
    /// It cannot start.
    Below,
    /// It met a black back.
    Black,
    Found(Found),
}

/// Adds radiance to its group's part and to the sum.
#[inline]
pub(crate) fn add(radiance: Vec3, group: usize, sum: &mut Vec3, groups: &mut [Vec3]) {
    *sum += radiance;
    if let Some(part) = groups.get_mut(group) {
        *part += radiance;
    }
}

/// Radiance under this share of the scene's mean is none.
const DIM: f32 = 1e-3;

/// What a ray hits nearer than this many footprints closes a gap that nobody looks into, under a crate that hovers by a millimetre.
const TOUCHING: f32 = 0.2;

/// A lamp that would bring less than this share of a lumel's light is not looked for where all neighbours agree about it.
const MATTERS: f32 = 0.01;

/// Unless it brings this share of the scene's mean radiance: the gap behind a tube of light is no dark one.
const SHADE: f32 = 0.1;

impl<'w, 'a> Gatherer<'w, 'a> {
    /// Gathers from `solution`, which is of `world`.
    pub fn new(
        world: &'w World<'a>,
        solution: &'w Solution,
        direct: DirectLight<'w, 'a>,
        options: GatherOptions,
        wanted: Wanted,
    ) -> Self {
        let mean = luminance(solution.mean_irradiance().as_vec3());
        let lit = match options.lit {
            0 => LitElements::default(),
            _ => LitElements::collect(world, solution),
        };
        Gatherer {
            world,
            solution,
            direct: direct.on_patches(&solution.cut),
            options,
            wanted,
            lit,
            recall: None,
            dim: DIM * mean * std::f32::consts::FRAC_1_PI,
        }
    }
}

impl Gatherer<'_, '_> {
    /// Mean irradiance over the footprint.
    ///
    /// First a few points share many rays. Where they disagree (some lie inside a closed thing, or see much more light than others) an edge
    /// crosses the footprint, and the mean is only as good as the share of points on either side: these footprints are gathered anew, with
    /// [`GatherOptions::edge_points`] points of two rays each.
    ///
    /// Sub-points inside closed things are those from which nearly all rays meet black back faces, or, where only what is open counts, unlit
    /// backs of double-sided ones. Where all of the footprint is inside, the mean is over all of it, whatever
    /// [`GatherOptions::open_only`] says.
    pub fn gather(&self, footprint: &impl Footprint, seed: u32) -> Received {
        self.gather_recalled(footprint, seed, &mut Tape::off())
    }

    /// [`gather`](Self::gather), with records.
    pub(crate) fn gather_recalled(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        tape: &mut Tape,
    ) -> Received {
        // Openness is there in the dark too.
        if self.world.is_dark() && self.wanted.openness.is_none() {
            return Received {
                open: 1.0,
                planes: vec![Plane::default(); self.wanted.planes()].into(),
                ..Received::default()
            };
        }
        let options = &self.options;
        let count = (options.points as usize).clamp(1, MOST_POINTS);
        let points = Points::new(footprint, count);
        let per_point = self.rays_per_point();
        let mut planes = PlaneSums::new(self.wanted);
        let mut records = tape.rays(Topic::Rays, 0);
        let mut lit = LitRays::new(self, footprint.reach(), 0, tape);
        let share = lit.share(|| points.get(), per_point);
        let mut sums = vec![Point::new(footprint.reach(), share); count];
        for (k, sum) in sums.iter_mut().enumerate() {
            // Aligned blocks of a Sobol sequence are well distributed, each by itself and all together.
            let base = k as u32 * per_point;
            planes.first_half = 2 * k < count;
            let rays = (base..base + per_point, seed);
            let point = || &points.get()[k];
            self.indirect(point, rays, sum, &mut planes, (tape, &mut records));
            lit.reach(point, (k as u32, seed), sum, &mut planes);
        }
        tape.keep_rays(Topic::Rays, 0, records);
        let mut rays = u64::from(per_point) * count as u64 + lit.keep(tape);
        // Inside of a wall is no place to see light from, whatever its rays find.
        let covered = options.open_only && sums.iter().any(|s| s.near || s.backs > 0);
        let buried: Vec<bool> = match covered {
            true => (points.get().iter())
                .map(|p| self.world.inside_a_body(p))
                .collect(),
            false => vec![false; count],
        };
        let mut open: Vec<bool> = (sums.iter().zip(&buried))
            .map(|(s, buried)| !buried && !s.inside())
            .collect();
        let in_the_open = open.iter().filter(|&&o| o).count();
        if in_the_open == 0 || !options.open_only {
            open.fill(true);
        }
        let near = sums.iter().any(|s| s.near);
        let estimate = mean_and_spread(&sums, &open);
        if options.edge_points > 0 {
            let more = options.contacts && options.edge_points > count as u32;
            let edge = if in_the_open == 0 {
                // A sliver of light beside a wall counts for little on screen, and for a lot in relative terms.
                rays += u64::from(options.edge_points.saturating_sub(options.points));
                self.anything_open(footprint, seed)
            } else if in_the_open < count {
                more || options.open_only
            } else {
                let parted = options.open_only && near && {
                    // Few points may all lie on one side of a wall.
                    let find = || {
                        let more = Points::new(footprint, count.max(PARTED_POINTS));
                        Parts::find(self.world, more.get(), footprint.reach())
                    };
                    let count = tape.bytes(Topic::PartsFirst, || vec![find().count as u8]);
                    count.first().is_some_and(|n| *n > 1)
                };
                parted || (more && estimate.disagree)
            };
            if edge {
                let mut out = self.gather_edge(footprint, seed, tape);
                out.rays += rays;
                if in_the_open < count {
                    // What the smoothing goes by: it must not take a lumel for whole because a sliver was missed.
                    out.open = out.open.min(1.0 - 1.0 / count as f32);
                }
                return out;
            }
        }
        let mut planes = planes.finish();
        let (direct, place) = self.direct_light(
            footprint,
            &points,
            &open,
            seed,
            (
                &options.direct,
                &Known {
                    light: luminance(estimate.mean),
                    look: 0,
                },
            ),
            &mut planes,
            tape,
        );
        rays += u64::from(direct.rays);
        // The light is of what is open, the place of all.
        let place = match open.contains(&false) {
            true => Place::of(points.get()),
            false => place,
        };
        let dark = self.is_dark(luminance(direct.irradiance + estimate.mean));
        let open = match in_the_open {
            0 if !buried.contains(&true) && !Point::shut(sums.iter(), dark) => 1.0,
            n => n as f32 / count as f32,
        };
        // As the ends of things that reach through a room's shell; but also what lies in the shade of a lamp without anything to bounce off. Only a
        // wall between it and its neighbours tells ([`fill_hidden`](crate::walls::fill_hidden)).
        let lost = options.open_only && near && dark && Point::in_the_void(sums.iter());
        Received {
            near,
            behind: lost || Point::dark_shares(sums.iter())[0] >= BEHIND,
            ..received(footprint, place, direct, &estimate, open, rays, planes)
        }
    }

    /// Direct light alone; the rest comes from neighbours. The footprint lies in the open, and nothing is near.
    pub(crate) fn gather_direct(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        indirect: &Between,
        tape: &mut Tape,
    ) -> Received {
        let options = &self.options;
        let points = Points::new(footprint, (options.points as usize).clamp(1, MOST_POINTS));
        let mut planes = vec![Plane::default(); self.wanted.planes()];
        for (plane, [all, first]) in planes.iter_mut().zip(&indirect.planes) {
            (plane.indirect, plane.first_half) = (*all, *first);
        }
        let known = Known {
            light: luminance(indirect.indirect),
            look: 0,
        };
        let open = vec![true; points.count];
        let (direct, place) = self.direct_light(
            footprint,
            &points,
            &open,
            seed,
            (&options.direct, &known),
            &mut planes,
            tape,
        );
        let rays = u64::from(direct.rays);
        let estimate = Estimate {
            mean: indirect.indirect,
            first_half: indirect.first_half,
            variance: indirect.variance,
            disagree: false,
        };
        received(footprint, place, direct, &estimate, 1.0, rays, planes)
    }

    /// All light from neighbours, `direct` too, where shadow rays from the footprint's middle to lamps find what they found. `None` where they do not.
    pub(crate) fn gather_nothing(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        (indirect, direct): (&Between, DirectBetween),
    ) -> Option<Received> {
        let point = footprint.fallback();
        let light = luminance(direct.irradiance + indirect.indirect);
        let (least, expected) = (MATTERS * light, [direct.lit, direct.hidden]);
        let rays = (self.direct).lamps_seen_as(&point, expected, least, seed)?;
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
            error: (indirect.variance + direct.variance).sqrt(),
            indirect_variance: indirect.variance,
            position: point.position,
            normal: point.normal,
            size: footprint.size(),
            open: 1.0,
            rays: rays.into(),
            lit: direct.lit,
            hidden: direct.hidden,
            planes,
            ..Received::default()
        })
    }

    /// The same with `times` as many gathering rays as [`gather`](Self::gather) casts, of which `first` has the first `done` times: powers of two.
    pub(crate) fn gather_more(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        first: &Received,
        done: u32,
        times: u32,
        tape: &mut Tape,
    ) -> Received {
        let count = (self.options.points as usize).clamp(1, MOST_POINTS);
        let per_point = self.rays_per_point();
        // On with the sequences, of points and of directions both.
        let points = Points::new(footprint, count * times as usize);
        let count = count * done as usize;
        let mut planes = PlaneSums::new(self.wanted);
        let start = count as u32 * per_point;
        let mut records = tape.rays(Topic::Rays, start);
        let mut lit = LitRays::new(self, footprint.reach(), start, tape);
        let share = lit.share(|| &points.get()[count..], per_point);
        let mut sums = vec![Point::new(0.0, share); points.count - count];
        let most = sums.len();
        for (k, sum) in sums.iter_mut().enumerate() {
            let base = (count + k) as u32 * per_point;
            planes.first_half = 2 * k < most;
            let rays = (base..base + per_point, seed);
            let point = || &points.get()[count + k];
            self.indirect(point, rays, sum, &mut planes, (tape, &mut records));
            lit.reach(point, ((count + k) as u32, seed), sum, &mut planes);
        }
        tape.keep_rays(Topic::Rays, start, records);
        let shadow_rays = lit.keep(tape);
        let more = mean_and_spread(&sums, &vec![true; sums.len()]);
        let direct_variance = (first.error * first.error - first.indirect_variance).max(0.0);
        let a = done as f32 / times as f32;
        let b = 1.0 - a;
        let variance = a * a * first.indirect_variance + b * b * more.variance;
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
            indirect_variance: variance,
            error: (direct_variance + variance).sqrt(),
            rays: first.rays + sums.len() as u64 * u64::from(per_point) + shadow_rays,
            ..first.clone()
        }
    }

    fn rays_per_point(&self) -> u32 {
        (self.options.rays / self.options.points.max(1)).max(1)
    }

    /// Direct light once more, with as many points as a penumbra gets for the lights of `look`: for footprints next to one that the edges of
    /// their shadows cross, which may cut a corner.
    pub(crate) fn refine_direct(
        &self,
        footprint: &impl Footprint,
        seed: u32,
        first: &Received,
        look: u32,
        tape: &mut Tape,
    ) -> Received {
        let points = Points::new(footprint, self.options.points as usize);
        let options = &self.options.direct;
        let known = Known {
            light: luminance(first.indirect),
            look,
        };
        let open = vec![true; points.count];
        let mut planes = first.planes.clone();
        let (direct, _) = self.direct_light(
            footprint,
            &points,
            &open,
            seed,
            (options, &known),
            &mut planes,
            tape,
        );
        Received {
            planes,
            direct: direct.irradiance,
            error: (first.indirect_variance + direct.variance).sqrt(),
            direct_doubt: direct.doubt,
            rays: first.rays + u64::from(direct.rays),
            edge: shadow(direct.mixed),
            mixed: direct.mixed,
            lit: direct.lit,
            hidden: direct.hidden,
            looked: first.looked | look,
            ..first.clone()
        }
    }

    /// Whether so much irradiance (luminance) is none.
    pub(crate) fn is_dark(&self, light: f32) -> bool {
        light <= std::f32::consts::PI * self.dim
    }

    /// Casts the gathering rays of `samples` from a point, or takes them from records.
    pub(crate) fn indirect<'p>(
        &self,
        point: impl Fn() -> &'p SurfacePoint,
        (samples, seed): (std::ops::Range<u32>, u32),
        out: &mut Point,
        planes: &mut PlaneSums,
        (tape, records): (&mut Tape, &mut RayTape),
    ) {
        for i in samples {
            out.rays += 1;
            let toward = || {
                let s = sample_4d(i, 0, seed);
                cosine_hemisphere(point().normal, s[0], s[1])
            };
            let bounds = [out.reach, TOUCHING * out.reach];
            if let RayTape::Read(bytes) = records {
                let places = Retrace::new(self.world, &point, &toward, (i, seed));
                match self.again(bytes, (bounds, out.share), places, &mut planes.of_ray, tape) {
                    Some(ray) => {
                        tape.taken += 1;
                        let ray = self.count(ray, out);
                        if !planes.is_empty() {
                            let direction = toward();
                            let cos = point().normal.dot(direction);
                            planes.add(ray.radiance, direction, cos, ray.distance);
                        }
                        continue;
                    }
                    None => {
                        planes.of_ray.fill(Vec3::ZERO);
                        tape.cast += 1;
                    }
                }
            }
            let (p, direction) = (point(), toward());
            // An interpolated normal's hemisphere dips below the face itself: nothing arrives from there.
            let ray = if p.geometric.dot(direction) <= 0.0 {
                Ray::Below
            } else {
                let groups = &mut planes.of_ray;
                let found = if let RayTape::Write(_) = records {
                    self.arriving_noted(
                        p,
                        direction,
                        (i, seed, out.share),
                        groups,
                        records,
                        (bounds, tape.exact),
                    )
                } else {
                    self.arriving(p, direction, (i, seed, out.share), groups, &mut Deaf)
                };
                found.map_or(Ray::Black, Ray::Found)
            };
            if let (RayTape::Write(bytes), Ray::Below) = (&mut *records, &ray) {
                Listening::new().0.write(bounds, false, bytes);
            }
            let ray = self.count(ray, out);
            if !planes.is_empty() {
                planes.add(
                    ray.radiance,
                    direction,
                    p.normal.dot(direction),
                    ray.distance,
                );
            }
        }
    }

    /// Takes what a ray found into account.
    #[inline]
    fn count(&self, ray: Ray, out: &mut Point) -> Found {
        match ray {
            Ray::Below => Found::default(),
            Ray::Black => {
                out.black += 1;
                out.backs += 1;
                out.void += 1;
                out.near = true;
                Found::default()
            }
            Ray::Found(found) => {
                out.add(found.radiance);
                out.backs += u32::from(found.back);
                out.near |= found.distance < out.reach;
                let light = luminance(found.radiance);
                let unlit =
                    self.options.open_only && found.back && light <= self.dim && !found.left_out;
                let touching = self.options.open_only
                    && found.distance < TOUCHING * out.reach
                    && light <= SHADE / DIM * self.dim;
                out.unlit += u32::from(touching || unlit);
                let lost = found.distance == f32::INFINITY && found.radiance == Vec3::ZERO;
                out.void += u32::from(unlit || lost);
                found
            }
        }
    }

    /// [`arriving`](Self::arriving), recorded.
    fn arriving_noted(
        &self,
        p: &SurfacePoint,
        direction: Vec3,
        ray: (u32, u32, f32),
        groups: &mut [Vec3],
        records: &mut RayTape,
        (bounds, exact): ([f32; 2], bool),
    ) -> Option<Found> {
        let mut notes = Listening::new();
        let found = self.arriving(p, direction, ray, groups, &mut notes);
        match &found {
            Some(found) => (notes.0.distance, notes.0.back) = (found.distance, found.back),
            None => notes.0.end = End::Black,
        }
        if let RayTape::Write(bytes) = records {
            notes.0.write(bounds, exact, bytes);
        }
        found
    }

    /// What arrives at `p` from `direction`; `None` from a black back face. Light is added to `groups` too, unless that is empty.
    ///
    /// What a ray hits far away is read from the solution. What it hits within an element's size ([`GatherOptions::near`]) is not: there one value stands for
    /// places that differ as much as those of the gather itself (the inside of a corner, the gap behind a picture). There the ray goes on as a path,
    /// with direct light by a shadow ray of its own (after Jensen, *Global illumination using photon maps*, 1996, who does so for near hits of his
    /// final gather).
    fn arriving<N: Notes>(
        &self,
        p: &SurfacePoint,
        direction: Vec3,
        (i, seed, share): (u32, u32, f32),
        groups: &mut [Vec3],
        notes: &mut N,
    ) -> Option<Found> {
        let (mut point, mut direction) = (*p, direction);
        let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        let (mut distance, mut back) = (f32::INFINITY, false);
        let mut left_out = false;
        for bounce in 0.. {
            let (found, tint) = self.world.incoming(point.origin, direction);
            throughput *= tint;
            if N::ON && tint != Vec3::ONE {
                notes.lose();
            }
            let hit = match found {
                Incoming::Escaped => {
                    let sky = throughput * self.world.sky.radiance(direction);
                    add(sky, self.world.sky_group(), &mut sum, groups);
                    notes.end(Some(End::Escaped((bounce > 0).then_some(direction))));
                    break;
                }
                Incoming::Black if bounce == 0 => return None,
                Incoming::Black => {
                    notes.end(Some(End::Stopped));
                    break;
                }
                Incoming::Surface(hit) => hit,
            };
            if bounce == 0 {
                (distance, back) = (hit.t, hit.back);
            }
            let at = point.origin + direction * hit.t;
            let random = hash_u32(seed ^ i ^ (bounce << 24));
            let edge = self.solution.cut.patch_edge(hit.triangle);
            let near = self.options.near * NEAR[bounce as usize] * edge;
            let far = hit.t > LitElements::FROM * edge;
            let of = self.of_hit(far, bounce, hit.triangle, share);
            if bounce == MOST_NEAR_BOUNCES || hit.t > near {
                let (solution, world) = (self.solution, self.world);
                let direct = &self.direct;
                let sent = if N::ON {
                    let (sent, seen) = solution
                        .radiance_noted(world, direct, &hit, at, random, of, throughput, groups);
                    notes.end(seen.map(End::Far));
                    sent
                } else if groups.is_empty() {
                    let mut sent = solution.radiance_sent(world, direct, &hit, at, random, of);
                    sent.light *= throughput;
                    sent
                } else {
                    solution
                        .radiance_by_group(world, direct, &hit, at, random, of, throughput, groups)
                };
                sum += sent.light;
                left_out = sent.left_out;
                break;
            }
            point = self
                .world
                .surface_point(hit.triangle, hit.u, hit.v, hit.back, false);
            let glow = self.world.gathered_emission(hit.triangle, hit.u, hit.v);
            if glow != Vec3::ZERO {
                let group = self.world.emission_group(hit.triangle);
                add(throughput * glow, group, &mut sum, groups);
            }
            throughput *= self.world.reflectance(hit.triangle, hit.u, hit.v);
            let cut = &self.solution.cut;
            let (direct, group) = match cut.locate(hit.triangle, at, hit.back) {
                Some(place) if N::ON => {
                    let patch = place.patch;
                    let (direct, group, drawn) =
                        self.direct.sample_on_noted(cut, patch, &point, random);
                    notes.near(patch.0, Shade::of(self.world, &hit), drawn);
                    (direct, group)
                }
                Some(place) => self.direct.sample_on(cut, place.patch, &point, random),
                None => {
                    notes.lose();
                    self.direct.sample_one(&point, random)
                }
            };
            let reflected = throughput * direct * std::f32::consts::FRAC_1_PI;
            add(reflected, group, &mut sum, groups);
            let [u, v] = sample_2d(i, 40 + bounce, seed);
            direction = cosine_hemisphere(point.normal, u, v);
            if point.geometric.dot(direction) <= 0.0 {
                notes.end(Some(End::Stopped));
                break;
            }
        }
        Some(Found {
            radiance: sum,
            distance,
            back,
            left_out,
        })
    }

    /// What of the light of a hit counts, after so many bounces: lit elements' is sampled besides from where rays are gathered, but not where light passes
    /// through them.
    #[inline]
    pub(crate) fn of_hit(&self, far: bool, bounce: u32, triangle: u32, share: f32) -> Reflected {
        match far {
            true if bounce == 0 && !self.world.lets_light_through(triangle) => {
                Reflected::Afar(share)
            }
            true => Reflected::Afar(0.0),
            false => Reflected::All,
        }
    }

    /// Direct light on the points that are open, and where the footprint is.
    #[allow(
        clippy::too_many_arguments,
        reason = "a footprint, and all that was found there"
    )]
    pub(crate) fn direct_light<F: Footprint>(
        &self,
        footprint: &F,
        points: &Points<F>,
        open: &[bool],
        seed: u32,
        (options, known): (&DirectOptions, &Known),
        planes: &mut [Plane],
        tape: &mut Tape,
    ) -> (DirectEstimate, Place) {
        let key = key_of(open, options.base);
        let mut shadows = tape.shadows(key);
        let valid: OnceCell<Vec<SurfacePoint>> = OnceCell::new();
        let find_valid = || {
            let open = points.get().iter().zip(open).filter(|(_, open)| **open);
            open.map(|(p, _)| *p).collect::<Vec<_>>()
        };
        let count = open.iter().filter(|o| **o).count();
        let all_open = count == points.count;
        let place = Place::find(tape, key, || valid.get_or_init(find_valid));
        let mut stream = 0;
        let mut extra: Vec<SurfacePoint> = Vec::new();
        let point = |i: u32| -> SurfacePoint {
            let i = i as usize;
            if i == 0 {
                return place.first;
            }
            let valid = valid.get_or_init(find_valid);
            if i < count {
                return valid[i];
            }
            // More points than the gather had: go on in the footprint's stream, staying near open ones.
            while extra.len() <= i - count {
                let mut found = None;
                for _ in 0..8 {
                    let c = footprint.candidate(stream + points.count as u32);
                    stream += 1;
                    found =
                        c.filter(|c| all_open || nearest_is_open(points.get(), open, c.position));
                    if found.is_some() {
                        break;
                    }
                }
                extra.push(found.unwrap_or(valid[extra.len() % count]));
            }
            extra[i - count]
        };
        let mut parts = self.wanted.direct_parts();
        let seed = seed ^ 0x68bc_21eb;
        let size = footprint.size();
        let (direct, shadow_rays) = (&self.direct, &mut shadows);
        let out =
            direct.irradiance_recalled(point, size, seed, options, known, &mut parts, shadow_rays);
        tape.keep_shadows(key, shadows);
        self.wanted.place_direct(&parts, planes);
        (out, place)
    }
}

/// The edge of a shadow, where any light's crosses.
fn shadow(mixed: u32) -> Edge {
    if mixed != 0 { Edge::Shadow } else { Edge::None }
}

pub(crate) fn received(
    footprint: &impl Footprint,
    place: Place,
    direct: DirectEstimate,
    indirect: &Estimate,
    open: f32,
    rays: u64,
    planes: Vec<Plane>,
) -> Received {
    Received {
        direct: direct.irradiance,
        indirect: indirect.mean,
        first_half: indirect.first_half,
        error: (indirect.variance + direct.variance).sqrt(),
        indirect_variance: indirect.variance,
        least: None,
        direct_doubt: direct.doubt,
        near: false,
        behind: false,
        position: place.position,
        normal: place.normal,
        size: footprint.size(),
        open,
        rays,
        edge: shadow(direct.mixed),
        mixed: direct.mixed,
        lit: direct.lit,
        hidden: direct.hidden,
        looked: 0,
        planes: planes.into(),
    }
}
