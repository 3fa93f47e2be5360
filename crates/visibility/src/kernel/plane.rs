//! Decides hits near the ends of a ray by the distance to the triangle's plane in `f64`.
//!
//! A ray that leaves a sliver crosses that sliver's plane at t just below zero. The `f32` weights
//! have errors of 2⁻²⁴ times the sliver's aspect ratio, and t that fraction of its length, which is
//! enough for a false hit. The signs of the edge functions, and with them the argument why no ray
//! leaks, are left alone; only t is recomputed, from the original corners.

use glam::{DVec3, Vec3};

use super::{Lanes, Prepared, Sheared};
use crate::node::Pack;

/// A triangle is rejected by its plane's distance only if it is this close to the ray's start, as a
/// fraction of the distance to its farthest corner. Elsewhere an edge-on triangle may be what
/// closes the gap between two others within the rounding of all three, and must stay. Surface
/// offsets are about 1e-6 and the rounding 1e-7, so a thousandth covers both with a margin.
const TOLERANCE: f64 = 1e-3;

/// Decides whether the hit in `lane` is within the ray, and corrects its t and side. Except for the
/// last comparison with `t_max`, the answer depends only on ray and triangle.
#[cold]
#[inline(never)]
pub(crate) fn decide_range(
    pack: &Pack,
    s: &Sheared,
    lane: usize,
    ray: &Prepared,
    t_max: f32,
    lanes: &mut Lanes,
) -> bool {
    let origin = Vec3::from_array(ray.origin).as_dvec3();
    let direction = Vec3::from_array(ray.direction).as_dvec3();
    // Differences of f32 values of similar size are exact in f64.
    let [a, b, c] = pack.triangle(lane);
    let from_origin = |p: Vec3| p.as_dvec3() - origin;
    let [a, b, c] = [from_origin(a), from_origin(b), from_origin(c)];
    let normal = (b - a).cross(c - a);
    let slope = normal.dot(direction);
    let t_min = f64::from(ray.t_min);
    let t = normal.dot(a) / slope;
    // If it is flat in f64, or edge-on, the f32 answer is as good as any.
    if t.is_finite() {
        lanes.back = lanes.back & !(1 << lane) | u32::from(slope > 0.0) << lane;
        if t > t_min {
            // Clamped to the corners' range, which the boxes above contain: the tree's shape must
            // not matter.
            let [x, y, z] = &s.z;
            let low = x[lane].min(y[lane]).min(z[lane]);
            let high = x[lane].max(y[lane]).max(z[lane]);
            lanes.t[lane] = (t as f32).clamp(low, high);
        } else if is_near(&[a, b, c], normal, direction * t_min) {
            return false;
        }
    }
    lanes.t[lane] > ray.t_min && lanes.t[lane] <= t_max
}

/// Whether `p` is within [`TOLERANCE`] of the triangle: of its plane, and of the inner side of each
/// edge.
fn is_near(corners: &[DVec3; 3], normal: DVec3, p: DVec3) -> bool {
    let reach = TOLERANCE
        * corners
            .iter()
            .map(|c| (*c - p).length())
            .fold(0.0, f64::max);
    let up = normal.normalize_or_zero();
    up.dot(corners[0] - p).abs() <= reach
        && (0..3).all(|i| {
            let edge = corners[(i + 1) % 3] - corners[i];
            up.cross(edge).dot(p - corners[i]) >= -reach * edge.length()
        })
}
