//! What a ray of the gather costs: its processor time over that of a bare closest hit in the same
//! scene. All that a gather does besides counts: shadow rays and further bounces, light where rays
//! hit, contacts, smoothing, fitting vertices.
//!
//!     cargo bench --bench rays                                    the project's levels at `quick`
//!     cargo bench --bench rays -- --quality preview LEVEL.glb…    others, under a grey sky
//!
//! One thread, so that wall time is processor time; run it on a quiet machine.
#![allow(missing_docs, reason = "benches are not an interface")]
#![allow(clippy::print_stdout, reason = "the table is its result")]

use std::f32::consts::TAU;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use lumel::mesh_ingest::{self, LoadOptions, Soup};
use lumel::radiosity::{World, WorldOptions};
use lumel::visibility::{AcceptAll, Ray};
use lumel::{Baker, Phase, Quality};

/// Rays that are timed without a bake.
const BARE: usize = 1 << 20;

fn main() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let mut levels: Vec<PathBuf> = Vec::new();
    let mut quality = Quality::Quick;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--bench" => {} // cargo's own
            "--quality" => {
                let name = args.next().unwrap_or_default();
                quality = match name.as_str() {
                    "draft" => Quality::Draft,
                    "quick" => Quality::Quick,
                    "preview" => Quality::Preview,
                    "production" => Quality::Production,
                    _ => panic!("--quality {name}: expected draft, quick, preview or production"),
                };
            }
            _ => levels.push(arg.into()),
        }
    }
    if levels.is_empty() {
        levels = ["cornell_box.glb", "demo_level.glb"]
            .map(|name| assets.join(name))
            .into();
    }
    println!("| level | rays, million | gather, ns a ray | closest hit, ns | ratio |");
    println!("|---|---|---|---|---|");
    for level in levels {
        let (rays, gather) = gather(&level, quality);
        let bare = closest_hit(&level);
        let name = level
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        println!(
            "| {name} | {:.1} | {gather:.0} | {bare:.0} | {:.2} |",
            rays as f64 / 1e6,
            gather / bare
        );
    }
}

/// Rays that a bake counts, and nanoseconds of its gather for each.
fn gather(level: &Path, quality: Quality) -> (u64, f64) {
    let began = Arc::new(Mutex::new(None));
    let watch = began.clone();
    let baker = (Baker::new()
        .quality(quality)
        .sky([0.25, 0.35, 0.5])
        .threads(1))
    .on_progress(move |progress| {
        if progress.phase == Phase::Gather {
            watch
                .lock()
                .expect("no panic")
                .get_or_insert_with(Instant::now);
        }
    });
    let bake = baker.bake(level).expect("a level that bakes");
    let began = began.lock().expect("no panic").expect("a gather");
    let seconds = began.elapsed().as_secs_f64();
    let report = &bake.report;
    let vertices = report.gather.vertices.as_ref().map_or(0, |v| v.rays);
    let rays = report.gather.light.lumel_rays + vertices;
    (rays, 1e9 * seconds / rays as f64)
}

/// Nanoseconds of a closest hit: cosine-distributed rays from points spread by area over the fronts
/// of all triangles, 64 from each point, as lumels cast them. The fastest of three runs.
fn closest_hit(level: &Path) -> f64 {
    let scene = mesh_ingest::load(level, &LoadOptions::default())
        .expect("a level")
        .scene;
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, WorldOptions::default()).expect("finite");
    let mut sums: Vec<f64> = vec![0.0];
    sums.extend(soup.areas.iter().scan(0.0, |sum, a| {
        *sum += f64::from(*a);
        Some(*sum)
    }));
    let all = sums[soup.areas.len()];
    // Roberts' R5 sequence: fractions of powers of the root of x⁶ = x + 1.
    let fraction =
        |k: usize, power: i32| ((k as f64 + 0.5) / 1.134_724_138_4_f64.powi(power)).fract();
    let rays: Vec<Ray> = (0..BARE)
        .map(|k| {
            let point = k / 64;
            let at = fraction(point, 1) * all;
            let t = sums
                .partition_point(|s| *s <= at)
                .clamp(1, soup.areas.len())
                - 1;
            let [a, b, c] = soup.triangles[t];
            let (u, v) = (fraction(point, 2) as f32, fraction(point, 3) as f32);
            let (u, v) = if u + v > 1.0 {
                (1.0 - u, 1.0 - v)
            } else {
                (u, v)
            };
            let normal = soup.normals[t];
            let (square, angle) = (fraction(k, 4) as f32, TAU * fraction(k, 5) as f32);
            let (x, y) = normal.any_orthonormal_pair();
            let flat = x * angle.cos() + y * angle.sin();
            let origin = a + (b - a) * u + (c - a) * v;
            Ray {
                origin: origin + normal * world.offset(origin),
                direction: flat * square.sqrt() + normal * (1.0 - square).sqrt(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            }
        })
        .collect();
    let run = || {
        let start = Instant::now();
        for ray in &rays {
            black_box(world.tree().closest_hit(black_box(ray), &AcceptAll));
        }
        start.elapsed().as_secs_f64()
    };
    let fastest = (0..3).map(|_| run()).fold(f64::INFINITY, f64::min);
    1e9 * fastest / BARE as f64
}
