//! The extra channels of a page.

use radiosity::MASKS;

use crate::manifest::ValueKind;
use crate::options::{BakeOptions, Directional, Layer};
use crate::seams::Range;

/// An extra channel of a page.
pub(crate) struct Channel {
    pub name: String,
    pub range: Range,
    /// Colour channel of the reflectance that the channel is finally multiplied with.
    /// Multiplication comes last because reflectance jumps where light does not.
    pub tint: Option<usize>,
    /// Whether it holds light in the requested unit.
    pub in_unit: bool,
}

/// Temporary channels with shadow masks.
pub(crate) const MASK: [&str; MASKS] = ["mask.R", "mask.G", "mask.B", "mask.A"];

/// Temporary channels with the surface's reflectance.
pub(crate) const TINT: [&str; 3] = ["tint.R", "tint.G", "tint.B"];

/// Whether any channel is multiplied with the reflectance.
pub(crate) fn tinted(options: &BakeOptions) -> bool {
    options.value == ValueKind::Radiosity || options.layers.contains(&Layer::Radiosity)
}

/// The extra channels that `options` ask for, and temporary ones: shadow masks, if there are any,
/// and the reflectance.
pub(crate) fn channels(options: &BakeOptions, masks: bool) -> Vec<Channel> {
    use Range::{Light, Share, Signed, Untouched};
    let all = options.value == ValueKind::Radiosity;
    let layers = options.layers.iter().map(|layer| match layer {
        Layer::Direct => ("direct", "RGB", Light, all, true),
        Layer::Indirect => ("indirect", "RGB", Light, all, true),
        Layer::Radiosity => ("radiosity", "RGB", Light, true, false),
        Layer::Error => ("error", "Y", Untouched, false, true),
        Layer::Coverage => ("coverage", "Y", Untouched, false, false),
        Layer::Ao => ("ao", "Y", Share, false, false),
        Layer::SunMask => ("sun_mask", "Y", Share, false, false),
    });
    let directional: &[(&str, &str, Range, bool, bool)] = match options.directional {
        None => &[],
        Some(Directional::Sh1) => &[
            ("L0", "RGB", Light, all, true),
            ("L1x", "RGB", Signed, all, true),
            ("L1y", "RGB", Signed, all, true),
            ("L1z", "RGB", Signed, all, true),
        ],
        Some(Directional::Dominant) => &[("dominant", "XYZ", Signed, false, false)],
    };
    let named = layers.chain(directional.iter().copied()).flat_map(
        |(name, parts, range, tint, in_unit)| {
            parts.chars().enumerate().map(move |(c, part)| Channel {
                name: format!("{name}.{part}"),
                range,
                tint: tint.then_some(c),
                in_unit,
            })
        },
    );
    let tint = TINT.iter().filter(|_| tinted(options)).map(|name| Channel {
        name: (*name).into(),
        range: Untouched,
        tint: None,
        in_unit: false,
    });
    let masks = MASK.iter().filter(|_| masks);
    let masks = masks.map(|name| Channel {
        name: (*name).into(),
        range: Share,
        tint: None,
        in_unit: false,
    });
    named.chain(masks).chain(tint).collect()
}
