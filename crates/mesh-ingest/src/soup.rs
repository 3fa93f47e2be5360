//! All triangles of a scene in one world-space list: what rays hit.

use glam::Vec3;
use rayon::prelude::*;

use crate::geometry::area_vector;
use crate::scene::Scene;

/// World-space (recentred) triangles of every instance, in the order instance, primitive, triangle.
///
/// Triangles whose area vanishes in world space, or which coincide exactly with an earlier one (same three corners, any
/// rotation, and no side that the earlier ones leave free: a double-sided triangle takes both; occluders count as last), are left out and counted. Winding is already flipped for mirroring transforms, so the
/// front is always the counter-clockwise side.
#[derive(Debug, Clone, Default)]
pub struct Soup {
    /// Corners, metres, recentred.
    pub triangles: Vec<[Vec3; 3]>,
    /// Unit geometric normal of the front, computed in `f64`.
    pub normals: Vec<Vec3>,
    /// Area in m².
    pub areas: Vec<f32>,
    /// Where each triangle comes from.
    pub sources: Vec<TriangleSource>,
    /// Index into [`Scene::materials`] for each triangle.
    pub materials: Vec<u32>,
    /// `[first, end)` of each instance's triangles.
    pub instance_ranges: Vec<[u32; 2]>,
    /// Left out because their world-space area is zero.
    pub dropped_zero_area: u64,
    /// Left out as exact duplicates.
    pub dropped_duplicate: u64,
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
    /// The instance mirrors: world corners 1 and 2 are local corners 2 and 1.
    pub mirrored: bool,
}

/// One instance's primitive on its way into the soup.
#[derive(Default)]
struct Part {
    triangles: Vec<[Vec3; 3]>,
    normals: Vec<Vec3>,
    areas: Vec<f32>,
    sources: Vec<TriangleSource>,
    dropped: u64,
}

impl Soup {
    /// Flattens `scene`, in parallel; the result does not depend on the number of threads. O(n log n) in triangles, whatever
    /// number of them coincide.
    pub fn build(scene: &Scene) -> Soup {
        let jobs: Vec<(u32, u32)> = scene
            .instances
            .iter()
            .enumerate()
            .flat_map(|(i, instance)| {
                (0..scene.meshes[instance.mesh].primitives.len()).map(move |p| (i as u32, p as u32))
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
        }
        soup.drop_duplicates(scene);
        soup.find_instance_ranges(scene.instances.len());
        soup
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Drops triangles that add no acting side to an earlier one with the same corners: a ray tree cannot split coincident
    /// triangles, and what it would hit among them is arbitrary.
    fn drop_duplicates(&mut self, scene: &Scene) {
        // Equal triangles have equal hashes, so sorting by hash brings them together at 16 bytes a triangle; the full key
        // is compared only within a run.
        let mut order: Vec<(u64, u32)> = self
            .triangles
            .par_iter()
            .enumerate()
            .map(|(i, corners)| (hash(&Key::of(corners)), i as u32))
            .collect();
        order.par_sort_unstable();
        let mut dropped = Vec::new();
        for run in order
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|run| run.len() > 1)
        {
            let mut members: Vec<(Key, u32)> = run
                .iter()
                .map(|&(_, i)| (Key::of(&self.triangles[i as usize]), i))
                .collect();
            // An occluder casts no shadow that the surface it lies on does not cast, and must not take that one's light.
            members
                .sort_unstable_by_key(|(key, i)| (key.corners, scene.only_occludes(self, *i), *i));
            for equal in members.chunk_by(|a, b| a.0.corners == b.0.corners) {
                // Bit 0: the side whose winding is even is taken, bit 1: the other.
                let mut taken = 0u8;
                for (key, i) in equal {
                    let double_sided =
                        scene.materials[self.materials[*i as usize] as usize].double_sided;
                    let sides = if double_sided {
                        3
                    } else {
                        1 << u8::from(key.odd)
                    };
                    if taken | sides == taken {
                        dropped.push(*i);
                    }
                    taken |= sides;
                }
            }
        }
        if dropped.is_empty() {
            return;
        }
        self.dropped_duplicate = dropped.len() as u64;
        let mut keep = vec![true; self.triangles.len()];
        dropped.into_iter().for_each(|i| keep[i as usize] = false);
        retain(&mut self.triangles, &keep);
        retain(&mut self.normals, &keep);
        retain(&mut self.areas, &keep);
        retain(&mut self.sources, &keep);
        retain(&mut self.materials, &keep);
    }

    fn find_instance_ranges(&mut self, instances: usize) {
        self.instance_ranges = vec![[0, 0]; instances];
        let mut at = 0;
        for (i, range) in self.instance_ranges.iter_mut().enumerate() {
            let first = at;
            while self
                .sources
                .get(at)
                .is_some_and(|s| s.instance as usize == i)
            {
                at += 1;
            }
            *range = [first as u32, at as u32];
        }
    }
}

fn flatten(scene: &Scene, instance: u32, primitive: u32) -> Part {
    let placed = &scene.instances[instance as usize];
    let source = &scene.meshes[placed.mesh].primitives[primitive as usize];
    let mirrored = placed.transform.matrix3.determinant() < 0.0;
    // Subtracted in f64 and rounded once, so that neighbours which share a vertex share its bits.
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
        // Areas that f32 holds only as subnormals (edges below about 1e-19 m) would divide to infinity later.
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

/// A triangle's corners in a fixed order, and whether that order reverses its winding.
struct Key {
    corners: [[u32; 3]; 3],
    odd: bool,
}

impl Key {
    fn of(corners: &[Vec3; 3]) -> Key {
        // Adding zero turns −0 into +0, which is the same place.
        let mut k = corners.map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
        let mut odd = false;
        for (i, j) in [(0, 1), (1, 2), (0, 1)] {
            if k[i] > k[j] {
                k.swap(i, j);
                odd = !odd;
            }
        }
        Key { corners: k, odd }
    }
}

/// Multiply-xorshift over the nine words (constants: 2⁶⁴/φ, and Vigna's splitmix64 finaliser, public domain). Collisions cost time
/// only, and equal bits give equal hashes on every machine.
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
