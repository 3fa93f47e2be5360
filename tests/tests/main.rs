//! Tests of the whole pipeline as one program, because linking each file separately takes most of
//! the time.

mod assets;
mod calm;
mod circles;
mod closed_forms;
mod common;
mod cull;
mod demo_level;
mod error;
mod hard_cases;
mod leaks;
mod levels;
mod lods;
mod mixed_light;
mod not_physical;
mod outputs;
mod page_groups;
mod platform_math;
mod round_trip;
mod seams;
mod second_method;
mod shadows;
mod shared_scenes;
mod sheets;
mod smooth;
mod surfaces;
mod tiles;
mod uvs;
mod vertices;

/// Automatic discovery is off, so a file that is not declared would never be compiled, and its
/// tests would never run.
#[test]
fn every_file_of_tests_is_part_of_its_program() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let crates = std::fs::read_dir(root.join("crates")).expect("crates/ is there");
    let mut folders: Vec<_> = crates
        .map(|e| e.expect("readable").path().join("tests"))
        .filter(|folder| folder.is_dir())
        .collect();
    folders.push(root.join("tests/tests"));
    assert!(folders.len() > 5, "{folders:?}");
    let mut forgotten = Vec::new();
    for folder in folders {
        let main = std::fs::read_to_string(folder.join("main.rs")).unwrap_or_default();
        for entry in std::fs::read_dir(&folder).expect("readable") {
            let path = entry.expect("readable").path();
            let name = path.file_stem().expect("a name").to_string_lossy();
            if name != "main" && !main.lines().any(|l| l == format!("mod {name};")) {
                forgotten.push(path);
            }
        }
    }
    assert!(forgotten.is_empty(), "main.rs does not name {forgotten:?}");
}
