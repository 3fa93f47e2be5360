//! Looking up luminaires' intensities by direction.

use glam::Vec3;

use crate::scene::{Light, Profile, Scene};

/// Directions this far beyond the measured range (degrees) still read its last value: `f32` angles
/// of directions in the plane at 90° are off by up to 2e-5 degrees either way, and half of them
/// would be dark.
const RIM: f32 = 1e-3;

impl Profile {
    /// The factor in `direction` (any length but 0, in the profile's own axes: nadir is −Y),
    /// bilinear in the two angles; 0 outside of the vertical range.
    ///
    /// Straight up and down, where the horizontal angle means nothing, it reads the plane that
    /// `atan2` names; sound profiles agree there in all planes.
    pub fn value(&self, direction: Vec3) -> f32 {
        let n = self.vertical.len();
        let (Some(&low), Some(&high)) = (self.vertical.first(), self.vertical.last()) else {
            return 0.0;
        };
        // atan2 rather than acos, which loses half the digits about nadir.
        let across = direction.x.hypot(direction.z);
        let theta = across.atan2(-direction.y).to_degrees();
        // Written so that NaN is outside.
        if !(theta >= low - RIM && theta <= high + RIM) {
            return 0.0;
        }
        let (v, fv) = place(&self.vertical, theta);
        let column = |h: usize| {
            let at = |k: usize| {
                self.values
                    .get(h * n + k.min(n - 1))
                    .copied()
                    .unwrap_or(0.0)
            };
            let first = at(v);
            first + fv * (at(v + 1) - first)
        };
        // Two planes, 0° and 360°, are one: the light is the same all around.
        if self.horizontal.len() <= 2 {
            return column(0);
        }
        let phi = (-direction.z).atan2(direction.x).to_degrees();
        let (h, fh) = place(&self.horizontal, if phi < 0.0 { phi + 360.0 } else { phi });
        let first = column(h);
        first + fh * (column((h + 1).min(self.horizontal.len() - 1)) - first)
    }

    /// ∫ value dω over the sphere, sr: the luminous flux (lumen) of a light of intensity 1
    /// (candela) that wears the profile.
    ///
    /// Exact for the bilinear values that [`Profile::value`] gives: along the horizontal angle the
    /// trapezoid rule is, and along the vertical one ∫ (a + bθ) sin θ dθ has a closed form.
    pub fn flux(&self) -> f64 {
        let n = self.vertical.len();
        if n < 2 || self.values.len() < n * self.horizontal.len() {
            return 0.0;
        }
        let column = |h: usize| -> f64 {
            (0..n - 1)
                .map(|k| {
                    let [a, b] = [k, k + 1].map(|k| f64::from(self.vertical[k]).to_radians());
                    let [va, vb] = [k, k + 1].map(|k| f64::from(self.values[h * n + k]));
                    let slope = (vb - va) / (b - a);
                    va * a.cos() - vb * b.cos() + slope * (b.sin() - a.sin())
                })
                .sum()
        };
        let columns: Vec<f64> = (0..self.horizontal.len()).map(column).collect();
        (1..self.horizontal.len())
            .map(|h| {
                let width = f64::from(self.horizontal[h] - self.horizontal[h - 1]).to_radians();
                0.5 * width * (columns[h - 1] + columns[h])
            })
            .sum()
    }
}

/// The interval of ascending `knots` that holds `x`, and how far into it, 0..=1; the ends where `x`
/// lies outside.
fn place(knots: &[f32], x: f32) -> (usize, f32) {
    let last = knots.len().saturating_sub(2);
    let k = knots
        .partition_point(|&knot| knot <= x)
        .saturating_sub(1)
        .min(last);
    let (a, b) = (knots[k], knots[(k + 1).min(knots.len() - 1)]);
    let f = if b > a { (x - a) / (b - a) } else { 0.0 };
    (k, f.clamp(0.0, 1.0))
}

impl Scene {
    /// What `light`'s measured distribution makes of its intensity in `direction`, which points
    /// from the light into recentred world space (any length but 0); 1 where it has none.
    pub fn profile_factor(&self, light: &Light, direction: Vec3) -> f32 {
        match light.profile {
            None => 1.0,
            Some(worn) => self
                .profiles
                .get(worn.profile)
                .map_or(1.0, |profile| profile.value(worn.from_world * direction)),
        }
    }
}
