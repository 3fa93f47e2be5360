//! Flat charts before packing: true to scale, each in its own coordinates.

use glam::{DVec2, Vec2Swizzles as _};

/// Charts of one mesh in metres, x right and y down, not placed yet.
#[derive(Debug, Clone, Default)]
pub(super) struct Charts {
    /// Corners of each triangle in the coordinates of its chart.
    pub corners: Vec<[DVec2; 3]>,
    /// Chart of each triangle.
    pub chart: Vec<u32>,
    /// Number of charts; each has at least one triangle.
    pub count: u32,
}

/// Twice the signed area.
pub(super) fn cross2(c: &[DVec2; 3]) -> f64 {
    (c[1] - c[0]).perp_dot(c[2] - c[0])
}

impl Charts {
    /// Renumbers the charts consecutively, in the order of their first triangles.
    pub fn renumber(&mut self) {
        let end = self.chart.iter().max().map_or(0, |&m| m as usize + 1);
        let mut new = vec![u32::MAX; end];
        self.count = 0;
        for c in &mut self.chart {
            let number = &mut new[*c as usize];
            if *number == u32::MAX {
                *number = self.count;
                self.count += 1;
            }
            *c = *number;
        }
    }

    /// Triangles by chart, in their order.
    pub fn by_chart(&self) -> Vec<Vec<u32>> {
        let mut lists: Vec<Vec<u32>> = vec![Vec::new(); self.count as usize];
        for (t, &c) in self.chart.iter().enumerate() {
            lists[c as usize].push(t as u32);
        }
        lists
    }
}

/// A chart prepared for packing, rotated into its tightest box.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    /// Its triangles in the mesh.
    pub triangles: Vec<u32>,
    /// Their corners, metres; the box's corner is the origin and its longer side is along x.
    pub corners: Vec<[DVec2; 3]>,
    /// Sides of the box, metres.
    pub extent: DVec2,
    /// Whether the chart fills its box, like most walls and floors.
    pub rectangle: bool,
    /// Area, m².
    pub area: f64,
}

/// Fraction of its box that a chart must fill to count as a rectangle.
const RECTANGLE: f64 = 0.999;

/// Number of sides of a chart's hull that are tried as a side of its box, longest first; the best
/// box nearly always lies on one of those.
const HULL_SIDES: usize = 48;

impl Shape {
    /// Rotates the triangles `list` of `charts` into their box.
    pub fn new(charts: &Charts, list: Vec<u32>) -> Shape {
        let mut corners: Vec<[DVec2; 3]> =
            list.iter().map(|&t| charts.corners[t as usize]).collect();
        let points: Vec<DVec2> = corners.iter().flatten().copied().collect();
        let along = tightest_direction(&hull(points));
        let area: f64 = corners.iter().map(|c| 0.5 * cross2(c)).sum();
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in corners.iter_mut().flatten() {
            *p = DVec2::new(p.dot(along), along.perp_dot(*p));
            low = low.min(*p);
            high = high.max(*p);
        }
        let mut extent = high - low;
        let upright = extent.y > extent.x;
        for p in corners.iter_mut().flatten() {
            *p -= low;
            if upright {
                *p = DVec2::new(extent.y - p.y, p.x);
            }
        }
        if upright {
            extent = extent.yx();
        }
        Shape {
            triangles: list,
            corners,
            extent,
            rectangle: extent.y > 0.0 && area > RECTANGLE * extent.x * extent.y,
            area,
        }
    }
}

/// Convex hull, counter-clockwise in the mathematical sense, without collinear points (Andrew's
/// monotone chain).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut out: Vec<DVec2> = Vec::new();
    for half in 0..2 {
        let start = out.len();
        let mut add = |p: DVec2| {
            while out.len() >= start + 2
                && (out[out.len() - 1] - out[out.len() - 2]).perp_dot(p - out[out.len() - 1]) <= 0.0
            {
                out.pop();
            }
            out.push(p);
        };
        if half == 0 {
            points.iter().for_each(|&p| add(p));
        } else {
            points.iter().rev().for_each(|&p| add(p));
        }
        out.pop();
    }
    out
}

/// Direction of the hull side on which the smallest box lies (Freeman, Shapira 1975: one side is
/// always flush).
fn tightest_direction(hull: &[DVec2]) -> DVec2 {
    if hull.len() < 2 {
        return DVec2::X;
    }
    let mut sides: Vec<DVec2> = (0..hull.len())
        .map(|i| hull[(i + 1) % hull.len()] - hull[i])
        .collect();
    sides.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
    sides.truncate(HULL_SIDES);
    let mut best = (f64::INFINITY, DVec2::X);
    for side in sides {
        let along = side.normalize_or(DVec2::X);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in hull {
            let q = DVec2::new(p.dot(along), along.perp_dot(*p));
            low = low.min(q);
            high = high.max(q);
        }
        let size = high - low;
        // Slightly smaller is not better: rounding must not orient equal charts differently.
        if size.x * size.y < best.0 * (1.0 - 1e-6) {
            best = (size.x * size.y, along);
        }
    }
    best.1
}
