//! Lumel bakes diffuse global illumination into glTF levels.
//!
//! [`bake`] runs the whole pipeline; the crates under it ([`mesh_ingest`], [`radiosity`], [`atlas_bake`], …) are its joints, for
//! programs that want only a part.
//!
//! ```no_run
//! use lumel::{Settings, Silent, bake};
//!
//! let baked = bake("level.glb".as_ref(), &Settings::default(), &Silent)?;
//! baked.write("out".as_ref())?;
//! println!("mean error about {:.2} %", 100.0 * baked.report.gather.estimated_error);
//! # Ok::<(), lumel::Error>(())
//! ```

mod baker;
mod check;
mod depfile;
mod error;
mod estimate;
mod files;
mod folder;
mod inspect;
mod memory;
mod origin;
mod pictures;
mod pipeline;
mod probes;
mod record;
mod report;
mod report_page;
mod results;
mod scene_builder;
mod scene_input;
mod settings;
mod sky;
mod sources;
pub mod view;
mod watch;

pub use atlas_bake;
pub use mesh_ingest;
pub use radiosity;
pub use visibility;

pub use atlas_bake::{
    Directional, Hidden, Layer, Page, Paint, UvMode, ValueKind, unwrap::UnwrapperChoice,
};
pub use baker::Baker;
pub use depfile::depfile;
pub use error::Error;
pub use estimate::{Estimate, estimate};
pub use files::{NamedFile, output_names};
pub use folder::{BakeFolder, FinishedGroup, FinishedManifest, FinishedPage};
pub use inspect::{Inspection, inspect, inspect_and_draw};
pub use mesh_ingest::MemoryDocument;
pub use origin::Origin;
pub use pipeline::{Bake, bake, bake_from};
pub use radiosity::{Monitor, Phase, Silent};
pub use record::{
    Current, InputKind, PREVIEW, Provenance, Record, RecordedInput, RecordedOutput, find_current,
};
pub use report::{Blank, GroupReport, Measured, PhaseTime, Report};
pub use report_page::report_page;
pub use results::VertexColors;
pub use scene_builder::{MaterialId, MeshId, SceneBuilder, Surface};
pub use scene_input::SceneInput;
pub use settings::{LightGroup, LightScale, ProbeSource, Quality, Settings, SkySource, Sun};
pub use sources::{Source, SourceKind};
pub use watch::{CancelToken, Progress};
