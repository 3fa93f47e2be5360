//! Fits values at points so that their interpolation approximates the light.
//!
//! Least squares over the surface: the values c that minimise ∫ (Σ cᵢφᵢ − E)² solve M c = b with
//! Mᵢⱼ = ∫φᵢφⱼ and bᵢ = ∫Eφᵢ (after Kavan, Bargteil & Sloan, *Least Squares Vertex Baking*, 2011).
//! Interpolating bᵢ / ∫φᵢ, the mean of E weighted by φᵢ, would be too flat. On triangles smaller
//! than a few lumels light hardly changes, and deconvolution would only amplify noise; there M is
//! lumped, and the result is that mean.
//!
//! At shadow edges least squares overshoot, even below zero. So each value is limited to the range
//! of E around it: a box-constrained quadratic programme, solved by projected Gauss–Seidel sweeps,
//! which converge for any symmetric positive definite M.

use glam::{DVec3, Vec3};

use super::moments::PAIR;
use super::sheet::Sheet;

/// Most sweeps. A mass matrix has a condition number below ten, so each sweep at least halves the
/// error; 1e-4 takes about fifteen.
const MOST_SWEEPS: usize = 60;

/// Relative to the largest value; small compared with a step of an 8-bit screen.
const TOLERANCE: f64 = 1e-4;

/// The points' values. `gathered` are the means for unmeasured triangles, by point.
pub(super) fn fit(sheet: &Sheet, gathered: &[Vec3]) -> Vec<Vec3> {
    let n = sheet.points;
    let mut system = System {
        diagonal: vec![0.0; n],
        right: vec![DVec3::ZERO; n],
        range: vec![[Vec3::INFINITY, Vec3::NEG_INFINITY]; n],
        starts: Vec::new(),
        entries: Vec::new(),
    };
    let mut entries: Vec<(u32, u32, f64)> = Vec::new();
    for tri in &sheet.tris {
        let points = sheet.points_of(tri);
        let m = &tri.moments;
        for (k, &i) in points.iter().enumerate() {
            if !m.measured() {
                let value = gathered[i];
                let share = tri.area / 3.0;
                system.diagonal[i] += share;
                system.right[i] += value.as_dvec3() * share;
                system.widen(i, [value; 2]);
                continue;
            }
            system.right[i] += m.light[k];
            system.widen(i, m.range);
            for (j, &other) in points.iter().enumerate() {
                let mass = m.mass[PAIR[j][k]];
                // Two corners may be the same point, because vertices may coincide in a triangle
                // that has area.
                if other == i {
                    system.diagonal[i] += mass;
                } else {
                    entries.push((i as u32, other as u32, mass));
                }
            }
        }
    }
    // Stable, so that sums are in the triangles' order.
    entries.sort_by_key(|e| (e.0, e.1));
    system.starts = (0..=n)
        .map(|i| entries.partition_point(|e| (e.0 as usize) < i))
        .collect();
    system.entries = entries.into_iter().map(|(_, j, m)| (j, m)).collect();
    system.solve()
}

struct System {
    diagonal: Vec<f64>,
    right: Vec<DVec3>,
    range: Vec<[Vec3; 2]>,
    /// Start of each row's entries.
    starts: Vec<usize>,
    /// Column and value.
    entries: Vec<(u32, f64)>,
}

impl System {
    fn widen(&mut self, i: usize, [low, high]: [Vec3; 2]) {
        let own = &mut self.range[i];
        *own = [own[0].min(low), own[1].max(high)];
    }

    fn solve(&self) -> Vec<Vec3> {
        let n = self.diagonal.len();
        let clamp = |i: usize, v: DVec3| {
            let [low, high] = self.range[i];
            v.max(low.as_dvec3()).min(high.as_dvec3())
        };
        let row = |i: usize| &self.entries[self.starts[i]..self.starts[i + 1]];
        // Starts from the means.
        let mut x: Vec<DVec3> = (0..n)
            .map(|i| {
                let whole = self.diagonal[i] + row(i).iter().map(|e| e.1).sum::<f64>();
                if whole > 0.0 {
                    clamp(i, self.right[i] / whole)
                } else {
                    DVec3::ZERO
                }
            })
            .collect();
        for _ in 0..MOST_SWEEPS {
            let (mut change, mut largest) = (0.0f64, 0.0f64);
            for i in 0..n {
                if self.diagonal[i] <= 0.0 {
                    continue;
                }
                let others: DVec3 = (row(i).iter()).map(|&(j, m)| x[j as usize] * m).sum();
                let new = clamp(i, (self.right[i] - others) / self.diagonal[i]);
                change = change.max((new - x[i]).abs().max_element());
                largest = largest.max(new.max_element());
                x[i] = new;
            }
            if change <= TOLERANCE * largest {
                break;
            }
        }
        x.into_iter().map(|v| v.as_vec3()).collect()
    }
}
