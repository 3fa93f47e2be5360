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
/// [`Error::Image`] if the crate cannot describe the format, which would be a bug there.
pub(super) fn assemble(
    (vulkan, alignment): (Format, usize),
    [width, height, depth]: [u32; 3],
    data: &[u8],
) -> Result<Vec<u8>> {
    let (basic, type_size) = Basic::from_format(vulkan).map_err(|e| Error::Image {
        what: "KTX2".into(),
        message: e.to_string(),
    })?;
    let block = Block::Basic(basic).to_vec();
    let dfd_byte_offset = Header::LENGTH + LevelIndex::LENGTH;
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
        face_count: 1,
        level_count: 1,
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
    let level = LevelIndex {
        byte_offset: start as u64,
        byte_length: data.len() as u64,
        uncompressed_byte_length: data.len() as u64,
    };
    let mut out = Vec::with_capacity(start + data.len());
    out.extend(header.as_bytes());
    out.extend(level.as_bytes());
    out.extend((dfd_byte_length as u32).to_le_bytes());
    out.extend(block);
    out.extend(kvd);
    out.resize(start, 0);
    out.extend(data);
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
