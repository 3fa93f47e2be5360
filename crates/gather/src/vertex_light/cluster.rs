//! Clusters of points on small triangles that share gathered indirect light.
//!
//! Where vertices are closer together than lumels, gathering at each vertex is more accurate than
//! the lightmap, but its cost depends on tessellation. So points within a lumel of each other, on
//! one smooth piece of the mesh and without a wall between them, share one gather over all of their
//! triangles. Direct light, which has the edges, is computed for each point.

use radiosity::{SurfacePoint, World};

use super::sheet::{Sheet, Tri, corners_of};
use crate::parts::LIFT;

/// Extent of a cluster from its first point, in lumels: that of a bilinear lookup.
const REACH: f32 = 1.0;

/// Left-over points join a neighbour's cluster within this distance, in lumels.
const JOIN: f32 = 1.5;

/// Least cosine between the normals of a cluster's points and its first point's: 15°.
const LIKE_NORMAL: f32 = 0.966;

/// Largest distance of points from each other's planes, in lumels; excludes steps and mouldings.
const FLAT: f32 = 0.1;

/// No cluster.
const NONE: u32 = u32::MAX;

/// A point as seen by clustering.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// On the first of the small triangles around it.
    pub at: SurfacePoint,
    /// Size of the lumels there, metres; 0 if there are none.
    pub size: f32,
}

/// Clusters of a sheet's points, from geometry alone, so that lamps do not affect them.
#[derive(Default)]
pub(super) struct Clusters {
    /// For each point, the first point of its cluster.
    pub of: Vec<u32>,
    /// For each point, its spot; `None` without small triangles around it.
    pub spots: Vec<Option<Spot>>,
}

impl Clusters {
    /// Grows a cluster from each point that is in none yet.
    pub fn find(sheet: &Sheet, world: &World) -> Clusters {
        let spots = spots(sheet, world);
        let (starts, next) = neighbours(sheet);
        let mut of = vec![NONE; sheet.points];
        // The first point that last visited each point, so that pairs are compared only once. A
        // point's neighbours are visited once it is in a cluster, and it is in only one, so all of
        // this is linear.
        let mut seen = vec![NONE; sheet.points];
        let mut queue: Vec<u32> = Vec::new();
        for first in 0..sheet.points as u32 {
            if of[first as usize] != NONE {
                continue;
            }
            of[first as usize] = first;
            let Some(own) = spots[first as usize] else {
                continue;
            };
            queue.push(first);
            while let Some(p) = queue.pop() {
                let [start, end] = [p, p + 1].map(|p| starts[p as usize] as usize);
                for &q in &next[start..end] {
                    let k = q as usize;
                    if of[k] == NONE
                        && std::mem::replace(&mut seen[k], first) != first
                        && spots[k].is_some_and(|other| own.goes_with(&other, REACH, world))
                    {
                        of[k] = first;
                        queue.push(q);
                    }
                }
            }
        }
        let mut sizes = vec![0u32; sheet.points];
        of.iter().for_each(|&first| sizes[first as usize] += 1);
        for p in 0..sheet.points {
            let Some(own) = spots[p].filter(|_| sizes[of[p] as usize] == 1) else {
                continue;
            };
            let around = &next[starts[p] as usize..starts[p + 1] as usize];
            let other = around.iter().map(|&q| of[q as usize]).find(|&first| {
                sizes[first as usize] > 1
                    && std::mem::replace(&mut seen[first as usize], p as u32) != p as u32
                    && spots[first as usize].is_some_and(|s| s.goes_with(&own, JOIN, world))
            });
            if let Some(first) = other {
                of[p] = first;
            }
        }
        Clusters { of, spots }
    }
}

impl Spot {
    /// Whether another point within `reach` lumels is on the same piece of surface.
    fn goes_with(&self, other: &Spot, reach: f32, world: &World) -> bool {
        let size = self.size.min(other.size);
        let way = other.at.position - self.at.position;
        let off = [self, other].map(|s| s.at.normal.dot(way).abs());
        way.length_squared() <= (reach * size) * (reach * size)
            && off[0].max(off[1]) <= FLAT * size
            && self.at.normal.dot(other.at.normal) >= LIKE_NORMAL
            && !world.wall_between(&self.at, &other.at, LIFT * size)
    }

    /// Whether anything stands so near on the surface that it may cut the triangles around a point
    /// of this one's cluster, which extend about as far as the cluster.
    pub fn is_beside_something(&self, world: &World) -> bool {
        world.anything_above(&self.at, (JOIN + REACH) * self.size)
    }
}

/// The spot of each point.
fn spots(sheet: &Sheet, world: &World) -> Vec<Option<Spot>> {
    let mut out: Vec<Option<Spot>> = vec![None; sheet.points];
    for tri in small(sheet) {
        let (triangle, order, back) = corners_of(world.soup, tri.face);
        let texels = tri.texels();
        // False for NaN too, i.e. without a chart.
        let size = match texels > 0.0 {
            true => (tri.area / texels).sqrt() as f32,
            false => 0.0,
        };
        for (point, corner) in sheet.points_of(tri).into_iter().zip(order) {
            match &mut out[point] {
                Some(spot) => spot.size = spot.size.min(size),
                slot => {
                    let mut w = [0.0f32; 3];
                    w[usize::from(corner)] = 1.0;
                    let at = world.inset_point(triangle, w[1], w[2], back, true);
                    *slot = Some(Spot { at, size });
                }
            }
        }
    }
    out
}

/// Triangles with too few lumels.
fn small(sheet: &Sheet) -> impl Iterator<Item = &Tri> {
    sheet.tris.iter().filter(|t| !t.moments.measured())
}

/// Points that share a small triangle with each point: the start of each list, and all lists.
fn neighbours(sheet: &Sheet) -> (Vec<u32>, Vec<u32>) {
    let pairs = || {
        small(sheet).flat_map(|tri| {
            let p = sheet.points_of(tri);
            [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)].map(|(a, b)| (p[a], p[b]))
        })
    };
    let mut starts = vec![0u32; sheet.points + 1];
    for (p, _) in pairs() {
        starts[p + 1] += 1;
    }
    for i in 0..sheet.points {
        starts[i + 1] += starts[i];
    }
    let mut next = vec![0u32; starts[sheet.points] as usize];
    let mut at = starts.clone();
    for (p, q) in pairs() {
        next[at[p] as usize] = q as u32;
        at[p] += 1;
    }
    (starts, next)
}
