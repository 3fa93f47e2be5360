//! Light that arrives straight from lamps and emissive surfaces.

use glam::{DVec3, Vec3};
use mesh_ingest::{Light, LightKind};

use crate::emitters::{Emitter, Emitters, emitted};
use crate::form_factor::form_factor_polygon;
use crate::sampling::{SphericalTriangle, hash_u32, sample_4d};
use crate::world::{SurfacePoint, World, luminance};

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
    /// emitters.
    pub mixed: u32,
}

/// The bit of [`DirectEstimate::mixed`] that stands for emissive surfaces.
const EMITTERS: u32 = 1 << 31;

/// A group of emitters is always taken as one when it is seen under less than this angle (radius over distance). At 0.1 the
/// point-to-point kernel varies by at most (1.1/0.9)² over it; the sampling of points inside averages that out.
const FAR_GROUP: f32 = 0.1;

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
    Punctual(&'e Light),
    Triangle(&'e Emitter),
    Group(u32, u32),
}

impl<'w, 'a> DirectLight<'w, 'a> {
    /// Direct light of `world`'s lamps and of `emitters`, which were collected from it.
    pub fn new(world: &'w World<'a>, emitters: &'w Emitters) -> Self {
        DirectLight { world, emitters }
    }

    /// Mean irradiance over a receiver.
    ///
    /// `point(i)` gives point *i* of the receiver, i < [`DirectOptions::penumbra`]; any prefix should cover it evenly. `scale` is the
    /// receiver's size in metres (0 for a point) and `seed` decides the random numbers.
    pub fn irradiance(
        &self,
        mut point: impl FnMut(u32) -> SurfacePoint,
        scale: f32,
        seed: u32,
        options: &DirectOptions,
    ) -> DirectEstimate {
        let mut out = DirectEstimate::default();
        let scene = self.world.scene;
        if scene.lights.is_empty() && self.emitters.is_empty() {
            return out;
        }
        let first = point(0);
        let mut set = 1;
        for (k, light) in scene.lights.iter().enumerate() {
            let before = out.variance;
            self.add(
                Term::Punctual(light),
                1.0,
                &mut point,
                set,
                seed,
                options,
                &mut out,
            );
            if out.variance > before {
                out.mixed |= 1 << (k % 31);
            }
            set += 1;
        }
        if self.emitters.is_empty() {
            return out;
        }
        let mut terms = Vec::new();
        self.emitter_terms(&first, scale, options.base.max(4) as usize * 2, &mut terms);
        let total: f32 = terms.iter().map(|t| t.1).sum();
        let before = out.variance;
        for (term, weight) in terms {
            self.add(
                term,
                weight / total,
                &mut point,
                set,
                seed,
                options,
                &mut out,
            );
            set += 1;
        }
        if out.variance > before {
            out.mixed |= EMITTERS;
        }
        out
    }

    /// Unbiased estimate of the direct irradiance at one point with a single shadow ray: one light is drawn, about in proportion to what
    /// it would bring unoccluded.
    pub fn sample_one(&self, point: &SurfacePoint, seed: u32) -> Vec3 {
        let mut terms = Vec::new();
        for light in &self.world.scene.lights {
            if let Some((_, _, value)) = arrival(light, point) {
                terms.push((Term::Punctual(light), luminance(value)));
            }
        }
        self.emitter_terms(point, 0.0, 8, &mut terms);
        let total: f32 = terms.iter().map(|t| t.1).sum();
        if total <= 0.0 {
            return Vec3::ZERO;
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
        let mut acc = Accumulator {
            plainly: true,
            ..Accumulator::default()
        };
        let random = sample_4d(0, 1, seed);
        match &term {
            Term::Punctual(light) => self.punctual(light, point, &mut acc),
            Term::Triangle(e) => self.triangle(e, point, random, &mut acc),
            Term::Group(s, e) => self.group(*s, *e, point, random, &mut acc),
        }
        acc.lit * (total / weight)
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
                Term::Group(node.start, node.end)
            };
            (term, weight)
        }));
    }

    /// Adds one light. `share` is roughly its part of the light, which decides how much work it is worth.
    #[allow(
        clippy::too_many_arguments,
        reason = "one private call site each; a struct would only rename them"
    )]
    fn add(
        &self,
        term: Term,
        share: f32,
        point: &mut impl FnMut(u32) -> SurfacePoint,
        set: u32,
        seed: u32,
        options: &DirectOptions,
        out: &mut DirectEstimate,
    ) {
        // Up to four lights of equal strength get the whole number of points each; more share four times that number, by what
        // they bring, so that a hundred emissive triangles cost little more than four.
        let part = (4.0 * share).min(1.0);
        let base = ((options.base as f32 * part).ceil() as u32).max(1);
        let most = ((options.penumbra as f32 * part).ceil() as u32).max(base);
        let mut acc = Accumulator::default();
        let mut n = 0;
        let mut target = base;
        while n < target {
            let p = point(n);
            match &term {
                Term::Punctual(light) => self.punctual(light, &p, &mut acc),
                Term::Triangle(e) => self.triangle(e, &p, sample_4d(n, set, seed), &mut acc),
                Term::Group(s, e) => self.group(*s, *e, &p, sample_4d(n, set, seed), &mut acc),
            }
            n += 1;
            // Seen from some points and hidden from others: look closer.
            if n == target && acc.hidden > 0 && acc.seen > 0 {
                target = most;
            }
        }
        acc.finish(n, out);
    }

    fn punctual(&self, light: &Light, p: &SurfacePoint, acc: &mut Accumulator) {
        let Some((to, t_max, value)) = arrival(light, p) else {
            acc.nothing();
            return;
        };
        let visible = !self.world.occluded(p.origin, to, t_max);
        acc.rays += 1;
        acc.plain(value, visible);
    }

    fn triangle(&self, e: &Emitter, p: &SurfacePoint, random: [f32; 4], acc: &mut Accumulator) {
        let d = |v: Vec3| -> DVec3 { v.as_dvec3() };
        // On the emitter's own face: rounding puts the point above or below it, and a polygon about the point has F = ±1.
        let height = e.normal.dot(p.position - e.corners[0]).abs();
        if height <= self.world.offset(p.position) && e.normal.dot(p.geometric).abs() > 0.99 {
            let faces_away = e.normal.dot(p.geometric) > 0.0;
            if faces_away || height == 0.0 {
                acc.nothing();
                return;
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
        if f <= 1e-12 {
            acc.nothing();
            return;
        }
        let unoccluded = f * std::f32::consts::PI;
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
            acc.weighted(unoccluded, 0.0, Vec3::ZERO, None);
            return;
        }
        let radiance = self.radiance_at(e, target, p);
        let visible = self.visible(p, target, e);
        acc.rays += 1;
        acc.weighted(unoccluded, weight, radiance, Some(visible));
    }

    fn group(
        &self,
        start: u32,
        end: u32,
        p: &SurfacePoint,
        random: [f32; 4],
        acc: &mut Accumulator,
    ) {
        // A group's choice may take more than the 24 bits of one number.
        let x = random[2] as f64 + random[3] as f64 * 2f64.powi(-24);
        let Some((e, probability)) = self.emitters.pick(start, end, p, x) else {
            acc.nothing();
            return;
        };
        let q = on_triangle(e.corners, random[0], random[1]);
        let v = q - p.origin;
        let d2 = v.length_squared();
        let facing = -e.normal.dot(v);
        let facing = if e.two_sided { facing.abs() } else { facing };
        let cos = p.normal.dot(v);
        if facing <= 0.0 || cos <= 0.0 || p.geometric.dot(v) <= 0.0 {
            acc.nothing();
            return;
        }
        let k = cos * facing / (d2 * d2) * e.area / probability;
        let visible = self.visible(p, q, e);
        acc.rays += 1;
        acc.plain(self.radiance_at(e, q, p) * k, visible);
    }

    /// Whether the point `q` of emitter `e` is seen from `p`. The ray ends just before the emitter, which must not hide itself.
    fn visible(&self, p: &SurfacePoint, q: Vec3, e: &Emitter) -> bool {
        let to = q - p.origin;
        // Stop as far off the emitter's plane as a receiver there would start.
        let height = e.normal.dot(to).abs();
        let stop = 2.0 * self.world.offset(q);
        let t_max = 1.0 - (stop / height.max(1e-30)).min(1.0);
        t_max <= 0.0 || !self.world.occluded(p.origin, to, t_max)
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
        emitted(self.world.scene, self.world.soup, e.triangle, u, v)
    }
}

/// The shadow ray's direction and end, and the irradiance at `p` if nothing is in between; `None` where it is 0.
fn arrival(light: &Light, p: &SurfacePoint) -> Option<(Vec3, f32, Vec3)> {
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
        LightKind::Point { range, .. } => falloff(d, range),
        LightKind::Spot {
            direction,
            range,
            inner,
            outer,
            ..
        } => {
            // The cone of KHR_lights_punctual: linear in the cosine between the angles, squared.
            let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
            let cone = ((direction.dot(-axis) - outer.cos()) * scale).clamp(0.0, 1.0);
            cone * cone * falloff(d, range)
        }
    };
    let value = light.intensity * (cos * factor);
    (value != Vec3::ZERO).then_some((to, t_max, value))
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
fn falloff(d: Vec3, range: Option<f32>) -> f32 {
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

/// Sums of one light's samples.
#[derive(Default)]
struct Accumulator {
    /// Samples that see light or would.
    seen: u32,
    hidden: u32,
    rays: u32,
    /// Σ over visible samples, for lights estimated sample by sample.
    lit: Vec3,
    /// Σ over all samples, visible or not.
    all: Vec3,
    /// Σ of closed-form values (per unit radiance), and of the weights.
    unoccluded: f32,
    weight: f32,
    weight_seen: Vec3,
    /// Take samples for what they are. The ratio has a bias of order 1/n at the edges of shadows, which is nothing for a lumel with its
    /// many samples but not for the one of `sample_one`.
    plainly: bool,
}

impl Accumulator {
    /// The sample gets nothing whatever the visibility.
    fn nothing(&mut self) {}

    fn mark(&mut self, visible: bool) {
        self.seen += visible as u32;
        self.hidden += !visible as u32;
    }

    fn plain(&mut self, value: Vec3, visible: bool) {
        self.mark(visible);
        self.all += value;
        if visible {
            self.lit += value;
        }
    }

    fn weighted(&mut self, unoccluded: f32, weight: f32, radiance: Vec3, visible: Option<bool>) {
        let Some(visible) = visible else {
            self.unoccluded += unoccluded;
            return;
        };
        if self.plainly {
            self.plain(radiance * weight, visible);
            return;
        }
        self.unoccluded += unoccluded;
        self.mark(visible);
        self.weight += weight;
        if visible {
            self.weight_seen += radiance * weight;
        }
    }

    fn finish(self, n: u32, out: &mut DirectEstimate) {
        out.rays += self.rays;
        let mut e = self.lit / n as f32;
        let mut full = self.all / n as f32;
        if self.weight > 0.0 {
            let k = self.unoccluded / n as f32 / self.weight;
            e += self.weight_seen * k;
            full +=
                self.weight_seen * k * ((self.seen + self.hidden) as f32 / self.seen.max(1) as f32);
        }
        out.irradiance += e;
        if self.seen > 0 && self.hidden > 0 {
            let m = (self.seen + self.hidden) as f32;
            let p = self.seen as f32 / m;
            let l = luminance(full);
            out.variance += l * l * p * (1.0 - p) / m;
        }
    }
}

#[cfg(test)]
mod tests;
