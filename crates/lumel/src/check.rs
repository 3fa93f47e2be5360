//! Validation of settings.

use std::ffi::OsStr;
use std::path::Path;

use atlas_bake::ValueKind;
use glam::Vec3;

use crate::error::Error;
use crate::settings::{BakeMode, GltfExt, Settings};
use crate::sources;

/// Largest diameter of a sun, degrees. Larger ones hardly have a direction and are better described
/// by a sky.
const MAX_SUN: f32 = 90.0;

/// Refuses scenes whose file name is not UTF-8: two such names could become the same one, and JSON
/// cannot name the files.
///
/// # Errors
/// [`Error::Name`].
pub(crate) fn check_name(scene: &Path) -> Result<(), Error> {
    match scene.file_name().map(OsStr::to_str) {
        Some(None) => Err(Error::Name {
            file: scene.to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Refuses settings that are out of range or contradict each other, before any work.
///
/// # Errors
/// [`Error::Setting`].
pub(crate) fn check(settings: &Settings) -> Result<(), Error> {
    let positive = |name: &str, x: f32| {
        if x.is_finite() && x > 0.0 {
            Ok(())
        } else {
            Err(Error::Setting(format!(
                "{name} is {x}, expected a number above 0"
            )))
        }
    };
    if let Some(t) = settings.texels_per_unit {
        positive("texels per unit", t)?;
    }
    if let Some(e) = settings.error {
        positive("error", e)?;
    }
    if !(settings.max_reflectance > 0.0 && settings.max_reflectance <= 1.0) {
        return Err(Error::Setting(format!(
            "the largest reflectance is {}, expected a number above 0 and at most 1",
            settings.max_reflectance
        )));
    }
    if !(settings.sky_intensity.is_finite() && settings.sky_intensity >= 0.0) {
        return Err(Error::Setting(format!(
            "sky intensity is {}, expected a number of at least 0",
            settings.sky_intensity
        )));
    }
    if !settings.sky_rotation.is_finite() {
        return Err(Error::Setting(format!(
            "sky rotation is {}, expected a finite number of degrees",
            settings.sky_rotation
        )));
    }
    for s in &settings.suns {
        positive("the sun's illuminance", s.lux)?;
        if Vec3::from_array(s.direction).try_normalize().is_none() {
            return Err(Error::Setting(format!(
                "the sun's direction is {:?}, expected a non-zero vector",
                s.direction
            )));
        }
        if !(0.0..=MAX_SUN).contains(&s.angle) {
            return Err(Error::Setting(format!(
                "the sun's diameter is {} degrees, expected 0 to {MAX_SUN}",
                s.angle
            )));
        }
    }
    if let Some(e) = settings.vertex_error {
        positive("the vertex error", e)?;
        if !settings.vertex_colors {
            return Err(Error::Setting(format!(
                "the vertex error is {e}, but vertex colours are off (--no-vertex-colors, or vertex-colors = false in the settings file): expected only one of the two"
            )));
        }
    }
    if let Some(d) = settings.ao_distance {
        positive("the distance of ambient occlusion", d)?;
    }
    settings.not_physical.check()?;
    if settings.not_physical.ambient_floor != [0.0; 3] && !settings.groups.is_empty() {
        return Err(Error::Setting(
            "--ambient-floor with --group: expected only one of the two, because the pages of groups sum to the lightmap".into(),
        ));
    }
    if settings.mode != BakeMode::Full && !settings.groups.is_empty() {
        return Err(Error::Setting(
            "--mode with --group: expected only one of the two, because the pages of groups hold all light".into(),
        ));
    }
    sources::check(settings)?;
    if !(8..=16384).contains(&settings.max_page) {
        return Err(Error::Setting(format!(
            "the largest page is {}, expected 8 to 16384",
            settings.max_page
        )));
    }
    if settings.padding > 64 {
        return Err(Error::Setting(format!(
            "padding is {}, expected at most 64",
            settings.padding
        )));
    }
    if !(1..=64).contains(&settings.block) {
        return Err(Error::Setting(format!(
            "blocks are {} texels wide, expected 1 to 64",
            settings.block
        )));
    }
    if let Some(format) = settings.ktx2
        && !settings.block.is_multiple_of(format.block())
    {
        return Err(Error::Setting(format!(
            "--ktx2 bc6h with --block-align {}: expected a multiple of {}, because GPUs reject other page sizes",
            settings.block,
            format.block()
        )));
    }
    if settings.ext.contains(&GltfExt::Moz) && settings.value == ValueKind::Radiosity {
        return Err(Error::Setting(
            "--ext moz with --value radiosity: expected radiance or irradiance, because materials multiply the lightmap with their albedo".into(),
        ));
    }
    Ok(())
}
