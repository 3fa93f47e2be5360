//! What a user may choose about a bake.

use std::path::PathBuf;

use atlas_bake::{GatherOptions, Layer, UvMode, ValueKind, unwrap::UnwrapperChoice};
use patch_subdivision::Options as CutOptions;
use radiosity::{DirectOptions, RelaxOptions, SolveOptions};
use serde::Serialize;

/// How much work a bake is worth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// For a look: some per cent of noise in corners.
    Draft,
    /// For work: around 1 %.
    #[default]
    Preview,
    /// For shipping.
    Production,
}

/// Light from beyond the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SkySource {
    /// The scene's own (`EXT_lights_image_based`), if it has one.
    #[default]
    None,
    /// The same radiance from everywhere, linear Rec.709.
    Color([f32; 3]),
    /// A latitude-longitude picture, Radiance HDR or EXR.
    File(#[serde(skip)] PathBuf),
}

/// A sun given beside the scene's own lights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sun {
    /// Direction in which its light travels, any length.
    pub direction: [f32; 3],
    /// Illuminance on a surface that faces it, lux (or W/m²).
    pub lux: f32,
}

/// Everything a bake depends on besides the scene.
///
/// Serialises into the report; what does not change the result (threads, paths) is left out there.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settings {
    /// Preset.
    pub quality: Quality,
    /// Which scene of the document; `None` for its default.
    pub scene: Option<usize>,
    /// Lumels per metre; `None` chooses by the scene's size.
    pub texels_per_unit: Option<f32>,
    /// Longest side of a page, texels.
    pub max_page: u32,
    /// Texels between charts.
    pub padding: u32,
    /// Which lightmap coordinates to use.
    pub uv: UvMode,
    /// Which unwrapper makes new ones.
    pub unwrapper: UnwrapperChoice,
    /// The sky.
    pub sky: SkySource,
    /// Multiplies the sky.
    pub sky_intensity: f32,
    /// Turns the sky about +Y, degrees, counter-clockwise seen from above.
    pub sky_rotation: f32,
    /// Further suns.
    pub suns: Vec<Sun>,
    /// What the lightmap holds.
    pub value: ValueKind,
    /// Extra channels.
    pub layers: Vec<Layer>,
    /// Estimated relative error to reach, instead of the preset's.
    pub error: Option<f32>,
    /// Reflectances above this are lowered to it. A closed scene with ρ = 1 never loses its light; 0.999 keeps the
    /// solve finite and changes nothing below.
    pub max_reflectance: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            quality: Quality::default(),
            scene: None,
            texels_per_unit: None,
            max_page: 2048,
            padding: 2,
            uv: UvMode::Auto,
            unwrapper: UnwrapperChoice::Auto,
            sky: SkySource::None,
            sky_intensity: 1.0,
            sky_rotation: 0.0,
            suns: Vec::new(),
            value: ValueKind::Radiance,
            layers: Vec::new(),
            error: None,
            max_reflectance: 0.999,
        }
    }
}

impl Settings {
    /// Patches, links and direct light of the solve.
    ///
    /// From 6,000 to 24,000 patches the Cornell box's bias fell from −0.22 to −0.12 % (docs/measurements.md, which says what has changed
    /// since); rays a patch hardly mattered between 128 and 256, since the gather averages over many patches.
    pub(crate) fn solve_options(&self) -> SolveOptions {
        let (patches, rays) = match self.quality {
            Quality::Draft => (3_000, 64),
            Quality::Preview => (10_000, 128),
            Quality::Production => (32_000, 256),
        };
        SolveOptions {
            cut: CutOptions {
                patches,
                ..CutOptions::default()
            },
            rays,
            relax: RelaxOptions::default(),
            ..SolveOptions::default()
        }
    }

    /// Gathering at lumels.
    pub(crate) fn lumel_options(&self) -> GatherOptions {
        let (rays, most, error, base, penumbra) = match self.quality {
            Quality::Draft => (32, 32, 1.0, 16, 32),
            Quality::Preview => (128, 256, 0.03, 16, 128),
            Quality::Production => (512, 4096, 0.01, 32, 512),
        };
        let (points, edge_points) = match self.quality {
            Quality::Draft => (16, 16),
            Quality::Preview => (16, 128),
            Quality::Production => (32, 1024),
        };
        let (most, error) = match self.error {
            None => (most, error),
            // 8192 rays a lumel: the last that the 16-bit Sobol index leaves room for beside the blocks.
            Some(x) => (8192, x),
        };
        GatherOptions {
            rays,
            points,
            edge_points,
            most_rays: most,
            error,
            direct: DirectOptions { base, penumbra },
            open_only: false,
        }
    }

    /// Gathering at vertices: they are interpolated over whole triangles, so noise shows less than at lumels.
    pub(crate) fn vertex_options(&self) -> GatherOptions {
        let rays = match self.quality {
            Quality::Draft => 16,
            Quality::Preview => 64,
            Quality::Production => 256,
        };
        GatherOptions {
            rays,
            points: 16,
            edge_points: 0,
            most_rays: rays,
            open_only: true,
            ..self.lumel_options()
        }
    }
}
