//! Samples of lamps and skies at one point of a receiver.

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use super::cap::Cap;
use super::tally::{Sample, Tally};
use super::{DirectLight, Term};
use crate::emitters::Parts;
use crate::sky::SkyCell;
use crate::world::{SurfacePoint, luminance};

impl DirectLight<'_, '_> {
    /// Approximate unoccluded contribution of a lamp to a point, without its cookie; 0 only if the
    /// lamp cannot contribute.
    pub(super) fn weight_of_lamp(&self, light: &Light, point: &SurfacePoint) -> f32 {
        match Cap::of(light, point.position) {
            Some(cap) => luminance(light.intensity) * cap.unoccluded(point.normal),
            None => self
                .arrival(light, point)
                .map_or(0.0, |a| luminance(a.value)),
        }
    }

    /// Whether samples of the light need random numbers.
    pub(super) fn is_random(&self, term: &Term) -> bool {
        match term {
            Term::Lamp(light, _) => match light.kind {
                LightKind::Directional { angle, .. } => angle > 0.0,
                LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } => radius > 0.0,
            },
            _ => true,
        }
    }

    /// Takes one sample of a light at one point. `parts` are those of a group, if known.
    pub(super) fn sample(
        &self,
        term: &Term,
        parts: Option<&Parts>,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        match term {
            Term::Lamp(light, group) => self.lamp(light, (*group, 1.0), p, random, tally),
            Term::Lamps(node, chance) => self.lamps((*node, *chance), p, random, tally),
            Term::Sky(cell) => self.sky(cell, p, random, tally),
            Term::Triangle(e) => self.triangle(e, p, random, tally),
            Term::Group(node, chance) => self.group((*node, *chance), parts, p, random, tally),
        }
    }

    /// One lamp of a group, which stands for all of it, and for others if the group was chosen with
    /// a probability below 1.
    fn lamps(
        &self,
        (node, chance): (u32, f32),
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        let lights = &self.world.scene.lights;
        // Choosing within a group may need more than the 24 bits of one number.
        let x = f64::from(random[2]) + f64::from(random[3]) * 2f64.powi(-24);
        let Some((k, probability)) = self.lamps.pick(lights, node, p.position, x) else {
            return;
        };
        let group = self.world.lamp_group(k as usize);
        let stands_for = (group, 1.0 / (probability * chance));
        self.lamp(&lights[k as usize], stands_for, p, random, tally);
    }

    /// A lamp, which stands for this many times its own light.
    fn lamp(
        &self,
        light: &Light,
        (group, times): (usize, f32),
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        if let Some(cap) = Cap::of(light, p.position) {
            return self.disc(light, &cap, (group, times), p, random, tally);
        }
        let Some(a) = self.arrival(light, p) else {
            return;
        };
        let cookie = self.world.scene.cookie_factor(light, p.position);
        // Where a picture is black, the lamp counts as hidden, so that the picture's edges get as
        // many samples as edges of shadows.
        let passed = if cookie == Vec3::ZERO {
            Vec3::ZERO
        } else {
            tally.passed(|| self.world.transmitted(p.origin, a.to, a.t_max))
        };
        tally.plain(&Sample {
            value: a.value * cookie * times,
            passed,
            direction: a.axis,
            cos: a.cos,
            group,
        });
    }

    /// A lamp that appears as a disc: closed form, with one shadow ray to a point on it.
    pub(super) fn disc(
        &self,
        light: &Light,
        cap: &Cap,
        (group, times): (usize, f32),
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
        let cookie = self.world.scene.cookie_factor(light, p.position);
        let radiance = light.intensity * cookie * self.directivity(light, -direction);
        let passed = if p.geometric.dot(direction) <= 0.0 || radiance == Vec3::ZERO {
            Vec3::ZERO
        } else {
            tally.passed(|| self.world.transmitted(p.origin, direction, reach))
        };
        let sample = Sample {
            value: radiance * weight * times,
            passed,
            direction,
            cos,
            group,
        };
        tally.weighted(unoccluded, weight, &sample);
    }

    pub(super) fn sky(
        &self,
        cell: &SkyCell,
        p: &SurfacePoint,
        random: [f32; 4],
        tally: &mut Tally,
    ) {
        let Some(bright) = &self.world.bright else {
            return;
        };
        let (direction, light) = bright.sample(cell, random[0], random[1]);
        let cos = p.normal.dot(direction);
        if cos <= 0.0 || p.geometric.dot(direction) <= 0.0 {
            return;
        }
        let passed = tally.passed(|| (self.world).transmitted(p.origin, direction, f32::INFINITY));
        tally.plain(&Sample {
            value: light * cos,
            passed,
            direction,
            cos,
            group: self.world.sky_group(),
        });
    }

    /// Factor on a lamp's intensity in the unit direction `leaving`: the spot's cone, and its
    /// profile.
    pub(super) fn directivity(&self, light: &Light, leaving: Vec3) -> f32 {
        let cone = match light.kind {
            LightKind::Spot {
                direction,
                inner,
                outer,
                ..
            } => {
                // The cone of KHR_lights_punctual: linear in the cosine between the two angles,
                // then squared.
                let (inner, outer) = (libm::cosf(inner), libm::cosf(outer));
                let scale = 1.0 / (inner - outer).max(0.001);
                let cone = ((direction.dot(leaving) - outer) * scale).clamp(0.0, 1.0);
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

    /// Unoccluded light at `p` from a light that comes from one point or one direction, without its
    /// cookie; `None` if it is 0.
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
}

/// Light from one point or direction.
struct Arrival {
    /// Direction and end of the shadow ray.
    to: Vec3,
    t_max: f32,
    /// Unit direction towards the light, and its cosine.
    axis: Vec3,
    cos: f32,
    /// Unoccluded irradiance.
    value: Vec3,
}

/// 1/d², windowed to reach 0 at `range` as KHR_lights_punctual recommends.
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
