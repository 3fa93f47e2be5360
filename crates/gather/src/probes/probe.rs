//! What is known of one point in the air.

use super::sh::Sh2;

/// Most probes of one bake: as many as a volume texture of 64³ has texels. Their file is some 80 MB
/// then.
pub const MAX_PROBES: usize = 1 << 18;

/// The light at a point in the air.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Probe {
    /// Radiance that arrives, by the direction it comes from.
    pub sh: Sh2,
    /// Estimated standard error of the luminance of `sh`'s first coefficient.
    pub error: f32,
    /// Share of rays that met the back of a single-sided face.
    pub backfaces: f32,
    /// Whether it is in the open; else it is inside or behind something.
    pub valid: bool,
}
