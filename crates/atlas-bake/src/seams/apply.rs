//! Applies the same least-squares solve to every channel of the pages.

use glam::Vec3;
use radiosity::luminance;

use crate::page::Page;
use crate::seams::solve::{Channel, Stitcher};

/// Range of values of an extra channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Range {
    /// 0 and above.
    Light,
    /// 0..=1.
    Share,
    /// Any value.
    Signed,
    /// Not a quantity of the surface: left unchanged.
    Untouched,
}

/// Stitches all channels of `full`, whose extra channels have these ranges, and the pages of
/// groups.
///
/// Channels that sum to the light keep doing so. The solve is linear; only clamping to bounds and
/// negative parts break the sum, and that difference is distributed over all parts in proportion.
pub(crate) fn stitch(
    stitcher: &mut Stitcher,
    full: &mut [Page],
    groups: &mut [Vec<Page>],
    ranges: &[Range],
) {
    let layers: Vec<usize> = (0..ranges.len())
        .filter(|&k| ranges[k] != Range::Untouched)
        .collect();
    let changes = {
        let (full, groups) = (&*full, &*groups);
        let mut channels: Vec<Channel<'_>> = Vec::new();
        for c in 0..3 {
            channels.push(Channel {
                value: Box::new(move |p, at| full[p].value[at][c]),
                signed: false,
            });
        }
        for &k in &layers {
            channels.push(Channel {
                value: Box::new(move |p, at| full[p].layers[k].1[at]),
                signed: ranges[k] == Range::Signed,
            });
        }
        for pages in groups {
            for c in 0..3 {
                channels.push(Channel {
                    value: Box::new(move |p, at| pages[p].value[at][c]),
                    signed: false,
                });
            }
        }
        stitcher.solve(&channels)
    };
    let (of_light, rest) = changes.split_at(3);
    let (of_layers, of_groups) = rest.split_at(layers.len());
    let parts = direct_and_indirect(full);
    let (mut was, mut clamped) = (Vec::new(), 0);
    for (i, &(p, at)) in stitcher.places().iter().enumerate() {
        let (p, at) = (p as usize, at as usize);
        let page = &mut full[p];
        was.push(luminance(page.value[at].into()));
        for (v, change) in page.value[at].iter_mut().zip(of_light) {
            *v += change[i];
            if *v < 0.0 {
                clamped += u64::from(page.coverage[at] > 0.0);
                *v = 0.0;
            }
        }
        let whole = Vec3::from(page.value[at]);
        for (&k, change) in layers.iter().zip(of_layers) {
            page.layers[k].1[at] += change[i];
        }
        if let Some(parts) = parts {
            let mut values =
                parts.map(|first| Vec3::from([0, 1, 2].map(|c| page.layers[first + c].1[at])));
            share(whole, &mut values);
            for (first, value) in parts.iter().zip(values) {
                for c in 0..3 {
                    page.layers[first + c].1[at] = value[c];
                }
            }
        }
        for &k in &layers {
            let v = &mut page.layers[k].1[at];
            *v = match ranges[k] {
                Range::Light => v.max(0.0),
                Range::Share => v.clamp(0.0, 1.0),
                Range::Signed | Range::Untouched => *v,
            };
        }
        let mut values: Vec<Vec3> = (groups.iter().zip(of_groups.chunks_exact(3)))
            .map(|(pages, change)| {
                Vec3::from(pages[p].value[at]) + Vec3::from([0, 1, 2].map(|c| change[c][i]))
            })
            .collect();
        share(whole, &mut values);
        for (pages, value) in groups.iter_mut().zip(values) {
            pages[p].value[at] = value.to_array();
        }
    }
    stitcher.finish(&was, full, clamped);
}

/// Makes parts non-negative, with sum `whole`.
fn share(whole: Vec3, parts: &mut [Vec3]) {
    for c in 0..3 {
        let sum: f32 = parts.iter().map(|p| p[c].max(0.0)).sum();
        let scale = if sum > 0.0 { whole[c] / sum } else { 0.0 };
        for p in parts.iter_mut() {
            p[c] = p[c].max(0.0) * scale;
        }
    }
}

/// Indices of the first channels of direct and indirect light, if both exist.
fn direct_and_indirect(pages: &[Page]) -> Option<[usize; 2]> {
    let layers = &pages.first()?.layers;
    let first = |name: &str| layers.iter().position(|l| l.0 == name);
    Some([first("direct.R")?, first("indirect.R")?])
}
