//! Minimises a quadratic function within bounds, with a fixed number of steps.
//!
//! Every step moves all texels down their gradient, clamps them, and adds momentum. A step costs
//! one pass over the matrix, whatever the equations are. No texel waits for another, so the result
//! has the same bits for any number of threads. Large weights, i.e. differences between lookups,
//! converge first, so stopping early costs little visible quality. An earlier interior-point method
//! on sparse factors found the exact minimum, but for one level its factors took more memory and
//! time than the whole rest of the bake.
//!
//! Based on: Beck, Teboulle, *A fast iterative shrinkage-thresholding algorithm for linear inverse
//! problems*, 2009 (with one step length per unknown, and bounds for the shrinkage).

use glam::Vec4;
use rayon::prelude::*;

use crate::seams::matrix::{Matrix, TOGETHER};

/// Number of steps. 99 % of seams then differ by less than 0.7 % in all measured scenes but Sponza
/// in direct sun (1.9 %). 100 steps leave 1.5 times this difference, 400 two thirds of it.
pub(super) const STEPS: u32 = 200;

/// Approximately minimises ½ xᵀA x − `right`ᵀx within bounds, starting at x = 0, for four
/// independent channels.
///
/// Bounds must contain 0. The result is within them, and 0 instead of NaN.
pub(super) fn least(matrix: &Matrix, right: &[Vec4], [low, high]: &[Vec<Vec4>; 2]) -> Vec<Vec4> {
    let steps = matrix.steps();
    let mut x = vec![Vec4::ZERO; right.len()];
    let mut before = x.clone();
    // The extrapolated position.
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

    /// A chain of texels whose neighbours are tied by weights from 1 to 1e4 and pulled apart. The
    /// four channels have different pulls and bounds.
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
        // A slow reference method: minimises each value in turn within its bounds.
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
            // A channel without pull does not change.
            assert_eq!(found.w, 0.0);
            assert_eq!((found.x, found.z), (clean.x, clean.z));
        }
    }
}
