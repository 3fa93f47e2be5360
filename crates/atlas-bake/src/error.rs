//! What can go wrong between a solved scene and the files on disk.

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
        /// What the system said.
        source: std::io::Error,
    },
    /// An output's name is not a plain file name, or names a folder that exists.
    #[error("{path} cannot be an output file: {why}", path = path.display())]
    OutputName {
        /// The name as given.
        path: PathBuf,
        /// What is wrong with it.
        why: &'static str,
    },
    /// A file is not an OpenEXR image that can be read, or an image could not be encoded.
    #[error("{what}: {message}")]
    Image {
        /// File or image concerned.
        what: String,
        /// What the codec said.
        message: String,
    },
    /// Two images that must have one size have two.
    #[error("sizes differ: {a_w}x{a_h} against {b_w}x{b_h}", a_w = a[0], a_h = a[1], b_w = b[0], b_h = b[1])]
    SizeMismatch {
        /// Size of the first, texels.
        a: [u32; 2],
        /// Size of the second, texels.
        b: [u32; 2],
    },
    /// Something is larger than this program is willing to handle.
    #[error("{what} is {got}, more than the limit of {max}")]
    Limit {
        /// The quantity, with its unit.
        what: &'static str,
        /// Its value.
        got: u64,
        /// The most that is accepted.
        max: u64,
    },
    /// The scene's document cannot be read (again).
    #[error(transparent)]
    Document(#[from] mesh_ingest::Error),
    /// The parts handed in do not belong together (a vertex out of range, a list of the wrong
    /// length).
    #[error("{at}: {message}")]
    Inconsistent {
        /// Document path or the name of the part.
        at: String,
        /// Expected and got.
        message: String,
    },
}

/// Result with this crate's [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;
