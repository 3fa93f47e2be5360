//! A simple web server on a free local port.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// The folder of `npm install` for engines that are not vendored: `LUMEL_NPM`, or where
/// tools/setup.sh puts it.
pub fn npm_modules() -> PathBuf {
    let folder = std::env::var_os("LUMEL_NPM").unwrap_or_else(|| "/opt/lumel-npm".into());
    PathBuf::from(folder).join("node_modules")
}

/// Serves the loaders, three.js, engines from npm, and a bake. It ends with the test process.
pub struct Site {
    pub url: String,
}

impl Site {
    pub fn start(bake: &Path) -> Site {
        Site::start_with(bake, None)
    }

    /// Serves one more folder under a path of its own.
    pub fn start_with(bake: &Path, more: Option<(&str, &Path)>) -> Site {
        let own = Path::new(env!("CARGO_MANIFEST_DIR"));
        let three = "/engines/node_modules/three";
        let modules = npm_modules();
        let mut folders = vec![
            (format!("{three}/build/"), own.join("vendor/three/build")),
            (
                format!("{three}/examples/jsm/"),
                own.join("vendor/three/addons"),
            ),
            ("/engines/".into(), own.join("../../tools/engines/three")),
            ("/three/".into(), own.join("../../tools/engines/three")),
            ("/playcanvas/node_modules/".into(), modules.clone()),
            ("/babylon/node_modules/".into(), modules),
            (
                "/playcanvas/".into(),
                own.join("../../tools/engines/playcanvas"),
            ),
            ("/babylon/".into(), own.join("../../tools/engines/babylon")),
            ("/bake/".into(), bake.to_owned()),
        ];
        folders.extend(more.map(|(at, folder)| (at.to_owned(), folder.to_owned())));
        let folders: Arc<[(String, PathBuf)]> = folders.into();
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let url = format!("http://{}", listener.local_addr().expect("an address"));
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let folders = folders.clone();
                // Browsers open connections in advance, so each gets its own thread.
                std::thread::spawn(move || respond(&stream, &folders));
            }
        });
        Site { url }
    }
}

/// Answers one request after reading its head.
fn respond(mut stream: &TcpStream, folders: &[(String, PathBuf)]) -> std::io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_secs(60)))?;
    let mut lines = BufReader::new(stream).lines();
    let first = lines.next().transpose()?.unwrap_or_default();
    while lines.next().transpose()?.is_some_and(|l| !l.is_empty()) {}
    let target = first.split([' ', '?']).nth(1).unwrap_or_default();
    let path = percent_encoding::percent_decode_str(target).decode_utf8_lossy();
    let found = folders.iter().find_map(|(prefix, dir)| {
        let file = dir.join(path.strip_prefix(prefix.as_str())?);
        Some((std::fs::read(&file).ok()?, file))
    });
    let (status, bytes, file) = match found {
        Some((bytes, file)) => ("200 OK", bytes, file),
        None => ("404 Not Found", Vec::new(), PathBuf::new()),
    };
    let kind = match file.extension().and_then(|e| e.to_str()) {
        Some("js" | "mjs") => "text/javascript",
        Some("html") => "text/html; charset=utf-8",
        Some("json") => "application/json",
        _ => "application/octet-stream",
    };
    let length = bytes.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )?;
    stream.write_all(&bytes)
}
