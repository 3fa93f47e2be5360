//! Least squares: texels change as little as they can until lookups on both sides of seams agree.
//!
//! With d the change of texels and a(·), b(·) the bilinear lookups of sample s on its two sides, least is
//!
//! Σ_s W ℓ_s ((a_s − b_s) / σ_s)² + Σ_i c_i (d_i / σ_i)² + Σ_(i,j) G ((d_i − d_j) / σ_ij)²
//!
//! where W falls a little with the light's contrast along the seam ([`contrast`](super::contrast)), ℓ is the seam's length in texels, c the texel's coverage and σ the light there over the mean, plus 1 %: errors are seen relative to it. The third sum, over
//! neighbours in a chart, lets changes die out over a few texels instead of making a step beside the seam.

use glam::{DVec4, Vec2, Vec4};
use radiosity::luminance;
use rayon::prelude::*;

use crate::atlas::Page;
use crate::seams::Sample;
use crate::seams::bounds::bounds;
use crate::seams::contrast::{faith, misfit};
use crate::seams::measure::{SeamError, SeamReport, quantiles};

/// W: what agreement counts against leaving texels as they are, where light is even. At 1e3 shadows that cross seams leave 99 % of them within 2 to 6 %; 3e4 gains nothing, and
/// moves lumels on (docs/seams.md).
const AGREE: f32 = 1e4;

/// G: what an even change counts against a small one. Changes die out over √G texels: at 2 lumels off the seam move six times as far as at ½,
/// and at 0.2 single texels take what seams need.
const EVEN: f32 = 0.5;

/// c of texels of which nothing is seen but by lookups across the border: dilated ones, and lumels inside of something.
const FREE: f32 = 0.02;

/// Texels next to those that seams read may change up to this many steps away.
const REACH: u8 = 5;

/// Residual against the right-hand side's at which the solver stops, in the preconditioner's norm. Half floats round by 5e-4 of the light, and
/// what the solver removes is at most that large.
const TOLERANCE: f64 = 1e-4;

/// It stops here in any case. The largest scenes measured took 260.
const MOST_ITERATIONS: u64 = 1000;

/// Weight in a lookup that is as good as none.
const LITTLE: f32 = 1e-3;

/// Times that the solver goes on after texels met their bounds, and the first. Scenes measured took six.
const ROUNDS: usize = 8;

/// A chart is narrow if at most this share of its lumels is left alone by seams.
const NARROW: f32 = 0.1;

/// What is known of texels beside their light, by page.
pub(crate) struct Texels {
    /// Piece of surface that a texel belongs to, [`EMPTY`] where it has no value.
    pub chart: Vec<Vec<u32>>,
    /// Lumels of which nothing lies in the open.
    pub hidden: Vec<Vec<bool>>,
}

/// No piece of surface.
pub(crate) const EMPTY: u32 = u32::MAX;

/// One sample's two lookups: Σ weights × texels is a − b.
pub(super) struct Row {
    pub texels: [u32; 8],
    pub weights: [f32; 8],
    /// W ℓ / σ², less where light bends.
    agree: f32,
    /// Misfit over σ, infinite for lips of a slit.
    misfit: f32,
    /// σ.
    scale: f32,
    /// ℓ.
    texels_long: f32,
    /// Whether both sides lie in the open, as far as their lumels say. What lies inside adapts to what does not, but is nothing to report.
    counts: bool,
}

/// The equations of a layout's seams, for any channel of its pages.
pub(crate) struct Stitcher {
    rows: Vec<Row>,
    /// Page and index of each texel that takes part.
    places: Vec<(u32, u32)>,
    /// c / σ², infinite for those that must not change.
    hold: Vec<f32>,
    /// Neighbours and G / σ².
    even: Vec<(u32, u32, f32)>,
    /// Of all equations, inverse; 0 for those that must not change.
    inverse_diagonal: Vec<f32>,
    /// Steps from a seam.
    steps: Vec<u8>,
    /// Coverage, 0 for lumels inside of something: nobody sees their own place.
    seen: Vec<f32>,
    /// Whether nearly all lumels of the chart take part in seams.
    narrow: Vec<bool>,
    /// Light plus 1 % of the mean, which changes are measured against.
    light: Vec<f32>,
    /// Mean light of the surface.
    mean: f32,
    report: SeamReport,
}

/// Values on all pages, of one channel.
pub(crate) struct Channel<'a> {
    /// Value of a texel: page, index.
    pub value: Box<dyn Fn(usize, usize) -> f32 + Sync + 'a>,
    /// Whether values may be negative.
    pub signed: bool,
}

impl Stitcher {
    /// Sets the equations up. `pages` hold the light itself, dilated.
    pub(crate) fn new(samples: &[Sample], pages: &[Page], texels: &Texels) -> Self {
        let mean = mean_light(pages);
        let mut list = TexelList::new(pages);
        let light = |(p, at): (u32, u32)| light_at(&pages[p as usize], at as usize);
        let mut report = SeamReport::default();
        let mut rows = Vec::with_capacity(samples.len());
        for s in samples {
            let sides = s.sides.map(|(page, at)| lookup(&pages[page as usize], at));
            // Whether the lumel that says most about this side lies inside of something.
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
            let mut row = Row {
                texels: [0; 8],
                weights: [0.0; 8],
                agree: 0.0,
                misfit: f32::INFINITY,
                scale: 0.0,
                texels_long: s.texels,
                counts: !(at_hidden(0) || at_hidden(1)),
            };
            for k in 0..2 {
                let sign = [1.0, -1.0][k];
                for (i, &(at, w)) in sides[k].iter().enumerate() {
                    let place = (s.sides[k].0, at as u32);
                    row.texels[4 * k + i] = list.number(place);
                    row.weights[4 * k + i] = sign * w;
                    row.scale += 0.5 * w * light(place);
                }
            }
            row.scale += 0.01 * mean;
            if !row.shares_texels() {
                row.misfit = misfit(s, pages, texels) / row.scale;
            }
            report.samples += u64::from(row.counts);
            report.metres += f64::from(s.metres) * f64::from(u8::from(row.counts));
            rows.push(row);
        }
        let mut stitcher = Stitcher {
            rows,
            places: Vec::new(),
            hold: Vec::new(),
            even: Vec::new(),
            inverse_diagonal: Vec::new(),
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

    /// Adds what lies around the texels that seams read, and all equations but the seams'.
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
        // What nobody sees in its own place is measured against the light of the lookups that read it: a dilated texel of the dark side must not hold the
        // lit one down. So is what has no inside: against its own light the dark side would win, and a lamp's rim in the sun turn black.
        let mut scales = self.light.clone();
        for row in &self.rows {
            for &t in &row.texels {
                if self.seen[t as usize] == 0.0 || self.narrow[t as usize] {
                    scales[t as usize] = scales[t as usize].max(row.scale);
                }
            }
        }
        self.hold = (list.places.iter().zip(&self.seen).zip(&scales))
            .map(|((&place, &seen), scale)| {
                let (p, at) = (place.0 as usize, place.1 as usize);
                // What got no light at all stays dark.
                if light(place) <= 0.0 && !texels.hidden[p][at] {
                    return f32::INFINITY;
                }
                seen.max(FREE) / (scale / mean).powi(2)
            })
            .collect();
        let mut diagonal: Vec<f64> = self.hold.iter().map(|&h| f64::from(h)).collect();
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
                        diagonal[i] += f64::from(weight);
                        diagonal[j as usize] += f64::from(weight);
                    }
                    Some(_) => {}
                    // Beyond reach nothing changes.
                    None => {
                        self.hold[i] += weight;
                        diagonal[i] += f64::from(weight);
                    }
                }
            }
        }
        for row in &mut self.rows {
            let narrow = row.in_narrow(&self.narrow);
            let faith = match (narrow, row.misfit.is_finite()) {
                (true, _) => 1.0,
                (false, true) => faith(row.misfit),
                (false, false) => 0.0,
            };
            row.agree = AGREE * faith * row.texels_long / (row.scale / mean).powi(2);
            for (&t, &w) in row.texels.iter().zip(&row.weights) {
                diagonal[t as usize] += f64::from(row.agree * w * w);
            }
        }
        self.inverse_diagonal = diagonal.iter().map(|d| (1.0 / d) as f32).collect();
        // Their inverse of 0 holds them.
        for hold in self.hold.iter_mut().filter(|h| h.is_infinite()) {
            *hold = 0.0;
        }
        self.places = list.places;
    }

    /// Differences of lookups in these pages' light.
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

    /// Changes that make each channel's lookups agree, in the order of [`places`](Self::places). Channels are solved four at a time, each by
    /// itself, and blocks of them in parallel.
    pub(crate) fn solve(&mut self, channels: &[Channel<'_>]) -> Vec<Vec<f32>> {
        let solved: Vec<(Vec<Vec4>, u64)> = (channels.par_chunks(4))
            .map(|channels| self.solve_channels(channels))
            .collect();
        let most = solved.iter().map(|s| s.1).max().unwrap_or(0);
        self.report.iterations = self.report.iterations.max(most);
        (0..channels.len())
            .map(|c| solved[c / 4].0.iter().map(|v| v[c % 4]).collect())
            .collect()
    }

    /// Conjugate gradients with the diagonal as preconditioner (Hestenes & Stiefel 1952), for up to four channels.
    fn solve_channels(&self, channels: &[Channel<'_>]) -> (Vec<Vec4>, u64) {
        let n = self.places.len();
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
        let [least, greatest] = bounds(
            &self.rows,
            &self.even,
            &self.steps,
            &self.seen,
            &self.narrow,
            &values,
            floor,
        );
        let mut change = vec![Vec4::ZERO; n];
        let mut free = vec![Vec4::ONE; n];
        let mut iterations = 0;
        let mut enough = None;
        // What met its bounds stays there while the rest makes up for it.
        for _ in 0..ROUNDS {
            let more = self.descend(&values, &free, &mut change, &mut enough);
            if more == 0 {
                break;
            }
            iterations += more;
            for i in 0..n {
                let c = if change[i].is_finite() {
                    change[i]
                } else {
                    Vec4::ZERO
                };
                change[i] = c.max(least[i]).min(greatest[i]);
                free[i] *= Vec4::select(c.cmpeq(change[i]), Vec4::ONE, Vec4::ZERO);
            }
        }
        (change, iterations)
    }

    /// Changes what is free (1, else 0) so that the sum becomes least; returns the number of iterations. The first call sets what residual is
    /// small `enough`.
    fn descend(
        &self,
        values: &[Vec4],
        free: &[Vec4],
        change: &mut [Vec4],
        enough: &mut Option<DVec4>,
    ) -> u64 {
        let n = values.len();
        let mut product = vec![Vec4::ZERO; n];
        self.multiply(change, &mut product);
        let mut residual: Vec<Vec4> = product.iter().map(|p| -p).collect();
        for row in &self.rows {
            row.spread(-row.difference(values) * row.agree, &mut residual);
        }
        let inverse: Vec<Vec4> = (free.iter().zip(&self.inverse_diagonal))
            .map(|(free, d)| free * *d)
            .collect();
        // Sums of single products, in double precision over hundreds of thousands of texels.
        let dot = |x: &[Vec4], y: &[Vec4]| -> DVec4 {
            x.iter().zip(y).map(|(x, y)| (x * y).as_dvec4()).sum()
        };
        let weighted = |r: &[Vec4]| -> DVec4 {
            (r.iter().zip(&inverse))
                .map(|(r, d)| (r * r * d).as_dvec4())
                .sum()
        };
        let mut direction: Vec<Vec4> = residual.iter().zip(&inverse).map(|(r, d)| r * d).collect();
        let mut size = weighted(&residual);
        let enough = *enough.get_or_insert(size * (TOLERANCE * TOLERANCE));
        let mut iterations = 0;
        // A channel that is done stands still: what it becomes does not hang on its neighbours.
        while size.cmpgt(enough).any() && iterations < MOST_ITERATIONS {
            self.multiply(&direction, &mut product);
            let curvature = dot(&direction, &product);
            let going = size.cmpgt(enough) & curvature.cmpgt(DVec4::ZERO);
            if !going.any() {
                break;
            }
            let step = DVec4::select(going, size / curvature, DVec4::ZERO).as_vec4();
            for i in 0..n {
                change[i] += step * direction[i];
                residual[i] -= step * product[i];
            }
            let next = weighted(&residual);
            let keep = DVec4::select(going, next / size, DVec4::ZERO).as_vec4();
            size = DVec4::select(going, next, size);
            for (d, (r, inverse)) in direction.iter_mut().zip(residual.iter().zip(&inverse)) {
                *d = r * inverse + keep * *d;
            }
            iterations += 1;
        }
        iterations
    }

    fn multiply(&self, x: &[Vec4], out: &mut [Vec4]) {
        for ((out, x), hold) in out.iter_mut().zip(x).zip(&self.hold) {
            *out = x * *hold;
        }
        for &(i, j, weight) in &self.even {
            let d = (x[i as usize] - x[j as usize]) * weight;
            out[i as usize] += d;
            out[j as usize] -= d;
        }
        for row in &self.rows {
            row.spread(row.difference(x) * row.agree, out);
        }
    }

    /// Takes notes of what became of the light: `was` at [`places`](Self::places), and the pages as they are.
    pub(crate) fn finish(&mut self, was: &[f32], pages: &[Page], clamped: u64) {
        self.report.after = self.error(pages);
        self.report.clamped = clamped;
        let (mut near, mut far) = (0f64, 0f64);
        let (mut near_area, mut all_area) = (0f64, 0f64);
        for (i, &(p, at)) in self.places.iter().enumerate() {
            let page = &pages[p as usize];
            // Nobody sees what lies inside of something.
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

    /// What was found and done.
    pub(crate) fn report(&self) -> SeamReport {
        self.report
    }
}

impl Row {
    /// Whether its two lookups read a texel in common. A chart that is slit open by less than a lookup's reach is such a place: its lips differ by
    /// the slope times their distance, and could agree only if the slope went.
    fn shares_texels(&self) -> bool {
        let (a, b) = self.texels.split_at(4);
        let (of_a, of_b) = self.weights.split_at(4);
        (a.iter().zip(of_a)).any(|(t, w)| {
            let same = b.iter().zip(of_b).filter(|x| x.0 == t);
            w.min(same.map(|x| -x.1).sum()) > LITTLE
        })
    }

    /// Whether one of its lookups reads nothing but narrow pieces.
    fn in_narrow(&self, narrow: &[bool]) -> bool {
        [0, 4].into_iter().any(|side| {
            (side..side + 4)
                .all(|k| self.weights[k].abs() <= LITTLE || narrow[self.texels[k] as usize])
        })
    }

    /// a − b.
    pub(super) fn difference(&self, values: &[Vec4]) -> Vec4 {
        let terms = self.texels.iter().zip(&self.weights);
        terms.map(|(&t, &w)| values[t as usize] * w).sum()
    }

    fn spread(&self, x: Vec4, out: &mut [Vec4]) {
        for (&t, &w) in self.texels.iter().zip(&self.weights) {
            out[t as usize] += x * w;
        }
    }
}

/// Texels by number.
struct TexelList {
    places: Vec<(u32, u32)>,
    numbers: Vec<Vec<u32>>,
}

impl TexelList {
    fn new(pages: &[Page]) -> Self {
        TexelList {
            places: Vec::new(),
            numbers: pages
                .iter()
                .map(|p| vec![u32::MAX; p.value.len()])
                .collect(),
        }
    }

    /// Its number, a new one if it has none.
    fn number(&mut self, place: (u32, u32)) -> u32 {
        let number = &mut self.numbers[place.0 as usize][place.1 as usize];
        if *number == u32::MAX {
            *number = self.places.len() as u32;
            self.places.push(place);
        }
        *number
    }

    fn known(&self, place: (u32, u32)) -> Option<u32> {
        let number = self.numbers[place.0 as usize][place.1 as usize];
        (number != u32::MAX).then_some(number)
    }
}

/// Texels that a bilinear lookup at `at` reads, with weights; the page's edge repeats.
pub(crate) fn lookup(page: &Page, at: Vec2) -> [(usize, f32); 4] {
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let limit = |x: f32, size: u32| x.clamp(0.0, size.saturating_sub(1) as f32) as usize;
    let [x0, x1] = [corner.x, corner.x + 1.0].map(|x| limit(x, page.width));
    let [y0, y1] = [corner.y, corner.y + 1.0].map(|y| limit(y, page.height) * page.width as usize);
    [
        (y0 + x0, (1.0 - f.x) * (1.0 - f.y)),
        (y0 + x1, f.x * (1.0 - f.y)),
        (y1 + x0, (1.0 - f.x) * f.y),
        (y1 + x1, f.x * f.y),
    ]
}

/// Whether the charts of these texels are narrow: strips and flakes of which hardly a lumel is not a border's.
fn narrow(list: &TexelList, steps: &[u8], pages: &[Page], texels: &Texels) -> Vec<bool> {
    let charts = (texels.chart.iter().flatten())
        .filter(|&&c| c != EMPTY)
        .max();
    let mut lumels = vec![[0u32; 2]; charts.map_or(0, |&c| c as usize + 1)];
    for (p, page) in pages.iter().enumerate() {
        for (at, &coverage) in page.coverage.iter().enumerate() {
            let chart = texels.chart[p][at];
            if chart == EMPTY || coverage <= 0.0 {
                continue;
            }
            let of_a_seam =
                (list.known((p as u32, at as u32))).is_some_and(|i| steps[i as usize] == 0);
            let inside = coverage >= 0.5 && !texels.hidden[p][at] && !of_a_seam;
            let [all, inner] = &mut lumels[chart as usize];
            *all += 1;
            *inner += u32::from(inside);
        }
    }
    (list.places.iter())
        .map(|&(p, at)| texels.chart[p as usize][at as usize])
        .map(|chart| {
            chart != EMPTY && {
                let [all, inner] = lumels[chart as usize];
                inner as f32 <= NARROW * all as f32
            }
        })
        .collect()
}

/// The four texels next to one.
fn beside(pages: &[Page], (p, at): (u32, u32)) -> [Option<(u32, u32)>; 4] {
    let page = &pages[p as usize];
    let (x, y) = (at % page.width, at / page.width);
    [
        (x > 0).then(|| (p, at - 1)),
        (x + 1 < page.width).then(|| (p, at + 1)),
        (y > 0).then(|| (p, at - page.width)),
        (y + 1 < page.height).then(|| (p, at + page.width)),
    ]
}

pub(super) fn light_at(page: &Page, at: usize) -> f32 {
    luminance(page.value[at].into())
}

/// Mean light of the surface.
fn mean_light(pages: &[Page]) -> f32 {
    let (mut sum, mut area) = (0f64, 0f64);
    for page in pages {
        for (at, &coverage) in page.coverage.iter().enumerate() {
            sum += f64::from(coverage * light_at(page, at));
            area += f64::from(coverage);
        }
    }
    if area > 0.0 { (sum / area) as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sample of which the second side lies `apart` texels right of the first, on a page of one chart.
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

    /// Two strips of a lumel's height whose long borders meet on both sides, as a ledge's do: 1 and a hundredth of it.
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
                .map(|i| [if row(i) < 7 { 1.0 } else { 0.01 }; 3])
                .collect(),
            coverage: (0..n)
                .map(|i| if is_lumel(i) { 0.5 } else { 0.0 })
                .collect(),
            layers: Vec::new(),
        };
        let texels = Texels {
            chart: vec![(0..n).map(|i| u32::from(row(i) >= 7)).collect()],
            hidden: vec![vec![false; n]],
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

    #[test]
    fn lookups_of_narrow_strips_agree_and_none_is_below_zero() {
        let (samples, pages, texels) = strips();
        let mut stitcher = Stitcher::new(&samples, &pages, &texels);
        assert!(stitcher.report.before.p99 > 1.0, "{:?}", stitcher.report);
        assert!(stitcher.narrow.iter().all(|&narrow| narrow));
        let channel = Channel {
            value: Box::new(|page, at| pages[page].value[at][0]),
            signed: false,
        };
        let change = stitcher.solve(&[channel]).remove(0);
        let mut after = pages.clone();
        for (&(p, at), change) in stitcher.places.iter().zip(change) {
            for v in &mut after[p as usize].value[at as usize] {
                *v += change;
                assert!(*v > -1e-6, "{v} but for rounding");
            }
        }
        // What is promised of seams; 0.13 with the bounds of charts that have an inside.
        let found = stitcher.error(&after);
        assert!(found.p99 < 0.01, "{found:?}");
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
