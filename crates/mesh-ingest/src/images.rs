//! Decoding of the images that light needs.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use image::{ImageFormat, ImageReader};
use rayon::prelude::*;

use crate::document::{Document, ImageSource};
use crate::error::{Fault, Faults, Outcome};
use crate::input::Input;
use crate::material::{AVIF_WAY_OUT, KTX2_WAY_OUT};
use crate::scene::Image;

/// More pixels than a byte of a JPEG can hold: a block of 64 takes a bit at the least, that of its mean in a progressive file. Twice
/// that leaves room for what has not been thought of.
const JPEG_PIXELS_PER_BYTE: u64 = 1024;

/// Decodes images `needed` of the document; the others stay `None`.
pub(crate) fn decode(
    document: &mut Document,
    needed: &BTreeSet<usize>,
    faults: &mut Faults,
) -> Vec<Option<Image>> {
    let count = faults.take(document.root().len_of("images")).unwrap_or(0);
    let mut images = vec![None; count];
    // Sizes first, so that a hundred small files that each claim 10,000² pixels are refused before any is decoded.
    let mut sources = Vec::new();
    let (mut pixels, mut files) = (0u64, Vec::new());
    for &i in needed {
        let source = open(document, i).and_then(|(bytes, file)| {
            let size = dimensions(i, &bytes)?;
            Ok((bytes, file, size))
        });
        if let Some((bytes, file, size)) = faults.take(source) {
            pixels += u64::from(size[0]) * u64::from(size[1]);
            if pixels > document.limits().image_pixels {
                let allowed = format!("at most {} pixels in all", document.limits().image_pixels);
                faults.push(Fault::limit(
                    format!("images[{i}]"),
                    format!("{} × {} pixels", size[0], size[1]),
                    allowed,
                ));
                return images;
            }
            files.extend(file);
            sources.push((i, bytes));
        }
    }
    let decoded: Vec<_> = sources
        .par_iter()
        .map(|(i, bytes)| (*i, decode_one(*i, bytes)))
        .collect();
    for (i, outcome) in decoded {
        images[i] = faults.take(outcome);
    }
    files.into_iter().for_each(|f| document.note_input(f));
    images
}

/// Decodes images `needed`, which are not among those that [`decode`] already took `spent` pixels for.
///
/// # Errors
/// The first fault of any of them; none is returned then.
pub(crate) fn decode_all(
    document: &mut Document,
    needed: &BTreeSet<usize>,
    spent: u64,
) -> Outcome<BTreeMap<usize, Image>> {
    let allowed = document.limits().image_pixels;
    let (mut pixels, mut sources, mut files) = (spent, Vec::new(), Vec::new());
    for &i in needed {
        let (bytes, file) = open(document, i)?;
        let [width, height] = dimensions(i, &bytes)?;
        pixels += u64::from(width) * u64::from(height);
        if pixels > allowed {
            return Err(Fault::limit(
                format!("images[{i}]"),
                format!("{width} × {height} pixels"),
                format!("at most {allowed} pixels in all"),
            ));
        }
        files.extend(file);
        sources.push((i, bytes));
    }
    let images = sources
        .par_iter()
        .map(|(i, bytes)| Ok((*i, decode_one(*i, bytes)?)))
        .collect::<Vec<Outcome<_>>>();
    // In order, so that the fault that is told does not depend on threads.
    let images = images.into_iter().collect::<Outcome<_>>()?;
    files.into_iter().for_each(|f| document.note_input(f));
    Ok(images)
}

type Opened = (Vec<u8>, Option<Input>);

fn open(document: &Document, i: usize) -> Outcome<Opened> {
    match document.image(i)? {
        ImageSource::Embedded(bytes) => Ok((bytes.into_owned(), None)),
        ImageSource::File(file) => {
            let path = format!("images[{i}].uri");
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

/// Tells the format by content: media types and file names in the wild are wrong too often.
fn format_of(i: usize, bytes: &[u8]) -> Outcome<ImageFormat> {
    let path = format!("images[{i}]");
    if bytes.starts_with(b"\xabKTX 20\xbb") {
        return Err(Fault::unsupported(path, "a KTX2 image", KTX2_WAY_OUT));
    }
    if bytes.get(4..12) == Some(b"ftypavif") {
        return Err(Fault::unsupported(path, "an AVIF image", AVIF_WAY_OUT));
    }
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => Ok(format),
        Ok(other) => Err(Fault::unsupported(
            path,
            format!("a {other:?} image"),
            "a PNG, JPEG or WebP image",
        )),
        Err(_) => Err(Fault::invalid(
            path,
            "bytes of no known image format",
            "a PNG, JPEG or WebP image",
        )),
    }
}

fn reader(i: usize, bytes: &[u8]) -> Outcome<ImageReader<Cursor<&[u8]>>> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format_of(i, bytes)?);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 16);
    limits.max_image_height = Some(1 << 16);
    limits.max_alloc = Some(2 << 30);
    reader.limits(limits);
    Ok(reader)
}

fn broken(i: usize, e: image::ImageError) -> Fault {
    let path = format!("images[{i}]");
    match e {
        image::ImageError::Unsupported(e) => {
            Fault::unsupported(path, e.to_string(), "a plain PNG, JPEG or WebP image")
        }
        image::ImageError::Limits(e) => Fault::limit(
            path,
            e.to_string(),
            "an image below 65536² pixels and 2 GiB",
        ),
        e => Fault::invalid(
            path,
            format!("a broken image ({e})"),
            "an image that decodes",
        ),
    }
}

fn dimensions(i: usize, bytes: &[u8]) -> Outcome<[u32; 2]> {
    let (width, height) = reader(i, bytes)?
        .into_dimensions()
        .map_err(|e| broken(i, e))?;
    if width == 0 || height == 0 {
        return Err(Fault::invalid(
            format!("images[{i}]"),
            format!("{width} × {height} pixels"),
            "at least one pixel",
        ));
    }
    // Decoders fill up what is missing of a JPEG, which may be nearly all of it.
    let most = (bytes.len() as u64).saturating_mul(JPEG_PIXELS_PER_BYTE);
    if u64::from(width) * u64::from(height) > most && format_of(i, bytes)? == ImageFormat::Jpeg {
        return Err(Fault::invalid(
            format!("images[{i}]"),
            format!("{width} × {height} pixels in {} bytes", bytes.len()),
            "an image that is not cut short",
        ));
    }
    Ok([width, height])
}

fn decode_one(i: usize, bytes: &[u8]) -> Outcome<Image> {
    let rgba = reader(i, bytes)?
        .decode()
        .map_err(|e| broken(i, e))?
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
