//! Tests the loaders of tools/engines: squares with known pixels, rendered in each engine.
//!
//! Each engine's test is skipped with a message if the engine is missing. three.js is vendored and
//! needs Chromium. Babylon.js and PlayCanvas also need npm packages (`LUMEL_NPM`, tools/setup.sh).
//! Bevy needs `LUMEL_BEVY`, the binary built from tools/engines/bevy, and Vulkan. Godot is
//! `LUMEL_GODOT` or `godot` on the path, and needs a display or xvfb-run. Blender needs
//! `LUMEL_VENV`, a Python environment with bpy.

#![allow(clippy::print_stderr, reason = "says what it skips")]

mod bevy;
mod godot;

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::browser::Browser;
use crate::common::quads::{ALBEDO, R, points, scene, shown, sun};
use crate::common::site::{Site, npm_modules};
use crate::common::{asset, files, lumel, names, outputs, parse, temp, write};
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

#[test]
fn three_js_shows_ktx2_pages() {
    for (options, share) in [
        // Half a step of rgb9e5 is 2^-9 of the largest channel. For BC6H it is relative to the
        // block, and all blocks but those at the shadow are uniform.
        ("--ktx2 rgb9e5", 1.0 / 512.0),
        ("--ktx2 bc6h --block-charts", 1.0 / 512.0),
    ] {
        let Some(mut b) = Browser::start("three.js with KTX2", [640, 480]) else {
            return;
        };
        let (_t, out) = squares(options);
        let site = Site::start(&out);
        if options.contains("bc6h") && !has_bc6h(&mut b, &site, "three.js") {
            return;
        }
        look(
            &mut b,
            &site,
            "/engines/index.html",
            "diffuse=1&ktx2=1",
            &srgb(share),
        );
        assert_eq!(b.errors, [""; 0]);
    }
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

#[test]
fn three_js_adds_mixed_lamps_through_shadow_masks() {
    for (options, query) in [("", "diffuse=1"), ("--ktx2 rgb9e5", "diffuse=1&ktx2=1")] {
        let Some(mut b) = Browser::start("three.js with shadow masks", [640, 480]) else {
            return;
        };
        let (_t, out) = squares_with_mask(options);
        // Without the sun's direct light, the page has no light here.
        let page = read_exr(&out.join(format!("{STEM}.lightmap.exr"))).expect("a page");
        let all = ["R", "G", "B"].map(|c| page.channel(c).expect("a channel").to_vec());
        let most = all.into_iter().flatten().fold(0.0, f32::max);
        assert!(most < 0.05 * R as f32, "{most}");
        let site = Site::start(&out);
        // Bounces between the squares are below a step of 255; the mask is exact away from edges.
        look(
            &mut b,
            &site,
            "/engines/index.html",
            query,
            &srgb(1.0 / 128.0),
        );
        assert_eq!(b.errors, [""; 0]);
    }
}

/// A mixed spot projects its picture: on the floor under it, each quarter has the colour of its
/// quarter of the picture, with +Y of the node at the top.
#[test]
fn three_js_projects_cookies_of_mixed_spots() {
    let Some(mut b) = Browser::start("three.js with cookies", [640, 480]) else {
        return;
    };
    let quarters: [[u8; 3]; 4] = [[255, 60, 60], [60, 255, 60], [60, 60, 255], [255, 255, 60]];
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_fn(64, 64, |x, y| {
        image::Rgb(quarters[usize::from(x >= 32) + 2 * usize::from(y >= 32)])
    })
    .write_to(&mut png, image::ImageFormat::Png)
    .expect("a picture");
    use base64::Engine;
    let png = base64::engine::general_purpose::STANDARD.encode(png.into_inner());
    let mut scene = scene_with_sun();
    scene["images"] = json!([{"uri": format!("data:image/png;base64,{png}")}]);
    scene["textures"] = json!([{"source": 0}]);
    // Over the square at x = -4, looking down; +Y of the node is −X of the world.
    let (height, candela) = (2.0, 4.0);
    scene["nodes"][4]["translation"] = json!([-4.0, height, 0.0]);
    scene["nodes"][4]["rotation"] = json!([-0.5, 0.5, 0.5, 0.5]);
    scene["extensions"]["KHR_lights_punctual"]["lights"] = json!([{
        "type": "spot", "intensity": candela,
        "spot": {"innerConeAngle": 0.6, "outerConeAngle": 0.7},
        "extras": {"lumel": {"cookie": 0}},
    }]);
    for mode in ["", "--mode shadowmask"] {
        let (_t, out) = bake_scene(&scene, mode);
        let site = Site::start(&out);
        b.open("about:blank");
        b.open(&format!(
            "{}/engines/index.html?glb=/bake/four%2520squares%2520%25231.glb&cam={}&diffuse=1&exposure=1",
            site.url, VIEWS[0].0
        ));
        b.wait("document.body?.dataset.state");
        let picture = b.screenshot();
        // The picture's right is +X of the node, −Z of the world; its top −X.
        for (i, quarter) in quarters.into_iter().enumerate() {
            let right = if i % 2 == 1 { -0.4 } else { 0.4 };
            let down = if i >= 2 { 0.4 } else { -0.4 };
            let at = [-4.0 + down, 0.0, right];
            let square: f64 = height * height + 0.32;
            let r = candela * height / square.powf(1.5) / std::f64::consts::PI;
            let linear: [f64; 3] = std::array::from_fn(|c| {
                let v = f64::from(quarter[c]) / 255.0;
                let v = if v <= 0.04045 {
                    v / 12.92
                } else {
                    ((v + 0.055) / 1.055).powf(2.4)
                };
                ALBEDO[c] * r * v
            });
            let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
            let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
            let found = picture.get_pixel(x as u32, y as u32).0;
            // A pixel is 3 cm wide, of which the light changes by up to 1 %.
            assert_pixel(found, linear, &srgb(0.02), &format!("{mode} {i}"));
        }
    }
    assert_eq!(b.errors, [""; 0]);
}

/// The radiance of a white diffuse surface with the normal `n`, as docs/probes.md writes it.
fn probe_diffuse(sh: &[[f64; 3]; 9], n: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = n;
    [0, 1, 2].map(|c| {
        let s = |k: usize| sh[k][c];
        (0.282095 * s(0)
            + 0.325735 * (s(1) * y + s(2) * z + s(3) * x)
            + 0.273137 * (s(4) * x * y + s(5) * y * z + s(7) * x * z)
            + 0.078848 * s(6) * (3.0 * z * z - 1.0)
            + 0.136569 * s(8) * (x * x - y * y))
            .max(0.0)
    })
}

/// The harmonics of a grid of probes.
struct ProbeGrid {
    file: Value,
}

impl ProbeGrid {
    fn numbers(&self, key: &str) -> [f64; 3] {
        [0, 1, 2].map(|i| self.file["grid"][key][i].as_f64().expect("a number"))
    }

    fn probe(&self, index: [f64; 3]) -> [[f64; 3]; 9] {
        let [nx, ny, _] = self.numbers("dims");
        let at = (index[0] + nx * (index[1] + ny * index[2])) as usize;
        let sh = &self.file["probes"][at]["sh"];
        std::array::from_fn(|k| [0, 1, 2].map(|c| sh[k][c].as_f64().expect("a number")))
    }

    /// Trilinear between the eight probes around `at`.
    fn around(&self, at: [f64; 3]) -> [[f64; 3]; 9] {
        let [origin, spacing, dims] = ["origin", "spacing", "dims"].map(|k| self.numbers(k));
        let place: [f64; 3] =
            std::array::from_fn(|i| ((at[i] - origin[i]) / spacing[i]).clamp(0.0, dims[i] - 1.0));
        let mut sum = [[0.0; 3]; 9];
        for corner in 0..8 {
            let far = [0, 1, 2].map(|i| f64::from((corner >> i) & 1));
            let index: [f64; 3] =
                std::array::from_fn(|i| (place[i].floor() + far[i]).min(dims[i] - 1.0));
            let weight: f64 = (0..3)
                .map(|i| 1.0 - (place[i] - place[i].floor() - far[i]).abs())
                .product();
            for (to, from) in sum
                .as_flattened_mut()
                .iter_mut()
                .zip(self.probe(index).as_flattened())
            {
                *to += weight * from;
            }
        }
        sum
    }
}

/// The Cornell box with probes at every metre.
fn cornell_with_probes(options: &str) -> (TempDir, PathBuf, ProbeGrid) {
    let t = temp();
    let out = t.path().join("out");
    let file = asset("cornell_box.glb");
    let paths = [&file, &out].map(|p| p.to_str().expect("UTF-8"));
    let options = format!("--quality draft --texels-per-unit 16 --probes 1 {options}");
    let a = ["bake", paths[0], "-o", paths[1]];
    lumel(a.into_iter().chain(options.split_whitespace())).ok();
    let json = std::fs::read(out.join("cornell_box.probes.json")).expect("it is written");
    (t, out, ProbeGrid { file: parse(json) })
}

/// Place and radius of a white ball in the Cornell box, and normals that its camera sees.
const BALL: ([f64; 3], f64) = ([2.9, 2.5, 2.6], 0.45);
const BALL_CAMERA: &str = "2.78,2.73,-8,2.78,2.73,0,39";
const NORMALS: [[f64; 3]; 5] = [
    [0.0, 0.0, -1.0],
    [0.6, 0.0, -0.8],
    [-0.6, 0.0, -0.8],
    [0.0, 0.6, -0.8],
    [0.0, -0.6, -0.8],
];

/// A white ball in the Cornell box: each of its points shows R = E/π of the probes, and the walls
/// show their lightmap only.
#[test]
fn three_js_lights_moving_objects_by_probes() {
    let Some(mut b) = Browser::start("three.js with probes", [640, 480]) else {
        return;
    };
    let (_t, out, grid) = cornell_with_probes("");
    let site = Site::start(&out);
    let (ball, radius) = BALL;
    let nearest = (0..grid.file["probes"].as_array().expect("probes").len())
        .min_by(|i, j| {
            let far = |k: &usize| -> f64 {
                let at = &grid.file["probes"][*k]["position"];
                (0..3)
                    .map(|i| (at[i].as_f64().expect("a number") - ball[i]).powi(2))
                    .sum()
            };
            far(i).total_cmp(&far(j))
        })
        .expect("a probe");
    let nearest = std::array::from_fn(|k| {
        [0, 1, 2].map(|c| {
            grid.file["probes"][nearest]["sh"][k][c]
                .as_f64()
                .expect("a number")
        })
    });
    let spacing = grid.numbers("spacing");
    let exposure = 0.5;
    let mut walls = Vec::new();
    for probes in ["one", "grid", "none"] {
        let place = if probes == "none" {
            String::new()
        } else {
            format!(
                "&ball={},{},{},{radius}&probes={probes}",
                ball[0], ball[1], ball[2]
            )
        };
        let cam = BALL_CAMERA;
        b.open("about:blank");
        b.open(&format!(
            "{}/engines/index.html?glb=/bake/cornell_box.glb&diffuse=1&exposure={exposure}&cam={cam}{place}",
            site.url
        ));
        b.wait("document.body?.dataset.state");
        let said = b.eval("document.body.innerText");
        assert_eq!(
            b.eval("document.body.dataset.state"),
            json!("ready"),
            "{said} {:?}",
            b.errors
        );
        let picture = b.screenshot();
        let mut pixel = |at: [f64; 3]| {
            let place = b.eval(&format!("lumel.project({}, {}, {})", at[0], at[1], at[2]));
            let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
            picture.get_pixel(x as u32, y as u32).0
        };
        walls.push([[0.02, 4.0, 2.8], [5.52, 4.0, 2.8], [2.8, 4.6, 5.59]].map(&mut pixel));
        if probes == "none" {
            continue;
        }
        for n in NORMALS {
            let on: [f64; 3] = std::array::from_fn(|i| ball[i] + radius * n[i]);
            // three.js reads half a cell in front of the surface.
            let before = std::array::from_fn(|i| on[i] + 0.5 * spacing[i] * n[i]);
            let sh = if probes == "one" {
                nearest
            } else {
                grid.around(before)
            };
            let shown = probe_diffuse(&sh, n).map(|r| r * exposure);
            // Harmonics are halves; a pixel's normal is up to 1 degree from n.
            assert_pixel(pixel(on), shown, &srgb(0.02), &format!("{probes} {n:?}"));
        }
    }
    assert_eq!(walls[0], walls[2]);
    assert_eq!(walls[1], walls[2]);
    assert_eq!(b.errors, [""; 0]);
}

/// The radiance at a glTF direction of a cube map as the bake writes it: rgb9e5, left-handed, z
/// negated.
fn captured(file: &[u8], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
    let (size, offset) = (word(20) as usize, word(80) as usize);
    let c = [x, y, -z];
    let most = c.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let [cx, cy, cz] = c;
    // Vulkan 1.3, table of cube map coordinates: face, s and t.
    let (face, s, t) = if cx.abs() == most {
        (usize::from(cx < 0.0), -cx.signum() * cz, -cy)
    } else if cy.abs() == most {
        (2 + usize::from(cy < 0.0), cx, cy.signum() * cz)
    } else {
        (4 + usize::from(cz < 0.0), cz.signum() * cx, -cy)
    };
    let texel = |v: f64| (((v / most + 1.0) * 0.5 * size as f64) as usize).min(size - 1);
    let packed = word(offset + 4 * ((face * size + texel(t)) * size + texel(s)));
    let scale = 2f64.powi((packed >> 27) as i32 - 24);
    [0, 9, 18].map(|shift| f64::from((packed >> shift) & 511) * scale)
}

/// Place and radius of a mirror ball in the Cornell box, and the eye that looks at it.
const MIRROR: ([f64; 3], f64) = ([2.9, 2.5, 2.6], 0.6);
const MIRROR_EYE: [f64; 3] = [2.78, 2.73, -3.0];

fn mirror_camera() -> String {
    let ([x, y, z], [ex, ey, ez]) = (MIRROR.0, MIRROR_EYE);
    format!("{ex},{ey},{ez},{x},{y},{z},39")
}

/// The Cornell box with a reflection capture at the mirror ball, as box.glb, and its cube map.
fn cornell_with_capture() -> (TempDir, PathBuf, Vec<u8>) {
    let t = temp();
    let out = t.path().join("out");
    // A node with the mark, put into the .glb's JSON.
    let glb = std::fs::read(asset("cornell_box.glb")).expect("it is there");
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let mut json = document(&glb);
    let nodes = json["nodes"].as_array_mut().expect("nodes");
    let mark = nodes.len();
    nodes.push(json!({
        "name": "here", "translation": MIRROR.0, "extras": {"lumel": {"reflection": true}},
    }));
    let roots = json["scenes"][0]["nodes"].as_array_mut().expect("roots");
    roots.push(json!(mark));
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut marked = glb[..8].to_vec();
    let total = glb.len() - length + text.len();
    marked.extend((total as u32).to_le_bytes());
    marked.extend((text.len() as u32).to_le_bytes());
    marked.extend(&glb[16..20]);
    marked.extend(text);
    marked.extend(&glb[20 + length..]);
    let file = write(t.path().join("box.glb"), marked);
    let paths = [&file, &out].map(|p| p.to_str().expect("UTF-8"));
    let options = "--quality quick --texels-per-unit 8";
    let a = ["bake", paths[0], "-o", paths[1]];
    lumel(a.into_iter().chain(options.split(' '))).ok();
    let cube = std::fs::read(out.join("box.reflection.ktx2")).expect("it is written");
    (t, out, cube)
}

/// The mirror ball shows what the bake captured there; `pixel` gives the colour that the picture
/// has at a point.
#[track_caller]
fn assert_mirror(cube: &[u8], mut pixel: impl FnMut([f64; 3]) -> [u8; 3]) {
    let (ball, radius) = MIRROR;
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let unit = |a: [f64; 3]| a.map(|v| v / dot(a, a).sqrt());
    // Normals that reflect the eye's rays onto the red and green walls, floor, ceiling and back.
    let mut seen = Vec::new();
    for n in [
        [0.6, 0.1, -0.8],
        [-0.6, 0.1, -0.8],
        [0.0, 0.7, -0.7],
        [0.1, -0.66, -0.75],
    ] {
        let n = unit(n);
        let on: [f64; 3] = std::array::from_fn(|i| ball[i] + radius * n[i]);
        let ray = unit(std::array::from_fn(|i| on[i] - MIRROR_EYE[i]));
        let reflected: [f64; 3] = std::array::from_fn(|i| ray[i] - 2.0 * dot(ray, n) * n[i]);
        // Engines filter texels, and the pixel's centre is not the point: what is captured within
        // two texels around gives the least and the most light there.
        let around = (0..27).map(|i| {
            let step = [i / 9, i / 3 % 3, i % 3].map(|s| (f64::from(s) - 1.0) * 0.03);
            captured(cube, unit(std::array::from_fn(|k| reflected[k] + step[k])))
        });
        let around: Vec<[f64; 3]> = around.map(|c| c.map(shown)).collect();
        let found = pixel(on);
        for (i, f) in found.into_iter().enumerate() {
            let all = around.iter().map(|c| c[i]);
            let (least, most) = all.fold((255.0, 0.0), |(a, b), x| (x.min(a), x.max(b)));
            let off = 3.0; // steps of rgb9e5, half floats and the picture's own
            assert!(
                (least - off..=most + off).contains(&f64::from(f)),
                "{n:?}: {found:?} is not within {least:.1} and {most:.1}"
            );
        }
        seen.push(found);
    }
    // The mirror shows the red wall on one side and the green one on the other.
    let redness = |p: [u8; 3]| i32::from(p[0]) - i32::from(p[1]);
    assert!(redness(seen[0]) * redness(seen[1]) < 0, "{seen:?}");
}

#[test]
fn three_js_shows_reflection_captures() {
    let Some(mut b) = Browser::start("three.js with reflections", [640, 480]) else {
        return;
    };
    let (_t, out, cube) = cornell_with_capture();
    let site = Site::start(&out);
    let ([x, y, z], radius) = MIRROR;
    b.open(&format!(
        "{}/engines/index.html?glb=/bake/box.glb&exposure=1&metal=0&ball={x},{y},{z},{radius}&cam={}",
        site.url,
        mirror_camera()
    ));
    b.wait("document.body?.dataset.state");
    let said = b.eval("document.body.innerText");
    assert_eq!(
        b.eval("document.body.dataset.state"),
        json!("ready"),
        "{said} {:?}",
        b.errors
    );
    let picture = b.screenshot();
    assert_mirror(&cube, |on| {
        let place = b.eval(&format!("lumel.project({}, {}, {})", on[0], on[1], on[2]));
        let [x, y] = [0, 1].map(|i| place[i].as_f64().expect("a number"));
        picture.get_pixel(x as u32, y as u32).0
    });
    assert_eq!(b.errors, [""; 0]);
}

/// The React Three Fiber example, bundled as its package.json says, with packages of `LUMEL_NPM`.
/// Prints a message if that is impossible.
fn react_example() -> Option<PathBuf> {
    let packages = [
        "esbuild",
        "react",
        "react-dom",
        "@react-three/fiber",
        "three",
    ];
    if !installed("React Three Fiber", &packages) {
        return None;
    }
    let bundle = temp().keep();
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/engines/three/react-example");
    let page = std::fs::read(folder.join("index.html")).expect("it is there");
    write(bundle.join("index.html"), page);
    let run = Command::new(npm_modules().join(".bin/esbuild"))
        .arg(folder.join("main.jsx"))
        .args([
            "--bundle",
            "--format=esm",
            "--jsx=automatic",
            "--log-level=error",
        ])
        .arg(format!(
            "--alias:lumel-three/react={}",
            folder.join("../lumel-react.js").display()
        ))
        .arg(format!("--outfile={}", bundle.join("bundle.js").display()))
        .env("NODE_PATH", npm_modules())
        .status()
        .expect("esbuild starts");
    assert!(run.success());
    Some(bundle)
}

#[test]
fn react_three_fiber_shows_closed_form_pixels() {
    let Some(mut b) = Browser::start("React Three Fiber", [640, 480]) else {
        return;
    };
    let Some(example) = react_example() else {
        return;
    };
    let (_t, out) = squares("");
    let site = Site::start_with(&out, Some(("/react/", &example)));
    look(&mut b, &site, "/react/index.html", "diffuse=1", &srgb(0.0));
    let (_t, out, exposure) = squares_times(4e4, "");
    let site = Site::start_with(&out, Some(("/react/", &example)));
    let (page, light) = ("/react/index.html", 4e4 * exposure);
    look_exposed(&mut b, &site, page, "diffuse=1", &srgb(1.0 / 512.0), light);
    // React Three Fiber 9.8 itself uses what three.js r187 deprecates.
    b.errors.retain(|e| !e.contains("THREE.Clock"));
    assert_eq!(b.errors, [""; 0]);
    let _ = std::fs::remove_dir_all(example);
}

/// Checks the types of the npm package against those of three.js and React.
#[test]
fn types_of_the_npm_package_hold() {
    let packages = [
        "typescript",
        "@types/three",
        "@types/react",
        "@react-three/fiber",
    ];
    if !installed("types of lumel-three", &packages) {
        return;
    }
    let t = temp();
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/engines/three");
    for name in ["lumel-lightmap.d.ts", "lumel-react.d.ts"] {
        std::fs::copy(package.join(name), t.path().join(name)).expect("copied");
    }
    let user = "import { useLumelLevel, LumelLevel } from './lumel-react.js';
        import { attachLightmaps } from './lumel-lightmap.js';
        const exposure: number = useLumelLevel('a.glb', { ktx2: true }).userData.lumel.exposure;
        attachLightmaps(useLumelLevel('a.glb'), { exposure }).then((a) => a.exposure.toFixed());
        useLumelLevel.preload('a.glb');
        export const level = <LumelLevel url='a.glb' diffuse position={[0, 1, 0]} />;";
    let file = write(t.path().join("user.tsx"), user);
    let bad = write(
        t.path().join("bad.tsx"),
        "import { LumelLevel } from './lumel-react.js'; export const level = <LumelLevel url={3} />;",
    );
    std::os::unix::fs::symlink(npm_modules(), t.path().join("node_modules")).expect("linked");
    let check = |file: &Path| {
        Command::new(npm_modules().join(".bin/tsc"))
            .args([
                "--noEmit",
                "--strict",
                "--skipLibCheck",
                "--jsx",
                "react-jsx",
            ])
            .args([
                "--module",
                "esnext",
                "--moduleResolution",
                "bundler",
                "--target",
                "es2022",
            ])
            .arg(file)
            .current_dir(t.path())
            .output()
            .expect("tsc starts")
    };
    let run = check(&file);
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stdout)
    );
    assert!(!check(&bad).status.success());
}

#[test]
fn three_js_shows_moz_lightmap() {
    let Some(mut b) = Browser::start("three.js with MOZ_lightmap", [640, 480]) else {
        return;
    };
    let (_t, out) = squares("--ext moz");
    let site = Site::start(&out);
    // PNG is off by half a step of 255 of the page's largest value, which these squares have; RGBE
    // is more accurate.
    for query in ["diffuse=1&moz=1", "diffuse=1&moz=png", "diffuse=1"] {
        look(
            &mut b,
            &site,
            "/engines/index.html",
            query,
            &srgb(1.0 / 255.0),
        );
    }
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn playcanvas_shows_closed_form_pixels() {
    let test = "PlayCanvas";
    if !installed(test, &["playcanvas"]) {
        return;
    }
    let Some(mut b) = Browser::start(test, [640, 480]) else {
        return;
    };
    let storage = power(1.0 / 512.0);
    for options in ["--ktx2 rgb9e5", "--ktx2 bc6h --block-charts"] {
        let (_t, out) = squares(options);
        let site = Site::start(&out);
        if options.contains("bc6h") && !has_bc6h(&mut b, &site, test) {
            break;
        }
        look(&mut b, &site, "/playcanvas/index.html", "", &storage);
    }
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn babylon_shows_closed_form_pixels() {
    let test = "Babylon.js";
    if !installed(test, &["babylonjs", "babylonjs-loaders", "fflate"]) {
        return;
    }
    let Some(mut b) = Browser::start(test, [640, 480]) else {
        return;
    };
    let (_t, out) = squares("");
    let site = Site::start(&out);
    look(&mut b, &site, "/babylon/index.html", "", &srgb(0.0));
    assert_eq!(b.errors, [""; 0]);
}

#[test]
fn babylon_adds_mixed_lamps_through_shadow_masks() {
    let test = "Babylon.js with shadow masks";
    if !installed(test, &["babylonjs", "babylonjs-loaders", "fflate"]) {
        return;
    }
    let Some(mut b) = Browser::start(test, [640, 480]) else {
        return;
    };
    let (_t, out) = squares_with_mask("");
    let site = Site::start(&out);
    // As in three.js.
    look(&mut b, &site, "/babylon/index.html", "", &srgb(1.0 / 128.0));
    assert_eq!(b.errors, [""; 0]);
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

#[test]
fn blender_imports_without_loss_and_looks_up_right() {
    let venv = std::env::var_os("LUMEL_VENV").unwrap_or_else(|| "/opt/lumel-venv".into());
    let python = PathBuf::from(venv).join("bin/python");
    if !python.is_file() {
        eprintln!(
            "SKIPPED Blender: no {} (LUMEL_VENV names its folder)",
            python.display()
        );
        return;
    }
    let (_t, out) = squares("");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/blender/tests");
    let points: Vec<Value> = (points().into_iter())
        .map(|(at, albedo, r)| json!({"at": at, "radiance": albedo.map(|a| a * r)}))
        .collect();
    let run = Command::new(&python)
        .arg(folder.join("check_import.py"))
        .arg(out.join(format!("{STEM}.glb")))
        .arg(json!(points).to_string())
        .output()
        .expect("Python starts");
    let text = String::from_utf8_lossy(&run.stdout);
    if run.status.code() == Some(77) {
        eprintln!("SKIPPED Blender: {text}");
        return;
    }
    assert!(
        run.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&run.stderr)
    );
}
