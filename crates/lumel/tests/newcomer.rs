//! What a first-time user meets: errors that state what is expected, warnings before the work,
//! units of Blender's exporter.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::common::{asset, bake, files, lumel, parse, temp, write};
use lumel::atlas_bake::read_exr;
use serde_json::json;
use tempfile::TempDir;

/// A square of 2 m under a lamp of so many cd, as if written by `generator`.
fn square(t: &TempDir, generator: &str, lamp: Option<f64>) -> PathBuf {
    let corners: [[f32; 3]; 4] = [[-1., 0., 1.], [1., 0., 1.], [1., 0., -1.], [-1., 0., -1.]];
    let bytes: Vec<u8> = (corners.iter().flatten())
        .flat_map(|x| x.to_le_bytes())
        .chain([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()))
        .collect();
    let uri = format!(
        "data:application/octet-stream;base64,{}",
        base64::Engine::encode(&base64::prelude::BASE64_STANDARD, &bytes)
    );
    let mut document = json!({
        "asset": {"version": "2.0", "generator": generator},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "floor"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 60, "uri": uri}],
    });
    if let Some(intensity) = lamp {
        document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        document["extensions"] = json!({"KHR_lights_punctual": {"lights": [
            {"type": "point", "intensity": intensity}
        ]}});
        document["nodes"] = json!([{"mesh": 0, "name": "floor"}, {
            "translation": [0, 1, 0],
            "extensions": {"KHR_lights_punctual": {"light": 0}},
        }]);
        document["scenes"][0]["nodes"] = json!([0, 1]);
    }
    write(t.path().join("level.gltf"), document.to_string())
}

const BLENDER: &str = "Khronos glTF Blender I/O v5.0.21";

/// The largest value of the lightmap, and the bake's messages.
fn brightest(t: &TempDir, scene: &Path, options: &str) -> (f32, String) {
    let out = t.path().join("out");
    let run = bake(scene, &out, options).ok();
    let image = read_exr(&out.join("level.lightmap.exr")).expect("a page");
    let red = image.channel("R").expect("light");
    (red.iter().copied().fold(0.0, f32::max), run.stderr)
}

#[test]
fn a_lamp_from_blender_shines_the_same_in_all_lighting_modes() {
    let t = temp();
    let watts = 100.0;
    let per_steradian = watts / (4.0 * std::f64::consts::PI);
    let bake =
        |written: f64, options: &str| brightest(&t, &square(&t, BLENDER, Some(written)), options);
    let (right, said) = bake(per_steradian, "");
    assert!(said.contains("Lighting Mode Unitless"), "{said}");
    for (mode, written) in [("Standard", 683.0 * per_steradian), ("Raw", watts)] {
        let (found, said) = bake(written, "");
        assert!(said.contains(&format!("Lighting Mode {mode}")), "{said}");
        // The tolerance covers f32 and the 11 bits of the page's halves.
        assert!(
            (found / right - 1.0).abs() < 1e-3,
            "{mode}: {found}, {right}"
        );
    }
    let (found, said) = bake(683.0 * per_steradian, "--units watt");
    assert!(!said.contains("note:"), "{said}");
    assert!(
        (found / right / 683.0 - 1.0).abs() < 1e-3,
        "{found}, {right}"
    );
    let (found, _) = bake(683.0 * per_steradian, "--units lumen");
    assert!((found / right - 1.0).abs() < 1e-3, "{found}, {right}");
}

#[test]
fn lamps_of_others_are_left_alone() {
    let t = temp();
    let (as_it_is, said) = brightest(&t, &square(&t, "a tool", Some(683.0)), "");
    assert!(!said.contains("note:"), "{said}");
    let (watt, _) = brightest(&t, &square(&t, "a tool", Some(683.0)), "--units watt");
    assert_eq!(as_it_is, watt);
}

#[test]
fn darkness_is_foretold_and_told_once() {
    let t = temp();
    let (value, said) = brightest(&t, &square(&t, BLENDER, None), "");
    assert_eq!(value, 0.0);
    let before = said.split("  ingest").next().unwrap_or_default();
    assert!(before.contains("Punctual Lights"), "{said}");
    assert_eq!(said.matches("will be black").count(), 1, "{said}");
    assert!(!said.contains("the lightmap is black"), "{said}");
    let report = parse(&files(&t.path().join("out"))["level.report.json"]);
    let warnings = report["warnings"].as_array().expect("a list");
    let told = |w: &&serde_json::Value| w.as_str().is_some_and(|w| w.contains("will be black"));
    assert_eq!(warnings.iter().filter(told).count(), 1, "{warnings:?}");
}

#[test]
fn a_sky_that_is_no_colour_says_what_one_is() {
    let t = temp();
    let run = bake(&asset("cornell_box.glb"), t.path(), "-q --sky blue");
    run.fails(1, &["--sky blue", "R,G,B", "#88aaff", ".hdr"]);
}

#[test]
fn an_absurd_density_ends_before_the_work() {
    let t = temp();
    let scene = square(&t, "a tool", None);
    let out = t.path().join("out");
    let options = ["-q", "--texels-per-unit", "1e9", "-o"].map(AsRef::<OsStr>::as_ref);
    let run = lumel(
        ["bake".as_ref(), scene.as_os_str()]
            .into_iter()
            .chain(options)
            .chain([out.as_os_str()]),
    );
    // For 4 m²: √(2³⁰ / 4).
    run.fails(1, &["1000000000", "16384 texels per unit"]);
}

#[test]
fn progress_for_programs_covers_the_whole_bake_and_never_falls() {
    let t = temp();
    let run = bake(&asset("cornell_box.glb"), t.path(), "--progress lines").ok();
    let shares: Vec<f64> = (run.stderr.lines())
        .filter_map(|l| l.strip_prefix("progress ")?.split(' ').next()?.parse().ok())
        .collect();
    assert!(!shares.is_empty() && shares.is_sorted(), "{}", run.stderr);
    assert!(
        shares.iter().all(|s| (0.0..=100.0).contains(s)),
        "{shares:?}"
    );
}

#[test]
fn the_file_of_settings_and_the_manual_are_whole() {
    let config = lumel(["config"]).ok().stdout;
    assert!(config.contains("\"draft\", \"quick\", \"preview\", \"production\""));
    assert!(config.contains("#units = \"auto\""));
    let page = lumel(["man", "bake"]).ok().stdout;
    let heading = page.lines().find(|l| l.starts_with(".TH")).unwrap_or("");
    let version = concat!("\"lumel ", env!("CARGO_PKG_VERSION"), "\"");
    assert!(heading.starts_with(".TH LUMEL-BAKE 1 2"), "{heading}");
    assert!(
        heading.contains(version) && heading.ends_with("\"Lumel Manual\""),
        "{heading}"
    );
}

/// The published crate needs its own copy of the loader in tools/engines/three.
#[test]
fn the_viewer_has_the_loader_of_three() {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &str| std::fs::read_to_string(own.join(path)).expect("a loader");
    let theirs = read("../../tools/engines/three/lumel-lightmap.js");
    assert!(
        read("web/lumel-lightmap.js") == theirs,
        "copy tools/engines/three/lumel-lightmap.js to crates/lumel/web"
    );
}

/// What tools/publish.sh sends to the registry can be used there: with licences and a first page.
#[test]
fn every_published_crate_carries_its_licences_and_is_in_the_script() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let script = std::fs::read_to_string(root.join("tools/publish.sh")).expect("the script");
    for entry in std::fs::read_dir(root.join("crates")).expect("the crates") {
        let folder = entry.expect("a crate").path();
        let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).expect("its manifest");
        if manifest.contains("publish = false") {
            continue;
        }
        let name = manifest.lines().find_map(|l| l.strip_prefix("name = "));
        let name = name.expect("a name").trim_matches('"');
        assert!(
            script.split_whitespace().any(|word| word == name),
            "{name} is not in tools/publish.sh"
        );
        for file in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
            assert!(folder.join(file).is_file(), "{name} has no {file}");
        }
    }
}
