//! Light sources by name with the real binary: `--light`, `--exclude-light`, `--group`, `--sun`,
//! and their lists in `inspect` and the report.

use std::path::Path;

use crate::common::{asset, bake, files, lumel, parse, temp, write};
use serde_json::{Value, json};

/// Half a floor that faces up, as base64: (−4 0 4), (4 0 4), (4 0 −4).
const FLOOR: &str = "AACAwAAAAAAAAIBAAACAQAAAAAAAAIBAAACAQAAAAAAAAIDA";

/// A grey triangle under two lamps with the same name, a third lamp and a small emissive triangle
/// above it.
fn level() -> Value {
    let lamp = |name: &str, light: u32, x: f32| {
        json!({"name": name, "translation": [x, 2.0, 0.5],
            "extensions": {"KHR_lights_punctual": {"light": light}}})
    };
    json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"name": "lamp", "type": "point", "intensity": 10.0},
            {"name": "fill", "type": "point", "color": [0.0, 0.0, 1.0], "intensity": 5.0}]}},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2, 3, 4]}],
        "nodes": [
            {"mesh": 0},
            lamp("left lamp", 0, 0.5),
            lamp("right lamp", 0, 2.0),
            lamp("fill node", 1, 1.0),
            {"mesh": 1, "translation": [1.0, 3.0, 1.0], "rotation": [1.0, 0.0, 0.0, 0.0], "scale": [0.2, 0.2, 0.2]}],
        "materials": [
            {"name": "floor", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0]}},
            {"name": "neon", "emissiveFactor": [1.0, 0.0, 0.0]},
            {"name": "unused", "emissiveFactor": [1.0, 1.0, 1.0]}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 0}, "material": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-4, 0, -4], "max": [4, 0, 4]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": format!("data:application/octet-stream;base64,{FLOOR}")}],
    })
}

/// The report of a bake of [`level`] with `options`, which are separated by spaces.
#[track_caller]
fn report(folder: &Path, options: &str) -> Value {
    let scene = write(folder.join("level.gltf"), level().to_string());
    let out = folder.join("out");
    bake(&scene, &out, options).ok();
    parse(&files(&out)["level.report.json"])
}

/// Mean of each channel of R over the lightmap.
fn mean(report: &Value) -> [f64; 3] {
    [0, 1, 2].map(|i| {
        let x = report["gather"]["mean"][i].as_f64();
        x.expect("the report has the mean")
    })
}

#[test]
fn inspect_lists_the_names_that_options_take() {
    let t = temp();
    let scene = write(t.path().join("level.gltf"), level().to_string());
    let path = scene.to_str().expect("UTF-8");
    let text = lumel(["inspect", path]).ok().stdout;
    for line in [
        "names       fill (light)",
        "            fill node (light)",
        "            lamp (2 lights)",
        "            left lamp (light)",
        "            neon (material)",
    ] {
        assert!(text.contains(&format!("  {line}\n")), "{line}: {text}");
    }
    assert!(!text.contains("unused"), "nothing wears it: {text}");
    let machine = parse(lumel(["inspect", path, "--json"]).ok().stdout);
    assert_eq!(
        machine["sources"],
        json!([
            {"kind": "light", "name": "lamp", "node": "left lamp"},
            {"kind": "light", "name": "lamp", "node": "right lamp"},
            {"kind": "light", "name": "fill", "node": "fill node"},
            {"kind": "material", "name": "neon"}])
    );
}

#[test]
fn lights_are_dimmed_by_name() {
    let t = temp();
    let all = mean(&report(t.path(), ""));
    let half = mean(&report(t.path(), "--light *=0.5"));
    let dark = mean(&report(t.path(), "--exclude-light *"));
    let fill = mean(&report(
        t.path(),
        "--light *=0 --light fill*=2 --exclude-light neon",
    ));
    for c in 0..3 {
        // Every step is linear in the light, and halving is exact in binary.
        assert!(
            (half[c] - 0.5 * all[c]).abs() <= 1e-6 * all[c],
            "{half:?} {all:?}"
        );
        assert_eq!(dark[c], 0.0);
    }
    assert!(fill[0] == 0.0 && fill[1] == 0.0, "{fill:?}");
    // Only the fill light has more blue than green, and its bounce adds equally to both.
    let blue = all[2] - all[1];
    assert!((fill[2] / blue - 2.0).abs() < 0.02, "{fill:?} {all:?}");
}

#[test]
fn the_report_says_what_was_chosen() {
    let t = temp();
    let options = "--light lamp=0.5 --exclude-light neon --sun 0,-1,0,3,0.5 --sky 0.1 \
        --group warm=lamp,neon --group sky_light=s* --directional sh1 --ao-distance 2";
    let r = report(t.path(), options);
    let s = &r["settings"];
    let lights = [json!(["lamp", 0.5]), json!(["neon", 0.0])];
    for (i, l) in lights.iter().enumerate() {
        assert_eq!(
            json!([s["lights"][i]["name"], s["lights"][i]["factor"]]),
            *l
        );
    }
    assert_eq!(
        s["groups"],
        json!([{"name": "warm", "sources": ["lamp", "neon"]}, {"name": "sky_light", "sources": ["s*"]}])
    );
    assert_eq!(s["suns"][0]["angle"], json!(0.5));
    assert_eq!(s["directional"], json!("sh1"));
    assert_eq!(s["ao_distance"], json!(2.0));
    assert_eq!(
        r["groups"],
        json!([
            {"name": "warm", "sources": ["left lamp", "right lamp"]},
            {"name": "sky_light", "sources": ["sun", "sky"]},
            {"name": "rest", "sources": ["fill"]}])
    );
    assert_eq!(report(t.path(), "")["groups"], json!([]));
}

#[test]
fn names_and_groups_that_make_no_sense_are_1() {
    let t = temp();
    let scene = write(t.path().join("level.gltf"), level().to_string());
    let out = t.path().join("out");
    let names = r#"there are "fill", "fill node", "lamp", "left lamp", "neon", "right lamp""#;
    for (options, words) in [
        ("--light Lamp=2", &["\"Lamp\"", names][..]),
        (
            "--exclude-light lam",
            &["--exclude-light", "\"lam\"", names],
        ),
        ("--exclude-light unused", &[names]),
        ("--light sky=2", &[names]),
        ("--group a=lamp,x*", &["--group a", "\"x*\"", names]),
        (
            "--group a=lamp --group b=neon,left*",
            &["\"left lamp\"", "a and b"],
        ),
        ("--group a=lamp --group A=neon", &["a and A"]),
        ("--group rest=lamp", &["\"rest\""]),
        ("--group a/b=lamp", &["\"a/b\""]),
        ("--group a=", &["a names no light sources"]),
        ("--group lamp", &["GROUP=NAME"]),
        ("--light lamp", &["NAME=FACTOR"]),
        ("--light lamp=-1", &["at least 0"]),
        ("--light lamp=nan", &["at least 0"]),
        ("--light lamp=3e38", &["overflows"]),
        ("--sun 0,-1,0,1,-1", &["diameter"]),
        ("--sun 0,-1,0,1,91", &["diameter"]),
        ("--sun 0,-1,0,1,nan", &["DEGREES"]),
        ("--ao-distance 0", &["above 0"]),
        ("--directional sh2", &["sh2"]),
    ] {
        bake(&scene, &out, &format!("-q {options}")).fails(1, words);
        assert!(!out.exists(), "{options} left a folder behind");
    }
}

#[test]
fn a_level_without_light_says_so() {
    let t = temp();
    bake(
        &asset("classic_room_1014.glb"),
        &t.path().join("out"),
        "-q --group a=lamp --exclude-light lamp",
    )
    .ok();
    let mut dark = level();
    dark["nodes"] = json!([{"mesh": 0}]);
    dark["scenes"] = json!([{"nodes": [0]}]);
    let scene = write(t.path().join("dark.gltf"), dark.to_string());
    bake(&scene, &t.path().join("no"), "-q --exclude-light *").fails(1, &["the scene has none"]);
}
