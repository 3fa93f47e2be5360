//! Solving the discrete radiosity equation `E = s + F (ρ E)` on given links.
//!
//! Based on: Southwell, *Relaxation methods*, 1940; Cohen, Chen, Wallace, Greenberg, *A progressive
//! refinement approach to fast radiosity image generation*, 1988 (shooting the largest unshot flux
//! is Southwell's relaxation of this equation: Gortler, Cohen, Slusallek, *Radiosity and relaxation
//! methods*, 1994); van der Vorst, *Bi-CGSTAB*, 1992, for high reflectance.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::links::Links;
use crate::monitor::Monitor;

/// The highest reflectance that the bound believes: beyond, 1/(1 − ρ) would call any solve
/// unfinished.
const HIGHEST: f64 = 0.9999;

/// When relaxation stops.
#[derive(Debug, Clone, Copy)]
pub struct RelaxOptions {
    /// Largest share of the light that may be left undistributed.
    pub tolerance: f64,
    /// Shots per patch after which the rest is left to Bi-CGSTAB. Shooting removes about a factor ρ
    /// a sweep, on one thread; from ρ ≈ 0.8 on the Krylov method, which does not care, is faster
    /// (measured on the furnace, and on white rooms of 60,000 patches).
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

/// Where a relaxation stood after a round of shots or an iteration of Bi-CGSTAB.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct RelaxStep {
    /// Shots so far.
    pub shots: u64,
    /// Iterations so far.
    pub iterations: u32,
    /// [`RelaxReport::residual`] at that time.
    pub residual: f64,
    /// Indirect flux that has arrived at patches by then, W (lm), sum of R, G, B.
    pub flux: f64,
}

/// How relaxation went.
#[derive(Debug, Clone, Default, Serialize)]
pub struct RelaxReport {
    /// Patches that shot (one patch may shoot often).
    pub shots: u64,
    /// Bi-CGSTAB iterations.
    pub iterations: u32,
    /// Upper bound on the light still to be distributed, as a share of all light that arrives: with
    /// four standard errors of the rays' noise in reciprocity, so that one solve in some 16,000 may
    /// leave more. Reflectances above 0.9999 count as that; where such surfaces close a scene in,
    /// nothing bounds their light.
    pub residual: f64,
    /// `residual` is within the tolerance.
    pub converged: bool,
    /// The way there; [`crate::SolveReport::history`] has those of all passes.
    #[serde(skip)]
    pub steps: Vec<RelaxStep>,
}

impl RelaxReport {
    /// Of two solves of the same system, one after the other.
    pub(crate) fn and(&self, other: &RelaxReport) -> RelaxReport {
        RelaxReport {
            shots: self.shots + other.shots,
            iterations: self.iterations + other.iterations,
            // Each is a share of its own light; of all light it is no more than the larger.
            residual: self.residual.max(other.residual),
            converged: self.converged && other.converged,
            steps: self.steps.iter().chain(&other.steps).copied().collect(),
        }
    }

    /// Notes where the relaxation stands: `flux` so far at `residual`.
    fn step(&mut self, residual: f64, flux: f64) {
        self.steps.push(RelaxStep {
            shots: self.shots,
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
    /// s: irradiance per patch that is not from E itself.
    pub source: &'l [DVec3],
}

impl System<'_> {
    fn len(&self) -> usize {
        self.area.len()
    }

    /// `s·scale + F (ρ x) − x·minus`, row by row (so any number of threads gives the same bits).
    fn apply(&self, x: &[DVec3], scale: f64, minus: f64) -> Vec<DVec3> {
        let radiosity: Vec<DVec3> = x
            .iter()
            .zip(self.reflectance)
            .map(|(e, r)| *e * *r)
            .collect();
        let inverse = 1.0 / self.links.rays.max(1) as f64;
        (0..self.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|i| {
                let sum = self.links.gather(i, &radiosity);
                self.source[i] * scale + sum * inverse - x[i] * minus
            })
            .collect()
    }

    /// Bound on the light left over, as a share of all.
    ///
    /// A residual r leaves Σ A e = Aᵀ(I − Fρ)⁻¹ r of irradiated flux. Were Aᵀ F = Aᵀ (reciprocity
    /// in a closed scene, and less than that in an open one), it would be at most Σ A|r| / (1 − ρ).
    /// Rays keep that up to noise: with d = AᵀF − Aᵀ, ρ/(1 − ρ) Σ d_j e_j comes on top, of which
    /// each d_j has a variance of A_j Ā/rays (a column is a count of rays, each worth Ā/rays, the
    /// area-weighted mean patch) and Σ d_j = 0, so that only the uneven part of e counts, which is
    /// about |r|. Four standard errors of it are added.
    ///
    /// All light is what `x` has, less what negative residuals say that it has too much: an iterate
    /// of Bi-CGSTAB was seen to be half as large again as the answer.
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
        let mean = squares / area.max(1e-300) / self.links.rays.max(1) as f64;
        let noise = 4.0 * most * (uneven * mean).sqrt();
        let has = all.element_sum();
        let all = (has - excess / (1.0 - most)).max(1e-3 * has);
        (left + noise) / (1.0 - most) / all.max(1e-300)
    }

    /// Flux that arrives with irradiance `x`, all channels.
    fn flux(&self, x: &[DVec3]) -> f64 {
        let received = x.iter().zip(self.area).map(|(e, a)| e.element_sum() * a);
        received.sum()
    }

    /// Improves `x`, which is updated in place and usable whenever this returns.
    pub(crate) fn relax(
        &self,
        x: &mut Vec<DVec3>,
        options: &RelaxOptions,
        monitor: &dyn Monitor,
    ) -> RelaxReport {
        let mut report = RelaxReport::default();
        let mut residual = self.apply(x, 1.0, 1.0);
        report.residual = self.bound(&residual, x);
        report.step(report.residual, self.flux(x));
        monitor.residual(report.residual);
        if report.residual > options.tolerance && !monitor.cancelled() {
            self.shoot(x, &mut residual, options, monitor, &mut report);
        }
        if report.residual > options.tolerance && !monitor.cancelled() {
            self.bicgstab(x, options, monitor, &mut report);
        }
        // What is reported was computed anew, not updated.
        let residual = self.apply(x, 1.0, 1.0);
        report.residual = self.bound(&residual, x);
        report.converged = report.residual <= options.tolerance;
        report
    }

    /// Southwell: the patch with the most unshot flux shoots, near enough: every patch above a
    /// falling threshold does, in order.
    fn shoot(
        &self,
        x: &mut [DVec3],
        r: &mut [DVec3],
        options: &RelaxOptions,
        monitor: &dyn Monitor,
        report: &mut RelaxReport,
    ) {
        let n = self.len();
        let (starts, receivers, tints) = self.transpose();
        let inverse = 1.0 / self.links.rays.max(1) as f64;
        let unshot =
            |i: usize, r: &[DVec3]| (r[i] * self.reflectance[i]).abs().element_sum() * self.area[i];
        let budget = options.sweeps as u64 * n as u64;
        let mut threshold = (0..n).map(|i| unshot(i, r)).fold(0.0, f64::max);
        while report.shots < budget && !monitor.cancelled() {
            threshold *= 0.5;
            for j in 0..n {
                if unshot(j, r) < threshold || threshold == 0.0 {
                    continue;
                }
                let shot = r[j];
                x[j] += shot;
                r[j] = DVec3::ZERO;
                let b = shot * self.reflectance[j] * inverse;
                let range = starts[j] as usize..starts[j + 1] as usize;
                if tints.is_empty() {
                    for &i in &receivers[range] {
                        r[i as usize] += b;
                    }
                } else {
                    for k in range {
                        r[receivers[k] as usize] += b * tints[k];
                    }
                }
                report.shots += 1;
            }
            report.residual = self.bound(r, x);
            report.step(report.residual, self.flux(x));
            monitor.residual(report.residual);
            if report.residual <= 0.5 * options.tolerance || threshold == 0.0 {
                break;
            }
        }
    }

    /// For each patch the rows that name it (with repetition), in compressed rows, and what arrives
    /// along each ray; the last is empty where all does.
    fn transpose(&self) -> (Vec<u32>, Vec<u32>, Vec<DVec3>) {
        let n = self.len();
        let mut starts = vec![0u32; n + 1];
        for i in 0..n {
            for &j in self.links.row(i) {
                if (j as usize) < n {
                    starts[j as usize + 1] += 1;
                }
            }
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut fill = starts.clone();
        let mut receivers = vec![0u32; starts[n] as usize];
        let tinted = self.links.tinted();
        let mut tints = vec![DVec3::ONE; if tinted { receivers.len() } else { 0 }];
        for i in 0..n {
            for (k, &j) in self.links.row(i).iter().enumerate() {
                if (j as usize) < n {
                    let at = fill[j as usize] as usize;
                    receivers[at] = i as u32;
                    if tinted {
                        tints[at] = self.links.tint(i, k);
                    }
                    fill[j as usize] += 1;
                }
            }
        }
        (starts, receivers, tints)
    }

    /// Bi-CGSTAB on `(I − Fρ) E = s`, the three channels side by side with scalars of their own.
    fn bicgstab(
        &self,
        x: &mut Vec<DVec3>,
        options: &RelaxOptions,
        monitor: &dyn Monitor,
        report: &mut RelaxReport,
    ) {
        // With scale 0 and minus 1, apply gives F ρ v − v.
        let operator = |v: &[DVec3]| -> Vec<DVec3> {
            self.apply(v, 0.0, 1.0).into_iter().map(|y| -y).collect()
        };
        let dot =
            |a: &[DVec3], b: &[DVec3]| -> DVec3 { a.iter().zip(b).map(|(p, q)| *p * *q).sum() };
        // A channel that is done has vanishing denominators; its scalars become 0 and it stays
        // where it is.
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
        for _ in 0..500 {
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
