//! The method laboratory: the classic ways to compute form factors and to solve the radiosity
//! equation, side by side on the same scenes, so that one can see which method suits when. The
//! baker uses none of this.
//!
//! Everything is in double precision and in world units. Matrices are dense: the laboratory is for
//! some thousand patches.

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
