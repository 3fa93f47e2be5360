//! `lumel-lab solvers`: the iterative solvers side by side on the studies' room.

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use method_lab::solver::{
    Closed, Method, Options, System, close, solve, solve_observed, with_ambient,
};
use method_lab::study::{Case, Detail, Room, barycentre_matrix, cases};

const REFLECTANCES: [f64; 4] = [0.3, 0.7, 0.9, 0.99];
const TOLERANCES: [f64; 3] = [1e-2, 1e-4, 1e-8];
/// Shots, as shares of the number of patches, after which the picture's error is recorded.
const LOOKS: [f64; 6] = [0.04, 0.1, 0.25, 0.5, 1.0, 2.0];

/// Writes `solvers.csv`, `solver_history.csv` and `ambient.csv` into `out`, and prints the tables.
pub fn run(out: &Path) -> Result<(), Box<dyn Error>> {
    print_out(&tables(out, &REFLECTANCES)?);
    Ok(())
}

fn tables(out: &Path, reflectances: &[f64]) -> Result<String, Box<dyn Error>> {
    std::fs::create_dir_all(out)?;
    let room = Room::new(Detail::Coarse);
    let case = cases()
        .into_iter()
        .find(|c| c.name == "ceiling40")
        .ok_or("no such case")?;
    let patches = case.enclosure(&room).patches;
    let area: Vec<f64> = patches.iter().map(|p| p.area()).collect();
    let raw = barycentre_matrix(&patches, |a, b| room.sees(a, b));
    // 1e-13: rounding of sums of a thousand terms.
    let closed = close(&raw, &area, 1e-13)?;
    let mut text = heading(&closed, area.len());
    text += &comparison(out, &room, &case, &closed, reflectances)?;
    text += &early_pictures(out, &room, &case, &closed, reflectances)?;
    Ok(text)
}

fn heading(closed: &Closed, n: usize) -> String {
    format!(
        "{n} patches, a lamp of 40. Form factors: centre to centre with occlusion, then scaled to row sums 1 and kept reciprocal \
         (they were {:.3} to {:.3}; {} passes), so that the answer is that of a closed room. F takes {:.1} MB. One thread.\n\n",
        closed.rows_before[0],
        closed.rows_before[1],
        closed.passes,
        closed.matrix.bytes() as f64 / 1e6
    )
}

/// The case's system with one reflectance everywhere.
fn system<'m>(
    room: &Room,
    case: &Case,
    closed: &'m Closed,
    rho: f64,
) -> Result<System<'m>, Box<dyn Error>> {
    let case = Case {
        reflectance: rho,
        ..case.clone()
    };
    Ok(System::new(&closed.matrix, &case.enclosure(room))?)
}

fn comparison(
    out: &Path,
    room: &Room,
    case: &Case,
    closed: &Closed,
    reflectances: &[f64],
) -> Result<String, Box<dyn Error>> {
    let n = room.patches.len() as f64;
    let mut csv = String::from(
        "rho,tolerance,solver,iterations,passes,multiply_adds,seconds,bytes_beside_matrix,needs_matrix,left,error_bound,converged\n",
    );
    let mut history = String::from("rho,solver,iteration,multiply_adds,left,error_bound\n");
    let mut text = String::from(
        "| ρ | solver | passes (shots / n) to 1e-2 | 1e-4 | 1e-8 | multiply-adds to 1e-2, 10⁶ | 1e-4 | 1e-8 | s to 1e-8 | \
         bound on the error at 1e-8, W/m² | kB beside F |\n|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for &rho in reflectances {
        let system = system(room, case, closed, rho)?;
        for method in Method::ALL {
            let shoots = matches!(method, Method::Southwell | Method::Progressive);
            let (mut passes, mut work) = (String::new(), String::new());
            let (mut seconds, mut last, mut memory) = (0.0, None, 0);
            for tolerance in TOLERANCES {
                let options = Options {
                    tolerance,
                    ..Options::default()
                };
                let start = Instant::now();
                let got = solve(method, &system, &options)?;
                seconds = start.elapsed().as_secs_f64();
                let r = got.last();
                let p = r.iteration as f64 / if shoots { n } else { 1.0 };
                let _ = write!(passes, " {} |", short(p));
                let _ = write!(work, " {} |", short(r.work as f64 / 1e6));
                let needs = if method == Method::Progressive {
                    "one row and an audit"
                } else {
                    "all of it"
                };
                let _ = writeln!(
                    csv,
                    "{rho},{tolerance:e},{},{},{p},{},{seconds:.6},{},{needs},{:e},{:e},{}",
                    method.name(),
                    r.iteration,
                    r.work,
                    got.memory,
                    r.left,
                    r.error_bound.max_element(),
                    got.converged()
                );
                if tolerance == 1e-8 {
                    for h in &got.history {
                        let _ = writeln!(
                            history,
                            "{rho},{},{},{},{:e},{:e}",
                            method.name(),
                            h.iteration,
                            h.work,
                            h.left,
                            h.error_bound.max_element()
                        );
                    }
                }
                memory = got.memory;
                last = Some(got);
            }
            let bound = last.map_or(f64::INFINITY, |s| s.last().error_bound.max_element());
            let _ = writeln!(
                text,
                "| {rho} | {} |{passes}{work} {seconds:.3} | {bound:.1e} | {:.0} |",
                method.name(),
                memory as f64 / 1e3
            );
        }
    }
    std::fs::write(out.join("solvers.csv"), csv)?;
    std::fs::write(out.join("solver_history.csv"), history)?;
    Ok(text)
}

/// How far the picture is from done while shooting, with and without the ambient term: Σ A|B − B*|
/// / Σ A B*.
fn early_pictures(
    out: &Path,
    room: &Room,
    case: &Case,
    closed: &Closed,
    reflectances: &[f64],
) -> Result<String, Box<dyn Error>> {
    let n = room.patches.len();
    let looks = LOOKS.map(|x| (x * n as f64).round() as u64);
    let mut csv = String::from("rho,shots,error_plain,error_with_ambient\n");
    let mut text = String::from("\n| ρ | error of the picture after");
    for (k, shots) in looks.iter().enumerate() {
        let _ = write!(text, "{}{shots}", if k == 0 { " " } else { " | " });
    }
    text += " shots |\n|---|";
    text += &"---|".repeat(looks.len());
    text += "\n";
    for &rho in reflectances {
        let system = system(room, case, closed, rho)?;
        let fine = Options {
            tolerance: 1e-10,
            ..Options::default()
        };
        let want = solve(Method::GaussSeidel, &system, &fine)?.radiosity;
        let total = distance(system.area(), &want, &vec![DVec3::ZERO; n]);
        let mut row = String::new();
        let cut = Options {
            tolerance: 0.0,
            max_passes: 2,
            ..Options::default()
        };
        let mut failure = None;
        solve_observed(Method::Progressive, &system, &cut, &mut |s| {
            if !looks.contains(&s.iteration) {
                return;
            }
            match with_ambient(&system, s.radiosity, s.residual) {
                Ok(shown) => {
                    let plain = distance(system.area(), s.radiosity, &want) / total;
                    let ambient = distance(system.area(), &shown, &want) / total;
                    let _ = write!(
                        row,
                        " {:.2} %, with ambient {:.2} % |",
                        plain * 100.0,
                        ambient * 100.0
                    );
                    let _ = writeln!(csv, "{rho},{},{plain:e},{ambient:e}", s.iteration);
                }
                Err(e) => failure = Some(e),
            }
        })?;
        if let Some(e) = failure {
            return Err(e.into());
        }
        let _ = writeln!(text, "| {rho} |{row}");
    }
    std::fs::write(out.join("ambient.csv"), csv)?;
    Ok(text)
}

fn distance(area: &[f64], a: &[DVec3], b: &[DVec3]) -> f64 {
    area.iter()
        .zip(a.iter().zip(b))
        .map(|(&area, (a, b))| (*a - *b).abs().element_sum() * area)
        .sum()
}

/// About three digits.
fn short(x: f64) -> String {
    if x >= 100.0 {
        format!("{x:.0}")
    } else if x >= 10.0 {
        format!("{x:.1}")
    } else {
        format!("{x:.2}")
    }
}

#[allow(clippy::print_stdout, reason = "the tables are this program's result")]
pub fn print_out(text: &str) {
    print!("{text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_solver_has_its_rows_and_the_ambient_term_helps() {
        let dir = tempfile::tempdir().unwrap();
        let text = tables(dir.path(), &[0.3, 0.7]).unwrap();
        let rows = |file: &str| -> Vec<Vec<String>> {
            let text = std::fs::read_to_string(dir.path().join(file)).unwrap();
            let split = |l: &str| l.split(',').map(str::to_owned).collect();
            text.lines().skip(1).map(split).collect()
        };
        let solved = rows("solvers.csv");
        assert_eq!(solved.len(), 2 * Method::ALL.len() * TOLERANCES.len());
        for r in &solved {
            let number = |k: usize| r[k].parse::<f64>().unwrap();
            assert_eq!((r.len(), r[11].as_str()), (12, "true"));
            assert!(number(9) <= number(1), "{r:?}");
        }
        for method in Method::ALL {
            assert!(text.contains(&format!("| 0.7 | {} |", method.name())));
            assert!(
                rows("solver_history.csv")
                    .iter()
                    .any(|r| r[1] == method.name())
            );
        }
        let looks = rows("ambient.csv");
        assert_eq!(looks.len(), 2 * LOOKS.len());
        for r in looks {
            let [plain, ambient] = [2, 3].map(|k: usize| r[k].parse::<f64>().unwrap());
            // Half is far above the measured value (a fifth at most).
            assert!(ambient < 0.5 * plain, "{r:?}");
        }
    }
}
