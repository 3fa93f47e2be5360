//! Errors of a bake.

use std::path::PathBuf;

/// Failure of a bake, by fault. [`exit_code`](Error::exit_code) is the exit code of the command
/// line.
///
/// ```
/// let error = lumel::Baker::new().bake("missing.glb").unwrap_err();
/// assert_eq!(error.exit_code(), 2);
/// assert!(error.to_string().contains("missing.glb"));
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene cannot be read.
    #[error(transparent)]
    Ingest(#[from] mesh_ingest::Error),
    /// The lightmap cannot be planned.
    #[error("{}: {source}", file.display())]
    Layout {
        /// The scene.
        file: PathBuf,
        /// Why.
        source: atlas::LayoutError,
    },
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] atlas_bake::Error),
    /// The sky image cannot be used.
    #[error("{}: {message}", file.display())]
    Sky {
        /// The image.
        file: PathBuf,
        /// Why.
        message: String,
        /// Whether the file could not be read at all.
        io: bool,
    },
    /// The list of probe positions cannot be used.
    #[error("{}: {message}", file.display())]
    Probes {
        /// The list.
        file: PathBuf,
        /// Why.
        message: String,
        /// Whether the file could not be read at all.
        io: bool,
    },
    /// A settings file cannot be used.
    #[error("{}{message}", file.display())]
    Config {
        /// The file.
        file: PathBuf,
        /// Place and reason: `:LINE:COLUMN: found …, expected …`.
        message: String,
        /// Whether the file could not be read at all.
        io: bool,
    },
    /// Two images cannot be compared.
    #[error("{} and {}: {source}", a.display(), b.display())]
    Compare {
        /// The reference.
        a: PathBuf,
        /// The image compared with it.
        b: PathBuf,
        /// Why.
        source: atlas_bake::Error,
    },
    /// A folder contains no finished bake, or a broken one.
    #[error("{}: {message}", path.display())]
    Folder {
        /// The folder, or a file in it.
        path: PathBuf,
        /// Why.
        message: String,
        /// Whether it could not be read at all.
        io: bool,
    },
    /// The viewer's port is not available.
    #[error("port {port} of 127.0.0.1: {message}")]
    Port {
        /// The port; 0 for any.
        port: u16,
        /// Why.
        message: String,
    },
    /// A result would replace a file that does not belong to the bake.
    #[error("{}: the bake would replace this file, but {why}; choose another folder or name", file.display())]
    Overwrite {
        /// The file.
        file: PathBuf,
        /// Whose file it is.
        why: String,
    },
    /// A light is brighter than any real one.
    #[error(
        "{what} is {value:e}, expected at most {:e} (candela, lux or radiance)",
        crate::brightness::BRIGHTEST
    )]
    TooBright {
        /// The light.
        what: String,
        /// Its largest channel after scaling.
        value: f32,
    },
    /// The bake would need more memory than allowed.
    #[error("the bake needs about {} MiB, expected at most {} MiB (--memory); {}", needed >> 20, allowed >> 20, what_fits(*fits))]
    Memory {
        /// Estimated memory, bytes.
        needed: u64,
        /// Allowed memory, bytes.
        allowed: u64,
        /// Lumels per metre that would fit, if any.
        fits: Option<f64>,
    },
    /// The scene is too large to be read within the allowed memory.
    #[error("{source} (--memory is {} MiB)", allowed >> 20)]
    TooLarge {
        /// What is too large.
        source: mesh_ingest::Error,
        /// Allowed memory, bytes.
        allowed: u64,
    },
    /// The scene's name cannot become part of the results' names.
    #[error("{}: found a file name that is not UTF-8, expected UTF-8, because results are named after the scene", file.display())]
    Name {
        /// The scene.
        file: PathBuf,
    },
    /// A setting is out of range.
    #[error("{0}")]
    Setting(String),
    /// The bake was cancelled.
    #[error("cancelled; files of earlier bakes are unchanged")]
    Cancelled,
    /// An invariant of Lumel was violated.
    #[error("internal error: {0}")]
    Internal(String),
}

fn what_fits(density: Option<f64>) -> String {
    match density {
        Some(x) => format!("--texels-per-unit {:.3} would fit", x),
        None => "no density would fit".into(),
    }
}

impl Error {
    /// Exit code: 1 wrong usage, 2 input/output failure, 3 invalid input, 4 unsupported feature, 70
    /// bug in Lumel, 75 cancelled and worth retrying.
    pub fn exit_code(&self) -> i32 {
        match self {
            Error::Ingest(e) => e.exit_code(),
            Error::Layout { source, .. } => match source {
                atlas::LayoutError::Cancelled => 75,
                atlas::LayoutError::Option { .. } => 1,
                _ => 3,
            },
            Error::Output(atlas_bake::Error::Document(e)) => e.exit_code(),
            Error::Output(atlas_bake::Error::Limit { .. } | atlas_bake::Error::Image { .. })
            | Error::Compare { .. }
            | Error::TooBright { .. }
            | Error::Name { .. }
            | Error::Memory { .. }
            | Error::TooLarge { .. } => 3,
            Error::Output(_) | Error::Port { .. } | Error::Overwrite { .. } => 2,
            Error::Sky { io, .. }
            | Error::Probes { io, .. }
            | Error::Config { io, .. }
            | Error::Folder { io, .. } => {
                if *io {
                    2
                } else {
                    3
                }
            }
            Error::Setting(_) => 1,
            Error::Cancelled => 75,
            // EX_SOFTWARE of sysexits.h.
            Error::Internal(_) => 70,
        }
    }
}
