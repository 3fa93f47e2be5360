//! Lightmap pages as KTX2, which engines can upload to the GPU without conversion.
//!
//! There are two formats: unsigned BC6H (1 byte per texel, lossy blocks of 4×4) and shared-exponent
//! rgb9e5 (4 bytes per texel, nine bits per channel). Files have one level and no supercompression.
//! Mipmaps would mix charts with their neighbours, because padding only serves bilinear lookups in
//! the first level, and loaders support different supercompression schemes. Row 0 is at the top
//! (`KTXorientation` "rd"), as in the EXR.
//!
//! The compression error of every page is measured and reported.

mod bc6h;
mod container;
mod cube;
mod format;
mod rgb9e5;
#[cfg(test)]
mod tests;
mod volume;

use rayon::prelude::*;
use serde::Serialize;

pub use cube::write_reflection_ktx2;
pub use format::Ktx2Format;
pub use volume::write_probe_volume;

use crate::compare::{DiffReport, diff};
use crate::error::{Error, Result};
use crate::exr_io::{ExrImage, ExrStats, as_stored};
use crate::page::Page;

/// How a page was stored.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ktx2Report {
    /// Format.
    pub format: Ktx2Format,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Samples that had to be changed.
    pub clamped: ExrStats,
    /// Error of the stored page against the baked one, on the luminance of covered lumels; see
    /// `rel_rmse` first.
    pub error: DiffReport,
    /// Peak signal-to-noise ratio, dB, over all channels of covered lumels: 20 lg(largest value /
    /// √mean((x − y)²)); null if nothing differs. It says little about dark parts of a lightmap
    /// with highlights.
    pub psnr: Option<f64>,
}

/// Encodes R, G and B of `page` as the EXR has them; extra channels exist only there. Equal pages
/// give equal bytes for any number of threads.
///
/// NaN, infinite and negative samples become 0, and samples above [`Ktx2Format::max`] are clamped
/// to it; both are counted. Texels that neither have a surface nor were dilated (black, no
/// coverage) may take other values if that helps their block.
///
/// # Errors
/// [`Error::Inconsistent`] if the page is empty or its lists do not match its size.
pub fn write_lightmap_ktx2(page: &Page, format: Ktx2Format) -> Result<(Vec<u8>, Ktx2Report)> {
    let texels = page.width as usize * page.height as usize;
    if texels == 0 || page.value.len() != texels || page.coverage.len() != texels {
        return Err(Error::Inconsistent {
            at: "lightmap page for KTX2".into(),
            message: format!(
                "expected {} x {} values and coverages and at least one, got {} and {}",
                page.width,
                page.height,
                page.value.len(),
                page.coverage.len()
            ),
        });
    }
    let size = [page.width, page.height];
    let (value, clamped) = storable(&page.value, format.max());
    let (data, back) = match format {
        Ktx2Format::Bc6h => {
            let data = bc6h::encode(size, &value, &page.coverage);
            let back = bc6h::decode(size, &data);
            (data, back)
        }
        Ktx2Format::Rgb9e5 => {
            let words: Vec<u32> = value.par_iter().map(|v| rgb9e5::encode(*v)).collect();
            let back = words.iter().map(|w| rgb9e5::decode(*w)).collect();
            (words.iter().flat_map(|w| w.to_le_bytes()).collect(), back)
        }
    };
    let [width, height] = size;
    let bytes = container::assemble(container::layout_of(format), [width, height, 0], &data)?;
    let report = Ktx2Report {
        format,
        bytes: bytes.len() as u64,
        clamped,
        error: diff(
            &image(size, &page.value, Some(&page.coverage)),
            &image(size, &back, None),
        )?,
        psnr: psnr(page, &back),
    };
    Ok((bytes, report))
}

/// Encodes a shadow mask, i.e. R, G and B of `page` and its layer `A`, as
/// `VK_FORMAT_R8G8B8A8_UNORM`. Values are rounded to multiples of 1/255.
///
/// # Errors
/// [`Error::Inconsistent`] if the page is empty, has no layer `A`, or its lists do not match its
/// size.
pub fn write_mask_ktx2(page: &Page) -> Result<Vec<u8>> {
    let texels = page.width as usize * page.height as usize;
    let alpha = page.channel("A").unwrap_or_default();
    if texels == 0 || page.value.len() != texels || alpha.len() != texels {
        return Err(Error::Inconsistent {
            at: "shadow mask for KTX2".into(),
            message: format!(
                "expected {} x {} values and at least one, got {} and {} of A",
                page.width,
                page.height,
                page.value.len(),
                alpha.len()
            ),
        });
    }
    let byte = |x: f32| (as_stored(x).clamp(0.0, 1.0) * 255.0).round() as u8;
    let data: Vec<u8> = (page.value.iter().zip(alpha))
        .flat_map(|([r, g, b], a)| [*r, *g, *b, *a].map(byte))
        .collect();
    let format = (ktx2::Format::R8G8B8A8_UNORM, 4);
    container::assemble(format, [page.width, page.height, 0], &data)
}

/// Values clamped to 0..=max, and counts of the changes.
fn storable(value: &[[f32; 3]], max: f32) -> (Vec<[f32; 3]>, ExrStats) {
    let mut stats = ExrStats::default();
    let mut one = |x: f32| {
        if !x.is_finite() {
            stats.non_finite += 1;
            0.0
        } else if x < 0.0 {
            stats.negative += 1;
            0.0
        } else {
            stats.clamped += u64::from(x > max);
            as_stored(x).min(max)
        }
    };
    let out = value.iter().map(|v| v.map(&mut one)).collect();
    (out, stats)
}

/// The page as an image for [`diff`].
fn image([width, height]: [u32; 2], value: &[[f32; 3]], coverage: Option<&[f32]>) -> ExrImage {
    let channel = |c: usize| value.iter().map(|v| v[c]).collect();
    let mut channels = vec![
        ("B".into(), channel(2)),
        ("G".into(), channel(1)),
        ("R".into(), channel(0)),
    ];
    channels.extend(coverage.map(|c| ("coverage.Y".into(), c.to_vec())));
    ExrImage {
        width,
        height,
        channels,
    }
}

fn psnr(page: &Page, back: &[[f32; 3]]) -> Option<f64> {
    let (mut peak, mut sum, mut n) = (0.0f64, 0.0f64, 0u64);
    for ((a, b), _) in (page.value.iter().zip(back))
        .zip(&page.coverage)
        .filter(|(_, c)| **c > 0.0)
    {
        for (x, y) in a.iter().zip(b).filter(|(x, _)| x.is_finite()) {
            peak = peak.max(f64::from(*x));
            sum += f64::from(x - y).powi(2);
            n += 1;
        }
    }
    (sum > 0.0).then(|| 20.0 * libm::log10(peak / (sum / n as f64).sqrt()))
}
