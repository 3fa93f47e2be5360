//! `lumel-lab form-factors`: every method at several settings, on the same scenes, against the same
//! references.

use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use method_lab::reference::reference_matrix;
use method_lab::{
    Enclosure, FormFactors, Matrix, Method, audit, compare, enclosures, form_factors,
};

/// Options of `form-factors`.
#[derive(Args)]
pub struct Options {
    /// Folder for `form_factors.csv`; created if missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only scenes whose name contains this.
    #[arg(long, value_name = "TEXT")]
    scene: Option<String>,
    /// Only methods whose name contains this.
    #[arg(long, value_name = "TEXT")]
    method: Option<String>,
    /// Runs of each; the fastest is written. Runs of over half a second are not repeated.
    #[arg(long, default_value_t = 3)]
    repeat: u32,
}

/// Gauss–Legendre points along each side, for references with occlusion.
const REFERENCE_ORDER: usize = 12;

struct Scene {
    name: &'static str,
    enclosure: Enclosure,
    /// Whether rows sum to 1.
    closed: bool,
    /// Whether there is occlusion, in which case methods without their own occlusion cast shadow
    /// rays.
    occluded: bool,
}

fn scenes() -> Vec<Scene> {
    let scene = |name, enclosure, closed, occluded| Scene {
        name,
        enclosure,
        closed,
        occluded,
    };
    vec![
        scene("opposed", enclosures::opposed_plates(1.0, 6), false, false),
        scene("near", enclosures::opposed_plates(0.1, 6), false, false),
        scene(
            "perpendicular",
            enclosures::perpendicular_plates(1.0, 1.0, 6),
            false,
            false,
        ),
        scene("cube", enclosures::cube(5), true, false),
        scene("room", enclosures::room_with_box(2), true, true),
        scene("l-shape", enclosures::furnace_l(3), true, true),
        scene(
            "spheres",
            enclosures::concentric_spheres(0.5, 1),
            true,
            true,
        ),
    ]
}

/// Name of a method, its setting in words, and the method itself.
fn methods(occluded: bool) -> Vec<(&'static str, String, Method)> {
    let mut all = Vec::new();
    // More accurate methods get more rays per pair.
    let shadow = |rays| if occluded { rays } else { 0 };
    let words = |what: String, rays: usize| {
        if rays == 0 {
            what
        } else {
            format!("{what}, {rays} shadow rays")
        }
    };
    for (cells, rays) in [(1, 1), (2, 4), (4, 16), (8, 64)] {
        let shadow_rays = shadow(rays);
        let setting = words(format!("{cells}×{cells} cells"), shadow_rays);
        all.push((
            "point to point",
            setting.clone(),
            Method::PointToPoint { cells, shadow_rays },
        ));
        all.push((
            "point to disc",
            setting.clone(),
            Method::PointToDisc { cells, shadow_rays },
        ));
        all.push((
            "point to polygon",
            setting,
            Method::PointToPolygon { cells, shadow_rays },
        ));
    }
    for (tolerance, rays) in [(1e-2, 4), (1e-4, 16), (1e-6, 64), (1e-8, 256)] {
        let shadow_rays = shadow(rays);
        all.push((
            "contour",
            words(format!("tolerance {tolerance:.0e}"), shadow_rays),
            Method::Contour {
                tolerance,
                shadow_rays,
            },
        ));
    }
    for (resolution, points) in [(16, 1), (64, 1), (64, 2), (64, 4)] {
        all.push((
            "Nusselt",
            format!("{resolution} px, {points}×{points} points"),
            Method::Nusselt { resolution, points },
        ));
    }
    for (resolution, points) in [(16, 1), (64, 1), (256, 1), (64, 2), (64, 4), (128, 4)] {
        all.push((
            "hemicube",
            format!("{resolution} px, {points}×{points} points"),
            Method::Hemicube { resolution, points },
        ));
    }
    for tolerance in [1e-2, 1e-3, 1e-4] {
        all.push((
            "area to area",
            format!("tolerance {tolerance:.0e}"),
            Method::AreaToArea {
                order: 2,
                tolerance,
            },
        ));
    }
    for power in [6, 8, 10, 12, 14, 16] {
        let count = 1usize << power;
        all.push(("rays", format!("{count} rays"), Method::Rays { count }));
    }
    all
}

/// Runs everything and writes `form_factors.csv`.
pub fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&options.out)?;
    let keep = |name: &str, part: &Option<String>| part.as_deref().is_none_or(|p| name.contains(p));
    let mut csv = String::from(
        "scene,patches,method,setting,rms_error,max_error,irradiance_error,row_sum_error,reciprocity_error,seconds,bytes,rays\n",
    );
    let mut table = String::from(
        "| scene | method | setting | RMS error | max error | irradiance | row sum | reciprocity | ms | KiB | rays |\n|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    let path = options.out.join("form_factors.csv");
    for scene in scenes() {
        if !keep(scene.name, &options.scene) {
            continue;
        }
        let start = Instant::now();
        let reference = reference_matrix(&scene.enclosure, REFERENCE_ORDER)?;
        let mut rows = vec![(
            "reference",
            format!("contour 1e-10, {REFERENCE_ORDER}×{REFERENCE_ORDER} points where hidden"),
            reference.clone(),
            start.elapsed().as_secs_f64(),
        )];
        for (name, setting, method) in methods(scene.occluded) {
            if keep(name, &options.method) {
                let (result, seconds) = timed(&scene.enclosure, method, options.repeat)?;
                rows.push((name, setting, result, seconds));
            }
        }
        for (name, setting, result, seconds) in rows {
            let error = compare(&result.matrix, &reference.matrix);
            let check = audit(&scene.enclosure, &result.matrix);
            let lit = irradiance_error(&scene.enclosure, &result.matrix, &reference.matrix);
            let row_sum = scene.closed.then_some(check.row_sum_error);
            writeln!(
                csv,
                "{},{},{name},\"{setting}\",{:.6e},{:.6e},{:.6e},{},{:.6e},{seconds:.6e},{},{}",
                scene.name,
                scene.enclosure.patches.len(),
                error.rms,
                error.max,
                lit,
                row_sum.map_or(String::new(), |e| format!("{e:.6e}")),
                check.reciprocity_error,
                result.bytes,
                result.rays,
            )?;
            writeln!(
                table,
                "| {} | {name} | {setting} | {:.1e} | {:.1e} | {:.1e} | {} | {:.1e} | {:.1} | {} | {} |",
                scene.name,
                error.rms,
                error.max,
                lit,
                row_sum.map_or("open".into(), |e| format!("{e:.1e}")),
                check.reciprocity_error,
                seconds * 1e3,
                result.bytes / 1024,
                result.rays,
            )?;
        }
        // After each scene, so that an interrupted run keeps its results.
        std::fs::write(&path, &csv)?;
    }
    #[allow(clippy::print_stdout, reason = "the table is what was asked for")]
    {
        print!("{table}");
    }
    Ok(())
}

/// The fastest of several runs, which is least disturbed by other processes.
fn timed(
    enclosure: &Enclosure,
    method: Method,
    repeat: u32,
) -> Result<(FormFactors, f64), Box<dyn Error>> {
    let mut best = f64::INFINITY;
    let mut runs = 0;
    loop {
        let start = Instant::now();
        let result = form_factors(enclosure, method)?;
        let seconds = start.elapsed().as_secs_f64();
        best = best.min(seconds);
        runs += 1;
        if runs >= repeat || seconds > 0.5 {
            return Ok((result, best));
        }
    }
}

/// Effect of a matrix's errors on light: the RMS error of E_i = Σ_j F_ij B_j over the patches,
/// relative to the RMS of E, if the half of the scene with greater x has radiosity 1 and the rest
/// 0. Errors of single pairs that cancel count little, those that add up count fully.
fn irradiance_error(enclosure: &Enclosure, matrix: &Matrix, reference: &Matrix) -> f64 {
    let x: Vec<f64> = enclosure.patches.iter().map(|p| p.centre().x).collect();
    let (low, high) = x
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
            (l.min(*x), h.max(*x))
        });
    let middle = 0.5 * (low + high);
    let irradiance = |row: &[f64]| -> f64 {
        row.iter()
            .zip(&x)
            .filter(|(_, x)| **x > middle)
            .map(|(f, _)| f)
            .sum()
    };
    let (mut difference, mut norm) = (0.0, 0.0);
    for i in 0..matrix.len() {
        let exact = irradiance(reference.row(i));
        difference += (irradiance(matrix.row(i)) - exact).powi(2);
        norm += exact * exact;
    }
    if norm > 0.0 {
        (difference / norm).sqrt()
    } else {
        0.0
    }
}
