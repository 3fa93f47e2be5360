//! Difference between interpolated vertex light and the lightmap.

use atlas::{Placement, TexelIndex};
use radiosity::luminance;
use serde::Serialize;

use super::moments::{LumelLight, over_lumels};
use super::sheet::Sheet;

/// Difference between interpolated vertex light and the lumels, by luminance, over visible lumels
/// and weighted by area.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct VertexDifference {
    /// Root mean square of the difference relative to that of the light.
    pub relative_rms: f64,
    /// Median of |difference| / (light + 1 % of the mean light).
    pub median: f64,
    /// 99th percentile of the same.
    pub p99: f64,
}

/// A lumel: its area (m²), its light, and the interpolated vertex light.
pub(super) struct Pair {
    area: f32,
    light: f32,
    interpolated: f32,
}

/// The lumels of one instance; `range` is that of their indices.
pub(super) fn pairs(
    sheet: &Sheet,
    values: &[glam::Vec3],
    placement: &Placement,
    index: &TexelIndex,
    light: &[LumelLight],
    range: std::ops::Range<usize>,
) -> Vec<Pair> {
    // (∫ 1, ∫ interpolated), m².
    let mut sums = vec![(0.0f64, 0.0f64); range.len()];
    for tri in &sheet.tris {
        let texels = tri.texels();
        if texels.is_nan() || texels <= 0.0 {
            continue;
        }
        let scale = tri.area / texels;
        let corners = (sheet.points_of(tri)).map(|p| f64::from(luminance(values[p])));
        over_lumels(&tri.page, placement, index, |lumel, cell| {
            let Some(sum) = lumel.checked_sub(range.start).and_then(|k| sums.get_mut(k)) else {
                return;
            };
            sum.0 += cell.area * scale;
            for (c, phi) in corners.iter().zip(cell.linear) {
                sum.1 += c * phi * scale;
            }
        });
    }
    (range.zip(sums))
        .filter(|(lumel, sum)| light[*lumel].open == 1.0 && sum.0 > 0.0)
        .map(|(lumel, (area, sum))| Pair {
            area: area as f32,
            light: luminance(light[lumel].e),
            interpolated: (sum / area) as f32,
        })
        .collect()
}

/// Summarises all instances.
pub(super) fn summarise(pairs: &[Pair]) -> VertexDifference {
    let (mut area, mut sum, mut squares, mut errors) = (0.0, 0.0, 0.0, 0.0);
    let wide = |p: &Pair| [p.area, p.light, p.interpolated].map(f64::from);
    for [a, light, interpolated] in pairs.iter().map(wide) {
        area += a;
        sum += a * light;
        squares += a * light * light;
        errors += a * (interpolated - light).powi(2);
    }
    if squares.is_nan() || squares <= 0.0 {
        return VertexDifference::default();
    }
    let floor = 0.01 * sum / area;
    let mut relative: Vec<(f64, f64)> = (pairs.iter().map(wide))
        .map(|[area, light, interpolated]| ((interpolated - light).abs() / (light + floor), area))
        .collect();
    relative.sort_by(|a, b| a.0.total_cmp(&b.0));
    let quantile = |q: f64| {
        let mut left = q * area;
        for (error, area) in &relative {
            left -= area;
            if left <= 0.0 {
                return *error;
            }
        }
        relative.last().map_or(0.0, |r| r.0)
    };
    VertexDifference {
        relative_rms: (errors / squares).sqrt(),
        median: quantile(0.5),
        p99: quantile(0.99),
    }
}
