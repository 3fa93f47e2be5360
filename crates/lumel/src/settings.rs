//! Settings of a bake.

use std::path::PathBuf;

use atlas::{UnwrapperChoice, UvMode};
use atlas_bake::{Directional, Hidden, Ktx2Format, Layer, PngFormat, ValueKind};
use gather::{GatherOptions, Interpolation};
use mesh_ingest::{Limits, Soup};
use patch_subdivision::Options as CutOptions;
use radiosity::{DirectOptions, RelaxOptions, SolveOptions};
use serde::Serialize;

use crate::memory::{COPIES, TRIANGLE, machine_bytes};
use crate::not_physical::NotPhysical;

/// Trade-off between bake time and accuracy.
///
/// ```
/// use lumel::Quality;
///
/// assert!(Quality::Draft < Quality::Production);
/// assert_eq!(Quality::default(), Quality::Preview);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// A rough look: a few per cent of noise on open walls, tens of per cent in dark corners.
    Draft,
    /// For moving lights around: about twice the time of a draft, a third of its error.
    Quick,
    /// For everyday work: about 1 % error.
    #[default]
    Preview,
    /// For shipping.
    Production,
}

/// Light from outside the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SkySource {
    /// The scene's own (`EXT_lights_image_based`), if it has one.
    #[default]
    None,
    /// The same radiance in all directions, linear Rec.709.
    Color([f32; 3]),
    /// A latitude-longitude image, Radiance HDR or EXR.
    File(#[serde(skip)] PathBuf),
}

/// Positions of light probes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbeSource {
    /// A list of points in a JSON file.
    File(#[serde(skip)] PathBuf),
    /// A regular grid over the scene with this spacing, metres.
    Spacing(f32),
}

/// A sun in addition to the scene's own lights.
///
/// ```
/// use lumel::{Baker, Sun};
///
/// let noon = Sun::new([0.3, -1.0, 0.2], 100_000.0).angle(0.533);
/// let baker = Baker::new().sun(noon);
/// assert_eq!(baker.settings().suns, [noon]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sun {
    /// Direction in which its light travels, any non-zero length.
    pub direction: [f32; 3],
    /// Illuminance on a surface that faces it, lux (or W/m²).
    pub lux: f32,
    /// Angular diameter of its disc, degrees; 0 for parallel light. The real sun has 0.533.
    pub angle: f32,
}

impl Sun {
    /// A sun of parallel light that travels in `direction` (any non-zero length) and gives a
    /// surface facing it `lux` (or W/m²).
    pub fn new(direction: [f32; 3], lux: f32) -> Sun {
        Sun {
            direction,
            lux,
            angle: 0.0,
        }
    }

    /// Gives it a disc with this angular diameter, 0 to 90 degrees, for soft shadows. The real sun
    /// has 0.533.
    #[must_use]
    pub fn angle(mut self, degrees: f32) -> Sun {
        self.angle = degrees;
        self
    }
}

/// Scales or switches off light sources.
///
/// ```
/// use lumel::{LightScale, Settings};
///
/// let dimmed = LightScale { name: "lamp*".into(), factor: 0.5 };
/// let settings = Settings { lights: vec![dimmed], ..Settings::default() };
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightScale {
    /// Name of the sources, with wildcards `*` (any characters) and `?` (one character). Lights go
    /// by their own or their node's name, emissive surfaces by their material's, the sky is `sky`,
    /// and suns of [`Settings::suns`] are `sun`.
    pub name: String,
    /// Factor on their light, finite and ≥ 0; sources with 0 cost nothing.
    pub factor: f32,
}

/// Which direct light the lightmap holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BakeMode {
    /// Light of all lamps.
    #[default]
    Full,
    /// Without the direct light of mixed and realtime lamps; their reflected light stays.
    Indirect,
    /// As `Indirect`, and with shadow masks for mixed lamps.
    Shadowmask,
}

impl BakeMode {
    fn is_full(&self) -> bool {
        *self == BakeMode::Full
    }
}

/// Units of the file's lamps. Emissive materials and skies are radiances in W/(m² sr), or whatever
/// unit the level's author chose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Units {
    /// The materials' units, with known scales of Blender's exporter detected and corrected.
    #[default]
    Auto,
    /// The materials' units.
    Watt,
    /// Candela and lux beside materials in W/(m² sr): lamps are divided by 683 lm/W.
    Lumen,
}

/// An engine's convention for referencing the lightmap in a glTF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GltfExt {
    /// `MOZ_lightmap` on materials, with the pages embedded in the .glb.
    Moz,
}

/// Light sources that are baked into separate pages.
///
/// ```
/// use lumel::{LightGroup, Settings};
///
/// let day = LightGroup { name: "day".into(), sources: vec!["sun".into(), "sky".into()] };
/// let settings = Settings { groups: vec![day], ..Settings::default() };
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LightGroup {
    /// Part of file names: characters `A-Z a-z 0-9 . _ -`, unique even if case is ignored.
    pub name: String,
    /// Names of its sources, as in [`LightScale::name`].
    pub sources: Vec<String>,
}

/// Everything besides the scene that a bake depends on.
///
/// Serialised into the report, without values that do not change the result (threads, paths).
///
/// ```no_run
/// use lumel::{Quality, Settings, Silent, bake};
///
/// let settings = Settings {
///     quality: Quality::Draft,
///     texels_per_unit: Some(4.0),
///     ..Settings::default()
/// };
/// let bake = bake("level.glb".as_ref(), &settings, &Silent)?;
/// # Ok::<(), lumel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settings {
    /// Preset.
    pub quality: Quality,
    /// Index of the scene in the document; `None` for its default scene.
    pub scene: Option<usize>,
    /// Whether node names that end in `_LOD0`, `_LOD1`, … mark levels of detail; extras and
    /// `MSFT_lod` always do.
    pub lods: bool,
    /// Lumels per metre; `None` derives it from the scene's size.
    pub texels_per_unit: Option<f32>,
    /// Longest side of a page, texels.
    pub max_page: u32,
    /// Texels between charts.
    pub padding: u32,
    /// Pages and instance rectangles are aligned to blocks of this many texels; 1 for any size.
    pub block: u32,
    /// Whether charts are aligned to blocks too.
    pub block_charts: bool,
    /// Names of nodes and materials, with wildcards, whose meshes get separate pages, in addition
    /// to `extras.lumel.page`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub page_by: Vec<String>,
    /// Whether surfaces that nobody sees from where players walk get no lumels.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub cull_unseen: bool,
    /// Names of nodes, with wildcards, that players walk on, in addition to
    /// `extras.lumel.walkable`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub walkable: Vec<String>,
    /// Whether to use the asset's lightmap coordinates.
    pub uv: UvMode,
    /// The unwrapper that makes new ones.
    pub unwrapper: UnwrapperChoice,
    /// The sky.
    pub sky: SkySource,
    /// Units of the file's lamps.
    pub units: Units,
    /// Factor on the sky.
    pub sky_intensity: f32,
    /// Rotation of the sky about +Y, degrees, counter-clockwise seen from above.
    pub sky_rotation: f32,
    /// Additional suns.
    pub suns: Vec<Sun>,
    /// Factors on light sources; the last match wins.
    pub lights: Vec<LightScale>,
    /// Light groups; sources in no group go to a last one, `rest`. Empty if light is not separated.
    pub groups: Vec<LightGroup>,
    /// Whether the direct light of lamps that the engine adds is left out.
    #[serde(skip_serializing_if = "BakeMode::is_full")]
    pub mode: BakeMode,
    /// Names of mixed lamps, with wildcards: lights or their nodes, `sun` for
    /// [`suns`](Self::suns). In addition to `extras.lumel.mode`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub mixed: Vec<String>,
    /// Names of realtime lamps.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub realtime: Vec<String>,
    /// Quantity stored in the lightmap.
    pub value: ValueKind,
    /// Also write pages as KTX2 in this format.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ktx2: Option<Ktx2Format>,
    /// Also write pages as PNG with 8 bits per channel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub png: Option<PngFormat>,
    /// Conventions for referencing the lightmap in the glTF, in addition to the nodes' extras.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ext: Vec<GltfExt>,
    /// Extra channels.
    pub layers: Vec<Layer>,
    /// How the light's directionality is stored.
    pub directional: Option<Directional>,
    /// Distance up to which surfaces occlude each other in the ambient occlusion layer, metres;
    /// `None` derives it from the scene's size.
    pub ao_distance: Option<f32>,
    /// Light probes for moving objects.
    pub probes: Option<ProbeSource>,
    /// Whether a grid of probes is also written as a volume texture.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub probe_volume: bool,
    /// Estimated relative error to reach, instead of the preset's fixed ray count.
    pub error: Option<f32>,
    /// Reflectances are clamped to this. A closed scene with ρ = 1 never loses its light. Fresh
    /// snow, the whitest material in levels, reflects 0.9 to 0.98.
    pub max_reflectance: f32,
    /// Value of lumels that are partly inside or behind something.
    pub hidden: Hidden,
    /// Whether sheets with different light on their two sides get separate faces for each side.
    pub split_sides: bool,
    /// Whether charts end under thin walls with different light on their two sides, and at the
    /// straight edges of sharp shadows, with new vertices there. Otherwise lumels there are read
    /// from both sides.
    pub cut_charts: bool,
    /// Whether bilinear lookups on both sides of chart borders are made to agree.
    pub stitch: bool,
    /// Whether the scene with vertex colours is baked too. If false, no light is computed for it
    /// and its file is not written.
    pub vertex_colors: bool,
    /// Split edges of the scene with vertex colours until its relative error is about this.
    pub vertex_error: Option<f32>,
    /// Departures from physics.
    #[serde(skip_serializing_if = "NotPhysical::is_physical")]
    pub not_physical: NotPhysical,
    /// Patches instead of the preset's. For tests that bake thousands of levels with a few lumels,
    /// where light on patches takes nine tenths of the time.
    #[doc(hidden)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub patches: Option<u32>,
    /// What the bake refuses; the result does not depend on it.
    #[serde(skip)]
    pub bounds: Bounds,
}

/// What a bake refuses to read or to begin, for users who bake untrusted scenes. Settings files
/// cannot change these bounds, because they may come from the same source as the scene.
///
/// ```
/// use lumel::{Bounds, Settings};
///
/// let bounds = Bounds { memory: Some(2 << 30), ..Bounds::default() };
/// let settings = Settings { bounds, ..Settings::default() };
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Bounds {
    /// Whether `..` and links in the document may lead out of its folder. Absolute paths are never
    /// followed.
    pub allow_outside: bool,
    /// Most bytes of decoded images: of those of the scene that light needs together, and of the
    /// sky's. Checked from their headers before decoding.
    pub max_image: u64,
    /// Most bytes of memory that the bake may need, by [`estimate`](crate::estimate). `None` stands
    /// for three quarters of the machine's, where the system tells that (Linux).
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
    /// Bytes of memory that the bake may need.
    pub(crate) fn allowed(&self) -> Option<u64> {
        self.memory.or_else(|| Some(machine_bytes()? / 4 * 3))
    }

    /// Limits for reading a scene. With a memory bound, inputs that already exceed it are not read
    /// at all.
    pub(crate) fn limits(&self) -> Limits {
        let all = Limits::default();
        let memory = self.allowed().unwrap_or(u64::MAX);
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
            page_by: Vec::new(),
            cull_unseen: false,
            walkable: Vec::new(),
            uv: UvMode::Auto,
            unwrapper: UnwrapperChoice::Auto,
            sky: SkySource::None,
            units: Units::Auto,
            sky_intensity: 1.0,
            sky_rotation: 0.0,
            suns: Vec::new(),
            lights: Vec::new(),
            groups: Vec::new(),
            mode: BakeMode::Full,
            mixed: Vec::new(),
            realtime: Vec::new(),
            value: ValueKind::Radiance,
            ktx2: None,
            png: None,
            ext: Vec::new(),
            layers: Vec::new(),
            directional: None,
            ao_distance: None,
            probes: None,
            probe_volume: false,
            error: None,
            max_reflectance: 0.98,
            hidden: Hidden::Fill,
            split_sides: true,
            cut_charts: true,
            stitch: true,
            vertex_colors: true,
            vertex_error: None,
            not_physical: NotPhysical::default(),
            patches: None,
            bounds: Bounds::default(),
        }
    }
}

/// How gathering starts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Start {
    Draft,
    Quick,
    /// A few rays, which later rounds add to. Contacts and shadow edges are searched for, because
    /// the error estimate does not see missed ones.
    Rounds,
    Preview,
    Production,
}

impl Start {
    /// With a target error, starts with as few rays as possible, and rounds add more. From `quick`,
    /// a target of 0.03 failed: the error estimate did not see contacts that `quick` had missed.
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

/// Number of lumels up to which a preset's number of patches is used as it is: that of the levels
/// that the presets were tuned on, at the default density.
const TUNED: f64 = 200_000.0;

/// Most lumels of a triangle that patches are made for. Light changes where things are built: a
/// house on a wide ground got four times its patches, and took half as long again.
const WIDE: f64 = 10_000.0;

/// Most patches. A patch takes about 2 kB with its elements and links.
const MOST_PATCHES: f64 = 400_000.0;

impl Settings {
    /// Estimated number of lumels; 0 if the density is chosen by the level's area, which bounds
    /// their number. A mesh that does not fit on a page has at most a page's.
    pub(crate) fn lumels(&self, soup: &Soup) -> f64 {
        let Some(density) = self.texels_per_unit.map(f64::from) else {
            return 0.0;
        };
        let page = f64::from(self.max_page).powi(2);
        let lumels = soup.instance_ranges.iter().map(|[first, end]| {
            let areas = &soup.areas[*first as usize..*end as usize];
            let area: f64 = areas.iter().map(|a| f64::from(*a)).sum();
            (area * density * density).min(page)
        });
        lumels.sum()
    }

    /// The lumels that decide how many patches there are: of a wide triangle only [`WIDE`].
    pub(crate) fn patched_lumels(&self, soup: &Soup) -> f64 {
        let density = self.texels_per_unit.map_or(0.0, f64::from);
        let lumels = (soup.areas.iter()).map(|a| (f64::from(*a) * density * density).min(WIDE));
        lumels.sum::<f64>().min(self.lumels(soup))
    }

    /// Patches, links and direct light of the solve. Beyond [`TUNED`] lumels, the number of patches
    /// grows with that of lumels: each copy of a level, at one density, gets as many as it does
    /// alone.
    ///
    /// From 6,000 to 24,000 patches, the Cornell box's bias fell from −0.22 to −0.12 %. The number
    /// of rays per patch hardly mattered between 128 and 256, because the gather averages over many
    /// patches.
    pub(crate) fn solve_options(&self, soup: &Soup) -> SolveOptions {
        self.solve_options_of(self.patched_lumels(soup))
    }

    /// As [`solve_options`](Settings::solve_options), for a level with this number of lumels.
    pub(crate) fn solve_options_of(&self, lumels: f64) -> SolveOptions {
        // A gather averages many elements, so the error of each hardly matters. Sampling a light at
        // each hit is noisier than reading the element's light.
        let (patches, rays, points) = match self.quality {
            Quality::Draft => (5_000, 32, 4),
            // With 32, few rays find a window: rooms lit by the sky were 1 % off as a whole.
            Quality::Quick => (5_000, 64, 4),
            Quality::Preview => (10_000, 64, 8),
            Quality::Production => (32_000, 128, 8),
        };
        let larger = (lumels / TUNED).max(1.0);
        let patches = (f64::from(patches) * larger).min(MOST_PATCHES) as u32;
        let patches = self.patches.unwrap_or(patches);
        SolveOptions {
            cut: CutOptions {
                patches,
                ..CutOptions::default()
            },
            rays,
            // The same number of shadow rays whether the first agree or not. Casting more only if
            // they disagree biases mostly visible lights towards fully visible; a garage with a
            // window became 2 % too bright.
            direct: DirectOptions::every(points, points),
            resample: false,
            relax: RelaxOptions::default(),
            ..SolveOptions::default()
        }
    }

    /// Gather options for lumels.
    pub(crate) fn lumel_options(&self) -> GatherOptions {
        let start = Start::of(self);
        let (rays, most, error, points, edge_points) = match start {
            Start::Draft => (32, 64, 0.1, 4, 16),
            Start::Quick => (64, 128, 0.05, 16, 32),
            Start::Rounds => (64, 64, 1.0, 16, 64),
            Start::Preview => (128, 256, 0.03, 16, 128),
            Start::Production => (512, 4096, 0.01, 32, 1024),
        };
        let (base, penumbra, scouts) = match start {
            Start::Draft => (4, 16, 2),
            // With 4 and 16, a room lit by a window had dots all over its walls.
            Start::Quick => (8, 32, 2),
            Start::Rounds => (16, 32, 4),
            Start::Preview => (16, 128, 4),
            Start::Production => (32, 512, 4),
        };
        let (interpolation, near, follow) = match start {
            Start::Draft => (Interpolation::Wide, 0.12, 0),
            Start::Quick => (Interpolation::Wide, 0.25, 1),
            _ => (Interpolation::Open, 0.25, 3),
        };
        // With 0.1 and more, levels without a sky became noisier. Directions are much noisier than
        // light, and in calm cells nothing would smooth them.
        let calm = match self.directional {
            None => self.error.unwrap_or(error).min(0.03),
            Some(_) => 0.0,
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
            calm,
            near,
            // With 0, only gathering rays find lit elements, which causes blotches on walls.
            lit: 1,
            open_only: false,
            tile: gather::TILE,
        }
    }

    /// Gather options for vertices. Vertex light is interpolated over whole triangles, so noise is
    /// less visible than at lumels.
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
            // Each point costs as much as two rays.
            points: lumels.points.min(16).min(rays / 4),
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
    fn directions_are_gathered_everywhere() {
        let settings = Settings::default();
        assert_eq!(settings.lumel_options().calm, 0.03);
        let directional = Some(Directional::Sh1);
        let settings = Settings {
            directional,
            ..settings
        };
        assert_eq!(settings.lumel_options().calm, 0.0);
    }

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
                // Rounds add rays, so the preset's own refinement must be off.
                assert_eq!(options.most_rays, options.rays);
                assert!(options.contacts && options.lit == 1 && options.follow > 0);
                // A small target error starts with no fewer rays, except for presets with few rays.
                assert!(options.rays >= rays || quality < Quality::Preview);
                rays = options.rays;
            }
        }
    }
}
