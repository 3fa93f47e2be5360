//! Files under other names until they are whole, each known by its lock to be somebody's.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};

/// How the name of every temporary begins.
pub(crate) const TEMPORARY_PREFIX: &str = ".lumel-tmp-";

/// How often a temporary is made anew that another process took for a stale one, which takes
/// microseconds to go wrong once.
const TRIES: usize = 100;

/// Temporaries of this process. Another one's in the same folder are its own affair.
pub(crate) static OWN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Removes all temporaries of this process: for one that is about to end without dropping its sets.
pub fn remove_own_temporaries() {
    let own = std::mem::take(&mut *OWN.lock().unwrap_or_else(PoisonError::into_inner));
    for path in own {
        let _ = fs::remove_file(path);
    }
}

/// A temporary that is known to be this process's for as long as it lives.
#[derive(Debug)]
pub(crate) struct Temporary(Option<NamedTempFile>);

impl Temporary {
    /// A new one in `dir`, locked. The system drops the lock when the process dies, however it
    /// dies: an unlocked temporary is a stale one. Where the file system knows no locks, nothing is
    /// ever seen as stale.
    pub fn create(dir: &Path) -> std::io::Result<Temporary> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(TEMPORARY_PREFIX);
        #[cfg(unix)]
        {
            // The default of temporaries is 0600; outputs are ordinary files, subject to the user's
            // umask.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        for _ in 0..TRIES {
            let file = builder.tempfile_in(dir)?;
            // Before the lock, somebody who tidies up may take it for a stale one: that lock, or
            // its absence, says so.
            let taken = matches!(
                file.as_file().try_lock_shared(),
                Err(TryLockError::WouldBlock)
            );
            if !taken && file.path().exists() {
                own(|all| all.insert(file.path().to_owned()));
                return Ok(Temporary(Some(file)));
            }
        }
        Err(std::io::Error::other(
            "others remove temporaries as they are made",
        ))
    }

    pub fn file(&mut self) -> &mut NamedTempFile {
        self.0.as_mut().expect("taken only when it is consumed")
    }

    pub fn persist(mut self, path: &Path) -> std::io::Result<()> {
        let Some(file) = self.0.take() else {
            return Ok(());
        };
        own(|all| all.remove(file.path()));
        file.persist(path).map(drop).map_err(|e| e.error)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(file) = self.0.take() {
            own(|all| all.remove(file.path()));
        }
    }
}

fn own(change: impl FnOnce(&mut BTreeSet<PathBuf>) -> bool) {
    change(&mut OWN.lock().unwrap_or_else(PoisonError::into_inner));
}

/// What killed runs left behind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Temporaries that were removed.
    pub files: u64,
    /// Their size.
    pub bytes: u64,
}

/// Removes temporaries in `dir` that no living process holds a lock on.
pub(crate) fn remove_stale(dir: &Path) -> Result<Leftovers> {
    let mut found = Leftovers::default();
    let io = |source| Error::Io {
        path: dir.to_owned(),
        source,
    };
    for entry in fs::read_dir(dir).map_err(io)? {
        let entry = entry.map_err(io)?;
        let ours = entry
            .file_name()
            .to_str()
            .is_some_and(|n| n.starts_with(TEMPORARY_PREFIX));
        if !ours || !entry.file_type().map_err(io)?.is_file() {
            continue;
        }
        // Being unable to tidy up is no reason not to bake.
        let Ok(file) = File::options().write(true).open(entry.path()) else {
            continue;
        };
        match file.try_lock() {
            Ok(()) => {
                let bytes = file.metadata().map_or(0, |m| m.len());
                if fs::remove_file(entry.path()).is_ok() {
                    found.files += 1;
                    found.bytes += bytes;
                }
            }
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
        }
    }
    Ok(found)
}
