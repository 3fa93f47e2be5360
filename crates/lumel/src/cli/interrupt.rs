//! Ctrl-C: work is asked to stop, and a second later the process ends, whatever it is doing.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use lumel::Monitor;
use lumel::atlas_bake::remove_own_temporaries;

static CANCELLED: AtomicBool = AtomicBool::new(false);
/// Files are being renamed: milliseconds that should not be cut in two.
static COMMITTING: AtomicBool = AtomicBool::new(false);
static FINISHED: AtomicBool = AtomicBool::new(false);
static OUTPUT: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Whether the user asked to stop.
pub(crate) fn cancelled() -> bool {
    CANCELLED.load(Ordering::Relaxed)
}

/// A monitor that only cancels.
pub(crate) struct Cancel;

impl Monitor for Cancel {
    fn cancelled(&self) -> bool {
        cancelled()
    }
}

/// Runs `work` with Ctrl-C (and SIGTERM) under control. This process's temporaries, and `output`
/// where it is empty, are removed should it have to end by force.
pub(crate) fn under_control<T>(output: Option<PathBuf>, work: impl FnOnce() -> T) -> T {
    if let Ok(mut slot) = OUTPUT.lock() {
        *slot = output;
    }
    // Failure to install only means that the system's own handling stays.
    let _ = ctrlc::set_handler(|| {
        if CANCELLED.swap(true, Ordering::Relaxed) {
            return;
        }
        // Most steps look at the flag many times a second. Building the tree and reading a large
        // file do not.
        std::thread::spawn(|| {
            let asked = Instant::now();
            while asked.elapsed() < Duration::from_millis(800) || COMMITTING.load(Ordering::Relaxed)
            {
                std::thread::sleep(Duration::from_millis(20));
                if FINISHED.load(Ordering::Relaxed) {
                    return;
                }
            }
            remove_temporaries();
            let message = b"\nerror: cancelled; files of earlier bakes are as they were\n";
            let _ = std::io::Write::write_all(&mut std::io::stderr(), message);
            std::process::exit(75);
        });
    });
    let result = work();
    FINISHED.store(true, Ordering::Relaxed);
    result
}

/// Runs the renames of a commit, which a pending Ctrl-C waits for.
pub(crate) fn committing<T>(work: impl FnOnce() -> T) -> T {
    COMMITTING.store(true, Ordering::Relaxed);
    let result = work();
    COMMITTING.store(false, Ordering::Relaxed);
    result
}

fn remove_temporaries() {
    remove_own_temporaries();
    if let Some(dir) = OUTPUT.lock().ok().and_then(|slot| slot.clone()) {
        // Only an empty folder goes.
        let _ = std::fs::remove_dir(&dir);
    }
}
