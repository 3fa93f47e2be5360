//! The glTF container, .gltf or .glb.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use serde_json::Value;

use crate::error::{Fault, Outcome};
use crate::regular::read_regular;

/// The JSON of a document and, for .glb, its binary chunk.
#[derive(Debug)]
pub(crate) struct Container {
    pub json: Value,
    pub binary: bool,
    pub chunk: Option<Vec<u8>>,
}

/// Reads a regular file of at most `limit` bytes, named at document path `path`.
pub(crate) fn read_file(file: &Path, path: &str, limit: u64) -> Outcome<Vec<u8>> {
    read_regular(file, limit).map_err(|e| match e.kind() {
        ErrorKind::FileTooLarge => Fault::limit(
            path,
            format!(
                "{} with {} bytes",
                file.display(),
                fs::metadata(file).map_or(0, |m| m.len())
            ),
            format!("at most {limit} bytes"),
        ),
        _ => Fault::io(path, file, e),
    })
}

/// Splits `bytes` into JSON and binary chunk.
pub(crate) fn parse(bytes: &[u8]) -> Outcome<Container> {
    if bytes.starts_with(b"glTF") {
        return parse_glb(bytes);
    }
    Ok(Container {
        json: parse_json(bytes)?,
        binary: false,
        chunk: None,
    })
}

fn parse_json(bytes: &[u8]) -> Outcome<Value> {
    if bytes.is_empty() {
        return Err(Fault::invalid(
            "",
            "an empty file",
            "a glTF 2.0 document (.gltf or .glb)",
        ));
    }
    if bytes.starts_with(b"\xef\xbb\xbf") {
        return Err(Fault::invalid(
            "",
            "a byte order mark",
            "JSON in UTF-8 that begins with '{'",
        ));
    }
    let first = bytes.iter().find(|b| !b.is_ascii_whitespace());
    if first != Some(&b'{') {
        return Err(Fault::invalid(
            "",
            "neither a JSON object nor a GLB header",
            "a glTF 2.0 document (.gltf or .glb)",
        ));
    }
    let mut json = serde_json::from_slice(bytes)
        .map_err(|e| Fault::invalid("", format!("broken JSON ({e})"), "a JSON object"))?;
    settle_integers(&mut json, Context::Other);
    Ok(json)
}

/// Members whose numbers are indices, counts or enumerations, in the specification and in
/// extensions.
const INTEGERS: [&str; 32] = [
    "buffer",
    "bufferView",
    "byteLength",
    "byteOffset",
    "byteStride",
    "camera",
    "children",
    "componentType",
    "count",
    "ids",
    "index",
    "indices",
    "input",
    "inverseBindMatrices",
    "joints",
    "light",
    "magFilter",
    "material",
    "mesh",
    "minFilter",
    "mode",
    "node",
    "nodes",
    "output",
    "sampler",
    "scene",
    "skeleton",
    "skin",
    "source",
    "specularImages",
    "texCoord",
    "variants",
];

/// Members that are objects of indices, or lists of such objects.
const INDEX_MAPS: [&str; 2] = ["attributes", "targets"];

/// Context of a JSON value.
#[derive(Clone, Copy, PartialEq)]
enum Context {
    Other,
    Integers,
    IndexMap,
}

/// Replaces `1.0` by `1` where glTF requires an integer, because some writers only know floats. All
/// readers and the output then see one form.
fn settle_integers(value: &mut Value, place: Context) {
    match value {
        Value::Number(n) if place == Context::Integers && n.is_f64() => {
            // Beyond 2^53 a float is not an exact count.
            let whole = |x: &f64| x.fract() == 0.0 && x.abs() < 9.0e15;
            if let Some(x) = n.as_f64().filter(whole) {
                *value = (x as i64).into();
            }
        }
        Value::Array(list) => {
            list.iter_mut().for_each(|v| settle_integers(v, place));
        }
        Value::Object(members) => {
            for (key, value) in members.iter_mut().filter(|(key, _)| *key != "extras") {
                let of_map = place == Context::IndexMap && value.is_number();
                let place = if of_map || INTEGERS.contains(&key.as_str()) {
                    Context::Integers
                } else if INDEX_MAPS.contains(&key.as_str()) {
                    Context::IndexMap
                } else {
                    Context::Other
                };
                settle_integers(value, place);
            }
        }
        _ => {}
    }
}

/// Reads the GLB container by hand: `gltf::Glb::from_slice` underflows on a short length and
/// refuses unknown chunks, which the specification (glTF 2.0, §4.4) tells readers to skip.
fn parse_glb(bytes: &[u8]) -> Outcome<Container> {
    let word = |at: usize| {
        bytes
            .get(at..at + 4)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(Fault::invalid(
            "glb.header",
            format!("{} bytes", bytes.len()),
            "at least 12",
        ));
    };
    if version == 1 {
        return Err(Fault::unsupported(
            "glb.header.version",
            "1 (glTF 1.0)",
            UPGRADE,
        ));
    }
    if version != 2 {
        return Err(Fault::invalid(
            "glb.header.version",
            format!("{version}"),
            "2",
        ));
    }
    if (length as usize) > bytes.len() || length < 12 {
        return Err(Fault::invalid(
            "glb.header.length",
            format!("{length}"),
            format!("12..={} (the file's size)", bytes.len()),
        ));
    }
    let end = length as usize;
    let (mut at, mut number, mut json, mut chunk) = (12, 0, None, None);
    while at < end {
        let path = format!("glb.chunks[{number}]");
        let Some((size, kind)) = word(at)
            .zip(bytes.get(at + 4..at + 8))
            .filter(|_| at + 8 <= end)
        else {
            return Err(Fault::invalid(
                path,
                format!("{} bytes of a chunk header", end - at),
                "8",
            ));
        };
        let from = at + 8;
        let Some(data) = from
            .checked_add(size as usize)
            .filter(|&to| to <= end)
            .map(|to| &bytes[from..to])
        else {
            return Err(Fault::invalid(
                path,
                format!("a chunk of {size} bytes"),
                format!("at most the {} remaining bytes", end - from),
            ));
        };
        match (number, kind) {
            (0, b"JSON") => json = Some(parse_json(data)?),
            (0, _) => {
                return Err(Fault::invalid(
                    path,
                    "another chunk",
                    "the JSON chunk first",
                ));
            }
            (_, b"JSON") => return Err(Fault::invalid(path, "a second JSON chunk", "one")),
            (1, b"BIN\0") => chunk = Some(data.to_vec()),
            (_, b"BIN\0") => {
                return Err(Fault::invalid(
                    path,
                    "a binary chunk",
                    "a binary chunk only as the second chunk",
                ));
            }
            _ => {}
        }
        at = from + size as usize;
        number += 1;
    }
    match json {
        Some(json) => Ok(Container {
            json,
            binary: true,
            chunk,
        }),
        None => Err(Fault::invalid("glb", "no chunk", "a JSON chunk")),
    }
}

/// How to convert glTF 1.0. gltf-pipeline is Cesium's converter (npm).
pub(crate) const UPGRADE: &str =
    "glTF 2.0; `npx gltf-pipeline -i old.gltf -o new.glb` upgrades a 1.0 document";
