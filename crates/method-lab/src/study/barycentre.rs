//! Centre-to-centre form factors, and the errors of their rows.

use std::f64::consts::PI;

use glam::DVec3;

use crate::enclosure::{Matrix, Patch};

/// F_ij = cos θ_i cos θ_j A_j / (π r²) between centres, if both face each other and `visible` is
/// true; n × n.
///
/// Exact in the limit of distant patches. Adjacent patches get too much: two unit squares with a
/// common edge at a right angle get 1/π instead of 0.200044. Reciprocal (A_i F_ij = A_j F_ji), F_ii
/// = 0; row sums are not corrected. Source: Goral et al., 1984, eq. 5, with its integrand at one
/// point instead of the integral.
pub fn barycentre_matrix(
    patches: &[Patch],
    mut visible: impl FnMut(DVec3, DVec3) -> bool,
) -> Matrix {
    let centre: Vec<DVec3> = patches.iter().map(Patch::centre).collect();
    let normal: Vec<DVec3> = patches.iter().map(Patch::normal).collect();
    let area: Vec<f64> = patches.iter().map(Patch::area).collect();
    let mut m = Matrix::zeros(patches.len());
    for i in 0..patches.len() {
        for j in i + 1..patches.len() {
            let d = centre[j] - centre[i];
            // cos θ · r on both sides; their product over r⁴ is the kernel.
            let (ci, cj) = (normal[i].dot(d), -normal[j].dot(d));
            if ci > 0.0 && cj > 0.0 && visible(centre[i], centre[j]) {
                let r2 = d.length_squared();
                let kernel = ci * cj / (PI * r2 * r2);
                m.row_mut(i)[j] = kernel * area[j];
                m.row_mut(j)[i] = kernel * area[i];
            }
        }
    }
    m
}

/// Σ_j F_ij over a matrix. In a closed room each should be 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowSums {
    /// Smallest.
    pub min: f64,
    /// Mean, by area.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// Row sums of `matrix`; `area` in m². None if there is no row or the lengths differ.
pub fn row_sums(matrix: &Matrix, area: &[f64]) -> Option<RowSums> {
    if matrix.is_empty() || area.len() != matrix.len() {
        return None;
    }
    let mut out = RowSums {
        min: f64::INFINITY,
        mean: 0.0,
        max: 0.0,
    };
    for (i, a) in area.iter().enumerate() {
        let sum: f64 = matrix.row(i).iter().sum();
        out.min = out.min.min(sum);
        out.max = out.max.max(sum);
        out.mean += a * sum;
    }
    out.mean /= area.iter().sum::<f64>();
    Some(out)
}

/// Largest eigenvalue λ of F, by `steps` steps of power iteration from a uniform start: over many
/// bounces light is multiplied by λρ each time instead of ρ, and if λρ ≥ 1 it grows without limit.
/// A lower bound, close after about thirty steps (F is similar to a symmetric matrix, of which this
/// is the Rayleigh quotient).
pub fn largest_eigenvalue(matrix: &Matrix, area: &[f64], steps: u32) -> f64 {
    let n = matrix.len().min(area.len());
    let mut b = vec![1.0; n];
    let mut value = 0.0;
    for _ in 0..steps {
        let next: Vec<f64> = (0..n)
            .map(|i| matrix.row(i).iter().zip(&b).map(|(f, b)| f * b).sum())
            .collect();
        // Σ A b (Fb) / Σ A b².
        let (mut top, mut bottom, mut size) = (0.0, 0.0, 0.0f64);
        for i in 0..n {
            top += area[i] * b[i] * next[i];
            bottom += area[i] * b[i] * b[i];
            size = size.max(next[i]);
        }
        if !(size > 0.0 && bottom > 0.0) {
            return 0.0;
        }
        value = top / bottom;
        b = next.iter().map(|x| x / size).collect();
    }
    value
}
