//! Converts lamps to the units of emissive materials and the sky, whatever an exporter wrote.
//!
//! Blender's exporter writes materials in W/(m² sr). Its *Lighting Mode* decides the units of
//! lamps: *Standard* multiplies them by 683 (candela and lux), *Unitless* leaves them in W/sr and
//! W/m², and *Raw* writes a lamp's watts instead of W/sr. Files do not record the mode. But users
//! type round figures, so the mode that gives the roundest figures is assumed.

use std::f64::consts::PI;

use mesh_ingest::{Light, LightKind, Scene};
use serde_json::Value;

use crate::settings::Units;

/// Factor of Blender's exporter: lumens per watt at 555 nm.
const LUMENS_PER_WATT: f64 = 683.0;

/// Beginning of the generator string of Blender's own exporter. Lumel's add-on appends its name to
/// it.
pub(crate) const BLENDER: &str = "Khronos glTF Blender I/O";
const ADD_ON: &str = "Lumel add-on";

/// An intensity with this many significant digits is a product, not a figure that someone typed; an
/// `f32` holds 7.
const MOST_DIGITS: u32 = 7;

/// A mode needs this many fewer digits, over all lamps, to be chosen. A single product that is
/// round by chance does not suffice: one in a hundred seven-digit figures has only five.
const CLEAR: u32 = 2;

/// How an exporter scaled lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Standard,
    Unitless,
    Raw,
}

impl Mode {
    const ALL: [Mode; 3] = [Mode::Unitless, Mode::Standard, Mode::Raw];

    fn name(self) -> &'static str {
        match self {
            Mode::Standard => "Standard",
            Mode::Unitless => "Unitless",
            Mode::Raw => "Raw",
        }
    }

    /// Factor that converts a lamp to W/sr or W/m².
    fn factor(self, sun: bool) -> f64 {
        match self {
            Mode::Standard => 1.0 / LUMENS_PER_WATT,
            Mode::Raw if !sun => 0.25 / PI,
            _ => 1.0,
        }
    }
}

/// Whether the document comes directly from Blender's exporter.
pub(crate) fn plain_blender(document: &Value) -> bool {
    let generator = document["asset"]["generator"].as_str().unwrap_or_default();
    generator.starts_with(BLENDER) && !generator.contains(ADD_ON)
}

/// Converts the file's lamps to the units of its materials; returns a note if anything was
/// converted or is unclear.
pub(crate) fn settle(scene: &mut Scene, document: &Value, units: Units) -> Option<String> {
    let lumen = format!(
        "lamps are in candela and lux and were divided by {LUMENS_PER_WATT} to convert them to W"
    );
    match units {
        Units::Watt => None,
        Units::Lumen => {
            scale(&mut scene.lights, Mode::Standard);
            (!scene.lights.is_empty()).then_some(lumen)
        }
        Units::Auto if plain_blender(document) => {
            let lamps = lamps(document);
            if lamps.is_empty() {
                return None;
            }
            let Some(mode) = recognise(&lamps) else {
                return Some(
                    "Blender exported this level, but its Lighting Mode cannot be recognised, so lamps were not converted; pass --units lumen if it was Standard, --units watt if Unitless"
                        .into(),
                );
            };
            scale(&mut scene.lights, mode);
            let name = mode.name();
            Some(match mode {
                Mode::Standard => format!("Blender exported with Lighting Mode {name}: {lumen}"),
                Mode::Unitless => {
                    format!("Blender exported with Lighting Mode {name}: lamps are in W")
                }
                Mode::Raw => format!(
                    "Blender exported with Lighting Mode {name}: lamps were divided by 4 pi to convert W to W/sr"
                ),
            })
        }
        Units::Auto => None,
    }
}

fn scale(lights: &mut [Light], mode: Mode) {
    for light in lights {
        let sun = matches!(light.kind, LightKind::Directional { .. });
        light.intensity *= mode.factor(sun) as f32;
    }
}

/// Intensities of the document's punctual lights, and whether they are suns.
fn lamps(document: &Value) -> Vec<(f64, bool)> {
    let lights = &document["extensions"]["KHR_lights_punctual"]["lights"];
    (lights.as_array().into_iter().flatten())
        .filter_map(|l| {
            let intensity = l["intensity"].as_f64().filter(|i| *i > 0.0)?;
            Some((intensity, l["type"] == "directional"))
        })
        .collect()
}

/// The mode that makes the figures in Blender the roundest, if one clearly does.
fn recognise(lamps: &[(f64, bool)]) -> Option<Mode> {
    let typed = |mode: Mode| -> u32 {
        let figures = lamps.iter().map(|&(intensity, sun)| {
            // A lamp's watts are 4 pi times its W/sr.
            let watts = intensity * mode.factor(sun) * if sun { 1.0 } else { 4.0 * PI };
            digits(watts)
        });
        figures.sum()
    };
    let mut scores = Mode::ALL.map(|mode| (typed(mode), mode));
    scores.sort_by_key(|(digits, _)| *digits);
    let [(best, mode), (next, other), _] = scores;
    // Suns are the same in both.
    let same = lamps.iter().all(|l| mode.factor(l.1) == other.factor(l.1));
    let next = if same { scores[2].0 } else { next };
    (best + CLEAR <= next).then_some(mode)
}

/// Significant digits of the decimal that an `f32` stands for.
fn digits(x: f64) -> u32 {
    let magnitude = x.abs().log10().floor();
    for n in 1..MOST_DIGITS {
        let unit = 10_f64.powf(magnitude + 1.0 - f64::from(n));
        // The figure was rounded to f32 twice.
        if ((x / unit).round() * unit - x).abs() <= 2.0 * f64::from(f32::EPSILON) * x.abs() {
            return n;
        }
    }
    MOST_DIGITS
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The intensity that Blender's exporter writes for a figure.
    fn exported(typed: f64, sun: bool, mode: Mode) -> f64 {
        let lamp = if sun || mode == Mode::Raw {
            typed
        } else {
            typed / (4.0 * PI)
        };
        let factor = if mode == Mode::Standard {
            LUMENS_PER_WATT
        } else {
            1.0
        };
        f64::from((lamp * factor) as f32)
    }

    #[test]
    fn modes_are_recognised_by_round_figures() {
        let levels: [&[(f64, bool)]; 5] = [
            &[(1000.0, false)],
            &[(80.0, false), (37.5, false), (150.0, false)],
            &[(10.0, false), (1.0, true)],
            &[(12.34, false), (3.7, true)],
            &[(0.25, false)],
        ];
        for level in levels {
            for mode in Mode::ALL {
                let lamps: Vec<_> = (level.iter())
                    .map(|&(typed, sun)| (exported(typed, sun, mode), sun))
                    .collect();
                assert_eq!(recognise(&lamps), Some(mode), "{level:?}");
            }
        }
    }

    #[test]
    fn suns_alone_are_told_apart_where_they_differ() {
        for typed in [1.0, 5.0, 0.8] {
            let sun = |mode| recognise(&[(exported(typed, true, mode), true)]);
            assert_eq!(sun(Mode::Standard), Some(Mode::Standard), "{typed}");
            // Unitless and Raw are the same for suns.
            assert_eq!(sun(Mode::Raw).map(|m| m.factor(true)), Some(1.0), "{typed}");
        }
    }

    #[test]
    fn figures_that_nobody_typed_decide_nothing() {
        assert_eq!(recognise(&[(78.912_345, false), (5.123_457, true)]), None);
        assert_eq!(digits(1000.0), 1);
        assert_eq!(digits(0.25), 2);
        assert_eq!(digits(f64::from(0.1_f32)), 1);
        assert_eq!(digits(PI), MOST_DIGITS);
    }

    #[test]
    fn only_blenders_own_exporter_is_guessed_about() {
        let by = |generator: &str| serde_json::json!({"asset": {"generator": generator}});
        assert!(plain_blender(&by("Khronos glTF Blender I/O v5.0.21")));
        let add_on = by("Khronos glTF Blender I/O v5.0.21, Lumel add-on 0.2.0");
        assert!(!plain_blender(&add_on));
        assert!(!plain_blender(&by("lumel 0.2.0")) && !plain_blender(&Value::Null));
    }
}
