//! Light probes with the real binary: `--probes`, the output file, and refused inputs.

use std::fs;

use crate::common::{asset, bake, comparable, files, lumel, names, outputs, parse, temp, write};
use serde_json::{Value, json};

/// Nine coefficients of a constant radiance.
fn constant(radiance: f64) -> Vec<f64> {
    let mut c = vec![0.0; 9];
    c[0] = radiance * (4.0 * std::f64::consts::PI).sqrt();
    c
}

/// The red channel of a probe's coefficients.
#[track_caller]
fn red(probe: &Value) -> Vec<f64> {
    let sh = probe["sh"].as_array().expect("coefficients");
    let red = sh.iter().map(|c| c[0].as_f64().expect("a number"));
    red.collect()
}

#[test]
fn points_of_a_file_come_back_with_light_in_their_order() {
    let t = temp();
    let points =
        json!({"points": [[0.5, 0.5, 0.5], [0.123456789012, 0.25, 0.75], [1.2, 0.0, 0.0]]});
    let list = write(t.path().join("my points.json"), points.to_string());
    let out = t.path().join("out");
    let scene = asset("furnace_cube_50.glb");
    let paths = [&scene, &out, &list].map(|p| p.to_str().expect("UTF-8"));
    let quality = ["--quality", "draft", "--texels-per-unit", "4"];
    let arguments = ["bake", paths[0], "-o", paths[1], "--probes", paths[2]];
    let run = lumel(arguments.into_iter().chain(quality)).ok();
    assert!(
        run.stderr
            .contains("probes    3, 1 of them inside or behind geometry"),
        "{}",
        run.stderr
    );
    let mut expected = outputs("furnace_cube_50");
    expected.push("furnace_cube_50.probes.json".into());
    expected.sort();
    assert_eq!(names(&out), expected);
    let got = files(&out);
    let file = parse(&got["furnace_cube_50.probes.json"]);
    assert!(file.get("grid").is_none());
    let probes = file["probes"].as_array().expect("probes");
    for (p, at) in probes
        .iter()
        .zip(points["points"].as_array().expect("list"))
    {
        assert_eq!(p["position"], *at);
    }
    // In the furnace L = L_e/(1 − ρ) with L_e = 1 and ρ = ½. The solve stops when 1e-4 of the light
    // is undistributed.
    for p in &probes[..2] {
        assert_eq!(p["valid"], json!(true));
        for (x, y) in red(p).iter().zip(constant(2.0)) {
            assert!((x - y).abs() < 1e-4 * constant(2.0)[0], "{p}");
        }
    }
    // Outside a room of single-sided faces, a probe sees only backfaces.
    assert_eq!(probes[2]["valid"], json!(false));
    let report = parse(&got["furnace_cube_50.report.json"]);
    let r = &report["probes"];
    assert_eq!((&r["probes"], &r["invalid"]), (&json!(3), &json!(1)));
    assert_eq!(r["dims"], Value::Null);
    let text = String::from_utf8_lossy(&got["furnace_cube_50.report.json"]).into_owned();
    assert!(!text.contains("my points"), "no paths in outputs");
}

#[test]
fn a_spacing_makes_a_grid_over_the_scene() {
    let t = temp();
    let out = t.path().join("out");
    bake(&asset("furnace_cube_50.glb"), &out, "--probes 0.4").ok();
    let got = files(&out);
    let file = parse(&got["furnace_cube_50.probes.json"]);
    let dims = &file["grid"]["dims"];
    let n: u64 = (0..3)
        .map(|i| dims[i].as_u64().expect("a number"))
        .product();
    let probes = file["probes"].as_array().expect("probes");
    assert_eq!(probes.len() as u64, n);
    assert_eq!(file["grid"]["spacing"], json!([0.4, 0.4, 0.4]));
    assert_eq!(file["grid"]["origin"], probes[0]["position"]);
    let x = |i: usize| probes[i]["position"][0].as_f64().expect("a number");
    assert!((x(1) - x(0) - 0.4).abs() < 1e-12, "x runs fastest");
    assert!(probes.iter().all(|p| p["valid"] == json!(true)));
    let report = parse(&got["furnace_cube_50.report.json"]);
    assert_eq!(report["probes"]["dims"], *dims);
    assert_eq!(report["settings"]["probes"], json!({"spacing": 0.4}));
    assert!(
        report["probes"]["estimated_error"]
            .as_f64()
            .is_some_and(|e| e < 0.01)
    );
}

#[test]
fn threads_change_no_byte_of_the_probes() {
    let t = temp();
    let [a, b] = ["1", "2"].map(|n| {
        let out = t.path().join(n);
        let options = format!("--probes 0.3 --sky 0.1 --threads {n}");
        bake(&asset("cornell_box.glb"), &out, &options).ok();
        files(&out)
    });
    let name = "cornell_box.probes.json";
    assert!(a[name] == b[name]);
    let report = "cornell_box.report.json";
    assert_eq!(comparable(&a[report]), comparable(&b[report]));
}

#[test]
fn lists_that_are_none_are_3_and_missing_ones_2() {
    let t = temp();
    let out = t.path().join("out");
    let scene = asset("furnace_cube_50.glb");
    for (text, words) in [
        (
            "{\"points\": [[0, 0, 0], [0, \"up\", 0]]}",
            &["points[1][1]", "\"up\"", "a number"][..],
        ),
        ("[[0, 0]]", &["[0]", "a list of 2", "three numbers"]),
        ("{}", &["points: found nothing"]),
        ("[]", &["0 points"]),
        ("{\"points\": [", &["invalid JSON", "line 1"]),
    ] {
        let list = write(t.path().join("list.json"), text);
        let option = format!("-q --probes {}", list.display());
        let run = bake(&scene, &out, &option);
        run.fails(3, words);
        run.fails(3, &["list.json"]);
        assert!(!out.exists(), "{text} left a folder behind");
    }
    bake(&scene, &out, "-q --probes missing.json").fails(2, &["missing.json"]);
}

#[test]
fn distances_that_make_no_sense_are_1() {
    let t = temp();
    let out = t.path().join("out");
    let scene = asset("furnace_cube_50.glb");
    for (options, word) in [
        ("--probes 0", "above 0"),
        ("--probes -1", "above 0"),
        ("--probes nan", "above 0"),
        ("--probes inf", "above 0"),
        ("--probes 0.001", "expected at most 262144 in all: try 0.0"),
        ("--probes 1e-30", "expected at most 262144 in all: try 0.0"),
    ] {
        bake(&scene, &out, &format!("-q {options}")).fails(1, &[word]);
        assert!(!out.exists(), "{options} left a folder behind");
    }
}

#[test]
fn the_list_is_not_replaced_by_what_comes_of_it() {
    let t = temp();
    let scene = t.path().join("level.glb");
    fs::copy(asset("furnace_cube_50.glb"), &scene).expect("copy");
    let out = t.path().join("out");
    fs::create_dir(&out).expect("created");
    let text = "[[0.5, 0.5, 0.5]]";
    let list = write(out.join("level.probes.json"), text);
    let option = format!("-q --probes {}", list.display());
    bake(&scene, &out, &option).fails(1, &["level.probes.json"]);
    let other = write(t.path().join("list.json"), text);
    let option = format!("-q --probes {0} --preview {0}", other.display());
    bake(&scene, &out, &option).fails(1, &["list.json"]);
    assert_eq!(fs::read(&list).expect("there"), text.as_bytes());
    assert_eq!(fs::read(&other).expect("there"), text.as_bytes());
}

#[test]
fn a_grid_is_a_volume_texture_too() {
    let t = temp();
    let scene = asset("cornell_box.glb");
    bake(&scene, t.path(), "--probes 2 --probe-volume -q").ok();
    let probes = parse(fs::read(t.path().join("cornell_box.probes.json")).expect("probes"));
    let (grid, volume) = (&probes["grid"], &probes["volume"]);
    assert_eq!(volume["uri"], "cornell_box.probes.ktx2");
    let bytes = fs::read(t.path().join("cornell_box.probes.ktx2")).expect("a texture");
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes"));
    // VK_FORMAT_E5B9G9R9_UFLOAT_PACK32, then width, height and depth behind the size of a word.
    assert_eq!(number(12), 123);
    for (k, times) in [1, 2, 3].into_iter().enumerate() {
        let n = grid["dims"][k].as_u64().expect("a number");
        assert_eq!(u64::from(number(20 + 4 * k)), times * n);
        // The box ends half a spacing beyond the outer probes.
        let of = |v: &Value, name: &str| v[name][k].as_f64().expect("a number");
        let low = of(volume, "center") - 0.5 * of(volume, "size");
        let first = of(grid, "origin") - 0.5 * of(grid, "spacing");
        assert!((low - first).abs() < 1e-9, "{low} {first}");
        assert!((of(volume, "size") - of(grid, "spacing") * n as f64).abs() < 1e-9);
    }
    let list = write(t.path().join("points.json"), "[[0, 1, 0]]");
    let option = format!("--probes {} --probe-volume -q", list.display());
    bake(&scene, t.path(), &option).fails(1, &["--probe-volume", "a grid"]);
    bake(&scene, t.path(), "--probe-volume -q").fails(1, &["--probe-volume", "--probes"]);
}
