//! Final gather: the light at lumels, vertices and probes of a solved scene. No files are touched here.
//!
//! [`bake_light`] runs the passes over a [`LumelMap`], [`bake_vertices`] takes vertices from it, and
//! [`probes`] are gathered by themselves. A [`Gatherer`] gathers at any [`Footprint`].
//!
//! ```
//! use gather::{GatherOptions, Gatherer, Interpolation, LightOptions, Wanted, bake_light};
//! use glam::Vec3;
//! use mesh_ingest::{Instance, Material, Mesh, Primitive, Scene, Soup};
//! use radiosity::{DirectLight, DirectOptions, Emitters, Silent, Sky, World, WorldOptions};
//!
//! // A square of one metre under a sky of radiance 1.
//! let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
//! let square = Primitive {
//!     positions: corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
//!     normals: vec![Vec3::Z; 4],
//!     triangles: vec![[0, 1, 2], [0, 2, 3]],
//!     ..Primitive::default()
//! };
//! let scene = Scene {
//!     meshes: vec![Mesh { primitives: vec![square], ..Mesh::default() }],
//!     instances: vec![Instance::default()],
//!     materials: vec![Material::default()],
//!     ..Scene::default()
//! };
//! let soup = Soup::build(&scene);
//! let sky = Sky::Constant(Vec3::ONE);
//! let world = World::build(&scene, &soup, WorldOptions { sky, ..WorldOptions::default() })?;
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
//!     near: 1.0,
//!     open_only: true,
//! };
//! let direct = DirectLight::new(&world, &emitters);
//! let gatherer = Gatherer::new(&world, &solution, direct, options, Wanted::default());
//! let all = LightOptions { rings: 1, error: None };
//! let (map, report) = bake_light(&gatherer, &layout, all, &Silent).expect("nobody cancels");
//! assert_eq!(report.lumels, 64);
//! for received in map.received() {
//!     // Every ray finds the sky: E = π, up to the rounding of f32 sums.
//!     assert!((received.light() - Vec3::splat(std::f32::consts::PI)).length() < 1e-5);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
