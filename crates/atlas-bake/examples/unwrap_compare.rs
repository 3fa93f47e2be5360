//! Measures the unwrappers on glTF scenes and on hard meshes made here, and prints a table.
//!
//! ```sh
//! cargo run --release -p atlas-bake --example unwrap_compare -- ../shared/scenes          # every .glb and .gltf below
//! cargo run --release -p atlas-bake --example unwrap_compare -- --hard                    # 500,000-triangle blob & co.
//! ```
//! Options: `--only xatlas|uvunwrap|box`, `--texels-per-unit X`. Columns: charts, area over page area (rectangles of all
//! instances), L² stretch (area-weighted mean over meshes), texels under two charts, triangles turned over, page
//! size, seconds (all meshes, all threads), what fell back to another unwrapper.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "an example's output is its purpose"
)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use atlas_bake::unwrap::UnwrapperChoice;
use atlas_bake::{LayoutOptions, UvMode, layout, overlap_share};
use glam::{DAffine3, Vec2, Vec3};
use mesh_ingest::{Instance, LoadOptions, Mesh, Primitive, Scene, Soup};

fn main() {
    let mut choices = vec![UnwrapperChoice::UvUnwrap, UnwrapperChoice::Xatlas];
    let mut texels_per_unit = None;
    let mut scenes: Vec<(String, Scene)> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--hard" => scenes.extend(hard_scenes()),
            "--only" => {
                choices = vec![match arguments.next().as_deref() {
                    Some("xatlas") => UnwrapperChoice::Xatlas,
                    Some("box") => UnwrapperChoice::Box,
                    _ => UnwrapperChoice::UvUnwrap,
                }];
            }
            "--texels-per-unit" => texels_per_unit = arguments.next().and_then(|x| x.parse().ok()),
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
        "| scene | triangles | unwrapper | charts | filled % | stretch | overlap % | flipped | page | s | fell back |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for (name, scene) in &scenes {
        for &choice in &choices {
            row(name, scene, choice, texels_per_unit);
        }
    }
}

fn row(name: &str, scene: &Scene, unwrapper: UnwrapperChoice, texels_per_unit: Option<f32>) {
    // The layout reads only areas from the soup and computes what is missing.
    let soup = Soup::default();
    let options = LayoutOptions {
        texels_per_unit,
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
    println!(
        "| {name} | {triangles} | {} | {} | {:.1} | {:.3} | {:.3} | {} | {} | {seconds:.2} | {} |",
        format!("{unwrapper:?}").to_lowercase(),
        report.meshes.iter().map(|m| m.charts).sum::<u32>(),
        100.0 * report.coverage,
        stretch / weight,
        100.0 * overlap / weight,
        report.meshes.iter().map(|m| m.flipped).sum::<u64>(),
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

/// Meshes that unwrappers hang on.
fn hard_scenes() -> Vec<(String, Scene)> {
    let lone = |name: &str, positions, triangles: Vec<[u32; 3]>| {
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
                extras: None,
            }],
            ..Scene::default()
        };
        (name.to_owned(), scene)
    };
    let mut out = Vec::new();
    for n in [143u32, 355] {
        let (positions, triangles) = blob(n);
        out.push(lone(
            &format!("blob {}", triangles.len()),
            positions,
            triangles,
        ));
    }
    let mut r = random(3);
    let n = 100_000u32;
    let mut positions = Vec::new();
    for _ in 0..n {
        let at = Vec3::new(r(), r(), r()) * 100.0;
        for _ in 0..3 {
            positions.push(at + Vec3::new(r(), r(), r()) * 0.5);
        }
    }
    let loose = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    out.push(lone("100,000 loose", positions, loose));
    // A thousand pages of a book: every triangle has one edge in common with all the others.
    let mut positions = vec![Vec3::ZERO, Vec3::Y];
    for i in 0..1000 {
        let a = i as f32 / 1000.0 * std::f32::consts::TAU;
        positions.push(Vec3::new(a.cos(), 0.5, a.sin()));
    }
    let book = (0..1000).map(|i| [0, 1, i + 2]).collect();
    out.push(lone("book of 1000", positions, book));
    // All triangles among 60 random points: every edge has 58.
    let mut r = random(5);
    let positions = (0..60).map(|_| Vec3::new(r(), r(), r())).collect();
    let mut triangles = Vec::new();
    for a in 0..60 {
        for b in a + 1..60 {
            for c in b + 1..60 {
                triangles.push([a, b, c]);
            }
        }
    }
    out.push(lone("complete complex", positions, triangles));
    // A heightfield of noise: every edge is sharp.
    let mut r = random(9);
    let n = 200u32;
    let positions = (0..n * n)
        .map(|i| Vec3::new((i % n) as f32, 2.0 * r(), (i / n) as f32))
        .collect();
    let mut triangles = Vec::new();
    for y in 0..n - 1 {
        for x in 0..n - 1 {
            let a = y * n + x;
            triangles.push([a, a + n, a + 1]);
            triangles.push([a + 1, a + n, a + n + 1]);
        }
    }
    out.push(lone("noise terrain", positions, triangles));
    out
}

/// A lumpy sphere of about 4 n² triangles.
fn blob(n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let columns = 2 * n;
    let point = |ring: u32, column: u32| {
        let a = std::f32::consts::PI * ring as f32 / n as f32;
        let b = std::f32::consts::TAU * column as f32 / columns as f32;
        let p = Vec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin());
        p * (3.0 + 0.3 * (7.0 * p.x).sin() * (9.0 * p.y).cos() + 0.1 * (31.0 * p.z).sin())
    };
    let mut positions = vec![point(0, 0)];
    for ring in 1..n {
        positions.extend((0..columns).map(|c| point(ring, c)));
    }
    positions.push(point(n, 0));
    let last = positions.len() as u32 - 1;
    let at = |ring: u32, column: u32| 1 + (ring - 1) * columns + column % columns;
    let mut triangles = Vec::new();
    for c in 0..columns {
        triangles.push([0, at(1, c + 1), at(1, c)]);
        for r in 1..n - 1 {
            triangles.push([at(r, c), at(r, c + 1), at(r + 1, c)]);
            triangles.push([at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)]);
        }
        triangles.push([last, at(n - 1, c), at(n - 1, c + 1)]);
    }
    (positions, triangles)
}

fn random(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 40) as f32 / (1u64 << 24) as f32
    }
}
