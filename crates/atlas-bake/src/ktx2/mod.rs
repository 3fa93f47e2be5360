//! Lightmap pages as KTX2: what engines ship, on the graphics card as it lies in the file.
//!
//! Two formats: BC6H (unsigned; a byte a texel, each block of 4×4 packed with loss) and
//! shared-exponent rgb9e5 (four bytes a texel, nine bits a channel). Files hold one level and no
//! supercompression. Smaller levels would mix charts with what lies beside them, since padding is
//! made for bilinear lookups in the first level alone; and which supercompression a loader knows
//! differs. Row 0 is at the top (`KTXorientation` "rd"), as in the EXR.
//!
//! What storing cost is measured on every page and reported.

mod bc6h;
mod container;
mod format;
mod rgb9e5;
#[cfg(test)]
mod tests;

use rayon::prelude::*;
use serde::Serialize;

pub use format::Ktx2Format;

use crate::compare::{DiffReport, diff};
use crate::error::{Error, Result};
use crate::exr_io::{ExrImage, ExrStats};
use crate::page::Page;

/// A page as it was stored.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ktx2Report {
    /// Format.
    pub format: Ktx2Format,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Samples that could not be stored as they are.
    pub clamped: ExrStats,
    /// What a reader finds against what was baked, on the luminance of covered lumels; `rel_rmse`
    /// is the figure to look at.
    pub error: DiffReport,
    /// Peak signal to noise ratio, dB, over all channels of covered lumels: 20 lg(largest value /
    /// √mean((x − y)²)); null where nothing differs. It tells little of dark parts of a lightmap
    /// with bright spots.
    pub psnr: Option<f64>,
}

/// Encodes R, G and B of `page`; extra channels stay with the EXR. Equal pages give equal bytes for
/// any number of threads.
///
/// NaN, infinite and negative samples become 0, samples above [`Ktx2Format::max`] become it; both
/// are counted. Texels without a surface that padding did not reach (black, no coverage) may take
/// other values, where that helps the block they are in.
///
/// # Errors
/// [`Error::Inconsistent`] where the page is empty or its lists are not of its size.
pub fn write_lightmap_ktx2(page: &Page, format: Ktx2Format) -> Result<(Vec<u8>, Ktx2Report)> {
    let texels = page.width as usize * page.height as usize;
    if texels == 0 || page.value.len() != texels || page.coverage.len() != texels {
        return Err(Error::Inconsistent {
            at: "lightmap page for KTX2".into(),
            message: format!(
                "expected {} x {} values and coverages, more than none, got {} and {}",
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
    let bytes = container::assemble(format, size, &data)?;
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

/// Values in 0..=max, and what had to be changed for that.
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
            x.min(max)
        }
    };
    let out = value.iter().map(|v| v.map(&mut one)).collect();
    (out, stats)
}

/// As [`diff`] takes it.
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
    (sum > 0.0).then(|| 20.0 * (peak / (sum / n as f64).sqrt()).log10())
}
