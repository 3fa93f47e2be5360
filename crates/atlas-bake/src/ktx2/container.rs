//! The KTX2 container.
//!
//! Based on: Khronos, KTX File Format Specification, version 2.0, §3 to §5. Structures and the data
//! format descriptor come from the crate `ktx2`; this module orders and pads them.

use ktx2::dfd::{Basic, Block};
use ktx2::{Format, Header, Index, LevelIndex};

use super::format::Ktx2Format;
use crate::error::{Error, Result};

/// The Vulkan format of a lightmap page, and the alignment of its data in bytes.
pub(super) fn layout_of(format: Ktx2Format) -> (Format, usize) {
    match format {
        Ktx2Format::Bc6h => (Format::BC6H_UFLOAT_BLOCK, 16),
        Ktx2Format::Rgb9e5 => (Format::E5B9G9R9_UFLOAT_PACK32, 4),
    }
}

/// A KTX2 file with one level. A depth of 0 is that of an image, any other that of a volume.
///
/// # Errors
/// As [`assemble_levels`].
pub(super) fn assemble(layout: (Format, usize), size: [u32; 3], data: &[u8]) -> Result<Vec<u8>> {
    assemble_levels(layout, size, 1, &[data])
}

/// A KTX2 file with these levels, the largest first, of 1 face or of 6.
///
/// # Errors
/// [`Error::Image`] if the crate cannot describe the format, which would be a bug there.
pub(super) fn assemble_levels(
    (vulkan, alignment): (Format, usize),
    [width, height, depth]: [u32; 3],
    faces: u32,
    levels: &[&[u8]],
) -> Result<Vec<u8>> {
    let (basic, type_size) = Basic::from_format(vulkan).map_err(|e| Error::Image {
        what: "KTX2".into(),
        message: e.to_string(),
    })?;
    let block = Block::Basic(basic).to_vec();
    let dfd_byte_offset = Header::LENGTH + levels.len() * LevelIndex::LENGTH;
    let dfd_byte_length = 4 + block.len();
    let kvd_byte_offset = dfd_byte_offset + dfd_byte_length;
    let kvd = key_values(if depth == 0 { "rd" } else { "rdi" });
    let start = (kvd_byte_offset + kvd.len()).next_multiple_of(alignment);
    let header = Header {
        format: Some(vulkan),
        type_size,
        pixel_width: width,
        pixel_height: height,
        pixel_depth: depth,
        layer_count: 0,
        face_count: faces,
        level_count: levels.len() as u32,
        supercompression_scheme: None,
        index: Index {
            dfd_byte_offset: dfd_byte_offset as u32,
            dfd_byte_length: dfd_byte_length as u32,
            kvd_byte_offset: kvd_byte_offset as u32,
            kvd_byte_length: kvd.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    let total: usize = levels.iter().map(|level| level.len()).sum();
    let mut out = Vec::with_capacity(start + total);
    out.extend(header.as_bytes());
    // The data of the smallest level comes first (§3.9.7). Only formats with texels of a multiple of
    // four bytes have several levels here, so that all of them are aligned.
    let mut end = start + total;
    for level in levels {
        end -= level.len();
        let entry = LevelIndex {
            byte_offset: end as u64,
            byte_length: level.len() as u64,
            uncompressed_byte_length: level.len() as u64,
        };
        out.extend(entry.as_bytes());
    }
    out.extend((dfd_byte_length as u32).to_le_bytes());
    out.extend(block);
    out.extend(kvd);
    out.resize(start, 0);
    levels.iter().rev().for_each(|level| out.extend(*level));
    Ok(out)
}

/// Keys in code point order, each preceded by its length and padded to four bytes (§3.11).
fn key_values(orientation: &str) -> Vec<u8> {
    let mut out = Vec::new();
    for (key, value) in [
        ("KTXorientation", orientation),
        ("KTXwriter", concat!("lumel ", env!("CARGO_PKG_VERSION"))),
    ] {
        out.extend((key.len() as u32 + value.len() as u32 + 2).to_le_bytes());
        for text in [key, value] {
            out.extend(text.as_bytes());
            out.push(0);
        }
        out.resize(out.len().next_multiple_of(4), 0);
    }
    out
}
