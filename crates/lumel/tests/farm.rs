//! `lumel solve`, `gather` and `merge` with the real binary: the bytes of one bake, and clear
//! errors for work folders that are damaged.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempDir;

use crate::common::{Run, asset, command, comparable, files, lumel, names, temp, write};

/// A coarse bake of the demo level that still traces edges and interpolates lumels.
const COARSE: &str = "--quality quick --texels-per-unit 2.5 --sky 0.25,0.35,0.5";

fn words<'w>(command: &'w str, paths: &[&'w Path], options: &'w str) -> Vec<&'w OsStr> {
    let paths = paths.iter().map(|p| p.as_os_str());
    let options = options.split_whitespace().map(OsStr::new);
    std::iter::once(command.as_ref())
        .chain(paths)
        .chain(options)
        .collect()
}

/// Solves a level into `work`.
fn solve(scene: &Path, work: &Path, options: &str) -> Run {
    lumel(words("solve", &[scene, "-o".as_ref(), work], options))
}

fn gather(work: &Path, shard: &str) -> Run {
    lumel(words(
        "gather",
        &[work, "-q".as_ref(), "--shard".as_ref(), shard.as_ref()],
        "",
    ))
}

fn merge(work: &Path, out: &Path) -> Run {
    lumel(words(
        "merge",
        &[work, "-q".as_ref(), "-o".as_ref(), out],
        "",
    ))
}

/// Asserts that both folders have the same results, apart from what the reports measured.
#[track_caller]
fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert!(a.keys().eq(b.keys()), "{:?} and {:?}", a.keys(), b.keys());
    for (name, bytes) in &a {
        if name.ends_with("report.json") {
            assert_eq!(comparable(bytes), comparable(&b[name]));
        } else {
            assert!(bytes == &b[name], "{name} differs");
        }
    }
}

/// The solved work folder of a coarse bake of the demo level, and the level, which a test may
/// change.
fn solved() -> (TempDir, PathBuf, PathBuf) {
    let t = temp();
    let scene = t.path().join("level.glb");
    fs::copy(asset("demo_level.glb"), &scene).expect("copied");
    let work = t.path().join("work");
    solve(
        &scene,
        &work,
        "--quality draft --texels-per-unit 2 --no-vertex-colors -q",
    )
    .ok();
    (t, scene, work)
}

#[test]
fn shards_give_the_bytes_of_one_bake() {
    let (t, scene) = (temp(), asset("demo_level.glb"));
    let preview = "--quality preview --texels-per-unit 1.5 --sky 1 --directional sh1 --layers ao \
                   --group lamps=pendant* --no-vertex-colors";
    let closed = "--quality preview --texels-per-unit 8 --probes 5";
    let cases = [
        (scene.clone(), COARSE, &[1, 8][..]),
        (scene, preview, &[3]),
        (asset("cornell_box.glb"), closed, &[4]),
    ];
    for (case, (scene, options, divisions)) in cases.into_iter().enumerate() {
        let at = |name: &str| t.path().join(format!("{case}-{name}"));
        let plain = at("plain");
        lumel(words(
            "bake",
            &[&scene, "-q".as_ref(), "-o".as_ref(), &plain],
            options,
        ))
        .ok();
        for n in divisions {
            let (work, out) = (at(&format!("work{n}")), at(&format!("out{n}")));
            solve(&scene, &work, &format!("{options} -q")).ok();
            // In any order.
            for i in (1..=*n).rev() {
                gather(&work, &format!("{i}/{n}")).ok();
            }
            merge(&work, &out).ok();
            assert_same(&plain, &out);
        }
    }
}

/// Names of the temporary files in a work folder.
fn parts_in(work: &Path) -> Vec<String> {
    let entries = fs::read_dir(work).expect("it is there");
    let names = entries.map(|e| e.expect("readable").file_name());
    (names.map(|name| name.to_string_lossy().into_owned()))
        .filter(|name| name.ends_with(".part"))
        .collect()
}

#[test]
fn a_killed_shard_leaves_nothing_wrong() {
    let (t, scene, work) = solved();
    for wait in [20, 60, 100, 150, 200, 300, 400] {
        let shard = [
            "gather".as_ref(),
            work.as_os_str(),
            "--shard".as_ref(),
            "1/2".as_ref(),
        ];
        let mut child = command().args(shard).arg("-q").spawn().expect("it starts");
        std::thread::sleep(Duration::from_millis(wait));
        // It may have finished.
        let _ = child.kill();
        child.wait().expect("it ended");
    }
    // What a kill leaves behind, which the next run of the shard removes; that of others stays.
    write(work.join(".lumel-shard-1-of-2.light-abc.part"), vec![1]);
    write(work.join(".lumel-shard-3-of-7.light-abc.part"), vec![1]);
    for i in [1, 2] {
        gather(&work, &format!("{i}/2")).ok();
    }
    assert_eq!(parts_in(&work), [".lumel-shard-3-of-7.light-abc.part"]);
    let before = fs::read(work.join("shard-1-of-2.light")).expect("it is there");
    fs::remove_file(work.join("shard-1-of-2.light")).expect("removed");
    gather(&work, "1/2").ok();
    let again = fs::read(work.join("shard-1-of-2.light")).expect("it is there again");
    assert!(before == again, "another run gives other bytes");
    let (plain, out) = (t.path().join("plain"), t.path().join("out"));
    let options = "--quality draft --texels-per-unit 2 --no-vertex-colors";
    lumel(words(
        "bake",
        &[&scene, "-q".as_ref(), "-o".as_ref(), &plain],
        options,
    ))
    .ok();
    merge(&work, &out).ok();
    assert_same(&plain, &out);
}

#[test]
fn two_processes_may_gather_the_same_shard() {
    let (_t, _, work) = solved();
    let of = |_| {
        let shard = [
            "gather".as_ref(),
            work.as_os_str(),
            "--shard".as_ref(),
            "1/1".as_ref(),
        ];
        command().args(shard).arg("-q").spawn().expect("it starts")
    };
    // A scheduler starts a shard again that it believes to be dead.
    for mut child in [0; 4].map(of) {
        assert!(child.wait().expect("it ended").success());
    }
    gather(&work, "1/1").ok();
    assert_eq!(parts_in(&work), Vec::<String>::new());
}

/// Flips a bit in the middle of a file.
fn damage(path: &Path) -> Vec<u8> {
    let whole = fs::read(path).expect("it is there");
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 4;
    write(path.to_owned(), damaged);
    whole
}

#[test]
fn what_is_damaged_or_does_not_belong_is_refused() {
    let (t, scene, work) = solved();
    let out = t.path().join("out");
    let refused = |run: Run, words: &[&str]| run.fails(3, words);
    refused(merge(&work, &out), &["found no shards"]);
    for i in [1, 2, 3] {
        gather(&work, &format!("{i}/3")).ok();
    }
    let shard = work.join("shard-2-of-3.light");
    let light = fs::read(&shard).expect("it is there");
    fs::remove_file(&shard).expect("removed");
    refused(merge(&work, &out), &["found 2 of 3 shards", "missing: 2"]);
    write(shard.clone(), &light);

    let charts = fs::read_dir(work.join("charts"))
        .into_iter()
        .flatten()
        .flatten();
    let mut all = vec![
        work.join("work.json"),
        work.join("solution.bin"),
        shard.clone(),
    ];
    all.extend(charts.map(|e| e.path()).take(1));
    for path in all {
        let name = path
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let whole = damage(&path);
        refused(merge(&work, &out), &[&name, "found a damaged file"]);
        if name.ends_with(".light") {
            // The damaged shard is gathered again.
            gather(&work, "2/3").ok();
            assert!(fs::read(&path).expect("there") == whole);
        } else {
            refused(gather(&work, "1/4"), &[&name, "found a damaged file"]);
            write(path, whole);
        }
    }
    let solution = fs::read(work.join("solution.bin")).expect("it is there");
    fs::remove_file(work.join("solution.bin")).expect("removed");
    merge(&work, &out).fails(2, &["solution.bin"]);
    write(work.join("solution.bin"), solution);

    // A work folder of another version.
    let text = fs::read_to_string(work.join("work.json")).expect("it is there");
    let mut other: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    let format = other["format"].as_u64().expect("a number") + 1;
    other["format"] = format.into();
    write(work.join("work.json"), other.to_string());
    let found = format!("format {format}");
    refused(gather(&work, "1/3"), &[&found, "solve again"]);
    write(work.join("work.json"), text);

    // A shard of another solution.
    let second = t.path().join("second");
    solve(
        &scene,
        &second,
        "--quality draft --texels-per-unit 2.1 --no-vertex-colors -q",
    )
    .ok();
    gather(&second, "2/3").ok();
    fs::copy(second.join("shard-2-of-3.light"), &shard).expect("copied");
    refused(
        merge(&work, &out),
        &["shard-2-of-3.light", "another solution"],
    );
    write(shard, light);
    merge(&work, &out).ok();

    // Another scene at the same path.
    fs::copy(asset("cornell_box.glb"), &scene).expect("copied");
    refused(merge(&work, &out), &["level.glb", "changed since"]);
    refused(gather(&work, "1/4"), &["level.glb", "changed since"]);
    assert!(
        names(&out).iter().all(|n| !n.starts_with('.')),
        "{:?}",
        names(&out)
    );
}

#[test]
fn options_about_results_belong_to_merge() {
    let t = temp();
    let run = solve(
        &asset("cornell_box.glb"),
        &t.path().join("work"),
        "--preview a.png -q",
    );
    run.fails(1, &["--preview", "lumel solve"]);
    assert!(!t.path().join("work").exists());
    gather(t.path(), "1/2").fails(2, &["work.json"]);
}
