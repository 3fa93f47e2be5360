//! Sources of a document's bytes and of the files that it references: a folder, or the caller's
//! memory.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::container;
use crate::error::{Fault, Outcome};
use crate::regular::open_regular;
use crate::uri::{self, Bounds, Target};

/// Returns the bytes of a file by its name in the document.
type Resolver = dyn Fn(&str) -> io::Result<Vec<u8>> + Send + Sync;

/// The files that a document references.
#[derive(Debug, Clone)]
pub(crate) struct Files {
    place: Location,
    /// Whether `..` and links may lead out of the document's folder.
    outside: bool,
}

/// Location of the files.
#[derive(Clone)]
enum Location {
    /// In this folder, by relative path.
    Folder(PathBuf),
    /// Provided by the caller, by name.
    Resolver(Arc<Resolver>),
}

impl fmt::Debug for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Location::Folder(folder) => f.debug_tuple("Folder").field(folder).finish(),
            Location::Resolver(_) => f.write_str("Resolver"),
        }
    }
}

impl Files {
    /// Files in `folder`, and only there until [`allow_outside`](Files::allow_outside).
    pub fn in_folder(folder: PathBuf) -> Files {
        Files {
            place: Location::Folder(folder),
            outside: false,
        }
    }

    fn with(resolver: Arc<Resolver>) -> Files {
        Files {
            place: Location::Resolver(resolver),
            outside: false,
        }
    }

    /// Whether `..` and links may lead out of the document's folder.
    pub fn allow_outside(mut self, yes: bool) -> Files {
        self.outside = yes;
        self
    }

    /// The folder; `None` if the caller provides files by name.
    pub fn folder(&self) -> Option<&Path> {
        match &self.place {
            Location::Folder(folder) => Some(folder),
            Location::Resolver(_) => None,
        }
    }

    /// Resolves `uri`, found at document path `path`; the result may be a path for [`Files::read`].
    pub fn resolve(&self, uri: &str, path: &str) -> Outcome<Target> {
        let bounds = Bounds {
            base: self.folder(),
            outside: self.outside,
        };
        uri::resolve(uri, bounds, path)
    }

    /// The bytes of a file, at most `limit` of them; `path` is the place in the document that
    /// references it.
    pub fn read(&self, file: &Path, path: &str, limit: u64) -> Outcome<Vec<u8>> {
        let Location::Resolver(resolver) = &self.place else {
            return container::read_file(file, path, limit);
        };
        let bytes = resolver(&file.to_string_lossy()).map_err(|e| Fault::io(path, file, e))?;
        if bytes.len() as u64 > limit {
            return Err(Fault::limit(
                path,
                format!("{} with {} bytes", file.display(), bytes.len()),
                format!("at most {limit}"),
            ));
        }
        Ok(bytes)
    }

    /// Whether the file exists and can be opened.
    pub fn check(&self, file: &Path) -> io::Result<()> {
        match &self.place {
            Location::Folder(_) => open_regular(file).map(drop),
            Location::Resolver(resolver) => resolver(&file.to_string_lossy()).map(drop),
        }
    }
}

/// A glTF 2.0 document in memory (.gltf or .glb), and where to find the files that it references.
///
/// ```
/// use mesh_ingest::{LoadOptions, MemoryDocument, load_memory};
///
/// let document = MemoryDocument::new("level.gltf", *br#"{"asset": {"version": "2.0"}}"#);
/// // It contains nothing to bake.
/// let error = load_memory(&document, &LoadOptions::default()).unwrap_err();
/// assert_eq!(error.exit_code(), 3);
/// ```
#[derive(Debug, Clone)]
pub struct MemoryDocument {
    pub(crate) name: PathBuf,
    pub(crate) bytes: Vec<u8>,
    pub(crate) files: Files,
}

impl MemoryDocument {
    /// A document that references no other files (a .glb, or a .gltf with only data URIs).
    ///
    /// `name` stands for a file name in errors and reports; results are named after its stem.
    pub fn new(name: impl Into<PathBuf>, bytes: impl Into<Vec<u8>>) -> MemoryDocument {
        MemoryDocument {
            name: name.into(),
            bytes: bytes.into(),
            files: Files::with(Arc::new(|_| {
                Err(io::Error::new(
                    io::ErrorKind::NotFound,
                    "the document is in memory and references files, but has no folder or resolver for them",
                ))
            })),
        }
    }

    /// Reads its files from `folder`, by the relative paths in the document.
    #[must_use]
    pub fn beside(mut self, folder: impl Into<PathBuf>) -> MemoryDocument {
        self.files = Files::in_folder(folder.into());
        self
    }

    /// Reads its files through `resolver`, which receives the percent-decoded name from the
    /// document (`textures/old wood.png`). It may be called from any thread and several times for
    /// the same name, and must return the same bytes each time.
    #[must_use]
    pub fn resolve_with(
        mut self,
        resolver: impl Fn(&str) -> io::Result<Vec<u8>> + Send + Sync + 'static,
    ) -> MemoryDocument {
        self.files = Files::with(Arc::new(resolver));
        self
    }

    /// The name that stands for a file name.
    pub fn name(&self) -> &Path {
        &self.name
    }
}
