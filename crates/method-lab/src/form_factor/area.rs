//! Area to area: the double area integral, divided where it must be, with rays for what is in
//! between.

use std::f64::consts::PI;

use glam::DVec3;

use super::contour::exchange_contour;
use super::sample::{centroid, gauss_legendre, polygon_nodes};
use crate::Visibility;

/// Divisions of a pair after which it is taken as it is: each side is then 2^-5 of the patch. A few
/// million rays at most for a pair that a shadow edge crosses everywhere, and what is left of the
/// edge is a thousandth of the patch.
const DEPTH: u32 = 10;

/// A_i F_ij of two flat convex polygons by the double area integral
/// `∫∫ cosθ cosθ' V / (π r²) dA dA'`, m², and the number of rays.
///
/// Each of the two is a Gauss–Legendre product rule of `order`² points, each pair of points joined
/// by a ray where `visible` is given (the tree and the indices of the two patches). Pieces nearer
/// than they are large, patches with a common edge among them, are too near for that: there the
/// kernel is integrated by [`exchange_contour`], and the rays only say what share of it arrives.
///
/// A pair of pieces is divided, the larger piece in four, until the sum over the parts agrees with
/// the undivided value to `tolerance` of the smaller patch's area, and until the parts that are
/// hidden in part are worth no more than that: a regular pattern of points and a shadow edge that
/// runs along it agree at two levels by chance. A part gets half of its whole's tolerance, since of
/// four quarters the two at a shadow edge do not agree. After Goral and others 1984; divided by
/// error as Hanrahan, Salzman, Aupperle, *A rapid hierarchical radiosity algorithm*, 1991, divide
/// by size.
///
/// Not guaranteed: an occluder that no ray of the first two levels meets is missed; errors of a
/// shadow edge that ten divisions do not resolve stay.
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
    /// Tolerance of the contour integral of near pieces: well under the whole's.
    near: f64,
}

impl Work<'_> {
    /// A_i F_ij of two pieces, and how much of it is in doubt because they are hidden in part: a
    /// shadow edge that crosses n × n points is known to half a row of them, so 1/2n of what there
    /// would be without it.
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
        // Doubts of the parts are of either sign.
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
