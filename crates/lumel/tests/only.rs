//! `--only` with the real binary: nodes baked anew into the results of an earlier bake.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use lumel::atlas_bake::{ExrImage, read_exr};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::{Run, asset, files, lumel, parse, temp};

/// A coarse bake of the demo level.
const COARSE: &[&str] = &[
    "--quality",
    "draft",
    "--texels-per-unit",
    "2",
    "--sky",
    "0.25",
];

/// A level that was baked into `out`.
struct Baked {
    folder: TempDir,
    options: Vec<&'static str>,
}

impl Baked {
    fn new(more: &[&'static str]) -> Baked {
        let baked = Baked::not_yet(more);
        baked.bake("out", &[]).ok();
        baked
    }

    /// A level that is not baked yet.
    fn not_yet(more: &[&'static str]) -> Baked {
        let folder = temp();
        fs::copy(asset("demo_level.glb"), folder.path().join("level.glb")).expect("copied");
        let options = [COARSE, more].concat();
        Baked { folder, options }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn bake(&self, out: &str, more: &[&str]) -> Run {
        let (level, out) = (self.at("level.glb"), self.at(out));
        let mut words = vec![
            "bake".as_ref(),
            level.as_os_str(),
            "-o".as_ref(),
            out.as_os_str(),
        ];
        words.extend(self.options.iter().chain(more).map(OsStr::new));
        lumel(words)
    }

    /// Changes the level's JSON.
    fn edit(&self, change: impl FnOnce(&mut Value)) {
        let path = self.at("level.glb");
        let bytes = fs::read(&path).expect("the level");
        let length = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes"));
        let end = 20 + length(12) as usize;
        let mut json = parse(&bytes[20..end]);
        change(&mut json);
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = bytes[..8].to_vec();
        out.extend((12 + 8 + text.len() as u32 + (bytes.len() - end) as u32).to_le_bytes());
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(b"JSON");
        out.extend(text);
        out.extend(&bytes[end..]);
        fs::write(path, out).expect("written");
    }

    fn page(&self, out: &str) -> ExrImage {
        read_exr(&self.at(out).join("level.lightmap.exr")).expect("an EXR")
    }

    fn json(&self, out: &str, end: &str) -> Value {
        parse(fs::read(self.at(out).join(format!("level.{end}"))).expect("a file"))
    }

    /// Rectangles of nodes on the page, by whether `chosen` names them.
    fn rects(&self, out: &str, chosen: impl Fn(&str) -> bool) -> [Vec<[usize; 4]>; 2] {
        let mut found = [Vec::new(), Vec::new()];
        let manifest = self.json(out, "lightmap.json");
        for node in manifest["nodes"].as_array().expect("nodes") {
            let side = |k: &str| node["rect"][k].as_u64().expect("a number") as usize;
            let rect = ["x", "y", "w", "h"].map(side);
            let name = node["name"].as_str().expect("a name");
            found[usize::from(chosen(name))].push(rect);
        }
        found
    }
}

/// Dims the lamps of the room `store` and makes its spot red.
fn other_lamps(json: &mut Value) {
    let lights = &mut json["extensions"]["KHR_lights_punctual"]["lights"];
    lights[1]["color"] = serde_json::json!([1.0, 0.1, 0.1]);
    lights[2]["intensity"] = 0.5.into();
}

fn node<'j>(json: &'j mut Value, name: &str) -> &'j mut Value {
    let nodes = json["nodes"].as_array_mut().expect("nodes");
    nodes
        .iter_mut()
        .find(|n| n["name"] == name)
        .expect("the node")
}

fn texels(rects: &[[usize; 4]], width: u32) -> Vec<usize> {
    let rows = rects.iter().flat_map(|&[x, y, w, h]| {
        (y..y + h).flat_map(move |y| (x..x + w).map(move |x| y * width as usize + x))
    });
    rows.collect()
}

/// Root mean square of the difference at these texels, relative to that of the values.
fn difference(a: &ExrImage, b: &ExrImage, texels: &[usize]) -> f64 {
    let (mut sum, mut all) = (0.0, 0.0);
    for c in ["R", "G", "B"] {
        let (a, b) = (a.channel(c).expect("it"), b.channel(c).expect("it"));
        for &at in texels {
            sum += f64::from(a[at] - b[at]).powi(2);
            all += f64::from(a[at]).powi(2);
        }
    }
    (sum / all).sqrt()
}

/// `_IRRADIANCE` by node name.
fn at_vertices(glb: &Path) -> BTreeMap<String, Vec<[f32; 3]>> {
    let loaded = mesh_ingest::load(glb, &Default::default()).expect("a glTF");
    let document = &loaded.document;
    let mut out = BTreeMap::new();
    for node in document.json()["nodes"].as_array().expect("nodes") {
        let Some(mesh) = node["mesh"].as_u64() else {
            continue;
        };
        let primitives = &document.json()["meshes"][mesh as usize]["primitives"];
        let light = primitives.as_array().into_iter().flatten().flat_map(|p| {
            let accessor = p["attributes"]["_IRRADIANCE"].as_u64().expect("light");
            let raw = document
                .accessor_raw(accessor as usize)
                .expect("an accessor");
            raw.to_floats::<3>(0.0)
        });
        out.insert(
            node["name"].as_str().unwrap_or_default().to_owned(),
            light.collect(),
        );
    }
    out
}

#[test]
fn nothing_changes_where_nothing_changed() {
    let baked = Baked::new(&[]);
    let before = files(&baked.at("out"));
    let run = baked
        .bake("out", &["--only", "store", "--only", "crate_*"])
        .ok();
    assert!(
        run.stderr.contains("unchanged: store, crate_*"),
        "{}",
        run.stderr
    );
    assert!(before == files(&baked.at("out")));
    // Results that were damaged since are not up to date. What is read must be as it was written,
    // and what is not is written again.
    let damage = |name: &str| {
        let bytes = &before[name];
        fs::write(baked.at("out").join(name), &bytes[..bytes.len() - 20]).expect("writable");
        baked.bake("out", &["--only", "store", "-q"])
    };
    damage("level.lightmap.exr").fails(3, &["level.lightmap.exr", "another file"]);
    fs::write(
        baked.at("out/level.lightmap.exr"),
        &before["level.lightmap.exr"],
    )
    .expect("writable");
    damage("level.glb").ok();
    let after = &files(&baked.at("out"))["level.glb"];
    let length = u32::from_le_bytes(after[8..12].try_into().expect("4 bytes"));
    assert_eq!(length as usize, after.len());
}

#[test]
fn only_named_nodes_get_new_light() {
    // A whole bake would cut charts where the other lamps' shadows end.
    let options = [
        "--layers",
        "direct,indirect",
        "--group",
        "spot=spot",
        "--no-cut-charts",
    ];
    let baked = Baked::new(&options);
    let (old, vertices) = (
        baked.page("out"),
        at_vertices(&baked.at("out/level.vertex.glb")),
    );
    let [others, store] = baked.rects("out", |name| name == "store" || name == "crate_6");
    baked.edit(other_lamps);
    baked
        .bake("out", &["--only", "store", "--only", "crate_6"])
        .ok();
    baked.bake("whole", &[]).ok();
    let (new, whole) = (baked.page("out"), baked.page("whole"));
    let (others, store) = (texels(&others, old.width), texels(&store, old.width));
    // Lumels of others keep every bit, in all channels.
    for ((name, a), (_, b)) in old.channels.iter().zip(&new.channels) {
        for &at in &others {
            assert!(a[at].to_bits() == b[at].to_bits(), "{name} at {at}");
        }
    }
    // The named nodes have the new light. The tolerance is half of a draft's error (the median of
    // the whole bake is 6 %): noise is judged among other lumels, so smoothing differs.
    assert!(difference(&old, &whole, &store) > 0.2);
    let found = difference(&whole, &new, &store);
    assert!(found < 0.03, "{found}");
    let now = at_vertices(&baked.at("out/level.vertex.glb"));
    for (name, light) in &vertices {
        let chosen = name == "store" || name == "crate_6";
        assert_eq!(now[name] != *light, chosen, "{name}");
    }
    let report = baked.json("out", "report.json");
    assert_eq!(
        report["only"]["nodes"],
        serde_json::json!(["\"store\"", "\"crate_6\""])
    );
    // Pages of groups keep the others too.
    let group = |out: &str| read_exr(&baked.at(out).join("level.group.spot.exr")).expect("an EXR");
    let (a, b) = (group("out"), group("whole"));
    assert!(difference(&b, &a, &store) < 0.03);
    // Bytes do not depend on threads, and a second time nothing is left to do.
    let run = baked.bake("out", &["--only", "store"]).ok();
    assert!(run.stderr.contains("unchanged"), "{}", run.stderr);
    // A whole bake is not skipped, because the other nodes' light is old.
    let run = baked.bake("out", &["--skip-if-unchanged"]).ok();
    assert!(run.stderr.contains("baked level.glb"), "{}", run.stderr);
    let same = |name: &str| {
        let [a, b] = ["out", "whole"].map(|out| fs::read(baked.at(out).join(name)).expect("it"));
        a == b
    };
    assert!(same("level.lightmap.exr") && same("level.vertex.glb"));
}

/// The results are in another folder than the pictures and measurements that lamps name.
#[test]
fn files_of_lamps_are_beside_the_level() {
    let baked = Baked::not_yet(&[]);
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([255, 128, 0]));
    picture.save(baked.at("orange.png")).expect("written");
    baked.edit(|json| {
        let lights = &mut json["extensions"]["KHR_lights_punctual"]["lights"];
        lights[1]["extras"]["lumel"]["cookie"] = "orange.png".into();
    });
    baked.bake("out", &[]).ok();
    baked.edit(other_lamps);
    baked.bake("out", &["--only", "store"]).ok();
    let report = baked.json("out", "report.json");
    assert_eq!(report["only"]["nodes"], serde_json::json!(["\"store\""]));
}

/// Coarser levels of detail copy the light of the first, so they are baked with it. Pages for GPUs
/// keep the bytes of other nodes, as the EXR does.
#[test]
fn coarser_levels_follow_the_first() {
    let baked = Baked::not_yet(&["--ktx2", "rgb9e5"]);
    baked.edit(|json| {
        let mut coarse = node(json, "crate_6").clone();
        coarse["name"] = "crate_6_LOD1".into();
        node(json, "crate_6")["name"] = "crate_6_LOD0".into();
        let nodes = json["nodes"].as_array_mut().expect("nodes");
        let index = nodes.len();
        nodes.push(coarse);
        let roots = json["scenes"][0]["nodes"].as_array_mut().expect("roots");
        roots.push(index.into());
    });
    baked.bake("out", &[]).ok();
    let ktx2 = || fs::read(baked.at("out/level.lightmap.ktx2")).expect("it");
    let old = ktx2();
    baked.edit(other_lamps);
    baked.bake("out", &["--only", "crate_6_LOD0"]).ok();
    let report = baked.json("out", "report.json");
    assert_eq!(
        report["only"]["nodes"],
        serde_json::json!(["\"crate_6_LOD0\"", "\"crate_6_LOD1\""])
    );
    let new = ktx2();
    let [others, crates] = baked.rects("out", |name| name.starts_with("crate_6_LOD"));
    assert_eq!(crates.len(), 2);
    let word = |b: &[u8], at: usize| u32::from_le_bytes(b[at..at + 4].try_into().expect("4 bytes"));
    let (width, start) = (word(&new, 20), word(&new, 80) as usize);
    let changed = |rects: &[[usize; 4]]| {
        let at = |t: &&usize| word(&old, start + 4 * **t) != word(&new, start + 4 * **t);
        texels(rects, width).iter().filter(at).count()
    };
    assert_eq!(changed(&others), 0);
    assert!(changed(&crates[..1]) > 0 && changed(&crates[1..]) > 0);
}

#[test]
fn all_nodes_anew_are_a_whole_bake() {
    // Charts stay where they are, and a whole bake would cut them for the other lamps.
    let options = [
        "--directional",
        "sh1",
        "--value",
        "irradiance",
        "--no-cut-charts",
    ];
    let baked = Baked::new(&options);
    baked.edit(other_lamps);
    baked.bake("out", &["--only", "*", "--threads", "1"]).ok();
    baked.bake("whole", &[]).ok();
    let (mut a, mut b) = (files(&baked.at("out")), files(&baked.at("whole")));
    a.remove("level.report.json");
    b.remove("level.report.json");
    assert!(a == b);
}

#[test]
fn geometry_may_move_only_where_it_is_named() {
    let baked = Baked::new(&["--no-vertex-colors"]);
    baked.edit(|json| node(json, "bench_0")["translation"] = serde_json::json!([16.0, 0.0, 8.3]));
    let before = files(&baked.at("out"));
    let fails = |more: &[&str], code, words: &[&str]| {
        baked
            .bake("out", &[&["-q"], more].concat())
            .fails(code, words);
        assert!(before == files(&baked.at("out")));
    };
    fails(
        &["--only", "gallery"],
        3,
        &["geometry of \"bench_0\" changed", "name it too"],
    );
    fails(
        &["--only", "bench0"],
        1,
        &["\"bench0\"", "did you mean \"bench_0\""],
    );
    fails(&["--only", "camera"], 1, &["no node with a mesh"]);
    fails(
        &["--only", "bench_0", "--sky-intensity", "0.5"],
        3,
        &["other settings", "sky_intensity: 1.0 there, 0.5 here"],
    );
    baked
        .bake("nowhere", &["-q", "--only", "bench_0"])
        .fails(2, &["earlier bake"]);
    assert!(!baked.at("nowhere").exists());
    baked
        .bake("out", &["--only", "gallery", "--only", "bench_0"])
        .ok();
    baked.edit(|json| {
        let mut more = node(json, "bench_1").clone();
        more["name"] = "bench_9".into();
        json["nodes"].as_array_mut().expect("nodes").push(more);
        let last = json["nodes"].as_array().expect("nodes").len() - 1;
        json["scenes"][0]["nodes"]
            .as_array_mut()
            .expect("nodes")
            .push(last.into());
    });
    let run = baked.bake("out", &["-q", "--only", "bench_0"]);
    run.fails(3, &["other nodes", "it lacks \"bench_9\""]);
}

#[test]
fn damaged_results_are_refused() {
    let baked = Baked::new(&[]);
    baked.edit(other_lamps);
    for (name, word) in [
        ("level.lightmap.exr", "another file"),
        ("level.vertex.glb", "another file"),
        ("level.report.json", "changed"),
    ] {
        let path = baked.at("out").join(name);
        let bytes = fs::read(&path).expect("a result");
        let mut other = bytes.clone();
        let middle = other.len() / 2;
        other[middle] ^= 1;
        fs::write(&path, other).expect("written");
        let run = baked.bake("out", &["-q", "--only", "store"]);
        run.fails(3, &[name, word]);
        fs::write(&path, bytes).expect("written");
    }
    fs::remove_file(baked.at("out/level.lightmap.exr")).expect("removed");
    baked
        .bake("out", &["-q", "--only", "store"])
        .fails(2, &["level.lightmap.exr"]);
}
