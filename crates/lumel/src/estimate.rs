//! Plan and cost of a bake, without baking.

use std::path::Path;

use atlas::{Layout, LayoutReport};
use atlas_bake::{WorkTime, gather_cost};
use glam::Vec3;
use mesh_ingest::Loaded;
use radiosity::{Emitters, Monitor, Solution, World, WorldOptions};
use rayon::prelude::*;
use serde::Serialize;

use crate::cache::Remembered;
use crate::check::{check, check_name};
use crate::error::Error;
use crate::files::{output_names, page_name};
use crate::memory::Need;
use crate::open::{Changes, Prepared, Uncut, prepare};
use crate::plan::{bake_options, plan_layout};
use crate::probes;
use crate::scene_input::SceneInput;
use crate::settings::{Quality, Settings};
use crate::sky;

/// The plan and cost of a bake.
///
/// Pages and lumels are exact unless [charts are made twice](Estimate::planned_twice): such charts
/// are cut as a coarse solve asks for. Rays, time and memory are estimates, see
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
    /// Whether charts are made twice: they are cut under thin walls and along the edges of shadows,
    /// or sheets get a lightmap for each side, once the light is known to differ there. With
    /// sheets, the light is solved twice as well.
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
/// 45 generated levels took 0.78 to 1.39 times the estimate at quick (lab/estimate.md).
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
    sky::check_file(settings)?;
    // A file that cannot be read is told at once.
    settings.probes.as_ref().map(probes::read).transpose()?;
    let charts = Remembered::default();
    let attempt = Attempt {
        file,
        settings,
        charts: &charts,
        monitor,
    };
    let start = WorkTime::start();
    let uncut = prepare(SceneInput::File(file), settings, &Changes::default())?;
    let first = attempt.run(&uncut, None, start)?;
    let start = WorkTime::start();
    let changes = first.to_change(&uncut.loaded, settings);
    let choosing = start.parallel();
    if changes.is_empty() {
        return attempt.estimate(&uncut, &first, None);
    }
    let mut before = first.cost;
    before.seconds += choosing;
    let solution = first.into_solution();
    let soup = uncut.soup;
    let light = changes.only_cut().then_some(Uncut { soup, solution });
    let start = WorkTime::start();
    let cut = prepare(SceneInput::File(file), settings, &changes)?;
    let second = attempt.run(&cut, light, start)?;
    attempt.estimate(&cut, &second, Some(before))
}

/// A level with charts and coarse light.
struct Tried<'l> {
    plan: Layout,
    layout: LayoutReport,
    world: World<'l>,
    emitters: Emitters,
    solution: Solution,
    cost: Cost,
}

/// What is done before light is gathered.
#[derive(Clone, Copy)]
struct Cost {
    rays: f64,
    seconds: f64,
}

impl Tried<'_> {
    fn into_solution(self) -> Solution {
        self.solution
    }

    fn to_change(&self, loaded: &Loaded, settings: &Settings) -> Changes {
        let lit = (&self.world, &self.emitters, &self.solution);
        Changes::wanted(loaded, lit, &self.layout, settings)
    }
}

/// Tries out a bake's attempts.
struct Attempt<'a> {
    file: &'a Path,
    settings: &'a Settings,
    charts: &'a Remembered,
    monitor: &'a dyn Monitor,
}

impl Attempt<'_> {
    /// Plans a level that is read since `start`, and solves its light coarsely. Light of an earlier
    /// attempt is kept, as a bake does.
    fn run<'l>(
        &self,
        level: &'l Prepared,
        uncut: Option<Uncut>,
        start: WorkTime,
    ) -> Result<Tried<'l>, Error> {
        let (scene, soup, settings) = (&level.loaded.scene, &level.soup, self.settings);
        let (plan, layout) = plan_layout(
            self.file,
            scene,
            soup,
            settings,
            Some(self.charts),
            self.monitor,
        )?;
        let options = WorldOptions {
            sky: level.sky.clone(),
            ..WorldOptions::default()
        };
        let world = World::build(scene, soup, options)
            .map_err(|e| Error::Internal(format!("cannot build the tree: {e}")))?;
        let emitters = Emitters::collect(&world);
        let planning = start.serial();
        let start = WorkTime::start();
        let carried = uncut.and_then(|light| light.solution.carried(&light.soup, &world));
        let (solution, solving) = match carried {
            Some(solution) => (
                solution,
                Cost {
                    rays: 0.0,
                    seconds: start.parallel(),
                },
            ),
            None => self.solve(&world, &emitters)?,
        };
        Ok(Tried {
            cost: Cost {
                rays: solving.rays,
                seconds: planning + solving.seconds,
            },
            plan,
            layout,
            world,
            emitters,
            solution,
        })
    }

    /// Solves light coarsely. Returns the cost of the solve that the settings ask for.
    fn solve(&self, world: &World, emitters: &Emitters) -> Result<(Solution, Cost), Error> {
        let solve = self.settings.solve_options(world.soup);
        let mut trial = solve;
        trial.cut.patches = trial.cut.patches.min(TRIAL[0]);
        trial.rays = trial.rays.min(TRIAL[1]);
        let (solution, trying) =
            fastest(|| radiosity::solve(world, emitters, &trial, self.monitor));
        let tried = &solution.report;
        if tried.cancelled {
            return Err(Error::Cancelled);
        }
        // Levels with many small objects have many more patches than requested, and more than the
        // trial.
        let patches = |cut| radiosity::cut_surfaces(world, cut).patches().len();
        let more = patches(&solve.cut) as f64 / patches(&trial.cut).max(1) as f64;
        let per_ray = tried.link_rays as f64 / f64::from(tried.rays_per_patch.max(1));
        let links = per_ray * more * f64::from(solve.rays);
        let rays = links + tried.shadow_rays as f64 * more;
        // Processing a ray takes longer than casting it, and costs the same in the trial.
        let seconds = trying * rays / ((tried.link_rays + tried.shadow_rays) as f64).max(1.0);
        Ok((solution, Cost { rays, seconds }))
    }

    /// The estimate, from the last attempt and the cost of one before.
    fn estimate(
        &self,
        level: &Prepared,
        tried: &Tried,
        before: Option<Cost>,
    ) -> Result<Estimate, Error> {
        let (file, settings) = (self.file, self.settings);
        let (world, layout) = (&tried.world, &tried.layout);
        let (emitters, solution) = (&tried.emitters, &tried.solution);
        let scene = &level.loaded.scene;
        let probes = match &settings.probes {
            Some(source) => {
                let points = probes::read(source)?;
                let parts = (scene, &level.soup);
                probes::plan(source, points, parts, settings.probe_volume)?
                    .positions
                    .len()
            }
            None => 0,
        };
        let options = bake_options(settings);
        let gather = gather_cost(world, emitters, solution, &tried.plan, &options);
        let need = Need::of(
            &level.loaded,
            (world, &world.sky),
            settings,
            layout,
            gather.counts,
        );
        need.check(settings, layout)?;
        let gathered = gather.gathered as f64;
        let over = over_gather(settings.quality);
        let probe_rays = probes as f64 * f64::from(probes::options(settings.quality).rays);
        let reflections = scene.reflections.len();
        let captured = probes::reflection_options(settings.quality).rays_each();
        let probe_rays = probe_rays + reflections as f64 * captured as f64;
        let samples = gather.counts.seam_samples as f64;
        let stitching = samples * (SEAM[0] + SEAM[1] * gather.stitched.div_ceil(4) as f64);
        let costs = || before.into_iter().chain([tried.cost]);
        let rate = rate(world);
        Ok(Estimate {
            scene: (file.file_name().unwrap_or_default().to_string_lossy()).into_owned(),
            triangles: level.soup.triangles.len(),
            files: files(file, settings, layout.pages.len(), reflections),
            seam_samples: gather.counts.seam_samples,
            probes,
            reflections,
            planned_twice: before.is_some(),
            rays: costs().map(|c| c.rays).sum::<f64>() + gathered * gather.rays * over + probe_rays,
            mrays_per_second: 1e-6 * rate,
            seconds: costs().map(|c| c.seconds).sum::<f64>()
                + (probe_rays + stitching) / rate
                + gathered * gather.seconds * over,
            bytes: need.bytes(),
            layout: layout.clone(),
        })
    }
}

/// Names of the files that a bake writes.
fn files(file: &Path, settings: &Settings, pages: usize, reflections: usize) -> Vec<String> {
    let mut files = output_names(file, settings);
    let first = ".lightmap.exr";
    let at = files.iter().position(|f| f.ends_with(first)).unwrap_or(0);
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    for i in (1..pages).rev() {
        files.insert(at + 1, format!("{stem}.lightmap.{i}.exr"));
    }
    let cubes = (0..reflections).map(|i| page_name(&stem, "reflection", i, "ktx2"));
    let last = files.len().saturating_sub(1);
    files.splice(last..last, cubes);
    files
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
