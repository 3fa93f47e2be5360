//! Errors between a solved scene and files on disk.

use std::path::PathBuf;

/// Failure of this crate, by fault.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read, written or renamed.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// An output's name is not a plain file name, or is the name of an existing folder.
    #[error("{path} cannot be an output file: {why}", path = path.display())]
    OutputName {
        /// The name as given.
        path: PathBuf,
        /// The fault.
        why: &'static str,
    },
    /// A file is not a readable OpenEXR image, or an image could not be encoded.
    #[error("{what}: {message}")]
    Image {
        /// The file or image.
        what: String,
        /// The codec's message.
        message: String,
    },
    /// Two images that must have the same size differ.
    #[error("sizes differ: {a_w} x {a_h} and {b_w} x {b_h}", a_w = a[0], a_h = a[1], b_w = b[0], b_h = b[1])]
    SizeMismatch {
        /// Size of the first, texels.
        a: [u32; 2],
        /// Size of the second, texels.
        b: [u32; 2],
    },
    /// A size exceeds this program's limit.
    #[error("{what} is {got}, more than the limit of {max}")]
    Limit {
        /// The quantity, with its unit.
        what: &'static str,
        /// Its value.
        got: u64,
        /// The limit.
        max: u64,
    },
    /// The scene's document could not be read (again).
    #[error(transparent)]
    Document(#[from] mesh_ingest::Error),
    /// Arguments that do not fit together, e.g. a vertex out of range or a list of the wrong
    /// length.
    #[error("{at}: {message}")]
    Inconsistent {
        /// Document path or the name of the part.
        at: String,
        /// What was expected and what was found.
        message: String,
    },
}

/// Result with this crate's [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;
