//! Gathers on until the estimated error is what was asked for.
//!
//! Rounds: the whole map is smoothed on trial and its error estimated; lumels that make most of it get four times their samples, of the kind
//! that they lack (gathering rays; points at a contact; points of a penumbra), as few lumels as must for the sum to come down to what is asked. The first
//! samples decide nothing but where to go on, so a lumel that is sure by chance is looked at with its neighbours: what it claims is pooled with theirs.

use std::collections::BTreeMap;

use radiosity::{Cancelled, Monitor, Phase, luminance};
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::bake::{Recorded, in_blocks};
use crate::certainty::{Certainty, scale};
use crate::gather::{Edge, Gatherer, Received};
use crate::lumels::Lumels;
use crate::smooth::smooth_indirect;
use crate::sparse::Sparse;
use crate::walls::Barriers;

/// Samples are multiplied by this in a round.
const TIMES: u32 = 4;

/// Rays of a lumel, and points of a penumbra, at most; a contact has half as many points, of two rays each. The sequences have 2¹⁶
/// points, of which a lumel that lies by an eighth on the surface uses all.
const MOST: u32 = 8192;

/// Rounds at most: from the least of samples to the most are eight doublings; the rest is for what earlier rounds judged wrongly.
const ROUNDS: u32 = 10;

/// What a round leaves of a picked lumel's squared error, at most.
const LEFT: f64 = 1.0 / TIMES as f64;

/// How a search for an error ended.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reached {
    /// Rounds that cast rays.
    pub rounds: u32,
    /// Lumels that have as many samples as they can, and more error than is asked for.
    pub exhausted: u64,
    /// By lumel: it has so many rays that what it says of itself can be trusted.
    pub sure: Vec<bool>,
}

/// Rays that a lumel can be judged by alone: what a sixteenth of them do not see is a thousandth of the light.
const SURE: u32 = 512;

/// The samples that lumels have, as multiples of what they had first.
struct Level {
    rays: Vec<u32>,
    /// Of contacts and penumbrae.
    points: Vec<u32>,
}

/// What a lumel is to get more of.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum More {
    Rays,
    Contact,
    Penumbra,
}

/// Gathers on at lumels until the root mean square of their relative errors is at most `wanted`, or nothing more can be done.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
#[allow(
    clippy::too_many_arguments,
    reason = "what a bake holds while it gathers"
)]
pub(crate) fn reach(
    gatherer: &mut Gatherer,
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
    barriers: &Barriers,
    sparse: &Sparse,
    wanted: f32,
    first_times: &[u32],
    finish: &Finish,
    monitor: &dyn Monitor,
) -> Result<Reached, Cancelled> {
    let first = gatherer.options;
    let mut level = Level {
        rays: first_times.to_vec(),
        points: vec![1; received.len()],
    };
    let mut out = Reached::default();
    let mut result = Ok(());
    for round in 0..ROUNDS {
        let sure = |i: usize| first.rays * level.rays[i] >= SURE;
        let (errors, finished) = estimate(
            lumels, layout, received, barriers, sparse, first.rays, &sure, finish,
        );
        let allowed = f64::from(wanted).powi(2);
        if finished <= allowed {
            break;
        }
        // Lumels that were gathered must come down by as much as the whole map.
        let total: f64 = errors.iter().map(Relative::sum).sum();
        let excess = total * (1.0 - allowed / finished);
        let (chosen, exhausted) = choose(&errors, received, sparse, &level, &first, excess);
        out.exhausted = exhausted;
        if chosen.is_empty() {
            break;
        }
        out.rounds = round + 1;
        result = look(gatherer, lumels, received, &mut level, &chosen, monitor);
        if result.is_err() {
            break;
        }
    }
    gatherer.options = first;
    out.sure = (level.rays.iter())
        .map(|times| first.rays * times >= SURE)
        .collect();
    result.map(|()| out)
}

/// Squared relative errors of a lumel.
#[derive(Default, Clone, Copy)]
struct Relative {
    direct: f64,
    indirect: f64,
}

impl Relative {
    fn sum(&self) -> f64 {
        self.direct + self.indirect
    }
}

/// What a map is given after smoothing: light, and errors, for lumels that have none of their own.
type Finish<'f> = dyn Fn(&mut [Received]) + 'f;

/// The errors of lumels' own samples if the map were finished now, and the mean square of all its errors, as the report will have it.
#[allow(clippy::too_many_arguments, reason = "as above")]
fn estimate(
    lumels: &Lumels,
    layout: &Layout,
    received: &[Received],
    barriers: &Barriers,
    sparse: &Sparse,
    rays: u32,
    sure: &(dyn Fn(usize) -> bool + Sync),
    finish: &Finish,
) -> (Vec<Relative>, f64) {
    let mut trial = received.to_vec();
    sparse.interpolate(&mut trial);
    let mean = mean_light(lumels, &trial);
    let certainty = Certainty::measure(&trial, |i| !sparse.is(i), rays, mean);
    smooth_indirect(
        lumels, layout, &mut trial, barriers, sparse, 0, &certainty, sure,
    );
    let errors = (trial.par_iter().with_min_len(1024))
        .map(|r| {
            let Some(scale) = scale(r, mean) else {
                return Relative::default();
            };
            let square = f64::from(scale).powi(2);
            let direct = f64::from(r.error * r.error - r.indirect_variance).max(0.0);
            Relative {
                direct: direct / square,
                indirect: f64::from(r.indirect_variance) / square,
            }
        })
        .collect();
    finish(&mut trial);
    (errors, mean_square(&relative_errors(lumels, &trial)))
}

/// Standard errors of lit lumels over their light. Those of which nothing can be seen hold light of others, and are left out.
pub(crate) fn relative_errors(lumels: &Lumels, received: &[Received]) -> Vec<f64> {
    let mean = mean_light(lumels, received);
    (received.iter())
        .filter(|r| r.open > 0.0)
        .filter_map(|r| Some(f64::from(r.error / scale(r, mean)?)))
        .collect()
}

/// 0 of none.
pub(crate) fn mean_square(errors: &[f64]) -> f64 {
    // Not `sum()`, which is −0 for an unlit scene.
    errors.iter().fold(0.0, |s, e| s + e * e) / errors.len().max(1) as f64
}

/// Mean luminance of the light of lumels, weighted by coverage.
pub(crate) fn mean_light(lumels: &Lumels, received: &[Received]) -> f32 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for (l, r) in lumels.lumels.iter().zip(received) {
        let covered = f64::from(l.coverage);
        sum += covered * f64::from(luminance(r.direct + r.indirect));
        weight += covered;
    }
    (sum / f64::max(weight, 1e-300)) as f32
}

/// The lumels with the largest errors, as few as bring the sum down by `excess`, with what each lacks; and how many of the largest have no more to get.
fn choose(
    errors: &[Relative],
    received: &[Received],
    sparse: &Sparse,
    level: &Level,
    first: &crate::GatherOptions,
    excess: f64,
) -> (BTreeMap<(More, u32), Vec<usize>>, u64) {
    let mut order: Vec<usize> = (0..errors.len())
        .filter(|&i| errors[i].sum() > 0.0)
        .collect();
    order.sort_by(|&a, &b| {
        (errors[b].sum())
            .total_cmp(&errors[a].sum())
            .then(a.cmp(&b))
    });
    let mut chosen: BTreeMap<(More, u32), Vec<usize>> = BTreeMap::new();
    let mut taken = vec![false; errors.len()];
    let (mut saved, mut exhausted) = (0.0, 0);
    for i in order {
        if saved >= excess {
            break;
        }
        let (r, e) = (&received[i], &errors[i]);
        let before = saved;
        if r.edge == Edge::Contact {
            if first.edge_points * level.points[i] * TIMES * 2 <= MOST {
                chosen
                    .entry((More::Contact, level.points[i]))
                    .or_default()
                    .push(i);
                saved += (1.0 - LEFT) * e.sum();
            }
        } else {
            // What has a tenth of the error is not worth while.
            if e.direct >= 0.1 * e.indirect
                && r.mixed != 0
                && first.direct.penumbra * level.points[i] * TIMES <= MOST
            {
                chosen
                    .entry((More::Penumbra, level.points[i]))
                    .or_default()
                    .push(i);
                saved += (1.0 - LEFT) * e.direct;
            }
            if e.indirect >= 0.1 * e.direct {
                let between = sparse.of(i);
                let own = (!sparse.is(i)).then_some(i);
                let mut more = false;
                for j in own.into_iter().chain(between) {
                    if received[j].edge == Edge::Contact
                        || first.rays * level.rays[j] * TIMES > MOST
                    {
                        continue;
                    }
                    more = true;
                    if !taken[j] {
                        taken[j] = true;
                        chosen
                            .entry((More::Rays, level.rays[j]))
                            .or_default()
                            .push(j);
                    }
                }
                if more {
                    saved += (1.0 - LEFT) * e.indirect;
                }
            }
        }
        exhausted += u64::from(saved == before);
    }
    (chosen, exhausted)
}

/// Gathers on at the chosen lumels.
fn look(
    gatherer: &mut Gatherer,
    lumels: &Lumels,
    received: &mut [Received],
    level: &mut Level,
    chosen: &BTreeMap<(More, u32), Vec<usize>>,
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let first = gatherer.options;
    // Penumbrae last: more rays leave direct light as it is.
    for (&(more, from), of) in chosen {
        let to = from * TIMES;
        gatherer.options.edge_points = first.edge_points * to;
        gatherer.options.direct.penumbra = first.direct.penumbra * to;
        // Which lumels come here hangs on the light: no records.
        let recorded = Recorded {
            recall: None,
            stage: 0,
            item: &|k| of[k] as u32,
            guard: &|_| 0,
        };
        let again = in_blocks(of.len(), Phase::Refine, monitor, recorded, |k, tape| {
            let i = of[k];
            let (footprint, seed) = lumels.footprint(gatherer.world, i);
            let old = &received[i];
            match more {
                More::Rays => gatherer.gather_more(&footprint, seed, old, from, to, tape),
                More::Penumbra => gatherer.refine_direct(&footprint, seed, old, old.mixed, tape),
                More::Contact => {
                    let again = gatherer.gather_edge(&footprint, seed, tape);
                    Received {
                        open: old.open.min(again.open),
                        rays: old.rays + again.rays,
                        ..again
                    }
                }
            }
        });
        gatherer.options = first;
        for (&i, r) in of.iter().zip(again?) {
            received[i] = r;
            let levels = if more == More::Rays {
                &mut level.rays
            } else {
                &mut level.points
            };
            levels[i] = to;
        }
    }
    Ok(())
}
