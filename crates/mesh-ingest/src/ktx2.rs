//! KTX2 pictures as `KHR_texture_basisu` allows them: ETC1S or UASTC, one 2D picture, of which the
//! largest level is read.
//!
//! The header is checked here, because `basisu` allocates what a file claims.

use std::panic::catch_unwind;

use basisu::{DecodeFlags, SourceFormat, TargetFormat, Transcoder};

use crate::error::{Fault, Outcome};
use crate::material::KTX2_WAY_OUT;
use crate::scene::Image;

const MAGIC: &[u8; 12] = b"\xabKTX 20\xbb\r\n\x1a\n";

/// Bytes of the header and of each entry of the level index.
const HEADER: usize = 80;
const LEVEL: usize = 24;

/// Values of `supercompressionScheme`.
const BASIS_LZ: u32 = 1;
const ZSTANDARD: u32 = 2;

/// Whether `bytes` begin like a KTX2 file.
pub(crate) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Width and height in pixels of the image at `path`, after a check of what the header claims.
pub(crate) fn dimensions(path: &str, bytes: &[u8]) -> Outcome<[u32; 2]> {
    let broken = |found: String| {
        Fault::invalid(
            path,
            format!("a broken KTX2 image ({found})"),
            "an image that decodes",
        )
    };
    if bytes.len() < HEADER + LEVEL {
        return Err(broken(format!("{} bytes", bytes.len())));
    }
    let [format, width, height, depth, layers, faces, levels, scheme] =
        [12, 20, 24, 28, 32, 36, 40, 44].map(|at| word(bytes, at));
    if format != 0 || scheme > ZSTANDARD {
        return Err(Fault::unsupported(
            path,
            format!("a KTX2 image of Vulkan format {format}, supercompression {scheme}"),
            format!("ETC1S or UASTC, or {KTX2_WAY_OUT}"),
        ));
    }
    if depth != 0 || layers > 1 || faces != 1 {
        return Err(Fault::unsupported(
            path,
            format!("a KTX2 image of depth {depth}, {layers} layers, {faces} faces"),
            "one 2D picture",
        ));
    }
    if width == 0 || height == 0 {
        return Err(broken(format!("{width} × {height} pixels")));
    }
    if !(1..=16).contains(&levels) || bytes.len() < HEADER + LEVEL * levels as usize {
        return Err(broken(format!("{levels} levels")));
    }
    let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
    for level in 0..levels as usize {
        let [offset, length, inflated] =
            [0, 8, 16].map(|at| double(bytes, HEADER + LEVEL * level + at));
        let end = offset.checked_add(length);
        if end.is_none_or(|end| end > bytes.len() as u64) {
            return Err(broken(format!("level {level} ends beyond the file")));
        }
        // A block of UASTC has 16 bytes.
        if scheme != BASIS_LZ && inflated > 16 * blocks {
            return Err(broken(format!("{inflated} bytes in level {level}")));
        }
    }
    Ok([width, height])
}

/// Decodes the image at `path`, whose [`dimensions`] were checked.
pub(crate) fn decode(path: &str, bytes: &[u8]) -> Outcome<Image> {
    let [width, height] = [20, 24].map(|at| word(bytes, at));
    // The decoder is young and its input is untrusted. A panic there must not abort a bake.
    let decoded = catch_unwind(|| {
        let file = Transcoder::new(bytes).map_err(|e| format!("{e:?}"))?;
        let source = file.source_format();
        if !matches!(source, SourceFormat::Etc1s | SourceFormat::UastcLdr) {
            return Ok(Err(source));
        }
        let rgba = TargetFormat::Rgba32;
        let size = file.output_size(0, rgba).map_err(|e| format!("{e:?}"))?;
        if size != 4 * width as usize * height as usize {
            return Err(format!("{size} bytes of {width} × {height} pixels"));
        }
        // Into their final place, because an image may take most of the memory that is allowed.
        let mut pixels = vec![[0; 4]; size / 4];
        let out = pixels.as_flattened_mut();
        file.transcode_into(0, rgba, DecodeFlags::NONE, out)
            .map(|_| Ok(pixels))
            .map_err(|e| format!("{e:?}"))
    });
    let pixels = match decoded.unwrap_or_else(|_| Err("damaged data".into())) {
        Ok(Ok(pixels)) => pixels,
        Ok(Err(source)) => {
            let expected = format!("ETC1S or UASTC, or {KTX2_WAY_OUT}");
            return Err(Fault::unsupported(
                path,
                format!("a KTX2 image, {source:?}"),
                expected,
            ));
        }
        Err(e) => {
            let found = format!("a broken KTX2 image ({e})");
            return Err(Fault::invalid(path, found, "an image that decodes"));
        }
    };
    Ok(Image {
        width,
        height,
        pixels,
    })
}

/// Little-endian number at `at`, or 0 beyond the end.
fn word(bytes: &[u8], at: usize) -> u32 {
    let found = bytes.get(at..).and_then(|b| b.first_chunk());
    found.map_or(0, |b| u32::from_le_bytes(*b))
}

fn double(bytes: &[u8], at: usize) -> u64 {
    let found = bytes.get(at..).and_then(|b| b.first_chunk());
    found.map_or(0, |b| u64::from_le_bytes(*b))
}
