//! Real levels, if their folder is next to this checkout; they are too large, and have too many
//! different licences, to commit.

use std::path::{Path, PathBuf};

use lumel::{Quality, Settings, Silent, SkySource};

/// Path of a shared scene; `None`, with a note, if it does not exist.
#[allow(clippy::print_stderr, reason = "a test that did nothing should say so")]
fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/scenes")
        .join(name);
    if path.is_file() {
        return Some(path);
    }
    eprintln!("skipped: {} is not there", path.display());
    None
}

/// Bakes the scene in draft under a sky of radiance 1; everything is finite, nothing negative, and
/// at least half of it lit.
fn bakes(name: &str, texels_per_unit: f32) {
    let Some(path) = shared(name) else { return };
    let settings = Settings {
        quality: Quality::Draft,
        sky: SkySource::Color([1.0; 3]),
        texels_per_unit: Some(texels_per_unit),
        ..Settings::default()
    };
    let b = lumel::bake(&path, &settings, &Silent).expect("it bakes");
    let (mut lit, mut all) = (0u64, 0u64);
    for page in &b.baked.pages {
        for (v, c) in page.value.iter().zip(&page.coverage) {
            assert!(v.iter().all(|x| x.is_finite() && *x >= 0.0), "{v:?}");
            all += u64::from(*c > 0.0);
            lit += u64::from(*c > 0.0 && v[1] > 0.0);
        }
    }
    assert!(all > 1000 && lit * 2 > all, "{lit} of {all} lumels are lit");
    assert!(b.report.solve.relaxation.converged);
    let (files, _) = b.files().expect("files");
    assert_eq!(files.len(), 4 + b.baked.pages.len());
}

#[test]
fn bevys_cornell_box() {
    // Its unit is a millimetre of a real box, and it is 556 of them wide.
    bakes("bevy_cornell/CornellBox.glb", 0.1);
}

#[test]
fn a_small_game_level() {
    bakes("kenney_fps_level/kenney_fps_level.glb", 1.0);
}

#[test]
fn mirrored_instances() {
    bakes("features/NegativeScaleTest/NegativeScaleTest.glb", 8.0);
}

#[test]
fn an_instancing_extension() {
    bakes("features/SimpleInstancing/SimpleInstancing.glb", 4.0);
}
