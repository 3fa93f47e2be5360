//! Stored directionality of light, and the sun mask. Values are radiances, R = E/π.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use lumel::{Directional, Settings, SkySource};
use lumel_tests::gltf::{Light, Material};
use lumel_tests::scenes::closed_form::Stage;
use serde_json::{Value, json};

use super::{GOLDEN, HALF, golden, production};
use crate::common::{Seen, at, lumels_of};

fn sh1(settings: Settings) -> Settings {
    Settings {
        directional: Some(Directional::Sh1),
        ..settings
    }
}

/// L0 and (L1x, L1y, L1z) of red.
fn parts(l: &Seen) -> (f64, DVec3) {
    let part = |name| l.layer(&format!("{name}.R"));
    let l1 = DVec3::new(part("L1x"), part("L1y"), part("L1z"));
    (part("L0"), l1)
}

fn floor_under(light: Light, at: [Vec3; 2], more: Value) -> Vec<u8> {
    let mut s = Stage::new();
    s.floor(Vec2::splat(-0.5), Vec2::splat(0.5));
    s.lamp("lamp", light, at, more);
    s.finish()
}

#[test]
fn of_a_distant_lamp() {
    let to = DVec3::new(1.0, 2.0, -0.5).normalize();
    for degrees in [0.0, 0.53] {
        let more = json!({"extras": {"lumel": {"angle": degrees}}});
        let place = [Vec3::Y, -to.as_vec3()];
        let glb = floor_under(Light::Directional([5.0; 3]), place, more);
        for l in lumels_of(&golden(&glb, &sh1(at(4.0))), "floor") {
            // ∫ L dω = E⊥, ∫ L ω dω = E⊥ to; E(n) = ¼ of the first + ½ of the second · n, over π.
            let (l0, l1) = parts(&l);
            assert!((l0 / (5.0 / (4.0 * PI)) - 1.0).abs() < HALF, "{l0}");
            let off = l1.distance(to * (5.0 / (2.0 * PI)));
            assert!(off < GOLDEN * 5.0 / (2.0 * PI), "{l1}");
        }
        let dominant = Settings {
            directional: Some(Directional::Dominant),
            ..at(4.0)
        };
        for l in lumels_of(&golden(&glb, &dominant), "floor") {
            let d = ["X", "Y", "Z"].map(|c| l.layer(&format!("dominant.{c}")));
            assert!(DVec3::from_array(d).distance(to) < GOLDEN, "{d:?}");
        }
    }
}

#[test]
fn of_a_sphere_lamp_and_a_point() {
    // I/d² towards the lamp, whatever its size.
    for radius in [0.0, 0.3] {
        let more = json!({"extras": {"lumel": {"radius": radius}}});
        let lamp = DVec3::new(0.2, 1.5, 0.1);
        let place = [lamp.as_vec3(), Vec3::NEG_Y];
        let glb = floor_under(Light::Point([10.0; 3]), place, more);
        for l in lumels_of(&golden(&glb, &sh1(production(8.0))), "floor") {
            let (l0, l1) = parts(&l);
            let flux = l.mean(|p| 10.0 / lamp.distance_squared(p));
            // E counts the light of the whole disc with the cosine of its middle, but ∫ L dω counts
            // each point with its own: it is L times its solid angle 2π(1 − cosσ) instead of π
            // sin²σ, which is 1 % more for sin σ = 0.2.
            let sin2 = l.mean(|p| radius * radius / lamp.distance_squared(p));
            let wide = 2.0 / (1.0 + (1.0 - sin2).sqrt());
            let exact = flux * wide / (4.0 * PI);
            assert!((l0 / exact - 1.0).abs() < GOLDEN, "{l0} {exact}");
            let towards = (lamp - l.middle()).normalize();
            let off = (l1 - towards * (flux / (2.0 * PI))).length();
            assert!(off < 2.0 * GOLDEN * flux / (2.0 * PI), "{l1}");
        }
    }
}

#[test]
fn of_an_even_sky() {
    let mut s = Stage::new();
    s.floor(Vec2::splat(-0.5), Vec2::splat(0.5));
    let glb = s.finish();
    let sky = |directional| Settings {
        sky: SkySource::Color([2.0; 3]),
        directional: Some(directional),
        ..production(12.0)
    };
    let lumels = lumels_of(&golden(&glb, &sky(Directional::Sh1)), "floor");
    let n = lumels.len() as f64;
    let (l0, l1) =
        (lumels.iter().map(parts)).fold((0.0, DVec3::ZERO), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
    // ∫ L dω = 2πL and ∫ L ω dω = πL, up.
    assert!((l0 / 1.0 - 1.0).abs() < GOLDEN, "{l0}");
    assert!((l1.y - 1.0).abs() < HALF, "{l1}");
    // Light along the floor has weights of 1/cos: a spread of 1 % in one lumel (0.5 % of L0; 4 %
    // and 2.6 % at preview quality) was measured. Smoothing makes neighbours alike, so their mean
    // is little better.
    assert!(l1.x.abs().max(l1.z.abs()) < 2.0 * GOLDEN, "{l1}");
    for l in lumels_of(&golden(&glb, &sky(Directional::Dominant)), "floor") {
        let d = ["X", "Y", "Z"].map(|c| l.layer(&format!("dominant.{c}")));
        // One lumel: four times 1 % of spread, over two axes.
        assert!(
            DVec3::from_array(d).distance(DVec3::Y * 0.5) < 0.03,
            "{d:?}"
        );
    }
}

#[test]
fn what_a_flat_surface_gets_is_kept_in_the_first_order() {
    // For any light, ∫ L ω dω · n is E on a surface that receives light only on its front: L1·n =
    // R/2.
    let mut s = Stage::new();
    let white = s.builder.material(&Material::diffuse("white", [0.6; 3]));
    s.room(Vec3::ZERO, Vec3::ONE, white);
    let glow = s
        .builder
        .material(&Material::emitter("glow", [8.0; 3], [0.0; 3]));
    let panel = [Vec3::new(0.4, 0.99, 0.4), Vec3::X * 0.2, Vec3::Z * 0.2];
    s.panel("glow", panel, glow);
    let lamp = [Vec3::new(0.3, 0.7, 0.2), Vec3::NEG_Y];
    let more = json!({"extras": {"lumel": {"radius": 0.05}}});
    s.lamp("lamp", Light::Point([0.5; 3]), lamp, more);
    let bake = golden(&s.finish(), &sh1(at(6.0)));
    for node in ["-x", "+x", "-y", "+y", "-z", "+z"] {
        for l in lumels_of(&bake, node) {
            let (l0, l1) = parts(&l);
            let half = 0.5 * l.red() / PI;
            // Four half floats.
            assert!(
                (l1.dot(l.normal) / half - 1.0).abs() < 2.0 * HALF,
                "{node}: {l1} {half}"
            );
            // |∫ L ω dω| ≤ ∫ L dω.
            assert!(l1.length() <= 2.0 * l0 * (1.0 + HALF), "{l0} {l1}");
        }
    }
}
