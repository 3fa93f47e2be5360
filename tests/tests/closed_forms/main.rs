//! Scenes whose light is known exactly, baked from file to EXR, each swept over its parameter.
//!
//! Tolerances: the EXR is half float, 2⁻¹¹ = 4.9e-4 relative; direct light without occlusion has no other error than the
//! footprint's mean, which bake and test take over different points. Gathered light has what its rays leave, which each test says.

#[path = "../common/mod.rs"]
mod common;

mod cie;
mod emissive_texture;
mod enclosures;
mod exchange;
mod lights;
mod sky;

/// The bake takes a lumel's mean over 16 Sobol points, the test over 64. Where light varies by 6 % over a lumel that is a deviation of about
/// 0.2 %, and the worst of some thousand lumels is five of these.
const SMOOTH: f64 = 0.01;

/// Half float, in the file and of the value in it.
const HALF: f64 = 1e-3;
