//! Gathers again at lumels, decided by the results of their neighbours.
//!
//! A lumel's own first rays cannot judge how many more it needs: one that missed a small bright
//! window appears dark and certain. Gathering more only where something was seen loses light
//! (between plates ten sides apart, three quarters of it). So neighbours decide.

use radiosity::{Cancelled, luminance};
use rayon::prelude::*;

use crate::certainty::FLOOR;
use crate::gatherer::Gatherer;
use crate::map::LumelMap;
use crate::received::Edge;
use crate::window::Window;
use crate::work::{Pass, Work};

/// Lumels are noisy if their standard error exceeds [`GatherOptions::error`] by this factor: a third
/// of it is left after smoothing, which at `preview` is a cloud with 6 % more or less light than its
/// surroundings, e.g. deep in a cave, where few rays find its mouth.
///
/// [`GatherOptions::error`]: crate::GatherOptions::error
const NOISY: f32 = 6.0;

/// Most times the first rays at noisy lumels.
const NOISY_TIMES: u32 = 8;

/// Computes direct light again at lumels next to one that a shadow edge crosses, with more points
/// for the lights of that edge: it continues, and may cut off less of a lumel than one of the first
/// points represents.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn follow_edges(
    gatherer: &Gatherer,
    map: &mut LumelMap,
    work: &Work,
) -> Result<(), Cancelled> {
    for round in 0..gatherer.options.follow {
        let beside: Vec<(usize, u32)> = (0..map.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| (i, look_again(map, i)))
            .filter(|(_, lights)| *lights != 0)
            .collect();
        if beside.is_empty() {
            break;
        }
        work.gather(map, Pass::Edges(round), &beside, |map, i, lights| {
            let (footprint, seed) = map.footprint(gatherer.world(), i);
            gatherer.refine_direct(&footprint, seed, &map.received[i], lights)
        })?;
    }
    Ok(())
}

/// Lights whose shadow edge crosses a neighbour of lumel `i`, or runs between it and the lumel, and
/// was not yet looked for.
fn look_again(map: &LumelMap, i: usize) -> u32 {
    let own = &map.received[i];
    // Buried lumels and those at contacts were already sampled densely.
    if own.edge == Edge::Contact || own.open == 0.0 {
        return 0;
    }
    let lights = (-1..=1)
        .flat_map(|dy| (-1..=1).map(move |dx| [dx, dy]))
        .filter_map(|way| map.beside(i, way))
        .map(|j| {
            let other = &map.received[j];
            // One light's shadow may end in a lumel where another's was found.
            other.mixed | (own.lit & other.hidden) | (own.hidden & other.lit)
        })
        .fold(0, |all, lights| all | lights);
    lights & !(own.mixed | own.looked)
}

/// Factor on a lumel's rays, given the variance of what the first ones found, the light that errors
/// are relative to, and `dim` more of it for the noisy. `most` is the usual limit. A power of two,
/// which keeps the points of the sequence well distributed.
fn times(variance: f32, [error, light, dim]: [f32; 3], most: u32) -> u32 {
    let within = |error: f32, most: u32| {
        let ratio = variance / (error * error).max(1e-30);
        let times = (ratio.clamp(1.0, most as f32).ceil() as u32).next_power_of_two();
        if times > most { times / 2 } else { times }
    };
    match most {
        1 => 1,
        _ => within(error * light, most).max(within(NOISY * error * (light + dim), NOISY_TIMES)),
    }
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
    let dim = FLOOR * gatherer.tracer.mean();
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
            let relative = [options.error, total / others, dim];
            let times = times(variance / others, relative, most);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The factor at this noise, relative to light of 2.
    fn factor(noise: f32, dim: f32, most: u32) -> u32 {
        times((2.0 * noise).powi(2), [0.03, 2.0, dim], most)
    }

    #[test]
    fn noisy_lumels_get_more_rays_than_others() {
        // Up to √2 times six times the wanted error: as many as the preset allows.
        let usual = [0.029, 0.031, 0.1, 0.25].map(|noise| factor(noise, 0.0, 2));
        assert_eq!(usual, [1, 2, 2, 2]);
        // Beyond, until the error is six times the wanted one, within eight times the rays.
        let noisy = [0.26, 0.35, 0.37, 10.0].map(|noise| factor(noise, 0.0, 2));
        assert_eq!(noisy, [4, 4, 8, 8]);
        // Never fewer than the preset allows.
        assert_eq!(factor(10.0, 0.0, 16), 16);
        // In the dark the usual number.
        assert_eq!(factor(1.0, 100.0, 2), 2);
        // Bakes to an error choose by themselves.
        assert_eq!(factor(10.0, 0.0, 1), 1);
    }
}
