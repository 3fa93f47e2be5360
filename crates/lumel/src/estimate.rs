//! Plan and cost of a bake, without baking.

use std::path::Path;

use atlas::LayoutReport;
use atlas_bake::{WorkTime, gather_cost};
use glam::Vec3;
use radiosity::{Emitters, Monitor, World, WorldOptions};
use rayon::prelude::*;
use serde::Serialize;

use crate::check::{check, check_name};
use crate::cut;
use crate::error::Error;
use crate::files::{output_names, page_name};
use crate::memory::Need;
use crate::open::{Changes, Prepared, prepare};
use crate::plan::{bake_options, plan_layout};
use crate::probes;
use crate::scene_input::SceneInput;
use crate::settings::{Quality, Settings};
use crate::split;

/// The plan and cost of a bake.
///
/// Pages and lumels are exact unless [charts are made twice](Estimate::planned_twice): cuts add 0.3
/// to 28 % of lumels to drawn levels. Rays, time and memory are estimates, see
/// [`seconds`](Estimate::seconds).
///
/// [`Baker::estimate`](crate::Baker::estimate) has an example.
#[derive(Debug, Clone, Serialize)]
pub struct Estimate {
    /// File name of the scene.
    pub scene: String,
    /// Triangles that rays can hit.
    pub triangles: usize,
    /// Charts and pages.
    pub layout: LayoutReport,
    /// Names of the files that would be written, including all pages.
    pub files: Vec<String>,
    /// Points on seams where the lookups of both sides are compared.
    pub seam_samples: usize,
    /// Number of probes.
    pub probes: usize,
    /// Number of reflection captures.
    pub reflections: usize,
    /// Whether charts will be made twice: they are cut under thin walls and along the edges of
    /// shadows, or sheets get a lightmap for each side, once the light is known to differ there.
    /// With sheets, the light is solved twice as well. Foretold by a coarse solve.
    pub planned_twice: bool,
    /// Number of rays of all kinds.
    pub rays: f64,
    /// Measured ray rate of this machine in this scene, million rays per second, with the threads
    /// of the current pool.
    pub mrays_per_second: f64,
    /// Seconds from reading the scene to writing the last file, within a factor of
    /// [`ESTIMATE_FACTOR`]. Based on gathering at a few lumels.
    pub seconds: f64,
    /// Peak memory, bytes.
    pub bytes: f64,
}

/// Ratio of all rays (and time) spent on lumels and vertices to those of the first gathering at
/// non-interpolated lumels. The rest goes to extra rays at edges and noise, direct light of
/// interpolated lumels, and vertices. Vertices are included even if vertex colours are off, because
/// the cost of the scene's triangles remains.
///
/// Generated levels took 0.8 to 1.25 times the estimate at draft, and about as much at quick and
/// preview (lab/estimate.md).
fn over_gather(quality: Quality) -> f64 {
    match quality {
        Quality::Draft => 1.6,
        Quality::Quick => 1.8,
        // Production was not measured; it uses preview's.
        Quality::Preview | Quality::Production => 1.35,
    }
}

/// On an otherwise idle machine the bake time is within this factor of the estimate, either way.
/// The uncertainty comes from the number of rays and the time per ray.
pub const ESTIMATE_FACTOR: f64 = 2.0;

/// Most patches and rays of the coarse solve that the trial gather uses; its light is discarded.
/// With 2,000 of 16 rays, noise between the two sides of walls foretold cuts that were not made, in
/// at least 12 of 560 levels.
const TRIAL: [u32; 2] = [5_000, 32];

/// Cost of a seam sample, in rays: for finding it and setting up its equation, and for stitching it
/// in up to four channels. Stitching runs a fixed number of steps. Measured on slow_dive_level with
/// 175,000 samples: 0.65 s on one thread at 1.6 million rays per second.
const SEAM: [f64; 2] = [4.0, 8.0];

/// Total time of short repeated trials, seconds.
const ENOUGH: f64 = 0.5;

/// Rays for measuring the ray rate.
const PROBES: usize = 1 << 16;

/// Parts in which they are timed.
const PARTS: usize = 8;

/// Reads the scene, plans its lightmap and casts some rays to estimate the bake time; writes
/// nothing.
///
/// # Errors
/// As [`bake`](crate::bake).
pub fn estimate(
    file: &Path,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Estimate, Error> {
    check(settings)?;
    check_name(file)?;
    let points = settings.probes.as_ref().map(probes::read).transpose()?;
    let start = WorkTime::start();
    let Prepared {
        loaded, soup, sky, ..
    } = prepare(SceneInput::File(file), settings, &Changes::default())?;
    let scene = &loaded.scene;
    let (plan, layout) = plan_layout(file, scene, &soup, settings, None, monitor)?;
    let probes = match (&settings.probes, points) {
        (Some(source), Some(points)) => {
            let volume = settings.probe_volume;
            (probes::plan(source, points, (scene, &soup), volume)?.positions).len()
        }
        _ => 0,
    };
    let options = WorldOptions {
        sky,
        ..WorldOptions::default()
    };
    let world = World::build(scene, &soup, options)
        .map_err(|e| Error::Internal(format!("cannot build the tree: {e}")))?;
    let planning = start.serial();
    let rate = rate(&world);

    let solve = settings.solve_options(&soup);
    let mut trial = solve;
    trial.cut.patches = trial.cut.patches.min(TRIAL[0]);
    trial.rays = trial.rays.min(TRIAL[1]);
    let emitters = Emitters::collect(&world);
    let (solution, trying) = fastest(|| radiosity::solve(&world, &emitters, &trial, monitor));
    if solution.report.cancelled {
        return Err(Error::Cancelled);
    }
    // Levels with many small objects have many more patches than requested, and more than the
    // trial.
    let tried = &solution.report;
    let patches = |cut| radiosity::cut_surfaces(&world, cut).patches().len();
    let more = patches(&solve.cut) as f64 / patches(&trial.cut).max(1) as f64;
    let per_ray = tried.link_rays as f64 / f64::from(tried.rays_per_patch.max(1));
    let links = per_ray * more * f64::from(solve.rays);
    let solving = links + tried.shadow_rays as f64 * more;
    // Processing a ray takes longer than casting it, and costs the same in the trial.
    let solve_seconds = trying * solving / ((tried.link_rays + tried.shadow_rays) as f64).max(1.0);
    let solved_twice =
        settings.split_sides && !split::wanted(&loaded, &world, &solution).is_empty();
    let planned_twice = solved_twice
        || settings.cut_charts
            && !cut::wanted(&loaded, (&world, &emitters, &solution), &layout).is_empty();
    let [plans, solves] =
        [planned_twice, solved_twice].map(|twice| 1.0 + f64::from(u8::from(twice)));
    let options = bake_options(settings);
    let gather = gather_cost(&world, &emitters, &solution, &plan, &options);
    let gathered = gather.gathered as f64;
    let over = over_gather(settings.quality);
    let probe_rays = probes as f64 * f64::from(probes::options(settings.quality).rays);
    let reflections = scene.reflections.len();
    let captured = probes::reflection_options(settings.quality).rays_each();
    let probe_rays = probe_rays + reflections as f64 * captured as f64;
    let rays = solves * solving + gathered * gather.rays * over + probe_rays;
    let samples = gather.counts.seam_samples as f64;
    let sky = &world.sky;
    let need = Need::of(&loaded, (&world, sky), settings, &layout, gather.counts);
    need.check(settings, &layout)?;
    let stitching = samples * (SEAM[0] + SEAM[1] * gather.stitched.div_ceil(4) as f64);
    // With new charts, direct light and links are made anew; only the solved light is carried.
    let seconds = plans * (planning + solve_seconds)
        + (probe_rays + stitching) / rate
        + gathered * gather.seconds * over;
    let mut files = output_names(file, settings);
    let first = ".lightmap.exr";
    let at = files.iter().position(|f| f.ends_with(first)).unwrap_or(0);
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    for i in (1..layout.pages.len()).rev() {
        files.insert(at + 1, format!("{stem}.lightmap.{i}.exr"));
    }
    let cubes = (0..reflections).map(|i| page_name(&stem, "reflection", i, "ktx2"));
    let last = files.len().saturating_sub(1);
    files.splice(last..last, cubes);
    Ok(Estimate {
        scene: (file.file_name().unwrap_or_default().to_string_lossy()).into_owned(),
        triangles: soup.triangles.len(),
        files,
        seam_samples: gather.counts.seam_samples,
        probes,
        reflections,
        planned_twice,
        rays,
        mrays_per_second: 1e-6 * rate,
        seconds,
        bytes: need.bytes(),
        layout,
    })
}

/// Runs `work` up to four times, or until [`ENOUGH`] seconds have passed. Returns its result and
/// the shortest time, because other programs share the caches of some.
fn fastest<T>(work: impl Fn() -> T) -> (T, f64) {
    let begin = WorkTime::start();
    let mut least = f64::INFINITY;
    let mut tries = 0;
    loop {
        let start = WorkTime::start();
        let out = work();
        least = least.min(start.parallel());
        tries += 1;
        if tries == 4 || begin.parallel() > ENOUGH {
            return (out, least);
        }
    }
}

/// Rays per second, from points distributed over the scene by area, in all directions.
fn rate(world: &World) -> f64 {
    let mut sum = 0.0f64;
    let ends: Vec<f64> = (world.soup.areas.iter())
        .map(|a| {
            sum += f64::from(*a);
            sum
        })
        .collect();
    if ends.is_empty() {
        return f64::INFINITY;
    }
    let cast = |i: usize| {
        // Additive recurrences with powers of the plastic number (Roberts, *The Unreasonable
        // Effectiveness of Quasirandom Sequences*, 2018).
        let r = |k: i32| (0.5 + i as f64 * 1.134_724_138_401_519_5f64.powi(-k)).fract();
        let t = ends
            .partition_point(|e| *e < r(1) * sum)
            .min(ends.len() - 1);
        let (u, v) = (r(2) as f32, r(3) as f32);
        let (u, v) = if u + v > 1.0 {
            (1.0 - u, 1.0 - v)
        } else {
            (u, v)
        };
        let p = world.surface_point(t as u32, u, v, false, false);
        let z = r(4).sqrt() as f32;
        let (s, c) = (std::f64::consts::TAU * r(5)).sin_cos();
        let side = (1.0 - z * z).max(0.0).sqrt();
        let (x, y) = p.geometric.any_orthonormal_pair();
        let d: Vec3 = x * (side * c as f32) + y * (side * s as f32) + p.geometric * z;
        std::hint::black_box(world.incoming(p.origin, d));
    };
    // The fastest of several parts, each distributed over the whole scene, because other programs
    // share the caches of some.
    let part = PROBES / PARTS;
    let rates = (0..PARTS).map(|k| {
        let start = WorkTime::start();
        (k * part..(k + 1) * part).into_par_iter().for_each(cast);
        part as f64 / start.parallel().max(1e-9)
    });
    rates.fold(0.0, f64::max)
}
