//! The sky of the settings, or else of the scene, as radiances.

use std::path::Path;

use glam::Vec3;
use mesh_ingest::Environment;
use radiosity::Sky;

use crate::error::Error;
use crate::settings::{Settings, SkySource};

/// Most pixels of a sky image: 16384 × 8192.
const MAX_PIXELS: u64 = 1 << 27;

/// The sky of the settings; where they give none, the scene's own `environment`. The settings' intensity and rotation apply to either.
///
/// # Errors
/// [`Error::Sky`] where the image cannot be read or is not a picture of radiances.
pub(crate) fn load(
    settings: &Settings,
    factor: f32,
    environment: Option<&Environment>,
) -> Result<Sky, Error> {
    let mut intensity = settings.sky_intensity * factor;
    let map = match &settings.sky {
        SkySource::Color(c) => return Ok(Sky::Constant(Vec3::from_array(*c) * intensity)),
        SkySource::File(path) => read_map(path)?,
        SkySource::None => match environment {
            None => return Ok(Sky::Black),
            Some(e) => {
                // The document's own light is dimmed where it is.
                intensity = settings.sky_intensity;
                (e.width, e.height, e.pixels.clone())
            }
        },
    };
    Ok(place_map(map, intensity, settings.sky_rotation))
}

/// A latitude-longitude map, times `intensity`, turned by `degrees` about +Y (counter-clockwise seen from above).
///
/// A turn is a shift along the rows, which are linearly interpolated: light is kept, and blurred by less than a pixel unless the turn
/// is a whole number of them.
fn place_map((width, height, mut pixels): Map, intensity: f32, degrees: f32) -> Sky {
    let shift = f64::from(degrees).rem_euclid(360.0) / 360.0 * f64::from(width);
    let (whole, part) = (shift.floor(), (shift - shift.floor()) as f32);
    // Columns run clockwise seen from above, from −X over −Z to +X: what turns the other way moves left.
    for row in pixels.chunks_exact_mut(width as usize) {
        row.rotate_left(whole as usize % width as usize);
        if part > 0.0 {
            let first = row[0];
            for i in 0..row.len() {
                let next = row.get(i + 1).copied().unwrap_or(first);
                row[i] = row[i].lerp(next, part);
            }
        }
        for p in row {
            *p *= intensity;
        }
    }
    Sky::from((width, height, pixels))
}

/// Width, height, and row-major radiances.
type Map = (u32, u32, Vec<Vec3>);

/// Reads a latitude-longitude picture of radiances.
fn read_map(path: &Path) -> Result<Map, Error> {
    let fail = |message: String, io: bool| Error::Sky {
        file: path.to_owned(),
        message,
        io,
    };
    let is_exr = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    let (width, height, pixels) = if is_exr {
        let image = atlas_bake::read_exr(path)?;
        let channel = |name: &str| image.channel(name).or_else(|| image.channel("Y"));
        let (Some(r), Some(g), Some(b)) = (channel("R"), channel("G"), channel("B")) else {
            return Err(fail(
                "found no channels R, G, B, expected a colour image".into(),
                false,
            ));
        };
        let pixels = (0..r.len()).map(|i| Vec3::new(r[i], g[i], b[i])).collect();
        (image.width, image.height, pixels)
    } else {
        let bytes = std::fs::read(path).map_err(|e| fail(e.to_string(), true))?;
        let decoder = image::codecs::hdr::HdrDecoder::new(std::io::Cursor::new(bytes))
            .map_err(|e| fail(format!("not a Radiance HDR or EXR image: {e}"), false))?;
        let meta = decoder.metadata();
        if meta.width as u64 * meta.height as u64 > MAX_PIXELS {
            return Err(fail(
                format!(
                    "found {} x {} pixels, expected at most {MAX_PIXELS}",
                    meta.width, meta.height
                ),
                false,
            ));
        }
        let image =
            image::DynamicImage::from_decoder(decoder).map_err(|e| fail(e.to_string(), false))?;
        let image = image.into_rgb32f();
        let pixels: Vec<Vec3> = image.pixels().map(|p| Vec3::from_array(p.0)).collect();
        (image.width(), image.height(), pixels)
    };
    if width == 0 || height == 0 {
        return Err(fail("found an empty image".into(), false));
    }
    for p in &pixels {
        if !p.is_finite() || p.min_element() < 0.0 {
            return Err(fail(
                format!("found the radiance {p}, expected finite values of at least 0"),
                false,
            ));
        }
    }
    Ok((width, height, pixels))
}
