//! The command line's grammar.

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use lumel::{
    BakeMode, Bounds, Directional, GltfExt, Hidden, Ktx2Format, Layer, LightGroup, LightScale,
    Origin, Paint, PngFormat, ProbeSource, Quality, Settings, SkySource, Sun, Units,
    UnwrapperChoice, UvMode, ValueKind,
};

use super::config::{self, ConfigArgs, Layered};

/// Bakes diffuse global illumination into glTF levels.
///
/// Exit codes: 0 success, 1 wrong usage, 2 input/output failure, 3 invalid input, 4 unsupported
/// feature, 5 warnings under --strict, 75 stopped (Ctrl-C).
#[derive(Debug, Parser)]
#[command(version, name = "lumel", max_term_width = 110)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Bake a level: lightmap (EXR), lightmapped glTF, vertex-coloured glTF, manifest and report
    Bake(Box<BakeScenes>),
    /// Start a bake that many machines share: write charts and solved light into a work folder
    Solve(Box<super::farm::Solve>),
    /// Gather one shard of a solved bake into its folder
    Gather(super::farm::Gather),
    /// Finish a bake whose shards are all gathered; the results are those of `lumel bake`
    Merge(super::farm::Merge),
    /// Bake a level again on every save, a draft first, and show it in a browser
    Watch(Box<super::watch::Watch>),
    /// Show what would be baked and every problem; writes only the pictures you ask for
    Inspect(Box<Inspect>),
    /// Measure the error between two lightmaps
    Diff(Diff),
    /// Print a settings file to start from: every key with its default, for SCENE.lumel.toml
    Config,
    /// Print shell completions, e.g. `lumel completions bash > /etc/bash_completion.d/lumel`
    Completions(Completions),
    /// Print the manual page of lumel or of one of its commands, e.g. `lumel man bake | man -l -`
    Man(Man),
    /// Show a finished bake in the browser; the server answers this machine only
    View(super::view::View),
    /// Summarise a finished bake in one HTML page: lightmaps, errors, convergence and problems
    Report(super::report::Report),
}

#[derive(Debug, Args)]
pub(crate) struct BakeScenes {
    /// Levels (.gltf or .glb), or folders of them
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    #[command(flatten)]
    pub bake: Bake,
}

#[derive(Debug, Clone, Args)]
pub(crate) struct Bake {
    /// The level.
    #[arg(skip)]
    pub scene: PathBuf,
    /// Whether it is one of several levels: the caller then prints and writes what concerns all of
    /// them.
    #[arg(skip)]
    pub one_of_many: bool,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub plan: Plan,
    #[command(flatten)]
    pub bounds: BoundsArgs,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Trade bake time for accuracy [default: preview]
    #[arg(long, value_enum)]
    pub quality: Option<QualityArg>,
    /// Gather until the estimated root mean square of the relative error is below X, e.g. 0.02
    /// [default: the fixed ray count of --quality]
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub error: Option<f32>,
    /// Radiance (one number, R,G,B or #rrggbb), or a latitude-longitude image (.hdr, .exr)
    #[arg(long, value_name = "COLOR|FILE", allow_negative_numbers = true)]
    pub sky: Option<String>,
    /// Units of the file's lamps [default: auto]
    #[arg(long, value_enum)]
    pub units: Option<UnitsArg>,
    /// Multiply the sky by X [default: 1]
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub sky_intensity: Option<f32>,
    /// Rotate a sky map about +Y, counter-clockwise seen from above [default: 0]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub sky_rotation: Option<f32>,
    /// Add a sun: direction of its light, illuminance, diameter of its disc (without it shadows are
    /// sharp); repeatable
    #[arg(long, value_name = "X,Y,Z,LUX[,DEGREES]", allow_hyphen_values = true, value_parser = parse_sun)]
    pub sun: Vec<Sun>,
    /// Scale a light source: a light or its node, an emissive material, `sky` or `sun`; wildcards
    /// `*` and `?`; the last match wins; repeatable. `inspect` lists the names
    #[arg(long, value_name = "NAME=X", value_parser = parse_light)]
    pub light: Vec<LightScale>,
    /// Leave a light source out, regardless of --light; repeatable
    #[arg(long, value_name = "NAME")]
    pub exclude_light: Vec<String>,
    /// Write the light of these sources into separate pages, and all other light into those of the
    /// group `rest`; repeatable
    #[arg(long, value_name = "GROUP=NAME,…", value_parser = parse_group)]
    pub group: Vec<LightGroup>,
    /// Leave out direct light that the engine adds itself [default: full]
    #[arg(long, value_enum)]
    pub mode: Option<ModeArg>,
    /// A light, its node, or `sun`: the engine adds its direct light, with baked shadows in --mode
    /// shadowmask; wildcards `*` and `?`; repeatable
    #[arg(long, value_name = "NAME")]
    pub mixed: Vec<String>,
    /// Likewise: the engine adds its direct light and shadows; repeatable
    #[arg(long, value_name = "NAME")]
    pub realtime: Vec<String>,
    /// Quantity stored in the lightmap [default: radiance]
    #[arg(long, value_enum)]
    pub value: Option<ValueArg>,
    /// Extra EXR channels
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LAYER,…")]
    pub layers: Vec<LayerArg>,
    /// Store the light's directionality, for normal maps
    #[arg(long, value_enum)]
    pub directional: Option<DirectionalArg>,
    /// Distance beyond which surfaces do not occlude in the layer `ao` [default: a tenth of the
    /// scene's diagonal]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub ao_distance: Option<f32>,
    /// Also write pages as KTX2, for GPUs
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub ktx2: Option<Ktx2Arg>,
    /// Also write pages as PNG, for targets without float textures
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub png: Option<PngArg>,
    /// Also reference the lightmap by another convention in the .glb
    #[arg(long, value_enum, value_delimiter = ',')]
    pub ext: Vec<ExtArg>,
    /// Bake light probes: at the points in a file {"points": [[x, y, z], …]}, or on a grid with
    /// this spacing in metres
    #[arg(long, value_name = "FILE.json|SPACING", allow_hyphen_values = true, value_parser = parse_probes)]
    pub probes: Option<ProbeSource>,
    /// Also write the grid as SCENE.probes.ktx2, a volume texture for Bevy
    #[arg(long)]
    pub probe_volume: bool,
    /// Override `probe-volume = true` in the settings file
    #[arg(long, conflicts_with = "probe_volume")]
    pub no_probe_volume: bool,
    #[command(flatten)]
    pub knobs: Knobs,
    /// Clamp reflectances to X [default: 0.98]
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub max_reflectance: Option<f32>,
    /// Value of partly hidden lumels [default: fill]
    #[arg(long, value_enum)]
    pub hidden: Option<HiddenArg>,
    /// Store one value for both sides of double-sided faces, even if their light differs
    #[arg(long)]
    pub no_split_sides: bool,
    /// Override `split-sides = false` in the settings file
    #[arg(long, conflicts_with = "no_split_sides")]
    pub split_sides: bool,
    /// Keep charts whole under thin walls and at the edges of sharp shadows, although both sides
    /// then read the same lumels
    #[arg(long)]
    pub no_cut_charts: bool,
    /// Override `cut-charts = false` in the settings file
    #[arg(long, conflicts_with = "no_cut_charts")]
    pub cut_charts: bool,
    /// Do not stitch chart borders
    #[arg(long)]
    pub no_stitch: bool,
    /// Override `stitch = false` in the settings file
    #[arg(long, conflicts_with = "no_stitch")]
    pub stitch: bool,
    /// Write no SCENE.vertex.glb
    #[arg(long)]
    pub no_vertex_colors: bool,
    /// Override `vertex-colors = false` in the settings file
    #[arg(long, conflicts_with = "no_vertex_colors")]
    pub vertex_colors: bool,
    /// Split triangles until vertex colours are within about X of the lightmap
    #[arg(
        long,
        value_name = "X",
        conflicts_with = "no_vertex_colors",
        allow_negative_numbers = true
    )]
    pub vertex_error: Option<f32>,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Make charts and solve the light one after the other, which saves memory
    #[arg(long)]
    pub in_turn: bool,
    /// Cache the charts of large meshes here; later bakes of the same meshes reuse them
    #[arg(long, value_name = "DIR")]
    pub cache: Option<PathBuf>,
    /// Largest size of the cache, e.g. 500M; the least recently used files go first [default: 8G]
    #[arg(long, value_name = "BYTES", requires = "cache", value_parser = parse_bytes)]
    pub cache_size: Option<u64>,
    /// Render the lit level to a picture, from its first camera if it has one
    #[arg(long, value_name = "FILE.png")]
    pub preview: Option<PathBuf>,
    /// Render a coarse picture of the lit level before lumels are gathered
    #[arg(long, value_name = "FILE.png")]
    pub first_picture: Option<PathBuf>,
    /// Also write the report to this file
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write a dependency file for make or ninja
    #[arg(long, value_name = "FILE")]
    pub depfile: Option<PathBuf>,
    /// Target in the dependency file instead of all results; repeatable
    #[arg(long, value_name = "PATH", requires = "depfile")]
    pub depfile_target: Vec<PathBuf>,
    /// Print the bake's plan (pages, lumels, memory and time) and write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Do nothing if the results exist and come from the same inputs, settings and version
    #[arg(long)]
    pub skip_if_unchanged: bool,
    /// Bake only these nodes and their children anew, into the results of an earlier bake;
    /// wildcards `*` and `?`; repeatable
    #[arg(long, value_name = "NODE", conflicts_with_all = ["dry_run", "skip_if_unchanged", "vertex_error"])]
    pub only: Vec<String>,
    /// Print the report to standard output
    #[arg(long)]
    pub json: bool,
    /// Exit with code 5 if there are warnings
    #[arg(long)]
    pub strict: bool,
    /// Override `strict = true` in the settings file
    #[arg(long, conflicts_with = "strict")]
    pub no_strict: bool,
    /// How to show progress on standard error
    #[arg(long, value_enum, default_value = "auto")]
    pub progress: ProgressArg,
    /// Print errors only
    #[arg(short, long)]
    pub quiet: bool,
    /// Print details
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
}

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressArg {
    /// A progress bar on a terminal, else a line for each finished phase
    Auto,
    /// Lines for other programs to parse
    Lines,
}

#[derive(Debug, Args)]
pub(crate) struct Inspect {
    /// The level, .gltf or .glb
    pub scene: PathBuf,
    #[command(flatten)]
    pub plan: Plan,
    #[command(flatten)]
    pub bounds: BoundsArgs,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Write pictures of pages and charts into this folder
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// What the pictures show
    #[arg(long, value_enum, default_value = "charts", requires = "pictures")]
    pub paint: PaintArg,
}

/// What a bake refuses. Deliberately not in the settings file, which may come from the same
/// untrusted source as the scene.
#[derive(Debug, Clone, Args)]
pub(crate) struct BoundsArgs {
    /// Allow `..` and links in the document to lead outside its folder
    #[arg(long)]
    pub allow_outside: bool,
    /// Limit of decoded images, e.g. 4G [default: 1G]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    pub max_image: Option<u64>,
    /// Refuse a bake whose estimated memory exceeds this, e.g. 4G [default: three quarters of the
    /// machine's]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    pub memory: Option<u64>,
}

impl From<&BoundsArgs> for Bounds {
    fn from(a: &BoundsArgs) -> Bounds {
        let default = Bounds::default();
        Bounds {
            allow_outside: a.allow_outside,
            max_image: a.max_image.unwrap_or(default.max_image),
            memory: a.memory,
        }
    }
}

/// Departures from physics.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Not physical (the report says so)")]
pub(crate) struct Knobs {
    /// Multiply reflected light by X, where it is received
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub indirect_boost: Option<f32>,
    /// Multiply the light of emissive materials by X
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub emissive_boost: Option<f32>,
    /// Multiply reflectances by X at every bounce
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub albedo_boost: Option<f32>,
    /// Saturation of bounced colours: 0 is grey, 1 changes nothing
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub bounce_saturation: Option<f32>,
    /// Minimum of R = E/π, per channel: one number, R,G,B or #rrggbb
    #[arg(long, value_name = "COLOR", allow_negative_numbers = true, value_parser = parse_color)]
    pub ambient_floor: Option<[f32; 3]>,
    /// Darken the lightmap by ambient occlusion, from 0 to 1; see --ao-distance
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub ao_multiply: Option<f32>,
}

impl Knobs {
    fn apply(&self, out: &mut Layered) {
        use Origin::Flag;
        out.put(Flag, "indirect-boost", self.indirect_boost, |s, x| {
            s.not_physical.indirect_boost = x
        });
        out.put(Flag, "emissive-boost", self.emissive_boost, |s, x| {
            s.not_physical.emissive_boost = x
        });
        out.put(Flag, "albedo-boost", self.albedo_boost, |s, x| {
            s.not_physical.albedo_boost = x
        });
        out.put(Flag, "bounce-saturation", self.bounce_saturation, |s, x| {
            s.not_physical.bounce_saturation = x
        });
        out.put(Flag, "ambient-floor", self.ambient_floor, |s, x| {
            s.not_physical.ambient_floor = x
        });
        out.put(Flag, "ao-multiply", self.ao_multiply, |s, x| {
            s.not_physical.ao_multiply = x
        });
    }
}

/// Options that determine charts and pages.
#[derive(Debug, Clone, Args)]
pub(crate) struct Plan {
    /// Index of the scene in the document [default: the document's choice]
    #[arg(long = "scene", id = "scene_index", value_name = "N")]
    pub scene: Option<usize>,
    /// Do not treat nodes named …_LOD0, …_LOD1, … as levels of detail
    #[arg(long)]
    pub no_lods: bool,
    /// Override `lods = false` in the settings file
    #[arg(long, conflicts_with = "no_lods")]
    pub lods: bool,
    /// Lumels per metre [default: from the scene's size]
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub texels_per_unit: Option<f32>,
    /// Longest side of a page in texels [default: 2048]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub max_page: Option<u32>,
    /// Texels between charts [default: 2]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub padding: Option<u32>,
    /// Align pages and instances to blocks of N x N texels; BC formats need 4 [default: 4]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub block_align: Option<u32>,
    /// Keep charts from sharing a block
    #[arg(long)]
    pub block_charts: bool,
    /// Override `block-charts = true` in the settings file
    #[arg(long, conflicts_with = "block_charts")]
    pub no_block_charts: bool,
    /// Separate pages for each matching node and its children, and for other meshes by matching
    /// material; wildcards `*` and `?`; repeatable
    #[arg(long, value_name = "PATTERN")]
    pub page_by: Vec<String>,
    /// Give no lumels to surfaces that players never see: from walkable volumes, else from the
    /// points of a --probes file, else from what the cameras see
    #[arg(long)]
    pub cull_unseen: bool,
    /// Override `cull-unseen = true` in the settings file
    #[arg(long, conflicts_with = "cull_unseen")]
    pub no_cull_unseen: bool,
    /// A node that players walk on, for --cull-unseen; wildcards `*` and `?`; repeatable
    #[arg(long, value_name = "NODE")]
    pub walkable: Vec<String>,
    /// Keep the asset's TEXCOORD_1 or make charts [default: auto]
    #[arg(long, value_enum)]
    pub uv: Option<UvArg>,
    /// Unwrapper that makes charts [default: auto]
    #[arg(long, value_enum)]
    pub unwrapper: Option<UnwrapperArg>,
}

#[derive(Debug, Args)]
pub(crate) struct Diff {
    /// The reference
    pub a: PathBuf,
    /// The lightmap to compare with it
    pub b: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Write a false-colour picture of the relative error
    #[arg(long, value_name = "FILE.png")]
    pub picture: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

#[derive(Debug, Args)]
pub(crate) struct Man {
    /// The command [default: lumel itself]
    pub command: Option<String>,
    /// Write the pages of all commands into this folder
    #[arg(short, long, value_name = "DIR", conflicts_with = "command")]
    pub output: Option<PathBuf>,
}

/// Declares a clap enum that mirrors one of the library's, so that the library does not depend on
/// clap.
macro_rules! mirror {
    ($name:ident => $target:ty { $($(#[$meta:meta])* $variant:ident => $value:expr, $help:literal;)+ }) => {
        #[derive(Debug, Clone, Copy, ValueEnum)]
        pub(crate) enum $name { $($(#[$meta])* #[doc = $help] $variant,)+ }
        impl From<$name> for $target {
            fn from(x: $name) -> $target {
                match x { $($name::$variant => $value,)+ }
            }
        }
    };
}

mirror!(QualityArg => Quality {
    Draft => Quality::Draft, "A first look, with visible noise";
    Quick => Quality::Quick, "Changing lights: twice draft's time, a third of its error";
    Preview => Quality::Preview, "Everyday work: about 1 % error";
    Production => Quality::Production, "Final bake for shipping";
});
mirror!(ModeArg => BakeMode {
    Full => BakeMode::Full, "All light";
    Indirect => BakeMode::Indirect, "Without the direct light of mixed and realtime lamps";
    Shadowmask => BakeMode::Shadowmask, "Likewise, with shadow masks of mixed lamps";
});
mirror!(ValueArg => ValueKind {
    Radiance => ValueKind::Radiance, "R = E/π";
    Irradiance => ValueKind::Irradiance, "E";
    Radiosity => ValueKind::Radiosity, "B = ρE";
});
mirror!(Ktx2Arg => Ktx2Format {
    Bc6h => Ktx2Format::Bc6h, "1 byte per texel, desktop GPUs";
    Rgb9e5 => Ktx2Format::Rgb9e5, "4 bytes per texel, all GPUs";
});
mirror!(PngArg => PngFormat {
    Rgbm => PngFormat::Rgbm, "light = (rgb * a)^2 * scale";
    Rgbd => PngFormat::Rgbd, "light = rgb^2 / a * scale";
});
mirror!(ExtArg => GltfExt {
    Moz => GltfExt::Moz, "MOZ_lightmap, with embedded pages and a mesh and material for each node";
});
mirror!(UvArg => UvMode {
    Auto => UvMode::Auto, "Keep a valid TEXCOORD_1";
    Keep => UvMode::Keep, "Keep it even if it overlaps or has holes";
    Generate => UvMode::Generate, "Always make charts";
});
mirror!(UnwrapperArg => UnwrapperChoice {
    Auto => UnwrapperChoice::Auto, "unroll";
    Unroll => UnwrapperChoice::Unroll, "Smooth groups of faces, flattened as rigidly as possible";
    Xatlas => UnwrapperChoice::Xatlas, "The xatlas-rs crate";
    Box => UnwrapperChoice::Box, "Projection along the axes";
});
mirror!(LayerArg => Layer {
    Direct => Layer::Direct, "direct.R, .G, .B: light straight from lamps, emitters and bright sky";
    Indirect => Layer::Indirect, "indirect.R, .G, .B: the rest";
    Radiosity => Layer::Radiosity, "radiosity.R, .G, .B: radiance that leaves the surface";
    Error => Layer::Error, "error.Y: estimated standard error of the luminance";
    Coverage => Layer::Coverage, "coverage.Y: share of the texel on the surface";
    Ao => Layer::Ao, "ao.Y: openness up to --ao-distance";
    #[value(name = "sun_mask")]
    SunMask => Layer::SunMask, "sun_mask.Y: share of directional light that is not shadowed";
});
mirror!(UnitsArg => Units {
    Auto => Units::Auto, "As watt, but corrects lamps that Blender's exporter scaled";
    Watt => Units::Watt, "Those of emissive materials and the sky";
    Lumen => Units::Lumen, "Candela and lux, all else in watt: divides lamps by 683 lm/W";
});
mirror!(PaintArg => Paint {
    Charts => Paint::Charts, "Charts and their faults";
    Density => Paint::Density, "Lumels per metre; blue is too low, orange too high";
});
mirror!(HiddenArg => Hidden {
    Fill => Hidden::Fill, "Light of the visible part, else of the neighbours";
    Mean => Hidden::Mean, "Mean over the whole lumel, counting hidden parts as black";
});
mirror!(DirectionalArg => Directional {
    Sh1 => Directional::Sh1, "First-order spherical harmonics";
    Dominant => Directional::Dominant, "One dominant direction";
});

/// Comma-separated finite numbers.
fn numbers(text: &str) -> Option<Vec<f32>> {
    text.split(',')
        .map(|x| x.trim().parse::<f32>().ok().filter(|x| x.is_finite()))
        .collect()
}

fn parse_sun(text: &str) -> Result<Sun, String> {
    match numbers(text).as_deref() {
        Some(&[x, y, z, lux, ref rest @ ..])
            if lux > 0.0 && (x, y, z) != (0.0, 0.0, 0.0) && rest.len() < 2 =>
        {
            Ok(Sun {
                direction: [x, y, z],
                lux,
                angle: rest.first().copied().unwrap_or(0.0),
            })
        }
        _ => Err(
            "expected X,Y,Z,LUX or X,Y,Z,LUX,DEGREES: a non-zero direction, an illuminance above 0, an angular diameter".into(),
        ),
    }
}

/// Parses NAME=FACTOR; the name may contain `=`.
fn parse_light(text: &str) -> Result<LightScale, String> {
    let (name, factor) = text
        .rsplit_once('=')
        .ok_or("expected NAME=FACTOR, e.g. lamp*=0.5")?;
    match factor.trim().parse::<f32>() {
        Ok(factor) if factor.is_finite() && factor >= 0.0 => Ok(LightScale {
            name: name.into(),
            factor,
        }),
        _ => Err(format!(
            "found the factor {factor:?}, expected a number of at least 0"
        )),
    }
}

/// Parses GROUP=NAME,NAME,…; a comma in a name is written as `?`.
fn parse_group(text: &str) -> Result<LightGroup, String> {
    let (name, sources) = text
        .split_once('=')
        .ok_or("expected GROUP=NAME,…, e.g. lamps=ceiling*,neon")?;
    Ok(LightGroup {
        name: name.into(),
        sources: sources
            .split(',')
            .map(|s| s.trim().to_owned())
            .filter(|s| !s.is_empty())
            .collect(),
    })
}

/// Parses a byte count with an optional suffix K, M, G or T (powers of 1024).
fn parse_bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let shift = match text.chars().last().map(|c| c.to_ascii_uppercase()) {
        Some('K') => 10,
        Some('M') => 20,
        Some('G') => 30,
        Some('T') => 40,
        _ => 0,
    };
    let digits = if shift > 0 {
        &text[..text.len() - 1]
    } else {
        text
    };
    let number: Option<u64> = digits.parse().ok();
    (number.and_then(|n| n.checked_mul(1 << shift)))
        .ok_or("expected a whole number of bytes, or one with K, M, G or T".into())
}

/// Parses a number as a spacing and anything else as a file.
fn parse_probes(text: &str) -> Result<ProbeSource, String> {
    match text.trim().parse::<f32>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(ProbeSource::Spacing(x)),
        Ok(x) => Err(format!("found the distance {x}, expected a number above 0")),
        Err(_) => Ok(ProbeSource::File(text.into())),
    }
}

/// A colour: a sky that is not a file.
fn parse_color(text: &str) -> Result<[f32; 3], String> {
    match parse_sky(text) {
        Ok(SkySource::Color(c)) => Ok(c),
        _ => Err("expected one number, R,G,B (each at least 0) or #rrggbb".into()),
    }
}

pub(crate) fn parse_sky(text: &str) -> Result<SkySource, String> {
    if let Some(hex) = text.strip_prefix('#')
        && hex.len() == 6
        && let Ok(v) = u32::from_str_radix(hex, 16)
    {
        // Hex colours come from colour pickers, so they are sRGB.
        let linear = |shift: u32| {
            let x = (v >> shift & 255) as f32 / 255.0;
            if x <= 0.04045 {
                x / 12.92
            } else {
                libm::powf((x + 0.055) / 1.055, 2.4)
            }
        };
        return Ok(SkySource::Color([linear(16), linear(8), linear(0)]));
    }
    let at_least_0 = |c: &[f32]| c.iter().all(|x| *x >= 0.0);
    match numbers(text).as_deref() {
        Some([x]) if *x >= 0.0 => Ok(SkySource::Color([*x; 3])),
        Some(c @ &[r, g, b]) if at_least_0(c) => Ok(SkySource::Color([r, g, b])),
        Some(_) => Err(format!(
            "--sky {text}: expected one number, R,G,B (each at least 0), #rrggbb or a file"
        )),
        // Without an extension this is a colour name or a typo: every supported image has one.
        None if Path::new(text).extension().is_none() => Err(format!(
            "--sky {text}: expected one number, R,G,B (0.25,0.35,0.5), #rrggbb (#88aaff), or a .hdr or .exr file"
        )),
        None => Ok(SkySource::File(text.into())),
    }
}

/// The value of a pair of opposite flags.
fn either(yes: bool, no: bool) -> Option<bool> {
    (yes || no).then_some(yes)
}

/// The values of a repeatable option if it was given.
fn given<T: Clone>(values: &[T]) -> Option<Vec<T>> {
    (!values.is_empty()).then(|| values.to_vec())
}

impl Plan {
    fn apply(&self, out: &mut Layered) {
        use Origin::Flag;
        out.put(Flag, "scene", self.scene, |s, x| s.scene = Some(x));
        let lods = either(self.lods, self.no_lods);
        out.put(Flag, "lods", lods, |s, x| s.lods = x);
        out.put(Flag, "texels-per-unit", self.texels_per_unit, |s, x| {
            s.texels_per_unit = Some(x)
        });
        out.put(Flag, "max-page", self.max_page, |s, x| s.max_page = x);
        out.put(Flag, "padding", self.padding, |s, x| s.padding = x);
        out.put(Flag, "block-align", self.block_align, |s, x| s.block = x);
        let charts = either(self.block_charts, self.no_block_charts);
        out.put(Flag, "block-charts", charts, |s, x| s.block_charts = x);
        let cull = either(self.cull_unseen, self.no_cull_unseen);
        out.put(Flag, "cull-unseen", cull, |s, x| s.cull_unseen = x);
        out.put(Flag, "walkable", given(&self.walkable), |s, x| {
            s.walkable = x
        });
        out.put(Flag, "page-by", given(&self.page_by), |s, x| s.page_by = x);
        out.put(Flag, "uv", self.uv, |s, x| s.uv = x.into());
        out.put(Flag, "unwrapper", self.unwrapper, |s, x| {
            s.unwrapper = x.into()
        });
    }
}

impl Bake {
    /// The same options for another scene.
    pub(crate) fn of(&self, scene: &Path) -> Bake {
        Bake {
            scene: scene.to_owned(),
            ..self.clone()
        }
    }

    /// The dependency file, if this bake writes it itself.
    pub(crate) fn own_depfile(&self) -> Option<&PathBuf> {
        self.depfile.as_ref().filter(|_| !self.one_of_many)
    }

    /// Defaults, overridden by the settings file, overridden by options.
    ///
    /// # Errors
    /// [`lumel::Error::Setting`], [`lumel::Error::Config`].
    pub(crate) fn settings(&self) -> Result<Layered, lumel::Error> {
        use Origin::Flag;
        let sky = self.sky.as_deref().map(parse_sky).transpose();
        let sky = sky.map_err(lumel::Error::Setting)?;
        let mut out = self.config.layered(&self.scene)?;
        self.plan.apply(&mut out);
        out.settings.bounds = Bounds::from(&self.bounds);
        out.put(Flag, "quality", self.quality, |s, x| s.quality = x.into());
        out.put(Flag, "error", self.error, |s, x| s.error = Some(x));
        out.put(Flag, "sky", sky, |s, x| s.sky = x);
        out.put(Flag, "units", self.units, |s, x| s.units = x.into());
        out.put(Flag, "sky-intensity", self.sky_intensity, |s, x| {
            s.sky_intensity = x
        });
        out.put(Flag, "sky-rotation", self.sky_rotation, |s, x| {
            s.sky_rotation = x
        });
        out.put(Flag, "sun", given(&self.sun), |s, x| s.suns = x);
        // The last match wins, so options come after the file and exclusions after factors.
        out.put(Flag, "light", given(&self.light), |s, x| s.lights.extend(x));
        out.put(Flag, "exclude-light", given(&self.exclude_light), |s, x| {
            s.lights.extend(x.into_iter().map(config::excluded))
        });
        out.put(Flag, "group", given(&self.group), |s, x| s.groups = x);
        out.put(Flag, "mode", self.mode, |s, x| s.mode = x.into());
        out.put(Flag, "mixed", given(&self.mixed), |s, x| s.mixed = x);
        out.put(Flag, "realtime", given(&self.realtime), |s, x| {
            s.realtime = x
        });
        out.put(Flag, "value", self.value, |s, x| s.value = x.into());
        out.put(Flag, "ktx2", self.ktx2, |s, x| s.ktx2 = Some(x.into()));
        out.put(Flag, "png", self.png, |s, x| s.png = Some(x.into()));
        out.put(Flag, "ext", given(&self.ext), |s, x| {
            s.ext.clear();
            for ext in x.into_iter().map(GltfExt::from) {
                if !s.ext.contains(&ext) {
                    s.ext.push(ext);
                }
            }
        });
        out.put(Flag, "layers", given(&self.layers), |s, x| {
            s.layers.clear();
            for layer in x.into_iter().map(Layer::from) {
                if !s.layers.contains(&layer) {
                    s.layers.push(layer);
                }
            }
        });
        out.put(Flag, "directional", self.directional, |s, x| {
            s.directional = Some(x.into())
        });
        out.put(Flag, "ao-distance", self.ao_distance, |s, x| {
            s.ao_distance = Some(x)
        });
        let volume = either(self.probe_volume, self.no_probe_volume);
        out.put(Flag, "probe-volume", volume, |s, x| s.probe_volume = x);
        out.put(Flag, "probes", self.probes.clone(), |s, x| {
            s.probes = Some(x)
        });
        self.knobs.apply(&mut out);
        out.put(Flag, "max-reflectance", self.max_reflectance, |s, x| {
            s.max_reflectance = x
        });
        out.put(Flag, "hidden", self.hidden, |s, x| s.hidden = x.into());
        let cuts = either(self.cut_charts, self.no_cut_charts);
        out.put(Flag, "cut-charts", cuts, |s, x| s.cut_charts = x);
        let sides = either(self.split_sides, self.no_split_sides);
        out.put(Flag, "split-sides", sides, |s, x| s.split_sides = x);
        let stitch = either(self.stitch, self.no_stitch);
        out.put(Flag, "stitch", stitch, |s, x| s.stitch = x);
        let colors = either(self.vertex_colors, self.no_vertex_colors);
        if self.no_vertex_colors {
            // Overrides a `vertex-error` of the settings file, which would ask for vertex colours.
            out.settings.vertex_error = None;
            out.provenance.origins.remove("vertex-error");
        }
        out.put(Flag, "vertex-colors", colors, |s, x| s.vertex_colors = x);
        out.put(Flag, "vertex-error", self.vertex_error, |s, x| {
            s.vertex_error = Some(x)
        });
        if let Some(strict) = either(self.strict, self.no_strict) {
            out.strict = strict;
        }
        Ok(out)
    }
}

impl Inspect {
    /// The library's settings that decide the atlas.
    ///
    /// # Errors
    /// [`lumel::Error::Config`].
    pub(crate) fn settings(&self) -> Result<Settings, lumel::Error> {
        let mut out = self.config.layered(&self.scene)?;
        self.plan.apply(&mut out);
        out.settings.bounds = Bounds::from(&self.bounds);
        Ok(out.settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_grammar_is_sound() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn skies_and_suns() {
        assert_eq!(parse_sky("0.5"), Ok(SkySource::Color([0.5; 3])));
        assert_eq!(parse_sky("1,2,3"), Ok(SkySource::Color([1., 2., 3.])));
        assert_eq!(parse_sky("#ff0000"), Ok(SkySource::Color([1., 0., 0.])));
        assert_eq!(parse_sky("a.hdr"), Ok(SkySource::File("a.hdr".into())));
        assert!(parse_sky("-1").is_err() && parse_sky("1,2").is_err());
        let blue = parse_sky("blue").expect_err("no colour");
        assert!(blue.contains("#rrggbb"), "{blue}");
        assert_eq!(
            parse_sun("0,-1,0,10"),
            Ok(Sun {
                direction: [0., -1., 0.],
                lux: 10.,
                angle: 0.
            })
        );
        let angle = parse_sun("0,-1,0,10,0.5").map(|s| s.angle);
        assert_eq!(angle, Ok(0.5));
        for bad in [
            "0,-1,0,10,1,1",
            "0,0,0,10",
            "0,-1,0",
            "0,-1,0,-5",
            "a,b,c,d",
            "0,-1,0,inf",
        ] {
            assert!(parse_sun(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn lights_and_groups() {
        let light = |text| parse_light(text).map(|l| (l.name, l.factor));
        assert_eq!(light("lamp=0.5"), Ok(("lamp".into(), 0.5)));
        assert_eq!(light("a=b c=2"), Ok(("a=b c".into(), 2.)));
        for bad in ["lamp", "lamp=", "lamp=x", "lamp=-1", "lamp=nan", "lamp=inf"] {
            assert!(light(bad).is_err(), "{bad}");
        }
        let group = |text| parse_group(text).map(|g| (g.name, g.sources.join("|")));
        let expected = ("g".into(), "a=1|b c|d*".into());
        assert_eq!(group("g=a=1, b c,,d*"), Ok(expected));
        assert_eq!(group("g="), Ok(("g".into(), String::new())));
        assert!(group("g").is_err());
    }
}
