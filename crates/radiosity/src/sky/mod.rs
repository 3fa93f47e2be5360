//! The sky, and its bright part as a light.

mod bright;

use glam::Vec3;

pub(crate) use bright::{BrightSky, SkyCell};

/// What a ray sees when it leaves the scene.
#[derive(Debug, Clone, Default)]
pub enum Sky {
    /// No light.
    #[default]
    Black,
    /// The same radiance from all directions (W/(m² sr) or nit).
    Constant(Vec3),
    /// A latitude-longitude map. Column 0 starts at −X and the columns run through −Z, the centre
    /// is +X, and row 0 is +Y (as in three.js and Blender). The values are radiances.
    Map {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Row-major radiances.
        pixels: Vec<Vec3>,
    },
}

impl Sky {
    /// Radiance that arrives from the unit `direction`.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Sky::Black => Vec3::ZERO,
            Sky::Constant(l) => *l,
            Sky::Map {
                width,
                height,
                pixels,
            } => {
                let (w, h) = (*width as usize, *height as usize);
                let u = 0.5 + libm::atan2f(direction.z, direction.x) / std::f32::consts::TAU;
                let v = libm::acosf(direction.y.clamp(-1.0, 1.0)) / std::f32::consts::PI;
                let (x, y) = (
                    u * w as f32 - 0.5,
                    (v * h as f32 - 0.5).clamp(0.0, h as f32 - 1.0),
                );
                let (fx, fy) = (x - x.floor(), y - y.floor());
                let column = |i: i64| i.rem_euclid(w as i64) as usize;
                let (x0, x1) = (column(x.floor() as i64), column(x.floor() as i64 + 1));
                let (y0, y1) = (y as usize, (y as usize + 1).min(h - 1));
                let at = |x: usize, y: usize| pixels[y * w + x];
                at(x0, y0)
                    .lerp(at(x1, y0), fx)
                    .lerp(at(x0, y1).lerp(at(x1, y1), fx), fy)
            }
        }
    }

    /// Whether the sky sends no light.
    pub fn is_black(&self) -> bool {
        match self {
            Sky::Black => true,
            Sky::Constant(l) => *l == Vec3::ZERO,
            Sky::Map { pixels, .. } => pixels.iter().all(|p| *p == Vec3::ZERO),
        }
    }
}

/// Creates a sky from a decoded image.
impl From<(u32, u32, Vec<Vec3>)> for Sky {
    fn from((width, height, pixels): (u32, u32, Vec<Vec3>)) -> Self {
        debug_assert_eq!(pixels.len(), width as usize * height as usize);
        Sky::Map {
            width,
            height,
            pixels,
        }
    }
}
