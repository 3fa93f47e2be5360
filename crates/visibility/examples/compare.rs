//! Times this crate's rays against obvhs's own eight-wide tree, in alternating rounds.
//!
//!     cargo run --release -p lumel-visibility --example compare [TRIANGLES.f32] [ROUNDS] [DUMP_DIR]
//!
//! `TRIANGLES.f32` contains nine little-endian floats per triangle; without it (or with `-`) the
//! generated interior is used. With `DUMP_DIR`, triangles and rays are written there for other ray
//! tracers.
#![allow(clippy::print_stdout, reason = "a program that prints its results")]

#[path = "../benches/support/mod.rs"]
mod support;

use std::time::{Duration, Instant};

use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::RayHit;
use obvhs::triangle::Triangle;
use visibility::{AcceptAll, BuildOptions, Bvh, Quality, Ray};

struct Peer {
    tree: CwBvh,
    triangles: Vec<Triangle>,
}

impl Peer {
    fn build(triangles: &[[Vec3; 3]]) -> Peer {
        let input: Vec<Triangle> = triangles
            .iter()
            .map(|t| Triangle {
                v0: t[0].into(),
                v1: t[1].into(),
                v2: t[2].into(),
            })
            .collect();
        let tree = build_cwbvh_from_tris(
            &input,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        let triangles = tree
            .primitive_indices
            .iter()
            .map(|&i| input[i as usize])
            .collect();
        Peer { tree, triangles }
    }

    fn ray(ray: &Ray) -> obvhs::ray::Ray {
        obvhs::ray::Ray::new(
            ray.origin.into(),
            ray.direction.into(),
            ray.t_min,
            ray.t_max,
        )
    }

    fn closest(&self, ray: &Ray) -> bool {
        let mut hit = RayHit::none();
        self.tree.ray_traverse(Self::ray(ray), &mut hit, |ray, id| {
            self.triangles[id].intersect(ray)
        });
        hit.t < f32::INFINITY
    }

    fn occluded(&self, ray: &Ray) -> bool {
        !self
            .tree
            .ray_traverse_miss(Self::ray(ray), |ray, id| self.triangles[id].intersect(ray))
    }
}

/// Processor time of this thread in seconds, which excludes other programs' load; Linux only.
fn busy_seconds() -> Option<f64> {
    let line = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

/// Number of rays that hit, and the time taken on `threads` threads: processor time for one thread,
/// wall time for more.
fn run(rays: &[Ray], threads: usize, cast: impl Fn(&Ray) -> bool + Sync) -> (usize, f64) {
    if threads == 1
        && let Some(start) = busy_seconds()
    {
        let hits = rays.iter().filter(|&r| cast(r)).count();
        return (hits, busy_seconds().unwrap_or(start) - start);
    }
    let start = Instant::now();
    let hits = std::thread::scope(|scope| {
        let chunks: Vec<_> = rays
            .chunks(rays.len().div_ceil(threads))
            .map(|chunk| scope.spawn(|| chunk.iter().filter(|&r| cast(r)).count()))
            .collect();
        chunks
            .into_iter()
            .map(|t| t.join().expect("a caster panicked"))
            .sum()
    });
    (hits, start.elapsed().as_secs_f64())
}

fn median(v: &mut [f64]) -> f64 {
    v.sort_unstable_by(f64::total_cmp);
    v[v.len() / 2]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let triangles = match arguments.next() {
        Some(path) if path != "-" => support::read_triangles(&path)?,
        _ => support::interior(),
    };
    let rounds: usize = arguments.next().map_or(Ok(7), |a| a.parse())?;
    let gather = support::hemisphere_rays(&triangles, 1_000_000, f32::INFINITY);
    if let Some(dir) = arguments.next() {
        let bytes: Vec<u8> = triangles
            .iter()
            .flatten()
            .flat_map(|p| p.to_array())
            .flat_map(f32::to_le_bytes)
            .collect();
        std::fs::write(format!("{dir}/triangles.f32"), bytes)?;
        let bytes: Vec<u8> = gather
            .iter()
            .flat_map(|r| [r.origin.to_array(), r.direction.to_array()])
            .flatten()
            .flat_map(f32::to_le_bytes)
            .collect();
        std::fs::write(format!("{dir}/rays.f32"), bytes)?;
    }
    println!("{} triangles", triangles.len());
    let mut trees = vec![];
    for quality in [Quality::Fast, Quality::Balanced, Quality::High] {
        let mut times: Vec<f64> = vec![];
        let mut built = None;
        for _ in 0..if triangles.len() > 1_000_000 { 1 } else { 3 } {
            let start = Instant::now();
            built = Some(Bvh::build(
                &triangles,
                |_| false,
                &BuildOptions::with_quality(quality),
            )?);
            times.push(start.elapsed().as_secs_f64());
        }
        let bvh = built.expect("built at least once");
        bvh.validate()?;
        println!(
            "build {quality:?}: {:.0} ms, {:?}",
            median(&mut times) * 1e3,
            bvh.stats()
        );
        trees.push((format!("ours {quality:?}"), bvh));
    }
    let portable = trees[1].1.clone().into_portable();
    trees.push(("ours Balanced, portable".into(), portable));
    let start = Instant::now();
    let peer = Peer::build(&triangles);
    println!(
        "build obvhs CwBvh medium: {:.0} ms",
        start.elapsed().as_secs_f64() * 1e3
    );

    let mut table: Vec<(String, Vec<f64>, usize)> = vec![];
    let mut record = |name: String, (hits, seconds): (usize, f64)| match table
        .iter_mut()
        .find(|r| r.0 == name)
    {
        Some(row) => row.1.push(seconds),
        None => table.push((name, vec![seconds], hits)),
    };
    for _ in 0..rounds {
        for threads in [1, 2] {
            for (name, bvh) in &trees {
                record(
                    format!("closest {threads}T {name}"),
                    run(&gather, threads, |r| {
                        bvh.closest_hit(r, &AcceptAll).is_some()
                    }),
                );
            }
            record(
                format!("closest {threads}T obvhs CwBvh"),
                run(&gather, threads, |r| peer.closest(r)),
            );
            for (name, bvh) in &trees {
                record(
                    format!("any hit {threads}T {name}"),
                    run(&gather, threads, |r| bvh.occluded(r, &AcceptAll)),
                );
            }
            record(
                format!("any hit {threads}T obvhs CwBvh"),
                run(&gather, threads, |r| peer.occluded(r)),
            );
        }
    }
    table.sort_by(|a, b| a.0.cmp(&b.0));
    println!(
        "median of {rounds} alternating rounds, {} rays",
        gather.len()
    );
    for (name, mut times, hits) in table {
        println!(
            "{name:40} {:6.2} M rays/s  ({hits} hit)",
            gather.len() as f64 / median(&mut times) / 1e6
        );
    }
    Ok(())
}
