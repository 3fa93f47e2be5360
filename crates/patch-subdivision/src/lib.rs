//! Divides a scene's surfaces into *patches*, which exchange light, and *elements*, which record
//! direct light at a finer resolution (Cohen, Greenberg, Immel, Brock, *An efficient radiosity
//! approach for realistic image synthesis*, 1986: substructuring).
//!
//! Patches have a size in world units, independent of tessellation. Triangles are first grouped
//! into nearly flat regions, and each is divided by a square grid in its own plane. A wall of two
//! triangles becomes many patches, and a statue of a hundred thousand becomes a few dozen. A point
//! on the surface finds its patch and its element in constant time, by projection
//! ([`Subdivision::locate`]).
//!
//! ```
//! use glam::Vec3;
//! use mesh_ingest::{LoadOptions, Soup, load};
//! use patch_subdivision::{Options, Subdivision};
//!
//! let cube = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
//! let soup = Soup::build(&load(cube.as_ref(), &LoadOptions::default())?.scene);
//! let cut = Subdivision::build(&soup, |_| false, &Options { patches: 600, ..Options::default() });
//! assert!(cut.elements().len() >= cut.patches().len());
//! let centre = soup.triangles[0].iter().sum::<Vec3>() / 3.0;
//! let at = cut.locate(0, centre, false).expect("the front of a wall");
//! assert!(cut.patches()[at.patch.0 as usize].area > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod adjacency;
mod flat;
mod grid;
pub mod raster;
mod region;
mod subdivision;
mod walls;

pub use flat::FlatPieces;
pub use region::{Between, RegionId, RegionOptions};
pub use subdivision::{
    Element, ElementId, ElementPoints, Locus, Options, Patch, PatchId, PointOn, Stats, Subdivision,
    Tap, weights,
};
