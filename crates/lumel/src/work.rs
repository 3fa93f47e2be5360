//! Work folders, through which `lumel solve` passes its results to other processes.
//!
//! | file | holds |
//! |---|---|
//! | `work.json` | the command, hashes of everything read and written, lumels by instance |
//! | `solution.bin` | the light of patches, in postcard's format |
//! | `charts/` | charts of large meshes, as `--cache` stores them |
//! | `shard-I-of-N.light` | the light of shard I |
//!
//! Everything else follows from the scene: each process rebuilds patches, tree and layout
//! identically.

use std::path::{Path, PathBuf};

use atlas::Layout;
use mesh_ingest::{Cut, Digest, open_regular, read_regular};
use radiosity::StoredSolution;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::open::Changes;
use crate::record::PROGRAM;

/// Raised when the format of the folder changes.
const FORMAT: u32 = 3;

/// Name of the file that describes the work.
pub(crate) const WORK: &str = "work.json";

/// Name of the file with the solution, and of the folder with charts.
pub(crate) const SOLUTION: &str = "solution.bin";
pub(crate) const CHARTS: &str = "charts";

/// Longest description that is read, bytes: a million instances.
const MAX_WORK: u64 = 64 << 20;

/// Longest solution that is read, bytes.
const MAX_SOLUTION: u64 = 16 << 30;

/// Placeholder of the seal while it is computed.
const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// A recorded `lumel solve` command, from which other processes take the same settings.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Told {
    /// The folder in which it ran.
    pub folder: String,
    /// Its arguments, without the program and the command.
    pub arguments: Vec<String>,
}

/// A file and its hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Hashed {
    pub file: String,
    /// Null if the file did not exist.
    pub digest: Option<String>,
}

/// The description of a work folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Description {
    pub format: u32,
    pub program: String,
    pub told: Told,
    /// Hash of program, settings and inputs: [`Record::key`](crate::Record::key).
    pub key: String,
    /// Files that were read.
    pub inputs: Vec<Hashed>,
    /// Files that were written beside this one.
    pub files: Vec<Hashed>,
    /// Primitives (mesh, primitive) that got separate faces for their two sides.
    pub split: Vec<(usize, usize)>,
    /// Cuts under thin walls.
    pub cuts: Vec<Cut>,
    /// Whether the solution is that of the document before these cuts.
    pub carried: bool,
    /// Hash of the layout.
    pub layout: String,
    /// Lumels of each instance.
    pub lumels: Vec<u32>,
    /// Hash of everything above.
    pub seal: String,
}

impl Description {
    pub(crate) fn new(told: Told, key: String, inputs: Vec<Hashed>) -> Description {
        Description {
            format: FORMAT,
            program: PROGRAM.into(),
            told,
            key,
            inputs,
            files: Vec::new(),
            split: Vec::new(),
            cuts: Vec::new(),
            carried: false,
            layout: String::new(),
            lumels: Vec::new(),
            seal: String::new(),
        }
    }

    /// Changes of the document.
    pub(crate) fn changes(&self) -> Changes {
        Changes {
            split: self.split.iter().copied().collect(),
            cuts: self.cuts.clone(),
        }
    }

    /// The bytes of the file, sealed.
    pub(crate) fn to_json(&self) -> Vec<u8> {
        let with = |seal: String| {
            let sealed = Description {
                seal,
                ..self.clone()
            };
            serde_json::to_string_pretty(&sealed).unwrap_or_default() + "\n"
        };
        with(Digest::of(with(BLANK.into()).as_bytes()).to_string()).into_bytes()
    }
}

/// A work folder whose description and files were checked.
#[derive(Debug, Clone)]
pub struct WorkFolder {
    pub(crate) folder: PathBuf,
    pub(crate) description: Description,
    /// The seal of its description.
    pub(crate) digest: Digest,
}

fn fault(path: &Path, message: impl Into<String>, io: bool) -> Error {
    Error::Folder {
        path: path.to_owned(),
        message: message.into(),
        io,
    }
}

impl WorkFolder {
    /// Opens a folder that `lumel solve` wrote, and checks everything in it except shards.
    ///
    /// # Errors
    /// [`Error::Folder`].
    pub fn open(folder: &Path) -> Result<WorkFolder, Error> {
        let path = folder.join(WORK);
        let bytes = read_regular(&path, MAX_WORK).map_err(|e| fault(&path, e.to_string(), true))?;
        let damaged = || {
            let message = "found a damaged file, expected what `lumel solve` wrote; solve again";
            fault(&path, message, false)
        };
        #[derive(Deserialize)]
        struct Head {
            format: u32,
            program: String,
        }
        let head: Head = serde_json::from_slice(&bytes).map_err(|_| damaged())?;
        if head.format != FORMAT || head.program != PROGRAM {
            let Head { format, program } = head;
            let message = format!(
                "found a work of lumel {program} (format {format}), expected one of lumel {PROGRAM} \
                 (format {FORMAT}); solve again"
            );
            return Err(fault(&path, message, false));
        }
        let description: Description = serde_json::from_slice(&bytes).map_err(|_| damaged())?;
        let digest: Digest = description.seal.parse().map_err(|_| damaged())?;
        if description.to_json() != bytes {
            return Err(damaged());
        }
        let work = WorkFolder {
            folder: folder.to_owned(),
            description,
            digest,
        };
        work.check_files()?;
        Ok(work)
    }

    /// Checks the files listed in the description.
    fn check_files(&self) -> Result<(), Error> {
        for Hashed { file, digest } in &self.description.files {
            let path = self.folder.join(file);
            let read = open_regular(&path).and_then(Digest::of_reader);
            let found = read.map_err(|e| fault(&path, e.to_string(), true))?;
            if digest.as_ref() != Some(&found.to_string()) {
                let message =
                    "found a damaged file, expected what `lumel solve` wrote; solve again";
                return Err(fault(&path, message, false));
            }
        }
        Ok(())
    }

    /// The command that wrote it.
    pub fn told(&self) -> &Told {
        &self.description.told
    }

    /// Refuses inputs and settings that differ from those that were solved.
    pub(crate) fn check_inputs(&self, key: &str, inputs: &[Hashed]) -> Result<(), Error> {
        let mut known = self.description.inputs.iter();
        for input in inputs {
            if known.next() != Some(input) {
                let path = Path::new(&input.file);
                let message = "the file changed since `lumel solve`; solve again";
                return Err(fault(path, message, false));
            }
        }
        if key != self.description.key || known.next().is_some() {
            let message = "the settings or inputs changed since `lumel solve`; solve again";
            return Err(fault(&self.folder, message, false));
        }
        Ok(())
    }

    /// Refuses a layout that differs from the one that was solved.
    pub(crate) fn check_layout(&self, layout: &Layout) -> Result<(), Error> {
        if layout_digest(layout) == self.description.layout {
            return Ok(());
        }
        let message = "this machine makes other charts than the one that solved";
        Err(fault(&self.folder, message, false))
    }

    /// The light of the solution.
    pub(crate) fn solution(&self) -> Result<(StoredSolution, PathBuf), Error> {
        let path = self.folder.join(SOLUTION);
        let bytes = read_regular(&path, MAX_SOLUTION);
        let bytes = bytes.map_err(|e| fault(&path, e.to_string(), true))?;
        match postcard::from_bytes(&bytes) {
            Ok(solution) => Ok((solution, path)),
            Err(_) => Err(fault(&path, "the file changed while it was read", false)),
        }
    }
}

/// Hash of the layout, which determines the lumels.
pub(crate) fn layout_digest(layout: &Layout) -> String {
    let mut h = blake3::Hasher::new();
    let mut put = |x: &[u32]| {
        h.update(&(x.len() as u64).to_le_bytes());
        x.iter().for_each(|x| {
            h.update(&x.to_le_bytes());
        });
    };
    layout.pages.iter().for_each(|size| put(size));
    for p in &layout.placements {
        put(&[p.page, p.rect.x, p.rect.y, p.rect.w, p.rect.h]);
    }
    for primitive in layout.meshes.iter().flat_map(|m| &m.primitives) {
        put(&primitive.xref);
        put(&primitive.chart);
        for uv in &primitive.uv {
            put(&[uv.x.to_bits(), uv.y.to_bits()]);
        }
        primitive.triangles.iter().for_each(|t| put(t));
    }
    h.finalize().to_hex().to_string()
}

/// Hashes of the files in a folder, sorted by name; names include the folder's.
pub(crate) fn hashes_in(folder: &Path) -> Result<Vec<Hashed>, Error> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Ok(Vec::new()); // No mesh was large enough.
    };
    let mut names: Vec<String> = entries
        .filter_map(|e| e.ok()?.file_name().into_string().ok())
        .filter(|name| !name.starts_with('.'))
        .collect();
    names.sort();
    let of = |name: String| {
        let path = folder.join(&name);
        let read = open_regular(&path).and_then(Digest::of_reader);
        let digest = read.map_err(|e| fault(&path, e.to_string(), true))?;
        Ok(Hashed {
            file: format!("{CHARTS}/{name}"),
            digest: Some(digest.to_string()),
        })
    };
    names.into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_description_is_known_by_its_seal() {
        let told = Told {
            folder: "/levels".into(),
            arguments: vec!["a.glb".into()],
        };
        let description = Description::new(told, "key".into(), Vec::new());
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(WORK);
        std::fs::write(&path, description.to_json()).expect("written");
        assert!(WorkFolder::open(folder.path()).is_ok());
        let text = String::from_utf8(description.to_json()).expect("UTF-8");
        std::fs::write(&path, text.replace("a.glb", "b.glb")).expect("written");
        let error = WorkFolder::open(folder.path()).expect_err("changed");
        assert!(error.to_string().contains("damaged"), "{error}");
        std::fs::write(&path, text.replace(PROGRAM, "0.0.1")).expect("written");
        let error = WorkFolder::open(folder.path()).expect_err("of another version");
        assert!(error.to_string().contains("lumel 0.0.1"), "{error}");
    }
}
