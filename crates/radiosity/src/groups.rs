//! Light groups: parts of a scene's light that are kept apart.

/// Which group each source of light belongs to.
///
/// Light adds up, so that what a group's sources send through the scene can be carried along beside
/// the sum of all, on the same rays.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LightGroups {
    /// Number of groups, at least 1 and at most 255; every entry below is less.
    pub count: usize,
    /// Per light of [`mesh_ingest::Scene::lights`].
    pub lights: Vec<u8>,
    /// Per material of [`mesh_ingest::Scene::materials`]: the group of what it emits.
    pub materials: Vec<u8>,
    /// The sky's.
    pub sky: u8,
}
