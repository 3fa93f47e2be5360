//! Light at vertices in the form that writers take.

#[cfg(doc)]
use mesh_ingest::{Primitive, Scene};

/// Irradiance at every vertex, W/m² (or lx).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VertexLight {
    /// By instance of the scene, by primitive of its mesh, by vertex of [`Primitive::positions`]:
    /// E, linear Rec.709. Followed by vertices added by splitting. Entries for instances and
    /// primitives that receive no light ([`Scene::receives`]) are ignored.
    pub instances: Vec<Vec<Vec<[f32; 3]>>>,
    /// By instance, by primitive: how triangles were split. An inner list is empty if the instance
    /// was not split; the outer one if none was.
    pub split: Vec<Vec<SplitPrimitive>>,
}

/// A primitive whose triangles were split, without T-junctions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SplitPrimitive {
    /// For each added vertex, the two earlier vertices whose midpoint it is. Added vertices are
    /// numbered after those of [`Primitive::positions`].
    pub parents: Vec<[u32; 2]>,
    /// All triangles after splitting: index into [`Primitive::triangles`], ascending, and vertices.
    pub triangles: Vec<(u32, [u32; 3])>,
}

impl VertexLight {
    /// How primitive `p` of instance `i` was split, if it was.
    pub fn split_of(&self, i: usize, p: usize) -> Option<&SplitPrimitive> {
        let split = self.split.get(i)?.get(p)?;
        (!split.parents.is_empty()).then_some(split)
    }
}
