//! The pieces of surface that a lightmap's texels represent, derived only from the written texture
//! coordinates.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use super::random::Random;
use super::scene::Scene;

/// A part of one triangle: a convex polygon in the triangle's barycentrics (u, v).
#[derive(Debug, Clone)]
struct Piece {
    triangle: usize,
    outline: Vec<DVec2>,
    /// Running sum of the footprint's area fractions; the last is 1.
    until: f64,
}

/// A piece of surface over which irradiance is averaged.
#[derive(Debug, Clone)]
pub struct Footprint {
    /// Index into the pages' sizes; 0 for a footprint without a lightmap.
    pub page: usize,
    /// Column and row of the texel.
    pub texel: [u32; 2],
    /// Fraction of the texel covered by surface, 0..=1 (more if charts overlap).
    pub coverage: f64,
    /// Area in m².
    pub area: f64,
    pieces: Vec<Piece>,
}

impl Footprint {
    /// A single point of `triangle` at barycentrics (u, v) of its second and third corner.
    pub fn of_point(triangle: usize, u: f64, v: f64) -> Footprint {
        let piece = Piece {
            triangle,
            outline: vec![DVec2::new(u, v); 3],
            until: 1.0,
        };
        Footprint {
            page: 0,
            texel: [0; 2],
            coverage: 0.0,
            area: 0.0,
            pieces: vec![piece],
        }
    }

    /// The point of the scene nearest to `position` on a triangle that faces along `normal` (unit,
    /// at most 60° off); `None` if there is no such triangle.
    ///
    /// For points from other programs, which do not know our triangles. The point is moved onto the
    /// triangle.
    pub fn nearest(scene: &Scene, position: DVec3, normal: DVec3) -> Option<Footprint> {
        let mut best: Option<(f64, Footprint)> = None;
        for (i, triangle) in scene.triangles.iter().enumerate() {
            if triangle.normal().dot(normal) < 0.5 {
                continue;
            }
            let [a, b, c] = triangle.corners;
            let n = triangle.cross();
            let p = position - a;
            // Barycentrics of the foot on the plane, then of the nearest point of the triangle in
            // their terms: exact for points inside.
            let u = p.cross(c - a).dot(n) / n.length_squared();
            let v = (b - a).cross(p).dot(n) / n.length_squared();
            let (u, v) = (u.max(0.0), v.max(0.0));
            let over = (u + v).max(1.0);
            let (u, v) = (u / over, v / over);
            let distance = triangle.at(u, v).distance(position);
            if best.as_ref().is_none_or(|b| distance < b.0) {
                best = Some((distance, Footprint::of_point(i, u, v)));
            }
        }
        best.map(|b| b.1)
    }

    /// Its parts: a triangle each, and the convex polygon in that triangle's barycentrics (of the
    /// second and third corner).
    pub fn outlines(&self) -> impl Iterator<Item = (usize, &[DVec2])> {
        (self.pieces.iter()).map(|p| (p.triangle, p.outline.as_slice()))
    }

    /// The triangle of the first piece.
    pub fn triangle(&self) -> usize {
        self.pieces[0].triangle
    }

    /// Its middle: the mean of the pieces' centroids by area.
    pub fn centre(&self, scene: &Scene) -> DVec3 {
        let mut from = 0.0;
        let mut sum = DVec3::ZERO;
        for piece in &self.pieces {
            let c = centroid(&piece.outline);
            sum += scene.triangles[piece.triangle].at(c.x, c.y) * (piece.until - from);
            from = piece.until;
        }
        sum
    }

    /// The point chosen uniformly by area by `pick` and `at` (uniform in 0..1), and its triangle.
    pub(super) fn point(&self, scene: &Scene, pick: f64, at: [f64; 2]) -> (usize, DVec3) {
        let last = self.pieces.len() - 1;
        let k = self.pieces.partition_point(|p| p.until <= pick).min(last);
        let piece = &self.pieces[k];
        let from = if k == 0 {
            0.0
        } else {
            self.pieces[k - 1].until
        };
        // The remainder of `pick` is uniform again: it chooses a triangle of the outline's fan.
        let mut left = (pick - from) / (piece.until - from) * area(&piece.outline);
        let [a, b] = [piece.outline[0], piece.outline[1]];
        let mut fan = [a, b, piece.outline[2]];
        for w in piece.outline[1..].windows(2) {
            fan = [a, w[0], w[1]];
            let part = area(&fan);
            if left < part {
                break;
            }
            left -= part;
        }
        let [mut s, mut t] = at;
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        let uv = fan[0] + (fan[1] - fan[0]) * s + (fan[2] - fan[0]) * t;
        (
            piece.triangle,
            scene.triangles[piece.triangle].at(uv.x, uv.y),
        )
    }
}

/// Texels with less coverage are padding that a chart's edge touches by rounding: coordinates are
/// f32, i.e. 1.2e-4 of a texel on a page of 2048 texels. Also, rays cannot start from a footprint
/// as thin as their rounding error.
const LEAST_COVERAGE: f64 = 2e-4;

/// The footprints of all texels of a lightmap whose pages have `sizes` (width, height), ordered by
/// page, row, column.
///
/// A texel's footprint is the part of its square that triangles cover, mapped to space. Texels with
/// a coverage below 2e-4 are left out, as are triangles on pages that do not exist.
pub fn footprints(scene: &Scene, sizes: &[[u32; 2]]) -> Vec<Footprint> {
    let mut found: BTreeMap<(usize, u32, u32), Footprint> = BTreeMap::new();
    for (index, triangle) in scene.triangles.iter().enumerate() {
        let Some((page, uv)) = triangle.lightmap else {
            continue;
        };
        let Some(&[width, height]) = sizes.get(page) else {
            continue;
        };
        let size = DVec2::new(f64::from(width), f64::from(height));
        let corners = uv.map(|p| p * size);
        for (texel, outline) in texels(corners, [width, height]) {
            let covered = area(&outline);
            if covered == 0.0 {
                continue;
            }
            let outline: Vec<DVec2> = outline.iter().map(|p| barycentrics(corners, *p)).collect();
            let key = (page, texel[1], texel[0]);
            let footprint = found.entry(key).or_insert_with(|| Footprint {
                page,
                texel,
                coverage: 0.0,
                area: 0.0,
                pieces: Vec::new(),
            });
            footprint.coverage += covered;
            footprint.area += area(&outline) * 2.0 * triangle.area();
            footprint.pieces.push(Piece {
                triangle: index,
                outline,
                until: footprint.area,
            });
        }
    }
    let mut out: Vec<Footprint> = found.into_values().collect();
    out.retain(|f| f.coverage >= LEAST_COVERAGE);
    for f in &mut out {
        for piece in &mut f.pieces {
            piece.until /= f.area;
        }
    }
    out
}

/// `count` distinct `footprints`, chosen by `seed`, in their order; all of them if there are no
/// more.
pub fn choose(footprints: Vec<Footprint>, count: usize, seed: u64) -> Vec<Footprint> {
    let mut rng = Random::new(seed, u64::MAX);
    let mut left = count;
    let total = footprints.len();
    // Selection sampling (Knuth, *The Art of Computer Programming*, vol. 2, §3.4.2, algorithm S).
    let chosen = |(i, _): &(usize, Footprint)| {
        let take = rng.next() * ((total - i) as f64) < left as f64;
        left -= usize::from(take);
        take
    };
    let all = footprints.into_iter().enumerate();
    all.filter(chosen).map(|(_, f)| f).collect()
}

/// The texels that a triangle (in texels, y down) touches, each with the polygon that it cuts out
/// of the triangle.
fn texels(corners: [DVec2; 3], [width, height]: [u32; 2]) -> Vec<([u32; 2], Vec<DVec2>)> {
    let low = corners[0].min(corners[1]).min(corners[2]).floor();
    let high = corners[0].max(corners[1]).max(corners[2]).ceil();
    // `as` saturates, which cuts off what is beyond the page.
    let range = |low: f64, high: f64, most: u32| (low as u32)..(high as u32).min(most);
    let mut out = Vec::new();
    for row in range(low.y, high.y, height) {
        let (top, bottom) = (f64::from(row), f64::from(row + 1));
        let strip = clip(&clip(&corners, 1, top, 1.0), 1, bottom, -1.0);
        for column in range(low.x, high.x, width) {
            let (left, right) = (f64::from(column), f64::from(column + 1));
            let outline = clip(&clip(&strip, 0, left, 1.0), 0, right, -1.0);
            if outline.len() >= 3 {
                out.push(([column, row], outline));
            }
        }
    }
    out
}

/// The part of a convex polygon where `side`·(p\[axis\] − at) ≥ 0 (Sutherland and Hodgman 1974).
fn clip(polygon: &[DVec2], axis: usize, at: f64, side: f64) -> Vec<DVec2> {
    let height = |p: DVec2| side * (p[axis] - at);
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (a, b) = (height(p), height(q));
        if a >= 0.0 {
            out.push(p);
        }
        if (a >= 0.0) != (b >= 0.0) {
            out.push(p + (q - p) * (a / (a - b)));
        }
    }
    out
}

/// Area of a convex polygon.
fn area(p: &[DVec2]) -> f64 {
    let twice: f64 = (1..p.len().saturating_sub(1))
        .map(|i| (p[i] - p[0]).perp_dot(p[i + 1] - p[0]))
        .sum();
    0.5 * twice.abs()
}

/// Centroid of a convex polygon; the mean of its corners if it has no area.
fn centroid(p: &[DVec2]) -> DVec2 {
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    for i in 1..p.len().saturating_sub(1) {
        let w = (p[i] - p[0]).perp_dot(p[i + 1] - p[0]).abs();
        sum += (p[0] + p[i] + p[i + 1]) / 3.0 * w;
        weight += w;
    }
    if weight > 0.0 {
        sum / weight
    } else {
        p.iter().sum::<DVec2>() / p.len() as f64
    }
}

/// Barycentrics of the second and third corner; the triangle must have area.
fn barycentrics([a, b, c]: [DVec2; 3], p: DVec2) -> DVec2 {
    let (e1, e2, d) = (b - a, c - a, p - a);
    DVec2::new(d.perp_dot(e2), e1.perp_dot(d)) / e1.perp_dot(e2)
}
