//! Form factors in closed form.

use glam::DVec3;

/// Form factor from a differential area at `point` with unit `normal` to the polygon: the irradiance there is
/// `E = F · B` when the polygon has uniform radiosity B and nothing is in between.
///
/// `corners` (3 to 8, metres, planar) run counter-clockwise as seen from the polygon's front; a point behind the polygon gets a
/// negative value of the same size. The part below the receiver's horizon is cut off first.
///
/// Lambert's contour sum, `F = 1/2π Σ_i Θ_i n·(r_i × r_{i+1})/|r_i × r_{i+1}|`, with Θ_i the angle that edge *i* subtends. The angle
/// is taken as `atan2(|a × b|, a·b)`, which is exact past 90° and for tiny angles, where `asin` and `acos` are not
/// (Lambert 1760; Baum, Rushmeier, Winget, *Improving radiosity solutions through the use of analytically determined
/// form-factors*, 1989).
///
/// Exact to rounding (about 1e-13 in absolute terms) when `point` is off the polygon; 0 when it lies in its plane outside it.
/// A point on the polygon itself gets 0 or up to ±1, as its contour goes.
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
            sum += sine.atan2(a.dot(b)) * (c.dot(normal) / sine);
        }
    }
    // Counter-clockwise from the front is clockwise from the receiver in front of it.
    -sum / (2.0 * std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A rectangle a × b above the origin's tangent plane at height c, one corner straight above the point:
    /// F = 1/2π (A/√(1+A²) atan(B/√(1+A²)) + B/√(1+B²) atan(A/√(1+B²))), A = a/c, B = b/c
    /// (Howell, *A catalog of radiation heat transfer configuration factors*, B-3).
    fn corner_rectangle(a: f64, b: f64, c: f64) -> f64 {
        let (x, y) = (a / c, b / c);
        let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        (x / p * (y / p).atan() + y / q * (x / q).atan()) / (2.0 * PI)
    }

    fn facing_rectangle(a: f64, b: f64, c: f64) -> [DVec3; 4] {
        // Front faces down (−z): counter-clockwise as seen from below.
        [
            DVec3::new(0., 0., c),
            DVec3::new(0., b, c),
            DVec3::new(a, b, c),
            DVec3::new(a, 0., c),
        ]
    }

    #[test]
    fn rectangle_overhead_matches_the_catalogue_over_twelve_decades() {
        for e in -6..=6 {
            let c = 10f64.powi(e);
            for (a, b) in [(1.0, 1.0), (0.01, 100.0), (3.0, 0.5)] {
                let f = form_factor_polygon(DVec3::ZERO, DVec3::Z, &facing_rectangle(a, b, c));
                let exact = corner_rectangle(a, b, c);
                // Cancellation among four edge terms of order a/c: rounding of each is 1e-16.
                assert!(
                    (f - exact).abs() <= 1e-13 + 1e-9 * exact,
                    "{a} {b} {c}: {f} {exact}"
                );
            }
        }
    }

    #[test]
    fn behind_is_negative_and_below_the_horizon_is_nothing() {
        let r = facing_rectangle(1., 1., 1.);
        let back: Vec<_> = r.iter().rev().copied().collect();
        let f = form_factor_polygon(DVec3::ZERO, DVec3::Z, &r);
        assert!((form_factor_polygon(DVec3::ZERO, DVec3::Z, &back) + f).abs() < 1e-15);
        assert_eq!(form_factor_polygon(DVec3::ZERO, -DVec3::Z, &r), 0.0);
    }

    #[test]
    fn a_wall_that_crosses_the_horizon_counts_its_upper_half_only() {
        // A wall in the plane x = 1 from z = −5 to 5 equals the same wall from z = 0 to 5.
        let wall = |z0: f64| {
            [
                DVec3::new(1., -2., z0),
                DVec3::new(1., -2., 5.),
                DVec3::new(1., 2., 5.),
                DVec3::new(1., 2., z0),
            ]
        };
        let (whole, half) = (
            form_factor_polygon(DVec3::ZERO, DVec3::Z, &wall(-5.)),
            form_factor_polygon(DVec3::ZERO, DVec3::Z, &wall(0.)),
        );
        assert!(
            (whole - half).abs() < 1e-15 && whole > 0.1,
            "{whole} {half}"
        );
    }

    #[test]
    fn the_inside_of_a_cube_sums_to_one_wherever_one_stands() {
        let p = DVec3::new(0.3, 0.2, 0.1);
        let c = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64);
        // Faces counter-clockwise from inside.
        let faces = [
            [0, 2, 6, 4],
            [1, 5, 7, 3],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 1, 3, 2],
            [4, 6, 7, 5],
        ];
        for n in [DVec3::X, DVec3::new(1., 2., -3.).normalize(), -DVec3::Z] {
            let sum: f64 = faces
                .iter()
                .map(|f| form_factor_polygon(p, n, &f.map(c)))
                .sum();
            assert!((sum.abs() - 1.0).abs() < 1e-14, "{sum}");
        }
    }
}
