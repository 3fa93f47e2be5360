//! Mixed light: the indirect page plus the engine's direct light times the shadow mask is the full
//! bake.

use std::f64::consts::PI;
use std::path::Path;

use glam::{DVec3, Vec3};
use lumel::atlas_bake::read_exr;
use lumel::{Bake, BakeMode, Ktx2Format, Settings};
use lumel_tests::gltf::{Light, Material};
use lumel_tests::scenes::closed_form::Stage;
use serde_json::{Value, json};

use crate::common::{Seen, at, bake, lumels_in, lumels_in_files};

const LAMP: DVec3 = DVec3::new(0.6, 1.0, 0.7);
const CANDELA: f64 = 3.0;
const SUN: DVec3 = DVec3::new(-0.4, -1.0, -0.3);
const LUX: f64 = 2.0;

/// A floor and a wall with a block that casts shadows, lit by a lamp, a sun and a spot. The lamp is
/// marked as mixed on its light, the sun on its node.
fn scene() -> Vec<u8> {
    let mut s = Stage::new();
    let grey = s.builder.material(&Material::diffuse("grey", [0.6; 3]));
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    s.panel("floor", [Vec3::ZERO, z * 2.0, x * 2.0], grey);
    s.panel("wall", [Vec3::ZERO, x * 2.0, y * 1.5], grey);
    s.cube(Vec3::new(0.9, 0.0, 0.9), Vec3::new(1.2, 0.4, 1.2), grey);
    let mixed = json!({"extras": {"lumel": {"mode": "mixed"}}});
    let lamp = [LAMP.as_vec3(), -y];
    s.lamp(
        "lamp",
        Light::Point([CANDELA as f32; 3]),
        lamp,
        mixed.clone(),
    );
    let sun = [y * 3.0, SUN.as_vec3()];
    s.lamp("sun", Light::Directional([LUX as f32; 3]), sun, mixed);
    let spot = [Vec3::new(1.7, 1.0, 1.7), -y];
    let plain = json!({});
    s.lamp("spot", Light::Spot([1.0; 3], 0.3, 0.6), spot, plain);
    s.finish()
}

fn settings(mode: BakeMode) -> Settings {
    Settings {
        mode,
        ktx2: Some(Ktx2Format::Rgb9e5),
        stitch: false,
        vertex_colors: false,
        ..at(12.0)
    }
}

fn written(bake: &Bake) -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    bake.write(dir.path()).expect("written");
    dir
}

fn manifest(dir: &Path) -> Value {
    let bytes = std::fs::read(dir.join("scene.lightmap.json")).expect("a manifest");
    serde_json::from_slice(&bytes).expect("JSON")
}

/// The engine's part: E from an unoccluded lamp.
fn analytic(lamp: &str, l: &Seen) -> f64 {
    l.mean(|p| match lamp {
        "lamp" => {
            let to = LAMP - p;
            CANDELA * l.normal.dot(to.normalize()).max(0.0) / to.length_squared()
        }
        _ => LUX * l.normal.dot(-SUN.normalize()).max(0.0),
    })
}

#[test]
fn the_indirect_page_and_masked_direct_light_are_the_full_bake() {
    let full = bake(&scene(), &settings(BakeMode::Full));
    let part = bake(&scene(), &settings(BakeMode::Shadowmask));
    let (all, dir) = (written(&full), written(&part));
    let manifest = manifest(dir.path());
    assert_eq!(manifest["mode"], "shadowmask");
    let channel = |name: &str| {
        let lamps = manifest["lamps"].as_array().expect("lamps");
        let lamp = lamps.iter().find(|l| l["name"] == name).expect("the lamp");
        assert_eq!(lamp["mode"], "mixed");
        lamp["channel"].as_u64().expect("a channel") as usize
    };
    let channels = [("lamp", channel("lamp")), ("sun", channel("sun"))];
    assert_ne!(channels[0].1, channels[1].1, "both reach the floor");
    let masks = vec!["scene.shadowmask.exr".to_string()];
    let (mut shadowed, mut partly) = (0, 0);
    for node in ["floor", "wall", "+y"] {
        let whole = lumels_in(&full, all.path(), node);
        let rest = lumels_in(&part, dir.path(), node);
        let masks = lumels_in_files(&part, dir.path(), &masks, node);
        for ((w, r), m) in whole.iter().zip(&rest).zip(&masks) {
            // Lumels under the block take their neighbours' light, which no lamp gives there.
            let near = |x: f64| (0.8..1.3).contains(&x);
            if node == "floor" && near(w.middle().x) && near(w.middle().z) {
                continue;
            }
            let mask = |c: usize| match c {
                3 => m.layer("A"),
                c => m.irradiance[c] / PI,
            };
            let added: f64 = (channels.iter())
                .map(|(name, c)| analytic(name, w) * mask(*c))
                .sum();
            let sum = r.red() + added;
            // The mask is the share of irradiance that arrives, so the sum is exact up to half
            // floats (three, and the mask's) and the mean over 64 points instead of the bake's 16
            // to 128: 1 % if the whole lumel sees the lamp. A shadow edge only changes the mean of
            // the visible part, which the analytic mean does not know: within 4 %.
            let seen: Vec<f64> = channels.iter().map(|(_, c)| mask(*c)).collect();
            let sharp = seen.iter().all(|s| *s < 0.01 || *s > 0.99);
            let most = if sharp { 0.012 } else { 0.04 };
            assert!(
                (sum - w.red()).abs() <= most * w.red() + 1e-3,
                "{node}: {sum} {} {seen:?}",
                w.red()
            );
            shadowed += usize::from(seen.iter().any(|s| *s < 0.01));
            partly += usize::from(!sharp);
        }
    }
    assert!(shadowed > 20 && partly > 20, "{shadowed} {partly}");
}

#[test]
fn indirect_pages_lack_only_the_direct_light_of_marked_lamps() {
    let layers = |mode| Settings {
        layers: vec![lumel::Layer::Direct, lumel::Layer::Indirect],
        realtime: vec!["spot*".into()],
        // The lamps' shadows would cut the floor of the full bake alone.
        cut_charts: false,
        ..settings(mode)
    };
    let full = bake(&scene(), &layers(BakeMode::Full));
    let part = bake(&scene(), &layers(BakeMode::Indirect));
    let (all, dir) = (written(&full), written(&part));
    for node in ["floor", "wall"] {
        let whole = lumels_in(&full, all.path(), node);
        let rest = lumels_in(&part, dir.path(), node);
        for (w, r) in whole.iter().zip(&rest) {
            assert_eq!(r.layer("indirect.R"), w.layer("indirect.R"), "same rays");
            assert_eq!(r.layer("direct.R"), 0.0, "all three lamps are marked");
        }
    }
    assert!(!dir.path().join("scene.shadowmask.exr").exists());
    let v = manifest(dir.path());
    assert_eq!(v["mode"], "indirect");
    let modes: Vec<&str> = (v["lamps"].as_array().expect("lamps").iter())
        .map(|l| l["mode"].as_str().expect("a mode"))
        .collect();
    assert_eq!(modes, ["mixed", "mixed", "realtime"]);
}

#[test]
fn masks_stand_in_exr_and_ktx2_alike_and_the_glb_says_where() {
    let part = bake(&scene(), &settings(BakeMode::Shadowmask));
    let dir = written(&part);
    let exr = read_exr(&dir.path().join("scene.shadowmask.exr")).expect("an EXR");
    let ktx2 = std::fs::read(dir.path().join("scene.shadowmask.ktx2")).expect("a KTX2");
    // VK_FORMAT_R8G8B8A8_UNORM after the identifier.
    assert_eq!(ktx2[12..16], 37u32.to_le_bytes());
    let texels = (exr.width * exr.height) as usize;
    let data = &ktx2[ktx2.len() - 4 * texels..];
    for (c, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        let values = exr.channel(name).expect("four channels");
        for (i, v) in values.iter().enumerate() {
            // Half a step of a byte, and half a step of a half float below 1.
            let off = f32::from(data[4 * i + c]) / 255.0 - v;
            assert!(off.abs() <= 0.5 / 255.0 + 3e-4, "{name} {i}: {off}");
        }
    }
    let loaded = lumel::mesh_ingest::load(&dir.path().join("scene.glb"), &Default::default());
    let loaded = loaded.expect("the .glb");
    let nodes = loaded.document.json()["nodes"].as_array().expect("nodes");
    let mask = (nodes.iter())
        .find_map(|n| n["extras"]["lightmap"]["mask"].as_object())
        .expect("a mask");
    assert_eq!(mask["uri"], "scene.shadowmask.exr");
    assert_eq!(mask["ktx2"]["uri"], "scene.shadowmask.ktx2");
    let lamps = nodes
        .iter()
        .filter(|n| !n["extras"]["lightmapLamp"].is_null());
    assert_eq!(lamps.count(), 2);
}

#[test]
fn a_fifth_lamp_on_one_node_stays_in_the_lightmap_with_a_warning() {
    let mut s = Stage::new();
    s.floor(glam::Vec2::ZERO, glam::Vec2::ONE);
    for k in 0..5 {
        let place = [Vec3::new(0.1 + 0.2 * k as f32, 1.0, 0.5), Vec3::NEG_Y];
        let name = format!("lamp {k}");
        s.lamp(&name, Light::Point([1.0; 3]), place, json!({}));
    }
    let settings = Settings {
        mixed: vec!["lamp*".into()],
        ..settings(BakeMode::Shadowmask)
    };
    let b = bake(&s.finish(), &settings);
    let warned = b.report.warnings.iter().find(|w| w.contains("shadow mask"));
    let warned = warned.expect("a warning");
    assert!(
        warned.contains("\"lamp 4\"") && !warned.contains("\"lamp 3\""),
        "{warned}"
    );
    let v = manifest(written(&b).path());
    assert_eq!(v["lamps"].as_array().expect("lamps").len(), 4);
}
