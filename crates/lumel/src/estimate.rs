//! What a bake would make and cost, without baking.

use std::path::Path;
use std::time::Instant;

use atlas::LayoutReport;
use atlas_bake::gather_cost;
use glam::Vec3;
use patch_subdivision::Subdivision;
use radiosity::{Emitters, Monitor, World, WorldOptions};
use rayon::prelude::*;
use serde::Serialize;

use crate::check::{check, check_name};
use crate::error::Error;
use crate::files::output_names;
use crate::memory::Need;
use crate::pipeline::{Prepared, bake_options, plan_layout, prepare};
use crate::probes;
use crate::scene_input::SceneInput;
use crate::settings::{Quality, Settings};

/// A bake's plan and cost.
///
/// Pages and lumels are what the bake will have. Rays, time and memory are estimates, see
/// [`seconds`](Estimate::seconds).
#[derive(Debug, Clone, Serialize)]
pub struct Estimate {
    /// File name of the scene.
    pub scene: String,
    /// Triangles that light meets.
    pub triangles: usize,
    /// Charts and pages.
    pub layout: LayoutReport,
    /// Names of the files that would be written, with all pages.
    pub files: Vec<String>,
    /// Points of seams, where lookups on two sides are compared.
    pub seam_samples: usize,
    /// Probes that would be baked.
    pub probes: usize,
    /// Rays, all kinds.
    pub rays: f64,
    /// Million rays per second that this machine casts in this scene, with the threads of the
    /// current pool, as measured just now.
    pub mrays_per_second: f64,
    /// Seconds from reading to the last written file, within [`ESTIMATE_FACTOR`]: light was
    /// gathered at some lumels to find out.
    pub seconds: f64,
    /// Peak memory, bytes.
    pub bytes: f64,
}

/// Rays, and time, of all that is done at lumels and vertices over those of gathering alone at
/// lumels that are not interpolated: more rays where edges and noise are, direct light of
/// interpolated lumels, vertices (also where they are left out, which saves what the scene's
/// triangles make of it). The geometric mean over the scenes of docs/pipeline.md (17 at draft, of
/// which each is within a factor of 1.55; 12 at quick, 11 of them within 1.5; 7 at preview, within
/// 1.5).
fn over_gather(quality: Quality) -> f64 {
    match quality {
        Quality::Draft => 1.5,
        Quality::Quick => 1.8,
        // Production was not measured.
        Quality::Preview | Quality::Production => 1.35,
    }
}

/// The time of a bake that has the machine for itself is within this factor of the estimate, either
/// way: that of rays, and what each takes.
pub const ESTIMATE_FACTOR: f64 = 2.0;

/// Patches and rays of the solve that the gather is tried in: its light is not looked at.
const TRIAL: [u32; 2] = [2_000, 16];

/// Time of a point of a seam over that of a ray: of finding it and setting its equation up, and of
/// stitching it in up to four channels. Stitching takes the same number of steps whatever the
/// equations are. By slow_dive_level's 175,000 points: 0.65 s of one thread at 1.6 million rays a
/// second.
const SEAM: [f64; 2] = [4.0, 8.0];

/// Seconds that short trials are repeated for.
const ENOUGH: f64 = 0.5;

/// Rays of the measurement.
const PROBES: usize = 1 << 16;

/// Parts that they are cast in.
const PARTS: usize = 8;

/// Reads the scene, plans its lightmap, and casts some rays to tell how long a bake would take;
/// writes nothing.
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
    let start = Instant::now();
    let Prepared {
        loaded, soup, sky, ..
    } = prepare(SceneInput::File(file), settings)?;
    let scene = &loaded.scene;
    let (plan, layout) = plan_layout(file, scene, &soup, settings, None, monitor)?;
    let probes = match (&settings.probes, points) {
        (Some(source), Some(points)) => probes::plan(source, points, scene, &soup)?.positions.len(),
        _ => 0,
    };
    let options = WorldOptions {
        sky,
        ..WorldOptions::default()
    };
    let world = World::build(scene, &soup, options)
        .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
    let planning = start.elapsed().as_secs_f64();
    let rate = rate(&world);

    let solve = settings.solve_options();
    let mut trial = solve;
    trial.cut.patches = trial.cut.patches.min(TRIAL[0]);
    trial.rays = trial.rays.min(TRIAL[1]);
    let emitters = Emitters::collect(&world);
    let (solution, trying) = fastest(|| radiosity::solve(&world, &emitters, &trial, monitor));
    if solution.report.cancelled {
        return Err(Error::Cancelled);
    }
    // Levels of many small things have many more patches than are asked for; the trial has fewer.
    let tried = &solution.report;
    let patches = |cut| {
        Subdivision::build(&soup, |t| world.two_sided(t as u32), cut)
            .patches()
            .len()
    };
    let more = patches(&solve.cut) as f64 / patches(&trial.cut).max(1) as f64;
    let links = f64::from(tried.subdivision.patches) * more * f64::from(solve.rays);
    let solving = links + tried.shadow_rays as f64 * more;
    // What is done with a ray takes longer than to cast it, and is the same in the trial.
    let solve_seconds = trying * solving / ((tried.link_rays + tried.shadow_rays) as f64).max(1.0);
    let options = bake_options(settings);
    let gather = gather_cost(&world, &emitters, &solution, &plan, &options);
    let gathered = gather.gathered as f64;
    let over = over_gather(settings.quality);
    let probe_rays = probes as f64 * f64::from(probes::options(settings.quality).rays);
    let rays = solving + gathered * gather.rays * over + probe_rays;
    let samples = gather.seam_samples as f64;
    let need = Need::of(
        &loaded,
        &world.sky,
        &soup,
        settings,
        &layout,
        gather.seam_samples,
    );
    need.check(settings, &layout)?;
    let stitching = samples * (SEAM[0] + SEAM[1] * gather.stitched.div_ceil(4) as f64);
    let seconds = planning
        + solve_seconds
        + (probe_rays + stitching) / rate
        + gathered * gather.seconds * over;
    let mut files = output_names(file, settings);
    let first = ".lightmap.exr";
    let at = files.iter().position(|f| f.ends_with(first)).unwrap_or(0);
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    for i in (1..layout.pages.len()).rev() {
        files.insert(at + 1, format!("{stem}.lightmap.{i}.exr"));
    }
    Ok(Estimate {
        scene: (file.file_name().unwrap_or_default().to_string_lossy()).into_owned(),
        triangles: soup.triangles.len(),
        files,
        seam_samples: gather.seam_samples,
        probes,
        rays,
        mrays_per_second: 1e-6 * rate,
        seconds,
        bytes: need.bytes(),
        layout,
    })
}

/// Does something up to four times, until [`ENOUGH`] seconds are gone: its result and the shortest
/// time. What else the machine does slows some of them.
fn fastest<T>(work: impl Fn() -> T) -> (T, f64) {
    let begin = Instant::now();
    let mut least = f64::INFINITY;
    let mut tries = 0;
    loop {
        let start = Instant::now();
        let out = work();
        least = least.min(start.elapsed().as_secs_f64());
        tries += 1;
        if tries == 4 || begin.elapsed().as_secs_f64() > ENOUGH {
            return (out, least);
        }
    }
}

/// Rays per second from points all over the scene, by area, in directions all about.
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
        // Additive recurrences of the plastic number's powers (Roberts, *The Unreasonable
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
    // The fastest of several parts, whose points all lie over the whole scene: what else the
    // machine does slows some of them.
    let part = PROBES / PARTS;
    let rates = (0..PARTS).map(|k| {
        let start = Instant::now();
        (k * part..(k + 1) * part).into_par_iter().for_each(cast);
        part as f64 / start.elapsed().as_secs_f64().max(1e-9)
    });
    rates.fold(0.0, f64::max)
}
