//! What rays found in an earlier bake of the same surfaces, so that they need not be cast again.
//!
//! Nothing here decides anything: an answer is recorded under what identifies its question (which light, which of its random numbers, which
//! point), and where there is none, a ray is cast. So a bake from records has the bytes of one without.

use smallvec::SmallVec;

use crate::sampling::hash_u32;

/// Names a light in records: a lamp, a cell of the sky or a node of the emitters' tree. 24 bits.
pub type Code = u32;

/// No light, or one whose number does not fit.
pub(crate) const NO_CODE: Code = 0xff_ffff;

const KIND: u32 = 22;

/// What a [`Code`] stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Lamp = 0,
    Sky = 1,
    Emitters = 2,
}

/// The code of light `number` of a kind.
pub(crate) fn code(kind: Kind, number: u32) -> Code {
    if number < 1 << KIND {
        (kind as u32) << KIND | number
    } else {
        NO_CODE
    }
}

/// What is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Topic {
    /// Rays between patches, by block of patches and pass.
    Links,
    /// Shadow rays of elements, by block of patches.
    Elements,
    /// Shadow rays of what hits on a patch choose lights from, by patch.
    Choices,
    /// Receivers near which nothing rises above their surface.
    Flat,
}

/// Where records are kept.
pub trait Records: Sync {
    /// Whether there is anything to be read; else it is to be written.
    fn read(&self) -> bool;
    /// What was kept under a topic and number; `None` where nothing was, or not what was written.
    fn load(&self, topic: Topic, item: u32) -> Option<Vec<u8>>;
    /// Keeps it.
    fn save(&self, topic: Topic, item: u32, bytes: &[u8]);
    /// Counts rays that records answered, and rays that were cast although there are records.
    fn count(&self, taken: u64, cast: u64);
}

/// Records, and which lamps are which in them.
#[derive(Clone)]
pub struct Recalled<'r> {
    /// The records.
    pub records: &'r dyn Records,
    /// The lamps.
    pub lamps: KnownLamps,
}

/// Which lamps of the scene are which of the records.
#[derive(Debug, Clone, Default)]
pub struct KnownLamps {
    /// By lamp: the number, in the records, of one of the same place, shape and directions, so that rays to it are the same.
    pub shape: Vec<Option<u32>>,
    /// The same of one that has its intensity too, so that its light is the same.
    pub light: Vec<Option<u32>>,
}

impl KnownLamps {
    /// For records of the scene itself.
    pub fn own(lamps: usize) -> Self {
        let all: Vec<Option<u32>> = (0..lamps as u32).map(Some).collect();
        KnownLamps {
            shape: all.clone(),
            light: all,
        }
    }

    pub(crate) fn shape(&self, lamp: usize) -> Code {
        (self.shape.get(lamp).copied().flatten()).map_or(NO_CODE, |k| code(Kind::Lamp, k))
    }

    pub(crate) fn light(&self, lamp: usize) -> Code {
        (self.light.get(lamp).copied().flatten()).map_or(NO_CODE, |k| code(Kind::Lamp, k))
    }
}

/// Shadow rays at one receiver: their answers are noted, taken from notes, or neither.
#[derive(Debug, Default)]
#[allow(clippy::large_enum_variant, reason = "one at a time, and on the stack")]
pub enum ShadowTape<'n> {
    /// Neither.
    #[default]
    Off,
    /// Noted, in [`ShadowTape::of_notes`]'s form.
    Write(Vec<u8>),
    /// Taken from notes.
    Read(Notes<'n>),
}

/// Notes of shadow rays, and how many questions they answered.
#[derive(Debug, Default)]
pub struct Notes<'n> {
    terms: SmallVec<[Term<'n>; 16]>,
    /// Where the next light is likely to be.
    next: usize,
    /// Questions with an answer here, and without.
    pub answered: [u32; 2],
}

/// Code, sequence, samples, answers, outcome.
type Term<'n> = (Code, u32, u16, &'n [u8], &'n [u8]);

/// What a shadow ray found, in two bits.
const UNKNOWN: u8 = 0;
const BLOCKED: u8 = 1;
const CLEAR: u8 = 2;

impl<'n> ShadowTape<'n> {
    /// Reads notes; what does not parse is left out.
    pub fn of_notes(mut bytes: &'n [u8]) -> Self {
        let mut terms = SmallVec::new();
        while let [a, b, c, s0, s1, s2, s3, n0, n1, o, rest @ ..] = bytes {
            let n = u16::from_le_bytes([*n0, *n1]);
            let Some((answers, rest)) = rest.split_at_checked(usize::from(n).div_ceil(4)) else {
                break;
            };
            let Some((outcome, rest)) = rest.split_at_checked(usize::from(*o)) else {
                break;
            };
            let code = u32::from_le_bytes([*a, *b, *c, 0]);
            let sequence = u32::from_le_bytes([*s0, *s1, *s2, *s3]);
            terms.push((code, sequence, n, answers, outcome));
            bytes = rest;
        }
        ShadowTape::Read(Notes {
            terms,
            next: 0,
            answered: [0; 2],
        })
    }

    /// Of one receiver in `bytes`, which [`end`](Self::end) wrote; it is taken off the front.
    pub(crate) fn begin(read: bool, bytes: &mut &'n [u8]) -> Self {
        if !read {
            return ShadowTape::Write(Vec::new());
        }
        let own = bytes
            .split_first_chunk::<4>()
            .and_then(|(head, rest)| rest.split_at_checked(u32::from_le_bytes(*head) as usize));
        let (own, rest) = own.unwrap_or_default();
        *bytes = rest;
        ShadowTape::of_notes(own)
    }

    /// Appends the notes of a receiver, or gives the rays that notes answered and those that were cast.
    pub(crate) fn end(self, out: &mut Vec<u8>) -> [u64; 2] {
        match self {
            ShadowTape::Off => [0; 2],
            ShadowTape::Write(bytes) => {
                out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
                out.extend_from_slice(&bytes);
                [0; 2]
            }
            ShadowTape::Read(notes) => notes.answered.map(u64::from),
        }
    }

    /// What is to be asked about a light; `None` where nothing is to be noted or known. `sequence` tells apart what decides about its
    /// samples beside their number.
    pub(crate) fn listen(&mut self, code: Code, sequence: u32) -> Option<Box<Heard>> {
        match self {
            ShadowTape::Off => None,
            ShadowTape::Write(_) if code == NO_CODE => None,
            ShadowTape::Write(_) => Some(Box::new(Heard {
                write: true,
                code,
                sequence,
                ..Heard::default()
            })),
            ShadowTape::Read(notes) => {
                let is = |t: &Term| (t.0, t.1) == (code, sequence);
                let found = match notes.terms.get(notes.next) {
                    Some(t) if is(t) => notes.next,
                    _ => match notes.terms.iter().position(is) {
                        Some(k) => k,
                        None => return Some(Box::new(Heard::default())),
                    },
                };
                notes.next = found + 1;
                let (.., n, answers, outcome) = notes.terms[found];
                Some(Box::new(Heard {
                    count: n,
                    answers: SmallVec::from_slice(answers),
                    outcome: SmallVec::from_slice(outcome),
                    ..Heard::default()
                }))
            }
        }
    }

    /// Takes what was heard of a light.
    pub(crate) fn keep(&mut self, heard: Option<Box<Heard>>) {
        match (self, heard) {
            (ShadowTape::Write(out), Some(h)) if h.count > 0 || !h.outcome.is_empty() => {
                out.extend_from_slice(&h.code.to_le_bytes()[..3]);
                out.extend_from_slice(&h.sequence.to_le_bytes());
                out.extend_from_slice(&h.count.to_le_bytes());
                out.push(h.outcome.len() as u8);
                out.extend_from_slice(&h.answers);
                out.extend_from_slice(&h.outcome);
            }
            (ShadowTape::Read(notes), Some(h)) => {
                for (sum, n) in notes.answered.iter_mut().zip(h.answered) {
                    *sum += n;
                }
            }
            _ => {}
        }
    }
}

/// Answers to the shadow rays of one light at one receiver.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    /// Which sample asks next.
    pub at: u32,
    write: bool,
    code: Code,
    sequence: u32,
    count: u16,
    answers: SmallVec<[u8; 16]>,
    outcome: SmallVec<[u8; 64]>,
    answered: [u32; 2],
}

/// Numbers that a light's samples come to, as bits.
pub(crate) type Outcome = [u32; 31];

/// Two numbers in one; none of them is as large as 2^16 but what stands for all that there are.
fn in_halves([a, b]: [u32; 2]) -> u32 {
    a.min(0xffff) << 16 | b.min(0xffff)
}

impl Heard {
    pub(crate) fn writes(&self) -> bool {
        self.write
    }

    /// Notes what a light's first samples came to; `asked` is how many there were, and how many of them had a ray for certain.
    pub(crate) fn note(&mut self, asked: [u32; 2], outcome: &Outcome) {
        let mask = (outcome.iter().enumerate()).fold(0u32, |m, (k, x)| m | u32::from(*x != 0) << k);
        self.outcome.clear();
        let parts = [in_halves(asked), mask].into_iter();
        let words = parts.chain(outcome.iter().copied().filter(|x| *x != 0));
        self.outcome.extend(words.flat_map(u32::to_le_bytes));
    }

    /// What was noted of the same samples.
    pub(crate) fn noted(&mut self, asked: [u32; 2]) -> Option<Outcome> {
        let mut words = self
            .outcome
            .as_chunks::<4>()
            .0
            .iter()
            .map(|w| u32::from_le_bytes(*w));
        if self.write || words.next()? != in_halves(asked) {
            return None;
        }
        let mask = words.next()?;
        let mut out = Outcome::default();
        for (k, x) in out.iter_mut().enumerate() {
            if mask >> k & 1 != 0 {
                *x = words.next()?;
            }
        }
        Some(out)
    }

    /// Counts rays of samples whose outcome was noted.
    pub(crate) fn count(&mut self, rays: u32) {
        self.answered[0] += rays;
    }

    /// The share that gets through: from notes, or by a ray.
    pub(crate) fn answer(&mut self, cast: impl FnOnce() -> glam::Vec3) -> glam::Vec3 {
        let (byte, shift) = (self.at as usize / 4, 2 * (self.at % 4));
        if self.write {
            let passed = cast();
            let answer = match passed {
                glam::Vec3::ZERO => BLOCKED,
                glam::Vec3::ONE => CLEAR,
                _ => UNKNOWN,
            };
            if self.at < u32::from(u16::MAX) {
                self.count = self.count.max(self.at as u16 + 1);
                if self.answers.len() <= byte {
                    self.answers.resize(byte + 1, 0);
                }
                self.answers[byte] |= answer << shift;
            }
            return passed;
        }
        let known = if self.at < u32::from(self.count) {
            self.answers.get(byte).map_or(UNKNOWN, |b| b >> shift & 3)
        } else {
            UNKNOWN
        };
        self.answered[usize::from(known != BLOCKED && known != CLEAR)] += 1;
        match known {
            BLOCKED => glam::Vec3::ZERO,
            CLEAR => glam::Vec3::ONE,
            _ => cast(),
        }
    }
}

/// A light that a hit drew and what it brought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// Which light.
    pub code: Code,
    /// Irradiance, before it is divided by the chance that this light is drawn.
    pub lit: glam::Vec3,
    /// Its group.
    pub group: u8,
}

impl Drawn {
    /// No light reaches as far.
    pub(crate) const NOTHING: Drawn = Drawn {
        code: NO_CODE,
        lit: glam::Vec3::ZERO,
        group: 0,
    };
}

/// A number in [0, 1) for what a hit draws.
#[inline]
pub(crate) fn share_of(seed: u32) -> f32 {
    hash_u32(seed) as f32 / 4294967296.0
}
