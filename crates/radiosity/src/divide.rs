//! Where trees of lights divide their sets.

/// Number of equal intervals at whose borders a set may be divided.
const INTERVALS: usize = 64;

/// How many of these values the lower part should get: the number of values times the range that
/// they span, summed over both parts, is smallest. What stands apart, like the lamps of another
/// room, is thus parted first, and one node stands for it from afar; a set divided into halves
/// would leave nodes that span the gap. Evenly spread values are halved.
///
/// Each part gets at least a quarter, so the depth of a tree is at most log₄⸝₃ n. O(n).
pub(crate) fn lower_part(values: impl Iterator<Item = f32> + Clone) -> usize {
    let (low, high) = (values.clone())
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
    let scale = INTERVALS as f32 / (high - low).max(f32::MIN_POSITIVE);
    let mut counts = [0usize; INTERVALS];
    let mut all = 0;
    for v in values {
        counts[(((v - low) * scale) as usize).min(INTERVALS - 1)] += 1;
        all += 1;
    }
    let occupied = || (0..INTERVALS).filter(|k| counts[*k] > 0);
    let mut best = (usize::MAX, all / 2);
    let mut below = 0;
    for (end, next) in occupied().zip(occupied().skip(1)) {
        below += counts[end];
        if 4 * below.min(all - below) >= all {
            let cost = below * (end + 1) + (all - below) * (INTERVALS - next);
            best = best.min((cost, below));
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::lower_part;

    #[test]
    fn sets_are_parted_where_they_are_apart_and_otherwise_halved() {
        // Three rooms with 100, 120 and 80 lamps.
        let rooms = [(0.0, 100), (40.0, 120), (80.0, 80)];
        let lamps = rooms.map(|(at, n)| (0..n).map(move |k| at + 10.0 * k as f32 / n as f32));
        assert_eq!(lower_part(lamps.into_iter().flatten()), 100);
        assert_eq!(lower_part((0..640).map(|k| k as f32)), 320);
        // No more than three quarters, and equal values.
        assert_eq!(lower_part((0..100).map(|k| f32::from(k > 9))), 50);
        assert_eq!(lower_part((0..7).map(|_| 2.5)), 3);
    }
}
