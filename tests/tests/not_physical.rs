//! The artists' knobs: each does exactly what its documentation says, and the report lists it.

use std::f64::consts::PI;

use glam::Vec3;
use lumel::{Bake, Layer, NotPhysical, Settings, SkySource};
use lumel_tests::geometry::room;
use lumel_tests::gltf::{GltfBuilder, Material, Node};
use lumel_tests::scenes::closed_form::Stage;

use crate::common::{Seen, at, bake, lumels_of};

/// Rows sum to 1, and rays see only emission and patches that all have the same light, so only the
/// residual of the solve (1e-4) and half floats (5e-4) remain. See closed_forms/enclosures.rs.
const FURNACE: f64 = 2e-3;

fn knobs(change: impl FnOnce(&mut NotPhysical)) -> Settings {
    let mut settings = Settings {
        vertex_colors: true,
        ..at(4.0)
    };
    change(&mut settings.not_physical);
    settings
}

/// A closed cube whose walls emit radiance 1 and reflect `rho`.
fn furnace(rho: [f32; 3]) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let glow = b.material(&Material::emitter("glow", [1.0; 3], rho));
    let mesh = b.mesh("room", &[(&room(-Vec3::ONE, Vec3::ONE, 1).bare(), glow)]);
    b.node(Node::of_mesh("room", mesh));
    b.finish()
}

#[track_caller]
fn holds(bake: &Bake, exact: [f64; 3]) {
    for l in lumels_of(bake, "room") {
        for (found, exact) in l.irradiance.into_iter().zip(exact) {
            assert!((found / exact - 1.0).abs() < FURNACE, "{found} {exact}");
        }
    }
    let vertices = bake.baked.vertices.instances.iter().flatten().flatten();
    for e in vertices.flat_map(|e| e.iter().zip(exact)) {
        assert!((f64::from(*e.0) / e.1 - 1.0).abs() < FURNACE, "{e:?}");
    }
}

#[test]
fn in_a_furnace_each_knob_has_a_closed_form() {
    let grey = furnace([0.5; 3]);
    // E = πL + ρE, and the reflected part ρE = πL ρ/(1 − ρ) counts three times.
    let b = bake(&grey, &knobs(|k| k.indirect_boost = 3.0));
    holds(&b, [PI * (1.0 + 3.0); 3]);
    assert_eq!(b.report.not_physical, ["light that surfaces reflected × 3"]);
    let b = bake(&grey, &knobs(|k| k.emissive_boost = 0.25));
    holds(&b, [0.25 * PI / 0.5; 3]);
    let b = bake(&grey, &knobs(|k| k.albedo_boost = 1.4));
    holds(&b, [PI / (1.0 - 0.7); 3]);
    // Clamped to --max-reflectance.
    let clamped = Settings {
        max_reflectance: 0.8,
        ..knobs(|k| k.albedo_boost = 10.0)
    };
    holds(&bake(&grey, &clamped), [PI / (1.0 - 0.8); 3]);
    let rho = [0.8f64, 0.3, 0.1];
    let y = 0.2126 * rho[0] + 0.7152 * rho[1] + 0.0722 * rho[2];
    let red = furnace([0.8, 0.3, 0.1]);
    for s in [0.0, 0.5] {
        let b = bake(&red, &knobs(|k| k.bounce_saturation = s as f32));
        holds(&b, rho.map(|x| PI / (1.0 - (y + s * (x - y)))));
    }
}

/// A floor under a sky of 1, with a wall that hides half of it from lumels at its foot.
fn wall() -> Vec<u8> {
    let mut s = Stage::new();
    let grey = s.builder.material(&Material::diffuse("grey", [0.3; 3]));
    s.panel("floor", [Vec3::ZERO, Vec3::Z * 2.0, Vec3::X * 2.0], grey);
    s.panel("wall", [Vec3::ZERO, Vec3::Y * 2.0, Vec3::Z * 2.0], grey);
    s.finish()
}

fn under_sky(change: impl FnOnce(&mut NotPhysical)) -> Vec<Seen> {
    let settings = Settings {
        sky: SkySource::Color([1.0, 0.5, 0.25]),
        layers: vec![Layer::Ao, Layer::Direct, Layer::Indirect],
        stitch: false,
        ..knobs(change)
    };
    lumels_of(&bake(&wall(), &settings), "floor")
}

#[test]
fn occlusion_and_floor_act_on_every_lumel_alone() {
    let plain = under_sky(|_| ());
    let both = under_sky(|k| {
        k.ao_multiply = 0.5;
        k.ambient_floor = [0.7, 0.0, 0.2];
    });
    let (mut darker, mut raised) = (0, 0);
    for (a, b) in plain.iter().zip(&both) {
        let factor = 1.0 - 0.5 * (1.0 - a.layer("ao.Y"));
        for (c, floor) in [0.7, 0.0, 0.2].into_iter().enumerate() {
            let wanted = (a.irradiance[c] * factor).max(floor * PI);
            // Three roundings to half floats.
            assert!((b.irradiance[c] / wanted - 1.0).abs() < 3e-3);
            raised += usize::from(wanted == floor * PI);
        }
        darker += usize::from(factor < 0.9);
        for layer in ["ao.Y", "direct.R", "indirect.G"] {
            assert_eq!(a.layer(layer), b.layer(layer), "layers stay");
        }
    }
    assert!(darker > 5 && raised > 5, "{darker} {raised}");
}

#[test]
fn vertices_have_the_floor_too() {
    let settings = knobs(|k| k.ambient_floor = [2.0, 0.0, 3.0]);
    let b = bake(&wall(), &settings);
    for e in b.baked.vertices.instances.iter().flatten().flatten() {
        let pi = std::f32::consts::PI;
        assert_eq!(*e, [2.0 * pi, 0.0, 3.0 * pi], "a dark level");
    }
}
