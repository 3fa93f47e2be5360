//! The solvers against closed forms, a direct solver and each other.

use glam::DVec3;
use method_lab::Matrix;
use method_lab::solver::{
    Method, Options, Solution, Stop, System, SystemError, ambient, close, solve, solve_observed,
    with_ambient,
};

/// Areas within a factor of ten and a closed reciprocal matrix in which every patch sees every
/// other one.
fn random_closed(n: usize, seed: u64) -> (Matrix, Vec<f64>) {
    let mut rng = fastrand::Rng::with_seed(seed);
    let area: Vec<f64> = (0..n).map(|_| 0.1 + 0.9 * rng.f64()).collect();
    let mut m = Matrix::zeros(n);
    for i in 0..n {
        for j in 0..i {
            let k = 0.05 + rng.f64();
            m.row_mut(i)[j] = k / area[i];
            m.row_mut(j)[i] = k / area[j];
        }
    }
    // 1e-14: the scaling arrives within rounding of a sum of n terms.
    (close(&m, &area, 1e-14).unwrap().matrix, area)
}

/// Emitters in a fifth of the patches, each with its own colour; reflectances up to `most`.
fn random_light(n: usize, most: f64, seed: u64) -> (Vec<DVec3>, Vec<DVec3>) {
    let mut rng = fastrand::Rng::with_seed(seed ^ 0x5bd1);
    let mut color = || DVec3::new(rng.f64(), rng.f64(), rng.f64());
    let exitance = (0..n)
        .map(|i| {
            if i % 5 == 0 {
                color() * 100.0
            } else {
                DVec3::ZERO
            }
        })
        .collect();
    let mut reflectance: Vec<DVec3> = (0..n).map(|_| color() * most).collect();
    reflectance[n / 2] = DVec3::splat(most);
    (exitance, reflectance)
}

/// (I − ρF) B = M by Gaussian elimination with partial pivoting, channel by channel.
fn direct(system: &System<'_>) -> Vec<DVec3> {
    let channels: [Vec<f64>; 3] = std::array::from_fn(|c| direct_channel(system, c));
    (0..system.len())
        .map(|i| DVec3::from(std::array::from_fn(|c| channels[c][i])))
        .collect()
}

fn direct_channel(system: &System<'_>, c: usize) -> Vec<f64> {
    let n = system.len();
    let mut rows: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let mut row: Vec<f64> = (0..n)
                .map(|j| f64::from(i == j) - system.reflectance()[i][c] * system.matrix().row(i)[j])
                .collect();
            row.push(system.exitance()[i][c]);
            row
        })
        .collect();
    for k in 0..n {
        let pivot = (k..n)
            .max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs()))
            .unwrap();
        rows.swap(k, pivot);
        let (done, todo) = rows.split_at_mut(k + 1);
        let top = &done[k];
        for row in todo {
            let f = row[k] / top[k];
            for j in k..=n {
                row[j] -= f * top[j];
            }
        }
    }
    let mut out = vec![0.0; n];
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| rows[i][j] * out[j]).sum();
        out[i] = (rows[i][n] - known) / rows[i][i];
    }
    out
}

fn options(tolerance: f64) -> Options {
    Options {
        tolerance,
        ..Options::default()
    }
}

/// The residual cannot be more precise than the rounding of B ≈ mean(M)/(1 − ρ), 1e-16 relative.
/// Sums of about thirty terms round about fifty times, relative to M. Below that, shooting returns
/// [`Stop::Stalled`].
fn reachable(rho: f64) -> f64 {
    1e-13f64.max(5e-15 / (1.0 - rho))
}

fn flux(area: &[f64], a: &[DVec3], b: &[DVec3]) -> DVec3 {
    area.iter()
        .zip(a.iter().zip(b))
        .map(|(&area, (a, b))| (*a - *b).abs() * area)
        .sum()
}

fn max_difference(a: &[DVec3], b: &[DVec3]) -> DVec3 {
    a.iter()
        .zip(b)
        .fold(DVec3::ZERO, |m, (a, b)| m.max((*a - *b).abs()))
}

#[test]
fn all_solvers_reach_the_direct_solution() {
    for (seed, most) in [0.0, 0.3, 0.7, 0.9, 0.99, 0.999].into_iter().enumerate() {
        let (matrix, area) = random_closed(40, seed as u64);
        let (m, rho) = random_light(40, most, seed as u64);
        let system = System::from_parts(&matrix, area.clone(), m.clone(), rho).unwrap();
        let want = direct(&system);
        let emitted: DVec3 = m.iter().zip(&area).map(|(m, &a)| *m * a).sum();
        for method in Method::ALL {
            let got = solve(method, &system, &options(1e-12)).unwrap();
            assert!(got.converged(), "{method:?} at {most}: {:?}", got.stop);
            // In the flux norm ‖(I − ρF)⁻¹‖ ≤ 1/(1 − ρ_max) in a closed reciprocal system; twice
            // that leaves room for rounding.
            let error = flux(&area, &got.radiosity, &want);
            let allowed = emitted * (2e-12 / (1.0 - most));
            assert!(
                error.cmple(allowed).all(),
                "{method:?} at {most}: {error} > {allowed}"
            );
        }
    }
}

#[test]
fn the_furnace_is_uniform() {
    let (matrix, area) = random_closed(30, 7);
    for rho in [0.0, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999] {
        let m = DVec3::new(1.0, 1e-3, 1e6);
        let system = System::from_parts(
            &matrix,
            area.clone(),
            vec![m; 30],
            vec![DVec3::splat(rho); 30],
        )
        .unwrap();
        let want = m / (1.0 - rho);
        for method in Method::ALL {
            let tolerance = reachable(rho);
            let got = solve(method, &system, &options(tolerance)).unwrap();
            assert!(got.converged(), "{method:?} at {rho}: {:?}", got.stop);
            // All of that flux may be on the smallest patch (a tenth of the mean area of 30
            // patches), and it grows by 1/(1 − ρ) as the exact value does, so relative to that the
            // bound is 30 · 10.
            for b in &got.radiosity {
                assert!(
                    ((*b - want) / want).abs().max_element() < 300.0 * tolerance,
                    "{method:?} at {rho}: {b}, expected {want}"
                );
            }
        }
    }
}

/// Inside a sphere F_ij = A_j / ΣA, F_ii too, so every patch receives the mean: B = M + ρ mean(M) /
/// (1 − ρ).
#[test]
fn the_inside_of_a_sphere_has_its_closed_form() {
    let n = 25;
    let mut rng = fastrand::Rng::with_seed(3);
    let area: Vec<f64> = (0..n).map(|_| 0.2 + rng.f64()).collect();
    let total: f64 = area.iter().sum();
    let mut matrix = Matrix::zeros(n);
    for i in 0..n {
        for (f, a) in matrix.row_mut(i).iter_mut().zip(&area) {
            *f = a / total;
        }
    }
    let m: Vec<DVec3> = (0..n)
        .map(|_| DVec3::new(rng.f64(), rng.f64() * 10.0, 0.0))
        .collect();
    let mean = m.iter().zip(&area).map(|(m, &a)| *m * a).sum::<DVec3>() / total;
    for rho in [0.0, 0.1, 0.5, 0.9, 0.999] {
        let system =
            System::from_parts(&matrix, area.clone(), m.clone(), vec![DVec3::splat(rho); n])
                .unwrap();
        for method in Method::ALL {
            let tolerance = reachable(rho);
            let got = solve(method, &system, &options(tolerance)).unwrap();
            assert!(got.converged(), "{method:?} at {rho}: {:?}", got.stop);
            for (b, m) in got.radiosity.iter().zip(&m) {
                let want = *m + rho * mean / (1.0 - rho);
                // As in the furnace: all of it may be on one of 25 patches, which is at most six
                // times smaller than the mean.
                let allowed = mean * (25.0 * 6.0 * tolerance / (1.0 - rho));
                assert!(
                    (*b - want).abs().cmple(allowed).all(),
                    "{method:?} at {rho}"
                );
            }
        }
    }
}

#[test]
fn the_residual_bounds_the_error_after_every_pass_and_shot() {
    for most in [0.3, 0.9, 0.99] {
        let (matrix, area) = random_closed(24, 11);
        let (m, rho) = random_light(24, most, 5);
        let system = System::from_parts(&matrix, area, m, rho).unwrap();
        let want = direct(&system);
        for method in Method::ALL {
            let mut seen = 0;
            let got = solve_observed(method, &system, &options(1e-9), &mut |s| {
                seen += 1;
                let worst = s.residual.iter().fold(DVec3::ZERO, |m, r| m.max(r.abs()));
                let bound = system.error_bound(worst);
                let error = max_difference(s.radiosity, &want);
                // 1e-12 W/m² out of 100 W/m² is the rounding of the direct solution.
                assert!(
                    error.cmple(bound + 1e-12).all(),
                    "{method:?}, iteration {}: error {error}, bound {bound}",
                    s.iteration
                );
            })
            .unwrap();
            assert_eq!(seen, got.last().iteration, "{method:?}");
            let error = max_difference(&got.radiosity, &want);
            assert!(error.cmple(got.last().error_bound + 1e-12).all());
        }
    }
}

#[test]
fn what_is_reported_is_the_residual_of_what_is_returned() {
    let (matrix, area) = random_closed(30, 2);
    let (m, rho) = random_light(30, 0.8, 2);
    let system = System::from_parts(&matrix, area, m, rho).unwrap();
    for method in [Method::Jacobi, Method::GaussSeidel, Method::Southwell] {
        let got = solve(method, &system, &options(1e-6)).unwrap();
        let again = system.residual(&got.radiosity).unwrap();
        // Gauss–Seidel sums each row in two parts. 30 terms of about 100 W/m² round by less than
        // this.
        assert!(max_difference(&again, &got.residual).max_element() < 1e-11);
    }
    // Progressive radiosity returns its unshot radiosity U; the residual of its solution is ρFU.
    let got = solve(Method::Progressive, &system, &options(1e-6)).unwrap();
    let own = system.residual(&got.radiosity).unwrap();
    for (i, own) in own.iter().enumerate() {
        let gathered: DVec3 = (0..30).map(|j| got.residual[j] * matrix.row(i)[j]).sum();
        let expected = system.reflectance()[i] * gathered;
        assert!((*own - expected).abs().max_element() < 1e-11);
    }
}

#[test]
fn every_southwell_step_lowers_error_and_residual_in_the_flux_norm() {
    let (matrix, area) = random_closed(30, 4);
    let (m, rho) = random_light(30, 0.9, 4);
    let system = System::from_parts(&matrix, area.clone(), m, rho).unwrap();
    let want = direct(&system);
    let zero = vec![DVec3::ZERO; 30];
    for method in [Method::Southwell, Method::Progressive] {
        let mut last = [DVec3::INFINITY; 2];
        solve_observed(method, &system, &options(1e-6), &mut |s| {
            let now = [
                flux(&area, s.radiosity, &want),
                flux(&area, s.residual, &zero),
            ];
            for (now, last) in now.iter().zip(&last) {
                // Channels without unshot radiosity do not change, apart from rounding of sums near
                // 1e3.
                assert!(
                    now.cmple(*last + 1e-12).all() && now.element_sum() < last.element_sum(),
                    "{method:?}, shot {}: {now} after {last}",
                    s.iteration
                );
            }
            last = now;
        })
        .unwrap();
    }
}

#[test]
fn the_ambient_term_lowers_the_early_error_of_the_picture() {
    for most in [0.5, 0.9] {
        let n = 60;
        let (matrix, area) = random_closed(n, 9);
        let (m, _) = random_light(n, most, 9);
        let mut rng = fastrand::Rng::with_seed(1);
        let rho: Vec<DVec3> = (0..n)
            .map(|_| DVec3::splat(most * (0.5 + 0.5 * rng.f64())))
            .collect();
        let system = System::from_parts(&matrix, area.clone(), m, rho).unwrap();
        let want = direct(&system);
        let mut ratios = Vec::new();
        solve_observed(Method::Progressive, &system, &options(1e-3), &mut |s| {
            if s.iteration <= n as u64 {
                let plain = flux(&area, s.radiosity, &want).element_sum();
                let shown = with_ambient(&system, s.radiosity, s.residual).unwrap();
                ratios.push(flux(&area, &shown, &want).element_sum() / plain);
            }
        })
        .unwrap();
        assert!(
            ratios.iter().all(|r| *r < 1.0),
            "ρ up to {most}: {ratios:?}"
        );
        // Every patch sees every other one, so the uniform mixture that the term assumes is nearly
        // correct: it removes at least half of the error.
        assert!(ratios[n / 4] < 0.5, "ρ up to {most}: {}", ratios[n / 4]);
    }
}

/// Where all patches see the same mixture, as inside a sphere, the estimate is exact from the
/// start.
#[test]
fn the_ambient_term_is_exact_in_a_uniform_sphere() {
    let n = 8;
    let mut matrix = Matrix::zeros(n);
    matrix.values_mut().fill(1.0 / n as f64);
    let mut m = vec![DVec3::ZERO; n];
    m[0] = DVec3::new(8.0, 4.0, 0.0);
    let rho = vec![DVec3::splat(0.75); n];
    let system = System::from_parts(&matrix, vec![2.0; n], m.clone(), rho).unwrap();
    let shown = with_ambient(&system, &m, &m).unwrap();
    let want = direct(&system);
    assert!(max_difference(&shown, &want).max_element() < 1e-13);
    assert_eq!(ambient(&system, &vec![DVec3::ZERO; n]), Ok(DVec3::ZERO));
    // Nothing is absorbed, so there is no estimate instead of an infinite one.
    let white = System::from_parts(&matrix, vec![2.0; n], m.clone(), vec![DVec3::ONE; n]).unwrap();
    assert_eq!(ambient(&white, &m), Ok(DVec3::ZERO));
}

#[test]
fn the_order_of_patches_does_not_matter() {
    let n = 30;
    let (matrix, area) = random_closed(n, 6);
    let (m, rho) = random_light(n, 0.9, 6);
    let mut order: Vec<usize> = (0..n).collect();
    fastrand::Rng::with_seed(8).shuffle(&mut order);
    let mut moved = Matrix::zeros(n);
    for i in 0..n {
        for j in 0..n {
            moved.row_mut(i)[j] = matrix.row(order[i])[order[j]];
        }
    }
    let pick = |v: &[DVec3]| order.iter().map(|&i| v[i]).collect::<Vec<_>>();
    let moved_area: Vec<f64> = order.iter().map(|&i| area[i]).collect();
    let a = System::from_parts(&matrix, area.clone(), m.clone(), rho.clone()).unwrap();
    let b = System::from_parts(&moved, moved_area.clone(), pick(&m), pick(&rho)).unwrap();
    let emitted: f64 = m.iter().zip(&area).map(|(m, &a)| m.max_element() * a).sum();
    for method in Method::ALL {
        let [x, y] = [&a, &b].map(|s| solve(method, s, &options(1e-10)).unwrap());
        // Each is within 1e-10 / (1 − 0.9) of the emitted flux.
        let apart = flux(&moved_area, &pick(&x.radiosity), &y.radiosity);
        assert!(apart.max_element() < 2e-9 * emitted, "{method:?}: {apart}");
    }
}

#[test]
fn the_history_counts_the_work() {
    let n = 20u64;
    let (matrix, area) = random_closed(n as usize, 1);
    let (m, rho) = random_light(n as usize, 0.7, 1);
    let system = System::from_parts(&matrix, area, m, rho).unwrap();
    let run = |method, shots_per_record| {
        solve(
            method,
            &system,
            &Options {
                tolerance: 1e-4,
                shots_per_record,
                ..Options::default()
            },
        )
        .unwrap()
    };
    for (method, pass) in [
        (Method::Jacobi, 3 * n * n),
        (Method::GaussSeidel, 3 * (n * n + n * (n - 1) / 2)),
    ] {
        for (k, r) in run(method, 0).history.iter().enumerate() {
            assert_eq!((r.iteration, r.work), (k as u64 + 1, (k as u64 + 1) * pass));
        }
    }
    for method in [Method::Southwell, Method::Progressive] {
        let got = run(method, 5);
        let (last, shots) = got.history.split_last().unwrap();
        for (k, r) in shots.iter().enumerate() {
            assert_eq!((r.iteration, r.work), (5 * k as u64, 15 * n * k as u64));
        }
        // There is one audit at the end.
        assert_eq!(last.work, 3 * n * last.iteration + 3 * n * n);
    }
    let falls = |s: &Solution| s.history.windows(2).all(|w| w[1].left <= w[0].left + 1e-15);
    assert!(Method::ALL.into_iter().all(|m| falls(&run(m, 1))));
    // Gauss–Seidel uses the newest values, so it never needs more passes on such a system.
    let passes = |m| run(m, 0).last().iteration;
    assert!(passes(Method::GaussSeidel) < passes(Method::Jacobi));
}

#[test]
fn southwell_relaxes_the_brightest_and_progressive_radiosity_the_strongest() {
    let (n, k) = (6, 1.0 / 5.0);
    let area = vec![1.0, 10.0, 1.0, 1.0, 1.0, 1.0];
    let mut matrix = Matrix::zeros(n);
    for i in 0..n {
        for (j, a) in area.iter().enumerate() {
            // A_i F_ij = k A_i A_j / 10: reciprocal, with row sums of at most 0.28.
            matrix.row_mut(i)[j] = if i == j { 0.0 } else { k * a / 10.0 };
        }
    }
    let mut m = vec![DVec3::ZERO; n];
    // The first is bright, the second has ten times the area, and the third ties with the first.
    (m[0].x, m[1].y, m[3].z) = (5.0, 2.0, 5.0);
    let system = System::from_parts(&matrix, area, m, vec![DVec3::splat(0.5); n]).unwrap();
    for (method, order) in [
        (Method::Southwell, [0, 3, 1]),
        (Method::Progressive, [1, 0, 3]),
    ] {
        let mut shot = Vec::new();
        solve_observed(method, &system, &options(1e-3), &mut |s| {
            // Only the patch that has just shot has nothing left.
            let empty: Vec<usize> = (0..n).filter(|&i| s.residual[i] == DVec3::ZERO).collect();
            if empty.len() == 1 {
                shot.push(empty[0]);
            }
        })
        .unwrap();
        assert_eq!(shot[..3], order, "{method:?}");
    }
}

#[test]
fn stopping_early_is_said() {
    let (matrix, area) = random_closed(20, 3);
    let (m, rho) = random_light(20, 0.99, 3);
    let system = System::from_parts(&matrix, area, m, rho).unwrap();
    for method in Method::ALL {
        let few = Options {
            tolerance: 1e-12,
            max_passes: 2,
            shots_per_record: 0,
        };
        let got = solve(method, &system, &few).unwrap();
        assert_eq!(got.stop, Stop::Passes, "{method:?}");
        assert!(got.last().left > 1e-12 && !got.converged());
        // No double is exact, so a tolerance of 0 is reached only with a residual of 0.
        let never = Options {
            tolerance: 0.0,
            max_passes: 3000,
            shots_per_record: 0,
        };
        let got = solve(method, &system, &never).unwrap();
        assert!(!got.converged() || got.last().left == 0.0, "{method:?}");
    }
}

#[test]
fn a_system_that_makes_light_has_no_bound_and_no_solution() {
    let n = 6;
    let mut matrix = Matrix::zeros(n);
    for i in 0..n {
        for j in 0..n {
            // Row sums of 2.
            matrix.row_mut(i)[j] = if i == j { 0.0 } else { 2.0 / (n - 1) as f64 };
        }
    }
    let build = |rho: f64| {
        System::from_parts(
            &matrix,
            vec![1.0; n],
            vec![DVec3::ONE; n],
            vec![DVec3::splat(rho); n],
        )
        .unwrap()
    };
    let growing = build(0.9);
    assert_eq!(growing.error_bound(DVec3::ONE), DVec3::INFINITY);
    for method in Method::ALL {
        let got = solve(method, &growing, &options(1e-6)).unwrap();
        assert_eq!(got.stop, Stop::Diverged, "{method:?}");
        assert_eq!(got.last().error_bound, DVec3::INFINITY);
    }
    // ρ 0.4 · 2 < 1: converges, to too much light, and the bound holds.
    let fading = build(0.4);
    for method in Method::ALL {
        let got = solve(method, &fading, &options(1e-9)).unwrap();
        assert!(got.converged());
        assert!((got.radiosity[0].x - 5.0).abs() < 1e-7);
    }
}

/// Progressive radiosity derives columns from rows by reciprocity. Without reciprocity it must not
/// report a solution that it does not have.
#[test]
fn rows_that_are_not_reciprocal_are_found_out() {
    let (mut matrix, area) = random_closed(20, 12);
    let mut rng = fastrand::Rng::with_seed(2);
    for f in matrix.values_mut() {
        *f *= 0.5 + rng.f64();
    }
    let (m, rho) = random_light(20, 0.6, 12);
    let system = System::from_parts(&matrix, area.clone(), m.clone(), rho).unwrap();
    let want = direct(&system);
    let emitted: f64 = m.iter().zip(&area).map(|(m, &a)| m.max_element() * a).sum();
    for method in Method::ALL {
        let got = solve(method, &system, &options(1e-9)).unwrap();
        let error = flux(&area, &got.radiosity, &want).max_element();
        // Row sums reach 1.2 here, and row and column sums are at most 1.5, so the factor is at
        // most 1/(1 − 0.6 · 1.5).
        assert!(
            !got.converged() || error < 1e-9 * 10.0 * emitted,
            "{method:?}: {error}"
        );
        assert!(got.converged() || method == Method::Progressive);
    }
}

#[test]
fn nonsense_is_refused_by_name() {
    let (matrix, area) = random_closed(5, 1);
    let (m, rho) = (vec![DVec3::ONE; 5], vec![DVec3::splat(0.5); 5]);
    let of = |area: &[f64], m: &[DVec3], rho: &[DVec3]| {
        System::from_parts(&matrix, area.to_vec(), m.to_vec(), rho.to_vec()).map(|_| ())
    };
    assert_eq!(of(&area, &m, &rho), Ok(()));
    assert!(matches!(
        of(&area[1..], &m, &rho),
        Err(SystemError::Length {
            what: "areas",
            got: 4,
            expected: 5
        })
    ));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut area = area.clone();
        area[2] = bad;
        let error = of(&area, &m, &rho).unwrap_err();
        assert!(error.to_string().starts_with("patch 2: area is"), "{error}");
    }
    for (exitance, reflectance, what) in [
        (-1.0, 0.5, "exitance"),
        (f64::NAN, 0.5, "exitance"),
        (1.0, 1.5, "reflectance"),
        (1.0, f64::NAN, "reflectance"),
    ] {
        let (mut m, mut rho) = (m.clone(), rho.clone());
        (m[4].y, rho[4].y) = (exitance, reflectance);
        let error = of(&area, &m, &rho).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
    let system = System::from_parts(&matrix, area.clone(), m.clone(), rho).unwrap();
    for tolerance in [-1.0, f64::NAN] {
        for method in Method::ALL {
            let got = solve(method, &system, &options(tolerance));
            assert!(matches!(got, Err(SystemError::Tolerance(_))));
        }
    }
    assert!(system.residual(&m[1..]).is_err() && with_ambient(&system, &m, &m[1..]).is_err());
    assert!(matches!(
        close(&Matrix::zeros(3), &[1.0; 3], 1e-9),
        Err(SystemError::NotClosable { patch: 0, .. })
    ));
    // A hub that all others see but that is too small for them cannot be closed.
    let mut star = Matrix::zeros(4);
    for j in 1..4 {
        star.row_mut(0)[j] = 1.0;
        star.row_mut(j)[0] = 1.0;
    }
    assert!(close(&star, &[1.0; 4], 1e-9).is_err());
}

#[test]
fn no_patches_are_solved_at_once() {
    let matrix = Matrix::zeros(0);
    let system = System::from_parts(&matrix, vec![], vec![], vec![]).unwrap();
    for method in Method::ALL {
        let got = solve(method, &system, &Options::default()).unwrap();
        assert!(got.converged() && got.radiosity.is_empty());
    }
}
