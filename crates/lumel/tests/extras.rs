//! What artists ask for costs nothing where it is not used.

use std::collections::BTreeSet;
use std::fs;

use serde_json::{Value, json};

use crate::common::{asset, bake, files, parse, temp, write};

/// Every knob at the value that changes nothing.
const NEUTRAL: &str = "--mode full --indirect-boost 1 --emissive-boost 1 --albedo-boost 1 \
     --bounce-saturation 1 --ambient-floor 0 --ao-multiply 0 --no-lods";

const COARSE: &str = "--sky 0.25 -q";

#[test]
fn neutral_values_change_no_byte() {
    let t = temp();
    let level = asset("cornell_box.glb");
    let of = |name: &str, options: &str| {
        let out = t.path().join(name);
        bake(&level, &out, &format!("{COARSE} {options}")).ok();
        let mut all = files(&out);
        let report = all.remove("cornell_box.report.json").expect("a report");
        (all, parse(report))
    };
    let (plain, report) = of("plain", "");
    let (neutral, _) = of("neutral", NEUTRAL);
    assert_eq!(
        plain.keys().collect::<Vec<_>>(),
        neutral.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in &plain {
        assert!(*bytes == neutral[name], "{name}");
    }
    // No step of the bake, no file and no entry belongs to what is not used.
    let steps = |report: &Value| -> BTreeSet<String> {
        let phases = report["measured"]["phases"].as_array().expect("phases");
        (phases
            .iter()
            .map(|p| p["phase"].as_str().expect("a name").to_owned()))
        .collect()
    };
    let known = ["ingest", "atlas", "tree", "solve", "gather", "write"];
    assert_eq!(steps(&report), known.map(str::to_owned).into());
    for key in [
        "culled",
        "not_physical",
        "only",
        "reflections",
        "png",
        "ktx2",
    ] {
        assert_eq!(report.get(key), None, "{key}");
    }
    let manifest = parse(&plain["cornell_box.lightmap.json"]);
    for key in ["mode", "lamps", "reflections", "groups"] {
        assert_eq!(manifest.get(key), None, "{key}");
    }
    let names: Vec<&str> = plain.keys().map(String::as_str).collect();
    let four = ["glb", "lightmap.exr", "lightmap.json", "vertex.glb"];
    assert_eq!(names, four.map(|end| format!("cornell_box.{end}")));
}

/// The Cornell box's walls as text, with captures inside and outside of a closed box.
#[test]
fn reflection_captures_are_foretold_and_reported() {
    let t = temp();
    let corners: Vec<f32> = (0..8)
        .flat_map(|i| [i & 1, (i >> 1) & 1, (i >> 2) & 1].map(|b| 2.0 * b as f32))
        .collect();
    // Faces look outwards, so that a point in the box sees only backs.
    let faces: [u16; 36] = [
        0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6,
        1, 3, 5, 3, 7, 5,
    ];
    let mut bytes: Vec<u8> = corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(faces.iter().flat_map(|i| i.to_le_bytes()));
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let mark = |at: [f64; 3]| json!({"translation": at, "extras": {"lumel": {"reflection": true}}});
    let scene = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0}, mark([1.0, 1.0, 1.0]), mark([5.0, 1.0, 1.0])],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
             "min": [0, 0, 0], "max": [2, 2, 2]},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 72},
        ],
        "buffers": [{"byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}")}],
    });
    let file = write(t.path().join("box.gltf"), scene.to_string());
    let out = t.path().join("out");
    let options = "--sky 1";
    let plan = bake(&file, &out, &format!("{options} --dry-run --json"))
        .ok()
        .stdout;
    let plan = parse(plan);
    assert_eq!(plan["estimate"]["reflections"], 2);
    let said = bake(&file, &out, options).ok();
    assert!(
        said.stderr
            .contains("captures  2 of reflections, 1 of them inside"),
        "{}",
        said.stderr
    );
    let report = parse(fs::read(out.join("box.report.json")).expect("a report"));
    assert_eq!(report["reflections"]["captures"], 2);
    assert_eq!(report["reflections"]["invalid"], 1);
    let phases = report["measured"]["phases"].as_array().expect("phases");
    assert!(phases.iter().any(|p| p["phase"] == "reflections"));
    let mut foretold: Vec<String> = (plan["estimate"]["files"].as_array().expect("files").iter())
        .map(|name| name.as_str().expect("a name").to_owned())
        .collect();
    foretold.sort();
    let written: Vec<String> = files(&out).into_keys().collect();
    assert_eq!(foretold, written);
}
