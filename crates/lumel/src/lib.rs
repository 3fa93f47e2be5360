//! Lumel bakes diffuse global illumination into glTF levels: light that arrives at every small
//! square of every surface, straight from lamps and by way of all other surfaces, as pictures that
//! an engine multiplies with the surfaces' colours.
//!
//! # A first bake
//!
//! ```no_run
//! use lumel::{Baker, Quality};
//!
//! let bake = Baker::new().quality(Quality::Draft).sky([0.25, 0.35, 0.5]).bake("level.glb")?;
//! bake.write("out")?;
//! println!("error about {:.2} %", 100.0 * bake.report.gather.light.median_error);
//! # Ok::<(), lumel::Error>(())
//! ```
//!
//! `out` then holds the lightmap (EXR), the level with lightmap coordinates, the level with vertex
//! colours, a manifest and a report: the files of `lumel bake`, byte for byte. `docs/guide.md` of
//! the project says what they are for, and how to look at them.
//!
//! # In this order
//!
//! | read | to learn | example |
//! |---|---|---|
//! | [`Baker`] | options, and one call that bakes | `01_bake_a_file` |
//! | [`Baker::sky`], [`Baker::sun`], [`Baker::light`], [`Baker::group`], [`inspect`] | what lights a level, and what it can be called | `02_choose_light` |
//! | [`Baker::on_progress`], [`CancelToken`], [`Error`] | watching, stopping, and what goes wrong, with exit codes | `03_progress_and_cancel` |
//! | [`Bake::pages`], [`Bake::vertex_colors`], [`Bake::manifest`], [`MemoryDocument`] | results and scenes in memory | `04_results_in_memory` |
//! | [`SceneBuilder`], [`Baker::find_current`] | scenes made in code, many scenes, baking only what changed | `05_scene_in_code` |
//!
//! `cargo run --release -p lumel --example 01_bake_a_file` runs the first.
//!
//! # What holds
//!
//! - **Units.** Pages hold R = E/π, linear Rec.709: the radiance of a white diffuse surface, in nit
//!   where lamps are in candela and lux, else in W/(m² sr). Lengths are metres, row 0 of a page is
//!   the top one.
//! - **Determinism.** The same scene, settings and version give the same bytes for any number of
//!   threads. [`Report::measured`] alone differs.
//! - **Errors** have a type and say file, place, what was found and what was expected. The library
//!   neither prints nor exits, and input does not make it panic.
//! - **Threads** are those of the current rayon pool, or [`Baker::threads`].
//!
//! [`Settings`] is the plain struct behind [`Baker`], for programs that read options from
//! elsewhere; [`bake()`] takes it with a [`Monitor`]. The crates underneath ([`mesh_ingest`],
//! [`visibility`], [`radiosity`], [`atlas`], [`gather`], [`atlas_bake`]) are the joints of the
//! pipeline, for programs that want only a part.

mod baker;
mod brightness;
mod cache;
mod check;
mod depfile;
mod early;
mod error;
mod estimate;
mod files;
mod folder;
mod inspect;
mod likeness;
mod memory;
mod named;
mod origin;
mod overwrite;
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
mod units;
pub mod view;
mod warnings;
mod watch;

pub use atlas;
pub use atlas_bake;
pub use gather;
pub use mesh_ingest;
pub use radiosity;
pub use visibility;

pub use atlas::{UnwrapperChoice, UvMode};
pub use atlas_bake::{Directional, Hidden, Ktx2Format, Layer, Page, Paint, ValueKind};
pub use baker::Baker;
pub use cache::{Cache, CacheReport};
pub use depfile::depfile;
pub use error::Error;
pub use estimate::{ESTIMATE_FACTOR, Estimate, estimate};
pub use files::{NamedFile, output_names};
pub use folder::{BakeFolder, FinishedGroup, FinishedManifest, FinishedPage};
pub use inspect::{Inspection, describe_lods, inspect, inspect_and_draw};
pub use mesh_ingest::MemoryDocument;
pub use origin::Origin;
pub use overwrite::outputs_in;
pub use pipeline::{Bake, Beside, FirstPicture, Remark, bake, bake_beside, bake_from};
pub use radiosity::{Monitor, Phase, Silent};
pub use record::{
    Current, InputKind, PREVIEW, Provenance, Record, RecordedInput, RecordedOutput, find_current,
};
pub use report::{Blank, GroupReport, Measured, PhaseTime, Report, StoredPage};
pub use report_page::report_page;
pub use results::VertexColors;
pub use scene_builder::{MaterialId, MeshId, SceneBuilder, Surface};
pub use scene_input::SceneInput;
pub use settings::{
    Bounds, GltfExt, LightGroup, LightScale, ProbeSource, Quality, Settings, SkySource, Sun, Units,
};
pub use sources::{Source, SourceKind};
pub use watch::{CancelToken, Progress};
