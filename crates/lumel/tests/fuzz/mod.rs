//! Thousands of damaged inputs: each must give either a valid result or one error.
//!
//! A short run is part of the other tests. `tools/fuzz.sh MINUTES` runs longer, with another seed
//! each time, and prints a summary. Failing inputs are stored next to the binary under `fuzz/`;
//! each should become a test in the crate with the fault.

mod compressed;
mod mutate;
pub mod seeds;
mod targets;

use std::fs::File;
use std::io::{Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use image::ImageFormat;
use lumel::atlas_bake::WorkTime;
use lumel::view::Viewer;
use serde_json::Value;

use mutate::Random;
use seeds::Level;
use targets::{Outcome, Place};

/// Most processor time per input in seconds, and more for each texel that is baked: 143,207 lumels
/// took 13.8 s, and options may add as much again several times. The slowest seed takes 50 ms.
const PATIENCE: f64 = 10.0;
const PER_TEXEL: f64 = 5e-4;

/// Length and seed of a run.
struct Plan {
    /// Executions per target by default.
    brief: usize,
    /// Seconds per target, from `LUMEL_FUZZ_SECONDS`.
    seconds: Option<f64>,
    seed: u64,
}

impl Plan {
    fn of(brief: usize) -> Plan {
        let variable = |name: &str| std::env::var(name).ok()?.parse::<f64>().ok();
        Plan {
            brief,
            seconds: variable("LUMEL_FUZZ_SECONDS"),
            seed: variable("LUMEL_FUZZ_SEED").unwrap_or(1.0) as u64,
        }
    }
}

thread_local! {
    /// Inputs are so small that distributing them over threads takes longer than reading them.
    static ALONE: rayon::ThreadPool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build()
        .expect("a pool of this thread");
}

fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    ALONE.with(|pool| pool.install(work))
}

/// Runs `target` on inputs from `damage`, and fails at the end with all faults.
fn run(
    name: &str,
    brief: usize,
    mut damage: impl FnMut(&mut Random) -> Vec<u8>,
    target: impl Fn(&[u8]) -> Outcome + Sync,
) {
    let plan = Plan::of(brief);
    let found = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    std::fs::create_dir_all(&found).expect("Cargo's own folder");
    let mut random = Random(plan.seed);
    let (start, mut done, mut read, mut worst) = (Instant::now(), 0usize, 0usize, 0.0f64);
    let mut wrong = Vec::new();
    let last = plan
        .seconds
        .map(|_| File::create(found.join(format!("{name}.last"))));
    let mut last = last.transpose().expect("Cargo's own folder");
    loop {
        let more = match plan.seconds {
            None => done < plan.brief,
            Some(seconds) => start.elapsed().as_secs_f64() < seconds,
        };
        if !more || wrong.len() >= 10 {
            break;
        }
        let input = damage(&mut random);
        if let Some(last) = &mut last {
            // Kept for the case that the process dies or hangs.
            keep(last, &input).expect("written");
        }
        // Of all threads: a target works on one, but it need not be this one. Other tests of a brief
        // run count too, but a target takes no longer than the time that passes.
        let began = WorkTime::start();
        let outcome = catch_unwind(AssertUnwindSafe(|| alone(|| target(&input))));
        let took = began.serial();
        worst = worst.max(took);
        done += 1;
        let texels = outcome.as_ref().ok().and_then(|o| o.as_ref().ok());
        read += usize::from(texels.is_some());
        let allowed = PATIENCE + PER_TEXEL * texels.copied().unwrap_or(0) as f64;
        if outcome.is_err() || took > allowed {
            let path = found.join(format!("{name}.{}.{done}", plan.seed));
            std::fs::write(&path, &input).expect("written");
            wrong.push(format!("{} after {took:.1} s", path.display()));
        }
    }
    if plan.seconds.is_some() {
        let peak = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let peak = peak.lines().find(|l| l.starts_with("VmHWM")).unwrap_or("");
        say(&format!(
            "{name:<10} {done:>9} executions, {read:>9} read, {:>7.0}/s, longest {worst:.2} s, {} wrong, {peak}",
            done as f64 / start.elapsed().as_secs_f64(),
            wrong.len()
        ));
    }
    assert!(wrong.is_empty(), "{name}: {wrong:#?}");
    // A target that refuses everything tests nothing; one that refuses nothing gets undamaged
    // input.
    assert!(
        read > 0 && read < done,
        "{name}: {read} of {done} were read"
    );
}

/// Replaces a file's content. Opening it for each input would take longer than some targets.
fn keep(file: &mut File, input: &[u8]) -> std::io::Result<()> {
    file.rewind()?;
    file.write_all(input)?;
    file.set_len(input.len() as u64)
}

#[allow(
    clippy::print_stderr,
    reason = "tells whoever runs the campaign what was done"
)]
fn say(line: &str) {
    eprintln!("{line}");
}

fn place() -> (tempfile::TempDir, Place) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = Place(folder.path().to_owned());
    (folder, place)
}

/// Small documents in the folder `LUMEL_FUZZ_SEEDS`, e.g. compressed ones, which the tests cannot
/// generate.
fn further() -> Vec<Vec<u8>> {
    let folder = std::env::var_os("LUMEL_FUZZ_SEEDS").map(PathBuf::from);
    let entries = folder.and_then(|f| std::fs::read_dir(f).ok());
    let mut paths: Vec<_> = entries
        .into_iter()
        .flatten()
        .flatten()
        .map(|e| e.path())
        .collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "glb"));
    // Only the seed may decide the order, not the file system.
    paths.sort();
    let read = paths.iter().filter_map(|p| std::fs::read(p).ok());
    read.filter(|bytes| bytes.len() < 100_000).collect()
}

/// Damages bytes of one of `seeds`.
fn of_bytes(seeds: Vec<Vec<u8>>) -> impl FnMut(&mut Random) -> Vec<u8> {
    move |random| {
        let (seed, other) = (random.pick(&seeds), random.pick(&seeds));
        mutate::bytes(random, &seed, &other)
    }
}

/// Damages the JSON tree of one of `levels`.
fn of_trees<const N: usize>(levels: [Level; N]) -> impl FnMut(&mut Random) -> Vec<u8> {
    move |random| {
        let level = &levels[random.below(N)];
        let json = mutate::tree(random, &level.json);
        let bin = level.bin.clone();
        Level { json, bin }.glb()
    }
}

/// Damages a JSON tree or its text.
fn of_json(text: &[u8]) -> impl FnMut(&mut Random) -> Vec<u8> + use<> {
    let value: Value = serde_json::from_slice(text).expect("a sound seed");
    let text = text.to_vec();
    move |random| match random.below(3) {
        0 => mutate::bytes(random, &text, &text),
        _ => mutate::tree(random, &value).to_string().into_bytes(),
    }
}

#[test]
fn containers() {
    let (_folder, place) = place();
    let mut seeds = vec![
        seeds::level().glb(),
        seeds::with_files(&[], &seeds::ies()).glb(),
    ];
    seeds.extend(further());
    run("containers", 3000, of_bytes(seeds), |b| {
        targets::load(&place, b)
    });
}

#[test]
fn documents() {
    let (_folder, place) = place();
    run("documents", 6000, of_trees(seeds::levels()), |b| {
        targets::load(&place, b)
    });
}

#[test]
fn meshopt() {
    let (_folder, place) = place();
    let whole = compressed::meshopt_streams();
    let damage = move |random: &mut Random| {
        let mut streams = whole.clone();
        let k = random.below(2);
        streams[k] = mutate::bytes(random, &whole[k], &whole[1 - k]);
        // The last does not fit the stride.
        let filter = random.pick(&["NONE", "EXPONENTIAL", "OCTAHEDRAL"]);
        compressed::with_meshopt(&streams, filter).glb()
    };
    run("meshopt", 3000, damage, |b| targets::load(&place, b));
}

#[test]
fn cached_charts() {
    let target = targets::Kept::new();
    let whole = target.whole.clone();
    let damage = move |random: &mut Random| {
        let body = mutate::bytes(random, &whole[targets::Kept::HEAD..], &whole);
        // Half of them with a wrong hash.
        match random.below(2) {
            0 => [&whole[..targets::Kept::HEAD], &body].concat(),
            _ => targets::Kept::sealed(&whole, &body),
        }
    };
    run("charts", 200, damage, |b| target.layout(b));
}

#[test]
fn pictures() {
    let (_folder, place) = place();
    let mut seeds = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP]
        .map(seeds::picture)
        .to_vec();
    seeds.extend(seeds::KTX2.map(<[u8]>::to_vec));
    run("pictures", 3000, of_bytes(seeds), |b| {
        targets::picture(&place, b)
    });
}

#[test]
fn lamps() {
    let (_folder, place) = place();
    run("lamps", 3000, of_bytes(vec![seeds::ies()]), |b| {
        targets::ies(&place, b)
    });
}

#[test]
fn maps() {
    let (_folder, place) = place();
    let files = targets::finished(&place);
    let exr = |(name, bytes): (String, Vec<u8>)| name.ends_with(".exr").then_some(bytes);
    let seeds: Vec<_> = files.into_iter().filter_map(exr).collect();
    run("maps", 1000, of_bytes(seeds), |b| targets::exr(&place, b));
}

#[test]
fn skies() {
    let (_folder, place) = place();
    run("skies", 60, of_bytes(vec![seeds::hdr()]), |b| {
        targets::hdr(&place, b)
    });
}

#[test]
fn lists_of_points() {
    let (_folder, place) = place();
    run("points", 20_000, of_json(&seeds::points()), |b| {
        targets::points(&place, b)
    });
}

#[test]
fn files_of_settings() {
    let (_folder, place) = place();
    run("settings", 60, of_bytes(vec![seeds::settings()]), |b| {
        targets::settings(&place, b)
    });
}

#[test]
fn manifests_and_reports() {
    let (_folder, place) = place();
    let files = targets::finished(&place);
    let of = |end: &str| {
        let file = files.iter().find(|(name, _)| name.ends_with(end));
        file.expect("it is written").1.clone()
    };
    let (manifest, report) = (of("lightmap.json"), of("report.json"));
    run("manifests", 200, of_json(&manifest), |b| {
        targets::manifest(&place, b)
    });
    std::fs::write(place.0.join("level.lightmap.json"), manifest).expect("written");
    run("reports", 200, of_json(&report), |b| {
        targets::report(&place, b)
    });
}

#[test]
fn requests() {
    let (_folder, place) = place();
    targets::finished(&place);
    let viewer = Arc::new(Viewer::bind(&place.0, 0).expect("a bake is there"));
    let url = viewer.url();
    let address = url
        .trim_start_matches("http://")
        .trim_end_matches('/')
        .to_owned();
    let server = viewer.clone();
    let thread = std::thread::spawn(move || server.serve());
    run("requests", 1000, of_bytes(seeds::requests()), |b| {
        targets::request(&address, b)
    });
    viewer.stop();
    thread.join().expect("the server ends without a panic");
}

#[test]
fn bakes() {
    let (_folder, place) = place();
    run("bakes", 60, of_trees(seeds::levels()), |b| {
        targets::bake(&place, b)
    });
}
