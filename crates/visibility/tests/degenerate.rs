//! Inputs that break tree builders, and answers that must not depend on the machine or the tree.

use std::time::{Duration, Instant};

use crate::common::{AIMS, PLACES, Random, build, cube, icosphere, inside_ray, ray, torus};
use glam::Vec3;
use visibility::{AcceptAll, BuildError, BuildOptions, Bvh};

const TRIANGLE: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

#[test]
fn no_triangles_no_hits() {
    let bvh = build(&[]);
    assert_eq!(bvh.closest_hit(&ray(Vec3::ZERO, Vec3::Z), &AcceptAll), None);
    assert!(!bvh.occluded(&ray(Vec3::ZERO, Vec3::Z), &AcceptAll));
    assert_eq!(bvh.bounds(), None);
    assert_eq!(bvh.stats(), Default::default());
}

#[test]
fn one_triangle_from_both_sides() {
    let bvh = build(&[TRIANGLE]);
    let above = bvh
        .closest_hit(&ray(Vec3::new(0.25, 0.5, 2.0), -Vec3::Z), &AcceptAll)
        .expect("a hit from above");
    assert_eq!(
        (above.triangle, above.t, above.u, above.v, above.back),
        (0, 2.0, 0.25, 0.5, false)
    );
    let below = bvh
        .closest_hit(&ray(Vec3::new(0.25, 0.5, -2.0), Vec3::Z), &AcceptAll)
        .expect("a hit from below");
    assert_eq!(
        (below.triangle, below.t, below.u, below.v, below.back),
        (0, 2.0, 0.25, 0.5, true)
    );
    assert_eq!(bvh.bounds(), Some((Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0))));
}

#[test]
fn bad_coordinates_are_errors() {
    let build = |x: f32| {
        Bvh::build(
            &[TRIANGLE, [Vec3::ZERO, Vec3::X, Vec3::Y * x]],
            |_| false,
            &BuildOptions::default(),
        )
    };
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(build(x).err(), Some(BuildError::NonFinite { triangle: 1 }));
    }
    assert!(matches!(
        build(-1e19).err(),
        Some(BuildError::TooFar { triangle: 1, .. })
    ));
    assert!(build(1e18).is_ok());
}

/// Each of these took obvhs alone seconds to minutes, or overflowed its stack. The limit is a
/// hundred times the required time and only catches quadratic growth.
#[test]
fn crowds_build_quickly() {
    let mut r = Random(1);
    let small = |p: Vec3| TRIANGLE.map(|c| p + c * 1e-3);
    let cases: Vec<(&str, Vec<[Vec3; 3]>)> = vec![
        ("identical", vec![TRIANGLE; 50_000]),
        ("zero-area, coincident", vec![[Vec3::ONE; 3]; 50_000]),
        ("all at the origin", vec![[Vec3::ZERO; 3]; 50_000]),
        (
            "nested",
            (1..50_000)
                .map(|i| TRIANGLE.map(|c| (c - 0.3) * i as f32))
                .collect(),
        ),
        (
            "nested, geometric",
            (0..50_000)
                .map(|i| TRIANGLE.map(|c| (c - 0.3) * 1.0005f32.powi(i)))
                .collect(),
        ),
        (
            "row of equal tiles",
            (0..50_000)
                .map(|i| TRIANGLE.map(|c| c + Vec3::X * i as f32))
                .collect(),
        ),
        (
            "collinear points",
            (0..50_000).map(|i| [Vec3::X * i as f32; 3]).collect(),
        ),
        (
            "collinear segments",
            (0..50_000)
                .map(|i| [0.0, 0.5, 1.0].map(|x| Vec3::X * (i as f32 + x)))
                .collect(),
        ),
        (
            "clumps",
            (0..50_000)
                .map(|i| small(Vec3::new((i % 7) as f32, (i % 11) as f32, 0.0)))
                .collect(),
        ),
        (
            "huge and tiny",
            (0..50_000)
                .map(|i| TRIANGLE.map(|c| c * 10f32.powi(i % 30 - 15) + r.cube().as_vec3()))
                .collect(),
        ),
    ];
    let mut slow = vec![];
    for (name, triangles) in cases {
        let start = Instant::now();
        let bvh = build(&triangles);
        let took = start.elapsed();
        if took > Duration::from_secs(5) {
            slow.push(format!("{name}: {took:?}"));
        }
        let stats = bvh.stats();
        assert!(stats.depth < 200, "{name}: {stats:?}");
        // A ray through the crowd terminates and is deterministic.
        let cast = ray(Vec3::new(0.2, 0.3, 5.0), -Vec3::Z);
        assert_eq!(
            bvh.closest_hit(&cast, &AcceptAll),
            bvh.clone().into_portable().closest_hit(&cast, &AcceptAll)
        );
        if name == "identical" {
            assert_eq!(
                bvh.closest_hit(&cast, &AcceptAll).map(|h| h.triangle),
                Some(0),
                "the lowest index wins"
            );
        }
    }
    assert!(slow.is_empty(), "quadratic builds: {slow:?}");
}

/// A fan from a corner nests every box in the next: the worst case for PLOC.
#[test]
fn a_fan_builds() {
    let n = 5_000;
    let at = |i: usize| Vec3::new(1.0, i as f32 / n as f32, 0.0);
    let fan: Vec<_> = (0..n).map(|i| [Vec3::ZERO, at(i), at(i + 1)]).collect();
    let bvh = build(&fan);
    let hit = bvh.closest_hit(&ray(Vec3::new(0.9, 0.4, 1.0), -Vec3::Z), &AcceptAll);
    assert!(hit.is_some_and(|h| h.t == 1.0), "{hit:?}");
}

#[test]
fn of_equal_hits_the_lowest_index_wins() {
    let mut r = Random(2);
    // Each triangle three times, far apart in the list, corners rotated the same way.
    let once: Vec<[Vec3; 3]> = (0..100)
        .map(|_| {
            let c = r.cube();
            [0; 3].map(|_| (c + r.cube() * 0.4).as_vec3())
        })
        .collect();
    let thrice = [once.clone(), once.clone(), once.clone()].concat();
    let (one, three) = (build(&once), build(&thrice));
    for _ in 0..20_000 {
        let ray = ray((r.cube() * 1.5).as_vec3(), r.direction().as_vec3());
        assert_eq!(
            one.closest_hit(&ray, &AcceptAll),
            three.closest_hit(&ray, &AcceptAll)
        );
    }
}

#[test]
fn both_paths_return_the_same_bits() {
    // Without AVX2 both are the portable path; CI machines have AVX2.
    for mesh in [icosphere(4), torus(48, 24), cube(12)] {
        for place in PLACES {
            let mut triangles = place.mesh(&mesh);
            // Ties: everything twice.
            triangles.extend(triangles.clone());
            let detected = build(&triangles);
            let portable = detected.clone().into_portable();
            let mut r = Random(3);
            for aim in AIMS {
                for _ in 0..1_500 {
                    let ray = inside_ray(&mesh, &triangles, place, aim, &mut r);
                    let bits = |b: &Bvh| {
                        b.closest_hit(&ray, &AcceptAll).map(|h| {
                            (
                                h.triangle,
                                h.t.to_bits(),
                                h.u.to_bits(),
                                h.v.to_bits(),
                                h.back,
                            )
                        })
                    };
                    assert_eq!(
                        bits(&detected),
                        bits(&portable),
                        "{} {place:?} {aim:?} {ray:?}",
                        mesh.name
                    );
                    assert_eq!(
                        detected.occluded(&ray, &AcceptAll),
                        portable.occluded(&ray, &AcceptAll)
                    );
                }
            }
        }
    }
}

/// Rays that start exactly on the planes of boxes and run along them: 0 × ∞ in the slabs.
#[test]
fn flat_boxes_and_rays_in_their_planes() {
    let mesh = cube(8);
    let bvh = build(&mesh.triangles);
    let brute = crate::common::BruteForce::new(&mesh.triangles);
    for i in -8i32..=8 {
        for j in -8i32..=8 {
            let p = Vec3::new(i as f32 / 8.0, j as f32 / 8.0, 0.0);
            for axis in 0..3 {
                for sign in [-1.0, 1.0] {
                    for zero in [0.0, -0.0] {
                        let mut direction = Vec3::splat(zero);
                        direction[axis] = sign;
                        for turn in 0..3 {
                            let origin =
                                Vec3::from_array([p[turn], p[(turn + 1) % 3], p[(turn + 2) % 3]]);
                            let ray = ray(origin, direction);
                            let hit = bvh.closest_hit(&ray, &AcceptAll);
                            assert_eq!(hit, brute.closest(&ray, |_, _| false), "{ray:?}");
                            // Away from its walls the cube is closed around the origin.
                            if origin.abs().max_element() < 1.0 {
                                assert!(hit.is_some(), "leak: {ray:?}");
                            }
                        }
                    }
                }
            }
        }
    }
}
