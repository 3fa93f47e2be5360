//! Pictures of a finished bake for people: the level as an engine would show it, and the pages
//! themselves.
//!
//! Nothing is measured here, and the rest of the program does not depend on it. Deterministic for
//! any number of threads.

mod camera;
mod seen;
mod tone;

use glam::Vec3;
use radiosity::hash_u32;
use rayon::prelude::*;

use crate::error::Result;
use crate::false_color::{encode_png, heat};
use crate::page::Page;

pub use camera::{Camera, choose_camera, scene_camera};
use seen::Seen;
pub use seen::{LitScene, PictureLight};
use tone::Exposure;

/// Samples along each side of a pixel.
const SUPERSAMPLING: u32 = 2;

/// sRGB colours of the background at the top and bottom of the picture: neutral, and not mistakable
/// for a surface.
const BACKDROP: [[f32; 3]; 2] = [[58.0, 66.0, 80.0], [22.0, 24.0, 29.0]];

/// Renders `lit` from `camera` as a PNG of `size` pixels with automatic exposure.
///
/// # Errors
/// [`crate::Error::Image`] if the PNG cannot be encoded.
pub fn render_preview(lit: &LitScene<'_>, camera: &Camera, size: [u32; 2]) -> Result<Vec<u8>> {
    let [width, height] = size.map(|s| s.clamp(1, 8192));
    let fine = [width * SUPERSAMPLING, height * SUPERSAMPLING];
    let rays = camera.rays(fine);
    let mut samples = vec![Seen::default(); fine[0] as usize * fine[1] as usize];
    samples
        .par_chunks_mut(fine[0] as usize)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, seen) in row.iter_mut().enumerate() {
                let direction = rays.direction(x as f32 + 0.5, y as f32 + 0.5);
                let seed = hash_u32(y as u32 ^ hash_u32(x as u32));
                *seen = lit.look(camera.position, direction, seed);
            }
        });
    let exposure = Exposure::measure(samples.iter().filter(|s| s.alpha > 0.0).map(|s| s.color));
    // Samples are tone-mapped before averaging; otherwise bright edges would stay jagged.
    let pixels: Vec<[u8; 3]> = (0..width as usize * height as usize)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % width as usize, i / width as usize);
            let t = y as f32 / height as f32;
            let backdrop = Vec3::from(BACKDROP[0]).lerp(Vec3::from(BACKDROP[1]), t) / 255.0;
            let n = SUPERSAMPLING as usize;
            let mut sum = Vec3::ZERO;
            for k in 0..n * n {
                let s = samples[(y * n + k / n) * fine[0] as usize + x * n + k % n];
                sum += exposure.display(s.color) + backdrop * (1.0 - s.alpha);
            }
            tone::to_bytes(sum / (n * n) as f32)
        })
        .collect();
    encode_png(width, height, &pixels)
}

/// A page as a PNG, exposed by its covered texels.
///
/// # Errors
/// [`crate::Error::Inconsistent`] if the page's lists do not match its size.
pub fn lightmap_png(page: &Page) -> Result<Vec<u8>> {
    let covered = page
        .value
        .iter()
        .zip(&page.coverage)
        .filter(|(_, c)| **c > 0.0);
    let exposure = Exposure::measure(covered.map(|(v, _)| Vec3::from(*v)));
    let pixels: Vec<_> = page
        .value
        .par_iter()
        .map(|v| tone::to_bytes(exposure.display(Vec3::from(*v))))
        .collect();
    encode_png(page.width, page.height, &pixels)
}

/// One channel of `page` (e.g. error or coverage) as a PNG, from black (`range[0]` and below)
/// through blue, green, yellow and red to white (`range[1]`).
///
/// # Errors
/// [`crate::Error::Inconsistent`] if `values` does not have one value per texel.
pub fn heat_png(page: &Page, values: &[f32], range: [f32; 2]) -> Result<Vec<u8>> {
    let span = (range[1] - range[0]).max(f32::MIN_POSITIVE);
    let pixels: Vec<_> = values.iter().map(|x| heat((x - range[0]) / span)).collect();
    encode_png(page.width, page.height, &pixels)
}

#[cfg(test)]
mod tests;
