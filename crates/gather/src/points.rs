//! Sample points of a footprint.

use glam::Vec3;
use radiosity::SurfacePoint;

use crate::footprint::Footprint;

/// The rays of a footprint's points.
#[derive(Clone, Copy)]
pub(crate) struct Sampling {
    /// Rays per point. Aligned blocks of a Sobol sequence are well distributed, individually and
    /// together.
    pub rays: u32,
    /// Number of earlier points of the footprint; their rays come first in the sequence.
    pub before: u32,
    pub seed: u32,
    /// The footprint's size, metres; hits within it are near.
    pub reach: f32,
    /// A triangle of the footprint, and whether it is on its back.
    pub side: Option<(u32, bool)>,
}

/// Position and normal of a footprint or a part of it.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// Mean position of its points.
    pub position: Vec3,
    /// Mean shading normal, unit.
    pub normal: Vec3,
}

impl Place {
    /// The place of some points, at least one.
    pub(crate) fn of(points: &[SurfacePoint]) -> Place {
        let n = points.len() as f32;
        Place {
            position: points.iter().map(|p| p.position).sum::<Vec3>() / n,
            normal: (points.iter().map(|p| p.normal).sum::<Vec3>()).normalize_or(points[0].normal),
        }
    }
}

/// The first `count` points of the footprint's stream on the surface, repeated if there are fewer.
pub(crate) fn spread(footprint: &impl Footprint, count: usize) -> Vec<SurfacePoint> {
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

/// Points of a footprint for direct light: the open ones and, if more are requested, further ones
/// of the stream near these.
pub(crate) struct OpenPoints<'p, F> {
    footprint: &'p F,
    points: &'p [SurfacePoint],
    open: &'p [bool],
    valid: Vec<SurfacePoint>,
    further: Vec<SurfacePoint>,
    /// Number of candidates of the stream used for `further`.
    stream: u32,
}

impl<'p, F: Footprint> OpenPoints<'p, F> {
    /// At least one of `open` is true.
    pub(crate) fn new(footprint: &'p F, points: &'p [SurfacePoint], open: &'p [bool]) -> Self {
        let valid = points.iter().zip(open).filter(|(_, open)| **open);
        OpenPoints {
            footprint,
            points,
            open,
            valid: valid.map(|(p, _)| *p).collect(),
            further: Vec::new(),
            stream: 0,
        }
    }

    /// Size of the footprint, metres.
    pub(crate) fn size(&self) -> f32 {
        self.footprint.size()
    }

    /// The instance that the footprint is on.
    pub(crate) fn instance(&self) -> Option<usize> {
        self.footprint.instance()
    }

    /// The place of the open points.
    pub(crate) fn place(&self) -> Place {
        Place::of(&self.valid)
    }

    /// Point number `i`.
    pub(crate) fn get(&mut self, i: u32) -> SurfacePoint {
        let (i, count) = (i as usize, self.valid.len());
        if i < count {
            return self.valid[i];
        }
        while self.further.len() <= i - count {
            let found = self.find_further();
            self.further
                .push(found.unwrap_or(self.valid[self.further.len() % count]));
        }
        self.further[i - count]
    }

    /// The next point of the stream near an open point, among eight.
    fn find_further(&mut self) -> Option<SurfacePoint> {
        let all_open = self.valid.len() == self.points.len();
        (0..8).find_map(|_| {
            let c = (self.footprint).candidate(self.stream + self.points.len() as u32);
            self.stream += 1;
            c.filter(|c| all_open || nearest_is_open(self.points, self.open, c.position))
        })
    }
}

/// Whether the nearest of some points is open.
fn nearest_is_open(points: &[SurfacePoint], open: &[bool], p: Vec3) -> bool {
    let mut best = (f32::INFINITY, true);
    for (q, open) in points.iter().zip(open) {
        let d = q.position.distance_squared(p);
        if d < best.0 {
            best = (d, *open);
        }
    }
    best.1
}
