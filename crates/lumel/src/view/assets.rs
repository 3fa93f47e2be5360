//! The viewer's own files, embedded and compressed.

use std::io::Read;

use flate2::read::GzDecoder;

/// Names under `/static/` and gzip bytes, as listed by `build.rs`.
const ASSETS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/assets.rs"));

/// The gzip bytes of an embedded file.
pub(super) fn compressed(name: &str) -> Option<&'static [u8]> {
    ASSETS.iter().find(|a| a.0 == name).map(|a| a.1)
}

/// An embedded file decompressed, for clients that do not accept gzip.
pub(super) fn plain(packed: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    // The build script compressed it, so this can only fail for lack of memory; an empty answer
    // will do.
    let _ = GzDecoder::new(packed).read_to_end(&mut bytes);
    bytes
}

/// Media type by file extension.
pub(super) fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, end)| end) {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("json") => "application/json",
        Some("txt") => "text/plain; charset=utf-8",
        Some("glb") => "model/gltf-binary",
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("webp") => "image/webp",
        Some("exr") => "image/x-exr",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_import_of_an_own_script_is_an_own_file() {
        for (name, packed) in ASSETS.iter().filter(|a| a.0.ends_with(".js")) {
            let text = String::from_utf8(plain(packed)).unwrap();
            // Only statements count: three.js's comments contain imports too.
            let code = text
                .lines()
                .filter(|l| !l.trim_start().starts_with(['*', '/']));
            for line in code {
                let Some((_, rest)) = line.split_once(" from '") else {
                    continue;
                };
                if !(line.starts_with("import")
                    || line.starts_with('}')
                    || line.starts_with("export"))
                {
                    continue;
                }
                let target = rest.split('\'').next().unwrap();
                let file = target
                    .strip_prefix("./")
                    .unwrap_or_else(|| panic!("{name}: {line}"));
                assert!(compressed(file).is_some(), "{name} imports {target}");
            }
        }
    }

    #[test]
    fn what_is_packed_comes_back() {
        let page = plain(compressed("index.html").unwrap());
        assert!(page.starts_with(b"<!doctype html>"));
        assert!(plain(compressed("THREE-LICENSE.txt").unwrap()).starts_with(b"The MIT License"));
        assert!(compressed("viewer").is_none());
    }
}
