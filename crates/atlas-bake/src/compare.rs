//! Error of one lightmap against another: the figures of `lumel diff`.
//!
//! All figures are computed on luminance. None depends on the scale of the stored value, as long as
//! both images use the same.

use serde::Serialize;

use crate::error::{Error, Result};
use crate::exr_io::ExrImage;
use crate::false_color::{encode_png, heat};

/// Rec. 709 luminance weights.
pub(crate) const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Fraction of the reference's mean that is added to each reference value before dividing by it, so
/// that black texels do not dominate relative errors.
const FLOOR: f64 = 0.01;

/// Relative errors that [`error_png`] shows as black and as white; the scale between is
/// logarithmic.
const SHOWN: [f64; 2] = [1e-3, 1.0];

/// The texels that [`diff`] counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Counted {
    /// Texels with a positive `coverage.Y` in the reference, or in the map if the reference has
    /// none.
    Coverage,
    /// Texels that are not black in either image, because there was no coverage channel.
    NonZero,
}

/// Error of a map against a reference. All figures are over the counted lumels, with x and y the
/// luminances of map and reference, m the mean of y, and d = (x − y) / (y + 0.01 m).
///
/// A relative figure is infinite (null in JSON) if the reference is black throughout and the map is
/// not.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiffReport {
    /// √mean(d²).
    #[serde(rename = "relRMSE")]
    pub rel_rmse: f64,
    /// √mean(d²) over lumels with y > 0.001 m only.
    #[serde(rename = "relRMSE0")]
    pub rel_rmse_lit: f64,
    /// √mean((x − y)²) / m.
    #[serde(rename = "nRMSE")]
    pub n_rmse: f64,
    /// mean(x) / m − 1.
    pub bias: f64,
    /// Median of |d|.
    pub p50: f64,
    /// 95th percentile of |d|.
    pub p95: f64,
    /// 99th percentile of |d|.
    pub p99: f64,
    /// Largest |d|.
    pub max: f64,
    /// Column and row of the largest |d|.
    pub max_at: [u32; 2],
    /// Lumels compared.
    pub lumels: u64,
    /// How lumels were chosen.
    pub counted: Counted,
    /// Lumels skipped because one of their samples is NaN or infinite in either image.
    pub non_finite: u64,
}

/// Compares `map` with `reference`.
///
/// # Errors
/// [`Error::SizeMismatch`] if the images differ in size; [`Error::Image`] if one has neither `R`,
/// `G`, `B` nor `Y`.
pub fn diff(reference: &ExrImage, map: &ExrImage) -> Result<DiffReport> {
    let p = Pairs::collect(reference, map)?;
    let n = p.x.len() as f64;
    let (mut d2, mut d2_lit, mut lit, mut e2, mut sum_x, mut max_at) =
        (0.0, 0.0, 0u64, 0.0, 0.0, 0);
    let mut abs = Vec::with_capacity(p.x.len());
    for (i, (&x, &y)) in p.x.iter().zip(&p.y).enumerate() {
        let d = p.relative(i);
        d2 += d * d;
        if y > 1e-3 * p.mean {
            d2_lit += d * d;
            lit += 1;
        }
        e2 += (x - y) * (x - y);
        sum_x += x;
        if abs.get(max_at).is_none_or(|m| d.abs() > *m) {
            max_at = i;
        }
        abs.push(d.abs());
    }
    let max = abs.get(max_at).copied().unwrap_or(0.0);
    let texel = p.texel.get(max_at).copied().unwrap_or(0) as u32;
    abs.sort_by(f64::total_cmp);
    let over_mean = |v: f64| {
        if p.mean > 0.0 {
            v / p.mean
        } else if v == 0.0 {
            0.0
        } else {
            f64::INFINITY
        }
    };
    let count = n.max(1.0);
    Ok(DiffReport {
        rel_rmse: (d2 / count).sqrt(),
        rel_rmse_lit: (d2_lit / lit.max(1) as f64).sqrt(),
        n_rmse: over_mean((e2 / count).sqrt()),
        bias: over_mean(sum_x / count - p.mean),
        p50: percentile(&abs, 0.50),
        p95: percentile(&abs, 0.95),
        p99: percentile(&abs, 0.99),
        max,
        max_at: [
            texel % reference.width.max(1),
            texel / reference.width.max(1),
        ],
        lumels: p.x.len() as u64,
        counted: p.counted,
        non_finite: p.non_finite,
    })
}

/// A PNG of |d| (see [`DiffReport`]) at every counted lumel. The colours run from black (0.1 % and
/// below) through blue, green, yellow and red to white (100 % and above); uncounted texels are
/// grey.
///
/// # Errors
/// As [`diff`].
pub fn error_png(reference: &ExrImage, map: &ExrImage) -> Result<Vec<u8>> {
    let p = Pairs::collect(reference, map)?;
    let mut pixels = vec![[64u8; 3]; reference.width as usize * reference.height as usize];
    let decades = (SHOWN[1] / SHOWN[0]).log10();
    for (i, &texel) in p.texel.iter().enumerate() {
        let t = (p.relative(i).abs() / SHOWN[0]).log10() / decades;
        pixels[texel] = heat(t as f32);
    }
    encode_png(reference.width, reference.height, &pixels)
}

/// Luminances at the counted lumels of two images of the same size.
struct Pairs {
    x: Vec<f64>,
    y: Vec<f64>,
    /// Index of each lumel in the image.
    texel: Vec<usize>,
    mean: f64,
    counted: Counted,
    non_finite: u64,
}

impl Pairs {
    fn collect(reference: &ExrImage, map: &ExrImage) -> Result<Pairs> {
        let (a, b) = ([reference.width, reference.height], [map.width, map.height]);
        if a != b {
            return Err(Error::SizeMismatch { a, b });
        }
        let (lr, lm) = (luminance(reference, "reference")?, luminance(map, "map")?);
        let coverage = ["coverage.Y", "coverage"]
            .iter()
            .find_map(|n| reference.channel(n).or_else(|| map.channel(n)));
        let mut p = Pairs {
            x: Vec::new(),
            y: Vec::new(),
            texel: Vec::new(),
            mean: 0.0,
            counted: if coverage.is_some() {
                Counted::Coverage
            } else {
                Counted::NonZero
            },
            non_finite: 0,
        };
        for (i, (&y, &x)) in lr.iter().zip(&lm).enumerate() {
            if !coverage.map_or(x != 0.0 || y != 0.0, |c| c[i] > 0.0) {
                continue;
            }
            if !(x.is_finite() && y.is_finite()) {
                p.non_finite += 1;
                continue;
            }
            p.x.push(x);
            p.y.push(y);
            p.texel.push(i);
        }
        p.mean = p.y.iter().sum::<f64>() / p.y.len().max(1) as f64;
        Ok(p)
    }

    /// d of lumel `i`.
    fn relative(&self, i: usize) -> f64 {
        let e = self.x[i] - self.y[i];
        // 0/0 counts as no error. The denominator is 0 if the reference is black throughout.
        if e == 0.0 {
            0.0
        } else {
            e / (self.y[i] + FLOOR * self.mean)
        }
    }
}

fn luminance(image: &ExrImage, what: &str) -> Result<Vec<f64>> {
    match ["R", "G", "B"].map(|c| image.channel(c)) {
        [Some(r), Some(g), Some(b)] => {
            let [wr, wg, wb] = LUMINANCE;
            Ok(r.iter()
                .zip(g)
                .zip(b)
                .map(|((&r, &g), &b)| wr * f64::from(r) + wg * f64::from(g) + wb * f64::from(b))
                .collect())
        }
        _ => match image.channel("Y") {
            Some(y) => Ok(y.iter().map(|&y| f64::from(y)).collect()),
            None => Err(Error::Image {
                what: what.into(),
                message: "it has neither channels R, G, B nor Y".into(),
            }),
        },
    }
}

/// Percentile `q` (0..=1) of ascending `sorted` by linear interpolation between ranks; 0 for an
/// empty list.
pub(crate) fn percentile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return 0.0;
    };
    let rank = q * last as f64;
    let (lo, hi) = (sorted[rank.floor() as usize], sorted[rank.ceil() as usize]);
    if lo == hi {
        lo
    } else {
        lo + (hi - lo) * rank.fract()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[f32], coverage: Option<&[f32]>) -> ExrImage {
        let mut channels: Vec<_> = ["B", "G", "R"]
            .iter()
            .map(|c| (c.to_string(), values.to_vec()))
            .collect();
        channels.extend(coverage.map(|c| ("coverage.Y".to_string(), c.to_vec())));
        ExrImage {
            width: values.len() as u32,
            height: 1,
            channels,
        }
    }

    /// The luminance weights sum to 1 within a few ulp in f64, so hand-computed figures hold to
    /// 1e-12.
    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * b.abs().max(1.0), "{a} is not {b}");
    }

    #[test]
    fn equal_images_have_no_error() {
        let a = grey(&[1.0, 2.0, 0.0], None);
        let r = diff(&a, &a).unwrap();
        assert_eq!(
            (r.rel_rmse, r.n_rmse, r.bias, r.max, r.lumels, r.counted),
            (0.0, 0.0, 0.0, 0.0, 2, Counted::NonZero)
        );
    }

    #[test]
    fn figures_of_a_case_computed_by_hand() {
        // y = 1, 2, 3, mean 2, floor 0.02; x − y = 0.5, 0, −1; d = 0.5/1.02, 0, −1/3.02.
        let r = diff(&grey(&[1.0, 2.0, 3.0], None), &grey(&[1.5, 2.0, 2.0], None)).unwrap();
        let (d0, d2) = (0.5 / 1.02, 1.0 / 3.02);
        close(r.rel_rmse, ((d0 * d0 + d2 * d2) / 3.0f64).sqrt());
        close(r.rel_rmse_lit, r.rel_rmse);
        close(r.n_rmse, (1.25 / 3.0f64).sqrt() / 2.0);
        close(r.bias, 5.5 / 6.0 - 1.0);
        close(r.p50, d2);
        close(r.p95, d2 + (d0 - d2) * 0.9);
        close(r.max, d0);
        assert_eq!(r.max_at, [0, 0]);
    }

    #[test]
    fn coverage_decides_what_is_counted_and_dark_lumels_do_not_enter_the_lit_figure() {
        // Covered: y = 0 (x = 0.1) and y = 2 (x = 2). The mean is 1 and the floor 0.01, so d = 10
        // and 0. The third is padding.
        let a = grey(&[0.0, 2.0, 9.0], Some(&[1.0, 0.5, 0.0]));
        let b = grey(&[0.1, 2.0, 1.0], None);
        let r = diff(&a, &b).unwrap();
        assert_eq!((r.lumels, r.counted), (2, Counted::Coverage));
        // 0.1 as f32 has a relative rounding error of 1.5e-8.
        assert!((r.rel_rmse - 10.0 / 2f64.sqrt()).abs() < 1e-6);
        assert_eq!(r.rel_rmse_lit, 0.0);
        assert_eq!(diff(&b, &a).unwrap().counted, Counted::Coverage);
    }

    #[test]
    fn black_references_and_bad_samples_are_told() {
        let black = grey(&[0.0, 0.0], Some(&[1.0, 1.0]));
        assert_eq!(diff(&black, &black).unwrap().rel_rmse, 0.0);
        let r = diff(&black, &grey(&[1.0, 0.0], None)).unwrap();
        assert!(r.rel_rmse.is_infinite() && r.bias.is_infinite() && r.n_rmse.is_infinite());
        let r = diff(&grey(&[1.0, f32::NAN], None), &grey(&[1.0, 1.0], None)).unwrap();
        assert_eq!((r.lumels, r.non_finite, r.rel_rmse), (1, 1, 0.0));
        let none = grey(&[0.0], None);
        assert_eq!(diff(&none, &none).unwrap().lumels, 0);
    }

    #[test]
    fn different_sizes_and_missing_channels_are_errors() {
        let e = diff(&grey(&[1.0], None), &grey(&[1.0, 2.0], None)).unwrap_err();
        assert!(matches!(
            e,
            Error::SizeMismatch {
                a: [1, 1],
                b: [2, 1]
            }
        ));
        let depth = ExrImage {
            width: 1,
            height: 1,
            channels: vec![("Z".into(), vec![1.0])],
        };
        assert!(matches!(diff(&depth, &depth), Err(Error::Image { .. })));
    }

    #[test]
    fn error_picture_shows_where() {
        let png = error_png(&grey(&[1.0, 1.0, 0.0], None), &grey(&[1.0, 9.0, 0.0], None)).unwrap();
        let image = image::load_from_memory(&png).unwrap().to_rgb8();
        let pixels: Vec<_> = image.pixels().map(|p| p.0).collect();
        assert_eq!(pixels, [[0, 0, 0], [255, 255, 255], [64, 64, 64]]);
    }
}
