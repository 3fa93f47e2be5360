//! The grid that cuts one region into cells, and the exact share of every triangle in every cell.

use glam::{DVec2, Vec3};
use mesh_ingest::Soup;

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

/// Chooses the frame of a region: the plane of its mean normal, turned so that most boundary runs along an axis, with cells near
/// `size` metres that fill the region's extent exactly (so cell borders fall on a wall's borders).
pub(crate) fn choose_frame(soup: &Soup, triangles: &[u32], size: f32) -> Frame {
    let mut normal = Vec3::ZERO;
    for &t in triangles {
        normal += soup.normals[t as usize] * soup.areas[t as usize];
    }
    // Faces that cancel (a closed shell in one cluster): any plane serves.
    let normal = normal
        .try_normalize()
        .unwrap_or(soup.normals[triangles[0] as usize]);
    let (x, y) = normal.any_orthonormal_pair();
    let (sin4, cos4) = boundary_direction(soup, triangles, x, y);
    let angle = 0.25 * sin4.atan2(cos4);
    let (s, c) = (angle.sin() as f32, angle.cos() as f32);
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
    // A long diagonal or ring-shaped region fills little of its rectangle; its cells grow until the table that looks them up
    // stays in proportion to the cells that exist.
    let budget = 4096.0 + 16.0 * area / (size * size); // 4096 for an infinite size
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

/// The frame of a cluster of loose pieces: one cell over all of it.
pub(crate) fn frame_of_cluster(soup: &Soup, triangles: &[u32]) -> Frame {
    Frame {
        sub: 4,
        ..choose_frame(soup, triangles, f32::INFINITY)
    }
}

/// Sum of (sin 4θ, cos 4θ) over boundary edges weighted by length: edges a quarter turn apart count as one direction.
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
    edges.sort_unstable_by(|a, b| a.0.cmp(&b.0));
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

/// A convex polygon of at most eight corners (a triangle clipped by a rectangle has at most seven).
#[derive(Clone, Copy)]
pub(crate) struct Polygon {
    pub n: usize,
    pub p: [DVec2; 8],
}

impl Polygon {
    pub(crate) fn triangle(p: [DVec2; 3]) -> Self {
        let mut q = [DVec2::ZERO; 8];
        q[..3].copy_from_slice(&p);
        Polygon { n: 3, p: q }
    }

    /// The part with `sign · (coordinate[axis] − at) ≥ 0` (Sutherland & Hodgman 1974).
    pub(crate) fn clip(&self, axis: usize, at: f64, sign: f64) -> Polygon {
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
    pub(crate) fn area2(&self) -> f64 {
        (1..self.n.saturating_sub(1))
            .map(|i| (self.p[i] - self.p[0]).perp_dot(self.p[i + 1] - self.p[0]))
            .sum()
    }

    /// The point at the area fractions `(a, b)` ∈ [0,1)², uniform over the polygon.
    pub(crate) fn sample(&self, a: f64, b: f64) -> DVec2 {
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
}

/// Corners of a triangle in fine-cell units.
pub(crate) fn fine_corners(soup: &Soup, frame: &Frame, triangle: u32) -> [DVec2; 3] {
    let s = frame.sub as f64;
    soup.triangles[triangle as usize].map(|p| {
        let q = frame.project(p);
        DVec2::new(q[0] as f64 * s, q[1] as f64 * s)
    })
}

/// Cuts the triangle into its parts by fine cell. The parts' areas sum to the triangle's area (to rounding).
pub(crate) fn rasterise(soup: &Soup, frame: &Frame, triangle: u32, out: &mut Vec<Fragment>) {
    let fine = [frame.cells[0] * frame.sub, frame.cells[1] * frame.sub];
    let corners = fine_corners(soup, frame, triangle);
    let area = soup.areas[triangle as usize];
    let cell_of = |x: f64, n: u32| (x.floor().max(0.0) as u32).min(n - 1);
    let whole = Polygon::triangle(corners);
    let total = whole.area2();
    let (y0, y1) = whole.range(1);
    let (x0, x1) = whole.range(0);
    let (r0, r1) = (cell_of(y0, fine[1]), cell_of(y1, fine[1]));
    let (c0, c1) = (cell_of(x0, fine[0]), cell_of(x1, fine[0]));
    let mid = (corners[0] + corners[1] + corners[2]) / 3.0;
    let at_mid = || Fragment {
        fine: cell_of(mid.y, fine[1]) * fine[0] + cell_of(mid.x, fine[0]),
        triangle,
        area,
    };
    // Inside one cell, or seen edge-on in this frame (a cluster's steep face): no cut.
    if (r0 == r1 && c0 == c1) || total.abs() < 1e-12 {
        out.push(at_mid());
        return;
    }
    let before = out.len();
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
        let (c0, c1) = (cell_of(x0, fine[0]), cell_of(x1, fine[0]));
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
            if share > 1e-9 {
                out.push(Fragment {
                    fine: r * fine[0] + c,
                    triangle,
                    area: (share * area as f64) as f32,
                });
            }
        }
    }
    if out.len() == before {
        out.push(at_mid());
    }
}

/// The part of the triangle inside fine cell `fine`, in fine-cell units.
pub(crate) fn clip_to_fine(soup: &Soup, frame: &Frame, triangle: u32, fine: u32) -> Polygon {
    let width = frame.cells[0] * frame.sub;
    let height = frame.cells[1] * frame.sub;
    let (r, c) = (fine / width, fine % width);
    let mut p = Polygon::triangle(fine_corners(soup, frame, triangle));
    // The outermost cells reach to the region's end, whatever the rounding of its extent.
    if r > 0 {
        p = p.clip(1, r as f64, 1.0);
    }
    if r + 1 < height {
        p = p.clip(1, (r + 1) as f64, -1.0);
    }
    if c > 0 {
        p = p.clip(0, c as f64, 1.0);
    }
    if c + 1 < width {
        p = p.clip(0, (c + 1) as f64, -1.0);
    }
    p
}
