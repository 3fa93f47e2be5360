//! Gathers again at lumels, decided by the results of their neighbours.
//!
//! A lumel's own first rays cannot judge how many more it needs: one that missed a small bright
//! window appears dark and certain. Gathering more only where something was seen loses light
//! (between plates ten sides apart, three quarters of it). So neighbours decide.

use radiosity::{Cancelled, luminance};
use rayon::prelude::*;

use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::received::{Edge, Received};
use crate::window::Window;
use crate::work::{Pass, Work};

/// Gathers again at apparently whole lumels next to one that an edge crosses: the edge continues,
/// and may cut off less of them than one of their first points represents.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn follow_edges(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    work: &Work,
) -> Result<(), Cancelled> {
    // If edges get no more points than other footprints, there is nothing to gain.
    let options = &gatherer.options;
    let contacts = options.contacts && options.edge_points > options.points;
    for round in 0..options.follow {
        let beside: Vec<(usize, Look)> = (0..map.len())
            .into_par_iter()
            .with_min_len(1024)
            .filter_map(|i| {
                let look = look_again(map, i);
                let contact = look.contact && contacts && round == 0;
                (contact || look.lights != 0).then_some((i, Look { contact, ..look }))
            })
            .collect();
        if beside.is_empty() {
            break;
        }
        work.gather(map, Pass::Edges(round), &beside, |map, i, look| {
            let (footprint, seed) = map.footprint(gatherer.world(), i);
            let first = &map.received[i];
            if !look.contact {
                return gatherer.refine_direct(&footprint, seed, first, look.lights);
            }
            let again = gatherer.gather_edge(&footprint, seed);
            Received {
                // For the smoothing; the many points know it better.
                open: first.open.min(again.open),
                rays: first.rays + again.rays,
                ..again
            }
        })?;
    }
    Ok(())
}

/// Why a lumel is gathered again.
#[derive(Clone, Copy, Default)]
struct Look {
    /// Whether something touches its neighbour.
    contact: bool,
    /// Lights whose shadow edge crosses a neighbour, or runs between it and the lumel.
    lights: u32,
}

fn look_again(map: &LumelMap, i: usize) -> Look {
    let own = &map.received[i];
    // Buried lumels and those at contacts were already sampled densely.
    if own.edge == Edge::Contact || own.open == 0.0 {
        return Look::default();
    }
    let mut look = Look::default();
    for way in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy])) {
        let Some(j) = map.beside(i, way) else {
            continue;
        };
        let other = &map.received[j];
        look.contact |= other.edge == Edge::Contact;
        // One light's shadow may end in a lumel where another's was found.
        look.lights |= other.mixed | (own.lit & other.hidden) | (own.hidden & other.lit);
    }
    look.lights &= !(own.mixed | own.looked);
    look
}

/// Casts more gathering rays where neighbours show that the first were too few for
/// [`GatherOptions::error`](crate::GatherOptions::error).
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn add_rays(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    work: &Work,
) -> Result<(), Cancelled> {
    let options = &gatherer.options;
    let most = (options.most_rays / options.rays.max(1)).max(1);
    if gatherer.world().is_dark() || (most == 1 && map.plan.most_bearing() == 1) {
        return Ok(());
    }
    let window = Window::new(map);
    let received = &map.received;
    let short: Vec<(usize, u32)> = (0..map.len())
        .into_par_iter()
        .with_min_len(256)
        .filter_map(|i| {
            let needless = map.plan.is(i) || map.plan.is_calm(i);
            if received[i].edge == Edge::Contact || received[i].open < 1.0 || needless {
                return None; // It already has many, or its rays do not matter.
            }
            let (around, n) = window.around(i);
            let (mut variance, mut total, mut others) = (0f32, 0f32, 0f32);
            for &(j, ..) in around[..n].iter().filter(|a| a.0 != i) {
                let r = &received[j];
                variance += r.indirect_variance;
                total += luminance(r.light());
                others += 1.0;
            }
            if others == 0.0 {
                variance = received[i].indirect_variance;
                total = luminance(received[i].light());
                others = 1.0;
            }
            let wanted = options.error * total / others;
            let ratio = variance / others / (wanted * wanted).max(1e-30);
            // Powers of two keep the points of the sequence well distributed.
            let times = (ratio.clamp(1.0, most as f32).ceil() as u32).next_power_of_two();
            let times = if times > most { times / 2 } else { times };
            let times = times.max(map.plan.bearing(i));
            (times > 1).then_some((i, times))
        })
        .collect();
    for &(i, times) in &short {
        map.times[i] = times;
    }
    work.gather(map, Pass::More, &short, |map, i, times| {
        let (footprint, seed) = map.footprint(gatherer.world(), i);
        gatherer.gather_more(&footprint, seed, &map.received[i], (1, times))
    })
}
