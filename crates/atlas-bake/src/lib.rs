//! Lightmap charts, lumels, final gather, seams; EXR and glTF output.

mod again;
mod atlas;
mod bake;
mod certainty;
mod compare;
mod cost;
pub mod density;
mod dilate;
mod edge;
mod error;
mod estimate;
mod exr_io;
mod false_color;
mod footprint;
mod gather;
mod gltf_out;
mod ktx2;
mod layout;
mod lit;
mod lumels;
mod manifest;
mod output;
mod pack;
mod pages;
mod planes;
mod points;
mod preview;
pub mod probes;
mod reach;
mod recall;
mod refine;
mod seams;
mod smooth;
mod sparse;
mod temporary;
mod texture;
mod unlike;
pub mod unwrap;
mod uv_check;
mod uv_picture;
mod vertex_footprint;
mod vertex_light;
mod walls;

pub use atlas::*;
pub use bake::{BakeOptions, BakeReport, Baked, Directional, Hidden, Layer, bake, bake_recalling};
pub use compare::{Counted, DiffReport, diff, error_png};
pub use cost::{GatherCost, gather_cost, seam_samples};
pub use error::{Error, Result};
pub use exr_io::{
    ExrImage, ExrOptions, ExrStats, HALF_MAX, read_exr, read_exr_within, write_lightmap_exr,
};
pub use footprint::{Footprint, LumelFootprint};
pub use gather::{Edge, GatherOptions, Gatherer, Interpolation, Received};
pub use gltf_out::{
    GlbOptions, GltfStats, LIGHTMAP_EXTRA, SplitPrimitive, VERTEX_LIGHT_EXTRA, VertexLight,
    VertexStats, write_lightmapped_glb, write_lightmapped_glb_with, write_vertex_glb,
};
pub use ktx2::{Ktx2Format, Ktx2Report, write_lightmap_ktx2};
pub use layout::{
    LayoutError, LayoutOptions, LayoutProgress, LayoutReport, MeshReport, layout, layout_kept,
};
pub use lumels::{Fragment, Lumel, Lumels};
pub use manifest::{
    Manifest, ManifestGroup, ManifestKtx2, ManifestNode, ManifestPage, UvTransform, ValueKind,
};
pub use output::{Committed, OutputSet};
pub use pack::{PackedPages, pack_pages};
pub use planes::{Plane, Wanted};
pub use preview::{
    Camera, LitScene, PictureLight, choose_camera, heat_png, lightmap_png, render_preview,
    scene_camera,
};
pub use recall::{Recall, RecallReport};
pub use seams::{SeamError, SeamReport};
pub use temporary::{Leftovers, remove_own_temporaries};
pub use unlike::separate_unlike;
pub use uv_check::{
    OwnUvs, Severity, UvFault, UvFaultKind, UvMode, UvPlace, check_uvs, overlap_share,
};
pub use uv_picture::{Paint, mesh_picture, own_uv_picture, page_picture};
pub use vertex_light::{MOST_ADDED_VERTICES, VertexDifference, VertexReport};
