//! Faults of an asset's own lightmap coordinates.

use serde::Serialize;

/// Kinds of faults of a mesh's `TEXCOORD_1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum UvFaultKind {
    /// Only some primitives have the set.
    Missing,
    /// Coordinates are NaN or infinite.
    NotFinite,
    /// Coordinates leave 0..1.
    OutOfRange,
    /// Triangles have no area in the lightmap.
    Collapsed,
    /// Triangles overlap.
    Overlap,
    /// Charts are so close that bilinear lookups read both.
    Close,
    /// The density varies strongly over the surface.
    Uneven,
    /// Charts are mirrored, which is harmless for lightmaps.
    Mirrored,
}

/// Consequence of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// None.
    Note,
    /// The coordinates are kept with a warning.
    Warning,
    /// The coordinates are replaced, unless the user chooses [`UvMode::Keep`](crate::UvMode::Keep).
    Bad,
    /// The coordinates cannot be kept.
    Unusable,
}

/// A place in the asset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UvPlace {
    /// Index of the mesh's glTF primitive.
    pub primitive: usize,
    /// Index of its triangle, with strips and fans unrolled.
    pub triangle: u32,
    /// Coordinates there as in the file; absent if they are not finite.
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

/// A fault of a mesh's `TEXCOORD_1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UvFault {
    /// The kind.
    pub kind: UvFaultKind,
    /// The consequence.
    pub severity: Severity,
    /// Number of affected triangles.
    pub triangles: u64,
    /// Affected fraction of the mesh's surface (of its lumels, for overlaps and closeness), 0..=1.
    pub share: f64,
    /// The worst place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst: Option<UvPlace>,
    /// Message for people, with the place.
    pub message: String,
}
