//! Gathers on until the estimated error is what was asked for.
//!
//! Rounds: the whole map is smoothed on trial and its error estimated; lumels that make most of it
//! get four times their samples, of the kind that they lack (gathering rays; points at a contact;
//! points of a penumbra), as few lumels as must for the sum to come down to what is asked. The
//! first samples decide nothing but where to go on, so a lumel that is sure by chance is looked at
//! with its neighbours: what it claims is pooled with theirs.

use std::collections::BTreeMap;

use atlas::Lumels;
use radiosity::{Cancelled, DirectOptions, Monitor, Phase, luminance};
use rayon::prelude::*;

use crate::between::interpolate;
use crate::blocks::in_blocks;
use crate::certainty::{Certainty, scale};
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::options::GatherOptions;
use crate::received::{Edge, Received};
use crate::smooth::{Trust, smooth_indirect};

/// Samples are multiplied by this in a round.
const TIMES: u32 = 4;

/// Rays of a lumel, and points of a penumbra, at most; a contact has half as many points, of two
/// rays each. The sequences have 2¹⁶ points, of which a lumel that lies by an eighth on the surface
/// uses all.
const MOST: u32 = 8192;

/// Rounds at most: from the least of samples to the most are eight doublings; the rest is for what
/// earlier rounds judged wrongly.
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
}

/// Rays that a lumel can be judged by alone: what a sixteenth of them do not see is a thousandth of
/// the light.
const SURE: u32 = 512;

/// What a lumel is to get more of.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum More {
    Rays,
    Contact,
    Penumbra,
}

/// Gathers on at lumels until the root mean square of their relative errors is at most `wanted`, or
/// nothing more can be done. `finish` gives light, and errors, to lumels that have none of their
/// own, once the map is smoothed.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub(crate) fn reach(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    wanted: f32,
    finish: &Finish,
    monitor: &dyn Monitor,
) -> Result<Reached, Cancelled> {
    let first = gatherer.options;
    // Of contacts and penumbrae.
    let mut points = vec![1; map.len()];
    let mut out = Reached::default();
    for round in 0..ROUNDS {
        let (errors, finished) = estimate(map, first.rays, finish);
        let allowed = f64::from(wanted).powi(2);
        if finished <= allowed {
            break;
        }
        // Lumels that were gathered must come down by as much as the whole map.
        let total: f64 = errors.iter().map(Relative::sum).sum();
        let excess = total * (1.0 - allowed / finished);
        let (chosen, exhausted) = choose(&errors, map, &points, &first, excess);
        out.exhausted = exhausted;
        if chosen.is_empty() {
            break;
        }
        out.rounds = round + 1;
        look(gatherer, map, &mut points, &chosen, monitor)?;
    }
    Ok(out)
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

/// What a map is given after smoothing.
type Finish<'f> = dyn Fn(&mut LumelMap) + 'f;

/// The errors of lumels' own samples if the map were finished now, and the mean square of all its
/// errors, as the report will have it.
fn estimate(map: &mut LumelMap, rays: u32, finish: &Finish) -> (Vec<Relative>, f64) {
    let gathered = map.received.clone();
    let mean = settle(map, rays, 0, true);
    let errors = (map.received.par_iter().with_min_len(1024))
        .map(|r| {
            let Some(scale) = scale(r, mean) else {
                return Relative::default();
            };
            let square = f64::from(scale).powi(2);
            Relative {
                direct: f64::from(r.direct_variance) / square,
                indirect: f64::from(r.indirect_variance) / square,
            }
        })
        .collect();
    finish(map);
    let finished = mean_square(&relative_errors(&map.lumels, &map.received));
    map.received = gathered;
    (errors, finished)
}

/// Interpolates and smooths lumels that have `rays` gathering rays at least. The first `groups`
/// planes are shares of the light. Where an error is `asked` for, lumels with many rays are
/// trusted. Gives the mean light before smoothing.
pub(crate) fn settle(map: &mut LumelMap, rays: u32, groups: usize, asked: bool) -> f32 {
    interpolate(map);
    let mean = mean_light(&map.lumels, &map.received);
    let certainty = Certainty::measure(&map.received, |i| !map.plan.is(i), rays, mean);
    let times = std::mem::take(&mut map.times);
    let trust = Trust {
        certainty: &certainty,
        sure: &|i| asked && rays * times[i] >= SURE,
        groups,
    };
    smooth_indirect(map, trust);
    map.times = times;
    mean
}

/// Standard errors of lit lumels over their light. Those of which nothing can be seen hold light of
/// others, and are left out.
pub(crate) fn relative_errors(lumels: &Lumels, received: &[Received]) -> Vec<f64> {
    let mean = mean_light(lumels, received);
    (received.iter())
        .filter(|r| r.open > 0.0)
        .filter_map(|r| Some(f64::from(r.error() / scale(r, mean)?)))
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
        sum += covered * f64::from(luminance(r.light()));
        weight += covered;
    }
    (sum / f64::max(weight, 1e-300)) as f32
}

/// The lumels with the largest errors, as few as bring the sum down by `excess`, with what each
/// lacks; and how many of the largest have no more to get.
fn choose(
    errors: &[Relative],
    map: &LumelMap,
    points: &[u32],
    first: &GatherOptions,
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
        let (r, e) = (&map.received[i], &errors[i]);
        let before = saved;
        if r.edge == Edge::Contact {
            if first.edge_points * points[i] * TIMES * 2 <= MOST {
                chosen
                    .entry((More::Contact, points[i]))
                    .or_default()
                    .push(i);
                saved += (1.0 - LEFT) * e.sum();
            }
        } else {
            // What has a tenth of the error is not worth while.
            if e.direct >= 0.1 * e.indirect
                && r.mixed != 0
                && first.direct.penumbra * points[i] * TIMES <= MOST
            {
                chosen
                    .entry((More::Penumbra, points[i]))
                    .or_default()
                    .push(i);
                saved += (1.0 - LEFT) * e.direct;
            }
            if e.indirect >= 0.1 * e.direct {
                let between = map.plan.of(i);
                let own = (!map.plan.is(i)).then_some(i);
                let mut more = false;
                for j in own.into_iter().chain(between) {
                    if map.received[j].edge == Edge::Contact
                        || first.rays * map.times[j] * TIMES > MOST
                    {
                        continue;
                    }
                    more = true;
                    if !taken[j] {
                        taken[j] = true;
                        chosen
                            .entry((More::Rays, map.times[j]))
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
    gatherer: &Gatherer,
    map: &mut LumelMap,
    points: &mut [u32],
    chosen: &BTreeMap<(More, u32), Vec<usize>>,
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let first = gatherer.options;
    // Penumbrae last: more rays leave direct light as it is.
    for (&(more, from), of) in chosen {
        let to = from * TIMES;
        let closer = gatherer.with(GatherOptions {
            edge_points: first.edge_points * to,
            direct: DirectOptions {
                penumbra: first.direct.penumbra * to,
                ..first.direct
            },
            ..first
        });
        let again = in_blocks(of.len(), Phase::Refine, monitor, |k| {
            let i = of[k];
            let (footprint, seed) = map.footprint(gatherer.world(), i);
            let old = &map.received[i];
            match more {
                More::Rays => closer.gather_more(&footprint, seed, old, (from, to)),
                More::Penumbra => closer.refine_direct(&footprint, seed, old, old.mixed),
                More::Contact => {
                    let again = closer.gather_edge(&footprint, seed);
                    Received {
                        open: old.open.min(again.open),
                        rays: old.rays + again.rays,
                        ..again
                    }
                }
            }
        })?;
        for (&i, r) in of.iter().zip(again) {
            map.received[i] = r;
            match more {
                More::Rays => map.times[i] = to,
                _ => points[i] = to,
            }
        }
    }
    Ok(())
}
