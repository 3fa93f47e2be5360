//! `lumel-lab convergence`: convergence orders of the baker's errors.

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;

use method_lab::convergence::{
    CutErrors, Field, Promise, Series, cut_errors, direct_error, indirect_error, rays_error,
    residual_and_error,
};

use crate::solvers::print_out;

/// Writes `convergence.csv` (study, series, x, y, promised y up to a factor) into `out` and prints
/// the orders.
pub fn run(out: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(out)?;
    let mut all = Vec::new();
    let cut = cut_errors(&Field::new(24), &[2, 3, 4, 6, 8, 12, 16], 16_384);
    let size = |pick: fn(&CutErrors) -> f64| -> Vec<(f64, f64)> {
        cut.iter()
            .map(|c| (f64::from(c.patches), pick(c)))
            .collect()
    };
    let mut add = |study, name, order, log, points| {
        all.push(Series {
            study,
            name,
            promise: Promise { order, log },
            // With less than 6 × 6 patches per face, a patch is as large as the features that it
            // should resolve.
            from: if study == "patches" { 216.0 } else { 0.0 },
            points,
        });
    };
    let patches = "patches";
    add(
        patches,
        "patch by patch, RMS",
        0.5,
        false,
        size(|c| c.constant),
    );
    add(
        patches,
        "interpolated, RMS",
        0.75,
        true,
        size(|c| c.interpolated),
    );
    add(
        patches,
        "interpolated, 1/4 m and more from edges",
        1.0,
        false,
        size(|c| c.interior),
    );
    add(
        patches,
        "interpolated, worst point",
        0.5,
        true,
        size(|c| c.worst),
    );
    let rays: Vec<u32> = (4..=14).map(|k| 1 << k).collect();
    add(
        "rays of the solve",
        "4 × 4 patches a face",
        0.625,
        false,
        rays_error(4, &rays),
    );
    let rays: Vec<u32> = (5..=13).map(|k| 1 << k).collect();
    add(
        "rays of the gather",
        "at a point",
        0.75,
        false,
        indirect_error(1, &rays),
    );
    add(
        "rays of the gather",
        "16 points of a lumel",
        0.625,
        false,
        indirect_error(16, &rays),
    );
    let rays: Vec<u32> = (2..=12).map(|k| 1 << k).collect();
    add(
        "shadow rays",
        "at a point",
        0.75,
        false,
        direct_error(0.0, &rays),
    );
    add(
        "shadow rays",
        "mean over 0.1 m",
        0.5,
        false,
        direct_error(0.1, &rays),
    );
    let mut text = String::from("study,series,x,y,promised\n");
    let mut table = String::from(
        "| error | settings | promised | that is, over these settings | measured |\n|---|---|---|---:|---:|\n",
    );
    for s in &all {
        for (x, y) in &s.points {
            let _ = writeln!(
                text,
                "{},\"{}\",{x},{y},{}",
                s.study,
                s.name,
                s.promise.at(*x)
            );
        }
        let used = || s.points.iter().filter(|p| p.0 >= s.from);
        let ends = [used().next(), used().next_back()].map(|p| p.map_or(0.0, |p| p.0));
        let _ = writeln!(
            table,
            "| {}: {} | {}–{} | x^−{}{} | {:.2} | {:.2} |",
            s.study,
            s.name,
            ends[0],
            ends[1],
            s.promise.order,
            if s.promise.log { " ln √(x/6)" } else { "" },
            s.promised_order(),
            s.order()
        );
    }
    table +=
        "\n| ρ | relaxed by | stops | bound / error, least | most |\n|---:|---|---:|---:|---:|\n";
    let tolerances: Vec<f64> = (0..=13).map(|k| 10f64.powf(-0.5 * f64::from(k))).collect();
    for rho in [0.5f32, 0.9] {
        for (krylov, name) in [(false, "Gauss–Seidel"), (true, "Bi-CGSTAB")] {
            let stops = residual_and_error(rho, krylov, &tolerances);
            let (mut least, mut most) = (f64::INFINITY, 0f64);
            for s in &stops {
                let _ = writeln!(
                    text,
                    "solver,\"{name}, ρ {rho}: bound\",{},{},0",
                    s.tolerance, s.bound
                );
                let _ = writeln!(
                    text,
                    "solver,\"{name}, ρ {rho}: error\",{},{},0",
                    s.tolerance, s.error
                );
                least = least.min(s.bound / s.error);
                most = most.max(s.bound / s.error);
            }
            let _ = writeln!(
                table,
                "| {rho} | {name} | {} | {least:.2} | {most:.1} |",
                stops.len()
            );
        }
    }
    std::fs::write(out.join("convergence.csv"), text)?;
    print_out(&table);
    Ok(())
}
