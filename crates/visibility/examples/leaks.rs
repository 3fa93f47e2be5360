//! Casts millions of rays from inside closed meshes and counts those that escape.
//!
//!     cargo run --release -p lumel-visibility --example leaks [RAYS_PER_KIND]
#![allow(clippy::print_stdout, reason = "a program that prints its results")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{AIMS, PLACES, Random, build, cube, icosphere, inside_ray, torus};
use visibility::AcceptAll;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rays: u64 = std::env::args()
        .nth(1)
        .map_or(Ok(10_000_000), |a| a.parse())?;
    let meshes = [icosphere(6), torus(256, 128), cube(48)];
    let per_case = rays.div_ceil((meshes.len() * PLACES.len()) as u64);
    let mut total = 0;
    for aim in AIMS {
        let (mut missed, mut open) = (0u64, 0u64);
        for mesh in &meshes {
            for place in PLACES {
                let triangles = place.mesh(mesh);
                let bvh = build(&triangles);
                let count = |seed: u64, n: u64| {
                    let mut r = Random(seed);
                    let (mut missed, mut open) = (0u64, 0u64);
                    for _ in 0..n {
                        let ray = inside_ray(mesh, &triangles, place, aim, &mut r);
                        missed += u64::from(bvh.closest_hit(&ray, &AcceptAll).is_none());
                        open += u64::from(!bvh.occluded(&ray, &AcceptAll));
                    }
                    (missed, open)
                };
                let (a, b) = std::thread::scope(|scope| {
                    let other = scope.spawn(|| count(1, per_case / 2));
                    (count(2, per_case - per_case / 2), other.join())
                });
                let b = b.map_err(|_| "a caster panicked")?;
                if a.0 + a.1 + b.0 + b.1 > 0 {
                    println!(
                        "  {} of {} triangles, {place:?}, {aim:?}: {a:?} {b:?}",
                        mesh.name,
                        triangles.len()
                    );
                }
                missed += a.0 + b.0;
                open += a.1 + b.1;
            }
        }
        total += missed + open;
        println!(
            "{aim:?}: {} rays, {missed} missed (closest), {open} missed (any hit)",
            per_case * 15
        );
    }
    if total > 0 {
        Err("leaks".into())
    } else {
        Ok(())
    }
}
