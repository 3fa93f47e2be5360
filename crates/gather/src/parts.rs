//! Walls that cut a lumel: its points are sorted by mutual visibility.
//!
//! A floor that continues under a wall has lumels on both sides, and some that the wall cuts. The
//! mean of a lit room and a dark one is wrong in both. So the points of such a lumel are sorted by
//! which of them see each other just above the surface ([`Parts`]). The lumel takes the light of the
//! part that is seen most, and lumels take no light from neighbours behind a wall ([`Barriers`]).

use radiosity::{SurfacePoint, World};

/// Height above the surface at which walls are detected, in lumels: above thresholds, mats and
/// other flat objects on a floor.
pub(crate) const LIFT: f32 = 0.15;

/// Points with something less than this above them, in lumels, are not seen: a carpet that hovers
/// by a millimetre, a lamp flush with the ceiling, a picture on a wall. Someone who looks along the
/// surface at 20° sees a third of a lumel into such a gap. Beside it, its darkness would be a dark
/// line one lumel wide.
pub(crate) const GAP: f32 = 0.12;

/// Number of points of a lumel that determine its parts. A part without any of them is smaller than
/// about a sixteenth of the lumel.
const SCOUTS: usize = 16;

/// Parts of a footprint that walls separate.
pub(crate) struct Parts {
    /// Points with the index of their part.
    scouts: Vec<(SurfacePoint, u8)>,
    lift: f32,
    /// Number of parts.
    pub count: usize,
}

impl Parts {
    /// Sorts the first of `points` by mutual visibility.
    pub(crate) fn find(world: &World, points: &[SurfacePoint], size: f32) -> Parts {
        let points = &points[..points.len().min(SCOUTS)];
        let lift = LIFT * size;
        let mut part: Vec<u8> = Vec::with_capacity(points.len());
        for (k, p) in points.iter().enumerate() {
            let mut order = [(0.0, 0); SCOUTS];
            let before = nearest_first(&mut order, points[..k].iter(), p);
            // Tests the nearest two points of each earlier part, because one may be hidden by a
            // small obstacle.
            let (mut tried, mut own) = ([0u8; SCOUTS], None);
            for &(_, j) in before {
                let of = part[j];
                if own == Some(of) || tried[of as usize] == 2 {
                    continue;
                }
                tried[of as usize] += 1;
                if world.wall_between(p, &points[j], lift) {
                    continue;
                }
                match own {
                    None => own = Some(of),
                    // This point connects two parts that did not see each other.
                    Some(one) => {
                        let (low, high) = (one.min(of), one.max(of));
                        part.iter_mut()
                            .filter(|x| **x == high)
                            .for_each(|x| *x = low);
                        own = Some(low);
                    }
                }
            }
            part.push(own.unwrap_or(k as u8));
        }
        let mut names = part.clone();
        names.sort_unstable();
        names.dedup();
        let number = |of: u8| names.binary_search(&of).unwrap_or(0) as u8;
        Parts {
            scouts: points
                .iter()
                .zip(&part)
                .map(|(p, of)| (*p, number(*of)))
                .collect(),
            lift,
            count: names.len(),
        }
    }

    /// The part of a further point of the footprint. A point that sees none of the others, i.e. a
    /// sliver beyond a wall, gets the index after the last part.
    pub(crate) fn of(&self, world: &World, p: &SurfacePoint) -> usize {
        let far = |s: &(SurfacePoint, u8)| s.0.position.distance_squared(p.position);
        let nearest = (self.scouts.iter()).min_by(|a, b| far(a).total_cmp(&far(b)));
        if let Some(s) = nearest.filter(|s| !world.wall_between(p, &s.0, self.lift)) {
            return s.1 as usize;
        }
        let mut order = [(0.0, 0); SCOUTS];
        nearest_first(&mut order, self.scouts.iter().map(|s| &s.0), p)
            .iter()
            .skip(1)
            .map(|&(_, j)| &self.scouts[j])
            .find(|s| !world.wall_between(p, &s.0, self.lift))
            .map_or(self.count, |s| s.1 as usize)
    }
}

/// Squared distances from `p` and indices of `points` (at most [`SCOUTS`]), nearest first.
fn nearest_first<'o, 'p>(
    order: &'o mut [(f32, usize); SCOUTS],
    points: impl Iterator<Item = &'p SurfacePoint>,
    p: &SurfacePoint,
) -> &'o [(f32, usize)] {
    let mut n = 0;
    for (slot, q) in order.iter_mut().zip(points) {
        *slot = (q.position.distance_squared(p.position), n);
        n += 1;
    }
    order[..n].sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    &order[..n]
}
