//! Errors in assets, by fault, file and place in the document.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

/// One fault in a document.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Document path: `meshes[0].primitives[1].indices`. Empty for the whole file.
    pub path: String,
    /// What was found.
    pub found: String,
    /// What was expected, or how to fix it.
    pub expected: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.path.is_empty() {
            write!(f, "{}: ", short(&self.path))?;
        }
        let (found, expected) = (short(&self.found), short(&self.expected));
        write!(f, "found {found}, expected {expected}")
    }
}

/// `text` on one line and without control characters or changes of writing direction, which become
/// `\u{1b}` and the like. For names and values from documents, which may contain anything.
pub fn printable(text: &str) -> Cow<'_, str> {
    let obeyed =
        |c: char| c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if obeyed(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// As [`printable`], truncated after `most` characters.
pub fn printable_within(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        Some((cut, _)) => Cow::Owned(format!("{}…", printable(&text[..cut]))),
        None => printable(text),
    }
}

/// A part of a message, truncated if it would fill a screen.
fn short(text: &str) -> Cow<'_, str> {
    // Longer than any of the project's own messages.
    printable_within(text, 400)
}

/// Why an asset cannot be loaded.
///
/// [`load`](crate::load) collects as many problems as possible before it fails. The variant is that
/// of the most serious one (invalid, then io, unsupported, limit) and lists all problems of that
/// kind.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read.
    #[error("{}: {}{source}", file.display(), at(path))]
    Io {
        /// The file that could not be read.
        file: PathBuf,
        /// Document path that names it; empty for the document itself.
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// The document violates the glTF 2.0 specification in a way that affects baking.
    #[error("{}: invalid glTF: {}", file.display(), all(problems))]
    Invalid {
        /// The document.
        file: PathBuf,
        /// At least one.
        problems: Vec<Problem>,
    },
    /// The document is valid but requires something that Lumel does not support.
    #[error("{}: not supported: {}", file.display(), all(problems))]
    Unsupported {
        /// The document.
        file: PathBuf,
        /// At least one; `expected` describes a workaround.
        problems: Vec<Problem>,
    },
    /// The document exceeds [`Limits`](crate::Limits).
    #[error("{}: too large: {}", file.display(), all(problems))]
    Limit {
        /// The document.
        file: PathBuf,
        /// At least one.
        problems: Vec<Problem>,
    },
    /// The document is valid but has no surface that could receive light.
    #[error("{}: no triangles to bake: {why}", file.display())]
    NoTriangles {
        /// The document.
        file: PathBuf,
        /// What was found instead.
        why: String,
    },
}

impl Error {
    /// The exit code of the command line: 2 input/output, 3 invalid (also too large, and nothing to
    /// bake), 4 unsupported.
    pub fn exit_code(&self) -> i32 {
        match self {
            Error::Io { .. } => 2,
            Error::Invalid { .. } | Error::Limit { .. } | Error::NoTriangles { .. } => 3,
            Error::Unsupported { .. } => 4,
        }
    }

    /// The document's problems; empty for variants without any.
    pub fn problems(&self) -> &[Problem] {
        match self {
            Error::Invalid { problems, .. }
            | Error::Unsupported { problems, .. }
            | Error::Limit { problems, .. } => problems,
            Error::Io { .. } | Error::NoTriangles { .. } => &[],
        }
    }
}

fn at(path: &str) -> String {
    if path.is_empty() {
        String::new()
    } else {
        format!("named by {path}: ")
    }
}

/// A single problem on the same line; several on one line each, so that a terminal shows them
/// completely.
fn all(problems: &[Problem]) -> String {
    /// More would scroll the first, usually the cause, out of sight.
    const SHOWN: usize = 20;
    match problems {
        [one] => one.to_string(),
        many => {
            let mut text = format!("{} problems", many.len());
            for problem in many.iter().take(SHOWN) {
                text.push_str(&format!("\n  {problem}"));
            }
            if many.len() > SHOWN {
                text.push_str(&format!("\n  and {} more", many.len() - SHOWN));
            }
            text
        }
    }
}

/// The kind of an internal fault. Mirrors [`Error`]'s variants, most serious first.
#[derive(Debug)]
pub(crate) enum Kind {
    Invalid,
    Io(PathBuf, io::Error),
    Unsupported,
    Limit,
}

/// A problem with its kind, before the file and related problems are known.
#[derive(Debug)]
pub(crate) struct Fault {
    pub kind: Kind,
    pub problem: Problem,
}

pub(crate) type Outcome<T> = Result<T, Fault>;

impl Fault {
    fn new(
        kind: Kind,
        path: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Fault {
        Fault {
            kind,
            problem: Problem {
                path: path.into(),
                found: found.into(),
                expected: expected.into(),
            },
        }
    }

    pub fn invalid(
        path: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Fault {
        Fault::new(Kind::Invalid, path, found, expected)
    }

    pub fn unsupported(
        path: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Fault {
        Fault::new(Kind::Unsupported, path, found, expected)
    }

    pub fn limit(
        path: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Fault {
        Fault::new(Kind::Limit, path, found, expected)
    }

    pub fn io(path: impl Into<String>, file: &Path, source: io::Error) -> Fault {
        let found = source.to_string();
        Fault::new(
            Kind::Io(file.to_path_buf(), source),
            path,
            found,
            "a readable file",
        )
    }

    pub fn into_error(self, file: &Path) -> Error {
        let mut faults = Faults::default();
        faults.push(self);
        faults.into_error(file).expect("one fault was pushed")
    }
}

/// Collects faults, so that a user sees all of them at once.
#[derive(Debug, Default)]
pub(crate) struct Faults(Vec<Fault>);

impl Faults {
    /// Most faults that are kept: a document may have one per byte.
    const KEPT: usize = 1000;

    pub fn push(&mut self, fault: Fault) {
        if self.0.len() < Self::KEPT
            && !self
                .0
                .iter()
                .rev()
                .take(64)
                .any(|f| f.problem == fault.problem)
        {
            self.0.push(fault);
        }
    }

    /// Records a fault, or passes on a value.
    pub fn take<T>(&mut self, outcome: Outcome<T>) -> Option<T> {
        match outcome {
            Ok(value) => Some(value),
            Err(fault) => {
                self.push(fault);
                None
            }
        }
    }

    pub fn into_error(self, file: &Path) -> Option<Error> {
        let (mut invalid, mut unsupported, mut limit, mut io) = (vec![], vec![], vec![], None);
        for Fault { kind, problem } in self.0 {
            match kind {
                Kind::Invalid => invalid.push(problem),
                Kind::Unsupported => unsupported.push(problem),
                Kind::Limit => limit.push(problem),
                Kind::Io(file, source) => {
                    io.get_or_insert(Error::Io {
                        file,
                        path: problem.path,
                        source,
                    });
                }
            }
        }
        let file = file.to_path_buf();
        if !invalid.is_empty() {
            Some(Error::Invalid {
                file,
                problems: invalid,
            })
        } else if io.is_some() {
            io
        } else if !unsupported.is_empty() {
            Some(Error::Unsupported {
                file,
                problems: unsupported,
            })
        } else if !limit.is_empty() {
            Some(Error::Limit {
                file,
                problems: limit,
            })
        } else {
            None
        }
    }

    /// Fails if any fault was collected; otherwise starts afresh.
    pub fn check(&mut self, file: &Path) -> Result<(), Error> {
        match std::mem::take(self).into_error(file) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}
