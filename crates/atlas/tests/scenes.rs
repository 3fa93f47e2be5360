//! Every mesh of the shared scenes, if they are next to this checkout or in `LUMEL_SCENES`.

use std::path::{Path, PathBuf};

use crate::common::*;
use atlas::{LayoutOptions, UvMode, layout};
use mesh_ingest::{LoadOptions, Soup};

/// Every .glb and .gltf below `folder`, except intentionally broken ones.
fn scenes(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|e| e.path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            if path
                .file_name()
                .is_some_and(|n| n != "bad" && n != "reproducers")
            {
                scenes(&path, out);
            }
        } else if path.extension().is_some_and(|e| e == "glb" || e == "gltf") {
            out.push(path);
        }
    }
}

#[test]
#[allow(clippy::print_stderr, reason = "a test that did nothing should say so")]
fn every_mesh_of_the_shared_scenes_gets_sound_charts() {
    let folder = std::env::var_os("LUMEL_SCENES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes"),
        PathBuf::from,
    );
    let mut files = Vec::new();
    scenes(&folder, &mut files);
    if files.is_empty() {
        eprintln!("skipped: no scenes in {}", folder.display());
        return;
    }
    let options = LayoutOptions {
        uv_mode: UvMode::Generate,
        ..LayoutOptions::default()
    };
    let mut meshes = 0;
    for file in files {
        let Ok(loaded) = mesh_ingest::load(&file, &LoadOptions::default()) else {
            continue;
        };
        let Ok((result, report)) = layout(&loaded.scene, &Soup::default(), &options, &|_| true)
        else {
            // Nothing in it receives light.
            continue;
        };
        check_placements(&loaded.scene, &result);
        for atlas in result.meshes.iter().filter(|m| m.charts > 0) {
            check_generated(atlas, 2);
            meshes += 1;
        }
        for m in &report.meshes {
            assert_eq!(m.flipped, 0, "{} {m:?}", file.display());
        }
        let gave_up = report.warnings.iter().find(|w| w.contains("given up"));
        assert_eq!(gave_up, None, "{}", file.display());
        let name = file.file_stem().unwrap_or_default();
        if name == "sponza" {
            // The measured value is 70.4 %; it was 45.6 % before charts were joined and packed
            // here.
            assert!(report.coverage > 0.69, "{}", report.coverage);
        }
    }
    assert!(meshes > 100, "{meshes}");
}
