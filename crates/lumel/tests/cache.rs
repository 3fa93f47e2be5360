//! `--cache` by the real binary: the bytes of a clean bake, whatever changed since the cache was filled and whatever became of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::common::{asset, bake, comparable, files, names, parse, temp, write};
use serde_json::{Value, json};
use tempfile::TempDir;

/// The Cornell box with three lamps of its own (a point, a ball and a spot), changed by `change`.
fn level(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let glb = std::fs::read(asset("cornell_box.glb")).expect("the asset is there");
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("four bytes"));
    let end = 20 + word(12) as usize;
    let mut v = parse(&glb[20..end]);
    v["extensionsUsed"] = json!(["KHR_materials_emissive_strength", "KHR_lights_punctual"]);
    v["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 3.0},
        {"type": "point", "intensity": 2.0, "extras": {"lumel": {"radius": 0.2}}},
        {"type": "spot", "intensity": 9.0, "spot": {"outerConeAngle": 0.9}},
    ]}});
    let lamp = |light: u32, at: [f64; 3]| json!({"translation": at, "extensions": {"KHR_lights_punctual": {"light": light}}});
    let nodes = v["nodes"].as_array_mut().expect("nodes");
    nodes.push(lamp(0, [1.0, 4.0, 1.0]));
    nodes.push(lamp(1, [4.5, 1.0, 0.5]));
    nodes.push(lamp(2, [2.0, 3.0, 2.0]));
    v["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4]);
    change(&mut v);
    let mut text = v.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let size = |n: usize| (n as u32).to_le_bytes();
    let parts = [
        &glb[..8],
        &size(20 + text.len() + glb.len() - end),
        &size(text.len()),
        &glb[16..20],
        &text,
        &glb[end..],
    ];
    write(folder.join("level.glb"), parts.concat())
}

/// A level, a cache, and bakes with and without.
struct Place {
    folder: TempDir,
}

/// What a bake wrote, and what its cache did.
struct Baked {
    files: BTreeMap<String, Vec<u8>>,
    cache: Value,
    stderr: String,
}

impl Baked {
    fn rays(&self) -> [u64; 2] {
        ["rays_taken", "rays_cast"].map(|k| self.cache[k].as_u64().expect("a number"))
    }
}

impl Place {
    /// With a cache that holds a bake of the unchanged level.
    fn filled(options: &str) -> Place {
        let place = Place { folder: temp() };
        let first = place.bake(|_| {}, &format!("--cache {} {options}", place.cache()));
        assert_eq!(first.cache["found"], false);
        assert_eq!(first.rays(), [0, 0]);
        assert_eq!(place.records().len(), 1);
        place
    }

    fn cache(&self) -> String {
        self.folder.path().join("cache").display().to_string()
    }

    /// The cache's files.
    fn records(&self) -> Vec<PathBuf> {
        let folder = self.folder.path().join("cache");
        names(&folder).into_iter().map(|n| folder.join(n)).collect()
    }

    fn bake(&self, change: impl FnOnce(&mut Value), options: &str) -> Baked {
        let scene = level(self.folder.path(), change);
        let out = temp();
        let run = bake(&scene, out.path(), options).ok();
        let mut files = files(out.path());
        let report = files.remove("level.report.json").expect("a report");
        let cache = parse(&report)["measured"]["cache"].take();
        files.insert("report".into(), comparable(report).to_string().into_bytes());
        Baked {
            files,
            cache,
            stderr: run.stderr,
        }
    }

    /// Bakes with the cache and without, and gives the former; both are the same.
    #[track_caller]
    fn compare(&self, change: impl Fn(&mut Value), options: &str) -> Baked {
        let clean = self.bake(&change, options);
        assert_eq!(clean.cache, Value::Null);
        let cached = self.bake(&change, &format!("--cache {} {options}", self.cache()));
        for (name, bytes) in &clean.files {
            assert!(cached.files.get(name) == Some(bytes), "{name} differs");
        }
        assert_eq!(clean.files.len(), cached.files.len());
        cached
    }
}

type Change = fn(&mut Value);

fn intensity(v: &mut Value) {
    v["extensions"]["KHR_lights_punctual"]["lights"][1]["intensity"] = json!(0.7);
}

fn moved(v: &mut Value) {
    v["nodes"][2]["translation"] = json!([1.6, 3.5, 1.4]);
}

#[test]
fn what_did_not_change_casts_no_ray_again() {
    let place = Place::filled("--threads 1");
    for options in ["--threads 1", "--threads 2"] {
        let again = place.compare(|_| {}, options);
        assert_eq!(again.cache["found"], true);
        let [taken, cast] = again.rays();
        // What is cast are rays that no record can hold; the box has next to none of them.
        assert!(taken > 100_000 && cast * 1000 < taken, "{taken} {cast}");
    }
    // What only the output depends on.
    let other = place.compare(
        |_| {},
        "--value irradiance --layers direct,error,coverage --no-stitch",
    );
    let [taken, cast] = other.rays();
    assert!(taken > 100_000 && cast * 1000 < taken, "{taken} {cast}");
}

#[test]
fn lamps_that_change_cast_their_own_rays() {
    let place = Place::filled("");
    // With the least share of rays that are taken. A lamp more or less shifts the random numbers of those after it and of the emitter.
    let lamp: &[(&str, f64, Change)] = &[
        ("moved", 0.7, moved),
        ("intensity", 0.7, intensity),
        ("added", 0.2, |v| {
            let lamp = json!({"translation": [3.0, 1.0, 1.0], "extensions": {"KHR_lights_punctual": {"light": 0}}});
            v["nodes"].as_array_mut().expect("nodes").push(lamp);
            v["scenes"][0]["nodes"] = json!([5, 0, 1, 2, 3, 4]);
        }),
        ("removed", 0.2, |v| {
            v["scenes"][0]["nodes"] = json!([0, 1, 3, 4])
        }),
    ];
    for (name, least, change) in lamp {
        for threads in [1, 2] {
            let cached = place.compare(change, &format!("--threads {threads}"));
            let [taken, cast] = cached.rays();
            assert_eq!(cached.cache["found"], true, "{name}");
            let share = taken as f64 / (taken + cast) as f64;
            assert!(cast > 0 && share > *least, "{name}: {taken} {cast}");
        }
    }
    assert_eq!(place.records().len(), 1);
    // The sky brings light, and decides about no ray.
    let sky = place.compare(|_| {}, "--sky 0.5,0.6,0.7");
    assert_eq!(sky.cache["found"], true);
}

#[test]
fn what_else_changes_is_another_bake() {
    let place = Place::filled("");
    let colour = place.compare(
        |v| {
            v["materials"][1]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.1, 0.2, 0.5, 1])
        },
        "",
    );
    assert_eq!(colour.cache["found"], false);
    let geometry = place.compare(|v| v["nodes"][0]["scale"] = json!([1.0, 1.1, 1.0]), "");
    assert_eq!(geometry.cache["found"], false);
    let limit = place.compare(|_| {}, "--max-reflectance 0.3");
    assert_eq!(limit.cache["found"], false);
    assert_eq!(place.records().len(), 4);
}

#[test]
fn groups_directions_and_openness_come_from_records_too() {
    let options = "--group lamp=lamp --directional sh1 --layers ao,sun_mask --sky 0.3";
    let place = Place::filled(options);
    for change in [moved as fn(&mut Value), intensity] {
        let cached = place.compare(change, options);
        let [taken, cast] = cached.rays();
        assert!(
            cached.cache["found"] == true && taken > cast,
            "{taken} {cast}"
        );
    }
}

#[test]
fn a_cache_that_is_not_whole_is_none() {
    let place = Place::filled("");
    let [record] = &place.records()[..] else {
        panic!("one file")
    };
    let whole = std::fs::read(record).expect("it is there");
    // Damage in the middle: some blocks are not as they were written, and their rays are cast.
    let mut bytes = whole.clone();
    for at in (whole.len() / 4..whole.len() / 2).step_by(997) {
        bytes[at] ^= 0x10;
    }
    write(record.clone(), &bytes);
    let damaged = place.compare(moved, "");
    assert_eq!(damaged.cache["found"], true);
    assert!(damaged.cache["damaged"].as_u64() > Some(0));
    assert!(damaged.stderr.contains("damaged"), "{}", damaged.stderr);
    // Cut short, of another form, empty, or with a broken index: the file is written anew.
    let mut broken_index = whole.clone();
    let at = whole.len() - 100;
    broken_index[at] ^= 1;
    let mut other_form = whole.clone();
    other_form[14] = b'0';
    for bytes in [
        &whole[..whole.len() - 1],
        &whole[..30],
        &[],
        &broken_index,
        &other_form,
    ] {
        write(record.clone(), bytes);
        let refused = place.compare(moved, "");
        assert_eq!(refused.cache["found"], false);
        assert!(refused.stderr.contains("is not used"), "{}", refused.stderr);
        assert_eq!(place.compare(|_| {}, "").cache["found"], true);
    }
    // Under another's name.
    let foreign = place
        .folder
        .path()
        .join("cache")
        .join(format!("{:032}.lumelrays", 0));
    std::fs::copy(record, &foreign).expect("it can be copied");
    write(record.clone(), &whole);
    assert_eq!(place.compare(moved, "").cache["found"], true);
}

#[test]
fn a_folder_that_cannot_be_written_costs_no_bake() {
    let place = Place { folder: temp() };
    let file = write(place.folder.path().join("cache"), "no folder");
    let baked = place.compare(|_| {}, "");
    assert_eq!(baked.cache["bytes"], 0);
    assert!(baked.stderr.contains("nothing is kept"), "{}", baked.stderr);
    assert_eq!(std::fs::read(file).expect("it is there"), b"no folder");
}

#[test]
fn the_oldest_records_go_when_there_are_too_many() {
    let place = Place::filled("");
    let first = place.records();
    let size = std::fs::metadata(&first[0]).expect("it is there").len();
    let limit = format!("--cache {} --cache-size {}", place.cache(), size * 3 / 2);
    let other = place.bake(|v| v["nodes"][0]["scale"] = json!([1.0, 1.1, 1.0]), &limit);
    assert_eq!(other.cache["removed"], 1);
    assert_eq!(place.records().len(), 1);
    assert!(!place.records().contains(&first[0]));
}

#[test]
fn charts_of_large_meshes_are_kept() {
    let (t, scene) = (temp(), asset("demo_level.glb"));
    let cache = t.path().join("cache");
    let run = |name: &str, options: &str| {
        let out = t.path().join(name);
        let cheap = "--sky 0.5";
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
    // Another lamp, another kind of value: the same meshes.
    let other = "--value irradiance --light sun*=0.5";
    let (clean, none, _) = run("clean", other);
    assert_eq!(none, Value::Null);
    let (cached, found, stderr) = run("cached", &with(other));
    assert_eq!(found, json!([kept, 0]));
    assert!(stderr.contains("charts of"), "{stderr}");
    assert!(clean == cached, "charts from the cache change bytes");
    // Damaged, cut short, empty: made anew.
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
    // Another distance between charts is another question.
    let (_, padded, _) = run("padded", &with("--padding 4"));
    assert_eq!(padded, json!([0, kept]));
}
