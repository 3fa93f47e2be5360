//! Compares the unwrappers on glTF scenes and on generated hard meshes, and prints a table.
//!
//! ```sh
//! cargo run --release -p lumel-atlas --example unwrap_compare -- FOLDER    # every .glb and .gltf below
//! cargo run --release -p lumel-atlas --example unwrap_compare -- --hard    # the meshes of tests/nasty.rs
//! ```
//! Options: `--only xatlas|unroll|box`, `--texels-per-unit X`, `--density X` (times the default).
//!
//! Columns: charts; area relative to page area (rectangles of all instances); L² stretch
//! (area-weighted mean over meshes); texels under two charts; inverted triangles; slits (length of
//! smooth edges whose two sides are in one chart and less than two lumels apart, relative to all
//! smooth chart borders); page size; seconds (all meshes, all threads); meshes that fell back to
//! another unwrapper.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example's output is its purpose"
)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use atlas::UnwrapperChoice;
use atlas::{LayoutOptions, UvMode, layout, overlap_share};
use glam::{DAffine3, Vec2};
use mesh_ingest::{Instance, LoadOptions, Material, Mesh, Primitive, Scene, Soup};

#[path = "../tests/common/nasty.rs"]
mod nasty;

fn main() {
    let mut choices = vec![UnwrapperChoice::Unroll, UnwrapperChoice::Xatlas];
    let mut texels_per_unit = None;
    let mut density = 1.0;
    let mut scenes: Vec<(String, Scene)> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--hard" => scenes.extend(hard_scenes()),
            "--only" => {
                choices = vec![match arguments.next().as_deref() {
                    Some("xatlas") => UnwrapperChoice::Xatlas,
                    Some("box") => UnwrapperChoice::Box,
                    _ => UnwrapperChoice::Unroll,
                }];
            }
            "--texels-per-unit" => texels_per_unit = arguments.next().and_then(|x| x.parse().ok()),
            "--density" => density = arguments.next().and_then(|x| x.parse().ok()).unwrap_or(1.0),
            path => {
                let mut files = Vec::new();
                collect(Path::new(path), &mut files);
                files.sort();
                for file in files {
                    match mesh_ingest::load(&file, &LoadOptions::default()) {
                        Ok(loaded) => {
                            let name = file.file_stem().unwrap_or_default();
                            scenes.push((name.to_string_lossy().into_owned(), loaded.scene));
                        }
                        Err(error) => eprintln!("{}: {error}", file.display()),
                    }
                }
            }
        }
    }
    println!(
        "| scene | triangles | unwrapper | charts | filled % | stretch | overlap % | flipped | slits % | page | s | fell back |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for (name, scene) in &scenes {
        for &choice in &choices {
            row(name, scene, choice, texels_per_unit, density);
        }
    }
}

fn row(
    name: &str,
    scene: &Scene,
    unwrapper: UnwrapperChoice,
    texels_per_unit: Option<f32>,
    density: f64,
) {
    // The layout only reads areas from the soup and computes missing ones.
    let soup = Soup::default();
    let options = LayoutOptions {
        texels_per_unit,
        // Twice the lumels per metre give four times the lumels.
        lumel_budget: (200_000.0 * density * density) as u64,
        unwrapper,
        uv_mode: UvMode::Generate,
        ..LayoutOptions::default()
    };
    let start = Instant::now();
    let result = layout(scene, &soup, &options, &|_| true);
    let seconds = start.elapsed().as_secs_f64();
    let triangles: usize = scene
        .meshes
        .iter()
        .flat_map(|m| &m.primitives)
        .map(|p| p.triangles.len())
        .sum();
    let (plan, report) = match result {
        Ok(result) => result,
        Err(error) => {
            println!("| {name} | {triangles} | {unwrapper:?} | {error} |");
            return;
        }
    };
    let mut overlap = 0.0;
    let (mut stretch, mut weight) = (0.0, 0.0);
    for (atlas, mesh) in plan.meshes.iter().zip(&report.meshes) {
        let corners: Vec<[Vec2; 3]> = atlas
            .primitives
            .iter()
            .flat_map(|p| p.triangles.iter().map(|t| t.map(|v| p.uv[v as usize])))
            .collect();
        let texels = f64::from(mesh.size[0] * mesh.size[1]) * mesh.utilisation;
        overlap += overlap_share(&corners, atlas.size) * texels;
        stretch += mesh.stretch * texels;
        weight += texels;
    }
    let mut slits = [0.0; 4];
    for mesh in &report.meshes {
        for (sum, s) in slits.iter_mut().zip(mesh.slits) {
            *sum += s;
        }
    }
    println!(
        "| {name} | {triangles} | {} | {} | {:.1} | {:.3} | {:.3} | {} | {:.1} | {} | {seconds:.2} | {} |",
        format!("{unwrapper:?}").to_lowercase(),
        report.meshes.iter().map(|m| m.charts).sum::<u32>(),
        100.0 * report.coverage,
        stretch / weight,
        100.0 * overlap / weight,
        report.meshes.iter().map(|m| m.flipped).sum::<u64>(),
        100.0 * (slits[1] + slits[2]) / slits[1..].iter().sum::<f64>().max(f64::MIN_POSITIVE),
        plan.pages
            .iter()
            .map(|p| format!("{}x{}", p[0], p[1]))
            .collect::<Vec<_>>()
            .join(" "),
        report
            .warnings
            .iter()
            .filter(|w| w.ends_with("used"))
            .count(),
    );
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    if path.is_dir() {
        for entry in std::fs::read_dir(path).into_iter().flatten().flatten() {
            if entry.file_name() != "bad" {
                collect(&entry.path(), files);
            }
        }
    } else if path.extension().is_some_and(|e| e == "glb" || e == "gltf") {
        files.push(path.to_owned());
    }
}

/// The meshes of the tests at full size.
fn hard_scenes() -> Vec<(String, Scene)> {
    nasty::nasty(true)
        .into_iter()
        .map(|(name, positions, triangles)| {
            let scene = Scene {
                meshes: vec![Mesh {
                    primitives: vec![Primitive {
                        positions,
                        source_triangles: (0..triangles.len() as u32).collect(),
                        triangles,
                        ..Primitive::default()
                    }],
                    ..Mesh::default()
                }],
                instances: vec![Instance {
                    node: 0,
                    name: String::new(),
                    copy: None,
                    mesh: 0,
                    transform: DAffine3::IDENTITY,
                    occluder: false,
                    density: 1.0,
                    stands_in: None,
                    extras: None,
                }],
                materials: vec![Material::default()],
                ..Scene::default()
            };
            (name.to_owned(), scene)
        })
        .collect()
}
