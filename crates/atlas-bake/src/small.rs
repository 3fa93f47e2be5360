//! Lightmap pages as PNG with 8 bits per channel, for targets without float textures.
//!
//! Alpha holds a common factor of the three colours. Both formats store square roots, so that steps
//! are finer where light is dim.

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use rayon::prelude::*;
use serde::Serialize;

use crate::compare::{DiffReport, diff};
use crate::error::{Error, Result};
use crate::exr_io::{ExrImage, ExrStats, as_stored};
use crate::page::Page;

/// How light is stored in 8 bits. `t` is the texel, 0..=1 per channel, and `scale` is one number for
/// all pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PngFormat {
    /// light = (t.rgb × t.a)² × scale; `scale` is the brightest value, and nothing is clamped.
    Rgbm,
    /// light = t.rgb² / t.a × scale; `scale` is what a screen shows as white, and 255 times as much
    /// can be stored.
    Rgbd,
}

/// How a page was stored.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PngReport {
    /// Format.
    pub format: PngFormat,
    /// Factor of the decoding.
    pub scale: f32,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Samples that had to be changed.
    pub clamped: ExrStats,
    /// Error of the stored page against the baked one, on the luminance of covered lumels.
    pub error: DiffReport,
}

impl PngFormat {
    /// The factor for `pages`; `exposure` is the one that they suggest, from radiance to a screen's
    /// values.
    pub fn scale(self, pages: &[Page], exposure: f64) -> f32 {
        let values = pages.iter().flat_map(|p| p.value.iter().flatten());
        let most = values
            .copied()
            .filter(|x| x.is_finite())
            .fold(0.0, f32::max);
        let most = as_stored(most);
        let scale = match self {
            PngFormat::Rgbm => most,
            PngFormat::Rgbd => (1.0 / exposure) as f32,
        };
        // A black level.
        if scale.is_finite() && scale > 0.0 {
            scale
        } else {
            1.0
        }
    }

    /// The texel for a light relative to the scale.
    fn encode(self, light: [f32; 3]) -> [u8; 4] {
        let most = light.into_iter().fold(0.0, f32::max);
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
        // Alpha is rounded so that no colour exceeds 1.
        let alpha = match self {
            PngFormat::Rgbm => (most.sqrt() * 255.0).ceil().clamp(1.0, 255.0),
            PngFormat::Rgbd => (255.0 / most.max(1.0)).floor().clamp(1.0, 255.0),
        };
        let a = alpha / 255.0;
        let [r, g, b] = light.map(|x| match self {
            PngFormat::Rgbm => byte(x.sqrt() / a),
            PngFormat::Rgbd => byte((x * a).sqrt()),
        });
        [r, g, b, alpha as u8]
    }

    /// The light of a texel, relative to the scale.
    pub fn decode(self, texel: [u8; 4]) -> [f32; 3] {
        let [r, g, b, a] = texel.map(|x| f32::from(x) / 255.0);
        [r, g, b].map(|x| match self {
            PngFormat::Rgbm => (x * a) * (x * a),
            PngFormat::Rgbd => x * x / a,
        })
    }
}

/// Encodes R, G and B of `page` as the EXR has them, row 0 at the top. `scale` is
/// [`PngFormat::scale`] of all pages.
///
/// NaN, infinite and negative samples become 0, and samples beyond the range are clamped to it; all
/// are counted.
///
/// # Errors
/// [`Error::Inconsistent`] if the page is empty or its lists do not match its size.
pub fn write_lightmap_png(
    page: &Page,
    format: PngFormat,
    scale: f32,
) -> Result<(Vec<u8>, PngReport)> {
    let texels = page.width as usize * page.height as usize;
    if texels == 0 || page.value.len() != texels || page.coverage.len() != texels {
        return Err(Error::Inconsistent {
            at: "lightmap page for PNG".into(),
            message: format!(
                "expected {} x {} values and coverages and at least one, got {} and {}",
                page.width,
                page.height,
                page.value.len(),
                page.coverage.len()
            ),
        });
    }
    let most = match format {
        PngFormat::Rgbm => 1.0,
        PngFormat::Rgbd => 255.0,
    };
    let mut clamped = ExrStats::default();
    let mut relative = |x: f32| {
        let y = as_stored(x) / scale;
        if !x.is_finite() {
            clamped.non_finite += 1;
            0.0
        } else if x < 0.0 {
            clamped.negative += 1;
            0.0
        } else {
            clamped.clamped += u64::from(y > most * (1.0 + 1e-5));
            y.min(most)
        }
    };
    let light: Vec<[f32; 3]> = page.value.iter().map(|v| v.map(&mut relative)).collect();
    let stored: Vec<[u8; 4]> = light.par_iter().map(|l| format.encode(*l)).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(
            stored.as_flattened(),
            page.width,
            page.height,
            ExtendedColorType::Rgba8,
        )
        .map_err(|e| Error::Image {
            what: "lightmap PNG".into(),
            message: e.to_string(),
        })?;
    let back: Vec<[f32; 3]> = (stored.iter())
        .map(|t| format.decode(*t).map(|x| x * scale))
        .collect();
    let report = PngReport {
        format,
        scale,
        bytes: bytes.len() as u64,
        clamped,
        error: diff(&image(page, &page.value, true), &image(page, &back, false))?,
    };
    Ok((bytes, report))
}

/// The page with other values as an image for [`diff`].
fn image(page: &Page, value: &[[f32; 3]], coverage: bool) -> ExrImage {
    let channel = |c: usize| value.iter().map(|v| v[c]).collect();
    let mut channels = vec![
        ("B".into(), channel(2)),
        ("G".into(), channel(1)),
        ("R".into(), channel(0)),
    ];
    channels.extend(coverage.then(|| ("coverage.Y".into(), page.coverage.clone())));
    ExrImage {
        width: page.width,
        height: page.height,
        channels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(values: &[f32]) -> Page {
        Page {
            width: values.len() as u32,
            height: 1,
            value: values.iter().map(|x| [*x, 0.5 * x, 0.1 * x]).collect(),
            coverage: vec![1.0; values.len()],
            layers: Vec::new(),
        }
    }

    #[test]
    fn what_is_read_back_is_near_what_was_stored() {
        let values: Vec<f32> = (0..200).map(|k| 40.0 * 0.95f32.powi(k)).collect();
        for format in [PngFormat::Rgbm, PngFormat::Rgbd] {
            let page = page(&values);
            let scale = format.scale(std::slice::from_ref(&page), 0.5);
            let (bytes, report) = write_lightmap_png(&page, format, scale).expect("a page");
            let back = image::load_from_memory(&bytes).expect("a PNG").into_rgba8();
            for (x, v) in values.iter().enumerate() {
                let texel = back.get_pixel(x as u32, 0).0;
                let found = format.decode(texel)[0] * scale;
                // Colours of 8 bits are off by half a step of 255. In RGBM the brightest colour is
                // at least half of 1 while alpha has more than one step; a square doubles relative
                // errors. In RGBD it is the square root of light × alpha, of at most 1.
                let root = match format {
                    PngFormat::Rgbm => (v / scale).sqrt().max(2.0 / 255.0),
                    PngFormat::Rgbd => (v / scale).sqrt().min(0.7),
                };
                let step = match format {
                    PngFormat::Rgbm => 2.0 * (0.5 / 255.0) / 0.5,
                    PngFormat::Rgbd => 2.0 * (0.5 / 255.0) / root,
                };
                let most = v * step + (1.5 / 255.0f32).powi(2) * scale;
                assert!((found - v).abs() <= most, "{format:?} {v}: {found}, {most}");
            }
            assert_eq!(report.clamped, ExrStats::default());
            assert!(report.error.rel_rmse < 0.01, "{report:?}");
        }
    }

    #[test]
    fn bad_samples_are_counted() {
        let mut page = page(&[1.0, 2.0]);
        page.value[0] = [f32::NAN, -1.0, 1e6];
        let (_, report) = write_lightmap_png(&page, PngFormat::Rgbd, 1.0).expect("a page");
        let c = report.clamped;
        assert_eq!((c.non_finite, c.negative, c.clamped), (1, 1, 1));
        assert!(write_lightmap_png(&Page::default(), PngFormat::Rgbm, 1.0).is_err());
    }
}
