//! Progress by closure, and stopping from elsewhere.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};

use radiosity::{Monitor, Phase};

/// Where a bake is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Progress {
    /// What is being done. Phases come in the order of [`Phase`]; those that a bake does not need
    /// are not seen.
    pub phase: Phase,
    /// Units of the phase that are finished. What a unit is differs from phase to phase.
    pub done: u64,
    /// Units of the phase in all; 0 where it just begins, or is too short to count.
    pub total: u64,
    /// While solving, an upper bound on the share of the light that is still to be distributed.
    pub residual: Option<f64>,
}

impl Progress {
    /// Share of the phase that is done, 0..=1; `None` where it is not counted.
    ///
    /// Some phases work in several passes and count each of them from 0. Phases take very different
    /// times: the gather is most of nearly every bake.
    pub fn share(&self) -> Option<f64> {
        (self.total > 0).then(|| (self.done as f64 / self.total as f64).min(1.0))
    }
}

/// Stops bakes that were given it, from any thread. Clones are one and the same token.
///
/// A bake that is stopped returns [`Error::Cancelled`](crate::Error::Cancelled) within a fraction
/// of a second and writes nothing.
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
    /// A token that has stopped nothing yet.
    pub fn new() -> CancelToken {
        CancelToken::default()
    }

    /// Stops every bake that has this token, now and later.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`cancel`](Self::cancel) was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A closure that is told about progress.
pub(crate) type Watcher<'a> = Mutex<Box<dyn FnMut(Progress) + Send + 'a>>;

/// A closure and a token as a monitor.
pub(crate) struct Watch<'b, 'a> {
    pub watcher: Option<&'b Watcher<'a>>,
    pub token: Option<&'b CancelToken>,
}

impl Watch<'_, '_> {
    fn tell(&self, progress: Progress) {
        if let Some(watcher) = self.watcher {
            // A closure that panicked once may be called again: it is the caller's, and the panic
            // goes on anyway.
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
