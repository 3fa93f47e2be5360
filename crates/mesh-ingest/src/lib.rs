//! Reads glTF 2.0 into [`Scene`], a documented normal form.
//!
//! In reading order:
//!
//! | read | to learn about |
//! |---|---|
//! | [`load`], [`load_memory`], [`LoadOptions`] | loading a file or a document in memory |
//! | [`Scene`] and its parts | the normal form and its guarantees |
//! | [`Soup`] | world-space triangles for ray casting |
//! | [`Scene::base_color`] and its siblings | what a point of a triangle does to light |
//! | [`Document`] | the original document, for writers |
//! | [`IngestReport`], [`Error`] | what was dropped or repaired, and why a load failed |
//!
//! Input is never trusted: every count is checked against the data that backs it before memory is
//! reserved, all problems are collected with their document paths, and nothing panics.
//!
//! ```
//! use mesh_ingest::{LoadOptions, Soup, load};
//!
//! let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");
//! let loaded = load(file.as_ref(), &LoadOptions::default())?;
//! let soup = Soup::build(&loaded.scene);
//! // Reflectance and alpha near the middle of the first triangle.
//! let color = loaded.scene.base_color(&soup, 0, 0.25, 0.25);
//! assert!(color.max_element() <= 1.0);
//! # Ok::<(), mesh_ingest::Error>(())
//! ```

mod accessor;
mod added;
mod blend;
mod compress;
mod container;
mod cookie;
mod cuts;
mod document;
mod environment;
mod error;
mod extensions;
mod extras;
mod files;
mod geometry;
mod hierarchy;
mod ies;
mod images;
mod input;
mod json;
mod ktx2;
mod lights;
mod load;
mod lods;
mod material;
mod mips;
mod nodes;
mod options;
mod primitive;
mod profile;
mod regular;
mod report;
mod scene;
mod settle;
mod shading;
mod sides;
mod soup;
mod uri;
mod version;
mod views;
mod writable;

pub use accessor::{DataType, Dimensions, RawAccessor};
pub use blend::{Between, blended};
pub use cuts::Cut;
pub use document::{Document, ImageSource};
pub use error::{Error, Problem, printable, printable_within};
pub use files::MemoryDocument;
pub use input::{Digest, Input};
pub use load::{Loaded, load, load_memory};
pub use lods::level_by_name;
pub use mips::Pyramids;
pub use options::{Limits, LoadOptions};
pub use primitive::{Mode, RawPrimitive};
pub use regular::{check_regular, open_regular, read_regular};
pub use report::{IngestReport, LeftOut, LeftOutReason, LodGroup, LodSource, Totals, Warning};
pub use scene::*;
pub use soup::{Duplicate, Soup, TriangleSource};
