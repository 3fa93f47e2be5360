//! Lightmap charts, lumels, final gather, seams; EXR and glTF output.

mod bake;
mod barriers;
mod between;
mod blocks;
mod certainty;
mod compare;
mod cost;
mod dilate;
mod edge;
mod error;
mod estimate;
mod exr_io;
mod false_color;
mod first;
mod footprint;
mod gather;
mod gltf_out;
mod hidden;
mod ktx2;
mod lit;
mod manifest;
mod map;
mod options;
mod output;
mod page;
mod pages;
mod parts;
mod plan;
mod planes;
mod points;
mod preview;
pub mod probes;
mod quadratic;
mod reach;
mod received;
mod refine;
mod sample;
mod seams;
mod smooth;
mod texture;
mod tracer;
mod uv_picture;
mod vertex_footprint;
mod vertex_light;
mod window;

pub use bake::{BakeOptions, BakeReport, Baked, Directional, Hidden, Layer, bake};
pub use compare::{Counted, DiffReport, diff, error_png};
pub use cost::{GatherCost, gather_cost};
pub use error::{Error, Result};
pub use exr_io::{ExrImage, ExrOptions, ExrStats, HALF_MAX, read_exr, write_lightmap_exr};
pub use footprint::{Footprint, LumelFootprint};
pub use gather::Gatherer;
pub use gltf_out::{
    GlbOptions, GltfStats, LIGHTMAP_EXTRA, SplitPrimitive, VERTEX_LIGHT_EXTRA, VertexLight,
    VertexStats, write_lightmapped_glb, write_lightmapped_glb_with, write_vertex_glb,
};
pub use ktx2::{Ktx2Format, Ktx2Report, write_lightmap_ktx2};
pub use manifest::{
    Manifest, ManifestGroup, ManifestKtx2, ManifestNode, ManifestPage, UvTransform, ValueKind,
};
pub use options::{GatherOptions, Interpolation};
pub use output::{Committed, OutputSet, TEMPORARY_PREFIX};
pub use page::Page;
pub use planes::{Plane, Wanted};
pub use preview::{
    Camera, LitScene, PictureLight, choose_camera, heat_png, lightmap_png, render_preview,
    scene_camera,
};
pub use received::{Edge, Received};
pub use seams::{SeamError, SeamReport};
pub use uv_picture::{Paint, mesh_picture, own_uv_picture, page_picture};
pub use vertex_light::{MOST_ADDED_VERTICES, VertexDifference, VertexReport};
