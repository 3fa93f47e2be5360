//! Options of a load.

use std::collections::BTreeSet;

/// Options of [`load`](crate::load).
#[derive(Debug, Clone, Default)]
pub struct LoadOptions {
    /// Index of the scene in the document; `None` for its default, else the first, else all root
    /// nodes.
    pub scene: Option<usize>,
    /// Whether `..` and links may lead out of the document's folder. The output contains the files
    /// that a document references, so an untrusted document could exfiltrate any file that this
    /// process can read. Absolute paths are never followed.
    pub allow_outside: bool,
    /// Ignore levels of detail in node names; extras and `MSFT_lod` still apply.
    pub ignore_lod_names: bool,
    /// Double-sided primitives (mesh, primitive of the mesh) that are to become two single-sided
    /// ones, so that each side has its own lumels. Those with extensions or morph targets stay as
    /// they are.
    pub split_sides: BTreeSet<(usize, usize)>,
    /// Cuts of flat surfaces, so that charts end there; made after `split_sides`, on both sides.
    /// Meshes that [`Document::can_cut`](crate::Document::can_cut) refuses stay as they are.
    pub cuts: Vec<crate::Cut>,
    /// Limits beyond which a load fails with [`Error::Limit`](crate::Error::Limit) instead of
    /// exhausting the machine.
    pub limits: Limits,
}

/// Limits on what a document may claim.
///
/// A few bytes of JSON can claim any count, so each is checked before memory is reserved.
#[derive(Debug, Clone)]
pub struct Limits {
    /// Bytes of one file (document, buffer or image).
    pub file_bytes: u64,
    /// Total bytes of all accessors without a buffer view, which no file data backs.
    pub unbacked_bytes: u64,
    /// Bytes that one compressed buffer view or Draco primitive may decode to.
    pub decoded_bytes: u64,
    /// Estimated bytes of the scene's unique geometry.
    pub geometry_bytes: u64,
    /// Triangles after instancing.
    pub triangles: u64,
    /// Number of placed meshes.
    pub instances: u64,
    /// Bytes of all decoded images together: four per pixel, up to eight of 16-bit ones.
    pub image_bytes: u64,
}

impl Default for Limits {
    /// Room for twenty times the largest measured level (about 3 million unique triangles), within
    /// 16 GiB.
    fn default() -> Limits {
        Limits {
            file_bytes: 8 << 30,
            unbacked_bytes: 256 << 20,
            decoded_bytes: 2 << 30,
            geometry_bytes: 6 << 30,
            triangles: 1 << 26,
            instances: 1 << 22,
            image_bytes: 1 << 30,
        }
    }
}

/// Maximum number of reflection captures of a level. At the preset `preview` each takes 1.6 million
/// rays.
pub(crate) const MAX_REFLECTIONS: usize = 64;

/// Larger coordinates (metres) count as not finite: the cube of a length, which ray tests compute,
/// must fit `f32`.
pub(crate) const MAX_COORDINATE: f64 = 1e12;
