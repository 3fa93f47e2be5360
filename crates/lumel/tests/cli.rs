//! The real binary: files, streams and exit codes. Values are tested elsewhere.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use crate::common::{
    asset, bake, cheap, comparable, files, lumel, names, outputs, parse, temp, write,
};
use lumel::atlas_bake::{ExrImage, read_exr};
use serde_json::{Value, json};

/// Three positions, (0 0 0), (1 0 0), (0 0 −1), as base64.
const TRIANGLE: &str = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAAAAAIC/";

/// A document of one triangle without light.
fn triangle() -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -1], "max": [1, 0, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": format!("data:application/octet-stream;base64,{TRIANGLE}")}],
    })
}

#[track_caller]
fn read(path: &Path) -> ExrImage {
    read_exr(path).expect("an OpenEXR image")
}

#[test]
fn bake_writes_its_five_files_and_nothing_else() {
    let t = temp();
    let out = t.path().join("new/folder");
    let run = bake(&asset("cornell_box.glb"), &out, "").ok();
    assert_eq!(run.stdout, "");
    assert!(run.stderr.contains("baked cornell_box.glb"));
    assert_eq!(names(&out), outputs("cornell_box"));
    let got = files(&out);
    assert!(got["cornell_box.glb"].starts_with(b"glTF\x02\0\0\0"));
    assert!(got["cornell_box.vertex.glb"].starts_with(b"glTF\x02\0\0\0"));
    assert!(got["cornell_box.lightmap.exr"].starts_with(b"\x76\x2f\x31\x01"));
    parse(&got["cornell_box.lightmap.json"]);
    comparable(&got["cornell_box.report.json"]);
}

#[test]
fn outputs_name_no_folder_of_this_machine() {
    let t = temp();
    let out = t.path().join("out");
    let scene = t.path().join("level.glb");
    fs::copy(asset("cornell_box.glb"), &scene).expect("copy");
    bake(&scene, &out, "").ok();
    let folder = t.path().to_str().expect("UTF-8").as_bytes();
    for (name, bytes) in files(&out) {
        let found = bytes.windows(folder.len()).any(|w| w == folder);
        assert!(!found, "{name} names the folder of the scene");
    }
}

#[test]
fn json_is_all_that_stdout_gets_and_equals_the_file() {
    let t = temp();
    let out = t.path().join("out");
    let run = bake(&asset("furnace_cube_50.glb"), &out, "--json").ok();
    let file = &files(&out)["furnace_cube_50.report.json"];
    // The printed report is the file's, so even times agree.
    assert_eq!(parse(&run.stdout), parse(file));
}

#[test]
fn quiet_says_nothing_and_warnings_are_no_exception() {
    let t = temp();
    let scene = write(t.path().join("dark.gltf"), triangle().to_string());
    let loud = bake(&scene, &t.path().join("a"), "").ok();
    assert!(loud.stderr.contains("warning: "), "{}", loud.stderr);
    let quiet = bake(&scene, &t.path().join("b"), "-q").ok();
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));
}

#[test]
fn help_and_version_go_to_stdout() {
    for option in ["--help", "--version"] {
        let run = lumel([option]).ok();
        assert!(run.stdout.contains("lumel"), "{}", run.stdout);
        assert_eq!(run.stderr, "");
    }
}

#[test]
fn wrong_usage_is_1() {
    let t = temp();
    let out = t.path().join("out");
    let scene = asset("furnace_cube_50.glb");
    for options in [
        "--no-such-flag",
        "--unwrapper best",
        "--sun 0,0,0,10",
        "--sun 0,-1,0",
        "--sun 0,-1,0,nan",
        "--threads 0",
        "--threads=-1",
        "--threads 100000",
        "--sky=-1",
        "--sky 1,2",
        "--sky-intensity=-1",
        "--sky-intensity nan",
        "--error 0",
        "--error=-0.1",
        "--error nan",
        "--max-page 0",
        "--padding 4000000000",
        "--layers direct,nothing",
        "-q -v",
    ] {
        bake(&scene, &out, options).fails(1, &[]);
        assert!(!out.exists(), "{options} left a folder behind");
    }
    // Not in the list above, because `bake` passes this option itself.
    for value in ["0", "-1", "nan", "inf", "many"] {
        let density = format!("--texels-per-unit={value}");
        let paths = [scene.to_str().expect("UTF-8"), out.to_str().expect("UTF-8")];
        lumel(["bake", paths[0], "-q", "-o", paths[1], &density]).fails(1, &[]);
        assert!(!out.exists(), "{density} left a folder behind");
        lumel(["inspect", paths[0], &density]).fails(1, &[]);
    }
    lumel(["bake"]).fails(1, &[]);
    lumel(["frobnicate"]).fails(1, &[]);
    // A negative number is a value, not an option that does not exist.
    for (options, expected) in [
        ("--vertex-error -1", "above 0"),
        ("--error -1", "above 0"),
        ("--sky -1", "#rrggbb"),
        ("--padding -1", "--padding"),
    ] {
        bake(&scene, &out, options).fails(1, &["-1", expected]);
    }
    bake(&scene, &out, "--probes many").fails(2, &["many: ", "a spacing in metres or a file"]);
}

#[test]
fn a_reflectance_limit_out_of_range_is_1() {
    let t = temp();
    for value in ["nan", "-1", "1.5"] {
        let option = format!("-q --max-reflectance={value}");
        bake(
            &asset("furnace_cube_50.glb"),
            &t.path().join("out"),
            &option,
        )
        .fails(1, &[]);
    }
}

#[test]
fn unreadable_and_unwritable_paths_are_2() {
    let t = temp();
    let out = t.path().join("out");
    let missing = t.path().join("missing.glb");
    bake(&missing, &out, "-q").fails(2, &["missing.glb"]);
    bake(t.path(), &out, "-q").fails(2, &[]);
    assert!(!out.exists());
    let file = write(t.path().join("taken"), "a file");
    bake(&asset("furnace_cube_50.glb"), &file, "-q").fails(2, &["taken"]);
    assert_eq!(fs::read(&file).expect("still there"), b"a file");
    bake(&asset("furnace_cube_50.glb"), &out, "-q --sky missing.hdr").fails(2, &["missing.hdr"]);
    assert!(!out.exists());
}

#[test]
fn what_is_no_gltf_is_3() {
    let t = temp();
    let out = t.path().join("out");
    let whole = fs::read(asset("cornell_box.glb")).expect("the asset exists");
    let json_length = u32::from_le_bytes(whole[12..16].try_into().expect("four bytes")) as usize;
    let mut wrong_chunk = whole.clone();
    wrong_chunk[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    let cases: [(&str, &[u8]); 11] = [
        ("empty.glb", b""),
        ("empty.gltf", b""),
        ("garbage.glb", b"\xff\x00garbage that is no glTF\x80"),
        ("garbage.gltf", b"\xff\x00garbage that is no glTF\x80"),
        ("no_json.gltf", b"{\"asset\": {\"version\": "),
        ("array.gltf", b"[]"),
        ("object.gltf", b"{}"),
        ("only_magic.glb", &whole[..4]),
        ("only_header.glb", &whole[..12]),
        ("half_json.glb", &whole[..20 + json_length / 2]),
        ("half_binary.glb", &whole[..whole.len() - 100]),
    ];
    for (name, bytes) in cases
        .into_iter()
        .chain([("wrong_chunk.glb", &wrong_chunk[..])])
    {
        let scene = write(t.path().join(name), bytes);
        bake(&scene, &out, "-q").fails(3, &[name]);
        assert!(!out.exists(), "{name} left a folder behind");
        let path = scene.to_str().expect("UTF-8");
        lumel(["inspect", path]).fails(3, &[name]);
    }
    bake(&asset("cornell_box.glb"), &out, "-q --scene 7").fails(3, &["cornell_box.glb"]);
    assert!(!out.exists());
    let sky = write(t.path().join("sky.hdr"), "no picture");
    let option = format!("-q --sky {}", sky.display());
    bake(&asset("cornell_box.glb"), &out, &option).fails(3, &["sky.hdr"]);
    assert!(!out.exists());
}

#[test]
fn what_is_not_supported_is_4() {
    let t = temp();
    let out = t.path().join("out");
    let mut old = triangle();
    old["asset"]["version"] = json!("1.0");
    let mut extended = triangle();
    extended["extensionsUsed"] = json!(["VENDOR_unheard_of"]);
    extended["extensionsRequired"] = json!(["VENDOR_unheard_of"]);
    for (name, document, word) in [
        ("old.gltf", old, "1.0"),
        ("extended.gltf", extended, "VENDOR_unheard_of"),
    ] {
        let scene = write(t.path().join(name), document.to_string());
        bake(&scene, &out, "-q").fails(4, &[name, word]);
        assert!(!out.exists(), "{name} left a folder behind");
    }
}

#[test]
fn strict_makes_warnings_5_and_only_warnings() {
    let t = temp();
    let scene = write(t.path().join("dark.gltf"), triangle().to_string());
    let out = t.path().join("out");
    bake(&scene, &out, "-q --strict").fails(5, &["--strict"]);
    // Warnings under --strict still write the results.
    assert_eq!(names(&out), outputs("dark"));
    bake(&asset("furnace_cube_50.glb"), &out, "--strict").ok();
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let t = temp();
    // Charts and light are computed concurrently unless there is one thread or `--in-turn`.
    let [one, two, in_turn] = ["1", "2", "2 --in-turn"].map(|n| {
        let out = t.path().join(n);
        let options = format!("--layers direct,indirect,error --sky 0.1 --threads {n}");
        bake(&asset("cornell_box.glb"), &out, &options).ok();
        files(&out)
    });
    for other in [two, in_turn] {
        assert_eq!(
            one.keys().collect::<Vec<_>>(),
            other.keys().collect::<Vec<_>>()
        );
        for (name, bytes) in &one {
            if name.ends_with(".report.json") {
                assert_eq!(comparable(bytes), comparable(&other[name]));
            } else {
                assert!(*bytes == other[name], "{name} differs");
            }
        }
    }
}

#[test]
fn the_portable_kernel_changes_no_byte() {
    let t = temp();
    let [fastest, portable] = ["", "portable"].map(|kernel| {
        let out = t.path().join(format!("out{kernel}"));
        let mut bake = cheap(&asset("cornell_box.glb"), &out);
        bake.env("LUMEL_KERNEL", kernel);
        bake.args(["-q", "--sky", "0.1"]);
        assert!(bake.status().expect("the binary starts").success());
        files(&out)
    });
    for (name, bytes) in fastest.iter().filter(|f| !f.0.ends_with(".report.json")) {
        assert!(*bytes == portable[name], "{name} differs");
    }
}

#[test]
fn inspect_prints_and_writes_nothing() {
    let t = temp();
    let scene = t.path().join("level.glb");
    fs::copy(asset("cornell_box.glb"), &scene).expect("copy");
    let path = scene.to_str().expect("UTF-8");
    let text = lumel(["inspect", path]).ok();
    assert!(text.stdout.contains("triangles 38"), "{}", text.stdout);
    assert_eq!(text.stderr, "");
    let machine = lumel(["inspect", path, "--json"]).ok();
    assert!(parse(&machine.stdout).is_object());
    assert_eq!(machine.stderr, "");
    assert_eq!(names(t.path()), ["level.glb"]);
}

#[test]
fn diff_of_a_map_with_itself_is_zero() {
    let t = temp();
    bake(&asset("cornell_box.glb"), t.path(), "").ok();
    let map = t.path().join("cornell_box.lightmap.exr");
    let map = map.to_str().expect("UTF-8");
    let report = parse(&lumel(["diff", map, map, "--json"]).ok().stdout);
    for key in [
        "relRMSE", "relRMSE0", "nRMSE", "bias", "p50", "p95", "p99", "max",
    ] {
        assert_eq!(report[key], json!(0.0), "{key}");
    }
    assert!(report["lumels"].as_u64().is_some_and(|n| n > 0), "{report}");
    let text = lumel(["diff", map, map]).ok();
    assert!(
        text.stdout.contains("relRMSE   0.0000 %"),
        "{}",
        text.stdout
    );
    assert_eq!(names(t.path()), outputs("cornell_box"));
}

#[test]
fn diff_tells_maps_apart_and_paints_where() {
    let t = temp();
    let scene = asset("cornell_box.glb");
    let folders = ["a", "b"].map(|n| t.path().join(n));
    bake(&scene, &folders[0], "").ok();
    bake(&scene, &folders[1], "--sky 1").ok();
    let [a, b] = folders.map(|f| f.join("cornell_box.lightmap.exr"));
    let picture = t.path().join("error.png");
    let words = [a.to_str(), b.to_str(), picture.to_str()].map(|w| w.expect("UTF-8"));
    let run = lumel(["diff", words[0], words[1], "--json", "--picture", words[2]]).ok();
    let report = parse(run.stdout);
    // The sky only adds light.
    assert!(
        report["relRMSE"].as_f64().is_some_and(|x| x > 0.0),
        "{report}"
    );
    assert!(report["bias"].as_f64().is_some_and(|x| x > 0.0), "{report}");
    assert!(fs::read(picture).expect("written").starts_with(b"\x89PNG"));
}

#[test]
fn diff_of_what_cannot_be_compared_fails_with_one_message() {
    let t = temp();
    bake(&asset("cornell_box.glb"), t.path(), "").ok();
    bake(&asset("furnace_cube_50.glb"), t.path(), "").ok();
    let path = |name: &str| t.path().join(name).to_str().expect("UTF-8").to_owned();
    let (a, b) = (
        path("cornell_box.lightmap.exr"),
        path("furnace_cube_50.lightmap.exr"),
    );
    let run = lumel(["diff", &a, &b]);
    assert_ne!(run.code, Some(0));
    run.fails(run.code.expect("it ends by itself"), &["sizes differ"]);
    lumel(["diff", &a, &path("missing.exr")]).fails(2, &["missing.exr"]);
    let garbage = path("garbage.exr");
    write(garbage.clone().into(), "no picture");
    let run = lumel(["diff", &a, &garbage]);
    assert_ne!(run.code, Some(0));
    run.fails(run.code.expect("it ends by itself"), &["garbage.exr"]);
}

#[test]
fn preview_and_report_go_where_they_are_told() {
    let t = temp();
    let (out, picture, report) = (
        t.path().join("out"),
        t.path().join("a b.png"),
        t.path().join("r.json"),
    );
    let scene = asset("cornell_box.glb");
    let mut arguments: Vec<&OsStr> =
        vec!["bake".as_ref(), scene.as_ref(), "-o".as_ref(), out.as_ref()];
    arguments.extend(["--quality", "draft", "--texels-per-unit", "4", "--preview"].map(OsStr::new));
    arguments.extend([picture.as_os_str(), "--report".as_ref(), report.as_os_str()]);
    lumel(arguments).ok();
    let png = fs::read(picture).expect("written");
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n") && png.ends_with(b"IEND\xaeB`\x82"));
    assert_eq!(names(&out), outputs("cornell_box"));
    assert_eq!(
        parse(fs::read(report).expect("written")),
        parse(&files(&out)["cornell_box.report.json"])
    );
}

#[test]
fn the_first_picture_shows_the_level_as_it_will_be() {
    let t = temp();
    let scene = asset("cornell_box.glb");
    let mut found = Vec::new();
    for threads in [1, 2] {
        let [out, first, last] = [
            format!("out{threads}"),
            format!("first{threads}.png"),
            format!("last{threads}.png"),
        ]
        .map(|n| t.path().join(n));
        let options = format!(
            "--threads {threads} --first-picture {} --preview {}",
            first.display(),
            last.display()
        );
        let run = bake(&scene, &out, &options).ok();
        assert!(run.stderr.contains("first"), "{}", run.stderr);
        assert_eq!(names(&out), outputs("cornell_box"));
        found.push([&first, &last].map(|p| fs::read(p).expect("written")));
    }
    assert!(found[0] == found[1], "threads change pictures");
    let [first, last] =
        (found.remove(0)).map(|png| image::load_from_memory(&png).expect("a PNG").to_rgb8());
    assert_eq!(first.dimensions(), (640, 360));
    // Means over blocks of 40 pixels hide patches and noise of shadow rays, but not a factor of π
    // or a missing light.
    let mut worst = 0.0f64;
    for (bx, by) in (0..16).flat_map(|x| (0..9).map(move |y| (x, y))) {
        let mean = |picture: &image::RgbImage, side: u32| -> f64 {
            let at = |k: u32| picture.get_pixel(bx * side + k % side, by * side + k / side);
            let sum: f64 = (0..side * side)
                .map(|k| at(k).0.iter().map(|c| f64::from(*c)).sum::<f64>())
                .sum();
            sum / f64::from(3 * side * side)
        };
        worst = worst.max((mean(&first, 40) - mean(&last, 80)).abs());
    }
    // The test finds 3.9 of 255, because lumels are coarse here; half the light would be 50.
    assert!(worst < 8.0, "{worst}");
}

#[test]
fn layers_are_further_channels() {
    let t = temp();
    let scene = asset("cornell_box.glb");
    let folders = ["plain", "layered"].map(|n| t.path().join(n));
    bake(&scene, &folders[0], "").ok();
    bake(
        &scene,
        &folders[1],
        "--layers direct,indirect,radiosity,error,coverage",
    )
    .ok();
    let [plain, layered] = folders.map(|f| read(&f.join("cornell_box.lightmap.exr")));
    let channels =
        |image: &ExrImage| -> Vec<String> { image.channels.iter().map(|c| c.0.clone()).collect() };
    let mut expected: Vec<String> = ["R", "G", "B", "error.Y", "coverage.Y"]
        .map(String::from)
        .to_vec();
    for layer in ["direct", "indirect", "radiosity"] {
        expected.extend(["R", "G", "B"].map(|c| format!("{layer}.{c}")));
    }
    expected.sort();
    assert_eq!(channels(&plain), ["B", "G", "R"]);
    assert_eq!(channels(&layered), expected);
    let get = |name: &str| layered.channel(name).expect("it is there");
    for c in ["R", "G", "B"] {
        assert_eq!(plain.channel(c), layered.channel(c), "layers change {c}");
        let (all, direct, indirect) = (
            get(c),
            get(&format!("direct.{c}")),
            get(&format!("indirect.{c}")),
        );
        for (i, &x) in all.iter().enumerate() {
            // Three samples rounded to halves: each is off by at most 2^-11 of its value, or 2^-25
            // if subnormal.
            let slack = (x + direct[i].abs() + indirect[i].abs()) / 2048. + 3. / (1 << 25) as f32;
            let sum = direct[i] + indirect[i];
            assert!((x - sum).abs() <= slack, "{c} at {i}: {x} against {sum}");
        }
    }
    assert!(get("coverage.Y").iter().all(|x| (0. ..=1.).contains(x)));
    assert!(get("coverage.Y").contains(&1.));
    assert!(get("error.Y").iter().all(|&x| x >= 0.));
}

#[test]
fn irradiance_is_pi_times_radiance() {
    let t = temp();
    let scene = asset("cornell_box.glb");
    let [radiance, irradiance] = ["radiance", "irradiance"].map(|value| {
        let out = t.path().join(value);
        bake(&scene, &out, &format!("--value {value}")).ok();
        read(&out.join("cornell_box.lightmap.exr"))
    });
    let pi = std::f32::consts::PI;
    for ((name, r), (_, e)) in radiance.channels.iter().zip(&irradiance.channels) {
        assert!(r.iter().any(|&x| x > 0.), "{name} is dark");
        for (r, e) in r.iter().zip(e) {
            // Both were rounded to halves: 2^-11 of the value each, 2^-25 if subnormal. f32
            // arithmetic adds far less.
            let slack = pi * r / 1024. + (1. + pi) / (1 << 25) as f32;
            assert!((pi * r - e).abs() <= slack, "{name}: {r} and {e}");
        }
    }
}

#[test]
fn names_with_spaces_and_beyond_ascii_work() {
    let t = temp();
    let folder = t.path().join("märz ordner");
    fs::create_dir(&folder).expect("created");
    let scene = folder.join("größe 三 #1%20.v2.glb");
    fs::copy(asset("cornell_box.glb"), &scene).expect("copy");
    let out = t.path().join("aus gabe ñ");
    bake(&scene, &out, "").ok();
    let mut expected = outputs("größe 三 #1%20.v2");
    expected.sort();
    assert_eq!(names(&out), expected);
}

/// Decodes the `uri` member and opens the file, as an engine does.
#[test]
fn the_uri_in_extras_leads_to_the_map() {
    let t = temp();
    let scene = t.path().join("a #1%20.glb");
    fs::copy(asset("cornell_box.glb"), &scene).expect("copy");
    let out = t.path().join("out");
    bake(&scene, &out, "").ok();
    let baked = files(&out).remove("a #1%20.glb").expect("written");
    let text = String::from_utf8_lossy(&baked);
    // The manifest has the plain file name, not a percent-encoded URI, so tools can open it
    // directly.
    assert!(text.contains("\"uri\":\"a #1%20.lightmap.exr\""));
    assert!(out.join("a #1%20.lightmap.exr").is_file());
}

#[test]
fn a_preview_over_another_output_is_refused() {
    let t = temp();
    let option = format!(
        "-q --preview {}",
        t.path().join("cornell_box.glb").display()
    );
    let run = bake(&asset("cornell_box.glb"), t.path(), &option);
    assert_ne!(run.code, Some(0));
}

#[test]
fn a_bake_beside_its_scene_leaves_the_scene_alone() {
    let t = temp();
    let scene = t.path().join("level.glb");
    fs::copy(asset("cornell_box.glb"), &scene).expect("copy");
    let run = bake(&scene, t.path(), "-q");
    assert_ne!(run.code, Some(0));
    assert!(fs::read(&scene).expect("there") == fs::read(asset("cornell_box.glb")).expect("there"));
}

#[test]
fn the_grammar_speaks_for_itself() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let run = lumel(["completions", shell]).ok();
        assert!(run.stdout.contains("skip-if-unchanged"), "{shell}");
    }
    lumel(["completions", "cmd"]).fails(1, &["bash"]);
    let page = lumel(["man"]).ok().stdout;
    assert!(
        page.contains(".TH LUMEL 1") && page.contains("bake"),
        "{page}"
    );
    let page = lumel(["man", "bake"]).ok().stdout;
    assert!(page.contains("texels\\-per\\-unit"), "{page}");
    lumel(["man", "fly"]).fails(1, &["\"fly\"", "bake"]);
    let t = temp();
    let out = t.path().join("man1");
    lumel(["man", "-o", out.to_str().expect("UTF-8")]).ok();
    assert!(names(&out).contains(&"lumel-inspect.1".to_owned()));
    assert!(
        lumel(["config"])
            .ok()
            .stdout
            .contains("#quality = \"preview\"")
    );
}
