//! The tree returns the same as testing every triangle, bit for bit, and respects ranges and
//! filters.

use crate::common::{BruteForce, EveryThird, Random, build, ray};
use glam::Vec3;
use visibility::{AcceptAll, BuildOptions, Bvh, HitFilter, Quality, Ray};

fn soup(count: usize, size: f64, scale: f32, r: &mut Random) -> Vec<[Vec3; 3]> {
    (0..count)
        .map(|_| {
            let centre = r.cube();
            [0; 3].map(|_| (centre + r.cube() * size).as_vec3() * scale)
        })
        .collect()
}

#[test]
fn closest_hit_equals_brute_force_on_random_soups() {
    for (count, size, scale) in [
        (1, 1.0, 1.0),
        (7, 1.0, 1.0),
        (40, 0.5, 1.0),
        (300, 0.1, 1.0),
        (300, 2.0, 1e3),
        (500, 0.2, 1e-6),
        (200, 0.3, 1e12),
    ] {
        let mut r = Random(count as u64);
        let triangles = soup(count, size, scale, &mut r);
        let brute = BruteForce::new(&triangles);
        for quality in [Quality::Fast, Quality::Balanced, Quality::High] {
            let bvh = Bvh::build(&triangles, |_| false, &BuildOptions::with_quality(quality))
                .expect("finite");
            bvh.validate().expect("sound");
            let mut hits = 0;
            for _ in 0..5_000 {
                let origin = (r.cube() * 1.5).as_vec3() * scale;
                let mut ray = ray(
                    origin,
                    r.direction().as_vec3() * (r.unit() as f32 * 3.0 + 1e-3),
                );
                if r.below(2) == 0 {
                    ray.t_min = r.unit() as f32 * scale;
                    ray.t_max = ray.t_min + r.unit() as f32 * scale;
                }
                let expected = brute.closest(&ray, |_, _| false);
                let got = bvh.closest_hit(&ray, &AcceptAll);
                assert_eq!(
                    got, expected,
                    "{count} triangles of {size} × {scale}, {quality:?}, {ray:?}"
                );
                assert_eq!(
                    bvh.occluded(&ray, &AcceptAll),
                    expected.is_some(),
                    "{ray:?}"
                );
                hits += u32::from(got.is_some());
            }
            assert!(
                hits > 5,
                "only {hits} of 5000 rays hit: the test sees nothing"
            );
        }
    }
}

#[test]
fn a_hit_lies_where_it_says() {
    let mut r = Random(5);
    let triangles = soup(200, 0.4, 1.0, &mut r);
    let bvh = build(&triangles);
    let mut hits = 0;
    for _ in 0..20_000 {
        let ray = ray((r.cube() * 1.5).as_vec3(), (r.direction() * 3.0).as_vec3());
        let Some(hit) = bvh.closest_hit(&ray, &AcceptAll) else {
            continue;
        };
        hits += 1;
        let [a, b, c] = triangles[hit.triangle as usize].map(|p| p.as_dvec3());
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let on_triangle = a + (b - a) * u + (c - a) * v;
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let normal = (b - a).cross(c - a);
        // Some rays hit the plane at a shallow angle: errors of 2^-24 × distance grow by its
        // inverse sine.
        let sine = (normal.normalize().dot(d.normalize())).abs();
        let error = (o + d * f64::from(hit.t) - on_triangle).length();
        assert!(
            error < 1e-5 + 2e-6 / sine,
            "{error} apart, sine {sine}, {hit:?}"
        );
        assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6, "{hit:?}");
        assert_eq!(hit.back, normal.dot(d) > 0.0, "{hit:?}");
    }
    assert!(hits > 1_000, "only {hits} hits");
}

#[test]
fn the_range_is_open_at_both_ends_and_has_no_epsilon() {
    for scale in [1e-12f32, 1e-6, 1.0, 1e6, 1e12] {
        let wall = [[
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(3.0, -1.0, 1.0),
            Vec3::new(-1.0, 3.0, 1.0),
        ]
        .map(|p| p * scale)];
        let bvh = build(&wall);
        let cast = |t_min: f32, t_max: f32| {
            let ray = Ray {
                origin: Vec3::ZERO,
                direction: Vec3::Z,
                t_min,
                t_max,
            };
            let hit = bvh.closest_hit(&ray, &AcceptAll);
            assert_eq!(hit.is_some(), bvh.occluded(&ray, &AcceptAll), "{ray:?}");
            hit.map(|h| h.t)
        };
        let (before, after) = (scale.next_down(), scale.next_up());
        assert_eq!(cast(0.0, f32::INFINITY), Some(scale));
        assert_eq!(cast(before, after), Some(scale));
        assert_eq!(cast(scale, f32::INFINITY), None, "t_min is excluded");
        assert_eq!(cast(0.0, scale), None, "t_max is excluded");
        assert_eq!(
            cast(-1.0, after),
            Some(scale),
            "a negative t_min counts as zero"
        );
        assert_eq!(cast(after, before), None, "empty range");
    }
    // The wall at t = 9e-5, which obvhs skips.
    let near = build(&[[
        Vec3::new(-1.0, -1.0, 9e-5),
        Vec3::new(3.0, -1.0, 9e-5),
        Vec3::new(-1.0, 3.0, 9e-5),
    ]]);
    assert_eq!(
        near.closest_hit(&ray(Vec3::ZERO, Vec3::Z), &AcceptAll)
            .map(|h| h.t),
        Some(9e-5)
    );
}

#[test]
fn t_counts_in_lengths_of_the_direction() {
    let wall = build(&[[
        Vec3::new(-1.0, -1.0, 1.0),
        Vec3::new(3.0, -1.0, 1.0),
        Vec3::new(-1.0, 3.0, 1.0),
    ]]);
    for exponent in [-120, -60, -25, -10, 0, 10, 25, 60, 120] {
        let length = 2f32.powi(exponent);
        let hit = wall.closest_hit(&ray(Vec3::ZERO, Vec3::Z * length), &AcceptAll);
        assert_eq!(
            hit.map(|h| h.t),
            Some(1.0 / length),
            "direction of length 2^{exponent}"
        );
    }
    // A small component of a short direction counts: at z = 1 the ray is at x = 1e-3.
    let strip = build(&[[
        Vec3::new(0.9e-3, -1.0, 1.0),
        Vec3::new(1.1e-3, -1.0, 1.0),
        Vec3::new(1e-3, 3.0, 1.0),
    ]]);
    assert!(
        strip
            .closest_hit(&ray(Vec3::ZERO, Vec3::new(1e-39, 0.0, 1e-36)), &AcceptAll)
            .is_some()
    );
}

#[test]
fn rays_that_make_no_sense_hit_nothing() {
    let wall = build(&[[
        Vec3::new(-1.0, -1.0, 1.0),
        Vec3::new(3.0, -1.0, 1.0),
        Vec3::new(-1.0, 3.0, 1.0),
    ]]);
    let good = ray(Vec3::ZERO, Vec3::Z);
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let mut bad = vec![
        Ray { t_min: nan, ..good },
        Ray { t_max: nan, ..good },
        Ray {
            t_min: 2.0,
            t_max: 1.0,
            ..good
        },
    ];
    bad.push(Ray {
        direction: Vec3::ZERO,
        ..good
    });
    for x in [nan, inf, -inf] {
        for axis in 0..3 {
            let mut v = Vec3::Z;
            v[axis] = x;
            bad.extend([
                Ray {
                    direction: v,
                    ..good
                },
                Ray { origin: v, ..good },
            ]);
        }
    }
    bad.push(Ray {
        origin: Vec3::splat(1e30),
        ..good
    });
    for ray in bad {
        assert_eq!(wall.closest_hit(&ray, &AcceptAll), None, "{ray:?}");
        assert!(!wall.occluded(&ray, &AcceptAll), "{ray:?}");
    }
}

#[test]
fn filtered_triangles_ask_and_others_do_not() {
    struct Refuse(std::sync::Mutex<Vec<u32>>);
    impl HitFilter for Refuse {
        fn accept(&self, triangle: u32, u: f32, v: f32, _: &Ray) -> bool {
            assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.000_001);
            self.0.lock().expect("not poisoned").push(triangle);
            false
        }
    }
    // Three walls one behind the other; the first is masked.
    let wall = |z: f32| {
        [
            Vec3::new(-1.0, -1.0, z),
            Vec3::new(3.0, -1.0, z),
            Vec3::new(-1.0, 3.0, z),
        ]
    };
    let walls = [wall(1.0), wall(2.0), wall(3.0)];
    let masked = Bvh::build(&walls, |i| i == 0, &BuildOptions::default()).expect("finite");
    let refuse = Refuse(Default::default());
    let hit = masked
        .closest_hit(&ray(Vec3::ZERO, Vec3::Z), &refuse)
        .expect("the second wall");
    assert_eq!((hit.triangle, hit.t), (1, 2.0));
    assert!(masked.occluded(&ray(Vec3::ZERO, Vec3::Z), &refuse));
    assert!(
        !masked.occluded(
            &Ray {
                t_max: 1.5,
                ..ray(Vec3::ZERO, Vec3::Z)
            },
            &refuse
        ),
        "only the masked wall is near"
    );
    assert!(
        refuse
            .0
            .lock()
            .expect("not poisoned")
            .iter()
            .all(|&t| t == 0),
        "only the flagged triangle asks"
    );
    assert_eq!(
        masked
            .closest_hit(&ray(Vec3::ZERO, Vec3::Z), &AcceptAll)
            .map(|h| h.triangle),
        Some(0)
    );

    let mut r = Random(9);
    let triangles = soup(300, 0.3, 1.0, &mut r);
    let brute = BruteForce::new(&triangles);
    let bvh = Bvh::build(&triangles, |i| i % 2 == 0, &BuildOptions::default()).expect("finite");
    for _ in 0..5_000 {
        let ray = ray((r.cube() * 1.5).as_vec3(), r.direction().as_vec3());
        let expected = brute.closest(&ray, |i, _| i % 2 == 0 && i % 3 != 0);
        assert_eq!(bvh.closest_hit(&ray, &EveryThird), expected);
        assert_eq!(bvh.occluded(&ray, &EveryThird), expected.is_some());
    }
}

#[test]
fn slices_give_what_single_rays_give() {
    let mut r = Random(21);
    let bvh = build(&soup(200, 0.3, 1.0, &mut r));
    let rays: Vec<Ray> = (0..1000)
        .map(|_| ray((r.cube() * 1.5).as_vec3(), r.direction().as_vec3()))
        .collect();
    let mut hits = vec![None; rays.len()];
    let mut hidden = vec![false; rays.len()];
    bvh.closest_hits(&rays, &AcceptAll, &mut hits);
    bvh.occluded_many(&rays, &AcceptAll, &mut hidden);
    for (i, ray) in rays.iter().enumerate() {
        assert_eq!(hits[i], bvh.closest_hit(ray, &AcceptAll));
        assert_eq!(hidden[i], bvh.occluded(ray, &AcceptAll));
    }
}
