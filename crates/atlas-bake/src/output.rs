//! Output files that appear all together or not at all.
//!
//! Every file is first written to a hidden temporary file next to its target; [`OutputSet::commit`]
//! renames all of them at the end. A bake that fails or is cancelled drops the set and deletes its
//! temporary files. A bake that is killed leaves the old files intact; the next run in the same
//! folder deletes its temporary files.
//!
//! ```
//! use atlas_bake::OutputSet;
//!
//! let folder = tempfile::tempdir().expect("a temporary folder");
//! let mut set = OutputSet::create(folder.path())?;
//! set.add("a.txt", b"1")?;
//! assert!(!folder.path().join("a.txt").exists());
//! let done = set.commit()?;
//! assert_eq!(done.written, [folder.path().join("a.txt")]);
//! # Ok::<(), atlas_bake::Error>(())
//! ```

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::{BufRead, Write};
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::temporary::{Leftovers, Temporary, remove_stale};

/// How long a set waits for the renames of another set, which normally take milliseconds.
const TURN: Duration = Duration::from_secs(5);

/// Files that are being written; none has its final name before [`OutputSet::commit`].
#[derive(Debug)]
pub struct OutputSet {
    dir: PathBuf,
    /// Folders that this set created, outermost first. They are deleted (if empty) unless the set
    /// is committed.
    created: Vec<PathBuf>,
    cleaned: BTreeSet<PathBuf>,
    files: Vec<(Temporary, PathBuf)>,
    leftovers: Leftovers,
    obsolete: Vec<PathBuf>,
}

/// Results of a commit, each in the order in which files were added.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Committed {
    /// Files that are new or have changed.
    pub written: Vec<PathBuf>,
    /// Files that already had the same contents and were not touched.
    pub unchanged: Vec<PathBuf>,
    /// Files of an earlier run that were deleted, see [`OutputSet::remove_obsolete`].
    pub removed: Vec<PathBuf>,
}

impl Committed {
    /// All files of the set, without deleted ones.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        (self.written.iter().chain(&self.unchanged)).map(PathBuf::as_path)
    }
}

impl OutputSet {
    /// Begins a set in folder `dir`, which is created (with its parents) if it does not exist.
    /// Temporary files of killed runs are deleted there; those of running processes are recognised
    /// by their lock and kept.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be created or read.
    pub fn create(dir: &Path) -> Result<OutputSet> {
        // `Path::parent` of a bare file name is empty.
        let dir = if dir.as_os_str().is_empty() {
            Path::new(".")
        } else {
            dir
        };
        let mut set = OutputSet {
            dir: dir.to_owned(),
            created: Vec::new(),
            cleaned: BTreeSet::new(),
            files: Vec::new(),
            leftovers: Leftovers::default(),
            obsolete: Vec::new(),
        };
        set.prepare(dir)?;
        Ok(set)
    }

    /// Writes `bytes` to a temporary file that will become `name` in the set's folder. A later file
    /// of the same name wins.
    ///
    /// # Errors
    /// [`Error::OutputName`] if `name` is not a plain file name or is a folder; [`Error::Io`] if
    /// writing fails.
    pub fn add(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        let mut parts = Path::new(name).components();
        if !matches!(
            (parts.next(), parts.next()),
            (Some(Component::Normal(_)), None)
        ) {
            return Err(Error::OutputName {
                path: name.into(),
                why: "not a plain file name",
            });
        }
        self.write(self.dir.join(name), bytes)
    }

    /// As [`add`](Self::add), for a file in any folder, e.g. a report or depfile at a path chosen
    /// by the user.
    ///
    /// # Errors
    /// As [`add`](Self::add).
    pub fn add_path(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        if path.file_name().is_none() {
            return Err(Error::OutputName {
                path: path.into(),
                why: "the path has no file name",
            });
        }
        let parent = parent_of(path);
        self.prepare(&parent)?;
        self.write(path.to_owned(), bytes)
    }

    /// Temporary files of killed runs that were found in the folders of this set.
    pub fn leftovers(&self) -> Leftovers {
        self.leftovers
    }

    /// The set's folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Deletes `name` from the set's folder at commit, unless this set writes it: for further pages
    /// of an earlier bake.
    pub fn remove_obsolete(&mut self, name: &str) {
        self.obsolete.push(self.dir.join(name));
    }

    /// Final paths in the order in which the files were added.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(_, path)| path.as_path())
    }

    /// Flushes every temporary file to disk, then renames all of them in the order in which they
    /// were added, replacing existing files. A file with unchanged contents is not touched, not
    /// even its modification time, so that build steps that depend on it need not run again.
    ///
    /// Each rename is atomic. The whole set is nearly so: everything that can be checked in advance
    /// is checked before the first rename.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be flushed or renamed. If a flush fails, nothing has changed;
    /// if a rename fails, earlier files of the set have been renamed.
    pub fn commit(mut self) -> Result<Committed> {
        let mut committed = Committed::default();
        let equal: Vec<bool> = (self.files.iter_mut())
            .map(|(file, path)| same_content(file.file().path(), path))
            .collect();
        let files = self.files.iter_mut().zip(&equal);
        for ((file, path), _) in files.filter(|(_, same)| !**same) {
            refuse_folder(path)?;
            file.file()
                .as_file()
                .sync_all()
                .map_err(|source| Error::Io {
                    path: path.clone(),
                    source,
                })?;
        }
        self.created.clear();
        // Only one set at a time renames in a folder, so that two bakes with the same name do not
        // mix. If folders cannot be locked, the report still reveals it.
        let _turn = take_turn(&self.dir);
        for ((file, path), same) in std::mem::take(&mut self.files).into_iter().zip(equal) {
            if same {
                committed.unchanged.push(path);
                continue;
            }
            file.persist(&path).map_err(|source| Error::Io {
                path: path.clone(),
                source,
            })?;
            committed.written.push(path);
        }
        for path in &self.obsolete {
            if !committed.files().any(|p| p == path) && path.is_file() {
                fs::remove_file(path).map_err(|source| Error::Io {
                    path: path.clone(),
                    source,
                })?;
                committed.removed.push(path.clone());
            }
        }
        Ok(committed)
    }

    fn write(&mut self, path: PathBuf, bytes: &[u8]) -> Result<()> {
        refuse_folder(&path)?;
        let io = |source| Error::Io {
            path: path.clone(),
            source,
        };
        let mut file = Temporary::create(&parent_of(&path)).map_err(io)?;
        file.file().write_all(bytes).map_err(io)?;
        self.files.retain(|(_, p)| *p != path);
        self.files.push((file, path));
        Ok(())
    }

    /// Creates `dir` if necessary and deletes stale temporary files in it, once per folder.
    fn prepare(&mut self, dir: &Path) -> Result<()> {
        if self.cleaned.contains(dir) {
            return Ok(());
        }
        let missing: Vec<_> = dir
            .ancestors()
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .map(Path::to_owned)
            .collect();
        for p in missing.into_iter().rev() {
            match fs::create_dir(&p) {
                Ok(()) => self.created.push(p),
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(source) => return Err(Error::Io { path: p, source }),
            }
        }
        let found = remove_stale(dir)?;
        self.leftovers.files += found.files;
        self.leftovers.bytes += found.bytes;
        self.cleaned.insert(dir.to_owned());
        Ok(())
    }
}

impl Drop for OutputSet {
    fn drop(&mut self) {
        self.files.clear();
        for dir in self.created.iter().rev() {
            // Fails, as it should, if another program has put something there in the meantime.
            let _ = fs::remove_dir(dir);
        }
    }
}

/// Waits until no other set is renaming in `dir`, up to a limit, because the holder may be stopped.
fn take_turn(dir: &Path) -> Option<File> {
    let folder = File::open(dir).ok()?;
    let start = Instant::now();
    while let Err(TryLockError::WouldBlock) = folder.try_lock() {
        if start.elapsed() > TURN {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Some(folder)
}

fn parent_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Whether `old` is a regular file with the same contents as `new`; `false` if either cannot be
/// read.
fn same_content(new: &Path, old: &Path) -> bool {
    let compare = || -> std::io::Result<bool> {
        // A link is replaced by a file.
        let (a, b) = (fs::metadata(new)?, fs::symlink_metadata(old)?);
        if !b.is_file() || a.len() != b.len() {
            return Ok(false);
        }
        let mut readers = [new, old].map(|p| File::open(p).map(std::io::BufReader::new));
        let [Ok(x), Ok(y)] = &mut readers else {
            return Ok(false);
        };
        loop {
            let (left, right) = (x.fill_buf()?, y.fill_buf()?);
            let n = left.len().min(right.len());
            if left[..n] != right[..n] {
                return Ok(false);
            }
            if n == 0 {
                return Ok(left.len() == right.len());
            }
            x.consume(n);
            y.consume(n);
        }
    };
    compare().unwrap_or(false)
}

fn refuse_folder(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::OutputName {
            path: path.into(),
            why: "a folder with that name exists",
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temporary::{OWN, TEMPORARY_PREFIX, remove_own_temporaries};

    fn names(dir: &Path) -> Vec<String> {
        let mut v: Vec<_> = fs::read_dir(dir)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        v.sort();
        v
    }

    #[test]
    fn nothing_shows_before_commit_and_everything_after() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("a.exr"), b"old").unwrap();
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("a.exr", b"new").unwrap();
        set.add("b.glb", b"b").unwrap();
        assert_eq!(fs::read(dir.path().join("a.exr")).unwrap(), b"old");
        assert!(!dir.path().join("b.glb").exists());
        let done = set.commit().unwrap();
        let expected = [dir.path().join("a.exr"), dir.path().join("b.glb")];
        assert_eq!(done.written, expected);
        assert!(done.unchanged.is_empty(), "{:?}", done.unchanged);
        assert_eq!(names(dir.path()), ["a.exr", "b.glb"]);
        assert_eq!(fs::read(dir.path().join("a.exr")).unwrap(), b"new");
    }

    #[test]
    fn files_that_hold_the_same_already_are_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = |n: &str| dir.path().join(n);
        let long = vec![7u8; 100_000];
        let mut other = long.clone();
        other[99_999] = 8;
        for (name, bytes) in [("same", &long[..]), ("other", &other), ("short", b"7")] {
            fs::write(path(name), bytes).unwrap();
            let past = std::time::SystemTime::UNIX_EPOCH + Duration::from_secs(1000);
            let file = File::options().write(true).open(path(name)).unwrap();
            file.set_modified(past).unwrap();
        }
        let changed = |n: &str| fs::metadata(path(n)).unwrap().modified().unwrap();
        let before = changed("same");
        let mut set = OutputSet::create(dir.path()).unwrap();
        for name in ["other", "same", "short", "new"] {
            set.add(name, &long).unwrap();
        }
        set.remove_obsolete("same");
        let done = set.commit().unwrap();
        assert_eq!(done.written, ["other", "short", "new"].map(path));
        assert_eq!(done.unchanged, [path("same")]);
        assert_eq!(changed("same"), before);
        assert!(changed("other") > before);
        assert_eq!(names(dir.path()), ["new", "other", "same", "short"]);
    }

    #[cfg(unix)]
    #[test]
    fn outputs_are_readable_as_ordinary_files_are() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let plain = dir.path().join("plain");
        fs::write(&plain, b"").unwrap();
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("a", b"x").unwrap();
        set.commit().unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&dir.path().join("a")), mode(&plain));
    }

    #[test]
    fn dropping_leaves_the_folder_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("a.exr"), b"old").unwrap();
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("a.exr", b"new").unwrap();
        drop(set);
        assert_eq!(names(dir.path()), ["a.exr"]);
        assert_eq!(fs::read(dir.path().join("a.exr")).unwrap(), b"old");

        let deep = dir.path().join("x/y/z");
        let mut set = OutputSet::create(&deep).unwrap();
        set.add("a", b"1").unwrap();
        drop(set);
        assert_eq!(names(dir.path()), ["a.exr"]);
        let mut set = OutputSet::create(&deep).unwrap();
        set.add("a", b"1").unwrap();
        set.commit().unwrap();
        assert_eq!(names(&deep), ["a"]);
    }

    #[test]
    fn a_killed_runs_temporaries_go_and_a_living_ones_stay() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(".lumel-tmp-dead"), b"half a file").unwrap();
        fs::write(dir.path().join(".other-tmp"), b"not ours").unwrap();
        let mut alive = OutputSet::create(dir.path()).unwrap();
        assert_eq!(names(dir.path()), [".other-tmp"]);
        alive.add("a", b"1").unwrap();
        let second = OutputSet::create(dir.path()).unwrap();
        drop(second);
        alive.commit().unwrap();
        assert_eq!(names(dir.path()), [".other-tmp", "a"]);
    }

    #[test]
    fn names_that_leave_the_folder_or_name_one_are_refused_and_nothing_is_renamed() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("folder")).unwrap();
        let mut set = OutputSet::create(dir.path()).unwrap();
        for name in ["../a", "", ".", "..", "x/a", "/a", "folder"] {
            assert!(
                matches!(set.add(name, b""), Err(Error::OutputName { .. })),
                "{name:?}"
            );
        }
        // A folder that appears after the file was added is noticed before the first rename.
        set.add("a", b"1").unwrap();
        set.add("b", b"1").unwrap();
        fs::create_dir(dir.path().join("b")).unwrap();
        assert!(set.commit().is_err());
        assert_eq!(names(dir.path()), ["b", "folder"]);
    }

    #[test]
    fn pages_of_an_earlier_bake_are_removed_at_commit_only() {
        let dir = tempfile::tempdir().unwrap();
        for n in ["l.exr", "l.1.exr"] {
            fs::write(dir.path().join(n), b"old").unwrap();
        }
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("l.exr", b"new").unwrap();
        for n in ["l.exr", "l.1.exr", "l.2.exr"] {
            set.remove_obsolete(n);
        }
        assert_eq!(
            names(dir.path())
                .iter()
                .filter(|n| !n.starts_with('.'))
                .count(),
            2
        );
        set.commit().unwrap();
        assert_eq!(names(dir.path()), ["l.exr"]);
    }

    #[test]
    fn a_report_can_lie_elsewhere() {
        let dir = tempfile::tempdir().unwrap();
        let mut set = OutputSet::create(&dir.path().join("out")).unwrap();
        set.add_path(&dir.path().join("reports/r.json"), b"{}")
            .unwrap();
        set.commit().unwrap();
        assert_eq!(names(&dir.path().join("reports")), ["r.json"]);
    }

    /// A temporary file of a killed process, i.e. without a lock.
    fn leave(dir: &Path, name: &str, bytes: &[u8]) {
        fs::write(dir.join(format!("{TEMPORARY_PREFIX}{name}")), bytes).unwrap();
    }

    #[test]
    fn leftovers_are_removed_and_counted_and_those_of_the_living_kept() {
        let dir = tempfile::tempdir().unwrap();
        let mut alive = OutputSet::create(dir.path()).unwrap();
        assert_eq!(alive.leftovers(), Leftovers::default());
        alive.add("a.exr", b"new").unwrap();
        leave(dir.path(), "1", b"12345");
        leave(dir.path(), "2", b"123");
        let other = OutputSet::create(dir.path()).unwrap();
        let found = Leftovers { files: 2, bytes: 8 };
        assert_eq!(other.leftovers(), found);
        drop(other);
        alive.commit().unwrap();
        assert_eq!(names(dir.path()), ["a.exr"]);
    }

    #[test]
    fn temporaries_are_known_as_long_as_they_live() {
        let dir = tempfile::tempdir().unwrap();
        let ours = || {
            let all = OWN.lock().unwrap();
            all.iter().filter(|p| p.starts_with(dir.path())).count()
        };
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("a", b"1").unwrap();
        set.add("a", b"2").unwrap();
        set.add("b", b"3").unwrap();
        assert_eq!(ours(), 2);
        set.commit().unwrap();
        assert_eq!(ours(), 0);
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("c", b"1").unwrap();
        drop(set);
        assert_eq!(ours(), 0);
        assert_eq!(names(dir.path()), ["a", "b"]);
    }

    /// A bake that was ended by force used to delete the temporary files of another one in the same
    /// folder.
    #[test]
    fn a_process_removes_its_own_temporaries_alone() {
        const CHILD: &str = "LUMEL_TEST_OWN_TEMPORARIES";
        const NAME: &str = "output::tests::a_process_removes_its_own_temporaries_alone";
        if let Some(dir) = std::env::var_os(CHILD) {
            let mut set = OutputSet::create(Path::new(&dir)).unwrap();
            set.add("b", b"2").unwrap();
            assert_eq!(names(Path::new(&dir)).len(), 2);
            remove_own_temporaries();
            assert_eq!(names(Path::new(&dir)).len(), 1);
            return;
        }
        let dir = tempfile::tempdir().unwrap();
        let mut set = OutputSet::create(dir.path()).unwrap();
        set.add("a", b"1").unwrap();
        let child = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", NAME])
            .env(CHILD, dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&child.stdout);
        assert!(
            child.status.success() && said.contains("1 passed"),
            "{said}"
        );
        set.commit().unwrap();
        assert_eq!(names(dir.path()), ["a"]);
    }
}
