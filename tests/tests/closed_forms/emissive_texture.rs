//! Panels with an emissive texture, from file to EXR.

use glam::DVec3;
use lumel_tests::scenes::closed_form as scenes;
use lumel_tests::scenes::closed_form::GlowPattern;

use crate::common::{Seen, at, bake, lumels_of, worst};

/// Largest and mean relative deviation over the plate.
fn deviation(lumels: &[Seen], exact: impl Fn(&Seen) -> f64) -> (f64, f64) {
    let mean: f64 = lumels.iter().map(|l| l.red() / exact(l) - 1.0).sum();
    (worst(lumels, 0.0, &exact), mean / lumels.len() as f64)
}

#[test]
fn from_afar_a_texture_is_its_mean() {
    for (pattern, side, height) in [
        (GlowPattern::Dots, 1.0, 4.0),
        (GlowPattern::Dots, 2.0, 1.0),
        (GlowPattern::Sign, 1.0, 8.0),
    ] {
        let glb = scenes::textured_panel(pattern, 100.0, side as f32, height as f32);
        let lumels = lumels_of(&bake(&glb, &at(8.0)), "plate");
        let corners = scenes::square(side, 0.0);
        let radiance = 100.0 * pattern.mean();
        let (worst, mean) = deviation(&lumels, |l| {
            l.mean(|p| scenes::polygon_irradiance(radiance, &corners, p, DVec3::NEG_Y))
        });
        // The golden number: π F × mean radiance. The sign is a little nearer than the panel as a whole: 1/6 (side/height)² = 0.3 %.
        assert!(mean.abs() < 5e-3, "{pattern:?} at {height}: {mean}");
        // One lumel has the noise of some 64 points drawn from groups of parts.
        assert!(worst < 0.03, "{pattern:?} at {height}: {worst}");
    }
}

#[test]
fn a_sign_shines_from_where_it_is() {
    for height in [0.25, 1.0, 4.0] {
        let glb = scenes::textured_panel(GlowPattern::Sign, 100.0, 2.0, height as f32);
        let lumels = lumels_of(&bake(&glb, &at(8.0)), "plate");
        let corners = scenes::sign_corners(2.0);
        let (worst, mean) = deviation(&lumels, |l| {
            l.mean(|p| scenes::polygon_irradiance(100.0, &corners, p, DVec3::NEG_Y))
        });
        // The square's texels are cut out exactly, 4 × 4 cells of the finest level each; with the panel's mean instead it would be wrong by
        // factors from near.
        assert!(mean.abs() < 5e-3, "at {height}: {mean}");
        // From 25 cm light changes by up to 60 % over a lumel of 12 cm, and few points each are drawn for each group.
        let tolerance = if height < 1.0 { 0.1 } else { 0.03 };
        assert!(worst < tolerance, "at {height}: {worst}");
    }
}
