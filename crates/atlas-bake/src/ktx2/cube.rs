//! Reflection captures as cube maps.

use gather::probes::ReflectionCube;
use ktx2::Format;

use super::container::assemble_levels;
use super::rgb9e5;
use crate::error::Result;

/// Encodes a capture with its levels as `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`. Values beyond the
/// format's are clamped.
///
/// # Errors
/// [`Error::Image`](crate::Error::Image) for a bug in the crate that describes the format.
pub fn write_reflection_ktx2(cube: &ReflectionCube) -> Result<Vec<u8>> {
    let levels: Vec<Vec<u8>> = (cube.levels.iter())
        .map(|level| {
            let word = |light: &glam::Vec3| {
                let storable = |x: f32| if x > 0.0 { x.min(rgb9e5::MAX) } else { 0.0 };
                rgb9e5::encode(light.to_array().map(storable)).to_le_bytes()
            };
            level.iter().flat_map(word).collect()
        })
        .collect();
    let levels: Vec<&[u8]> = levels.iter().map(|level| &level[..]).collect();
    let format = (Format::E5B9G9R9_UFLOAT_PACK32, 4);
    assemble_levels(format, [cube.size, cube.size, 0], 6, &levels)
}
