//! Lumel bakes diffuse global illumination into glTF levels. It computes the light that arrives at
//! every lumel (lightmap texel) of every surface, both directly from light sources and by
//! interreflection. The result is a lightmap that an engine multiplies by the surfaces' albedo.
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
//! The folder `out` then contains the same files that `lumel bake` writes: the lightmap (EXR), the
//! level with lightmap coordinates, the level with vertex colours, a manifest and a report.
//! `lumel view out` shows them.
//!
//! # Where to start
//!
//! In teaching order:
//!
//! | read | to learn about | example |
//! |---|---|---|
//! | [`Baker`] | options and baking | `01_bake_a_file` |
//! | [`Baker::sky`], [`Baker::sun`], [`Baker::light`], [`Baker::group`], [`inspect()`] | light sources, their names and light groups | `02_choose_light` |
//! | [`Baker::on_progress`], [`CancelToken`], [`Error`] | progress, cancellation, errors and exit codes | `03_progress_and_cancel` |
//! | [`Bake::pages`], [`Bake::vertex_colors`], [`Bake::manifest`], [`MemoryDocument`] | results and scenes in memory | `04_results_in_memory` |
//! | [`SceneBuilder`], [`Baker::find_current`] | generated scenes, many scenes, rebaking only what changed | `05_scene_in_code` |
//! | [`solve`], [`gather_work`], [`merge_work`] | one bake on many machines | |
//! | [`BakeFolder`], [`report_page()`], [`Viewer`](view::Viewer) | finished bakes on disk | |
//!
//! `cargo run --release -p lumel --example 01_bake_a_file` runs the first example.
//!
//! # Guarantees
//!
//! - **Units.** Pages hold R = E/π, linear Rec.709: the radiance of a white diffuse surface. The
//!   unit is nit if lamps are in candela and lux, else W/(m² sr). Lengths are metres. Row 0 of a
//!   page is the top row.
//! - **Determinism.** The same scene, settings and version give the same bytes for any number of
//!   threads. Only [`Report::measured`] differs.
//! - **Errors** are typed and state the file, the place in it, what was found and what was
//!   expected. The library neither prints nor exits, and no input makes it panic.
//! - **Threads** are those of the current rayon pool, or [`Baker::threads`].
//!
//! # Lower levels
//!
//! [`Settings`] is the plain struct behind [`Baker`], for programs that read options from
//! elsewhere; [`bake()`] takes it together with a [`Monitor`]. The stages of the pipeline are
//! crates of their own: [`mesh_ingest`], [`visibility`], [`radiosity`], [`atlas`], [`gather`] and
//! [`atlas_bake`].

mod baker;
mod beside;
mod brightness;
mod cache;
mod check;
mod clock;
mod cull;
mod cut;
mod depfile;
mod earlier_bake;
mod early;
mod error;
mod estimate;
mod files;
mod folder;
mod inspect;
mod joints;
mod level_record;
mod likeness;
mod memory;
mod mixed;
mod named;
mod not_physical;
mod only;
mod open;
mod origin;
mod overwrite;
mod page_groups;
mod pictures;
mod pipeline;
mod plan;
mod probes;
mod record;
mod report;
mod report_page;
mod results;
mod scene_builder;
mod scene_input;
mod settings;
mod shards;
mod sky;
mod sources;
mod split;
mod two_sides;
mod units;
pub mod view;
mod warnings;
mod watch;
mod work;

pub use atlas;
pub use atlas_bake;
pub use gather;
pub use mesh_ingest;
pub use radiosity;
pub use visibility;

pub use atlas::{UnwrapperChoice, UvMode};
pub use atlas_bake::{Directional, Hidden, Ktx2Format, Layer, Page, Paint, PngFormat, ValueKind};
pub use baker::Baker;
pub use beside::{Beside, FirstPicture, Remark};
pub use cache::{Cache, CacheReport};
pub use cull::CullReport;
pub use depfile::depfile;
pub use error::Error;
pub use estimate::{ESTIMATE_FACTOR, Estimate, estimate};
pub use files::{NamedFile, output_names};
pub use folder::{BakeFolder, FinishedGroup, FinishedManifest, FinishedPage};
pub use inspect::{Inspection, describe_lods, inspect, inspect_and_draw};
pub use joints::{GatherDone, Order, SolveDone, gather_work, merge_work, solve};
pub use level_record::{InstanceRecord, LevelRecord};
pub use mesh_ingest::MemoryDocument;
pub use not_physical::NotPhysical;
pub use only::{Only, OnlyReport, Rebaked, rebake};
pub use origin::Origin;
pub use overwrite::outputs_in;
pub use pipeline::{Bake, bake, bake_beside, bake_from};
pub use radiosity::{Monitor, Phase, Silent};
pub use record::{
    Current, InputKind, PREVIEW, Provenance, ReadFile, Record, RecordedInput, RecordedOutput,
    find_current,
};
pub use report::{Blank, GroupReport, Measured, PhaseTime, Report, StoredPage, StoredPng};
pub use report_page::report_page;
pub use results::VertexColors;
pub use scene_builder::{MaterialId, MeshId, SceneBuilder, Surface};
pub use scene_input::SceneInput;
pub use settings::{
    BakeMode, Bounds, GltfExt, LightGroup, LightScale, ProbeSource, Quality, Settings, SkySource,
    Sun, Units,
};
pub use shards::ShardOf;
pub use sources::{Source, SourceKind};
pub use watch::{CancelToken, Progress};
pub use work::{Told, WorkFolder};
