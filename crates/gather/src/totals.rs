//! The report on lumels, summed up over tiles.

use std::f32::consts::FRAC_1_PI;

use radiosity::luminance;
use serde::Serialize;

use crate::certainty::{basis, relative, scale_of};
use crate::map::LumelMap;
use crate::reach::{Claim, Reached, mean_square, seen};
use crate::received::Edge;
use crate::thinned::Thinned;

/// Report on gathering at lumels.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LightReport {
    /// Number of texels with a surface.
    pub lumels: u64,
    /// Lumels that are completely inside or right behind something single-sided: nearly all of
    /// their rays hit backfaces.
    pub hidden_lumels: u64,
    /// The nodes that most of them belong to.
    pub hidden: Vec<HiddenIn>,
    /// Lumels that are partly inside or behind something; their value is the mean over the whole
    /// lumel.
    pub partly_hidden_lumels: u64,
    /// Lumels at contacts, which were gathered at many points.
    pub edge_lumels: u64,
    /// Lumels at or next to a shadow edge.
    pub shadow_edge_lumels: u64,
    /// Gathering and shadow rays of lumels.
    pub lumel_rays: u64,
    /// Mean of R over lumels, weighted by coverage (linear RGB).
    pub mean: [f64; 3],
    /// Estimated relative error: root mean square over the visible area of lit lumels of standard
    /// error / (value + 1 % of the mean), at most 1 for each. Within a factor of 1.5 of the true one
    /// on the scenes of lab/error.md. NaN (null in JSON) if no lumel is lit, because nothing was
    /// measured.
    pub estimated_error: f64,
    /// Median of the same, i.e. the error of a typical lumel; the root mean square
    /// is dominated by the worst corners. NaN like [`estimated_error`](Self::estimated_error).
    pub median_error: f64,
    /// Whether the error is as small as [`LightOptions::error`](crate::LightOptions::error)
    /// requests; `None` without a request.
    pub error_reached: Option<bool>,
    /// Number of further rounds to reach it.
    pub rounds: u32,
    /// Lumels with the maximum number of samples whose error is still too large.
    pub exhausted_lumels: u64,
}

/// Hidden lumels of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct HiddenIn {
    /// Index into [`Scene::instances`](mesh_ingest::Scene::instances).
    pub instance: usize,
    /// Number of its lumels.
    pub lumels: u64,
    /// Number of those that are completely inside or right behind something.
    pub hidden: u64,
}

/// Most instances that are listed, starting with the most hidden lumels.
const NAMED: usize = 100;

/// The report so far.
#[derive(Default)]
pub(crate) struct Totals {
    report: LightReport,
    /// Sums of R and of the light's luminance, weighted by coverage, and of the weights.
    sum: [f64; 3],
    luminance: f64,
    weight: f64,
    /// Of lumels that are partly visible.
    errors: Thinned<Absolute>,
}

/// The light that a lumel's error is relative to, and its standard error.
struct Absolute {
    light: f32,
    error: f32,
    /// How much it is seen.
    seen: f32,
}

impl Totals {
    /// Adds a tile.
    pub(crate) fn add(&mut self, map: &LumelMap, reached: Reached) {
        let report = &mut self.report;
        report.rounds = report.rounds.max(reached.rounds);
        report.exhausted_lumels += reached.exhausted;
        report.lumels += map.len() as u64;
        for (l, r) in map.lumels.lumels.iter().zip(&map.received) {
            report.lumel_rays += r.rays;
            report.edge_lumels += (r.edge == Edge::Contact) as u64;
            report.shadow_edge_lumels += (r.edge == Edge::Shadow) as u64;
            report.hidden_lumels += (r.open == 0.0) as u64;
            report.partly_hidden_lumels += (r.open > 0.0 && r.open < 1.0) as u64;
            let w = f64::from(l.coverage);
            let value = r.light() * FRAC_1_PI;
            for (s, v) in self.sum.iter_mut().zip(value.to_array()) {
                *s += f64::from(v) * w;
            }
            self.luminance += w * f64::from(luminance(r.light()));
            self.weight += w;
            if r.open > 0.0 {
                self.errors.push(Absolute {
                    light: basis(r),
                    error: r.error(),
                    seen: seen(l, r) as f32,
                });
            }
        }
        hidden_in(map, &mut report.hidden);
    }

    /// The report, if this error was asked for.
    pub(crate) fn report(self, asked: Option<f32>) -> LightReport {
        let Totals {
            mut report,
            sum,
            luminance,
            weight,
            errors,
        } = self;
        let weight = weight.max(1e-300);
        report.mean = sum.map(|s| s / weight);
        report.hidden.sort_by_key(|h| std::cmp::Reverse(h.hidden));
        report.hidden.truncate(NAMED);
        (report.estimated_error, report.median_error) = (f64::NAN, f64::NAN);
        let mean = (luminance / weight) as f32;
        let mut claims: Vec<Claim> = (errors.items().iter())
            .filter_map(|e| {
                Some(Claim {
                    error: relative(e.error, scale_of(e.light, mean)?),
                    seen: f64::from(e.seen),
                })
            })
            .collect();
        if !claims.is_empty() {
            report.estimated_error = mean_square(&claims).sqrt();
            report.median_error = median(&mut claims);
            report.error_reached = asked.map(|x| report.estimated_error <= f64::from(x));
        }
        report
    }
}

/// The error that half of the visible area does not exceed.
fn median(claims: &mut [Claim]) -> f64 {
    claims.sort_unstable_by(|a, b| a.error.total_cmp(&b.error));
    let half = 0.5 * claims.iter().map(|c| c.seen).sum::<f64>();
    let mut area = 0.0;
    let middle = claims.iter().find(|c| {
        area += c.seen;
        area >= half
    });
    middle.map_or(f64::NAN, |c| c.error)
}

/// Adds the instances of a tile that have hidden lumels.
fn hidden_in(map: &LumelMap, all: &mut Vec<HiddenIn>) {
    // Lumels are sorted by instance.
    let lumels = map.lumels.lumels.iter().zip(&map.received);
    let before = all.len();
    for (l, r) in lumels {
        let instance = l.instance as usize;
        if all[before..].last().is_none_or(|h| h.instance != instance) {
            all.push(HiddenIn {
                instance,
                lumels: 0,
                hidden: 0,
            });
        }
        if let Some(h) = all.last_mut() {
            h.lumels += 1;
            h.hidden += u64::from(r.open == 0.0);
        }
    }
    all.retain(|h| h.hidden > 0);
}
