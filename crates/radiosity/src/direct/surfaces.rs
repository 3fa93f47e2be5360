//! Samples of emissive surfaces at one point of a receiver.

use glam::{DVec3, Vec3};
use visibility::closest_point;

use super::DirectLight;
use super::tally::{Sample, Tally};
use crate::emitters::{Emitter, Parts};
use crate::form_factor::form_factor_polygon;
use crate::sampling::SphericalTriangle;
use crate::world::{SurfacePoint, luminance};

/// Groups of at most this many emitters are computed in closed form.
const FEW: usize = 2;

/// Textures are sampled at the light's point of origin within this many times the emitter's size.
/// At that distance, the point-to-point kernel varies over the emitter by (1 ± 1/16)⁻². If only one
/// side glows, the error is therefore at most 12 %. Emitters are subdivided until few are like
/// that.
const NEAR_TEXTURE: f32 = 8.0;

impl DirectLight<'_, '_> {
    /// Unoccluded form factor of an emitter, i.e. its share of the receiver's cosine-weighted sky;
    /// 0 from behind.
    pub(super) fn form_factor(&self, e: &Emitter, p: &SurfacePoint) -> f32 {
        let d = |v: Vec3| -> DVec3 { v.as_dvec3() };
        // For a point on the emitter itself, rounding puts it above or below, and a polygon around
        // the point has F = ±1.
        let height = e.normal.dot(p.position - e.corners[0]).abs();
        if height <= self.world.offset(p.position) && e.normal.dot(p.geometric).abs() > 0.99 {
            let faces_away = e.normal.dot(p.geometric) > 0.0;
            if faces_away || height == 0.0 {
                return 0.0;
            }
        }
        // In f64 and relative to the receiver from the start: close to contact, everything cancels.
        let f = form_factor_polygon(
            DVec3::ZERO,
            d(p.normal),
            &e.corners.map(|c| d(c) - d(p.position)),
        ) as f32;
        let f = if e.two_sided { f.abs() } else { f };
        // Edge terms of order 1 cancel with a rounding error of 1e-16; values below 1e-12 are
        // noise.
        if f > 1e-12 { f } else { 0.0 }
    }

    pub(super) fn triangle(
        &self,
        e: &Emitter,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        let unoccluded = self.form_factor(e, p) * std::f32::consts::PI;
        if unoccluded <= 0.0 || is_beside(e, p, tally.beside) {
            return;
        }
        // Samples a point of the triangle, weighted by the light from there. The part below the
        // horizon is clipped as in the closed form; otherwise, a few samples might all fall below
        // it and lose the light.
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
        let passed = tally.passed(|| self.passed(p, target, e));
        let direction = to.normalize_or(p.normal);
        let sample = Sample {
            value: self.radiance_at(e, target, p) * weight,
            passed,
            direction,
            cos: p.normal.dot(direction).max(1e-6),
            group: self.world.emission_group(e.triangle),
        };
        tally.weighted(unoccluded, weight, &sample);
    }

    /// One emitter of a group, which stands for all of it, and for others if the group was chosen
    /// with a probability below 1.
    pub(super) fn group(
        &self,
        (node, chance): (u32, f32),
        parts: Option<&Parts>,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        // A few triangles, such as the two of a distant rectangle, use their closed form like a
        // single one; the sample measures visibility.
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
        // Choosing within a group may need more than the 24 bits of one number.
        let x = random[2] as f64 + random[3] as f64 * 2f64.powi(-24);
        let picked = match parts {
            Some(parts) => self.emitters.pick_of(parts, p, x),
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
        let faces = facing > 0.0 && cos > 0.0 && p.geometric.dot(v) > 0.0;
        if !faces || is_beside(e, p, tally.beside) {
            if let Some(unoccluded) = unoccluded {
                tally.unweighted(unoccluded);
            }
            return;
        }
        let k = cos * facing / (d2 * d2) * e.area / probability;
        let passed = tally.passed(|| self.passed(p, q, e));
        let d = d2.sqrt();
        let sample = Sample {
            value: self.radiance_at(e, q, p) * (k / chance),
            passed,
            direction: v / d,
            cos: cos / d,
            group: self.world.emission_group(e.triangle),
        };
        match unoccluded {
            Some(unoccluded) => tally.weighted(unoccluded, luminance(e.radiance) * k, &sample),
            None => tally.plain(&sample),
        }
    }

    /// Transmittance between the point `q` of emitter `e` and `p`. The ray ends just in front of
    /// the emitter, so that the emitter does not occlude itself.
    pub(super) fn passed(&self, p: &SurfacePoint, q: Vec3, e: &Emitter) -> Vec3 {
        let to = q - p.origin;
        // Stop as far from the emitter's plane as a receiver on it would start.
        let height = e.normal.dot(to).abs();
        let stop = 2.0 * self.world.offset(q);
        let t_max = 1.0 - (stop / height.max(1e-30)).min(1.0);
        if t_max <= 0.0 {
            return Vec3::ONE;
        }
        self.world.transmitted(p.origin, to, t_max)
    }

    /// Radiance of the point `q` of `e` as seen from `p`. For nearby points, this is the texture's
    /// value at `q`. For distant ones, it is the mean over the part, which avoids the noise of a
    /// texture sampled at a few points.
    pub(super) fn radiance_at(&self, e: &Emitter, q: Vec3, p: &SurfacePoint) -> Vec3 {
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

/// Whether an emitter is this near to a point, and rises less than this above its surface, metres.
fn is_beside(e: &Emitter, p: &SurfacePoint, metres: f32) -> bool {
    let height = |corner: &Vec3| p.geometric.dot(corner - p.position);
    let distance = || closest_point(e.corners, p.position).0.distance(p.position);
    e.corners.iter().all(|c| height(c) < metres) && distance() < metres
}

/// A point uniform on the triangle.
pub(super) fn on_triangle([a, b, c]: [Vec3; 3], u: f32, v: f32) -> Vec3 {
    let s = u.sqrt();
    a * (1.0 - s) + b * (s * (1.0 - v)) + c * (s * v)
}

/// The part of a triangle above the receiver's horizon, as up to two triangles, and their number.
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
    // The closed form found light, so nothing can be above the horizon only due to rounding; the
    // corners get weight 0.
    ([[a, b, c], [a, c, d]], n.saturating_sub(2))
}
