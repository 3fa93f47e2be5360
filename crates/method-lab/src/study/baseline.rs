//! Two further habits of the baseline: a fixed number of gathers, and blending at vertices.

use std::collections::BTreeMap;

use glam::DVec3;

use super::room::{Room, Surface};
use crate::enclosure::{Enclosure, Matrix};

/// B after each of `times` gathers (ascending), W/m²: B⁰ = M, Bᵏ⁺¹_i = M_i + ρ_i Σ_j F_ij Bᵏ_j.
/// There is no estimate of its distance from the solution; [`crate::solver`] has one.
///
/// `matrix` must have a row for each patch of `enclosure`; rows beyond the shorter of both are
/// ignored.
pub fn gather_times(matrix: &Matrix, enclosure: &Enclosure, times: &[u32]) -> Vec<Vec<DVec3>> {
    let patches = &enclosure.patches;
    let n = matrix.len().min(patches.len());
    let mut b: Vec<DVec3> = patches.iter().map(|p| p.exitance).collect();
    let mut out = Vec::new();
    let mut done = 0;
    for &until in times {
        while done < until {
            b = (0..n)
                .map(|i| {
                    let gathered: DVec3 = matrix.row(i).iter().zip(&b).map(|(&f, &b)| b * f).sum();
                    patches[i].exitance + patches[i].reflectance * gathered
                })
                .collect();
            done += 1;
        }
        out.push(b.clone());
    }
    out
}

/// Radiosity at the four corners of every patch, in the order of its corners, W/m²: the mean over
/// the patches of the same surface, plane and light that meet there. To be interpolated bilinearly
/// over the patch (Gouraud, 1971).
///
/// A lamp's edge stays sharp, and colours do not bleed around an edge of the room.
pub fn vertex_radiosity(
    room: &Room,
    enclosure: &Enclosure,
    radiosity: &[DVec3],
) -> Vec<[DVec3; 4]> {
    // Coordinates are sums of a few hundredths of a metre; rounding to a micrometre separates
    // vertices and removes rounding.
    let grid = |p: DVec3| [p.x, p.y, p.z].map(|x| (x * 1e6).round() as i64);
    type Key = (Surface, [i64; 3], [i64; 3], [u64; 3]);
    let key = |i: usize, corner: usize| -> Key {
        let p = &room.patches[i];
        let light = enclosure.patches[i].exitance.to_array();
        (
            p.surface,
            grid(p.normal),
            grid(p.corners[corner]),
            light.map(f64::to_bits),
        )
    };
    let n = room
        .patches
        .len()
        .min(enclosure.patches.len())
        .min(radiosity.len());
    let mut sums: BTreeMap<Key, (DVec3, f64)> = BTreeMap::new();
    for (i, b) in radiosity.iter().enumerate().take(n) {
        for corner in 0..4 {
            let sum = sums.entry(key(i, corner)).or_default();
            sum.0 += *b;
            sum.1 += 1.0;
        }
    }
    (0..n)
        .map(|i| {
            std::array::from_fn(|corner| {
                let (sum, count) = sums[&key(i, corner)];
                sum / count
            })
        })
        .collect()
}
