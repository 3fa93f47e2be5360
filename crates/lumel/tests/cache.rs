//! `--cache` with the real binary: same bytes as a clean bake, whatever happens to the folder.

use std::path::PathBuf;

use crate::common::{asset, bake, files, names, parse, temp, write};
use serde_json::{Value, json};

#[test]
fn charts_of_large_meshes_are_kept() {
    let (t, scene) = (temp(), asset("demo_level.glb"));
    let cache = t.path().join("cache");
    let run = |name: &str, options: &str| {
        let out = t.path().join(name);
        // Splitting the sides of the demo level's lamp shades, and cuts, make charts twice.
        let cheap = "--sky 0.5 --no-split-sides --no-cut-charts";
        let run = bake(&scene, &out, &format!("{cheap} {options}")).ok();
        let mut files = files(&out);
        let report = parse(files.remove("demo_level.report.json").expect("a report"));
        (
            files,
            report["measured"]["cache"]["charts"].clone(),
            run.stderr,
        )
    };
    let with = |more: &str| format!("--cache {} {more}", cache.display());
    let (_, first, _) = run("filled", &with(""));
    let kept = first[1].as_u64().expect("a number");
    assert!(first[0] == 0 && kept > 0, "{first}");
    // Another lamp and another quantity, but the same meshes.
    let other = "--value irradiance --light sun*=0.5";
    let (clean, none, _) = run("clean", other);
    assert_eq!(none, Value::Null);
    let (cached, found, stderr) = run("cached", &with(other));
    assert_eq!(found, json!([kept, 0]));
    assert!(stderr.contains("charts of"), "{stderr}");
    assert!(clean == cached, "charts from the cache change bytes");
    // Damaged, truncated and empty files are replaced.
    let charts: Vec<PathBuf> = (names(&cache).into_iter())
        .filter(|n| n.ends_with(".lumelcharts"))
        .map(|n| cache.join(n))
        .collect();
    assert_eq!(charts.len() as u64, kept);
    let whole = std::fs::read(&charts[0]).expect("it is there");
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    for bytes in [&damaged[..], &whole[..whole.len() - 4], &[]] {
        write(charts[0].clone(), bytes);
        let (cached, found, _) = run("mended", &with(other));
        assert_eq!(found, json!([kept - 1, 1]));
        assert!(clean == cached, "damaged charts change bytes");
    }
    assert_eq!(std::fs::read(&charts[0]).expect("mended"), whole);
    // Another padding gives another hash.
    let (_, padded, _) = run("padded", &with("--padding 4"));
    assert_eq!(padded, json!([0, kept]));
}

#[test]
fn a_folder_that_cannot_be_written_costs_no_bake() {
    let t = temp();
    let file = write(t.path().join("cache"), "no folder");
    let out = t.path().join("out");
    let options = format!("--sky 0.5 --cache {}", file.display());
    let run = bake(&asset("demo_level.glb"), &out, &options).ok();
    assert!(run.stderr.contains("cannot cache charts"), "{}", run.stderr);
    assert_eq!(std::fs::read(file).expect("it is there"), b"no folder");
}

#[test]
fn the_oldest_files_go_when_there_are_too_many() {
    let t = temp();
    let cache = t.path().join("cache");
    let run = |name: &str, options: &str| {
        let options = format!("--sky 0.5 --cache {} {options}", cache.display());
        bake(&asset("demo_level.glb"), &t.path().join(name), &options).ok();
        names(&cache)
    };
    let first = run("first", "");
    // Another padding needs new charts; the limit only has room for those.
    let size = |n: &String| std::fs::metadata(cache.join(n)).expect("it is there").len();
    let all: u64 = first.iter().map(size).sum();
    let second = run(
        "second",
        &format!("--padding 4 --cache-size {}", all * 3 / 2),
    );
    let left: u64 = second.iter().map(size).sum();
    assert!(left <= all * 3 / 2, "{left} of {all}");
    assert!(second.len() > first.len() / 2 && second.iter().any(|n| !first.contains(n)));
}
