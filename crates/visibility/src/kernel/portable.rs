//! The tests in plain Rust, for every machine.

use super::{
    Kernel, Lanes, Prepared, SMALL_DETERMINANT, Sheared, T_ERROR, WIDEN, decide_exactly,
    decide_range,
};
use crate::node::{Node, PACK, Pack, WIDTH};

/// Plain Rust, vectorised by the compiler for the baseline target.
pub(crate) struct Portable;

/// `minps`: the second operand if one is NaN.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `maxps`: the second operand if one is NaN.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Kernel for Portable {
    #[inline(always)]
    unsafe fn boxes(node: &Node, ray: &Prepared, t_max: f32, t_near: &mut [f32; WIDTH]) -> u32 {
        let mut near = [ray.t_min; WIDTH];
        let mut far = [t_max; WIDTH];
        for axis in 0..3 {
            let (o, inv) = (ray.origin[axis], ray.inverse[axis]);
            let lo = &node.bounds[axis][ray.near[axis]];
            let hi = &node.bounds[axis][1 - ray.near[axis]];
            for i in 0..WIDTH {
                near[i] = max((lo[i] - o) * inv, near[i]);
                far[i] = min((hi[i] - o) * inv, far[i]);
            }
        }
        *t_near = near;
        let mut mask = 0;
        for i in 0..WIDTH {
            mask |= u32::from(near[i] <= far[i] * WIDEN) << i;
        }
        mask
    }

    #[inline(always)]
    unsafe fn triangles(pack: &Pack, ray: &Prepared, t_max: f32, lanes: &mut Lanes) -> u32 {
        let [kx, ky, kz] = ray.axes;
        let mut s = Sheared {
            x: [[0.0; PACK]; 3],
            y: [[0.0; PACK]; 3],
            z: [[0.0; PACK]; 3],
        };
        let mut deep = [0.0; PACK];
        for corner in 0..3 {
            for (i, deep) in deep.iter_mut().enumerate() {
                let z = pack.corners[kz][corner][i] - ray.origin[kz];
                s.x[corner][i] = (pack.corners[kx][corner][i] - ray.origin[kx]) - ray.shear[0] * z;
                s.y[corner][i] = (pack.corners[ky][corner][i] - ray.origin[ky]) - ray.shear[1] * z;
                s.z[corner][i] = ray.shear[2] * z;
                *deep = max(*deep, z.abs());
            }
        }
        let [ax, bx, cx] = &s.x;
        let [ay, by, cy] = &s.y;
        let (mut u, mut v, mut w) = ([0.0; PACK], [0.0; PACK], [0.0; PACK]);
        let mut alive = 0;
        for i in 0..PACK {
            u[i] = cx[i] * by[i] - cy[i] * bx[i];
            v[i] = ax[i] * cy[i] - ay[i] * cx[i];
            w[i] = bx[i] * ay[i] - by[i] * ax[i];
            let least = min(min(u[i], v[i]), w[i]);
            let most = max(max(u[i], v[i]), w[i]);
            alive |= u32::from((least >= 0.0) | (most <= 0.0)) << i;
        }
        if alive == 0 {
            return 0;
        }
        let mut hits = 0;
        lanes.back = 0;
        for i in 0..PACK {
            if alive >> i & 1 == 0 {
                continue;
            }
            let det = u[i] + v[i] + w[i];
            if u[i] == 0.0 || v[i] == 0.0 || w[i] == 0.0 || det.abs() < SMALL_DETERMINANT {
                let hit =
                    decide_exactly(&s, i, lanes) && decide_range(pack, &s, i, ray, t_max, lanes);
                hits |= u32::from(hit) << i;
                continue;
            }
            let reciprocal = 1.0 / det;
            let (wb, wc) = (v[i] * reciprocal, w[i] * reciprocal);
            let az = s.z[0][i];
            let t = az + (wb * (s.z[1][i] - az) + wc * (s.z[2][i] - az));
            lanes.t[i] = t;
            lanes.u[i] = wb;
            lanes.v[i] = wc;
            lanes.back |= u32::from(det < 0.0) << i;
            let wide = (0..3).fold(0.0, |m, c| max(m, max(s.x[c][i].abs(), s.y[c][i].abs())));
            let (bz, cz) = (s.z[1][i], s.z[2][i]);
            let span = max(max(az, bz), cz) - min(min(az, bz), cz);
            let spread = (wide * max(wide, deep[i])) * (reciprocal.abs() * span);
            let error = (spread + deep[i] * ray.shear[2].abs()) * T_ERROR;
            let hit = if (t - ray.t_min).abs() <= error || (t - ray.t_max).abs() <= error {
                decide_range(pack, &s, i, ray, t_max, lanes)
            } else {
                t > ray.t_min && t <= t_max
            };
            hits |= u32::from(hit) << i;
        }
        hits
    }
}
