//! The method laboratory: classic methods for computing form factors and solving the radiosity
//! equation, side by side on the same scenes, to show which method suits when. The baker does not
//! use it.
//!
//! Everything is in double precision and in world units. Matrices are dense, for a few thousand
//! patches.

mod audit;
pub mod convergence;
mod enclosure;
pub mod enclosures;
pub mod form_factor;
pub mod reference;
pub mod solver;
pub mod study;
mod visible;

pub use audit::{Audit, MatrixError, audit, compare};
pub use enclosure::{Enclosure, Matrix, Patch};
pub use form_factor::{FormFactorError, FormFactors, Method, form_factors};
pub use visible::{Hit, Visibility};
