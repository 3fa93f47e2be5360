//! What can be wrong with an asset's own lightmap coordinates.

use serde::Serialize;

/// What is wrong with a mesh's `TEXCOORD_1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UvFaultKind {
    /// Some primitives have the set, others do not.
    Missing,
    /// Coordinates are NaN or infinite.
    NotFinite,
    /// Coordinates leave 0..1.
    OutOfRange,
    /// Triangles have no area in the lightmap.
    Collapsed,
    /// Triangles lie on each other.
    Overlap,
    /// Charts are so near to each other that bilinear lookups read both.
    Close,
    /// The density varies much over the surface.
    Uneven,
    /// Charts are mirrored, which lightmaps do not mind.
    Mirrored,
}

/// What follows from a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Nothing.
    Note,
    /// The coordinates are kept, and the user warned.
    Warning,
    /// The coordinates are replaced, unless the user insists
    /// ([`UvMode::Keep`](crate::UvMode::Keep)).
    Bad,
    /// The coordinates cannot be kept.
    Unusable,
}

/// A place in the asset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UvPlace {
    /// Index of the mesh's glTF primitive.
    pub primitive: usize,
    /// Number of its triangle, strips and fans unrolled.
    pub triangle: u32,
    /// Coordinates there as they stand in the file; absent where they are not finite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uv: Option<[f32; 2]>,
}

impl std::fmt::Display for UvPlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "primitive {}, triangle {}",
            self.primitive, self.triangle
        )?;
        match self.uv {
            Some([u, v]) => write!(f, " near ({u:.4}, {v:.4})"),
            None => Ok(()),
        }
    }
}

/// Something found wrong with a mesh's `TEXCOORD_1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UvFault {
    /// What.
    pub kind: UvFaultKind,
    /// What follows.
    pub severity: Severity,
    /// How many triangles it concerns.
    pub triangles: u64,
    /// How large a part of the mesh's surface (of its lumels, for overlaps and closeness), 0..=1.
    pub share: f64,
    /// Where it is worst.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst: Option<UvPlace>,
    /// For people, with the place.
    pub message: String,
}
