//! Lightmap charts, their layout on pages, and the lumels under it. No light is known here.
//!
//! [`layout()`] gives every mesh charts, or keeps an asset's own coordinates where they can serve,
//! and every instance a place on a page. [`Lumels`] lists the texels that have a surface, with the
//! triangles under each.
//!
//! ```
//! use atlas::{LayoutOptions, Lumels, layout, separate_unlike};
//! use mesh_ingest::{LoadOptions, Soup, load};
//!
//! // A cube, seen from within.
//! let cube = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
//! let mut scene = load(cube.as_ref(), &LoadOptions::default())?.scene;
//! separate_unlike(&mut scene);
//! let soup = Soup::build(&scene);
//! let options = LayoutOptions { texels_per_unit: Some(8.0), ..LayoutOptions::default() };
//! let (layout, report) = layout(&scene, &soup, &options, &|_| true)?;
//! assert_eq!(report.texels_per_unit, 8.0);
//! let lumels = Lumels::find(&scene, &soup, &layout);
//! let area: f32 = soup.areas.iter().sum();
//! // Texels that reach over a chart's border are lumels too.
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
