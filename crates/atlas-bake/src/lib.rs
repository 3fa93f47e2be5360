//! Lightmap pages: seams, dilation and file output (EXR, KTX2, glTF, JSON, PNG).
//!
//! In reading order:
//!
//! | read | to learn about |
//! |---|---|
//! | [`bake()`], [`BakeOptions`] | a whole bake: light is gathered at lumels (crate `gather`), lumels become pages, seams are stitched, and vertices get light from the same lumels |
//! | [`Page`], [`Layer`], [`Directional`] | the channels of a page |
//! | [`write_lightmap_exr`], [`read_exr`], [`write_lightmap_ktx2`] | image files |
//! | [`write_lightmapped_glb`], [`write_vertex_glb`], [`Manifest`] | glTF output and its description |
//! | [`diff`] | the error between two lightmaps |
//! | [`OutputSet`] | writing many files as one transaction |
//!
//! ```
//! use atlas_bake::{ExrOptions, Page, diff, read_exr, write_lightmap_exr};
//!
//! let page = Page {
//!     width: 2,
//!     height: 1,
//!     value: vec![[0.5, 0.25, 1.0], [2.0; 3]],
//!     coverage: vec![1.0; 2],
//!     layers: Vec::new(),
//! };
//! let (bytes, stats) = write_lightmap_exr(&page, &ExrOptions::default())?;
//! assert_eq!(stats.clamped, 0);
//! let file = tempfile::NamedTempFile::new().expect("a temporary file");
//! std::fs::write(file.path(), bytes).expect("written");
//! let image = read_exr(file.path())?;
//! assert_eq!(image.channel("R"), Some(&[0.5, 2.0][..]));
//! assert_eq!(diff(&image, &image)?.rel_rmse, 0.0);
//! # Ok::<(), atlas_bake::Error>(())
//! ```

mod bake;
mod channels;
mod compare;
mod cost;
mod dilate;
mod earlier;
mod error;
mod exposure;
mod exr_io;
mod false_color;
mod gltf_out;
mod ktx2;
mod manifest;
mod mixed;
mod options;
mod output;
mod page;
mod pages;
mod preview;
mod probe_file;
mod probe_points;
mod seams;
mod small;
mod temporary;
mod texture;
mod uv_picture;
mod work_time;

pub use bake::{BakeReport, Baked, bake, gather_shard, merge, rebake};
pub use compare::{Counted, DiffReport, diff, error_png};
pub use cost::{Counts, GatherCost, extra_bytes, gather_cost};
pub use earlier::Earlier;
pub use error::{Error, Result};
pub use exposure::suggested_exposure;
pub use exr_io::{ExrImage, ExrOptions, ExrStats, read_exr, read_exr_within, write_lightmap_exr};
pub use gltf_out::{
    GlbOptions, GltfStats, LIGHTMAP_EXTRA, REFLECTION_EXTRA, VERTEX_LIGHT_EXTRA, VertexStats,
    write_lightmapped_glb, write_lightmapped_glb_with, write_vertex_glb,
};
pub use ktx2::{
    Ktx2Format, Ktx2Report, write_lightmap_ktx2, write_mask_ktx2, write_probe_volume,
    write_reflection_ktx2,
};
pub use manifest::{
    Manifest, ManifestGroup, ManifestKtx2, ManifestMask, ManifestNode, ManifestPage, ManifestPng,
    ManifestReflection, UvTransform, ValueKind,
};
pub use mixed::{ManifestLamp, MixedLight, NodelessSun};
pub use options::{BakeOptions, Directional, Divided, Hidden, Layer};
pub use output::{Committed, OutputSet};
pub use page::Page;
pub use preview::{
    Camera, LitScene, PictureLight, choose_camera, heat_png, lightmap_png, render_preview,
    scene_camera,
};
pub use probe_file::{FilledGrid, ProbeFile, ProbeVolume};
pub use probe_points::{PointsError, parse_points};
pub use seams::{SeamError, SeamReport};
pub use small::{PngFormat, PngReport, write_lightmap_png};
pub use temporary::{Leftovers, remove_own_temporaries};
pub use uv_picture::{Paint, mesh_picture, own_uv_picture, page_picture};
pub use work_time::{WorkTime, processor_seconds};
