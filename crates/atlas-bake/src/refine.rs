//! Second looks at lumels, decided by what was gathered next to them.
//!
//! A lumel's own first rays are no judge of how many more it needs: one that missed a small bright window finds itself dark and certain. To stop
//! there, and to go on only where something was seen, loses light (between plates ten sides apart, three quarters of it). So neighbours decide.

use radiosity::{Cancelled, Monitor, Phase, luminance};
use rayon::prelude::*;

use crate::atlas::Layout;
use crate::bake::{Recorded, in_blocks};
use crate::gather::{Edge, Gatherer, Received};
use crate::lumels::{Lumels, TexelIndex};
use crate::recall::Stage;
use crate::smooth::Window;
use crate::sparse::Sparse;
use crate::walls::Barriers;

/// Looks again at lumels beside one that an edge crosses, where they were found whole: the edge goes on, and may cut off less of them than one
/// of their first points stands for.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub(crate) fn follow_edges(
    gatherer: &Gatherer,
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
    monitor: &dyn Monitor,
) -> Result<(), Cancelled> {
    let index = TexelIndex::build(&lumels.lumels, layout);
    // Where edges get no more points than others, a second look would see no more.
    let options = &gatherer.options;
    let contacts = options.contacts && options.edge_points > options.points;
    for round in 0..options.follow.min(ROUNDS) {
        let beside: Vec<(usize, Look)> = (0..received.len())
            .into_par_iter()
            .with_min_len(1024)
            .filter_map(|i| {
                let look = look_again(lumels, &index, received, i);
                let contact = look.contact && contacts && round == 0;
                (contact || look.lights != 0).then_some((i, Look { contact, ..look }))
            })
            .collect();
        if beside.is_empty() {
            break;
        }
        let stage = Stage::Follow.round(round);
        let recorded = Recorded {
            recall: gatherer.recall,
            stage,
            item: &|k| beside[k].0 as u32,
            guard: &|_| 0,
        };
        let refined = in_blocks(beside.len(), Phase::Refine, monitor, recorded, |k, tape| {
            let (i, look) = beside[k];
            let (footprint, seed) = lumels.footprint(gatherer.world, i);
            let first = &received[i];
            if !look.contact {
                return gatherer.refine_direct(&footprint, seed, first, look.lights, tape);
            }
            let again = gatherer.gather_edge(&footprint, seed, tape);
            Received {
                // What the smoothing goes by, which the many points know better.
                open: first.open.min(again.open),
                rays: first.rays + again.rays,
                ..again
            }
        })?;
        for ((i, _), again) in beside.into_iter().zip(refined) {
            received[i] = again;
        }
    }
    Ok(())
}

/// Most lumels that an edge is followed for, [`GatherOptions::follow`](crate::GatherOptions::follow): records have a stage for each.
const ROUNDS: u32 = 3;

/// Why a lumel is to be looked at again.
#[derive(Clone, Copy, Default)]
struct Look {
    /// Something touches its neighbour.
    contact: bool,
    /// Lights whose shadow's edge crosses a neighbour, or runs between it and the lumel.
    lights: u32,
}

fn look_again(lumels: &Lumels, index: &TexelIndex, received: &[Received], i: usize) -> Look {
    let (l, own) = (&lumels.lumels[i], &received[i]);
    // Buried lumels were searched through, and those at contacts looked at closely.
    if own.edge == Edge::Contact || own.open == 0.0 {
        return Look::default();
    }
    let [x, y] = l.texel.map(i64::from);
    let mut look = Look::default();
    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
        let Some(j) = index.at(l.page, x + dx, y + dy) else {
            continue;
        };
        let other = &received[j];
        if lumels.lumels[j].instance == l.instance {
            look.contact |= other.edge == Edge::Contact;
            // One light's shadow may end in a lumel that another's was found in.
            look.lights |= other.mixed | (own.lit & other.hidden) | (own.hidden & other.lit);
        }
    }
    look.lights &= !(own.mixed | own.looked);
    look
}

/// Casts more gathering rays where neighbours say that the first were too few for [`GatherOptions::error`](crate::GatherOptions::error), and says how many times
/// as many rays as at first each lumel has.
///
/// # Errors
/// [`Cancelled`] when the monitor says so.
pub(crate) fn add_rays(
    gatherer: &Gatherer,
    lumels: &Lumels,
    layout: &Layout,
    received: &mut [Received],
    barriers: &Barriers,
    sparse: &Sparse,
    monitor: &dyn Monitor,
) -> Result<Vec<u32>, Cancelled> {
    let mut all = vec![1; received.len()];
    let options = &gatherer.options;
    let most = (options.most_rays / options.rays.max(1)).max(1);
    if gatherer.world.is_dark() || (most == 1 && sparse.most_bearing() == 1) {
        return Ok(all);
    }
    let window = Window::new(lumels, layout, received, barriers, sparse);
    let short: Vec<(usize, u32)> = (0..received.len())
        .into_par_iter()
        .with_min_len(256)
        .filter_map(|i| {
            if received[i].edge == Edge::Contact || received[i].open < 1.0 || sparse.is(i) {
                return None; // has many already, or none that matter
            }
            let (around, n) = window.around(i);
            let (mut variance, mut total, mut others) = (0f32, 0f32, 0f32);
            for &(j, ..) in around[..n].iter().filter(|a| a.0 != i) {
                let r = &received[j];
                variance += r.indirect_variance;
                total += luminance(r.direct + r.indirect);
                others += 1.0;
            }
            if others == 0.0 {
                variance = received[i].indirect_variance;
                total = luminance(received[i].direct + received[i].indirect);
                others = 1.0;
            }
            let wanted = options.error * total / others;
            let ratio = variance / others / (wanted * wanted).max(1e-30);
            // Powers of two keep the points of the sequence well distributed.
            let times = (ratio.clamp(1.0, most as f32).ceil() as u32).next_power_of_two();
            let times = if times > most { times / 2 } else { times };
            let times = times.max(sparse.bearing(i));
            (times > 1).then_some((i, times))
        })
        .collect();
    let recorded = Recorded {
        recall: gatherer.recall,
        stage: Stage::More.round(0),
        item: &|k| short[k].0 as u32,
        guard: &|_| 0,
    };
    let more = in_blocks(short.len(), Phase::Refine, monitor, recorded, |k, tape| {
        let (i, times) = short[k];
        let (footprint, seed) = lumels.footprint(gatherer.world, i);
        gatherer.gather_more(&footprint, seed, &received[i], 1, times, tape)
    })?;
    for ((i, times), again) in short.into_iter().zip(more) {
        received[i] = again;
        all[i] = times;
    }
    Ok(all)
}
