//! Progress by closure, and cancellation from elsewhere.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};

use radiosity::{Monitor, Phase};

/// Progress of a bake.
///
/// ```
/// let baker = lumel::Baker::new().on_progress(|p| {
///     if let Some(share) = p.share() {
///         println!("{}: {:.0} %", p.phase.name(), 100.0 * share);
///     }
/// });
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Progress {
    /// The current phase. Phases come in the order of [`Phase`]; those that a bake does not need
    /// are skipped.
    pub phase: Phase,
    /// Finished units of the phase. The unit differs from phase to phase.
    pub done: u64,
    /// Total units of the phase; 0 if it just began, or is too short to count.
    pub total: u64,
    /// During the solve, an upper bound on the fraction of the light that is not distributed yet.
    pub residual: Option<f64>,
}

impl Progress {
    /// Fraction of the phase that is done, 0..=1; `None` if it is not counted.
    ///
    /// Some phases have several passes, each counted from 0. Phases take very different times: the
    /// gather takes most of nearly every bake.
    pub fn share(&self) -> Option<f64> {
        (self.total > 0).then(|| (self.done as f64 / self.total as f64).min(1.0))
    }
}

/// Cancels the bakes that it was given to, from any thread. Clones are the same token.
///
/// A cancelled bake returns [`Error::Cancelled`](crate::Error::Cancelled) within a fraction of a
/// second and writes nothing.
///
/// ```
/// use lumel::{Baker, CancelToken, Error};
///
/// let token = CancelToken::new();
/// token.cancel();
/// let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");
/// let outcome = Baker::new().cancel_token(&token).bake(scene);
/// assert!(matches!(outcome, Err(Error::Cancelled)));
/// ```
#[derive(Debug, Clone, Default)]
pub struct CancelToken(Arc<AtomicBool>);

impl CancelToken {
    /// A token that has not been cancelled.
    pub fn new() -> CancelToken {
        CancelToken::default()
    }

    /// Cancels every bake that has this token, now and later.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`cancel`](Self::cancel) was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A closure that receives progress.
pub(crate) type Watcher<'a> = Mutex<Box<dyn FnMut(Progress) + Send + 'a>>;

/// A closure and a token as a monitor.
pub(crate) struct Watch<'b, 'a> {
    pub watcher: Option<&'b Watcher<'a>>,
    pub token: Option<&'b CancelToken>,
}

impl Watch<'_, '_> {
    fn tell(&self, progress: Progress) {
        if let Some(watcher) = self.watcher {
            // A closure that panicked may be called again: it is the caller's, and the panic
            // continues anyway.
            let mut watcher = watcher.lock().unwrap_or_else(PoisonError::into_inner);
            watcher(progress);
        }
    }
}

impl Monitor for Watch<'_, '_> {
    fn progress(&self, phase: Phase, done: u64, total: u64) {
        self.tell(Progress {
            phase,
            done,
            total,
            residual: None,
        });
    }

    fn residual(&self, residual: f64) {
        self.tell(Progress {
            phase: Phase::Solve,
            done: 0,
            total: 0,
            residual: Some(residual),
        });
    }

    fn cancelled(&self) -> bool {
        self.token.is_some_and(CancelToken::is_cancelled)
    }
}
