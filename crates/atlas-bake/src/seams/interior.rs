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

/// Share of its range that a value keeps from both bounds at first.
const INSIDE: f64 = 0.1;

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

/// How far values are from their bounds, and what these push with.
#[derive(Clone, Copy)]
struct Bounded {
    /// From the lower and the upper bound.
    room: [DVec4; 2],
    push: [DVec4; 2],
}

impl Bounded {
    /// How pushes change when the value moves by `x`, so that room times push becomes `target` less what the predictor said of its square.
    fn change(&self, x: DVec4, target: DVec4, predicted: DVec4, by: [DVec4; 2]) -> [DVec4; 2] {
        let sign = [1.0, -1.0];
        [0, 1].map(|k| {
            (target - predicted * by[k] * sign[k] - x * self.push[k] * sign[k]) / self.room[k]
                - self.push[k]
        })
    }
}

/// The least, and the number of steps that the slowest channel took.
///
/// Each channel is solved as if it were alone: one that is done stands still.
pub(super) fn least(matrix: &Matrix, wanted: &Wanted) -> (Vec<DVec4>, u64) {
    let n = matrix.diagonal.len();
    let tiny = DVec4::splat(f64::MIN_POSITIVE);
    let (low, high) = (&wanted.low, &wanted.high);
    let range = |i: usize| high[i] - low[i];
    let free: Vec<BVec4> = (0..n).map(|i| range(i).cmpgt(DVec4::ZERO)).collect();
    let one = |free: BVec4| DVec4::select(free, DVec4::ONE, DVec4::ZERO);
    let count = free.iter().map(|&f| one(f)).sum::<DVec4>() * 2.0;
    let mut mean_push = (wanted.energy / count.max(DVec4::ONE)).max(tiny);
    let mut x: Vec<DVec4> = (0..n)
        .map(|i| {
            let keep = range(i) * INSIDE;
            let inside = DVec4::ZERO.max(low[i] + keep).min(high[i] - keep);
            DVec4::select(free[i], inside, DVec4::ZERO)
        })
        .collect();
    let mut bounded: Vec<Bounded> = (0..n)
        .map(|i| {
            // What is fixed is not pushed, and takes no part below.
            let room =
                [x[i] - low[i], high[i] - x[i]].map(|r| DVec4::select(free[i], r, DVec4::ONE));
            let push = room.map(|r| DVec4::select(free[i], mean_push / r, tiny));
            Bounded { room, push }
        })
        .collect();
    let mut factor = matrix.pattern.room();
    let (mut slope, mut right) = (vec![DVec4::ZERO; n], vec![DVec4::ZERO; n]);
    let (mut first, mut step) = (vec![DVec4::ZERO; n], vec![DVec4::ZERO; n]);
    let mut going = wanted.energy.cmpgt(DVec4::ZERO);
    let mut iterations = 0;
    while iterations < MOST_ITERATIONS {
        matrix.multiply(&x, &mut slope);
        let mut value = wanted.energy * 0.5;
        // What the least may lie below it: what pushes still do, and what they do not hold.
        let mut above = mean_push * count;
        for i in 0..n {
            value += x[i] * (slope[i] * 0.5 - wanted.right[i]);
            slope[i] -= wanted.right[i];
            let [low, high] = bounded[i].push;
            let loose = (slope[i] - low + high).abs() * range(i);
            above += DVec4::select(free[i], loose, DVec4::ZERO);
        }
        going &= above.cmpgt(value * GAP);
        if !going.any() {
            break;
        }
        iterations += 1;
        let diagonal: Vec<DVec4> = (0..n)
            .map(|i| {
                let Bounded { room, push } = bounded[i];
                let own = DVec4::splat(matrix.diagonal[i]) + push[0] / room[0] + push[1] / room[1];
                DVec4::select(
                    free[i],
                    own,
                    DVec4::splat(FIXED * matrix.diagonal[i].max(1.0)),
                )
            })
            .collect();
        matrix
            .pattern
            .factor(&matrix.values, &diagonal, &mut factor);
        // Where the least would be if pushes could end at once.
        for (right, slope) in right.iter_mut().zip(&slope) {
            *right = -slope;
        }
        solve_free(matrix, &mut factor, &free, &right, &mut first);
        let none = [DVec4::ZERO; 2];
        let mut most = DVec4::ONE;
        for (b, &d) in bounded.iter().zip(&first) {
            let [l, h] = [d / b.room[0], d / b.room[1]];
            most = most.max(-l).max(h).max(DVec4::ONE + l).max(DVec4::ONE - h);
        }
        let far = most.recip();
        let mut left = DVec4::ZERO;
        for ((b, &d), &free) in bounded.iter().zip(&first).zip(&free) {
            let by = b.change(d, DVec4::ZERO, DVec4::ZERO, none);
            let sum = (b.room[0] + far * d) * (b.push[0] + far * by[0])
                + (b.room[1] - far * d) * (b.push[1] + far * by[1]);
            left += sum * one(free);
        }
        // The less is left of pushes then, the less of them to aim at now.
        let share = left / count.max(DVec4::ONE) / mean_push;
        let target = mean_push * share * share * share;
        for i in 0..n {
            let (b, d) = (&bounded[i], first[i]);
            let by = b.change(d, DVec4::ZERO, DVec4::ZERO, none);
            right[i] =
                (target - d * by[0]) / b.room[0] - (target + d * by[1]) / b.room[1] - slope[i];
        }
        solve_free(matrix, &mut factor, &free, &right, &mut step);
        let mut most = DVec4::splat(NEARLY);
        let mut changes = Vec::with_capacity(n);
        for i in 0..n {
            let (b, d) = (&bounded[i], step[i]);
            let by = b.change(first[i], DVec4::ZERO, DVec4::ZERO, none);
            let by = b.change(d, target, first[i], by);
            most = most.max(-d / b.room[0]).max(d / b.room[1]);
            let slower = (-by[0] / b.push[0]).max(-by[1] / b.push[1]);
            most = most.max(DVec4::select(free[i], slower, DVec4::ZERO));
            changes.push(by);
        }
        let far = DVec4::select(going, most.recip() * NEARLY, DVec4::ZERO);
        mean_push = DVec4::ZERO;
        for i in 0..n {
            let b = &mut bounded[i];
            let go =
                |value: DVec4, by: DVec4| DVec4::select(going & free[i], value + far * by, value);
            x[i] = go(x[i], step[i]);
            b.room = [go(b.room[0], step[i]), go(b.room[1], -step[i])];
            b.push = [go(b.push[0], changes[i][0]), go(b.push[1], changes[i][1])];
            mean_push += (b.room[0] * b.push[0] + b.room[1] * b.push[1]) * one(free[i]);
        }
        mean_push = (mean_push / count.max(DVec4::ONE)).max(tiny);
    }
    for i in 0..n {
        let c = DVec4::select(free[i], x[i].max(low[i]).min(high[i]), DVec4::ZERO);
        // Light may be no number.
        x[i] = DVec4::select(c.is_finite_mask(), c, DVec4::ZERO);
    }
    (x, iterations)
}

/// Times a fixed value's place on the diagonal what it would be.
const FIXED: f64 = 1e30;

/// Solves, and leaves what is fixed.
fn solve_free(
    matrix: &Matrix,
    factor: &mut Factor,
    free: &[BVec4],
    right: &[DVec4],
    out: &mut [DVec4],
) {
    matrix.pattern.solve(factor, right, out);
    for (out, &free) in out.iter_mut().zip(free) {
        *out = DVec4::select(free, *out, DVec4::ZERO);
    }
}
