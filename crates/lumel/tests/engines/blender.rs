//! Blender: the add-on's importer, run by the Python environment with bpy.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use super::{STEM, squares};
use crate::common::quads::points;

#[test]
fn blender_imports_without_loss_and_looks_up_right() {
    let venv = std::env::var_os("LUMEL_VENV").unwrap_or_else(|| "/opt/lumel-venv".into());
    let python = PathBuf::from(venv).join("bin/python");
    if !python.is_file() {
        eprintln!(
            "SKIPPED Blender: no {} (LUMEL_VENV names its folder)",
            python.display()
        );
        return;
    }
    let (_t, out) = squares("");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/blender/tests");
    let points: Vec<Value> = (points().into_iter())
        .map(|(at, albedo, r)| json!({"at": at, "radiance": albedo.map(|a| a * r)}))
        .collect();
    let run = Command::new(&python)
        .arg(folder.join("check_import.py"))
        .arg(out.join(format!("{STEM}.glb")))
        .arg(json!(points).to_string())
        .output()
        .expect("Python starts");
    let text = String::from_utf8_lossy(&run.stdout);
    if run.status.code() == Some(77) {
        eprintln!("SKIPPED Blender: {text}");
        return;
    }
    assert!(
        run.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&run.stderr)
    );
}
