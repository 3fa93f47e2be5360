//! Warnings of the real binary name the nodes and what to do.

use std::path::{Path, PathBuf};

use base64::Engine;
use serde_json::{Value, json};

use crate::common::{Run, bake, lumel, temp};

/// A closed box around the origin: name and half-sizes.
type Named<'a> = (&'a str, [f32; 3]);

/// Writes boxes, one mesh each, and a lamp above them if `lit`.
fn boxes(folder: &Path, boxes: &[Named], lit: bool) -> PathBuf {
    let corners: Vec<[f32; 3]> = (0..8u32)
        .map(|i| [0, 1, 2].map(|axis| (i >> axis & 1) as f32 * 2.0 - 1.0))
        .collect();
    // Counter-clockwise from outside.
    let faces: [[u16; 4]; 6] = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let mut bytes: Vec<u8> = Vec::new();
    for [a, b, c, d] in faces {
        for i in [a, b, c, a, c, d] {
            bytes.extend(i.to_le_bytes());
        }
    }
    for p in corners.as_flattened() {
        bytes.extend(p.to_le_bytes());
    }
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let mut nodes: Vec<Value> = (boxes.iter())
        .map(|(name, size)| json!({"name": name, "mesh": 0, "scale": size}))
        .collect();
    let mut used: Vec<&str> = Vec::new();
    if lit {
        used.push("KHR_lights_punctual");
        nodes.push(
            json!({"translation": [0, 6, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}}),
        );
    }
    let scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}],
        "extensionsUsed": used, "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 90}]}},
        "nodes": nodes, "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}],
        "buffers": [{"byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}")}],
        "bufferViews": [{"buffer": 0, "byteLength": 72}, {"buffer": 0, "byteOffset": 72, "byteLength": 96}],
        "accessors": [
            {"bufferView": 0, "componentType": 5123, "count": 36, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 8, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]}
        ]
    });
    let path = folder.join("boxes.gltf");
    std::fs::write(&path, scene.to_string()).expect("written");
    path
}

/// The warnings of a successful bake; asserts that `inspect` gives the same warnings about
/// geometry.
fn warnings(parts: &[Named], lit: bool, options: &str) -> (Run, Vec<String>) {
    let t = temp();
    let scene = boxes(t.path(), parts, lit);
    let out = t.path().join("out");
    let run = bake(&scene, &out, options).ok();
    let report = std::fs::read(out.join("boxes.report.json")).expect("a report");
    let report: Value = serde_json::from_slice(&report).expect("JSON");
    let list = report["warnings"].as_array().expect("a list");
    let list: Vec<String> = list
        .iter()
        .map(|w| w.as_str().unwrap_or_default().to_string())
        .collect();
    let mut a = vec!["inspect".to_string(), scene.display().to_string()];
    a.extend(options.split_whitespace().map(String::from));
    let inspected = lumel(a).ok().stdout;
    for w in list
        .iter()
        .filter(|w| !w.contains("lumels are inside geometry"))
    {
        assert!(inspected.contains(w.as_str()), "{w}\n{inspected}");
    }
    (run, list)
}

/// The only warning that contains `words`; asserts that it contains each of `names`.
#[track_caller]
fn one<'w>(list: &'w [String], words: &str, names: &[&str]) -> &'w str {
    let mut found = list.iter().filter(|w| w.contains(words));
    let (Some(w), None) = (found.next(), found.next()) else {
        panic!("{words}: {list:?}");
    };
    for name in names {
        assert!(w.contains(name), "{name} is not in: {w}");
    }
    w
}

#[test]
fn a_level_with_nothing_wrong_has_no_warning() {
    let (_, list) = warnings(&[("a", [1.0; 3])], true, "");
    assert_eq!(list, Vec::<String>::new());
}

#[test]
fn levels_that_nobody_told_are_named() {
    let three = [("old", [1.0; 3]), ("mid", [0.97; 3]), ("far", [1.04; 3])];
    let (_, list) = warnings(&three, true, "");
    one(
        &list,
        "like levels of detail",
        &["\"old\" / \"mid\" / \"far\"", "extras.lumel.lod"],
    );
    assert!(
        !list.iter().any(|w| w.contains("wholly inside")),
        "{list:?}"
    );
    // Marked levels are fine. With `--no-lods` the user has said that names mean nothing.
    let told = [
        ("a_LOD0", [1.0; 3]),
        ("a_LOD1", [0.97; 3]),
        ("a_LOD2", [1.04; 3]),
    ];
    let (run, list) = warnings(&told, true, "");
    assert_eq!(list, Vec::<String>::new());
    assert!(
        run.stderr
            .contains("1 group of levels of detail or variants: \"a\" (levels 0, 1, 2)"),
        "{}",
        run.stderr
    );
    let (run, list) = warnings(&told, true, "--no-lods");
    assert!(!run.stderr.contains("levels of detail"), "{}", run.stderr);
    one(
        &list,
        "completely inside closed bodies",
        &["\"a_LOD0\"", "\"a_LOD1\""],
    );
}

#[test]
fn what_coincides_and_what_lies_inside_is_named() {
    let twice = [("wall", [1.0, 1.0, 0.1]), ("copy", [1.0, 1.0, 0.1])];
    let (_, list) = warnings(&twice, true, "");
    let w = one(
        &list,
        "triangles coincide with others",
        &["\"copy\" on \"wall\" (12)", "extras.lumel.variant"],
    );
    assert!(w.starts_with("12 triangles"), "{w}");
    let many: Vec<(String, [f32; 3])> = (0..7)
        .map(|i| (format!("doll{i}"), [0.7f32.powi(i + 1); 3]))
        .collect();
    let mut parts: Vec<Named> = vec![("wall", [1.0; 3])];
    parts.extend(many.iter().map(|(name, size)| (name.as_str(), *size)));
    let (_, list) = warnings(&parts, true, "");
    let w = one(
        &list,
        "completely inside closed bodies",
        &["\"doll0\"", "\"doll4\" and 2 more"],
    );
    assert!(w.starts_with("7 nodes lie") && !w.contains("doll5"), "{w}");
    // Their lumels are dark, which the bake reports too.
    one(
        &list,
        "lumels are inside geometry or behind",
        &["\"doll0\" (100 % of"],
    );
}

#[test]
fn a_black_bake_is_told_before_it_and_once() {
    let (run, list) = warnings(&[("a", [1.0; 3])], false, "");
    one(&list, "the lightmap will be black", &["--sky", "--sun"]);
    let lines: Vec<&str> = run.stderr.lines().collect();
    let at = |words: &str| lines.iter().position(|l| l.contains(words));
    let told = at("warning: the lightmap will be black").expect("it is said");
    assert!(told < at("  lightmap ").expect("a summary"), "{lines:?}");
    assert!(told < at("gather").expect("the gather's time"), "{lines:?}");
    let count = lines
        .iter()
        .filter(|l| l.contains("the lightmap will be black"))
        .count();
    assert_eq!(count, 1, "{lines:?}");
    assert!(
        !list.iter().any(|w| w.contains("the lightmap is black")),
        "{list:?}"
    );
}
