//! What a bake keeps for the next one of the same surfaces: what rays met.
//!
//! Nearly all of a bake's time goes into rays, and where they go hangs on surfaces alone. So the first bake records it, footprint by footprint
//! ([`tape`]), and the next one, in which a lamp has moved, casts only the rays that the first did not: those towards that lamp, and those that
//! it asks for since the light differs. Every answer is recorded under what identifies the question, and results are computed from it by the
//! same operations in the same order, so that they have the same bits.
//!
//! A file holds the records of one scene, layout and settings, lamps left out ([`Recall::open`]'s key). It is written by the first bake and
//! read by the others, which add nothing to it: a lamp that is moved again and again would leave a file each time.

mod rays;
mod store;
mod tape;

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use radiosity::{KnownLamps, Recalled, Records, Topic as SolveTopic};
use serde::Serialize;

pub(crate) use rays::{Deaf, End, Head, Listening, Notes, read_answer, write_answer};
use store::{Reader, Writer};
pub(crate) use tape::{RayTape, Tape, Topic, key_of, mix};

/// Stages of a bake, each with records of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Stage {
    /// Lumels that are gathered at.
    Gather = 1,
    /// Those that may be interpolated.
    Between = 2,
    /// Second looks beside edges; three rounds.
    Follow = 3,
    /// More rays.
    More = 6,
    /// Vertices: what they share, what is their own, and what is shared where neighbours smooth it.
    Vertices = 7,
}

impl Stage {
    /// Number of a round of the stage.
    pub(crate) fn round(self, round: u32) -> u8 {
        self as u8 + round as u8
    }
}

/// What records did for a bake.
#[derive(Debug, Clone, Default, Serialize)]
pub struct RecallReport {
    /// The bake found records.
    pub found: bool,
    /// Gathering and shadow rays that records answered.
    pub rays_taken: u64,
    /// Those that were cast although there were records, since these did not have them.
    pub rays_cast: u64,
    /// Blocks of records that were not as they were written.
    pub damaged: u64,
    /// Size of the records, bytes.
    pub bytes: u64,
    /// What went wrong with records; the bake goes on without.
    pub notes: Vec<String>,
}

enum Mode {
    Off,
    Write(Mutex<Option<Writer>>),
    Read(Reader),
}

/// Records of an earlier bake, or for a later one.
pub struct Recall {
    mode: Mode,
    path: PathBuf,
    lamps: KnownLamps,
    /// Rays' lengths are recorded.
    pub(crate) exact: bool,
    taken: AtomicU64,
    cast: AtomicU64,
    damaged: AtomicU64,
    failed: AtomicBool,
    notes: Mutex<Vec<String>>,
}

impl Recall {
    /// No records.
    pub fn off() -> Recall {
        Recall {
            mode: Mode::Off,
            path: PathBuf::new(),
            lamps: KnownLamps::default(),
            exact: false,
            taken: AtomicU64::new(0),
            cast: AtomicU64::new(0),
            damaged: AtomicU64::new(0),
            failed: AtomicBool::new(false),
            notes: Mutex::new(Vec::new()),
        }
    }

    /// Records in the file `path`, which are about `key`: a hash of all that decides where rays go, and of the options. They are read if they
    /// are there, else written.
    ///
    /// `lamps` has two hashes for each lamp of the scene: of its place and shape, and of these with its intensity. `exact` keeps how far rays
    /// went, which [`Layer::Ao`](crate::Layer::Ao) needs.
    pub fn open(path: &Path, key: &[u8; 32], lamps: &[[[u8; 32]; 2]], exact: bool) -> Recall {
        let mut out = Recall {
            path: path.to_owned(),
            exact,
            ..Recall::off()
        };
        if path.exists() {
            match Reader::open(path, key) {
                Ok(reader) => {
                    out.lamps = match_lamps(&reader.head, lamps);
                    out.mode = Mode::Read(reader);
                    return out;
                }
                Err(why) => out.note(format!("{} is not used: {why}", path.display())),
            }
        }
        let folder = path.parent().unwrap_or(Path::new("."));
        let head: Vec<u8> = lamps.as_flattened().as_flattened().to_vec();
        let created =
            std::fs::create_dir_all(folder).and_then(|()| Writer::create(folder, key, &head));
        match created {
            Ok(writer) => {
                out.lamps = KnownLamps::own(lamps.len());
                out.mode = Mode::Write(Mutex::new(Some(writer)));
            }
            Err(e) => out.note(format!("{}: nothing is kept: {e}", folder.display())),
        }
        out
    }

    fn note(&self, text: String) {
        if let Ok(mut notes) = self.notes.lock() {
            notes.push(text);
        }
    }

    /// Their file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives new records their name, and says what came of all.
    pub fn finish(self) -> RecallReport {
        let mut report = RecallReport {
            found: matches!(self.mode, Mode::Read(_)),
            rays_taken: self.taken.into_inner(),
            rays_cast: self.cast.into_inner(),
            damaged: self.damaged.into_inner(),
            bytes: 0,
            notes: self.notes.into_inner().unwrap_or_default(),
        };
        match self.mode {
            Mode::Off => {}
            Mode::Read(reader) => report.bytes = reader.size,
            Mode::Write(writer) => {
                if let Some(writer) = writer.into_inner().ok().flatten() {
                    match writer.finish(&self.path) {
                        Ok(size) => report.bytes = size,
                        Err(e) => report
                            .notes
                            .push(format!("{}: nothing is kept: {e}", self.path.display())),
                    }
                }
            }
        }
        if report.damaged > 0 {
            report.notes.push(format!(
                "{}: {} blocks are damaged; their rays were cast",
                self.path.display(),
                report.damaged
            ));
        }
        report
    }

    /// Records of some footprints of a stage, in ascending order.
    pub(crate) fn block(&self, stage: u8) -> Block<'_> {
        Block {
            recall: self,
            stage,
            held: None,
            out: Vec::new(),
            items: Vec::new(),
        }
    }

    /// Records and lamps as the crates below know them.
    pub fn recalled(&self) -> Option<Recalled<'_>> {
        (!matches!(self.mode, Mode::Off)).then(|| Recalled {
            records: self,
            lamps: self.lamps.clone(),
        })
    }

    fn append(&self, stage: u8, first: u32, last: u32, bytes: &[u8]) {
        let Mode::Write(writer) = &self.mode else {
            return;
        };
        let Ok(mut slot) = writer.lock() else { return };
        let Some(writer) = slot.as_mut() else { return };
        if let Err(e) = writer.block(stage, first, last, bytes) {
            // Dropped, it takes its file along.
            *slot = None;
            drop(slot);
            if !self.failed.swap(true, Ordering::Relaxed) {
                self.note(format!("{}: nothing is kept: {e}", self.path.display()));
            }
        }
    }
}

/// The stage of a topic.
fn stage_of(topic: SolveTopic) -> u8 {
    match topic {
        SolveTopic::Links => 16,
        SolveTopic::Elements => 17,
        SolveTopic::Choices => 18,
        SolveTopic::Flat => 19,
    }
}

impl Records for Recall {
    fn read(&self) -> bool {
        !matches!(self.mode, Mode::Write(_))
    }

    fn load(&self, topic: SolveTopic, item: u32) -> Option<Vec<u8>> {
        let Mode::Read(reader) = &self.mode else {
            return None;
        };
        let stage = stage_of(topic);
        let found = reader.load(stage, item);
        if found.is_none() && reader.has(stage, item) {
            self.damaged.fetch_add(1, Ordering::Relaxed);
        }
        found.map(|f| f.2)
    }

    fn save(&self, topic: SolveTopic, item: u32, bytes: &[u8]) {
        self.append(stage_of(topic), item, item, bytes);
    }

    fn count(&self, taken: u64, cast: u64) {
        self.taken.fetch_add(taken, Ordering::Relaxed);
        self.cast.fetch_add(cast, Ordering::Relaxed);
    }
}

/// For each lamp, a recorded one with the same hash that no other has taken.
fn match_lamps(head: &[u8], lamps: &[[[u8; 32]; 2]]) -> KnownLamps {
    let recorded: Vec<&[u8]> = head.chunks_exact(64).collect();
    let one = |which: usize| -> Vec<Option<u32>> {
        let mut free = vec![true; recorded.len()];
        lamps
            .iter()
            .map(|lamp| {
                let found = (0..recorded.len())
                    .find(|&k| free[k] && recorded[k][32 * which..][..32] == lamp[which])?;
                free[found] = false;
                Some(found as u32)
            })
            .collect()
    };
    KnownLamps {
        shape: one(0),
        light: one(1),
    }
}

/// A block of records as it is read.
struct Held {
    first: u32,
    last: u32,
    bytes: Vec<u8>,
    /// Items and where they are in `bytes`.
    items: Vec<(u32, std::ops::Range<usize>)>,
}

/// Records of consecutive footprints.
pub(crate) struct Block<'r> {
    recall: &'r Recall,
    stage: u8,
    held: Option<Held>,
    out: Vec<u8>,
    items: Vec<(u32, u32)>,
}

impl Block<'_> {
    /// Calls `f` with the tape of an item, which is larger than the last one; `guard` identifies its footprint.
    pub(crate) fn with<T>(
        &mut self,
        item: u32,
        guard: impl FnOnce() -> u64,
        f: impl FnOnce(&mut Tape) -> T,
    ) -> T {
        let recall = self.recall;
        match &recall.mode {
            Mode::Off => f(&mut Tape::off()),
            Mode::Write(_) => {
                if recall.failed.load(Ordering::Relaxed) {
                    return f(&mut Tape::off());
                }
                let mut tape = Tape::write(guard(), recall.exact);
                let out = f(&mut tape);
                let bytes = tape.finish();
                self.items.push((item, bytes.len() as u32));
                self.out.extend_from_slice(&bytes);
                out
            }
            Mode::Read(reader) => {
                self.hold(reader, item);
                let blob = self.held.as_ref().and_then(|held| {
                    let at = held.items.binary_search_by_key(&item, |i| i.0).ok()?;
                    held.bytes.get(held.items[at].1.clone())
                });
                let mut tape = Tape::read(blob, guard(), recall.exact);
                let out = f(&mut tape);
                recall.taken.fetch_add(tape.taken, Ordering::Relaxed);
                recall.cast.fetch_add(tape.cast, Ordering::Relaxed);
                out
            }
        }
    }

    fn hold(&mut self, reader: &Reader, item: u32) {
        if (self.held.as_ref()).is_some_and(|h| h.first <= item && item <= h.last) {
            return;
        }
        let loaded = reader.load(self.stage, item);
        if loaded.is_none() && reader.has(self.stage, item) {
            self.recall.damaged.fetch_add(1, Ordering::Relaxed);
        }
        self.held = loaded.map(|(first, last, bytes)| Held {
            items: items_of(&bytes).unwrap_or_default(),
            first,
            last,
            bytes,
        });
    }
}

/// The items of a block and where they are in it.
fn items_of(bytes: &[u8]) -> Option<Vec<(u32, std::ops::Range<usize>)>> {
    let word = |k: usize| -> Option<u32> {
        let bytes = bytes.get(4 * k..4 * k + 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    };
    let n = word(0)? as usize;
    let mut at = 4 + n.checked_mul(8)?;
    let mut items = Vec::new();
    for k in 0..n {
        let (item, length) = (word(1 + 2 * k)?, word(2 + 2 * k)? as usize);
        items.push((item, at..at + length));
        at += length;
    }
    Some(items)
}

impl Drop for Block<'_> {
    fn drop(&mut self) {
        let (Some(first), Some(last)) = (self.items.first(), self.items.last()) else {
            return;
        };
        let (first, last) = (first.0, last.0);
        let mut bytes = Vec::with_capacity(4 + 8 * self.items.len() + self.out.len());
        bytes.extend_from_slice(&(self.items.len() as u32).to_le_bytes());
        for (item, length) in &self.items {
            bytes.extend_from_slice(&item.to_le_bytes());
            bytes.extend_from_slice(&length.to_le_bytes());
        }
        bytes.extend_from_slice(&self.out);
        self.recall.append(self.stage, first, last, &bytes);
    }
}
