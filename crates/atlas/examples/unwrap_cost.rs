//! Measures how the time of unwrappers grows with mesh size, on generated worst cases.
//!
//! ```sh
//! cargo run --release -p lumel-atlas --example unwrap_cost -- xatlas 1000 60000     # from, to; doubles each step
//! ```
#![allow(clippy::print_stdout, reason = "an example's output is its purpose")]

use std::time::Instant;

use atlas::{UnwrapInput, UnwrapOptions, UnwrapperChoice};
use glam::{DMat3, Vec3};
use mesh_ingest::{Mesh, Primitive};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let unwrapper = match arguments.first().map(String::as_str) {
        Some("xatlas") => UnwrapperChoice::Xatlas,
        Some("box") => UnwrapperChoice::Box,
        _ => UnwrapperChoice::Unroll,
    };
    let number = |k: usize, or: usize| arguments.get(k).and_then(|x| x.parse().ok()).unwrap_or(or);
    let (mut n, last) = (number(1, 1000), number(2, 64_000));
    println!("| mesh | triangles | charts | seconds | µs a triangle |");
    println!("|---|---|---|---|---|");
    while n <= last {
        for (name, mesh) in meshes(n as u32) {
            let input = UnwrapInput::from_mesh(&mesh, DMat3::IDENTITY);
            let area: f64 = input.areas().iter().sum();
            let options = UnwrapOptions {
                texels_per_unit: (200_000.0 / area).sqrt() as f32,
                padding: 2,
                block: 4,
                block_charts: false,
                max_size: 2048,
            };
            let start = Instant::now();
            let result = unwrapper.candidates()[0].unwrap(&input, &options, &|| false);
            let seconds = start.elapsed().as_secs_f64();
            let count = input.triangles.len();
            let charts = result.map_or_else(|e| e.to_string(), |r| r.charts.to_string());
            let each = 1e6 * seconds / count as f64;
            println!("| {name} | {count} | {charts} | {seconds:.2} | {each:.0} |");
        }
        n *= 2;
    }
}

/// Worst cases of about `n` triangles.
fn meshes(n: u32) -> Vec<(&'static str, Mesh)> {
    vec![
        ("loose triangles", loose(n)),
        ("soup of shared vertices", shared(n)),
        ("cards", cards(n)),
        ("terrain", sheet(n, 0.02)),
        ("crumpled paper", sheet(n, 3.0)),
        ("sphere", sphere(n)),
    ]
}

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        primitives: vec![Primitive {
            positions,
            source_triangles: (0..triangles.len() as u32).collect(),
            triangles,
            ..Primitive::default()
        }],
        ..Mesh::default()
    }
}

/// Numbers from −1 to 1 (a 64-bit linear congruential generator after Knuth).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = (self.0)
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn place(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
}

fn loose(n: u32) -> Mesh {
    let mut r = Random(1);
    let positions = (0..n).flat_map(|_| {
        let at = r.place() * 10.0;
        [at, at + r.place(), at + r.place()]
    });
    mesh(
        positions.collect(),
        (0..n).map(|t| [0, 1, 2].map(|k| 3 * t + k)).collect(),
    )
}

/// Every vertex is in about thirty triangles.
fn shared(n: u32) -> Mesh {
    let (mut r, vertices) = (Random(2), (n / 10).max(4));
    let positions = (0..vertices).map(|_| r.place()).collect();
    let mut r = Random(3);
    let mut pick = || ((r.next() + 1.0) * 0.5 * vertices as f32) as u32 % vertices;
    let triangles = (0..n).map(|_| {
        let a = pick();
        [
            a,
            (a + 1 + pick() % (vertices / 2 - 1)) % vertices,
            (a + vertices - 1) % vertices,
        ]
    });
    mesh(positions, triangles.collect())
}

/// Cards of two triangles, like foliage.
fn cards(n: u32) -> Mesh {
    let (mut r, mut positions, mut triangles) = (Random(4), Vec::new(), Vec::new());
    for k in 0..n / 2 {
        let (at, x) = (r.place() * 10.0, r.place().normalize_or(Vec3::X));
        let y = x.cross(r.place()).normalize_or(Vec3::Y);
        positions.extend([at, at + x, at + x + y, at + y]);
        triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| 4 * k + i)));
    }
    mesh(positions, triangles)
}

/// A square sheet with noise of `noise` cells.
fn sheet(n: u32, noise: f32) -> Mesh {
    let (mut r, side) = (Random(5), ((n / 2) as f32).sqrt() as u32);
    let positions =
        (0..=side).flat_map(|i| (0..=side).map(move |j| Vec3::new(i as f32, 0.0, j as f32)));
    let positions = positions.map(|p| {
        let wave = (p.x * 0.07).sin() * (p.z * 0.05).cos() * 3.0;
        p + Vec3::Y * (wave + noise * r.next())
    });
    let row = side + 1;
    let cells = (0..side).flat_map(|i| (0..side).map(move |j| i * row + j));
    let triangles = cells.flat_map(|a| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]);
    mesh(positions.collect(), triangles.collect())
}

fn sphere(n: u32) -> Mesh {
    let rings = ((n / 4) as f32).sqrt().max(3.0) as u32;
    let columns = 2 * rings;
    let at = |i: u32, j: u32| {
        let (a, b) = (
            std::f32::consts::PI * i as f32 / rings as f32,
            std::f32::consts::TAU * (j % columns) as f32 / columns as f32,
        );
        Vec3::new(a.sin() * b.cos(), a.cos(), a.sin() * b.sin())
    };
    let positions = (0..=rings).flat_map(|i| (0..columns).map(move |j| at(i, j)));
    let cell = |i: u32, j: u32| i * columns + j % columns;
    let mut triangles = Vec::new();
    for i in 0..rings {
        for j in 0..columns {
            let (a, b, c, d) = (
                cell(i, j),
                cell(i, j + 1),
                cell(i + 1, j + 1),
                cell(i + 1, j),
            );
            if i > 0 {
                triangles.push([a, b, c]);
            }
            if i + 1 < rings {
                triangles.push([a, c, d]);
            }
        }
    }
    mesh(positions.collect(), triangles)
}
