//! The grid that divides a region into cells, and the exact area of every triangle in every cell.

use glam::{DVec2, Vec3};
use mesh_ingest::Soup;

use crate::raster::{Polygon, cover_triangle};

/// A region's frame: `dot(p − origin, axes[k])` is the position in cells.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    pub origin: Vec3,
    /// Unit axes in the region's plane, divided by the cell size (1/m).
    pub axes: [Vec3; 2],
    /// Cells along each axis, ≥ 1.
    pub cells: [u32; 2],
    /// Elements per cell edge: 1, 2 or 4.
    pub sub: u32,
}

impl Frame {
    /// Position of `p` in cells.
    #[inline]
    pub(crate) fn project(&self, p: Vec3) -> [f32; 2] {
        let d = p - self.origin;
        [d.dot(self.axes[0]), d.dot(self.axes[1])]
    }
}

/// The part of a triangle inside a fine cell (an element's footprint).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fragment {
    /// Row-major index on the fine grid (`cells × sub`).
    pub fine: u32,
    pub triangle: u32,
    /// m².
    pub area: f32,
}

/// Chooses the frame of a region: the plane of its mean normal, rotated so that most boundary edges
/// run along an axis, with cells of about `size` metres that divide the region's extent evenly, so
/// that cell borders coincide with a wall's borders.
pub(crate) fn choose_frame(soup: &Soup, triangles: &[u32], size: f32) -> Frame {
    let mut normal = Vec3::ZERO;
    for &t in triangles {
        normal += soup.normals[t as usize] * soup.areas[t as usize];
    }
    // If faces cancel out (a closed shell in one cluster), any plane will do.
    let normal = normal
        .try_normalize()
        .unwrap_or(soup.normals[triangles[0] as usize]);
    let (x, y) = normal.any_orthonormal_pair();
    let (sin4, cos4) = boundary_direction(soup, triangles, x, y);
    let angle = 0.25 * libm::atan2(sin4, cos4);
    let (s, c) = (libm::sin(angle) as f32, libm::cos(angle) as f32);
    let axes = [x * c + y * s, y * c - x * s];
    let mut low = [f32::INFINITY; 2];
    let mut high = [f32::NEG_INFINITY; 2];
    let anchor = soup.triangles[triangles[0] as usize][0];
    for &t in triangles {
        for p in soup.triangles[t as usize] {
            for k in 0..2 {
                let d = (p - anchor).dot(axes[k]);
                low[k] = low[k].min(d);
                high[k] = high[k].max(d);
            }
        }
    }
    let extent = [high[0] - low[0], high[1] - low[1]];
    let mut size = size;
    let area: f32 = triangles.iter().map(|&t| soup.areas[t as usize]).sum();
    // A long diagonal or ring-shaped region fills little of its bounding rectangle. Its cells grow
    // until the lookup table is in proportion to the cells that exist.
    let budget = 4096.0 + 16.0 * area / (size * size); // 4096 for an infinite size.
    let cells_at = |s: f32| (extent[0] / s).max(1.0) * (extent[1] / s).max(1.0);
    while cells_at(size) > budget {
        size *= 1.5;
    }
    let mut cells = [1u32; 2];
    let mut scaled = axes;
    for k in 0..2 {
        cells[k] = ((extent[k] / size).round() as u32).max(1);
        scaled[k] = axes[k] * (cells[k] as f32 / extent[k].max(1e-30));
        if extent[k] <= 1e-6 * extent[1 - k] {
            scaled[k] = Vec3::ZERO;
        }
    }
    let reach = extent[0].max(extent[1]);
    let sub = if reach >= 0.6 * size {
        4
    } else if reach >= 0.25 * size {
        2
    } else {
        1
    };
    Frame {
        origin: anchor + axes[0] * low[0] + axes[1] * low[1],
        axes: scaled,
        cells,
        sub,
    }
}

/// The frame of a cluster of loose pieces: a single cell.
pub(crate) fn frame_of_cluster(soup: &Soup, triangles: &[u32]) -> Frame {
    Frame {
        sub: 4,
        ..choose_frame(soup, triangles, f32::INFINITY)
    }
}

/// Sum of (sin 4θ, cos 4θ) over boundary edges, weighted by length, so that perpendicular edges
/// count as the same direction.
fn boundary_direction(soup: &Soup, triangles: &[u32], x: Vec3, y: Vec3) -> (f64, f64) {
    type Edge = ([u32; 3], [u32; 3]);
    let bits = |p: Vec3| {
        let p = p + Vec3::ZERO;
        [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()]
    };
    let mut edges: Vec<(Edge, Vec3)> = Vec::with_capacity(3 * triangles.len());
    for &t in triangles {
        let tri = &soup.triangles[t as usize];
        for k in 0..3 {
            let (a, b) = (tri[k], tri[(k + 1) % 3]);
            let (ka, kb) = (bits(a), bits(b));
            edges.push((if ka < kb { (ka, kb) } else { (kb, ka) }, b - a));
        }
    }
    edges.sort_unstable_by_key(|e| e.0);
    let (mut s, mut c) = (0f64, 0f64);
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        if run.len() > 1 {
            continue;
        }
        let d = DVec2::new(run[0].1.dot(x) as f64, run[0].1.dot(y) as f64);
        let length = d.length();
        if length > 0.0 {
            // cos 4θ and sin 4θ by squaring the unit complex number twice.
            let (u, v) = (d.x / length, d.y / length);
            let (u2, v2) = (u * u - v * v, 2.0 * u * v);
            c += length * (u2 * u2 - v2 * v2);
            s += length * 2.0 * u2 * v2;
        }
    }
    (s, c)
}

/// Corners of a triangle in fine-cell units.
pub(crate) fn fine_corners(soup: &Soup, frame: &Frame, triangle: u32) -> [DVec2; 3] {
    let s = frame.sub as f64;
    soup.triangles[triangle as usize].map(|p| {
        let q = frame.project(p);
        DVec2::new(q[0] as f64 * s, q[1] as f64 * s)
    })
}

/// Splits the triangle by fine cells. The areas of the parts sum to the triangle's area, up to
/// rounding.
pub(crate) fn rasterise(soup: &Soup, frame: &Frame, triangle: u32, out: &mut Vec<Fragment>) {
    let fine = [frame.cells[0] * frame.sub, frame.cells[1] * frame.sub];
    let area = soup.areas[triangle as usize];
    cover_triangle(
        fine_corners(soup, frame, triangle),
        fine,
        |column, row, share| {
            out.push(Fragment {
                fine: row * fine[0] + column,
                triangle,
                area: (share * area as f64) as f32,
            });
        },
    );
}

/// The part of the triangle inside fine cell `fine`, in fine-cell units.
pub(crate) fn clip_to_fine(soup: &Soup, frame: &Frame, triangle: u32, fine: u32) -> Polygon {
    let size = [frame.cells[0] * frame.sub, frame.cells[1] * frame.sub];
    Polygon::triangle(fine_corners(soup, frame, triangle)).clip_to_cell(
        fine % size[0],
        fine / size[0],
        size,
    )
}
