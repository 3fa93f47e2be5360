//! The formats of texels.

use serde::Serialize;

use super::rgb9e5;
use crate::exr_io::HALF_MAX;

/// How a page's texels are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ktx2Format {
    /// `VK_FORMAT_BC6H_UFLOAT_BLOCK`: 16 bytes for 4×4 texels. An extension of WebGL and a feature
    /// of Vulkan, which desktop cards have.
    Bc6h,
    /// `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`: 4 bytes a texel. Vulkan and WebGL 2 demand that it can
    /// be read and filtered.
    Rgb9e5,
}

impl Ktx2Format {
    /// Texels on the side of a block: pages that are whole multiples of it load everywhere.
    pub fn block(self) -> u32 {
        match self {
            Ktx2Format::Bc6h => 4,
            Ktx2Format::Rgb9e5 => 1,
        }
    }

    /// The largest value that can be stored.
    pub fn max(self) -> f32 {
        match self {
            Ktx2Format::Bc6h => HALF_MAX,
            Ktx2Format::Rgb9e5 => rgb9e5::MAX,
        }
    }
}
