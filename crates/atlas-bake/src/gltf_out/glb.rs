//! The .glb container: a JSON chunk and at most one binary chunk (glTF 2.0, §4.4).

use serde_json::{Map, Value};

use crate::error::{Error, Result};

/// Assembles a .glb. `bin` is padded with zeros and the JSON with spaces to multiples of four
/// bytes.
pub(super) fn assemble(json: &Map<String, Value>, bin: &[u8]) -> Result<Vec<u8>> {
    let mut text = serde_json::to_vec(json).map_err(|e| Error::Inconsistent {
        at: "glTF JSON".into(),
        message: e.to_string(),
    })?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let padded = bin.len().next_multiple_of(4);
    let total = 12 + 8 + text.len() + if bin.is_empty() { 0 } else { 8 + padded };
    let length = u32::try_from(total).map_err(|_| Error::Limit {
        what: "size of a .glb in bytes",
        got: total as u64,
        max: u64::from(u32::MAX),
    })?;
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(b"glTF");
    out.extend_from_slice(&2u32.to_le_bytes());
    out.extend_from_slice(&length.to_le_bytes());
    // Both chunks are shorter than `length`, so their sizes fit.
    out.extend_from_slice(&(text.len() as u32).to_le_bytes());
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&text);
    if !bin.is_empty() {
        out.extend_from_slice(&(padded as u32).to_le_bytes());
        out.extend_from_slice(b"BIN\0");
        out.extend_from_slice(bin);
        out.resize(total, 0);
    }
    Ok(out)
}

/// The media type of an image file, from its first bytes.
pub(super) fn sniff_image(bytes: &[u8]) -> Option<&'static str> {
    let at =
        |offset: usize, magic: &[u8]| bytes.get(offset..).is_some_and(|b| b.starts_with(magic));
    Some(match () {
        () if at(0, b"\x89PNG\r\n\x1a\n") => "image/png",
        () if at(0, b"\xff\xd8\xff") => "image/jpeg",
        () if at(0, b"RIFF") && at(8, b"WEBP") => "image/webp",
        () if at(0, b"\xabKTX 20\xbb\r\n\x1a\n") => "image/ktx2",
        () if at(4, b"ftypavif") => "image/avif",
        () if at(0, b"DDS ") => "image/vnd-ms.dds",
        () => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_whole_words_and_lengths_right() {
        let json = Map::from_iter([("asset".to_string(), serde_json::json!({"version": "2.0"}))]);
        let glb = assemble(&json, &[1, 2, 3, 4, 5]).unwrap();
        let word = |i: usize| u32::from_le_bytes(glb[i..i + 4].try_into().unwrap()) as usize;
        assert_eq!((&glb[..4], word(4), word(8)), (&b"glTF"[..], 2, glb.len()));
        let n = word(12);
        assert_eq!((n % 4, &glb[16..20]), (0, &b"JSON"[..]));
        assert_eq!((word(20 + n), &glb[24 + n..28 + n]), (8, &b"BIN\0"[..]));
        assert_eq!(&glb[28 + n..], &[1, 2, 3, 4, 5, 0, 0, 0]);
        let bare = assemble(&json, &[]).unwrap();
        assert_eq!(bare.len(), 20 + n);
    }

    #[test]
    fn image_kinds_are_told_by_content() {
        assert_eq!(sniff_image(b"\x89PNG\r\n\x1a\n...."), Some("image/png"));
        assert_eq!(sniff_image(b"RIFF\0\0\0\0WEBPVP8 "), Some("image/webp"));
        assert_eq!(sniff_image(b"RIFF\0\0\0\0WAVE"), None);
        assert_eq!(sniff_image(b""), None);
    }
}
