//! PNG encoding and the colour scale of error and coverage pictures.

use std::io::Cursor;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use crate::error::{Error, Result};

/// Evenly spaced stops of the heat scale. Brightness increases monotonically, so the scale also
/// works in greyscale.
const STOPS: [[f32; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [40.0, 40.0, 180.0],
    [20.0, 150.0, 140.0],
    [220.0, 200.0, 30.0],
    [255.0, 90.0, 30.0],
    [255.0, 255.0, 255.0],
];

/// Colour of `t` in 0..=1 (clamped; NaN counts as 1): black, blue, green, yellow, red, white.
pub(crate) fn heat(t: f32) -> [u8; 3] {
    let last = STOPS.len() - 1;
    let s = if t.is_nan() { 1.0 } else { t.clamp(0.0, 1.0) } * last as f32;
    let i = (s as usize).min(last - 1);
    let f = s - i as f32;
    std::array::from_fn(|c| (STOPS[i][c] + (STOPS[i + 1][c] - STOPS[i][c]) * f).round() as u8)
}

/// `width × height` sRGB pixels, row 0 at the top, as a PNG without any metadata.
pub(crate) fn encode_png(width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<Vec<u8>> {
    if pixels.len() != width as usize * height as usize {
        let message = format!("expected {width} x {height} pixels, got {}", pixels.len());
        return Err(Error::Inconsistent {
            at: "picture".into(),
            message,
        });
    }
    let mut bytes = Cursor::new(Vec::new());
    PngEncoder::new(&mut bytes)
        .write_image(
            pixels.as_flattened(),
            width,
            height,
            ExtendedColorType::Rgb8,
        )
        .map_err(|e| Error::Image {
            what: "PNG".into(),
            message: e.to_string(),
        })?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heat_hits_its_ends_and_takes_anything() {
        assert_eq!(heat(0.0), [0, 0, 0]);
        assert_eq!(heat(1.0), [255, 255, 255]);
        assert_eq!(
            (heat(-5.0), heat(7.0), heat(f32::NAN)),
            (heat(0.0), heat(1.0), heat(1.0))
        );
        assert_eq!(heat(f32::NEG_INFINITY), heat(0.0));
    }

    #[test]
    fn pixel_count_must_fit() {
        assert!(encode_png(2, 2, &[[0; 3]; 3]).is_err());
    }
}
