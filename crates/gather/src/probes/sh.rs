//! Spherical harmonics of order two.

use glam::Vec3;

/// Nine RGB coefficients L_lm = ∫ L(ω) Y_lm(ω) dω of a function of direction, in the order L00,
/// L1−1, L10, L11, L2−2, L2−1, L20, L21, L22.
///
/// Real harmonics with the signs of Ramamoorthi and Hanrahan 2001 (no Condon–Shortley phase), for a
/// unit direction (x, y, z) in the glTF's axes:
///
/// | | Y_lm |
/// |---|---|
/// | Y00 | ½ √(1/π) |
/// | Y1−1, Y10, Y11 | √(3/4π) · y, z, x |
/// | Y2−2, Y2−1, Y21 | ½ √(15/π) · xy, yz, xz |
/// | Y20 | ¼ √(5/π) · (3z² − 1) |
/// | Y22 | ¼ √(15/π) · (x² − y²) |
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sh2(
    /// Coefficients, linear RGB.
    pub [Vec3; 9],
);

/// The factors of [`Sh2`]'s table, in the order of the coefficients.
const FACTORS: [f32; 9] = {
    let (y1, y2) = (0.488_602_52, 1.092_548_5);
    let (y20, y22) = (0.315_391_57, 0.546_274_24);
    [0.282_094_8, y1, y1, y1, y2, y2, y20, y2, y22]
};

/// The harmonics without their factors.
fn polynomials(d: Vec3) -> [f32; 9] {
    let Vec3 { x, y, z } = d;
    let zonal = 3.0 * z * z - 1.0;
    [1.0, y, z, x, x * y, y * z, zonal, x * z, x * x - y * y]
}

/// Y_lm at the unit `direction`.
pub(crate) fn basis(direction: Vec3) -> [f32; 9] {
    let mut y = polynomials(direction);
    for (y, k) in y.iter_mut().zip(FACTORS) {
        *y *= k;
    }
    y
}

impl Sh2 {
    /// The function itself at the unit `direction`: Σ L_lm Y_lm.
    pub fn value(&self, direction: Vec3) -> Vec3 {
        let y = basis(direction);
        self.0.iter().zip(y).map(|(c, y)| *c * y).sum()
    }

    /// Irradiance on a surface with the unit `normal`, if the function is the arriving radiance: Σ
    /// A_l L_lm Y_lm with the coefficients of the cosine lobe A = π, 2π/3, π/4. Higher orders would
    /// add about 1 % on average (Ramamoorthi and Hanrahan 2001). The worst case is a single point
    /// light: the sum is off by up to 9.4 % of the peak where the surface turns away from it, and
    /// falls to −4 % beyond.
    pub fn irradiance(&self, normal: Vec3) -> Vec3 {
        use std::f32::consts::PI;
        let band = |i: usize| match i {
            0 => PI,
            1..4 => 2.0 * PI / 3.0,
            _ => PI / 4.0,
        };
        let y = basis(normal);
        let terms = self.0.iter().zip(y).enumerate();
        terms.map(|(i, (c, y))| *c * (y * band(i))).sum()
    }
}

/// A direction uniform over the sphere.
pub(super) fn on_sphere(u: f32, v: f32) -> Vec3 {
    let y = 1.0 - 2.0 * u;
    let r = (1.0 - y * y).max(0.0).sqrt();
    let (sin, cos) = libm::sincosf(std::f32::consts::TAU * v);
    Vec3::new(r * cos, y, r * sin)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn factors_are_the_closed_forms() {
        let k = |x: f64| x as f32;
        let y1 = k((3.0 / (4.0 * PI)).sqrt());
        let y2 = k(0.5 * (15.0 / PI).sqrt());
        let expected = [
            k(0.5 * (1.0 / PI).sqrt()),
            y1,
            y1,
            y1,
            y2,
            y2,
            k(0.25 * (5.0 / PI).sqrt()),
            y2,
            k(0.25 * (15.0 / PI).sqrt()),
        ];
        assert_eq!(FACTORS, expected);
    }

    #[test]
    fn harmonics_are_orthonormal() {
        // A product rule: the midpoint rule in longitude is exact for polynomials of degree 4 with
        // 16 steps; in height its error is h²/24 of the second derivative's integral, below 1e-5
        // with 512 steps.
        let (n, m) = (512, 16);
        let mut products = [[0f64; 9]; 9];
        for i in 0..n {
            for j in 0..m {
                let u = (i as f32 + 0.5) / n as f32;
                let v = (j as f32 + 0.5) / m as f32;
                let y = basis(on_sphere(u, v)).map(f64::from);
                for (a, row) in products.iter_mut().enumerate() {
                    for (b, p) in row.iter_mut().enumerate() {
                        *p += y[a] * y[b] * 4.0 * PI / f64::from(n * m);
                    }
                }
            }
        }
        for (a, row) in products.iter().enumerate() {
            for (b, p) in row.iter().enumerate() {
                let expected = if a == b { 1.0 } else { 0.0 };
                assert!((p - expected).abs() < 1e-4, "{a} {b}: {p}");
            }
        }
    }

    #[test]
    fn irradiance_is_that_of_closed_forms() {
        // L = 1: E = π. L = 1 + ω·a: the linear term adds ∫ (ω·a) max(0, ω·n) dω = 2π/3 n·a.
        let mut sh = Sh2::default();
        sh.0[0] = Vec3::splat((4.0 * PI).sqrt() as f32);
        let n = Vec3::new(0.6, 0.0, -0.8);
        assert!((sh.irradiance(n).x - std::f32::consts::PI).abs() < 1e-5);
        let a = Vec3::new(0.1, 0.2, 0.3);
        let k = 1.0 / FACTORS[1];
        for (i, x) in [a.y, a.z, a.x].into_iter().enumerate() {
            sh.0[1 + i] = Vec3::splat(x * k);
        }
        assert!((sh.value(n).x - (1.0 + n.dot(a))).abs() < 1e-5);
        let e = std::f32::consts::PI * (1.0 + 2.0 / 3.0 * n.dot(a));
        assert!((sh.irradiance(n).x - e).abs() < 1e-5);
        // L = z²: E(n) = ∫ z² max(0, ω·n) dω = π/4 (1 + n_z²), from the moments of the cosine lobe:
        // ½π along n, ¼π across it.
        let mut sh = Sh2::default();
        // z² = (3z² − 1)/3 + 1/3.
        sh.0[0] = Vec3::splat((4.0 * PI).sqrt() as f32 / 3.0);
        sh.0[6] = Vec3::splat(1.0 / (3.0 * FACTORS[6]));
        for n in [Vec3::X, Vec3::Z, n] {
            let e = std::f32::consts::FRAC_PI_4 * (1.0 + n.z * n.z);
            assert!((sh.irradiance(n).x - e).abs() < 1e-5, "{n}");
        }
    }
}
