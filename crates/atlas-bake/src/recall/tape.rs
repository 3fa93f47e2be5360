//! All that is recorded of one footprint.

use std::cell::Cell;

use radiosity::ShadowTape;

/// What a part of a tape is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Topic {
    /// Gathering rays of the first points and of further ones; the key is the first ray's number.
    Rays = 1,
    /// Gathering rays of the points of a footprint that an edge crosses.
    EdgeRays = 2,
    /// Shadow rays; the key says of which points.
    Shadows = 3,
    /// Into how many parts walls cut the first points.
    PartsFirst = 4,
    /// The part of each point where an edge crosses.
    Parts = 5,
    /// Where the points are of which shadow rays start; the key is theirs.
    Place = 6,
    /// Shadow rays to lit elements; the key is that of the gathering rays from the same points.
    Lit = 8,
}

/// Gathering rays of one sequence.
pub(crate) enum RayTape<'b> {
    Off,
    Write(Vec<u8>),
    Read(&'b [u8]),
}

/// The tape of a footprint: nothing, a new one, or one to be read.
pub(crate) struct Tape<'b> {
    mode: Mode,
    blob: &'b [u8],
    /// Where in it the last part that was found ends: they are asked for about as they were written.
    next: Cell<usize>,
    out: Vec<u8>,
    /// Ends of rays are wanted exactly.
    pub exact: bool,
    /// Gathering and shadow rays that need not be cast.
    pub taken: u64,
    /// And those that were.
    pub cast: u64,
}

#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Off,
    Write,
    Read,
}

impl<'b> Tape<'b> {
    fn new(mode: Mode, blob: &'b [u8], exact: bool) -> Self {
        Tape {
            mode,
            blob,
            next: Cell::new(0),
            out: Vec::new(),
            exact,
            taken: 0,
            cast: 0,
        }
    }

    /// Nothing is recorded or read.
    pub(crate) fn off() -> Self {
        Tape::new(Mode::Off, &[], false)
    }

    /// To be written; `guard` identifies the footprint.
    pub(crate) fn write(guard: u64, exact: bool) -> Self {
        let mut tape = Tape::new(Mode::Write, &[], exact);
        tape.out.extend_from_slice(&guard.to_le_bytes());
        tape
    }

    /// To be read: `blob` is what [`finish`](Self::finish) gave, if it is of the same footprint.
    pub(crate) fn read(blob: Option<&'b [u8]>, guard: u64, exact: bool) -> Self {
        let own = blob
            .and_then(|b| b.split_first_chunk::<8>())
            .filter(|(head, _)| **head == guard.to_le_bytes());
        Tape::new(Mode::Read, own.map_or(&[][..], |own| own.1), exact)
    }

    /// What was written.
    pub(crate) fn finish(self) -> Vec<u8> {
        self.out
    }

    pub(crate) fn writes(&self) -> bool {
        self.mode == Mode::Write
    }

    /// What is recorded under a topic and key.
    pub(crate) fn find(&self, topic: Topic, key: u64) -> Option<&'b [u8]> {
        let next = self.next.get();
        (self.find_after(next, topic, key)).or_else(|| self.find_after(0, topic, key))
    }

    fn find_after(&self, at: usize, topic: Topic, key: u64) -> Option<&'b [u8]> {
        let mut rest = self.blob.get(at..)?;
        while let Some((head, tail)) = rest.split_first_chunk::<13>() {
            let [kind, k @ .., a, b, c, d] = *head;
            let length = u32::from_le_bytes([a, b, c, d]) as usize;
            let (body, after) = tail.split_at_checked(length)?;
            if kind == topic as u8 && u64::from_le_bytes(k) == key {
                self.next.set(self.blob.len() - after.len());
                return Some(body);
            }
            rest = after;
        }
        None
    }

    /// Records `body`.
    pub(crate) fn put(&mut self, topic: Topic, key: u64, body: &[u8]) {
        let Ok(length) = u32::try_from(body.len()) else {
            return;
        };
        self.out.push(topic as u8);
        self.out.extend_from_slice(&key.to_le_bytes());
        self.out.extend_from_slice(&length.to_le_bytes());
        self.out.extend_from_slice(body);
    }

    /// The gathering rays of a sequence.
    pub(crate) fn rays(&self, topic: Topic, first: u32) -> RayTape<'b> {
        match self.mode {
            Mode::Off => RayTape::Off,
            Mode::Write => RayTape::Write(Vec::new()),
            Mode::Read => RayTape::Read(self.find(topic, u64::from(first)).unwrap_or(&[])),
        }
    }

    /// Keeps them.
    pub(crate) fn keep_rays(&mut self, topic: Topic, first: u32, rays: RayTape) {
        if let RayTape::Write(bytes) = rays {
            self.put(topic, u64::from(first), &bytes);
        }
    }

    /// The shadow rays of a receiver.
    pub(crate) fn shadows(&self, key: u64) -> ShadowTape<'b> {
        match self.mode {
            Mode::Off => ShadowTape::Off,
            Mode::Write => ShadowTape::Write(Vec::new()),
            Mode::Read => ShadowTape::of_notes(self.find(Topic::Shadows, key).unwrap_or(&[])),
        }
    }

    /// Keeps them.
    pub(crate) fn keep_shadows(&mut self, key: u64, shadows: ShadowTape) {
        match shadows {
            ShadowTape::Off => {}
            ShadowTape::Write(bytes) => self.put(Topic::Shadows, key, &bytes),
            ShadowTape::Read(notes) => {
                let [taken, cast] = notes.answered;
                self.taken += u64::from(taken);
                self.cast += u64::from(cast);
            }
        }
    }

    /// What is recorded under a topic, or what `make` makes.
    pub(crate) fn bytes(&mut self, topic: Topic, make: impl FnOnce() -> Vec<u8>) -> Vec<u8> {
        if let Some(body) = self.find(topic, 0) {
            return body.to_vec();
        }
        let made = make();
        if self.writes() {
            self.put(topic, 0, &made);
        }
        made
    }
}

/// A key for which of a footprint's points count, and how they are shared out.
pub(crate) fn key_of(open: &[bool], base: u32) -> u64 {
    let mut h = u64::from(base) << 32 | open.len() as u64;
    for bits in open.chunks(64) {
        let word = (bits.iter().enumerate()).fold(0u64, |w, (k, b)| w | u64::from(*b) << k);
        h = mix(h ^ word);
    }
    h
}

/// A bijection that spreads every bit (Steele, Lea, Flood, *Fast splittable pseudorandom number generators*, 2014).
pub(crate) fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
