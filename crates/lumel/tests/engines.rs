//! Tests the loaders of tools/engines: squares with known pixels, rendered in each engine.
//!
//! Each engine's test is skipped with a message if the engine is missing. three.js is vendored and
//! needs Chromium. Babylon.js and PlayCanvas also need npm packages (`LUMEL_NPM`, tools/setup.sh).
//! Bevy needs `LUMEL_BEVY`, the binary built from tools/engines/bevy, and Vulkan. Godot is
//! `LUMEL_GODOT` or `godot` on the path, and needs a display or xvfb-run. Blender needs
//! `LUMEL_VENV`, a Python environment with bpy.

#![allow(clippy::print_stderr, reason = "says what it skips")]

mod babylon;
mod balls;
mod bevy;
mod blender;
mod godot;
mod playcanvas;
mod three;

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::browser::Browser;
use crate::common::quads::{R, points, scene, shown, sun};
use crate::common::site::{Site, npm_modules};
use crate::common::{files, lumel, names, outputs, parse, temp, write};
use lumel::atlas_bake::read_exr;
use serde_json::{Value, json};
use tempfile::TempDir;

/// This name needs percent-encoding in a URL, and Bevy would parse its `#` as a label.
const STEM: &str = "four squares #1";
/// Cameras: one from high above, and one that sees the floor under the plate.
const VIEWS: [(&str, std::ops::Range<usize>); 2] =
    [("0,9,0.01,0,0,0,60", 0..5), ("3,0.6,3,0,0,0,60", 2..6)];

/// Bakes the squares with `options` at 16 lumels per metre, so that test points are more than a
/// BC6H block from the shadow's edge. Stitching is off, because it would smooth that edge as a
/// seam.
fn squares(options: &str) -> (TempDir, PathBuf) {
    let t = temp();
    let file = write(t.path().join(format!("{STEM}.gltf")), scene());
    let out = t.path().join("out");
    bake_squares(&file, &out, options);
    (t, out)
}

fn bake_squares(file: &Path, out: &Path, options: &str) {
    let more = format!(
        "--quality draft --texels-per-unit 16 --no-stitch --sun {} {options}",
        sun()
    );
    let mut a = vec![
        "bake".into(),
        file.into(),
        "-o".into(),
        out.as_os_str().to_owned(),
    ];
    a.extend(more.split_whitespace().map(Into::into));
    lumel(a).ok();
}

/// Within one 8-bit step: half a step for rounding, the rest for the storage format (`share` of the
/// value) and the GPU.
#[track_caller]
fn assert_pixel(found: [u8; 3], linear: [f64; 3], storage: &Storage, what: &str) {
    let curve = storage.curve;
    let steps = |v: f64| (curve(v * (1.0 + storage.share)) - curve(v)).max(0.0);
    let near =
        (found.iter().zip(linear)).all(|(f, v)| (f64::from(*f) - curve(v)).abs() <= 1.0 + steps(v));
    assert!(near, "{what}: {found:?} is not {:.2?}", linear.map(curve));
}

/// How values are stored and displayed.
struct Storage {
    /// Largest relative error of the page's format.
    share: f64,
    /// Maps a linear value to a byte.
    curve: fn(f64) -> f64,
}

/// sRGB with the given relative error of the page.
fn srgb(share: f64) -> Storage {
    Storage {
        share,
        curve: shown,
    }
}

/// PlayCanvas approximates sRGB by the power 1/2.2, which is off by up to two steps of 255.
fn power(share: f64) -> Storage {
    Storage {
        share,
        curve: |v| 255.0 * v.clamp(0.0, 1.0).powf(1.0 / 2.2),
    }
}

/// Checks all points, at exposure 1, through a page that reports their positions on screen.
fn look(b: &mut Browser, site: &Site, page: &str, query: &str, storage: &Storage) {
    look_exposed(b, site, page, &format!("{query}&exposure=1"), storage, 1.0);
}

/// As [`look`]; the page shows light × `shown`.
fn look_exposed(
    b: &mut Browser,
    site: &Site,
    page: &str,
    query: &str,
    storage: &Storage,
    shown: f64,
) {
    for (cam, range) in VIEWS {
        b.open("about:blank");
        b.open(&format!(
            "{}{page}?glb=/bake/four%2520squares%2520%25231.glb&cam={cam}&{query}",
            site.url
        ));
        b.wait("document.body?.dataset.state");
        assert_eq!(
            b.eval("document.body.dataset.state"),
            json!("ready"),
            "{page} {query}: {} {:?}",
            b.eval("document.body.innerText"),
            b.errors
        );
        let picture = b.screenshot();
        for (at, albedo, r) in points().into_iter().take(range.end).skip(range.start) {
            let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
            let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
            let found = picture.get_pixel(x as u32, y as u32).0;
            let what = format!("{page} {query} {at:?}");
            assert_pixel(found, albedo.map(|a| a * r * shown), storage, &what);
        }
    }
}

/// Whether the browser supports BC6H; prints a message if not.
fn has_bc6h(b: &mut Browser, site: &Site, test: &str) -> bool {
    b.open(&format!("{}/three/lumel-ktx2.js", site.url));
    b.wait("document.body");
    let extension = "document.createElement('canvas').getContext('webgl2')?.getExtension('EXT_texture_compression_bptc')";
    let has = b.eval(&format!("Boolean({extension})"));
    if has != json!(true) {
        eprintln!("SKIPPED {test} with BC6H: this browser has no EXT_texture_compression_bptc");
    }
    has == json!(true)
}

/// Whether npm packages are installed; prints a message if not.
fn installed(test: &str, packages: &[&str]) -> bool {
    let missing: Vec<_> = (packages.iter())
        .filter(|p| !npm_modules().join(p).is_dir())
        .collect();
    if !missing.is_empty() {
        eprintln!(
            "SKIPPED {test}: {missing:?} not in {} (LUMEL_NPM names its folder)",
            npm_modules().display()
        );
    }
    missing.is_empty()
}

fn document(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    parse(&glb[20..20 + length])
}

#[test]
fn ktx2_pages_are_listed_stored_well_and_retired() {
    let (t, out) = squares("--ktx2 bc6h --block-charts --group day=sun");
    let page = format!("{STEM}.lightmap.ktx2");
    let all = files(&out);
    let report = parse(&all[&format!("{STEM}.report.json")]);
    let stored = report["ktx2"].as_array().expect("a list");
    assert_eq!(stored.len(), 2, "the page and the group's: {stored:?}");
    assert_eq!(stored[0]["file"], json!(page));
    assert_eq!(stored[0]["bytes"], json!(all[&page].len()));
    // More than half of all blocks are uniform, so they are exact to the ten bits of a half.
    let error = stored[0]["error"]["p50"].as_f64().expect("a number");
    assert!(error < 2f64.powi(-10), "{error}");
    let listed: Vec<&str> = (report["content"]["outputs"]
        .as_array()
        .expect("a list")
        .iter())
    .filter_map(|o| o["file"].as_str())
    .collect();
    for name in [page.as_str(), "four squares #1.group.day.ktx2"] {
        assert!(listed.contains(&name) && all.contains_key(name), "{name}");
    }
    let manifest = parse(&all[&format!("{STEM}.lightmap.json")]);
    let named = json!({"uri": page, "format": "bc6h"});
    assert_eq!(manifest["pages"][0]["ktx2"], named);
    assert_eq!(
        manifest["groups"][0]["ktx2"],
        json!(["four squares #1.group.day.ktx2"])
    );
    let extras = document(&all[&format!("{STEM}.glb")])["nodes"][0]["extras"]["lightmap"].clone();
    assert_eq!(extras["ktx2"], named);

    // The next bake without KTX2 deletes them, because they would show outdated light. The user's
    // own file stays.
    write(out.join("other.lightmap.ktx2"), b"mine");
    let file = t.path().join(format!("{STEM}.gltf"));
    bake_squares(&file, &out, "");
    let mut expected = outputs(STEM);
    // EXR files of groups are never deleted.
    expected.extend([
        format!("{STEM}.group.day.exr"),
        "other.lightmap.ktx2".into(),
    ]);
    expected.sort();
    assert_eq!(names(&out), expected);

    let mut a = vec![
        "bake".into(),
        file.into_os_string(),
        "-o".into(),
        out.into_os_string(),
    ];
    a.extend(["-q", "--ktx2", "bc6h", "--block-align", "1"].map(Into::into));
    lumel(a).fails(1, &["--block-align 1", "multiple of 4"]);
}

#[test]
fn moz_lightmap_gives_each_node_its_own_mesh_and_each_page_its_material() {
    let (_t, out) = squares("--ext moz");
    let glb = std::fs::read(out.join(format!("{STEM}.glb"))).expect("it is written");
    let d = document(&glb);
    let nodes = d["nodes"].as_array().expect("nodes");
    let meshes: Vec<u64> = nodes.iter().filter_map(|n| n["mesh"].as_u64()).collect();
    // `flat` and `tilted` shared a mesh; the other two already had their own.
    assert_eq!(meshes.len(), 4);
    let apart: std::collections::BTreeSet<_> = meshes.iter().collect();
    assert_eq!(apart.len(), 4, "{meshes:?}");
    assert_eq!(d["meshes"].as_array().map(Vec::len), Some(4));
    let primitive = |n: usize, i: usize| &d["meshes"][meshes[n] as usize]["primitives"][i];
    // Positions stay shared, coordinates do not, and both primitives use one material.
    assert_eq!(
        primitive(0, 0)["attributes"]["POSITION"],
        primitive(1, 0)["attributes"]["POSITION"]
    );
    assert_ne!(
        primitive(0, 0)["attributes"]["TEXCOORD_1"],
        primitive(1, 0)["attributes"]["TEXCOORD_1"]
    );
    assert_eq!(primitive(0, 0)["material"], primitive(1, 0)["material"]);
    assert_eq!(primitive(0, 0)["material"], primitive(2, 0)["material"]);
    assert_ne!(primitive(2, 0)["material"], primitive(2, 1)["material"]);
    let material =
        &d["materials"][primitive(2, 1)["material"].as_u64().expect("a material") as usize];
    assert_eq!(material["name"], json!("green"));
    let moz = &material["extensions"]["MOZ_lightmap"];
    assert_eq!(moz["texCoord"], json!(1));
    let exr = read_exr(&out.join(format!("{STEM}.lightmap.exr"))).expect("it is written");
    let largest = ["R", "G", "B"]
        .iter()
        .flat_map(|c| exr.channel(c).expect("a channel"))
        .copied()
        .fold(0.0f32, f32::max);
    let intensity = moz["intensity"].as_f64().expect("a number");
    // The EXR stores it as halves.
    let expected = std::f64::consts::PI * f64::from(largest);
    assert!(
        (intensity / expected - 1.0).abs() < 1e-3,
        "{intensity} is not {expected}"
    );
    for extension in ["MOZ_lightmap", "MOZ_texture_rgbe"] {
        let used = d["extensionsUsed"].as_array().expect("a list");
        assert!(used.contains(&json!(extension)), "{used:?}");
    }
    // The coordinates now include the page rectangle, and extras and manifest say so.
    let whole = [json!([0.0, 0.0]), json!([1.0, 1.0])];
    let manifest =
        parse(std::fs::read(out.join(format!("{STEM}.lightmap.json"))).expect("it is written"));
    for place in [&nodes[0]["extras"]["lightmap"], &manifest["nodes"][0]] {
        assert_eq!([place["offset"].clone(), place["scale"].clone()], whole);
    }
    validate(&out.join(format!("{STEM}.glb")));

    let file = out.join("../four squares #1.gltf");
    let mut a = vec![
        "bake".into(),
        file.into_os_string(),
        "-o".into(),
        out.into_os_string(),
    ];
    a.extend(["-q", "--ext", "moz", "--value", "radiosity"].map(Into::into));
    lumel(a).fails(1, &["--ext moz", "radiance or irradiance"]);
}

/// Runs the Khronos validator if it is installed.
fn validate(file: &Path) {
    if !installed("the glTF validator on MOZ_lightmap", &["gltf-validator"]) {
        return;
    }
    let tool = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/validate.mjs");
    let Ok(run) = Command::new("node").arg(tool).arg(file).output() else {
        eprintln!("SKIPPED the glTF validator on MOZ_lightmap: no node");
        return;
    };
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stdout)
    );
}

/// The squares, lit by the sun as a mixed lamp in the file.
fn scene_with_sun() -> Value {
    let mut scene = parse(scene().as_bytes());
    let half = 0.5f64.sqrt();
    let nodes = scene["nodes"].as_array_mut().expect("nodes");
    nodes.push(json!({
        "name": "sun",
        // From −Z to straight down.
        "rotation": [-half, 0.0, 0.0, half],
        "extensions": {"KHR_lights_punctual": {"light": 0}},
        "extras": {"lumel": {"mode": "mixed"}},
    }));
    scene["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4]);
    scene["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let lux = R * std::f64::consts::PI;
    scene["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "directional", "intensity": lux},
    ]}});
    scene
}

/// Bakes such a scene with `options`.
fn bake_scene(scene: &Value, options: &str) -> (TempDir, PathBuf) {
    let t = temp();
    let file = write(t.path().join(format!("{STEM}.gltf")), scene.to_string());
    let out = t.path().join("out");
    let more = format!("--quality draft --texels-per-unit 16 --no-stitch {options}");
    let mut a = vec![
        "bake".into(),
        file.into(),
        "-o".into(),
        out.as_os_str().to_owned(),
    ];
    a.extend(more.split_whitespace().map(Into::into));
    lumel(a).ok();
    (t, out)
}

/// The squares with a mixed sun, baked with shadow masks.
fn squares_with_mask(options: &str) -> (TempDir, PathBuf) {
    bake_scene(&scene_with_sun(), &format!("--mode shadowmask {options}"))
}

/// The squares, lit `times` as brightly, and the suggested exposure of their page.
fn squares_times(times: f64, options: &str) -> (TempDir, PathBuf, f64) {
    let (t, out) = squares(&format!("--light sun={times} {options}"));
    let manifest = std::fs::read(out.join(format!("{STEM}.lightmap.json"))).expect("it is written");
    let exposure = parse(manifest)["exposure"].as_f64().expect("a number");
    (t, out, exposure)
}

/// The squares in lux and in millionths of a lux: both are far from what a screen can show without
/// exposure.
const BRIGHTNESSES: [f64; 2] = [4e4, 1e-4];

#[test]
fn the_bake_suggests_one_exposure_everywhere() {
    let mut shown = Vec::new();
    for times in BRIGHTNESSES {
        let (_t, out, exposure) = squares_times(times, "");
        let glb = std::fs::read(out.join(format!("{STEM}.glb"))).expect("it is written");
        let nodes = document(&glb)["nodes"].clone();
        let of = |i: usize| nodes[i]["extras"]["lightmap"]["exposure"].as_f64();
        assert_eq!([0, 1, 2, 3].map(of), [Some(exposure); 4]);
        // The documented formula, applied to the file: all lit lumels are within the middle nine
        // tenths or close to them.
        let exr = read_exr(&out.join(format!("{STEM}.lightmap.exr"))).expect("it is written");
        let lit = exr.channel("G").expect("a channel").iter();
        let lit: Vec<f64> = lit.filter(|x| **x > 0.0).map(|x| f64::from(*x)).collect();
        let log = lit.iter().map(|x| x.ln()).sum::<f64>() / lit.len() as f64;
        let level = 0.36 / log.exp();
        // The page has dilated texels too.
        assert!((exposure / level - 1.0).abs() < 0.1, "{exposure}, {level}");
        shown.push(exposure * times);
    }
    // Each has four digits.
    assert!((shown[0] / shown[1] - 1.0).abs() < 1e-3, "{shown:?}");
}

#[test]
fn no_page_shows_white_or_black_first() {
    let Some(mut b) = Browser::start("exposures", [640, 480]) else {
        return;
    };
    for times in BRIGHTNESSES {
        // The smallest halves have few digits.
        let share = if times < 1.0 { 0.01 } else { 1.0 / 512.0 };
        let (_t, out, exposure) = squares_times(times, "--ktx2 rgb9e5");
        let site = Site::start(&out);
        let mut see = |page: &str, query: &str, storage: &Storage| {
            look_exposed(&mut b, &site, page, query, storage, times * exposure);
        };
        for query in ["diffuse=1", "diffuse=1&manifest=1", "diffuse=1&plugin=1"] {
            see("/engines/index.html", query, &srgb(share));
        }
        if installed("exposures in Babylon.js", &["babylonjs", "fflate"]) {
            see("/babylon/index.html", "", &srgb(share));
        }
        if installed("exposures in PlayCanvas", &["playcanvas"]) {
            see("/playcanvas/index.html", "", &power(share));
        }
    }
    assert_eq!(b.errors, [""; 0]);
}
