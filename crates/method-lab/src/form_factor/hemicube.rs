//! The hemicube: patches are drawn onto the five faces of half a cube around a point, with a depth
//! buffer.

use std::f64::consts::PI;

use glam::{DVec3, dvec3};

use super::hemisphere::frame;
use super::sample::cells;
use crate::Patch;

/// No patch seen in a pixel.
const NOTHING: u32 = u32::MAX;
/// Pixels whose centre is this far outside an outline, in pixels, are also filled: rounding
/// separates two patches with a common edge by at most 1e-13 of the image, and the depth buffer
/// decides pixels that both claim.
const SLACK: f64 = 1e-9;
/// Distances this close are equal: an edge of two patches, computed from each.
const SAME: f64 = 1e-12;
/// Sine below which a patch is edge-on: coordinates have several rounding errors of 1e-16.
const EDGE_ON: f64 = 1e-13;

/// A hemicube of a given resolution, i.e. its delta factors.
///
/// The half cube has edge length 2 and the point at the centre of its base. The top face at z = 1
/// has `resolution` × `resolution` pixels, each of the four sides half as many. A pixel's delta
/// factor is its form factor from the point with the kernel at its centre and area ΔA:
/// `ΔA / π(x² + y² + 1)²` on top, `z ΔA / π(y² + z² + 1)²` on a side. They sum to 1 +
/// O(1/resolution²).
///
/// Cohen and Greenberg, *The hemi-cube: a radiosity solution for complex environments*, 1985.
#[derive(Debug, Clone)]
pub struct Hemicube {
    resolution: usize,
    top: Vec<f64>,
    side: Vec<f64>,
}

/// Pixels of one face: the visible patch, and 1/distance along the face's axis.
struct Buffer {
    item: Vec<u32>,
    near: Vec<f64>,
}

impl Hemicube {
    /// Computes the delta factors. `resolution` is even and at least 2.
    pub fn new(resolution: usize) -> Self {
        let n = resolution;
        let area = (2.0 / n as f64).powi(2);
        let at = |k: usize| (2 * k + 1) as f64 / n as f64 - 1.0;
        let factor = |x: f64, y: f64, cos: f64| cos * area / (PI * (x * x + y * y + 1.0).powi(2));
        let mut top = Vec::with_capacity(n * n);
        let mut side = Vec::with_capacity(n * n / 2);
        for v in 0..n {
            for u in 0..n {
                top.push(factor(at(u), at(v), 1.0));
                if v >= n / 2 {
                    side.push(factor(at(u), at(v), at(v)));
                }
            }
        }
        Hemicube {
            resolution,
            top,
            side,
        }
    }

    /// Delta factors of the top face, row by row.
    pub fn top(&self) -> &[f64] {
        &self.top
    }

    /// Delta factors of one side face, row by row from its foot.
    pub fn side(&self) -> &[f64] {
        &self.side
    }

    /// Memory for the factors and the buffers of one point, bytes.
    pub fn bytes(&self) -> usize {
        let pixels = self.top.len();
        8 * (self.top.len() + self.side.len()) + pixels * (4 + 8)
    }

    /// One row: F_ij by hemicubes about the centres of `points` × `points` cells of patch `i`. Adds
    /// to `row`.
    pub fn row(&self, patches: &[Patch], i: usize, points: usize, row: &mut [f64]) {
        let patch = &patches[i];
        let [x, y, z] = frame(patch);
        // (axis, right, up) of each face; a side's image has its foot at up = 0.
        let faces = [(z, x, y), (x, y, z), (-x, -y, z), (y, -x, z), (-y, x, z)];
        let area = patch.area();
        let mut buffer = Buffer {
            item: Vec::new(),
            near: Vec::new(),
        };
        for cell in cells(&patch.corners, points) {
            let share = cell.area / area;
            for (k, &(axis, right, up)) in faces.iter().enumerate() {
                let (factors, low) = if k == 0 {
                    (&self.top, -1.0)
                } else {
                    (&self.side, 0.0)
                };
                buffer.item.clear();
                buffer.item.resize(factors.len(), NOTHING);
                buffer.near.clear();
                buffer.near.resize(factors.len(), 0.0);
                let see = |c: DVec3| {
                    let d = c - cell.centre;
                    dvec3(d.dot(right), d.dot(up), d.dot(axis))
                };
                for (j, other) in patches.iter().enumerate() {
                    if j != i {
                        self.draw(other, j as u32, &see, low, &mut buffer);
                    }
                }
                for (item, factor) in buffer.item.iter().zip(factors) {
                    if *item != NOTHING {
                        let j = *item as usize;
                        // A back hides what is behind it but receives nothing.
                        if (cell.centre - patches[j].corners[0]).dot(patches[j].normal()) > 0.0 {
                            row[j] += share * factor;
                        }
                    }
                }
            }
        }
    }

    /// Draws one patch into a face that shows x and y in −1..1 (y from `low`) at z = 1.
    fn draw(
        &self,
        patch: &Patch,
        item: u32,
        see: &impl Fn(DVec3) -> DVec3,
        low: f64,
        buffer: &mut Buffer,
    ) {
        let n = self.resolution;
        let mut outline: Vec<DVec3> = patch.corners.iter().map(|c| see(*c)).collect();
        let normal = (1..outline.len() - 1)
            .map(|k| (outline[k] - outline[0]).cross(outline[k + 1] - outline[0]))
            .sum::<DVec3>();
        // 1/z where the ray (x, y, 1) meets the plane n·p = h is n·(x, y, 1)/h.
        let height = normal.dot(outline[0]);
        // Edge-on it covers nothing; rounding would give it random depths along a line of pixels.
        let size = outline.iter().map(|p| p.length()).fold(0.0, f64::max);
        if height.abs() <= EDGE_ON * normal.length() * size {
            return;
        }
        // At the edge of a solid, the front takes precedence over its back, which is equally far.
        let back = if height > 0.0 { 1.0 - SAME } else { 1.0 };
        let slope = normal * (back / height);
        // The face's pyramid: its planes meet at the point, so nothing behind remains, and no near
        // plane is needed.
        for plane in [
            dvec3(1.0, 0.0, 1.0),
            dvec3(-1.0, 0.0, 1.0),
            dvec3(0.0, -1.0, 1.0),
            dvec3(0.0, 1.0, -low),
        ] {
            outline = clip(&outline, plane);
            if outline.len() < 3 {
                return;
            }
        }
        let half = 0.5 * n as f64;
        let flat: Vec<(f64, f64)> = outline
            .iter()
            .filter(|p| p.z > 0.0)
            .map(|p| ((p.x / p.z + 1.0) * half, (p.y / p.z - low) * half))
            .collect();
        if flat.len() < 3 {
            return;
        }
        let rows = buffer.item.len() / n;
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in &flat {
            (first, last) = (first.min(p.1), last.max(p.1));
        }
        for v in pixels(first, last, rows) {
            let y = v as f64 + 0.5;
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for k in 0..flat.len() {
                let (a, b) = (flat[k], flat[(k + 1) % flat.len()]);
                let (bottom, top) = (a.1.min(b.1), a.1.max(b.1));
                if y < bottom - SLACK || y > top + SLACK {
                    continue;
                }
                let x = if top > bottom {
                    a.0 + (b.0 - a.0) * ((y - a.1) / (b.1 - a.1)).clamp(0.0, 1.0)
                } else {
                    a.0
                };
                (left, right) = (left.min(x), right.max(x));
                if top == bottom {
                    (left, right) = (left.min(b.0), right.max(b.0));
                }
            }
            for u in pixels(left, right, n) {
                let (px, py) = ((u as f64 + 0.5) / half - 1.0, y / half + low);
                let near = slope.dot(dvec3(px, py, 1.0));
                let at = v * n + u;
                if near > buffer.near[at] {
                    buffer.near[at] = near;
                    buffer.item[at] = item;
                }
            }
        }
    }
}

/// The pixels of 0..count whose centres lie in [from, to].
fn pixels(from: f64, to: f64, count: usize) -> std::ops::Range<usize> {
    if from > to {
        return 0..0;
    }
    // `as` takes negative numbers to 0.
    let first = (from - 0.5 - SLACK).ceil().max(0.0) as usize;
    let end = ((to - 0.5 + SLACK).floor() + 1.0).clamp(0.0, count as f64) as usize;
    first..end.max(first)
}

/// The part of a convex polygon with `plane` · p ≥ 0.
fn clip(corners: &[DVec3], plane: DVec3) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(corners.len() + 1);
    for k in 0..corners.len() {
        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
        let (ha, hb) = (plane.dot(a), plane.dot(b));
        if ha >= 0.0 {
            out.push(a);
        }
        if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
            out.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    out
}
