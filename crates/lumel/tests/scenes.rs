//! The real binary on several levels at once, and on folders of them.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::quads::{scene, sun};
use crate::common::{Run, comparable, files, lumel, names, outputs, parse, temp, write};

/// `lumel bake SCENES -o OUT`, cheap, with further `options`.
fn bake_all(scenes: &[&Path], out: &Path, options: &str) -> Run {
    let mut a: Vec<OsString> = vec!["bake".into()];
    a.extend(scenes.iter().map(|s| s.as_os_str().to_owned()));
    a.extend(["-o".into(), out.as_os_str().to_owned()]);
    let cheap = format!(
        "--quality draft --texels-per-unit 2 --sun {} {options}",
        sun()
    );
    a.extend(cheap.split_whitespace().map(OsString::from));
    lumel(a)
}

/// A folder of two levels with a broken one between them, a text file and a folder named like a
/// level.
fn levels(folder: &Path) -> [PathBuf; 3] {
    fs::create_dir(folder).expect("created");
    write(folder.join("notes.txt"), "no level");
    fs::create_dir(folder.join("folder.glb")).expect("created");
    [
        ("a.gltf", scene()),
        ("broken.glb", "glTF".into()),
        ("c.gltf", scene()),
    ]
    .map(|(name, text)| write(folder.join(name), text))
}

#[test]
fn a_folder_is_baked_by_name_and_one_failure_stops_nothing() {
    let t = temp();
    let (folder, out) = (t.path().join("levels"), t.path().join("out"));
    let [a, broken, c] = levels(&folder);
    let run = bake_all(&[&folder], &out, "");
    assert_eq!(run.code, Some(3), "{}", run.stderr);
    let expected: Vec<String> = [outputs("a"), outputs("c")].concat();
    assert_eq!(names(&out), expected);
    let said = |text: &str| {
        run.stderr
            .find(text)
            .unwrap_or_else(|| panic!("{text}: {}", run.stderr))
    };
    // In order and numbered; a failure is printed when it happens and again at the end.
    let order = [
        "[1/3] ",
        "[2/3] ",
        "error: ",
        "[3/3] ",
        "3 levels: 2 baked, 1 failed",
    ]
    .map(said);
    assert!(order.is_sorted(), "{order:?}: {}", run.stderr);
    said(&format!("failed, code 3  {}", broken.display()));
    said("lumel view");
    assert_eq!(run.stderr.matches("lumel view").count(), 1);

    // The same bytes as one by one.
    for level in [&a, &c] {
        let alone = t.path().join("alone");
        bake_all(&[level], &alone, "").ok();
    }
    let (together, alone) = (files(&out), files(&t.path().join("alone")));
    for (name, bytes) in &together {
        if name.ends_with(".report.json") {
            assert_eq!(comparable(bytes), comparable(&alone[name]), "{name}");
        } else {
            assert!(bytes == &alone[name], "{name}");
        }
    }
}

#[test]
fn unchanged_levels_are_skipped_and_one_rule_covers_all() {
    let t = temp();
    let (folder, out) = (t.path().join("levels"), t.path().join("out"));
    let [a, broken, c] = levels(&folder);
    fs::remove_file(broken).expect("removed");
    let rule = t.path().join("all.d");
    let options = format!("--skip-if-unchanged --depfile {}", rule.display());
    let run = bake_all(&[&folder], &out, &options).ok();
    assert!(run.stderr.contains("2 levels: 2 baked"), "{}", run.stderr);
    let text = fs::read_to_string(&rule).expect("it is written");
    let (targets, inputs) = text.split_once(": ").expect("a rule");
    for stem in ["a", "c"] {
        let page = out.join(format!("{stem}.lightmap.exr"));
        assert!(targets.contains(page.to_str().expect("UTF-8")), "{text}");
    }
    for level in [&a, &c] {
        assert!(inputs.contains(level.to_str().expect("UTF-8")), "{text}");
    }

    write(c, scene().replace("0.75", "0.5"));
    fs::remove_file(&rule).expect("removed, as ninja does");
    let run = bake_all(&[&folder], &out, &options).ok();
    assert!(
        run.stderr.contains("2 levels: 1 baked, 1 unchanged"),
        "{}",
        run.stderr
    );
    assert_eq!(fs::read_to_string(&rule).ok(), Some(text));

    // Each level gets a plan and nothing is written.
    let none = t.path().join("none");
    let run = bake_all(&[&folder], &none, "--dry-run").ok();
    assert_eq!(run.stdout.matches("scene ").count(), 2, "{}", run.stdout);
    assert!(!none.exists());
    let run = bake_all(&[&folder], &none, "--dry-run --json").ok();
    let documents =
        serde_json::Deserializer::from_str(&run.stdout).into_iter::<serde_json::Value>();
    assert_eq!(documents.filter_map(Result::ok).count(), 2);
}

#[test]
fn what_cannot_be_is_refused_before_the_work() {
    let t = temp();
    let (one, other) = (t.path().join("one"), t.path().join("other"));
    let [a, ..] = levels(&one);
    levels(&other);
    let out = t.path().join("out");
    for option in ["--preview", "--first-picture", "--report"] {
        bake_all(&[&one], &out, &format!("-q {option} x.png")).fails(1, &[option, "3 levels"]);
    }
    // Two levels with the same name would overwrite each other; one level given twice is fine.
    bake_all(&[&one, &other], &out, "-q").fails(1, &["a.gltf", "the same results"]);
    bake_all(&[&a, &a], &out, "-q").ok();
    let empty = t.path().join("empty");
    fs::create_dir(&empty).expect("created");
    bake_all(&[&empty], &out, "-q").fails(2, &["no level"]);
    assert_eq!(names(&out), outputs("a"));

    // Results beside a level are not taken for levels when their folder is baked.
    fs::copy(&a, out.join("new.gltf")).expect("copied");
    let again = t.path().join("again");
    bake_all(&[&out], &again, "-q").ok();
    assert_eq!(names(&again), outputs("new"));
    let report = parse(&files(&again)["new.report.json"]);
    assert_eq!(report["scene"], serde_json::json!("new.gltf"));
}

#[test]
#[cfg(unix)]
fn ctrl_c_stops_all_levels() {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;
    let t = temp();
    let (folder, out) = (t.path().join("levels"), t.path().join("out"));
    fs::create_dir(&folder).expect("created");
    for name in ["a.glb", "b.glb"] {
        fs::copy(crate::common::asset("demo_level.glb"), folder.join(name)).expect("copied");
    }
    let mut child = crate::common::command()
        .arg("bake")
        .arg(&folder)
        .arg("-o")
        .arg(&out)
        .args(["--quality", "production"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let mut log = BufReader::new(child.stderr.take().expect("it is piped")).lines();
    let mut line = || log.next().expect("it goes on").expect("UTF-8");
    while !line().contains("atlas") {}
    let kill = std::process::Command::new("kill")
        .args(["-s", "INT", &child.id().to_string()])
        .status();
    assert!(kill.expect("kill is installed").success());
    let rest: Vec<String> = log.map_while(Result::ok).collect();
    assert_eq!(
        child.wait().expect("it is ours").code(),
        Some(75),
        "{rest:?}"
    );
    assert!(!rest.iter().any(|l| l.starts_with("[2/2]")), "{rest:?}");
    assert!(!out.exists() || names(&out).is_empty());
}
