//! Southwell's relaxation and progressive radiosity: one patch at a time shoots its light.

use glam::DVec3;

use super::{Observer, Options, Snapshot, Solution, Stop, System};
use crate::enclosure::Matrix;

/// The light that patch i has received but not passed on is r_i. Its relaxation adds s = r_i / (1 −
/// ρ_i F_ii) to B_i and ρ_k F_ki s to every r_k. In exact arithmetic r = M + ρFB − B throughout.
///
/// `PROGRESSIVE` chooses the largest flux A_i Σ_channels |r_i|, derives F_ki from the shooter's row
/// by reciprocity, and counts unshot light as radiosity. Otherwise the largest |r_i| of any channel
/// is chosen and F_ki is read from the columns. The smaller index wins ties. Choosing costs n
/// comparisons per shot, which are not counted as work.
///
/// Before convergence is reported, the residual is recomputed from the matrix. If it is larger than
/// the running one (rounding, rows that are not reciprocal), shooting continues from there, as long
/// as each such audit at least halves it. Shots since the last audit are summed separately:
/// thousands of tiny shots added to a large B one by one would all round, which at ρ = 0.99 leaves
/// a permanent residual of 1e-12.
pub(super) fn shoot<const PROGRESSIVE: bool>(
    system: &System<'_>,
    options: &Options,
    mut observe: Observer<'_>,
) -> Solution {
    let n = system.len();
    let (area, rho) = (system.area(), system.reflectance());
    let per_area: Vec<f64> = area.iter().map(|a| 1.0 / a).collect();
    let columns = if PROGRESSIVE {
        None
    } else {
        Some(transposed(system.matrix()))
    };
    let per_record = match options.shots_per_record {
        0 => n.max(1) as u64,
        k => u64::from(k),
    };
    let budget = u64::from(options.max_passes.max(1)).saturating_mul(n as u64);
    let per_shot = 3 * n as u64;
    let mut sent = vec![DVec3::ZERO; n];
    let mut sent_since = sent.clone();
    let mut unsent = system.exitance().to_vec();
    let mut shown = Vec::new();
    let (mut shots, mut audits) = (0, 0);
    let mut last_audit = f64::INFINITY;
    // After a failed audit, a margin for the next one.
    let mut target = options.tolerance;
    let work =
        |shots: u64, audits: u64| shots * per_shot + audits * per_shot.saturating_mul(n as u64);
    let mut history = vec![system.record(0, 0, &unsent)];
    let stop = loop {
        let (pick, flux) = choose::<PROGRESSIVE>(area, &unsent);
        let left = system.left(flux);
        let out_of_shots = shots >= budget;
        if left <= target || out_of_shots || !left.is_finite() {
            for (b, since) in sent.iter_mut().zip(&mut sent_since) {
                *b += std::mem::take(since);
            }
            unsent = system.residual_of(&sent);
            audits += 1;
            let audit = system.record(shots, work(shots, audits), &unsent);
            history.push(audit);
            if !audit.left.is_finite() {
                break Stop::Diverged;
            }
            if audit.left <= options.tolerance {
                break Stop::Converged;
            }
            if out_of_shots {
                break Stop::Passes;
            }
            if audit.left > 0.5 * last_audit {
                break Stop::Stalled;
            }
            last_audit = audit.left;
            target = 0.5 * options.tolerance;
            continue;
        }
        let row = match &columns {
            Some(t) => t.row(pick),
            None => system.matrix().row(pick),
        };
        let shot = unsent[pick] / (DVec3::ONE - rho[pick] * row[pick]);
        sent_since[pick] += shot;
        for k in 0..n {
            let factor = if PROGRESSIVE {
                row[k] * (area[pick] * per_area[k])
            } else {
                row[k]
            };
            unsent[k] += rho[k] * shot * factor;
        }
        unsent[pick] = DVec3::ZERO;
        shots += 1;
        if shots % per_record == 0 {
            history.push(system.record(shots, work(shots, audits), &unsent));
        }
        if let Some(observe) = &mut observe {
            shown.clear();
            shown.extend(sent.iter().zip(&sent_since).map(|(a, b)| *a + *b));
            if PROGRESSIVE {
                add(&mut shown, &unsent);
            }
            observe(Snapshot {
                iteration: shots,
                radiosity: &shown,
                residual: &unsent,
            });
        }
    };
    // `shown` belongs to the observer and is not counted.
    let memory =
        3 * n * size_of::<DVec3>() + n * size_of::<f64>() + columns.map_or(0, |t| t.bytes());
    if PROGRESSIVE {
        add(&mut sent, &unsent);
    }
    Solution {
        radiosity: sent,
        residual: unsent,
        history,
        memory,
        stop,
    }
}

/// The patch to relax, and Σ A_i|r_i| by channel.
fn choose<const BY_FLUX: bool>(area: &[f64], unsent: &[DVec3]) -> (usize, DVec3) {
    let (mut pick, mut most, mut flux) = (0, -1.0, DVec3::ZERO);
    for (i, (r, &a)) in unsent.iter().zip(area).enumerate() {
        let size = r.abs();
        let merit = if BY_FLUX {
            size.element_sum() * a
        } else {
            size.max_element()
        };
        if merit > most {
            (pick, most) = (i, merit);
        }
        flux += size * a;
    }
    (pick, flux)
}

fn add(to: &mut [DVec3], more: &[DVec3]) {
    for (a, b) in to.iter_mut().zip(more) {
        *a += *b;
    }
}

fn transposed(m: &Matrix) -> Matrix {
    let n = m.len();
    let mut t = Matrix::zeros(n);
    for i in 0..n {
        for (j, &f) in m.row(i).iter().enumerate() {
            t.row_mut(j)[i] = f;
        }
    }
    t
}
