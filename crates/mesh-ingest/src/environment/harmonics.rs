//! Converts spherical harmonics of irradiance to a map of radiance.
//!
//! Based on: Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment
//! Maps" (2001), which the extension refers to: E(n) = Σ E_lm Y_lm(n) with the real basis of its
//! equation 3 (all signs positive), in the order (0,0), (1,−1), (1,0), (1,1), (2,−2) … (2,2), and
//! E_lm = Â_l L_lm with Â = π, 2π/3, π/4.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Vec3};

use super::cube::map_direction;

/// Width of the map: between its pixels, harmonics of degree 2 change by less than a hundredth of
/// their range.
pub(super) const WIDTH: u32 = 128;
pub(super) const HEIGHT: u32 = 64;

/// The radiances whose irradiance has these coefficients, rotated by `rotation`, and the number of
/// negative pixels that were set to 0.
pub(super) fn to_map(irradiance: &[DVec3; 9], rotation: DQuat) -> (Vec<Vec3>, u64) {
    let bands = [PI, 2.0 * PI / 3.0, PI / 4.0];
    let band = |k: usize| bands[if k == 0 { 0 } else { 1 + usize::from(k >= 4) }];
    let inverse = rotation.inverse();
    let mut clamped = 0;
    let mut pixels = Vec::with_capacity((WIDTH * HEIGHT) as usize);
    for j in 0..HEIGHT {
        for i in 0..WIDTH {
            let u = (f64::from(i) + 0.5) / f64::from(WIDTH);
            let v = (f64::from(j) + 0.5) / f64::from(HEIGHT);
            let y = basis(inverse * map_direction(u, v));
            let radiance: DVec3 = (0..9).map(|k| irradiance[k] * (y[k] / band(k))).sum();
            clamped += u64::from(radiance.min_element() < 0.0);
            pixels.push(radiance.max(DVec3::ZERO).as_vec3());
        }
    }
    (pixels, clamped)
}

/// The real spherical harmonics up to degree 2 in the unit direction `d`.
fn basis(d: DVec3) -> [f64; 9] {
    let DVec3 { x, y, z } = d;
    let c0 = 0.5 * (1.0 / PI).sqrt();
    let c1 = 0.5 * (3.0 / PI).sqrt();
    let c2 = 0.5 * (15.0 / PI).sqrt();
    let c20 = 0.25 * (5.0 / PI).sqrt();
    [
        c0,
        c1 * y,
        c1 * z,
        c1 * x,
        c2 * x * y,
        c2 * y * z,
        c20 * (3.0 * z * z - 1.0),
        c2 * x * z,
        0.5 * c2 * (x * x - y * y),
    ]
}
