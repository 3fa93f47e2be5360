//! Least squares: texels change as little as possible while lookups on both sides of seams agree.
//!
//! Let d be the change of the texels, and a and b the bilinear lookups of sample s on its two
//! sides. We minimise
//!
//! Σ_s W ℓ_s ((a_s − b_s) / σ_s)² + Σ_i c_i (d_i / σ_i)² + Σ_(i,j) G ((d_i − d_j) / σ_ij)²
//!
//! W decreases where light bends along the seam ([`contrast`](super::contrast)), ℓ is the
//! seam's length in texels, and c the texel's coverage. σ is the local light relative to the mean,
//! plus 1 %, because visible errors are relative to it. The third sum, over neighbours in a chart,
//! makes changes fade out over a few texels instead of forming a step next to the seam.

use glam::Vec4;

use crate::page::Page;
use crate::seams::bounds::bounds;
use crate::seams::contrast::{misfit, weight};
use crate::seams::least::least;
use crate::seams::matrix::Matrix;
use crate::seams::measure::{SeamError, SeamReport, quantiles};
use crate::seams::pairs::Sample;
use crate::seams::rows::{
    EMPTY, Row, TexelList, Texels, beside, light_at, lookup, mean_light, narrow,
};

/// W in narrow charts, which have no light of their own to preserve. At 2e4, Sponza's seams stay
/// 1.4 % apart.
const AGREE_NARROW: f32 = 2e5;

/// Light is continuous across a seam if one side has at most this many times the light of the
/// other. Beyond it, one side is under or behind something, or light falls off within a lumel.
/// Agreement would then darken the bright side, which holds less fast than the dark one: at 6, walls
/// were dark a lumel or two above a sofa a hand's width before them. 1.5 changes nothing more that
/// is seen.
const CONTINUOUS: f32 = 2.0;

/// G: weight of smooth changes against small ones. Changes fade out over √G texels. At 2, lumels
/// away from the seam change six times as much as at ½; at 0.2, single texels take up all of the
/// change.
const EVEN: f32 = 0.5;

/// c of texels that are only visible through lookups across the border: dilated ones, and lumels
/// inside something.
const FREE: f32 = 0.02;

/// Texels up to this many steps from those that seams read may change; at that distance a hundredth
/// of the change is left.
const REACH: u8 = 3;

/// The equations of a layout's seams, for any channel of its pages.
pub(crate) struct Stitcher {
    rows: Vec<Row>,
    /// Page and index of each participating texel.
    places: Vec<(u32, u32)>,
    /// c / σ².
    hold: Vec<f32>,
    /// Pairs of neighbours, and G / σ².
    even: Vec<(u32, u32, f32)>,
    /// Whether a texel must not change.
    still: Vec<bool>,
    /// Steps from a seam.
    steps: Vec<u8>,
    /// Coverage, or 0 for lumels inside something, which are not visible themselves.
    seen: Vec<f32>,
    /// Whether nearly all lumels of the chart take part in seams.
    narrow: Vec<bool>,
    /// Light plus 1 % of the mean, to which changes are relative.
    light: Vec<f32>,
    /// Mean light over the surface.
    mean: f32,
    report: SeamReport,
}

/// Values of one channel on all pages.
pub(crate) struct Channel<'a> {
    /// Value of a texel: page, index.
    pub value: Box<dyn Fn(usize, usize) -> f32 + Sync + 'a>,
    /// Whether values may be negative.
    pub signed: bool,
}

impl Stitcher {
    /// Sets up the equations. `pages` hold the light itself, dilated.
    pub(crate) fn new(samples: &[Sample], pages: &[Page], texels: &Texels) -> Self {
        let mean = mean_light(pages);
        let mut list = TexelList::new(pages);
        let light = |(p, at): (u32, u32)| light_at(&pages[p as usize], at as usize);
        let mut report = SeamReport::default();
        let mut rows = Vec::with_capacity(samples.len());
        for s in samples {
            let sides = s
                .sides
                .map(|(page, at)| lookup(pages[page as usize].size(), at));
            // Whether the lumel with the largest weight on this side is inside something.
            let at_hidden = |k: usize| {
                let page = s.sides[k].0 as usize;
                let mut most = (0.0, false);
                for &(at, w) in &sides[k] {
                    if pages[page].coverage[at] > 0.0 && w > most.0 {
                        most = (w, texels.hidden[page][at]);
                    }
                }
                most.1
            };
            let hidden = [at_hidden(0), at_hidden(1)];
            // Nobody sees such a place. Inside of a solid, one side may be dark and the other have
            // its visible neighbours' light, and agreement would pull those into the dark.
            if hidden == [true; 2] {
                continue;
            }
            let lookups = [0, 1].map(|k| {
                let page = s.sides[k].0;
                let terms = sides[k].iter().map(|&(at, w)| w * light((page, at as u32)));
                terms.sum::<f32>() + 0.01 * mean
            });
            let [dark, bright] = [f32::min, f32::max].map(|f| f(lookups[0], lookups[1]));
            let counts = hidden == [false; 2];
            let metres = f64::from(s.metres) * f64::from(u8::from(counts));
            if bright > CONTINUOUS * dark {
                report.jumps += metres;
                continue;
            }
            let mut row = Row {
                texels: [0; 8],
                weights: [0.0; 8],
                agree: 0.0,
                misfit: f32::INFINITY,
                scale: 0.5 * (lookups[0] + lookups[1]),
                texels_long: s.texels,
                counts,
            };
            for k in 0..2 {
                let sign = [1.0, -1.0][k];
                for (i, &(at, w)) in sides[k].iter().enumerate() {
                    let place = (s.sides[k].0, at as u32);
                    row.texels[4 * k + i] = list.number(place);
                    row.weights[4 * k + i] = sign * w;
                }
            }
            if !row.shares_texels() {
                row.misfit = misfit(s, pages, texels) / row.scale;
            }
            report.samples += u64::from(counts);
            report.metres += metres;
            rows.push(row);
        }
        let mut stitcher = Stitcher {
            rows,
            places: Vec::new(),
            hold: Vec::new(),
            even: Vec::new(),
            still: Vec::new(),
            steps: Vec::new(),
            seen: Vec::new(),
            narrow: Vec::new(),
            light: Vec::new(),
            mean,
            report,
        };
        if mean > 0.0 {
            stitcher.surround(list, pages, texels, mean);
        } else {
            stitcher.rows.clear();
        }
        let before = stitcher.error(pages);
        (stitcher.report.before, stitcher.report.after) = (before, before);
        stitcher
    }

    /// Adds the texels around those that seams read, and all equations except the seams'.
    fn surround(&mut self, mut list: TexelList, pages: &[Page], texels: &Texels, mean: f32) {
        let chart = |(p, at): (u32, u32)| texels.chart[p as usize][at as usize];
        self.steps = vec![0; list.places.len()];
        let mut from = 0;
        for step in 1..=REACH {
            let to = list.places.len();
            for i in from..to {
                let place = list.places[i];
                for next in beside(pages, place).into_iter().flatten() {
                    if chart(place) != EMPTY && chart(next) == chart(place) {
                        list.number(next);
                    }
                }
            }
            self.steps.resize(list.places.len(), step);
            from = to;
        }
        self.narrow = narrow(&list, &self.steps, pages, texels);
        let light = |(p, at): (u32, u32)| light_at(&pages[p as usize], at as usize);
        self.seen = (list.places.iter())
            .map(|&(p, at)| (p as usize, at as usize))
            .map(|(p, at)| match texels.hidden[p][at] {
                true => 0.0,
                false => pages[p].coverage[at],
            })
            .collect();
        self.light = (list.places.iter())
            .map(|&place| light(place) + 0.01 * mean)
            .collect();
        // Texels that are not visible themselves are relative to the light of the lookups that read
        // them, so that a dilated texel of the dark side does not hold the lit side down. Hidden
        // texels are relative to the sum of both sides. Relative to its own light, the dark side
        // would win, and the rim of a lamp in the sun would turn black.
        let mut scales = self.light.clone();
        for row in &self.rows {
            for t in row.texels.map(|t| t as usize) {
                if self.narrow[t] {
                    scales[t] = scales[t].max(2.0 * row.scale);
                } else if self.seen[t] == 0.0 {
                    scales[t] = scales[t].max(row.scale);
                }
            }
        }
        self.hold = (list.places.iter().zip(&self.seen).zip(&scales))
            .map(|((&place, &seen), scale)| {
                let (p, at) = (place.0 as usize, place.1 as usize);
                // Texels without any light stay black.
                let kept = texels.kept.get(p).is_some_and(|kept| kept[at]);
                self.still
                    .push(kept || light(place) <= 0.0 && !texels.hidden[p][at]);
                seen.max(FREE) / (scale / mean).powi(2)
            })
            .collect();
        for (i, &place) in list.places.iter().enumerate() {
            for next in beside(pages, place).into_iter().flatten() {
                if chart(next) != chart(place) || chart(place) == EMPTY {
                    continue;
                }
                let known = list.known(next);
                let beyond = light(next) + 0.01 * mean;
                let scale = 0.5 * (scales[i] + known.map_or(beyond, |j| scales[j as usize]));
                let cover = |(p, at): (u32, u32)| pages[p as usize].coverage[at as usize].max(FREE);
                let weight = EVEN * cover(place).min(cover(next)) / (scale / mean).powi(2);
                match known {
                    Some(j) if (j as usize) > i => {
                        self.even.push((i as u32, j, weight));
                    }
                    Some(_) => {}
                    // Nothing changes beyond the reach.
                    None => {
                        self.hold[i] += weight;
                    }
                }
            }
        }
        for row in &mut self.rows {
            let agree = match row.in_narrow(&self.narrow) {
                true => AGREE_NARROW,
                false => weight(row.misfit),
            };
            row.agree = agree * row.texels_long / (row.scale / mean).powi(2);
        }
        self.places = list.places;
    }

    /// Differences of lookups of these pages' light.
    fn error(&self, pages: &[Page]) -> SeamError {
        let light: Vec<f32> = (self.places.iter())
            .map(|&(p, at)| light_at(&pages[p as usize], at as usize))
            .collect();
        let differences = (self.rows.iter().filter(|row| row.counts))
            .map(|row| {
                let terms = row.texels.iter().zip(&row.weights);
                let d: f64 = terms
                    .map(|(&t, &w)| f64::from(w) * f64::from(light[t as usize]))
                    .sum();
                let sum: f64 = (row.texels.iter().zip(&row.weights))
                    .map(|(&t, &w)| f64::from(w.abs()) * f64::from(light[t as usize]))
                    .sum();
                let scale = 0.5 * sum + 0.01 * f64::from(self.mean);
                (
                    d.abs() / scale.max(f64::MIN_POSITIVE),
                    f64::from(row.texels_long),
                )
            })
            .collect();
        quantiles(differences)
    }

    /// Page and index of the texels that change.
    pub(crate) fn places(&self) -> &[(u32, u32)] {
        &self.places
    }

    /// Changes that make each channel's lookups agree, in the order of [`places`](Self::places).
    /// Channels are independent and solved four at a time.
    pub(crate) fn solve(&self, channels: &[Channel<'_>]) -> Vec<Vec<f32>> {
        let matrix = Matrix::new(&self.rows, &self.hold, &self.even);
        let mut changes = Vec::new();
        for channels in channels.chunks(4) {
            let solved = self.solve_four(&matrix, channels);
            for c in 0..channels.len() {
                changes.push(solved.iter().map(|v| v[c]).collect());
            }
        }
        changes
    }

    fn solve_four(&self, matrix: &Matrix, channels: &[Channel<'_>]) -> Vec<Vec4> {
        let (values, bounds) = self.values_and_bounds(channels);
        let mut right = vec![Vec4::ZERO; values.len()];
        for row in &self.rows {
            let pull = row.difference(&values) * row.agree;
            for (t, w) in row.terms() {
                right[t] -= pull * w;
            }
        }
        least(matrix, &right, &bounds)
    }

    /// Values of the texels in up to four channels, and the bounds of their changes.
    fn values_and_bounds(&self, channels: &[Channel<'_>]) -> (Vec<Vec4>, [Vec<Vec4>; 2]) {
        let values: Vec<Vec4> = (self.places.iter())
            .map(|&(p, at)| {
                let mut value = Vec4::ZERO;
                for (c, channel) in channels.iter().enumerate() {
                    value[c] = (channel.value)(p as usize, at as usize);
                }
                value
            })
            .collect();
        let mut floor = Vec4::ZERO;
        for (c, _) in channels.iter().enumerate().filter(|(_, c)| c.signed) {
            floor[c] = f32::NEG_INFINITY;
        }
        let mut bounds = bounds(
            &self.rows,
            &self.even,
            &self.steps,
            &self.seen,
            &self.narrow,
            &values,
            floor,
        );
        for (i, _) in self.still.iter().enumerate().filter(|(_, still)| **still) {
            (bounds[0][i], bounds[1][i]) = (Vec4::ZERO, Vec4::ZERO);
        }
        (values, bounds)
    }

    /// Records the change of the light, from `was` at [`places`](Self::places) to the final pages.
    pub(crate) fn finish(&mut self, was: &[f32], pages: &[Page], clamped: u64) {
        self.report.after = self.error(pages);
        self.report.clamped = clamped;
        let (mut near, mut far) = (0f64, 0f64);
        let (mut near_area, mut all_area) = (0f64, 0f64);
        for (i, &(p, at)) in self.places.iter().enumerate() {
            let page = &pages[p as usize];
            // Hidden lumels are not visible themselves.
            let coverage = f64::from(self.seen[i]);
            let moved = (light_at(page, at as usize) - was[i]) / self.light[i];
            let square = coverage * f64::from(moved).powi(2);
            if self.steps[i] <= 1 {
                near += square;
                near_area += coverage;
            } else {
                far += square;
            }
        }
        for page in pages {
            all_area += page.coverage.iter().map(|&c| f64::from(c)).sum::<f64>();
        }
        let root = |sum: f64, area: f64| if area > 0.0 { (sum / area).sqrt() } else { 0.0 };
        self.report.moved_near = root(near, near_area);
        self.report.moved_elsewhere = root(far, all_area - near_area);
    }

    /// The report on seams.
    pub(crate) fn report(&self) -> SeamReport {
        self.report
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    /// A sample whose second side is `apart` texels to the right of the first, on a page with one
    /// chart.
    fn agreement(apart: f32) -> f32 {
        let page = Page {
            width: 8,
            height: 4,
            value: vec![[1.0; 3]; 32],
            coverage: vec![1.0; 32],
            layers: Vec::new(),
        };
        let texels = Texels {
            chart: vec![vec![0; 32]],
            hidden: vec![vec![false; 32]],
            kept: Vec::new(),
        };
        let at = Vec2::new(2.3, 1.8);
        let sample = Sample {
            sides: [(0, at), (0, at + Vec2::X * apart)],
            along: [Vec2::Y; 2],
            texels: 0.25,
            metres: 0.25,
        };
        Stitcher::new(&[sample], &[page], &texels).rows[0].agree
    }

    /// Two strips, one lumel high, whose long borders meet on both sides like those of a ledge;
    /// their light is 1 and 0.55.
    fn strips() -> (Vec<Sample>, Vec<Page>, Texels) {
        let (width, height) = (24u32, 16u32);
        let n = (width * height) as usize;
        let row = |i: usize| i / width as usize;
        let column = |i: usize| i % width as usize;
        let is_lumel = |i: usize| [4, 9].contains(&row(i)) && (3..=18).contains(&column(i));
        let page = Page {
            width,
            height,
            value: (0..n)
                .map(|i| [if row(i) < 7 { 1.0 } else { 0.55 }; 3])
                .collect(),
            coverage: (0..n)
                .map(|i| if is_lumel(i) { 0.5 } else { 0.0 })
                .collect(),
            layers: Vec::new(),
        };
        let texels = Texels {
            chart: vec![(0..n).map(|i| u32::from(row(i) >= 7)).collect()],
            hidden: vec![vec![false; n]],
            kept: Vec::new(),
        };
        let samples = (0..128)
            .flat_map(|i| {
                let x = 3.0 + 0.125 * i as f32;
                [[4.33, 9.0], [4.0, 9.5]].map(|y| Sample {
                    sides: y.map(|y| (0, Vec2::new(x, y))),
                    along: [Vec2::X; 2],
                    texels: 0.125,
                    metres: 0.125,
                })
            })
            .collect();
        (samples, vec![page], texels)
    }

    fn stitched(samples: &[Sample], pages: &[Page], texels: &Texels) -> (Stitcher, Vec<Page>) {
        let stitcher = Stitcher::new(samples, pages, texels);
        let channel = Channel {
            value: Box::new(|page, at| pages[page].value[at][0]),
            signed: false,
        };
        let change = stitcher.solve(&[channel]);
        let mut after = pages.to_vec();
        for (&(p, at), change) in stitcher.places.iter().zip(&change[0]) {
            for v in &mut after[p as usize].value[at as usize] {
                *v += change;
                assert!(*v > -1e-6, "{v} but for rounding");
            }
        }
        (stitcher, after)
    }

    #[test]
    fn lookups_of_narrow_strips_agree_and_none_is_below_zero() {
        let (samples, pages, texels) = strips();
        let (stitcher, after) = stitched(&samples, &pages, &texels);
        assert!(stitcher.report.before.p99 > 0.5, "{:?}", stitcher.report);
        assert!(stitcher.narrow.iter().all(|&narrow| narrow));
        // The promised agreement; with the bounds of charts that are not narrow it would be 0.13.
        let found = stitcher.error(&after);
        assert!(found.p99 < 0.01, "{found:?}");
    }

    #[test]
    fn strips_in_and_out_of_a_sun_agree() {
        // Patches of sun, three lumels long and nearly twice as bright as their shade, offset
        // between the sides, so that bounds are active everywhere.
        let (samples, mut pages, texels) = strips();
        for (i, v) in pages[0].value.iter_mut().enumerate() {
            let (x, y) = (i % 24, i / 24);
            let lit = (x + if y < 7 { 0 } else { 2 }) % 6 < 3;
            *v = [if lit { 1.0 } else { 0.55 }; 3];
        }
        let (stitcher, after) = stitched(&samples, &pages, &texels);
        assert!(stitcher.report.before.p99 > 0.5, "{:?}", stitcher.report);
        let found = stitcher.error(&after);
        assert!(found.p99 < 0.01, "{found:?}");
    }

    #[test]
    fn places_that_nobody_sees_pull_nothing_that_is_seen() {
        // Two charts with an inside. From column 11 on they are inside something: one has the light
        // of what is visible beside it, the other none.
        let (samples, mut pages, mut texels) = strips();
        let page = &mut pages[0];
        for i in 0..page.value.len() {
            let (x, y) = (i % 24, i / 24);
            texels.hidden[0][i] = x >= 11;
            page.value[i] = [if x >= 11 && y >= 7 { 0.0 } else { 1.0 }; 3];
            if !(4..=9).contains(&y) {
                page.coverage[i] = 1.0;
            }
        }
        let (_, after) = stitched(&samples, &pages, &texels);
        for (i, v) in after[0].value.iter().enumerate() {
            // A thousandth for rounding; they would lose 6 %.
            assert!(i % 24 >= 11 || (v[0] - 1.0).abs() < 1e-3, "{i}: {v:?}");
        }
    }

    #[test]
    fn a_place_in_the_dark_does_not_blacken_what_continues_it() {
        let after = |dark: f32| {
            let (samples, mut pages, texels) = strips();
            for i in 0..pages[0].value.len() {
                let y = i / 24;
                pages[0].value[i] = [if y < 7 { 1.0 } else { dark }; 3];
                // Not narrow.
                if !(4..=9).contains(&y) {
                    pages[0].coverage[i] = 1.0;
                }
            }
            let (stitcher, after) = stitched(&samples, &pages, &texels);
            let bright = (after[0].value.iter().enumerate()).filter(|(i, _)| i / 24 < 7);
            let least = bright.map(|(_, v)| v[0]).fold(f32::INFINITY, f32::min);
            (least, stitcher.error(&after).p99)
        };
        // A difference that the grids may have made is taken out.
        let (least, apart) = after(0.6);
        assert!(least < 0.95 && apart < 0.05, "{least} {apart}");
        // A thousandth for rounding; they would be 0.7 and 0.003.
        for dark in [0.4, 0.01] {
            let (least, _) = after(dark);
            assert!(least > 0.999, "{least}");
        }
    }

    #[test]
    fn a_step_along_a_seam_stays_a_step() {
        // Something stands on a floor of two charts, whose grids are half a lumel apart: from 11 on,
        // the floor is nearly dark.
        let (mut samples, mut pages, texels) = strips();
        for s in &mut samples {
            s.sides[1].1.x += 0.5;
        }
        for i in 0..pages[0].value.len() {
            let (x, y) = (i % 24, i / 24);
            let lit = (11.0 + if y < 7 { 0.0 } else { 0.5 } - x as f32).clamp(0.0, 1.0);
            pages[0].value[i] = [0.1 + 0.9 * lit; 3];
            // Not narrow.
            if !(4..=9).contains(&y) {
                pages[0].coverage[i] = 1.0;
            }
        }
        let (_, after) = stitched(&samples, &pages, &texels);
        // With agreement as where light is even, 0.18 would be lost at these two lumels.
        for (y, x) in [4, 9].into_iter().flat_map(|y| [8, 9].map(|x| (y, x))) {
            let light = after[0].value[y * 24 + x][0];
            assert!((light - 1.0).abs() < 0.05, "{x}, {y}: {light}");
        }
    }

    #[test]
    fn a_chart_with_an_inside_is_not_narrow() {
        let (samples, mut pages, texels) = strips();
        // Lumels up to the page's border, which no seam reads.
        for (i, coverage) in pages[0].coverage.iter_mut().enumerate() {
            *coverage = f32::from(u8::from(i / 24 < 5)).max(*coverage);
        }
        let stitcher = Stitcher::new(&samples, &pages, &texels);
        for (&(p, at), &narrow) in stitcher.places.iter().zip(&stitcher.narrow) {
            assert_eq!(narrow, texels.chart[p as usize][at as usize] == 1);
        }
    }

    #[test]
    fn lips_of_a_slit_that_read_the_same_texels_are_not_stitched() {
        for apart in [0.1, 0.5, 1.0] {
            assert_eq!(agreement(apart), 0.0, "{apart}");
        }
        for apart in [2.0, 3.1] {
            assert!(agreement(apart) > 0.0, "{apart}");
        }
    }
}
