//! Light that the texel grids of the two sides cannot both represent.
//!
//! Along a seam, bilinear lookups are piecewise linear with knots at texel centres, which differ
//! between the two sides. Both can only agree if both are straight. Where light bends along the
//! seam, e.g. at a crossing shadow edge or where something stands on the floor, forced agreement
//! straightens it over several texels, which shows as a streak along the seam. The error of linear
//! interpolation, an eighth of the second difference, measures this.

use glam::Vec2;

use crate::page::Page;
use crate::seams::pairs::Sample;
use crate::seams::rows::{EMPTY, Texels, light_at, lookup};

/// Weight of agreement, against unchanged texels, where light is even. At 1e5, the seams of kits
/// agree better than needed, and lookups on spheres are a fifth further from the truth.
const AGREE: f32 = 2e4;

/// Misfit, relative to the light, at which a difference of all the light counts no more than a lumel
/// that changes by all of its light; a step has up to 0.125, where agreement has 1/300 of its weight.
/// With 1/100 of it, streaks show. At 0.25, or by squares, a coarse kit's stay over 1 % apart.
const BENT: f32 = 0.35;

/// Weight of agreement at this misfit, relative to the light; 0 if it is infinite.
pub(super) fn weight(misfit: f32) -> f32 {
    (AGREE.recip() + (misfit / BENT).powi(4)).recip()
}

/// An eighth of the largest second difference along the seam, over five texels of either side. Other
/// charts do not count, nor do lumels inside something, which have no light of their own.
pub(super) fn misfit(s: &Sample, pages: &[Page], texels: &Texels) -> f32 {
    let mut most = 0f32;
    for k in 0..2 {
        let (p, at) = s.sides[k];
        let page = &pages[p as usize];
        let charts = &texels.chart[p as usize];
        let hidden = &texels.hidden[p as usize];
        let own = lookup(page.size(), at)
            .into_iter()
            .fold(
                (0.0, EMPTY),
                |best, (t, w)| {
                    if w > best.0 { (w, charts[t]) } else { best }
                },
            )
            .1;
        let light = [-2.0, -1.0, 0.0, 1.0, 2.0f32].map(|x| {
            light_if(page, at + s.along[k] * x, |t| {
                charts[t] == own && !hidden[t]
            })
        });
        for l in light.windows(3) {
            if let [Some(a), Some(b), Some(c)] = l {
                most = most.max((a - 2.0 * b + c).abs() / 8.0);
            }
        }
    }
    most
}

/// Light of a lookup, if it only reads texels that count.
fn light_if(page: &Page, at: Vec2, counts: impl Fn(usize) -> bool) -> Option<f32> {
    let mut sum = 0.0;
    for (t, w) in lookup(page.size(), at) {
        if w > 1e-3 && !counts(t) {
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
    fn agreement_counts_less_where_light_bends() {
        assert_eq!(weight(0.0), AGREE);
        // At a step of all the light, agreement counts as much as a few lumels, not as a thousand;
        // on the slope of a coarse lumel it keeps its weight.
        let step = weight(0.125);
        assert!((10.0..100.0).contains(&step), "{step}");
        assert!(weight(0.02) > 0.7 * AGREE);
        assert_eq!(weight(f32::INFINITY), 0.0);
    }
}
