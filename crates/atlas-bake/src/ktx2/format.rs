//! Texel formats.

use serde::Serialize;

use super::rgb9e5;
use crate::exr_io::HALF_MAX;

/// Texel format of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ktx2Format {
    /// `VK_FORMAT_BC6H_UFLOAT_BLOCK`: 16 bytes per 4×4 texels. An optional feature of WebGL and
    /// Vulkan that desktop GPUs support.
    Bc6h,
    /// `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`: 4 bytes per texel. Vulkan and WebGL 2 require support
    /// for reading and filtering it.
    Rgb9e5,
}

impl Ktx2Format {
    /// Side of a block, texels. Pages with multiples of this size load everywhere.
    pub fn block(self) -> u32 {
        match self {
            Ktx2Format::Bc6h => 4,
            Ktx2Format::Rgb9e5 => 1,
        }
    }

    /// The largest representable value.
    pub fn max(self) -> f32 {
        match self {
            Ktx2Format::Bc6h => HALF_MAX,
            Ktx2Format::Rgb9e5 => rgb9e5::MAX,
        }
    }
}
