//! Parallel gathering of footprints.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use radiosity::{Cancelled, Monitor, Phase};
use rayon::prelude::*;

use crate::received::Received;

/// Footprints gathered between two checks for cancellation.
const BLOCK: usize = 64;

/// Computes `0..n` in parallel blocks, in order, and asks the monitor between blocks.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn in_blocks(
    n: usize,
    phase: Phase,
    monitor: &dyn Monitor,
    gather: impl Fn(usize) -> Received + Sync,
) -> Result<Vec<Received>, Cancelled> {
    part_in_blocks(0..n, n, phase, monitor, gather)
}

/// As [`in_blocks`], for some of the `n`.
///
/// # Errors
/// [`Cancelled`] if the monitor asks for it.
pub(crate) fn part_in_blocks(
    part: Range<usize>,
    n: usize,
    phase: Phase,
    monitor: &dyn Monitor,
    gather: impl Fn(usize) -> Received + Sync,
) -> Result<Vec<Received>, Cancelled> {
    let mut received = Vec::new();
    received.resize_with(part.len(), Received::default);
    let done = AtomicU64::new(0);
    let before = part.start as u64;
    let blocks = received.par_chunks_mut(BLOCK).enumerate();
    blocks.for_each(|(b, out)| {
        if monitor.cancelled() {
            return;
        }
        for (k, r) in out.iter_mut().enumerate() {
            *r = gather(part.start + b * BLOCK + k);
        }
        let now = done.fetch_add(out.len() as u64, Ordering::Relaxed) + out.len() as u64;
        monitor.progress(phase, before + now, n as u64);
    });
    if done.load(Ordering::Relaxed) < part.len() as u64 {
        return Err(Cancelled);
    }
    Ok(received)
}
