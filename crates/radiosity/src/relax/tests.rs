use mesh_ingest::Soup;
use patch_subdivision::{Options as CutOptions, Subdivision};

use super::*;
use crate::fixtures::cube;
use crate::monitor::Silent;
use crate::sampling::hash_u32;
use crate::world::{World, WorldOptions};

/// A synthetic light problem on the sampled form factors of a cube.
struct Problem {
    links: Links,
    reflectance: Vec<DVec3>,
    area: Vec<f64>,
    source: Vec<DVec3>,
}

/// A number in [0, 1) for each `i` and `salt`.
fn random(i: usize, salt: u32) -> f64 {
    hash_u32(hash_u32(i as u32).wrapping_add(salt)) as f64 / 4294967296.0
}

impl Problem {
    /// Red has the same reflectance `rho` everywhere (the slowest case), green varies up to it, and
    /// blue has half of it. A tenth of the patches emits light.
    fn new(rho: f64) -> Self {
        let scene = cube(0.5, glam::Vec3::ZERO);
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
        let cut = CutOptions {
            patches: 96,
            ..CutOptions::default()
        };
        let cut = Subdivision::build(&soup, |_| false, &cut);
        let n = cut.patches().len();
        let mut links = Links::new(n, 256);
        links.extend(&world, &cut, |_| 256, &Silent).unwrap();
        Problem {
            links,
            reflectance: (0..n)
                .map(|i| DVec3::new(rho, rho * random(i, 1), 0.5 * rho))
                .collect(),
            area: cut.patches().iter().map(|p| p.area as f64).collect(),
            source: (0..n)
                .map(|i| match random(i, 2) < 0.1 {
                    true => DVec3::new(random(i, 3), 10.0 * random(i, 4), random(i, 5)),
                    false => DVec3::ZERO,
                })
                .collect(),
        }
    }

    fn system(&self) -> System<'_> {
        System {
            links: &self.links,
            reflectance: &self.reflectance,
            area: &self.area,
            source: &self.source,
        }
    }

    /// The solution by Gaussian elimination with partial pivoting of `I − Fρ`, channel by channel.
    fn eliminate(&self) -> Vec<DVec3> {
        let n = self.area.len();
        let mut out = vec![DVec3::ZERO; n];
        for (channel, axis) in DVec3::AXES.into_iter().enumerate() {
            let mut m = vec![vec![0f64; n + 1]; n];
            for (i, row) in m.iter_mut().enumerate() {
                row[i] = 1.0;
                row[n] = self.source[i][channel];
                for &j in self.links.row(i) {
                    row[j as usize] -=
                        self.reflectance[j as usize][channel] / self.links.row(i).len() as f64;
                }
            }
            for k in 0..n {
                let pivot = (k..n)
                    .max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs()))
                    .unwrap();
                m.swap(k, pivot);
                let (upper, lower) = m.split_at_mut(k + 1);
                for row in lower {
                    let f = row[k] / upper[k][k];
                    for (x, p) in row[k..].iter_mut().zip(&upper[k][k..]) {
                        *x -= f * p;
                    }
                }
            }
            for k in (0..n).rev() {
                let known: f64 = (k + 1..n).map(|j| m[k][j] * out[j][channel]).sum();
                out[k] += axis * ((m[k][n] - known) / m[k][k]);
            }
        }
        out
    }

    /// Σ A|x − exact| / Σ A exact over patches and channels: what [`RelaxReport::residual`] bounds.
    fn error(&self, x: &[DVec3], exact: &[DVec3]) -> f64 {
        let (mut off, mut all) = (0.0, 0.0);
        for i in 0..x.len() {
            off += (x[i] - exact[i]).abs().element_sum() * self.area[i];
            all += exact[i].element_sum() * self.area[i];
        }
        off / all
    }
}

/// Runs one method to convergence and compares it with elimination.
fn check(rho: f64, sweeps: u32) -> RelaxReport {
    let problem = Problem::new(rho);
    let exact = problem.eliminate();
    // The elimination itself must satisfy the equation, up to rounding times the condition number
    // 2/(1−ρ).
    assert!(
        problem
            .system()
            .bound(&problem.system().apply(&exact, 1.0, 1.0), &exact)
            < 1e-10
    );
    let options = RelaxOptions {
        tolerance: 1e-8,
        sweeps,
    };
    let mut x = vec![DVec3::ZERO; exact.len()];
    let report = problem.system().relax(&mut x, &options, &Silent);
    assert!(report.converged, "rho {rho}: {report:?}");
    assert!(report.residual <= options.tolerance);
    let error = problem.error(&x, &exact);
    assert!(
        error <= report.residual + 1e-10,
        "rho {rho}: error {error:e}, {report:?}"
    );
    // No patch is left out: one has 1/96 of the area, so its error may be 96 × 1e-8 of the mean,
    // and the darkest get a tenth of the mean.
    for (a, b) in x.iter().zip(&exact) {
        assert!((*a - *b).abs().max_element() < 1e-5 * b.max_element().max(1e-3));
    }
    report
}

#[test]
fn sweeps_alone_find_the_solution() {
    // At 0.999, thousands would be needed; the other method exists for this case.
    for rho in [0.5, 0.9] {
        let report = check(rho, 100_000);
        assert!(report.iterations == 0 && report.sweeps > 0, "{report:?}");
    }
}

#[test]
fn bicgstab_alone_finds_the_solution() {
    for rho in [0.5, 0.9, 0.999] {
        let report = check(rho, 0);
        assert!(report.sweeps == 0 && report.iterations > 0, "{report:?}");
        // Superlinear convergence: the ln 1e-8 / ln 0.999 = 18,000 plain sweeps do
        // not matter.
        assert!(report.iterations < 60, "{report:?}");
    }
}

#[test]
fn what_sweeps_leave_is_handed_over() {
    let report = check(0.999, RelaxOptions::default().sweeps);
    assert!(report.iterations > 0, "{report:?}");
    assert_eq!(report.sweeps, RelaxOptions::default().sweeps);
}

/// Surfaces that absorb nothing, and no tolerance: the worst case.
#[test]
fn what_never_converges_ends_after_its_steps() {
    let mut problem = Problem::new(1.0);
    problem.reflectance.fill(DVec3::ONE);
    let n = problem.area.len();
    let options = RelaxOptions {
        tolerance: 0.0,
        sweeps: 3,
    };
    let mut x = vec![DVec3::ZERO; n];
    let report = problem.system().relax(&mut x, &options, &Silent);
    assert!(!report.converged && x.iter().all(|x| x.is_finite()));
    assert_eq!(report.sweeps, 3);
    let most = MOST_ITERATIONS;
    assert!(
        (1..=most).contains(&report.iterations),
        "{}",
        report.iterations
    );
}

/// Cancels when the reported residual falls below a limit.
struct StopAt {
    limit: f64,
    last: std::sync::Mutex<f64>,
}

impl Monitor for StopAt {
    fn residual(&self, residual: f64) {
        *self.last.lock().unwrap() = residual;
    }
    fn cancelled(&self) -> bool {
        *self.last.lock().unwrap() < self.limit
    }
}

#[test]
fn the_residual_bounds_the_error_on_the_way() {
    for rho in [0.5, 0.9, 0.999] {
        let problem = Problem::new(rho);
        let exact = problem.eliminate();
        for sweeps in [0, 10, 100_000] {
            let mut compared = 0;
            for limit in [100.0, 10.0, 1.0, 0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-4, 1e-5] {
                if rho > 0.99 && sweeps > 10 && limit < 1.0 {
                    continue; // that many sweeps take too long
                }
                let monitor = StopAt {
                    limit,
                    last: std::sync::Mutex::new(f64::INFINITY),
                };
                let options = RelaxOptions {
                    tolerance: 1e-8,
                    sweeps,
                };
                let mut x = vec![DVec3::ZERO; exact.len()];
                let report = problem.system().relax(&mut x, &options, &monitor);
                assert!(x.iter().all(|e| e.is_finite()));
                assert_eq!(report.converged, report.residual <= options.tolerance);
                let error = problem.error(&x, &exact);
                assert!(
                    error <= report.residual,
                    "rho {rho}, sweeps {sweeps}, limit {limit}: error {error:e}, {report:?}"
                );
                // A bound that is always huge would pass as well; for the constant channel, it is
                // nearly reached.
                compared += (error > 0.01 * report.residual) as u32;
            }
            assert!(compared > 1, "rho {rho}, sweeps {sweeps}: {compared}");
        }
    }
}

#[test]
fn a_good_start_is_kept_and_a_dark_problem_stays_dark() {
    let mut problem = Problem::new(0.9);
    let exact = problem.eliminate();
    let mut x = exact.clone();
    let report = problem
        .system()
        .relax(&mut x, &RelaxOptions::default(), &Silent);
    assert!(report.converged && report.sweeps == 0 && report.iterations == 0);
    assert_eq!(x, exact);
    problem.source.fill(DVec3::ZERO);
    x.fill(DVec3::ZERO);
    let report = problem
        .system()
        .relax(&mut x, &RelaxOptions::default(), &Silent);
    assert!(report.converged && report.residual == 0.0, "{report:?}");
    assert!(x.iter().all(|e| *e == DVec3::ZERO));
}
