//! The bake from the input file to the output files.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use atlas::{KeptCharts, Layout, LayoutError, LayoutOptions, LayoutProgress, LayoutReport};
use atlas_bake::ProbeFile;
use atlas_bake::{
    BakeOptions, Baked, Earlier, LitScene, MixedLight, PictureLight, ValueKind, choose_camera,
    render_preview, scene_camera,
};
use gather::Records;
use gather::probes::{ProbeReport, ProbeScene, bake_probes, report_probes};
use glam::Vec3;
use mesh_ingest::{LampMode, Light, LightKind, Loaded, Scene, Soup};
use radiosity::{
    Bounce, DirectLight, Emitters, LightGroups, Monitor, Phase, Sky, Solution, StoredSolution,
    World, WorldOptions,
};

use crate::brightness;
use crate::cache::{Cache, CacheReport, Charts};
use crate::check::{check, check_name};
use crate::cull::{self, CullReport};
use crate::early;
use crate::error::Error;
use crate::memory::Need;
use crate::mixed;
use crate::only::Kept;
use crate::overwrite;
use crate::page_groups;
use crate::probes::{self, ProbePlan};
use crate::record::{self, Provenance, Record, RecordedInput};
use crate::report::{GroupReport, Measured, PhaseTime, Report};
use crate::scene_input::SceneInput;
use crate::settings::{Settings, SkySource};
use crate::sky;
use crate::sources::{Chosen, Sources};
use crate::split;
use crate::units;
use crate::warnings::Warned;

/// A finished bake, in memory.
pub struct Bake {
    /// The scene as it was read.
    pub loaded: Loaded,
    /// Charts and pages.
    pub layout: Layout,
    /// The light.
    pub baked: Baked,
    /// Light probes.
    pub probes: Option<ProbeFile>,
    /// The report so far; [`files`](Bake::files) completes a copy of it.
    pub report: Report,
    /// Names of the groups of [`Baked::groups`].
    pub(crate) group_names: Vec<String>,
    /// Lamps that are left out; `None` for a full bake.
    pub(crate) mixed: Option<MixedLight>,
    /// Files that the settings name.
    pub(crate) option_inputs: Vec<RecordedInput>,
    /// Primitives with separate faces for their two sides.
    pub(crate) split: Sides,
    /// What stays of an earlier bake.
    pub(crate) kept: Option<Kept>,
    pub(crate) stem: String,
    pub(crate) value: ValueKind,
    pub(crate) clock: Clock,
}

impl std::fmt::Debug for Bake {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bake")
            .field("scene", &self.report.scene)
            .field("pages", &self.layout.pages)
            .finish_non_exhaustive()
    }
}

/// Wall time by phase.
#[derive(Debug, Clone)]
pub(crate) struct Clock {
    pub start: Instant,
    pub last: Instant,
    pub phases: Vec<PhaseTime>,
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

    pub(crate) fn lap(&mut self, phase: Phase) {
        let now = Instant::now();
        self.phases.push(PhaseTime {
            phase: phase.name(),
            seconds: (now - self.last).as_secs_f64(),
        });
        self.last = now;
    }
}

/// Begins a phase: reports it to the monitor, and stops if the monitor asks to.
fn begin(monitor: &dyn Monitor, phase: Phase) -> Result<(), Error> {
    monitor.progress(phase, 0, 0);
    if monitor.cancelled() {
        return Err(Error::Cancelled);
    }
    Ok(())
}

/// A scene that was read and changed by the settings, before planning.
pub(crate) struct Prepared {
    pub loaded: Loaded,
    pub soup: Soup,
    pub chosen: Chosen,
    /// By light: who computes its direct light.
    pub modes: Vec<LampMode>,
    pub sky: Sky,
    pub clamped_materials: u64,
    pub culled: Option<CullReport>,
    pub early: Early,
}

/// What is known before a bake begins.
#[derive(Debug, Clone, Default)]
pub(crate) struct Early {
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
    /// Whether one of the warnings is that the scene has no light.
    pub dark: bool,
}

/// Reads a scene, adds the settings' suns and sky, and scales its lights.
///
/// # Errors
/// [`Error`], by fault.
pub(crate) fn prepare(
    scene: SceneInput<'_>,
    settings: &Settings,
    split_sides: &Sides,
) -> Result<Prepared, Error> {
    let mut loaded = scene.load(settings, split_sides)?;
    let mut early = Early::default();
    let document = loaded.document.json();
    (early.notes).extend(units::settle(&mut loaded.scene, document, settings.units));
    add_suns(&mut loaded.scene, settings);
    let sources = Sources::find(
        &loaded.scene,
        loaded.document.json(),
        settings.sky != SkySource::None,
    );
    let chosen = sources.apply(&mut loaded.scene, settings)?;
    let modes = mixed::modes(&loaded.scene, loaded.document.json(), settings)?;
    let departures = settings.not_physical.describe();
    if !departures.is_empty() {
        (early.notes).push(format!("not physical: {}", departures.join("; ")));
    }
    let sky = sky::load(
        settings,
        chosen.sky_factor,
        loaded.scene.environment.as_ref(),
    )?;
    brightness::check(&loaded.scene, &sky)?;
    let clamped_materials = loaded.scene.limit_reflectance(settings.max_reflectance);
    page_groups::assign(&mut loaded.scene, loaded.document.json(), settings)?;
    atlas::separate_unlike(&mut loaded.scene);
    let soup = Soup::build(&loaded.scene);
    let culled = cull::apply(&mut loaded.scene, &soup, settings)?;
    early::density(&soup, settings)?;
    let (scene, document) = (&loaded.scene, loaded.document.json());
    let dark = early::no_light(scene, &soup, &sky, document);
    early.dark = dark.is_some();
    (early.warnings).extend(dark.or_else(|| early::no_lamps(document)));
    (early.warnings).extend(early::too_dense(scene, &soup, settings));
    Ok(Prepared {
        loaded,
        soup,
        chosen,
        modes,
        sky,
        clamped_materials,
        culled,
        early,
    })
}

/// Bakes the scene in `file`.
///
/// The result is the same for any number of threads of the current rayon pool. `monitor` receives
/// the phases and may cancel.
///
/// # Errors
/// [`Error`], by fault.
pub fn bake(file: &Path, settings: &Settings, monitor: &dyn Monitor) -> Result<Bake, Error> {
    bake_from(file, settings, &Provenance::default(), monitor)
}

/// As [`bake`], with a report that also records where settings came from.
///
/// # Errors
/// [`Error`], by fault.
pub fn bake_from(
    file: &Path,
    settings: &Settings,
    provenance: &Provenance,
    monitor: &dyn Monitor,
) -> Result<Bake, Error> {
    bake_beside(file, settings, provenance, &Beside::default(), monitor)
}

/// Optional side effects of a bake that do not change the result.
#[derive(Clone, Copy, Default)]
pub struct Beside<'a> {
    /// Where charts of large meshes are cached.
    pub cache: Option<&'a Cache>,
    /// Receives a picture of the level as soon as the solve is done, before lumels are gathered.
    pub first_picture: Option<FirstPicture<'a>>,
    /// Make charts and solve the light one after the other, so that phase times do not overlap.
    pub in_turn: bool,
    /// Files that will be written or deleted ([`output_names`](crate::output_names),
    /// [`outputs_in`](crate::outputs_in)). A bake that would read one of them ends with
    /// [`Error::Overwrite`] before planning.
    pub outputs: &'a [PathBuf],
    /// Receives remarks before the work begins. The report contains them too.
    pub tell: Option<&'a (dyn Fn(Remark<'_>) + Sync)>,
}

impl<'a> Beside<'a> {
    /// For a second attempt, when the first picture and the remarks have been shown already.
    pub(crate) fn again(&self) -> Beside<'a> {
        Beside {
            first_picture: None,
            tell: None,
            ..*self
        }
    }
}

/// A remark that is known before a bake begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remark<'a> {
    /// A decision that the bake made: one of [`Report::notes`].
    Note(&'a str),
    /// A possible problem: one of [`Report::warnings`].
    Warning(&'a str),
}

/// A picture of the level lit by the solution on patches: coarse, with some noise near lamps and
/// contacts, but available early in a bake.
#[derive(Clone, Copy)]
pub struct FirstPicture<'a> {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Receives the PNG on a worker thread, which waits for it. An error ends the bake.
    pub show: &'a (dyn Fn(Vec<u8>) -> Result<(), Error> + Sync),
}

/// As [`bake_from`], with a cache or a first picture.
///
/// # Errors
/// [`Error`], by fault. Cache faults are not errors; [`Measured::cache`] lists them.
pub fn bake_beside(
    file: &Path,
    settings: &Settings,
    provenance: &Provenance,
    beside: &Beside<'_>,
    monitor: &dyn Monitor,
) -> Result<Bake, Error> {
    bake_scene(
        SceneInput::File(file),
        settings,
        provenance,
        beside,
        monitor,
    )
}

/// As [`bake_beside`], for a file or a document in memory.
pub(crate) fn bake_scene(
    scene: SceneInput<'_>,
    settings: &Settings,
    provenance: &Provenance,
    beside: &Beside<'_>,
    monitor: &dyn Monitor,
) -> Result<Bake, Error> {
    let file = scene.path();
    let order = (settings, provenance);
    let fresh = Start::default();
    let (opened, outside) = open(scene, order, beside, fresh, monitor)?;
    match bake_opened(file, opened, outside, order, (beside, None), monitor)? {
        Attempt::Done(bake) => Ok(*bake),
        // At most once: the second solve has separate sides, and nothing is left to split.
        Attempt::Again(start) => {
            let beside = beside.again();
            let (opened, outside) = open(scene, order, &beside, start, monitor)?;
            match bake_opened(file, opened, outside, order, (&beside, None), monitor)? {
                Attempt::Done(bake) => Ok(*bake),
                Attempt::Again(_) => Err(Error::Internal("sides were split twice".into())),
            }
        }
    }
}

/// Primitives (mesh, primitive) that have separate faces for their two sides.
pub(crate) type Sides = BTreeSet<(usize, usize)>;

/// How a bake begins.
#[derive(Debug, Default)]
pub(crate) struct Start {
    pub split: Sides,
    /// Whether `split` is final, by an earlier attempt or by another process.
    pub decided: bool,
    /// The clock of the earlier attempt.
    pub clock: Option<Clock>,
}

/// Outcome of an attempt.
enum Attempt {
    Done(Box<Bake>),
    /// The bake must start again like this.
    Again(Start),
}

/// A scene that was read and planned, before its light is computed.
pub(crate) struct Opened {
    pub loaded: Loaded,
    soup: Soup,
    groups: Vec<GroupReport>,
    group_names: Vec<String>,
    /// By light: who computes its direct light.
    modes: Vec<LampMode>,
    clamped_materials: u64,
    culled: Option<CullReport>,
    early: Early,
    pub option_inputs: Vec<RecordedInput>,
    probes: Option<ProbePlan>,
    pub clock: Clock,
    /// Sides that are separate, and whether that is final.
    split: Sides,
    decided: bool,
}

/// Light from outside the scene, the light groups, and the solution, if another process has solved
/// it.
pub(crate) struct Outside {
    sky: Sky,
    groups: Option<LightGroups>,
    pub solved: Option<Solved>,
}

/// A solution from another process.
pub(crate) struct Solved {
    pub light: StoredSolution,
    /// The file that it was read from.
    pub file: PathBuf,
}

/// Reads a scene and checks everything that can be checked before its light is computed.
///
/// # Errors
/// [`Error`], by fault.
pub(crate) fn open(
    scene: SceneInput<'_>,
    (settings, provenance): (&Settings, &Provenance),
    beside: &Beside<'_>,
    start: Start,
    monitor: &dyn Monitor,
) -> Result<(Opened, Outside), Error> {
    check(settings)?;
    check_name(scene.path())?;
    sky::check_file(settings)?;
    probes::check_file(settings)?;
    // Hashed before they are read: if a file changes in between, the next run sees a different
    // hash.
    let option_inputs = record::option_inputs(settings, provenance);
    let points = settings.probes.as_ref().map(probes::read).transpose()?;
    let mut clock = start.clock.unwrap_or_else(Clock::new);
    begin(monitor, Phase::Ingest)?;
    let Prepared {
        loaded,
        soup,
        chosen,
        modes,
        sky,
        clamped_materials,
        culled,
        early,
    } = prepare(scene, settings, &start.split)?;
    if let Some(tell) = beside.tell {
        let warnings = early.warnings.iter().map(|w| Remark::Warning(w));
        let notes = early.notes.iter().map(|n| Remark::Note(n));
        notes.chain(warnings).for_each(tell);
    }
    if !beside.outputs.is_empty() {
        let inputs = overwrite::all_inputs(&loaded.document, &option_inputs, settings, provenance);
        overwrite::refuse_inputs(beside.outputs, &inputs)?;
    }
    let (groups, group_names) = chosen.groups.unzip();
    let probes = match (&settings.probes, points) {
        (Some(source), Some(points)) => {
            let level = (&loaded.scene, &soup);
            Some(probes::plan(source, points, level, settings.probe_volume)?)
        }
        _ => None,
    };
    clock.lap(Phase::Ingest);
    let opened = Opened {
        loaded,
        soup,
        groups: chosen.report,
        group_names: group_names.unwrap_or_default(),
        modes,
        clamped_materials,
        culled,
        early,
        option_inputs,
        probes,
        clock,
        split: start.split,
        decided: start.decided,
    };
    let outside = Outside {
        sky,
        groups,
        solved: None,
    };
    Ok((opened, outside))
}

/// Charts of a level, and its light on patches.
pub(crate) struct Planned<'l> {
    pub layout: Layout,
    pub report: LayoutReport,
    pub lit: Lit<'l>,
    /// Lamps left out of the pages, and warnings about them.
    mixed: Option<(MixedLight, Vec<String>)>,
    /// What the cache did.
    cached: Option<CacheReport>,
}

impl Opened {
    /// Bakes no light probes: those of an earlier bake stay.
    pub(crate) fn leave_probes(&mut self) {
        self.probes = None;
    }

    /// The sides that need separate faces, decided by the light.
    pub(crate) fn to_split(&self, lit: &Lit<'_>, settings: &Settings) -> Sides {
        match settings.split_sides && !self.decided {
            true => split::wanted(&self.loaded, &lit.world, &lit.solution),
            false => Sides::new(),
        }
    }

    /// Makes charts and solves the light, or uses the solution of another process.
    ///
    /// # Errors
    /// [`Error`], by fault.
    pub(crate) fn plan<'l>(
        &'l self,
        file: &'l Path,
        outside: Outside,
        settings: &'l Settings,
        beside: &'l Beside<'l>,
        (clock, monitor): (&mut Clock, &dyn Monitor),
    ) -> Result<Planned<'l>, Error> {
        begin(monitor, Phase::Atlas)?;
        let charts = beside.cache.map(Charts::new);
        let kept = charts.as_ref().map(|c| c as &dyn KeptCharts);
        let level = Level {
            file,
            loaded: &self.loaded,
            soup: &self.soup,
            settings,
            first_picture: beside.first_picture.as_ref(),
        };
        // With a single thread, concurrency would only alternate between the two.
        let bounded = settings.bounds.memory.is_some();
        let in_turn = beside.in_turn || bounded || rayon::current_num_threads() == 1;
        let ((layout, report), mut lit) = if in_turn {
            let planned = level.charts(kept, monitor)?;
            if bounded {
                level.check_memory(&planned, &outside.sky)?;
            }
            clock.lap(Phase::Atlas);
            (planned, level.light(outside, monitor, clock)?)
        } else {
            level.charts_and_light(kept, outside, monitor, clock)?
        };
        let (world, emitters, solution) = lit.parts();
        let settled = mixed::settle(world, emitters, solution, &self.modes, settings);
        let mixed = settled.map(|mixed| {
            lit.world.roles = Some(mixed.roles);
            (mixed.light, mixed.warnings)
        });
        Ok(Planned {
            layout,
            report,
            lit,
            mixed,
            cached: charts.map(Charts::close),
        })
    }
}

/// What other processes have contributed to a bake.
pub(crate) struct Elsewhere<'e> {
    pub done: Done<'e>,
    /// Refuses charts other than those of the other processes.
    pub check: &'e dyn Fn(&Scene, &Layout) -> Result<(), Error>,
}

/// Light that other processes have computed.
#[derive(Clone, Copy)]
pub(crate) enum Done<'e> {
    /// That of shards.
    Shards(&'e dyn Records),
    /// That of nodes which are not baked anew.
    Earlier(&'e Earlier),
}

/// Bakes a scene that was read; `elsewhere` holds the records of shards.
fn bake_opened(
    file: &Path,
    opened: Opened,
    outside: Outside,
    (settings, provenance): (&Settings, &Provenance),
    (beside, elsewhere): (&Beside<'_>, Option<&Elsewhere<'_>>),
    monitor: &dyn Monitor,
) -> Result<Attempt, Error> {
    let mut clock = opened.clock.clone();
    let planned = opened.plan(file, outside, settings, beside, (&mut clock, monitor))?;
    let Planned {
        layout,
        report: layout_report,
        lit,
        mixed,
        cached,
    } = planned;
    let split = opened.to_split(&lit, settings);
    if !split.is_empty() {
        return Ok(Attempt::Again(Start {
            split,
            decided: true,
            clock: Some(clock),
        }));
    }
    begin(monitor, Phase::Gather)?;
    let baked = match elsewhere {
        None => lit.bake(&layout, settings, monitor),
        Some(elsewhere) => {
            (elsewhere.check)(&opened.loaded.scene, &layout)?;
            lit.rest(&layout, settings, elsewhere.done, monitor)
        }
    }?;
    clock.lap(Phase::Gather);
    let (probes, probe_report) = match &opened.probes {
        Some(plan) => {
            begin(monitor, Phase::Probes)?;
            let (file, report) = light_probes(&lit, plan, settings, monitor)?;
            clock.lap(Phase::Probes);
            (Some(file), Some(report))
        }
        None => (None, None),
    };
    let warned = Warned {
        loaded: &opened.loaded,
        world: &lit.world,
        clamped_materials: opened.clamped_materials,
        layout: &layout_report,
        solution: &lit.solution,
        baked: &baked,
        settings,
        foretold: opened.early.dark,
    };
    let mut warnings = opened.early.warnings.clone();
    warnings.extend(warned.list());
    let mixed = mixed.map(|(light, said)| {
        warnings.extend(said);
        light
    });
    let solve = lit.solution.report.clone();
    drop(lit);
    let mut notes = opened.early.notes;
    notes.extend(split::note(&opened.loaded.scene, &opened.split));
    let report = Report {
        generator: concat!("lumel ", env!("CARGO_PKG_VERSION")).into(),
        scene: name_of(file.file_name()),
        settings: settings.clone(),
        origins: provenance.origins.clone(),
        content: Record::default(),
        ingest: opened.loaded.report.clone(),
        dropped_triangles: [opened.soup.dropped_zero_area, opened.soup.dropped_duplicate],
        clamped_materials: opened.clamped_materials,
        groups: opened.groups,
        culled: opened.culled,
        layout: layout_report,
        solve,
        gather: baked.report.clone(),
        probes: probe_report,
        clamped: Vec::new(),
        ktx2: Vec::new(),
        png: Vec::new(),
        not_physical: settings.not_physical.describe(),
        only: None,
        notes,
        warnings,
        measured: Measured {
            cache: cached,
            ..Measured::default()
        },
    };
    Ok(Attempt::Done(Box::new(Bake {
        loaded: opened.loaded,
        layout,
        baked,
        probes,
        report,
        group_names: opened.group_names,
        mixed,
        option_inputs: opened.option_inputs,
        split: opened.split,
        kept: None,
        stem: name_of(file.file_stem()),
        value: settings.value,
        clock,
    })))
}

/// As [`bake_opened`], for a bake that another process has begun and that decided which sides are
/// separate.
pub(crate) fn bake_rest(
    file: &Path,
    (opened, outside): (Opened, Outside),
    order: (&Settings, &Provenance),
    (beside, elsewhere): (&Beside<'_>, &Elsewhere<'_>),
    monitor: &dyn Monitor,
) -> Result<Bake, Error> {
    match bake_opened(
        file,
        opened,
        outside,
        order,
        (beside, Some(elsewhere)),
        monitor,
    )? {
        Attempt::Done(bake) => Ok(*bake),
        Attempt::Again(_) => Err(Error::Internal("sides were split late".into())),
    }
}

fn name_of(part: Option<&OsStr>) -> String {
    part.unwrap_or_default().to_string_lossy().into_owned()
}

/// An opened level with its settings.
struct Level<'l> {
    file: &'l Path,
    loaded: &'l Loaded,
    soup: &'l Soup,
    settings: &'l Settings,
    first_picture: Option<&'l FirstPicture<'l>>,
}

/// A level with a solution on patches.
pub(crate) struct Lit<'l> {
    pub world: World<'l>,
    pub emitters: Emitters,
    pub solution: Solution,
}

impl Lit<'_> {
    /// The parts that the gather reads.
    pub(crate) fn parts(&self) -> (&World<'_>, &Emitters, &Solution) {
        (&self.world, &self.emitters, &self.solution)
    }

    fn bake(
        &self,
        layout: &Layout,
        settings: &Settings,
        monitor: &dyn Monitor,
    ) -> Result<Baked, Error> {
        let (world, emitters, solution) = self.parts();
        let options = bake_options(settings);
        atlas_bake::bake(world, emitters, solution, layout, &options, monitor)
            .map_err(|_| Error::Cancelled)
    }

    /// Bakes what others have not done.
    fn rest(
        &self,
        layout: &Layout,
        settings: &Settings,
        done: Done<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Baked, Error> {
        let (parts, options) = (self.parts(), bake_options(settings));
        let baked = match done {
            Done::Shards(records) => atlas_bake::merge(parts, layout, &options, records, monitor),
            Done::Earlier(earlier) => atlas_bake::rebake(parts, layout, &options, earlier, monitor),
        };
        baked.map_err(|_| Error::Cancelled)
    }
}

impl<'l> Level<'l> {
    fn charts(
        &self,
        kept: Option<&dyn KeptCharts>,
        monitor: &dyn Monitor,
    ) -> Result<(Layout, LayoutReport), Error> {
        let scene = &self.loaded.scene;
        plan_layout(self.file, scene, self.soup, self.settings, kept, monitor)
    }

    /// Refuses, before light is computed, a bake that needs more memory than allowed.
    fn check_memory(&self, planned: &(Layout, LayoutReport), sky: &Sky) -> Result<(), Error> {
        let (layout, report) = planned;
        let world = World::build(&self.loaded.scene, self.soup, WorldOptions::default())
            .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
        let samples = atlas_bake::seam_samples(&world, layout);
        let need = Need::of(self.loaded, sky, self.soup, self.settings, report, samples);
        need.check(self.settings, report)
    }

    /// Builds the tree, solves the light, and shows the first picture.
    fn light(
        &self,
        outside: Outside,
        monitor: &dyn Monitor,
        clock: &mut Clock,
    ) -> Result<Lit<'l>, Error> {
        begin(monitor, Phase::Tree)?;
        let Outside {
            sky,
            groups,
            solved,
        } = outside;
        let options = WorldOptions {
            sky,
            groups,
            bounce: bounce(self.settings),
            ..WorldOptions::default()
        };
        let world = World::build(&self.loaded.scene, self.soup, options)
            .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
        let emitters = Emitters::collect(&world);
        clock.lap(Phase::Tree);

        begin(monitor, Phase::Solve)?;
        let options = self.settings.solve_options();
        let solution = match solved {
            None => radiosity::solve(&world, &emitters, &options, monitor),
            Some(Solved { light, file }) => {
                let message = "found the light of other patches than the scene has";
                let other = || Error::Folder {
                    path: file,
                    message: message.into(),
                    io: false,
                };
                light.restore(&world, &options).ok_or_else(other)?
            }
        };
        if solution.report.cancelled {
            return Err(Error::Cancelled);
        }
        clock.lap(Phase::Solve);
        if let Some(first) = self.first_picture {
            let png = first_picture(self.loaded, &world, &emitters, &solution, first.size)?;
            (first.show)(png)?;
            clock.lap(Phase::Picture);
        }
        Ok(Lit {
            world,
            emitters,
            solution,
        })
    }

    /// Makes charts and solves light concurrently: they do not depend on each other, and charting a
    /// few large meshes occupies only one core. If both fail, the charts' error is reported, as in
    /// sequence.
    fn charts_and_light(
        &self,
        kept: Option<&dyn KeptCharts>,
        outside: Outside,
        monitor: &dyn Monitor,
        clock: &mut Clock,
    ) -> Result<((Layout, LayoutReport), Lit<'l>), Error> {
        let (always, stop, planned) = (
            AtomicBool::new(true),
            AtomicBool::new(false),
            AtomicBool::new(false),
        );
        let side = |shown| Side {
            monitor,
            stop: &stop,
            shown,
        };
        let mut own = clock.clone();
        let (charts, lit) = rayon::join(
            || {
                let charts = self.charts(kept, &side(&always));
                clock.lap(Phase::Atlas);
                planned.store(true, Ordering::Relaxed);
                stop.fetch_or(charts.is_err(), Ordering::Relaxed);
                charts
            },
            || {
                own.phases.clear();
                let lit = self.light(outside, &side(&planned), &mut own);
                stop.fetch_or(lit.is_err(), Ordering::Relaxed);
                lit
            },
        );
        let outcome = match (charts, lit) {
            // The other side failed and cancelled this one.
            (Err(Error::Cancelled), Err(e)) => Err(e),
            (Err(e), _) | (_, Err(e)) => Err(e),
            (Ok(charts), Ok(lit)) => Ok((charts, lit)),
        }?;
        // Monitors see every phase in order.
        begin(monitor, Phase::Solve)?;
        clock.phases.append(&mut own.phases);
        clock.last = Instant::now();
        Ok(outcome)
    }
}

/// The monitor of one of two concurrent tasks.
struct Side<'m> {
    monitor: &'m dyn Monitor,
    /// Set when the other task failed.
    stop: &'m AtomicBool,
    /// Whether this task's progress is shown.
    shown: &'m AtomicBool,
}

impl Monitor for Side<'_> {
    fn progress(&self, phase: Phase, done: u64, total: u64) {
        if self.shown.load(Ordering::Relaxed) {
            self.monitor.progress(phase, done, total);
        }
    }

    fn residual(&self, residual: f64) {
        if self.shown.load(Ordering::Relaxed) {
            self.monitor.residual(residual);
        }
    }

    fn cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.monitor.cancelled()
    }
}

/// The settings' changes to bounced light.
fn bounce(settings: &Settings) -> Bounce {
    let changed = &settings.not_physical;
    Bounce {
        albedo: changed.albedo_boost,
        saturation: changed.bounce_saturation,
        reflected: changed.indirect_boost,
    }
}

/// Gathering and page options from the settings.
pub(crate) fn bake_options(settings: &Settings) -> BakeOptions {
    BakeOptions {
        lumels: settings.lumel_options(),
        vertices: settings.vertex_colors.then(|| settings.vertex_options()),
        layers: settings.layers.clone(),
        padding: settings.padding,
        value: settings.value,
        directional: settings.directional,
        ao_distance: settings.ao_distance,
        hidden: settings.hidden,
        stitch: settings.stitch,
        error: settings.error,
        vertex_error: settings.vertex_error,
        ambient_floor: settings.not_physical.ambient_floor,
        ao_multiply: settings.not_physical.ao_multiply,
    }
}

/// The level lit by the solution on patches, as a PNG.
fn first_picture(
    loaded: &Loaded,
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    size: [u32; 2],
) -> Result<Vec<u8>, Error> {
    let lights = DirectLight::new(world, emitters).on_patches(&solution.cut);
    let lit = LitScene {
        scene: world.scene,
        soup: world.soup,
        bvh: world.tree(),
        light: PictureLight::Solved {
            world,
            solution,
            lights: &lights,
        },
    };
    let camera = scene_camera(&loaded.document, world.scene).unwrap_or_else(|| choose_camera(&lit));
    Ok(render_preview(&lit, &camera, size)?)
}

/// Bakes the probes of a plan.
fn light_probes(
    lit: &Lit<'_>,
    plan: &ProbePlan,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<(ProbeFile, ProbeReport), Error> {
    let (world, emitters, solution) = lit.parts();
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

/// Plans charts and pages of a scene and reports progress.
pub(crate) fn plan_layout(
    file: &Path,
    scene: &Scene,
    soup: &Soup,
    settings: &Settings,
    kept: Option<&dyn KeptCharts>,
    monitor: &dyn Monitor,
) -> Result<(Layout, LayoutReport), Error> {
    let options = LayoutOptions {
        texels_per_unit: settings.texels_per_unit,
        max_page: settings.max_page,
        padding: settings.padding,
        block: settings.block,
        block_charts: settings.block_charts,
        uv_mode: settings.uv,
        unwrapper: settings.unwrapper,
        ..LayoutOptions::default()
    };
    let progress = |p: LayoutProgress| {
        monitor.progress(Phase::Atlas, p.done as u64, p.total as u64);
        !monitor.cancelled()
    };
    atlas::layout_kept(scene, soup, &options, kept, &progress).map_err(|source| match source {
        LayoutError::Cancelled => Error::Cancelled,
        source => Error::Layout {
            file: file.to_owned(),
            source,
        },
    })
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
