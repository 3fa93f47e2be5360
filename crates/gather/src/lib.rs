//! Final gather: the light at lumels, vertices and probes of a solved scene. This crate does not
//! touch files.
//!
//! In reading order:
//!
//! | read | to learn about |
//! |---|---|
//! | [`bake_light`], [`LumelMap`] | the passes of a bake over the map of lumels, tile by tile |
//! | [`Gatherer`], [`GatherOptions`], [`Footprint`] | gathering at a single piece of surface |
//! | [`Received`], [`Wanted`], [`Plane`] | the result: irradiance, and optional quantities from the same rays |
//! | [`gather_shard`], [`Shard`], [`Records`] | the same, divided among processes |
//! | [`VertexLights`], [`VertexLight`] | light at vertices, fitted to the lumels |
//! | [`probes`] | light at points in the air |
//!
//! ```
//! use gather::{
//!     GatherOptions, Gatherer, Interpolation, LightBake, LightOptions, Wanted, bake_light,
//! };
//! use mesh_ingest::{LoadOptions, Soup, load};
//! use radiosity::{DirectLight, DirectOptions, Emitters, Silent, World};
//!
//! // A closed cube: every face emits L = 1 and reflects half of the light.
//! let cube = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
//! let scene = load(cube.as_ref(), &LoadOptions::default())?.scene;
//! let soup = Soup::build(&scene);
//! let world = World::build(&scene, &soup, Default::default())?;
//! let emitters = Emitters::collect(&world);
//! let solution = radiosity::solve(&world, &emitters, &Default::default(), &Silent);
//! let density = atlas::LayoutOptions { texels_per_unit: Some(8.0), ..Default::default() };
//! let (layout, _) = atlas::layout(&scene, &soup, &density, &|_| true)?;
//!
//! let options = GatherOptions {
//!     rays: 64,
//!     points: 16,
//!     edge_points: 0,
//!     contacts: false,
//!     follow: 0,
//!     most_rays: 64,
//!     error: 0.05,
//!     direct: DirectOptions::every(16, 64),
//!     lit: 0,
//!     interpolation: Interpolation::Open,
//!     calm: 0.03,
//!     near: 1.0,
//!     open_only: true,
//!     tile: gather::TILE,
//! };
//! let direct = DirectLight::new(&world, &emitters);
//! let gatherer = Gatherer::new(&world, &solution, direct, options, Wanted::default());
//! let options = LightOptions { rings: 1, error: None };
//! let all = LightBake { instances: &[0], options, records: None };
//! let mut lumels = 0;
//! let report = bake_light(&gatherer, &layout, all, &Silent, &mut |tile, _| {
//!     lumels += tile.received().len() as u64;
//!     Ok(())
//! })
//! .expect("nobody cancels");
//! assert_eq!(report.lumels, lumels);
//! // E = π L / (1 − ρ) = 2π everywhere, and `mean` is E/π. Each lumel is within 0.6 % of it
//! // (lab/measurements.md), because a few rays slip through an edge.
//! for channel in report.mean {
//!     assert!((channel / 2.0 - 1.0).abs() < 0.006, "{channel}");
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bake;
mod barriers;
mod batch;
mod between;
mod blocks;
mod calm;
mod certainty;
mod clear;
mod edge;
mod estimate;
mod first;
mod footprint;
mod gather;
mod gatherer;
mod hidden;
mod lit;
mod map;
mod options;
mod parts;
mod plan;
mod planes;
mod points;
pub mod probes;
mod quadratic;
mod reach;
mod received;
mod refine;
mod sample;
mod sheets;
mod sky;
mod smooth;
mod thinned;
mod tiles;
mod totals;
mod tracer;
mod vertex_footprint;
mod vertex_light;
mod window;
mod work;

pub use bake::{EachTile, LightBake, bake_light, gather_shard};
pub use calm::not_calm;
pub use footprint::{Footprint, LumelFootprint};
pub use gatherer::Gatherer;
pub use map::LumelMap;
pub use options::{GatherOptions, Interpolation, LightOptions, VertexOptions};
pub use planes::{Plane, Wanted};
pub use received::Received;
pub use tiles::{TILE, tiles};
pub use totals::{HiddenIn, LightReport};
pub use vertex_light::{SplitPrimitive, VertexDifference, VertexLight, VertexLights, VertexReport};
pub use work::{Pass, Records, Shard};
