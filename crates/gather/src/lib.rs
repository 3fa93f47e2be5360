//! Final gather: the light at lumels, vertices and probes of a solved scene. No files are touched here.
//!
//! [`bake_light`] runs the passes over a [`LumelMap`], [`bake_vertices`] takes vertices from it, and
//! [`probes`] are gathered by themselves. A [`Gatherer`] gathers at any [`Footprint`].

mod bake;
mod barriers;
mod between;
mod blocks;
mod certainty;
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
mod smooth;
mod tracer;
mod vertex_footprint;
mod vertex_light;
mod window;

pub use bake::{LightReport, bake_light, bake_vertices};
pub use footprint::{Footprint, LumelFootprint};
pub use gatherer::Gatherer;
pub use map::LumelMap;
pub use options::{GatherOptions, Interpolation, LightOptions, VertexOptions};
pub use planes::{Plane, Wanted};
pub use received::Received;
pub use vertex_light::{SplitPrimitive, VertexDifference, VertexLight, VertexReport};
