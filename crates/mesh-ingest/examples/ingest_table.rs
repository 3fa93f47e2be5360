//! Loads every glTF below the given folders and prints one line per file: the outcome and the time.
//!
//! ```sh
//! cargo run --release -p lumel-mesh-ingest --example ingest_table -- FOLDER …
//! ```
//!
//! Columns, tab-separated: path, exit code, milliseconds, triangles of the soup, area in m², size
//! of the bounding box, lights, first line of the error or the counts.

#![allow(clippy::print_stdout, reason = "the table is this program's result")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use mesh_ingest::{LightKind, LoadOptions, Loaded, Soup, load};

fn main() {
    let mut files = Vec::new();
    for folder in std::env::args_os().skip(1) {
        collect(Path::new(&folder), &mut files);
    }
    files.sort();
    for file in files {
        let start = Instant::now();
        let outcome = load(&file, &LoadOptions::default());
        let (code, text) = match &outcome {
            Ok(loaded) => (0, describe(loaded)),
            Err(error) => (error.exit_code(), error.to_string().replace('\n', " | ")),
        };
        println!(
            "{}\t{code}\t{}\t{text}",
            file.display(),
            start.elapsed().as_millis()
        );
    }
}

fn describe(loaded: &Loaded) -> String {
    let soup = Soup::build(&loaded.scene);
    let area: f64 = soup.areas.iter().map(|&a| f64::from(a)).sum();
    let corners = || {
        soup.triangles
            .iter()
            .flatten()
            .map(|p| p.as_dvec3() + loaded.scene.origin)
    };
    let low = corners().reduce(|a, b| a.min(b)).unwrap_or_default();
    let high = corners().reduce(|a, b| a.max(b)).unwrap_or_default();
    let lights: Vec<String> = loaded
        .scene
        .lights
        .iter()
        .map(|light| {
            let place = match light.kind {
                LightKind::Directional { direction, .. } => format!("directional {direction:.4}"),
                LightKind::Point { position, .. } => {
                    format!("point {:.4}", position.as_dvec3() + loaded.scene.origin)
                }
                LightKind::Spot {
                    position,
                    direction,
                    inner,
                    outer,
                    ..
                } => {
                    format!(
                        "spot {:.4} {direction:.4} {inner:.4} {outer:.4}",
                        position.as_dvec3() + loaded.scene.origin
                    )
                }
            };
            format!("{place} {:.4}", light.intensity)
        })
        .collect();
    format!(
        "{}\t{area:.6e}\t{low:.4} {high:.4}\t{}\t{:?} zero {} dup {} left out {:?}",
        soup.len(),
        lights.join("; "),
        loaded.report.counts,
        soup.dropped_zero_area,
        soup.dropped_duplicate,
        loaded.report.left_out_by_reason(),
    )
}

fn collect(at: &Path, files: &mut Vec<PathBuf>) {
    if let Ok(entries) = std::fs::read_dir(at) {
        entries
            .flatten()
            .for_each(|entry| collect(&entry.path(), files));
    } else if at.extension().is_some_and(|e| e == "gltf" || e == "glb") {
        files.push(at.to_path_buf());
    }
}
