//! Light groups: parts of a scene's light that are kept separate.

/// Assigns each light source to a group.
///
/// Light is additive, so the light of each group can be computed alongside the total, with the same
/// rays.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LightGroups {
    /// Number of groups, from 1 to 255; every index below is less.
    pub count: usize,
    /// Per light of [`mesh_ingest::Scene::lights`].
    pub lights: Vec<u8>,
    /// Per material of [`mesh_ingest::Scene::materials`]: the group of its emission.
    pub materials: Vec<u8>,
    /// The group of the sky.
    pub sky: u8,
}
