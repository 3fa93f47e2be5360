//! All triangles of a scene in one world-space list for ray casting.

use std::collections::BTreeSet;

use glam::Vec3;
use rayon::prelude::*;

use crate::geometry::area_vector;
use crate::scene::Scene;

/// World-space (recentred) triangles of every instance, ordered by instance, primitive, triangle.
///
/// Triangles without area in world space are left out and counted. So are exact duplicates of
/// earlier ones, which are also listed in [`duplicates`](Soup::duplicates), because they receive
/// light. A duplicate has the same three corners (in any rotation) and no side that the earlier
/// triangles leave free; a double-sided triangle takes both sides, and occluders count as last.
/// Winding is already flipped for mirroring transforms, so the front is always the
/// counter-clockwise side.
///
/// Triangles of instances that stand in for others
/// ([`Instance::stands_in`](crate::Instance::stands_in)) come last, in the same order. Rays see
/// only those before them, and none of them is a duplicate.
///
/// ```
/// use mesh_ingest::{LoadOptions, Soup, load};
///
/// let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/furnace_cube_50.glb");
/// let soup = Soup::build(&load(file.as_ref(), &LoadOptions::default())?.scene);
/// assert_eq!(soup.triangles.len(), soup.normals.len());
/// assert!(soup.areas.iter().all(|area| *area > 0.0));
/// # Ok::<(), mesh_ingest::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Soup {
    /// Corners, metres, recentred.
    pub triangles: Vec<[Vec3; 3]>,
    /// Unit geometric normal of the front, computed in `f64`.
    pub normals: Vec<Vec3>,
    /// Area in m².
    pub areas: Vec<f32>,
    /// Origin of each triangle.
    pub sources: Vec<TriangleSource>,
    /// Index into [`Scene::materials`] for each triangle.
    pub materials: Vec<u32>,
    /// `[first, end)` of each instance's triangles.
    pub instance_ranges: Vec<[u32; 2]>,
    /// Triangles left out because their world-space area is zero.
    pub dropped_zero_area: u64,
    /// Triangles left out as exact duplicates, ordered by instance, primitive, triangle.
    pub duplicates: Vec<Duplicate>,
    /// `[first, end)` of each instance's duplicates.
    pub duplicate_ranges: Vec<[u32; 2]>,
    /// Number of `duplicates`.
    pub dropped_duplicate: u64,
    /// Number of triangles at the end of the list that rays do not see.
    pub unseen: usize,
    /// Single-sided triangles back to back with another one, sorted by `of`.
    twins: Vec<Twin>,
}

/// The other side of a single-sided triangle: a single-sided triangle with the same corners that
/// faces the other way.
///
/// A ray that meets such a pair hits both at the same distance. It must see the one that faces it,
/// whichever of them the tree reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Twin {
    of: u32,
    /// The triangle that faces the other way.
    pub triangle: u32,
    /// For each of its corners, the corresponding corner of `of`.
    corners: [u8; 3],
}

impl Twin {
    /// The twin's barycentric weights of corners 1 and 2 at the same place.
    pub fn weights(&self, u: f32, v: f32) -> [f32; 2] {
        let own = [1.0 - u - v, u, v];
        [1, 2].map(|k: usize| own[self.corners[k] as usize])
    }
}

/// A triangle that rays never hit, because another one coincides with it.
///
/// Where an index is called a *face*, values from [`Soup::len`] on are duplicates: face `len() + i`
/// is `duplicates[i]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Duplicate {
    /// Its origin.
    pub source: TriangleSource,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// The triangle of the soup that coincides with it.
    pub kept: u32,
    /// For each of its world corners 0, 1, 2, the corresponding corner of `kept`.
    pub corners: [u8; 3],
    /// Whether it faces the other way; `kept` is then double-sided.
    pub turned: bool,
}

/// Origin of a world-space triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TriangleSource {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index into the mesh's primitives.
    pub primitive: u32,
    /// Index into the primitive's triangles.
    pub triangle: u32,
    /// Whether the instance mirrors: world corners 1 and 2 are local corners 2 and 1.
    pub mirrored: bool,
}

/// One instance's primitive that is to be added.
#[derive(Default)]
struct Part {
    triangles: Vec<[Vec3; 3]>,
    normals: Vec<Vec3>,
    areas: Vec<f32>,
    sources: Vec<TriangleSource>,
    dropped: u64,
}

impl Soup {
    /// Flattens `scene` in parallel; the result does not depend on the number of threads. O(n log
    /// n) in triangles, however many coincide.
    pub fn build(scene: &Scene) -> Soup {
        let stands_in = |i: &usize| scene.instances[*i].stands_in.is_some();
        let mut order: Vec<usize> = (0..scene.instances.len()).collect();
        order.sort_by_key(stands_in);
        let jobs: Vec<(u32, u32)> = (order.iter())
            .flat_map(|&i| {
                let mesh = &scene.meshes[scene.instances[i].mesh];
                (0..mesh.primitives.len()).map(move |p| (i as u32, p as u32))
            })
            .collect();
        let parts: Vec<Part> = jobs
            .par_iter()
            .map(|&(instance, primitive)| flatten(scene, instance, primitive))
            .collect();
        let total = parts.iter().map(|part| part.triangles.len()).sum();
        let mut soup = Soup {
            triangles: Vec::with_capacity(total),
            normals: Vec::with_capacity(total),
            areas: Vec::with_capacity(total),
            sources: Vec::with_capacity(total),
            materials: Vec::with_capacity(total),
            ..Soup::default()
        };
        let mut seen = 0;
        for (part, &(instance, primitive)) in parts.into_iter().zip(&jobs) {
            let mesh = &scene.meshes[scene.instances[instance as usize].mesh];
            let material = mesh.primitives[primitive as usize].material as u32;
            soup.materials
                .extend(std::iter::repeat_n(material, part.triangles.len()));
            soup.triangles.extend(part.triangles);
            soup.normals.extend(part.normals);
            soup.areas.extend(part.areas);
            soup.sources.extend(part.sources);
            soup.dropped_zero_area += part.dropped;
            if stands_in(&(instance as usize)) {
                soup.unseen = soup.len() - seen;
            } else {
                seen = soup.len();
            }
        }
        soup.drop_duplicates(scene);
        soup.instance_ranges = ranges(&soup.sources, &order, |s| s.instance);
        order.sort_unstable();
        soup.duplicate_ranges = ranges(&soup.duplicates, &order, |d| d.source.instance);
        soup
    }

    /// Number of triangles that rays see; they come first.
    pub fn seen(&self) -> usize {
        self.len() - self.unseen
    }

    /// The triangles that rays see.
    pub fn seen_triangles(&self) -> &[[Vec3; 3]] {
        &self.triangles[..self.seen()]
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Origin of a face.
    #[inline]
    pub fn source(&self, face: u32) -> TriangleSource {
        match self.sources.get(face as usize) {
            Some(source) => *source,
            None => self.duplicates[face as usize - self.len()].source,
        }
    }

    /// Index into [`Scene::materials`] of a face.
    #[inline]
    pub fn material(&self, face: u32) -> u32 {
        match self.materials.get(face as usize) {
            Some(material) => *material,
            None => self.duplicates[face as usize - self.len()].material,
        }
    }

    /// The duplicate of a face, if it is one.
    #[inline]
    pub fn duplicate(&self, face: u32) -> Option<&Duplicate> {
        self.duplicates
            .get((face as usize).checked_sub(self.len())?)
    }

    /// The triangle back to back with a single-sided one.
    #[inline]
    pub fn twin(&self, triangle: u32) -> Option<&Twin> {
        let at = self.twins.binary_search_by_key(&triangle, |t| t.of).ok()?;
        Some(&self.twins[at])
    }

    /// Triangles whose back is shown by a coincident face that has its own lumels.
    pub fn backed(&self) -> BTreeSet<u32> {
        (self.duplicates.iter().filter(|d| d.turned))
            .map(|d| d.kept)
            .collect()
    }

    /// Drops triangles that add no new side to an earlier one with the same corners: a BVH cannot
    /// separate coincident triangles, so hits among them would be arbitrary.
    fn drop_duplicates(&mut self, scene: &Scene) {
        // Sorting by hash groups equal triangles with 16 bytes per triangle; full keys are compared
        // only within a run of equal hashes.
        let mut order: Vec<(u64, u32)> = self.triangles[..self.seen()]
            .par_iter()
            .enumerate()
            .map(|(i, corners)| (hash(&Key::of(corners)), i as u32))
            .collect();
        order.par_sort_unstable();
        // (Dropped triangle, coinciding triangle.)
        let mut dropped: Vec<(u32, u32)> = Vec::new();
        let mut back_to_back: Vec<[u32; 2]> = Vec::new();
        for run in order
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|run| run.len() > 1)
        {
            let mut members: Vec<(Key, u32)> = run
                .iter()
                .map(|&(_, i)| (Key::of(&self.triangles[i as usize]), i))
                .collect();
            // An occluder casts no additional shadow where it coincides with a surface, and must
            // not take that surface's light.
            members
                .sort_unstable_by_key(|(key, i)| (key.corners, scene.only_occludes(self, *i), *i));
            for equal in members.chunk_by(|a, b| a.0.corners == b.0.corners) {
                // Owner of the side with even winding, and of the other side.
                let mut sides: [Option<u32>; 2] = [None; 2];
                for (key, i) in equal {
                    let double_sided =
                        scene.materials[self.materials[*i as usize] as usize].double_sided;
                    let front = usize::from(key.odd);
                    match sides[front] {
                        Some(kept) if !double_sided || sides[1 - front].is_some() => {
                            dropped.push((*i, kept));
                        }
                        _ => {
                            sides[front].get_or_insert(*i);
                            if double_sided {
                                sides[1 - front].get_or_insert(*i);
                            }
                        }
                    }
                }
                if let [Some(a), Some(b)] = sides
                    && a != b
                {
                    back_to_back.extend([[a, b], [b, a]]);
                }
            }
        }
        back_to_back.sort_unstable();
        if dropped.is_empty() {
            self.find_twins(&back_to_back, |i| i);
            return;
        }
        dropped.sort_unstable();
        self.dropped_duplicate = dropped.len() as u64;
        let mut keep = vec![true; self.triangles.len()];
        for &(i, _) in &dropped {
            keep[i as usize] = false;
        }
        let before: Vec<u32> = (keep.iter())
            .scan(0, |kept, k| {
                *kept += u32::from(*k);
                Some(*kept - u32::from(*k))
            })
            .collect();
        self.find_twins(&back_to_back, |i| before[i as usize]);
        self.duplicates = (dropped.iter())
            .map(|&(i, kept)| {
                let (own, other) = (self.order(i), self.order(kept));
                Duplicate {
                    source: self.sources[i as usize],
                    material: self.materials[i as usize],
                    kept: before[kept as usize],
                    corners: own.corners_of(&other),
                    turned: own.odd != other.odd,
                }
            })
            .collect();
        retain(&mut self.triangles, &keep);
        retain(&mut self.normals, &keep);
        retain(&mut self.areas, &keep);
        retain(&mut self.sources, &keep);
        retain(&mut self.materials, &keep);
    }

    /// Records pairs of a triangle and its twin, in ascending order; `renamed` gives the index of a
    /// triangle once duplicates are dropped.
    fn find_twins(&mut self, pairs: &[[u32; 2]], renamed: impl Fn(u32) -> u32) {
        self.twins = (pairs.iter())
            .map(|&[of, triangle]| Twin {
                of: renamed(of),
                triangle: renamed(triangle),
                corners: self.order(triangle).corners_of(&self.order(of)),
            })
            .collect();
    }

    fn order(&self, triangle: u32) -> Key {
        Key::of(&self.triangles[triangle as usize])
    }
}

/// `[first, end)` of each instance in a list sorted in the order of instances in `order`.
fn ranges<T>(list: &[T], order: &[usize], instance_of: impl Fn(&T) -> u32) -> Vec<[u32; 2]> {
    let mut out = vec![[0; 2]; order.len()];
    let mut at = 0;
    for &i in order {
        let first = at;
        while at < list.len() && instance_of(&list[at]) as usize == i {
            at += 1;
        }
        out[i] = [first as u32, at as u32];
    }
    out
}

fn flatten(scene: &Scene, instance: u32, primitive: u32) -> Part {
    let placed = &scene.instances[instance as usize];
    let source = &scene.meshes[placed.mesh].primitives[primitive as usize];
    let mirrored = placed.transform.matrix3.determinant() < 0.0;
    // Subtracted in f64 and rounded once, so that neighbours that share a vertex share its bits.
    let positions: Vec<Vec3> = source
        .positions
        .iter()
        .map(|p| (placed.transform.transform_point3(p.as_dvec3()) - scene.origin).as_vec3())
        .collect();
    let mut part = Part::default();
    for (t, corners) in source.triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|i| positions[i as usize]);
        let [a, b, c] = if mirrored { [a, c, b] } else { [a, b, c] };
        let double_area = area_vector(a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
        let area = double_area.map_or(0.0, |n| (0.5 * n.length()) as f32);
        let normal = double_area.map_or(Vec3::ZERO, |n| n.normalize().as_vec3());
        // Areas that are subnormal in f32 (edges below about 1e-19 m) would later give infinity in
        // divisions.
        if area < f32::MIN_POSITIVE || !area.is_finite() || !normal.is_finite() {
            part.dropped += 1;
            continue;
        }
        part.triangles.push([a, b, c]);
        part.normals.push(normal);
        part.areas.push(area);
        part.sources.push(TriangleSource {
            instance,
            primitive,
            triangle: t as u32,
            mirrored,
        });
    }
    part
}

/// A triangle's corners in a canonical order, and whether that order reverses its winding.
struct Key {
    corners: [[u32; 3]; 3],
    /// The triangle's corner at each position.
    places: [u8; 3],
    odd: bool,
}

impl Key {
    fn of(corners: &[Vec3; 3]) -> Key {
        // Adding zero turns −0 into +0, which is the same position.
        let mut k = corners.map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
        let (mut places, mut odd) = ([0, 1, 2], false);
        for (i, j) in [(0, 1), (1, 2), (0, 1)] {
            if k[i] > k[j] {
                k.swap(i, j);
                places.swap(i, j);
                odd = !odd;
            }
        }
        Key {
            corners: k,
            places,
            odd,
        }
    }

    /// For each of the triangle's corners, the corresponding corner of another one with the same
    /// corners.
    fn corners_of(&self, other: &Key) -> [u8; 3] {
        let mut corners = [0; 3];
        for (own, of) in self.places.into_iter().zip(other.places) {
            corners[own as usize] = of;
        }
        corners
    }
}

/// Multiply-xorshift over the nine words (constants: 2⁶⁴/φ, and Vigna's splitmix64 finaliser,
/// public domain). Collisions only cost time, and equal bits give equal hashes on every machine.
fn hash(key: &Key) -> u64 {
    let mut h = 0u64;
    for word in key.corners.as_flattened() {
        h = (h ^ u64::from(*word)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^= h >> 29;
    }
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^ (h >> 27)
}

fn retain<T>(list: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    list.retain(|_| flags.next().copied().unwrap_or(true));
}
