//! `SCENE.lumel.toml`: options of `bake` and `inspect` kept beside the scene.
//!
//! Keys are the long option names. Paths are relative to the file. [`TEMPLATE`] lists every key.

use std::collections::BTreeMap;
use std::fmt;
use std::io::ErrorKind;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use lumel::mesh_ingest::{Digest, read_regular};
use lumel::{
    GltfExt, LightGroup, LightScale, Origin, ProbeSource, Provenance, Settings, SkySource, Sun,
};
use serde::de::{Deserializer, Error as _, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, de};

use super::args::{
    DirectionalArg, ExtArg, HiddenArg, Ktx2Arg, LayerArg, ModeArg, PngArg, QualityArg, UnitsArg,
    UnwrapperArg, UvArg, ValueArg, parse_sky,
};

/// All keys with their defaults, commented out: the output of `lumel config`.
pub(crate) const TEMPLATE: &str = include_str!("template.toml");

/// Longest file that is read, bytes: a thousand times the length of real settings.
const MAX_BYTES: u64 = 1 << 20;

/// The contents of a settings file and where it is.
#[derive(Debug)]
pub(crate) struct ConfigFile {
    path: PathBuf,
    digest: Digest,
    options: FileOptions,
}

/// Settings, and the origin of each of them.
#[derive(Debug, Default)]
pub(crate) struct Layered {
    pub settings: Settings,
    pub provenance: Provenance,
    /// `--strict`, from either source.
    pub strict: bool,
}

impl Layered {
    /// Applies the value of option `key`, if `who` gave one, and records its origin.
    pub(crate) fn put<T>(
        &mut self,
        who: Origin,
        key: &str,
        value: Option<T>,
        apply: impl FnOnce(&mut Settings, T),
    ) {
        if let Some(value) = value {
            self.provenance.origins.insert(key.into(), who);
            apply(&mut self.settings, value);
        }
    }
}

/// Options that choose the settings file.
#[derive(Debug, Default, Clone, clap::Args)]
pub(crate) struct ConfigArgs {
    /// Read settings from this file; options override it [default: SCENE.lumel.toml beside the
    /// scene, if it exists]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Ignore settings files
    #[arg(long, conflicts_with = "config")]
    pub no_config: bool,
}

impl ConfigArgs {
    /// Path of the settings file, which need not exist.
    pub(crate) fn place(&self, scene: &Path) -> Option<PathBuf> {
        let given = || self.config.clone();
        (!self.no_config).then(|| given().unwrap_or_else(|| scene.with_extension("lumel.toml")))
    }

    /// Defaults, overridden by the file's settings.
    ///
    /// # Errors
    /// [`lumel::Error::Config`].
    pub(crate) fn layered(&self, scene: &Path) -> Result<Layered, lumel::Error> {
        let mut out = Layered::default();
        let there = |path: &PathBuf| self.config.is_some() || path.exists();
        if let Some(path) = self.place(scene).filter(there) {
            ConfigFile::read(path)?.apply(&mut out);
        }
        Ok(out)
    }
}

impl ConfigFile {
    fn read(path: PathBuf) -> Result<ConfigFile, lumel::Error> {
        let fail = |message: String, io| lumel::Error::Config {
            file: path.clone(),
            message,
            io,
        };
        let bytes = read_regular(&path, MAX_BYTES).map_err(|e| {
            let io = e.kind() != ErrorKind::FileTooLarge;
            fail(format!(": {e}"), io)
        })?;
        let text = String::from_utf8(bytes).map_err(|e| {
            let at = e.utf8_error().valid_up_to();
            fail(
                format!(": found bytes that are not UTF-8 at {at}, expected TOML"),
                false,
            )
        })?;
        let options = parse(&text).map_err(|message| fail(message, false))?;
        let digest = Digest::of(text.as_bytes());
        Ok(ConfigFile {
            path,
            digest,
            options,
        })
    }

    fn apply(self, out: &mut Layered) {
        let base = self.path.parent().unwrap_or(Path::new("")).to_owned();
        self.options.apply(&base, out);
        out.provenance.config = Some((self.path, self.digest));
    }
}

/// Parses; errors begin with `:LINE:COLUMN: ` and say what was found and what was expected.
fn parse(text: &str) -> Result<FileOptions, String> {
    toml::from_str(text).map_err(|e| {
        let place = e.span().map_or(String::new(), |span| {
            let before = &text[..text.floor_char_boundary(span.start)];
            let line = before.matches('\n').count() + 1;
            let column = before.rsplit('\n').next().unwrap_or(before).chars().count() + 1;
            format!(":{line}:{column}")
        });
        format!("{place}: {}", plain(e.message()))
    })
}

/// Rewords an error message of `serde` in the style of Lumel's.
fn plain(message: &str) -> String {
    let message = message.trim_end().replace('\n', "; ");
    if let Some(rest) = message.strip_prefix("unknown field `")
        && let Some((key, known)) = rest.split_once("`, expected ")
    {
        let names: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
        let near = names
            .iter()
            .min_by_key(|n| strsim::damerau_levenshtein(n, key));
        let near = near.filter(|n| strsim::damerau_levenshtein(n, key) <= 1 + key.len() / 4);
        return match near {
            Some(near) => format!("found the key `{key}`, expected `{near}`"),
            None => format!(
                "found the key `{key}`, expected one of {}",
                names.join(", ")
            ),
        };
    }
    for kind in ["invalid type: ", "invalid value: ", "invalid length "] {
        if let Some(rest) = message.strip_prefix(kind) {
            let mut text = format!("found {rest}");
            for (theirs, ours) in [
                ("expected u32", "expected a whole number of at least 0"),
                ("expected usize", "expected a whole number of at least 0"),
                ("expected f32", "expected a number"),
            ] {
                text = text.replace(theirs, ours);
            }
            return text;
        }
    }
    if let Some(key) = message.strip_prefix("missing field ") {
        return format!("found no key {key}, expected it here");
    }
    message
}

/// All keys of the file, by the long option name; `None` leaves the default.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
struct FileOptions {
    scene: Option<usize>,
    lods: Option<bool>,
    #[serde(deserialize_with = "positive")]
    texels_per_unit: Option<f32>,
    max_page: Option<u32>,
    padding: Option<u32>,
    block_align: Option<u32>,
    block_charts: Option<bool>,
    page_by: Option<Vec<String>>,
    cull_unseen: Option<bool>,
    walkable: Option<Vec<String>>,
    uv: Option<Choice<UvArg>>,
    unwrapper: Option<Choice<UnwrapperArg>>,
    quality: Option<Choice<QualityArg>>,
    #[serde(deserialize_with = "positive")]
    error: Option<f32>,
    sky: Option<SkyValue>,
    #[serde(deserialize_with = "not_negative")]
    sky_intensity: Option<f32>,
    sky_rotation: Option<f32>,
    sun: Option<Vec<SunTable>>,
    light: Option<Vec<LightTable>>,
    exclude_light: Option<Vec<String>>,
    group: Option<Vec<GroupTable>>,
    mode: Option<Choice<ModeArg>>,
    mixed: Option<Vec<String>>,
    realtime: Option<Vec<String>>,
    value: Option<Choice<ValueArg>>,
    ktx2: Option<Choice<Ktx2Arg>>,
    png: Option<Choice<PngArg>>,
    ext: Option<Vec<Choice<ExtArg>>>,
    layers: Option<Vec<Choice<LayerArg>>>,
    directional: Option<Choice<DirectionalArg>>,
    #[serde(deserialize_with = "positive")]
    ao_distance: Option<f32>,
    probes: Option<ProbesValue>,
    probe_volume: Option<bool>,
    #[serde(deserialize_with = "not_negative")]
    indirect_boost: Option<f32>,
    #[serde(deserialize_with = "not_negative")]
    emissive_boost: Option<f32>,
    #[serde(deserialize_with = "not_negative")]
    albedo_boost: Option<f32>,
    #[serde(deserialize_with = "not_negative")]
    bounce_saturation: Option<f32>,
    #[serde(deserialize_with = "color")]
    ambient_floor: Option<[f32; 3]>,
    #[serde(deserialize_with = "not_negative")]
    ao_multiply: Option<f32>,
    #[serde(deserialize_with = "positive")]
    max_reflectance: Option<f32>,
    hidden: Option<Choice<HiddenArg>>,
    units: Option<Choice<UnitsArg>>,
    split_sides: Option<bool>,
    cut_charts: Option<bool>,
    stitch: Option<bool>,
    vertex_colors: Option<bool>,
    #[serde(deserialize_with = "positive")]
    vertex_error: Option<f32>,
    strict: Option<bool>,
}

impl FileOptions {
    /// `base` is the folder that paths are relative to.
    fn apply(self, base: &Path, out: &mut Layered) {
        use Origin::File;
        out.put(File, "scene", self.scene, |s, x| s.scene = Some(x));
        out.put(File, "lods", self.lods, |s, x| s.lods = x);
        out.put(File, "texels-per-unit", self.texels_per_unit, |s, x| {
            s.texels_per_unit = Some(x)
        });
        out.put(File, "max-page", self.max_page, |s, x| s.max_page = x);
        out.put(File, "padding", self.padding, |s, x| s.padding = x);
        out.put(File, "block-align", self.block_align, |s, x| s.block = x);
        out.put(File, "block-charts", self.block_charts, |s, x| {
            s.block_charts = x
        });
        out.put(File, "cull-unseen", self.cull_unseen, |s, x| {
            s.cull_unseen = x
        });
        out.put(File, "walkable", self.walkable, |s, x| s.walkable = x);
        out.put(File, "page-by", self.page_by, |s, x| s.page_by = x);
        out.put(File, "uv", self.uv, |s, x| s.uv = x.0.into());
        out.put(File, "unwrapper", self.unwrapper, |s, x| {
            s.unwrapper = x.0.into()
        });
        out.put(File, "quality", self.quality, |s, x| s.quality = x.0.into());
        out.put(File, "error", self.error, |s, x| s.error = Some(x));
        out.put(File, "sky", self.sky, |s, x| {
            s.sky = match x.0 {
                SkySource::File(path) => SkySource::File(base.join(path)),
                sky => sky,
            }
        });
        out.put(File, "sky-intensity", self.sky_intensity, |s, x| {
            s.sky_intensity = x
        });
        out.put(File, "sky-rotation", self.sky_rotation, |s, x| {
            s.sky_rotation = x
        });
        out.put(File, "sun", self.sun, |s, x| {
            s.suns = x.into_iter().map(Sun::from).collect()
        });
        out.put(File, "light", self.light, |s, x| {
            s.lights.extend(x.into_iter().map(LightScale::from))
        });
        out.put(File, "exclude-light", self.exclude_light, |s, x| {
            s.lights.extend(x.into_iter().map(excluded))
        });
        out.put(File, "group", self.group, |s, x| {
            s.groups = x.into_iter().map(LightGroup::from).collect()
        });
        out.put(File, "mode", self.mode, |s, x| s.mode = x.0.into());
        out.put(File, "mixed", self.mixed, |s, x| s.mixed = x);
        out.put(File, "realtime", self.realtime, |s, x| s.realtime = x);
        out.put(File, "value", self.value, |s, x| s.value = x.0.into());
        out.put(File, "ktx2", self.ktx2, |s, x| s.ktx2 = Some(x.0.into()));
        out.put(File, "png", self.png, |s, x| s.png = Some(x.0.into()));
        out.put(File, "ext", self.ext, |s, x| {
            s.ext.clear();
            for ext in x {
                let ext = GltfExt::from(ext.0);
                if !s.ext.contains(&ext) {
                    s.ext.push(ext);
                }
            }
        });
        out.put(File, "layers", self.layers, |s, x| {
            s.layers.clear();
            for layer in x {
                let layer = layer.0.into();
                if !s.layers.contains(&layer) {
                    s.layers.push(layer);
                }
            }
        });
        out.put(File, "directional", self.directional, |s, x| {
            s.directional = Some(x.0.into())
        });
        out.put(File, "ao-distance", self.ao_distance, |s, x| {
            s.ao_distance = Some(x)
        });
        out.put(File, "probe-volume", self.probe_volume, |s, x| {
            s.probe_volume = x
        });
        out.put(File, "probes", self.probes, |s, x| {
            s.probes = Some(match x.0 {
                ProbeSource::File(path) => ProbeSource::File(base.join(path)),
                grid => grid,
            })
        });
        out.put(File, "indirect-boost", self.indirect_boost, |s, x| {
            s.not_physical.indirect_boost = x
        });
        out.put(File, "emissive-boost", self.emissive_boost, |s, x| {
            s.not_physical.emissive_boost = x
        });
        out.put(File, "albedo-boost", self.albedo_boost, |s, x| {
            s.not_physical.albedo_boost = x
        });
        out.put(File, "bounce-saturation", self.bounce_saturation, |s, x| {
            s.not_physical.bounce_saturation = x
        });
        out.put(File, "ambient-floor", self.ambient_floor, |s, x| {
            s.not_physical.ambient_floor = x
        });
        out.put(File, "ao-multiply", self.ao_multiply, |s, x| {
            s.not_physical.ao_multiply = x
        });
        out.put(File, "max-reflectance", self.max_reflectance, |s, x| {
            s.max_reflectance = x
        });
        out.put(File, "units", self.units, |s, x| s.units = x.0.into());
        out.put(File, "hidden", self.hidden, |s, x| s.hidden = x.0.into());
        out.put(File, "cut-charts", self.cut_charts, |s, x| s.cut_charts = x);
        out.put(File, "split-sides", self.split_sides, |s, x| {
            s.split_sides = x
        });
        out.put(File, "stitch", self.stitch, |s, x| s.stitch = x);
        out.put(File, "vertex-colors", self.vertex_colors, |s, x| {
            s.vertex_colors = x
        });
        out.put(File, "vertex-error", self.vertex_error, |s, x| {
            s.vertex_error = Some(x)
        });
        out.strict = self.strict.unwrap_or(false);
    }
}

/// A factor of 0, as `--exclude-light` gives.
pub(crate) fn excluded(name: String) -> LightScale {
    LightScale { name, factor: 0.0 }
}

/// One of the values that an option takes.
#[derive(Debug)]
struct Choice<T>(T);

impl<'de, T: ValueEnum> Deserialize<'de> for Choice<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Word<T>(PhantomData<T>);
        impl<T: ValueEnum> Visitor<'_> for Word<T> {
            type Value = Choice<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let names = T::value_variants().iter().filter_map(T::to_possible_value);
                let names: Vec<String> = names.map(|v| format!("\"{}\"", v.get_name())).collect();
                write!(f, "one of {}", names.join(", "))
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Choice<T>, E> {
                T::from_str(text, false)
                    .map(Choice)
                    .map_err(|_| E::invalid_value(Unexpected::Str(text), &self))
            }
        }
        deserializer.deserialize_str(Word(PhantomData))
    }
}

fn number_where<'de, D: Deserializer<'de>>(
    deserializer: D,
    fits: impl Fn(f32) -> bool,
    expected: &str,
) -> Result<Option<f32>, D::Error> {
    struct Number<'a>(&'a str);
    impl Visitor<'_> for Number<'_> {
        type Value = f64;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }

        fn visit_i64<E>(self, x: i64) -> Result<f64, E> {
            Ok(x as f64)
        }

        fn visit_f64<E>(self, x: f64) -> Result<f64, E> {
            Ok(x)
        }
    }
    let x = deserializer.deserialize_f64(Number(expected))?;
    if !(x as f32).is_finite() || !fits(x as f32) {
        return Err(D::Error::custom(format!("found {x}, expected {expected}")));
    }
    Ok(Some(x as f32))
}

fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f32>, D::Error> {
    number_where(deserializer, |x| x > 0.0, "a number above 0")
}

fn not_negative<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f32>, D::Error> {
    number_where(deserializer, |x| x >= 0.0, "a number of at least 0")
}

fn color<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f32; 3]>, D::Error> {
    match SkyValue::deserialize(deserializer)?.0 {
        SkySource::Color(c) => Ok(Some(c)),
        _ => Err(D::Error::custom(
            "found a file name, expected a number of at least 0, [R, G, B] or \"#rrggbb\"",
        )),
    }
}

fn factor<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    not_negative(deserializer).map(|x| x.unwrap_or(1.0))
}

/// A sky: one number, three numbers, a hex colour or a file name.
#[derive(Debug)]
struct SkyValue(SkySource);

impl<'de> Deserialize<'de> for SkyValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Sky;
        impl<'de> Visitor<'de> for Sky {
            type Value = SkyValue;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number of at least 0, [R, G, B], \"#rrggbb\" or a file name")
            }

            fn visit_i64<E: de::Error>(self, x: i64) -> Result<SkyValue, E> {
                self.visit_f64(x as f64)
            }

            fn visit_f64<E: de::Error>(self, x: f64) -> Result<SkyValue, E> {
                if !(x as f32).is_finite() || x < 0.0 {
                    return Err(E::invalid_value(Unexpected::Float(x), &self));
                }
                Ok(SkyValue(SkySource::Color([x as f32; 3])))
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<SkyValue, E> {
                parse_sky(text)
                    .map(SkyValue)
                    .map_err(|_| E::invalid_value(Unexpected::Str(text), &self))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<SkyValue, A::Error> {
                let mut rgb = Vec::new();
                while let Some(x) = seq.next_element::<f32>()? {
                    rgb.push(x);
                }
                match rgb[..] {
                    [r, g, b] if rgb.iter().all(|x| x.is_finite() && *x >= 0.0) => {
                        Ok(SkyValue(SkySource::Color([r, g, b])))
                    }
                    _ => Err(A::Error::custom(format!(
                        "found {rgb:?}, expected three numbers of at least 0"
                    ))),
                }
            }
        }
        deserializer.deserialize_any(Sky)
    }
}

/// Probes: a grid spacing or a file name.
#[derive(Debug)]
struct ProbesValue(ProbeSource);

impl<'de> Deserialize<'de> for ProbesValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Probes;
        impl Visitor<'_> for Probes {
            type Value = ProbesValue;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a spacing above 0 or a file name")
            }

            fn visit_i64<E: de::Error>(self, x: i64) -> Result<ProbesValue, E> {
                self.visit_f64(x as f64)
            }

            fn visit_f64<E: de::Error>(self, x: f64) -> Result<ProbesValue, E> {
                if (x as f32).is_finite() && x as f32 > 0.0 {
                    return Ok(ProbesValue(ProbeSource::Spacing(x as f32)));
                }
                Err(E::invalid_value(Unexpected::Float(x), &self))
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<ProbesValue, E> {
                if text.is_empty() {
                    return Err(E::invalid_value(Unexpected::Str(text), &self));
                }
                Ok(ProbesValue(ProbeSource::File(text.into())))
            }
        }
        deserializer.deserialize_any(Probes)
    }
}

/// One `[[sun]]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SunTable {
    direction: [f32; 3],
    lux: f32,
    #[serde(default)]
    degrees: f32,
}

impl From<SunTable> for Sun {
    fn from(s: SunTable) -> Sun {
        Sun {
            direction: s.direction,
            lux: s.lux,
            angle: s.degrees,
        }
    }
}

/// One `[[light]]`; the last match wins.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightTable {
    name: String,
    #[serde(deserialize_with = "factor")]
    factor: f32,
}

impl From<LightTable> for LightScale {
    fn from(l: LightTable) -> LightScale {
        LightScale {
            name: l.name,
            factor: l.factor,
        }
    }
}

/// One `[[group]]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GroupTable {
    name: String,
    sources: Vec<String>,
}

impl From<GroupTable> for LightGroup {
    fn from(g: GroupTable) -> LightGroup {
        LightGroup {
            name: g.name,
            sources: g.sources,
        }
    }
}

/// Settings that are not defaults and their origins, one per line.
pub(crate) fn describe(origins: &BTreeMap<String, Origin>) -> String {
    let list = |who: Origin| {
        let keys: Vec<&str> = (origins.iter())
            .filter(|(_, o)| **o == who)
            .map(|(key, _)| key.as_str())
            .collect();
        if keys.is_empty() {
            "none".into()
        } else {
            keys.join(", ")
        }
    };
    format!(
        "{} from the file, {} from options",
        list(Origin::File),
        list(Origin::Flag)
    )
}

#[cfg(test)]
mod tests;
