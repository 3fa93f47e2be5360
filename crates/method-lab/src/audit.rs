//! Quality measures of a form-factor matrix, with and without a reference.

use crate::{Enclosure, Matrix};

/// Quality measures of a form-factor matrix by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Audit {
    /// Largest |Σ_j F_ij − 1| over the rows i: in a closed enclosure, the fraction of a patch's
    /// power that is gained or lost.
    pub row_sum_error: f64,
    /// Largest |A_i F_ij − A_j F_ji| over all pairs, relative to the largest A_i F_ij.
    pub reciprocity_error: f64,
    /// Largest |F_ii|; a flat patch does not see itself.
    pub self_factor: f64,
}

/// Distance of a matrix from the reference F*.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatrixError {
    /// ‖F − F*‖ / ‖F*‖ over all entries (Frobenius): the RMS error relative to the RMS form factor.
    pub rms: f64,
    /// Largest |F_ij − F*_ij| / F*_ij over the pairs with F*_ij ≥ 0.1/n, where n is the number of
    /// patches. Smaller ones together make up less than a tenth of a row, and the relative error of
    /// an almost hidden pair says nothing.
    pub max: f64,
}

/// Checks rows, reciprocity and diagonal. `matrix` is that of `enclosure`, of the same size.
pub fn audit(enclosure: &Enclosure, matrix: &Matrix) -> Audit {
    let areas: Vec<f64> = enclosure.patches.iter().map(|p| p.area()).collect();
    let n = matrix.len().min(areas.len());
    let mut audit = Audit {
        row_sum_error: 0.0,
        reciprocity_error: 0.0,
        self_factor: 0.0,
    };
    let mut largest = 0f64;
    for i in 0..n {
        let row = matrix.row(i);
        let sum: f64 = row.iter().sum();
        audit.row_sum_error = audit.row_sum_error.max((sum - 1.0).abs());
        audit.self_factor = audit.self_factor.max(row[i].abs());
        for j in 0..n {
            let (there, back) = (areas[i] * row[j], areas[j] * matrix.row(j)[i]);
            audit.reciprocity_error = audit.reciprocity_error.max((there - back).abs());
            largest = largest.max(there.abs());
        }
    }
    if largest > 0.0 {
        audit.reciprocity_error /= largest;
    }
    audit
}

/// The error of `matrix` against `reference`, of the same size.
pub fn compare(matrix: &Matrix, reference: &Matrix) -> MatrixError {
    let n = matrix.len().min(reference.len());
    let floor = 0.1 / n.max(1) as f64;
    let (mut difference, mut norm, mut max) = (0.0, 0.0, 0f64);
    for i in 0..n {
        for (f, r) in matrix.row(i).iter().zip(reference.row(i)) {
            difference += (f - r).powi(2);
            norm += r * r;
            if *r >= floor {
                max = max.max((f - r).abs() / r);
            }
        }
    }
    MatrixError {
        rms: if norm > 0.0 {
            (difference / norm).sqrt()
        } else {
            difference.sqrt()
        },
        max,
    }
}
