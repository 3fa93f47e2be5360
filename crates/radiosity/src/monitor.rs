//! How long work says where it is, and learns that it should stop.

/// A step of a bake, for progress displays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading and cleaning the document.
    Ingest,
    /// Charts and packing.
    Atlas,
    /// Building the ray-casting tree.
    Tree,
    /// Direct light on elements.
    Direct,
    /// Rays between patches.
    Links,
    /// Relaxation of the radiosity equation.
    Solve,
    /// A first picture from the solution.
    Picture,
    /// Finding the lumels.
    Lumels,
    /// Light at lumels.
    Gather,
    /// More rays at lumels that need them.
    Refine,
    /// Light at vertices.
    Vertices,
    /// Light probes.
    Probes,
    /// Writing files.
    Write,
}

impl Phase {
    /// A word for it.
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
            Phase::Write => "write",
        }
    }
}

/// Watches long work and may stop it. Called from worker threads, some hundred times a second at
/// most.
pub trait Monitor: Sync {
    /// `done` of `total` units of the phase are finished.
    fn progress(&self, _phase: Phase, _done: u64, _total: u64) {}
    /// The solve's residual: an upper bound on the share of the light that is still to be
    /// distributed.
    fn residual(&self, _residual: f64) {}
    /// True once the work should stop; asked at least ten times a second.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Monitor for Silent {}

/// The work was stopped through [`Monitor::cancelled`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;
