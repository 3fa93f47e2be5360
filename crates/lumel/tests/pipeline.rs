//! The real binary as a build step: unchanged inputs, dependency files, ninja and make.

#![allow(clippy::print_stderr, reason = "says what it skips")]

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

use crate::common::{Run, bake, comparable, files, lumel, names, outputs, parse, temp, write};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A document of one textured triangle. Buffer, texture and a normal map that light does not need
/// are separate files.
fn textured(folder: &Path) -> PathBuf {
    let floats: Vec<u8> = [
        0f32, 0., 0., 1., 0., 0., 0., 0., -1., // Positions.
        0., 0., 1., 0., 0., 1., // TEXCOORD_0
    ]
    .iter()
    .flat_map(|x| x.to_le_bytes())
    .collect();
    write(folder.join("level.bin"), &floats);
    write(folder.join("a wall.png"), png([200, 100, 50]));
    write(folder.join("normal.png"), png([128, 128, 255]));
    let document = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{
            "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
            "normalTexture": {"index": 1},
        }],
        "textures": [{"source": 0}, {"source": 1}],
        "images": [{"uri": "a%20wall.png"}, {"uri": "normal.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -1], "max": [1, 0, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
        "buffers": [{"byteLength": 60, "uri": "level.bin"}],
    });
    write(folder.join("level.gltf"), document.to_string())
}

/// A 1 × 1 PNG of one colour.
fn png(rgb: [u8; 3]) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let picture = image::RgbImage::from_pixel(1, 1, image::Rgb(rgb));
    picture
        .write_to(&mut out, image::ImageFormat::Png)
        .expect("PNG can be written to memory");
    out.into_inner()
}

/// A folder with a scene, and bakes of it into `out`.
struct Level {
    folder: TempDir,
    scene: PathBuf,
}

impl Level {
    fn new() -> Level {
        let folder = temp();
        let scene = textured(folder.path());
        Level { folder, scene }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn bake(&self, options: &str) -> Run {
        bake(
            &self.scene,
            &self.path("out"),
            &format!("--sky 1 {options}"),
        )
    }

    /// Whether a bake with these options finds everything up to date.
    #[track_caller]
    fn skips(&self, options: &str) -> bool {
        let run = self.bake(&format!("--skip-if-unchanged {options}")).ok();
        let skipped = run.stderr.starts_with("unchanged: ");
        assert_eq!(run.stderr.lines().count() == 1, skipped, "{}", run.stderr);
        assert_eq!(run.stderr.contains("baked level.gltf"), !skipped);
        skipped
    }
}

/// Sets a file's modification time far back, and returns it.
fn age(path: &Path) -> SystemTime {
    let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000);
    let file = File::options().write(true).open(path).expect("it exists");
    file.set_modified(then).expect("times can be set");
    modified(path)
}

fn modified(path: &Path) -> SystemTime {
    fs::metadata(path)
        .expect("it exists")
        .modified()
        .expect("files have times")
}

#[test]
fn an_unchanged_bake_is_skipped_and_touches_nothing() {
    let level = Level::new();
    assert!(!level.skips(""), "nothing is there yet");
    let before = files(&level.path("out"));
    let times: Vec<_> = before
        .keys()
        .map(|n| age(&level.path("out").join(n)))
        .collect();
    assert!(level.skips(""));
    // Times change, contents do not.
    for name in ["level.gltf", "level.bin", "a wall.png"] {
        let bytes = fs::read(level.path(name)).expect("it exists");
        write(level.path(name), bytes);
    }
    assert!(level.skips(""));
    assert!(
        level.skips("--threads 1 --strict"),
        "what changes no byte is no change"
    );
    let quiet = level.bake("--skip-if-unchanged -q").ok();
    assert_eq!(quiet.stderr, "");
    let printed = level.bake("--skip-if-unchanged --json").ok();
    assert_eq!(printed.stdout.as_bytes(), before["level.report.json"]);
    let after: Vec<_> = before
        .keys()
        .map(|n| modified(&level.path("out").join(n)))
        .collect();
    assert_eq!(times, after);
    assert!(before == files(&level.path("out")));
}

#[test]
fn every_changed_input_is_noticed() {
    let level = Level::new();
    level.bake("").ok();
    for (name, bytes) in [
        ("a wall.png", png([1, 2, 3])),
        // Light does not need it, but the results embed it.
        ("normal.png", png([3, 2, 1])),
    ] {
        write(level.path(name), bytes);
        assert!(!level.skips(""), "{name}");
        assert!(level.skips(""), "{name}");
    }
    let mut buffer = fs::read(level.path("level.bin")).expect("it exists");
    buffer[11] ^= 1;
    write(level.path("level.bin"), buffer);
    assert!(!level.skips(""));
    let scene = fs::read_to_string(&level.scene).expect("it exists");
    write(level.scene.clone(), scene.replace("true", "false"));
    assert!(!level.skips(""));
    assert!(level.skips(""));
    // A missing texture is an error of the bake, not of the check; one that light does not need is
    // a warning.
    fs::remove_file(level.path("normal.png")).expect("removed");
    assert!(!level.skips(""));
    assert!(level.skips(""), "what was not there still is not");
    fs::remove_file(level.path("a wall.png")).expect("removed");
    let run = level.bake("--skip-if-unchanged");
    assert_ne!(run.code, Some(0), "{}", run.stderr);
}

#[test]
fn every_changed_setting_is_noticed() {
    let level = Level::new();
    level.bake("").ok();
    for options in [
        "--sun 0,-1,0,5",
        "--no-stitch",
        "--no-vertex-colors",
        "--light sky=2",
        "--padding 3",
    ] {
        assert!(!level.skips(options), "{options}");
        assert!(level.skips(options), "{options}");
    }
    let sky = write(level.path("sky.hdr"), hdr(1));
    let option = format!("--skip-if-unchanged --sky {}", sky.display());
    let with_sky = || bake(&level.scene, &level.path("out"), &option).ok().stderr;
    assert!(with_sky().contains("baked"));
    assert!(with_sky().contains("unchanged"));
    write(sky.clone(), hdr(2));
    assert!(with_sky().contains("baked"));
}

/// A Radiance image of 2 × 1 pixels, uncompressed, with `x` as mantissas.
fn hdr(x: u8) -> Vec<u8> {
    let mut out = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    // Small mantissas would be run-length markers.
    let m = 100 + x;
    out.extend([m, m, m, 128, m, m, m, 128]);
    out
}

#[test]
fn every_output_that_is_not_whole_is_made_again() {
    let level = Level::new();
    level.bake("").ok();
    let clean = files(&level.path("out"));
    for (name, bytes) in &clean {
        let path = level.path("out").join(name);
        let mut edited = bytes.clone();
        let middle = edited.len() / 2;
        edited[middle] ^= 1;
        for wrong in [
            None,
            Some(&bytes[..bytes.len() - 1]),
            Some(&edited[..]),
            Some(&[][..]),
        ] {
            match wrong {
                None => fs::remove_file(&path).expect("removed"),
                Some(wrong) => fs::write(&path, wrong).expect("written"),
            }
            assert!(!level.skips(""), "{name}");
        }
    }
    for (name, bytes) in files(&level.path("out")) {
        if name.ends_with("report.json") {
            assert_eq!(comparable(bytes), comparable(&clean[&name]));
        } else {
            assert!(bytes == clean[&name], "{name}");
        }
    }
}

#[test]
fn a_bake_leaves_files_alone_that_stay_the_same() {
    let level = Level::new();
    level.bake("").ok();
    let out = level.path("out");
    let map = out.join("level.lightmap.exr");
    let vertex = out.join("level.vertex.glb");
    let old = [age(&map), age(&vertex)];
    // A setting that has no effect on this scene.
    level.bake("--max-reflectance 0.97").ok();
    assert_eq!([modified(&map), modified(&vertex)], old);
    level.bake("--sky-intensity 2").ok();
    assert!(modified(&map) > old[0]);
}

#[test]
fn skipping_gives_the_exit_code_and_files_of_a_bake() {
    let level = Level::new();
    let dark = |options: &str| bake(&level.scene, &level.path("dark"), options);
    dark("--strict -q").fails(5, &[]);
    dark("--strict -q --skip-if-unchanged").fails(5, &["--strict"]);
    let extra = |name: &str| level.path(name);
    let options = format!(
        "--report {} --preview {} --depfile {}",
        extra("r.json").display(),
        extra("p.png").display(),
        extra("d.d").display()
    );
    assert!(!level.skips(&options));
    let made: Vec<Vec<u8>> = ["r.json", "p.png", "d.d"]
        .iter()
        .map(|n| fs::read(extra(n)).expect("made"))
        .collect();
    // The report's copy and the dependency file are rewritten; the picture must be baked again.
    for name in ["r.json", "d.d"] {
        fs::remove_file(extra(name)).expect("removed");
        assert!(level.skips(&options), "{name}");
    }
    fs::remove_file(extra("p.png")).expect("removed");
    assert!(level.skips(""), "no picture is asked for");
    assert!(!level.skips(&options));
    assert!(fs::read(extra("p.png")).expect("made") == made[1]);
    assert!(fs::read(extra("d.d")).expect("made") == made[2]);
}

#[test]
fn the_record_names_all_that_was_read_and_no_folder() {
    let level = Level::new();
    level.bake("").ok();
    let report = parse(&files(&level.path("out"))["level.report.json"]);
    let content = &report["content"];
    let uris: Vec<&str> = (content["inputs"].as_array().expect("a list").iter())
        .filter_map(|i| i["uri"].as_str())
        .collect();
    assert_eq!(
        uris,
        ["level.gltf", "level.bin", "a%20wall.png", "normal.png"]
    );
    let recorded: Vec<&str> = (content["outputs"].as_array().expect("a list").iter())
        .filter_map(|i| i["file"].as_str())
        .collect();
    let mut expected = outputs("level");
    expected.retain(|n| n != "level.report.json");
    let mut sorted = recorded.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, expected);
    // The same scene in another folder.
    let other = Level::new();
    other.bake("").ok();
    let again = parse(&files(&other.path("out"))["level.report.json"]);
    assert_eq!(&again["content"], content);
}

#[test]
fn a_depfile_names_targets_and_inputs() {
    let level = Level::new();
    let depfile = level.path("deps.d");
    level.bake(&format!("--depfile {}", depfile.display())).ok();
    let text = fs::read_to_string(&depfile).expect("written");
    let (rule, phony) = text.split_once("\n\n").expect("a rule, then empty ones");
    let (targets, inputs) = rule.split_once(':').expect("a rule");
    for name in outputs("level") {
        assert!(targets.contains(&name), "{name}: {text}");
    }
    for name in ["level.gltf", "level.bin", "a\\ wall.png", "normal.png"] {
        assert!(inputs.contains(name), "{name}: {text}");
        assert!(phony.contains(&format!("{name}:\n")), "{name}: {text}");
    }
    let option = format!("--depfile {} --depfile-target stamp", depfile.display());
    level.bake(&option).ok();
    let text = fs::read_to_string(&depfile).expect("written");
    assert!(text.starts_with("stamp:"), "{text}");
    level
        .bake(&format!("-q --depfile {}", level.scene.display()))
        .fails(1, &["also an input"]);
}

#[test]
fn settings_beside_the_scene_are_found_and_options_go_before_them() {
    let level = Level::new();
    let config = write(
        level.path("level.lumel.toml"),
        "max-reflectance = 0.5\nvalue = \"irradiance\"\n[[light]]\nname = \"sky\"\nfactor = 2\n",
    );
    let settings = |options: &str| -> (Value, Value) {
        level.bake(options).ok();
        let mut report = parse(&files(&level.path("out"))["level.report.json"]);
        (report["settings"].take(), report["origins"].take())
    };
    let (s, origins) = settings("--value radiosity --light sky=3");
    assert_eq!(
        (&s["max_reflectance"], &s["value"]),
        (&json!(0.5), &json!("radiosity"))
    );
    assert_eq!(s["lights"][1]["factor"], json!(3.0), "{s}");
    assert_eq!(
        (&origins["max-reflectance"], &origins["value"]),
        (&json!("file"), &json!("flag"))
    );
    let (s, _) = settings("--no-config");
    assert_eq!(
        (&s["max_reflectance"], &s["value"]),
        (&json!(0.98), &json!("radiance"))
    );
    let other = write(level.path("other.toml"), "max-reflectance = 0.25");
    let (s, _) = settings(&format!("--config {}", other.display()));
    assert_eq!(
        (&s["max_reflectance"], &s["value"]),
        (&json!(0.25), &json!("radiance"))
    );
    // An edited settings file is noticed, and is a dependency.
    let depfile = level.path("d");
    let options = format!("--depfile {}", depfile.display());
    assert!(!level.skips(&options));
    assert!(level.skips(&options));
    write(config.clone(), "max-reflectance = 0.6");
    assert!(!level.skips(&options));
    assert!(
        fs::read_to_string(&depfile)
            .expect("written")
            .contains("level.lumel.toml")
    );
    fs::remove_file(config).expect("removed");
    assert!(!level.skips(&options));
}

#[test]
fn wrong_settings_are_3_and_say_where() {
    let level = Level::new();
    let config = write(
        level.path("level.lumel.toml"),
        "quality = \"draft\"\npaddin = 2\n",
    );
    level
        .bake("-q")
        .fails(3, &["level.lumel.toml:2:1: ", "`paddin`", "`padding`"]);
    assert!(!level.path("out").exists());
    let path = level.scene.to_str().expect("UTF-8");
    lumel(["inspect", path]).fails(3, &["level.lumel.toml:2:1: "]);
    write(config.clone(), b"\xff\xfe");
    level.bake("-q").fails(3, &["UTF-8"]);
    fs::remove_file(&config).expect("removed");
    fs::create_dir(&config).expect("created");
    level.bake("-q").fails(2, &["level.lumel.toml"]);
    level
        .bake("-q --config missing.toml")
        .fails(2, &["missing.toml"]);
}

/// Runs a build tool in the level's folder, and returns its output.
#[track_caller]
fn build(program: &str, level: &Level) -> String {
    let out = Command::new(program)
        .current_dir(level.folder.path())
        .output()
        .expect("it starts");
    let text =
        String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{text}");
    text
}

fn is_installed(program: &str) -> bool {
    let there = Command::new(program)
        .arg("--version")
        .output()
        .is_ok_and(|o| o.status.success());
    if !there {
        eprintln!("SKIPPED: {program} is not installed");
    }
    there
}

/// An example of the documentation with this binary in place of `lumel`.
fn example(language: &str) -> String {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/pipeline.md");
    let page = fs::read_to_string(page).expect("the page exists");
    let (_, rest) = page
        .split_once(&format!("```{language}\n"))
        .expect("it has an example");
    let (text, _) = rest.split_once("```").expect("the example ends");
    text.replace(
        "lumel bake",
        concat!(env!("CARGO_BIN_EXE_lumel"), " bake --texels-per-unit 4"),
    )
}

/// Touches a texture, edits one and deletes an output; `again` says whether the build tool ran the
/// command.
fn rebuilds_what_it_must(program: &str, level: &Level) {
    let ran = |text: &str| text.contains("baked level.gltf") || text.contains("unchanged: ");
    let out = level.path("out");
    assert!(build(program, level).contains("baked level.gltf"));
    assert_eq!(
        names(&out)
            .iter()
            .filter(|n| n.starts_with("level."))
            .count(),
        5 + usize::from(program == "make")
    );
    let text = build(program, level);
    assert!(!ran(&text), "nothing changed: {text}");
    // File systems and build tools reliably distinguish one second.
    std::thread::sleep(Duration::from_millis(1100));
    let texture = level.path("a wall.png");
    let bytes = fs::read(&texture).expect("it exists");
    write(texture.clone(), bytes);
    let text = build(program, level);
    assert!(
        text.contains("unchanged: ") && !text.contains("copying"),
        "a touched texture: {text}"
    );
    let text = build(program, level);
    assert!(!ran(&text), "the touch was dealt with: {text}");
    std::thread::sleep(Duration::from_millis(1100));
    write(texture, png([9, 9, 9]));
    assert!(
        build(program, level).contains("baked level.gltf"),
        "an edited texture"
    );
    fs::remove_file(out.join("level.lightmap.exr")).expect("removed");
    assert!(
        build(program, level).contains("baked level.gltf"),
        "a deleted output"
    );
    assert!(out.join("level.lightmap.exr").exists());
    let text = build(program, level);
    assert!(!ran(&text), "nothing changed: {text}");
}

#[test]
fn ninja_rebuilds_what_it_must_and_no_more() {
    let level = Level::new();
    write(level.path("build.ninja"), example("ninja"));
    if is_installed("ninja") {
        rebuilds_what_it_must("ninja", &level);
    }
}

#[test]
fn make_rebuilds_what_it_must_and_no_more() {
    let level = Level::new();
    write(level.path("Makefile"), example("make"));
    if is_installed("make") {
        rebuilds_what_it_must("make", &level);
    }
}
