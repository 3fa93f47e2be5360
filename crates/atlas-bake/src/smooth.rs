//! Takes sampling noise out of indirect light, and nothing else.
//!
//! Neighbouring lumels of one flat piece of surface gathered the same smooth function with independent random numbers. A plane is
//! fitted through their values by weighted least squares, in which a neighbour counts only as far as its difference can be
//! noise, by both lumels' own estimated variances. Where light truly changes, differences exceed the noise and the
//! lumel keeps its value; along a gradient the fitted plane has no bias.
//!
//! Based on: Rousselle, Knaus, Zwicker, *Adaptive rendering with non-local means filtering*, 2012 (weights from estimated variances);
//! Moon, Carr, Yoon, *Adaptive rendering based on weighted local regression*, 2014 (first-order fit). Direct light is not
//! touched: it has no noise but in penumbrae, where a filter could not tell a shadow's edge from it.

use glam::{DMat3, DVec3, Vec3};
use radiosity::luminance;
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::gather::Received;
use crate::lumels::{Lumel, Lumels};

/// Texels on each side of a lumel that take part: 24 neighbours. Two rings cut noise to about a third; a third ring
/// gained little in corners, where errors are (measured on the Cornell box).
const REACH: i64 = 2;

/// A difference of this many standard errors halves a neighbour's weight and more: exp(−d²/2K²) = 0.61 at K.
const SIGMAS: f32 = 2.0;

/// Cosine between normals below which two lumels see too different hemispheres. About 30°: along a curve light changes steadily, which
/// the plane follows, and pillars are a few lumels around.
const SAME_FACING: f32 = 0.85;

/// Smooths `received` in place; only `indirect` and `error` change.
pub(crate) fn smooth_indirect(lumels: &Lumels, layout: &Layout, received: &mut [Received]) {
    let index = Index::build(&lumels.lumels, layout);
    let smoothed: Vec<(Vec3, f32)> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|i| fit(i, &lumels.lumels, &index, received))
        .collect();
    for (r, (indirect, variance)) in received.iter_mut().zip(smoothed) {
        let direct = (r.error * r.error - r.indirect_variance).max(0.0);
        r.indirect = indirect;
        r.indirect_variance = variance;
        r.error = (direct + variance).sqrt();
    }
}

/// Lumel at each texel.
struct Index {
    /// By page: width, height, lumel number or `u32::MAX`.
    pages: Vec<(i64, i64, Vec<u32>)>,
}

impl Index {
    fn build(lumels: &[Lumel], layout: &Layout) -> Self {
        let mut pages: Vec<(i64, i64, Vec<u32>)> = layout
            .pages
            .iter()
            .map(|&[w, h]| (w as i64, h as i64, vec![u32::MAX; w as usize * h as usize]))
            .collect();
        for (i, l) in lumels.iter().enumerate() {
            let (w, _, texels) = &mut pages[l.page as usize];
            texels[l.texel[1] as usize * *w as usize + l.texel[0] as usize] = i as u32;
        }
        Index { pages }
    }

    fn at(&self, page: u32, x: i64, y: i64) -> Option<usize> {
        let (w, h, texels) = &self.pages[page as usize];
        if x < 0 || y < 0 || x >= *w || y >= *h {
            return None;
        }
        let i = texels[(y * w + x) as usize];
        (i != u32::MAX).then_some(i as usize)
    }
}

/// Smoothed indirect irradiance of lumel `i`, and the variance of its luminance.
fn fit(i: usize, lumels: &[Lumel], index: &Index, received: &[Received]) -> (Vec3, f32) {
    const SIDE: usize = (2 * REACH + 1) as usize;
    let own = &received[i];
    let keep = (own.indirect, own.indirect_variance);
    if own.indirect_variance <= 0.0 || own.open < 1.0 {
        return keep;
    }
    let l = &lumels[i];
    let value = luminance(own.indirect);
    let mut used = [(0usize, DVec3::ZERO, 0f64); SIDE * SIDE];
    let mut n = 0;
    let mut normal_matrix = DMat3::ZERO;
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let (x, y) = (l.texel[0] as i64 + dx, l.texel[1] as i64 + dy);
            let Some(j) = index.at(l.page, x, y) else {
                continue;
            };
            let (other, r) = (&lumels[j], &received[j]);
            let steps = ((dx * dx + dy * dy) as f32).sqrt();
            if other.instance != l.instance
                || r.open < 1.0
                || r.normal.dot(own.normal) < SAME_FACING
                || r.position.distance(own.position) > 1.5 * (steps + 0.5) * own.size
                || (r.position - own.position).dot(own.normal).abs()
                    > 0.5 * (steps + 1.0) * own.size
            {
                continue;
            }
            let d = luminance(r.indirect) - value;
            let noise = own.indirect_variance + r.indirect_variance;
            let likely = (-d * d / (2.0 * SIGMAS * SIGMAS * noise)).exp();
            let near = (-0.5 * steps * steps / (REACH * REACH) as f32).exp();
            let w = (likely * near * other.coverage.max(0.05)) as f64;
            let row = DVec3::new(1.0, dx as f64, dy as f64);
            normal_matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * w;
            used[n] = (j, row, w);
            n += 1;
        }
    }
    // Too few for a plane: a strip one or two lumels wide.
    let (determinant, trace) = (normal_matrix.determinant(), normal_matrix.x_axis.x);
    if n < 6 || determinant < 1e-3 * trace * trace * trace {
        return keep;
    }
    let first = normal_matrix.inverse().x_axis; // symmetric, so this is the first row
    let (mut sum, mut variance) = (Vec3::ZERO, 0f32);
    for &(j, row, w) in &used[..n] {
        let h = (first.dot(row) * w) as f32;
        sum += received[j].indirect * h;
        variance += h * h * received[j].indirect_variance;
    }
    if variance >= own.indirect_variance || sum.min_element() < 0.0 {
        return keep;
    }
    (sum, variance)
}
