//! One file of records: blocks in any order, an index at the end.
//!
//! Written beside its place and renamed, so that nobody sees half of one; read block by block, each checked by its hash. A file that is not whole
//! is no file, and a block that is not is no block.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Mutex;

use tempfile::NamedTempFile;

/// First bytes of a file: the form of what follows.
const MAGIC: &[u8; 16] = b"lumel records 4\n";

/// Where a block is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    /// What it is about, and its first and last item.
    stage: u8,
    first: u32,
    last: u32,
    at: u64,
    length: u32,
    hash: [u8; 16],
}

const PLACE: usize = 1 + 4 + 4 + 8 + 4 + 16;

/// Ends a file: length of the index, its hash.
const TAIL: u64 = 8 + 32;

fn short_hash(bytes: &[u8]) -> [u8; 16] {
    let mut out = [0; 16];
    out.copy_from_slice(&blake3::hash(bytes).as_bytes()[..16]);
    out
}

/// A file under way.
pub(crate) struct Writer {
    file: BufWriter<NamedTempFile>,
    at: u64,
    places: Vec<Place>,
}

impl Writer {
    /// In `folder`, about `key`.
    pub(crate) fn create(folder: &Path, key: &[u8; 32], head: &[u8]) -> io::Result<Writer> {
        let file = tempfile::Builder::new()
            .prefix(".lumel-")
            .suffix(".part")
            .tempfile_in(folder)?;
        let mut out = Writer {
            file: BufWriter::with_capacity(1 << 20, file),
            at: 0,
            places: Vec::new(),
        };
        out.write(MAGIC)?;
        out.write(key)?;
        out.block(HEAD, 0, 0, head)?;
        Ok(out)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Appends a block.
    pub(crate) fn block(
        &mut self,
        stage: u8,
        first: u32,
        last: u32,
        bytes: &[u8],
    ) -> io::Result<()> {
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        self.places.push(Place {
            stage,
            first,
            last,
            at: self.at,
            length,
            hash: short_hash(bytes),
        });
        self.write(bytes)
    }

    /// Ends the file and gives it its name. Returns its size.
    pub(crate) fn finish(mut self, path: &Path) -> io::Result<u64> {
        self.places.sort();
        let mut index = Vec::with_capacity(self.places.len() * PLACE);
        for p in &self.places {
            index.push(p.stage);
            index.extend_from_slice(&p.first.to_le_bytes());
            index.extend_from_slice(&p.last.to_le_bytes());
            index.extend_from_slice(&p.at.to_le_bytes());
            index.extend_from_slice(&p.length.to_le_bytes());
            index.extend_from_slice(&p.hash);
        }
        let hash = blake3::hash(&index);
        self.write(&index)?;
        self.write(&(index.len() as u64).to_le_bytes())?;
        self.write(hash.as_bytes())?;
        let file = self.file.into_inner().map_err(|e| e.into_error())?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(self.at)
    }
}

/// The stage of a file's head.
const HEAD: u8 = 0;

/// A whole file.
pub(crate) struct Reader {
    file: Mutex<File>,
    places: Vec<Place>,
    pub head: Vec<u8>,
    pub size: u64,
}

impl Reader {
    /// Opens a file about `key`.
    ///
    /// # Errors
    /// Why it cannot be used, for people.
    pub(crate) fn open(path: &Path, key: &[u8; 32]) -> Result<Reader, String> {
        let mut file = File::open(path).map_err(|e| e.to_string())?;
        Self::open_file(&mut file, key)
            .map_err(|e| e.to_string())?
            .map(|(places, size)| Reader {
                file: Mutex::new(file),
                places,
                head: Vec::new(),
                size,
            })
            .and_then(|mut reader| {
                let head = reader.load(HEAD, 0).ok_or("it is damaged")?;
                reader.head = head.2;
                Ok(reader)
            })
    }

    fn open_file(file: &mut File, key: &[u8; 32]) -> io::Result<Result<(Vec<Place>, u64), String>> {
        let size = file.metadata()?.len();
        let start = (MAGIC.len() + key.len()) as u64;
        if size < start + TAIL {
            return Ok(Err("it is cut short".into()));
        }
        let mut head = vec![0; start as usize];
        file.read_exact(&mut head)?;
        if head[..MAGIC.len()] != MAGIC[..] || head[MAGIC.len()..] != key[..] {
            return Ok(Err("it is something else".into()));
        }
        let mut tail = [0; TAIL as usize];
        file.seek(SeekFrom::Start(size - TAIL))?;
        file.read_exact(&mut tail)?;
        let [a, b, c, d, e, f, g, h, hash @ ..] = tail;
        let length = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
        if length > size - TAIL - start || length % PLACE as u64 != 0 {
            return Ok(Err("it is cut short".into()));
        }
        let mut index = vec![0; length as usize];
        file.seek(SeekFrom::Start(size - TAIL - length))?;
        file.read_exact(&mut index)?;
        if *blake3::hash(&index).as_bytes() != hash {
            return Ok(Err("it is damaged".into()));
        }
        let number = |b: &[u8]| b.iter().rev().fold(0u64, |n, x| n << 8 | u64::from(*x));
        let places = index
            .chunks_exact(PLACE)
            .map(|p| {
                let mut hash = [0; 16];
                hash.copy_from_slice(&p[21..]);
                Place {
                    stage: p[0],
                    first: number(&p[1..5]) as u32,
                    last: number(&p[5..9]) as u32,
                    at: number(&p[9..17]),
                    length: number(&p[17..21]) as u32,
                    hash,
                }
            })
            .collect();
        Ok(Ok((places, size)))
    }

    /// The block of a stage that may hold an item: its first and last item and its bytes; `None` where there is none, or none that is whole.
    pub(crate) fn load(&self, stage: u8, item: u32) -> Option<(u32, u32, Vec<u8>)> {
        let at = self
            .places
            .partition_point(|p| (p.stage, p.first) <= (stage, item));
        let place = self.places[..at].last()?;
        if place.stage != stage
            || place.last < item
            || place.at + u64::from(place.length) > self.size
        {
            return None;
        }
        let mut bytes = vec![0; place.length as usize];
        {
            let mut file = self.file.lock().ok()?;
            file.seek(SeekFrom::Start(place.at)).ok()?;
            file.read_exact(&mut bytes).ok()?;
        }
        (short_hash(&bytes) == place.hash).then_some((place.first, place.last, bytes))
    }

    /// Whether a stage has a block for an item, whole or not.
    pub(crate) fn has(&self, stage: u8, item: u32) -> bool {
        let at = self
            .places
            .partition_point(|p| (p.stage, p.first) <= (stage, item));
        (self.places[..at].last()).is_some_and(|p| p.stage == stage && p.last >= item)
    }
}
