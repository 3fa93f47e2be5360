//! Direct light at points in the air.

use glam::Vec3;
use mesh_ingest::LightKind;

use super::cap::Cap;
use super::sample::falloff;
use super::surfaces::on_triangle;
use super::{DirectLight, Term};
use crate::sampling::{SphericalTriangle, sample_4d};
use crate::world::SurfacePoint;

impl DirectLight<'_, '_> {
    /// Light that arrives at a point in space from all directions, straight from lamps, emitters
    /// and the bright parts of the sky. Lamps whose direct light is left out do not count.
    ///
    /// Calls `f` for each of about `samples` samples per light, with the unit direction towards the
    /// light and ∫ L dω from there (W/m² or lx on a surface that faces it).
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
        for (k, light) in world.scene.lights.iter().enumerate() {
            if world.leaves_out(k) {
                set += 1;
                continue;
            }
            let cap = Cap::of(light, at);
            let cookie = world.scene.cookie_factor(light, at);
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
                let light = light.intensity * cookie * (flux * self.directivity(light, -direction));
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
        // There is no hemisphere: with a zero normal, nothing is below the horizon.
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
                    Term::Group(node, _) => {
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
                    Term::Lamp(..) | Term::Lamps(..) | Term::Sky(_) => continue,
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
}
