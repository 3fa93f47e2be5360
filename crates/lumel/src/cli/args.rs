//! The command line's grammar.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use lumel::{Layer, Quality, Settings, SkySource, Sun, UnwrapperChoice, UvMode, ValueKind};

/// Bakes diffuse global illumination into glTF levels.
///
/// Exit codes: 0 ok, 1 wrong usage, 2 input/output failure, 3 invalid input, 4 unsupported feature, 5 warnings under --strict,
/// 75 stopped (Ctrl-C).
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
    /// Show what would be baked, and every problem found; writes nothing
    Inspect(Box<Inspect>),
    /// Error between two lightmaps
    Diff(Diff),
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
    /// How much work the bake is worth
    #[arg(long, value_enum, default_value = "preview")]
    pub quality: QualityArg,
    /// Gather until the estimated relative error is below X, e.g. 0.01 [default: by quality]
    #[arg(long, value_name = "X")]
    pub error: Option<f32>,
    /// Sky: a radiance (one number, R,G,B or #rrggbb) or a latitude-longitude .hdr or .exr
    #[arg(long, value_name = "COLOR|FILE")]
    pub sky: Option<String>,
    /// Multiplies the sky
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub sky_intensity: f32,
    /// A sun: direction in which its light travels, and illuminance in lux, e.g. 0.3,-1,0.2,100000; may be repeated
    #[arg(long, value_name = "X,Y,Z,LUX", allow_hyphen_values = true, value_parser = parse_sun)]
    pub sun: Vec<Sun>,
    /// What the lightmap holds
    #[arg(long, value_enum, default_value = "radiance")]
    pub value: ValueArg,
    /// Extra channels in the EXR
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LAYER,…")]
    pub layers: Vec<LayerArg>,
    /// Reflectances above this count as this
    #[arg(long, value_name = "X", default_value_t = 0.98)]
    pub max_reflectance: f32,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Write a picture of the lit level (from its first camera, if it has one)
    #[arg(long, value_name = "FILE.png")]
    pub preview: Option<PathBuf>,
    /// Write the report here too
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Print the report on standard output
    #[arg(long)]
    pub json: bool,
    /// Exit with code 5 if there was any warning
    #[arg(long)]
    pub strict: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
    /// Say more
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Inspect {
    /// The level, .gltf or .glb
    pub scene: PathBuf,
    #[command(flatten)]
    pub plan: Plan,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What decides the atlas.
#[derive(Debug, Args)]
pub(crate) struct Plan {
    /// Which scene of the document [default: its own default]
    #[arg(long = "scene", id = "scene_index", value_name = "N")]
    pub scene: Option<usize>,
    /// Lumels per metre [default: by the scene's size]
    #[arg(long, value_name = "X")]
    pub texels_per_unit: Option<f32>,
    /// Longest side of a page in texels
    #[arg(long, value_name = "N", default_value_t = 2048)]
    pub max_page: u32,
    /// Texels between charts
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub padding: u32,
    /// The asset's TEXCOORD_1, or new charts
    #[arg(long, value_enum, default_value = "auto")]
    pub uv: UvArg,
    /// What makes new charts
    #[arg(long, value_enum, default_value = "auto")]
    pub unwrapper: UnwrapperArg,
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

/// Declares a clap enum that mirrors one of the library's, so that the library needs no clap.
macro_rules! mirror {
    ($name:ident => $target:ty { $($variant:ident => $value:expr, $help:literal;)+ }) => {
        #[derive(Debug, Clone, Copy, ValueEnum)]
        pub(crate) enum $name { $(#[doc = $help] $variant,)+ }
        impl From<$name> for $target {
            fn from(x: $name) -> $target {
                match x { $($name::$variant => $value,)+ }
            }
        }
    };
}

mirror!(QualityArg => Quality {
    Draft => Quality::Draft, "For a look";
    Preview => Quality::Preview, "For work";
    Production => Quality::Production, "For shipping";
});
mirror!(ValueArg => ValueKind {
    Radiance => ValueKind::Radiance, "R = E/pi, what engines multiply with the albedo";
    Irradiance => ValueKind::Irradiance, "E";
    Radiosity => ValueKind::Radiosity, "B = reflectance x E";
});
mirror!(UvArg => UvMode {
    Auto => UvMode::Auto, "Keep a usable TEXCOORD_1, else make charts";
    Keep => UvMode::Keep, "The same, with a warning for each that cannot be kept";
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
});

/// Comma-separated finite numbers.
fn numbers(text: &str) -> Option<Vec<f32>> {
    text.split(',')
        .map(|x| x.trim().parse::<f32>().ok().filter(|x| x.is_finite()))
        .collect()
}

fn parse_sun(text: &str) -> Result<Sun, String> {
    match numbers(text).as_deref() {
        Some(&[x, y, z, lux]) if lux > 0.0 && (x, y, z) != (0.0, 0.0, 0.0) => Ok(Sun {
            direction: [x, y, z],
            lux,
        }),
        _ => Err(
            "expected X,Y,Z,LUX: a direction that is not zero and an illuminance above 0".into(),
        ),
    }
}

fn parse_sky(text: &str) -> Result<SkySource, String> {
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
        None => Ok(SkySource::File(text.into())),
    }
}

impl Plan {
    fn apply(&self, settings: &mut Settings) {
        settings.scene = self.scene;
        settings.texels_per_unit = self.texels_per_unit;
        settings.max_page = self.max_page;
        settings.padding = self.padding;
        settings.uv = self.uv.into();
        settings.unwrapper = self.unwrapper.into();
    }
}

impl Bake {
    /// The library's settings.
    pub(crate) fn settings(&self) -> Result<Settings, lumel::Error> {
        let mut s = Settings {
            quality: self.quality.into(),
            error: self.error,
            sky_intensity: self.sky_intensity,
            suns: self.sun.clone(),
            value: self.value.into(),
            max_reflectance: self.max_reflectance,
            ..Settings::default()
        };
        for &layer in &self.layers {
            let layer = layer.into();
            if !s.layers.contains(&layer) {
                s.layers.push(layer);
            }
        }
        if let Some(sky) = &self.sky {
            s.sky = parse_sky(sky).map_err(lumel::Error::Setting)?;
        }
        self.plan.apply(&mut s);
        Ok(s)
    }
}

impl Inspect {
    /// The library's settings.
    pub(crate) fn settings(&self) -> Result<Settings, lumel::Error> {
        let mut s = Settings::default();
        self.plan.apply(&mut s);
        Ok(s)
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
        assert_eq!(
            parse_sun("0,-1,0,10"),
            Ok(Sun {
                direction: [0., -1., 0.],
                lux: 10.
            })
        );
        for bad in ["0,0,0,10", "0,-1,0", "0,-1,0,-5", "a,b,c,d", "0,-1,0,inf"] {
            assert!(parse_sun(bad).is_err(), "{bad}");
        }
    }
}
