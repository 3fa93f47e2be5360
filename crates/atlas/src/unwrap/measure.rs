//! Quality measures of an unwrap.

use glam::Vec2;
use serde::Serialize;

use super::input::{NONE, UnwrapInput};
use super::unwrapper::UnwrappedMesh;

/// Quality of an unwrap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ChartMeasure {
    /// Number of charts.
    pub charts: u32,
    /// Chart area relative to the rectangle's, 0..=1.
    pub utilisation: f64,
    /// L² stretch of Sander, Snyder, Gortler, Hoppe 2001 ("Texture Mapping Progressive Meshes"),
    /// normalised by area: 1 for an isometry, infinite if a triangle collapses (collapsed triangles
    /// are excluded and counted).
    pub stretch: f64,
    /// Minimum, median and maximum texel density by area, lumels per metre.
    pub density: [f64; 3],
    /// Total length of smooth edges, lumels, in four classes: closed in the chart; slit open by up
    /// to ½ lumel; slit open by up to 2 lumels, where lookups on both sides read the same lumels
    /// and cannot be made to agree; and open further or between charts.
    pub slits: [f64; 4],
    /// Triangles whose signed area in the chart is negative.
    pub flipped: u64,
    /// Triangles with area in space but none in the chart.
    pub collapsed: u64,
}

/// Twice the signed area of a triangle in texels, x right and y down.
pub(crate) fn signed_area2(c: &[Vec2; 3]) -> f64 {
    let [a, b, c] = c.map(|p| p.as_dvec2());
    (b - a).perp_dot(c - a)
}

/// Measures `result` against the surface that it unwraps.
pub fn measure(mesh: &UnwrapInput, result: &UnwrappedMesh) -> ChartMeasure {
    let mut out = ChartMeasure {
        charts: result.charts,
        ..ChartMeasure::default()
    };
    let (mut flat, mut space, mut l2) = (0.0f64, 0.0f64, 0.0f64);
    // (density, area) of each triangle, for the weighted median.
    let mut densities: Vec<(f64, f64)> = Vec::with_capacity(mesh.triangles.len());
    for (triangle, corners) in mesh.triangles.iter().zip(&result.corners) {
        let [p, q, r] = triangle.map(|v| mesh.positions[v as usize].as_dvec3());
        let area = 0.5 * (q - p).cross(r - p).length();
        let signed = 0.5 * signed_area2(corners);
        if signed < 0.0 {
            out.flipped += 1;
        }
        if area <= 0.0 {
            continue;
        }
        let chart_area = signed.abs();
        if chart_area <= area * 1e-12 {
            out.collapsed += 1;
            continue;
        }
        let [a, b, c] = corners.map(|v| v.as_dvec2());
        // Columns of the map from texels to space: Ss along x, St along y.
        let denominator = 2.0 * signed;
        let ss = (p * (b.y - c.y) + q * (c.y - a.y) + r * (a.y - b.y)) / denominator;
        let st = (p * (c.x - b.x) + q * (a.x - c.x) + r * (b.x - a.x)) / denominator;
        l2 += area * 0.5 * (ss.length_squared() + st.length_squared());
        flat += chart_area;
        space += area;
        densities.push(((chart_area / area).sqrt(), area));
    }
    out.slits = slits(mesh, result);
    if space > 0.0 {
        out.stretch = (l2 / space * flat / space).sqrt();
        out.utilisation = flat / (f64::from(result.size[0]) * f64::from(result.size[1]));
        densities.sort_by(|x, y| x.0.total_cmp(&y.0));
        out.density = [
            densities[0].0,
            weighted_median(&densities),
            densities[densities.len() - 1].0,
        ];
    }
    out
}

/// See [`ChartMeasure::slits`].
fn slits(mesh: &UnwrapInput, result: &UnwrappedMesh) -> [f64; 4] {
    let mut out = [0.0; 4];
    for (t, own) in result.corners.iter().enumerate() {
        for k in 0..3 {
            let u = mesh.neighbors[t][k] as usize;
            if mesh.neighbors[t][k] == NONE || u < t || mesh.seams[t][k] {
                continue;
            }
            let next = (k + 1) % 3;
            let place = |vertex: u32| {
                let corner = mesh.triangles[u].iter().position(|&v| v == vertex)?;
                Some(result.corners[u][corner])
            };
            let (Some(a), Some(b)) = (place(mesh.triangles[t][k]), place(mesh.triangles[t][next]))
            else {
                continue;
            };
            let gap = own[k].distance(a).max(own[next].distance(b));
            let class = match gap {
                _ if result.chart[t] != result.chart[u] => 3,
                // Only rounding.
                g if g < 1e-3 => 0,
                g if g < 0.5 => 1,
                g if g < 2.0 => 2,
                _ => 3,
            };
            out[class] += f64::from(own[k].distance(own[next]).max(a.distance(b)));
        }
    }
    out
}

/// Weighted median of (value, weight) pairs sorted by value; 0 if there are none.
pub(crate) fn weighted_median(sorted: &[(f64, f64)]) -> f64 {
    let half = 0.5 * sorted.iter().map(|d| d.1).sum::<f64>();
    let mut seen = 0.0;
    sorted
        .iter()
        .find(|d| {
            seen += d.1;
            seen >= half
        })
        .or(sorted.last())
        .map_or(0.0, |d| d.0)
}
