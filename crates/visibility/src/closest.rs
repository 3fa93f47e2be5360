//! The nearest point of a triangle.

use glam::Vec3;

/// The point of a triangle nearest to `p`, and its barycentrics (after Ericson, *Real-Time
/// Collision Detection*, 2005, §5.1.5).
pub fn closest_point([a, b, c]: [Vec3; 3], p: Vec3) -> (Vec3, f32, f32) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let at = |u: f32, v: f32| (a + ab * u + ac * v, u, v);
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(0.0, 0.0);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return at(1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return at(d1 / (d1 - d3), 0.0);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return at(0.0, d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return at(1.0 - w, w);
    }
    let sum = (va + vb + vc).max(f32::MIN_POSITIVE);
    at(vb / sum, vc / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_is_nearer_than_any_other() {
        let t = [Vec3::ZERO, Vec3::X * 2.0, Vec3::new(0.5, 1.0, 0.3)];
        for k in 0..500 {
            let f = |p: u32| (k * p % 101) as f32 / 25.0 - 2.0;
            let p = Vec3::new(f(17), f(37), f(71));
            let (q, u, v) = closest_point(t, p);
            assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6, "{u} {v}");
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let r = t[0]
                        + (t[1] - t[0]) * (i as f32 / 20.0)
                        + (t[2] - t[0]) * (j as f32 / 20.0);
                    // Rounding of lengths of a few metres.
                    assert!(q.distance(p) <= r.distance(p) + 1e-5, "{p}: {q} {r}");
                }
            }
        }
    }
}
