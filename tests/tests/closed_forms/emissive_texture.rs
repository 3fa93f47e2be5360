//! Panels with an emissive texture, from file to EXR.

use glam::DVec3;
use lumel_tests::scenes::closed_form as scenes;
use lumel_tests::scenes::closed_form::GlowPattern;

use crate::common::{Seen, at, bake, lumels_of};

/// Root mean square and mean relative deviation over the plate.
fn deviation(lumels: &[Seen], exact: impl Fn(&Seen) -> f64) -> (f64, f64) {
    let off: Vec<f64> = lumels.iter().map(|l| l.red() / exact(l) - 1.0).collect();
    let n = off.len() as f64;
    let squares: f64 = off.iter().map(|d| d * d).sum();
    ((squares / n).sqrt(), off.iter().sum::<f64>() / n)
}

#[test]
fn from_afar_a_texture_is_its_mean() {
    for (pattern, side, height) in [
        (GlowPattern::Dots, 1.0, 4.0),
        (GlowPattern::Dots, 2.0, 1.0),
        (GlowPattern::Sign, 1.0, 16.0),
    ] {
        let glb = scenes::textured_panel(pattern, 100.0, side as f32, height as f32);
        let lumels = lumels_of(&bake(&glb, &at(8.0)), "plate");
        let corners = scenes::square(side, 0.0);
        let radiance = 100.0 * pattern.mean();
        let (rms, mean) = deviation(&lumels, |l| {
            l.mean(|p| scenes::polygon_irradiance(radiance, &corners, p, DVec3::NEG_Y))
        });
        // The required 0.5 %: π F × mean radiance. The sign in the middle is nearer than the panel
        // as a whole, whose light is 1 − 2⟨r²⟩/h² = 1 − (side/h)²/3 of it: 0.13 % less at 16 m (8
        // m: 0.52 %, measured 0.50 %).
        assert!(mean.abs() < 5e-3, "{pattern:?} at {height}: {mean}");
        // One lumel has the noise of 64 points drawn from groups of parts: radiosity's own tests
        // measure 0.5 to 2.3 % over a panel of 4 × 2 m, from 4 m to 40 cm.
        assert!(rms < 0.023, "{pattern:?} at {height}: {rms}");
    }
}

#[test]
fn a_sign_shines_from_where_it_is() {
    for height in [0.25, 1.0, 4.0] {
        let glb = scenes::textured_panel(GlowPattern::Sign, 100.0, 2.0, height as f32);
        let lumels = lumels_of(&bake(&glb, &at(8.0)), "plate");
        let corners = scenes::sign_corners(2.0);
        let (rms, mean) = deviation(&lumels, |l| {
            l.mean(|p| scenes::polygon_irradiance(100.0, &corners, p, DVec3::NEG_Y))
        });
        // The square's texels are cut out exactly, 4 × 4 cells of the finest level each. From
        // nearby, the panel's mean would be wrong by factors.
        assert!(mean.abs() < 5e-3, "at {height}: {mean}");
        // The same noise. From 25 cm, light also changes by up to 60 % over a lumel of 12 cm, a
        // spread of 17 %, which 16 points reduce to 4 %.
        let tolerance = if height < 1.0 { 0.05 } else { 0.023 };
        assert!(rms < tolerance, "at {height}: {rms}");
    }
}
