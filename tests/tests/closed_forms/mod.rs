//! Scenes with exactly known light, baked from file to EXR, each swept over its parameter.
//!
//! Tolerances: the EXR is half float, 2⁻¹¹ = 4.9e-4 relative. The only error of unoccluded direct
//! light is that of the footprint's mean, for which bake and test use different points. Gathered
//! light has the noise of its rays, which each test states.

mod area_lights;
mod cie;
mod cookies;
mod directions;
mod emissive_texture;
mod enclosures;
mod everything;
mod exchange;
mod glass;
mod groups;
mod lights;
mod materials;
mod measured_lamps;
mod occlusion;
mod probes;
mod reflections;
mod sized_lights;
mod skies;
mod sky;

use lumel::{Bake, Quality, Settings};

/// The bake averages a lumel over 16 Sobol points, the test over 64. If light varies by 6 % over a
/// lumel, their standard deviation is about 0.2 %, and the worst of a thousand lumels is five times
/// that.
const SMOOTH: f64 = 0.01;

/// Half floats, in the file and in the value.
const HALF: f64 = 1e-3;

/// The required accuracy for every kind of light.
const GOLDEN: f64 = 0.005;

/// Bakes and checks the energy audit.
#[track_caller]
fn golden(glb: &[u8], settings: &Settings) -> Bake {
    let bake = crate::common::bake(glb, settings);
    let audit = &bake.report.solve.audit;
    assert!(
        audit.within_bound,
        "imbalance {} of at most {}",
        audit.imbalance, audit.bound
    );
    bake
}

/// For shipping, at a density.
fn production(texels_per_unit: f32) -> Settings {
    Settings {
        quality: Quality::Production,
        ..crate::common::at(texels_per_unit)
    }
}
