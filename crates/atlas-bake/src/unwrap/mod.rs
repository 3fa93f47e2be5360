//! Unwrapping: a surface in space becomes flat charts, packed into one rectangle of texels per mesh.
//!
//! [`Unwrapper`] is the one small interface; [`UvUnwrap`] and [`BoxProjection`] implement it.
//! [`unwrap_with_fallback`] tries one after the other, so that a mesh always gets charts.

mod boxes;
mod charts;
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
mod uvunwrap;
mod weld;
mod xatlas;

use std::sync::Arc;

use glam::{DVec2, Vec2};
use serde::Serialize;
use split::split_hollow;
use thiserror::Error;

pub use boxes::BoxProjection;
use charts::Charts;
pub use input::{CREASE_DEGREES, NONE, SHARP_DEGREES, UnwrapInput};
use join::join_small;
pub use kept::KeptCharts;
pub(crate) use measure::weighted_median;
pub use measure::{ChartMeasure, measure};
use pack_charts::pack_charts;
pub use uvunwrap::UvUnwrap;
use weld::weld_slits;

use crate::uv_check::Overlaps;
pub use xatlas::Xatlas;

/// How to unwrap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnwrapOptions {
    /// Lumels per metre wanted.
    pub texels_per_unit: f32,
    /// What keeps charts apart. 2: the texels that bilinear lookups on two charts read are disjoint; each one more is a free texel
    /// between those. 1: one free texel between the texels that charts touch; 0: no texel is touched by two charts. Half
    /// of the free texels, rounded up, lie between the charts and the border of the rectangle.
    pub padding: u32,
    /// Both sides of the rectangle are multiples of so many texels (4 for BC formats; 0 or 1: any size).
    pub block: u32,
    /// Also keeps charts to blocks: no block of `block` × `block` texels holds texels that lookups in two charts read.
    pub block_charts: bool,
    /// Longest side of the rectangle in texels. The density is lowered until the charts fit.
    pub max_size: u32,
}

/// Flat charts of one mesh.
#[derive(Debug, Clone, Default)]
pub struct UnwrappedMesh {
    /// Width and height of the rectangle in texels.
    pub size: [u32; 2],
    /// Density that was reached; the one asked for unless the charts did not fit.
    pub texels_per_unit: f32,
    /// Texel coordinates of each triangle's corners (x right, y down). The signed area (x right, y down) is positive, or zero for
    /// triangles too thin for any texel.
    pub corners: Vec<[Vec2; 3]>,
    /// Chart of each triangle.
    pub chart: Vec<u32>,
    /// Number of charts.
    pub charts: u32,
}

/// Why an unwrapper gave up on a mesh.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum UnwrapError {
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The charts cannot be made to fit.
    #[error("{charts} charts do not fit into {max_size} x {max_size} texels")]
    DoesNotFit {
        /// How many charts there are.
        charts: u32,
        /// The largest rectangle allowed.
        max_size: u32,
    },
    /// The unwrapper refused the mesh or gave a result that cannot be used.
    #[error("{0}")]
    Failed(String),
}

/// Polled during long work; `true` asks to stop.
pub type Cancel<'a> = &'a (dyn Fn() -> bool + Sync);

/// Something that flattens meshes.
pub trait Unwrapper: Sync {
    /// Name for reports and for `--unwrapper`.
    fn name(&self) -> &'static str;

    /// Flattens `mesh`.
    ///
    /// Guarantees on success: every corner is finite and lies in the rectangle; charts do not overlap and keep
    /// their distance; the same input gives the same output for any number of threads.
    ///
    /// # Errors
    /// [`UnwrapError`]; another unwrapper may do better.
    fn unwrap(
        &self,
        mesh: &UnwrapInput,
        options: &UnwrapOptions,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError>;
}

/// Which unwrapper to use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UnwrapperChoice {
    /// The one that measures better (`docs/unwrap.md`): uvunwrap.
    #[default]
    Auto,
    /// The `uvunwrap` crate.
    UvUnwrap,
    /// The `xatlas-rs` crate (xatlas of 2019), its charts packed by `uvunwrap`; falls back where it fails.
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

/// Tries `unwrappers` in turn; gives the result, the name of the one that made it, and why each earlier one failed.
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

/// Cuts hollow charts, joins small ones, closes slits and packs them all: what every unwrapper ends with.
fn finish(
    mesh: &UnwrapInput,
    mut charts: Charts,
    options: &UnwrapOptions,
    cancel: Cancel<'_>,
) -> Result<UnwrappedMesh, UnwrapError> {
    let lumel = 1.0 / f64::from(options.texels_per_unit);
    split_hollow(mesh, &mut charts, lumel);
    join_small(mesh, &mut charts, lumel);
    let apart = charts.corners.clone();
    weld_slits(mesh, &mut charts, lumel);
    if cancel() {
        return Err(UnwrapError::Cancelled);
    }
    let packed = pack_charts(&charts, options, cancel)?;
    // Charts that come near themselves may be drawn over themselves by it. The page tells; they stay as they were then.
    if undo_overlaps(&packed, &apart, &mut charts) {
        return pack_charts(&charts, options, cancel);
    }
    Ok(packed)
}

/// Gives charts with texels that two triangles cover the corners that they had `before`; whether that changes anything.
fn undo_overlaps(packed: &UnwrappedMesh, before: &[[DVec2; 3]], charts: &mut Charts) -> bool {
    let overlaps = Overlaps::find(&packed.corners, packed.size);
    if overlaps.twice == 0 {
        return false;
    }
    let mut overlapping = vec![false; charts.count as usize];
    for (t, n) in overlaps.by_triangle.iter().enumerate() {
        if *n > 0 {
            overlapping[charts.chart[t] as usize] = true;
        }
    }
    let mut changed = false;
    for ((now, was), chart) in charts.corners.iter_mut().zip(before).zip(&charts.chart) {
        if overlapping[*chart as usize] && now != was {
            *now = *was;
            changed = true;
        }
    }
    changed
}

/// Rejects what would break the bake: wrong counts, non-finite or outlying corners.
fn check(
    mesh: &UnwrapInput,
    options: &UnwrapOptions,
    result: UnwrappedMesh,
) -> Result<UnwrappedMesh, UnwrapError> {
    let [w, h] = result.size;
    if result.corners.len() != mesh.triangles.len() || result.chart.len() != mesh.triangles.len() {
        return Err(UnwrapError::Failed("triangles are missing".into()));
    }
    if w > options.max_size || h > options.max_size {
        return Err(UnwrapError::DoesNotFit {
            charts: result.charts,
            max_size: options.max_size,
        });
    }
    let inside = |p: &Vec2| p.x >= 0.0 && p.y >= 0.0 && p.x <= w as f32 && p.y <= h as f32;
    if !result.corners.iter().flatten().all(inside) {
        return Err(UnwrapError::Failed("a corner lies off the page".into()));
    }
    Ok(result)
}
