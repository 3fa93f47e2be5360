//! Jacobi and Gauss–Seidel: every patch gathers, in turn.

use glam::DVec3;

use super::{Observer, Options, Snapshot, Solution, Stop, System};

/// Each pass measures the residual of the iterate that it starts from and computes the next one.
/// The returned iterate is the last measured one, so the reported residual is its own and not an
/// estimate.
///
/// Jacobi: B'_i = M_i + ρ_i Σ_j F_ij B_j, which is B_i + r_i, so the residual is free. Gauss–Seidel
/// (`SEIDEL`): B'_i = (M_i + ρ_i Σ_{j<i} F_ij B'_j + ρ_i Σ_{j>i} F_ij B_j) / (1 − ρ_i F_ii); its
/// residual also needs Σ_{j<i} F_ij B_j, half a pass more multiply-adds on a row that is in cache.
pub(super) fn gather<const SEIDEL: bool>(
    system: &System<'_>,
    options: &Options,
    mut observe: Observer<'_>,
) -> Solution {
    let n = system.len();
    let (m, rho) = (system.exitance(), system.reflectance());
    let mut now = m.to_vec();
    let mut next = now.clone();
    let mut residual = vec![DVec3::ZERO; n];
    let mut history = Vec::new();
    let pairs = (n as u64) * (n as u64);
    let work_of_a_pass = 3 * if SEIDEL {
        pairs + pairs.saturating_sub(n as u64) / 2
    } else {
        pairs
    };
    // At least one pass, because the history must not be empty.
    let passes = u64::from(options.max_passes.max(1));
    let mut stop = Stop::Passes;
    for pass in 1..=passes {
        for i in 0..n {
            let row = system.matrix().row(i);
            let (before, after) = (&row[..i], &row[i + 1..]);
            let old = dot(before, &now[..i]);
            let rest = dot(after, &now[i + 1..]);
            let own = now[i] * row[i];
            residual[i] = m[i] + rho[i] * (old + own + rest) - now[i];
            next[i] = if SEIDEL {
                let new = dot(before, &next[..i]);
                (m[i] + rho[i] * (new + rest)) / (DVec3::ONE - rho[i] * row[i])
            } else {
                now[i] + residual[i]
            };
        }
        let record = system.record(pass, pass * work_of_a_pass, &residual);
        history.push(record);
        if let Some(observe) = &mut observe {
            observe(Snapshot {
                iteration: pass,
                radiosity: &now,
                residual: &residual,
            });
        }
        if record.left <= options.tolerance {
            stop = Stop::Converged;
            break;
        }
        if !record.left.is_finite() {
            stop = Stop::Diverged;
            break;
        }
        if pass < passes {
            std::mem::swap(&mut now, &mut next);
        }
    }
    Solution {
        radiosity: now,
        residual,
        history,
        memory: 3 * n * size_of::<DVec3>(),
        stop,
    }
}

/// Σ f_j b_j.
fn dot(f: &[f64], b: &[DVec3]) -> DVec3 {
    f.iter().zip(b).map(|(&f, &b)| b * f).sum()
}
