//! What can go wrong in a bake.

use std::path::PathBuf;

/// Failure of a bake, by fault; [`exit_code`](Error::exit_code) is what the command line returns
/// for it.
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
    /// Results cannot be put into files.
    #[error(transparent)]
    Output(#[from] atlas_bake::Error),
    /// The sky image cannot be used.
    #[error("{}: {message}", file.display())]
    Sky {
        /// The image.
        file: PathBuf,
        /// Why.
        message: String,
        /// It could not be read at all.
        io: bool,
    },
    /// The list of probes' points cannot be used.
    #[error("{}: {message}", file.display())]
    Probes {
        /// The list.
        file: PathBuf,
        /// Why.
        message: String,
        /// It could not be read at all.
        io: bool,
    },
    /// A file of settings cannot be used.
    #[error("{}{message}", file.display())]
    Config {
        /// The file.
        file: PathBuf,
        /// Where in it and why: `:LINE:COLUMN: found …, expected …`.
        message: String,
        /// It could not be read at all.
        io: bool,
    },
    /// Two images cannot be compared.
    #[error("{} and {}: {source}", a.display(), b.display())]
    Compare {
        /// The reference.
        a: PathBuf,
        /// The other.
        b: PathBuf,
        /// Why.
        source: atlas_bake::Error,
    },
    /// A folder holds no finished bake, or a broken one.
    #[error("{}: {message}", path.display())]
    Folder {
        /// The folder, or the file in it.
        path: PathBuf,
        /// Why.
        message: String,
        /// It could not be read at all.
        io: bool,
    },
    /// The viewer's port cannot be had.
    #[error("port {port} of 127.0.0.1: {message}")]
    Port {
        /// Which; 0 for any.
        port: u16,
        /// Why.
        message: String,
    },
    /// A result would replace a file that is not the bake's.
    #[error("{}: the bake would replace this file, and {why}; give another folder or name", file.display())]
    Overwrite {
        /// The file.
        file: PathBuf,
        /// Whose it is.
        why: String,
    },
    /// A light is brighter than anything is.
    #[error(
        "{what} is {value:e}, expected at most {:e} (candela, lux or radiance)",
        crate::brightness::BRIGHTEST
    )]
    TooBright {
        /// Which.
        what: String,
        /// Its largest channel, as it was to be baked.
        value: f32,
    },
    /// The bake would need more memory than it may take.
    #[error("the bake needs about {} MiB, expected at most {} MiB (--memory); {}", needed >> 20, allowed >> 20, what_fits(*fits))]
    Memory {
        /// Estimate, bytes.
        needed: u64,
        /// Bytes.
        allowed: u64,
        /// Lumels per metre that would fit, if any.
        fits: Option<f64>,
    },
    /// The scene is larger than what the bake may take lets it be.
    #[error("{source} (--memory is {} MiB)", allowed >> 20)]
    TooLarge {
        /// What is too large.
        source: mesh_ingest::Error,
        /// Bytes.
        allowed: u64,
    },
    /// The scene's name cannot be part of other names.
    #[error("{}: found a file name that is not UTF-8, expected one that results can be named after", file.display())]
    Name {
        /// The scene.
        file: PathBuf,
    },
    /// A setting is out of its range.
    #[error("{0}")]
    Setting(String),
    /// The work was stopped.
    #[error("cancelled; files of earlier bakes are as they were")]
    Cancelled,
    /// An invariant of Lumel's own does not hold.
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
    /// Exit code by DESIGN.md §1.1: 1 usage, 2 input/output, 3 invalid input, 4 unsupported
    /// feature, 75 stopped and worth retrying.
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
            // EX_SOFTWARE of sysexits.h: no promise of DESIGN.md covers a bug.
            Error::Internal(_) => 70,
        }
    }
}
