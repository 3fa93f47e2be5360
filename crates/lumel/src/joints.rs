//! A bake cut at its joints: solve, gather in shards, merge. [`work`](crate::work) describes the
//! folder that connects them.

use std::path::Path;

use atlas::Lumels;
use atlas_bake::OutputSet;
use gather::Shard;
use mesh_ingest::Digest;
use radiosity::{Monitor, Phase, StoredSolution};
use serde::Serialize;

use crate::beside::Beside;
use crate::cache::Cache;
use crate::error::Error;
use crate::open::{Opened, Outside, Solved, Start, Uncut, open};
use crate::pipeline::{Bake, Elsewhere, bake_rest};
use crate::plan::{Done, bake_options};
use crate::record::{self, Provenance, RecordedInput};
use crate::scene_input::SceneInput;
use crate::settings::Settings;
use crate::shards::{ShardOf, ShardWriter, Shards, is_gathered};
use crate::work::{
    CHARTS, Description, Hashed, SOLUTION, Told, WORK, WorkFolder, hashes_in, layout_digest,
};

/// A level: its file, the settings, and where they came from.
#[derive(Clone, Copy)]
pub struct Order<'o> {
    /// The scene.
    pub scene: &'o Path,
    /// The settings.
    pub settings: &'o Settings,
    /// Where they came from.
    pub provenance: &'o Provenance,
}

/// What `lumel solve` did.
#[derive(Debug, Clone, Serialize)]
pub struct SolveDone {
    /// Lumels to gather.
    pub lumels: u64,
    /// Patches of the solution.
    pub patches: u32,
    /// Bytes of the solution.
    pub bytes: u64,
}

/// What `lumel gather` did. Records and bytes are 0 if the shard existed already.
#[derive(Debug, Clone, Serialize)]
pub struct GatherDone {
    /// The shard's lumels.
    pub lumels: u64,
    /// Number of records that it stored: the light of a lumel after a pass.
    pub records: u64,
    /// Size of its file, bytes.
    pub bytes: u64,
}

impl Order<'_> {
    /// Reads the scene.
    pub(crate) fn open(
        &self,
        beside: &Beside<'_>,
        start: Start,
        monitor: &dyn Monitor,
    ) -> Result<(Opened, Outside), Error> {
        let scene = SceneInput::File(self.scene);
        let order = (self.settings, self.provenance);
        open(scene, order, beside, start, monitor)
    }

    /// All inputs, and the hash of them and of the settings.
    fn inputs(&self, opened: &Opened) -> (String, Vec<Hashed>) {
        let name = self.scene.file_name().unwrap_or_default().to_string_lossy();
        let mut all = record::document_inputs(&name, opened.loaded.document.inputs());
        all.extend(opened.option_inputs.iter().cloned());
        let key = record::key(self.settings, &self.provenance.origins, &all);
        let hashed = |input: RecordedInput| {
            let path = record::locate(self.scene, self.settings, self.provenance, &input);
            Hashed {
                file: path.map_or(input.uri, |p| p.display().to_string()),
                digest: input.digest.map(|d| d.to_string()),
            }
        };
        (key, all.into_iter().map(hashed).collect())
    }

    /// The light of the document before its charts are cut.
    pub(crate) fn uncut(
        &self,
        solved: Option<Solved>,
        beside: &Beside<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Box<Uncut>, Error> {
        let (opened, outside) = self.open(&beside.again(), Start::default(), monitor)?;
        let outside = Outside { solved, ..outside };
        opened.uncut(self.scene, outside, self.settings, monitor)
    }

    /// Reopens the scene of a work folder, with its solution.
    fn resume(
        &self,
        work: &WorkFolder,
        beside: &Beside<'_>,
        monitor: &dyn Monitor,
    ) -> Result<(Opened, Outside), Error> {
        let start = Start {
            changes: work.description.changes(),
            decided: true,
            ..Start::default()
        };
        let (opened, mut outside) = self.open(beside, start, monitor)?;
        let (key, inputs) = self.inputs(&opened);
        work.check_inputs(&key, &inputs)?;
        let (light, file) = work.solution()?;
        let light = Box::new(light);
        let solved = Solved::Elsewhere { light, file };
        outside.solved = Some(match work.description.carried {
            false => solved,
            true => Solved::Uncut(self.uncut(Some(solved), beside, monitor)?),
        });
        Ok((opened, outside))
    }
}

/// The charts stored in a work folder.
fn charts(folder: &Path) -> Cache {
    Cache {
        folder: folder.join(CHARTS),
        limit: u64::MAX,
    }
}

/// Makes charts, solves the light, and writes both into the folder `work`. `told` is the command
/// from which other processes take the same settings.
///
/// ```no_run
/// use lumel::{Beside, Order, Provenance, Settings, Silent, Told, WorkFolder, merge_work, solve};
///
/// let (settings, provenance) = (Settings::default(), Provenance::default());
/// let scene = "level.glb".as_ref();
/// let order = || Order { scene, settings: &settings, provenance: &provenance };
/// let told = Told { folder: ".".into(), arguments: vec!["level.glb".into()] };
/// solve(order(), told, "work".as_ref(), &Beside::default(), &Silent)?;
/// // Then every shard is gathered, on any machine: see `gather_work`.
/// let work = WorkFolder::open("work".as_ref())?;
/// merge_work(order(), &work, &Beside::default(), &Silent)?.write("out")?;
/// # Ok::<(), lumel::Error>(())
/// ```
///
/// # Errors
/// [`Error`], by fault.
pub fn solve(
    order: Order<'_>,
    told: Told,
    work: &Path,
    beside: &Beside<'_>,
    monitor: &dyn Monitor,
) -> Result<SolveDone, Error> {
    let mut set = OutputSet::create(work)?;
    let cache = charts(work);
    let beside = Beside {
        cache: Some(&cache),
        ..*beside
    };
    let (mut opened, outside) = order.open(&beside, Start::default(), monitor)?;
    let mut clock = opened.clock.clone();
    let first = opened.plan(
        order.scene,
        outside,
        order.settings,
        &beside,
        (&mut clock, monitor),
    )?;
    let changes = opened.to_change(&first, order.settings);
    let again = beside.again();
    let planned = if changes.is_empty() {
        first
    } else {
        let solution = first.into_solution();
        let soup = opened.soup;
        let start = Start {
            uncut: (changes.only_cut()).then(|| Box::new(Uncut { soup, solution })),
            changes: changes.clone(),
            decided: true,
            ..Start::default()
        };
        let (second, outside) = order.open(&again, start, monitor)?;
        opened = second;
        opened.plan(
            order.scene,
            outside,
            order.settings,
            &again,
            (&mut clock, monitor),
        )?
    };
    let (key, inputs) = order.inputs(&opened);
    let world = &planned.lit.world;
    let solution = postcard::to_stdvec(&StoredSolution::of(&planned.lit.solution))
        .map_err(|e| Error::Internal(format!("the solution cannot be stored: {e}")))?;
    let mut description = Description::new(told, key, inputs);
    description.split = changes.split.into_iter().collect();
    description.cuts = changes.cuts;
    description.carried = planned.lit.carried;
    description.layout = layout_digest(&planned.layout);
    description.lumels = Lumels::count(world.scene, world.soup, &planned.layout);
    description.files = hashes_in(&cache.folder)?;
    description.files.push(Hashed {
        file: SOLUTION.into(),
        digest: Some(Digest::of(&solution).to_string()),
    });
    monitor.progress(Phase::Write, 0, 0);
    if monitor.cancelled() {
        return Err(Error::Cancelled);
    }
    set.add(SOLUTION, &solution)?;
    // Written last: without this file, a folder is not a work folder.
    set.add(WORK, &description.to_json())?;
    set.commit()?;
    Ok(SolveDone {
        lumels: description.lumels.iter().map(|&n| u64::from(n)).sum(),
        patches: planned.lit.solution.report.subdivision.patches,
        bytes: solution.len() as u64,
    })
}

/// Gathers a shard, unless its file exists already, is complete, and belongs to this work folder.
///
/// ```no_run
/// use lumel::{Beside, Order, Provenance, Settings, ShardOf, Silent, WorkFolder, gather_work};
///
/// let (settings, provenance) = (Settings::default(), Provenance::default());
/// let scene = "level.glb".as_ref();
/// let order = Order { scene, settings: &settings, provenance: &provenance };
/// let (work, shard) = (WorkFolder::open("work".as_ref())?, ShardOf { number: 1, of: 8 });
/// gather_work(order, &work, shard, &Beside::default(), &Silent)?;
/// # Ok::<(), lumel::Error>(())
/// ```
///
/// # Errors
/// [`Error`], by fault; [`Error::Folder`] if the work is damaged or its inputs changed.
pub fn gather_work(
    order: Order<'_>,
    work: &WorkFolder,
    shard: ShardOf,
    beside: &Beside<'_>,
    monitor: &dyn Monitor,
) -> Result<GatherDone, Error> {
    let part = Shard {
        counts: &work.description.lumels,
        number: shard.number - 1,
        of: shard.of,
    };
    let lumels = part.lumels().len() as u64;
    if is_gathered(&work.folder, &work.digest, shard) {
        let (records, bytes) = (0, 0);
        return Ok(GatherDone {
            lumels,
            records,
            bytes,
        });
    }
    let cache = charts(&work.folder);
    let beside = Beside {
        cache: Some(&cache),
        ..*beside
    };
    let (opened, outside) = order.resume(work, &beside, monitor)?;
    let mut clock = opened.clock.clone();
    let steps = (&mut clock, monitor);
    let planned = opened.plan(order.scene, outside, order.settings, &beside, steps)?;
    work.check_layout(&planned.layout)?;
    let records = ShardWriter::create(&work.folder, &work.digest, shard)?;
    let options = bake_options(order.settings);
    let (lit, into) = (planned.lit.parts(), (&part, &records as _));
    monitor.progress(Phase::Gather, 0, 0);
    atlas_bake::gather_shard(lit, &planned.layout, &options, into, monitor)
        .map_err(|_| Error::Cancelled)?;
    let (bytes, records) = records.finish()?;
    Ok(GatherDone {
        lumels,
        records,
        bytes,
    })
}

/// Finishes a bake whose shards are all gathered, by everything that needs all lumels together.
///
/// # Errors
/// [`Error`], by fault; [`Error::Folder`] if the work or a shard is damaged or missing, or inputs
/// changed.
pub fn merge_work(
    order: Order<'_>,
    work: &WorkFolder,
    beside: &Beside<'_>,
    monitor: &dyn Monitor,
) -> Result<Bake, Error> {
    let shards = Shards::open(&work.folder, &work.digest)?;
    let cache = charts(&work.folder);
    let beside = Beside {
        cache: Some(&cache),
        ..*beside
    };
    let (opened, outside) = order.resume(work, &beside, monitor)?;
    let check = |_: &_, layout: &_| work.check_layout(layout);
    let elsewhere = Elsewhere {
        done: Done::Shards(&shards),
        check: &check,
    };
    let settled = (order.settings, order.provenance);
    let with = (&beside, &elsewhere);
    let bake = bake_rest(order.scene, (opened, outside), settled, with, monitor);
    match shards.fault() {
        Some(fault) => Err(fault),
        None => bake,
    }
}
