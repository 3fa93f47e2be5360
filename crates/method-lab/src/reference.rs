//! References for the laboratory's methods: closed forms from the catalogue, and a converged matrix
//! for any enclosure.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use crate::form_factor::{
    check_enclosure, cull::Shaft, exchange_contour, form_factor_visible_polygon, gauss_legendre,
    mirror, polygon_nodes,
};
use crate::{Enclosure, FormFactorError, FormFactors, Matrix, Patch};

/// Two equal, aligned, opposed rectangles a × b at distance c (Howell, *A catalog of radiation heat
/// transfer configuration factors*, C-11). X = a/c, Y = b/c:
/// `F = 2/πXY (ln √((1+X²)(1+Y²)/(1+X²+Y²)) + X√(1+Y²) atan(X/√(1+Y²)) + Y√(1+X²) atan(Y/√(1+X²)) − X atan X − Y atan Y)`.
///
/// Exact to about 1e-14 for X and Y from 0.1 up; below, terms cancel and the relative error grows
/// as 1e-16/(XY)².
pub fn opposed_rectangles(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (x2, y2) = (x * x, y * y);
    let (p, q) = ((1.0 + y2).sqrt(), (1.0 + x2).sqrt());
    // (1+X²)(1+Y²)/(1+X²+Y²) = 1 + X²Y²/(1+X²+Y²).
    let log = 0.5 * (x2 * y2 / (1.0 + x2 + y2)).ln_1p();
    2.0 / (PI * x * y)
        * (log + x * p * (x / p).atan() + y * q * (y / q).atan() - x * x.atan() - y * y.atan())
}

/// From a rectangle of depth `width` to one of height `height` at right angles, with a common edge
/// of length `length` (Howell, C-14). W = width/length, H = height/length:
/// `F = 1/πW (W atan(1/W) + H atan(1/H) − √(H²+W²) atan(1/√(H²+W²)) + ¼ ln(((1+W²)(1+H²)/(1+W²+H²)) · (W²(1+W²+H²)/((1+W²)(W²+H²)))^W² · (H²(1+H²+W²)/((1+H²)(H²+W²)))^H²))`.
///
/// Exact to about 1e-12 for W and H from 0.01 to 100.
pub fn perpendicular_rectangles(width: f64, height: f64, length: f64) -> f64 {
    let (w, h) = (width / length, height / length);
    let (w2, h2) = (w * w, h * h);
    let r2 = w2 + h2;
    let r = r2.sqrt();
    // Each ratio as 1 ± something small, for accuracy at large and small aspect ratios:
    // W²(1+R²)/((1+W²)R²) = 1 − H²/((1+W²)R²).
    let log = (w2 * h2 / (1.0 + r2)).ln_1p()
        + w2 * (-h2 / ((1.0 + w2) * r2)).ln_1p()
        + h2 * (-w2 / ((1.0 + h2) * r2)).ln_1p();
    (w * (1.0 / w).atan() + h * (1.0 / h).atan() - r * (1.0 / r).atan() + 0.25 * log) / (PI * w)
}

/// From a disc of radius `r1` to a coaxial one of radius `r2` at distance `h` (Howell, C-41): with
/// R = r/h, S = 1 + (1 + R2²)/R1², `F = ½ (S − √(S² − 4 (r2/r1)²))`.
pub fn coaxial_discs(r1: f64, r2: f64, h: f64) -> f64 {
    let (x, y) = (r1 / h, r2 / h);
    let s = 1.0 + (1.0 + y * y) / (x * x);
    let ratio = 4.0 * (r2 / r1).powi(2);
    // The difference of nearly equal numbers, written as a quotient.
    0.5 * ratio / (s + (s * s - ratio).sqrt())
}

/// Between any two parts of the inside of a sphere of radius `r`: F_ij = A_j / 4πr², independent of
/// i.
pub fn sphere_interior(area: f64, r: f64) -> f64 {
    area / (4.0 * PI * r * r)
}

/// Tolerance of the contour integrals of [`reference_matrix`]: 1e4 times smaller than the error of
/// any studied method.
const CONTOUR: f64 = 1e-10;

/// The converged form factors of an enclosure, including occlusion.
///
/// Unoccluded pairs use the double contour integral to 1e-10. Pairs that may be occluded use
/// `order`² Gauss–Legendre points on the smaller patch, and from each the closed form for the
/// visible part of the other ([`form_factor_visible_polygon`]), so visibility is never sampled.
/// Doubling `order` shows whether it suffices (with 8 instead of 16 the room with a box changes by
/// 1.7e-4 of the RMS form factor).
///
/// Reciprocal to rounding. Errors as [`crate::form_factors`].
pub fn reference_matrix(
    enclosure: &Enclosure,
    order: usize,
) -> Result<FormFactors, FormFactorError> {
    check_enclosure(enclosure)?;
    let patches = &enclosure.patches;
    let n = patches.len();
    let areas: Vec<f64> = patches.iter().map(Patch::area).collect();
    let normals: Vec<DVec3> = patches.iter().map(Patch::normal).collect();
    let rule = gauss_legendre(order);
    let blocking = blocking_patches(enclosure);
    let mut matrix = Matrix::zeros(n);
    matrix
        .values_mut()
        .par_chunks_mut(n.max(1))
        .enumerate()
        .for_each(|(i, row)| {
            for j in i + 1..n {
                // From the smaller patch, whose points are more closely spaced.
                let (s, t) = if areas[i] <= areas[j] { (i, j) } else { (j, i) };
                let Some(shaft) = Shaft::new(&patches[s], &patches[t]) else {
                    continue;
                };
                let between: Vec<&Patch> = blocking
                    .iter()
                    .filter(|k| **k != i && **k != j && shaft.may_cut(&patches[**k]))
                    .map(|k| &patches[*k])
                    .collect();
                row[j] = if between.is_empty() {
                    exchange_contour(&patches[i].corners, &patches[j].corners, CONTOUR)
                } else {
                    polygon_nodes(&patches[s].corners, &rule)
                        .iter()
                        .map(|(x, w)| {
                            w * form_factor_visible_polygon(
                                *x,
                                normals[s],
                                &patches[t].corners,
                                &between,
                            )
                        })
                        .sum()
                };
            }
        });
    mirror(&mut matrix, &areas);
    let bytes = matrix.bytes();
    Ok(FormFactors {
        matrix,
        rays: 0,
        bytes,
    })
}

/// Patches that can hide anything, i.e. those with corners of others on both sides. The walls of a
/// convex room cannot.
fn blocking_patches(enclosure: &Enclosure) -> Vec<usize> {
    let patches = &enclosure.patches;
    let size = patches
        .iter()
        .flat_map(|p| &p.corners)
        .map(|c| c.abs().max_element())
        .fold(0.0, f64::max);
    (0..patches.len())
        .into_par_iter()
        .filter(|&k| {
            let (o, n) = (patches[k].corners[0], patches[k].normal());
            let heights = || {
                patches
                    .iter()
                    .flat_map(|p| &p.corners)
                    .map(|c| (*c - o).dot(n))
            };
            heights().any(|h| h > 1e-12 * size) && heights().any(|h| h < -1e-12 * size)
        })
        .collect()
}
