//! Light that arrives straight from lamps and emissive surfaces.

mod around;
mod cap;
mod choice;
mod sample;
mod surfaces;
mod tally;
mod terms;

use glam::Vec3;
use mesh_ingest::{Light, LightKind};
use patch_subdivision::Subdivision;

use crate::emitters::{Emitter, Emitters, Few};
use crate::sampling::{hash_u32, sample_4d};
use crate::sky::SkyCell;
use crate::world::{SurfacePoint, World, luminance};
use choice::Tables;
use tally::{Mark, Tally};

/// How many shadow rays a light gets.
#[derive(Debug, Clone, Copy)]
pub struct DirectOptions {
    /// Points (with one shadow ray each) for every light that matters.
    pub base: u32,
    /// Points where the first ones disagree about visibility: a shadow's edge crosses the receiver.
    pub penumbra: u32,
    /// Points that have a shadow ray. Where these agree, the rest of `base` is taken to see what
    /// they saw: a light's closed form varies over a receiver in any case, what is seen of it only
    /// where a shadow's edge runs.
    pub scouts: u32,
}

impl DirectOptions {
    /// A shadow ray for every point.
    pub const fn every(base: u32, penumbra: u32) -> Self {
        DirectOptions {
            base,
            penumbra,
            scouts: u32::MAX,
        }
    }
}

/// What is known of a receiver before its direct light is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Known {
    /// Luminance of the irradiance that arrives beside direct light. A light that brings next to
    /// nothing beside the rest is worth few rays.
    pub light: f32,
    /// Lights that get a shadow ray at as many points as a penumbra has, as
    /// [`DirectEstimate::mixed`] names them.
    pub look: u32,
}

/// Direct irradiance at a receiver.
#[derive(Debug, Clone, Copy, Default)]
pub struct DirectEstimate {
    /// E, W/m² or lx.
    pub irradiance: Vec3,
    /// Variance of the luminance of `irradiance` due to sampled visibility, as if samples were
    /// independent: an upper bound, since they are stratified.
    pub variance: f32,
    /// How far parts of the samples differ, summed over lights whose samples disagree: the squared
    /// difference between the two halves of a light's samples times their shares of them, and the
    /// same of the two halves of the first half. Of independent samples the first is expected to be
    /// the variance of the mean, the second twice that; what it is less by is what stratification
    /// brings.
    pub doubt: [f32; 2],
    /// Shadow rays cast.
    pub rays: u32,
    /// Lights that some points see and others do not: a bit for each lamp (the 32nd and on share
    /// with the first), the top bit for emitters and the bright parts of the sky.
    pub mixed: u32,
    /// Lamps that some point sees, and lamps that are hidden from one, by the same bits.
    pub lit: u32,
    /// See `lit`.
    pub hidden: u32,
}

/// What is to be kept of direct light beside its sum. What is empty or `None` is not asked for and
/// costs nothing; the rest is added to.
#[derive(Debug, Clone, Default)]
pub struct DirectParts {
    /// Irradiance per group of [`LightGroups`](crate::LightGroups).
    pub groups: Vec<Vec3>,
    /// ∫ L dω, and ∫ L ω dω along x, y and z.
    pub moments: Option<[Vec3; 4]>,
    /// Luminance of the irradiance from directional lights: what arrives, and what would if nothing
    /// were in the way.
    pub sun: Option<[f32; 2]>,
}

/// The bit of [`DirectEstimate::mixed`] that stands for emissive surfaces.
const EMITTERS: u32 = 1 << 31;

/// Computes direct light.
///
/// Each punctual light and each near emissive triangle is computed unoccluded in closed form, and
/// multiplied with the share of it that shadow rays find visible. The share is a ratio of sums over
/// the same weights (self-normalised), so a fully visible light is exact and a hidden one exactly
/// 0.
pub struct DirectLight<'w, 'a> {
    world: &'w World<'a>,
    emitters: &'w Emitters,
    tables: Tables,
}

/// A light as one receiver sees it.
enum Term<'e> {
    /// A lamp and its group.
    Lamp(&'e Light, usize),
    /// Some of the bright part of the sky.
    Sky(&'e SkyCell),
    Triangle(&'e Emitter),
    /// A node of the emitters' tree.
    Group(u32),
}

impl<'w, 'a> DirectLight<'w, 'a> {
    /// Direct light of `world`'s lamps and of `emitters`, which were collected from it.
    pub fn new(world: &'w World<'a>, emitters: &'w Emitters) -> Self {
        DirectLight {
            world,
            emitters,
            tables: Tables::default(),
        }
    }

    /// The same, ready for [`sample_on`](Self::sample_on) the patches of `cut`. What hits choose
    /// from is kept per patch: 12 bytes a lamp or group of emitters.
    pub fn on_patches(self, cut: &Subdivision) -> Self {
        DirectLight {
            tables: Tables::new(cut.patches().len()),
            ..self
        }
    }

    /// Whether there is no light to compute.
    pub(crate) fn is_dark(&self) -> bool {
        self.world.scene.lights.is_empty()
            && self.emitters.is_empty()
            && self.world.bright.is_none()
    }

    /// Mean irradiance over a receiver.
    ///
    /// `point(i)` gives point *i* of the receiver, i < [`DirectOptions::penumbra`]; any prefix
    /// should cover it evenly. `scale` is the receiver's size in metres (0 for a point) and `seed`
    /// decides the random numbers.
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

    /// [`irradiance`](Self::irradiance), of which `parts` keeps what it asks for.
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
            set: 1,
            seed,
            options,
            out: &mut out,
            parts,
            mixed: Vec::new(),
        };
        let shares = self.shares_of_lamps(&first, scale);
        for (k, light) in lights.iter().enumerate() {
            let share = shares.as_ref().map_or(1.0, |s| s[k]);
            if share > 0.0 {
                let term = Term::Lamp(light, self.world.lamp_group(k));
                let sun = matches!(light.kind, LightKind::Directional { .. });
                let bit = 1 << (k % 31);
                let look = known.look & bit != 0;
                self.begin(term, share, bit, look, sun, &mut work);
            }
        }
        if !self.emitters.is_empty() || bright.is_some() {
            let look = known.look & EMITTERS != 0;
            if let Some(bright) = bright {
                let total: f32 = bright.cells.iter().map(|c| c.power).sum();
                for cell in &bright.cells {
                    let share = cell.power / total;
                    self.begin(Term::Sky(cell), share, EMITTERS, look, false, &mut work);
                }
            }
            let mut terms = Vec::new();
            self.emitter_nodes(&first, scale, options.base.max(4) as usize * 2, &mut terms);
            let total: f32 = terms.iter().map(|t| t.1).sum();
            // Beside strong other light they are worth less.
            let worth = (WORTH * total / (total + known.light + work.lit())).min(1.0);
            for (node, weight) in terms {
                let share = worth * weight / total;
                let term = self.term_of_node(node);
                self.begin(term, share, EMITTERS, look, false, &mut work);
            }
        }
        self.look_closer(known.light, work);
        out
    }

    /// Whether a shadow ray from `p` to each lamp that would bring more than `least` (luminance of
    /// the irradiance) meets what is `expected`: lamps that are seen and lamps that are not, by the
    /// bits of [`DirectEstimate::lit`]. Gives the rays that it took; `None` where one does not, and
    /// where bits cannot tell: a lamp that is in both or neither, or a sky with bright parts.
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
        for (k, light) in self.world.scene.lights.iter().enumerate() {
            if self.weight_of_lamp(light, p) <= least {
                continue;
            }
            let bit = 1 << (k % 31);
            let expected = expected.map(|of| of & bit != 0);
            if expected[0] == expected[1] {
                return None;
            }
            let term = Term::Lamp(light, 0);
            let mut tally = Tally::single();
            let random = sample_4d(k as u32, 2, seed);
            self.sample(&term, None, p, random, &mut tally);
            rays += tally.rays;
            if tally.rays > 0 && tally.seen() != expected {
                return None;
            }
        }
        Some(rays)
    }

    /// Unbiased estimate of the direct irradiance at one point with a single shadow ray: one light
    /// is drawn, about in proportion to what it would bring unoccluded. Also says of which group it
    /// was.
    pub fn sample_one(&self, point: &SurfacePoint, seed: u32) -> (Vec3, usize) {
        let mut terms = Vec::new();
        for (k, light) in self.world.scene.lights.iter().enumerate() {
            let weight = self.weight_of_lamp(light, point);
            if weight > 0.0 {
                terms.push((Term::Lamp(light, self.world.lamp_group(k)), weight));
            }
        }
        for cell in self.world.bright.iter().flat_map(|b| &b.cells) {
            // A cell that straddles the horizon keeps a chance.
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

    /// Takes a light's first samples, and adds it to what arrives unless they disagree about what
    /// gets through. `share` is roughly its part of the light, which decides how much work it is
    /// worth.
    #[allow(
        clippy::too_many_arguments,
        reason = "a light, and all that decides how it is begun"
    )]
    fn begin<'t, P: FnMut(u32) -> SurfacePoint>(
        &self,
        term: Term<'t>,
        share: f32,
        bit: u32,
        look: bool,
        sun: bool,
        work: &mut Work<'_, 't, P>,
    ) {
        // Up to four lights of equal strength get the whole number of points each; more share four
        // times that number, by what they bring, so that a hundred emissive triangles cost little
        // more than four.
        let part = (4.0 * share).min(1.0);
        let is_random = self.is_random(&term);
        // One point, one direction: all samples are the same.
        let part = if is_random || work.scale > 0.0 {
            part
        } else {
            0.0
        };
        let base = ((work.options.base as f32 * part).ceil() as u32).max(1);
        let most = ((work.options.penumbra as f32 * part).ceil() as u32).max(base);
        // Half shadows of lights that have an extent are seen by many points or not at all.
        let scouts = if is_random {
            u32::MAX
        } else {
            ((work.options.scouts as f32 * part).ceil() as u32).max(1)
        };
        let groups = match term {
            Term::Group(..) => self.world.group_count(),
            _ => 1,
        };
        // Lights that get few points start at different ones: else all would be seen from the same
        // corner of the receiver. Aligned blocks of a Sobol sequence are well distributed.
        let whole = work.options.base.max(1);
        let shift = if base < whole {
            work.set.wrapping_mul(base.next_power_of_two()) % whole
        } else {
            0
        };
        let tally = Tally::new(work.parts, groups, sun);
        let mut light = Started {
            is_random,
            tally,
            term,
            few: None,
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

    /// Takes samples of a light until it has `target`, of which the first `scouts` that count have
    /// a shadow ray, and the others too if these disagree.
    fn go_on<P: FnMut(u32) -> SurfacePoint>(
        &self,
        light: &mut Started,
        target: u32,
        scouts: u32,
        work: &mut Work<P>,
    ) {
        let whole = work.options.base.max(1);
        // What each of a few emitters brings, found once for all points of the receiver.
        if let (Term::Group(node), None) = (&light.term, &light.few) {
            light.few = Some(self.emitters.few(*node, &work.first, work.scale));
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
            let few = light.few.as_ref().and_then(Option::as_ref);
            self.sample(&light.term, few, &p, random, &mut light.tally);
            light.taken += 1;
        }
    }

    /// Lights of which the first samples disagree: a shadow's edge crosses the receiver. They get
    /// more samples, the more the larger their part in all light that arrives, of which `beside` is
    /// known to come from elsewhere.
    fn look_closer<P: FnMut(u32) -> SurfacePoint>(&self, beside: f32, mut work: Work<P>) {
        let total = (beside + work.lit()).max(1e-30);
        let mixed = std::mem::take(&mut work.mixed);
        for mut light in mixed {
            let [_, full] = light.tally.luminances(light.taken);
            let worth = (WORTH * full / total).min(1.0) * light.most as f32;
            let target = (worth.ceil() as u32).clamp(light.taken, light.most);
            self.go_on(&mut light, target, u32::MAX, &mut work);
            work.finish(light);
        }
    }
}

/// A light of which this part of what arrives would come, if nothing were in the way, gets one part
/// in so many of a penumbra's points; one that would bring half of it, all of them.
const WORTH: f32 = 2.0;

/// A light of which samples were taken.
struct Started<'t> {
    term: Term<'t>,
    /// A group's emitters, once that was asked for.
    few: Option<Option<Few>>,
    is_random: bool,
    /// What stands for it in [`DirectEstimate::mixed`].
    bit: u32,
    /// Its set of random numbers, and the point that it starts at.
    set: u32,
    shift: u32,
    /// Samples taken, and the most that it gets.
    taken: u32,
    most: u32,
    /// The sums after a quarter and after half of the samples, or what powers of two come nearest
    /// to that.
    marks: [Mark; 2],
    tally: Tally,
}

/// What is under way at one receiver.
struct Work<'r, 't, P> {
    /// Points of the receiver, the first of them, and its size in metres.
    point: &'r mut P,
    first: SurfacePoint,
    scale: f32,
    /// Set of random numbers of the next light.
    set: u32,
    seed: u32,
    options: &'r DirectOptions,
    out: &'r mut DirectEstimate,
    parts: &'r mut DirectParts,
    /// Lights to be looked at more closely.
    mixed: Vec<Started<'t>>,
}

impl<P> Work<'_, '_, P> {
    /// Luminance of what arrives from all lights so far.
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
        // Emitters share a bit, and are seen here and hidden there all the time.
        if light.bit != EMITTERS {
            self.out.lit |= if lit { light.bit } else { 0 };
            self.out.hidden |= if hidden { light.bit } else { 0 };
        }
        (light.tally).finish(light.taken, &light.marks, self.out, self.parts);
    }
}

#[cfg(test)]
mod tests;
