//! Cuts a scene's surfaces into *patches*, between which light is exchanged, and *elements*, which
//! record direct light more finely (Cohen, Greenberg, Immel, Brock, *An efficient radiosity
//! approach for realistic image synthesis*, 1986: substructuring).
//!
//! Patches are sized in world units and do not follow the tessellation: triangles are first
//! gathered into regions, each about flat, and a square grid in the region's own plane cuts it. A
//! wall of two triangles becomes many patches; a statue of a hundred thousand becomes some dozens.
//! A point on the surface finds its patch and its element in constant time, by projection
//! ([`Subdivision::locate`]).

mod adjacency;
mod grid;
pub mod raster;
mod region;
mod subdivision;
mod walls;

pub use region::{RegionId, RegionOptions};
pub use subdivision::{
    Element, ElementId, Locus, Options, Patch, PatchId, Stats, Subdivision, Tap,
};
