//! Weighted least-squares fit of a polynomial to a window of lumels.

use crate::window::{Neighbour, SIDE};

/// Unknowns of a quadratic in two variables.
const TERMS: usize = 6;

/// Unknowns of a plane.
const PLANE: usize = 3;

/// The weight of each neighbour in the value, at the lumel, of the polynomial fitted with these
/// weights; they sum to 1. It is a quadratic, or a plane if there are few neighbours. Terms that
/// they cannot tell from others are left out: along a strip one lumel wide those across it.
pub(crate) fn shares_of_fit(
    around: &[Neighbour],
    weigh: impl Fn(usize) -> f32,
) -> Option<[f32; SIDE * SIDE]> {
    let terms = match around.len() >= 2 * TERMS {
        true => TERMS,
        false => PLANE,
    };
    let mut rows = [([0f64; TERMS], 0f64); SIDE * SIDE];
    let mut matrix = [[0f64; TERMS]; TERMS];
    for (k, &(_, dx, dy)) in around.iter().enumerate() {
        let w = f64::from(weigh(k));
        let (x, y) = (dx as f64, dy as f64);
        let row = [1.0, x, y, x * x, x * y, y * y];
        for a in 0..terms {
            for b in 0..=a {
                matrix[a][b] += w * row[a] * row[b];
            }
        }
        rows[k] = (row, w);
    }
    // The value at the lumel is the first unknown, so its weights are the first row of the inverse
    // times the rows.
    let first = first_of_inverse(matrix)?;
    let mut shares = [0f32; SIDE * SIDE];
    for (share, (row, w)) in shares.iter_mut().zip(&rows[..around.len()]) {
        let dot: f64 = row.iter().zip(&first).map(|(a, b)| a * b).sum();
        *share = (dot * w) as f32;
    }
    Some(shares)
}

/// First row of the inverse of a symmetric matrix, given by its lower triangle, by Cholesky
/// factorisation. Columns that depend on previous ones are left out, and have 0 in the row. `None`
/// if the first is 0.
fn first_of_inverse(mut m: [[f64; TERMS]; TERMS]) -> Option<[f64; TERMS]> {
    let dot = |a: &[f64; TERMS], b: &[f64; TERMS], n: usize| -> f64 {
        a[..n].iter().zip(&b[..n]).map(|(x, y)| x * y).sum()
    };
    for c in 0..TERMS {
        let scale = m[c][c];
        let pivot = scale - dot(&m[c], &m[c], c);
        // A column that depends on the previous ones except for a millionth adds noise but no
        // information.
        if pivot <= 1e-6 * scale || scale <= 0.0 {
            if c == 0 {
                return None;
            }
            m[c][..c].fill(0.0);
            m[c + 1..].iter_mut().for_each(|row| row[c] = 0.0);
            m[c][c] = 1.0;
            continue;
        }
        let root = pivot.sqrt();
        m[c][c] = root;
        for r in c + 1..TERMS {
            m[r][c] = (m[r][c] - dot(&m[r], &m[c], c)) / root;
        }
    }
    let mut x = [0.0; TERMS];
    x[0] = 1.0;
    for r in 0..TERMS {
        for k in 0..r {
            x[r] -= m[r][k] * x[k];
        }
        x[r] /= m[r][r];
    }
    for r in (0..TERMS).rev() {
        for k in r + 1..TERMS {
            x[r] -= m[k][r] * x[k];
        }
        x[r] /= m[r][r];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_one() {
        // A Hilbert-like matrix plus the identity: symmetric, positive definite, far from diagonal.
        let at = |r: usize, c: usize| 1.0 / (1 + r + c) as f64 + f64::from(u8::from(r == c));
        let mut m = [[0.0; TERMS]; TERMS];
        for (r, row) in m.iter_mut().enumerate() {
            for (c, x) in row.iter_mut().enumerate().take(r + 1) {
                *x = at(r, c);
            }
        }
        let x = first_of_inverse(m).expect("regular");
        for r in 0..TERMS {
            let dot: f64 = (0..TERMS).map(|c| at(r, c) * x[c]).sum();
            // Condition number below 10: a few ulp.
            assert!((dot - f64::from(u8::from(r == 0))).abs() < 1e-14, "{dot}");
        }
        assert_eq!(
            first_of_inverse([[1.0; TERMS]; TERMS]),
            Some([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            "columns equal to the first are left out"
        );
        assert_eq!(first_of_inverse([[0.0; TERMS]; TERMS]), None);
    }

    #[test]
    fn a_strip_is_fitted_along_its_length() {
        let row: Vec<Neighbour> = (-6..=6).map(|x| (0, x, 0)).collect();
        let shares = shares_of_fit(&row, |_| 1.0).expect("regular");
        let fitted = |light: &dyn Fn(f32) -> f32| -> f32 {
            row.iter()
                .zip(shares)
                .map(|(n, w)| w * light(n.1 as f32))
                .sum()
        };
        // Rounding of thirteen shares.
        assert!((fitted(&|_| 1.0) - 1.0).abs() < 1e-5);
        assert!((fitted(&|x| 2.0 + x + x * x) - 2.0).abs() < 1e-4);
        // A quadratic through 13 points leaves 25/143 of the variance at the middle.
        let left: f32 = shares.iter().map(|s| s * s).sum();
        assert!((left - 25.0 / 143.0).abs() < 1e-5, "{left}");
    }
}
