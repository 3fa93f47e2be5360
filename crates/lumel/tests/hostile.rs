//! Inputs that broke the real binary: one error each, at once, and nothing of the user's is touched.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::common::{Run, asset, bake, files, lumel, temp, write};

/// (0 0 0), (1 0 0), (0 0 −1): a triangle as bytes.
fn triangle() -> Vec<u8> {
    let floats = [0f32, 0., 0., 1., 0., 0., 0., 0., -1.];
    floats.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// A triangle with a buffer of its own, and a picture that light does not need.
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

/// A folder with a scene whose buffer and picture have these names.
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

/// A bake into `out` is refused with exit code 2, names what it would replace, and changes nothing of `folder`.
#[track_caller]
fn refused(folder: &Path, scene: &Path, out: &Path, options: &str, name: &str) {
    let before = snapshot(folder);
    let run = bake(scene, out, &format!("-q --sky 1 {options}"));
    run.fails(2, &[name, "would replace"]);
    assert!(snapshot(folder) == before, "{options}: {run:?}");
}

/// Everything below a folder.
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
    // By results, and by further pages of a bake that has only one now.
    for (buffer, picture, replaced) in [
        ("c.lightmap.exr", "p.png", "c.lightmap.exr"),
        ("c.bin", "c.report.json", "c.report.json"),
        ("c.bin", "c.lightmap.3.exr", "c.lightmap.3.exr"),
    ] {
        let (folder, scene) = level(buffer, picture);
        refused(folder.path(), &scene, folder.path(), "", replaced);
    }
    // By what options name.
    let (folder, scene) = level("c.bin", "p.png");
    let out = folder.path().join("out");
    for option in ["--preview", "--first-picture", "--depfile", "--report"] {
        for name in ["c.bin", "p.png"] {
            let path = folder.path().join(name);
            let option = format!("{option} {}", path.display());
            refused(folder.path(), &scene, &out, &option, name);
        }
    }
    // By results where the sky lies.
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
    // The scene is a link to what the bake writes.
    let folder = temp();
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("created");
    fs::copy(asset("cornell_box.glb"), out.join("c.glb")).expect("copied");
    let scene = folder.path().join("c.glb");
    symlink("out/c.glb", &scene).expect("linked");
    refused(folder.path(), &scene, &out, "", "out/c.glb");
    // A result's name is another name of the buffer.
    let (folder, scene) = level("c.bin", "p.png");
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("created");
    fs::hard_link(folder.path().join("c.bin"), out.join("c.lightmap.json")).expect("linked");
    refused(folder.path(), &scene, &out, "", "c.lightmap.json");
    // The buffer lies elsewhere, under the name of a result.
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
    // Its own result may go.
    bake(&scene, folder.path(), "-q --sky 2").ok();
}

/// A lightmap of four channels, to be lied about.
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

/// 2^30 × 2^30 pixels of four channels of four bytes are 2^64 bytes, which wrapped to 0 and aborted the process.
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

/// Whatever a name holds, a terminal obeys none of it.
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
