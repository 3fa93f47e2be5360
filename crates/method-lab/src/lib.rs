//! The method laboratory: the classic ways to compute form factors and to solve the radiosity equation, side by side on the same
//! scenes, so that one can see which method suits when. The baker uses none of this.
//!
//! Everything is in double precision and in world units. Matrices are dense: the laboratory is for some thousand patches.

mod enclosure;
pub mod solver;
pub mod study;

pub use enclosure::{Enclosure, Matrix, Patch};
