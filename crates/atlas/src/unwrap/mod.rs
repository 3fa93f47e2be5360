//! Unwrapping: a surface in space becomes flat charts, packed into one rectangle of texels per
//! mesh.
//!
//! [`Unwrapper`] is the one small interface; [`UvUnwrap`] and [`BoxProjection`] implement it.
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
mod split;
mod unwrapper;
mod uvunwrap;
mod weld;
mod xatlas;

use std::sync::Arc;

use serde::Serialize;

pub use boxes::BoxProjection;
pub use input::UnwrapInput;
pub use kept::KeptCharts;
pub(crate) use measure::weighted_median;
pub use measure::{ChartMeasure, measure};
use unwrapper::check;
pub use unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};
pub use uvunwrap::UvUnwrap;
pub use xatlas::Xatlas;

/// Which unwrapper to use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UnwrapperChoice {
    /// The one that measures better (`lab/unwrap.md`): uvunwrap.
    #[default]
    Auto,
    /// The `uvunwrap` crate.
    UvUnwrap,
    /// The `xatlas-rs` crate (xatlas of 2019), its charts packed by `uvunwrap`; falls back where it
    /// fails.
    Xatlas,
    /// Our own projection along the axes: many charts, never fails on sane input.
    Box,
}

impl UnwrapperChoice {
    /// The unwrappers to try, in order.
    pub fn candidates(self) -> Vec<&'static dyn Unwrapper> {
        match self {
            UnwrapperChoice::Auto | UnwrapperChoice::UvUnwrap => vec![&UvUnwrap, &BoxProjection],
            UnwrapperChoice::Xatlas => vec![&Xatlas, &UvUnwrap, &BoxProjection],
            UnwrapperChoice::Box => vec![&BoxProjection],
        }
    }
}

/// Tries `unwrappers` in turn; gives the result, the name of the one that made it, and why each
/// earlier one failed.
///
/// All but the last run under a guard: one that panics is left behind. Each refuses what is too
/// much for it, by counting, so that the result does not depend on the machine.
///
/// # Errors
/// The last one's error when none succeeds; [`UnwrapError::Cancelled`] at once.
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
