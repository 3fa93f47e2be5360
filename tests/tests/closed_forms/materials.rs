//! Sides of surfaces, and the effect of `extras.lumel` on them.

use std::f64::consts::PI;

use glam::{Vec2, Vec3};
use lumel::Settings;
use lumel_tests::gltf::{Light, Material, Node};
use lumel_tests::scenes::closed_form::{
    Stage, form_factor_opposed_squares, polygon_irradiance, square,
};
use lumel_tests::scenes::{FurnaceShape, furnace};
use serde_json::{Value, json};

use super::{GOLDEN, HALF, SMOOTH, golden, production};
use crate::common::{Seen, at, lumels_of, mean, worst};

/// A level square of 1 m at this height about the y axis; its front is up or down.
fn level(height: f32, up: bool) -> [Vec3; 3] {
    let (u, v) = if up {
        (Vec3::Z, Vec3::X)
    } else {
        (Vec3::X, Vec3::Z)
    };
    [Vec3::new(-0.5, height, -0.5), u, v]
}

fn lumel(member: &str, value: impl Into<Value>) -> Option<Value> {
    Some(json!({"lumel": {member: value.into()}}))
}

/// A sheet at y = 0 whose front faces down, under a low sun from above of 2 lux on level ground,
/// and a black plate above it that faces down.
fn sheet_lit_from_behind(double_sided: bool) -> Vec<u8> {
    let mut s = Stage::new();
    let material = s.builder.material(&Material {
        double_sided,
        ..Material::diffuse("sheet", [0.5; 3])
    });
    s.panel("sheet", level(0.0, false), material);
    s.panel("plate", level(1.0, false), s.black);
    let lux = 2.0 * 5f32.sqrt();
    let along = Vec3::new(-2.0, -1.0, 0.0);
    s.lamp(
        "sun",
        Light::Directional([lux; 3]),
        [Vec3::Y, along],
        json!({}),
    );
    s.finish()
}

#[test]
fn the_back_of_a_double_sided_sheet_reflects_and_of_a_single_sided_one_is_black() {
    let bake = golden(&sheet_lit_from_behind(true), &production(8.0));
    let exact = 0.5 * 2.0 * form_factor_opposed_squares(1.0);
    let e = mean(&lumels_of(&bake, "plate"));
    assert!((e / exact - 1.0).abs() < GOLDEN, "{e} {exact}");
    // Nobody sees the front, which faces the void, so the lightmap holds the light of the back. It
    // has no noise, only the rounding of half floats (2⁻¹¹).
    for l in lumels_of(&bake, "sheet") {
        assert!((l.red() - 2.0).abs() < 2.0 * 5e-4, "{}", l.red());
    }
    let bake = golden(&sheet_lit_from_behind(false), &at(8.0));
    for node in ["sheet", "plate"] {
        for l in lumels_of(&bake, node) {
            assert_eq!(l.irradiance, [0.0; 3], "{node}");
        }
    }
}

#[test]
fn a_double_sided_lamp_shines_both_ways() {
    let mut s = Stage::new();
    let lamp = s.builder.material(&Material {
        double_sided: true,
        ..Material::emitter("lamp", [3.0; 3], [0.0; 3])
    });
    s.panel("lamp", level(0.0, true), lamp);
    s.panel("above", level(1.0, false), s.black);
    s.panel("below", level(-1.0, true), s.black);
    let bake = golden(&s.finish(), &production(12.0));
    for node in ["above", "below"] {
        let lumels = lumels_of(&bake, node);
        let exact = |l: &Seen| l.mean(|p| polygon_irradiance(3.0, &square(1.0, 0.0), p, l.normal));
        let (sum, all) = (lumels.iter()).fold((0.0, 0.0), |s, l| (s.0 + l.red(), s.1 + exact(l)));
        assert!((sum / all - 1.0).abs() < GOLDEN, "{node}: {}", sum / all);
        // The panel is wide and dim, so gathering rays find it: at least 512, a fifth of which hit
        // it; a spread of 0.4 % was measured.
        let w = worst(&lumels, 0.0, exact);
        assert!(w < 0.02, "{node}: {w}");
    }
}

/// A floor of 1 m under a sun of 2 lux straight above, and half a metre above it a sheet of the
/// same size with this material, on a node with `extras`.
fn with_thing(material: &Material, extras: Option<Value>) -> Vec<u8> {
    let mut s = Stage::new();
    s.floor(Vec2::splat(-0.5), Vec2::splat(0.5));
    let thing = s.builder.material(material);
    let panel = level(0.5, true);
    let mut g = lumel_tests::geometry::grid(panel[0], panel[1], panel[2], [1, 1]);
    g.normals.clear();
    let mesh = s.builder.mesh("thing", &[(&g.bare(), thing)]);
    s.builder.node(Node {
        extras,
        ..Node::of_mesh("thing", mesh)
    });
    let above = [Vec3::Y * 2.0, Vec3::NEG_Y];
    s.lamp("sun", Light::Directional([2.0; 3]), above, json!({}));
    s.finish()
}

/// Whether the bake has lumels of this node.
fn has_lumels(bake: &lumel::Bake, node: &str) -> bool {
    let instances = &bake.loaded.scene.instances;
    let Some(i) = instances.iter().position(|i| i.name == node) else {
        return false;
    };
    let rect = bake.layout.placements[i].rect;
    rect.w > 0 && rect.h > 0
}

#[test]
fn what_is_excluded_is_not_there() {
    let white = Material {
        double_sided: true,
        ..Material::diffuse("white", [0.8; 3])
    };
    let marked = Material {
        extras: lumel("exclude", true),
        ..white.clone()
    };
    for (material, extras) in [(&white, lumel("exclude", true)), (&marked, None)] {
        let bake = golden(&with_thing(material, extras), &at(8.0));
        let w = worst(&lumels_of(&bake, "floor"), 0.0, |_| 2.0);
        assert!(w < HALF, "{w}");
        assert!(!has_lumels(&bake, "thing"));
    }
    // Without `exclude`, the sheet shadows the floor.
    let bake = golden(&with_thing(&white, None), &at(8.0));
    assert!(mean(&lumels_of(&bake, "floor")) < 0.5);
    assert!(has_lumels(&bake, "thing"));
}

#[test]
fn an_occluder_casts_shadows_and_nothing_else() {
    let glowing = Material {
        double_sided: true,
        ..Material::emitter("white", [5.0; 3], [0.8; 3])
    };
    let marked = Material {
        extras: lumel("occluder", true),
        ..glowing.clone()
    };
    for (material, extras) in [(&glowing, lumel("occluder", true)), (&marked, None)] {
        let bake = golden(&with_thing(material, extras), &at(8.0));
        for l in lumels_of(&bake, "floor") {
            // The sun stands straight above, and the occluder is as large as the floor.
            assert_eq!(l.irradiance, [0.0; 3]);
        }
        assert!(!has_lumels(&bake, "thing"));
    }
}

#[test]
fn emission_is_scaled() {
    for scale in [0.0, 0.25, 40.0] {
        let mut s = Stage::new();
        s.floor(Vec2::splat(-0.5), Vec2::splat(0.5));
        let lamp = s.builder.material(&Material {
            extras: lumel("emitScale", scale),
            ..Material::emitter("lamp", [3.0; 3], [0.0; 3])
        });
        s.panel("lamp", level(1.0, false), lamp);
        let lumels = lumels_of(&golden(&s.finish(), &production(12.0)), "floor");
        let corners = square(1.0, 1.0);
        let exact = |l: &Seen| l.mean(|p| polygon_irradiance(3.0 * scale, &corners, p, l.normal));
        let (sum, all) = (lumels.iter()).fold((0.0, 0.0), |s, l| (s.0 + l.red(), s.1 + exact(l)));
        assert!((sum - all).abs() <= GOLDEN * all, "{scale}: {sum} {all}");
    }
}

/// The cube of [`furnace`] with `extras` on its material.
fn furnace_with(rho: f32, extras: Option<Value>) -> Vec<u8> {
    let mut s = Stage::new();
    let wall = s.builder.material(&Material {
        extras,
        ..Material::emitter("wall", [1.0; 3], [rho; 3])
    });
    s.room(Vec3::splat(-1.0), Vec3::ONE, wall);
    s.finish()
}

#[test]
fn reflectances_are_clamped_and_counted() {
    let limited = |x: f32| Settings {
        max_reflectance: x,
        ..at(4.0)
    };
    // ρ, the material's limit, the settings', the effective one, and the number of changed
    // materials.
    for (rho, own, settings, holds, changed) in [
        (0.5, None, at(4.0), 0.5, 0),
        (1.0, None, at(4.0), 0.98, 1),
        (0.9, Some(0.6), at(4.0), 0.6, 1),
        (0.9, Some(0.95), limited(0.8), 0.8, 1),
        (0.9, None, limited(0.5), 0.5, 1),
    ] {
        let glb = furnace_with(rho, own.and_then(|x: f64| lumel("maxReflectance", x)));
        let bake = golden(&glb, &settings);
        let exact = PI / (1.0 - holds);
        let w = worst(&lumels_of(&bake, "-x"), 0.0, |_| exact);
        // Errors of the rows grow by 1/(1 − ρ), to 50 times.
        assert!(w < SMOOTH, "ρ {rho}, limit {own:?}: {w}");
        assert_eq!(bake.report.clamped_materials, changed, "ρ {rho}");
        // `furnace` makes the same cube.
        if own.is_none() && rho == 0.5 {
            let twin = golden(&furnace(rho, 1.0, FurnaceShape::Cube), &settings);
            let m = mean(&lumels_of(&twin, "furnace"));
            assert!((m / exact - 1.0).abs() < HALF, "{m}");
        }
    }
}
