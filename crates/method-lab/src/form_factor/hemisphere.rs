//! Nusselt's analogue and rays: directions from points of a patch, and what they hit.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};
use radiosity::{hash_u32, sample_4d};

use super::sample::{cells, point_on};
use crate::{Patch, Visibility};

/// Number of samples in one low-discrepancy sequence (`radiosity::sample_4d`).
pub(super) const SEQUENCE: usize = 1 << 16;

/// A right-handed frame whose third axis is `normal` and whose first lies along the patch's first
/// edge.
pub(crate) fn frame(patch: &Patch) -> [DVec3; 3] {
    let n = patch.normal();
    let x = (patch.corners[1] - patch.corners[0]).normalize_or_zero();
    [x, n.cross(x), n]
}

/// One row by Nusselt's analogue: directions are projected from the hemisphere onto the disc below
/// it, and F_ij is the fraction of the disc that patch *j* covers. Adds to `row`; returns the
/// number of rays.
///
/// The disc is scanned at the centres of `resolution` × `resolution` pixels of its bounding square;
/// each finds the first patch in the direction above it. All pixels have the same weight, so the
/// row sums to exactly 1 in a closed enclosure. The outline of each patch is only known to a pixel.
/// This is repeated from `points` × `points` cell centres of the patch.
///
/// Nusselt, *Graphische Bestimmung des Winkelverhältnisses bei der Wärmestrahlung*, 1928. The exact
/// area of the projection is the contour sum of [`super::form_factor_polygon`]; scanning is needed
/// to handle occlusion.
pub fn row_nusselt(
    patches: &[Patch],
    tree: &Visibility,
    i: usize,
    resolution: usize,
    points: usize,
    row: &mut [f64],
) -> u64 {
    let patch = &patches[i];
    let [x, y, z] = frame(patch);
    let mut directions = Vec::new();
    for v in 0..resolution {
        for u in 0..resolution {
            let at = |k: usize| (2 * k + 1) as f64 / resolution as f64 - 1.0;
            let (a, b) = (at(u), at(v));
            let r2 = a * a + b * b;
            if r2 < 1.0 {
                directions.push(x * a + y * b + z * (1.0 - r2).sqrt());
            }
        }
    }
    let area = patch.area();
    let mut rays = 0;
    for cell in cells(&patch.corners, points) {
        let share = cell.area / area / directions.len() as f64;
        for d in &directions {
            rays += 1;
            if let Some(hit) = tree.closest(cell.centre, *d, i)
                && hit.front
            {
                row[hit.patch] += share;
            }
        }
    }
    rays
}

/// One row by `count` rays with density cosθ/π from points distributed over the patch: F_ij is the
/// fraction that hits patch *j*. Adds to `row`; returns the number of rays.
///
/// Points and directions are a four-dimensional Owen-scrambled Sobol sequence, scrambled separately
/// for every patch and every 65,536 rays. Rows sum to exactly 1 in a closed enclosure; reciprocity
/// holds only up to sampling error. The baker computes its links like this (after Malley, *A
/// shading method for computer generated images*, 1988; low-discrepancy points: Keller 1996, Burley
/// 2020).
pub fn row_rays(
    patches: &[Patch],
    tree: &Visibility,
    i: usize,
    count: usize,
    row: &mut [f64],
) -> u64 {
    let patch = &patches[i];
    let [x, y, z] = frame(patch);
    let share = 1.0 / count as f64;
    for k in 0..count {
        let set = (k / SEQUENCE) as u32;
        let seed = hash_u32(i as u32 ^ hash_u32(set));
        let [s, t, u, v] = sample_4d((k % SEQUENCE) as u32, 0, seed).map(f64::from);
        let origin = point_on(&patch.corners, s, t);
        let (sine, azimuth) = (u.sqrt(), TAU * v);
        let d = dvec3(
            sine * azimuth.cos(),
            sine * azimuth.sin(),
            (1.0 - u).max(0.0).sqrt(),
        );
        let direction = x * d.x + y * d.y + z * d.z;
        if let Some(hit) = tree.closest(origin, direction, i)
            && hit.front
        {
            row[hit.patch] += share;
        }
    }
    count as u64
}

/// The visible fraction of the exchange between patches `i` and `j`, by `rays` rays between points
/// distributed over both, and the number of rays. Symmetric in i and j.
///
/// Each ray has the weight of the kernel cosθ cosθ'/r², and the result is a ratio of sums over the
/// same weights (as in the baker's direct light), so fully visible is exactly 1 and fully hidden
/// exactly 0. Equal weights would confuse the mean of a product with the product of means, which is
/// wrong wherever the near part of a patch is hidden, however many rays there are. Points below
/// each other's horizon have weight 0.
pub fn visible_share(
    patches: &[Patch],
    tree: &Visibility,
    i: usize,
    j: usize,
    rays: usize,
) -> (f64, u64) {
    let (i, j) = (i.min(j), i.max(j));
    let (n_i, n_j) = (patches[i].normal(), patches[j].normal());
    let seed = hash_u32(i as u32 ^ hash_u32(j as u32));
    let (mut cast, mut all, mut free) = (0, 0.0, 0.0);
    for k in 0..rays {
        let [s, t, u, v] = sample_4d(k as u32, 0, seed).map(f64::from);
        let a = point_on(&patches[i].corners, s, t);
        let b = point_on(&patches[j].corners, u, v);
        let d = b - a;
        let (c, c1) = (n_i.dot(d), -n_j.dot(d));
        if c > 0.0 && c1 > 0.0 {
            let weight = c * c1 / d.length_squared().powi(2);
            cast += 1;
            all += weight;
            if tree.visible(a, i, b, j) {
                free += weight;
            }
        }
    }
    let share = if all > 0.0 { free / all } else { 0.0 };
    (share, cast)
}
