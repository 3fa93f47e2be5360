//! Detects that input files were saved again, by content.
//!
//! Files are polled. Notifications of the operating system differ between systems, miss network
//! drives and container mounts, and break when an exporter replaces a file instead of writing to
//! it. A poll costs one `stat` per file; contents are hashed only if that changed.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use lumel::ReadFile;
use lumel::mesh_ingest::{Digest, open_regular};

/// Interval of polling.
pub(crate) const LOOK: Duration = Duration::from_millis(150);

/// Number of polls in a row that must agree before files count as complete: exporters write in
/// pieces, and several files.
const CALM: u32 = 2;

/// Size and time of a file; `None` if it is missing.
type Stat = Option<(u64, SystemTime)>;

fn stat(path: &Path) -> Stat {
    let known = |m: Metadata| Some((m.len(), m.modified().ok()?));
    std::fs::metadata(path).ok().and_then(known)
}

fn hash(path: &Path) -> Option<Digest> {
    Digest::of_reader(open_regular(path).ok()?).ok()
}

#[derive(Debug, Clone, PartialEq)]
struct Seen {
    /// `None` before the first poll.
    stat: Option<Stat>,
    digest: Option<Digest>,
}

/// The inputs of a bake, as they were when it read them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Saves {
    files: BTreeMap<PathBuf, Seen>,
}

impl Saves {
    /// Records the present state of files.
    pub(crate) fn note(&mut self, paths: impl IntoIterator<Item = PathBuf>) {
        for path in paths {
            let seen = Seen {
                stat: Some(stat(&path)),
                digest: hash(&path),
            };
            self.files.insert(path, seen);
        }
    }

    /// Records the state in which a bake read files, which may have changed since.
    pub(crate) fn note_read(&mut self, read: &[ReadFile]) {
        for file in read {
            let seen = Seen {
                stat: None,
                digest: file.digest,
            };
            self.files.insert(file.path.clone(), seen);
        }
    }

    /// All recorded files.
    pub(crate) fn paths(&self) -> Vec<PathBuf> {
        self.files.keys().cloned().collect()
    }

    /// Whether the contents of a file differ from the recorded ones.
    pub(crate) fn changed(&mut self) -> bool {
        self.files.iter_mut().any(|(path, seen)| {
            let now = Some(stat(path));
            if now == seen.stat {
                return false;
            }
            // A new time stamp alone is no reason to bake; its contents are hashed only once.
            let differs = hash(path) != seen.digest;
            if !differs {
                seen.stat = now;
            }
            differs
        })
    }

    /// Waits until no file is being written. Returns `false` if `ended` becomes true first.
    pub(crate) fn settle(&self, ended: impl Fn() -> bool) -> bool {
        let look = || -> Vec<Stat> { self.files.keys().map(|p| stat(p)).collect() };
        let (mut last, mut calm) = (look(), 0);
        while calm < CALM {
            if ended() {
                return false;
            }
            std::thread::sleep(LOOK);
            let now = look();
            calm = if now == last { calm + 1 } else { 0 };
            last = now;
        }
        true
    }
}

/// Extensions of files that a level or its settings name.
const INPUTS: [&str; 14] = [
    "bin", "exr", "glb", "gltf", "hdr", "ies", "jfif", "jpeg", "jpg", "json", "ktx2", "png",
    "toml", "webp",
];

/// Names, sizes and times of the files in a folder. A level that cannot be read has no known list
/// of inputs, so any change beside it may repair it. Files of other kinds are left out: a log of
/// this very program would repeat the error for ever.
pub(crate) fn listing(folder: &Path) -> Vec<(OsString, Stat)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let may_be_input = |path: &Path| {
        (path.extension()).is_none_or(|e| INPUTS.iter().any(|i| e.eq_ignore_ascii_case(i)))
    };
    let mut all: Vec<_> = (entries.map(|e| e.path()).filter(|p| may_be_input(p)))
        .map(|p| (p.file_name().unwrap_or_default().to_owned(), stat(&p)))
        .collect();
    all.sort();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_decides_not_time_stamps() {
        let t = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|n| t.path().join(n));
        std::fs::write(&a, "one").unwrap();
        let mut saves = Saves::default();
        saves.note([a.clone(), b.clone()]);
        assert!(!saves.changed());
        // A new time stamp alone.
        let later = SystemTime::now() + Duration::from_secs(5);
        std::fs::File::options()
            .write(true)
            .open(&a)
            .and_then(|f| f.set_modified(later))
            .unwrap();
        assert!(!saves.changed());
        std::fs::write(&a, "two").unwrap();
        assert!(saves.changed() && saves.changed(), "until it is noted");
        saves.note([a]);
        assert!(!saves.changed());
        // A file that was missing appears.
        std::fs::write(&b, "new").unwrap();
        assert!(saves.changed());
    }

    #[test]
    fn what_was_read_counts_not_what_is_there() {
        let t = tempfile::tempdir().unwrap();
        let path = t.path().join("a");
        std::fs::write(&path, "new").unwrap();
        let mut saves = Saves::default();
        let read = |content: &[u8]| {
            let path = path.clone();
            let digest = Some(Digest::of(content));
            [ReadFile { path, digest }]
        };
        saves.note_read(&read(b"new"));
        assert!(!saves.changed());
        saves.note_read(&read(b"old"));
        assert!(saves.changed());
    }
}
