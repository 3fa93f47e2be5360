//! Files with the light that shards gathered.
//!
//! A file is a header, sections, and a hash of both. A section holds the light of some lumels after
//! a pass, in postcard's format. Nothing in a file is used before its hash is checked.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use gather::{Pass, Received, Records};
use mesh_ingest::{Digest, open_regular};
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// First bytes of a file.
const MAGIC: &[u8; 16] = b"lumel shard 2\n\0\0";

/// Bytes of the hash at the end, and of the header: magic, the seal of the work folder in
/// hexadecimal digits, number, count.
const HASH: u64 = 32;
const HEAD: u64 = 16 + 64 + 8;

/// Bytes of a section's header: pass, round, lumels, first and last of them, bytes.
const SECTION: usize = 28;

/// Number of a shard, from 1, and the number of shards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardOf {
    /// From 1.
    pub number: u32,
    /// Number of shards.
    pub of: u32,
}

impl ShardOf {
    /// Name of its file in a work folder.
    pub(crate) fn file(self) -> String {
        format!("shard-{}-of-{}.light", self.number, self.of)
    }

    /// The shard whose file has this name.
    pub(crate) fn named(file: &str) -> Option<ShardOf> {
        let name = file.strip_prefix("shard-")?.strip_suffix(".light")?;
        let (number, of) = name.split_once("-of-")?;
        let shard = ShardOf {
            number: number.parse().ok()?,
            of: of.parse().ok()?,
        };
        (shard.file() == file && (1..=shard.of).contains(&shard.number)).then_some(shard)
    }
}

/// A pass encoded as two numbers.
fn code(pass: Pass) -> [u32; 2] {
    match pass {
        Pass::First => [0, 0],
        Pass::Cells => [1, 0],
        Pass::Between => [2, 0],
        Pass::Unsteady => [3, 0],
        Pass::Edges(round) => [4, round],
        Pass::More => [5, 0],
    }
}

/// Hashes everything that is written through it.
struct Hashed<W> {
    out: W,
    hasher: blake3::Hasher,
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let n = self.out.write(bytes)?;
        self.hasher.update(&bytes[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

/// A shard's file while it is being written: a temporary file beside its final place.
pub(crate) struct ShardWriter {
    path: PathBuf,
    shard: ShardOf,
    work: Digest,
    state: Mutex<Writing>,
}

struct Writing {
    file: Hashed<BufWriter<tempfile::NamedTempFile>>,
    /// The first fault.
    fault: Option<std::io::Error>,
    lumels: u64,
}

fn head(work: &Digest, shard: ShardOf) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    out.extend(work.to_string().into_bytes());
    out.extend(shard.number.to_le_bytes());
    out.extend(shard.of.to_le_bytes());
    out
}

impl ShardWriter {
    pub(crate) fn create(folder: &Path, work: &Digest, shard: ShardOf) -> Result<Self, Error> {
        let path = folder.join(shard.file());
        let begin = || -> std::io::Result<Writing> {
            let file = tempfile::Builder::new()
                .prefix(&temporary(shard))
                .suffix(".part")
                .tempfile_in(folder)?;
            let mut file = Hashed {
                out: BufWriter::new(file),
                hasher: blake3::Hasher::new(),
            };
            file.write_all(&head(work, shard))?;
            Ok(Writing {
                file,
                fault: None,
                lumels: 0,
            })
        };
        let state = begin().map_err(|e| unreadable(&path, &e))?;
        Ok(ShardWriter {
            path,
            shard,
            work: *work,
            state: Mutex::new(state),
        })
    }

    /// Completes the file and renames it to its final place, and removes what killed attempts at
    /// this shard left behind. Returns its size in bytes and its number of records.
    pub(crate) fn finish(self) -> Result<(u64, u64), Error> {
        let (path, folder) = (&self.path, self.path.parent().unwrap_or(Path::new("")));
        let state = self.state.into_inner();
        let Writing {
            file,
            fault,
            lumels,
        } = state.unwrap_or_else(std::sync::PoisonError::into_inner);
        let end = || -> std::io::Result<u64> {
            fault.map_or(Ok(()), Err)?;
            let mut out = file.out;
            out.write_all(file.hasher.finalize().as_bytes())?;
            let file = out.into_inner().map_err(|e| e.into_error())?;
            readable_by_all(file.as_file())?;
            file.as_file().sync_all()?;
            let bytes = file.as_file().metadata()?.len();
            match file.persist(path) {
                // Another process has finished the same shard, and has removed this file.
                Err(_) if is_gathered(folder, &self.work, self.shard) => {}
                Err(e) => return Err(e.error),
                Ok(_) => {}
            }
            Ok(bytes)
        };
        let bytes = end().map_err(|e| unreadable(path, &e))?;
        remove_temporaries(folder, self.shard);
        Ok((bytes, lumels))
    }
}

/// Start of the names of a shard's temporary files.
fn temporary(shard: ShardOf) -> String {
    format!(".lumel-{}-", shard.file())
}

fn remove_temporaries(folder: &Path, shard: ShardOf) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    let of_shard = |name: &str| name.starts_with(&temporary(shard)) && name.ends_with(".part");
    for entry in entries.flatten() {
        if entry.file_name().to_str().is_some_and(of_shard) {
            // A file that stays only takes space.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Temporary files are private, but the nodes of a farm may run as different users.
fn readable_by_all(file: &File) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    let _ = file;
    Ok(())
}

impl Records for ShardWriter {
    fn put(&self, pass: Pass, lumels: &[u32], light: &[Received]) {
        let Ok(mut state) = self.state.lock() else {
            return;
        };
        if state.fault.is_some() || lumels.is_empty() {
            return;
        }
        state.lumels += lumels.len() as u64;
        let outcome = section(pass, lumels, light).and_then(|bytes| state.file.write_all(&bytes));
        state.fault = outcome.err();
    }

    fn take(&self, _: Pass, _: Range<u32>, _: &mut dyn FnMut(u32, Received)) {}
}

/// A section with its header.
fn section(pass: Pass, lumels: &[u32], light: &[Received]) -> std::io::Result<Vec<u8>> {
    let mut out = vec![0; SECTION];
    for (lumel, light) in lumels.iter().zip(light) {
        out = postcard::to_extend(&(lumel, light), out).map_err(std::io::Error::other)?;
    }
    let bytes = (out.len() - SECTION) as u64;
    let [pass, round] = code(pass);
    let mut head = Vec::with_capacity(SECTION);
    // Lumels are in ascending order.
    let [first, last] = [lumels.first(), lumels.last()].map(|l| l.copied().unwrap_or(0));
    for x in [pass, round, lumels.len() as u32, first, last] {
        head.extend(x.to_le_bytes());
    }
    head.extend(bytes.to_le_bytes());
    out[..SECTION].copy_from_slice(&head);
    Ok(out)
}

/// A section of a file: pass, number of lumels, the first and last of them, place, bytes.
struct Section {
    pass: [u32; 2],
    lumels: u32,
    ends: [u32; 2],
    at: u64,
    bytes: u64,
}

/// A shard's file after its check.
struct ShardFile {
    path: PathBuf,
    sections: Vec<Section>,
}

/// The files of all shards of a work folder.
pub(crate) struct Shards {
    files: Vec<ShardFile>,
    fault: Mutex<Option<Error>>,
}

fn unreadable(path: &Path, e: &std::io::Error) -> Error {
    Error::Folder {
        path: path.to_owned(),
        message: e.to_string(),
        io: true,
    }
}

fn broken(path: &Path, message: String) -> Error {
    Error::Folder {
        path: path.to_owned(),
        message,
        io: false,
    }
}

impl ShardFile {
    /// Checks that a file is complete and belongs to this work folder and shard.
    fn open(path: PathBuf, work: &Digest, shard: ShardOf) -> Result<ShardFile, Error> {
        let failed = |e: &std::io::Error| unreadable(&path, e);
        let file = open_regular(&path).map_err(|e| failed(&e))?;
        let length = file.metadata().map_err(|e| failed(&e))?.len();
        let mut reader = BufReader::new(file);
        let again = |what: &str| {
            let ShardOf { number, of } = shard;
            broken(
                &path,
                format!("{what}; gather it again: --shard {number}/{of}"),
            )
        };
        let damaged = || again("found a damaged file, expected the light of a shard");
        let mut first = vec![0; HEAD as usize];
        if length < HEAD + HASH || reader.read_exact(&mut first).is_err() {
            return Err(damaged());
        }
        let expected = head(work, shard);
        if first[..16] != expected[..16] {
            return Err(again("found a file of another version, or none of Lumel's"));
        }
        let hash = hash_of_rest(&first, &mut reader, length - HEAD - HASH);
        let mut stored = [0; HASH as usize];
        reader.read_exact(&mut stored).map_err(|e| failed(&e))?;
        if hash.map_err(|e| failed(&e))? != stored {
            return Err(damaged());
        }
        if first != expected {
            return Err(again("found the light of another solution or shard"));
        }
        let sections = sections(&mut reader, length).map_err(|e| failed(&e))?;
        let sections = sections.ok_or_else(damaged)?;
        Ok(ShardFile { path, sections })
    }

    /// Passes on the records of a pass, at least of these lumels.
    fn take(
        &self,
        pass: [u32; 2],
        lumels: &Range<u32>,
        to: &mut dyn FnMut(u32, Received),
    ) -> Result<(), Error> {
        let failed = |e: &std::io::Error| unreadable(&self.path, e);
        let changed = || broken(&self.path, "the file changed while it was read".into());
        let mut file = open_regular(&self.path).map_err(|e| failed(&e))?;
        let of_these = |s: &&Section| {
            let [first, last] = s.ends;
            s.pass == pass && first < lumels.end && last >= lumels.start
        };
        for section in self.sections.iter().filter(of_these) {
            file.seek(SeekFrom::Start(section.at))
                .map_err(|e| failed(&e))?;
            let mut bytes = vec![0; section.bytes as usize];
            file.read_exact(&mut bytes).map_err(|e| failed(&e))?;
            let mut rest = &bytes[..];
            for _ in 0..section.lumels {
                let ((lumel, light), after): ((u32, Received), _) =
                    postcard::take_from_bytes(rest).map_err(|_| changed())?;
                rest = after;
                to(lumel, light);
            }
        }
        Ok(())
    }
}

/// Hash of a header and of the next `length` bytes.
fn hash_of_rest(head: &[u8], reader: &mut impl Read, length: u64) -> std::io::Result<[u8; 32]> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(head);
    hasher.update_reader(reader.take(length))?;
    Ok(hasher.finalize().into())
}

/// The sections of a file of this length; `None` if they do not fill it.
fn sections(file: &mut BufReader<File>, length: u64) -> std::io::Result<Option<Vec<Section>>> {
    let (mut at, end) = (HEAD, length - HASH);
    let mut out = Vec::new();
    while at < end {
        if end - at < SECTION as u64 {
            return Ok(None);
        }
        file.seek(SeekFrom::Start(at))?;
        let mut head = [0; SECTION];
        file.read_exact(&mut head)?;
        let number =
            |k: usize| u32::from_le_bytes([head[k], head[k + 1], head[k + 2], head[k + 3]]);
        let bytes = u64::from(number(20)) | u64::from(number(24)) << 32;
        at += SECTION as u64;
        if bytes > end - at {
            return Ok(None);
        }
        out.push(Section {
            pass: [number(0), number(4)],
            lumels: number(8),
            ends: [number(12), number(16)],
            at,
            bytes,
        });
        at += bytes;
    }
    Ok(Some(out))
}

/// Whether the shard's file exists, is complete, and belongs to this work folder.
pub(crate) fn is_gathered(folder: &Path, work: &Digest, shard: ShardOf) -> bool {
    ShardFile::open(folder.join(shard.file()), work, shard).is_ok()
}

impl Shards {
    /// Opens the shards in a work folder, which must all belong to one division.
    pub(crate) fn open(folder: &Path, work: &Digest) -> Result<Shards, Error> {
        let entries = std::fs::read_dir(folder).map_err(|e| unreadable(folder, &e))?;
        let mut found: Vec<ShardOf> = entries
            .filter_map(|entry| ShardOf::named(entry.ok()?.file_name().to_str()?))
            .collect();
        found.sort_by_key(|s| (s.of, s.number));
        let divisions: Vec<&[ShardOf]> = found.chunk_by(|a, b| a.of == b.of).collect();
        let whole = divisions.iter().find(|d| d.len() == d[0].of as usize);
        let Some(whole) = whole else {
            return Err(broken(folder, missing(&divisions)));
        };
        let files: Result<Vec<_>, Error> = (whole.iter())
            .map(|&shard| ShardFile::open(folder.join(shard.file()), work, shard))
            .collect();
        Ok(Shards {
            files: files?,
            fault: Mutex::new(None),
        })
    }

    /// The first fault while records were read.
    pub(crate) fn fault(self) -> Option<Error> {
        let fault = self.fault.into_inner();
        fault.unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

/// Describes which shards are missing.
fn missing(divisions: &[&[ShardOf]]) -> String {
    let most = divisions.iter().max_by_key(|d| d.len());
    let Some(most) = most else {
        return "found no shards, expected those that `lumel gather --shard` writes".into();
    };
    let of = most[0].of;
    let there = |k: &u32| most.iter().any(|s| s.number == *k);
    let gone: Vec<String> = (1..=of)
        .filter(|k| !there(k))
        .map(|k| k.to_string())
        .collect();
    let named = gone.len().min(10);
    let more = if gone.len() > named { ", …" } else { "" };
    let (found, gone) = (most.len(), gone[..named].join(", "));
    format!("found {found} of {of} shards, expected all; missing: {gone}{more}")
}

impl Records for Shards {
    fn put(&self, _: Pass, _: &[u32], _: &[Received]) {}

    fn take(&self, pass: Pass, lumels: Range<u32>, to: &mut dyn FnMut(u32, Received)) {
        let taken = self
            .files
            .iter()
            .try_for_each(|file| file.take(code(pass), &lumels, to));
        if let (Err(e), Ok(mut fault)) = (taken, self.fault.lock()) {
            fault.get_or_insert(e);
        }
    }
}
