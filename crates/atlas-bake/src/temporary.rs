//! Temporary files, whose lock shows that their process is alive.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};

/// Prefix of the names of all temporary files.
pub(crate) const TEMPORARY_PREFIX: &str = ".lumel-tmp-";

/// Retries if another process deletes a new file as stale before it is locked. That window is a few
/// microseconds long.
const TRIES: usize = 100;

/// Temporary files of this process.
pub(crate) static OWN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Deletes all temporary files of this process, for one that is about to end without dropping its
/// sets.
pub fn remove_own_temporaries() {
    let own = std::mem::take(&mut *OWN.lock().unwrap_or_else(PoisonError::into_inner));
    for path in own {
        let _ = fs::remove_file(path);
    }
}

/// A temporary file that is locked by this process.
#[derive(Debug)]
pub(crate) struct Temporary(Option<NamedTempFile>);

impl Temporary {
    /// Creates and locks a new file in `dir`. The system releases the lock when the process dies
    /// for any reason, so an unlocked temporary file is stale. If the file system has no locks, no
    /// file is considered stale.
    pub fn create(dir: &Path) -> std::io::Result<Temporary> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(TEMPORARY_PREFIX);
        #[cfg(unix)]
        {
            // Temporary files default to mode 0600, but outputs are ordinary files, subject to the
            // user's umask.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        for _ in 0..TRIES {
            let file = builder.tempfile_in(dir)?;
            // Another process may have considered it stale before it was locked; then it is locked
            // by that process, or gone.
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

/// Temporary files of killed runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Number of deleted files.
    pub files: u64,
    /// Their total size.
    pub bytes: u64,
}

/// Deletes temporary files in `dir` that no living process has locked.
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
        // Failing to clean up must not stop a bake.
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
