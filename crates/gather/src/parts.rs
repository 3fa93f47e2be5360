//! Walls that cut a lumel: its points are sorted by which of them see each other.
//!
//! A floor that runs on under a wall has lumels on both sides, and some that the wall cuts. The
//! mean of a lit room and a dark one is wrong in both. So the points of such a lumel are sorted by
//! which of them see each other just above the surface ([`Parts`]), it holds the light of its
//! largest part that can be seen, and lumels do not take light from neighbours behind a wall
//! ([`Barriers`]).

use radiosity::{SurfacePoint, World};

/// Height above the surface at which walls are looked for, in lumels: above thresholds, mats and
/// what else lies flat on a floor.
pub(crate) const LIFT: f32 = 0.15;

/// Points of a lumel that say into which parts it falls. A part that holds none of them is less
/// than about a sixteenth of it.
const SCOUTS: usize = 16;

/// Parts of a footprint that walls keep from each other.
pub(crate) struct Parts {
    /// Points with the number of their part.
    scouts: Vec<(SurfacePoint, u8)>,
    lift: f32,
    /// How many parts there are.
    pub count: usize,
}

impl Parts {
    /// Sorts the first of `points` by which of them see each other.
    pub(crate) fn find(world: &World, points: &[SurfacePoint], size: f32) -> Parts {
        let points = &points[..points.len().min(SCOUTS)];
        let lift = LIFT * size;
        let mut part: Vec<u8> = Vec::with_capacity(points.len());
        for (k, p) in points.iter().enumerate() {
            let mut order = [(0.0, 0); SCOUTS];
            let before = nearest_first(&mut order, points[..k].iter(), p);
            // The nearest two of each part before it: one may hide behind a pebble.
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
                    // It joins two that did not see each other.
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

    /// The part of a further point of the footprint; the one after the last where it sees none of
    /// those that it was sorted by: a sliver beyond a wall.
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

/// Squared distances from `p` and numbers of `points` (at most [`SCOUTS`]), the nearest first.
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
