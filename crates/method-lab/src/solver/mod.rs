//! Iterative solvers of the discrete radiosity equation B_i = M_i + ρ_i Σ_j F_ij B_j, by colour
//! channel.
//!
//! All start from the light sources, count their work in multiply-adds, and stop when the
//! undistributed flux is at most a fraction `tolerance` of the emitted flux, or report why not
//! ([`Stop`]). They run on one thread and sum in index order: the same input gives the same bits.
//!
//! Based on: Goral, Torrance, Greenberg, Battaile, *Modeling the interaction of light between
//! diffuse surfaces*, 1984 (the equation); Cohen, Chen, Wallace, Greenberg, *A progressive
//! refinement approach to fast radiosity image generation*, 1988 (shooting, ambient term); Gortler,
//! Cohen, Slusallek, *Radiosity and relaxation methods*, 1994 (classification of the relaxations).

mod ambient;
mod balance;
mod gather;
mod shoot;
mod system;

use glam::DVec3;

pub use ambient::{ambient, with_ambient};
pub use balance::{Closed, close};
pub use system::{System, SystemError};

/// Which solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Method {
    /// Every patch gathers from the last iterate. One iteration is one bounce of light.
    Jacobi,
    /// Every patch gathers from the newest values.
    GaussSeidel,
    /// The patch with the largest residual |r_i|, W/m², is relaxed. Needs columns of F, i.e. a
    /// transposed copy.
    Southwell,
    /// The patch with the largest unshot flux A_i ΔB_i shoots it, and unshot light counts as
    /// radiosity. Needs one row of F at a time, because A_i F_ij = A_j F_ji gives the column.
    Progressive,
}

impl Method {
    /// All methods, in teaching order.
    pub const ALL: [Method; 4] = [
        Method::Jacobi,
        Method::GaussSeidel,
        Method::Southwell,
        Method::Progressive,
    ];

    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Method::Jacobi => "Jacobi",
            Method::GaussSeidel => "Gauss-Seidel",
            Method::Southwell => "Southwell",
            Method::Progressive => "progressive",
        }
    }
}

/// Stopping criteria.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Largest fraction of the emitted flux that may remain undistributed, in any channel: Σ
    /// A_i|r_i| ≤ tolerance · Σ A_i M_i.
    pub tolerance: f64,
    /// Most passes over all patches; n shots count as one pass.
    pub max_passes: u32,
    /// Shots per entry of the history; 0 means n.
    pub shots_per_record: u32,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            tolerance: 1e-8,
            max_passes: 100_000,
            shots_per_record: 0,
        }
    }
}

/// Why a solver stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The rest is within the tolerance.
    Converged,
    /// `max_passes` did not suffice.
    Passes,
    /// Shooting no longer reduces the residual when it is recomputed from the matrix, because of
    /// rounding or rows that are not reciprocal.
    Stalled,
    /// The residual overflowed.
    Diverged,
}

/// State after an iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Passes (Jacobi, Gauss–Seidel) or shots so far.
    pub iteration: u64,
    /// Multiply-adds so far, all three channels.
    pub work: u64,
    /// ‖r‖∞ by channel, W/m². r = M + ρFB − B of the radiosity; with [`Method::Progressive`] the
    /// unshot radiosity ΔB (see `error_bound`).
    pub residual_max: DVec3,
    /// Σ A_i|r_i| by channel, W.
    pub residual_flux: DVec3,
    /// `residual_flux` relative to the emitted flux of the largest channel, which is compared with
    /// the tolerance.
    pub left: f64,
    /// Bound on ‖B − B*‖∞ by channel, W/m²: ‖r‖∞ / (1 − max_i ρ_i Σ_j F_ij), because B* − B = (I −
    /// ρF)⁻¹ r. Infinite, i.e. no bound, if the denominator is not positive. For the progressive
    /// solver, whose radiosity B includes ΔB, B* − B = (I − ρF)⁻¹ ρF ΔB, for which the same bound
    /// holds.
    pub error_bound: DVec3,
}

/// State passed to an observer after every pass or shot.
#[derive(Debug, Clone, Copy)]
pub struct Snapshot<'a> {
    /// Passes or shots so far.
    pub iteration: u64,
    /// B by patch, W/m².
    pub radiosity: &'a [DVec3],
    /// r by patch, W/m²; with [`Method::Progressive`] the unshot ΔB.
    pub residual: &'a [DVec3],
}

/// Result of a solver.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// B by patch, W/m²; usable whatever the reason for stopping.
    pub radiosity: Vec<DVec3>,
    /// r of `radiosity`, or ΔB with [`Method::Progressive`], W/m².
    pub residual: Vec<DVec3>,
    /// One entry per pass, or every `shots_per_record` shots; the last entry belongs to
    /// `radiosity`.
    pub history: Vec<Record>,
    /// Bytes used by the solver in addition to F, M, ρ and A.
    pub memory: usize,
    /// Why it stopped.
    pub stop: Stop,
}

impl Solution {
    /// Whether the tolerance was reached.
    pub fn converged(&self) -> bool {
        self.stop == Stop::Converged
    }

    /// The last entry of the history.
    pub fn last(&self) -> Record {
        // A solver records before it returns, so the fallback is never used.
        self.history.last().copied().unwrap_or(Record {
            iteration: 0,
            work: 0,
            residual_max: DVec3::INFINITY,
            residual_flux: DVec3::INFINITY,
            left: f64::INFINITY,
            error_bound: DVec3::INFINITY,
        })
    }
}

/// Solves `system` by `method`.
///
/// # Errors
/// [`SystemError::Tolerance`] if the tolerance is negative or not a number.
pub fn solve(
    method: Method,
    system: &System<'_>,
    options: &Options,
) -> Result<Solution, SystemError> {
    run(method, system, options, None)
}

/// As [`solve`], but passes every pass or shot to `observe`. A snapshot costs the shooting solvers
/// n additions per shot, which are not counted as work.
///
/// # Errors
/// As [`solve`].
pub fn solve_observed(
    method: Method,
    system: &System<'_>,
    options: &Options,
    observe: &mut dyn FnMut(Snapshot<'_>),
) -> Result<Solution, SystemError> {
    run(method, system, options, Some(observe))
}

type Observer<'o> = Option<&'o mut dyn FnMut(Snapshot<'_>)>;

fn run(
    method: Method,
    system: &System<'_>,
    options: &Options,
    observe: Observer<'_>,
) -> Result<Solution, SystemError> {
    if options.tolerance.is_nan() || options.tolerance < 0.0 {
        return Err(SystemError::Tolerance(options.tolerance));
    }
    Ok(match method {
        Method::Jacobi => gather::gather::<false>(system, options, observe),
        Method::GaussSeidel => gather::gather::<true>(system, options, observe),
        Method::Southwell => shoot::shoot::<false>(system, options, observe),
        Method::Progressive => shoot::shoot::<true>(system, options, observe),
    })
}
