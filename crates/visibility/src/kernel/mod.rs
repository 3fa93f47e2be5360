//! The two inner tests, ray against eight boxes and ray against four triangles, in portable and
//! AVX2 versions.
//!
//! # Why no ray leaks
//! The triangle test is that of Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection" (JCGT
//! 2013). Corners are translated to the ray's origin and sheared so that the ray is the z axis,
//! with the same operations for all triangles. The sign of a·d − b·c then says on which side of an
//! edge the ray passes. Rounding is monotone: if the products are rounded *separately* (no fused
//! multiply-add), the sign is correct, or the difference is zero. If it is zero, `f64` decides, in
//! which the products are exact. So both triangles at an edge see the same sign, and a ray between
//! them hits at least one.
//!
//! The box test must not reject what the triangle test would accept. Its slab distances have
//! relative errors, so the far side and the closest hit so far are increased by a factor
//! ([`WIDEN`]; Ize, "Robust BVH Ray Traversal", JCGT 2013). Rays with a zero direction component
//! divide to infinity. The one indeterminate case, an origin exactly on a slab, gives NaN, and
//! minima and maxima are arranged so that NaN counts as inside.
//!
//! # Why a ray does not hit the sliver that it leaves
//! The error of t grows with a triangle's aspect ratio. If it could reach an end of the ray
//! (`T_ERROR`), the plane's distance in `f64` decides (`plane.rs`). This only removes hits of rays
//! that start within a thousandth of the triangle's extent from it and leave its plane; for all
//! other rays the argument above holds unchanged.
//!
//! # Why both versions agree
//! Each operation (sub, mul, div, compare, min as `a < b ? a : b`) is the IEEE one, in the same
//! order, and Rust never contracts a multiplication and an addition.

use std::sync::LazyLock;

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
mod plane;
pub(crate) mod portable;

use crate::node::{Node, PACK, Pack, WIDTH};
use crate::ray::Ray;

pub(crate) use plane::decide_range;

/// Largest magnitude of coordinates of corners and ray origins. Sheared differences reach 4e18,
/// edge functions 3.2e37 and their sum 1e38, just within the range of `f32`.
pub const MAX_COORDINATE: f32 = 1e18;

/// Factor on far distances: eight units in the last place. Two slab distances of three roundings
/// each (subtraction, reciprocal, product) and the sheared corners (three more) can disagree by
/// about seven. No leak occurred in 5e7 rays (`examples/leaks.rs`).
pub const WIDEN: f32 = 1.0 + 8.0 * f32::EPSILON;

/// If the determinant is smaller than this, its reciprocal may overflow or edge functions may be
/// denormal, so `f64` is used.
const SMALL_DETERMINANT: f32 = 1e-30;

/// Bound on the error of the `f32` t, in units of m·max(m, z)·s/|det| + Z, with m the largest
/// sheared |x| or |y| of a corner, z the largest difference along the ray's main axis, Z the same
/// in units of t, and s the span of the corners' t. A sheared coordinate has an error of about
/// 2⁻²⁴·max(m, z), an edge function m times that, and the weights that divided by the determinant,
/// which is small for a sliver. The bound is sixteen units of 2⁻²⁴; the worst of 370,000 triangles
/// of aspect ratio 1 to 1e6 needed 2.3 (`kernel/tests.rs`). A bound that is too large costs little,
/// a wrong answer costs much.
pub(crate) const T_ERROR: f32 = 16.0 * 0.5 * f32::EPSILON;

/// Instruction sets with their own version of the tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Isa {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Isa {
    /// The fastest one that this machine supports. All give the same hits; `LUMEL_KERNEL=portable`
    /// in the environment chooses the portable one, so that a test can show that.
    pub fn detect() -> Isa {
        static FORCED: LazyLock<bool> =
            LazyLock::new(|| std::env::var_os("LUMEL_KERNEL").is_some_and(|k| k == "portable"));
        if *FORCED {
            return Isa::Portable;
        }
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Isa::Avx2;
        }
        Isa::Portable
    }

    pub fn name(self) -> &'static str {
        match self {
            Isa::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => "avx2",
        }
    }
}

/// Precomputed values of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prepared {
    pub origin: [f32; 3],
    /// Direction in units of the internal `t`.
    pub direction: [f32; 3],
    /// 1 / direction, infinite where that is zero.
    pub inverse: [f32; 3],
    /// The side of a box that the ray enters first, by axis: 0 lower, 1 upper.
    pub near: [usize; 3],
    /// Axes permuted so that the direction's longest component is last and handedness is kept.
    pub axes: [usize; 3],
    /// Sheared x and y per unit of z, and 1 / z.
    pub shear: [f32; 3],
    pub t_min: f32,
    pub t_max: f32,
    /// Factor from internal `t` to the caller's: a power of two, 1 for directions of normal length.
    pub t_scale: f32,
}

impl Prepared {
    /// `None` for a ray that cannot hit anything.
    #[inline(always)]
    pub fn new(ray: &Ray) -> Option<Prepared> {
        let origin = ray.origin.to_array();
        let mut d = ray.direction.to_array();
        let a = d.map(f32::abs);
        // Written so that NaN takes the first branch too.
        let longest = if a[0] > a[1] { a[0] } else { a[1] };
        let longest = if longest > a[2] { longest } else { a[2] };
        let valid = longest > 0.0
            && a.iter().all(|x| x.is_finite())
            && origin.iter().all(|x| x.abs() <= MAX_COORDINATE)
            && ray.t_min < ray.t_max;
        if !valid {
            return None;
        }
        let (mut t_min, mut t_max, mut t_scale) = (ray.t_min.max(0.0), ray.t_max, 1.0);
        if !(1e-6..=1e6).contains(&longest) {
            // A very short direction would have infinite reciprocals of significant components, so
            // it is scaled to a length of about 1. Powers of two are exact.
            let exponent = (longest.to_bits() >> 23).clamp(1, 253);
            t_scale = f32::from_bits((254 - exponent) << 23);
            d = d.map(|x| x * t_scale);
            t_min *= 1.0 / t_scale;
            t_max *= 1.0 / t_scale;
        }
        let inverse = d.map(|x| 1.0 / x);
        let kz = if a[0] > a[1] {
            if a[0] > a[2] { 0 } else { 2 }
        } else if a[1] > a[2] {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ([1, 2, 0][kz], [2, 0, 1][kz]);
        if d[kz] < 0.0 {
            (kx, ky) = (ky, kx);
        }
        Some(Prepared {
            origin,
            direction: d,
            inverse,
            near: inverse.map(|x| usize::from(x.is_sign_negative())),
            axes: [kx, ky, kz],
            shear: [d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]],
            t_min,
            t_max,
            t_scale,
        })
    }
}

/// Per-lane results of the triangle test; only lanes in the returned mask are meaningful.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lanes {
    pub t: [f32; PACK],
    pub u: [f32; PACK],
    pub v: [f32; PACK],
    /// Bit per lane: whether the back was hit.
    pub back: u32,
}

/// The two tests for one instruction set.
pub(crate) trait Kernel {
    /// Mask of the child boxes that the ray enters within `t_min..=t_max · WIDEN`, and the
    /// distances to them.
    ///
    /// # Safety
    /// The machine supports the instruction set.
    unsafe fn boxes(node: &Node, ray: &Prepared, t_max: f32, t_near: &mut [f32; WIDTH]) -> u32;

    /// Mask of the triangles that the ray hits at `t_min < t <= t_max`.
    ///
    /// # Safety
    /// The machine supports the instruction set.
    unsafe fn triangles(pack: &Pack, ray: &Prepared, t_max: f32, lanes: &mut Lanes) -> u32;
}

/// Sheared corners of four triangles: `[corner][lane]` of x and y, and of z scaled to units of `t`.
pub(crate) struct Sheared {
    pub x: [[f32; PACK]; 3],
    pub y: [[f32; PACK]; 3],
    pub z: [[f32; PACK]; 3],
}

/// Decides in `f64`, where the product of two `f32` is exact, whether the line hits the triangle in
/// `lane`, and fills in its results. [`decide_range`] decides whether the hit is within the ray.
#[cold]
#[inline(never)]
pub(crate) fn decide_exactly(s: &Sheared, lane: usize, lanes: &mut Lanes) -> bool {
    let [ax, bx, cx] = s.x.map(|c| f64::from(c[lane]));
    let [ay, by, cy] = s.y.map(|c| f64::from(c[lane]));
    let [az, bz, cz] = s.z.map(|c| f64::from(c[lane]));
    let u = cx * by - cy * bx;
    let v = ax * cy - ay * cx;
    let w = bx * ay - by * ax;
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return false;
    }
    let det = u + v + w;
    if det == 0.0 {
        return false;
    }
    let t = (az + (v * (bz - az) + w * (cz - az)) / det) as f32;
    lanes.t[lane] = t;
    lanes.u[lane] = (v / det) as f32;
    lanes.v[lane] = (w / det) as f32;
    lanes.back = lanes.back & !(1 << lane) | u32::from(det < 0.0) << lane;
    true
}

#[cfg(test)]
mod tests;
