//! `lumel view`: a page on this machine that shows a finished bake.
//!
//! The server answers on 127.0.0.1 alone, reads nothing but the files of one folder and its own,
//! and changes nothing. The page (`web/`) draws with three.js, whose files lie in `vendor/three` as
//! npm has them.

mod answer;
mod assets;
mod http;
mod plane;

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::Error;
use crate::folder::BakeFolder;
use answer::Answers;
use plane::Planes;

/// A server that shows the bakes of a folder.
pub struct Viewer {
    listener: TcpListener,
    answers: Arc<Answers>,
    address: SocketAddr,
    stopping: AtomicBool,
}

impl Viewer {
    /// Opens `path`, a folder that `lumel bake` wrote or one bake's `*.lightmap.json`, and binds
    /// `port` of 127.0.0.1 (0 for any that is free). Requests wait until [`serve`](Viewer::serve).
    ///
    /// # Errors
    /// [`Error::Folder`] where there is no bake, [`Error::Port`] where the port cannot be had.
    pub fn bind(path: &Path, port: u16) -> Result<Viewer, Error> {
        let folder = BakeFolder::open(path)?;
        let failed = |e: std::io::Error| Error::Port {
            port,
            message: e.to_string(),
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        Ok(Viewer {
            listener,
            answers: Arc::new(Answers {
                folder,
                planes: Planes::default(),
            }),
            address,
            stopping: AtomicBool::new(false),
        })
    }

    /// Where the page is.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// The folder that is shown.
    pub fn folder(&self) -> &BakeFolder {
        &self.answers.folder
    }

    /// Names of the bakes in the folder.
    pub fn bakes(&self) -> Vec<String> {
        self.answers.folder.bakes()
    }

    /// Answers requests until [`stop`](Viewer::stop), each connection on a thread of its own.
    pub fn serve(&self) {
        http::serve(&self.listener, &self.answers, &self.stopping);
    }

    /// Ends [`serve`](Viewer::serve), from another thread. Answers that are on their way are still
    /// sent.
    pub fn stop(&self) {
        self.stopping.store(true, Ordering::SeqCst);
        // Whoever waits for a connection gets one.
        let _ = TcpStream::connect(self.address);
    }
}
