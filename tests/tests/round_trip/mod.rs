//! The output contains everything that was read: a strict comparison of input and output, for
//! generated documents with many features and for the shared levels if available.

mod compare;
mod crafted;

use std::path::{Path, PathBuf};

use compare::{Diff, Kind, compare};
use lumel::UnwrapperChoice;
use lumel::atlas::{LayoutOptions, layout};
use lumel::atlas_bake::{ValueKind, write_lightmapped_glb, write_vertex_glb};
use lumel::gather::VertexLight;
use lumel::mesh_ingest::{LoadOptions, Loaded, Soup, load};

/// Both outputs of `file` with a plain layout and even light, read back.
fn written(file: &Path, dir: &Path) -> (Loaded, [(Kind, Loaded); 2]) {
    let read = |path: &Path| load(path, &LoadOptions::default()).expect("it loads");
    let input = read(file);
    let scene = &input.scene;
    let soup = Soup::build(scene);
    let options = LayoutOptions {
        unwrapper: UnwrapperChoice::Box,
        lumel_budget: 20_000,
        ..LayoutOptions::default()
    };
    let (layout, _) = layout(scene, &soup, &options, &|_| true).expect("a layout");
    let pages: Vec<String> = (0..layout.pages.len())
        .map(|i| format!("page{i}.exr"))
        .collect();
    let (lightmapped, _) =
        write_lightmapped_glb(&input.document, scene, &layout, &pages, ValueKind::Radiance)
            .expect("written");
    let light = VertexLight {
        instances: (scene.instances.iter())
            .map(|i| {
                let primitives = &scene.meshes[i.mesh].primitives;
                (primitives.iter())
                    .map(|p| vec![[1.0; 3]; p.positions.len()])
                    .collect()
            })
            .collect(),
        ..VertexLight::default()
    };
    let (vertex, _) = write_vertex_glb(&input.document, scene, &light).expect("written");
    let back = [
        (Kind::Lightmapped, "out.glb", lightmapped),
        (Kind::Vertex, "out.vertex.glb", vertex),
    ]
    .map(|(kind, name, bytes)| {
        let path = dir.join(name);
        std::fs::write(&path, bytes).expect("written");
        (kind, read(&path))
    });
    (input, back)
}

fn round_trip(file: &Path) -> [Diff; 2] {
    let dir = tempfile::tempdir().expect("a folder");
    let (input, back) = written(file, dir.path());
    back.map(|(kind, output)| {
        let diff = compare(&input.document, &output.document, kind);
        assert!(
            diff.faults.is_empty(),
            "{} {kind:?}: {} differences\n{}",
            file.display(),
            diff.faults.len(),
            diff.faults
                .iter()
                .take(40)
                .cloned()
                .collect::<Vec<_>>()
                .join("\n")
        );
        diff
    })
}

#[test]
fn a_document_with_everything_keeps_it() {
    for name in ["level.glb", "level.gltf"] {
        let dir = tempfile::tempdir().expect("a folder");
        crafted::write_side_files(dir.path());
        let (doc, json) = crafted::everything();
        let [lightmapped, vertex] = round_trip(&doc.write(json, dir.path(), name));
        // The changes that the scene was made to cause, so that the comparison is known to detect
        // them.
        for kind in [
            "extras.lightmap",
            "TEXCOORD_1",
            "TEXCOORD_0 doubles TEXCOORD_1",
            "set 1 moved",
            "set 1 replaced",
            "material copied",
            "vertices copied at chart borders",
            "strip or fan written as a list",
            "image embedded",
        ] {
            assert!(
                lightmapped.allowed.contains_key(kind),
                "{kind}: {:?}",
                lightmapped.allowed
            );
        }
        for kind in [
            "extras.vertexLight",
            "vertex colours",
            "vertex colours replaced",
            "mesh copied for a node",
            "copy written out as a node",
            "material made unlit",
            "glow moved into vertex colours",
            "extension no longer used",
        ] {
            assert!(
                vertex.allowed.contains_key(kind),
                "{kind}: {:?}",
                vertex.allowed
            );
        }
    }
}

#[test]
fn unknown_extensions_at_every_level_stay() {
    let dir = tempfile::tempdir().expect("a folder");
    crafted::write_side_files(dir.path());
    let (mut doc, mut json) = crafted::everything();
    crafted::with_unknown_extensions(&mut doc, &mut json);
    round_trip(&doc.write(json, dir.path(), "level.gltf"));
}

#[test]
fn the_comparison_sees_what_is_lost() {
    // Each edit of the output is one fault.
    let dir = tempfile::tempdir().expect("a folder");
    crafted::write_side_files(dir.path());
    let (doc, json) = crafted::everything();
    let file = doc.write(json, dir.path(), "level.gltf");
    let (input, [(kind, _), _]) = written(&file, dir.path());
    let glb = std::fs::read(dir.path().join("out.glb")).expect("bytes");
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("4")) as usize;
    let end = 20 + word(12);
    let json: serde_json::Value = serde_json::from_slice(&glb[20..end]).expect("JSON");
    type Edit = fn(&mut serde_json::Value);
    let edits: [Edit; 9] = [
        |j| j["nodes"][0]["extras"]["keep"] = serde_json::json!([1]),
        |j| drop(j["nodes"][2].as_object_mut().map(|o| o.remove("camera"))),
        |j| j["nodes"][1]["mesh"] = 2.into(),
        |j| j["materials"][3]["name"] = "x".into(),
        |j| drop(j["skins"][0].as_object_mut().map(|o| o.remove("skeleton"))),
        |j| {
            j["animations"][0]["samplers"][0]["output"] =
                j["animations"][0]["samplers"][0]["input"].clone()
        },
        |j| {
            j["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
                j["meshes"][0]["primitives"][0]["attributes"]["POSITION"].clone()
        },
        |j| j["images"].as_array_mut().expect("images").swap(0, 1),
        |j| j["extras"]["big"] = 9_007_199_254_740_992u64.into(),
    ];
    for (i, edit) in edits.into_iter().enumerate() {
        let mut json = json.clone();
        edit(&mut json);
        let mut text = serde_json::to_vec(&json).expect("JSON");
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = glb[..8].to_vec();
        out.extend((20 + text.len() as u32 + (glb.len() - end) as u32).to_le_bytes());
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(&glb[16..20]);
        out.extend(text);
        out.extend(&glb[end..]);
        let path = dir.path().join("edited.glb");
        std::fs::write(&path, out).expect("written");
        let edited = load(&path, &LoadOptions::default()).expect("it loads");
        let diff = compare(&input.document, &edited.document, kind);
        assert!(!diff.faults.is_empty(), "edit {i} went unseen");
    }
}

/// All documents below a folder, in order.
fn documents(dir: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(dir)
        .expect("a folder")
        .map(|e| e.expect("an entry").path())
        .collect();
    entries.sort();
    for path in entries {
        let end = path.extension().and_then(|e| e.to_str());
        if path.is_dir()
            && path
                .file_name()
                .is_some_and(|n| n != "bad" && n != "reproducers")
        {
            documents(&path, found);
        } else if matches!(end, Some("gltf" | "glb")) {
            found.push(path);
        }
    }
}

#[test]
#[allow(clippy::print_stderr, reason = "a test that did nothing should say so")]
fn shared_levels_come_back_whole() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes");
    if !root.is_dir() {
        eprintln!("SKIPPED: {} is not there", root.display());
        return;
    }
    let mut files = Vec::new();
    documents(&root, &mut files);
    assert!(files.len() >= 10, "{}", files.len());
    for file in files {
        let start = std::time::Instant::now();
        let [lightmapped, vertex] = round_trip(&file);
        eprintln!(
            "{:.1} s {}: {:?} {:?}",
            start.elapsed().as_secs_f64(),
            file.display(),
            lightmapped.allowed,
            vertex.allowed
        );
    }
}

#[test]
fn our_own_scenes_come_back_whole() {
    let mut files = Vec::new();
    documents(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets"),
        &mut files,
    );
    assert!(!files.is_empty());
    for file in files {
        round_trip(&file);
    }
}
