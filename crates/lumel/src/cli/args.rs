//! The command line's grammar.

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use lumel::{
    Bounds, Directional, GltfExt, Hidden, Ktx2Format, Layer, LightGroup, LightScale, Origin, Paint,
    ProbeSource, Quality, Settings, SkySource, Sun, Units, UnwrapperChoice, UvMode, ValueKind,
};

use super::config::{self, ConfigArgs, Layered};

/// Bakes diffuse global illumination into glTF levels.
///
/// Exit codes: 0 ok, 1 wrong usage, 2 input/output failure, 3 invalid input, 4 unsupported feature,
/// 5 warnings under --strict, 75 stopped (Ctrl-C).
#[derive(Debug, Parser)]
#[command(version, name = "lumel", max_term_width = 110)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Bake a level: lightmap (EXR), lightmapped glTF, vertex-coloured glTF, manifest and report
    Bake(Box<Bake>),
    /// Show what would be baked, and every problem found; writes nothing but the pictures asked for
    Inspect(Box<Inspect>),
    /// Error between two lightmaps
    Diff(Diff),
    /// Print a file of settings to start from: every key with its default, for SCENE.lumel.toml
    Config,
    /// Print a shell's completions, e.g. `lumel completions bash > /etc/bash_completion.d/lumel`
    Completions(Completions),
    /// Print the manual page of lumel or of one of its commands, e.g. `lumel man bake | man -l -`
    Man(Man),
    /// Look at a finished bake in a browser: a page on this machine alone
    View(super::view::View),
    /// A finished bake as one HTML page, with its lightmaps, errors, curves and problems
    Report(super::report::Report),
}

#[derive(Debug, Args)]
pub(crate) struct Bake {
    /// The level, .gltf or .glb
    pub scene: PathBuf,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub plan: Plan,
    #[command(flatten)]
    pub bounds: BoundsArgs,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// How much work the bake is worth [default: preview]
    #[arg(long, value_enum)]
    pub quality: Option<QualityArg>,
    /// Gather until the estimated relative error (root mean square over lit lumels) is below X,
    /// e.g. 0.02; a warning says where it cannot be reached [default: as many rays as --quality
    /// has]
    #[arg(long, value_name = "X")]
    pub error: Option<f32>,
    /// Sky: a radiance (one number, R,G,B or #rrggbb) or a latitude-longitude .hdr or .exr
    #[arg(long, value_name = "COLOR|FILE")]
    pub sky: Option<String>,
    /// Units of the file's lamps, beside glowing materials in W/(m² sr) [default: auto]
    #[arg(long, value_enum)]
    pub units: Option<UnitsArg>,
    /// Multiplies the sky [default: 1]
    #[arg(long, value_name = "X")]
    pub sky_intensity: Option<f32>,
    /// Turns a sky map about +Y, degrees, counter-clockwise seen from above [default: 0]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub sky_rotation: Option<f32>,
    /// A sun: direction in which its light travels, illuminance in lux, and its disc's diameter
    /// (0.533 for ours; without it, shadows are sharp), e.g. 0.3,-1,0.2,100000,0.533; may be
    /// repeated
    #[arg(long, value_name = "X,Y,Z,LUX[,DEGREES]", allow_hyphen_values = true, value_parser = parse_sun)]
    pub sun: Vec<Sun>,
    /// Multiply a source of light: a light or its node, an emissive material, `sky` or `sun`; `*`
    /// and `?` are wild, the last that fits counts (`inspect` lists names); may be repeated
    #[arg(long, value_name = "NAME=X", value_parser = parse_light)]
    pub light: Vec<LightScale>,
    /// Leave a source of light out, whatever --light says; may be repeated
    #[arg(long, value_name = "NAME")]
    pub exclude_light: Vec<String>,
    /// Keep sources of light apart under a name of your own; what no group names becomes the group
    /// `rest`; may be repeated
    #[arg(long, value_name = "GROUP=NAME,…", value_parser = parse_group)]
    pub group: Vec<LightGroup>,
    /// What the lightmap holds [default: radiance]
    #[arg(long, value_enum)]
    pub value: Option<ValueArg>,
    /// Extra channels in the EXR
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LAYER,…")]
    pub layers: Vec<LayerArg>,
    /// Keep what normal maps need of the directions that light comes from
    #[arg(long, value_enum)]
    pub directional: Option<DirectionalArg>,
    /// Distance beyond which surfaces do not occlude each other in the layer `ao` [default: by the
    /// scene's size]
    #[arg(long, value_name = "METRES")]
    pub ao_distance: Option<f32>,
    /// Write the lightmap's pages as KTX2 too, for graphics cards: R, G and B, one level
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub ktx2: Option<Ktx2Arg>,
    /// Name the lightmap in the .glb by this convention too, beside the nodes' extras
    #[arg(long, value_enum, value_delimiter = ',')]
    pub ext: Vec<ExtArg>,
    /// Light probes for things that move, into SCENE.probes.json: at the points of a file
    /// {"points": [[x, y, z], …]}, or on a grid with this distance in metres
    #[arg(long, value_name = "FILE.json|SPACING", allow_hyphen_values = true, value_parser = parse_probes)]
    pub probes: Option<ProbeSource>,
    /// Reflectances above this count as this [default: 0.98]
    #[arg(long, value_name = "X")]
    pub max_reflectance: Option<f32>,
    /// Lumels that lie partly inside or behind something [default: fill]
    #[arg(long, value_enum)]
    pub hidden: Option<HiddenArg>,
    /// Leave the borders of charts as they were gathered
    #[arg(long)]
    pub no_stitch: bool,
    /// Stitch the borders of charts, whatever the file of settings says
    #[arg(long, conflicts_with = "no_stitch")]
    pub stitch: bool,
    /// Bake the lightmap alone: no light at vertices, and no SCENE.vertex.glb
    #[arg(long)]
    pub no_vertex_colors: bool,
    /// Bake vertex colours too, whatever the file of settings says
    #[arg(long, conflicts_with = "no_vertex_colors")]
    pub vertex_colors: bool,
    /// Split edges in the scene with vertex colours until its relative error is about X
    #[arg(long, value_name = "X", conflicts_with = "no_vertex_colors")]
    pub vertex_error: Option<f32>,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Make charts and solve the light one after the other, not at once: for measuring, each
    /// phase's time in the report is then its own. The results are the same
    #[arg(long)]
    pub in_turn: bool,
    /// Keep the charts of large meshes in this folder, for later bakes of the same meshes. The
    /// results are the same
    #[arg(long, value_name = "DIR")]
    pub cache: Option<PathBuf>,
    /// Remove what was used least recently from the cache's folder when it is larger than this,
    /// e.g. 500M or 20G [default: 8G]
    #[arg(long, value_name = "BYTES", requires = "cache", value_parser = parse_bytes)]
    pub cache_size: Option<u64>,
    /// Write a picture of the lit level (from its first camera, if it has one)
    #[arg(long, value_name = "FILE.png")]
    pub preview: Option<PathBuf>,
    /// Write a coarse picture of the lit level as soon as its light is solved, long before the bake
    /// is done
    #[arg(long, value_name = "FILE.png")]
    pub first_picture: Option<PathBuf>,
    /// Write the report here too
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write a dependency file for make or ninja: results: everything that was read
    #[arg(long, value_name = "FILE")]
    pub depfile: Option<PathBuf>,
    /// The dependency file's target, instead of all results: a stamp, or the one name that the
    /// build knows; may be repeated
    #[arg(long, value_name = "PATH", requires = "depfile")]
    pub depfile_target: Vec<PathBuf>,
    /// Print what the bake would do, its pages, lumels, memory and time, and write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Do nothing if the results are there and whole, and inputs, settings and version are those
    /// that they were made with, by content
    #[arg(long)]
    pub skip_if_unchanged: bool,
    /// Print the report on standard output
    #[arg(long)]
    pub json: bool,
    /// Exit with code 5 if there was any warning
    #[arg(long)]
    pub strict: bool,
    /// Do not, whatever the file of settings says
    #[arg(long, conflicts_with = "strict")]
    pub no_strict: bool,
    /// How progress is shown on standard error
    #[arg(long, value_enum, default_value = "auto")]
    pub progress: ProgressArg,
    /// Say nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
    /// Say more
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
}

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressArg {
    /// One bar on a terminal, a line for each finished phase elsewhere
    Auto,
    /// Four lines a second for programs: progress 42.0 % gather, 12 s left
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
    /// Write pictures of the lightmap's charts into this folder: of the pages, and of the meshes
    /// with something wrong or most lumels
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// What the pictures show
    #[arg(long, value_enum, default_value = "charts", requires = "pictures")]
    pub paint: PaintArg,
}

/// What is refused. Not in the file of settings: whoever made the scene may have made that too.
#[derive(Debug, Args)]
pub(crate) struct BoundsArgs {
    /// Let `..` and links in the document lead to files outside of its folder, which the results
    /// then hold; absolute paths never do
    #[arg(long)]
    pub allow_outside: bool,
    /// Refuse pictures that take more memory than this once decoded, the scene's together or the
    /// sky's, e.g. 4G [default: 1G]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    pub max_image: Option<u64>,
    /// Refuse, before light is computed, a bake that would need more memory than this by its
    /// estimate (within a factor of 1.3), e.g. 4G
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

/// What decides the atlas.
#[derive(Debug, Args)]
pub(crate) struct Plan {
    /// Which scene of the document [default: its own default]
    #[arg(long = "scene", id = "scene_index", value_name = "N")]
    pub scene: Option<usize>,
    /// Do not take nodes named ..._LOD0, ..._LOD1 and so on for levels of detail
    #[arg(long)]
    pub no_lods: bool,
    /// Override `lods = false` in the settings file
    #[arg(long, conflicts_with = "no_lods")]
    pub lods: bool,
    /// Lumels per metre [default: by the scene's size]
    #[arg(long, value_name = "X")]
    pub texels_per_unit: Option<f32>,
    /// Longest side of a page in texels [default: 2048]
    #[arg(long, value_name = "N")]
    pub max_page: Option<u32>,
    /// Texels between charts [default: 2]
    #[arg(long, value_name = "N")]
    pub padding: Option<u32>,
    /// Pages and instances' rectangles in whole blocks of N x N texels (4 for BC formats; 1 for any
    /// size) [default: 4]
    #[arg(long, value_name = "N")]
    pub block_align: Option<u32>,
    /// Charts in whole blocks too, so that none is shared by two
    #[arg(long)]
    pub block_charts: bool,
    /// Override `block-charts = true` in the settings file
    #[arg(long, conflicts_with = "block_charts")]
    pub no_block_charts: bool,
    /// The asset's TEXCOORD_1, or new charts [default: auto]
    #[arg(long, value_enum)]
    pub uv: Option<UvArg>,
    /// What makes new charts [default: auto]
    #[arg(long, value_enum)]
    pub unwrapper: Option<UnwrapperArg>,
}

#[derive(Debug, Args)]
pub(crate) struct Diff {
    /// The reference
    pub a: PathBuf,
    /// The lightmap held against it
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
    /// Which shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

#[derive(Debug, Args)]
pub(crate) struct Man {
    /// Which command [default: lumel itself]
    pub command: Option<String>,
    /// Write the pages of all commands into this folder instead
    #[arg(short, long, value_name = "DIR", conflicts_with = "command")]
    pub output: Option<PathBuf>,
}

/// Declares a clap enum that mirrors one of the library's, so that the library needs no clap.
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
    Draft => Quality::Draft, "For a look";
    Quick => Quality::Quick, "For changing lights";
    Preview => Quality::Preview, "For work";
    Production => Quality::Production, "For shipping";
});
mirror!(ValueArg => ValueKind {
    Radiance => ValueKind::Radiance, "R = E/pi, what engines multiply with the albedo";
    Irradiance => ValueKind::Irradiance, "E";
    Radiosity => ValueKind::Radiosity, "B = reflectance x E";
});
mirror!(Ktx2Arg => Ktx2Format {
    Bc6h => Ktx2Format::Bc6h, "BC6H, unsigned: a byte a texel, for desktop cards";
    Rgb9e5 => Ktx2Format::Rgb9e5, "Shared exponent: four bytes a texel, for all cards";
});
mirror!(ExtArg => GltfExt {
    Moz => GltfExt::Moz, "MOZ_lightmap on materials: meshes and materials are copied for instances, pictures lie in the .glb";
});
mirror!(UvArg => UvMode {
    Auto => UvMode::Auto, "Keep a usable TEXCOORD_1, else make charts";
    Keep => UvMode::Keep, "Keep a TEXCOORD_1 that overlaps or has holes too, with warnings; make charts where it cannot be used at all";
    Generate => UvMode::Generate, "Always make charts";
});
mirror!(UnwrapperArg => UnwrapperChoice {
    Auto => UnwrapperChoice::Auto, "The one that measured better: uvunwrap";
    Uvunwrap => UnwrapperChoice::UvUnwrap, "The uvunwrap crate";
    Xatlas => UnwrapperChoice::Xatlas, "The xatlas-rs crate";
    Box => UnwrapperChoice::Box, "Projection along the axes";
});
mirror!(LayerArg => Layer {
    Direct => Layer::Direct, "direct.R, .G, .B";
    Indirect => Layer::Indirect, "indirect.R, .G, .B";
    Radiosity => Layer::Radiosity, "radiosity.R, .G, .B: reflected radiance";
    Error => Layer::Error, "error.Y: estimated standard error of the luminance";
    Coverage => Layer::Coverage, "coverage.Y: share of the texel on the surface";
    Ao => Layer::Ao, "ao.Y: ambient occlusion (openness), see --ao-distance";
    #[value(name = "sun_mask")]
    SunMask => Layer::SunMask, "sun_mask.Y: share of directional lights' light that gets through";
});
mirror!(UnitsArg => Units {
    Auto => Units::Auto, "Those of the materials; what Blender's exporter did to lamps is recognised and put right";
    Watt => Units::Watt, "Those of the materials: W/sr and W/m², or all in candela, lux and nit";
    Lumen => Units::Lumen, "Candela and lux: lamps are divided by 683 lm/W";
});
mirror!(PaintArg => Paint {
    Charts => Paint::Charts, "Charts, and where they overlap, are mirrored or too near to each other";
    Density => Paint::Density, "Lumels per metre: blue too few, orange too many";
});
mirror!(HiddenArg => Hidden {
    Fill => Hidden::Fill, "Hold the light of the part that can be seen, or else their neighbours'";
    Mean => Hidden::Mean, "Hold the mean over all of them, hidden parts being dark";
});
mirror!(DirectionalArg => Directional {
    Sh1 => Directional::Sh1, "Spherical harmonics of first order";
    Dominant => Directional::Dominant, "One direction";
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
            "expected X,Y,Z,LUX or X,Y,Z,LUX,DEGREES: a direction that is not zero, an illuminance above 0, a diameter".into(),
        ),
    }
}

/// NAME=FACTOR; a name may hold `=`.
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

/// GROUP=NAME,NAME,…; of a name with a comma, write the comma as `?`.
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

/// A number of bytes, with K, M, G or T for powers of 1024.
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

/// A number is a distance, anything else a file.
fn parse_probes(text: &str) -> Result<ProbeSource, String> {
    match text.trim().parse::<f32>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(ProbeSource::Spacing(x)),
        Ok(x) => Err(format!("found the distance {x}, expected a number above 0")),
        Err(_) => Ok(ProbeSource::File(text.into())),
    }
}

pub(crate) fn parse_sky(text: &str) -> Result<SkySource, String> {
    if let Some(hex) = text.strip_prefix('#')
        && hex.len() == 6
        && let Ok(v) = u32::from_str_radix(hex, 16)
    {
        // A hex colour is what a colour picker shows, so sRGB.
        let linear = |shift: u32| {
            let x = (v >> shift & 255) as f32 / 255.0;
            if x <= 0.04045 {
                x / 12.92
            } else {
                ((x + 0.055) / 1.055).powf(2.4)
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
        // A name without an ending is a colour's, or a slip: no file of either kind is called so.
        None if Path::new(text).extension().is_none() => Err(format!(
            "--sky {text}: expected one number, R,G,B (0.25,0.35,0.5), #rrggbb (#88aaff), or a .hdr or .exr file"
        )),
        None => Ok(SkySource::File(text.into())),
    }
}

/// What a pair of flags says.
fn either(yes: bool, no: bool) -> Option<bool> {
    (yes || no).then_some(yes)
}

/// What a repeated option says, if it was given.
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
        out.put(Flag, "uv", self.uv, |s, x| s.uv = x.into());
        out.put(Flag, "unwrapper", self.unwrapper, |s, x| {
            s.unwrapper = x.into()
        });
    }
}

impl Bake {
    /// Defaults, then the file of settings, then options.
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
        // Of several that fit a source the last counts: options go before the file, and what is
        // left out before what is dimmed.
        out.put(Flag, "light", given(&self.light), |s, x| s.lights.extend(x));
        out.put(Flag, "exclude-light", given(&self.exclude_light), |s, x| {
            s.lights.extend(x.into_iter().map(config::excluded))
        });
        out.put(Flag, "group", given(&self.group), |s, x| s.groups = x);
        out.put(Flag, "value", self.value, |s, x| s.value = x.into());
        out.put(Flag, "ktx2", self.ktx2, |s, x| s.ktx2 = Some(x.into()));
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
        out.put(Flag, "probes", self.probes.clone(), |s, x| {
            s.probes = Some(x)
        });
        out.put(Flag, "max-reflectance", self.max_reflectance, |s, x| {
            s.max_reflectance = x
        });
        out.put(Flag, "hidden", self.hidden, |s, x| s.hidden = x.into());
        let stitch = either(self.stitch, self.no_stitch);
        out.put(Flag, "stitch", stitch, |s, x| s.stitch = x);
        let colors = either(self.vertex_colors, self.no_vertex_colors);
        if self.no_vertex_colors {
            // Of a file that says how close they are to be, options go before it.
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
    /// The library's settings: what of them decides the atlas.
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
