//! From the input file to a level that can be planned: reading, settings, checks.

use std::collections::BTreeSet;
use std::path::PathBuf;

use glam::Vec3;
use mesh_ingest::{Cut, LampMode, Light, LightKind, Loaded, Scene, Soup};
use radiosity::{LightGroups, Monitor, Phase, Sky, Solution, StoredSolution};

use crate::beside::{Beside, Remark};
use crate::brightness;
use crate::cache::Remembered;
use crate::check::{check, check_name};
use crate::clock::{Clock, begin};
use crate::cull::{self, CullReport};
use crate::early;
use crate::error::Error;
use crate::mixed;
use crate::overwrite;
use crate::page_groups;
use crate::probes::{self, ProbePlan};
use crate::record::{self, Provenance, RecordedInput};
use crate::report::GroupReport;
use crate::scene_input::SceneInput;
use crate::settings::{Settings, SkySource};
use crate::sky;
use crate::sources::{Chosen, Sources};
use crate::units;

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
    changes: &Changes,
) -> Result<Prepared, Error> {
    let mut loaded = scene.load(settings, changes)?;
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
    (early.notes).extend(early::without_effect(settings));
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

/// Changes of the document that its light asks for.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Changes {
    /// Primitives (mesh, primitive) that have separate faces for their two sides.
    pub split: BTreeSet<(usize, usize)>,
    /// Cuts under thin walls.
    pub cuts: Vec<Cut>,
}

impl Changes {
    pub(crate) fn is_empty(&self) -> bool {
        self.split.is_empty() && self.cuts.is_empty()
    }

    /// Whether the surfaces stay as they are, and so does their light: only charts are cut.
    pub(crate) fn only_cut(&self) -> bool {
        self.split.is_empty() && !self.cuts.is_empty()
    }
}

/// How a bake begins.
#[derive(Default)]
pub(crate) struct Start {
    pub changes: Changes,
    /// Whether `changes` are final, by an earlier attempt or by another process.
    pub decided: bool,
    /// The light before the changes, if it is that after them.
    pub uncut: Option<Box<Uncut>>,
    /// The clock of the earlier attempt.
    pub clock: Option<Clock>,
    /// Its charts.
    pub charts: Remembered,
}

/// A scene that was read and planned, before its light is computed.
pub(crate) struct Opened {
    pub loaded: Loaded,
    pub soup: Soup,
    pub groups: Vec<GroupReport>,
    pub group_names: Vec<String>,
    /// By light: who computes its direct light.
    pub modes: Vec<LampMode>,
    pub clamped_materials: u64,
    pub culled: Option<CullReport>,
    pub early: Early,
    pub option_inputs: Vec<RecordedInput>,
    pub probes: Option<ProbePlan>,
    pub clock: Clock,
    /// Changes of the document, and whether they are final.
    pub changes: Changes,
    pub decided: bool,
    /// Charts of the earlier attempt, or for the next one.
    pub charts: Remembered,
}

/// Light from outside the scene, the light groups, and the solution, if there is one.
pub(crate) struct Outside {
    pub sky: Sky,
    pub groups: Option<LightGroups>,
    pub solved: Option<Solved>,
}

/// A solution that is known before.
pub(crate) enum Solved {
    /// By another process.
    Elsewhere {
        light: Box<StoredSolution>,
        /// The file that it was read from.
        file: PathBuf,
    },
    /// Of the document before its charts were cut.
    Uncut(Box<Uncut>),
}

/// The light of a document before its charts are cut: the surfaces are the same, so it is not
/// solved again.
pub(crate) struct Uncut {
    pub soup: Soup,
    pub solution: Solution,
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
    } = prepare(scene, settings, &start.changes)?;
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
        changes: start.changes,
        decided: start.decided,
        charts: start.charts,
    };
    let outside = Outside {
        sky,
        groups,
        solved: start.uncut.map(Solved::Uncut),
    };
    Ok((opened, outside))
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
            cookie: None,
        });
    }
}
