//! The interface of an unwrapper.

use glam::Vec2;
use thiserror::Error;

use super::input::UnwrapInput;

/// How to unwrap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnwrapOptions {
    /// Requested lumels per metre.
    pub texels_per_unit: f32,
    /// Distance of charts. 2: bilinear lookups on two charts read disjoint texels; each further
    /// unit adds a free texel between those. 1: one free texel between the texels that charts
    /// touch. 0: no texel is touched by two charts. Half of the free texels, rounded up, are
    /// between charts and the rectangle's border.
    pub padding: u32,
    /// Both sides of the rectangle are multiples of this many texels (4 for BC formats; 0 or 1: any
    /// size).
    pub block: u32,
    /// Also aligns charts to blocks: no block of `block` × `block` texels is read by lookups in two
    /// charts.
    pub block_charts: bool,
    /// Longest side of the rectangle in texels. The density is lowered until the charts fit.
    pub max_size: u32,
}

/// Flat charts of one mesh.
#[derive(Debug, Clone, Default)]
pub struct UnwrappedMesh {
    /// Width and height of the rectangle in texels.
    pub size: [u32; 2],
    /// The density that was reached: the requested one unless the charts did not fit.
    pub texels_per_unit: f32,
    /// Texel coordinates of each triangle's corners (x right, y down). The signed area (x right, y
    /// down) is positive, or zero for triangles thinner than any texel.
    pub corners: Vec<[Vec2; 3]>,
    /// Chart of each triangle.
    pub chart: Vec<u32>,
    /// Number of charts.
    pub charts: u32,
}

/// Why an unwrapper failed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum UnwrapError {
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The charts cannot be made to fit.
    #[error("{charts} charts do not fit into {max_size} x {max_size} texels")]
    DoesNotFit {
        /// Number of charts.
        charts: u32,
        /// Largest allowed side of the rectangle, texels.
        max_size: u32,
    },
    /// The unwrapper refused the mesh or gave an unusable result.
    #[error("{0}")]
    Failed(String),
}

/// Polled during long work; `true` asks to stop.
pub type Cancel<'a> = &'a (dyn Fn() -> bool + Sync);

/// An algorithm that unwraps meshes.
pub trait Unwrapper: Sync {
    /// Name for reports and for `--unwrapper`.
    fn name(&self) -> &'static str;

    /// Unwraps `mesh`.
    ///
    /// Guarantees on success: every corner is finite and inside the rectangle; charts do not
    /// overlap and keep their distance; the same input gives the same output for any number of
    /// threads.
    ///
    /// # Errors
    /// [`UnwrapError`]; another unwrapper may succeed.
    fn unwrap(
        &self,
        mesh: &UnwrapInput,
        options: &UnwrapOptions,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError>;
}

/// Rejects results that would break the bake: wrong counts, non-finite or outlying corners.
pub(super) fn check(
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
        return Err(UnwrapError::Failed("a corner is outside the page".into()));
    }
    Ok(result)
}
