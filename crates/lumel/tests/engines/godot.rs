//! Godot: pictures by tools/engines/godot/picture.gd, run by `LUMEL_GODOT` or `godot` on the path.

use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::Command;

use super::bevy::pixel;
use super::{STEM, VIEWS, assert_pixel, squares_times, srgb};
use crate::common::quads::points;
use crate::common::write;

/// Godot 4 as a command that can draw; prints a message if there is none.
fn godot() -> Option<Vec<OsString>> {
    let answers = |program: &OsStr, flag: &str| {
        let run = Command::new(program).arg(flag).output();
        run.is_ok_and(|o| o.status.success())
    };
    let program = std::env::var_os("LUMEL_GODOT").unwrap_or_else(|| "godot".into());
    if !answers(&program, "--version") {
        eprintln!("SKIPPED Godot: neither LUMEL_GODOT nor `godot` on the path starts");
        return None;
    }
    if std::env::var_os("DISPLAY").is_some() {
        return Some(vec![program]);
    }
    if !answers("xvfb-run".as_ref(), "--help") {
        eprintln!("SKIPPED Godot: neither a display nor xvfb-run");
        return None;
    }
    Some(vec!["xvfb-run".into(), "-a".into(), program])
}

/// Runs Godot, whose exit code does not tell of errors in scripts and shaders.
#[track_caller]
fn run_godot(godot: &[OsString], folder: &Path, arguments: &[&str]) {
    let run = Command::new(&godot[0])
        .args(&godot[1..])
        .args(["--audio-driver", "Dummy", "--path"])
        .arg(folder)
        .args(arguments)
        .output()
        .expect("it started before");
    let text = String::from_utf8_lossy(&run.stderr);
    let bad = ["SCRIPT ERROR", "SHADER ERROR"];
    assert!(
        run.status.success() && !bad.iter().any(|b| text.contains(b)),
        "{arguments:?}: {text}"
    );
}

#[test]
fn godot_shows_closed_form_pixels() {
    let Some(godot) = godot() else { return };
    let tools = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/engines/godot");
    // In the second bake, the loader applies the suggested exposure.
    for (times, given) in [(1.0, &["--exposure", "1"][..]), (4e4, &[])] {
        let (_t, folder, exposure) = squares_times(times, "");
        let shown = if given.is_empty() {
            times * exposure
        } else {
            1.0
        };
        for script in ["lumel_lightmap.gd", "picture.gd"] {
            std::fs::copy(tools.join(script), folder.join(script)).expect("copied");
        }
        write(folder.join("project.godot"), "config_version=5\n");
        run_godot(&godot, &folder, &["--headless", "--import"]);
        let level = format!("res://{STEM}.glb");
        for (i, (cam, range)) in VIEWS.into_iter().enumerate() {
            let picture = folder.join(format!("{i}.png"));
            let to = picture.to_str().expect("UTF-8");
            let arguments = [
                &["--resolution", "640x480", "--rendering-method"],
                &["gl_compatibility", "--script", "res://picture.gd"],
                &["--", &level, to, "--cam", cam][..],
                given,
            ];
            run_godot(&godot, &folder, &arguments.concat());
            let picture = image::open(&picture).expect("a picture").to_rgb8();
            for (at, albedo, r) in points().into_iter().take(range.end).skip(range.start) {
                let found = pixel(&picture, cam, at);
                let what = format!("Godot, sun times {times}, {at:?}");
                assert_pixel(
                    found,
                    albedo.map(|a| a * r * shown),
                    &srgb(1.0 / 512.0),
                    &what,
                );
            }
        }
    }
}
