//! A scene with everything at once: same bytes for any number of threads, and no energy lost.

use std::collections::BTreeMap;

use glam::Vec3;
use lumel::{
    Directional, Layer, LightGroup, LightScale, ProbeSource, Quality, Settings, SkySource, Sun,
};
use lumel_tests::gltf::{Light, Material};
use lumel_tests::scenes::closed_form::Stage;
use lumel_tests::textures;
use serde_json::json;

use super::golden;
use crate::common::at;

/// An open room with lamps of every kind, a glowing texture, a screen, glass, a blended and a
/// double-sided sheet, and an occluder.
fn scene() -> Vec<u8> {
    let mut s = Stage::new();
    let white = s
        .builder
        .material(&Material::diffuse("white", [0.7, 0.6, 0.5]));
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    s.panel("floor", [Vec3::ZERO, z, x], white);
    s.panel("left", [Vec3::ZERO, y, z], white);
    s.panel("right", [x, z, y], white);
    s.panel("back", [Vec3::ZERO, x, y], white);
    let picture = textures::masked_checker(16, 4);
    let checker = s.builder.texture("checker", &picture, true);
    let tiles = textures::tiles(16, [250, 200, 90], [20, 30, 40], [0, 0, 0]);
    let tiles = s.builder.texture("tiles", &tiles, true);
    let things = [
        Material {
            emission_texture: Some(tiles),
            ..Material::emitter("sign", [4.0, 3.0, 2.0], [0.1; 3])
        },
        Material {
            texture: Some(checker),
            mask: Some(0.5),
            double_sided: true,
            ..Material::diffuse("screen", [0.5; 3])
        },
        Material {
            transmission: 0.8,
            ..Material::diffuse("glass", [0.9, 0.5, 0.1])
        },
        Material {
            blend: Some(0.25),
            double_sided: true,
            ..Material::diffuse("veil", [0.9; 3])
        },
        Material {
            double_sided: true,
            extras: Some(json!({"lumel": {"maxReflectance": 0.5, "emitScale": 2.0}})),
            ..Material::emitter("sheet", [0.1, 0.2, 0.1], [0.9; 3])
        },
    ];
    for (i, thing) in things.iter().enumerate() {
        let material = s.builder.material(thing);
        let origin = Vec3::new(0.2 + 0.3 * i as f32, 0.3 + 0.3 * i as f32, 0.4);
        s.panel(
            &thing.name,
            [origin, Vec3::Z * 0.6, Vec3::X * 0.5],
            material,
        );
    }
    s.blocker([Vec3::new(1.2, 1.0, 1.2), Vec3::Z * 0.5, Vec3::X * 0.5]);
    let radius = json!({"extras": {"lumel": {"radius": 0.1}}, "range": 5.0});
    let place = |x: f32, z: f32| [Vec3::new(x, 1.8, z), Vec3::new(0.2, -1.0, 0.1)];
    s.lamp(
        "bulb",
        Light::Point([2.0, 1.5, 1.0]),
        place(0.5, 1.5),
        radius,
    );
    s.lamp(
        "spot",
        Light::Spot([0.5, 1.0, 3.0], 0.3, 0.7),
        place(1.5, 0.5),
        json!({}),
    );
    let disc = json!({"extras": {"lumel": {"angle": 2.0}}});
    s.lamp(
        "day",
        Light::Directional([1.0, 0.9, 0.8]),
        place(0.0, 0.0),
        disc,
    );
    s.finish()
}

#[test]
fn the_same_bytes_for_one_and_two_threads() {
    let group = |name: &str, source: &str| LightGroup {
        name: name.into(),
        sources: vec![source.into()],
    };
    let settings = Settings {
        quality: Quality::Draft,
        sky: SkySource::Color([0.1, 0.2, 0.4]),
        suns: vec![Sun {
            direction: [-1.0, -2.0, -0.5],
            lux: 3.0,
            angle: 0.53,
        }],
        lights: vec![LightScale {
            name: "spot".into(),
            factor: 0.5,
        }],
        groups: vec![group("lamps", "b*"), group("signs", "sign")],
        layers: vec![
            Layer::Direct,
            Layer::Indirect,
            Layer::Radiosity,
            Layer::Error,
            Layer::Coverage,
            Layer::Ao,
            Layer::SunMask,
        ],
        directional: Some(Directional::Sh1),
        ao_distance: Some(0.5),
        probes: Some(ProbeSource::Spacing(0.7)),
        ..at(8.0)
    };
    let glb = scene();
    let [one, two] = [1, 2].map(|threads| -> BTreeMap<String, Vec<u8>> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| {
            let (files, _) = golden(&glb, &settings).files().expect("encoded");
            // The report contains times.
            (files.into_iter())
                .filter(|f| !f.0.ends_with("report.json"))
                .collect()
        })
    });
    assert!(one.len() >= 7, "{:?}", one.keys());
    assert!(one.keys().eq(two.keys()));
    for (name, bytes) in &one {
        assert!(two[name] == *bytes, "{name} differs");
    }
}

#[test]
fn nothing_is_lost_at_preview_quality() {
    let audit = golden(&scene(), &at(2.0)).report.solve.audit;
    // `golden` checks the imbalance against its bound; this checks that the bound is not too wide.
    assert!(audit.bound < 0.03, "{}", audit.bound);
}
