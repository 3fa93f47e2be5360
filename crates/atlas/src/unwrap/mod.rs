//! Unwrapping: turns a surface in space into flat charts, packed into one rectangle of texels per
//! mesh.
//!
//! [`Unwrapper`] is the interface, implemented by [`Unroll`], [`Xatlas`] and [`BoxProjection`].
//! [`unwrap_with_fallback`] tries one after the other, so that a mesh always gets charts.

mod boxes;
mod charts;
mod finish;
mod guard;
mod input;
mod join;
mod joints;
pub(crate) mod kept;
mod mask;
mod measure;
mod pack_charts;
mod place;
mod rigid;
mod segment;
mod split;
mod unroll;
mod unwrapper;
mod weld;
mod xatlas;

use std::sync::Arc;

use serde::Serialize;

pub use boxes::BoxProjection;
pub use input::UnwrapInput;
pub use kept::KeptCharts;
pub(crate) use measure::weighted_median;
pub use measure::{ChartMeasure, measure};
pub use unroll::Unroll;
use unwrapper::check;
pub use unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};
pub use xatlas::Xatlas;

/// Choice of the unwrapper.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UnwrapperChoice {
    /// The one with the best measurements: `Unroll`.
    #[default]
    Auto,
    /// Groups of faces within a cone, flattened as rigidly as possible.
    Unroll,
    /// The `xatlas-rs` crate (xatlas of 2019), with charts packed by Lumel; falls back to others if
    /// it fails.
    Xatlas,
    /// Lumel's own projection along the axes: many charts, but it never fails on valid input.
    Box,
}

impl UnwrapperChoice {
    /// The unwrappers to try, in order.
    pub fn candidates(self) -> Vec<&'static dyn Unwrapper> {
        match self {
            UnwrapperChoice::Auto | UnwrapperChoice::Unroll => vec![&Unroll, &BoxProjection],
            UnwrapperChoice::Xatlas => vec![&Xatlas, &Unroll, &BoxProjection],
            UnwrapperChoice::Box => vec![&BoxProjection],
        }
    }
}

/// Tries `unwrappers` in order. Returns the result, the name of the unwrapper that made it, and why
/// each earlier one failed.
///
/// All but the last run under a guard: one that panics is abandoned. Each refuses meshes that are
/// too large for it by counting, so the result does not depend on the machine.
///
/// # Errors
/// The last one's error if none succeeds; [`UnwrapError::Cancelled`] at once.
pub fn unwrap_with_fallback(
    unwrappers: &[&'static dyn Unwrapper],
    mesh: &Arc<UnwrapInput>,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
) -> Result<(UnwrappedMesh, &'static str, Vec<String>), UnwrapError> {
    let mut failures = Vec::new();
    let mut last = UnwrapError::Failed("no unwrapper".into());
    for (number, &unwrapper) in unwrappers.iter().enumerate() {
        let result = if number + 1 == unwrappers.len() {
            unwrapper.unwrap(mesh, options, cancel)
        } else {
            guard::run(unwrapper, mesh, options, cancel)
        };
        match result.and_then(|result| check(mesh, options, result)) {
            Ok(result) => return Ok((result, unwrapper.name(), failures)),
            Err(UnwrapError::Cancelled) => return Err(UnwrapError::Cancelled),
            Err(error) => {
                failures.push(format!("{}: {error}", unwrapper.name()));
                last = error;
            }
        }
    }
    Err(last)
}
