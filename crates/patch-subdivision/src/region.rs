//! Regions: connected, nearly flat groups of triangles that share one grid.

use glam::Vec3;
use mesh_ingest::Soup;
use rayon::prelude::*;

use crate::adjacency::Adjacency;

/// Index of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RegionId(pub u32);

/// How triangles are grouped into regions.
#[derive(Debug, Clone, Copy)]
pub struct RegionOptions {
    /// Faces within this angle of the first one belong to its plane, at any distance. 15° keeps the
    /// projected area within 1/cos 15° = 1.035 of the true one, so grid cells have about their
    /// nominal size.
    pub flat_angle: f32,
    /// Faces within this angle belong if they are within one patch size of the first: small detail
    /// is clustered. At 60° a cluster's mean irradiance still represents one side of an object
    /// rather than all of it.
    pub cluster_angle: f32,
}

impl Default for RegionOptions {
    fn default() -> Self {
        RegionOptions {
            flat_angle: 15f32.to_radians(),
            cluster_angle: 60f32.to_radians(),
        }
    }
}

/// The result of [`gather_regions`].
pub(crate) struct Regions {
    /// Region of each triangle.
    pub of_triangle: Vec<u32>,
    /// Triangles of each region, in ascending order, in compressed rows.
    pub starts: Vec<u32>,
    pub triangles: Vec<u32>,
    /// Whether the region was merged from disconnected pieces.
    pub cluster: Vec<bool>,
}

impl Regions {
    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    pub(crate) fn triangles(&self, region: usize) -> &[u32] {
        &self.triangles[self.starts[region] as usize..self.starts[region + 1] as usize]
    }
}

/// What regions are made of: how triangles are connected, and their order by area.
pub(crate) struct Connected {
    adjacency: Adjacency,
    /// Large faces first: walls and floors become whole regions, and details group around the rest.
    order: Vec<u32>,
}

impl Connected {
    /// `two_sided` says of each triangle whether both sides reflect or emit: a region has only one
    /// kind.
    pub(crate) fn new(soup: &Soup, two_sided: impl Fn(usize) -> bool + Sync) -> Self {
        let adjacency = Adjacency::build(soup.seen_triangles(), |t| {
            2 * soup.sources[t].instance + two_sided(t) as u32
        });
        let mut order: Vec<u32> = (0..soup.seen() as u32).collect();
        order.sort_by(|&a, &b| {
            soup.areas[b as usize]
                .total_cmp(&soup.areas[a as usize])
                .then(a.cmp(&b))
        });
        Connected { adjacency, order }
    }

    /// Areas of the flat pieces of surface, without details that patches of some size cluster.
    pub(crate) fn flat_areas(&self, soup: &Soup, options: &RegionOptions) -> Vec<f64> {
        let (of_triangle, regions) = self.flood(soup, 0.0, options);
        let mut areas = vec![0.0; regions as usize];
        for (region, area) in of_triangle.into_iter().zip(&soup.areas) {
            areas[region as usize] += f64::from(*area);
        }
        areas
    }

    /// Of each triangle, the largest extent of all that is connected to it, metres.
    fn extents(&self, soup: &Soup) -> Vec<f32> {
        let mut extents = vec![-1.0; self.order.len()];
        let mut members = Vec::new();
        for first in 0..extents.len() {
            if extents[first] >= 0.0 {
                continue;
            }
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            extents[first] = 0.0;
            members.push(first as u32);
            let mut next = 0;
            while let Some(&t) = members.get(next) {
                next += 1;
                for p in soup.triangles[t as usize] {
                    (low, high) = (low.min(p), high.max(p));
                }
                for &m in self.adjacency.of(t) {
                    if extents[m as usize] < 0.0 {
                        extents[m as usize] = 0.0;
                        members.push(m);
                    }
                }
            }
            for t in members.drain(..) {
                extents[t as usize] = (high - low).max_element();
            }
        }
        extents
    }

    /// The triangles that share an edge with a triangle.
    pub(crate) fn beside(&self, triangle: u32) -> &[u32] {
        self.adjacency.of(triangle)
    }

    /// The region of each triangle, and their number.
    pub(crate) fn flood(&self, soup: &Soup, size: f32, options: &RegionOptions) -> (Vec<u32>, u32) {
        let centroid =
            |t: usize| (soup.triangles[t][0] + soup.triangles[t][1] + soup.triangles[t][2]) / 3.0;
        let (cos_flat, cos_cluster) = (
            libm::cosf(options.flat_angle),
            libm::cosf(options.cluster_angle),
        );
        let mut of_triangle = vec![u32::MAX; self.order.len()];
        let mut regions = 0u32;
        let mut stack = Vec::new();
        for &seed in &self.order {
            if of_triangle[seed as usize] != u32::MAX {
                continue;
            }
            let (normal, centre) = (soup.normals[seed as usize], centroid(seed as usize));
            of_triangle[seed as usize] = regions;
            stack.push(seed);
            while let Some(t) = stack.pop() {
                for &m in self.adjacency.of(t) {
                    let m = m as usize;
                    if of_triangle[m] != u32::MAX {
                        continue;
                    }
                    let cos = normal.dot(soup.normals[m]);
                    let near = || {
                        soup.triangles[m]
                            .iter()
                            .all(|p| p.distance_squared(centre) < 0.25 * size * size)
                    };
                    if cos > cos_flat || (cos > cos_cluster && near()) {
                        of_triangle[m] = regions;
                        stack.push(m as u32);
                    }
                }
            }
            regions += 1;
        }
        (of_triangle, regions)
    }
}

/// Groups triangles into regions; `size` is the nominal patch size in metres.
pub(crate) fn gather_regions(
    soup: &Soup,
    connected: &Connected,
    two_sided: impl Fn(usize) -> bool + Sync,
    between: &Between,
    size: f32,
    options: &RegionOptions,
) -> Regions {
    let (mut of_triangle, regions) = connected.flood(soup, size, options);
    let apart = Apart {
        between,
        extents: connected.extents(soup),
    };
    merge_small(soup, &two_sided, &apart, size, &mut of_triangle, regions)
}

/// Whether one of the opaque triangles of the [`Soup`] between two points is such as the third
/// argument says.
pub type Between<'a> = dyn Fn(Vec3, Vec3, &dyn Fn(u32) -> bool) -> bool + Sync + 'a;

/// Tells whether small pieces of surface are in different places.
struct Apart<'a> {
    between: &'a Between<'a>,
    /// Of each triangle, the largest extent of what it is connected to, metres.
    extents: Vec<f32>,
}

impl Apart<'_> {
    /// Whether something larger than the voxel, e.g. a wall or a cloth, stands between two points:
    /// neither sees the other, nor do both see one of six points about the middle.
    fn are(&self, a: Vec3, b: Vec3, voxel: f32) -> bool {
        let large = |t: u32| self.extents[t as usize] > voxel;
        let open = |from: Vec3, to: Vec3| !(self.between)(from, to, &large);
        // A thousandth beyond, so that something through the middle itself is met.
        let reaches = |from: Vec3, via: Vec3| open(from, via + 1e-3 * (via - from));
        let middle = 0.5 * (a + b);
        let aside = |axis: Vec3| {
            [0.5 * voxel, -0.5 * voxel].into_iter().any(|far| {
                let via = middle + far * axis;
                reaches(a, via) && reaches(b, via)
            })
        };
        !open(a, b) && !Vec3::AXES.into_iter().any(aside)
    }
}

/// Merges regions much smaller than a patch if they are in the same voxel and face the same way:
/// leaves of a tree, links of a chain, and other small disconnected pieces. If a voxel of one patch
/// size contains little, voxels of up to four times the size are tried, because sparse grass needs
/// no patch per blade.
///
/// Pieces that something large separates stay apart: the folds of a curtain face the same way on
/// the side of a courtyard and on that of a gallery, which is a hundred times darker.
fn merge_small(
    soup: &Soup,
    two_sided: &impl Fn(usize) -> bool,
    apart: &Apart,
    size: f32,
    of_triangle: &mut [u32],
    regions: u32,
) -> Regions {
    let mut parts: Vec<Part> = (0..regions).map(|_| Part::default()).collect();
    for (t, &r) in of_triangle.iter().enumerate() {
        parts[r as usize].add(soup, t, two_sided(t));
    }
    // The part that each region belongs to so far.
    let mut now: Vec<u32> = (0..regions).collect();
    for level in 0..3 {
        let voxel = size * (1 << level) as f32;
        let small = |p: &Part| p.area < 0.125 * (size * size) as f64 && p.extent() <= voxel;
        let mut keys: Vec<([i32; 4], u32)> = (0..parts.len() as u32)
            .filter(|&i| parts[i as usize].alive && small(&parts[i as usize]))
            .map(|i| (parts[i as usize].key(voxel), i))
            .collect();
        keys.sort_unstable();
        let mut joined: Vec<u32> = (0..parts.len() as u32).collect();
        let pairs: Vec<[u32; 2]> = keys
            .par_chunk_by(|a, b| a.0 == b.0)
            .flat_map_iter(|run| {
                let mut places: Vec<u32> = Vec::new();
                let at = |part: u32| parts[part as usize].point;
                run.iter().filter_map(move |&(_, part)| {
                    let with = |place: &&u32| !apart.are(at(**place), at(part), voxel);
                    let place = places.iter().find(with).copied();
                    if place.is_none() && places.len() < PLACES {
                        places.push(part);
                        return None;
                    }
                    let far = |place: &u32| at(*place).distance_squared(at(part));
                    let nearest = || {
                        let nearer = |a: &u32, b: &u32| far(a).total_cmp(&far(b));
                        places.iter().copied().min_by(nearer)
                    };
                    Some([place.or_else(nearest)?, part])
                })
            })
            .collect();
        for [place, other] in pairs {
            let other_part = std::mem::take(&mut parts[other as usize]);
            parts[place as usize].join(&other_part);
            joined[other as usize] = place;
        }
        for p in &mut now {
            *p = joined[*p as usize];
        }
    }
    // Numbers regions by their first triangle, so that the numbering does not depend on the keys.
    let mut final_id = vec![u32::MAX; regions as usize];
    let mut cluster = Vec::new();
    for r in of_triangle.iter_mut() {
        let part = now[*r as usize] as usize;
        if final_id[part] == u32::MAX {
            final_id[part] = cluster.len() as u32;
            cluster.push(parts[part].cluster);
        }
        *r = final_id[part];
    }
    let mut starts = vec![0u32; cluster.len() + 1];
    for &r in of_triangle.iter() {
        starts[r as usize + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut fill = starts.clone();
    let mut triangles = vec![0u32; of_triangle.len()];
    for (t, &r) in of_triangle.iter().enumerate() {
        triangles[fill[r as usize] as usize] = t as u32;
        fill[r as usize] += 1;
    }
    Regions {
        of_triangle: of_triangle.to_vec(),
        starts,
        triangles,
        cluster,
    }
}

/// Most places in a voxel that are kept apart, which bounds patches and rays: behind the layers of a
/// heap of rags nobody sees the difference.
const PLACES: usize = 4;

/// A region while regions are being merged.
struct Part {
    alive: bool,
    cluster: bool,
    two_sided: bool,
    area: f64,
    normal: Vec3,
    low: Vec3,
    high: Vec3,
    /// A point just above its largest triangle, and that triangle's area.
    point: Vec3,
    largest: f32,
}

impl Default for Part {
    fn default() -> Self {
        Part {
            alive: false,
            cluster: false,
            two_sided: false,
            area: 0.0,
            normal: Vec3::ZERO,
            low: Vec3::INFINITY,
            high: Vec3::NEG_INFINITY,
            point: Vec3::ZERO,
            largest: -1.0,
        }
    }
}

impl Part {
    fn add(&mut self, soup: &Soup, t: usize, two_sided: bool) {
        self.alive = true;
        self.two_sided = two_sided;
        self.area += soup.areas[t] as f64;
        self.normal += soup.normals[t] * soup.areas[t];
        for p in soup.triangles[t] {
            self.low = self.low.min(p);
            self.high = self.high.max(p);
        }
        if soup.areas[t] > self.largest {
            let [a, b, c] = soup.triangles[t];
            let lift = 1e-3 * libm::sqrtf(soup.areas[t]);
            (self.point, self.largest) =
                ((a + b + c) / 3.0 + lift * soup.normals[t], soup.areas[t]);
        }
    }

    fn join(&mut self, other: &Part) {
        self.cluster = true;
        self.area += other.area;
        self.normal += other.normal;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }

    fn extent(&self) -> f32 {
        (self.high - self.low).max_element()
    }

    /// Facing (one of six directions, separately for one- and two-sided faces) and voxel.
    fn key(&self, voxel: f32) -> [i32; 4] {
        let v = ((self.low + self.high) * 0.5 / voxel).floor();
        let axis = self.normal.abs().max_position();
        let facing = 2 * axis as i32 + (self.normal[axis] < 0.0) as i32;
        [
            facing + 6 * self.two_sided as i32,
            v.x as i32,
            v.y as i32,
            v.z as i32,
        ]
    }
}
