//! The classic radiosity studies: one closed room with two boxes in it, under lamps and colours of
//! several kinds, and the baseline as it is first written.
//!
//! The baseline takes form factors from centre to centre, ignores that the boxes hide things,
//! gathers a fixed number of times and blends patch colours at vertices. It is what the studies are
//! about, not what should be used.

mod barycentre;
mod baseline;
mod cases;
mod room;

pub use barycentre::{RowSums, barycentre_matrix, largest_eigenvalue, row_sums};
pub use baseline::{gather_times, vertex_radiosity};
pub use cases::{Case, Lamp, cases};
pub use room::{Detail, Room, RoomPatch, Surface};
