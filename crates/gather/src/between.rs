//! Interpolates light of lumels between gathered ones.

use glam::Vec3;
use radiosity::luminance;
use rayon::prelude::*;

use crate::map::LumelMap;
use crate::plan::WIDE_FACING;
use crate::received::{Edge, Received};

/// Direct light is interpolated if linear interpolation between two neighbours and cubic
/// interpolation through four differ by at most this fraction of the light.
const STRAIGHT: f32 = 0.01;

/// Interpolated indirect light.
pub(crate) struct Between {
    pub indirect: Vec3,
    pub first_half: Vec3,
    pub variance: f32,
    /// Indirect light and its first half, by plane.
    pub planes: Vec<[Vec3; 2]>,
}

/// The lumels that an interpolated lumel reads, and their weights; see [`taps`].
#[derive(Default)]
pub(crate) struct Taps {
    list: [(usize, f32); 8],
    count: usize,
    lines: usize,
    /// Whether all lines have more than two points, so that curvature can be detected.
    bent: bool,
}

impl Taps {
    /// Adds a line of two to four lumels.
    fn add(&mut self, line: &[(usize, f32)]) {
        if self.lines == 1 {
            self.list[..self.count].iter_mut().for_each(|t| t.1 *= 0.5);
        }
        let share = if self.lines == 0 { 1.0 } else { 0.5 };
        for &(j, weight) in line {
            self.list[self.count] = (j, weight * share);
            self.count += 1;
        }
        self.bent = (self.bent || self.lines == 0) && line.len() > 2;
        self.lines += 1;
    }

    /// Lumels and their weights.
    pub(crate) fn list(&self) -> &[(usize, f32)] {
        &self.list[..self.count]
    }
}

/// Interpolated direct light.
pub(crate) struct DirectBetween {
    pub irradiance: Vec3,
    /// Direct light by plane.
    pub planes: Vec<Vec3>,
    /// Square of the possible interpolation error.
    pub variance: f32,
    /// Lamps visible to all taps, and lamps hidden from all, as in [`Received`].
    pub lit: u32,
    pub hidden: u32,
}

/// The weighted mean; weights sum to 1.
pub(crate) fn mean_of<'r>(beside: impl Iterator<Item = (&'r Received, f32)>) -> Between {
    let mut out = Between {
        indirect: Vec3::ZERO,
        first_half: Vec3::ZERO,
        variance: 0.0,
        planes: Vec::new(),
    };
    for (r, weight) in beside {
        out.indirect += r.indirect * weight;
        out.first_half += r.first_half * weight;
        // As if neighbours had the same error; smoothing estimates it properly.
        out.variance += r.indirect_variance * weight;
        out.planes.resize(r.planes.len(), [Vec3::ZERO; 2]);
        for (sum, plane) in out.planes.iter_mut().zip(&r.planes) {
            sum[0] += plane.indirect * weight;
            sum[1] += plane.first_half * weight;
        }
    }
    out
}

/// Indirect light of interpolated lumel `i`.
pub(crate) fn between(map: &LumelMap, i: usize) -> Between {
    let weight = 1.0 / map.plan.of(i).count().max(1) as f32;
    mean_of(map.plan.of(i).map(|j| (&map.received[j], weight)))
}

/// The taps of an interpolated lumel: its neighbours on both sides and, if the surface continues
/// undisturbed, the next lumels on the same lines, with weights that sum to 1. Interpolation is
/// cubic through four, parabolic through three, else linear. Empty if there are neighbours on one
/// side only.
pub(crate) fn taps(map: &LumelMap, i: usize) -> Taps {
    let (l, received) = (map.lumel(i), &map.received);
    let [x, y] = l.texel.map(i64::from);
    let mut taps = Taps::default();
    let next = |j: usize| -> Option<usize> {
        let [u, v] = map.lumel(j).texel.map(i64::from);
        let at = |k: i64| map.index.at(l.page, x + k * (u - x), y + k * (v - y));
        let (between, far) = (at(2)?, at(3)?);
        let (near, r) = (&received[j], &received[far]);
        let way = r.position - near.position;
        // Adjacent texels of a chart need not be adjacent on the surface, nor on the same side of a
        // thin thing. What lies between may not have been gathered yet.
        let goes_on = r.normal.dot(near.normal) >= WIDE_FACING
            && way.length() <= 4.0 * near.size
            && way.dot(near.normal).abs() <= 0.5 * near.size
            && [between, far].into_iter().all(|k| {
                let r = &received[k];
                let clear = map.plan.is(k) || (r.open == 1.0 && !r.near);
                clear && map.lumel(k).instance == l.instance
            });
        goes_on.then_some(far)
    };
    // Opposite neighbours: the first and the second of two, the first and the last, and the second
    // and the third of four.
    let [a, b, c, d] = map.plan.beside[i];
    let pairs = if c.or(d).is_some() || (x & y & 1 == 1) {
        [[a, d], [b, c]]
    } else {
        [[a, b], [None; 2]]
    };
    for pair in pairs {
        let [Some(a), Some(b)] = pair.map(|j| j.map(|j| j as usize)) else {
            continue;
        };
        match (next(a), next(b)) {
            (Some(far_a), Some(far_b)) => {
                taps.add(&[(a, 0.5625), (b, 0.5625), (far_a, -0.0625), (far_b, -0.0625)]);
            }
            (None, Some(far)) => taps.add(&[(a, 0.375), (b, 0.75), (far, -0.125)]),
            (Some(far), None) => taps.add(&[(a, 0.75), (b, 0.375), (far, -0.125)]),
            (None, None) => taps.add(&[(a, 0.5), (b, 0.5)]),
        }
    }
    taps
}

/// Direct light of lumel `i` from its taps, if all agree about lamps, no shadow edge crosses any,
/// and the light is nearly linear; else `None`.
pub(crate) fn direct_between(map: &LumelMap, i: usize) -> Option<DirectBetween> {
    let (taps, received) = (taps(map, i), &map.received);
    if !taps.bent {
        return None; // Curvature cannot be detected.
    }
    let first = &received[taps.list().first()?.0];
    let mut out = DirectBetween {
        irradiance: Vec3::ZERO,
        planes: vec![Vec3::ZERO; first.planes.len()],
        variance: 0.0,
        lit: first.lit,
        hidden: first.hidden,
    };
    for &(j, weight) in taps.list() {
        let r = &received[j];
        let same = [r.lit, r.hidden] == [out.lit, out.hidden] && r.mixed == 0;
        if !(same && r.edge == Edge::None && r.open == 1.0) {
            return None;
        }
        out.irradiance += r.direct * weight;
        for (sum, plane) in out.planes.iter_mut().zip(&r.planes) {
            *sum += plane.direct * weight;
        }
    }
    let (mut straight, mut n) = (0f32, 0f32);
    for j in map.plan.of(i) {
        straight += luminance(received[j].direct);
        n += 1.0;
    }
    out.irradiance = out.irradiance.max(Vec3::ZERO);
    let light = luminance(out.irradiance + first.indirect);
    let bend = luminance(out.irradiance) - straight / n;
    out.variance = bend * bend;
    (bend.abs() <= STRAIGHT * light).then_some(out)
}

/// Repeats the interpolation after the gathered lumels have changed.
pub(crate) fn interpolate(map: &mut LumelMap) {
    let between: Vec<Option<Between>> = (0..map.len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|i| (map.plan.is(i)).then(|| between(map, i)))
        .collect();
    for (r, between) in map.received.iter_mut().zip(between) {
        let Some(b) = between else { continue };
        (r.indirect, r.first_half) = (b.indirect, b.first_half);
        r.indirect_variance = b.variance;
        for (plane, of) in r.planes.iter_mut().zip(b.planes) {
            [plane.indirect, plane.first_half] = of;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::smooth::tests::map_of;

    /// The lumels that the second of a row of six is interpolated between. The last two are on the
    /// other side of a board as thick as a fifth of a lumel, if `turned`.
    fn read(turned: bool) -> Vec<usize> {
        let received = (0..6u8).map(|k| {
            let behind = turned && k > 3;
            Received {
                position: Vec3::new(f32::from(k), 0.0, if behind { -0.2 } else { 0.0 }),
                normal: if behind { -Vec3::Z } else { Vec3::Z },
                size: 1.0,
                open: 1.0,
                ..Received::default()
            }
        });
        let mut map = map_of(received.collect(), [6, 1]);
        map.plan.beside[1] = [Some(0), Some(2), None, None];
        taps(&map, 1).list().iter().map(|(j, _)| *j).collect()
    }

    #[test]
    fn light_is_not_interpolated_with_the_other_side_of_a_board() {
        assert_eq!(read(false), [0, 2, 4]);
        assert_eq!(read(true), [0, 2]);
    }
}
