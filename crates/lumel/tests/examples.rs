//! Runs the examples and checks what they print.
//!
//! `cargo test` builds examples first. `cargo test --test all` does not, in which case this test
//! says so.

use std::path::PathBuf;
use std::process::Command;

/// The example's binary, next to this test's own folder.
fn binary(name: &str) -> PathBuf {
    let own = std::env::current_exe().expect("the test has a path");
    let profile = own.ancestors().nth(2).expect("target/PROFILE/deps/TEST");
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let path = profile.join("examples").join(file);
    assert!(
        path.is_file(),
        "{} is not there: run `cargo build --workspace --examples` first",
        path.display()
    );
    path
}

fn run(name: &str, arguments: &[&str]) -> String {
    let out = Command::new(binary(name))
        .args(arguments)
        .output()
        .expect("the example starts");
    let text = String::from_utf8(out.stdout).expect("text");
    let errors = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{name}: {errors}\n{text}");
    text
}

/// The first number after `before`.
fn number(text: &str, before: &str) -> f64 {
    let rest = text
        .split_once(before)
        .unwrap_or_else(|| panic!("no {before:?} in:\n{text}"))
        .1
        .trim_start();
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.');
    let digits = rest[..end.unwrap_or(rest.len())].trim_end_matches('.');
    digits
        .parse()
        .unwrap_or_else(|_| panic!("no number after {before:?} in:\n{text}"))
}

#[test]
fn a_file_is_baked_and_written() {
    let dir = tempfile::tempdir().expect("a folder");
    let scene = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../assets/furnace_cube_50.glb"
    );
    let folder = dir.path().to_str().expect("UTF-8");
    let text = run("01_bake_a_file", &[scene, folder]);
    for end in [
        "lightmap.exr",
        "glb",
        "vertex.glb",
        "lightmap.json",
        "report.json",
    ] {
        let file = dir.path().join(format!("furnace_cube_50.{end}"));
        assert!(file.is_file() && text.contains(file.to_str().expect("UTF-8")));
    }
}

#[test]
fn groups_sum_to_the_whole() {
    let text = run("02_choose_light", &[]);
    assert!(text.contains("source \"lamp\""), "{text}");
    let outside = number(&text, "outside  mean");
    let rest = number(&text, "rest     mean");
    let whole = number(&text, "whole    mean");
    assert!(outside > 0.01 && rest > 0.01, "{text}");
    // Three numbers, each printed with four digits.
    assert!((outside + rest - whole).abs() < 2e-4, "{text}");
}

#[test]
fn progress_is_told_and_the_button_works() {
    let text = run("03_progress_and_cancel", &[]);
    let phases: Vec<&str> = text
        .lines()
        .filter_map(|l| l.strip_prefix("now: "))
        .collect();
    assert_eq!(phases.first(), Some(&"ingest"), "{text}");
    assert!(phases.contains(&"solve") && phases.contains(&"gather"));
    assert!(text.contains("would exit with 75"), "{text}");
}

#[test]
fn results_in_memory_are_the_furnaces_closed_form() {
    let dir = tempfile::tempdir().expect("a folder");
    let picture = dir.path().join("page.png");
    let text = run("04_results_in_memory", &[picture.to_str().expect("UTF-8")]);
    // The allowed error of preset `draft` in a furnace; tests/closed_forms tests a tenth of this.
    assert!(number(&text, "= 2:") < 0.01, "{text}");
    let times_pi = number(&text, "hold E =") / std::f64::consts::PI;
    assert!((times_pi - 2.0).abs() < 0.01, "{text}");
    // At exposure 0.25, 2 × 0.25 = 0.5 is 188 in sRGB. Texels that no lookup reads may be black.
    let image = image::open(&picture).expect("a PNG").into_rgb8();
    let brightest = image.pixels().map(|p| p.0[1]).max();
    assert!(
        brightest.is_some_and(|b| b.abs_diff(188) <= 1),
        "{brightest:?}"
    );
}

#[test]
fn a_lamp_over_a_floor_has_its_closed_form() {
    let text = run("05_scene_in_code", &[]);
    for (height, lines) in [("0.5", 1), ("1", 1), ("2", 1)] {
        let line = format!("h = {height} m: brightest lumel");
        assert_eq!(text.matches(&line).count(), lines, "{text}");
        let found = number(&text, &line);
        let h: f64 = height.parse().expect("a number");
        let foot = 10.0 / (std::f64::consts::PI * h * h);
        // A lumel of 1/32 m holds its mean and is brightest at its corner: over r ≤ 1/32 m, (1 +
        // r²/h²)^-2 falls by at most 2 r²/h², 0.8 % for the lowest lamp. Three digits are printed.
        assert!(
            (found / foot - 1.0).abs() < 0.01,
            "{line} {found}, expected {foot}"
        );
    }
}
