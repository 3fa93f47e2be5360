//! The tests with AVX2 intrinsics. Fused multiply-add is not used: it would invalidate the argument
//! of the parent module.

use std::arch::x86_64::*;

use super::{
    Kernel, Lanes, Prepared, SMALL_DETERMINANT, Sheared, T_ERROR, WIDEN, decide_exactly,
    decide_range,
};
use crate::node::{Node, Pack, WIDTH};

/// For machines with AVX2, found at run time.
pub(crate) struct Avx2;

// SAFETY of the unsafe blocks below: the trait's contract is that the machine has AVX2, which
// covers every intrinsic used; pointers come from references to whole arrays of the width loaded,
// and unaligned loads are used throughout.
impl Kernel for Avx2 {
    #[inline(always)]
    unsafe fn boxes(node: &Node, ray: &Prepared, t_max: f32, t_near: &mut [f32; WIDTH]) -> u32 {
        // SAFETY: see above.
        unsafe {
            let mut near = _mm256_set1_ps(ray.t_min);
            let mut far = _mm256_set1_ps(t_max);
            for axis in 0..3 {
                let o = _mm256_set1_ps(ray.origin[axis]);
                let inv = _mm256_set1_ps(ray.inverse[axis]);
                let side = ray.near[axis] & 1;
                let lo = _mm256_loadu_ps(node.bounds[axis][side].as_ptr());
                let hi = _mm256_loadu_ps(node.bounds[axis][side ^ 1].as_ptr());
                // If an operand is NaN, the result is the second one.
                near = _mm256_max_ps(_mm256_mul_ps(_mm256_sub_ps(lo, o), inv), near);
                far = _mm256_min_ps(_mm256_mul_ps(_mm256_sub_ps(hi, o), inv), far);
            }
            far = _mm256_mul_ps(far, _mm256_set1_ps(WIDEN));
            _mm256_storeu_ps(t_near.as_mut_ptr(), near);
            _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32
        }
    }

    #[inline(always)]
    unsafe fn triangles(pack: &Pack, ray: &Prepared, t_max: f32, lanes: &mut Lanes) -> u32 {
        // SAFETY: see above.
        unsafe {
            let [kx, ky, kz] = ray.axes.map(|k| &pack.corners[k]);
            let [ox, oy, oz] = ray.axes.map(|k| _mm_set1_ps(ray.origin[k]));
            let [sx, sy, sz] = ray.shear.map(|s| _mm_set1_ps(s));
            let zero = _mm_setzero_ps();
            let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
            for corner in 0..3 {
                z[corner] = _mm_sub_ps(_mm_loadu_ps(kz[corner].as_ptr()), oz);
                x[corner] = _mm_sub_ps(
                    _mm_sub_ps(_mm_loadu_ps(kx[corner].as_ptr()), ox),
                    _mm_mul_ps(sx, z[corner]),
                );
                y[corner] = _mm_sub_ps(
                    _mm_sub_ps(_mm_loadu_ps(ky[corner].as_ptr()), oy),
                    _mm_mul_ps(sy, z[corner]),
                );
            }
            let [ax, bx, cx] = x;
            let [ay, by, cy] = y;
            let u = _mm_sub_ps(_mm_mul_ps(cx, by), _mm_mul_ps(cy, bx));
            let v = _mm_sub_ps(_mm_mul_ps(ax, cy), _mm_mul_ps(ay, cx));
            let w = _mm_sub_ps(_mm_mul_ps(bx, ay), _mm_mul_ps(by, ax));
            let least = _mm_min_ps(_mm_min_ps(u, v), w);
            let most = _mm_max_ps(_mm_max_ps(u, v), w);
            let alive = _mm_or_ps(_mm_cmpge_ps(least, zero), _mm_cmple_ps(most, zero));
            let alive_mask = _mm_movemask_ps(alive);
            if alive_mask == 0 {
                return 0;
            }
            let magnitude = |v| _mm_andnot_ps(_mm_set1_ps(-0.0), v);
            let deep = z.iter().fold(zero, |m, z| _mm_max_ps(m, magnitude(*z)));
            let [az, bz, cz] = z.map(|z| _mm_mul_ps(sz, z));
            let det = _mm_add_ps(_mm_add_ps(u, v), w);
            let reciprocal = _mm_div_ps(_mm_set1_ps(1.0), det);
            let wb = _mm_mul_ps(v, reciprocal);
            let wc = _mm_mul_ps(w, reciprocal);
            // Relative to corner 0, so that a plane facing the ray has the same t everywhere.
            let along_b = _mm_mul_ps(wb, _mm_sub_ps(bz, az));
            let along_c = _mm_mul_ps(wc, _mm_sub_ps(cz, az));
            let t = _mm_add_ps(az, _mm_add_ps(along_b, along_c));
            _mm_storeu_ps(lanes.t.as_mut_ptr(), t);
            _mm_storeu_ps(lanes.u.as_mut_ptr(), wb);
            _mm_storeu_ps(lanes.v.as_mut_ptr(), wc);
            lanes.back = _mm_movemask_ps(_mm_cmplt_ps(det, zero)) as u32;
            let in_range = _mm_and_ps(
                _mm_cmpgt_ps(t, _mm_set1_ps(ray.t_min)),
                _mm_cmple_ps(t, _mm_set1_ps(t_max)),
            );
            let mut hits = (alive_mask & _mm_movemask_ps(in_range)) as u32;

            let on_edge = _mm_or_ps(
                _mm_or_ps(_mm_cmpeq_ps(u, zero), _mm_cmpeq_ps(v, zero)),
                _mm_cmpeq_ps(w, zero),
            );
            let uncertain = _mm_or_ps(
                on_edge,
                _mm_cmplt_ps(magnitude(det), _mm_set1_ps(SMALL_DETERMINANT)),
            );
            let wide = x.iter().zip(&y).fold(zero, |m, (x, y)| {
                _mm_max_ps(m, _mm_max_ps(magnitude(*x), magnitude(*y)))
            });
            let span = _mm_sub_ps(
                _mm_max_ps(_mm_max_ps(az, bz), cz),
                _mm_min_ps(_mm_min_ps(az, bz), cz),
            );
            let spread = _mm_mul_ps(
                _mm_mul_ps(wide, _mm_max_ps(wide, deep)),
                _mm_mul_ps(magnitude(reciprocal), span),
            );
            let error = _mm_mul_ps(
                _mm_add_ps(spread, _mm_mul_ps(deep, magnitude(sz))),
                _mm_set1_ps(T_ERROR),
            );
            let at_end = |end: f32| _mm_cmple_ps(magnitude(_mm_sub_ps(t, _mm_set1_ps(end))), error);
            let ends = _mm_or_ps(at_end(ray.t_min), at_end(ray.t_max));
            let uncertain_mask = _mm_movemask_ps(uncertain) as u32;
            let mut doubtful = (alive_mask & _mm_movemask_ps(_mm_or_ps(uncertain, ends))) as u32;
            if doubtful != 0 {
                let arrays = |v: [__m128; 3]| v.map(|v| std::mem::transmute::<__m128, [f32; 4]>(v));
                let sheared = Sheared {
                    x: arrays(x),
                    y: arrays(y),
                    z: arrays([az, bz, cz]),
                };
                while doubtful != 0 {
                    let lane = doubtful.trailing_zeros();
                    doubtful &= doubtful - 1;
                    let i = lane as usize;
                    let hit = (uncertain_mask >> lane & 1 == 0
                        || decide_exactly(&sheared, i, lanes))
                        && decide_range(pack, &sheared, i, ray, t_max, lanes);
                    hits = hits & !(1 << lane) | u32::from(hit) << lane;
                }
            }
            hits
        }
    }
}
