//! Light that arrives straight from lamps and emissive surfaces.

mod cap;
mod tally;

use glam::{DVec3, Vec3};
use mesh_ingest::{Light, LightKind};

use crate::emitters::{Emitter, Emitters, Few};
use crate::form_factor::form_factor_polygon;
use crate::sampling::{SphericalTriangle, hash_u32, sample_4d};
use crate::sky::SkyCell;
use crate::world::{SurfacePoint, World, luminance};
use cap::Cap;
use tally::{Sample, Tally};

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

/// Lamps beyond this number share their points by what they bring, as emissive triangles do.
const MANY_LAMPS: usize = 8;

/// The bit of [`DirectEstimate::mixed`] that stands for emissive surfaces.
const EMITTERS: u32 = 1 << 31;

/// A group of emitters is always taken as one when it is seen under less than this angle (radius over distance). At 0.1 the
/// point-to-point kernel varies by at most (1.1/0.9)² over it; the sampling of points inside averages that out.
const FAR_GROUP: f32 = 0.1;

/// Groups of at most so many emitters are computed in closed form.
const FEW: usize = 2;

/// Marks groups that must be split; above any weight.
const INSIDE: f32 = f32::MAX;

/// Textures are read where light comes from when they are nearer than this many times the emitter's size. From there the point-to-point
/// kernel varies over it by (1 ± 1/16)⁻², so that what glows on one side of it alone counts 12 % too little or too much at most; parts
/// are cut until that happens in few.
const NEAR_TEXTURE: f32 = 8.0;

/// Terms where there are more emitters than may count singly: so that each has several points, which see a shadow's edge that one point
/// misses. From 32 to 12 the error of a panel of 10,000 squares over boxes fell from 3.2 to 2.6 %, for less work; 4 did no
/// better (docs/emitters.md).
const GROUPS: usize = 12;

/// Terms at most, whatever must be split: a receiver within a cloud of emitters has some dozen nested groups about it.
const MOST_TERMS: usize = 256;

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

    /// How many lamps share the work, and by which parts: `None` where they are few and each gets all of it. A part is 0 only where
    /// the lamp's range ends before the receiver.
    fn shares_of_lamps(&self, first: &SurfacePoint, scale: f32) -> Option<Vec<f32>> {
        let lights = &self.world.scene.lights;
        if lights.len() <= MANY_LAMPS {
            return None;
        }
        let mut shares: Vec<f32> = lights
            .iter()
            .map(|light| {
                let l = luminance(light.intensity);
                match light.kind {
                    LightKind::Directional { .. } => l,
                    LightKind::Point {
                        position,
                        range,
                        radius,
                    }
                    | LightKind::Spot {
                        position,
                        range,
                        radius,
                        ..
                    } => {
                        // As near as the receiver comes to it.
                        let d = (first.position.distance(position) - scale).max(radius.max(1e-3));
                        l * falloff(Vec3::X * d, range)
                    }
                }
            })
            .collect();
        let total: f32 = shares.iter().sum();
        if total > 0.0 {
            shares.iter_mut().for_each(|s| *s /= total);
        }
        Some(shares)
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

    /// Light that arrives at a point in space from all sides, straight from lamps, emitters and the bright parts of the sky.
    ///
    /// Calls `f` with the unit direction towards the light and with ∫ L dω of what comes from there (W/m² or lx on a surface that faces it),
    /// for each of about `samples` samples a light.
    pub fn for_each_arrival(
        &self,
        at: Vec3,
        samples: u32,
        seed: u32,
        f: &mut impl FnMut(Vec3, Vec3),
    ) {
        let world = self.world;
        let n = samples.max(1);
        let mut set = 1;
        for light in &world.scene.lights {
            let cap = Cap::of(light, at);
            for i in 0..if cap.is_some() { n } else { 1 } {
                let (direction, reach, flux) = match &cap {
                    Some(cap) => {
                        let s = sample_4d(i, set, seed);
                        let (direction, reach) = cap.sample(s[0], s[1]);
                        (
                            direction,
                            reach,
                            cap.radiance() * cap.solid_angle() / n as f32,
                        )
                    }
                    None => match light.kind {
                        LightKind::Directional { direction, .. } => {
                            (-direction, f32::INFINITY, 1.0)
                        }
                        LightKind::Point {
                            position, range, ..
                        }
                        | LightKind::Spot {
                            position, range, ..
                        } => {
                            let d = position - at;
                            (d.normalize_or(Vec3::Y), d.length(), falloff(d, range))
                        }
                    },
                };
                let light = light.intensity * (flux * self.directivity(light, -direction));
                if light != Vec3::ZERO {
                    f(direction, light * world.transmitted(at, direction, reach));
                }
            }
            set += 1;
        }
        if let Some(bright) = &world.bright {
            let total: f32 = bright.cells.iter().map(|c| c.power).sum();
            for cell in &bright.cells {
                let own = ((n as f32 * 4.0 * cell.power / total).ceil() as u32).min(n);
                for i in 0..own {
                    let s = sample_4d(i, set, seed);
                    let (direction, light) = bright.sample(cell, s[0], s[1]);
                    let passed = world.transmitted(at, direction, f32::INFINITY);
                    f(direction, light * passed / own as f32);
                }
                set += 1;
            }
        }
        // No hemisphere: a normal of zero length puts nothing below the horizon.
        let point = SurfacePoint {
            position: at,
            origin: at,
            normal: Vec3::ZERO,
            geometric: Vec3::ZERO,
        };
        let mut terms = Vec::new();
        self.emitter_terms(&point, 0.0, n.max(4) as usize * 2, &mut terms);
        let total: f32 = terms.iter().map(|t| t.1).sum();
        for (term, weight) in terms {
            let own = ((n as f32 * (4.0 * weight / total).min(1.0)).ceil() as u32).max(1);
            for i in 0..own {
                let s = sample_4d(i, set, seed);
                let (e, q, solid_angle) = match &term {
                    Term::Triangle(e) => match SphericalTriangle::new(e.corners, at) {
                        Some(t) => {
                            let direction = t.sample(s[0], s[1]);
                            let reach = e.normal.dot(e.corners[0] - at) / e.normal.dot(direction);
                            (*e, at + direction * reach, t.solid_angle)
                        }
                        None => continue,
                    },
                    Term::Group(node) => {
                        let x = s[2] as f64 + s[3] as f64 * 2f64.powi(-24);
                        let Some((e, probability)) = self.emitters.pick(*node, &point, x) else {
                            continue;
                        };
                        let q = on_triangle(e.corners, s[0], s[1]);
                        let v = q - at;
                        let d2 = v.length_squared().max(1e-30);
                        let facing = e.normal.dot(v).abs() / (d2 * d2.sqrt());
                        (e, q, facing * e.area / probability)
                    }
                    Term::Lamp(..) | Term::Sky(_) => continue,
                };
                let front = e.two_sided || e.normal.dot(at - q) > 0.0;
                let direction = (q - at).normalize_or_zero();
                if front && q.is_finite() && direction != Vec3::ZERO {
                    let light = self.radiance_at(e, q, &point) * (solid_angle / own as f32);
                    f(direction, light * self.passed(&point, q, e));
                }
            }
            set += 1;
        }
    }

    /// About what a lamp brings to a point if nothing is in between; 0 only where it brings nothing.
    fn weight_of_lamp(&self, light: &Light, point: &SurfacePoint) -> f32 {
        match Cap::of(light, point.position) {
            Some(cap) => luminance(light.intensity) * cap.unoccluded(point.normal),
            None => self
                .arrival(light, point)
                .map_or(0.0, |a| luminance(a.value)),
        }
    }

    /// Which emissive triangles count singly and which groups whole, at most `most` of both, with roughly how much each brings.
    ///
    /// A group that the receiver lies within is always split: a point drawn from it may be arbitrarily near, and 1/d² of that is a spark.
    ///
    /// Starts from all emitters as one group and splits the one whose light is spread widest, until what is left is either a single
    /// triangle or far away, or there are enough (Walter and others, *Lightcuts*, 2005).
    fn emitter_terms(
        &self,
        first: &SurfacePoint,
        scale: f32,
        most: usize,
        terms: &mut Vec<(Term<'w>, f32)>,
    ) {
        if self.emitters.is_empty() {
            return;
        }
        /// A node with its weight, and how much there is to gain from splitting it.
        type Candidate = (u32, f32, f32);
        // Closed forms while they last; then a few groups with several points each, which see a shadow's edge that one point misses.
        let most = if self.emitters.len() <= most {
            most
        } else {
            most.min(GROUPS)
        };
        let judge = |id: u32| -> Option<Candidate> {
            let node = &self.emitters.nodes[id as usize];
            let weight = node.importance(first.position, first.normal, scale);
            if weight <= 0.0 {
                return None; // below the horizon, or all of it faces away
            }
            if node.second == 0 {
                let e = &self.emitters.emitters[node.start as usize];
                let faces = e.two_sided || e.normal.dot(first.position - e.corners[0]) > -scale;
                return faces.then_some((id, weight, 0.0));
            }
            let reach = node.radius + scale;
            let d2 = node.centre.distance_squared(first.position);
            let far = reach * reach < FAR_GROUP * FAR_GROUP * d2;
            let gain = if far {
                0.0
            } else if reach * reach > d2 {
                INSIDE
            } else {
                weight * reach * reach / d2
            };
            Some((id, weight, gain))
        };
        let mut cut: Vec<Candidate> = Vec::with_capacity(most + 2);
        cut.extend(judge(0));
        while cut.len() < MOST_TERMS {
            let Some(widest) = (0..cut.len()).max_by(|&a, &b| cut[a].2.total_cmp(&cut[b].2)) else {
                break;
            };
            let (id, _, gain) = cut[widest];
            if gain <= 0.0 || (cut.len() >= most && gain < INSIDE) {
                break;
            }
            cut.swap_remove(widest);
            cut.extend(judge(id + 1));
            cut.extend(judge(self.emitters.nodes[id as usize].second));
        }
        terms.extend(cut.into_iter().map(|(id, weight, _)| {
            let node = &self.emitters.nodes[id as usize];
            let term = if node.second == 0 {
                Term::Triangle(&self.emitters.emitters[node.start as usize])
            } else {
                Term::Group(id)
            };
            (term, weight)
        }));
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

    /// Whether samples of the light need random numbers.
    fn is_random(&self, term: &Term) -> bool {
        match term {
            Term::Lamp(light, _) => match light.kind {
                LightKind::Directional { angle, .. } => angle > 0.0,
                LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } => radius > 0.0,
            },
            _ => true,
        }
    }

    /// Takes one sample of a light at one point; `few` holds a group's emitters, where that is known.
    fn sample(
        &self,
        term: &Term,
        few: Option<&Few>,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        match term {
            Term::Lamp(light, group) => self.lamp(light, *group, p, random, tally),
            Term::Sky(cell) => self.sky(cell, p, random, tally),
            Term::Triangle(e) => self.triangle(e, p, random, tally),
            Term::Group(node) => self.group(*node, few, p, random, tally),
        }
    }

    fn lamp(
        &self,
        light: &Light,
        group: usize,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        if let Some(cap) = Cap::of(light, p.position) {
            return self.disc(light, &cap, group, p, random, tally);
        }
        let Some(a) = self.arrival(light, p) else {
            return;
        };
        tally.rays += 1;
        tally.plain(&Sample {
            value: a.value,
            passed: self.world.transmitted(p.origin, a.to, a.t_max),
            direction: a.axis,
            cos: a.cos,
            group,
        });
    }

    /// A lamp that is seen as a disc: closed form, and one shadow ray to a point of it.
    fn disc(
        &self,
        light: &Light,
        cap: &Cap,
        group: usize,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        let unoccluded = cap.unoccluded(p.normal);
        if unoccluded <= 0.0 {
            return;
        }
        let (direction, reach) = cap.sample(random[0], random[1]);
        let cos = p.normal.dot(direction);
        if cos <= 0.0 {
            return tally.unweighted(unoccluded);
        }
        let weight = cos * cap.solid_angle() * cap.radiance();
        let radiance = light.intensity * self.directivity(light, -direction);
        let passed = if p.geometric.dot(direction) <= 0.0 || radiance == Vec3::ZERO {
            Vec3::ZERO
        } else {
            tally.rays += 1;
            self.world.transmitted(p.origin, direction, reach)
        };
        let sample = Sample {
            value: radiance * weight,
            passed,
            direction,
            cos,
            group,
        };
        tally.weighted(unoccluded, weight, &sample);
    }

    fn sky(&self, cell: &SkyCell, p: &SurfacePoint, random: [f32; 4], tally: &mut Tally) {
        let Some(bright) = &self.world.bright else {
            return;
        };
        let (direction, light) = bright.sample(cell, random[0], random[1]);
        let cos = p.normal.dot(direction);
        if cos <= 0.0 || p.geometric.dot(direction) <= 0.0 {
            return;
        }
        tally.rays += 1;
        tally.plain(&Sample {
            value: light * cos,
            passed: self.world.transmitted(p.origin, direction, f32::INFINITY),
            direction,
            cos,
            group: self.world.sky_group(),
        });
    }

    /// Factor of a lamp's intensity in the unit direction in which its light leaves: the spot's cone, and its profile.
    fn directivity(&self, light: &Light, leaving: Vec3) -> f32 {
        let cone = match light.kind {
            LightKind::Spot {
                direction,
                inner,
                outer,
                ..
            } => {
                // The cone of KHR_lights_punctual: linear in the cosine between the angles, squared.
                let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
                let cone = ((direction.dot(leaving) - outer.cos()) * scale).clamp(0.0, 1.0);
                cone * cone
            }
            LightKind::Point { .. } | LightKind::Directional { .. } => 1.0,
        };
        if cone > 0.0 && light.profile.is_some() {
            cone * self.world.scene.profile_factor(light, leaving)
        } else {
            cone
        }
    }

    /// A light that comes from one point, or from one direction, at `p` if nothing is in between; `None` where it is 0.
    fn arrival(&self, light: &Light, p: &SurfacePoint) -> Option<Arrival> {
        let from = |position: Vec3| (position - p.origin, 1.0, position - p.position);
        let (to, t_max, d) = match light.kind {
            LightKind::Directional { direction, .. } => (-direction, f32::INFINITY, -direction),
            LightKind::Point { position, .. } | LightKind::Spot { position, .. } => from(position),
        };
        let axis = d.normalize_or_zero();
        let cos = p.normal.dot(axis);
        if cos <= 0.0 || p.geometric.dot(axis) <= 0.0 {
            return None;
        }
        let factor = match light.kind {
            LightKind::Directional { .. } => 1.0,
            LightKind::Point { range, .. } | LightKind::Spot { range, .. } => {
                self.directivity(light, -axis) * falloff(d, range)
            }
        };
        let value = light.intensity * (cos * factor);
        (value != Vec3::ZERO).then_some(Arrival {
            to,
            t_max,
            axis,
            cos,
            value,
        })
    }

    /// Share of the receiver's sky that an emitter takes if nothing is in between: the form factor; 0 from behind.
    fn form_factor(&self, e: &Emitter, p: &SurfacePoint) -> f32 {
        let d = |v: Vec3| -> DVec3 { v.as_dvec3() };
        // On the emitter's own face: rounding puts the point above or below it, and a polygon about the point has F = ±1.
        let height = e.normal.dot(p.position - e.corners[0]).abs();
        if height <= self.world.offset(p.position) && e.normal.dot(p.geometric).abs() > 0.99 {
            let faces_away = e.normal.dot(p.geometric) > 0.0;
            if faces_away || height == 0.0 {
                return 0.0;
            }
        }
        // In f64 and relative to the receiver from the start: near contact everything cancels.
        let f = form_factor_polygon(
            DVec3::ZERO,
            d(p.normal),
            &e.corners.map(|c| d(c) - d(p.position)),
        ) as f32;
        let f = if e.two_sided { f.abs() } else { f };
        // Edge terms of order 1 cancel to rounding 1e-16; what is left below 1e-12 is noise.
        if f > 1e-12 { f } else { 0.0 }
    }

    fn triangle(&self, e: &Emitter, p: &SurfacePoint, random: [f32; 4], tally: &mut Tally) {
        let unoccluded = self.form_factor(e, p) * std::f32::consts::PI;
        if unoccluded <= 0.0 {
            return;
        }
        // A point on the triangle, its weight ∝ the light that comes from there. The part below the horizon is cut off, as it is
        // from the closed form: else few samples might all fall there and lose the light.
        let (pieces, count) = above_horizon(e.corners, p);
        let seen = |k: usize| {
            (k < count)
                .then(|| SphericalTriangle::new(pieces[k], p.origin))
                .flatten()
        };
        let spherical = [seen(0), seen(1)];
        let solid_angle: f32 = spherical.iter().flatten().map(|s| s.solid_angle).sum();
        let (target, weight) = if solid_angle > 2e-4 {
            let mut left = random[2] * solid_angle;
            let mut chosen = None;
            for s in spherical.iter().flatten() {
                chosen = Some(s);
                if left < s.solid_angle {
                    break;
                }
                left -= s.solid_angle;
            }
            let dir = chosen.map_or(Vec3::ZERO, |s| s.sample(random[0], random[1]));
            let det = e.normal.dot(dir);
            let t = e.normal.dot(e.corners[0] - p.origin) / det;
            if !(t.is_finite() && t > 0.0) {
                (e.corners[0], 0.0)
            } else {
                let cos = p.normal.dot(dir).max(0.0);
                (p.origin + dir * t, cos * solid_angle)
            }
        } else {
            let area = |c: [Vec3; 3]| 0.5 * (c[1] - c[0]).cross(c[2] - c[0]).length();
            let whole: f32 = pieces[..count].iter().map(|c| area(*c)).sum();
            let first = count < 2 || random[2] * whole < area(pieces[0]);
            let q = on_triangle(pieces[if first { 0 } else { 1 }], random[0], random[1]);
            let v = q - p.origin;
            let d2 = v.length_squared().max(1e-30);
            let cos = p.normal.dot(v).max(0.0) * e.normal.dot(v).abs() / d2;
            (q, cos / d2 * whole)
        };
        let to = target - p.origin;
        if weight <= 0.0 || p.geometric.dot(to) <= 0.0 {
            return tally.unweighted(unoccluded);
        }
        tally.rays += 1;
        let direction = to.normalize_or(p.normal);
        let sample = Sample {
            value: self.radiance_at(e, target, p) * weight,
            passed: self.passed(p, target, e),
            direction,
            cos: p.normal.dot(direction).max(1e-6),
            group: self.world.emission_group(e.triangle),
        };
        tally.weighted(unoccluded, weight, &sample);
    }

    fn group(
        &self,
        node: u32,
        few: Option<&Few>,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        // A few triangles, such as a far rectangle's two, have their closed form like one; the sample says what of it is seen.
        let range = &self.emitters.nodes[node as usize];
        let members = &self.emitters.emitters[range.start as usize..range.end as usize];
        let closed = members.len() <= FEW && !tally.plainly;
        let unoccluded = closed.then(|| -> f32 {
            let each = |e: &Emitter| luminance(e.radiance) * self.form_factor(e, p);
            members.iter().map(each).sum::<f32>() * std::f32::consts::PI
        });
        if unoccluded.is_some_and(|e| e <= 0.0) {
            return;
        }
        // A group's choice may take more than the 24 bits of one number.
        let x = random[2] as f64 + random[3] as f64 * 2f64.powi(-24);
        let picked = match few {
            Some(few) => few.pick(self.emitters, x),
            None => self.emitters.pick(node, p, x),
        };
        let Some((e, probability)) = picked else {
            if let Some(unoccluded) = unoccluded {
                tally.unweighted(unoccluded);
            }
            return;
        };
        let q = on_triangle(e.corners, random[0], random[1]);
        let v = q - p.origin;
        let d2 = v.length_squared();
        let facing = -e.normal.dot(v);
        let facing = if e.two_sided { facing.abs() } else { facing };
        let cos = p.normal.dot(v);
        if facing <= 0.0 || cos <= 0.0 || p.geometric.dot(v) <= 0.0 {
            if let Some(unoccluded) = unoccluded {
                tally.unweighted(unoccluded);
            }
            return;
        }
        let k = cos * facing / (d2 * d2) * e.area / probability;
        tally.rays += 1;
        let d = d2.sqrt();
        let sample = Sample {
            value: self.radiance_at(e, q, p) * k,
            passed: self.passed(p, q, e),
            direction: v / d,
            cos: cos / d,
            group: self.world.emission_group(e.triangle),
        };
        match unoccluded {
            Some(unoccluded) => tally.weighted(unoccluded, luminance(e.radiance) * k, &sample),
            None => tally.plain(&sample),
        }
    }

    /// Share of light from the point `q` of emitter `e` that gets to `p`. The ray ends just before the emitter, which must not hide itself.
    fn passed(&self, p: &SurfacePoint, q: Vec3, e: &Emitter) -> Vec3 {
        let to = q - p.origin;
        // Stop as far off the emitter's plane as a receiver there would start.
        let height = e.normal.dot(to).abs();
        let stop = 2.0 * self.world.offset(q);
        let t_max = 1.0 - (stop / height.max(1e-30)).min(1.0);
        if t_max <= 0.0 {
            return Vec3::ONE;
        }
        self.world.transmitted(p.origin, to, t_max)
    }

    /// Radiance that counts for the point `q` of `e` at `p`: from near what the texture says there, and from far the part's mean, which is
    /// what arrives, without the noise of a texture read at a few points.
    fn radiance_at(&self, e: &Emitter, q: Vec3, p: &SurfacePoint) -> Vec3 {
        let size2 = (e.corners[1] - e.corners[0])
            .length_squared()
            .max((e.corners[2] - e.corners[0]).length_squared());
        if !e.textured || q.distance_squared(p.origin) > NEAR_TEXTURE * NEAR_TEXTURE * size2 {
            return e.radiance;
        }
        let whole = self.world.soup.triangles[e.triangle as usize];
        let (ab, ac, ap) = (whole[1] - whole[0], whole[2] - whole[0], q - whole[0]);
        let (d11, d12, d22) = (ab.dot(ab), ab.dot(ac), ac.dot(ac));
        let (p1, p2) = (ap.dot(ab), ap.dot(ac));
        let det = (d11 * d22 - d12 * d12).max(1e-30);
        let u = ((d22 * p1 - d12 * p2) / det).clamp(0.0, 1.0);
        let v = ((d11 * p2 - d12 * p1) / det).clamp(0.0, 1.0 - u);
        self.world.scene.emitted(self.world.soup, e.triangle, u, v)
    }
}

/// Light from one point or direction.
struct Arrival {
    /// The shadow ray's direction and end.
    to: Vec3,
    t_max: f32,
    /// Unit direction towards the light, and its cosine.
    axis: Vec3,
    cos: f32,
    /// Irradiance if nothing is in between.
    value: Vec3,
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

/// A point uniform on the triangle.
fn on_triangle([a, b, c]: [Vec3; 3], u: f32, v: f32) -> Vec3 {
    let s = u.sqrt();
    a * (1.0 - s) + b * (s * (1.0 - v)) + c * (s * v)
}

/// The part of a triangle above the receiver's horizon, as up to two triangles, and how many.
fn above_horizon(corners: [Vec3; 3], p: &SurfacePoint) -> ([[Vec3; 3]; 2], usize) {
    let height = corners.map(|c| p.normal.dot(c - p.origin));
    if height.iter().all(|h| *h >= 0.0) {
        return ([corners; 2], 1);
    }
    let mut kept = [Vec3::ZERO; 4];
    let mut n = 0;
    for i in 0..3 {
        let (j, k) = (i, (i + 1) % 3);
        if height[j] >= 0.0 {
            kept[n] = corners[j];
            n += 1;
        }
        if (height[j] >= 0.0) != (height[k] >= 0.0) {
            let t = height[j] / (height[j] - height[k]);
            kept[n] = corners[j].lerp(corners[k], t);
            n += 1;
        }
    }
    let [a, b, c, d] = kept;
    // Nothing above (only by rounding, since the closed form found light): its corners get weight 0.
    ([[a, b, c], [a, c, d]], n.saturating_sub(2))
}

/// 1/d², windowed to 0 at `range` as KHR_lights_punctual recommends.
pub(crate) fn falloff(d: Vec3, range: Option<f32>) -> f32 {
    let d2 = d.length_squared();
    if d2 == 0.0 {
        return 0.0;
    }
    let window = match range {
        Some(r) if r > 0.0 => {
            let q = d2 / (r * r);
            (1.0 - q * q).clamp(0.0, 1.0)
        }
        _ => 1.0,
    };
    window / d2
}

#[cfg(test)]
mod tests;
