//! `lumel inspect` with the real binary: faults in a level's own coordinates, and the pictures that
//! it draws.

use std::fs;
use std::path::Path;

use crate::common::{lumel, names, temp};
use serde_json::{Value, json};

/// Two 1 m quads in one mesh, the second overlapping half of the first in TEXCOORD_1, and a valid
/// quad in its own mesh.
fn level(dir: &Path) -> std::path::PathBuf {
    let quad = |x: f32| {
        [
            [x, 0.0, 0.0],
            [x + 1.0, 0.0, 0.0],
            [x + 1.0, 1.0, 0.0],
            [x, 1.0, 0.0],
        ]
    };
    let square = |u: f32| [[u, 0.1], [u + 0.4, 0.1], [u + 0.4, 0.5], [u, 0.5f32]];
    let mut bin: Vec<u8> = Vec::new();
    for p in [quad(0.0), quad(2.0)].concat().concat() {
        bin.extend(f32::to_le_bytes(p));
    }
    for uv in [square(0.1), square(0.3)].concat().concat() {
        bin.extend(f32::to_le_bytes(uv));
    }
    for i in [0u16, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7] {
        bin.extend(i.to_le_bytes());
    }
    let primitive = |position: u32, uv: u32, indices: u32| json!([{"attributes": {"POSITION": position, "TEXCOORD_0": uv, "TEXCOORD_1": uv}, "indices": indices}]);
    let positions = |offset: u32, x: f32, count: u32| {
        json!({"bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": count, "type": "VEC3",
            "min": [0.0, 0.0, 0.0], "max": [x, 1.0, 0.0]})
    };
    let doc = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "name": "doubled"}, {"mesh": 1, "name": "sound", "translation": [0, 3, 0]}],
        "meshes": [{"name": "two", "primitives": primitive(0, 1, 2)}, {"name": "one", "primitives": primitive(3, 4, 5)}],
        "accessors": [
            positions(0, 3.0, 8),
            {"bufferView": 1, "componentType": 5126, "count": 8, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR"},
            positions(0, 1.0, 4),
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 64},
            {"buffer": 0, "byteOffset": 160, "byteLength": 24},
        ],
        "buffers": [{"byteLength": 184, "uri": "level.bin"}],
    });
    fs::write(dir.join("level.bin"), bin).expect("written");
    let path = dir.join("level.gltf");
    fs::write(&path, doc.to_string()).expect("written");
    path
}

fn inspect(scene: &Path, options: &[&str]) -> crate::common::Run {
    let scene = scene.to_str().expect("UTF-8");
    lumel([&["inspect", scene, "--texels-per-unit=20"], options].concat())
}

#[test]
fn json_and_text_say_what_is_wrong_and_where() {
    let t = temp();
    let scene = level(t.path());
    let before = names(t.path());
    let run = inspect(&scene, &["--json"]).ok();
    let report: Value = serde_json::from_str(&run.stdout).expect("JSON");
    let layout = &report["layout"];
    let [two, one] = [0, 1].map(|i| &layout["meshes"][i]);
    assert_eq!(
        (&two["origin"]["kind"], &one["origin"]["kind"]),
        (&json!("replaced"), &json!("kept"))
    );
    let fault = &two["uv_faults"][0];
    assert_eq!(
        (&fault["kind"], &fault["severity"]),
        (&json!("overlap"), &json!("bad"))
    );
    assert_eq!(fault["worst"]["primitive"], 0);
    assert!(
        fault["worst"]["triangle"].as_u64().is_some_and(|t| t >= 2),
        "{fault}"
    );
    let u = fault["worst"]["uv"][0].as_f64().expect("a number");
    assert!((0.3..0.5).contains(&u), "{fault}");
    assert_eq!(one.get("uv_faults"), None);
    // 20 lumels per metre throughout. Kept rectangles are multiples of four texels, so 50 becomes
    // 52.
    for (i, least) in layout["density"]
        .as_array()
        .expect("three")
        .iter()
        .enumerate()
    {
        let x = least.as_f64().expect("a number");
        assert!((x / 20.0 - 1.0).abs() < 0.041, "{i}: {x}");
    }
    assert_eq!(layout["charts"], 3);

    let run = inspect(&scene, &[]).ok();
    let line = run
        .stdout
        .lines()
        .find(|l| l.contains("bad: triangles overlap"));
    assert!(
        line.is_some_and(|l| l.contains("primitive 0, triangle ")),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout
            .contains("mesh 0 \"two\" (node 0 \"doubled\"): TEXCOORD_1 replaced")
    );
    assert!(run.stdout.contains("used stretch"), "the table of charts");
    assert_eq!(names(t.path()), before, "inspect writes nothing");

    let run = inspect(&scene, &["--uv=keep"]).ok();
    assert!(
        run.stdout.contains("2 meshes keep their TEXCOORD_1"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout
            .contains("TEXCOORD_1 kept, but triangles overlap")
    );
}

/// Fraction of a picture's pixels with a colour.
fn share(path: &Path, color: [u8; 3]) -> f64 {
    let picture = image::open(path).expect("a PNG").to_rgb8();
    let hits = picture.pixels().filter(|p| p.0 == color).count();
    hits as f64 / f64::from(picture.width() * picture.height())
}

#[test]
fn pictures_show_overlaps_in_red_and_only_there() {
    let t = temp();
    let scene = level(t.path());
    let out = t.path().join("pictures");
    let options = format!("--pictures={}", out.display());
    let run = inspect(&scene, &[&options]).ok();
    assert!(run.stderr.contains("wrote 4 pictures"), "{}", run.stderr);
    let written = [
        "level.mesh0.png",
        "level.mesh0.uv1.png",
        "level.mesh1.png",
        "level.page0.png",
    ];
    assert_eq!(names(&out), written);
    let red = |name: &str| share(&out.join(name), [255, 0, 0]);
    // 0.2 × 0.4 of the unit square, drawn with a margin of 1 %; outlines and hatching cover part of
    // it.
    let found = red("level.mesh0.uv1.png");
    assert!((found - 0.08 / 1.02f64.powi(2)).abs() < 0.004, "{found}");
    for name in ["level.mesh0.png", "level.mesh1.png", "level.page0.png"] {
        assert_eq!(red(name), 0.0, "{name}");
    }
    let kept = t.path().join("kept");
    let options = format!("--pictures={}", kept.display());
    inspect(&scene, &[&options, "--uv=keep"]).ok();
    assert!(share(&kept.join("level.mesh0.png"), [255, 0, 0]) > 0.05);

    // At the requested density nothing is blue or orange.
    let density = t.path().join("density");
    let options = format!("--pictures={}", density.display());
    inspect(&scene, &[&options, "--paint=density"]).ok();
    let picture = image::open(density.join("level.mesh0.png"))
        .expect("a PNG")
        .to_rgb8();
    let spread =
        |p: &image::Rgb<u8>| p.0.iter().max().unwrap_or(&0) - p.0.iter().min().unwrap_or(&0);
    assert!(
        picture.pixels().all(|p| spread(p) <= 12),
        "a colour where the density is right"
    );

    // Pictures are deterministic.
    let again = t.path().join("again");
    inspect(&scene, &[&format!("--pictures={}", again.display())]).ok();
    for name in written {
        let [a, b] = [&out, &again].map(|d| fs::read(d.join(name)).expect("a file"));
        assert!(a == b, "{name}");
    }
}

#[test]
fn a_paint_without_pictures_is_wrong_usage() {
    let t = temp();
    let run = inspect(&level(t.path()), &["--paint=density"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
}
