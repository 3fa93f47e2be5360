//! Inputs at the limits of floating point: correct values, or counted and explained omissions;
//! never NaN, never a leak.
//!
//! Faces that coincide or nearly touch are in `surfaces.rs`.

mod broken;
mod energy;
mod leaks;
mod space;
