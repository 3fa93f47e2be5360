//! Ctrl-C: asks the work to stop, and ends the process one second later at the latest.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use lumel::Monitor;
use lumel::atlas_bake::remove_own_temporaries;

static CANCELLED: AtomicBool = AtomicBool::new(false);
/// Set while files are renamed: a few milliseconds that must not be interrupted.
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

/// Runs `work` while handling Ctrl-C and SIGTERM. If the process has to end by force, its temporary
/// files are removed, and `output` too if it is empty.
pub(crate) fn under_control<T>(output: Option<PathBuf>, work: impl FnOnce() -> T) -> T {
    if let Ok(mut slot) = OUTPUT.lock() {
        *slot = output;
    }
    // If installing fails, the system's default handling remains.
    let _ = ctrlc::set_handler(|| {
        if CANCELLED.swap(true, Ordering::Relaxed) {
            return;
        }
        // Most steps check the flag many times a second. Building the tree and reading a large file
        // do not.
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
            let message = b"\nerror: cancelled; files of earlier bakes are unchanged\n";
            let _ = std::io::Write::write_all(&mut std::io::stderr(), message);
            std::process::exit(75);
        });
    });
    let result = work();
    FINISHED.store(true, Ordering::Relaxed);
    result
}

/// Runs the renames of a commit; a pending Ctrl-C waits for them.
pub(crate) fn committing<T>(work: impl FnOnce() -> T) -> T {
    COMMITTING.store(true, Ordering::Relaxed);
    let result = work();
    COMMITTING.store(false, Ordering::Relaxed);
    result
}

fn remove_temporaries() {
    remove_own_temporaries();
    if let Some(dir) = OUTPUT.lock().ok().and_then(|slot| slot.clone()) {
        // Removes the folder only if it is empty.
        let _ = std::fs::remove_dir(&dir);
    }
}
