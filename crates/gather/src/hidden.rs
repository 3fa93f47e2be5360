//! Hidden lumels take the light of their neighbours.

use glam::Vec3;
use radiosity::{Backs, World, luminance};
use rayon::prelude::*;

use crate::estimate::Around;
use crate::map::LumelMap;
use crate::parts::LIFT;
use crate::planes::Plane;
use crate::received::Received;

/// Fills hidden lumels with their neighbours' light, `rings` deep, because bilinear lookups next to
/// them read it.
///
/// Lumels behind a surface that their neighbours are in front of are filled too, e.g. a wall's
/// first row below ground, which may see the sky from below. So are lumels outside the level that
/// are next to lumels in a room, e.g. where a sofa's back passes through a wall without thickness.
pub(crate) fn fill_hidden(world: &World, map: &mut LumelMap, rings: u32) {
    let mut filled: Vec<bool> = map.received.iter().map(|r| r.open > 0.0).collect();
    let received = &map.received;
    let behind: Vec<(usize, Received)> = (0..map.len())
        .into_par_iter()
        .with_min_len(1024)
        .filter(|&i| filled[i] && (received[i].behind || received[i].around == Around::Outside))
        .filter_map(|i| {
            let own = received[i].point(world);
            let lift = LIFT * received[i].size;
            let before = |j: usize| {
                let other = &received[j];
                let outside = received[i].around == Around::Outside;
                let of = match outside && other.around == Around::Room {
                    true => Backs::All,
                    false if received[i].behind => Backs::Black,
                    false => return false,
                };
                filled[j]
                    && !other.behind
                    && map.barriers.between(&map.lumels, i, j)
                    && world.backs_onto(&own, &other.point(world), lift, of)
            };
            let around = beside(map, &before, i, EDGES);
            Some((i, blend(received, &around, i)?))
        })
        .collect();
    put(&mut map.received, behind);
    let mut empty: Vec<usize> = (0..map.len()).filter(|&i| !filled[i]).collect();
    for _ in 0..rings {
        let found: Vec<(usize, Received)> = empty
            .par_iter()
            .with_min_len(1024)
            .filter_map(|&i| {
                let around = [EDGES, CORNERS].into_iter().find_map(|ways| {
                    let around = beside(map, &|j: usize| filled[j], i, ways);
                    (!around.is_empty()).then(|| before(&map.received, around))
                })?;
                Some((i, blend(&map.received, &around, i)?))
            })
            .collect();
        if found.is_empty() {
            return;
        }
        for (i, _) in &found {
            filled[*i] = true;
        }
        put(&mut map.received, found);
        empty.retain(|&i| !filled[i]);
    }
}

const EDGES: [[i64; 2]; 4] = [[0, -1], [-1, 0], [1, 0], [0, 1]];
const CORNERS: [[i64; 2]; 4] = [[-1, -1], [1, -1], [-1, 1], [1, 1]];

fn put(received: &mut [Received], values: Vec<(usize, Received)>) {
    for (i, value) in values {
        received[i] = value;
    }
}

/// The neighbours of lumel `i` at these offsets that `may` serve and have a similar normal.
fn beside(
    map: &LumelMap,
    may: &dyn Fn(usize) -> bool,
    i: usize,
    around: [[i64; 2]; 4],
) -> Vec<usize> {
    let received = &map.received;
    (around.into_iter())
        .filter_map(|way| map.beside(i, way))
        .filter(|&j| received[j].normal.dot(received[i].normal) > 0.5)
        .filter(|&j| may(j))
        .collect()
}

/// Those of these lumels that are not behind the backs of single-sided faces, nor outside of the
/// level while others are in a room; all of them if there are only such.
fn before(received: &[Received], mut lumels: Vec<usize>) -> Vec<usize> {
    let room = lumels.iter().any(|&j| received[j].around == Around::Room);
    let outside = |j: usize| room && received[j].around == Around::Outside;
    let is_before = |&j: &usize| !received[j].behind && !outside(j);
    if lumels.iter().any(is_before) {
        lumels.retain(is_before);
    }
    lumels
}

/// Lumel `i` with the blended light of its neighbours; `None` without any.
///
/// The lumel is in a wall, and a partly visible neighbour ends where the wall begins. Lookups in
/// front of the wall read the hidden lumel if more than half of the neighbour is visible, which
/// gives the weights. A wall little thicker than a lumel is read from both sides, of which one may
/// be bright and the other dark. The mean of both would show as light in the dark room, the darker
/// one as a dark line in the bright room. The square of the mean root is a compromise close to
/// perceived brightness.
fn blend(received: &[Received], around: &[usize], i: usize) -> Option<Received> {
    // Neighbours that were hidden themselves have equal weights.
    let read = |j: usize| (received[j].open - 0.5).max(1e-3);
    let all: f32 = around.iter().map(|&j| read(j)).sum();
    let light = |j: usize| luminance(received[j].direct + received[j].indirect).max(0.0);
    let mean = around.iter().map(|&j| read(j) * light(j)).sum::<f32>() / all;
    let root = around
        .iter()
        .map(|&j| read(j) * light(j).sqrt())
        .sum::<f32>()
        / all;
    let dimmed = if mean > 0.0 { root * root / mean } else { 1.0 };
    let (first, own) = (*around.first()?, &received[i]);
    let mut out = Received {
        position: own.position,
        normal: own.normal,
        open: 0.0,
        rays: own.rays,
        edge: own.edge,
        direct: Vec3::ZERO,
        indirect: Vec3::ZERO,
        first_half: Vec3::ZERO,
        planes: vec![Plane::default(); own.planes.len()].into(),
        ..received[first].clone()
    };
    for &j in around {
        let from = &received[j];
        let weight = dimmed * read(j) / all;
        out.direct += from.direct * weight;
        out.indirect += from.indirect * weight;
        out.first_half += from.first_half * weight;
        for (plane, of) in out.planes.iter_mut().zip(&from.planes) {
            plane.direct += of.direct * weight;
            plane.indirect += of.indirect * weight;
            plane.first_half += of.first_half * weight;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_behind_walls_counts_only_alone() {
        let lumel = |behind: bool, around: Around| Received {
            behind,
            around,
            ..Received::default()
        };
        let received = [
            lumel(false, Around::Room),
            lumel(true, Around::Open),
            lumel(false, Around::Outside),
            lumel(false, Around::Open),
        ];
        assert_eq!(before(&received, vec![0, 1, 2, 3]), [0, 3]);
        // Without a room, outside is where people are.
        assert_eq!(before(&received, vec![1, 2, 3]), [2, 3]);
        assert_eq!(before(&received, vec![1]), [1]);
    }
}
