//! Solves the discrete radiosity equation `E = s + F (ρ E)` on given links.
//!
//! Based on: Cohen, Greenberg, *The hemi-cube*, 1985 (gathering by Gauss–Seidel); van der Vorst,
//! *Bi-CGSTAB*, 1992, for high reflectance. Shooting (Cohen, Chen, Wallace, Greenberg, 1988) needs
//! the transposed matrix and one thread.

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::links::Links;
use crate::monitor::Monitor;

/// The highest reflectance that the error bound uses: above it, 1/(1 − ρ) would classify every
/// solve as unfinished.
const HIGHEST: f64 = 0.9999;

/// Blocks of a sweep. More of them converge sooner, fewer keep more threads busy.
const BLOCKS: usize = 16;

/// Most iterations of Bi-CGSTAB. A reflectance of 0.999 takes some dozens.
const MOST_ITERATIONS: u32 = 500;

/// When relaxation stops.
#[derive(Debug, Clone, Copy)]
pub struct RelaxOptions {
    /// Maximum share of the light that may be left undistributed.
    pub tolerance: f64,
    /// Sweeps over all patches, after which Bi-CGSTAB takes over.
    pub sweeps: u32,
}

impl Default for RelaxOptions {
    fn default() -> Self {
        RelaxOptions {
            tolerance: 1e-4,
            sweeps: 8,
        }
    }
}

/// State of a relaxation after a sweep or an iteration of Bi-CGSTAB.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct RelaxStep {
    /// Number of sweeps so far.
    pub sweeps: u32,
    /// Number of iterations so far.
    pub iterations: u32,
    /// [`RelaxReport::residual`] at that point.
    pub residual: f64,
    /// Indirect flux received by patches so far, in W (lm), as the sum of R, G and B.
    pub flux: f64,
}

/// Result of a relaxation.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct RelaxReport {
    /// Number of Gauss–Seidel sweeps.
    pub sweeps: u32,
    /// Number of Bi-CGSTAB iterations.
    pub iterations: u32,
    /// Upper bound on the undistributed light as a share of all arriving light. It includes four
    /// standard errors of the rays' noise in reciprocity, so about one solve in 16,000 may leave
    /// more. Reflectances above 0.9999 count as 0.9999; if such surfaces enclose a scene, their
    /// light is unbounded.
    pub residual: f64,
    /// Whether `residual` is within the tolerance.
    pub converged: bool,
    /// The steps of this relaxation; [`crate::SolveReport::history`] has those of all passes.
    #[serde(skip)]
    pub steps: Vec<RelaxStep>,
}

impl RelaxReport {
    /// Combines two solves of the same system, one after the other.
    pub(crate) fn and(&self, other: &RelaxReport) -> RelaxReport {
        RelaxReport {
            sweeps: self.sweeps + other.sweeps,
            iterations: self.iterations + other.iterations,
            // Each residual is a share of its own light. As a share of all light, it does not
            // exceed the larger of the two.
            residual: self.residual.max(other.residual),
            converged: self.converged && other.converged,
            steps: self.steps.iter().chain(&other.steps).copied().collect(),
        }
    }

    /// Records a step with `flux` so far at `residual`.
    fn step(&mut self, residual: f64, flux: f64) {
        self.steps.push(RelaxStep {
            sweeps: self.sweeps,
            iterations: self.iterations,
            residual,
            flux,
        });
    }
}

/// The equation.
pub(crate) struct System<'l> {
    pub links: &'l Links,
    /// ρ per patch.
    pub reflectance: &'l [DVec3],
    /// m² per patch.
    pub area: &'l [f64],
    /// s: irradiance per patch that does not depend on E.
    pub source: &'l [DVec3],
}

impl System<'_> {
    fn len(&self) -> usize {
        self.area.len()
    }

    /// `s·scale + F (ρ x) − x·minus`, row by row, so that any number of threads gives the same
    /// bits.
    fn apply(&self, x: &[DVec3], scale: f64, minus: f64) -> Vec<DVec3> {
        let radiosity: Vec<DVec3> = x
            .iter()
            .zip(self.reflectance)
            .map(|(e, r)| *e * *r)
            .collect();
        (0..self.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|i| {
                let gathered = self.links.gather(i, &radiosity);
                self.source[i] * scale + gathered - x[i] * minus
            })
            .collect()
    }

    /// Upper bound on the remaining light, as a share of all light.
    ///
    /// A residual r leaves Σ A e = Aᵀ(I − Fρ)⁻¹ r of irradiated flux. If Aᵀ F = Aᵀ (reciprocity in
    /// a closed scene; less in an open one), this would be at most Σ A|r| / (1 − ρ). Rays satisfy
    /// it up to noise. With d = AᵀF − Aᵀ, the noise adds ρ/(1 − ρ) Σ d_j e_j. Each d_j has a
    /// variance of A_j Ā/rays, because a column is a count of rays, each worth Ā/rays, where Ā is
    /// the area-weighted mean patch area. Since Σ d_j = 0, only the uneven part of e matters, which
    /// is about |r|. Four standard errors of this term are added.
    ///
    /// All light is `x` minus the excess that negative residuals indicate: an iterate of Bi-CGSTAB
    /// was observed to be 1.5 times the solution.
    fn bound(&self, r: &[DVec3], x: &[DVec3]) -> f64 {
        let (mut left, mut excess, mut all) = (0f64, 0f64, DVec3::ZERO);
        let (mut most, mut uneven, mut area, mut squares) = (0f64, 0f64, 0f64, 0f64);
        for i in 0..self.len() {
            let (a, w) = (self.area[i], r[i].abs().element_sum());
            left += w * a;
            excess -= r[i].min(DVec3::ZERO).element_sum() * a;
            uneven += w * w * a;
            area += a;
            squares += a * a;
            all += x[i].abs().max(self.source[i]) * a;
            most = most.max(self.reflectance[i].max_element());
        }
        if left == 0.0 {
            return 0.0;
        }
        let most = most.min(HIGHEST);
        let rays = self.links.count() as f64 / self.len() as f64;
        let mean = squares / area.max(1e-300) / rays.max(1.0);
        let noise = 4.0 * most * (uneven * mean).sqrt();
        let has = all.element_sum();
        let all = (has - excess / (1.0 - most)).max(1e-3 * has);
        (left + noise) / (1.0 - most) / all.max(1e-300)
    }

    /// Flux that arrives with irradiance `x`, in all channels.
    fn flux(&self, x: &[DVec3]) -> f64 {
        let received = x.iter().zip(self.area).map(|(e, a)| e.element_sum() * a);
        received.sum()
    }

    /// Improves `x` in place. It is usable whenever this function returns.
    pub(crate) fn relax(
        &self,
        x: &mut Vec<DVec3>,
        options: &RelaxOptions,
        monitor: &dyn Monitor,
    ) -> RelaxReport {
        let mut report = RelaxReport::default();
        let residual = self.apply(x, 1.0, 1.0);
        report.residual = self.bound(&residual, x);
        report.step(report.residual, self.flux(x));
        monitor.residual(report.residual);
        if report.residual > options.tolerance && !monitor.cancelled() {
            self.gauss_seidel(x, options, monitor, &mut report);
        }
        if report.residual > options.tolerance && !monitor.cancelled() {
            self.bicgstab(x, options, monitor, &mut report);
        }
        // The reported residual is recomputed, not updated.
        let residual = self.apply(x, 1.0, 1.0);
        report.residual = self.bound(&residual, x);
        report.converged = report.residual <= options.tolerance;
        report
    }

    /// Gauss–Seidel by blocks of patches: each block gathers the newest light of all others.
    ///
    /// With δ the change of a patch in a sweep, the residual is at most F ρ |δ|, so that ρ δ bounds
    /// it as the residual itself would.
    fn gauss_seidel(
        &self,
        x: &mut [DVec3],
        options: &RelaxOptions,
        monitor: &dyn Monitor,
        report: &mut RelaxReport,
    ) {
        let n = self.len();
        let reflected = |(e, r): (&DVec3, &DVec3)| *e * *r;
        let mut radiosity: Vec<DVec3> = x.iter().zip(self.reflectance).map(reflected).collect();
        let mut change = vec![DVec3::ZERO; n];
        for _ in 0..options.sweeps {
            if monitor.cancelled() {
                break;
            }
            for first in (0..n).step_by(n.div_ceil(BLOCKS).max(1)) {
                let block = first..(first + n.div_ceil(BLOCKS)).min(n);
                let gathered: Vec<DVec3> = (block.clone().into_par_iter())
                    .with_min_len(64)
                    .map(|i| self.source[i] + self.links.gather(i, &radiosity))
                    .collect();
                for (i, e) in block.zip(gathered) {
                    change[i] = (e - x[i]) * self.reflectance[i];
                    x[i] = e;
                    radiosity[i] = e * self.reflectance[i];
                }
            }
            report.sweeps += 1;
            report.residual = self.bound(&change, x);
            report.step(report.residual, self.flux(x));
            monitor.residual(report.residual);
            if report.residual <= 0.5 * options.tolerance {
                break;
            }
        }
    }

    /// Bi-CGSTAB on `(I − Fρ) E = s`, with separate scalars for each of the three channels.
    fn bicgstab(
        &self,
        x: &mut Vec<DVec3>,
        options: &RelaxOptions,
        monitor: &dyn Monitor,
        report: &mut RelaxReport,
    ) {
        // With scale 0 and minus 1, apply returns F ρ v − v.
        let operator = |v: &[DVec3]| -> Vec<DVec3> {
            self.apply(v, 0.0, 1.0).into_iter().map(|y| -y).collect()
        };
        let dot =
            |a: &[DVec3], b: &[DVec3]| -> DVec3 { a.iter().zip(b).map(|(p, q)| *p * *q).sum() };
        // A channel that has converged has vanishing denominators; its scalars become 0 and it
        // stays unchanged.
        let ratio = |a: DVec3, b: DVec3| -> DVec3 {
            let f = |p: f64, q: f64| if q.abs() > 1e-290 { p / q } else { 0.0 };
            DVec3::new(f(a.x, b.x), f(a.y, b.y), f(a.z, b.z))
        };
        let mut r = self.apply(x, 1.0, 1.0);
        let shadow = r.clone();
        let (mut rho, mut alpha, mut omega) = (DVec3::ONE, DVec3::ONE, DVec3::ONE);
        let mut v = vec![DVec3::ZERO; self.len()];
        let mut p = vec![DVec3::ZERO; self.len()];
        let mut best = x.clone();
        let mut best_bound = report.residual;
        for _ in 0..MOST_ITERATIONS {
            if monitor.cancelled() {
                break;
            }
            let rho_next = dot(&shadow, &r);
            let beta = ratio(rho_next, rho) * ratio(alpha, omega);
            rho = rho_next;
            for i in 0..p.len() {
                p[i] = r[i] + beta * (p[i] - omega * v[i]);
            }
            v = operator(&p);
            alpha = ratio(rho, dot(&shadow, &v));
            let s: Vec<DVec3> = r.iter().zip(&v).map(|(a, b)| *a - alpha * *b).collect();
            let t = operator(&s);
            omega = ratio(dot(&t, &s), dot(&t, &t));
            for i in 0..p.len() {
                x[i] += alpha * p[i] + omega * s[i];
                r[i] = s[i] - omega * t[i];
            }
            report.iterations += 1;
            let bound = self.bound(&r, x);
            monitor.residual(bound);
            if !bound.is_finite() {
                break;
            }
            report.step(bound, self.flux(x));
            if bound < best_bound {
                best_bound = bound;
                best.copy_from_slice(x);
            }
            if bound <= 0.5 * options.tolerance {
                break;
            }
        }
        *x = best;
    }
}

#[cfg(test)]
mod tests;
