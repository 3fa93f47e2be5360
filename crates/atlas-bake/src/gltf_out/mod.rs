//! glTF output: the input document with lightmap coordinates, or with baked vertex colours.
//!
//! Both writers edit the document's own JSON, so that everything they do not know passes through
//! unchanged, and append their data. A last step drops unreferenced accessors and buffer views
//! (only if every extension is known, see `refs`), embeds images and writes one .glb with one
//! binary chunk. Compressed views are written uncompressed.

mod editor;
mod glb;
mod json;
mod lightmapped;
mod midpoints;
mod moz;
mod nodes;
mod refs;
mod split;
#[cfg(test)]
mod tests;
mod texcoord;
mod vertex;

pub use lightmapped::{GlbOptions, GltfStats, write_lightmapped_glb, write_lightmapped_glb_with};
pub use nodes::{LIGHTMAP_EXTRA, REFLECTION_EXTRA, VERTEX_LIGHT_EXTRA};
pub use vertex::{VertexStats, write_vertex_glb};
