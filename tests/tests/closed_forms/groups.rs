//! Light groups: their files sum to the lightmap, and each contains the light of its sources.

use std::path::Path;

use glam::{Vec2, Vec3};
use lumel::{Bake, Layer, LightGroup, LightScale, Settings, SkySource};
use lumel_tests::gltf::{Light, Material};
use lumel_tests::scenes::closed_form::Stage;
use serde_json::json;

use super::golden;
use crate::common::{Seen, at, lumels_in, lumels_in_files, lumels_of, mean};

/// Largest relative error of a number in a half float: eleven bits.
const HALF_BITS: f64 = 1.0 / 2048.0;

/// Half a step among the smallest half floats, times π, because lumels here hold irradiances.
const LEAST: f64 = std::f64::consts::PI / (1u64 << 25) as f64;

/// An open box of 1 m, white or black, with three lamps, a glowing panel on a wall, and a block on
/// the floor.
fn scene(rho: f32) -> Vec<u8> {
    let mut s = Stage::new();
    let white = s.builder.material(&Material::diffuse("wall", [rho; 3]));
    let neon = s
        .builder
        .material(&Material::emitter("neon", [0.0, 2.0, 6.0], [0.0; 3]));
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    s.panel("floor", [Vec3::ZERO, z, x], white);
    s.panel("left", [Vec3::ZERO, y, z], white);
    s.panel("right", [x, z, y], white);
    s.panel("back", [Vec3::ZERO, x, y], white);
    s.panel("neon", [Vec3::new(0.3, 0.4, 0.001), x * 0.3, y * 0.2], neon);
    s.cube(Vec3::new(0.3, 0.0, 0.4), Vec3::new(0.5, 0.2, 0.6), white);
    let radius = json!({"extras": {"lumel": {"radius": 0.1}}});
    let lamp = [Vec3::new(0.2, 0.9, 0.3), -y];
    s.lamp("lamp", Light::Point([3.0, 1.0, 0.5]), lamp, radius);
    let spot = [Vec3::new(0.8, 0.9, 0.8), Vec3::new(-0.3, -1.0, -0.2)];
    s.lamp(
        "spot",
        Light::Spot([0.2, 0.4, 4.0], 0.3, 0.6),
        spot,
        json!({}),
    );
    let sun = [y, Vec3::new(-0.5, -1.0, -0.3)];
    s.lamp("sun", Light::Directional([2.0, 1.8, 1.5]), sun, json!({}));
    s.finish()
}

fn group(name: &str, sources: &[&str]) -> LightGroup {
    LightGroup {
        name: name.into(),
        sources: sources.iter().map(|s| (*s).into()).collect(),
    }
}

fn scaled(name: &str, factor: f32) -> LightScale {
    LightScale {
        name: name.into(),
        factor,
    }
}

fn settings() -> Settings {
    Settings {
        sky: SkySource::Color([0.2, 0.3, 0.5]),
        groups: vec![
            group("lamp", &["lamp"]),
            group("spot", &["spot"]),
            group("glow", &["neon"]),
        ],
        layers: vec![Layer::Direct, Layer::Indirect],
        // Charts that end at the edges of the sun's shadows are others where it is switched off, and
        // means over lumels are compared.
        cut_charts: false,
        ..at(8.0)
    }
}

const NODES: [&str; 5] = ["floor", "left", "right", "back", "+y"];

/// The lightmap's lumels, and those of each group that the report names.
fn read(bake: &Bake, dir: &Path) -> (Vec<Seen>, Vec<Vec<Seen>>) {
    let all = |files: &[String]| -> Vec<Seen> {
        NODES
            .iter()
            .flat_map(|node| lumels_in_files(bake, dir, files, node))
            .collect()
    };
    let groups = (bake.report.groups.iter())
        .map(|g| all(&bake.group_page_names(&g.name)))
        .collect();
    (all(&bake.page_names()), groups)
}

fn files(bake: &Bake) -> (Vec<Seen>, Vec<Vec<Seen>>) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    bake.write(dir.path()).expect("written");
    read(bake, dir.path())
}

#[test]
fn groups_sum_to_the_whole_and_each_is_its_own_light() {
    let glb = scene(0.5);
    let bake = golden(&glb, &settings());
    let names: Vec<&str> = bake.report.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["lamp", "spot", "glow", "rest"]);
    let (whole, groups) = files(&bake);
    assert_they_sum(&whole, &groups);
    // Alone. Two bakes have different samples; the tolerance is the noise of the means over all
    // faces, from 128 rays in 300 lumels.
    for (g, (name, keep)) in [("lamp", "lamp"), ("spot", "spot"), ("glow", "neon")]
        .into_iter()
        .enumerate()
    {
        let alone = Settings {
            lights: vec![scaled("*", 0.0), scaled(keep, 1.0)],
            groups: Vec::new(),
            ..settings()
        };
        let (alone, _) = files(&golden(&glb, &alone));
        let (a, b) = (channel_mean(&groups[g], 2), channel_mean(&alone, 2));
        assert!((a / b - 1.0).abs() < 0.01, "{name}: {a} {b}");
    }
}

#[test]
fn groups_sum_to_the_whole_on_cut_charts() {
    // The edge of the right wall's shadow, 0.55 m, is worth a cut from 8.1 lumels a metre on.
    let cut = Settings {
        texels_per_unit: Some(16.0),
        cut_charts: true,
        ..settings()
    };
    let bake = golden(&scene(0.5), &cut);
    let notes = &bake.report.notes;
    assert!(
        notes.iter().any(|n| n.contains("charts end along")),
        "{notes:?}"
    );
    let (whole, groups) = files(&bake);
    assert_they_sum(&whole, &groups);
}

fn assert_they_sum(whole: &[Seen], groups: &[Vec<Seen>]) {
    for (i, l) in whole.iter().enumerate() {
        for c in 0..3 {
            let sum: f64 = groups.iter().map(|g| g[i].irradiance[c]).sum();
            // Each number is rounded once: one per group, and the sum. Rounding in f32 sums is
            // negligible.
            let most = HALF_BITS * 2.0 * sum.max(l.irradiance[c]) + 5.0 * LEAST;
            let off = (sum - l.irradiance[c]).abs();
            assert!(off <= most, "{i}: {sum} {}", l.irradiance[c]);
        }
    }
}

fn channel_mean(lumels: &[Seen], channel: usize) -> f64 {
    let sum: f64 = lumels.iter().map(|l| l.irradiance[channel]).sum();
    sum / lumels.len() as f64
}

#[test]
fn alone_and_in_a_group_lamps_give_the_same_direct_light() {
    // Black walls; lumels that see all of the lamps have closed forms, and so the same number in
    // every bake.
    let mut s = Stage::new();
    s.floor(Vec2::ZERO, Vec2::ONE);
    let down = |x: f32| [Vec3::new(x, 1.0, 0.3), Vec3::NEG_Y];
    let more = json!({"extras": {"lumel": {"radius": 0.2}}});
    s.lamp("a", Light::Point([3.0; 3]), down(0.1), more);
    s.lamp("b", Light::Point([2.0; 3]), down(0.9), json!({}));
    s.lamp("c", Light::Directional([1.0; 3]), down(0.5), json!({}));
    let glb = s.finish();
    let grouped = Settings {
        groups: vec![group("one", &["a"]), group("two", &["b"])],
        ..at(8.0)
    };
    let bake = golden(&glb, &grouped);
    let dir = tempfile::tempdir().expect("a temporary folder");
    bake.write(dir.path()).expect("written");
    for (name, source) in [("one", "a"), ("two", "b"), ("rest", "c")] {
        let of_group = lumels_in_files(&bake, dir.path(), &bake.group_page_names(name), "floor");
        let alone = Settings {
            lights: vec![scaled("*", 0.0), scaled(source, 1.0)],
            ..at(8.0)
        };
        let alone = lumels_of(&golden(&glb, &alone), "floor");
        for (g, a) in of_group.iter().zip(&alone) {
            // Ratios of sums over other samples round differently in f32, by at most one step of
            // half floats.
            let off = (g.red() - a.red()).abs();
            assert!(
                off <= 2.0 * HALF_BITS * a.red(),
                "{name}: {} {}",
                g.red(),
                a.red()
            );
        }
    }
}

#[test]
fn a_light_is_dimmed_or_switched_off_in_its_group() {
    let glb = scene(0.5);
    let (whole, groups) = files(&golden(&glb, &settings()));
    let half = Settings {
        lights: vec![scaled("neon", 0.5), scaled("spot", 0.0)],
        ..settings()
    };
    let bake = golden(&glb, &half);
    let names: Vec<&str> = bake.report.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["lamp", "spot", "glow", "rest"]);
    let (dimmed, parts) = files(&bake);
    let of = |g: &[Seen]| channel_mean(g, 2);
    assert_eq!(of(&parts[1]), 0.0);
    for (k, factor) in [(0, 1.0), (2, 0.5), (3, 1.0)] {
        let ratio = of(&parts[k]) / of(&groups[k]);
        // Samples of other lights change which samples these get.
        assert!((ratio / factor - 1.0).abs() < 0.01, "{k}: {ratio}");
    }
    let expected = of(&whole) - of(&groups[1]) - 0.5 * of(&groups[2]);
    assert!((of(&dimmed) / expected - 1.0).abs() < 0.01);
}

#[test]
fn one_lamp_at_half_is_half_of_it() {
    let mut s = Stage::new();
    let white = s.builder.material(&Material::diffuse("wall", [0.5; 3]));
    s.room(Vec3::ZERO, Vec3::ONE, white);
    let at_lamp = [Vec3::new(0.3, 0.6, 0.4), Vec3::NEG_Y];
    s.lamp("lamp", Light::Point([3.0; 3]), at_lamp, json!({}));
    let glb = s.finish();
    let full = golden(&glb, &at(6.0));
    let half = Settings {
        lights: vec![scaled("lamp", 0.5)],
        ..at(6.0)
    };
    let half = golden(&glb, &half);
    for node in ["-y", "+x"] {
        for (f, h) in lumels_of(&full, node).iter().zip(lumels_of(&half, node)) {
            // Every step is linear, and a half exact in binary; the solve stops at a residual
            // relative to the light.
            let off = (0.5 * f.red() - h.red()).abs();
            assert!(off <= HALF_BITS * h.red(), "{} {}", f.red(), h.red());
        }
    }
}

#[test]
fn direct_and_indirect_sum_to_the_whole() {
    let bake = golden(&scene(0.5), &settings());
    let dir = tempfile::tempdir().expect("a temporary folder");
    bake.write(dir.path()).expect("written");
    for node in NODES {
        let lumels = lumels_in(&bake, dir.path(), node);
        for l in &lumels {
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                let [d, i] =
                    ["direct", "indirect"].map(|layer| l.layer(&format!("{layer}.{name}")));
                let sum = std::f64::consts::PI * (d + i);
                let off = (sum - l.irradiance[c]).abs();
                assert!(off <= 2.0 * HALF_BITS * l.irradiance[c] + 3.0 * LEAST);
            }
        }
        assert!(mean(&lumels) > 0.0);
    }
}
