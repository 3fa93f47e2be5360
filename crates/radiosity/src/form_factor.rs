//! Form factors in closed form.

use glam::DVec3;

/// Form factor from a differential area at `point` with unit `normal` to the polygon. The
/// unoccluded irradiance at `point` is `E = F · B` if the polygon has uniform radiosity B.
///
/// `corners` (3 to 8, in metres, planar) are counter-clockwise as seen from the polygon's front. A
/// point behind the polygon gets a negative value of the same magnitude. The part below the
/// receiver's horizon is clipped.
///
/// Lambert's contour sum, `F = 1/2π Σ_i Θ_i n·(r_i × r_{i+1})/|r_i × r_{i+1}|`, with Θ_i the angle
/// that edge *i* subtends. The angle is computed as `atan2(|a × b|, a·b)`, which, unlike `asin` and
/// `acos`, is accurate beyond 90° and for tiny angles (Lambert 1760; Baum, Rushmeier, Winget,
/// *Improving radiosity solutions through the use of analytically determined form-factors*, 1989).
///
/// The result is exact up to rounding (about 1e-13 absolute) if `point` is off the polygon, and 0
/// if it is in the polygon's plane but outside it. For a point on the polygon, the result is 0 or
/// up to ±1, depending on the contour.
pub fn form_factor_polygon(point: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let n = corners.len();
    debug_assert!((3..=8).contains(&n));
    // Corners relative to the point, clipped at the horizon.
    let mut above = [DVec3::ZERO; 10];
    let mut m = 0;
    for i in 0..n {
        let (a, b) = (corners[i] - point, corners[(i + 1) % n] - point);
        let (da, db) = (a.dot(normal), b.dot(normal));
        if da >= 0.0 {
            above[m] = a;
            m += 1;
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            above[m] = a + (b - a) * (da / (da - db));
            m += 1;
        }
    }
    if m < 3 {
        return 0.0;
    }
    let mut sum = 0.0;
    for i in 0..m {
        let (a, b) = (above[i], above[(i + 1) % m]);
        let c = a.cross(b);
        let sine = c.length();
        if sine > 0.0 {
            sum += libm::atan2(sine, a.dot(b)) * (c.dot(normal) / sine);
        }
    }
    // Counter-clockwise from the front is clockwise as seen by the receiver.
    -sum / (2.0 * std::f64::consts::PI)
}

#[cfg(test)]
mod tests;
