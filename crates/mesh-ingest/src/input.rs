//! Input files by content.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::uri::{self, Bounds, Target};

/// BLAKE3 hash of a file's contents, as printed by the program `b3sum`.
///
/// ```
/// use mesh_ingest::Digest;
///
/// let digest = Digest::of(b"");
/// assert_eq!(digest.to_string().parse(), Ok::<_, ()>(digest));
/// assert!(digest.to_string().starts_with("af1349b9f5f9a1a6"));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// Hash of `bytes`.
    pub fn of(bytes: &[u8]) -> Digest {
        Digest(blake3::hash(bytes).into())
    }

    /// Hash of everything that a reader returns.
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

/// Parses the output of [`Digest`]'s `Display`; `Err` for anything else.
impl FromStr for Digest {
    type Err = ();

    fn from_str(text: &str) -> Result<Digest, ()> {
        let hash = blake3::Hash::from_hex(text).map_err(|_| ())?;
        // hex accepts both cases, but only lower case is ever written.
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
    /// Its path.
    pub file: PathBuf,
    /// Its name in the document; empty for the document itself.
    pub uri: String,
    /// Hash of its contents when it was read; `None` if it did not exist or could not be read.
    pub digest: Option<Digest>,
}

impl Input {
    /// A file with the contents `bytes`.
    pub fn new(file: PathBuf, uri: String, bytes: &[u8]) -> Input {
        Input {
            file,
            uri,
            digest: Some(Digest::of(bytes)),
        }
    }

    /// The file that `uri` denotes in a document in folder `base`; `None` if it denotes none (a
    /// data URI, a network address).
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
        // The hash of the empty input in the BLAKE3 specification's test vectors.
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
