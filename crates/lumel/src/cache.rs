//! `--cache`: charts of large meshes, kept for later bakes.
//!
//! A file's name is a hash of the mesh, of the unwrapping options and of the program, because
//! another version may unwrap differently.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use atlas::KeptCharts;
use mesh_ingest::read_regular;
use serde::Serialize;

use crate::record::PROGRAM;

/// A folder where bakes store charts for later bakes.
///
/// ```
/// use lumel::{Baker, Cache};
///
/// let cache = Cache { folder: "cache".into(), limit: Cache::LIMIT };
/// let baker = Baker::new().cache(cache);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    /// The folder; created when needed.
    pub folder: PathBuf,
    /// If the folder exceeds this size, bytes, the least recently used files are deleted.
    pub limit: u64,
}

impl Cache {
    /// Default of [`Cache::limit`]: 8 GiB.
    pub const LIMIT: u64 = 8 << 30;
}

/// What the cache did for a bake.
#[derive(Debug, Clone, Serialize)]
pub struct CacheReport {
    /// Number of meshes whose charts were reused, and number whose charts were stored.
    pub charts: [u64; 2],
    /// Files deleted because the folder exceeded its limit.
    pub removed: u64,
    /// Problems with the folder; the bake continues without the cache.
    pub notes: Vec<String>,
}

/// Extension of cache files.
const CHARTS: &str = "lumelcharts";

/// Longest cache file that is read, bytes: charts of far more triangles than are unwrapped.
const MAX_CHARTS: u64 = 4 << 30;

/// Prefix and suffix of temporary files.
const PART: [&str; 2] = [".lumel-", ".part"];

/// Age from which a temporary file belongs to a killed bake. Writing takes seconds.
const STALE: Duration = Duration::from_secs(3600);

/// Cached charts of meshes, one file per mesh.
pub(crate) struct Charts<'a> {
    cache: &'a Cache,
    found: AtomicU64,
    kept: AtomicU64,
    /// Why the first failed write failed.
    fault: Mutex<Option<String>>,
}

impl<'a> Charts<'a> {
    pub(crate) fn new(cache: &'a Cache) -> Self {
        Charts {
            cache,
            found: AtomicU64::new(0),
            kept: AtomicU64::new(0),
            fault: Mutex::new(None),
        }
    }

    /// The hash includes the program, because another version may unwrap differently.
    fn path(&self, key: &[u8; 32]) -> PathBuf {
        let mut h = blake3::Hasher::new();
        h.update(PROGRAM.as_bytes());
        h.update(key);
        let hex = h.finalize().to_hex();
        self.cache.folder.join(format!("{}.{CHARTS}", &hex[..32]))
    }

    /// Trims the folder to its limit and reports what was done.
    pub(crate) fn close(self) -> CacheReport {
        let mut notes: Vec<String> = self.fault.into_inner().ok().flatten().into_iter().collect();
        let folder = &self.cache.folder;
        let removed = match trim(folder, self.cache.limit) {
            Ok(removed) => removed,
            // Either nothing was stored, or a note about the folder exists already.
            Err(_) if !folder.is_dir() => 0,
            Err(e) => {
                notes.push(format!(
                    "{}: cannot delete old files: {e}",
                    folder.display()
                ));
                0
            }
        };
        CacheReport {
            charts: [self.found.into_inner(), self.kept.into_inner()],
            removed,
            notes,
        }
    }

    /// Writes to a temporary file and renames it, so that readers never see half a file.
    fn write(&self, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
        std::fs::create_dir_all(&self.cache.folder)?;
        let mut file = tempfile::Builder::new()
            .prefix(PART[0])
            .suffix(PART[1])
            .tempfile_in(&self.cache.folder)?;
        file.write_all(bytes)?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    }
}

impl KeptCharts for Charts<'_> {
    fn load(&self, key: &[u8; 32]) -> Option<Vec<u8>> {
        let path = self.path(key);
        let bytes = read_regular(&path, MAX_CHARTS).ok()?;
        touch(&path);
        Some(bytes)
    }

    fn used(&self) {
        self.found.fetch_add(1, Ordering::Relaxed);
    }

    fn save(&self, key: &[u8; 32], bytes: &[u8]) {
        match self.write(&self.path(key), bytes) {
            Ok(()) => {
                self.kept.fetch_add(1, Ordering::Relaxed);
            }
            Err(e) => {
                if let Ok(mut fault) = self.fault.lock() {
                    let text =
                        || format!("{}: cannot cache charts: {e}", self.cache.folder.display());
                    fault.get_or_insert_with(text);
                }
            }
        }
    }
}

/// Charts of a bake that may begin again with a changed document: most meshes are the same then.
#[derive(Debug, Default)]
pub(crate) struct Remembered {
    charts: Mutex<BTreeMap<[u8; 32], Vec<u8>>>,
}

impl Remembered {
    /// Frees their memory.
    pub(crate) fn forget(&self) {
        if let Ok(mut charts) = self.charts.lock() {
            charts.clear();
        }
    }
}

impl KeptCharts for Remembered {
    fn load(&self, key: &[u8; 32]) -> Option<Vec<u8>> {
        self.charts.lock().ok()?.remove(key)
    }

    fn save(&self, key: &[u8; 32], bytes: &[u8]) {
        if let Ok(mut charts) = self.charts.lock() {
            charts.insert(*key, bytes.to_vec());
        }
    }
}

/// Marks a file as just used, for trimming. Failure is harmless, e.g. on file systems without
/// access times.
fn touch(path: &Path) {
    if let Ok(file) = std::fs::File::options().append(true).open(path) {
        let _ = file.set_modified(SystemTime::now());
    }
}

/// Deletes temporary files of killed bakes, and the least recently used files until the total size
/// is within `limit`.
fn trim(folder: &Path, limit: u64) -> std::io::Result<u64> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        let (is_charts, is_part) = (
            path.extension().is_some_and(|e| e == CHARTS),
            is_part(&path),
        );
        let Ok(m) = entry.metadata() else { continue };
        let used = m.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        if is_charts {
            files.push((used, path, m.len()));
        } else if is_part && used.elapsed().is_ok_and(|age| age > STALE) {
            std::fs::remove_file(&path)?;
        }
    }
    files.sort();
    let mut all: u64 = files.iter().map(|f| f.2).sum();
    let mut removed = 0;
    for (.., path, size) in files {
        if all <= limit {
            break;
        }
        std::fs::remove_file(&path)?;
        all -= size;
        removed += 1;
    }
    Ok(removed)
}

fn is_part(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(|name| name.starts_with(PART[0]) && name.ends_with(PART[1]))
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn temporary_files_of_killed_bakes_go() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str, age: Duration| {
            let path = folder.path().join(name);
            std::fs::write(&path, "x").expect("written");
            let file = File::options()
                .append(true)
                .open(&path)
                .expect("it is there");
            let then = SystemTime::now() - age;
            file.set_modified(then).expect("its own file");
            path
        };
        let dead = file(".lumel-a.part", 2 * STALE);
        let alive = file(".lumel-b.part", Duration::ZERO);
        let foreign = file("b.part", 2 * STALE);
        trim(folder.path(), 0).expect("its own folder");
        assert!(!dead.exists() && alive.exists() && foreign.exists());
    }
}
