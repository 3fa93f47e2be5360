//! Weighted least-squares fit of a quadratic to a window of lumels.

use crate::window::{Neighbour, SIDE};

/// Unknowns of a quadratic in two variables.
pub(crate) const TERMS: usize = 6;

/// The weight of each neighbour in the value, at the lumel, of the quadratic fitted with these
/// weights; they sum to 1.
pub(crate) fn shares_of_fit(
    around: &[Neighbour],
    weigh: impl Fn(usize) -> f32,
) -> Option<[f32; SIDE * SIDE]> {
    let mut rows = [([0f64; TERMS], 0f64); SIDE * SIDE];
    let mut matrix = [[0f64; TERMS]; TERMS];
    for (k, &(_, dx, dy)) in around.iter().enumerate() {
        let w = f64::from(weigh(k));
        let (x, y) = (dx as f64, dy as f64);
        let row = [1.0, x, y, x * x, x * y, y * y];
        for a in 0..TERMS {
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

/// First row of the inverse of a symmetric positive definite matrix, given by its lower triangle, by
/// Cholesky factorisation. `None` if it is nearly singular
/// (too few neighbours, or all in a line).
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
            return None;
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
        assert!(
            first_of_inverse([[1.0; TERMS]; TERMS]).is_none(),
            "singular"
        );
    }
}
