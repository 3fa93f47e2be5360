//! Lightmap charts, lumels, final gather, seams; EXR and glTF output.

mod atlas;
mod compare;
pub mod density;
mod error;
mod exr_io;
mod false_color;
mod layout;
mod manifest;
mod output;
mod pack;
pub mod unwrap;
mod uv_check;

pub use atlas::*;
pub use compare::{Counted, DiffReport, diff, error_png};
pub use error::{Error, Result};
pub use exr_io::{ExrImage, ExrOptions, ExrStats, HALF_MAX, read_exr, write_lightmap_exr};
pub use layout::{LayoutError, LayoutOptions, LayoutProgress, LayoutReport, MeshReport, layout};
pub use manifest::{Manifest, ManifestNode, ManifestPage, UvTransform, ValueKind};
pub use output::{OutputSet, TEMPORARY_PREFIX};
pub use pack::{PackedPages, pack_pages};
pub use uv_check::{UvMode, keep_uvs, overlap_share};
