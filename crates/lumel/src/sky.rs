//! Radiances of the sky, from the settings or from the scene.

use std::io::ErrorKind;
use std::path::Path;

use glam::Vec3;
use mesh_ingest::{Environment, check_regular, read_regular};
use radiosity::Sky;

use crate::error::Error;
use crate::settings::{Settings, SkySource};

/// Checks that the sky's file exists and is not too long before it is hashed.
///
/// # Errors
/// [`Error::Sky`].
pub(crate) fn check_file(settings: &Settings) -> Result<(), Error> {
    let SkySource::File(path) = &settings.sky else {
        return Ok(());
    };
    check_regular(path, settings.bounds.max_image).map_err(|e| {
        let io = e.kind() != ErrorKind::FileTooLarge;
        let option = if io { "" } else { " (--max-image)" };
        Error::Sky {
            file: path.clone(),
            message: format!("{e}{option}"),
            io,
        }
    })
}

/// Bytes of a decoded pixel: three floats.
const PIXEL: u64 = 12;

/// The settings' sky, or else the scene's own `environment`. The settings' intensity and rotation
/// apply to either.
///
/// # Errors
/// [`Error::Sky`] if the image cannot be read or does not contain radiances.
pub(crate) fn load(
    settings: &Settings,
    factor: f32,
    environment: Option<&Environment>,
) -> Result<Sky, Error> {
    let mut intensity = settings.sky_intensity * factor;
    let map = match &settings.sky {
        SkySource::Color(c) => return Ok(Sky::Constant(Vec3::from_array(*c) * intensity)),
        SkySource::File(path) => read_map(path, settings.bounds.max_image)?,
        SkySource::None => match environment {
            None => return Ok(Sky::Black),
            Some(e) => {
                // Light factors are already applied to the document's own sky.
                intensity = settings.sky_intensity;
                (e.width, e.height, e.pixels.clone())
            }
        },
    };
    Ok(place_map(map, intensity, settings.sky_rotation))
}

/// A latitude-longitude map, scaled by `intensity` and rotated by `degrees` about +Y
/// (counter-clockwise seen from above).
///
/// The rotation shifts rows with linear interpolation. It conserves light and blurs by less than a
/// pixel; whole pixels are exact.
fn place_map((width, height, mut pixels): Map, intensity: f32, degrees: f32) -> Sky {
    let shift = f64::from(degrees).rem_euclid(360.0) / 360.0 * f64::from(width);
    let (whole, part) = (shift.floor(), (shift - shift.floor()) as f32);
    // Columns run clockwise seen from above, from −X over −Z to +X, so a counter-clockwise rotation
    // shifts to the left.
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

/// Reads a latitude-longitude image of radiances that takes at most `limit` bytes.
fn read_map(path: &Path, limit: u64) -> Result<Map, Error> {
    let fail = |message: String, io: bool| Error::Sky {
        file: path.to_owned(),
        message,
        io,
    };
    let is_exr = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    let (width, height, pixels) = if is_exr {
        let image = atlas_bake::read_exr_within(path, limit)?;
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
        let bytes = read_regular(path, limit).map_err(|e| {
            let io = e.kind() != ErrorKind::FileTooLarge;
            fail(e.to_string(), io)
        })?;
        let decoder = image::codecs::hdr::HdrDecoder::new(std::io::Cursor::new(bytes))
            .map_err(|e| fail(format!("not a Radiance HDR or EXR image: {e}"), false))?;
        let meta = decoder.metadata();
        let (width, height) = (meta.width as u64, meta.height as u64);
        if width.saturating_mul(height) > limit / PIXEL {
            return Err(fail(
                format!(
                    "found {width} x {height} pixels at {PIXEL} bytes each, expected at most {limit} bytes (--max-image)"
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A sky of 16 × 8 pixels of which one is not black.
    fn lit(column: u32, row: u32) -> Environment {
        let (width, height) = (16, 8);
        let mut pixels = vec![Vec3::ZERO; 128];
        pixels[(row * width + column) as usize] = Vec3::new(1.0, 2.0, 4.0);
        Environment {
            name: String::new(),
            width,
            height,
            pixels,
        }
    }

    /// Direction of the pixel's centre in an [`Environment`], rotated by `degrees` about +Y.
    fn direction(column: u32, row: u32, degrees: f32) -> Vec3 {
        use std::f32::consts::{PI, TAU};
        let a = TAU * ((column as f32 + 0.5) / 16.0 - 0.5);
        let t = PI * (row as f32 + 0.5) / 8.0;
        let d = Vec3::new(t.sin() * a.cos(), t.cos(), t.sin() * a.sin());
        glam::Quat::from_rotation_y(degrees.to_radians()) * d
    }

    fn load_with(settings: &Settings, environment: &Environment) -> Sky {
        load(settings, 1.0, Some(environment)).expect("no file is read")
    }

    #[test]
    fn a_scenes_sky_shines_from_where_it_says() {
        for (column, row) in [(0, 3), (5, 0), (9, 7), (15, 4)] {
            let sky = load_with(&Settings::default(), &lit(column, row));
            // The lookup is bilinear: it returns the pixel's own value at its centre, within
            // rounding of the angles, and a quarter of it at its corner.
            let at = sky.radiance(direction(column, row, 0.0));
            assert!(at.distance(Vec3::new(1.0, 2.0, 4.0)) < 1e-4, "{at}");
            let away = sky.radiance(direction((column + 8) % 16, row, 0.0));
            assert_eq!(away, Vec3::ZERO);
        }
    }

    #[test]
    fn a_turn_moves_the_light_and_keeps_it() {
        for degrees in [90.0, -90.0, 22.5, 360.0, 405.0, -1000.0, 7.0, 200.3] {
            let settings = Settings {
                sky_rotation: degrees,
                sky_intensity: 3.0,
                ..Settings::default()
            };
            let sky = load_with(&settings, &lit(6, 4));
            let Sky::Map { pixels, .. } = &sky else {
                panic!("no map")
            };
            let sum: Vec3 = pixels.iter().sum();
            assert!(sum.distance(Vec3::new(3.0, 6.0, 12.0)) < 1e-5, "{sum}");
            // The shift spreads the light over two pixels and the lookup interpolates between them,
            // so at least half of it remains.
            let at = sky.radiance(direction(6, 4, degrees)).x;
            let whole = (degrees / 22.5).fract() == 0.0;
            assert!(at >= if whole { 2.999 } else { 1.499 }, "{degrees}: {at}");
        }
    }

    #[test]
    fn settings_go_before_the_scene() {
        let settings = |sky| Settings {
            sky,
            ..Settings::default()
        };
        let black = settings(SkySource::Color([0.0; 3]));
        assert!(load_with(&black, &lit(1, 1)).is_black());
        let none = settings(SkySource::None);
        assert!(!load_with(&none, &lit(1, 1)).is_black());
        assert!(matches!(load(&none, 1.0, None), Ok(Sky::Black)));
    }
}
