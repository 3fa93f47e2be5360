//! All triangles of a scene in one world-space list: what rays hit.

use glam::Vec3;

use crate::scene::Scene;

/// World-space (recentred) triangles of every instance, in the order instance, primitive, triangle.
///
/// Triangles whose area vanishes in world space, or which coincide exactly with an earlier one (same three corners, same
/// facing, any rotation), are left out and counted. Winding is already flipped for mirroring transforms, so the
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

impl Soup {
    /// Flattens `scene`.
    pub fn build(scene: &Scene) -> Soup {
        let _ = scene;
        Soup::default()
    }
}
