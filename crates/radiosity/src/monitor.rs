//! Progress reports from, and cancellation of, long work.

/// A step of a bake, for progress displays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading and cleaning the document.
    Ingest,
    /// Creating charts and packing them.
    Atlas,
    /// Building the ray-casting tree.
    Tree,
    /// Computing direct light on elements.
    Direct,
    /// Casting rays between patches.
    Links,
    /// Relaxing the radiosity equation.
    Solve,
    /// A first picture from the solution.
    Picture,
    /// Finding the lumels.
    Lumels,
    /// Gathering light at lumels.
    Gather,
    /// Casting more rays at lumels that need them.
    Refine,
    /// Computing light at vertices.
    Vertices,
    /// Gathering light probes.
    Probes,
    /// Capturing reflections.
    Reflections,
    /// Writing files.
    Write,
}

impl Phase {
    /// A short name.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Ingest => "ingest",
            Phase::Atlas => "atlas",
            Phase::Tree => "tree",
            Phase::Direct => "direct",
            Phase::Links => "links",
            Phase::Solve => "solve",
            Phase::Picture => "picture",
            Phase::Lumels => "lumels",
            Phase::Gather => "gather",
            Phase::Refine => "refine",
            Phase::Vertices => "vertices",
            Phase::Probes => "probes",
            Phase::Reflections => "reflections",
            Phase::Write => "write",
        }
    }
}

/// Observes long work and may stop it. Its methods are called from worker threads, at most a few
/// hundred times per second.
///
/// ```
/// use radiosity::{Monitor, Phase};
///
/// struct Lines;
///
/// impl Monitor for Lines {
///     fn progress(&self, phase: Phase, done: u64, total: u64) {
///         println!("{} {done} of {total}", phase.name());
///     }
/// }
/// ```
pub trait Monitor: Sync {
    /// `done` of `total` units of the phase are finished.
    fn progress(&self, _phase: Phase, _done: u64, _total: u64) {}
    /// The residual of the solve: an upper bound on the share of undistributed light.
    fn residual(&self, _residual: f64) {}
    /// Whether the work should stop; called at least ten times per second.
    fn cancelled(&self) -> bool {
        false
    }
}

/// A monitor that does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Monitor for Silent {}

/// The work was stopped by [`Monitor::cancelled`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;
