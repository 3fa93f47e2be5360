//! Lamps that appear as a disc: the sun, and lamps with a radius.

use std::f32::consts::PI;

use glam::Vec3;
use mesh_ingest::{Light, LightKind};

use super::sample::falloff;
use crate::sampling::concentric_disc;

/// A uniformly bright disc on the sky of a receiver: all directions within an angle of an axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cap {
    /// Unit direction towards the centre.
    pub axis: Vec3,
    /// sin² of the angle between the axis and the rim, in (0, 1].
    sin2: f32,
    /// Radiance of the disc per unit of the light's intensity: in 1/m² for lamps and in 1/sr for
    /// suns; 0 beyond a lamp's range.
    radiance: f32,
    /// The lamp's sphere: centre relative to the receiver, and radius.
    sphere: Option<(Vec3, f32)>,
}

impl Cap {
    /// The light as seen from `at`; `None` for point lights and parallel light.
    pub(super) fn of(light: &Light, at: Vec3) -> Option<Cap> {
        match light.kind {
            LightKind::Directional { direction, angle } if angle > 0.0 => {
                let sin2 = libm::sinf(angle.min(0.5 * PI)).powi(2);
                Some(Cap {
                    axis: -direction,
                    sin2,
                    // The intensity is the irradiance E = π L sin² on a surface that faces the sun.
                    radiance: 1.0 / (PI * sin2),
                    sphere: None,
                })
            }
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
            } if radius > 0.0 => {
                let to = position - at;
                let d2 = to.length_squared();
                let r2 = radius * radius;
                let window = falloff(to, range) * d2;
                Some(Cap {
                    axis: to.try_normalize().unwrap_or(Vec3::Y),
                    // A receiver inside the sphere sees nothing else, as it would from the sphere's
                    // surface.
                    sin2: (r2 / d2.max(1e-30)).min(1.0),
                    // I = π r² L in every direction.
                    radiance: window / (PI * r2),
                    sphere: Some((to, radius)),
                })
            }
            _ => None,
        }
    }

    /// Unoccluded irradiance per unit of intensity on a surface with this unit normal, in closed
    /// form.
    ///
    /// A disc entirely above the horizon gives π L sin²σ cosθ. For one that the horizon cuts:
    /// Snyder, *Area light sources for real-time graphics*, 1996, as in Lagarde & de Rousiers,
    /// *Moving Frostbite to physically based rendering*, 2014, listing 9.
    pub(super) fn unoccluded(&self, normal: Vec3) -> f32 {
        let cos = normal.dot(self.axis).clamp(-1.0, 1.0);
        let sin = (1.0 - cos * cos).sqrt();
        let area = if cos * cos >= self.sin2 || sin < 1e-6 {
            PI * self.sin2 * cos.max(0.0)
        } else {
            let x = (1.0 / self.sin2 - 1.0).sqrt();
            let y = (-x * cos / sin).clamp(-1.0, 1.0);
            let z = sin * (1.0 - y * y).sqrt();
            ((cos * libm::acosf(y) - x * z) * self.sin2 + libm::atan2f(z, x)).max(0.0)
        };
        self.radiance * area
    }

    /// Solid angle in sr: 2π(1 − cosσ), computed without its cancellation.
    pub(super) fn solid_angle(&self) -> f32 {
        2.0 * PI * self.sin2 / (1.0 + (1.0 - self.sin2).sqrt())
    }

    /// Radiance per unit of intensity.
    pub(super) fn radiance(&self) -> f32 {
        self.radiance
    }

    /// A unit direction sampled uniformly from the disc, and the length of its shadow ray, which
    /// ends at the lamp's surface.
    pub(super) fn sample(&self, u: f32, v: f32) -> (Vec3, f32) {
        // 1 − cos is uniform over solid angle: it is the scaled square of the radius on the unit
        // disc.
        let p = concentric_disc(u, v);
        let r2 = p.length_squared().min(1.0);
        let most = self.sin2 / (1.0 + (1.0 - self.sin2).sqrt());
        let sag = most * r2;
        // sin² = 1 − (1 − sag)².
        let scale = (most * (2.0 - sag)).max(0.0).sqrt();
        let (x, y) = self.axis.any_orthonormal_pair();
        let direction = x * (p.x * scale) + y * (p.y * scale) + self.axis * (1.0 - sag);
        let reach = match self.sphere {
            None => f32::INFINITY,
            Some((to, radius)) => {
                let along = to.dot(direction);
                let off2 = (to - direction * along).length_squared();
                (along - (radius * radius - off2).max(0.0).sqrt()).max(0.0)
            }
        };
        (direction, reach)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::light;
    use crate::sampling::sample_2d;

    fn sphere(position: Vec3, radius: f32) -> Light {
        light(
            7.0,
            LightKind::Point {
                position,
                range: None,
                radius,
            },
        )
    }

    #[test]
    fn the_closed_form_is_the_mean_over_the_disc() {
        // Above the horizon, cut by it, just touching it, almost entirely below it, and from inside
        // the lamp.
        for (k, (position, radius)) in [
            (Vec3::new(0.3, 2.0, 0.0), 0.5),
            (Vec3::new(2.0, 0.2, 0.5), 0.9),
            (Vec3::new(2.0, 0.5, 0.0), 0.5),
            (Vec3::new(2.0, -0.6, 0.0), 0.9),
            (Vec3::new(0.0, 0.2, 0.1), 0.5),
            (Vec3::new(1e3, 40.0, 0.0), 0.01),
        ]
        .into_iter()
        .enumerate()
        {
            let cap = Cap::of(&sphere(position, radius), Vec3::ZERO).expect("a lamp with a radius");
            let n = 1 << 16;
            let mut sum = 0f64;
            for i in 0..n {
                let [u, v] = sample_2d(i, 0, 3);
                let (d, _) = cap.sample(u, v);
                assert!((d.length() - 1.0).abs() < 1e-5);
                sum += d.y.max(0.0) as f64;
            }
            let sampled = sum / n as f64 * (cap.solid_angle() * cap.radiance()) as f64;
            let exact = cap.unoccluded(Vec3::Y) as f64;
            // 65,536 Sobol points on an integrand with a kink have an error of about n^-3/4 =
            // 2.4e-4 of the disc's total flux. The sum in the closed form loses 1e-5 of that flux
            // to cancellation.
            let whole = (cap.solid_angle() * cap.radiance()) as f64;
            assert!(
                (sampled - exact).abs() < 3e-4 * whole,
                "{k}: {sampled} {exact}"
            );
        }
    }

    #[test]
    fn far_lamps_are_points_and_suns_give_their_lux() {
        let position = Vec3::new(3.0, 4.0, 0.0);
        let cap = Cap::of(&sphere(position, 0.1), Vec3::ZERO).expect("a lamp");
        // Exactly I cosθ/d² while the sphere is above the horizon.
        assert!((cap.unoccluded(Vec3::Y) - 0.8 / 25.0).abs() < 1e-7);
        let sun = light(
            1.0,
            LightKind::Directional {
                direction: Vec3::NEG_Y,
                angle: 0.01,
            },
        );
        let cap = Cap::of(&sun, Vec3::ZERO).expect("a sun");
        assert!((cap.unoccluded(Vec3::Y) - 1.0).abs() < 1e-6);
        // L = E / (π sin²), so L times the solid angle π sin² (1 + O(σ²)) gives E again.
        assert!((cap.radiance() * cap.solid_angle() - 1.0).abs() < 1e-4);
    }

    #[test]
    fn shadow_rays_end_on_the_lamp() {
        let cap = Cap::of(&sphere(Vec3::new(0.0, 2.0, 0.0), 0.5), Vec3::ZERO).expect("a lamp");
        for i in 0..64 {
            let [u, v] = sample_2d(i, 0, 1);
            let (d, t) = cap.sample(u, v);
            let off = (d * t - Vec3::new(0.0, 2.0, 0.0)).length() - 0.5;
            assert!(off.abs() < 1e-3 && t < 2.0, "{off}");
        }
    }
}
