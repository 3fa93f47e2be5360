//! Light that the texel grids of the two sides cannot both represent.
//!
//! Along a seam, bilinear lookups are piecewise linear with knots at texel centres, which differ
//! between the two sides. Both can only agree if both are straight. Where light bends along the
//! seam, e.g. at a crossing shadow edge, forced agreement smears the shadow over several texels and
//! moves lumels away from their true values. The error of linear interpolation, an eighth of the
//! second difference, measures this.

use glam::Vec2;

use crate::page::Page;
use crate::seams::pairs::Sample;
use crate::seams::rows::{EMPTY, Texels, light_at, lookup};

/// Misfit, relative to the light, at which agreement has a quarter of its weight; a step of all the
/// light has 0.125. With a third of this value, the shadows of a demo level leave 1 % of its seams
/// 12 % apart. Without a limit, lookups on a sphere are a sixth farther from the truth.
const BENT: f32 = 0.12;

/// Lower bound of the weight: a step that is reduced everywhere is less visible than one that
/// remains.
const MIN_WEIGHT: f32 = 0.1;

/// Weight of agreement at this misfit, relative to the light: 1 down to [`MIN_WEIGHT`].
pub(super) fn faith(misfit: f32) -> f32 {
    (1.0 + (misfit / BENT).powi(4)).powi(-2).max(MIN_WEIGHT)
}

/// An eighth of the largest second difference along the seam, over five texels of either side.
pub(super) fn misfit(s: &Sample, pages: &[Page], texels: &Texels) -> f32 {
    let mut most = 0f32;
    for k in 0..2 {
        let (p, at) = s.sides[k];
        let page = &pages[p as usize];
        let charts = &texels.chart[p as usize];
        let own = lookup(page.size(), at)
            .into_iter()
            .fold(
                (0.0, EMPTY),
                |best, (t, w)| {
                    if w > best.0 { (w, charts[t]) } else { best }
                },
            )
            .1;
        let light = [-2.0, -1.0, 0.0, 1.0, 2.0f32]
            .map(|x| light_in(page, charts, own, at + s.along[k] * x));
        for l in light.windows(3) {
            if let [Some(a), Some(b), Some(c)] = l {
                most = most.max((a - 2.0 * b + c).abs() / 8.0);
            }
        }
    }
    most
}

/// Light of a lookup, if it only reads this chart.
fn light_in(page: &Page, charts: &[u32], chart: u32, at: Vec2) -> Option<f32> {
    let mut sum = 0.0;
    for (t, w) in lookup(page.size(), at) {
        if w > 1e-3 && charts[t] != chart {
            return None;
        }
        sum += w * light_at(page, t);
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A page whose columns have these values, all in one chart.
    fn columns(values: &[f32]) -> (Vec<Page>, Texels) {
        let (width, height) = (values.len() as u32, 4);
        let n = values.len() * 4;
        let page = Page {
            width,
            height,
            value: (0..n).map(|i| [values[i % values.len()]; 3]).collect(),
            coverage: vec![1.0; n],
            layers: Vec::new(),
        };
        let texels = Texels {
            chart: vec![vec![0; n]],
            hidden: vec![vec![false; n]],
            kept: Vec::new(),
        };
        (vec![page], texels)
    }

    fn sample(x: f32) -> Sample {
        Sample {
            sides: [(0, Vec2::new(x, 1.0)), (0, Vec2::new(x, 3.0))],
            along: [Vec2::X; 2],
            texels: 1.0,
            metres: 1.0,
        }
    }

    #[test]
    fn a_slope_is_no_misfit_and_a_step_is_an_eighth_of_itself() {
        let (pages, texels) = columns(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
        // The tolerance is the rounding of the luminance weights.
        assert!(misfit(&sample(4.2), &pages, &texels) < 1e-6);
        let (pages, texels) = columns(&[1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        let found = misfit(&sample(4.5), &pages, &texels);
        assert!((found - 0.125).abs() < 1e-6, "{found}");
    }

    #[test]
    fn what_other_charts_hold_does_not_count() {
        let (pages, mut texels) = columns(&[1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        for (i, chart) in texels.chart[0].iter_mut().enumerate() {
            *chart = u32::from(i % 8 >= 4);
        }
        assert!(misfit(&sample(3.5), &pages, &texels) < 1e-6);
    }

    #[test]
    fn agreement_counts_less_across_a_step_but_not_nothing() {
        assert_eq!(faith(0.0), 1.0);
        // A step of all the light, and one of an eighth of it.
        assert!(faith(0.125) < 0.25);
        assert!(faith(0.016) > 0.99);
        assert_eq!(faith(10.0), MIN_WEIGHT);
    }
}
