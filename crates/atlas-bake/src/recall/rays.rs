//! What a gathering ray met, the light apart: its record.
//!
//! Where a path goes hangs on surfaces alone; what it brings, on the solved light and the lamps. A record holds the first, in few bytes, so that
//! the second can be computed without a ray: for each near hit the surface, the patch and the lamp that was sampled, and for the far one the place
//! on its patch's grid. What does not fit is recorded as unknown, and such a ray is cast again.

use glam::Vec3;
use radiosity::{Drawn, SeenPatch, Shade};
use smallvec::SmallVec;

/// How a path ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum End {
    /// It cannot start: below the face.
    Below,
    /// At a black back, at once.
    Black,
    /// It left the scene; the direction is noted where it is not the first.
    Escaped(Option<Vec3>),
    /// At a black back, or below a face that it met.
    Stopped,
    /// At what the solution says of a surface.
    Far(SeenPatch),
    /// The ray is to be cast again.
    Unknown,
}

/// A hit from which a path went on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NearHit {
    pub patch: u32,
    pub surface: Shade,
    pub drawn: Drawn,
}

/// The record of a ray.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RayNote {
    pub end: End,
    pub near: SmallVec<[NearHit; 4]>,
    /// To the first surface; exact where [`RayNote::write`] was told to keep it, else on the right side of both bounds that it was told.
    pub distance: f32,
    pub back: bool,
}

/// Told what a path does, or not.
pub(crate) trait Notes {
    /// Whether it listens.
    const ON: bool;
    fn near(&mut self, _: u32, _: Shade, _: Option<Drawn>) {}
    fn end(&mut self, _: Option<End>) {}
    fn lose(&mut self) {}
}

/// Nobody listens.
pub(crate) struct Deaf;

impl Notes for Deaf {
    const ON: bool = false;
}

/// Makes a record.
pub(crate) struct Listening(pub RayNote);

impl Listening {
    pub(crate) fn new() -> Self {
        Listening(RayNote {
            end: End::Below,
            near: SmallVec::new(),
            distance: 0.0,
            back: false,
        })
    }
}

impl Notes for Listening {
    const ON: bool = true;

    fn near(&mut self, patch: u32, surface: Shade, drawn: Option<Drawn>) {
        match drawn {
            Some(drawn) if patch < 1 << 24 && surface.triangle < 1 << 24 => {
                self.0.near.push(NearHit {
                    patch,
                    surface,
                    drawn,
                })
            }
            _ => self.lose(),
        }
    }

    fn end(&mut self, end: Option<End>) {
        match end {
            _ if self.0.end == End::Unknown => {}
            Some(End::Far(seen)) if (seen.patch | seen.surface.triangle) >= 1 << 24 => self.lose(),
            Some(end) => self.0.end = end,
            None => self.lose(),
        }
    }

    fn lose(&mut self) {
        self.0.end = End::Unknown;
    }
}

const NEAR: u16 = 1 << 6;
const TOUCHING: u16 = 1 << 7;
const BACK: u16 = 1 << 8;
const EXACT: u16 = 1 << 9;

const UNEVEN: u8 = 1;
const GLOWS: u8 = 2;
const DRAWN: u8 = 4;
const LIT: u8 = 8;

/// An element's number within its patch, which has 16 at most, where there is none.
const NO_ELEMENT: u8 = 0x7f;
/// Beside that: it is far off.
const FAR: u8 = 0x80;

impl RayNote {
    /// Appends the record. `bounds` are the distances below which something is near, and touching; with `exact` all of the distance is kept.
    pub(crate) fn write(&self, bounds: [f32; 2], exact: bool, out: &mut Vec<u8>) {
        let kind: u16 = match self.end {
            End::Below => 0,
            End::Black => 1,
            End::Escaped(_) => 2,
            End::Stopped => 3,
            End::Far(_) => 4,
            End::Unknown => 5,
        };
        if matches!(self.end, End::Below | End::Black | End::Unknown) {
            out.extend_from_slice(&kind.to_le_bytes());
            return;
        }
        let flag = |on: bool, bit: u16| if on { bit } else { 0 };
        let header = kind
            | (self.near.len() as u16) << 3
            | flag(self.distance < bounds[0], NEAR)
            | flag(self.distance < bounds[1], TOUCHING)
            | flag(self.back, BACK)
            | flag(exact, EXACT);
        out.extend_from_slice(&header.to_le_bytes());
        if exact {
            put(out, &[self.distance]);
        }
        for hit in &self.near {
            surface(&hit.surface, Some(&hit.drawn), out);
            out.extend_from_slice(&hit.patch.to_le_bytes()[..3]);
            drawn(&hit.drawn, out);
        }
        match self.end {
            End::Escaped(Some(direction)) => put(out, &direction.to_array()),
            End::Far(seen) => {
                surface(&seen.surface, seen.drawn.as_ref(), out);
                out.extend_from_slice(&seen.patch.to_le_bytes()[..3]);
                let far = if seen.far { FAR } else { 0 };
                out.push(seen.element.unwrap_or(NO_ELEMENT) | far);
                put(out, &seen.q);
                if let Some(d) = &seen.drawn {
                    drawn(d, out);
                }
            }
            _ => {}
        }
    }
}

/// The first part of a record, as it is read.
pub(crate) struct Head {
    kind: u16,
    /// Near hits.
    pub near: usize,
    /// See [`RayNote::distance`].
    pub distance: f32,
    /// See [`RayNote::back`].
    pub back: bool,
}

impl Head {
    /// Takes it off the front of `bytes`; `None` where there is none. A distance that was not kept comes out on the same side of `bounds`.
    #[inline]
    pub(crate) fn read(bounds: [f32; 2], bytes: &mut &[u8]) -> Option<Head> {
        let header = u16::from_le_bytes(take(bytes)?);
        let (kind, near) = (header & 7, usize::from(header >> 3 & 7));
        if matches!(kind, 0 | 1 | 5) {
            return Some(Head {
                kind,
                near: 0,
                distance: 0.0,
                back: false,
            });
        }
        let distance = if header & EXACT != 0 {
            float(bytes)?
        } else if header & TOUCHING != 0 {
            -1.0
        } else if header & NEAR != 0 {
            0.5 * (bounds[0] + bounds[1])
        } else if near == 0 && kind == 2 {
            f32::INFINITY
        } else {
            f32::MAX
        };
        Some(Head {
            kind,
            near,
            distance,
            back: header & BACK != 0,
        })
    }

    /// The next near hit, as long as there are any.
    #[inline]
    pub(crate) fn near_hit(&self, bytes: &mut &[u8]) -> Option<NearHit> {
        let (surface, flags) = read_surface(bytes)?;
        Some(NearHit {
            patch: read_u24(bytes)?,
            surface,
            drawn: read_drawn(flags, bytes)?,
        })
    }

    /// The end, after all near hits.
    #[inline]
    pub(crate) fn end(&self, bytes: &mut &[u8]) -> Option<End> {
        Some(match self.kind {
            0 => End::Below,
            1 => End::Black,
            2 if self.near == 0 => End::Escaped(None),
            2 => End::Escaped(Some(vec3(bytes)?)),
            3 => End::Stopped,
            4 => {
                let (surface, flags) = read_surface(bytes)?;
                let patch = read_u24(bytes)?;
                let [element] = take(bytes)?;
                let far = element & FAR != 0;
                let element = element & !FAR;
                End::Far(SeenPatch {
                    patch,
                    element: (element != NO_ELEMENT).then_some(element),
                    q: [float(bytes)?, float(bytes)?],
                    surface,
                    far,
                    drawn: match flags & DRAWN {
                        0 => None,
                        _ => Some(read_drawn(flags, bytes)?),
                    },
                })
            }
            _ => End::Unknown,
        })
    }
}

/// Appends what a shadow ray to an element found, or that there was none to draw.
pub(crate) fn write_answer(answer: Option<(u32, Vec3)>, out: &mut Vec<u8>) {
    let (element, passed) = answer
        .filter(|a| a.0 < NOTHING)
        .unwrap_or((NOTHING, Vec3::ZERO));
    out.extend_from_slice(&element.to_le_bytes()[..3]);
    if passed == Vec3::ZERO {
        out.push(0);
    } else if passed == Vec3::ONE {
        out.push(1);
    } else {
        out.push(2);
        put(out, &passed.to_array());
    }
}

/// Takes an answer off the front of `bytes`; `None` where there is none.
pub(crate) fn read_answer(bytes: &mut &[u8]) -> Option<(u32, Vec3)> {
    let element = read_u24(bytes)?;
    let [kind] = take(bytes)?;
    let passed = match kind {
        0 => Vec3::ZERO,
        1 => Vec3::ONE,
        _ => vec3(bytes)?,
    };
    (element < NOTHING).then_some((element, passed))
}

/// No element.
const NOTHING: u32 = 0xff_ffff;

fn put(out: &mut Vec<u8>, numbers: &[f32]) {
    for x in numbers {
        out.extend_from_slice(&x.to_le_bytes());
    }
}

fn surface(s: &Shade, drawn: Option<&Drawn>, out: &mut Vec<u8>) {
    let mut flags = 0;
    if s.reflectance.is_some() {
        flags |= UNEVEN;
    }
    if s.glow.0 != Vec3::ZERO {
        flags |= GLOWS;
    }
    if let Some(d) = drawn {
        flags |= DRAWN;
        if d.lit != Vec3::ZERO {
            flags |= LIT;
        }
    }
    out.push(flags);
    out.extend_from_slice(&s.triangle.to_le_bytes()[..3]);
    if let Some(reflectance) = s.reflectance {
        put(out, &reflectance.to_array());
    }
    if flags & GLOWS != 0 {
        put(out, &s.glow.0.to_array());
        out.extend_from_slice(&(s.glow.1 as u16).to_le_bytes());
    }
}

fn drawn(d: &Drawn, out: &mut Vec<u8>) {
    out.extend_from_slice(&d.code.to_le_bytes()[..3]);
    if d.lit != Vec3::ZERO {
        put(out, &d.lit.to_array());
        out.push(d.group);
    }
}

#[inline]
fn read_surface(bytes: &mut &[u8]) -> Option<(Shade, u8)> {
    let [flags] = take(bytes)?;
    let mut s = Shade {
        triangle: read_u24(bytes)?,
        reflectance: None,
        glow: (Vec3::ZERO, 0),
    };
    if flags & UNEVEN != 0 {
        s.reflectance = Some(vec3(bytes)?);
    }
    if flags & GLOWS != 0 {
        s.glow = (vec3(bytes)?, usize::from(u16::from_le_bytes(take(bytes)?)));
    }
    Some((s, flags))
}

#[inline]
fn read_drawn(flags: u8, bytes: &mut &[u8]) -> Option<Drawn> {
    let code = read_u24(bytes)?;
    let (lit, group) = if flags & LIT != 0 {
        (vec3(bytes)?, take::<1>(bytes)?[0])
    } else {
        (Vec3::ZERO, 0)
    };
    Some(Drawn { code, lit, group })
}

#[inline]
fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (head, rest) = bytes.split_first_chunk::<N>()?;
    *bytes = rest;
    Some(*head)
}

#[inline]
fn float(bytes: &mut &[u8]) -> Option<f32> {
    Some(f32::from_le_bytes(take(bytes)?))
}

#[inline]
fn vec3(bytes: &mut &[u8]) -> Option<Vec3> {
    Some(Vec3::new(float(bytes)?, float(bytes)?, float(bytes)?))
}

#[inline]
fn read_u24(bytes: &mut &[u8]) -> Option<u32> {
    let [a, b, c] = take(bytes)?;
    Some(u32::from_le_bytes([a, b, c, 0]))
}
