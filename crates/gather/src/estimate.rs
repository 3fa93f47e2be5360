//! Sums over gathering rays at the points of a footprint, and the light and noise estimated from
//! them.

use glam::Vec3;
use radiosity::luminance;
use serde::{Deserialize, Serialize};

/// A sample point is inside something if this fraction of its rays hits black backfaces. Not all,
/// because a ray may escape through a seam. A point that is merely near backfaces sees them in at
/// most half of its hemisphere.
const INSIDE: f32 = 0.9;

/// The same threshold for all points of a part that walls close off: inside intersecting objects
/// some rays hit front faces. Half-way between the most that a visible part sees of backfaces, and
/// the fraction inside a single object.
pub(crate) const MOSTLY_INSIDE: f32 = 0.75;

/// If one part sees fewer black backfaces than this, another part that sees more does not count: it
/// is behind the surface that the first is in front of, like the foot of a wall below ground.
/// Half-way between nothing and the fraction right behind a plane.
pub(crate) const BEHIND: f32 = 0.25;

/// Points are outside the level if fewer than this fraction of their rays hit the front of
/// something and nearby points are in a room: under a floor or beyond a wall there are only backs
/// and the sky.
const OUTSIDE: f32 = 0.1;

/// Points are in a room if at least this fraction of their rays hit the front of something. Beside
/// a fence on a plain, half of them do.
const IN_A_ROOM: f32 = 0.75;

/// A ray that goes this many footprints far crosses a place from which people may look back. The
/// gap behind a cupboard and the slit between two walls have none.
pub(crate) const ROOM: f32 = 3.0;

/// What surrounds the points of a footprint.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Around {
    /// Backs and the sky.
    Outside,
    #[default]
    Open,
    /// Fronts nearly everywhere.
    Room,
}

/// Points disagree if their spread exceeds the noise of their rays by this factor (an F-test). One
/// of sixteen points with eight rays that sees light through a slit with three of them is at 4.2.
/// Gaussian noise exceeds 2.5 in 3 of 1000 lumels with sixteen points of eight rays. It exceeds 2
/// in 20 of them, some of which were visible as dots.
const DISAGREE: f32 = 2.5;

/// The same for points with fewer rays than [`FEW`], whose noise is less well known: with two rays
/// each, noise exceeds 4 in 5 of 1000 lumels.
const FEW_DISAGREE: f32 = 4.0;

/// See [`FEW_DISAGREE`].
const FEW: u32 = 8;

/// Spread below this fraction of the light, squared, counts as none. Under an open sky there is
/// only rounding, which the variances of the rays do not include.
const EVEN: f32 = 1e-6;

/// Running sums of one sample point.
#[derive(Clone, Copy, Default)]
pub(crate) struct Point {
    /// Hits closer than this are near, metres; hits closer than a quarter of it are about to touch.
    pub reach: f32,
    /// Whether a ray hit something near.
    pub near: bool,
    pub sum: Vec3,
    /// Irradiance from lit elements, which gathering rays leave out.
    pub from_lit: Vec3,
    /// Σ of squared luminances.
    pub square: f32,
    pub rays: u32,
    pub black: u32,
    /// Number of rays that hit any backface.
    pub backs: u32,
    /// Number of rays that hit any front.
    pub fronts: u32,
    /// Number of rays that go farther than [`ROOM`].
    pub far: u32,
    /// Number of rays that hit unlit backs of double-sided faces, or ended in the dark right above
    /// the point.
    pub unlit: u32,
    /// Number of rays that left the scene, or hit black backfaces, without finding light.
    pub void: u32,
}

impl Point {
    pub(crate) fn new(reach: f32) -> Self {
        Point {
            reach,
            ..Point::default()
        }
    }

    /// Adds the radiance of a ray; returns its luminance.
    pub(crate) fn add(&mut self, radiance: Vec3) -> f32 {
        self.sum += radiance;
        let l = luminance(radiance);
        self.square += l * l;
        l
    }

    /// Whether the point may be inside a body or right under something: all rays of one that is
    /// meet backs or something near.
    pub(crate) fn may_be_buried(&self) -> bool {
        self.near || self.backs > 0
    }

    pub(crate) fn inside(&self) -> bool {
        (self.black + self.unlit) as f32 >= INSIDE * self.rays as f32
    }

    /// Whether these points are all inside: nearly all of their rays hit black backfaces. One by one,
    /// with eight rays each, a third of the points in a wall whose seams let one ray in twenty pass
    /// would not be.
    pub(crate) fn inside_together<'p>(points: impl Iterator<Item = &'p Point>) -> bool {
        Point::dark_shares(points)[0] >= INSIDE
    }

    /// Fraction of these points' rays that hit black backfaces, and fraction that hit these, unlit
    /// backfaces, or something right above; both are 1 without points.
    pub(crate) fn dark_shares<'p>(points: impl Iterator<Item = &'p Point>) -> [f32; 2] {
        let (mut black, mut unlit, mut rays) = (0, 0, 0);
        for p in points {
            black += p.black;
            unlit += p.unlit;
            rays += p.rays;
        }
        if rays == 0 {
            return [1.0; 2];
        }
        [black, black + unlit].map(|n| n as f32 / rays as f32)
    }

    /// What surrounds these points.
    pub(crate) fn around<'p>(points: impl Iterator<Item = &'p Point>) -> Around {
        let (mut fronts, mut rays) = (0, 0);
        for p in points {
            fronts += p.fronts;
            rays += p.rays;
        }
        match fronts as f32 / rays.max(1) as f32 {
            share if share < OUTSIDE => Around::Outside,
            share if share < IN_A_ROOM => Around::Open,
            _ => Around::Room,
        }
    }

    /// Fraction of these points' rays that go far.
    pub(crate) fn far<'p>(points: impl Iterator<Item = &'p Point>) -> f32 {
        let (mut far, mut rays) = (0, 0);
        for p in points {
            far += p.far;
            rays += p.rays;
        }
        far as f32 / rays.max(1) as f32
    }

    /// Whether these points are invisible: nearly all of their rays end right above, or on unlit
    /// backfaces. Black backfaces count only if `dark`: under the back of a vault they are
    /// everywhere, but light enters at its ends.
    pub(crate) fn shut<'p>(points: impl Iterator<Item = &'p Point>, dark: bool) -> bool {
        let [black, all] = Point::dark_shares(points);
        let share = if dark { all } else { all - black };
        share >= MOSTLY_INSIDE
    }

    /// Whether nearly all rays of these points left the scene without light, or hit black
    /// backfaces.
    pub(crate) fn in_the_void<'p>(points: impl Iterator<Item = &'p Point>) -> bool {
        let (mut void, mut rays) = (0, 0);
        for p in points {
            void += p.void;
            rays += p.rays;
        }
        void as f32 >= INSIDE * rays as f32
    }

    /// Variance of the mean luminance over this point's own rays.
    fn variance_of_mean(&self) -> f32 {
        let n = self.rays as f32;
        let mean = luminance(self.sum) / n;
        (self.square / n - mean * mean).max(0.0) / (n - 1.0).max(1.0)
    }
}

/// Indirect irradiance of the sample points.
pub(crate) struct Estimate {
    pub mean: Vec3,
    /// The mean over the first half of the points.
    pub first_half: Vec3,
    /// Variance of the mean's luminance, from [`GROUPS`] groups of points. It ignores that
    /// consecutive points of a Sobol sequence, and so the groups, are stratified against each
    /// other, which makes it an upper bound.
    pub variance: f32,
    /// Whether the points differ by more than their rays' noise.
    pub disagree: bool,
}

/// Number of groups for estimating the variance. Fewer give a less certain estimate (eight: to a
/// third); more lose more of the stratification.
pub(crate) const GROUPS: usize = 8;

/// Mean irradiance over open points, and their spread.
pub(crate) fn mean_and_spread(sums: &[Point], open: &[bool]) -> Estimate {
    let pi = std::f32::consts::PI;
    let (mut mean, mut n) = (Vec3::ZERO, 0.0f32);
    let mut from_lit = 0.0;
    let (mut first_half, mut in_half) = (Vec3::ZERO, 0.0f32);
    for (k, (s, _)) in sums.iter().zip(open).enumerate().filter(|(_, (_, o))| **o) {
        mean += s.sum * (pi / s.rays as f32) + s.from_lit;
        from_lit += luminance(s.from_lit);
        n += 1.0;
        if 2 * k < sums.len() {
            (first_half, in_half) = (mean, n);
        }
    }
    mean /= n;
    first_half = if in_half > 0.0 && in_half < n {
        first_half / in_half
    } else {
        mean
    };
    let m = luminance(mean);
    let by_rays = m - from_lit / n;
    let (mut square, mut noise) = (0.0, 0.0);
    let mut groups = [(0f32, 0f32); GROUPS];
    for (k, (s, _)) in sums.iter().zip(open).enumerate().filter(|(_, (_, o))| **o) {
        let gathered = luminance(s.sum) * (pi / s.rays as f32);
        square += (gathered - by_rays) * (gathered - by_rays);
        let value = gathered + luminance(s.from_lit);
        noise += pi * pi * s.variance_of_mean();
        let group = &mut groups[k * GROUPS / sums.len()];
        *group = (group.0 + value, group.1 + 1.0);
    }
    let used = groups.iter().filter(|g| g.1 > 0.0).count() as f32;
    let between: f32 = groups
        .iter()
        .map(|g| (g.0 - g.1 * m) * (g.0 - g.1 * m))
        .sum();
    let spread = square / (n - 1.0).max(1.0);
    let few = sums.first().is_some_and(|s| s.rays < FEW);
    let bound = if few { FEW_DISAGREE } else { DISAGREE };
    Estimate {
        mean,
        first_half,
        variance: if used > 1.0 {
            between / (n * n) * (used / (used - 1.0))
        } else {
            m * m
        },
        disagree: n > 1.0 && spread > (bound * noise / n).max(EVEN * m * m),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sixteen points with this many rays; `light` gives the radiance of ray `i` of point `k`.
    fn disagree(rays: u32, light: impl Fn(usize, u32) -> f32) -> bool {
        let mut points = [Point::default(); 16];
        for (k, point) in points.iter_mut().enumerate() {
            for i in 0..rays {
                point.rays += 1;
                point.add(Vec3::new(1.0, 0.9, 1.3) * light(k, i));
            }
        }
        mean_and_spread(&points, &[true; 16]).disagree
    }

    #[test]
    fn points_that_are_not_inside_one_by_one_are_together() {
        // In a wall through whose seams one ray in sixteen passes: of four rays a point has three
        // quarters at least, which alone could be a place in front of backs.
        let point = |black| Point {
            rays: 4,
            black,
            ..Point::default()
        };
        let mut points = [point(4); 16];
        points[..4].fill(point(3));
        assert_eq!(points.iter().filter(|p| !p.inside()).count(), 4);
        assert!(Point::inside_together(points.iter()));
        // A corner of the lumel looks out of the wall.
        points[..2].fill(point(0));
        assert!(!Point::inside_together(points.iter()));
    }

    #[test]
    fn even_light_is_no_edge() {
        for rays in [2, 4, 8, 16] {
            // Sums of thirds round differently depending on their number, and slightly differently
            // for each point.
            for light in [1.0 / 3.0, 0.7, 1e-6, 3e5] {
                let even = |k: usize, _| light * (1.0 + 2e-7 * k as f32);
                assert!(!disagree(rays, even), "{rays} rays of {light}");
            }
        }
    }

    #[test]
    fn a_point_that_looks_out_of_a_slit_is_seen() {
        // Two of one point's rays and half of a third give F = 3.7; an eighth of all points' rays
        // is noise.
        let slit = |k: usize, i: u32| match (k, i) {
            (5, 0 | 1) => 1.0,
            (5, 2) => 0.5,
            _ => 0.0,
        };
        assert!(disagree(8, slit));
        let noise = |k: usize, i: u32| f32::from(u8::from((k + i as usize).is_multiple_of(8)));
        assert!(!disagree(8, noise));
        // Half of the footprint sees half of the light, even with few rays per point.
        let half = |k: usize, i: u32| if k < 8 { 1.0 } else { 0.5 } + 0.01 * i as f32;
        assert!(disagree(2, half) && disagree(8, half));
    }
}
