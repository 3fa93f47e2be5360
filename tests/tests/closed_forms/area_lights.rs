//! Area lights of `EXT_lights_area` over a black floor.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use lumel_tests::scenes::closed_form as scenes;
use serde_json::json;

use super::GOLDEN;
use crate::common::{at, bake, lumels_of, worst};

/// The light is a thousandth of its size lower than its node.
const IN_FRONT: f64 = 1e-3;

#[test]
fn a_rectangle_of_every_aspect_and_scale() {
    for (size, aspect, h, scale) in [
        (1.0, 1.0, 1.0, Vec3::ONE),
        (0.4, 3.0, 1.5, Vec3::ONE),
        // The largest component counts, and no scale mirrors.
        (0.5, 0.5, 1.0, Vec3::new(-2.0, 1.0, 0.5)),
    ] {
        let light = json!({
            "type": "rect", "name": "panel", "intensity": 3.0, "size": size, "rect": {"aspect": aspect}
        });
        let glb = scenes::area_light_over_floor(light, h as f32, scale);
        let b = bake(&glb, &at(16.0));
        let y = f64::from(scale.abs().max_element()) * size;
        let x = y * aspect;
        let height = h - IN_FRONT * x.min(y);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(u, v)| DVec3::new(0.5 * x * u, height, 0.5 * y * v));
        let w = worst(&lumels_of(&b, "floor"), 0.01, |l| {
            l.mean(|p| scenes::polygon_irradiance(3.0, &corners, p, DVec3::Y))
        });
        assert!(w < GOLDEN, "size {size} aspect {aspect}: {w}");
    }
}

#[test]
fn a_disc_and_its_defaults() {
    // 1000 nit, white, with a diameter of 1 m.
    let glb = scenes::area_light_over_floor(json!({"type": "disk"}), 1.0, Vec3::ONE);
    let b = bake(&glb, &at(16.0));
    let height = 1.0 - IN_FRONT;
    let corners: Vec<DVec3> = (0..1024)
        .map(|i| TAU * f64::from(i) / 1024.0)
        .map(|a| DVec3::new(0.5 * a.cos(), height, 0.5 * a.sin()))
        .collect();
    // E under its middle is π L r²/(r² + h²).
    let foot = scenes::polygon_irradiance(1000.0, &corners, DVec3::ZERO, DVec3::Y);
    let exact = PI * 1000.0 * 0.25 / (0.25 + height * height);
    assert!((foot / exact - 1.0).abs() < 1e-4);
    let w = worst(&lumels_of(&b, "floor"), 1.0, |l| {
        l.mean(|p| scenes::polygon_irradiance(1000.0, &corners, p, DVec3::Y))
    });
    // A polygon of 16 corners differs by 1e-4 at this distance.
    assert!(w < 2.0 * GOLDEN, "{w}");
}

#[test]
fn lights_without_area_are_dropped() {
    for light in [
        json!({"type": "disk", "size": 0.0}),
        json!({"type": "rect", "size": -1.0}),
        json!({"type": "rect", "rect": {"aspect": 0.0}}),
        json!({"type": "tube"}),
    ] {
        let glb = scenes::area_light_over_floor(light.clone(), 1.0, Vec3::ONE);
        let b = bake(&glb, &at(4.0));
        let of_light =
            |w: &&lumel::mesh_ingest::Warning| w.message.contains("the light is dropped");
        assert_eq!(
            b.report.ingest.warnings.iter().filter(of_light).count(),
            1,
            "{light}"
        );
        assert!(lumels_of(&b, "floor").iter().all(|l| l.red() == 0.0));
    }
}
