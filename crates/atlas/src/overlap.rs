//! Overlap of triangles in an atlas, and bleeding between charts.

use glam::Vec2;
use patch_subdivision::raster::cover_triangle;

/// No triangle or chart at a texel.
const NOBODY: u32 = u32::MAX;

/// Two or more charts at a texel.
const SEVERAL: u32 = u32::MAX - 1;

/// Area in texels that is neglected as rounding of corners on texel borders.
const LEAST_AREA: f64 = 1e-6;

/// Fraction of the covered texel centres that are inside two or more triangles, 0..=1.
///
/// `corners` are in texels of a `size` grid. A centre within 1e-3 texels of an edge counts as
/// outside. The cost is proportional to the triangles' height plus their area in texels.
///
/// ```
/// use glam::Vec2;
///
/// let triangle = [Vec2::ZERO, Vec2::new(8.0, 0.0), Vec2::new(0.0, 8.0)];
/// assert_eq!(atlas::overlap_share(&[triangle], [8, 8]), 0.0);
/// assert_eq!(atlas::overlap_share(&[triangle, triangle], [8, 8]), 1.0);
/// ```
pub fn overlap_share(corners: &[[Vec2; 3]], size: [u32; 2]) -> f64 {
    Overlaps::find(corners, size).share()
}

/// Texel centres that are inside more than one triangle.
pub(crate) struct Overlaps {
    /// Covered texels.
    pub covered: u64,
    /// Texels covered more than once.
    pub twice: u64,
    /// For each triangle, the number of its texels that an earlier triangle covers.
    pub by_triangle: Vec<u32>,
    /// For each triangle with such texels, the first of them and the earlier triangle.
    pub first: Vec<([u32; 2], u32)>,
}

impl Overlaps {
    /// Rasterises triangles given in texels of a `size` grid.
    pub fn find(corners: &[[Vec2; 3]], size: [u32; 2]) -> Overlaps {
        let [w, h] = size.map(|s| s.max(1) as usize);
        // The top bit marks texels that already count as covered twice.
        const AGAIN: u32 = 1 << 31;
        let mut owner = vec![NOBODY; w * h];
        let mut out = Overlaps {
            covered: 0,
            twice: 0,
            by_triangle: vec![0; corners.len()],
            first: vec![([0; 2], NOBODY); corners.len()],
        };
        for (t, c) in corners.iter().enumerate() {
            for_each_texel(c, size, |x, y| {
                let cell = &mut owner[y as usize * w + x as usize];
                if *cell == NOBODY {
                    *cell = t as u32;
                    out.covered += 1;
                    return;
                }
                if *cell & AGAIN == 0 {
                    *cell |= AGAIN;
                    out.twice += 1;
                }
                out.by_triangle[t] += 1;
                if out.first[t].1 == NOBODY {
                    out.first[t] = ([x, y], *cell & !AGAIN);
                }
            });
        }
        out
    }

    /// Fraction of the covered texels that are covered more than once.
    pub fn share(&self) -> f64 {
        self.twice as f64 / self.covered.max(1) as f64
    }
}

/// Calls `f(column, row)` for each texel of the grid whose centre is more than 1e-3 texels inside
/// the triangle.
pub fn for_each_texel(corners: &[Vec2; 3], size: [u32; 2], mut f: impl FnMut(u32, u32)) {
    const INSET: f64 = 1e-3;
    let p = corners.map(|c| c.as_dvec2());
    let low = p[0].y.min(p[1].y).min(p[2].y) + INSET;
    let high = p[0].y.max(p[1].y).max(p[2].y) - INSET;
    // First and one-past-last row or column whose centre lies in [a, b].
    let range = |a: f64, b: f64, end: u32| {
        let first = (a - 0.5).ceil().max(0.0);
        let last = (b - 0.5).floor().min(f64::from(end) - 1.0);
        (first as i64, last as i64)
    };
    let (top, bottom) = range(low, high, size[1]);
    for row in top..=bottom {
        let y = row as f64 + 0.5;
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            if (a.y <= y) != (b.y <= y) {
                let x = a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x);
                left = left.min(x);
                right = right.max(x);
            }
        }
        let (first, last) = range(left + INSET, right - INSET, size[0]);
        for x in first..=last {
            f(x as u32, row as u32);
        }
    }
}

/// Bilinear lookups on one chart that read lumels of another.
pub struct Bleeding {
    /// Covered area, texels.
    pub covered: f64,
    /// Area, by triangle, whose lookups read other charts, texels.
    pub by_triangle: Vec<f64>,
    /// Centre and area of the largest such region of each triangle, texels.
    pub at: Vec<(Vec2, f64)>,
}

impl Bleeding {
    /// `corners` in texels of a `size` grid; `chart` of each triangle.
    ///
    /// A lookup reads the four texels around it, so the quarter of a texel that it falls into
    /// determines them. Charts are therefore rasterised in quarter texels. A texel belongs to a
    /// chart if any of the chart is in it. `mark` is called for each affected quarter with its
    /// column and row in half texels.
    pub fn find(
        corners: &[[Vec2; 3]],
        chart: &[u32],
        size: [u32; 2],
        mut mark: impl FnMut(u32, u32),
    ) -> Bleeding {
        let [w, h] = size.map(|s| s.max(1) as usize);
        let mut owner = vec![NOBODY; w * h];
        for (c, &chart) in corners.iter().zip(chart) {
            let c = c.map(|p| p.as_dvec2());
            let area = 0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0]).abs();
            cover_triangle(c, [w as u32, h as u32], |x, y, share| {
                if share * area < LEAST_AREA {
                    return;
                }
                let cell = &mut owner[y as usize * w + x as usize];
                if *cell == NOBODY {
                    *cell = chart;
                } else if *cell != chart {
                    *cell = SEVERAL;
                }
            });
        }
        let mut out = Bleeding {
            covered: 0.0,
            by_triangle: vec![0.0; corners.len()],
            at: vec![(Vec2::ZERO, 0.0); corners.len()],
        };
        let foreign = |x: i64, y: i64, chart: u32| {
            let inside = (0..w as i64).contains(&x) && (0..h as i64).contains(&y);
            inside && !matches!(owner[y as usize * w + x as usize], c if c == chart || c == NOBODY)
        };
        for (t, (c, &chart)) in corners.iter().zip(chart).enumerate() {
            let c = c.map(|p| p.as_dvec2());
            let area = 0.5 * (c[1] - c[0]).perp_dot(c[2] - c[0]).abs();
            let quarters = [2 * w as u32, 2 * h as u32];
            cover_triangle(c.map(|p| p * 2.0), quarters, |qx, qy, share| {
                let part = share * area;
                out.covered += part;
                if part < LEAST_AREA {
                    return;
                }
                // Columns (or rows) of the texel and of the neighbour that is read on this side of
                // its centre.
                let pair = |q: u32| {
                    let own = i64::from(q / 2);
                    [own, own + if q.is_multiple_of(2) { -1 } else { 1 }]
                };
                let reads = pair(qy).into_iter();
                let mut reads = reads.flat_map(|y| pair(qx).map(|x| (x, y)));
                if reads.any(|(x, y)| foreign(x, y, chart)) {
                    mark(qx, qy);
                    out.by_triangle[t] += part;
                    if part > out.at[t].1 {
                        let middle = Vec2::new(qx as f32 + 0.5, qy as f32 + 0.5) * 0.5;
                        out.at[t] = (middle, part);
                    }
                }
            });
        }
        out
    }

    /// Fraction of the covered area whose lookups read other charts.
    pub fn share(&self) -> f64 {
        self.by_triangle.iter().sum::<f64>() / self.covered.max(f64::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f32, y: f32, side: f32) -> [[Vec2; 3]; 2] {
        let at = |u: f32, v: f32| Vec2::new(x + u * side, y + v * side);
        [
            [at(0., 0.), at(1., 0.), at(1., 1.)],
            [at(0., 0.), at(1., 1.), at(0., 1.)],
        ]
    }

    fn bleeding(gap: f32) -> f64 {
        let corners = [square(2.0, 2.0, 4.0), square(6.0 + gap, 2.0, 4.0)].concat();
        Bleeding::find(&corners, &[0, 0, 1, 1], [16, 8], |_, _| {}).share()
    }

    #[test]
    fn charts_on_texel_borders_bleed_unless_a_texel_lies_between() {
        // Half a texel on each side's four, along the whole border.
        assert_eq!(bleeding(0.0), 1.0 / 8.0);
        assert_eq!(bleeding(1.0), 0.0);
        assert_eq!(bleeding(2.0), 0.0);
        // Off texel borders a gap of one texel is too small: the second chart begins in the texel
        // that lookups on the first read.
        assert!(bleeding(0.5) > 0.0);
    }

    #[test]
    fn one_triangle_over_another_is_found_with_its_place() {
        let corners = [square(0.0, 0.0, 8.0), square(6.0, 6.0, 8.0)].concat();
        let found = Overlaps::find(&corners, [16, 16]);
        // 64 + 64 texels minus 4 common ones; centres on the diagonals belong to neither.
        assert_eq!(found.twice, 2);
        let total: u32 = found.by_triangle.iter().sum();
        assert_eq!(total, 2);
        let (at, other) = found.first[2];
        assert!(other < 2 && at[0] >= 6 && at[1] >= 6, "{at:?} {other}");
        assert_eq!(overlap_share(&square(0.0, 0.0, 8.0), [8, 8]), 0.0);
    }
}
