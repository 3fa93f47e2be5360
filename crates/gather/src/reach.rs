//! Gathers until the estimated error reaches the requested one.
//!
//! Each round smooths the map tentatively and estimates its error. The lumels that contribute most
//! to the error get four times their samples, of the kind that they lack (gathering rays, points at
//! a contact, or points of a penumbra). As few lumels are chosen as reduce the sum to the target.
//! The first samples only decide where to continue: a lumel that appears accurate by chance is
//! judged together with its neighbours, because their claims are pooled.

use std::collections::BTreeMap;

use atlas::{Lumel, Lumels};
use radiosity::{Cancelled, DirectOptions, Monitor, Phase, luminance};
use rayon::prelude::*;

use crate::between::interpolate;
use crate::blocks::in_blocks;
use crate::certainty::{Certainty, relative, scale};
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::options::GatherOptions;
use crate::received::{Edge, Received};
use crate::smooth::{Trust, smooth_indirect};

/// Factor on samples in a round.
const TIMES: u32 = 4;

/// Most rays of a lumel, and most points of a penumbra; a contact has half as many points, of two
/// rays each. The sequences have 2¹⁶ points; a lumel with a coverage of an eighth uses all of them.
const MOST: u32 = 8192;

/// Most rounds. From the least to the most samples there are eight doublings; the other rounds
/// correct misjudgements of earlier ones.
const ROUNDS: u32 = 10;

/// Largest fraction of a chosen lumel's squared error that remains after a round.
const LEFT: f64 = 1.0 / TIMES as f64;

/// Result of a search for an error.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reached {
    /// Rounds that cast rays.
    pub rounds: u32,
    /// Lumels with the maximum number of samples and more than the requested error.
    pub exhausted: u64,
}

/// From this many rays on, a lumel's own estimates can be trusted.
const SURE: u32 = 512;

/// The kind of samples that a lumel needs.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum More {
    Rays,
    Contact,
    Penumbra,
}

/// Gathers until the root mean square of the lumels' relative errors is at most `wanted`, or
/// nothing more can be done. `finish` assigns light and errors to lumels without their own, once
/// the map is smoothed.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn reach(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    wanted: f32,
    finish: &Finish,
    monitor: &dyn Monitor,
) -> Result<Reached, Cancelled> {
    let first = gatherer.options;
    // Factor on points of contacts and penumbrae.
    let mut points = vec![1; map.len()];
    let mut out = Reached::default();
    for round in 0..ROUNDS {
        let (errors, finished) = estimate(map, first.rays, finish);
        let allowed = f64::from(wanted).powi(2);
        if finished <= allowed {
            break;
        }
        // The error of gathered lumels must fall by as much as that of the whole map.
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

/// Squared relative errors of a lumel, by kind of sample, times the area that is seen of it.
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

/// Applied to a map after smoothing.
type Finish<'f> = dyn Fn(&mut LumelMap) + 'f;

/// The errors of the lumels' own samples if the map were finished now, and the mean square of all
/// its errors, as reported.
fn estimate(map: &mut LumelMap, rays: u32, finish: &Finish) -> (Vec<Relative>, f64) {
    let gathered = map.received.clone();
    let mean = settle(map, rays, 0, true);
    let lumels = map.lumels.lumels.par_iter().zip(&map.received);
    let errors = (lumels.with_min_len(1024))
        .map(|(l, r)| {
            let Some(scale) = scale(r, mean) else {
                return Relative::default();
            };
            let square = seen(l, r) * relative(r.error(), scale).powi(2);
            let direct = f64::from(r.direct_variance / r.variance().max(f32::MIN_POSITIVE));
            Relative {
                direct: square * direct,
                indirect: square * (1.0 - direct),
            }
        })
        .collect();
    finish(map);
    let finished = mean_square(&claims(&map.lumels, &map.received));
    map.received = gathered;
    (errors, finished)
}

/// Interpolates and smooths lumels that have at least `rays` gathering rays. The first `groups`
/// planes are parts of the light. If an error was `asked` for, lumels with many rays are trusted.
/// Returns the mean light before smoothing.
pub(crate) fn settle(map: &mut LumelMap, rays: u32, groups: usize, asked: bool) -> f32 {
    interpolate(map);
    let mean = mean_light(&map.lumels, &map.received);
    let certainty = Certainty::measure(&map.received, |i| map.plan.is_gathered(i), rays, mean);
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

/// Relative standard error of a lit lumel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Claim {
    pub error: f64,
    /// How much it is seen; see [`seen`].
    pub seen: f64,
}

/// How much the lumels of a slit are seen at least: where lumels are as wide as rooms, no ray goes
/// far, and all of them count alike.
const LEAST_SEEN: f32 = 0.02;

/// How much a lumel is seen: its visible area, in lumels, times the fraction of directions from which
/// people can look at it. Hidden lumels have the light of others, and what lies in a slit is dark, is
/// known badly, and is seen by nobody.
pub(crate) fn seen(lumel: &Lumel, received: &Received) -> f64 {
    f64::from(lumel.coverage * received.open * received.far.max(LEAST_SEEN))
}

/// What lit lumels claim.
fn claims(lumels: &Lumels, received: &[Received]) -> Vec<Claim> {
    let mean = mean_light(lumels, received);
    (lumels.lumels.iter().zip(received))
        .filter_map(|(l, r)| {
            Some(Claim {
                error: relative(r.error(), scale(r, mean)?),
                seen: seen(l, r),
            })
        })
        .collect()
}

/// The mean square over the visible area; 0 if there is none.
pub(crate) fn mean_square(claims: &[Claim]) -> f64 {
    let (mut sum, mut area) = (0.0, 0.0);
    for claim in claims {
        sum += claim.seen * claim.error * claim.error;
        area += claim.seen;
    }
    sum / f64::max(area, 1e-300)
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

/// The lumels with the largest errors, as few as reduce the sum by `excess`, with the samples that
/// each lacks; and the number of largest ones that cannot get more.
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
    let mut choice = Choice {
        map,
        first,
        chosen: BTreeMap::new(),
        taken: vec![false; errors.len()],
    };
    let (mut saved, mut exhausted) = (0.0, 0);
    for i in order {
        if saved >= excess {
            break;
        }
        let less = choice.take(i, &errors[i], points[i]);
        saved += (1.0 - LEFT) * less;
        exhausted += u64::from(less == 0.0);
    }
    (choice.chosen, exhausted)
}

/// Lumels by what they lack and how much they have of it.
struct Choice<'m> {
    map: &'m LumelMap,
    first: &'m GatherOptions,
    chosen: BTreeMap<(More, u32), Vec<usize>>,
    /// Which lumels get rays.
    taken: Vec<bool>,
}

impl Choice<'_> {
    /// Takes lumel `i`, unless it cannot get more. Returns the error of what gets more samples.
    fn take(&mut self, i: usize, e: &Relative, points: u32) -> f64 {
        let (r, first) = (&self.map.received[i], self.first);
        if r.edge == Edge::Contact {
            let more = first.edge_points * points * TIMES * 2 <= MOST;
            if more {
                self.add(More::Contact, points, i);
            }
            return if more { e.sum() } else { 0.0 };
        }
        let mut less = 0.0;
        // A kind of sample with a tenth of the error is not worth it.
        if e.direct >= 0.1 * e.indirect
            && r.mixed != 0
            && first.direct.penumbra * points * TIMES <= MOST
        {
            self.add(More::Penumbra, points, i);
            less += e.direct;
        }
        if e.indirect >= 0.1 * e.direct && self.take_rays(i) {
            less += e.indirect;
        }
        less
    }

    /// Takes the lumels whose rays lumel `i` has: its own, or those between which it lies. Returns
    /// whether any can get more.
    fn take_rays(&mut self, i: usize) -> bool {
        let map = self.map;
        let own = (!map.plan.is(i)).then_some(i);
        let mut more = false;
        for j in own.into_iter().chain(map.plan.of(i)) {
            let cast = self.first.rays * map.times[j] * TIMES;
            if map.received[j].edge == Edge::Contact || cast > MOST {
                continue;
            }
            more = true;
            if !std::mem::replace(&mut self.taken[j], true) {
                self.add(More::Rays, map.times[j], j);
            }
        }
        more
    }

    fn add(&mut self, more: More, times: u32, i: usize) {
        self.chosen.entry((more, times)).or_default().push(i);
    }
}

/// Gathers more samples at the chosen lumels.
fn look(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    points: &mut [u32],
    chosen: &BTreeMap<(More, u32), Vec<usize>>,
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let first = gatherer.options;
    // Penumbrae last, because more rays do not change direct light.
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
