//! `--no-vertex-colors` with the real binary: the lightmap keeps every byte, and no outdated vertex
//! light remains.

use crate::common::{asset, bake, files, lumel, names, outputs, parse, temp, write};
use serde_json::{Value, json};

const OUT: &str = "--no-vertex-colors";

#[test]
fn all_but_vertex_colours_keeps_its_bytes() {
    let (all, some) = (temp(), temp());
    let scene = asset("cornell_box.glb");
    let options = "--layers direct,error --vertex-error 0.2";
    bake(&scene, all.path(), options).ok();
    let options = format!("--layers direct,error {OUT} -v");
    let said = bake(&scene, some.path(), &options).ok().stderr;
    assert!(!said.contains("  vertices"), "{said}");
    let (all, some) = (files(all.path()), files(some.path()));
    let kept: Vec<&String> = some.keys().collect();
    let expected = outputs("cornell_box");
    let expected = expected.iter().filter(|n| !n.ends_with(".vertex.glb"));
    assert_eq!(kept, expected.collect::<Vec<_>>());
    for (name, bytes) in &some {
        assert!(
            name.ends_with("report.json") || all[name] == *bytes,
            "{name}"
        );
    }
    let [all, some] = [&all, &some].map(|f| parse(&f["cornell_box.report.json"]));
    assert!(all["gather"]["vertices"]["points"].as_u64() > Some(0));
    assert_eq!(some["gather"]["vertices"], Value::Null);
    assert_eq!(some["settings"]["vertex_colors"], json!(false));
    assert_eq!(some["origins"]["vertex-colors"], json!("flag"));
    let [all, mut some] = [all, some].map(|mut r| r["gather"].take());
    some["vertices"] = all["vertices"].clone();
    assert_eq!(some, all, "what was gathered at lumels");
}

#[test]
fn how_close_colours_of_nothing_are_is_wrong_usage() {
    let t = temp();
    let scene = write(
        t.path().join("box.glb"),
        std::fs::read(asset("furnace_cube_50.glb")).expect("it exists"),
    );
    let out = t.path().join("out");
    let both = format!("{OUT} --vertex-error 0.1");
    bake(&scene, &out, &both).fails(1, &["--vertex-error", OUT]);
    bake(&scene, &out, &format!("{OUT} --vertex-colors")).fails(1, &["--vertex-colors", OUT]);
    let config = |text| write(t.path().join("box.lumel.toml"), text);
    config("vertex-colors = false");
    bake(&scene, &out, "--vertex-error 0.1").fails(1, &["0.1", OUT]);
    config("vertex-colors = false\nvertex-error = 0.1");
    bake(&scene, &out, "").fails(1, &["0.1", "vertex-colors = false"]);
    assert!(!out.exists());
    // Options override the file.
    let settings = |options: &str| {
        bake(&scene, &out, options).ok();
        let mut report = parse(&files(&out)["box.report.json"]);
        (report["settings"].take(), report["origins"].take())
    };
    let (s, _) = settings("--vertex-colors");
    assert_eq!(s["vertex_error"], json!(0.1));
    config("vertex-error = 0.1");
    let (s, origins) = settings(OUT);
    assert_eq!(
        (&s["vertex_error"], &s["vertex_colors"]),
        (&Value::Null, &json!(false))
    );
    assert_eq!(origins["vertex-error"], Value::Null);
}

#[test]
fn colours_of_an_earlier_bake_go_and_those_of_others_stay() {
    let t = temp();
    let (scene, name) = (asset("cornell_box.glb"), "cornell_box.vertex.glb");
    // No report lists this file as written.
    write(t.path().join(name), b"mine");
    bake(&scene, t.path(), OUT).ok();
    assert_eq!(files(t.path())[name], b"mine");
    bake(&scene, t.path(), "").ok();
    assert!(files(t.path())[name].starts_with(b"glTF"));
    let said = bake(&scene, t.path(), &format!("{OUT} -v")).ok().stderr;
    assert!(!names(t.path()).contains(&name.to_owned()));
    let removed = said.lines().find(|l| l.starts_with("  removed"));
    assert!(removed.is_some_and(|l| l.ends_with(name)), "{said}");
}

#[test]
fn plans_builds_and_pages_know_that_there_are_none() {
    let t = temp();
    let (scene, out) = (asset("cornell_box.glb"), t.path().join("out"));
    let plan = bake(&scene, &out, &format!("{OUT} --dry-run")).ok().stdout;
    assert!(
        plan.contains("cornell_box.lightmap.exr") && !plan.contains("vertex.glb"),
        "{plan}"
    );
    let rule = t.path().join("d");
    let options = format!("{OUT} --skip-if-unchanged --depfile {}", rule.display());
    assert!(bake(&scene, &out, &options).ok().stderr.contains("baked"));
    let text = std::fs::read_to_string(&rule).expect("written");
    assert!(text.contains("lightmap.exr") && !text.contains("vertex.glb"));
    let again = bake(&scene, &out, &options).ok().stderr;
    assert!(again.starts_with("unchanged: "), "{again}");
    let other = bake(&scene, &out, "--skip-if-unchanged").ok().stderr;
    assert!(other.contains("baked"), "{other}");
    bake(&scene, &out, &options).ok();
    let page = t.path().join("page.html");
    let paths = [&out, &page].map(|p| p.to_str().expect("UTF-8"));
    lumel(["report", paths[0], "-o", paths[1]]).ok();
    assert!(page.exists());
}
