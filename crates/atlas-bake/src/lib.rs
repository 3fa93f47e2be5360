//! Lightmap charts, lumels, final gather, seams; EXR and glTF output.

mod atlas;
mod error;
mod exr_io;
mod output;

pub use atlas::*;
pub use error::{Error, Result};
pub use exr_io::{ExrImage, ExrOptions, ExrStats, HALF_MAX, read_exr, write_lightmap_exr};
pub use output::{OutputSet, TEMPORARY_PREFIX};
