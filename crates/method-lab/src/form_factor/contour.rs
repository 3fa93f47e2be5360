//! Form factor of two whole polygons by the double contour integral.

use std::f64::consts::PI;

use glam::DVec3;

/// Nodes and weights of the 15-point Kronrod rule on [−1, 1] (the upper half, from the middle) and
/// of the 7-point Gauss rule in it (Piessens and others, *QUADPACK*, 1983).
const KRONROD: [(f64, f64, f64); 8] = [
    (0.0, 0.209_482_141_084_727_83, 0.417_959_183_673_469_4),
    (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    (
        0.405_845_151_377_397_2,
        0.190_350_578_064_785_4,
        0.381_830_050_505_118_9,
    ),
    (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    (
        0.741_531_185_599_394_4,
        0.140_653_259_715_525_92,
        0.279_705_391_489_276_64,
    ),
    (0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
    (
        0.949_107_912_342_758_5,
        0.063_092_092_629_978_55,
        0.129_484_966_168_869_7,
    ),
    (0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
];

/// Halvings after which an interval is accepted as it is: at 2^-50 of an edge the rest is below
/// rounding.
const DEPTH: u32 = 50;

/// A_i F_ij of two flat convex polygons without occlusion, m², to about `tolerance` of the smaller
/// area (1e-3 to 1e-14). Divide it by the area of the emitting patch.
///
/// `A_i F_ij = 1/2π ∮_i ∮_j ln(r/r₀) dr_i · dr_j`, counter-clockwise seen from each front; any r₀
/// gives the same. Parts behind the other polygon's plane are clipped first. The inner integral
/// along a straight edge is elementary: with s along the edge from the foot of the perpendicular
/// and its length h, `∫ ln √(s² + h²) ds = s ln √(s² + h²) − s + h atan(s/h)`. The outer one is
/// integrated adaptively (Gauss–Kronrod 7/15), which also handles common edges, where it behaves as
/// s ln s.
///
/// Contour form: Moon, *The scientific basis of illuminating engineering*, 1936; Goral and others
/// 1984. Inner edge in closed form: after Mitalas and Stephenson, *FORTRAN IV programs to calculate
/// radiant energy interchange factors*, 1966; Baum and others 1989. Symmetric in the two polygons
/// up to the tolerance. 0 if they do not face each other.
pub fn exchange_contour(from: &[DVec3], to: &[DVec3], tolerance: f64) -> f64 {
    let (n_from, n_to) = (vector_area(from), vector_area(to));
    let smaller = n_from.length().min(n_to.length());
    let a = clip_front(from, to[0], n_to.normalize_or_zero());
    let b = clip_front(to, from[0], n_from.normalize_or_zero());
    if a.len() < 3 || b.len() < 3 {
        return 0.0;
    }
    // A unit in the middle of the occurring distances keeps their logarithms small, so less
    // cancels.
    let middle = |p: &[DVec3]| p.iter().sum::<DVec3>() / p.len() as f64;
    let unit = (middle(&a) - middle(&b)).length();
    let unit = if unit > 0.0 { unit } else { 1.0 };
    let edges: Vec<Edge> = (0..b.len())
        .filter_map(|k| Edge::new(b[k], b[(k + 1) % b.len()]))
        .collect();
    let mut sum = 0.0;
    for k in 0..a.len() {
        let (p, q) = (a[k], a[(k + 1) % a.len()]);
        let step = q - p;
        let length = step.length();
        if length == 0.0 {
            continue;
        }
        let along = step / length;
        let integrand = |s: f64| {
            let x = p + step * s;
            edges
                .iter()
                .map(|e| e.direction.dot(along) * e.log_distance(x, unit))
                .sum::<f64>()
                * length
        };
        // At most eight edges; the factor 2π is on the safe side.
        let allowed = tolerance * smaller;
        sum += adaptive(&integrand, 0.0, 1.0, allowed, DEPTH);
    }
    (sum / (2.0 * PI)).max(0.0)
}

/// Normal times area.
fn vector_area(c: &[DVec3]) -> DVec3 {
    (1..c.len() - 1)
        .map(|k| (c[k] - c[0]).cross(c[k + 1] - c[0]))
        .sum::<DVec3>()
        * 0.5
}

/// The part of a convex polygon in front of the plane through `origin` with unit `normal`. Corners
/// within 1e-13 of the polygon's size count as on the plane.
pub(crate) fn clip_front(corners: &[DVec3], origin: DVec3, normal: DVec3) -> Vec<DVec3> {
    let size = corners
        .iter()
        .map(|c| (*c - origin).abs().max_element())
        .fold(0.0, f64::max);
    let height = |c: DVec3| {
        let h = (c - origin).dot(normal);
        if h.abs() <= 1e-13 * size { 0.0 } else { h }
    };
    if corners.iter().all(|c| height(*c) <= 0.0) {
        return Vec::new();
    }
    let mut out = Vec::with_capacity(corners.len() + 2);
    for k in 0..corners.len() {
        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
        let (ha, hb) = (height(a), height(b));
        if ha >= 0.0 {
            out.push(a);
        }
        if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
            out.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    out
}

struct Edge {
    start: DVec3,
    direction: DVec3,
    length: f64,
}

impl Edge {
    fn new(a: DVec3, b: DVec3) -> Option<Self> {
        let length = (b - a).length();
        (length > 0.0).then(|| Edge {
            start: a,
            direction: (b - a) / length,
            length,
        })
    }

    /// ∫ ln(|y − x| / unit) dy along the edge.
    fn log_distance(&self, x: DVec3, unit: f64) -> f64 {
        let d = self.start - x;
        let s = d.dot(self.direction);
        let h = (d - self.direction * s).length();
        let primitive = |s: f64| {
            let r = s.hypot(h);
            if r == 0.0 {
                0.0
            } else {
                s * ((r / unit).ln() - 1.0) + h * s.atan2(h)
            }
        };
        primitive(s + self.length) - primitive(s)
    }
}

fn adaptive(f: &impl Fn(f64) -> f64, a: f64, b: f64, tolerance: f64, depth: u32) -> f64 {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let (mut fine, mut coarse) = (0.0, 0.0);
    for (k, &(x, wk, wg)) in KRONROD.iter().enumerate() {
        let y = if k == 0 {
            f(middle)
        } else {
            f(middle - half * x) + f(middle + half * x)
        };
        fine += wk * y;
        coarse += wg * y;
    }
    (fine, coarse) = (fine * half, coarse * half);
    // The difference is the error of the Gauss rule; Kronrod's is far smaller, about its 3/2 power
    // (QUADPACK).
    if (fine - coarse).abs() <= tolerance || depth == 0 {
        return fine;
    }
    adaptive(f, a, middle, tolerance * 0.5, depth - 1)
        + adaptive(f, middle, b, tolerance * 0.5, depth - 1)
}
