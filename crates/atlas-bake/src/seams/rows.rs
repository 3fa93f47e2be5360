//! Lookups on both sides of seams, and the texels that they read.

use glam::{Vec2, Vec4};
use radiosity::luminance;

use crate::page::Page;

/// Weights of a lookup below this are neglected.
pub(super) const LITTLE: f32 = 1e-3;

/// A chart is narrow if at most this fraction of its lumels is not part of any seam. At 0.6, half a
/// sphere would count.
const NARROW: f32 = 0.3;

/// Data of texels besides their light, by page.
pub(crate) struct Texels {
    /// Piece of surface that a texel belongs to, or [`EMPTY`].
    pub chart: Vec<Vec<u32>>,
    /// Lumels without a visible part.
    pub hidden: Vec<Vec<bool>>,
    /// Texels that keep their value; empty if all may change.
    pub kept: Vec<Vec<bool>>,
}

/// No piece of surface.
pub(crate) const EMPTY: u32 = u32::MAX;

/// The two lookups of one sample: Σ weights × texels is a − b.
pub(super) struct Row {
    pub texels: [u32; 8],
    pub weights: [f32; 8],
    /// W ℓ / σ², reduced where light bends.
    pub agree: f32,
    /// Misfit over σ, infinite for the two sides of a slit.
    pub misfit: f32,
    /// σ.
    pub scale: f32,
    /// ℓ.
    pub texels_long: f32,
    /// Whether both sides are in the open, judged by their lumels. Hidden parts adapt to visible
    /// ones, but are not reported.
    pub counts: bool,
}

impl Row {
    /// Whether the two lookups have a texel in common. This happens at slits in a chart that are
    /// narrower than a lookup's footprint: the sides differ by slope times distance, and could only
    /// agree if the slope vanished.
    pub(super) fn shares_texels(&self) -> bool {
        let (a, b) = self.texels.split_at(4);
        let (of_a, of_b) = self.weights.split_at(4);
        (a.iter().zip(of_a)).any(|(t, w)| {
            let same = b.iter().zip(of_b).filter(|x| x.0 == t);
            w.min(same.map(|x| -x.1).sum()) > LITTLE
        })
    }

    /// Whether one of the lookups reads only narrow pieces.
    pub(super) fn in_narrow(&self, narrow: &[bool]) -> bool {
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

    /// The texels that it reads, with weights.
    pub(super) fn terms(&self) -> impl Iterator<Item = (usize, f32)> {
        let terms = self.texels.iter().zip(&self.weights);
        terms
            .filter(|(_, w)| **w != 0.0)
            .map(|(&t, &w)| (t as usize, w))
    }
}

/// Texels by number.
pub(super) struct TexelList {
    pub places: Vec<(u32, u32)>,
    numbers: Vec<Vec<u32>>,
}

impl TexelList {
    pub(super) fn new(pages: &[Page]) -> Self {
        TexelList {
            places: Vec::new(),
            numbers: pages
                .iter()
                .map(|p| vec![u32::MAX; p.value.len()])
                .collect(),
        }
    }

    /// Number of a texel, which is added if it has none.
    pub(super) fn number(&mut self, place: (u32, u32)) -> u32 {
        let number = &mut self.numbers[place.0 as usize][place.1 as usize];
        if *number == u32::MAX {
            *number = self.places.len() as u32;
            self.places.push(place);
        }
        *number
    }

    pub(super) fn known(&self, place: (u32, u32)) -> Option<u32> {
        let number = self.numbers[place.0 as usize][place.1 as usize];
        (number != u32::MAX).then_some(number)
    }
}

/// The texels that a bilinear lookup at `at` reads on a page of this size, with weights; the
/// page's edge is repeated.
pub(crate) fn lookup([width, height]: [u32; 2], at: Vec2) -> [(usize, f32); 4] {
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let limit = |x: f32, size: u32| x.clamp(0.0, size.saturating_sub(1) as f32) as usize;
    let [x0, x1] = [corner.x, corner.x + 1.0].map(|x| limit(x, width));
    let [y0, y1] = [corner.y, corner.y + 1.0].map(|y| limit(y, height) * width as usize);
    [
        (y0 + x0, (1.0 - f.x) * (1.0 - f.y)),
        (y0 + x1, f.x * (1.0 - f.y)),
        (y1 + x0, (1.0 - f.x) * f.y),
        (y1 + x1, f.x * f.y),
    ]
}

/// Whether the charts of these texels are narrow, i.e. strips and slivers that consist almost only
/// of borders.
pub(super) fn narrow(list: &TexelList, steps: &[u8], pages: &[Page], texels: &Texels) -> Vec<bool> {
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

/// The four direct neighbours of a texel.
pub(super) fn beside(pages: &[Page], (p, at): (u32, u32)) -> [Option<(u32, u32)>; 4] {
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

/// Mean light over the surface.
pub(super) fn mean_light(pages: &[Page]) -> f32 {
    let (mut sum, mut area) = (0f64, 0f64);
    for page in pages {
        for (at, &coverage) in page.coverage.iter().enumerate() {
            sum += f64::from(coverage * light_at(page, at));
            area += f64::from(coverage);
        }
    }
    if area > 0.0 { (sum / area) as f32 } else { 0.0 }
}
