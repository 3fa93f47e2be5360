//! The bake from file to files.

use std::path::{Path, PathBuf};
use std::time::Instant;

use atlas_bake::probes::{ProbeFile, ProbeReport, ProbeScene, bake_probes, report_probes};
use atlas_bake::{
    BakeOptions, Baked, ExrOptions, Layout, LayoutError, LayoutOptions, LayoutProgress,
    LayoutReport, LitScene, Manifest, ManifestGroup, OutputSet, ValueKind, choose_camera,
    render_preview, scene_camera, write_lightmap_exr, write_lightmapped_glb, write_vertex_glb,
};
use glam::Vec3;
use mesh_ingest::{Light, LightKind, LoadOptions, Loaded, Scene, Soup};
use radiosity::{DirectLight, Emitters, Monitor, Phase, Solution, World, WorldOptions};

use visibility::{BuildOptions, Bvh};

use crate::error::Error;
use crate::memory;
use crate::probes::{self, ProbePlan};
use crate::report::{Measured, PhaseTime, Report, audit_warnings, clamped_warning};
use crate::settings::{Settings, SkySource};
use crate::sky;
use crate::sources::{self, Sources};

/// A finished bake, in memory.
pub struct Bake {
    /// The scene as it was read.
    pub loaded: Loaded,
    /// Charts and pages.
    pub layout: Layout,
    /// Light.
    pub baked: Baked,
    /// Light probes.
    pub probes: Option<ProbeFile>,
    /// Report so far; [`files`](Bake::files) completes a copy of it.
    pub report: Report,
    /// Names of the groups of [`Baked::groups`].
    group_names: Vec<String>,
    stem: String,
    value: ValueKind,
    clock: Clock,
}

/// An output file: name and bytes.
pub type NamedFile = (String, Vec<u8>);

/// Wall time by phase.
#[derive(Debug, Clone)]
struct Clock {
    start: Instant,
    last: Instant,
    phases: Vec<PhaseTime>,
}

impl Clock {
    fn new() -> Self {
        let now = Instant::now();
        Clock {
            start: now,
            last: now,
            phases: Vec::new(),
        }
    }

    fn lap(&mut self, phase: Phase) {
        let now = Instant::now();
        self.phases.push(PhaseTime {
            phase: phase.name(),
            seconds: (now - self.last).as_secs_f64(),
        });
        self.last = now;
    }
}

/// Begins a phase: tells the monitor, and stops if it says so.
fn begin(monitor: &dyn Monitor, phase: Phase) -> Result<(), Error> {
    monitor.progress(phase, 0, 0);
    if monitor.cancelled() {
        return Err(Error::Cancelled);
    }
    Ok(())
}

/// Bakes the scene in `file`.
///
/// The result is the same for any number of threads of the current rayon pool. `monitor` sees phases and may cancel.
///
/// # Errors
/// [`Error`], by fault.
pub fn bake(file: &Path, settings: &Settings, monitor: &dyn Monitor) -> Result<Bake, Error> {
    check(settings)?;
    let points = settings.probes.as_ref().map(probes::read).transpose()?;
    let mut clock = Clock::new();
    begin(monitor, Phase::Ingest)?;
    let mut loaded = mesh_ingest::load(
        file,
        &LoadOptions {
            scene: settings.scene,
            ..LoadOptions::default()
        },
    )?;
    add_suns(&mut loaded.scene, settings);
    let sources = Sources::find(
        &loaded.scene,
        loaded.document.json(),
        settings.sky != SkySource::None,
    );
    let chosen = sources.apply(&mut loaded.scene, settings)?;
    let sky = sky::load(
        settings,
        chosen.sky_factor,
        loaded.scene.environment.as_ref(),
    )?;
    let (groups, group_names) = chosen.groups.unzip();
    let clamped_materials = loaded.scene.limit_reflectance(settings.max_reflectance);
    let soup = Soup::build(&loaded.scene);
    let plan = match (&settings.probes, points) {
        (Some(source), Some(points)) => Some(probes::plan(source, points, &loaded.scene, &soup)?),
        _ => None,
    };
    clock.lap(Phase::Ingest);

    begin(monitor, Phase::Atlas)?;
    let (layout, layout_report) = plan_layout(file, &loaded.scene, &soup, settings, monitor)?;
    clock.lap(Phase::Atlas);

    begin(monitor, Phase::Tree)?;
    let world = World::build(
        &loaded.scene,
        &soup,
        WorldOptions {
            sky,
            groups,
            ..WorldOptions::default()
        },
    )
    .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
    let emitters = Emitters::collect(&world);
    clock.lap(Phase::Tree);

    begin(monitor, Phase::Solve)?;
    let solution = radiosity::solve(&world, &emitters, &settings.solve_options(), monitor);
    if solution.report.cancelled {
        return Err(Error::Cancelled);
    }
    clock.lap(Phase::Solve);

    begin(monitor, Phase::Gather)?;
    let options = BakeOptions {
        lumels: settings.lumel_options(),
        vertices: settings.vertex_options(),
        layers: settings.layers.clone(),
        padding: settings.padding,
        value: settings.value,
        directional: settings.directional,
        ao_distance: settings.ao_distance,
    };
    let baked = atlas_bake::bake(&world, &emitters, &solution, &layout, &options, monitor)
        .map_err(|_| Error::Cancelled)?;
    clock.lap(Phase::Gather);

    let (probes, probe_report) = match &plan {
        Some(plan) => {
            begin(monitor, Phase::Probes)?;
            let (file, report) =
                light_probes(&world, &emitters, &solution, plan, settings, monitor)?;
            clock.lap(Phase::Probes);
            (Some(file), Some(report))
        }
        None => (None, None),
    };
    let warnings = warnings(
        &loaded,
        clamped_warning(clamped_materials),
        soup.dropped_duplicate,
        &layout_report,
        &solution,
        &baked,
    );
    drop(world);

    let name = file
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let stem = file
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let report = Report {
        generator: concat!("lumel ", env!("CARGO_PKG_VERSION")).into(),
        scene: name,
        settings: settings.clone(),
        ingest: loaded.report.clone(),
        dropped_triangles: [soup.dropped_zero_area, soup.dropped_duplicate],
        clamped_materials,
        groups: chosen.report,
        layout: layout_report,
        solve: solution.report.clone(),
        gather: baked.report.clone(),
        probes: probe_report,
        clamped: Vec::new(),
        warnings,
        measured: Measured::default(),
    };
    Ok(Bake {
        loaded,
        layout,
        baked,
        probes,
        report,
        group_names: group_names.unwrap_or_default(),
        stem,
        value: settings.value,
        clock,
    })
}

/// Bakes the probes of a plan.
fn light_probes(
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    plan: &ProbePlan,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<(ProbeFile, ProbeReport), Error> {
    let origin = world.scene.origin;
    let at: Vec<Vec3> = plan
        .positions
        .iter()
        .map(|p| (*p - origin).as_vec3())
        .collect();
    let scene = ProbeScene {
        world,
        solution,
        direct: &DirectLight::new(world, emitters),
    };
    let options = probes::options(settings.quality);
    let mut probes = bake_probes(&scene, &at, &options, monitor).map_err(|_| Error::Cancelled)?;
    let report = report_probes(&probes, plan.grid.as_ref(), &options);
    if let Some(grid) = &plan.grid {
        grid.fill(&mut probes);
    }
    let file = ProbeFile::new(&plan.positions, &probes, plan.grid.as_ref());
    Ok((file, report))
}

/// Charts and pages of a scene, under the monitor.
pub(crate) fn plan_layout(
    file: &Path,
    scene: &Scene,
    soup: &Soup,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<(Layout, LayoutReport), Error> {
    let options = LayoutOptions {
        texels_per_unit: settings.texels_per_unit,
        max_page: settings.max_page,
        padding: settings.padding,
        uv_mode: settings.uv,
        unwrapper: settings.unwrapper,
        ..LayoutOptions::default()
    };
    let progress = |p: LayoutProgress| {
        monitor.progress(Phase::Atlas, p.done as u64, p.total as u64);
        !monitor.cancelled()
    };
    atlas_bake::layout(scene, soup, &options, &progress).map_err(|source| match source {
        LayoutError::Cancelled => Error::Cancelled,
        source => Error::Layout {
            file: file.to_owned(),
            source,
        },
    })
}

/// Largest diameter of a sun, degrees. Beyond this, light has no direction to speak of, and a sky says it better.
const MAX_SUN: f32 = 90.0;

fn check(settings: &Settings) -> Result<(), Error> {
    let positive = |name: &str, x: f32| {
        if x.is_finite() && x > 0.0 {
            Ok(())
        } else {
            Err(Error::Setting(format!(
                "{name} is {x}, expected a number above 0"
            )))
        }
    };
    if let Some(t) = settings.texels_per_unit {
        positive("texels per unit", t)?;
    }
    if let Some(e) = settings.error {
        positive("error", e)?;
    }
    if !(settings.max_reflectance > 0.0 && settings.max_reflectance <= 1.0) {
        return Err(Error::Setting(format!(
            "the largest reflectance is {}, expected a number above 0 and at most 1",
            settings.max_reflectance
        )));
    }
    if !(settings.sky_intensity.is_finite() && settings.sky_intensity >= 0.0) {
        return Err(Error::Setting(format!(
            "sky intensity is {}, expected a number of at least 0",
            settings.sky_intensity
        )));
    }
    if !settings.sky_rotation.is_finite() {
        return Err(Error::Setting(format!(
            "sky rotation is {}, expected a number of degrees",
            settings.sky_rotation
        )));
    }
    for s in &settings.suns {
        positive("the sun's illuminance", s.lux)?;
        if Vec3::from_array(s.direction).try_normalize().is_none() {
            return Err(Error::Setting(format!(
                "the sun's direction is {:?}, expected a vector that is not zero",
                s.direction
            )));
        }
        if !(0.0..=MAX_SUN).contains(&s.angle) {
            return Err(Error::Setting(format!(
                "the sun's diameter is {} degrees, expected 0 to {MAX_SUN}",
                s.angle
            )));
        }
    }
    if let Some(d) = settings.ao_distance {
        positive("the distance of ambient occlusion", d)?;
    }
    sources::check(settings)?;
    if !(8..=16384).contains(&settings.max_page) {
        return Err(Error::Setting(format!(
            "the largest page is {}, expected 8 to 16384",
            settings.max_page
        )));
    }
    if settings.padding > 64 {
        return Err(Error::Setting(format!(
            "padding is {}, expected at most 64",
            settings.padding
        )));
    }
    Ok(())
}

fn add_suns(scene: &mut Scene, settings: &Settings) {
    for s in &settings.suns {
        scene.lights.push(Light {
            name: "sun".into(),
            node: None,
            intensity: Vec3::splat(s.lux),
            kind: LightKind::Directional {
                direction: Vec3::from_array(s.direction).normalize(),
                angle: 0.5 * s.angle.to_radians(),
            },
            profile: None,
        });
    }
}

fn warnings(
    loaded: &Loaded,
    clamped: Option<String>,
    duplicates: u64,
    layout: &LayoutReport,
    solution: &Solution,
    baked: &Baked,
) -> Vec<String> {
    let mut out: Vec<String> = loaded
        .report
        .warnings
        .iter()
        .map(|w| format!("{}: {}", w.path, w.message))
        .collect();
    for (reason, n) in loaded.report.left_out_by_reason() {
        out.push(format!("{n} nodes left out: {reason:?}").to_lowercase());
    }
    out.extend(clamped);
    out.extend(layout.warnings.iter().cloned());
    if duplicates > 0 {
        out.push(format!(
            "{duplicates} triangles coincide with others of another mesh or node; they get no light of their own and stay black"
        ));
    }
    if solution.report.audit.flux_in.iter().all(|f| *f == 0.0) {
        out.push(
            "no light reaches any surface: no lamp or emissive material shines on one, and no --sky or --sun was given; the lightmap is black"
                .into(),
        );
    }
    out.extend(audit_warnings(&solution.report.audit));
    if !solution.report.relaxation.converged {
        out.push(format!(
            "the solve did not converge: up to {:.2} % of the light is not distributed",
            100.0 * solution.report.relaxation.residual
        ));
    }
    let hidden = baked.report.hidden_lumels;
    if hidden * 20 > baked.report.lumels {
        out.push(format!(
            "{hidden} of {} lumels lie inside or behind single-sided faces",
            baked.report.lumels
        ));
    }
    out
}

/// Names of the files that a bake of `scene` writes, first page only; the report is the last.
pub fn output_names(scene: &Path, settings: &Settings) -> Vec<String> {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    let mut ends = vec!["lightmap.exr", "glb", "vertex.glb", "lightmap.json"];
    ends.extend(settings.probes.as_ref().map(|_| PROBES));
    let mut names: Vec<String> = ends.iter().map(|end| format!("{stem}.{end}")).collect();
    let groups = settings.groups.iter().map(|g| g.name.as_str());
    let rest = (!settings.groups.is_empty()).then_some(sources::REST);
    names.extend(groups.chain(rest).map(|g| format!("{stem}.group.{g}.exr")));
    names.push(format!("{stem}.report.json"));
    names
}

/// End of the name of the probes' file.
const PROBES: &str = "probes.json";

impl Bake {
    /// Names of the page files, in order.
    pub fn page_names(&self) -> Vec<String> {
        (0..self.layout.pages.len())
            .map(|i| match i {
                0 => format!("{}.lightmap.exr", self.stem),
                i => format!("{}.lightmap.{i}.exr", self.stem),
            })
            .collect()
    }

    /// Names of a light group's page files, in order.
    pub fn group_page_names(&self, group: &str) -> Vec<String> {
        (0..self.layout.pages.len())
            .map(|i| match i {
                0 => format!("{}.group.{group}.exr", self.stem),
                i => format!("{}.group.{group}.{i}.exr", self.stem),
            })
            .collect()
    }

    /// Name of the report file.
    pub fn report_name(&self) -> String {
        format!("{}.report.json", self.stem)
    }

    /// All output files by name, and the completed report (which is the last of them).
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn files(&self) -> Result<(Vec<NamedFile>, Report), Error> {
        let mut clock = self.clock.clone();
        let mut report = self.report.clone();
        let uris = self.page_names();
        let scene = &self.loaded.scene;
        let mut files = Vec::new();
        for (page, name) in self.baked.pages.iter().zip(&uris) {
            let (bytes, stats) = write_lightmap_exr(page, &ExrOptions::default())?;
            files.push((name.clone(), bytes));
            report.clamped.push(stats);
        }
        for (group, pages) in self.group_names.iter().zip(&self.baked.groups) {
            for (page, name) in pages.iter().zip(self.group_page_names(group)) {
                let (bytes, _) = write_lightmap_exr(page, &ExrOptions::default())?;
                files.push((name, bytes));
            }
        }
        let glb = format!("{}.glb", self.stem);
        let (bytes, _) = write_lightmapped_glb(
            &self.loaded.document,
            scene,
            &self.layout,
            &uris,
            self.value,
        )?;
        files.push((glb.clone(), bytes));
        let (bytes, _) = write_vertex_glb(&self.loaded.document, scene, &self.baked.vertices)?;
        files.push((format!("{}.vertex.glb", self.stem), bytes));
        let mut manifest = Manifest::new(scene, &self.layout, &glb, &uris, self.value)?;
        if let Some(page) = self.baked.pages.first() {
            manifest.channels = page.layers.iter().map(|(name, _)| name.clone()).collect();
        }
        manifest.groups = (self.group_names.iter())
            .map(|name| ManifestGroup {
                name: name.clone(),
                pages: self.group_page_names(name),
            })
            .collect();
        files.push((format!("{}.lightmap.json", self.stem), manifest.to_json()));
        if let Some(probes) = &self.probes {
            files.push((format!("{}.{PROBES}", self.stem), probes.to_json()));
        }
        clock.lap(Phase::Write);
        report.measured = self.measure(clock);
        files.push((self.report_name(), report.to_json()));
        Ok((files, report))
    }

    /// Writes all files into `dir`, together: until all are complete, files of an earlier bake stay as they are.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn write(&self, dir: &Path) -> Result<Vec<PathBuf>, Error> {
        let (files, _) = self.files()?;
        let mut set = OutputSet::create(dir)?;
        for (name, bytes) in &files {
            set.add(name, bytes)?;
        }
        self.retire_pages(&mut set);
        Ok(set.commit()?)
    }

    /// Pages of an earlier bake that had more of them would be left over.
    pub fn retire_pages(&self, set: &mut OutputSet) {
        for i in self.layout.pages.len()..self.layout.pages.len() + 64 {
            set.remove_obsolete(&format!("{}.lightmap.{i}.exr", self.stem));
            for group in &self.group_names {
                set.remove_obsolete(&format!("{}.group.{group}.{i}.exr", self.stem));
            }
        }
    }

    /// A picture of the lit level, PNG: from the document's first camera, or a place that sees much of it.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn preview(&self, size: [u32; 2]) -> Result<Vec<u8>, Error> {
        let scene = &self.loaded.scene;
        // Built anew: a bake does not hold its tree, which a large level would pay for while files are written.
        let soup = Soup::build(scene);
        let bvh = Bvh::build(
            &soup.triangles,
            |t| scene.needs_alpha(soup.materials[t as usize]),
            &BuildOptions::default(),
        )
        .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
        let lit = LitScene {
            scene,
            soup: &soup,
            bvh: &bvh,
            layout: &self.layout,
            pages: &self.baked.pages,
            value: self.value,
        };
        let camera =
            scene_camera(&self.loaded.document, scene).unwrap_or_else(|| choose_camera(&lit));
        Ok(render_preview(&lit, &camera, size)?)
    }

    fn measure(&self, clock: Clock) -> Measured {
        let seconds_in = |names: &[&str]| -> f64 {
            clock
                .phases
                .iter()
                .filter(|p| names.contains(&p.phase))
                .map(|p| p.seconds)
                .sum()
        };
        let rays = self.report.solve.link_rays
            + self.report.solve.shadow_rays
            + self.report.gather.lumel_rays
            + self.report.gather.vertex_rays
            + self.report.probes.as_ref().map_or(0, |p| p.rays);
        Measured {
            threads: rayon::current_num_threads(),
            seconds: (clock.last - clock.start).as_secs_f64(),
            mrays_per_second: rays as f64 * 1e-6
                / seconds_in(&["solve", "gather", "probes"]).max(1e-9),
            peak_bytes: memory::peak_bytes(),
            phases: clock.phases,
        }
    }
}
