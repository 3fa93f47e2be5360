//! `lumel view`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use lumel::view::Viewer;

use super::Failure;

/// Options of `lumel view`.
#[derive(Debug, Args)]
pub(crate) struct View {
    /// A folder written by `lumel bake`, or the .lightmap.json of one bake in it
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    #[command(flatten)]
    pub serve: Serve,
}

/// Options of the page.
#[derive(Debug, Args)]
pub(crate) struct Serve {
    /// Port on 127.0.0.1 [default: any free port]
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub port: u16,
    /// Open the page in the browser
    #[arg(long)]
    pub open: bool,
}

impl Serve {
    /// Prints where the page is, and opens it if requested.
    pub(crate) fn start(&self, bakes: &Path) -> Result<Viewer, Failure> {
        let viewer = Viewer::bind(bakes, self.port)?;
        let url = viewer.url();
        // Scripts read the address from standard output.
        let mut out = std::io::stdout().lock();
        writeln!(out, "{url}")?;
        out.flush()?;
        drop(out);
        if self.open
            && let Err(e) = open::that_detached(&url)
        {
            let _ = writeln!(
                std::io::stderr(),
                "could not start a browser ({e}): open the address above"
            );
        }
        Ok(viewer)
    }
}

/// Serves until Ctrl-C.
pub(crate) fn run(a: &View) -> Result<(), Failure> {
    let viewer = a.serve.start(&a.folder)?;
    let _ = writeln!(
        std::io::stderr(),
        "showing {} ({}); press Ctrl-C to stop",
        a.folder.display(),
        viewer.bakes().join(", ")
    );
    super::warn_of_strangers(viewer.folder());
    // Ctrl-C is the normal way to end the viewer, so it exits with success. If the handler cannot
    // be installed, the system's default ends the program too.
    let _ = ctrlc::set_handler(|| std::process::exit(0));
    viewer.serve();
    Ok(())
}
