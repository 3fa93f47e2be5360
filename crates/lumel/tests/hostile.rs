//! Inputs that once broke the real binary: each gives one error at once, and the user's files stay
//! untouched.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::common::{Run, asset, bake, files, lumel, parse, temp, write};

/// The triangle (0 0 0), (1 0 0), (0 0 −1) as bytes.
fn triangle() -> Vec<u8> {
    let floats = [0f32, 0., 0., 1., 0., 0., 0., 0., -1.];
    floats.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// A triangle with its own buffer, and an image that light does not need.
fn document(buffer: &str, picture: &str) -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "images": [{"uri": picture}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [0, 0, -1], "max": [1, 0, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": buffer}],
    })
}

/// A folder with a scene whose buffer and image have these names.
fn level(buffer: &str, picture: &str) -> (TempDir, PathBuf) {
    let folder = temp();
    write(folder.path().join(buffer), triangle());
    write(
        folder.path().join(picture),
        b"a picture, as far as anybody knows",
    );
    let scene = folder.path().join("c.gltf");
    write(scene.clone(), document(buffer, picture).to_string());
    (folder, scene)
}

/// Asserts that a bake into `out` is refused with exit code 2, names the file that it would
/// replace, and changes nothing in `folder`.
#[track_caller]
fn refused(folder: &Path, scene: &Path, out: &Path, options: &str, name: &str) {
    let before = snapshot(folder);
    let run = bake(scene, out, &format!("-q --sky 1 {options}"));
    run.fails(2, &[name, "would replace"]);
    assert!(snapshot(folder) == before, "{options}: {run:?}");
}

/// All files below a folder.
fn snapshot(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            all.extend(snapshot(&path));
        } else {
            let bytes = fs::read(&path).unwrap_or_default();
            all.push((path, bytes));
        }
    }
    all.sort();
    all
}

#[test]
fn files_that_the_scene_names_are_not_replaced() {
    // Replaced by results, and by further pages of an earlier bake.
    for (buffer, picture, replaced) in [
        ("c.lightmap.exr", "p.png", "c.lightmap.exr"),
        ("c.bin", "c.report.json", "c.report.json"),
        ("c.bin", "c.lightmap.3.exr", "c.lightmap.3.exr"),
    ] {
        let (folder, scene) = level(buffer, picture);
        refused(folder.path(), &scene, folder.path(), "", replaced);
    }
    // Replaced by files that options name.
    let (folder, scene) = level("c.bin", "p.png");
    let out = folder.path().join("out");
    for option in ["--preview", "--first-picture", "--depfile", "--report"] {
        for name in ["c.bin", "p.png"] {
            let path = folder.path().join(name);
            let option = format!("{option} {}", path.display());
            refused(folder.path(), &scene, &out, &option, name);
        }
    }
    // The sky has the name of a result.
    let sky = folder.path().join("c.lightmap.exr");
    fs::copy(sky_picture(folder.path()), &sky).expect("copied");
    let option = format!("--sky {}", sky.display());
    let before = snapshot(folder.path());
    let run = bake(&scene, folder.path(), &format!("-q {option}"));
    run.fails(2, &["c.lightmap.exr", "would replace"]);
    assert!(snapshot(folder.path()) == before);
    bake(&scene, &out, &format!("-q {option}")).ok();
}

#[cfg(unix)]
#[test]
fn links_to_inputs_and_links_as_inputs_are_followed() {
    use std::os::unix::fs::symlink;
    // The scene is a link to a result.
    let folder = temp();
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("created");
    fs::copy(asset("cornell_box.glb"), out.join("c.glb")).expect("copied");
    let scene = folder.path().join("c.glb");
    symlink("out/c.glb", &scene).expect("linked");
    refused(folder.path(), &scene, &out, "", "out/c.glb");
    // A result's name is a hard link to the buffer.
    let (folder, scene) = level("c.bin", "p.png");
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("created");
    fs::hard_link(folder.path().join("c.bin"), out.join("c.lightmap.json")).expect("linked");
    refused(folder.path(), &scene, &out, "", "c.lightmap.json");
    // The buffer is in another folder, but has the name of a result.
    let (folder, scene) = level("c.bin", "p.png");
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("created");
    fs::rename(folder.path().join("c.bin"), out.join("c.vertex.glb")).expect("moved");
    symlink("out/c.vertex.glb", folder.path().join("c.bin")).expect("linked");
    refused(folder.path(), &scene, &out, "", "out/c.vertex.glb");
}

#[test]
fn a_glb_beside_the_scene_that_no_bake_made_is_not_replaced() {
    let (folder, scene) = level("c.bin", "p.png");
    let own = write(folder.path().join("c.glb"), b"the user's own");
    refused(folder.path(), &scene, folder.path(), "", "c.glb");
    fs::remove_file(own).expect("removed");
    bake(&scene, folder.path(), "-q --sky 1").ok();
    // Its own earlier result may be replaced.
    bake(&scene, folder.path(), "-q --sky 2").ok();
}

/// A lightmap with four channels, to be corrupted.
fn sky_picture(folder: &Path) -> PathBuf {
    let out = folder.join("sky");
    bake(
        &asset("cornell_box.glb"),
        &out,
        "-q --layers coverage --no-vertex-colors",
    )
    .ok();
    out.join("cornell_box.lightmap.exr")
}

/// 2^30 × 2^30 pixels of four 4-byte channels are 2^64 bytes, which wrapped to 0 and aborted the
/// process.
#[test]
fn an_exr_whose_size_wraps_is_one_error_in_every_command() {
    let folder = temp();
    let exr = sky_picture(folder.path());
    let mut bytes = fs::read(&exr).expect("written");
    let name = b"dataWindow\0box2i\0\x10\0\0\0";
    let at = bytes.windows(name.len()).position(|w| w == name);
    let at = at.expect("every EXR has one") + name.len();
    for (i, x) in [-(1 << 29), -(1 << 29), (1 << 29) - 1, (1 << 29) - 1i32]
        .into_iter()
        .enumerate()
    {
        bytes[at + 4 * i..][..4].copy_from_slice(&x.to_le_bytes());
    }
    let bad = write(folder.path().join("bad.exr"), &bytes);
    let words = ["1073741824 x 1073741824 pixels of 4 channels"];
    let sky = format!("-q --sky {}", bad.display());
    let out = folder.path().join("out");
    bake(&asset("cornell_box.glb"), &out, &sky).fails(3, &words);
    let diff =
        |a: &Path, b: &Path| -> Run { lumel(["diff".as_ref(), a.as_os_str(), b.as_os_str()]) };
    diff(&bad, &exr).fails(3, &words);
    diff(&exr, &bad).fails(3, &words);
    fs::copy(&bad, &exr).expect("copied");
    let baked = exr.parent().expect("a folder");
    lumel(["report".as_ref(), baked.as_os_str()]).fails(3, &words);
    assert!(!files(baked).contains_key("cornell_box.report.html"));
}

#[test]
fn names_reach_the_terminal_escaped() {
    let (folder, scene) = level("c.bin", "p.png");
    let mut document = document("c.bin", "p.png");
    document["accessors"][0]["type"] = json!("\u{1b}[31mEVIL\n\nerror: fake");
    write(scene.clone(), document.to_string());
    let run = bake(&scene, &folder.path().join("out"), "-q --sky 1");
    run.fails(3, &["EVIL"]);
    assert!(!run.stderr.contains('\u{1b}'), "{:?}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{:?}", run.stderr);
}

/// Opening a pipe without a writer blocks, and a device may never end.
#[cfg(unix)]
#[test]
fn pipes_devices_and_folders_are_refused_unread_wherever_a_file_is_read() {
    let folder = temp();
    let at = |name: &str| folder.path().join(name);
    let pipe = |name: &str| {
        let made = Command::new("mkfifo").arg(at(name)).status();
        assert!(made.expect("mkfifo is there").success());
        at(name)
    };
    let (scene, out) = (asset("cornell_box.glb"), at("out"));
    let words = ["expected a regular file", "found a pipe"];
    bake(&pipe("a.glb"), &out, "-q").fails(2, &words);
    lumel(["inspect".as_ref(), at("a.glb").as_os_str()]).fails(2, &words);
    let options = [
        ("--sky", pipe("a.hdr")),
        ("--sky", pipe("a.exr")),
        ("--probes", pipe("a.json")),
        ("--config", pipe("a.toml")),
    ];
    for (option, pipe) in options {
        bake(&scene, &out, &format!("-q {option} {}", pipe.display())).fails(2, &words);
    }
    let exr = at("a.exr");
    lumel(["diff".as_ref(), exr.as_os_str(), exr.as_os_str()]).fails(2, &words);
    bake(&scene, &out, "-q --sky /dev/zero.hdr").fails(2, &["/dev/zero.hdr"]);
    std::os::unix::fs::symlink("/dev/zero", at("zero.hdr")).expect("linked");
    // Without an extension it would not be taken for a file name.
    fs::create_dir(at("folder.hdr")).expect("made");
    for (name, found) in [("zero.hdr", "a device"), ("folder.hdr", "a folder")] {
        let sky = at(name);
        let run = bake(&scene, &out, &format!("-q --sky {}", sky.display()));
        run.fails(2, &[found, "expected a regular file"]);
    }
    // Files that the document references: its buffer, and an image that light needs. An image that
    // light does not need is ignored.
    pipe("b.bin");
    write(at("c.bin"), triangle());
    let level = write(at("c.gltf"), document("b.bin", "a.json").to_string());
    bake(&level, &out, "-q --sky 1").fails(2, &words);
    write(level.clone(), document("c.bin", "a.json").to_string());
    let run = bake(&level, &out, "--sky 1").ok();
    assert!(
        run.stderr
            .contains("images[0]: its file cannot be read: found a pipe"),
        "{run:?}"
    );
    let mut textured = document("c.bin", "a.json");
    textured["textures"] = json!([{"source": 0}]);
    textured["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    textured["meshes"][0]["primitives"][0]["material"] = json!(0);
    write(level, textured.to_string());
    bake(&at("c.gltf"), &out, "-q --sky 1").fails(2, &words);
    fs::remove_dir_all(&out).expect("written");
    fs::rename(at("a.toml"), at("c.lumel.toml")).expect("renamed");
    bake(&at("c.gltf"), &out, "-q").fails(2, &words);
    // In place of the last report, which the bake replaces.
    fs::create_dir(&out).expect("created");
    let report = pipe("out/cornell_box.report.json");
    bake(&scene, &out, "-q --skip-if-unchanged").ok();
    assert!(fs::metadata(report).expect("written").is_file());
}

/// The .glb used to keep the missing file's name, relative to the wrong folder.
#[test]
fn a_picture_that_is_lost_during_the_bake_is_an_error() {
    let (folder, scene) = level("c.bin", "p.png");
    let baker = lumel::Baker::new().quality(lumel::Quality::Draft);
    let baker = baker.texels_per_unit(4.0).sky([1.0; 3]);
    let baked = baker.bake(&scene).expect("all is there");
    let picture = folder.path().join("p.png");
    fs::remove_file(&picture).expect("removed");
    let out = folder.path().join("out");
    let error = baked.write(&out).expect_err("the picture is gone");
    assert_eq!(error.exit_code(), 2);
    assert!(error.to_string().contains("p.png"), "{error}");
    assert!(!out.exists());
    // A file that never existed stays referenced as it was.
    let baked = baker.bake(&scene).expect("light does not need it");
    baked.write(&out).expect("written");
    let gltf = fs::read(out.join("c.glb")).expect("written");
    assert!(String::from_utf8_lossy(&gltf).contains(r#""uri":"p.png""#));
}

/// These were baked black or completely white, with "estimated error 0.00 %" and no warning.
#[test]
fn light_that_numbers_cannot_hold_is_refused_or_told_of() {
    let folder = temp();
    let (scene, out) = (asset("cornell_box.glb"), folder.path().join("out"));
    for sky in ["3e38", "1e13", "1,2,1e20"] {
        bake(&scene, &out, &format!("-q --sky {sky}")).fails(3, &["the sky is", "at most 1e12"]);
    }
    let run = bake(&scene, &out, "-q --sky 1e9 --sky-intensity 1e9");
    run.fails(3, &["the sky is 1e18"]);
    let words = ["the material \"lamp\" is", "at most 1e12"];
    bake(&scene, &out, "-q --light *=1e20").fails(3, &words);
    let sun = bake(&scene, &out, "-q --sun 0,-1,0,1e30");
    sun.fails(3, &["the light \"sun\" is 1e30"]);
    let floor = bake(&scene, &out, "-q --ambient-floor 0,1e38,0");
    floor.fails(1, &["--ambient-floor is 1", "from 0 to 65504"]);
    assert!(!out.exists());
    let run = bake(&scene, &out, "--sky 1e9").ok();
    let told = "lit lumels exceed 65504";
    assert!(run.stderr.contains(told), "{}", run.stderr);
    // Values within the half float range give no warning.
    let run = bake(&scene, &out, "--sky 1e3").ok();
    assert!(!run.stderr.contains("warning"), "{}", run.stderr);
    // Without light there is no error estimate.
    let run = bake(&scene, &out, "--exclude-light *").ok();
    assert!(run.stderr.contains("no error estimate"), "{}", run.stderr);
    let report = parse(&files(&out)["cornell_box.report.json"]);
    assert_eq!(report["gather"]["median_error"], Value::Null);
    assert_eq!(report["gather"]["estimated_error"], Value::Null);
}

/// A hundred bytes may claim gigabytes, and the memory of a bake is known before light is computed.
#[test]
fn pictures_and_memory_have_budgets() {
    let folder = temp();
    let (scene, out) = (asset("cornell_box.glb"), folder.path().join("out"));
    // The header claims more pixels than the file has, and more than allowed.
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n";
    let sky = write(folder.path().join("a.hdr"), head);
    let bake_sky = |options: &str| {
        let options = format!("-q --sky {} {options}", sky.display());
        bake(&scene, &out, &options)
    };
    bake_sky("").fails(3, &["16384 x 16384 pixels", "--max-image"]);
    bake_sky("--max-image 4G").fails(3, &["a.hdr"]);
    // A sparse terabyte, which must be neither read nor hashed.
    let sparse = fs::File::create(folder.path().join("b.hdr")).expect("created");
    if sparse.set_len(1 << 40).is_ok() {
        let option = format!("-q --sky {}/b.hdr", folder.path().display());
        bake(&scene, &out, &option).fails(3, &["found 1099511627776 bytes", "(--max-image)"]);
        let option = format!("-q --probes {}/b.hdr", folder.path().display());
        bake(&scene, &out, &option).fails(3, &["found 1099511627776 bytes"]);
    }
    let exr = sky_picture(folder.path());
    let option = format!("-q --sky {} --max-image 20K", exr.display());
    bake(&scene, &out, &option).fails(3, &["expected at most 5120 samples"]);

    let level = asset("demo_level.glb");
    let plan = |density: &str| {
        let words = [
            "bake",
            "--dry-run",
            "-q",
            "--quality",
            "draft",
            "--memory",
            "90M",
        ];
        let mut all: Vec<&OsStr> = words.map(OsStr::new).to_vec();
        all.extend([scene.as_os_str(), "-o".as_ref(), out.as_os_str()]);
        all.extend(["--texels-per-unit".as_ref(), OsStr::new(density)]);
        lumel(all)
    };
    let run = plan("40");
    run.fails(
        3,
        &["expected at most 90 MiB (--memory)", "--texels-per-unit "],
    );
    let fits = run
        .stderr
        .split("--texels-per-unit ")
        .nth(1)
        .expect("it is said");
    plan(fits.split(' ').next().expect("a number")).ok();
    let run = bake(&level, &out, "-q --memory 4M");
    run.fails(3, &["triangles after instancing", "--memory is 4 MiB"]);
    let run = bake(&level, &out, "-q --memory 1M");
    run.fails(3, &["demo_level.glb with", "--memory is 1 MiB"]);
    bake(&scene, &out, "-q --memory 20M").fails(3, &["no density would fit"]);
    assert!(!out.exists());
}

/// Half a gigabyte of colour profile in half a megabyte, which used to be unpacked.
#[test]
#[cfg(target_os = "linux")]
fn colour_profiles_have_a_limit() {
    let mut profile = ZlibEncoder::new(b"icc\0\0".to_vec(), Compression::best());
    let megabyte = vec![0; 1 << 20];
    for _ in 0..500 {
        profile.write_all(&megabyte).expect("memory takes all");
    }
    let profile = profile.finish().expect("memory takes all");
    let mut png = crate::fuzz::seeds::picture(image::ImageFormat::Png);
    // After the signature of 8 bytes and the header of 25.
    let mut sum = Crc::new();
    sum.update(b"iCCP");
    sum.update(&profile);
    let head = (profile.len() as u32).to_be_bytes();
    let chunk = [&head, &b"iCCP"[..], &profile, &sum.sum().to_be_bytes()].concat();
    png.splice(33..33, chunk);
    let folder = temp();
    let level = crate::fuzz::seeds::with_files(&png, &crate::fuzz::seeds::ies());
    let scene = write(folder.path().join("c.glb"), level.glb());
    bake(&scene, &folder.path().join("out"), "-q").ok();
    let report = parse(&files(&folder.path().join("out"))["c.report.json"]);
    let peak = report["measured"]["peak_bytes"].as_u64().expect("measured");
    assert!(peak < 200 << 20, "{peak}");
}

/// `ulimit -v` used to be unknown, so that a bake within three quarters of the machine's memory was
/// aborted.
#[test]
#[cfg(target_os = "linux")]
fn memory_defaults_to_what_the_process_may_have() {
    let folder = temp();
    let (scene, out) = (asset("cornell_box.glb"), folder.path().join("out"));
    let run = Run::of(
        Command::new("sh")
            .args(["-c", "ulimit -v 1000000; exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_lumel"))
            .args(["bake", "-q", "--texels-per-unit", "300", "-o"])
            .args([&out, &scene]),
    );
    run.fails(3, &["expected at most 732 MiB (--memory)"]);
}

/// Peak memory of a bake of the Cornell box over what `--dry-run` foretells.
#[cfg(target_os = "linux")]
fn peak_over_foretold(options: &str) -> f64 {
    let folder = temp();
    let (scene, out) = (asset("cornell_box.glb"), folder.path().join("out"));
    let run = |more: &str| {
        let words = ["-q --sky 1", options, more].join(" ");
        let mut a: Vec<&OsStr> = vec!["bake".as_ref(), scene.as_ref(), "-o".as_ref(), out.as_ref()];
        a.extend(words.split_whitespace().map(OsStr::new));
        lumel(a).ok()
    };
    let plan = run("--dry-run --json");
    let plan = parse(plan.stdout.as_bytes());
    let told = plan["estimate"]["bytes"].as_f64().expect("a number");
    run("");
    let report = parse(&files(&out)["cornell_box.report.json"]);
    report["measured"]["peak_bytes"].as_f64().expect("measured") / told
}

/// Layers, directions, groups, shadow masks and split edges used to be left out.
#[test]
#[cfg(target_os = "linux")]
fn memory_of_options_is_counted() {
    let all = "--layers direct,indirect,radiosity,error,coverage,ao,sun_mask --directional sh1";
    let options = [
        "",
        "--no-vertex-colors --no-stitch",
        all,
        "--mode shadowmask --sun 0.1,-1,0,5 --mixed sun --ktx2 rgb9e5 --layers ao",
        "--group a=sky --value radiosity --png rgbm",
        "--vertex-error 1e-6",
    ];
    for options in options {
        let always = "--quality draft --texels-per-unit 30";
        let ratio = peak_over_foretold(&format!("{always} {options}"));
        // What `tools/hostile_mix.py` allows beyond `--memory`; and a bake must not be refused for
        // much more than it needs.
        assert!((0.5..1.1).contains(&ratio), "{ratio} for {options}");
    }
}

/// Twice the memory that a bake of a few lumels needs used to be foretold, because the number of its
/// patches was not known.
#[test]
#[cfg(target_os = "linux")]
fn memory_of_small_levels_is_foretold() {
    for options in ["--quality draft", "--quality preview"] {
        let ratio = peak_over_foretold(&format!("{options} --texels-per-unit 8"));
        assert!((0.7..1.1).contains(&ratio), "{ratio} for {options}");
    }
}

/// Captures of reflections are kept until all files are written.
#[test]
fn memory_of_captures_is_counted() {
    let told = |captures: usize| {
        let (folder, scene) = level("level.bin", "level.png");
        let mut document = parse(fs::read(&scene).expect("written"));
        let nodes = document["nodes"].as_array_mut().expect("a list");
        let first = nodes.len();
        let capture = json!({"translation": [0, 1, 0], "extras": {"lumel": {"reflection": true}}});
        nodes.extend(vec![capture; captures]);
        let roots = document["scenes"][0]["nodes"].as_array_mut();
        (roots.expect("a list")).extend((first..first + captures).map(|n| json!(n)));
        fs::write(&scene, document.to_string()).expect("writable");
        let out = folder.path().join("out");
        let plan = bake(&scene, &out, "-q --dry-run --json").ok().stdout;
        let plan = parse(plan.as_bytes());
        plan["estimate"]["bytes"].as_f64().expect("a number")
    };
    // 64² texels a face, of 12 bytes and four in the file.
    let each = (told(64) - told(0)) / 64.0;
    let whole = 6.0 * 64.0 * 64.0 * 16.0 * 4.0 / 3.0;
    assert!((0.9 * whole..1.2 * whole).contains(&each), "{each}");
}

/// 7.7 million triangles used to be generated from a few hundred bytes before they were counted.
#[test]
fn instances_are_counted_before_they_are_made() {
    let folder = temp();
    let mut document = document("c.bin", "p.png");
    let copies = 3_000_000;
    let accessors = document["accessors"].as_array_mut().expect("a list");
    accessors.push(json!({"componentType": 5126, "count": copies, "type": "VEC3"}));
    document["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}});
    document["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    write(folder.path().join("c.bin"), triangle());
    let scene = write(folder.path().join("c.gltf"), document.to_string());
    let run = bake(&scene, &folder.path().join("out"), "-q --sky 1 --memory 1G");
    run.fails(3, &["3000000 copies", "at most 631612 mesh instances"]);
}

/// Names of three million characters, and names with lines that look like Lumel's own output.
#[test]
fn names_take_a_line_and_end() {
    let folder = temp();
    let mut document = document("c.bin", "p.png");
    let name = format!(
        "x\nerror: fake\n  problems    none\u{1b}[31m{}",
        "y".repeat(3_000_000)
    );
    document["materials"] = json!([{"name": &name, "emissiveFactor": [1, 1, 1]}]);
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document["meshes"][0]["name"] = json!(&name);
    document["nodes"][0]["name"] = json!(&name);
    write(folder.path().join("c.bin"), triangle());
    write(folder.path().join("p.png"), b"a picture");
    let scene = write(folder.path().join("c.gltf"), document.to_string());
    let out = folder.path().join("out");
    let run = lumel(["inspect".as_ref(), scene.as_os_str()]).ok();
    let fails = bake(&scene, &out, "-q --light nope=2");
    fails.fails(1, &["nope"]);
    let bakes = bake(&scene, &out, "-v").ok();
    for text in [&run.stdout, &fails.stderr, &bakes.stderr] {
        let fake = |l: &str| l.starts_with("error: fake") || l == "  problems    none";
        let faked = text.lines().filter(|l| fake(l)).count();
        // The note belongs to the report of this valid scene.
        assert!(
            faked <= usize::from(std::ptr::eq(text, &run.stdout)),
            "{faked}"
        );
        assert!(
            text.len() < 20_000 && !text.contains('\u{1b}'),
            "{}",
            text.len()
        );
    }
}

/// Two different names used to be baked into the same files.
#[cfg(unix)]
#[test]
fn names_that_are_not_utf8_are_refused_and_line_breaks_in_names_escaped() {
    use std::os::unix::ffi::OsStrExt;
    let folder = temp();
    let out = folder.path().join("out");
    let scene = folder.path().join(OsStr::from_bytes(b"a\xff.glb"));
    fs::copy(asset("cornell_box.glb"), &scene).expect("copied");
    bake(&scene, &out, "-q").fails(3, &["not UTF-8"]);
    assert!(!out.exists());
    let missing = folder.path().join("b\nerror: fake.glb");
    let run = bake(&missing, &out, "-q");
    run.fails(2, &["b\\nerror: fake.glb"]);
}

#[test]
fn a_level_whose_only_picture_is_ktx2_is_baked() {
    let folder = temp();
    write(folder.path().join("b.bin"), triangle());
    let mut level = document("b.bin", "p.ktx2");
    level["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    level["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    level["textures"] = json!([{"extensions": {"KHR_texture_basisu": {"source": 0}}}]);
    level["materials"] = json!([{"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}]);
    let whole = &mut level["meshes"][0]["primitives"][0];
    whole["attributes"]["TEXCOORD_0"] = json!(1);
    whole["material"] = json!(0);
    let second = json!({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"});
    level["accessors"]
        .as_array_mut()
        .expect("a list")
        .push(second);
    let scene = write(folder.path().join("c.gltf"), level.to_string());
    let out = folder.path().join("out");
    for picture in crate::fuzz::seeds::KTX2 {
        write(folder.path().join("p.ktx2"), picture);
        bake(&scene, &out, "-q").ok();
        write(folder.path().join("p.ktx2"), &picture[..picture.len() - 9]);
        bake(&scene, &out, "-q").fails(3, &["images[0]", "KTX2"]);
    }
}
