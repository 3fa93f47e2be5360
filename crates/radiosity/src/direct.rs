//! Light that arrives straight from lamps and emissive surfaces.

mod around;
mod cap;
mod choice;
mod lamp_tree;
mod sample;
mod surfaces;
mod tally;
mod terms;

use glam::Vec3;
use mesh_ingest::{Light, LightKind};
use patch_subdivision::Subdivision;

use crate::emitters::{Emitter, Emitters, Parts};
use crate::roles::{MASKS, MaskLamps};
use crate::sampling::{hash_u32, sample_4d};
use crate::sky::SkyCell;
use crate::world::{SurfacePoint, World, luminance};
use choice::Tables;
pub(crate) use lamp_tree::LampTree;
use lamp_tree::Lamps;
use tally::{Mark, Tally};
use terms::{REST, draw_rest};

/// Number of shadow rays per light.
#[derive(Debug, Clone, Copy)]
pub struct DirectOptions {
    /// Sample points, with one shadow ray each, for every light that contributes noticeably.
    pub base: u32,
    /// Sample points if the first ones disagree about visibility, i.e. if a shadow edge crosses the
    /// receiver.
    pub penumbra: u32,
    /// Sample points that get a shadow ray. If they all agree, the rest of `base` is assumed to see
    /// the same. The closed form of a light varies over any receiver, but its visibility varies
    /// only where there is a shadow edge.
    pub scouts: u32,
}

impl DirectOptions {
    /// Casts a shadow ray from every sample point.
    pub const fn every(base: u32, penumbra: u32) -> Self {
        DirectOptions {
            base,
            penumbra,
            scouts: u32::MAX,
        }
    }
}

/// What is known about a receiver before its direct light is computed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Known {
    /// Luminance of the irradiance from everything but direct light. A light that contributes
    /// little in comparison gets few rays.
    pub light: f32,
    /// Lights that get as many shadow rays as in a penumbra, as a bit mask like
    /// [`DirectEstimate::mixed`].
    pub look: u32,
    /// Emissive triangles that are this near to a point and rise less than this above its surface do
    /// not light it, metres.
    pub beside: f32,
}

/// Direct irradiance at a receiver.
#[derive(Debug, Clone, Copy, Default)]
pub struct DirectEstimate {
    /// E, in W/m² or lx.
    pub irradiance: Vec3,
    /// Variance of the luminance of `irradiance` due to sampled visibility, computed as if the
    /// samples were independent. It is an upper bound, because the samples are stratified.
    pub variance: f32,
    /// How much parts of the samples differ, summed over lights whose samples disagree. The first
    /// value is the squared difference between the two halves of a light's samples times their
    /// shares; the second is the same for the two halves of the first half. For independent
    /// samples, the expected values are the variance of the mean and twice that variance.
    /// Stratification makes them smaller.
    pub doubt: [f32; 2],
    /// Number of shadow rays.
    pub rays: u32,
    /// Lights that some sample points see and others do not, as a bit mask: one bit per lamp (from
    /// the 32nd on, lamps share bits with the first ones), and the top bit for emitters and the
    /// bright parts of the sky.
    pub mixed: u32,
    /// Lamps visible from at least one sample point, with the same bits.
    pub lit: u32,
    /// Lamps hidden from at least one sample point, with the same bits.
    pub hidden: u32,
}

/// Optional parts of direct light to record besides its sum. Fields that are empty or `None` are
/// not requested and cost nothing; the others are added to.
#[derive(Debug, Clone, Default)]
pub struct DirectParts {
    /// Irradiance per group of [`LightGroups`](crate::LightGroups).
    pub groups: Vec<Vec3>,
    /// ∫ L dω, and ∫ L ω dω along x, y and z.
    pub moments: Option<[Vec3; 4]>,
    /// Luminance of the irradiance from directional lights: with and without occlusion.
    pub sun: Option<[f32; 2]>,
    /// Irradiance from everything but the lamps that are left out
    /// ([`LampRoles`](crate::LampRoles)). If requested, `moments` leave them out too.
    pub kept: Option<Vec3>,
    /// The lamps of a shadow mask, and the luminance of the irradiance from each: with and without
    /// occlusion.
    pub masks: Option<(MaskLamps, [[f32; 2]; MASKS])>,
}

impl DirectParts {
    /// The channel of light `k` in the shadow mask.
    fn channel_of(&self, k: usize) -> Option<usize> {
        let (lamps, _) = self.masks.as_ref()?;
        lamps.iter().position(|lamp| *lamp == Some(k as u32))
    }
}

/// How a light is recorded.
#[derive(Debug, Clone, Copy, Default)]
struct Kind {
    /// It is a sun.
    sun: bool,
    /// It is a lamp whose direct light is left out.
    left_out: bool,
    /// Its channel in the shadow mask.
    channel: Option<usize>,
}

impl Kind {
    /// The share of the samples that it gets. A mask must be accurate even if the lamp contributes
    /// little.
    fn share(&self, share: f32) -> f32 {
        if self.channel.is_some() { 1.0 } else { share }
    }
}

/// The bit of [`DirectEstimate::mixed`] for emissive surfaces.
const EMITTERS: u32 = 1 << 31;

/// Computes direct light.
///
/// The unoccluded irradiance from each punctual light and each near emissive triangle has a closed
/// form. It is multiplied by the visible share that shadow rays measure. That share is a ratio of
/// sums over the same weights (self-normalized), so a fully visible light is exact and a hidden
/// light is exactly 0.
pub struct DirectLight<'w, 'a> {
    world: &'w World<'a>,
    emitters: &'w Emitters,
    lamps: LampTree,
    tables: Tables,
}

/// A light as seen from one receiver.
enum Term<'e> {
    /// A lamp and its light group.
    Lamp(&'e Light, usize),
    /// A node of the lamp tree, and the probability with which it was chosen to stand for others
    /// besides itself (1 if it does not).
    Lamps(u32, f32),
    /// A cell of the bright part of the sky.
    Sky(&'e SkyCell),
    Triangle(&'e Emitter),
    /// A node of the emitter tree, and the same probability.
    Group(u32, f32),
}

impl<'w, 'a> DirectLight<'w, 'a> {
    /// Direct light from the lamps of `world` and from `emitters`, which must have been collected
    /// from it.
    pub fn new(world: &'w World<'a>, emitters: &'w Emitters) -> Self {
        DirectLight {
            world,
            emitters,
            lamps: LampTree::new(&world.scene.lights, |k| {
                !world.is_masked(k) && !world.leaves_out(k)
            }),
            tables: Tables::default(),
        }
    }

    /// Prepares for [`sample_on`](Self::sample_on) on the patches of `cut`. The tables that hits
    /// choose lights from are kept per patch and take 12 bytes per lamp or group of emitters.
    pub fn on_patches(self, cut: &Subdivision) -> Self {
        DirectLight {
            tables: Tables::new(cut.patches().len()),
            ..self
        }
    }

    /// Whether there are no lights.
    pub(crate) fn is_dark(&self) -> bool {
        self.world.scene.lights.is_empty()
            && self.emitters.is_empty()
            && self.world.bright.is_none()
    }

    /// Mean irradiance over a receiver.
    ///
    /// `point(i)` returns point *i* of the receiver, i < [`DirectOptions::penumbra`]. Every prefix
    /// of the points should cover the receiver evenly. `scale` is the size of the receiver in
    /// metres (0 for a point), and `seed` determines the random numbers.
    pub fn irradiance(
        &self,
        point: impl FnMut(u32) -> SurfacePoint,
        scale: f32,
        seed: u32,
        options: &DirectOptions,
    ) -> DirectEstimate {
        let parts = &mut DirectParts::default();
        self.irradiance_parts(point, scale, seed, options, &Known::default(), parts)
    }

    /// Like [`irradiance`](Self::irradiance), and also records what `parts` requests.
    pub fn irradiance_parts(
        &self,
        mut point: impl FnMut(u32) -> SurfacePoint,
        scale: f32,
        seed: u32,
        options: &DirectOptions,
        known: &Known,
        parts: &mut DirectParts,
    ) -> DirectEstimate {
        let mut out = DirectEstimate::default();
        let lights = &self.world.scene.lights;
        let bright = self.world.bright.as_ref();
        if self.is_dark() {
            return out;
        }
        let first = point(0);
        let mut work = Work {
            point: &mut point,
            first,
            scale,
            beside: known.beside,
            set: 1,
            seed,
            options,
            out: &mut out,
            parts,
            mixed: Vec::new(),
        };
        let (lamps, rest) = self.lamps_of(&first, scale, seed);
        let look = known.look & EMITTERS != 0;
        for (lamps, share) in lamps {
            let Lamps::One(k) = lamps else {
                let term = self.term_of_lamps(lamps);
                self.begin(term, share, EMITTERS, look, Kind::default(), &mut work);
                continue;
            };
            let k = k as usize;
            let bit = 1 << (k % 31);
            let look = known.look & bit != 0;
            let kind = Kind {
                sun: matches!(lights[k].kind, LightKind::Directional { .. }),
                left_out: self.world.leaves_out(k),
                channel: work.parts.channel_of(k),
            };
            let term = self.term_of_lamps(lamps);
            self.begin(term, kind.share(share), bit, look, kind, &mut work);
        }
        if let Some((Lamps::Group(node), chance)) = rest {
            let term = Term::Lamps(node, chance);
            self.begin(term, REST, EMITTERS, look, Kind::default(), &mut work);
        }
        if !self.emitters.is_empty() || bright.is_some() {
            if let Some(bright) = bright {
                let total: f32 = bright.cells.iter().map(|c| c.power).sum();
                for cell in &bright.cells {
                    let share = cell.power / total;
                    let kind = Kind::default();
                    self.begin(Term::Sky(cell), share, EMITTERS, look, kind, &mut work);
                }
            }
            let mut terms = Vec::new();
            self.emitter_nodes(&first, scale, options.base.max(4) as usize * 2, &mut terms);
            let total: f32 = terms.iter().map(|t| t.1).sum();
            let is_group = |id: u32| self.emitters.nodes[id as usize].second != 0;
            let rest = draw_rest(&mut terms, is_group, total, seed ^ 1);
            // Lights are worth fewer samples if other light is strong.
            let worth = (WORTH * total / (total + known.light + work.lit())).min(1.0);
            for (node, weight) in terms {
                let share = worth * weight / total;
                let term = self.term_of_node(node);
                self.begin(term, share, EMITTERS, look, Kind::default(), &mut work);
            }
            if let Some((node, chance)) = rest {
                let (term, share) = (Term::Group(node, chance), worth * REST);
                self.begin(term, share, EMITTERS, look, Kind::default(), &mut work);
            }
        }
        self.look_closer(known.light, work);
        out
    }

    /// Casts a shadow ray from `p` to each lamp whose irradiance could exceed `least` (luminance),
    /// and checks that the result is as `expected`: lamps that should be visible and lamps that
    /// should be hidden, with the bits of [`DirectEstimate::lit`]. Returns the number of rays, or
    /// `None` if a result differs or if the bits are not enough: a lamp is in both masks or in
    /// neither, a lamp has a cookie, or the sky has bright parts.
    pub fn lamps_seen_as(
        &self,
        p: &SurfacePoint,
        expected: [u32; 2],
        least: f32,
        seed: u32,
    ) -> Option<u32> {
        if self.world.bright.is_some() {
            return None;
        }
        let mut rays = 0;
        self.lamps.each_above(p.position, least, |k| {
            let light = &self.world.scene.lights[k as usize];
            // A shadow mask needs every lamp.
            let masked = self.world.is_masked(k as usize);
            let least = if masked { 0.0 } else { least };
            if self.weight_of_lamp(light, p) <= least {
                return Some(());
            }
            // A picture varies between the lumels although all of them see the lamp.
            if light.cookie.is_some() {
                return None;
            }
            let bit = 1 << (k % 31);
            let expected = expected.map(|of| of & bit != 0);
            if expected[0] == expected[1] {
                return None;
            }
            let term = Term::Lamp(light, 0);
            let mut tally = Tally::single();
            let random = sample_4d(k, 2, seed);
            self.sample(&term, None, p, random, &mut tally);
            rays += tally.rays;
            (tally.rays == 0 || tally.seen() == expected).then_some(())
        })?;
        Some(rays)
    }

    /// Whether `point`, which is on `triangle`, sees lamp `k` and receives light from it.
    pub(crate) fn lamp_is_seen(&self, k: usize, point: &SurfacePoint, triangle: u32) -> bool {
        let light = &self.world.scene.lights[k];
        if self.weight_of_lamp(light, point) <= 0.0 {
            return false;
        }
        let term = Term::Lamp(light, 0);
        let mut tally = Tally::single();
        let random = sample_4d(triangle, 3, k as u32);
        self.sample(&term, None, point, random, &mut tally);
        tally.seen()[0]
    }

    /// Unbiased estimate of the direct irradiance at one point with a single shadow ray. One light
    /// is chosen with a probability roughly proportional to its unoccluded irradiance. Also returns
    /// its light group.
    pub fn sample_one(&self, point: &SurfacePoint, seed: u32) -> (Vec3, usize) {
        let mut terms = Vec::new();
        let lights = &self.world.scene.lights;
        for (lamps, rough) in self.lamps.cut(lights, point.position, 0.0) {
            let weight = match lamps {
                Lamps::One(k) => self.weight_of_lamp(&lights[k as usize], point),
                Lamps::Group(_) => rough,
            };
            if weight > 0.0 {
                terms.push((self.term_of_lamps(lamps), weight));
            }
        }
        for cell in self.world.bright.iter().flat_map(|b| &b.cells) {
            // A cell that straddles the horizon must keep some probability.
            let cos = point.normal.dot(cell.direction);
            if cos > -0.2 {
                terms.push((Term::Sky(cell), cell.power * cos.max(0.05)));
            }
        }
        self.emitter_terms(point, 0.0, 8, &mut terms);
        let total: f32 = terms.iter().map(|t| t.1).sum();
        if total <= 0.0 {
            return (Vec3::ZERO, 0);
        }
        let mut left = hash_u32(seed) as f32 / 4294967296.0 * total;
        let mut chosen = terms.len() - 1;
        for (k, t) in terms.iter().enumerate() {
            if left < t.1 {
                chosen = k;
                break;
            }
            left -= t.1;
        }
        let (term, weight) = terms.swap_remove(chosen);
        let mut tally = Tally::single();
        self.sample(&term, None, point, sample_4d(0, 1, seed), &mut tally);
        (tally.lit() * (total / weight), tally.group)
    }

    /// Takes the first samples of a light, and adds it to the sum unless they disagree about
    /// visibility. `share` is roughly the light's share of the total, which determines how many
    /// samples it gets.
    fn begin<'t, P: FnMut(u32) -> SurfacePoint>(
        &self,
        term: Term<'t>,
        share: f32,
        bit: u32,
        look: bool,
        kind: Kind,
        work: &mut Work<'_, 't, P>,
    ) {
        // Up to four lights of equal strength get the full number of points each. More lights share
        // four times that number by their contribution, so that a hundred emissive triangles cost
        // little more than four.
        let part = (4.0 * share).min(1.0);
        let is_random = self.is_random(&term);
        // With one point and one direction, all samples are the same.
        let part = if is_random || work.scale > 0.0 {
            part
        } else {
            0.0
        };
        let base = ((work.options.base as f32 * part).ceil() as u32).max(1);
        let most = ((work.options.penumbra as f32 * part).ceil() as u32).max(base);
        // For area lights, a partial shadow is seen from many points or from none.
        let scouts = if is_random {
            u32::MAX
        } else {
            ((work.options.scouts as f32 * part).ceil() as u32).max(1)
        };
        let groups = match term {
            Term::Group(..) | Term::Lamps(..) => self.world.group_count(),
            _ => 1,
        };
        // Lights with few points start at different ones; otherwise all of them would be seen from
        // the same corner of the receiver. Aligned blocks of a Sobol sequence are well distributed.
        let whole = work.options.base.max(1);
        let shift = if base < whole {
            work.set.wrapping_mul(base.next_power_of_two()) % whole
        } else {
            0
        };
        let mut tally = Tally::new(work.parts, groups, kind);
        // Lamps of a group have no common closed form.
        tally.plainly = matches!(term, Term::Lamps(..));
        tally.beside = work.beside;
        let mut light = Started {
            is_random,
            tally,
            term,
            parts: None,
            bit,
            set: work.set,
            shift,
            taken: 0,
            marks: Default::default(),
            most,
        };
        work.set += 1;
        let [target, scouts] = if look {
            [most, u32::MAX]
        } else {
            [base, scouts]
        };
        self.go_on(&mut light, target, scouts, work);
        if light.tally.mixed() && light.taken < most {
            work.mixed.push(light);
        } else {
            work.finish(light);
        }
    }

    /// Samples a light until it has `target` samples. The first `scouts` samples that count have a
    /// shadow ray, and the others only if these disagree.
    fn go_on<P: FnMut(u32) -> SurfacePoint>(
        &self,
        light: &mut Started,
        target: u32,
        scouts: u32,
        work: &mut Work<P>,
    ) {
        let whole = work.options.base.max(1);
        // The contributions of a group's parts are computed once for all points of the receiver.
        if let (Term::Group(node, _), None) = (&light.term, &light.parts) {
            let parts = self.emitters.parts(*node, &work.first, work.scale);
            light.parts = Some(Box::new(parts));
        }
        while light.taken < target {
            let n = light.taken;
            if n.is_power_of_two() {
                light.marks = [light.marks[1], light.tally.mark(n)];
            }
            light.tally.assume(scouts);
            let at = if n < whole {
                (n + light.shift) % whole
            } else {
                n
            };
            let p = (work.point)(at);
            let random = if light.is_random {
                sample_4d(n, light.set, work.seed)
            } else {
                [0.0; 4]
            };
            let parts = light.parts.as_deref();
            self.sample(&light.term, parts, &p, random, &mut light.tally);
            light.taken += 1;
        }
    }

    /// Takes more samples of the lights whose first samples disagree, because a shadow edge crosses
    /// the receiver. The number of samples grows with the light's share of all arriving light, of
    /// which `beside` is known to come from elsewhere.
    fn look_closer<P: FnMut(u32) -> SurfacePoint>(&self, beside: f32, mut work: Work<P>) {
        let total = (beside + work.lit()).max(1e-30);
        let mixed = std::mem::take(&mut work.mixed);
        for mut light in mixed {
            let [_, full] = light.tally.luminances(light.taken);
            let share = light.tally.kind.share(WORTH * full / total);
            let worth = share.min(1.0) * light.most as f32;
            let target = (worth.ceil() as u32).clamp(light.taken, light.most);
            self.go_on(&mut light, target, u32::MAX, &mut work);
            work.finish(light);
        }
    }
}

/// Scales the share of a penumbra's points that a light gets. The share is this factor times the
/// light's share of the total unoccluded irradiance, so a light that could contribute half of it
/// gets all points.
const WORTH: f32 = 2.0;

/// A light that has been sampled.
struct Started<'t> {
    term: Term<'t>,
    /// The parts of a group, once they have been looked up. In a box, as there are many bytes.
    parts: Option<Box<Parts>>,
    is_random: bool,
    /// The light's bit in [`DirectEstimate::mixed`].
    bit: u32,
    /// The set of random numbers, and the index of the first point.
    set: u32,
    shift: u32,
    /// Number of samples taken, and the maximum.
    taken: u32,
    most: u32,
    /// The sums after a quarter and after half of the samples, or after the nearest powers of two.
    marks: [Mark; 2],
    tally: Tally,
}

/// The state of the computation at one receiver.
struct Work<'r, 't, P> {
    /// The points of the receiver, the first of them, and its size in metres.
    point: &'r mut P,
    first: SurfacePoint,
    scale: f32,
    /// See [`Known::beside`].
    beside: f32,
    /// Set of random numbers for the next light.
    set: u32,
    seed: u32,
    options: &'r DirectOptions,
    out: &'r mut DirectEstimate,
    parts: &'r mut DirectParts,
    /// Lights that need more samples.
    mixed: Vec<Started<'t>>,
}

impl<P> Work<'_, '_, P> {
    /// Luminance of the light that has arrived so far.
    fn lit(&self) -> f32 {
        let mixed: f32 = (self.mixed.iter())
            .map(|l| l.tally.luminances(l.taken)[0])
            .sum();
        luminance(self.out.irradiance) + mixed
    }

    fn finish(&mut self, light: Started) {
        let [lit, hidden] = light.tally.seen();
        if light.tally.mixed() {
            self.out.mixed |= light.bit;
        }
        // All emitters share a bit, so there visible and hidden samples are often mixed.
        if light.bit != EMITTERS {
            self.out.lit |= if lit { light.bit } else { 0 };
            self.out.hidden |= if hidden { light.bit } else { 0 };
        }
        (light.tally).finish(light.taken, &light.marks, self.out, self.parts);
    }
}

#[cfg(test)]
mod tests;
