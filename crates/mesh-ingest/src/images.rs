//! Decodes the images that light needs.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use image::{DynamicImage, ImageFormat, ImageReader};
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

    pub fn claim(&mut self, path: &str, [width, height]: [u32; 2]) -> Outcome<()> {
        let pixels = u64::from(width) * u64::from(height);
        self.spent = self.spent.saturating_add(4 * pixels);
        let expected = if pixels > MOST_PIXELS {
            format!("at most {MOST_PIXELS}, 16384²")
        } else if self.spent > self.allowed {
            format!(
                "at most {} bytes in all images at four per pixel (--max-image)",
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
        if faults.take(budget.claim(&path_of(i), size)).is_none() {
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
        budget.claim(&path_of(i), size)?;
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

pub(crate) fn decode_one(path: &str, bytes: &[u8]) -> Outcome<Image> {
    if ktx2::is_ktx2(bytes) {
        return ktx2::decode(path, bytes);
    }
    let decoder = reader(path, bytes)?.into_decoder();
    let rgba = decoder
        .and_then(DynamicImage::from_decoder)
        .map_err(|e| broken(path, e))?
        .into_rgba8();
    let (width, height) = rgba.dimensions();
    Ok(Image {
        width,
        height,
        pixels: rgba
            .into_raw()
            .chunks_exact(4)
            .map(|p| [p[0], p[1], p[2], p[3]])
            .collect(),
    })
}
