//! Pseudo-random numbers.

use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;

/// A stream of numbers: O'Neill, *PCG: A Family of Simple Fast Space-Efficient Statistically Good
/// Algorithms for Random Number Generation*, 2014 (PCG64 XSL-RR).
pub(super) struct Random(Pcg64);

impl Random {
    /// Stream `stream` of `seed`; all streams of all seeds are different sequences.
    pub(super) fn new(seed: u64, stream: u64) -> Random {
        Random(Pcg64::new(u128::from(seed), u128::from(stream)))
    }

    /// Uniform in 0..1, from the top 53 bits.
    pub(super) fn next(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }
}
