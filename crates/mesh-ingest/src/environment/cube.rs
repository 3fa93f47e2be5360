//! Cube maps, and their resampling into latitude-longitude maps.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::scene::Image;
use crate::shading::SRGB;

/// Widest latitude-longitude map, 8192 × 4096 pixels or 400 MB: a pixel is a twelfth of the sun's
/// diameter.
const MAX_WIDTH: u32 = 8192;

/// Narrowest map: the outlines of faces with few pixels are curved in the map, and would be lost at
/// a lower resolution.
const MIN_WIDTH: u32 = 256;

/// The faces of a cube seen from inside with upright images: forward, right, down.
///
/// The extension uses OpenGL's orientation (OpenGL 4.6, table 8.19), in which faces are mirror
/// images of the view from inside, but flips each image horizontally. So every image is what a
/// camera at the centre sees.
const FACES: [[DVec3; 3]; 6] = [
    [DVec3::X, DVec3::Z, DVec3::NEG_Y],
    [DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y],
    [DVec3::Y, DVec3::NEG_X, DVec3::Z],
    [DVec3::NEG_Y, DVec3::NEG_X, DVec3::NEG_Z],
    [DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y],
    [DVec3::NEG_Z, DVec3::X, DVec3::NEG_Y],
];

/// Six square faces of radiances.
#[derive(Debug)]
pub(super) struct Cube {
    size: usize,
    faces: [Vec<Vec3>; 6],
}

impl Cube {
    /// Decodes faces in the order +X, −X, +Y, −Y, +Z, −Z, or says why it cannot.
    ///
    /// The format is RGBD: linear colour divided by alpha. The extension does not say that colours
    /// are sRGB, but glTF's colour images are, and the engine of the extension's authors decodes
    /// sRGB before dividing. Images without alpha have alpha 1. Alpha 0 is treated as 1/255.
    pub fn new(images: [&Image; 6]) -> Result<Cube, String> {
        let size = images[0].width;
        for (k, image) in images.iter().enumerate() {
            if image.width != size || image.height != size {
                return Err(format!(
                    "face {k} of its cube has {} × {} pixels, but face 0 is {size} wide",
                    image.width, image.height
                ));
            }
        }
        let srgb = &*SRGB;
        let decode = |&[r, g, b, d]: &[u8; 4]| {
            let linear = [r, g, b].map(|c| srgb[usize::from(c)]);
            Vec3::from_array(linear) * (255.0 / f32::from(d.max(1)))
        };
        Ok(Cube {
            size: size as usize,
            faces: images.map(|image| image.pixels.iter().map(decode).collect()),
        })
    }

    /// Size of a latitude-longitude map that preserves the faces' detail: 4 × face by 2 × face,
    /// within limits.
    pub fn map_size(&self) -> (u32, u32) {
        let width = (4 * self.size.min(1 << 16) as u32).clamp(MIN_WIDTH, MAX_WIDTH);
        (width, width / 2)
    }

    /// The latitude-longitude map of this cube, rotated by `rotation` about the world's origin.
    ///
    /// Each pixel is the mean of the cube's texels over its solid angle. The sides of pixels are
    /// approximated by great circles, which are straight lines on the faces. Pixels then partition
    /// every texel exactly, and no light is lost or counted twice.
    pub fn to_map(&self, width: u32, height: u32, rotation: DQuat) -> Vec<Vec3> {
        let to_cube = DMat3::from_quat(rotation.inverse());
        // Corners along the upper or lower side of a row, each shared by two pixels.
        let side = |j: u32| -> Vec<DVec3> {
            let v = f64::from(j) / f64::from(height);
            (0..=width)
                .map(|i| to_cube * map_direction(f64::from(i) / f64::from(width), v))
                .collect()
        };
        let row = |j: u32| {
            let (upper, lower) = (side(j), side(j + 1));
            (0..width as usize)
                .map(move |i| self.mean([upper[i], lower[i], lower[i + 1], upper[i + 1]]))
        };
        (0..height).into_par_iter().flat_map_iter(row).collect()
    }

    /// Mean radiance over a small spherical quadrilateral.
    fn mean(&self, corners: [DVec3; 4]) -> Vec3 {
        let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
        for (face, [forward, right, down]) in self.faces.iter().zip(FACES) {
            // Pixels are at most 1.4° wide, so one that touches the face is well in front of its
            // plane's horizon.
            if corners.iter().any(|c| c.dot(forward) < 0.3) {
                continue;
            }
            let mut shape = Polygon::default();
            for c in corners {
                shape.push(DVec2::new(c.dot(right), c.dot(down)) / c.dot(forward));
            }
            self.add(face, &shape, &mut sum, &mut weight);
        }
        if weight > 0.0 {
            (sum / weight).as_vec3()
        } else {
            Vec3::ZERO
        }
    }

    /// Adds the part of `shape`, in coordinates −1..=1 of a face, that is on each of its texels.
    fn add(&self, face: &[Vec3], shape: &Polygon, sum: &mut DVec3, weight: &mut f64) {
        let n = self.size as f64;
        let line = |k: usize| 2.0 * k as f64 / n - 1.0;
        let range = |low: f64, high: f64| {
            let cell = |x: f64| ((x + 1.0) * 0.5 * n).floor().clamp(0.0, n - 1.0) as usize;
            (low < 1.0 && high > -1.0).then(|| cell(low)..cell(high) + 1)
        };
        let [low, high] = shape.bounds();
        let Some(rows) = range(low.y, high.y) else {
            return;
        };
        for y in rows {
            let strip = shape.between(1, line(y), line(y + 1), [low, high]);
            let [low, high] = strip.bounds();
            let Some(columns) = range(low.x, high.x) else {
                continue;
            };
            for x in columns {
                let part = strip.between(0, line(x), line(x + 1), [low, high]);
                let solid_angle = part.solid_angle();
                *sum += face[y * self.size + x].as_dvec3() * solid_angle;
                *weight += solid_angle;
            }
        }
    }
}

/// The direction of point (u, v) in 0..=1 of a latitude-longitude map, as in
/// [`crate::Environment`].
pub(super) fn map_direction(u: f64, v: f64) -> DVec3 {
    let (sin_a, cos_a) = libm::sincos(TAU * (u - 0.5));
    let (sin_t, cos_t) = libm::sincos(PI * v);
    DVec3::new(sin_t * cos_a, cos_t, sin_t * sin_a)
}

/// A convex polygon of at most eight corners: a quadrilateral clipped by four lines.
#[derive(Debug, Clone, Copy, Default)]
struct Polygon {
    points: [DVec2; 8],
    len: usize,
}

impl Polygon {
    fn push(&mut self, p: DVec2) {
        // Rounding can make a sliver cross a line more than twice; such a corner encloses no area.
        if let Some(slot) = self.points.get_mut(self.len) {
            *slot = p;
            self.len += 1;
        }
    }

    fn points(&self) -> &[DVec2] {
        &self.points[..self.len]
    }

    /// Minimum and maximum coordinates; an empty range if the polygon is empty.
    fn bounds(&self) -> [DVec2; 2] {
        self.points()
            .iter()
            .fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| {
                [low.min(*p), high.max(*p)]
            })
    }

    /// The part with coordinate `axis` in `low..=high`; the polygon's own `bounds` avoid most cuts.
    fn between(&self, axis: usize, low: f64, high: f64, bounds: [DVec2; 2]) -> Polygon {
        let mut part = *self;
        if bounds[0][axis] < low {
            part = part.cut(axis, low, 1.0);
        }
        if bounds[1][axis] > high {
            part = part.cut(axis, high, -1.0);
        }
        part
    }

    /// The part where `sign` × (coordinate − `at`) ≥ 0 (Sutherland and Hodgman, "Reentrant Polygon
    /// Clipping", 1974).
    fn cut(&self, axis: usize, at: f64, sign: f64) -> Polygon {
        let mut out = Polygon::default();
        let points = self.points();
        for (k, &b) in points.iter().enumerate() {
            let a = points[(k + self.len - 1) % self.len];
            let (da, db) = (sign * (a[axis] - at), sign * (b[axis] - at));
            if (da < 0.0) != (db < 0.0) {
                out.push(a.lerp(b, da / (da - db)));
            }
            if db >= 0.0 {
                out.push(b);
            }
        }
        out
    }

    /// The solid angle of its cone from the cube's centre: area × (1 + x² + y²)^−³ᐟ² at the
    /// centroid, for polygons so small that the factor is nearly linear over them (within 1e-4 for
    /// a pixel of 1.4°).
    fn solid_angle(&self) -> f64 {
        let points = self.points();
        let Some(&o) = points.first() else {
            return 0.0;
        };
        let (mut area, mut moment) = (0.0, DVec2::ZERO);
        for pair in points[1..].windows(2) {
            let (a, b) = (pair[0] - o, pair[1] - o);
            let twice = a.perp_dot(b);
            area += 0.5 * twice;
            moment += (a + b) * (twice / 6.0);
        }
        if area == 0.0 {
            return 0.0;
        }
        let centroid = o + moment / area;
        let square = 1.0 + centroid.length_squared();
        area.abs() / (square * square.sqrt())
    }
}
