//! Parallel gathering of footprints.

use std::sync::atomic::{AtomicU64, Ordering};

use radiosity::{Cancelled, Monitor, Phase};
use rayon::prelude::*;

use crate::received::Received;

/// Footprints gathered between two checks for cancellation.
const BLOCK: usize = 64;

/// Blocks that are gathered one after the other. Single blocks, scattered, take 5 to 9 % longer:
/// what a block's rays leave in the processor's caches is of no use to the next.
const RUN: usize = 64;

/// Footprints of a run.
pub(crate) const IN_RUN: usize = RUN * BLOCK;

/// Computes `0..n` in parallel blocks and asks the monitor between blocks.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn in_blocks(
    n: usize,
    phase: Phase,
    monitor: &dyn Monitor,
    gather: impl Fn(usize) -> Received + Sync,
) -> Result<Vec<Received>, Cancelled> {
    part_in_blocks(n, (0, n), phase, monitor, gather)
}

/// As [`in_blocks`], where `before` of `all` were computed earlier.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn part_in_blocks(
    n: usize,
    (before, all): (usize, usize),
    phase: Phase,
    monitor: &dyn Monitor,
    gather: impl Fn(usize) -> Received + Sync,
) -> Result<Vec<Received>, Cancelled> {
    let mut received = Vec::new();
    received.resize_with(n, Received::default);
    let done = AtomicU64::new(0);
    let blocks = received.chunks_mut(BLOCK).enumerate().collect();
    scattered(blocks).into_par_iter().for_each(|(b, out)| {
        if monitor.cancelled() {
            return;
        }
        for (k, r) in out.iter_mut().enumerate() {
            *r = gather(b * BLOCK + k);
        }
        let now = done.fetch_add(out.len() as u64, Ordering::Relaxed) + out.len() as u64;
        monitor.progress(phase, before as u64 + now, all as u64);
    });
    if done.load(Ordering::Relaxed) < n as u64 {
        return Err(Cancelled);
    }
    Ok(received)
}

/// Numbered blocks in an order in which any part is spread over the whole, so that its pace tells
/// that of the rest: floors can take ten times as long as lumels inside walls. Runs of [`RUN`] stay
/// together, because rays from neighbours meet the same triangles.
fn scattered<T>(mut of: Vec<(usize, T)>) -> Vec<(usize, T)> {
    of.sort_by_key(|(number, _)| (number / RUN).reverse_bits());
    of
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scattering_keeps_all_and_spreads_each_run() {
        for n in [0_usize, 1, 2, 3, 5, 64, 1000, 65_536] {
            let order = scattered((0..n).map(|k| (k, ())).collect());
            let order: Vec<usize> = order.into_iter().map(|(k, ())| k).collect();
            let mut all = order.clone();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..n), "{n}");
            // Of a tenth, no gap is wider than four times the average one, neither to the ends.
            for run in order.chunks(n.div_ceil(10).max(1)).take(9) {
                let mut run = [run, &[0, n]].concat();
                run.sort_unstable();
                let widest = run.windows(2).map(|w| w[1] - w[0]).max();
                assert!(widest.unwrap_or(0) <= 40 * RUN, "{n}: {run:?}");
            }
        }
    }
}
