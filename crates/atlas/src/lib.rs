//! Lightmap charts, their layout on pages, and the lumels under it. No light is known here.
//!
//! [`layout`] gives every mesh charts and every instance a place on a page, [`check_uvs`] says
//! whether an asset's own coordinates can serve, and [`Lumels`] lists the texels that have a
//! surface, with the triangles under each.
//!
//! ```
//! use atlas::{LayoutOptions, Lumels, layout, separate_unlike};
//! use mesh_ingest::{Instance, Material, Mesh, Primitive, Scene, Soup};
//!
//! // A square of one metre.
//! let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
//! let square = Primitive {
//!     positions: corners.map(|[x, y]| glam::Vec3::new(x, y, 0.0)).to_vec(),
//!     normals: vec![glam::Vec3::Z; 4],
//!     triangles: vec![[0, 1, 2], [0, 2, 3]],
//!     ..Primitive::default()
//! };
//! let mut scene = Scene {
//!     meshes: vec![Mesh { primitives: vec![square], ..Mesh::default() }],
//!     instances: vec![Instance::default()],
//!     materials: vec![Material::default()],
//!     ..Scene::default()
//! };
//! separate_unlike(&mut scene);
//! let soup = Soup::build(&scene);
//! let options = LayoutOptions { texels_per_unit: Some(8.0), ..LayoutOptions::default() };
//! let (layout, report) = layout(&scene, &soup, &options, &|_| true)?;
//! assert_eq!(report.texels_per_unit, 8.0);
//! let lumels = Lumels::find(&scene, &soup, &layout);
//! assert_eq!(lumels.lumels.len(), 64);
//! # Ok::<(), atlas::LayoutError>(())
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
pub use unwrap::{ChartMeasure, KeptCharts, UnwrapError, UnwrapInput, UnwrapperChoice};
pub use uv_check::{OwnUvs, Severity, UvFault, UvFaultKind, UvMode, UvPlace, check_uvs};
