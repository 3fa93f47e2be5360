//! The bake from the input file to the output files.

use std::ffi::OsStr;
use std::path::Path;

use atlas::Layout;
use atlas_bake::{Baked, MixedLight, ProbeFile, ValueKind};
use gather::probes::{
    ProbeReport, ProbeScene, ReflectionCube, ReflectionReport, bake_probes, capture_reflections,
    report_probes, report_reflections,
};
use glam::Vec3;
use mesh_ingest::{Loaded, Scene};
use radiosity::{DirectLight, Monitor, Phase};

use crate::beside::Beside;
use crate::clock::{Clock, begin};
use crate::cut;
use crate::error::Error;
use crate::only::Kept;
use crate::open::{Changes, Opened, Outside, Start, Uncut, open};
use crate::plan::{Done, Lit, Planned};
use crate::probes::{self, ProbePlan};
use crate::record::{Provenance, Record, RecordedInput};
use crate::report::{Measured, Report};
use crate::scene_input::SceneInput;
use crate::settings::Settings;
use crate::split;
use crate::warnings::Warned;

/// A finished bake, in memory.
///
/// ```no_run
/// let bake = lumel::Baker::new().bake("level.glb")?;
/// let page = &bake.pages()[0];
/// println!("{} × {} texels", page.width, page.height);
/// bake.write("out")?;
/// # Ok::<(), lumel::Error>(())
/// ```
pub struct Bake {
    /// The scene as it was read.
    pub loaded: Loaded,
    /// Charts and pages.
    pub layout: Layout,
    /// The light.
    pub baked: Baked,
    /// Light probes.
    pub probes: Option<ProbeFile>,
    /// Reflection captures, in the order of the scene's.
    pub reflections: Vec<ReflectionCube>,
    /// The report so far; [`files`](Bake::files) completes a copy of it.
    pub report: Report,
    /// Names of the groups of [`Baked::groups`].
    pub(crate) group_names: Vec<String>,
    /// Lamps that are left out; `None` for a full bake.
    pub(crate) mixed: Option<MixedLight>,
    /// Files that the settings name.
    pub(crate) option_inputs: Vec<RecordedInput>,
    /// Changes of the document.
    pub(crate) changes: Changes,
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
        // At most once: the second attempt begins with all changes.
        Attempt::Again(start) => {
            let beside = beside.again();
            let (opened, outside) = open(scene, order, &beside, start, monitor)?;
            match bake_opened(file, opened, outside, order, (&beside, None), monitor)? {
                Attempt::Done(bake) => Ok(*bake),
                Attempt::Again(_) => Err(Error::Internal("the document was changed twice".into())),
            }
        }
    }
}

/// Outcome of an attempt.
enum Attempt {
    Done(Box<Bake>),
    /// The bake must start again like this.
    Again(Start),
}

/// What other processes have contributed to a bake.
pub(crate) struct Elsewhere<'e> {
    pub done: Done<'e>,
    /// Refuses charts other than those of the other processes.
    pub check: &'e dyn Fn(&Scene, &Layout) -> Result<(), Error>,
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
    let changes = opened.to_change(&planned, settings);
    if !changes.is_empty() {
        let solution = planned.into_solution();
        let soup = opened.soup;
        return Ok(Attempt::Again(Start {
            uncut: (changes.only_cut()).then(|| Box::new(Uncut { soup, solution })),
            changes,
            decided: true,
            clock: Some(clock),
            charts: opened.charts,
        }));
    }
    opened.charts.forget();
    let Planned {
        layout,
        report: layout_report,
        lit,
        mixed,
        cached,
    } = planned;
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
    let (reflections, reflection_report) = if lit.world.scene.reflections.is_empty() {
        (Vec::new(), None)
    } else {
        begin(monitor, Phase::Reflections)?;
        let (cubes, report) = reflections(&lit, settings, monitor)?;
        clock.lap(Phase::Reflections);
        (cubes, Some(report))
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
    let (scene, changes) = (&opened.loaded.scene, &opened.changes);
    notes.extend(split::note(scene, &changes.split, &changes.cuts));
    notes.extend(cut::note(scene, &changes.cuts));
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
        reflections: reflection_report,
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
        reflections,
        report,
        group_names: opened.group_names,
        mixed,
        option_inputs: opened.option_inputs,
        changes: opened.changes,
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

/// Captures the reflections that the scene asks for.
fn reflections(
    lit: &Lit<'_>,
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<(Vec<ReflectionCube>, ReflectionReport), Error> {
    let (world, emitters, solution) = lit.parts();
    let at: Vec<Vec3> = (world.scene.reflections.iter())
        .map(|r| r.position)
        .collect();
    let scene = ProbeScene {
        world,
        solution,
        direct: &DirectLight::new(world, emitters),
    };
    let options = probes::reflection_options(settings.quality);
    let cubes = capture_reflections(&scene, &at, &options, monitor);
    let cubes = cubes.map_err(|_| Error::Cancelled)?;
    let report = report_reflections(&cubes, &options);
    Ok((cubes, report))
}
