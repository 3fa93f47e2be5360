//! What can be wrong with an asset, said by fault, file and place in the document.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

/// One thing wrong with a document.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Where, as a document path: `meshes[0].primitives[1].indices`. Empty for the file as a whole.
    pub path: String,
    /// What is there.
    pub found: String,
    /// What should be there, or what to do about it.
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

/// `text` on one line and without what a terminal obeys: control characters, and those that turn
/// the direction of writing, as `\u{1b}`. For names and values out of documents, which may hold
/// anything.
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

/// As [`printable`], cut after `most` characters.
pub fn printable_within(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        Some((cut, _)) => Cow::Owned(format!("{}…", printable(&text[..cut]))),
        None => printable(text),
    }
}

/// A part of a message, cut where it would fill a screen.
fn short(text: &str) -> Cow<'_, str> {
    // Longer than any of the project's own.
    printable_within(text, 400)
}

/// Why an asset cannot be loaded.
///
/// [`load`](crate::load) collects every problem that it can before it fails; the variant is that of
/// the gravest (invalid, then io, unsupported, limit) and lists all problems of that kind.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read.
    #[error("{}: {}{source}", file.display(), at(path))]
    Io {
        /// The file that could not be read.
        file: PathBuf,
        /// What in the document names it; empty for the document itself.
        path: String,
        /// The system's reason.
        source: io::Error,
    },
    /// The document breaks the glTF 2.0 specification in a way that matters for baking.
    #[error("{}: invalid glTF: {}", file.display(), all(problems))]
    Invalid {
        /// The document.
        file: PathBuf,
        /// At least one.
        problems: Vec<Problem>,
    },
    /// The document is sound but needs something that Lumel does not do.
    #[error("{}: not supported: {}", file.display(), all(problems))]
    Unsupported {
        /// The document.
        file: PathBuf,
        /// At least one; `expected` names the way out.
        problems: Vec<Problem>,
    },
    /// The document is larger than [`Limits`](crate::Limits) allow.
    #[error("{}: too large: {}", file.display(), all(problems))]
    Limit {
        /// The document.
        file: PathBuf,
        /// At least one.
        problems: Vec<Problem>,
    },
    /// The document is sound but has no surface that could receive light.
    #[error("{}: no triangles to bake: {why}", file.display())]
    NoTriangles {
        /// The document.
        file: PathBuf,
        /// What was found instead.
        why: String,
    },
}

impl Error {
    /// The process exit code that the command line promises for this fault: 2 input/output, 3
    /// invalid (also too large, and nothing to bake), 4 unsupported.
    pub fn exit_code(&self) -> i32 {
        match self {
            Error::Io { .. } => 2,
            Error::Invalid { .. } | Error::Limit { .. } | Error::NoTriangles { .. } => 3,
            Error::Unsupported { .. } => 4,
        }
    }

    /// The document's problems; empty for the variants that have none.
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

/// One problem in place; several one per line, so that a terminal shows them whole.
fn all(problems: &[Problem]) -> String {
    /// More would push the first, usually the cause, out of sight.
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

/// The kind of an internal fault; mirrors [`Error`]'s variants, gravest first.
#[derive(Debug)]
pub(crate) enum Kind {
    Invalid,
    Io(PathBuf, io::Error),
    Unsupported,
    Limit,
}

/// A problem with its kind, before it is known which file and which others it goes with.
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

/// Collects faults so that a user sees all of them at once.
#[derive(Debug, Default)]
pub(crate) struct Faults(Vec<Fault>);

impl Faults {
    /// A document can be wrong in as many places as it has bytes; the first thousand tell enough.
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

    /// Keeps the fault, if it is one, and passes on the value, if it is one.
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

    /// Fails if anything was collected, and starts afresh otherwise.
    pub fn check(&mut self, file: &Path) -> Result<(), Error> {
        match std::mem::take(self).into_error(file) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}
