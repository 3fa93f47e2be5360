//! The least of a quadratic function within bounds, as near as a fixed number of steps comes to it.
//!
//! Every step moves all texels down their own slope, clamps them, and carries on in the direction
//! of the step before. Its work is one pass over the matrix, whatever the equations are, and no
//! texel waits for another: the same bits for any number of threads. Differences between lookups,
//! which pull hardest, go first, so that stopping early costs little of what one sees. An
//! interior-point method on sparse factors, which was here before, found the least itself, but one
//! level's factors took more memory and time than all the rest of its bake together.
//!
//! Based on: Beck, Teboulle, *A fast iterative shrinkage-thresholding algorithm for linear inverse
//! problems*, 2009 (with a step length for each unknown, and bounds for the shrinkage).

use glam::Vec4;
use rayon::prelude::*;

use crate::seams::matrix::{Matrix, TOGETHER};

/// Steps. 99 % of seams then differ by less than 0.7 % in all scenes measured but Sponza in a hard
/// sun (1.9 %); 100 steps leave 1.5 times as much, 400 two thirds (lab/seams.md).
pub(super) const STEPS: u32 = 200;

/// Makes ½ xᵀA x − `right`ᵀx small between bounds, from x = 0, for four channels, each as if it
/// were alone.
///
/// Bounds must hold 0. What comes out lies within them, and is 0 where it would be no number.
pub(super) fn least(matrix: &Matrix, right: &[Vec4], [low, high]: &[Vec<Vec4>; 2]) -> Vec<Vec4> {
    let steps = matrix.steps();
    let mut x = vec![Vec4::ZERO; right.len()];
    let mut before = x.clone();
    // Where x would be had it carried on.
    let mut ahead = x.clone();
    let mut momentum = 1f32;
    for _ in 0..STEPS {
        std::mem::swap(&mut x, &mut before);
        (x.par_iter_mut().enumerate().with_min_len(TOGETHER)).for_each(|(i, x)| {
            let terms = matrix.entries(i).map(|(j, a)| ahead[j] * a);
            let slope = terms.sum::<Vec4>() - right[i];
            *x = (ahead[i] - slope * steps[i]).max(low[i]).min(high[i]);
        });
        let more = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
        let carry = (momentum - 1.0) / more;
        momentum = more;
        let both = x.par_iter().zip(&before);
        (ahead.par_iter_mut().zip(both).with_min_len(TOGETHER))
            .for_each(|(ahead, (x, before))| *ahead = *x + (*x - *before) * carry);
    }
    for x in &mut x {
        *x = Vec4::select(x.is_finite_mask(), *x, Vec4::ZERO);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of texels whose neighbours are tied by weights from 1 to 1e4 and pulled apart, in
    /// four channels that differ in pulls and bounds.
    fn chain(n: usize) -> (Matrix, Vec<Vec4>, [Vec<Vec4>; 2]) {
        let mut seed = 7u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1 << 24) as f32
        };
        let mut right = vec![Vec4::ZERO; n];
        let mut ties = Vec::new();
        for j in 0..n - 1 {
            let tie = 10f32.powf(4.0 * random());
            let apart = Vec4::new(random(), random() - 0.5, 100.0 * random(), 0.0) * tie;
            right[j] -= apart;
            right[j + 1] += apart;
            ties.push((j as u32, j as u32 + 1, tie));
        }
        let mut bound = |i: usize| match i % 5 {
            0 => Vec4::ZERO,
            k => Vec4::new(random(), 10.0, 0.1 * random(), 1.0) * k as f32,
        };
        let low = (0..n).map(|i| -bound(i)).collect();
        let high = (0..n).map(&mut bound).collect();
        (Matrix::new(&[], &vec![0.05; n], &ties), right, [low, high])
    }

    /// ½ xᵀA x − bᵀx.
    fn value(matrix: &Matrix, right: &[Vec4], x: &[Vec4]) -> Vec4 {
        let row = |i: usize| matrix.entries(i).map(|(j, a)| x[j] * a).sum::<Vec4>();
        (0..x.len()).map(|i| x[i] * (row(i) * 0.5 - right[i])).sum()
    }

    #[test]
    fn what_there_is_to_gain_within_bounds_is_gained_however_much_ties_differ() {
        let (matrix, right, bounds) = chain(60);
        let found = least(&matrix, &right, &bounds);
        for ((x, low), high) in found.iter().zip(&bounds[0]).zip(&bounds[1]) {
            assert!((x.cmpge(*low) & x.cmple(*high)).all(), "{low} {x} {high}");
        }
        // Another method, which takes its time: value by value to the best within its bounds.
        let mut slow = vec![Vec4::ZERO; 60];
        for _ in 0..100_000 {
            for i in 0..60 {
                let (mut pull, mut own) = (right[i], 0.0);
                for (j, a) in matrix.entries(i) {
                    if i == j {
                        own = a;
                    } else {
                        pull -= slow[j] * a;
                    }
                }
                slow[i] = (pull / own).max(bounds[0][i]).min(bounds[1][i]);
            }
        }
        let [found, slow] = [found, slow].map(|x| value(&matrix, &right, &x).truncate());
        assert!(slow.cmplt(glam::Vec3::ZERO).all(), "{slow}");
        assert!(found.cmple(slow * 0.99).all(), "{found} {slow}");
    }

    #[test]
    fn light_that_is_no_number_spoils_no_other_channel() {
        let (matrix, mut right, bounds) = chain(20);
        let clean = least(&matrix, &right, &bounds);
        right[3][1] = f32::NAN;
        right[5][1] = f32::INFINITY;
        let found = least(&matrix, &right, &bounds);
        for (found, clean) in found.iter().zip(&clean) {
            assert!(found.is_finite());
            // Nor does a channel change that nothing pulls at.
            assert_eq!(found.w, 0.0);
            assert_eq!((found.x, found.z), (clean.x, clean.z));
        }
    }
}
