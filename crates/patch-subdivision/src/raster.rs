//! Exact coverage of grid cells by triangles, instead of tests at cell centres.

use glam::DVec2;

/// A convex polygon of at most eight corners (a triangle clipped by a rectangle has at most seven).
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    /// Number of corners.
    pub n: usize,
    /// The corners; the first `n` count.
    pub p: [DVec2; 8],
}

impl Polygon {
    /// A triangle.
    pub fn triangle(p: [DVec2; 3]) -> Self {
        let mut q = [DVec2::ZERO; 8];
        q[..3].copy_from_slice(&p);
        Polygon { n: 3, p: q }
    }

    /// The part with `sign · (coordinate[axis] − at) ≥ 0` (Sutherland & Hodgman 1974).
    pub fn clip(&self, axis: usize, at: f64, sign: f64) -> Polygon {
        let mut out = Polygon {
            n: 0,
            p: [DVec2::ZERO; 8],
        };
        for i in 0..self.n {
            let (a, b) = (self.p[i], self.p[(i + 1) % self.n]);
            let (da, db) = (sign * (a[axis] - at), sign * (b[axis] - at));
            if da >= 0.0 && out.n < 8 {
                out.p[out.n] = a;
                out.n += 1;
            }
            if (da >= 0.0) != (db >= 0.0) && out.n < 8 {
                let mut c = a + (b - a) * (da / (da - db));
                c[axis] = at;
                out.p[out.n] = c;
                out.n += 1;
            }
        }
        out
    }

    /// Twice the signed area.
    pub fn area2(&self) -> f64 {
        (1..self.n.saturating_sub(1))
            .map(|i| (self.p[i] - self.p[0]).perp_dot(self.p[i + 1] - self.p[0]))
            .sum()
    }

    /// The point at the area fractions `(a, b)` ∈ [0,1)², uniform over the polygon.
    pub fn sample(&self, a: f64, b: f64) -> DVec2 {
        let total = self.area2();
        let mut left = a * total;
        for i in 1..self.n - 1 {
            let w = (self.p[i] - self.p[0]).perp_dot(self.p[i + 1] - self.p[0]);
            let last = i == self.n - 2;
            if (left.abs() < w.abs() || last) && w != 0.0 {
                let r = (left / w).clamp(0.0, 1.0).sqrt();
                return self.p[0] * (1.0 - r)
                    + self.p[i] * (r * (1.0 - b))
                    + self.p[i + 1] * (r * b);
            }
            left -= w;
        }
        self.p[..self.n].iter().sum::<DVec2>() / self.n as f64
    }

    fn range(&self, axis: usize) -> (f64, f64) {
        self.p[..self.n]
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| {
                (l.min(p[axis]), h.max(p[axis]))
            })
    }

    /// The part inside cell (`column`, `row`) of a grid of `size` unit cells. Cells at the rim
    /// extend to infinity, so that nothing is lost to rounding.
    pub fn clip_to_cell(&self, column: u32, row: u32, size: [u32; 2]) -> Polygon {
        let mut p = *self;
        for (axis, at) in [column, row].into_iter().enumerate() {
            if at > 0 {
                p = p.clip(axis, at as f64, 1.0);
            }
            if at + 1 < size[axis] {
                p = p.clip(axis, (at + 1) as f64, -1.0);
            }
        }
        p
    }
}

/// Calls `emit(column, row, share)` for every cell of a grid of `size` unit cells that the triangle
/// touches, with the fraction of the triangle's area in the cell; the fractions sum to 1. Cells at
/// the rim include everything beyond them.
///
/// A triangle that is degenerate in the plane is assigned to the cell of its centroid. Cost: rows
/// plus cells touched.
pub fn cover_triangle(corners: [DVec2; 3], size: [u32; 2], mut emit: impl FnMut(u32, u32, f64)) {
    cut_triangle(corners, size, |c, r, _, share| emit(c, r, share));
}

/// As [`cover_triangle`], but also passes the part of the triangle.
pub fn cut_triangle(
    corners: [DVec2; 3],
    size: [u32; 2],
    mut emit: impl FnMut(u32, u32, &Polygon, f64),
) {
    let cell_of = |x: f64, n: u32| (x.floor().max(0.0) as u32).min(n - 1);
    let whole = Polygon::triangle(corners);
    let total = whole.area2();
    let mid = (corners[0] + corners[1] + corners[2]) / 3.0;
    let (x0, x1) = whole.range(0);
    let (y0, y1) = whole.range(1);
    let (r0, r1) = (cell_of(y0, size[1]), cell_of(y1, size[1]));
    let one_cell = r0 == r1 && cell_of(x0, size[0]) == cell_of(x1, size[0]);
    if one_cell || total.abs() < 1e-12 {
        let (c, r) = (cell_of(mid.x, size[0]), cell_of(mid.y, size[1]));
        emit(c, r, &whole, 1.0);
        return;
    }
    for r in r0..=r1 {
        let mut strip = whole;
        if r > r0 {
            strip = strip.clip(1, r as f64, 1.0);
        }
        if r < r1 {
            strip = strip.clip(1, (r + 1) as f64, -1.0);
        }
        if strip.n < 3 {
            continue;
        }
        let (x0, x1) = strip.range(0);
        let (c0, c1) = (cell_of(x0, size[0]), cell_of(x1, size[0]));
        for c in c0..=c1 {
            let mut part = strip;
            if c > c0 {
                part = part.clip(0, c as f64, 1.0);
            }
            if c < c1 {
                part = part.clip(0, (c + 1) as f64, -1.0);
            }
            let share = if part.n < 3 {
                0.0
            } else {
                part.area2() / total
            };
            if share > 0.0 {
                emit(c, r, &part, share);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_sum_to_one_for_any_triangle() {
        let mut x = 1u32;
        let mut random = || {
            x = x.wrapping_mul(1664525).wrapping_add(1013904223);
            x as f64 / 4294967296.0
        };
        for _ in 0..2000 {
            let mut p = || DVec2::new(random() * 22.0 - 1.0, random() * 12.0 - 1.0);
            let tri = [p(), p(), p()];
            let mut sum = 0.0;
            cover_triangle(tri, [20, 10], |c, r, share| {
                assert!(c < 20 && r < 10 && share > 0.0);
                sum += share;
            });
            // Clipping is done in f64 on numbers up to 22; 1e-9 is far above its rounding, except
            // for needles.
            assert!((sum - 1.0).abs() < 1e-9, "{sum} {tri:?}");
        }
    }

    #[test]
    fn a_clipped_cell_samples_inside_itself() {
        let t = Polygon::triangle([
            DVec2::new(0.2, 0.1),
            DVec2::new(7.0, 0.5),
            DVec2::new(3.0, 6.0),
        ]);
        let cell = t.clip_to_cell(2, 1, [8, 8]);
        assert!(cell.n >= 3);
        for i in 0..50 {
            let q = cell.sample(i as f64 / 50.0, (i * 17 % 50) as f64 / 50.0);
            assert!(
                (2.0..=3.0).contains(&q.x) && (1.0..=2.0).contains(&q.y),
                "{q}"
            );
        }
    }
}
