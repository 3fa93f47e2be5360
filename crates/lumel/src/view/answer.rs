//! Answers of the viewer's server: from the parts of a request to status, headers and body, without
//! a socket.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Mutex;

use mesh_ingest::open_regular;
use percent_encoding::percent_decode_str;
use serde_json::{Value, json};

use super::Status;
use super::assets::{compressed, media_type, plain};
use super::plane::Planes;
use crate::error::Error;
use crate::folder::BakeFolder;

/// The parts of a request that matter.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Ask<'a> {
    /// `GET`, `HEAD`, …
    pub method: &'a str,
    /// Path and query as received.
    pub target: &'a str,
    /// The header `Host`.
    pub host: Option<&'a str>,
    /// The header `Range`.
    pub range: Option<&'a str>,
    /// Whether the client accepts gzip.
    pub gzip: bool,
}

pub(super) enum Body {
    Bytes(Cow<'static, [u8]>),
    /// The rest of an open file from its current position, and its length in bytes.
    File(File, u64),
}

pub(super) struct Reply {
    pub status: u16,
    pub headers: Vec<(&'static str, String)>,
    pub body: Body,
}

/// Headers of every answer. The page may run only its own scripts and reach only this server.
/// `blob:` is how the glTF loader hands embedded textures to the browser.
const POLICY: [(&str, &str); 4] = [
    (
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    ("X-Content-Type-Options", "nosniff"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    // Files change with every bake, and revalidating is cheap on the same machine.
    ("Cache-Control", "no-cache"),
];

impl Reply {
    fn new(status: u16, kind: &str, body: Body) -> Reply {
        let mut headers: Vec<_> = POLICY.iter().map(|(k, v)| (*k, (*v).to_owned())).collect();
        headers.push(("Content-Type", kind.to_owned()));
        Reply {
            status,
            headers,
            body,
        }
    }

    pub fn text(status: u16, message: impl Into<String>) -> Reply {
        let bytes = Cow::Owned(message.into().into_bytes());
        Reply::new(status, "text/plain; charset=utf-8", Body::Bytes(bytes))
    }

    fn json(value: &Value) -> Reply {
        let bytes = Cow::Owned(value.to_string().into_bytes());
        Reply::new(200, "application/json", Body::Bytes(bytes))
    }

    fn not_found(what: &str) -> Reply {
        Reply::text(404, format!("not found: {what}\n"))
    }

    fn with(mut self, name: &'static str, value: impl Into<String>) -> Reply {
        self.headers.push((name, value.into()));
        self
    }
}

/// Answers requests about one folder.
pub(super) struct Answers {
    pub folder: BakeFolder,
    pub planes: Planes,
    /// Status of the program that bakes into the folder.
    pub status: Mutex<Option<Status>>,
}

impl Answers {
    /// Answers `ask`. Errors become answers too.
    pub fn answer(&self, ask: &Ask<'_>) -> Reply {
        // A page of another site can point its own host name at this machine (DNS rebinding) and
        // read the answers. It cannot forge the `Host` header.
        if !ask.host.is_some_and(is_local) {
            return Reply::text(
                403,
                "refused: this server only answers to 127.0.0.1 and localhost\n",
            );
        }
        if !matches!(ask.method, "GET" | "HEAD") {
            return Reply::text(405, "refused: only GET and HEAD\n").with("Allow", "GET, HEAD");
        }
        let (path, query) = ask.target.split_once('?').unwrap_or((ask.target, ""));
        let path = percent_decode_str(path).decode_utf8_lossy();
        let query = Query(query);
        let outcome = match &*path {
            "/" => Ok(own("index.html", ask.gzip)),
            "/api/bakes" => Ok(self.bakes()),
            "/api/report" => self.about(&query, BakeFolder::report),
            "/api/manifest" => self.about(&query, |f, bake| {
                // Parsed before it is served, so that the page need not validate it.
                f.manifest(bake)?;
                f.json(&format!("{bake}.lightmap.json"))
            }),
            "/api/plane" => self.plane(&query),
            path => {
                if let Some(name) = path.strip_prefix("/static/") {
                    Ok(own(name, ask.gzip))
                } else if let Some(name) = path.strip_prefix("/files/") {
                    Ok(self.file(name, ask.range))
                } else {
                    Ok(Reply::not_found(path))
                }
            }
        };
        // The page shows the message, which is the one that the command line prints.
        outcome.unwrap_or_else(|e| Reply::text(500, e.to_string()))
    }

    /// The bakes in the folder, each with a stamp that changes when one of its files does, and the
    /// status of the program that bakes.
    fn bakes(&self) -> Reply {
        let bakes: Vec<Value> = (self.folder.bakes().iter())
            .map(|name| json!({"name": name, "stamp": self.stamp(name)}))
            .collect();
        let status = self.status.lock().map_or(None, |s| s.clone());
        let generator = concat!("lumel ", env!("CARGO_PKG_VERSION"));
        Reply::json(&json!({"generator": generator, "bakes": bakes, "status": status}))
    }

    fn stamp(&self, bake: &str) -> String {
        let mut names = vec![
            format!("{bake}.lightmap.json"),
            format!("{bake}.report.json"),
        ];
        if let Ok(m) = self.folder.manifest(bake) {
            names.push(m.scene);
            names.extend(m.pages.into_iter().map(|p| p.uri));
            names.extend(m.groups.into_iter().flat_map(|g| g.pages));
        }
        let newest = (names.iter())
            .filter_map(|n| {
                std::fs::metadata(self.folder.file(n)?)
                    .ok()?
                    .modified()
                    .ok()
            })
            .filter_map(|t| t.duration_since(std::time::UNIX_EPOCH).ok())
            .max();
        format!("{}", newest.map_or(0, |t| t.as_nanos()))
    }

    fn about(
        &self,
        query: &Query<'_>,
        read: impl Fn(&BakeFolder, &str) -> Result<Value, Error>,
    ) -> Result<Reply, Error> {
        match self.bake(query) {
            Some(bake) => Ok(Reply::json(&read(&self.folder, &bake)?)),
            None => Ok(Reply::not_found("no such bake")),
        }
    }

    /// The bake that a query names, if the folder contains it.
    fn bake(&self, query: &Query<'_>) -> Option<String> {
        let bake = query.get("bake")?;
        self.folder.bakes().contains(&bake).then_some(bake)
    }

    /// A layer of a page of the lightmap or of a group.
    fn plane(&self, query: &Query<'_>) -> Result<Reply, Error> {
        let Some(bake) = self.bake(query) else {
            return Ok(Reply::not_found("no such bake"));
        };
        let manifest = self.folder.manifest(&bake)?;
        let page: Option<usize> = query.get("page").and_then(|p| p.parse().ok());
        let uri = match query.get("group") {
            None => page.and_then(|p| Some(manifest.pages.get(p)?.uri.clone())),
            Some(name) => (manifest.groups.iter())
                .find(|g| g.name == name)
                .and_then(|g| g.pages.get(page?).cloned()),
        };
        let Some(uri) = uri else {
            return Ok(Reply::not_found("no such page or group"));
        };
        let path = self.folder.expect_file(&uri)?;
        let layer = query.get("layer").unwrap_or_default();
        Ok(match self.planes.read(&path, &layer)? {
            Some(plane) => Reply::new(
                200,
                "application/octet-stream",
                Body::Bytes(plane.bytes.into()),
            )
            .with("X-Width", plane.width.to_string())
            .with("X-Height", plane.height.to_string()),
            None => Reply::not_found(&format!("{uri} has no layer {layer:?}")),
        })
    }

    /// A file of the folder, or a range of it.
    fn file(&self, name: &str, range: Option<&str>) -> Reply {
        match self.folder.file(name) {
            Some(path) => send(&path, name, range)
                .unwrap_or_else(|e| Reply::text(500, format!("{name}: {e}"))),
            None => Reply::not_found(name),
        }
    }
}

/// One of the viewer's own files.
fn own(name: &str, gzip: bool) -> Reply {
    let Some(packed) = compressed(name) else {
        return Reply::not_found(name);
    };
    let kind = media_type(name);
    if gzip {
        Reply::new(200, kind, Body::Bytes(packed.into()))
            .with("Content-Encoding", "gzip")
            .with("Vary", "Accept-Encoding")
    } else {
        Reply::new(200, kind, Body::Bytes(plain(packed).into())).with("Vary", "Accept-Encoding")
    }
}

fn send(path: &Path, name: &str, range: Option<&str>) -> std::io::Result<Reply> {
    let mut file = open_regular(path)?;
    let size = file.metadata()?.len();
    let reply = |status, file, length| {
        Reply::new(status, media_type(name), Body::File(file, length))
            .with("Accept-Ranges", "bytes")
    };
    Ok(match range.and_then(|r| parse_range(r, size)) {
        None => reply(200, file, size),
        Some(Ok((first, last))) => {
            file.seek(SeekFrom::Start(first))?;
            reply(206, file, last - first + 1)
                .with("Content-Range", format!("bytes {first}-{last}/{size}"))
        }
        Some(Err(())) => Reply::text(416, "the range is beyond the file\n")
            .with("Content-Range", format!("bytes */{size}")),
    })
}

/// Parses one byte range (first and last) of a file of `size` bytes (RFC 9110 §14.1.2). `None` for
/// headers that a server may ignore: other units, several ranges, malformed ones. `Err` for a range
/// beyond the file.
fn parse_range(header: &str, size: u64) -> Option<Result<(u64, u64), ()>> {
    let (first, last) = header.strip_prefix("bytes=")?.split_once('-')?;
    let number = |s: &str| s.trim().parse::<u64>().ok();
    if first.trim().is_empty() {
        // A suffix range: the last n bytes.
        let n = number(last)?;
        return Some(if n == 0 || size == 0 {
            Err(())
        } else {
            Ok((size.saturating_sub(n), size - 1))
        });
    }
    let first = number(first)?;
    let last = match last.trim() {
        "" => u64::MAX,
        text => number(text)?,
    };
    if last < first {
        return None;
    }
    Some(if first >= size {
        Err(())
    } else {
        Ok((first, last.min(size - 1)))
    })
}

/// Whether a `Host` is a loopback name. Any port is accepted, because tunnels change it.
fn is_local(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    name == "127.0.0.1" || name == "[::1]" || name.eq_ignore_ascii_case("localhost")
}

/// A query string.
struct Query<'a>(&'a str);

impl Query<'_> {
    fn get(&self, key: &str) -> Option<String> {
        let pairs = self.0.split('&').filter_map(|p| p.split_once('='));
        let value = pairs.filter(|(k, _)| *k == key).map(|(_, v)| v).next()?;
        // URLSearchParams writes a space as + and a plus as %2B.
        let value = value.replace('+', " ");
        Some(percent_decode_str(&value).decode_utf8_lossy().into_owned())
    }
}

impl Body {
    /// The reader and its length in bytes.
    pub fn open(self) -> (Box<dyn Read + Send>, u64) {
        match self {
            Body::Bytes(b) => {
                let n = b.len() as u64;
                (Box::new(std::io::Cursor::new(b)), n)
            }
            Body::File(file, length) => (Box::new(file.take(length)), length),
        }
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
