//! Decodes the images that light needs.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use image::{ColorType, ImageDecoder, ImageFormat, ImageReader};
use rayon::prelude::*;

use crate::document::{Document, ImageSource};
use crate::error::{Fault, Faults, Outcome};
use crate::input::Input;
use crate::ktx2;
use crate::material::AVIF_WAY_OUT;
use crate::scene::Image;

/// Most pixels of one image, 16384².
const MOST_PIXELS: u64 = 1 << 28;

/// Upper bound of pixels per byte of a JPEG: a block of 64 takes at least one bit, that of its mean
/// in a progressive file. Doubled for safety.
const JPEG_PIXELS_PER_BYTE: u64 = 1024;

/// Upper bound of decoded bytes per byte of DEFLATE data, as in PNG: at most 258 bytes in two bits.
const PNG_BYTES_PER_BYTE: u64 = 1032;

/// Most bytes that a PNG decoder may allocate besides the pixels. Larger colour profiles, which half
/// a megabyte of DEFLATE data may expand to 500 MB, are skipped.
const PNG_EXTRAS: u64 = 16 << 20;

/// Pixels claimed so far. They are claimed before decoding, so that a hundred small files of
/// 10,000² pixels each are refused before any is decoded.
#[derive(Debug)]
pub(crate) struct Budget {
    spent: u64,
    allowed: u64,
}

impl Budget {
    /// A budget of which `pixels` are already used.
    pub fn new(document: &Document, pixels: u64) -> Budget {
        Budget {
            spent: pixels.saturating_mul(4),
            allowed: document.limits().image_bytes,
        }
    }

    /// Claims the pixels of an image stored as `bytes`.
    pub fn claim(&mut self, path: &str, [width, height]: [u32; 2], bytes: &[u8]) -> Outcome<()> {
        let pixels = u64::from(width) * u64::from(height);
        let taken = pixels.saturating_mul(pixel_bytes(bytes));
        self.spent = self.spent.saturating_add(taken);
        let expected = if pixels > MOST_PIXELS {
            format!("at most {MOST_PIXELS}, 16384²")
        } else if self.spent > self.allowed {
            format!(
                "at most {} bytes in all images, four or more per pixel (--max-image)",
                self.allowed
            )
        } else {
            return Ok(());
        };
        Err(Fault::limit(
            path,
            format!("{width} × {height} pixels"),
            expected,
        ))
    }
}

/// Decodes images `needed` of the document; the others stay `None`. `spent` is the number of pixels
/// already decoded.
pub(crate) fn decode(
    document: &mut Document,
    needed: &BTreeSet<usize>,
    spent: u64,
    faults: &mut Faults,
) -> Vec<Option<Image>> {
    let count = faults.take(document.root().len_of("images")).unwrap_or(0);
    let mut images = vec![None; count];
    let (mut sources, mut files) = (Vec::new(), Vec::new());
    let mut budget = Budget::new(document, spent);
    for &i in needed {
        let Some((bytes, file, size)) = faults.take(measure(document, i)) else {
            continue;
        };
        if faults
            .take(budget.claim(&path_of(i), size, &bytes))
            .is_none()
        {
            return images;
        }
        files.extend(file);
        sources.push((i, bytes));
    }
    let decoded: Vec<_> = sources
        .par_iter()
        .map(|(i, bytes)| (*i, decode_one(&path_of(*i), bytes)))
        .collect();
    for (i, outcome) in decoded {
        images[i] = faults.take(outcome);
    }
    files.into_iter().for_each(|f| document.note_input(f));
    images
}

/// Decodes images `needed`, none of which is among those that [`decode`] already decoded with
/// `spent` pixels.
///
/// # Errors
/// The first fault of any of them; then no image is returned.
pub(crate) fn decode_all(
    document: &mut Document,
    needed: &BTreeSet<usize>,
    spent: u64,
) -> Outcome<BTreeMap<usize, Image>> {
    let (mut sources, mut files) = (Vec::new(), Vec::new());
    let mut budget = Budget::new(document, spent);
    for &i in needed {
        let (bytes, file, size) = measure(document, i)?;
        budget.claim(&path_of(i), size, &bytes)?;
        files.extend(file);
        sources.push((i, bytes));
    }
    let images = sources
        .par_iter()
        .map(|(i, bytes)| Ok((*i, decode_one(&path_of(*i), bytes)?)))
        .collect::<Vec<Outcome<_>>>();
    // In order, so that the reported fault does not depend on threads.
    let images = images.into_iter().collect::<Outcome<_>>()?;
    files.into_iter().for_each(|f| document.note_input(f));
    Ok(images)
}

/// An image's bytes, its file, and its size from the header.
fn measure(document: &Document, i: usize) -> Outcome<(Vec<u8>, Option<Input>, [u32; 2])> {
    let (bytes, file) = open(document, i)?;
    let size = dimensions(&path_of(i), &bytes)?;
    Ok((bytes, file, size))
}

fn path_of(i: usize) -> String {
    format!("images[{i}]")
}

pub(crate) type Opened = (Vec<u8>, Option<Input>);

pub(crate) fn open(document: &Document, i: usize) -> Outcome<Opened> {
    match document.image(i)? {
        ImageSource::Embedded(bytes) => Ok((bytes.into_owned(), None)),
        ImageSource::File(file) => {
            let path = format!("{}.uri", path_of(i));
            let limit = document.limits().file_bytes;
            let bytes = document.files.read(&file, &path, limit)?;
            let uri = document
                .root()
                .element("images", i)?
                .opt_str("uri")?
                .unwrap_or_default()
                .to_string();
            let input = Input::new(file, uri, &bytes);
            Ok((bytes, Some(input)))
        }
    }
}

/// Detects the format by content, because media types and file names are often wrong.
fn format_of(path: &str, bytes: &[u8]) -> Outcome<ImageFormat> {
    if bytes.get(4..12) == Some(b"ftypavif") {
        return Err(Fault::unsupported(path, "an AVIF image", AVIF_WAY_OUT));
    }
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => Ok(format),
        Ok(other) => Err(Fault::unsupported(
            path,
            format!("a {other:?} image"),
            "a PNG, JPEG, WebP or KTX2 image",
        )),
        Err(_) => Err(Fault::invalid(
            path,
            "an unknown image format",
            "a PNG, JPEG, WebP or KTX2 image",
        )),
    }
}

fn reader<'b>(path: &str, bytes: &'b [u8]) -> Outcome<ImageReader<Cursor<&'b [u8]>>> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format_of(path, bytes)?);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 16);
    limits.max_image_height = Some(1 << 16);
    limits.max_alloc = Some(PNG_EXTRAS);
    reader.limits(limits);
    Ok(reader)
}

fn broken(path: &str, e: image::ImageError) -> Fault {
    match e {
        image::ImageError::Unsupported(e) => {
            Fault::unsupported(path, e.to_string(), "a plain PNG, JPEG or WebP image")
        }
        image::ImageError::Limits(e) => {
            Fault::limit(path, e.to_string(), "an image below 65536² pixels")
        }
        e => Fault::invalid(
            path,
            format!("a broken image ({e})"),
            "an image that decodes",
        ),
    }
}

pub(crate) fn dimensions(path: &str, bytes: &[u8]) -> Outcome<[u32; 2]> {
    if ktx2::is_ktx2(bytes) {
        return ktx2::dimensions(path, bytes);
    }
    let (width, height) = reader(path, bytes)?
        .into_dimensions()
        .map_err(|e| broken(path, e))?;
    if width == 0 || height == 0 {
        return Err(Fault::invalid(
            path,
            format!("{width} × {height} pixels"),
            "at least one pixel",
        ));
    }
    // Decoders fill in missing data of a JPEG, which may be nearly all of it, and allocate memory
    // for a PNG before decoding. A WebP of any size may be a few bytes long.
    let stored = bytes.len() as u64;
    let most = match format_of(path, bytes)? {
        ImageFormat::Jpeg => stored.saturating_mul(JPEG_PIXELS_PER_BYTE),
        ImageFormat::Png => stored.saturating_mul(8 * PNG_BYTES_PER_BYTE) / png_bits(bytes),
        _ => u64::MAX,
    };
    if u64::from(width) * u64::from(height) > most {
        return Err(Fault::invalid(
            path,
            format!("{width} × {height} pixels in {stored} bytes"),
            "a complete image",
        ));
    }
    Ok([width, height])
}

/// Bits per pixel of a PNG, from its header at a fixed position.
fn png_bits(bytes: &[u8]) -> u64 {
    let depth = bytes.get(24).map_or(1, |d| u64::from(*d).clamp(1, 16));
    let channels = match bytes.get(25) {
        Some(2) => 3,
        Some(4) => 2,
        Some(6) => 4,
        _ => 1,
    };
    depth * channels
}

/// Bytes per pixel that decoding takes at most: four, or those of a 16-bit PNG.
fn pixel_bytes(bytes: &[u8]) -> u64 {
    match image::guess_format(bytes) {
        Ok(ImageFormat::Png) => (png_bits(bytes) / 8).max(4),
        _ => 4,
    }
}

pub(crate) fn decode_one(path: &str, bytes: &[u8]) -> Outcome<Image> {
    if ktx2::is_ktx2(bytes) {
        return ktx2::decode(path, bytes);
    }
    let decoded = reader(path, bytes)?.into_decoder().and_then(|decoder| {
        let size = decoder.dimensions();
        Ok((size, read_rgba8(decoder)?))
    });
    let ((width, height), pixels) = decoded.map_err(|e| broken(path, e))?;
    Ok(Image {
        width,
        height,
        pixels,
    })
}

/// Decodes to 8 bits and four channels within one allocation, because an image may take most of the
/// memory that is allowed: what the decoder writes at the end is widened from the beginning, or
/// narrowed, in place.
fn read_rgba8(decoder: impl ImageDecoder) -> image::ImageResult<Vec<[u8; 4]>> {
    let color = decoder.color_type();
    let (channels, each) = match color {
        ColorType::L8 => (1, 1),
        ColorType::La8 => (2, 1),
        ColorType::Rgb8 => (3, 1),
        ColorType::Rgba8 => (4, 1),
        ColorType::L16 => (1, 2),
        ColorType::La16 => (2, 2),
        ColorType::Rgb16 => (3, 2),
        ColorType::Rgba16 => (4, 2),
        other => {
            let kind = image::error::UnsupportedErrorKind::Color(other.into());
            let hint = image::error::ImageFormatHint::Unknown;
            let error = image::error::UnsupportedError::from_format_and_kind(hint, kind);
            return Err(image::ImageError::Unsupported(error));
        }
    };
    let (width, height) = decoder.dimensions();
    let pixels = width as usize * height as usize;
    let stored = channels * each;
    let mut out = vec![[0; 4]; (pixels * stored).div_ceil(4).max(pixels)];
    let flat = out.as_flattened_mut();
    let start = if stored < 4 {
        flat.len() - pixels * stored
    } else {
        0
    };
    decoder.read_image(&mut flat[start..start + pixels * stored])?;
    if color == ColorType::Rgba8 {
        return Ok(out);
    }
    for i in 0..pixels {
        let at = start + stored * i;
        let value = |channel: usize| match each {
            1 => flat[at + channel],
            _ => {
                let wide = [flat[at + 2 * channel], flat[at + 2 * channel + 1]];
                // To the nearest: 65535 is 255 × 257.
                ((u32::from(u16::from_ne_bytes(wide)) + 128) / 257) as u8
            }
        };
        let pixel = match channels {
            1 => [value(0), value(0), value(0), 255],
            2 => [value(0), value(0), value(0), value(1)],
            3 => [value(0), value(1), value(2), 255],
            _ => [value(0), value(1), value(2), value(3)],
        };
        // Ends at or before the end of what was read.
        flat[4 * i..4 * i + 4].copy_from_slice(&pixel);
    }
    out.truncate(pixels);
    out.shrink_to_fit();
    Ok(out)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use image::{DynamicImage, ImageFormat};

    use super::decode_one;

    /// The crate's own conversion, which takes a copy.
    #[test]
    fn pixels_are_those_that_the_crate_would_convert_to() {
        let noise = image::ImageBuffer::from_fn(7, 5, |x, y| {
            let at = |k: u32| (x * 9973 + y * 7919 + k * 104_729) as u16;
            image::Rgba([at(1), at(2).wrapping_mul(3), at(3), at(4).wrapping_mul(5)])
        });
        let deep = DynamicImage::ImageRgba16(noise);
        let kinds = [
            DynamicImage::from(deep.to_luma8()),
            deep.to_luma_alpha8().into(),
            deep.to_rgb8().into(),
            deep.to_rgba8().into(),
            deep.to_luma16().into(),
            deep.to_luma_alpha16().into(),
            deep.to_rgb16().into(),
            deep,
        ];
        for picture in kinds {
            let mut bytes = Cursor::new(Vec::new());
            let written = picture.write_to(&mut bytes, ImageFormat::Png);
            written.expect("memory takes all");
            let read = decode_one("images[0]", bytes.get_ref()).expect("it is sound");
            let expected = picture.to_rgba8().into_raw();
            assert_eq!([read.width, read.height], [7, 5]);
            assert!(
                read.pixels.as_flattened() == expected,
                "{:?}",
                picture.color()
            );
        }
    }
}
