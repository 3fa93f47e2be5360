//! Lightmap charts, lumels, final gather, seams; EXR and glTF output.

mod atlas;

pub use atlas::*;
