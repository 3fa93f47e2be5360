//! Light at vertices, as writers take it.

#[cfg(doc)]
use mesh_ingest::{Primitive, Scene};

/// Irradiance at every vertex, W/m² (or lx).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VertexLight {
    /// By instance of the scene, by primitive of its mesh, by vertex of [`Primitive::positions`]:
    /// E, linear Rec.709. What is there for instances and primitives that receive no light
    /// ([`Scene::receives`]) is not looked at. Vertices that splitting added come after them.
    pub instances: Vec<Vec<Vec<[f32; 3]>>>,
    /// By instance, by primitive: how triangles were split. An inner list is empty where an
    /// instance is as it was; so is all of it where all are.
    pub split: Vec<Vec<SplitPrimitive>>,
}

/// A primitive whose triangles were split, without any vertex on another's edge.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SplitPrimitive {
    /// Added vertices: of each, the two earlier ones in whose middle it is. They are numbered on
    /// from [`Primitive::positions`].
    pub parents: Vec<[u32; 2]>,
    /// The parts of triangles, whole ones among them: index into [`Primitive::triangles`],
    /// ascending, and vertices.
    pub triangles: Vec<(u32, [u32; 3])>,
}

impl VertexLight {
    /// How primitive `p` of instance `i` was split, if it was.
    pub fn split_of(&self, i: usize, p: usize) -> Option<&SplitPrimitive> {
        let split = self.split.get(i)?.get(p)?;
        (!split.parents.is_empty()).then_some(split)
    }
}
