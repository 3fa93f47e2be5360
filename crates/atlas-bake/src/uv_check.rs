//! Whether an asset's own `TEXCOORD_1` can serve as lightmap coordinates, and at which size.

use glam::{DVec2, Vec2};
use mesh_ingest::Mesh;

use crate::atlas::{MeshAtlas, PrimitiveAtlas, UvOrigin};
use crate::unwrap::UnwrapInput;
use crate::unwrap::weighted_median;

/// Share of covered texels that may lie under two triangles. Authors' atlases have shared borders that cross a few texel
/// centres; a real overlap (a tiled or mirrored layout) is far above.
const MAX_OVERLAP: f64 = 0.005;

/// How far outside 0..1 a coordinate may lie: rounding of quantised coordinates, far below a texel.
const RANGE_SLACK: f32 = 1e-4;

/// Share of the surface that may have no area in the lightmap.
const MAX_COLLAPSED: f64 = 0.01;

/// Which lightmap coordinates to use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UvMode {
    /// The asset's `TEXCOORD_1` where it can be used, else new ones.
    #[default]
    Auto,
    /// Like `Auto`, but a mesh whose `TEXCOORD_1` exists and cannot be used is warned about.
    Keep,
    /// Always new ones.
    Generate,
}

/// Makes lightmap charts from `mesh`'s `TEXCOORD_1`, sized so that the median texel density is `texels_per_unit`.
///
/// `None` where no primitive has the set (nothing to keep). Texel coordinates are exactly `TEXCOORD_1 × size`, so a writer
/// may leave the attribute as it is. `input` is the same mesh welded and scaled to the world. The second
/// value is the density reached: less than asked where the size was limited to `max_size`.
///
/// # Errors
/// Why the coordinates cannot be used.
pub fn keep_uvs(
    mesh: &Mesh,
    input: &UnwrapInput,
    texels_per_unit: f32,
    max_size: u32,
) -> Option<Result<(MeshAtlas, f32), String>> {
    let present = |p: &mesh_ingest::Primitive| p.tex_coords.get(1).is_some_and(|c| !c.is_empty());
    if !mesh.primitives.iter().any(present) {
        return None;
    }
    Some(try_keep(mesh, input, texels_per_unit, max_size))
}

fn try_keep(
    mesh: &Mesh,
    input: &UnwrapInput,
    texels_per_unit: f32,
    max_size: u32,
) -> Result<(MeshAtlas, f32), String> {
    let mut flat: Vec<[Vec2; 3]> = Vec::with_capacity(input.triangles.len());
    for (number, primitive) in mesh.primitives.iter().enumerate() {
        let uv = match primitive.tex_coords.get(1) {
            Some(uv) if uv.len() == primitive.positions.len() => uv,
            _ => return Err(format!("primitive {number} has no TEXCOORD_1")),
        };
        for triangle in &primitive.triangles {
            let corners = triangle.map(|v| uv[v as usize]);
            for p in corners {
                if !p.is_finite() {
                    return Err("a coordinate is not finite".into());
                }
                let low = p.min_element();
                let high = p.max_element();
                if low < -RANGE_SLACK || high > 1.0 + RANGE_SLACK {
                    return Err(format!("coordinates leave 0..1 ({:.3}, {:.3})", p.x, p.y));
                }
            }
            flat.push(corners);
        }
    }
    let areas = input.areas();
    let total: f64 = areas.iter().sum();
    let mut collapsed = 0.0;
    let mut covered = 0.0;
    for (corners, &area) in flat.iter().zip(&areas) {
        let uv_area = 0.5 * cross(corners).abs();
        covered += uv_area;
        // Less than a 1e-4th of a texel on a 4096² page.
        if uv_area < 1e-4 / (4096.0 * 4096.0) && area > total * 1e-9 {
            collapsed += area;
        }
    }
    if total <= 0.0 || collapsed > MAX_COLLAPSED * total {
        return Err(format!(
            "{:.1} % of the surface has no area in it",
            100.0 * collapsed / total.max(f64::MIN_POSITIVE)
        ));
    }
    if covered > 1.0 + MAX_OVERLAP {
        return Err(format!(
            "triangles overlap (they cover {covered:.2} times the unit square)"
        ));
    }
    let ideal = ideal_size(input, &flat, &areas) * f64::from(texels_per_unit);
    let fit = (f64::from(max_size) / ideal.max_element()).min(1.0);
    let limit = max_size.max(1);
    let size = (ideal * fit)
        .to_array()
        // To a thousandth first: a scene in other units, whose sizes differ by rounding, gets the same texels.
        .map(|s| {
            (((s * 1e3).round() * 1e-3).round() as u32)
                .next_multiple_of(4)
                .clamp(1, limit)
        });
    let scale = Vec2::new(size[0] as f32, size[1] as f32);
    // A small atlas hides overlaps between its texel centres; judge on at least 256.
    let factor = (256.0 / scale.min_element()).max(1.0);
    let grid = size.map(|s| (s as f32 * factor).ceil() as u32);
    let grid_scale = Vec2::new(grid[0] as f32, grid[1] as f32);
    let scaled: Vec<[Vec2; 3]> = flat.iter().map(|c| c.map(|p| p * grid_scale)).collect();
    let overlap = overlap_share(&scaled, grid);
    if overlap > MAX_OVERLAP {
        return Err(format!(
            "triangles overlap on {:.1} % of the texels",
            overlap * 100.0
        ));
    }
    // Islands: neighbours whose coordinates agree at both ends of their edge.
    let agree = |t: usize, k: usize| {
        let u = input.neighbors[t][k] as usize;
        let ends = [
            (input.triangles[t][k], flat[t][k]),
            (input.triangles[t][(k + 1) % 3], flat[t][(k + 1) % 3]),
        ];
        ends.iter().all(|&(vertex, at)| {
            (0..3).any(|l| input.triangles[u][l] == vertex && flat[u][l] == at)
        })
    };
    let (chart, charts) = input.components(agree);
    let mut first = 0;
    let primitives = mesh
        .primitives
        .iter()
        .map(|primitive| {
            let end = first + primitive.triangles.len();
            let high = scale;
            let atlas = PrimitiveAtlas {
                xref: (0..primitive.positions.len() as u32).collect(),
                uv: primitive.tex_coords[1]
                    .iter()
                    .map(|&p| {
                        let p = if p.is_finite() { p } else { Vec2::ZERO };
                        (p * scale).clamp(Vec2::ZERO, high)
                    })
                    .collect(),
                triangles: primitive.triangles.clone(),
                chart: chart[first..end].to_vec(),
            };
            first = end;
            atlas
        })
        .collect();
    let atlas = MeshAtlas {
        size,
        primitives,
        charts,
        origin: UvOrigin::Kept,
    };
    Ok((atlas, texels_per_unit * fit as f32))
}

fn cross(corners: &[Vec2; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| p.as_dvec2());
    (b - a).perp_dot(c - a)
}

/// Metres that the unit square's sides stand for (weighted medians): texels per metre times this is the size.
fn ideal_size(input: &UnwrapInput, flat: &[[Vec2; 3]], areas: &[f64]) -> DVec2 {
    let mut along: [Vec<(f64, f64)>; 2] = [Vec::new(), Vec::new()];
    let mut side = Vec::new();
    for ((triangle, corners), &area) in input.triangles.iter().zip(flat).zip(areas) {
        let d = cross(corners);
        if d.abs() < 1e-14 || area <= 0.0 {
            continue;
        }
        let [p, q, r] = triangle.map(|v| input.positions[v as usize].as_dvec3());
        let [a, b, c] = corners.map(|v| v.as_dvec2());
        let su = (p * (b.y - c.y) + q * (c.y - a.y) + r * (a.y - b.y)) / d;
        let sv = (p * (c.x - b.x) + q * (a.x - c.x) + r * (b.x - a.x)) / d;
        along[0].push((su.length(), area));
        along[1].push((sv.length(), area));
        side.push(((2.0 * area / d.abs()).sqrt(), area));
    }
    let median = |list: &mut Vec<(f64, f64)>| {
        list.sort_by(|x, y| x.0.total_cmp(&y.0));
        weighted_median(list).max(1e-9)
    };
    let [u, v] = [median(&mut along[0]), median(&mut along[1])];
    // Charts rotated at random make u and v differ a little; a lightmap drawn for a 2 : 1 image by a factor of two.
    if u.max(v) > 1.5 * u.min(v) {
        DVec2::new(u, v)
    } else {
        DVec2::splat(median(&mut side))
    }
}

/// Share of the covered texel centres that lie inside two triangles or more, 0..=1.
///
/// `corners` in texels of a `size` grid. A centre within 1e-3 texel of an edge counts for neither side. The work is the
/// triangles' height plus their area in texels.
pub fn overlap_share(corners: &[[Vec2; 3]], size: [u32; 2]) -> f64 {
    let [w, h] = size.map(|s| s.max(1) as usize);
    let mut count = vec![0u8; w * h];
    for c in corners {
        for_each_texel(c, size, |x, y| {
            let cell = &mut count[y as usize * w + x as usize];
            *cell = cell.saturating_add(1);
        });
    }
    let covered = count.iter().filter(|&&n| n > 0).count();
    let twice = count.iter().filter(|&&n| n > 1).count();
    twice as f64 / covered.max(1) as f64
}

/// Calls `f(column, row)` for each texel of the grid whose centre lies more than 1e-3 texel inside the triangle.
pub(crate) fn for_each_texel(corners: &[Vec2; 3], size: [u32; 2], mut f: impl FnMut(u32, u32)) {
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
