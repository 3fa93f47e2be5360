//! Makes a matrix closed and reciprocal, for comparing solvers on a system whose solution is
//! physically meaningful.

use super::SystemError;
use crate::enclosure::Matrix;

/// A matrix with row sums 1 and A_i F_ij = A_j F_ji, and the effort to make it.
#[derive(Debug, Clone, PartialEq)]
pub struct Closed {
    /// F_ij = d_i K_ij d_j / A_i with K_ij = (A_i F_ij + A_j F_ji) / 2.
    pub matrix: Matrix,
    /// Iterations.
    pub passes: u32,
    /// Largest remaining |1 − Σ_j F_ij|.
    pub row_error: f64,
    /// Smallest and largest original row sum.
    pub rows_before: [f64; 2],
}

/// Most iterations of the scaling. It converges geometrically for matrices whose patches see many
/// others; a few hundred suffice.
const PASSES: u32 = 2000;

/// Scales `matrix` to row sums 1 within `tolerance` and makes it reciprocal.
///
/// This deliberately changes form factors and is no way to correct them. It finds d > 0 with d_i
/// Σ_j K_ij d_j = A_i by d_i ← √(d_i A_i / Σ_j K_ij d_j). Source: Sinkhorn, *A relationship between
/// arbitrary positive matrices and doubly stochastic matrices*, 1964; the symmetric iteration:
/// Knight, Ruiz, Uçar, *A symmetry preserving algorithm for matrix scaling*, 2014.
///
/// # Errors
/// [`SystemError::Length`] if there is not one area per row; [`SystemError::NotClosable`] if a row
/// sees nothing, or the iteration does not converge (e.g. if one group of patches sees only a
/// smaller group).
pub fn close(matrix: &Matrix, area: &[f64], tolerance: f64) -> Result<Closed, SystemError> {
    let n = matrix.len();
    if area.len() != n {
        return Err(SystemError::Length {
            what: "areas",
            got: area.len(),
            expected: n,
        });
    }
    let mut k = Matrix::zeros(n);
    let mut rows_before = [f64::INFINITY, 0.0f64];
    for i in 0..n {
        let sum: f64 = matrix.row(i).iter().sum();
        rows_before = [rows_before[0].min(sum), rows_before[1].max(sum)];
        for j in 0..n {
            k.row_mut(i)[j] = (area[i] * matrix.row(i)[j] + area[j] * matrix.row(j)[i]) / 2.0;
        }
        let kernel: f64 = k.row(i).iter().sum();
        if !(kernel > 0.0 && kernel.is_finite()) {
            return Err(SystemError::NotClosable {
                patch: i,
                why: "it sees nothing, or its form factors are no numbers",
            });
        }
    }
    let mut d = vec![1.0f64; n];
    let mut worst = 0;
    for passes in 1..=PASSES {
        let sums: Vec<f64> = (0..n)
            .map(|i| k.row(i).iter().zip(&d).map(|(k, d)| k * d).sum::<f64>())
            .collect();
        let mut row_error = 0.0;
        for i in 0..n {
            let error = (1.0 - d[i] * sums[i] / area[i]).abs();
            // Scales that diverge to 0 and infinity become NaN.
            if error > row_error || error.is_nan() {
                (worst, row_error) = (i, error);
            }
        }
        if row_error <= tolerance {
            for i in 0..n {
                let scale = d[i] / area[i];
                for (f, d) in k.row_mut(i).iter_mut().zip(&d) {
                    *f *= scale * d;
                }
            }
            return Ok(Closed {
                matrix: k,
                passes,
                row_error,
                rows_before,
            });
        }
        if row_error.is_nan() {
            break;
        }
        for i in 0..n {
            d[i] = (d[i] * area[i] / sums[i]).sqrt();
        }
    }
    Err(SystemError::NotClosable {
        patch: worst,
        why: "the scaling does not converge",
    })
}
