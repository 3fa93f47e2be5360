//! Lightmap charts, their layout on pages, and lumels. This crate knows nothing about light.
//!
//! In reading order:
//!
//! | read | to learn about |
//! |---|---|
//! | [`layout()`], [`LayoutOptions`] | charts for every mesh (or the asset's own coordinates where they are valid), and a rectangle on a page for every instance |
//! | [`Layout`], [`MeshAtlas`], [`Placement`] | the result |
//! | [`Lumels`], [`Lumel`] | the texels that have a surface, and the triangles under each |
//! | [`separate_unlike`] | instances of one mesh that need charts of their own |
//! | [`UvFault`], [`overlap_share`] | faults of an asset's own coordinates |
//!
//! ```
//! use atlas::{LayoutOptions, Lumels, layout, separate_unlike};
//! use mesh_ingest::{LoadOptions, Soup, load};
//!
//! // A cube with inward-facing walls.
//! let cube = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
//! let mut scene = load(cube.as_ref(), &LoadOptions::default())?.scene;
//! separate_unlike(&mut scene);
//! let soup = Soup::build(&scene);
//! let options = LayoutOptions { texels_per_unit: Some(8.0), ..LayoutOptions::default() };
//! let (layout, report) = layout(&scene, &soup, &options, &|_| true)?;
//! assert_eq!(report.texels_per_unit, 8.0);
//! let lumels = Lumels::find(&scene, &soup, &layout);
//! let area: f32 = soup.areas.iter().sum();
//! // Texels that cross a chart's border are lumels too.
//! assert!(lumels.lumels.len() as f32 >= 8.0 * 8.0 * area);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atlas;
mod density;
mod layout;
mod lumels;
mod overlap;
mod pack;
mod unlike;
mod unwrap;
mod uv_check;

pub use atlas::{Layout, MeshAtlas, Placement, PrimitiveAtlas, Rect, UvOrigin};
pub use density::{Adjusted, shape_of};
pub use layout::{
    LayoutError, LayoutOptions, LayoutProgress, LayoutReport, MeshReport, layout, layout_kept,
};
pub use lumels::{Fragment, Lumel, Lumels, TexelIndex, faces_of};
pub use overlap::{Bleeding, for_each_texel, overlap_share};
pub use pack::{PackedPages, pack_pages};
pub use unlike::separate_unlike;
pub use unwrap::{
    ChartMeasure, KeptCharts, UnwrapError, UnwrapInput, UnwrapOptions, UnwrapperChoice,
};
pub use uv_check::{Severity, UvFault, UvFaultKind, UvMode, UvPlace};
