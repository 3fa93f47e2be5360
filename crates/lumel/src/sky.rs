//! The sky of the settings, as radiances.

use std::path::Path;

use glam::Vec3;
use radiosity::Sky;

use crate::error::Error;
use crate::settings::SkySource;

/// Most pixels of a sky image: 16384 × 8192.
const MAX_PIXELS: u64 = 1 << 27;

/// Reads the sky; `intensity` multiplies it.
///
/// # Errors
/// [`Error::Sky`] where the image cannot be read or is not a picture of radiances.
pub(crate) fn load(source: &SkySource, intensity: f32) -> Result<Sky, Error> {
    match source {
        SkySource::None => Ok(Sky::Black),
        SkySource::Color(c) => Ok(Sky::Constant(Vec3::from_array(*c) * intensity)),
        SkySource::File(path) => load_map(path, intensity),
    }
}

fn load_map(path: &Path, intensity: f32) -> Result<Sky, Error> {
    let fail = |message: String, io: bool| Error::Sky {
        file: path.to_owned(),
        message,
        io,
    };
    let is_exr = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    let (width, height, mut pixels) = if is_exr {
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
    for p in &mut pixels {
        if !p.is_finite() || p.min_element() < 0.0 {
            return Err(fail(
                format!("found the radiance {p}, expected finite values of at least 0"),
                false,
            ));
        }
        *p *= intensity;
    }
    Ok(Sky::from((width, height, pixels)))
}
