//! Points on patches: cells with their centres, low-discrepancy samples, Gauss–Legendre nodes.

use glam::DVec3;

/// A piece of a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Centroid, metres.
    pub centre: DVec3,
    /// Area, m².
    pub area: f64,
}

/// Divides a flat convex polygon into `k` × `k` cells: a quadrilateral along its edges, a triangle
/// into k² similar ones, anything else as a fan of triangles. Areas add up to the polygon's.
pub fn cells(corners: &[DVec3], k: usize) -> Vec<Cell> {
    let mut out = Vec::with_capacity(k * k);
    let f = |i: usize| i as f64 / k as f64;
    if let [a, b, c, d] = *corners {
        let at = |i: usize, j: usize| {
            let (s, t) = (f(i), f(j));
            (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t
        };
        for j in 0..k {
            for i in 0..k {
                out.push(centroid(&[
                    at(i, j),
                    at(i + 1, j),
                    at(i + 1, j + 1),
                    at(i, j + 1),
                ]));
            }
        }
        return out;
    }
    for t in 1..corners.len() - 1 {
        let (a, u, v) = (
            corners[0],
            corners[t] - corners[0],
            corners[t + 1] - corners[0],
        );
        let at = |i: usize, j: usize| a + u * f(i) + v * f(j);
        for j in 0..k {
            for i in 0..k - j {
                out.push(centroid(&[at(i, j), at(i + 1, j), at(i, j + 1)]));
                if i + j + 1 < k {
                    out.push(centroid(&[at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]));
                }
            }
        }
    }
    out
}

/// Centroid and area of a flat convex polygon.
pub fn centroid(corners: &[DVec3]) -> Cell {
    let (mut moment, mut area) = (DVec3::ZERO, 0.0);
    for t in 1..corners.len() - 1 {
        let (a, b, c) = (corners[0], corners[t], corners[t + 1]);
        let s = (b - a).cross(c - a).length() / 2.0;
        moment += (a + b + c) * (s / 3.0);
        area += s;
    }
    Cell {
        centre: if area > 0.0 {
            moment / area
        } else {
            corners[0]
        },
        area,
    }
}

/// Maps the unit square to a flat convex polygon, preserving areas.
pub fn point_on(corners: &[DVec3], u: f64, v: f64) -> DVec3 {
    if let [a, b, c, d] = *corners {
        let skew = (a - b + c - d).length();
        if skew <= 1e-12 * (c - a).length() {
            return a + (b - a) * u + (d - a) * v;
        }
    }
    let area = |t: usize| {
        (corners[t] - corners[0])
            .cross(corners[t + 1] - corners[0])
            .length()
    };
    let last = corners.len() - 2;
    let total: f64 = (1..=last).map(area).sum();
    let (mut t, mut rest) = (1, u * total);
    while t < last && rest >= area(t) {
        rest -= area(t);
        t += 1;
    }
    let (mut u, mut v) = ((rest / area(t)).min(1.0), v);
    // Square to triangle with little distortion (Heitz, *A low-distortion map between triangle and
    // square*, 2019).
    if v > u {
        u /= 2.0;
        v -= u;
    } else {
        v /= 2.0;
        u -= v;
    }
    corners[0] + (corners[t] - corners[0]) * u + (corners[t + 1] - corners[0]) * v
}

/// Nodes and weights of the Gauss–Legendre rule with `n` points on [0, 1], exact for polynomials up
/// to degree 2n − 1.
///
/// Newton's method on the Legendre polynomial from the usual cosine guess; accurate to 1e-15 up to
/// some hundred points.
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    (0..n)
        .map(|k| {
            let mut x = (std::f64::consts::PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut p0, mut p1) = (1.0, x);
                for m in 2..=n {
                    let m = m as f64;
                    (p0, p1) = (p1, ((2.0 * m - 1.0) * x * p1 - (m - 1.0) * p0) / m);
                }
                slope = n as f64 * (x * p1 - p0) / (x * x - 1.0);
                let step = p1 / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// A point of a quadrature over a polygon: weights add up to the area.
pub type Node = (DVec3, f64);

/// Gauss–Legendre product rule of `rule.len()`² points over each triangle of the fan, or over the
/// quadrilateral.
pub fn polygon_nodes(corners: &[DVec3], rule: &[(f64, f64)]) -> Vec<Node> {
    let mut out = Vec::with_capacity(rule.len() * rule.len() * (corners.len() - 2));
    if let [a, b, c, d] = *corners {
        for &(s, ws) in rule {
            for &(t, wt) in rule {
                let p = (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t;
                let along = (b - a) * (1.0 - t) + (c - d) * t;
                let across = (d - a) * (1.0 - s) + (c - b) * s;
                out.push((p, ws * wt * along.cross(across).length()));
            }
        }
        return out;
    }
    for k in 1..corners.len() - 1 {
        let (a, u, v) = (
            corners[0],
            corners[k] - corners[0],
            corners[k + 1] - corners[0],
        );
        let twice = u.cross(v).length();
        for &(s, ws) in rule {
            for &(t, wt) in rule {
                // Duffy's map: (s, t) to s·((1−t)·u + t·v), with Jacobian s.
                out.push((a + (u * (1.0 - t) + v * t) * s, ws * wt * s * twice));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn gauss_rules_integrate_powers_exactly() {
        for n in 1..=24 {
            let rule = gauss_legendre(n);
            for power in 0..2 * n {
                let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(power as i32)).sum();
                let exact = 1.0 / (power as f64 + 1.0);
                // Rounding of n terms.
                assert!((sum - exact).abs() < 1e-14, "{n} {power}: {sum}");
            }
        }
    }

    #[test]
    fn cells_nodes_and_samples_keep_area_and_centroid() {
        let triangle = vec![dvec3(0., 0., 1.), dvec3(3., 0., 1.), dvec3(0., 2., 2.)];
        let kite = vec![
            dvec3(0., 0., 0.),
            dvec3(2., 0., 0.),
            dvec3(3., 3., 0.),
            dvec3(0., 1., 0.),
        ];
        let pentagon: Vec<_> = (0..5)
            .map(|k| DVec3::from_array([(k as f64 * 1.2566).cos(), (k as f64 * 1.2566).sin(), 0.5]))
            .collect();
        for shape in [triangle, kite, pentagon] {
            let whole = centroid(&shape);
            for k in 1..5 {
                let parts = cells(&shape, k);
                let area: f64 = parts.iter().map(|c| c.area).sum();
                let mean = parts.iter().map(|c| c.centre * c.area).sum::<DVec3>() / area;
                assert!((area - whole.area).abs() < 1e-13);
                assert!((mean - whole.centre).length() < 1e-13);
            }
            let nodes = polygon_nodes(&shape, &gauss_legendre(3));
            let area: f64 = nodes.iter().map(|n| n.1).sum();
            let mean = nodes.iter().map(|n| n.0 * n.1).sum::<DVec3>() / area;
            assert!((area - whole.area).abs() < 1e-13 && (mean - whole.centre).length() < 1e-13);
            let n = 64;
            let mut mean = DVec3::ZERO;
            for i in 0..n * n {
                let (u, v) = ((i % n) as f64 + 0.5, (i / n) as f64 + 0.5);
                mean += point_on(&shape, u / n as f64, v / n as f64) / (n * n) as f64;
            }
            // A column of points that straddles two triangles of the fan counts for one: up to half
            // a column of the size of 3.
            assert!(
                (mean - whole.centre).length() < 0.5 * 3.0 / n as f64,
                "{mean}"
            );
        }
    }
}
