//! Points of a footprint.

use std::cell::OnceCell;

use glam::Vec3;
use radiosity::SurfacePoint;

use crate::footprint::Footprint;
use crate::recall::{Tape, Topic};

/// Points of a footprint, found when they are first asked for: with records they may never be.
pub(crate) struct Points<'f, F> {
    footprint: &'f F,
    /// How many they are.
    pub count: usize,
    all: OnceCell<Vec<SurfacePoint>>,
}

impl<'f, F: Footprint> Points<'f, F> {
    pub(crate) fn new(footprint: &'f F, count: usize) -> Self {
        Points {
            footprint,
            count,
            all: OnceCell::new(),
        }
    }

    #[inline]
    pub(crate) fn get(&self) -> &[SurfacePoint] {
        (self.all).get_or_init(|| spread(self.footprint, self.count))
    }
}

/// Where a footprint is, or a part of it.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// Its first point.
    pub first: SurfacePoint,
    /// Mean position of its points.
    pub position: Vec3,
    /// Mean shading normal, unit.
    pub normal: Vec3,
}

impl Place {
    /// Of some points, at least one.
    pub(crate) fn of(points: &[SurfacePoint]) -> Place {
        let (first, n) = (points[0], points.len() as f32);
        Place {
            first,
            position: points.iter().map(|p| p.position).sum::<Vec3>() / n,
            normal: (points.iter().map(|p| p.normal).sum::<Vec3>()).normalize_or(first.normal),
        }
    }

    /// Of `points`, or from records.
    pub(crate) fn find<'p>(
        tape: &mut Tape,
        key: u64,
        points: impl FnOnce() -> &'p Vec<SurfacePoint>,
    ) -> Place {
        let known = tape.find(Topic::Place, key).and_then(|bytes| {
            let mut numbers = bytes
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| f32::from_le_bytes(*b));
            let mut next = || Some(Vec3::new(numbers.next()?, numbers.next()?, numbers.next()?));
            Some(Place {
                first: SurfacePoint {
                    position: next()?,
                    origin: next()?,
                    normal: next()?,
                    geometric: next()?,
                },
                position: next()?,
                normal: next()?,
            })
        });
        if let Some(known) = known {
            return known;
        }
        let place = Place::of(points());
        let first = place.first;
        if tape.writes() {
            let all = [
                first.position,
                first.origin,
                first.normal,
                first.geometric,
                place.position,
                place.normal,
            ];
            let numbers = all.map(|v| v.to_array());
            let bytes = numbers.as_flattened().iter().flat_map(|x| x.to_le_bytes());
            tape.put(Topic::Place, key, &bytes.collect::<Vec<u8>>());
        }
        place
    }
}

/// The first points of the stream that lie on the surface, repeated where it has fewer.
fn spread(footprint: &impl Footprint, count: usize) -> Vec<SurfacePoint> {
    let mut points = Vec::with_capacity(count);
    for i in 0..8 * count as u32 {
        if points.len() == count || (points.is_empty() && i == 4 * count.min(16) as u32) {
            break;
        }
        points.extend(footprint.candidate(i));
    }
    if points.is_empty() {
        points.push(footprint.fallback());
    }
    let found = points.len();
    for k in found..count {
        points.push(points[k % found]);
    }
    points
}

/// Whether the nearest of some points is open.
pub(crate) fn nearest_is_open(points: &[SurfacePoint], open: &[bool], p: Vec3) -> bool {
    let mut best = (f32::INFINITY, true);
    for (q, open) in points.iter().zip(open) {
        let d = q.position.distance_squared(p);
        if d < best.0 {
            best = (d, *open);
        }
    }
    best.1
}
