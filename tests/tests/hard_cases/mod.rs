//! Inputs at the edge of what numbers can say: right values, or counted and explained omissions;
//! never NaN, never a leak.
//!
//! Faces that lie in or on one another are in `surfaces.rs`.

mod broken;
mod energy;
mod leaks;
mod space;
