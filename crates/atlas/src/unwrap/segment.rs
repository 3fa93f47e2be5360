//! Cuts a mesh into groups of faces that can be flattened: each connected, without a seam inside,
//! and seen from the front from one direction.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use rayon::prelude::*;

use super::input::{NONE, UnwrapInput};
use super::rigid::is_sliver;

/// Largest angle between a face's normal and the mean of its group, degrees. Below 90 a projection
/// along the mean turns no face over.
const CONE_DEGREES: f64 = 70.0;

/// Faces whose normals are within 0.25° (its cosine) of the first one's are one flat region, which
/// is never cut.
const COPLANAR: f64 = 1.0 - 1e-5;

/// Rounds in which normals are averaged with those of neighbours before groups grow: on scans,
/// whose normals are noisy, borders would be combs.
const SMOOTHING: usize = 8;

/// Normals are averaged across edges that bend by less than 30° (its cosine).
const SMOOTH: f64 = 0.866_025_4;

/// Weights of what makes a region a worse continuation of a group, and the most that is accepted:
/// as in xatlas. Costs are kept in millionths, so that they can be ordered.
const DEVIATION: f64 = 2.0;
const STRAIGHTNESS: f64 = 6.0;
const CREASE: f64 = 4.0;
const MOST: f64 = 2.0;

/// Area in lumels below which a group goes to a neighbour where it can: the free texels around a
/// chart of four by four are more than the chart.
const SMALL: f64 = 16.0;

/// Rounds in which small groups go to a neighbour.
const MERGING: usize = 4;

/// The groups of `mesh`, each in the order of its triangles.
pub(super) fn segment(mesh: &UnwrapInput, lumel: f64) -> Vec<Vec<u32>> {
    let (part, count) = mesh.components(|t, k| !mesh.seams[t][k]);
    let mut parts = vec![Vec::new(); count as usize];
    let mut place = vec![0; part.len()];
    for (t, &p) in part.iter().enumerate() {
        let list: &mut Vec<u32> = &mut parts[p as usize];
        place[t] = list.len() as u32;
        list.push(t as u32);
    }
    let mut normals = mesh.face_normals();
    let mut areas = mesh.areas();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        if is_sliver(corners.map(|v| mesh.positions[v as usize].as_dvec3())) {
            (normals[t], areas[t]) = (DVec3::ZERO, 0.0);
        }
    }
    let surface = Surface {
        smooth: smoothed(mesh, &normals, &areas),
        mesh,
        normals,
        areas,
        place,
        cone: CONE_DEGREES.to_radians(),
        small: SMALL * lumel * lumel,
    };
    parts
        .into_par_iter()
        .flat_map_iter(|faces| surface.groups(faces))
        .collect()
}

/// Normals averaged with those of neighbours, weighted by area.
fn smoothed(mesh: &UnwrapInput, normals: &[DVec3], areas: &[f64]) -> Vec<DVec3> {
    let near: Vec<[u32; 3]> = (0..normals.len())
        .into_par_iter()
        .map(|t| {
            mesh.neighbors[t].map(|u| {
                if u != NONE && normals[t].dot(normals[u as usize]) >= SMOOTH {
                    u
                } else {
                    NONE
                }
            })
        })
        .collect();
    let mut sums: Vec<DVec3> = normals.iter().zip(areas).map(|(&n, &a)| n * a).collect();
    for _ in 0..SMOOTHING {
        sums = sums
            .par_iter()
            .zip(&near)
            .map(|(&sum, near)| {
                let others = near.iter().filter(|&&u| u != NONE);
                others.fold(sum, |sum, &u| sum + sums[u as usize])
            })
            .collect();
    }
    sums.iter()
        .zip(normals)
        .map(|(sum, &n)| sum.normalize_or(n))
        .collect()
}

struct Surface<'a> {
    mesh: &'a UnwrapInput,
    normals: Vec<DVec3>,
    smooth: Vec<DVec3>,
    areas: Vec<f64>,
    /// Position of each face in the list of its part.
    place: Vec<u32>,
    /// Angle of the cone.
    cone: f64,
    /// Area of a group that is better merged, m².
    small: f64,
}

impl Surface<'_> {
    /// The groups of one connected part.
    fn groups(&self, faces: Vec<u32>) -> Vec<Vec<u32>> {
        let mean: DVec3 = faces
            .iter()
            .map(|&t| self.normals[t as usize] * self.areas[t as usize])
            .sum();
        let mean = mean.normalize_or_zero();
        let seen = |&t: &u32| {
            let n = self.normals[t as usize];
            n == DVec3::ZERO || n.dot(mean) >= libm::cos(self.cone)
        };
        if faces.iter().all(seen) {
            return vec![faces];
        }
        let regions = Regions::new(self, &faces);
        let mut growth = Growth::new(&regions, self.cone);
        growth.grow();
        growth.merge(self.small);
        let mut groups = vec![Vec::new(); growth.groups.len()];
        for (&t, &region) in faces.iter().zip(&regions.of) {
            groups[growth.group[region as usize] as usize].push(t);
        }
        groups.retain(|g| !g.is_empty());
        groups
    }
}

/// The border of a region with another.
struct Link {
    other: u32,
    length: f64,
    /// Length times one minus the cosine of the bend.
    crease: f64,
}

#[derive(Default)]
struct Region {
    /// Sum of the smoothed normals, by area.
    sum: DVec3,
    normal: DVec3,
    area: f64,
    perimeter: f64,
    links: Vec<Link>,
}

/// Flat regions of one part: the faces that no group's border may separate.
struct Regions {
    /// Region of each face, in the order of the part.
    of: Vec<u32>,
    regions: Vec<Region>,
}

impl Regions {
    fn new(surface: &Surface<'_>, faces: &[u32]) -> Regions {
        let mesh = surface.mesh;
        let across = |t: u32, k: usize| {
            let u = mesh.neighbors[t as usize][k];
            (u != NONE && !mesh.seams[t as usize][k]).then_some(u)
        };
        let mut of = vec![NONE; faces.len()];
        let mut count = 0;
        let mut stack = Vec::new();
        for (i, &seed) in faces.iter().enumerate() {
            if of[i] != NONE {
                continue;
            }
            of[i] = count;
            stack.push(seed);
            let normal = surface.normals[seed as usize];
            while let Some(t) = stack.pop() {
                for u in (0..3).filter_map(|k| across(t, k)) {
                    let slot = &mut of[surface.place[u as usize] as usize];
                    if *slot == NONE && surface.normals[u as usize].dot(normal) >= COPLANAR {
                        *slot = count;
                        stack.push(u);
                    }
                }
            }
            count += 1;
        }
        let mut regions: Vec<Region> = (0..count).map(|_| Region::default()).collect();
        let mut links = Vec::new();
        for (&t, &r) in faces.iter().zip(&of) {
            let region = &mut regions[r as usize];
            let (normal, area) = (surface.normals[t as usize], surface.areas[t as usize]);
            region.sum += surface.smooth[t as usize] * area;
            region.area += area;
            let corners = mesh.triangles[t as usize];
            for k in 0..3 {
                let other = across(t, k).map(|u| (u, of[surface.place[u as usize] as usize]));
                if other.is_some_and(|(_, o)| o == r) {
                    continue;
                }
                let [a, b] = [corners[k], corners[(k + 1) % 3]]
                    .map(|v| mesh.positions[v as usize].as_dvec3());
                let length = a.distance(b);
                region.perimeter += length;
                if let Some((u, other)) = other {
                    let bend = 1.0 - normal.dot(surface.normals[u as usize]);
                    links.push((r, other, length, length * bend.max(0.0)));
                }
            }
        }
        links.sort_by_key(|l| (l.0, l.1));
        for run in links.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            regions[run[0].0 as usize].links.push(Link {
                other: run[0].1,
                length: run.iter().map(|l| l.2).sum(),
                crease: run.iter().map(|l| l.3).sum(),
            });
        }
        for region in &mut regions {
            region.normal = region.sum.normalize_or_zero();
        }
        Regions { of, regions }
    }
}

#[derive(Default)]
struct Group {
    sum: DVec3,
    area: f64,
    boundary: f64,
    regions: Vec<u32>,
    /// No normal is further from the mean than this angle.
    spread: f64,
}

impl Group {
    /// Largest angle between a normal of the group's regions and `mean`.
    fn widest(&self, regions: &[Region], mean: DVec3) -> f64 {
        let normals = self.regions.iter().map(|&r| regions[r as usize].normal);
        let normals = normals.filter(|&n| n != DVec3::ZERO);
        normals.fold(0.0, |most: f64, n| most.max(angle(n, mean)))
    }
}

/// Between two unit vectors.
fn angle(a: DVec3, b: DVec3) -> f64 {
    libm::acos(a.dot(b).clamp(-1.0, 1.0))
}

/// What a region and the group that grows have in common.
#[derive(Clone)]
struct Border {
    group: u32,
    length: f64,
    crease: f64,
}

/// Groups that grow over the regions.
struct Growth<'a> {
    regions: &'a [Region],
    /// Angle of the cone.
    cone: f64,
    /// Group of each region.
    group: Vec<u32>,
    groups: Vec<Group>,
    /// Border of each region with the last group that touched it.
    borders: Vec<Border>,
}

impl<'a> Growth<'a> {
    fn new(regions: &'a Regions, cone: f64) -> Self {
        Growth {
            regions: &regions.regions,
            cone,
            group: vec![NONE; regions.regions.len()],
            groups: Vec::new(),
            borders: vec![
                Border {
                    group: NONE,
                    length: 0.0,
                    crease: 0.0,
                };
                regions.regions.len()
            ],
        }
    }

    /// One group after the other, from the largest region that is left, always by the region that
    /// continues it best.
    fn grow(&mut self) {
        let mut seeds: Vec<u32> = (0..self.regions.len() as u32).collect();
        let area = |&r: &u32| self.regions[r as usize].area;
        seeds.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.cmp(b)));
        let mut next = BinaryHeap::new();
        for seed in seeds {
            if self.group[seed as usize] != NONE {
                continue;
            }
            self.groups.push(Group::default());
            self.take(seed);
            self.offer(seed, &mut next);
            while let Some(Reverse((offered, r))) = next.pop() {
                if self.group[r as usize] != NONE {
                    continue;
                }
                // The group has grown since: what has become dearer goes back.
                let Some(cost) = self.cost(r) else {
                    continue;
                };
                if cost > offered {
                    next.push(Reverse((cost, r)));
                    continue;
                }
                self.take(r);
                self.offer(r, &mut next);
            }
        }
    }

    /// Gives region `r` to the last group.
    fn take(&mut self, r: u32) {
        let own = self.groups.len() as u32 - 1;
        let region = &self.regions[r as usize];
        let border = &self.borders[r as usize];
        let inside = if border.group == own {
            border.length
        } else {
            0.0
        };
        let group = &mut self.groups[own as usize];
        group.sum += region.sum;
        group.area += region.area;
        group.boundary += region.perimeter - 2.0 * inside;
        group.regions.push(r);
        self.group[r as usize] = own;
        for link in &region.links {
            let border = &mut self.borders[link.other as usize];
            if border.group != own {
                (border.group, border.length, border.crease) = (own, 0.0, 0.0);
            }
            border.length += link.length;
            border.crease += link.crease;
        }
    }

    /// Puts the free neighbours of `r` on the list of candidates.
    fn offer(&self, r: u32, next: &mut BinaryHeap<Reverse<(i64, u32)>>) {
        for link in &self.regions[r as usize].links {
            if self.group[link.other as usize] == NONE
                && let Some(cost) = self.cost(link.other)
            {
                next.push(Reverse((cost, link.other)));
            }
        }
    }

    /// What it costs the last group to take region `r`; `None` if it may not.
    fn cost(&self, r: u32) -> Option<i64> {
        let own = self.groups.len() - 1;
        let region = &self.regions[r as usize];
        let border = &self.borders[r as usize];
        if border.group != own as u32 || border.length <= 0.0 {
            return None;
        }
        // A sliver goes with anyone.
        let along = if region.normal == DVec3::ZERO {
            1.0
        } else {
            region.normal.dot(self.groups[own].sum.normalize_or_zero())
        };
        // Negative where the region fills a notch.
        let straight = ((region.perimeter - 2.0 * border.length) / region.perimeter).min(0.0);
        let cost = DEVIATION * (1.0 - along)
            + STRAIGHTNESS * straight
            + CREASE * border.crease / border.length;
        let may = along >= libm::cos(self.cone) && cost <= MOST;
        may.then_some((cost * 1e6) as i64)
    }

    /// Gives small groups, and those that another one surrounds, to the neighbour with the longest
    /// common border, where the cone allows it.
    fn merge(&mut self, small: f64) {
        for group in &mut self.groups {
            group.spread = group.widest(self.regions, group.sum.normalize_or_zero());
        }
        for _ in 0..MERGING {
            let mut order: Vec<usize> = (0..self.groups.len())
                .filter(|&g| !self.groups[g].regions.is_empty())
                .collect();
            let area = |&g: &usize| self.groups[g].area;
            order.sort_by(|a, b| area(a).total_cmp(&area(b)).then(a.cmp(b)));
            let mut changed = false;
            for g in order {
                changed |= self.merge_one(g, small);
            }
            if !changed {
                break;
            }
        }
    }

    fn merge_one(&mut self, g: usize, small: f64) -> bool {
        let group = &self.groups[g];
        let mut borders: Vec<(u32, f64)> = group
            .regions
            .iter()
            .flat_map(|&r| &self.regions[r as usize].links)
            .map(|l| (self.group[l.other as usize], l.length))
            .filter(|&(other, _)| other as usize != g)
            .collect();
        borders.sort_by_key(|b| b.0);
        let longest = borders
            .chunk_by(|x, y| x.0 == y.0)
            .map(|run| (run[0].0 as usize, run.iter().map(|b| b.1).sum::<f64>()))
            .max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)));
        let Some((other, length)) = longest else {
            return false;
        };
        let share = length / group.boundary.max(f64::MIN_POSITIVE);
        if !(share >= 0.5 || group.area < small && share >= 0.25 || group.area < 0.1 * small) {
            return false;
        }
        // The other group may be large: by how far its mean turns is a bound for all its normals.
        let to = &self.groups[other];
        let mean = (group.sum + to.sum).normalize_or_zero();
        let turned = to.spread + angle(to.sum.normalize_or_zero(), mean);
        let spread = turned.max(group.widest(self.regions, mean));
        if spread > self.cone {
            return false;
        }
        let moved = std::mem::take(&mut self.groups[g]);
        for &r in &moved.regions {
            self.group[r as usize] = other as u32;
        }
        let group = &mut self.groups[other];
        group.spread = spread;
        group.sum += moved.sum;
        group.area += moved.area;
        group.boundary += moved.boundary - 2.0 * length;
        group.regions.extend(moved.regions);
        true
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, Vec3};
    use mesh_ingest::{Mesh, Primitive};

    use super::*;

    /// A tube of radius 1 and length 4, in `sides` flat sides that share their corners.
    fn tube(sides: u32) -> UnwrapInput {
        let at = |i: u32, x: f32| {
            let angle = std::f32::consts::TAU * i as f32 / sides as f32;
            Vec3::new(x, libm::sinf(angle), libm::cosf(angle))
        };
        let positions: Vec<Vec3> = (0..sides).flat_map(|i| [at(i, 0.0), at(i, 4.0)]).collect();
        let normals = positions.iter().map(|p| Vec3::new(0.0, p.y, p.z)).collect();
        let triangles = (0..sides)
            .flat_map(|i| {
                let (a, b) = (2 * i, 2 * ((i + 1) % sides));
                [[a, a + 1, b], [b, a + 1, b + 1]]
            })
            .collect();
        let primitive = Primitive {
            positions,
            normals,
            triangles,
            ..Primitive::default()
        };
        let mesh = Mesh {
            primitives: vec![primitive],
            ..Mesh::default()
        };
        UnwrapInput::from_mesh(&mesh, DMat3::IDENTITY)
    }

    #[test]
    fn every_face_is_in_one_group_and_seen_from_one_direction() {
        let mesh = tube(64);
        let groups = segment(&mesh, 0.01);
        let mut all: Vec<u32> = groups.concat();
        all.sort_unstable();
        assert_eq!(all, (0..128).collect::<Vec<u32>>());
        let normals = mesh.face_normals();
        for group in &groups {
            let of = |t: &u32| normals[*t as usize];
            let mean = group.iter().map(of).sum::<DVec3>().normalize();
            // Smoothing turns a normal by up to eight sides of 5.6°.
            let limit = libm::cos((CONE_DEGREES + 45.0_f64).to_radians());
            assert!(group.iter().all(|t| of(t).dot(mean) > limit), "{group:?}");
        }
        // A cone of 70° to either side holds 140° of the 360.
        assert!((3..=4).contains(&groups.len()), "{}", groups.len());
    }

    #[test]
    fn a_flat_side_is_never_cut() {
        for group in segment(&tube(8), 0.01) {
            assert!(
                group.chunks(2).all(|side| side[0] / 2 == side[1] / 2),
                "{group:?}"
            );
        }
    }

    #[test]
    fn groups_of_less_than_sixteen_lumels_go_to_their_neighbours() {
        // Sides that bend by 60° are too dear to grow over, and two in five of a side's border are
        // with each neighbour. They merge in pairs; two pairs do not fit a cone of 70°.
        let [fine, coarse] = [0.01, 4.0].map(|lumel| segment(&tube(6), lumel).len());
        assert_eq!((fine, coarse), (6, 3));
        // 90° is a border.
        assert_eq!(segment(&tube(4), 4.0).len(), 4);
    }
}
