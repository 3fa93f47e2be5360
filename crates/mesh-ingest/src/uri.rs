//! URIs: what a document may reference, and where it is.

use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use crate::error::{Fault, Outcome};

/// Exporters disagree about padding, and nothing is ambiguous without it.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// What a URI denotes.
#[derive(Debug)]
pub(crate) enum Target {
    /// Bytes in the URI itself.
    Data(Vec<u8>),
    /// A file.
    File(PathBuf),
}

/// Where URIs may lead.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds<'a> {
    /// The document's folder; without one, files are just names.
    pub base: Option<&'a Path>,
    /// Whether `..` and links may lead out of it.
    pub outside: bool,
}

/// Resolves `uri` (found at document path `path`). The output contains the files that a document
/// references, so an untrusted document could exfiltrate any file that can be read here. Absolute
/// paths are never followed, and nothing outside the document's folder unless `bounds` allow it.
pub(crate) fn resolve(uri: &str, bounds: Bounds<'_>, path: &str) -> Outcome<Target> {
    if let Some(rest) = strip_prefix_ignore_case(uri, "data:") {
        return data(rest, path).map(Target::Data);
    }
    if has_scheme(uri) {
        return Err(Fault::unsupported(
            path,
            format!("\"{uri}\""),
            "a relative path or a data URI; download the file to the document's folder and reference it there",
        ));
    }
    let name = percent_encoding::percent_decode_str(uri).decode_utf8();
    let name = match name {
        Ok(name) if !name.is_empty() && !name.contains('\0') => name,
        _ => {
            return Err(Fault::invalid(
                path,
                "a URI that is not a file name",
                "a relative path in UTF-8",
            ));
        }
    };
    let Some(base) = bounds.base else {
        check_name(&name, bounds, path)?;
        return Ok(Target::File(PathBuf::from(name.as_ref())));
    };
    // Some exporters do not encode at all, so a file with a literal percent sign takes precedence
    // over the decoded name.
    let candidates = [Cow::Borrowed(uri), name];
    for name in &candidates {
        check_name(name, bounds, path)?;
    }
    let [literal, decoded] = candidates.map(|name| base.join(name.as_ref()));
    let file = if literal.is_file() { literal } else { decoded };
    if !bounds.outside && leads_out(&file, base) {
        return Err(outside(
            path,
            format!("\"{uri}\", a link that leads out of the document's folder"),
        ));
    }
    Ok(Target::File(file))
}

/// Validates a name before the file system is touched.
fn check_name(name: &str, bounds: Bounds<'_>, path: &str) -> Outcome<()> {
    let mut depth = 0usize;
    for part in Path::new(name).components() {
        depth = match part {
            Component::Normal(_) => depth + 1,
            Component::CurDir => depth,
            Component::ParentDir if bounds.outside => depth,
            Component::ParentDir if depth > 0 => depth - 1,
            Component::ParentDir => {
                return Err(outside(
                    path,
                    format!("\"{name}\", which leads out of the document's folder"),
                ));
            }
            Component::RootDir | Component::Prefix(_) => {
                return Err(Fault::invalid(
                    path,
                    format!("the absolute path \"{name}\""),
                    "a path relative to the document",
                ));
            }
        };
    }
    Ok(())
}

fn outside(path: &str, found: String) -> Fault {
    Fault::invalid(
        path,
        found,
        "a file in the document's folder or below; --allow-outside lets `..` and links lead out of it",
    )
}

/// Whether `file`, with all links followed, is outside `base`. A file that does not exist is not.
fn leads_out(file: &Path, base: &Path) -> bool {
    let base = if base.as_os_str().is_empty() {
        Path::new(".")
    } else {
        base
    };
    match (file.canonicalize(), base.canonicalize()) {
        (Ok(file), Ok(base)) => !file.starts_with(base),
        _ => false,
    }
}

/// Whether `uri` begins with a scheme (RFC 3986, §3.1); Windows's `c:` counts as one.
fn has_scheme(uri: &str) -> bool {
    let Some((scheme, _)) = uri.split_once(':') else {
        return false;
    };
    scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
}

/// The bytes of a data URI, given without its scheme.
fn data(rest: &str, path: &str) -> Outcome<Vec<u8>> {
    let Some((head, body)) = rest.split_once(',') else {
        return Err(Fault::invalid(
            path,
            "a data URI without a comma",
            "data:<type>;base64,<data>",
        ));
    };
    let body: Vec<u8> = percent_encoding::percent_decode_str(body).collect();
    if !head
        .split(';')
        .any(|part| part.eq_ignore_ascii_case("base64"))
    {
        return Ok(body);
    }
    let body: Vec<u8> = body
        .into_iter()
        .filter(|b| !b.is_ascii_whitespace())
        .collect();
    match BASE64.decode(&body) {
        Ok(bytes) => Ok(bytes),
        Err(e) => Err(Fault::invalid(
            path,
            format!("broken base64 ({e})"),
            "base64 data",
        )),
    }
}

fn strip_prefix_ignore_case<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let head = text.get(..prefix.len())?;
    head.eq_ignore_ascii_case(prefix)
        .then(|| &text[prefix.len()..])
}
