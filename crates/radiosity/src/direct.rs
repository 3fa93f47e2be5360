//! Light that arrives straight from lamps and emissive surfaces.

mod around;
mod cap;
mod sample;
mod surfaces;
mod tally;
mod terms;

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use crate::emitters::{Emitter, Emitters};
use crate::sampling::{hash_u32, sample_4d};
use crate::sky::SkyCell;
use crate::world::{SurfacePoint, World};
use tally::Tally;

/// How many shadow rays a light gets.
#[derive(Debug, Clone, Copy)]
pub struct DirectOptions {
    /// Points (with one shadow ray each) for every light that matters.
    pub base: u32,
    /// Points where the first ones disagree about visibility: a shadow's edge crosses the receiver.
    pub penumbra: u32,
}

/// Direct irradiance at a receiver.
#[derive(Debug, Clone, Copy, Default)]
pub struct DirectEstimate {
    /// E, W/m² or lx.
    pub irradiance: Vec3,
    /// Variance of the luminance of `irradiance` due to sampled visibility, as if samples were independent: an upper
    /// bound, since they are stratified.
    pub variance: f32,
    /// Shadow rays cast.
    pub rays: u32,
    /// Lights that some points see and others do not: a bit for each lamp (the 32nd and on share with the first), the top bit for
    /// emitters and the bright parts of the sky.
    pub mixed: u32,
}

/// What is to be kept of direct light beside its sum. What is empty or `None` is not asked for and costs nothing; the rest is added to.
#[derive(Debug, Clone, Default)]
pub struct DirectParts {
    /// Irradiance per group of [`LightGroups`](crate::LightGroups).
    pub groups: Vec<Vec3>,
    /// ∫ L dω, and ∫ L ω dω along x, y and z.
    pub moments: Option<[Vec3; 4]>,
    /// Luminance of the irradiance from directional lights: what arrives, and what would if nothing were in the way.
    pub sun: Option<[f32; 2]>,
}

/// The bit of [`DirectEstimate::mixed`] that stands for emissive surfaces.
const EMITTERS: u32 = 1 << 31;

/// Computes direct light.
///
/// Each punctual light and each near emissive triangle is computed unoccluded in closed form, and multiplied with the share of it
/// that shadow rays find visible. The share is a ratio of sums over the same weights (self-normalised), so a fully visible light
/// is exact and a hidden one exactly 0.
pub struct DirectLight<'w, 'a> {
    world: &'w World<'a>,
    emitters: &'w Emitters,
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
        DirectLight { world, emitters }
    }

    /// Whether there is no light to compute.
    pub(crate) fn is_dark(&self) -> bool {
        self.world.scene.lights.is_empty()
            && self.emitters.is_empty()
            && self.world.bright.is_none()
    }

    /// Mean irradiance over a receiver.
    ///
    /// `point(i)` gives point *i* of the receiver, i < [`DirectOptions::penumbra`]; any prefix should cover it evenly. `scale` is the
    /// receiver's size in metres (0 for a point) and `seed` decides the random numbers.
    pub fn irradiance(
        &self,
        point: impl FnMut(u32) -> SurfacePoint,
        scale: f32,
        seed: u32,
        options: &DirectOptions,
    ) -> DirectEstimate {
        self.irradiance_parts(point, scale, seed, options, &mut DirectParts::default())
    }

    /// [`irradiance`](Self::irradiance), of which `parts` keeps what it asks for.
    pub fn irradiance_parts(
        &self,
        mut point: impl FnMut(u32) -> SurfacePoint,
        scale: f32,
        seed: u32,
        options: &DirectOptions,
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
        };
        let shares = self.shares_of_lamps(&first, scale);
        for (k, light) in lights.iter().enumerate() {
            let share = shares.as_ref().map_or(1.0, |s| s[k]);
            let term = Term::Lamp(light, self.world.lamp_group(k));
            if share <= 0.0 {
                continue;
            }
            let mixed = if matches!(light.kind, LightKind::Directional { .. }) {
                self.add(&term, share, &mut work)
            } else {
                work.without_sun(|work| self.add(&term, share, work))
            };
            if mixed {
                work.out.mixed |= 1 << (k % 31);
            }
        }
        if self.emitters.is_empty() && bright.is_none() {
            return out;
        }
        work.without_sun(|work| {
            let mut mixed = false;
            if let Some(bright) = bright {
                let total: f32 = bright.cells.iter().map(|c| c.power).sum();
                for cell in &bright.cells {
                    mixed |= self.add(&Term::Sky(cell), cell.power / total, work);
                }
            }
            let mut terms = Vec::new();
            self.emitter_terms(&first, scale, options.base.max(4) as usize * 2, &mut terms);
            let total: f32 = terms.iter().map(|t| t.1).sum();
            for (term, weight) in terms {
                mixed |= self.add(&term, weight / total, work);
            }
            if mixed {
                work.out.mixed |= EMITTERS;
            }
        });
        out
    }

    /// Unbiased estimate of the direct irradiance at one point with a single shadow ray: one light is drawn, about in proportion to what
    /// it would bring unoccluded. Also says of which group it was.
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

    /// Adds one light, and says whether its samples disagree about what gets through. `share` is roughly its part of the light, which
    /// decides how much work it is worth.
    fn add<P: FnMut(u32) -> SurfacePoint>(
        &self,
        term: &Term,
        share: f32,
        work: &mut Work<P>,
    ) -> bool {
        // Up to four lights of equal strength get the whole number of points each; more share four times that number, by what
        // they bring, so that a hundred emissive triangles cost little more than four.
        let part = (4.0 * share).min(1.0);
        let base = ((work.options.base as f32 * part).ceil() as u32).max(1);
        let most = ((work.options.penumbra as f32 * part).ceil() as u32).max(base);
        let groups = match term {
            Term::Group(..) => self.world.group_count(),
            _ => 1,
        };
        // What each of a few emitters brings, found once for all points of the receiver.
        let few = match term {
            Term::Group(node) => self.emitters.few(*node, &work.first, work.scale),
            _ => None,
        };
        let mut tally = Tally::new(work.parts, groups);
        let mut n = 0;
        let mut target = base;
        // Lights that get few points start at different ones: else all would be seen from the same corner of the receiver. Aligned
        // blocks of a Sobol sequence are well distributed.
        let whole = work.options.base.max(1);
        let shift = if base < whole {
            work.set.wrapping_mul(base.next_power_of_two()) % whole
        } else {
            0
        };
        while n < target {
            let at = if n < whole { (n + shift) % whole } else { n };
            let p = (work.point)(at);
            let random = if self.is_random(term) {
                sample_4d(n, work.set, work.seed)
            } else {
                [0.0; 4]
            };
            self.sample(term, few.as_ref(), &p, random, &mut tally);
            n += 1;
            // Seen from some points and hidden from others: look closer.
            if n == target && tally.mixed() {
                target = most;
            }
        }
        work.set += 1;
        let mixed = tally.mixed();
        tally.finish(n, work.out, work.parts);
        mixed
    }
}

/// What is under way at one receiver.
struct Work<'r, P> {
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
}

impl<P> Work<'_, P> {
    /// For lights that are no suns.
    fn without_sun<T>(&mut self, add: impl FnOnce(&mut Self) -> T) -> T {
        let sun = self.parts.sun.take();
        let out = add(self);
        self.parts.sun = sun;
        out
    }
}

#[cfg(test)]
mod tests;
