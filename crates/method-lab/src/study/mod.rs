//! The classic radiosity studies: a closed room with two boxes, various lamps and colours, and the
//! baseline as it is typically first written.
//!
//! The baseline uses centre-to-centre form factors, ignores occlusion by the boxes, gathers a fixed
//! number of times and blends patch colours at vertices. It is the subject of the studies, not a
//! recommendation.

mod barycentre;
mod baseline;
mod cases;
mod room;

pub use barycentre::{RowSums, barycentre_matrix, largest_eigenvalue, row_sums};
pub use baseline::{gather_times, vertex_radiosity};
pub use cases::{Case, Lamp, cases};
pub use room::{Detail, Room, RoomPatch, Surface};
