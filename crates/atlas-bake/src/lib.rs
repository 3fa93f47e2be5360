//! Lightmap charts, lumels, final gather, seams; EXR and glTF output.

mod atlas;
mod compare;
mod error;
mod exr_io;
mod false_color;
mod manifest;
mod output;

pub use atlas::*;
pub use compare::{Counted, DiffReport, diff, error_png};
pub use error::{Error, Result};
pub use exr_io::{ExrImage, ExrOptions, ExrStats, HALF_MAX, read_exr, write_lightmap_exr};
pub use manifest::{Manifest, ManifestNode, ManifestPage, UvTransform, ValueKind};
pub use output::{OutputSet, TEMPORARY_PREFIX};
