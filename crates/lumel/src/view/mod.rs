//! `lumel view`: a local page that shows a finished bake.
//!
//! The server listens on 127.0.0.1, reads only the files of one folder and its own, and changes
//! nothing. The page (`web/`) draws with three.js, which is vendored unchanged in `vendor/three`.

mod answer;
mod assets;
mod http;
mod plane;

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;

use crate::error::Error;
use crate::folder::BakeFolder;
use answer::Answers;
use plane::Planes;

/// Status of the program that bakes into the folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Status {
    /// One line or a few.
    pub text: String,
    /// Whether the text is an error.
    pub fault: bool,
}

/// A server that shows the bakes of a folder.
///
/// ```no_run
/// let viewer = lumel::view::Viewer::bind("out".as_ref(), 0)?;
/// println!("{}", viewer.url());
/// viewer.serve();
/// # Ok::<(), lumel::Error>(())
/// ```
pub struct Viewer {
    listener: TcpListener,
    answers: Arc<Answers>,
    address: SocketAddr,
    stopping: AtomicBool,
}

impl Viewer {
    /// Opens `path` (a folder written by `lumel bake`, or one bake's `*.lightmap.json`) and binds
    /// `port` of 127.0.0.1 (0 for any free port). Requests wait until [`serve`](Viewer::serve).
    ///
    /// # Errors
    /// [`Error::Folder`] if there is no bake, [`Error::Port`] if the port is not available.
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
                status: Mutex::default(),
            }),
            address,
            stopping: AtomicBool::new(false),
        })
    }

    /// The address of the page.
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

    /// Sets the status that the page shows.
    pub fn set_status(&self, status: Option<Status>) {
        // A thread that panicked while holding the lock cannot have left half a status.
        let mut now = (self.answers.status.lock()).unwrap_or_else(PoisonError::into_inner);
        *now = status;
    }

    /// Answers requests until [`stop`](Viewer::stop), each connection on its own thread.
    pub fn serve(&self) {
        http::serve(&self.listener, &self.answers, &self.stopping);
    }

    /// Makes [`serve`](Viewer::serve) return; call it from another thread. Answers in progress are
    /// completed.
    pub fn stop(&self) {
        self.stopping.store(true, Ordering::SeqCst);
        // Wakes up the thread that waits for a connection.
        let _ = TcpStream::connect(self.address);
    }
}
