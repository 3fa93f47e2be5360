//! The committed assets equal the generated ones.

use std::path::Path;

#[test]
fn committed_assets_are_up_to_date() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let mut stale = Vec::new();
    for asset in lumel_tests::assets::ASSETS {
        if std::fs::read(dir.join(asset.name)).ok() != Some((asset.make)()) {
            stale.push(asset.name);
        }
    }
    assert!(
        stale.is_empty(),
        "run `cargo run -p lumel-tests --bin make-assets`: {stale:?} differ"
    );
}

#[test]
fn every_committed_scene_has_its_maker() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    for entry in std::fs::read_dir(dir).expect("assets/ is there") {
        let name = entry
            .expect("readable")
            .file_name()
            .into_string()
            .expect("plain name");
        let made = lumel_tests::assets::ASSETS.iter().any(|a| a.name == name);
        assert!(
            made || !name.ends_with(".glb"),
            "{name} is not made by make-assets"
        );
    }
}
