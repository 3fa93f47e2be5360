//! Cost of mean reflectances: for each given glTF, texels, memory and time of the pyramids, and
//! time of a lookup.
//!
//! cargo run --release -p lumel-mesh-ingest --example mips_cost -- level.glb …

#![allow(clippy::print_stdout, reason = "printing is what it does")]

use std::path::Path;
use std::time::Instant;

use glam::Vec3;
use mesh_ingest::{Error, LoadOptions, Pyramids, Soup, load};

fn main() -> Result<(), Error> {
    println!("scene, texels (million), MiB, build ms, lookup ns");
    for file in std::env::args().skip(1) {
        let scene = load(Path::new(&file), &LoadOptions::default())?.scene;
        let soup = Soup::build(&scene);
        let texels: u64 = scene
            .images
            .iter()
            .flatten()
            .map(|i| i.pixels.len() as u64)
            .sum();
        let start = Instant::now();
        let pyramids = Pyramids::build(&scene, &soup);
        let build = start.elapsed();
        let total: f64 = soup.areas.iter().map(|&a| f64::from(a)).sum();
        // The size of a patch in a solve with 10,000 patches.
        let area = (total / 1e4) as f32;
        const LOOKUPS: usize = 200_000;
        let start = Instant::now();
        let mut sum = Vec3::ZERO;
        for k in 0..LOOKUPS {
            let tri = (k * 7919 % soup.len()) as u32;
            sum += pyramids.reflectance(&scene, &soup, tri, 0.3, 0.3, area);
        }
        let lookup = start.elapsed().as_secs_f64() * 1e9 / LOOKUPS as f64;
        println!(
            "{file}, {:.2}, {:.1}, {:.1}, {lookup:.0} (mean {:.3})",
            texels as f64 * 1e-6,
            pyramids.bytes() as f64 / f64::from(1 << 20),
            build.as_secs_f64() * 1e3,
            sum / LOOKUPS as f32
        );
    }
    Ok(())
}
