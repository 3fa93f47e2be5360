//! `lumel view`: a page on this machine that shows a finished bake.
//!
//! The server answers on 127.0.0.1 alone, reads nothing but the files of one folder and its own, and changes nothing. The page
//! (`web/`) draws with three.js, whose files lie in `vendor/three` as npm has them.

mod answer;
mod assets;
mod plane;

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;

use tiny_http::{Header, Request, Response, Server, StatusCode};

use crate::error::Error;
use crate::folder::BakeFolder;
use answer::{Answers, Ask, Reply};
use plane::Planes;

/// Requests answered at once: browsers open up to six connections.
const WORKERS: usize = 6;

/// A server that shows the bakes of a folder.
pub struct Viewer {
    server: Arc<Server>,
    answers: Arc<Answers>,
    port: u16,
}

impl Viewer {
    /// Opens `path`, a folder that `lumel bake` wrote or one bake's `*.lightmap.json`, and binds `port` of 127.0.0.1 (0 for any that is
    /// free). Requests wait until [`serve`](Viewer::serve).
    ///
    /// # Errors
    /// [`Error::Folder`] where there is no bake, [`Error::Port`] where the port cannot be had.
    pub fn bind(path: &Path, port: u16) -> Result<Viewer, Error> {
        let folder = BakeFolder::open(path)?;
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let server = Server::http(address).map_err(|e| Error::Port {
            port,
            message: e.to_string(),
        })?;
        let port = server.server_addr().to_ip().map_or(port, |a| a.port());
        Ok(Viewer {
            server: Arc::new(server),
            answers: Arc::new(Answers {
                folder,
                planes: Planes::default(),
            }),
            port,
        })
    }

    /// Where the page is.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Names of the bakes in the folder.
    pub fn bakes(&self) -> Vec<String> {
        self.answers.folder.bakes()
    }

    /// Answers requests until [`stop`](Viewer::stop).
    pub fn serve(&self) {
        std::thread::scope(|scope| {
            for _ in 0..WORKERS {
                scope.spawn(|| {
                    while let Ok(request) = self.server.recv() {
                        // A client that went away is no failure of ours.
                        let _ = respond(&self.answers, request);
                    }
                });
            }
        });
    }

    /// Ends [`serve`](Viewer::serve), from another thread.
    pub fn stop(&self) {
        for _ in 0..WORKERS {
            self.server.unblock();
        }
    }
}

fn respond(answers: &Answers, request: Request) -> io::Result<()> {
    let header = |name: &'static str| {
        let found = request.headers().iter().find(|h| h.field.equiv(name));
        found.map(|h| h.value.as_str().to_owned())
    };
    let (host, range, encoding) = (header("Host"), header("Range"), header("Accept-Encoding"));
    let method = request.method().to_string();
    let reply = answers.answer(&Ask {
        method: &method,
        target: request.url(),
        host: host.as_deref(),
        range: range.as_deref(),
        gzip: encoding.is_some_and(|e| e.contains("gzip")),
    });
    let Reply {
        status,
        headers,
        body,
    } = reply;
    let headers = headers
        .iter()
        .filter_map(|(k, v)| Header::from_bytes(*k, v.as_bytes()).ok())
        .collect();
    let (reader, length) = body.open();
    // Lengths are known, and clients show progress by them.
    let response = Response::new(
        StatusCode(status),
        headers,
        reader,
        usize::try_from(length).ok(),
        None,
    )
    .with_chunked_threshold(usize::MAX);
    request.respond(response)
}
