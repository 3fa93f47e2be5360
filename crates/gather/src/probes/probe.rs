//! The light at one point in the air.

use super::sh::Sh2;

/// Most probes of one bake: the texels of a 64³ volume texture. Their file takes about 80 MB.
pub const MAX_PROBES: usize = 1 << 18;

/// The light at a point in the air.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Probe {
    /// Arriving radiance by direction.
    pub sh: Sh2,
    /// Estimated standard error of the luminance of `sh`'s first coefficient.
    pub error: f32,
    /// Fraction of rays that hit the back of a single-sided face.
    pub backfaces: f32,
    /// Whether it is in the open, i.e. not inside or behind something.
    pub valid: bool,
}
