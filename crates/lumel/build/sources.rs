//! Puts a hash of the workspace's sources into `LUMEL_SOURCES`.
//!
//! A development build has the version number of the last release. Keys of records and caches
//! therefore contain this hash besides the version.

use std::path::{Path, PathBuf};

pub(crate) fn write() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files = vec![root.join("Cargo.lock")];
    // A published crate has no sibling crates; their versions are in the lock file.
    for folder in [
        "mesh-ingest",
        "visibility",
        "patch-subdivision",
        "radiosity",
        "atlas",
        "gather",
        "atlas-bake",
    ] {
        collect(&root.join("crates").join(folder).join("src"), &mut files);
    }
    collect(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("src"),
        &mut files,
    );
    files.sort();
    let mut hash = Fnv::new();
    for file in &files {
        println!("cargo::rerun-if-changed={}", file.display());
        if let Ok(bytes) = std::fs::read(file) {
            // Checkouts on Windows have other line ends, but compile to the same program.
            hash.add(bytes.iter().copied().filter(|b| *b != b'\r'));
            hash.add([0]);
        }
    }
    println!("cargo::rustc-env=LUMEL_SOURCES={:016x}", hash.0);
}

/// Adds the Rust files below `folder`, and the folder itself so that new files are noticed.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    println!("cargo::rerun-if-changed={}", folder.display());
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// FNV-1a, 64 bits: detects changes, but is not secure against forgery.
struct Fnv(u64);

impl Fnv {
    fn new() -> Self {
        Fnv(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for b in bytes {
            self.0 = (self.0 ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}
