//! The exposure that a bake suggests to engines.

use glam::Vec3;

use crate::compare::LUMINANCE;
use crate::manifest::ValueKind;
use crate::page::Page;

/// Display value of a scene's log-average luminance: middle grey (Reinhard et al., "Photographic
/// Tone Reproduction for Digital Images", 2002).
pub(crate) const KEY: f64 = 0.18;

/// Typical albedo of the surfaces of a level.
const ALBEDO: f64 = 0.5;

/// Largest exposure, for levels with next to no light.
const MOST: f64 = 1e12;

pub(crate) fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::from(LUMINANCE.map(|w| w as f32)))
}

/// Luminances above 0, sorted; there is at least one.
pub(crate) struct Luminances(Vec<f32>);

impl Luminances {
    /// Of all colours that are finite and brighter than black; `None` if there are none.
    pub fn of(colors: impl Iterator<Item = Vec3>) -> Option<Luminances> {
        let mut y: Vec<f32> = colors
            .map(luminance)
            .filter(|y| y.is_finite() && *y > 0.0)
            .collect();
        y.sort_unstable_by(f32::total_cmp);
        (!y.is_empty()).then_some(Luminances(y))
    }

    /// The quantile `q`, 0..=1.
    pub fn at(&self, q: f64) -> f32 {
        self.0[((self.0.len() - 1) as f64 * q) as usize]
    }

    /// The log-average of the middle 90 %. A few very bright lumels, such as a sun patch, do not
    /// affect it. Anything below a thousandth of the bright parts looks black and counts as that.
    pub fn typical(&self) -> f64 {
        let (y, cut) = (&self.0, self.0.len() / 20);
        let middle = &y[cut..(y.len() - cut).max(cut + 1)];
        let floor = self.at(0.9) * 1e-3;
        let sum: f64 = middle
            .iter()
            .map(|y| libm::log(f64::from(y.max(floor))))
            .sum();
        libm::exp(sum / middle.len() as f64)
    }
}

/// The factor from the radiance of `pages` to a screen's values, 1 being white. A surface of albedo
/// 0.5 in the level's typical light becomes middle grey.
///
/// exposure = 0.18 / (0.5 M), rounded to four digits, where M is the log-average of R's luminance
/// (0.2126 R + 0.7152 G + 0.0722 B) over the middle 90 % of all lit lumels: those with
/// coverage and R > 0, sorted, without the darkest and the brightest 5 %. Values below a thousandth
/// of the 90th percentile count as that. If pages hold irradiance E, R is E/π. If they hold
/// radiosity B, which includes the albedo, exposure = 0.18 / M with M of B/π.
///
/// 1 if no lumel is lit.
pub fn suggested_exposure(pages: &[Page], value: ValueKind) -> f64 {
    let covered = pages.iter().flat_map(|page| {
        let texels = page.value.iter().zip(&page.coverage);
        texels.filter(|(_, coverage)| **coverage > 0.0)
    });
    let Some(stored) = Luminances::of(covered.map(|(value, _)| Vec3::from(*value))) else {
        return 1.0;
    };
    let seen = match value {
        ValueKind::Radiance => ALBEDO,
        ValueKind::Irradiance => ALBEDO * std::f64::consts::FRAC_1_PI,
        ValueKind::Radiosity => std::f64::consts::FRAC_1_PI,
    };
    let exposure = (KEY / (seen * stored.typical())).min(MOST);
    // Four digits are finer than anyone can see, and easy to type.
    format!("{exposure:.3e}").parse().unwrap_or(exposure)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A page of grey lumels.
    fn page(values: impl IntoIterator<Item = f32>) -> Page {
        let value: Vec<[f32; 3]> = values.into_iter().map(|x| [x; 3]).collect();
        Page {
            width: value.len() as u32,
            height: 1,
            coverage: vec![1.0; value.len()],
            value,
            layers: Vec::new(),
        }
    }

    fn of(values: impl IntoIterator<Item = f32>) -> f64 {
        suggested_exposure(&[page(values)], ValueKind::Radiance)
    }

    #[test]
    fn an_even_level_becomes_middle_grey() {
        assert_eq!(of([1.0; 9]), 0.36);
        // Rounded to four digits.
        assert_eq!(of([3.0; 9]), 0.12);
        assert_eq!(of([700.0; 9]), 5.143e-4);
        // The geometric mean of 1 and 4.
        assert_eq!(of([1.0, 4.0]), 0.18);
    }

    #[test]
    fn few_bright_or_black_lumels_do_not_move_it() {
        let level = |odd: f32| (0..1000).map(move |i| if i < 50 { odd } else { 1.0 });
        for odd in [1e6, 65504.0, 1e-9, 0.0, f32::NAN, f32::INFINITY] {
            assert_eq!(of(level(odd)), 0.36, "{odd}");
        }
    }

    #[test]
    fn the_dark_half_counts_no_less_than_a_thousandth() {
        let half = |dark: f32| (0..1000).map(move |i| if i < 500 { dark } else { 1.0 });
        assert_eq!(of(half(1e-12)), of(half(1e-3)));
        assert!(of(half(1e-3)) > of(half(1e-2)));
    }

    #[test]
    fn what_pages_hold_does_not_matter_nor_does_padding() {
        let mut padded = page([1.0, 1.0, 1e9]);
        padded.coverage[2] = 0.0;
        let one = |value| suggested_exposure(std::slice::from_ref(&padded), value);
        assert_eq!(one(ValueKind::Radiance), 0.36);
        assert_eq!(one(ValueKind::Irradiance), 1.131);
        assert_eq!(one(ValueKind::Radiosity), 0.5655);
    }

    #[test]
    fn darkness_has_no_exposure() {
        assert_eq!(of([0.0; 3]), 1.0);
        assert_eq!(suggested_exposure(&[], ValueKind::Radiance), 1.0);
        assert_eq!(of([1e-40; 3]), MOST);
    }
}
