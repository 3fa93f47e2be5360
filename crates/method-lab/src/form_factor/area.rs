//! Area to area: the double area integral, subdivided where necessary, with rays for occlusion.

use std::f64::consts::PI;

use glam::DVec3;

use super::contour::exchange_contour;
use super::sample::{centroid, gauss_legendre, polygon_nodes};
use crate::Visibility;

/// Divisions of a pair after which it is accepted as it is; each side is then 2^-5 of the patch. A
/// pair that a shadow edge crosses everywhere takes at most a few million rays, and the remaining
/// edge is a thousandth of the patch.
const DEPTH: u32 = 10;

/// A_i F_ij of two flat convex polygons by the double area integral
/// `∫∫ cosθ cosθ' V / (π r²) dA dA'`, m², and the number of rays.
///
/// Each polygon has a Gauss–Legendre product rule of `order`² points, and each pair of points is
/// connected by a ray if `visible` is given (the tree and the indices of the two patches). Pieces
/// closer than their size, including patches with a common edge, are too close for that: their
/// kernel is integrated by [`exchange_contour`], and the rays only determine the visible fraction.
///
/// A pair of pieces is divided, the larger piece into four, until the sum over the parts agrees
/// with the undivided value to `tolerance` of the smaller patch's area, and until the partly hidden
/// parts contribute no more than that. The second condition is needed because two levels may agree
/// by chance, with a regular pattern of points and a shadow edge along it. A part gets half of its
/// parent's tolerance, because two of four quarters touch a shadow edge. After Goral and others
/// 1984; subdivision by error, as Hanrahan, Salzman, Aupperle, *A rapid hierarchical radiosity
/// algorithm*, 1991, subdivide by size.
///
/// Not guaranteed: an occluder that no ray of the first two levels hits is missed; errors of a
/// shadow edge that ten divisions do not resolve remain.
pub fn exchange_area(
    from: &[DVec3],
    to: &[DVec3],
    order: usize,
    tolerance: f64,
    visible: Option<(&Visibility, usize, usize)>,
) -> (f64, u64) {
    let mut work = Work {
        rule: gauss_legendre(order),
        visible,
        rays: 0,
        near: 0.1 * tolerance,
    };
    let (a, b) = (Piece::new(from, &work.rule), Piece::new(to, &work.rule));
    let (whole, _) = work.estimate(&a, &b);
    let tolerance = tolerance * a.area.min(b.area);
    let sum = work.refine(&a, &b, whole, tolerance, DEPTH);
    (sum, work.rays)
}

struct Piece {
    corners: Vec<DVec3>,
    centre: DVec3,
    /// Greatest distance of two corners, metres.
    size: f64,
    normal: DVec3,
    area: f64,
    nodes: Vec<(DVec3, f64)>,
}

impl Piece {
    fn new(corners: &[DVec3], rule: &[(f64, f64)]) -> Self {
        let nodes = polygon_nodes(corners, rule);
        let normal = (1..corners.len() - 1)
            .map(|k| (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]))
            .sum::<DVec3>()
            .normalize_or_zero();
        let size = corners
            .iter()
            .flat_map(|a| corners.iter().map(|b| (*a - *b).length_squared()))
            .fold(0.0, f64::max)
            .sqrt();
        let whole = centroid(corners);
        Piece {
            area: whole.area,
            centre: whole.centre,
            size,
            normal,
            nodes,
            corners: corners.to_vec(),
        }
    }

    /// Four parts: a triangle or quadrilateral at the middles of its edges, anything else as a fan.
    fn split(&self, rule: &[(f64, f64)]) -> Vec<Piece> {
        let c = &self.corners;
        let mid = |i: usize, j: usize| (c[i] + c[j]) * 0.5;
        let parts: Vec<Vec<DVec3>> = match c.len() {
            3 => {
                let (ab, bc, ca) = (mid(0, 1), mid(1, 2), mid(2, 0));
                vec![
                    vec![c[0], ab, ca],
                    vec![ab, c[1], bc],
                    vec![ca, bc, c[2]],
                    vec![ab, bc, ca],
                ]
            }
            4 => {
                let m = (c[0] + c[1] + c[2] + c[3]) * 0.25;
                let e = [mid(0, 1), mid(1, 2), mid(2, 3), mid(3, 0)];
                (0..4)
                    .map(|k| vec![c[k], e[k], m, e[(k + 3) % 4]])
                    .collect()
            }
            n => (1..n - 1).map(|k| vec![c[0], c[k], c[k + 1]]).collect(),
        };
        parts.iter().map(|p| Piece::new(p, rule)).collect()
    }
}

struct Work<'a> {
    rule: Vec<(f64, f64)>,
    visible: Option<(&'a Visibility, usize, usize)>,
    rays: u64,
    /// Tolerance of the contour integral of close pieces: well below the total.
    near: f64,
}

impl Work<'_> {
    /// A_i F_ij of two pieces, and the part that is uncertain because they are partly hidden: a
    /// shadow edge that crosses n × n points is known to half a row of them, so 1/2n of the
    /// unoccluded value.
    fn estimate(&mut self, a: &Piece, b: &Piece) -> (f64, f64) {
        let (mut all, mut seen) = (0.0, 0.0);
        for &(x, wx) in &a.nodes {
            for &(y, wy) in &b.nodes {
                let d = y - x;
                let (c, c1) = (a.normal.dot(d), -b.normal.dot(d));
                if c <= 0.0 || c1 <= 0.0 {
                    continue;
                }
                let r2 = d.length_squared();
                let part = wx * wy * c * c1 / (PI * r2 * r2);
                all += part;
                if let Some((tree, i, j)) = self.visible {
                    self.rays += 1;
                    if !tree.visible(x, i, y, j) {
                        continue;
                    }
                }
                seen += part;
            }
        }
        let near = a.size.max(b.size) > (a.centre - b.centre).length();
        if seen == 0.0 {
            return (0.0, 0.0);
        }
        let whole = if near {
            exchange_contour(&a.corners, &b.corners, self.near)
        } else {
            all
        };
        let doubt = if seen < all {
            whole / (2 * self.rule.len()) as f64
        } else {
            0.0
        };
        (whole * (seen / all), doubt)
    }

    fn refine(&mut self, a: &Piece, b: &Piece, whole: f64, tolerance: f64, depth: u32) -> f64 {
        let first = a.area >= b.area;
        let parts = if first { a } else { b }.split(&self.rule);
        let values: Vec<(f64, f64)> = parts
            .iter()
            .map(|p| {
                if first {
                    self.estimate(p, b)
                } else {
                    self.estimate(a, p)
                }
            })
            .collect();
        let sum: f64 = values.iter().map(|v| v.0).sum();
        // Uncertainties of the parts have either sign.
        let doubt = values.iter().map(|v| v.1 * v.1).sum::<f64>().sqrt();
        if depth <= 1 || (sum - whole).abs().max(doubt) <= tolerance {
            return sum;
        }
        parts
            .iter()
            .zip(values)
            .map(|(p, (v, _))| {
                let (a, b) = if first { (p, b) } else { (a, p) };
                self.refine(a, b, v, 0.5 * tolerance, depth - 1)
            })
            .sum()
    }
}
