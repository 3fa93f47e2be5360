//! The least of a quadratic function within bounds, by an interior-point method.
//!
//! ½ xᵀA x − bᵀx, low ≤ x ≤ high, for four channels at once: all have the same A. Bounds are what makes stitching hard: where they are met in one
//! place, others must make up for it. Fixing what meets them, and never letting go, left 3 % of Sponza's seams apart that need not be; letting go goes
//! round in circles. This takes some fifteen factors of A, however many bounds are met and however much weights differ.
//!
//! Based on: Mehrotra, *On the implementation of a primal-dual interior point method*, 1992.

use glam::{BVec4, DVec4};

use crate::seams::factor::{Factor, Pattern};

/// What the function may be above its least, as a share of it: changes are then within a few per cent of what is best, a fraction of noise.
const GAP: f64 = 1e-2;

/// It stops here in any case. Scenes measured took at most 20.
const MOST_ITERATIONS: u64 = 60;

/// Share of the way to the nearest bound that a step may go.
const NEARLY: f64 = 0.995;

/// Where pushes could not be brought below this share of what they are, what was seen on the way says nothing about what lies beyond: used all the
/// same, it led one island of Sponza round in circles.
const ASTRAY: f64 = 0.7;

/// What pushes aim at then, as a share of what they are.
const CALM: f64 = 0.5;

/// What is pulled by nothing ends where bound and matrix push alike; together, such texels give way more easily than each by itself, which is what one can
/// see: some hundred times, at hold's least against even changes (0.02 to 2).
const FAINT: f64 = 100.0;

/// Share of its range that a value keeps from both bounds at first.
const INSIDE: f64 = 0.1;

/// Times a fixed value's place on the diagonal what it would be.
const FIXED: f64 = 1e30;

/// A, for all channels.
pub(super) struct Matrix {
    /// Where columns of the triangle below the diagonal begin.
    pub columns: Vec<usize>,
    /// Rows of its entries.
    pub below: Vec<u32>,
    /// And their values.
    pub values: Vec<f64>,
    pub diagonal: Vec<f64>,
    pub pattern: Pattern,
}

/// What a channel wants: b, twice what the function is at 0, and the bounds. Equal ones fix a value at 0.
pub(super) struct Wanted {
    pub right: Vec<DVec4>,
    pub energy: DVec4,
    pub low: Vec<DVec4>,
    pub high: Vec<DVec4>,
}

impl Matrix {
    /// A x.
    pub(super) fn multiply(&self, x: &[DVec4], out: &mut [DVec4]) {
        for ((out, x), d) in out.iter_mut().zip(x).zip(&self.diagonal) {
            *out = x * *d;
        }
        for j in 0..x.len() {
            let mut sum = DVec4::ZERO;
            for e in self.columns[j]..self.columns[j + 1] {
                let i = self.below[e] as usize;
                out[i] += x[j] * self.values[e];
                sum += x[i] * self.values[e];
            }
            out[j] += sum;
        }
    }
}

/// The least, and the number of steps that the slowest channel took.
///
/// Each channel is solved as if it were alone: one that is done stands still.
pub(super) fn least(matrix: &Matrix, wanted: &Wanted) -> (Vec<DVec4>, u64) {
    let mut search = Search::new(matrix, wanted);
    let n = matrix.diagonal.len();
    let (mut right, mut first) = (vec![DVec4::ZERO; n], vec![DVec4::ZERO; n]);
    let mut iterations = 0;
    while iterations < MOST_ITERATIONS {
        search.look(wanted);
        if !search.going.any() {
            break;
        }
        iterations += 1;
        search.factor();
        // Where the least would be if pushes could end at once, and what would be left of them on the way there.
        for (right, slope) in right.iter_mut().zip(&search.slope) {
            *right = -slope;
        }
        search.solve(&right, &mut first);
        let share = search.left(&first) / search.mean_push;
        let known = share.cmplt(DVec4::splat(ASTRAY));
        let target = DVec4::select(known, share * share * share, DVec4::splat(CALM));
        let trust = DVec4::select(known, DVec4::ONE, DVec4::ZERO);
        let step = search.step(&first, search.mean_push * target, trust);
        search.go(&step);
    }
    (search.found(wanted), iterations)
}

/// Where the search is.
struct Search<'a> {
    matrix: &'a Matrix,
    factor: Factor,
    /// Values whose bounds lie apart.
    free: Vec<BVec4>,
    /// Number of their bounds.
    count: DVec4,
    range: Vec<DVec4>,
    x: Vec<DVec4>,
    /// How far values are from their lower and upper bounds.
    room: [Vec<DVec4>; 2],
    /// What these push with.
    push: [Vec<DVec4>; 2],
    /// Mean of room times push.
    mean_push: DVec4,
    /// A x − b.
    slope: Vec<DVec4>,
    /// Channels that are not done.
    going: BVec4,
}

/// Where to go, and how far.
struct Step {
    x: Vec<DVec4>,
    push: [Vec<DVec4>; 2],
    far: DVec4,
}

/// Which way room changes with the value.
const SIGN: [f64; 2] = [1.0, -1.0];

impl<'a> Search<'a> {
    fn new(matrix: &'a Matrix, wanted: &Wanted) -> Self {
        let n = matrix.diagonal.len();
        let range: Vec<DVec4> = (0..n).map(|i| wanted.high[i] - wanted.low[i]).collect();
        let free: Vec<BVec4> = range.iter().map(|r| r.cmpgt(DVec4::ZERO)).collect();
        let count = free.iter().map(|&f| one(f)).sum::<DVec4>() * 2.0;
        let count = count.max(DVec4::ONE);
        let mean_push = (wanted.energy / count).max(TINY);
        let x: Vec<DVec4> = (0..n)
            .map(|i| {
                let keep = range[i] * INSIDE;
                let (low, high) = (wanted.low[i] + keep, wanted.high[i] - keep);
                DVec4::select(free[i], DVec4::ZERO.max(low).min(high), DVec4::ZERO)
            })
            .collect();
        // What is fixed is not pushed, and takes no part.
        let room = [0, 1].map(|k| {
            let to = |i: usize| [x[i] - wanted.low[i], wanted.high[i] - x[i]][k];
            let room = |i: usize| DVec4::select(free[i], to(i), DVec4::ONE);
            (0..n).map(room).collect::<Vec<_>>()
        });
        let push = [0, 1].map(|k| {
            let push = |i: usize| DVec4::select(free[i], mean_push / room[k][i], TINY);
            (0..n).map(push).collect()
        });
        Search {
            matrix,
            factor: matrix.pattern.room(),
            free,
            count,
            range,
            x,
            room,
            push,
            mean_push,
            slope: vec![DVec4::ZERO; n],
            going: wanted.energy.cmpgt(DVec4::ZERO),
        }
    }

    /// Finds the slope, and which channels are done.
    fn look(&mut self, wanted: &Wanted) {
        self.matrix.multiply(&self.x, &mut self.slope);
        let mut value = wanted.energy * 0.5;
        // What the least may lie below it: what pushes still do, and what they do not hold.
        let mut above = self.mean_push * self.count;
        for (i, slope) in self.slope.iter_mut().enumerate() {
            value += self.x[i] * (*slope * 0.5 - wanted.right[i]);
            *slope -= wanted.right[i];
            let loose = *slope - self.push[0][i] + self.push[1][i];
            let loose = loose.abs() * self.range[i];
            above += DVec4::select(self.free[i], loose, DVec4::ZERO);
        }
        self.going &= above.cmpgt(value * GAP);
    }

    fn factor(&mut self) {
        let diagonal: Vec<DVec4> = (0..self.x.len())
            .map(|i| {
                let stiff = |k: usize| self.push[k][i] / self.room[k][i];
                let own = self.matrix.diagonal[i];
                let fixed = DVec4::splat(FIXED * own.max(1.0));
                DVec4::select(self.free[i], stiff(0) + stiff(1) + own, fixed)
            })
            .collect();
        let values = &self.matrix.values;
        (self.matrix.pattern).factor(values, &diagonal, &mut self.factor);
    }

    /// Solves, and leaves what is fixed.
    fn solve(&mut self, right: &[DVec4], out: &mut [DVec4]) {
        self.matrix.pattern.solve(&mut self.factor, right, out);
        for (out, &free) in out.iter_mut().zip(&self.free) {
            *out = DVec4::select(free, *out, DVec4::ZERO);
        }
    }

    /// How a push changes that ends when its value moves by this.
    fn ending(&self, k: usize, i: usize, x: DVec4) -> DVec4 {
        -self.push[k][i] * (DVec4::ONE + x * SIGN[k] / self.room[k][i])
    }

    /// Mean of room times push after these steps, as far as they can be gone.
    fn left(&self, first: &[DVec4]) -> DVec4 {
        let mut most = DVec4::ONE;
        for (i, &x) in first.iter().enumerate() {
            let [l, h] = [0, 1].map(|k| x * SIGN[k] / self.room[k][i]);
            most = most.max(-l).max(-h);
            most = most.max(DVec4::ONE + l).max(DVec4::ONE + h);
        }
        let far = most.recip();
        let mut left = DVec4::ZERO;
        for (i, &x) in first.iter().enumerate() {
            for k in [0, 1] {
                let room = self.room[k][i] + far * x * SIGN[k];
                let push = self.push[k][i] + far * self.ending(k, i, x);
                left += room * push * one(self.free[i]);
            }
        }
        left / self.count
    }

    /// The step to where room times push is `target`, less what the `first` says of its square as far as one may `trust` it.
    fn step(&mut self, first: &[DVec4], target: DVec4, trust: DVec4) -> Step {
        let n = first.len();
        let aim = |search: &Self, k: usize, i: usize| {
            let square = first[i] * SIGN[k] * search.ending(k, i, first[i]);
            (target - trust * square) / search.room[k][i]
        };
        let right: Vec<DVec4> = (0..n)
            .map(|i| aim(self, 0, i) - aim(self, 1, i) - self.slope[i])
            .collect();
        let mut x = vec![DVec4::ZERO; n];
        self.solve(&right, &mut x);
        let mut most = DVec4::splat(NEARLY);
        let push = [0, 1].map(|k| {
            (0..n)
                .map(|i| {
                    let change = aim(self, k, i) + self.ending(k, i, x[i]);
                    let slower = (-change / self.push[k][i]).max(-x[i] * SIGN[k] / self.room[k][i]);
                    most = most.max(DVec4::select(self.free[i], slower, DVec4::ZERO));
                    change
                })
                .collect::<Vec<_>>()
        });
        Step {
            x,
            push,
            far: most.recip() * NEARLY,
        }
    }

    fn go(&mut self, step: &Step) {
        let mut sum = DVec4::ZERO;
        for i in 0..self.x.len() {
            let going = self.going & self.free[i];
            let go = |value: &mut DVec4, by: DVec4| {
                *value = DVec4::select(going, *value + step.far * by, *value);
            };
            go(&mut self.x[i], step.x[i]);
            for k in [0, 1] {
                go(&mut self.room[k][i], step.x[i] * SIGN[k]);
                go(&mut self.push[k][i], step.push[k][i]);
                sum += self.room[k][i] * self.push[k][i] * one(self.free[i]);
            }
        }
        self.mean_push = (sum / self.count).max(TINY);
    }

    /// What was found. What a bound pushes harder than the way onto it would push back is put there, which adds to the gap about what it is; and so is
    /// what lies at its lower bound already, unless it has gone far from it: what is black, and pulled by nothing, stays black.
    fn found(&self, wanted: &Wanted) -> Vec<DVec4> {
        (0..self.x.len())
            .map(|i| {
                let held = |k: usize, times: f64| {
                    let way = self.room[k][i] * self.matrix.diagonal[i];
                    way.cmplt(self.push[k][i] * times)
                };
                let x = self.x[i].max(wanted.low[i]).min(wanted.high[i]);
                let black = wanted.low[i].cmpeq(DVec4::ZERO) & held(0, FAINT);
                let x = DVec4::select(held(0, 1.0) | black, wanted.low[i], x);
                let x = DVec4::select(held(1, 1.0), wanted.high[i], x);
                // Light may be no number; and where nothing differs, nothing changes.
                let differs = wanted.energy.cmpgt(DVec4::ZERO);
                let known = self.free[i] & x.is_finite_mask() & differs;
                DVec4::select(known, x, DVec4::ZERO)
            })
            .collect()
    }
}

/// Positive, and nothing beside any number.
const TINY: DVec4 = DVec4::splat(f64::MIN_POSITIVE);

fn one(free: BVec4) -> DVec4 {
    DVec4::select(free, DVec4::ONE, DVec4::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of texels whose neighbours are tied by weights from 1 to 1e6, pulled up and down, in four channels that differ in pulls and bounds.
    fn chain(n: usize) -> (Matrix, Wanted) {
        let mut seed = 7u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        let columns: Vec<usize> = (0..=n).map(|j| j.min(n - 1)).collect();
        let below: Vec<u32> = (1..n as u32).collect();
        let mut diagonal = vec![0.05; n];
        let mut values = Vec::new();
        for j in 0..n - 1 {
            let tie = 10f64.powf(6.0 * random());
            values.push(-tie);
            diagonal[j] += tie;
            diagonal[j + 1] += tie;
        }
        let mut right = vec![DVec4::ZERO; n];
        let mut energy = DVec4::ZERO;
        for (j, tie) in values.iter().enumerate() {
            // What neighbours differ by to begin with.
            let apart = DVec4::new(random(), random() - 0.5, 100.0 * random(), 0.0);
            right[j] -= apart * *tie;
            right[j + 1] += apart * *tie;
            energy -= apart * apart * *tie;
        }
        let mut bound = |i: usize| match i % 5 {
            0 => DVec4::ZERO,
            k => DVec4::new(random(), 10.0, 0.1 * random(), 1.0) * k as f64,
        };
        let low = (0..n).map(|i| -bound(i)).collect();
        let high = (0..n).map(&mut bound).collect();
        let pattern = Pattern::new(n, &columns, &below);
        let matrix = Matrix {
            columns,
            below,
            values,
            diagonal,
            pattern,
        };
        let wanted = Wanted {
            right,
            energy,
            low,
            high,
        };
        (matrix, wanted)
    }

    fn value(matrix: &Matrix, wanted: &Wanted, x: &[DVec4]) -> DVec4 {
        let mut product = vec![DVec4::ZERO; x.len()];
        matrix.multiply(x, &mut product);
        let parts = (0..x.len()).map(|i| x[i] * (product[i] * 0.5 - wanted.right[i]));
        wanted.energy * 0.5 + parts.sum::<DVec4>()
    }

    #[test]
    fn the_least_within_bounds_is_found_however_much_ties_differ() {
        let n = 60;
        let (matrix, wanted) = chain(n);
        let (found, iterations) = least(&matrix, &wanted);
        assert!(iterations < MOST_ITERATIONS, "{iterations}");
        for ((x, low), high) in found.iter().zip(&wanted.low).zip(&wanted.high) {
            assert!((x.cmpge(*low) & x.cmple(*high)).all(), "{low} {x} {high}");
        }
        // Another method, which takes its time: value by value to the best within its bounds.
        let mut slow = vec![DVec4::ZERO; n];
        for _ in 0..400_000 {
            for i in 0..n {
                let mut pull = wanted.right[i];
                if i > 0 {
                    pull -= slow[i - 1] * matrix.values[i - 1];
                }
                if i + 1 < n {
                    pull -= slow[i + 1] * matrix.values[i];
                }
                slow[i] = (pull / matrix.diagonal[i])
                    .max(wanted.low[i])
                    .min(wanted.high[i]);
            }
        }
        let (found, slow) = (
            value(&matrix, &wanted, &found),
            value(&matrix, &wanted, &slow),
        );
        // The gap that is promised, over what is found; and the slow one is within its bounds too, so no better than the least.
        let above = (found - slow).cmple(found * GAP);
        assert!(
            (above | BVec4::new(false, false, false, true)).all(),
            "{found} {slow}"
        );
        assert!(found.truncate().cmplt(wanted.energy.truncate() * 0.5).all());
    }

    #[test]
    fn a_channel_is_solved_as_if_it_were_alone() {
        let (matrix, wanted) = chain(60);
        let (together, _) = least(&matrix, &wanted);
        for c in 0..3 {
            let mut mask = DVec4::ZERO;
            mask[c] = 1.0;
            let only = |list: &[DVec4]| list.iter().map(|v| v * mask).collect();
            let alone = Wanted {
                right: only(&wanted.right),
                energy: wanted.energy * mask,
                low: only(&wanted.low),
                high: only(&wanted.high),
            };
            let (alone, _) = least(&matrix, &alone);
            for (x, y) in alone.iter().zip(&together) {
                assert_eq!(x[c].to_bits(), y[c].to_bits(), "{c}");
            }
        }
    }

    #[test]
    fn light_that_is_no_number_spoils_no_other_channel() {
        let (matrix, mut wanted) = chain(20);
        let (clean, _) = least(&matrix, &wanted);
        wanted.right[3][1] = f64::NAN;
        wanted.energy[1] = f64::INFINITY;
        let (found, _) = least(&matrix, &wanted);
        for (found, clean) in found.iter().zip(&clean) {
            assert!(found.is_finite());
            // Nor does a channel change in which nothing differs.
            assert_eq!(found.w, 0.0);
            assert_eq!((found.x, found.z), (clean.x, clean.z));
        }
    }
}
