//! Low-discrepancy points, and mappings from them to directions and positions.

use glam::{Vec2, Vec3};

/// Point `index` (< 2^16) of a four-dimensional Owen-scrambled Sobol sequence with scrambling
/// `seed`, in [0, 1)⁴.
///
/// Each `set` is a separate sequence: the same first four dimensions with a new scrambling and a
/// new order of points that keeps aligned blocks of 2^k points together (Burley, *Practical
/// hash-based Owen scrambling*, 2020). The higher dimensions of Sobol's sequence are no substitute:
/// 1024 points in dimensions 252 and 253 leave half of 32 × 32 cells empty.
#[inline]
pub fn sample_4d(index: u32, set: u32, seed: u32) -> [f32; 4] {
    if set == 0 {
        return sobol_burley::sample_4d(index & 0xffff, 0, seed);
    }
    let seed = hash_u32(seed ^ set.wrapping_mul(0x9e37_79b9));
    sobol_burley::sample_4d(shuffled(index, seed) & 0xffff, 0, seed.rotate_left(16))
}

/// Permutes indices so that every aligned block of 2^k of them is mapped to an aligned block:
/// Owen's scrambling in base 2, with the hash of Laine and Karras, *Stratified sampling for
/// stochastic transparency*, 2011.
#[inline]
fn shuffled(index: u32, seed: u32) -> u32 {
    let mut x = index.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6u32] {
        x ^= x.wrapping_mul(factor);
    }
    x.reverse_bits()
}

/// The first two dimensions of [`sample_4d`].
#[inline]
pub fn sample_2d(index: u32, set: u32, seed: u32) -> [f32; 2] {
    let s = sample_4d(index, set, seed);
    [s[0], s[1]]
}

/// A 32-bit integer hash (Wellons' `lowbias32`, 2018), for seeds.
#[inline]
pub fn hash_u32(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Maps the unit square to the unit disc, preserving area ratios and neighbourhoods (Shirley & Chiu
/// 1997).
#[inline]
pub(crate) fn concentric_disc(u: f32, v: f32) -> Vec2 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return Vec2::ZERO;
    }
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};
    let (r, phi) = if a.abs() > b.abs() {
        (a, FRAC_PI_4 * (b / a))
    } else {
        (b, FRAC_PI_2 - FRAC_PI_4 * (a / b))
    };
    let (s, c) = libm::sincosf(phi);
    Vec2::new(r * c, r * s)
}

/// A direction around the unit `normal`, with density cosθ/π.
#[inline]
pub fn cosine_hemisphere(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let d = concentric_disc(u, v);
    let z = (1.0 - d.length_squared()).max(0.0).sqrt();
    let (x, y) = normal.any_orthonormal_pair();
    x * d.x + y * d.y + normal * z
}

/// A triangle as seen from a point, prepared for uniform sampling by solid angle (Arvo, *Stratified
/// sampling of spherical triangles*, 1995).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SphericalTriangle {
    a: Vec3,
    b: Vec3,
    c: Vec3,
    cos_c: f32,
    alpha: f32,
    /// Solid angle, sr.
    pub solid_angle: f32,
}

impl SphericalTriangle {
    /// `None` if the triangle is degenerate as seen from the point.
    pub(crate) fn new(corners: [Vec3; 3], from: Vec3) -> Option<Self> {
        let dir = |p: Vec3| (p - from).try_normalize();
        let (a, b, c) = (dir(corners[0])?, dir(corners[1])?, dir(corners[2])?);
        let ab = a.cross(b).try_normalize()?;
        let bc = b.cross(c).try_normalize()?;
        let ca = c.cross(a).try_normalize()?;
        let angle = |x: Vec3, y: Vec3| libm::acosf(x.dot(y).clamp(-1.0, 1.0));
        let (alpha, beta, gamma) = (angle(ab, -ca), angle(bc, -ab), angle(ca, -bc));
        // Van Oosterom & Strackee 1983: unlike α + β + γ − π, without cancellation for small
        // triangles.
        let num = a.dot(b.cross(c)).abs();
        let den = 1.0 + a.dot(b) + b.dot(c) + c.dot(a);
        let solid_angle = 2.0 * libm::atan2f(num, den);
        let _ = (beta, gamma);
        (solid_angle > 0.0).then_some(SphericalTriangle {
            a,
            b,
            c,
            cos_c: a.dot(b),
            alpha,
            solid_angle,
        })
    }

    /// Unit direction from the point into the triangle.
    pub(crate) fn sample(&self, u: f32, v: f32) -> Vec3 {
        let area = u * self.solid_angle;
        let (sin_alpha, cos_alpha) = libm::sincosf(self.alpha);
        let (s, t) = libm::sincosf(area - self.alpha);
        let u_ = t - cos_alpha;
        let v_ = s + sin_alpha * self.cos_c;
        let q_num = (v_ * t - u_ * s) * cos_alpha - v_;
        let q_den = (v_ * s + u_ * t) * sin_alpha;
        let q = if q_den.abs() > 1e-20 {
            (q_num / q_den).clamp(-1.0, 1.0)
        } else {
            1.0
        };
        let orth = |x: Vec3, y: Vec3| (x - y * x.dot(y)).normalize_or_zero();
        let c2 = self.a * q + orth(self.c, self.a) * (1.0 - q * q).max(0.0).sqrt();
        let z = 1.0 - v * (1.0 - c2.dot(self.b));
        self.b * z + orth(c2, self.b) * (1.0 - z * z).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_set_is_stratified() {
        for set in [0, 1, 2, 7, 40, 62, 63, 64, 300] {
            for n in [16u32, 64, 256, 1024] {
                for (first, seed) in [(0, 5), (n, 77), (3 * n, 901)] {
                    let m = f64::from(n).sqrt() as usize;
                    let mut cells = vec![0u32; m * m];
                    let mut slices = vec![[0u32; 2]; n as usize];
                    for i in first..first + n {
                        let s = sample_4d(i, set, seed);
                        let [x, y] = [s[0], s[1]].map(|x| (x * m as f32) as usize);
                        cells[x * m + y] += 1;
                        for k in 0..2 {
                            slices[(s[2 + k] * n as f32) as usize][k] += 1;
                        }
                    }
                    // The first two dimensions are a (0, 2)-net with one point in each cell. Each
                    // of the others alone is a (0, 1)-net.
                    assert!(cells.iter().all(|c| *c == 1), "set {set}, {n} points");
                    assert!(slices.iter().all(|c| *c == [1, 1]), "set {set}, {n} points");
                }
            }
        }
    }

    #[test]
    fn sets_and_seeds_are_independent() {
        // Correlation of the same point's coordinates across sets and seeds. It is 1/√n for
        // independent ones; four times that is allowed.
        let n = 4096;
        let other = [(1u32, 5u32), (2, 5), (63, 5), (0, 6), (1, 6)];
        for (k, (set, seed)) in other.into_iter().enumerate() {
            let mut sum = 0f64;
            for i in 0..n {
                let a = f64::from(sample_4d(i, 0, 5)[0]) - 0.5;
                let b = f64::from(sample_4d(i, set, seed)[0]) - 0.5;
                sum += a * b * 12.0;
            }
            let r = sum / f64::from(n);
            assert!(r.abs() < 4.0 / f64::from(n).sqrt(), "{k}: {r}");
        }
    }

    #[test]
    fn cosine_directions_have_the_moments_of_the_density() {
        // ∫ cosθ · cosθ/π = 2/3 and ∫ x² cosθ/π = 1/4; with 4096 Sobol points, the error is far
        // below 1e-3.
        let (mut z, mut xx) = (0f64, 0f64);
        let n = 4096;
        for i in 0..n {
            let [u, v] = sample_2d(i, 0, 1);
            let d = cosine_hemisphere(Vec3::Z, u, v);
            assert!((d.length() - 1.0).abs() < 1e-5 && d.z >= 0.0);
            z += d.z as f64;
            let (x, _) = Vec3::Z.any_orthonormal_pair();
            xx += (d.dot(x) as f64).powi(2);
        }
        assert!((z / n as f64 - 2.0 / 3.0).abs() < 1e-3);
        assert!((xx / n as f64 - 0.25).abs() < 1e-3);
    }

    #[test]
    fn spherical_triangle_samples_are_uniform_by_solid_angle() {
        // The octant has a solid angle of π/2, and its mean direction is (1/2, 1/2, 1/2), i.e. its
        // vector area over its area.
        let t = SphericalTriangle::new([Vec3::X, Vec3::Y, Vec3::Z], Vec3::ZERO).unwrap();
        assert!((t.solid_angle - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        let n = 4096;
        let mut mean = Vec3::ZERO;
        for i in 0..n {
            let [u, v] = sample_2d(i, 0, 7);
            let d = t.sample(u, v);
            assert!(d.min_element() > -1e-4);
            mean += d / n as f32;
        }
        assert!(
            (mean - Vec3::splat(0.5)).abs().max_element() < 2e-3,
            "{mean}"
        );
    }
}
