//! Evaluates luminaires' intensities by direction.

use glam::Vec3;

use crate::scene::{Light, Profile, Scene};

/// Tolerance beyond the measured range, degrees: `f32` angles of directions in the plane at 90° are
/// off by up to 2e-5 degrees either way, and half of them would be dark.
const RIM: f32 = 1e-3;

impl Profile {
    /// The factor in `direction` (any non-zero length, in the profile's own axes: nadir is −Y),
    /// bilinear in the two angles; 0 outside the vertical range.
    ///
    /// Straight up and down, where the horizontal angle is undefined, it uses the plane that
    /// `atan2` gives; valid profiles agree there in all planes.
    pub fn value(&self, direction: Vec3) -> f32 {
        let n = self.vertical.len();
        let (Some(&low), Some(&high)) = (self.vertical.first(), self.vertical.last()) else {
            return 0.0;
        };
        // atan2 instead of acos, which loses half the digits near nadir.
        let across = libm::hypotf(direction.x, direction.z);
        let theta = libm::atan2f(across, -direction.y).to_degrees();
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
        // Two planes, 0° and 360°, are the same one: the profile is rotationally symmetric.
        if self.horizontal.len() <= 2 {
            return column(0);
        }
        let phi = libm::atan2f(-direction.z, direction.x).to_degrees();
        let (h, fh) = place(&self.horizontal, if phi < 0.0 { phi + 360.0 } else { phi });
        let first = column(h);
        first + fh * (column((h + 1).min(self.horizontal.len() - 1)) - first)
    }

    /// ∫ value dω over the sphere, sr: the luminous flux (lumen) of a light of intensity 1
    /// (candela) with this profile.
    ///
    /// Exact for the bilinear values of [`Profile::value`]: the trapezoid rule is exact along the
    /// horizontal angle, and ∫ (a + bθ) sin θ dθ along the vertical angle has a closed form.
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
                    va * libm::cos(a) - vb * libm::cos(b) + slope * (libm::sin(b) - libm::sin(a))
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

/// The interval of ascending `knots` that contains `x`, and the position in it, 0..=1; clamped to
/// the ends.
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
    /// Factor of `light`'s measured distribution in `direction`, which points from the light into
    /// recentred world space (any non-zero length); 1 without a profile.
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
