//! Files that were read, by content.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::uri::{self, Bounds, Target};

/// BLAKE3 hash of a file's content; the program `b3sum` prints the same.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// Of `bytes`.
    pub fn of(bytes: &[u8]) -> Digest {
        Digest(blake3::hash(bytes).into())
    }

    /// Of what a reader gives until it ends.
    ///
    /// # Errors
    /// The reader's.
    pub fn of_reader(reader: impl std::io::Read) -> std::io::Result<Digest> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(reader)?;
        Ok(Digest(hasher.finalize().into()))
    }
}

/// 64 hexadecimal digits.
impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Digest({self})")
    }
}

/// What [`Digest`]'s `Display` writes; `Err` for anything else.
impl FromStr for Digest {
    type Err = ();

    fn from_str(text: &str) -> Result<Digest, ()> {
        let hash = blake3::Hash::from_hex(text).map_err(|_| ())?;
        // Digits of either case are read; only one is ever written.
        let digest = Digest(hash.into());
        (digest.to_string() == text).then_some(digest).ok_or(())
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Where it was.
    pub file: PathBuf,
    /// How the document names it; empty for the document itself.
    pub uri: String,
    /// What it held when it was read; `None` for a file that the document names and that was not
    /// there or could not be read.
    pub digest: Option<Digest>,
}

impl Input {
    /// A file that held `bytes`.
    pub fn new(file: PathBuf, uri: String, bytes: &[u8]) -> Input {
        Input {
            file,
            uri,
            digest: Some(Digest::of(bytes)),
        }
    }

    /// The file that a document in folder `base` means by `uri`; `None` where it means none (a data
    /// URI, a network address).
    pub fn locate(base: &Path, uri: &str) -> Option<PathBuf> {
        let bounds = Bounds {
            base: Some(base),
            outside: true,
        };
        match uri::resolve(uri, bounds, "") {
            Ok(Target::File(file)) => Some(file),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_is_what_b3sum_prints_and_survives_text() {
        // The empty input's hash, from the BLAKE3 specification's test vectors.
        let empty = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";
        let digest = Digest::of(b"");
        assert_eq!(digest.to_string(), empty);
        assert_eq!(empty.parse(), Ok(digest));
        assert_eq!(Digest::of_reader(&b""[..]).ok(), Some(digest));
        for bad in ["", "00", &empty[1..], &empty.to_uppercase(), "xyz"] {
            assert!(bad.parse::<Digest>().is_err(), "{bad}");
        }
    }
}
