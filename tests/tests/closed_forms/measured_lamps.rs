//! Lamps with a measured distribution.

use glam::{DVec3, Vec2, Vec3};
use lumel_tests::gltf::Light;
use lumel_tests::scenes::closed_form::{Stage, point_irradiance};
use serde_json::json;

use super::{GOLDEN, golden};
use crate::common::{at, lumels_of, worst};

/// IES LM-63-2002, type C, rotationally symmetric, with these candela at these vertical angles
/// (degrees).
fn ies(values: &[(f64, f64)]) -> String {
    let row = |f: fn(&(f64, f64)) -> f64| -> String {
        let all: Vec<String> = values.iter().map(|v| format!("{:.6}", f(v))).collect();
        all.join("\n")
    };
    let n = values.len();
    format!(
        "IESNA:LM-63-2002\n[TEST] none\nTILT=NONE\n1 -1 1 {n} 1 1 2 0 0 0\n1 1 10\n{}\n0\n{}\n",
        row(|v| v.0),
        row(|v| v.1)
    )
}

/// A percent-encoded data URI.
fn data_uri(text: &str) -> String {
    let coded: String = text.bytes().map(|b| format!("%{b:02X}")).collect();
    format!("data:application/x-ies-lm-63,{coded}")
}

/// E over the floor with the lamp of 20 cd at 2 m straight above it.
fn over_floor(file: &str, exact: impl Fn(f64) -> f64) -> f64 {
    let mut s = Stage::new();
    s.floor(Vec2::splat(-1.5), Vec2::splat(1.5));
    let more = json!({"extras": {"lumel": {"ies": data_uri(file)}}});
    let place = [Vec3::Y * 2.0, Vec3::NEG_Y];
    s.lamp("lamp", Light::Point([20.0; 3]), place, more);
    let lumels = lumels_of(&golden(&s.finish(), &at(16.0)), "floor");
    worst(&lumels, 0.0, |l| {
        l.mean(|p: DVec3| {
            let r = p.x.hypot(p.z);
            exact(2.0 / r.hypot(2.0)) * point_irradiance(20.0, 2.0, r)
        })
    })
}

#[test]
fn an_even_one_is_a_point_light() {
    let even: Vec<_> = (0..=18).map(|i| (10.0 * f64::from(i), 123.0)).collect();
    let w = over_floor(&ies(&even), |_| 1.0);
    assert!(w < GOLDEN, "{w}");
}

#[test]
fn a_lobe_of_the_cosine() {
    // Every 2.5°, bilinear between: cos is off by (2.5°)²/8 = 0.024 %.
    let lobe: Vec<_> = (0..=36)
        .map(|i| 2.5 * f64::from(i))
        .map(|a| (a, 500.0 * a.to_radians().cos().max(0.0)))
        .collect();
    let w = over_floor(&ies(&lobe), |cos| cos);
    assert!(w < GOLDEN, "{w}");
}
