//! Rays and builds on a generated interior of 260,000 triangles, compared with obvhs's own
//! eight-wide tree.
//!
//!     cargo bench -p lumel-visibility
//!
//! `examples/compare.rs` does the same in alternating rounds and on any mesh; quote figures from
//! there.
#![allow(missing_docs, reason = "benches are not an interface")]

mod support;

use std::sync::LazyLock;
use std::time::Duration;

use divan::{Bencher, counter::ItemsCount};
use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::RayHit;
use obvhs::triangle::Triangle;
use visibility::{AcceptAll, BuildOptions, Bvh, Quality, Ray};

struct Scene {
    triangles: Vec<[Vec3; 3]>,
    rays: Vec<Ray>,
    ours: Bvh,
    portable: Bvh,
    peer: CwBvh,
    peer_triangles: Vec<Triangle>,
}

/// Rays per measured iteration.
const BATCH: usize = 50_000;

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let triangles = support::interior();
    let ours = Bvh::build(&triangles, |_| false, &BuildOptions::default())
        .expect("the interior is finite");
    let (peer, peer_triangles) = build_peer(&triangles);
    Scene {
        rays: support::hemisphere_rays(&triangles, BATCH, f32::INFINITY),
        portable: ours.clone().into_portable(),
        ours,
        peer,
        peer_triangles,
        triangles,
    }
});

fn build_peer(triangles: &[[Vec3; 3]]) -> (CwBvh, Vec<Triangle>) {
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
    (tree, triangles)
}

fn peer_ray(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new(
        ray.origin.into(),
        ray.direction.into(),
        ray.t_min,
        ray.t_max,
    )
}

fn cast(bencher: Bencher, one: impl Fn(&Scene, &Ray) -> bool + Sync) {
    let scene = &*SCENE;
    bencher
        .counter(ItemsCount::new(BATCH))
        .bench(|| scene.rays.iter().filter(|&ray| one(scene, ray)).count());
}

#[divan::bench(threads = [1, 2], sample_count = 20)]
fn closest_ours(bencher: Bencher) {
    cast(bencher, |s, ray| {
        s.ours.closest_hit(ray, &AcceptAll).is_some()
    });
}

#[divan::bench(threads = [1, 2], sample_count = 20)]
fn closest_ours_portable(bencher: Bencher) {
    cast(bencher, |s, ray| {
        s.portable.closest_hit(ray, &AcceptAll).is_some()
    });
}

#[divan::bench(threads = [1, 2], sample_count = 20)]
fn closest_obvhs(bencher: Bencher) {
    cast(bencher, |s, ray| {
        let mut hit = RayHit::none();
        s.peer.ray_traverse(peer_ray(ray), &mut hit, |ray, id| {
            s.peer_triangles[id].intersect(ray)
        });
        hit.t < f32::INFINITY
    });
}

#[divan::bench(threads = [1, 2], sample_count = 20)]
fn any_hit_ours(bencher: Bencher) {
    cast(bencher, |s, ray| s.ours.occluded(ray, &AcceptAll));
}

#[divan::bench(threads = [1, 2], sample_count = 20)]
fn any_hit_ours_portable(bencher: Bencher) {
    cast(bencher, |s, ray| s.portable.occluded(ray, &AcceptAll));
}

#[divan::bench(threads = [1, 2], sample_count = 20)]
fn any_hit_obvhs(bencher: Bencher) {
    cast(bencher, |s, ray| {
        !s.peer
            .ray_traverse_miss(peer_ray(ray), |ray, id| s.peer_triangles[id].intersect(ray))
    });
}

#[divan::bench(args = [Quality::Fast, Quality::Balanced, Quality::High], sample_count = 3, sample_size = 1)]
fn build_ours(bencher: Bencher, quality: Quality) {
    let scene = &*SCENE;
    bencher.bench(|| {
        Bvh::build(
            &scene.triangles,
            |_| false,
            &BuildOptions::with_quality(quality),
        )
    });
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn build_obvhs(bencher: Bencher) {
    let scene = &*SCENE;
    bencher.bench(|| build_peer(&scene.triangles));
}

fn main() {
    divan::main();
}
