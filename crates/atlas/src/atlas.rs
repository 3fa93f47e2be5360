//! Where every instance's surface lies in the lightmap: charts per mesh, rectangles per instance,
//! pages.

use glam::Vec2;
use serde::Serialize;

/// Lightmap charts of one mesh, shared by all its instances.
///
/// Coordinates are texels of the mesh's own rectangle: x to the right, y down, (0, 0) the top left
/// corner of the top left texel. Texel (c, r) covers `[c, c+1) × [r, r+1)`.
#[derive(Debug, Clone, Default)]
pub struct MeshAtlas {
    /// Width and height of the rectangle in texels, padding included; zero where no instance
    /// receives light.
    pub size: [u32; 2],
    /// One per [`mesh_ingest::Mesh::primitives`], in order.
    pub primitives: Vec<PrimitiveAtlas>,
    /// Number of charts.
    pub charts: u32,
    /// How the coordinates came about.
    pub origin: UvOrigin,
}

/// Lightmap coordinates of one primitive; nothing at all where it only occludes.
#[derive(Debug, Clone, Default)]
pub struct PrimitiveAtlas {
    /// For each new vertex, the vertex of the primitive that it copies. The identity where nothing
    /// was split.
    pub xref: Vec<u32>,
    /// Position of each new vertex in texels of the mesh's rectangle.
    pub uv: Vec<Vec2>,
    /// New-vertex indices of each of the primitive's triangles, in their order and with the same
    /// corner order.
    pub triangles: Vec<[u32; 3]>,
    /// Chart of each triangle, 0..[`MeshAtlas::charts`].
    pub chart: Vec<u32>,
}

/// Where a mesh's lightmap coordinates come from.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum UvOrigin {
    /// The asset's `TEXCOORD_1`, as it came.
    Kept,
    /// Made by an unwrapper (its name).
    #[default]
    Generated,
    /// Made by an unwrapper because the asset's `TEXCOORD_1` cannot be used.
    Replaced {
        /// What is wrong with the asset's own.
        why: String,
    },
}

/// A rectangle of texels on a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Rect {
    /// Left edge.
    pub x: u32,
    /// Top edge.
    pub y: u32,
    /// Width.
    pub w: u32,
    /// Height.
    pub h: u32,
}

/// The place of one instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Placement {
    /// Page number.
    pub page: u32,
    /// Its rectangle there; the same size as the mesh's [`MeshAtlas::size`], but zero for an
    /// instance that receives no light.
    pub rect: Rect,
}

/// The whole lightmap's plan.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    /// By mesh of the scene.
    pub meshes: Vec<MeshAtlas>,
    /// By instance of the scene.
    pub placements: Vec<Placement>,
    /// Width and height of each page in texels.
    pub pages: Vec<[u32; 2]>,
    /// Lumels per metre that were asked for.
    pub texels_per_unit: f32,
}

impl Layout {
    /// Texels of all pages.
    pub fn texels(&self) -> f64 {
        let texels = |&[w, h]: &[u32; 2]| f64::from(w) * f64::from(h);
        self.pages.iter().map(texels).sum()
    }
}
