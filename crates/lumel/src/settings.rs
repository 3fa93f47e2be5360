//! What a user may choose about a bake.

use std::path::PathBuf;

use atlas::{UnwrapperChoice, UvMode};
use atlas_bake::{Directional, Hidden, Ktx2Format, Layer, ValueKind};
use gather::{GatherOptions, Interpolation};
use mesh_ingest::Limits;
use patch_subdivision::Options as CutOptions;
use radiosity::{DirectOptions, RelaxOptions, SolveOptions};
use serde::Serialize;

use crate::memory::{COPIES, TRIANGLE};

/// How much work a bake is worth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// For a look: some per cent of noise on walls, tens in dark corners.
    Draft,
    /// For changing lights: about twice a draft's time, a third of its error.
    Quick,
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

/// Where light probes are.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbeSource {
    /// A list of points, JSON.
    File(#[serde(skip)] PathBuf),
    /// A regular grid over the scene with this distance between neighbours, metres.
    Spacing(f32),
}

/// A sun given beside the scene's own lights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sun {
    /// Direction in which its light travels, any length.
    pub direction: [f32; 3],
    /// Illuminance on a surface that faces it, lux (or W/m²).
    pub lux: f32,
    /// Diameter of its disc, degrees; 0 for parallel light. The sun's is 0.533.
    pub angle: f32,
}

impl Sun {
    /// A sun of parallel light that travels in `direction` (any length but 0) and gives a surface
    /// that faces it `lux` (or W/m²).
    pub fn new(direction: [f32; 3], lux: f32) -> Sun {
        Sun {
            direction,
            lux,
            angle: 0.0,
        }
    }

    /// Gives it a disc of so many degrees across, 0 to 90, so that its shadows have soft edges.
    /// Ours has 0.533.
    #[must_use]
    pub fn angle(mut self, degrees: f32) -> Sun {
        self.angle = degrees;
        self
    }
}

/// Dims, brightens or switches off sources of light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightScale {
    /// Which: a name, with `*` for any characters and `?` for one. Lights go by their own or their
    /// node's name, emissive surfaces by their material's, the sky as `sky`, suns of
    /// [`Settings::suns`] as `sun`.
    pub name: String,
    /// Multiplies their light, finite and ≥ 0; what has 0 costs nothing.
    pub factor: f32,
}

/// Which units lamps of the file are in. Glowing materials and skies are radiances in W/(m² sr), or
/// whatever unit the level's author chose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Units {
    /// Those of the materials, but for what Blender's exporter is known to do.
    #[default]
    Auto,
    /// Those of the materials.
    Watt,
    /// Candela and lux beside materials in W/(m² sr): lamps are divided by 683 lm/W.
    Lumen,
}

/// A convention of some engine for where a glTF names its lightmap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GltfExt {
    /// `MOZ_lightmap` on materials, with the picture in the .glb.
    Moz,
}

/// Sources of light that are kept apart from the others.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LightGroup {
    /// Part of the names of files: characters `A-Z a-z 0-9 . _ -`, unlike the others' even if case
    /// is ignored.
    pub name: String,
    /// Names of its sources, as in [`LightScale::name`].
    pub sources: Vec<String>,
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
    /// Whether names of nodes that end in `_LOD0`, `_LOD1`, … tell levels of detail; extras and
    /// `MSFT_lod` always do.
    pub lods: bool,
    /// Lumels per metre; `None` chooses by the scene's size.
    pub texels_per_unit: Option<f32>,
    /// Longest side of a page, texels.
    pub max_page: u32,
    /// Texels between charts.
    pub padding: u32,
    /// Pages and rectangles of instances keep to blocks of so many texels; 1 for any size.
    pub block: u32,
    /// Whether charts do so too.
    pub block_charts: bool,
    /// Which lightmap coordinates to use.
    pub uv: UvMode,
    /// Which unwrapper makes new ones.
    pub unwrapper: UnwrapperChoice,
    /// The sky.
    pub sky: SkySource,
    /// Units of the file's lamps.
    pub units: Units,
    /// Multiplies the sky.
    pub sky_intensity: f32,
    /// Turns the sky about +Y, degrees, counter-clockwise seen from above.
    pub sky_rotation: f32,
    /// Further suns.
    pub suns: Vec<Sun>,
    /// Changes to sources of light; of several that name one source, the last counts.
    pub lights: Vec<LightScale>,
    /// Sources to be kept apart; what no group names is in a last one, `rest`. Empty keeps all
    /// light together.
    pub groups: Vec<LightGroup>,
    /// What the lightmap holds.
    pub value: ValueKind,
    /// Write pages as KTX2 too, in this format.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ktx2: Option<Ktx2Format>,
    /// Further conventions for the lightmap's place in the glTF, beside the nodes' extras.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ext: Vec<GltfExt>,
    /// Extra channels.
    pub layers: Vec<Layer>,
    /// What the lightmap keeps of the directions that light comes from.
    pub directional: Option<Directional>,
    /// How far surfaces occlude each other for the layer of ambient occlusion, metres; `None`
    /// chooses by the scene's size.
    pub ao_distance: Option<f32>,
    /// Light probes for things that move.
    pub probes: Option<ProbeSource>,
    /// Estimated relative error to reach, instead of the preset's.
    pub error: Option<f32>,
    /// Reflectances above this count as this. A closed scene with ρ = 1 never loses its light;
    /// fresh snow, the whitest thing that levels hold, reflects 0.9 to 0.98.
    pub max_reflectance: f32,
    /// What lumels hold of which a part lies inside or behind something.
    pub hidden: Hidden,
    /// Make bilinear lookups on both sides of chart borders agree, but for those of curved surfaces
    /// (lab/seams.md).
    pub stitch: bool,
    /// Bake the scene with vertex colours too; without, no light is computed for it and its file is
    /// not written.
    pub vertex_colors: bool,
    /// Split edges of the vertex-lit scene until its relative error is about this.
    pub vertex_error: Option<f32>,
    /// What is refused; no result depends on it.
    #[serde(skip)]
    pub bounds: Bounds,
}

/// What a bake refuses to read or to begin: for those who bake what others made. No file of
/// settings can change them, since whoever made the scene may have made it too.
#[derive(Debug, Clone, PartialEq)]
pub struct Bounds {
    /// Let `..` and links in the document lead out of its folder. Absolute paths are never
    /// followed.
    pub allow_outside: bool,
    /// Bytes of decoded pictures: of all the scene's that light needs together, and of the sky's.
    /// By their headers, before any is decoded.
    pub max_image: u64,
    /// Bytes that the bake may need, by the estimate that [`estimate`](crate::estimate) makes.
    pub memory: Option<u64>,
}

impl Default for Bounds {
    fn default() -> Self {
        Bounds {
            allow_outside: false,
            max_image: 1 << 30,
            memory: None,
        }
    }
}

impl Bounds {
    /// Ceilings for reading a scene. With a bound on memory, what is larger than it before anything
    /// is computed is not read at all.
    pub(crate) fn limits(&self) -> Limits {
        let all = Limits::default();
        let memory = self.memory.unwrap_or(u64::MAX);
        Limits {
            file_bytes: all.file_bytes.min(memory / COPIES),
            decoded_bytes: all.decoded_bytes.min(memory),
            geometry_bytes: all.geometry_bytes.min(memory),
            triangles: all.triangles.min(memory / TRIANGLE),
            instances: all.instances.min(memory / TRIANGLE),
            // A texel's pyramid comes on top of its four bytes.
            image_bytes: self.max_image.min(memory / 2),
            ..all
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            quality: Quality::default(),
            scene: None,
            lods: true,
            texels_per_unit: None,
            max_page: 2048,
            padding: 2,
            block: 4,
            block_charts: false,
            uv: UvMode::Auto,
            unwrapper: UnwrapperChoice::Auto,
            sky: SkySource::None,
            units: Units::Auto,
            sky_intensity: 1.0,
            sky_rotation: 0.0,
            suns: Vec::new(),
            lights: Vec::new(),
            groups: Vec::new(),
            value: ValueKind::Radiance,
            ktx2: None,
            ext: Vec::new(),
            layers: Vec::new(),
            directional: None,
            ao_distance: None,
            probes: None,
            error: None,
            max_reflectance: 0.98,
            hidden: Hidden::Fill,
            stitch: true,
            vertex_colors: true,
            vertex_error: None,
            bounds: Bounds::default(),
        }
    }
}

/// What gathering begins with.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Start {
    Draft,
    Quick,
    /// Few rays, which rounds add to. Contacts and shadows' edges are looked for: of those that
    /// were missed no estimate knows.
    Rounds,
    Preview,
    Production,
}

impl Start {
    /// With an error to reach, as few rays as may do: the gather goes on by itself. To 0.03 from
    /// `quick`, what it had overlooked was left out of the estimate (lab/ideas.md).
    fn of(settings: &Settings) -> Start {
        let preset = match settings.quality {
            Quality::Draft => Start::Draft,
            Quality::Quick => Start::Quick,
            Quality::Preview => Start::Preview,
            Quality::Production => Start::Production,
        };
        match (settings.error, preset) {
            (None, _) => preset,
            (Some(x), _) if x >= 0.1 => Start::Quick,
            (Some(x), _) if x >= 0.03 => Start::Rounds,
            (Some(x), _) if x >= 0.01 => Start::Preview,
            (Some(_), Start::Draft | Start::Quick) => Start::Rounds,
            (Some(_), _) => preset,
        }
    }
}

impl Settings {
    /// Patches, links and direct light of the solve.
    ///
    /// From 6,000 to 24,000 patches the Cornell box's bias fell from −0.22 to −0.12 %
    /// (lab/measurements.md, which says what has changed since); rays a patch hardly mattered
    /// between 128 and 256, since the gather averages over many patches.
    pub(crate) fn solve_options(&self) -> SolveOptions {
        // A gather reads many elements: what is not known of each by itself hardly matters, and one
        // light sampled at a hit is noisier than what its element has of all (lab/ideas.md).
        let (patches, rays, points) = match self.quality {
            Quality::Draft => (2_600, 32, 4),
            Quality::Quick => (8_000, 24, 4),
            Quality::Preview => (10_000, 64, 8),
            Quality::Production => (32_000, 128, 8),
        };
        SolveOptions {
            cut: CutOptions {
                patches,
                ..CutOptions::default()
            },
            rays,
            // As many where a light is seen in part: to go on only where the first disagree takes
            // what all see for all there is, more often than what none see for nothing that
            // matters. A garage with a window was 2 % too bright by it.
            direct: DirectOptions::every(points, points),
            resample: false,
            relax: RelaxOptions::default(),
            ..SolveOptions::default()
        }
    }

    /// Gathering at lumels.
    pub(crate) fn lumel_options(&self) -> GatherOptions {
        let start = Start::of(self);
        let (rays, most, error, points, edge_points) = match start {
            Start::Draft => (16, 16, 1.0, 4, 16),
            Start::Quick => (32, 64, 0.1, 16, 32),
            Start::Rounds => (32, 32, 1.0, 16, 64),
            Start::Preview => (128, 256, 0.03, 16, 128),
            Start::Production => (512, 4096, 0.01, 32, 1024),
        };
        let (base, penumbra, scouts) = match start {
            Start::Draft => (4, 16, 2),
            // With 4 and 16 a room lit by a window had dots all over its walls.
            Start::Quick => (8, 32, 2),
            Start::Rounds => (16, 32, 4),
            Start::Preview => (16, 128, 4),
            Start::Production => (32, 512, 4),
        };
        let (interpolation, near, follow) = match start {
            Start::Draft => (Interpolation::Wide, 0.12, 0),
            Start::Quick => (Interpolation::Wide, 0.12, 1),
            _ => (Interpolation::Open, 0.25, 3),
        };
        let (most, error) = match self.error {
            None => (most, error),
            Some(_) => (rays, 1.0),
        };
        GatherOptions {
            rays,
            points,
            edge_points,
            most_rays: most,
            error,
            direct: DirectOptions {
                base,
                penumbra,
                scouts,
            },
            contacts: start != Start::Draft,
            follow,
            interpolation,
            near,
            // Found by gathering rays alone, what lamps shine on made clouds on walls
            // (lab/ideas.md).
            lit: 1,
            open_only: false,
        }
    }

    /// Gathering at vertices: they are interpolated over whole triangles, so noise shows less than
    /// at lumels.
    pub(crate) fn vertex_options(&self) -> GatherOptions {
        let rays = match self.quality {
            Quality::Draft => 16,
            Quality::Quick => 32,
            Quality::Preview => 64,
            Quality::Production => 256,
        };
        let lumels = self.lumel_options();
        GatherOptions {
            rays,
            points: lumels.points.min(16),
            edge_points: 0,
            most_rays: rays,
            open_only: true,
            ..lumels
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_to_reach_an_error_looks_for_contacts() {
        let options = |quality, error| {
            Settings {
                quality,
                error,
                ..Settings::default()
            }
            .lumel_options()
        };
        assert!(!options(Quality::Draft, None).contacts);
        for quality in [
            Quality::Draft,
            Quality::Quick,
            Quality::Preview,
            Quality::Production,
        ] {
            let mut rays = 0;
            for error in [0.3, 0.1, 0.05, 0.02, 0.005] {
                let options = options(quality, Some(error));
                // Rounds add rays; the preset's own second looks would come before them.
                assert_eq!(options.most_rays, options.rays);
                assert!(options.contacts && options.lit == 1 && options.follow > 0);
                // A small error begins with no fewer rays, but for presets that have few.
                assert!(options.rays >= rays || quality < Quality::Preview);
                rays = options.rays;
            }
        }
    }
}
