//! Rays that start on or just above thin triangles.

use crate::common::{Random, ray};
use glam::{DVec3, Vec3};
use visibility::{AcceptAll, BuildOptions, Bvh, HitFilter, Ray};

/// A strip of two triangles, 1 long and 1/aspect wide, in any place and orientation, rounded to
/// `f32`.
struct Strip {
    triangles: [[Vec3; 3]; 2],
}

fn strip(aspect: f64, r: &mut Random) -> Strip {
    let along = r.direction();
    let across = along.cross(r.direction()).normalize() / aspect;
    let corner = r.cube() * [0.1, 1.0, 3.0][r.below(3)];
    let [a, b, c, d] = [
        corner,
        corner + along,
        corner + along + across,
        corner + across,
    ]
    .map(|p| p.as_vec3());
    let mut triangles = [[a, b, c], [a, c, d]];
    for t in &mut triangles {
        t.rotate_left(r.below(3));
    }
    Strip { triangles }
}

fn normal(t: &[Vec3; 3]) -> DVec3 {
    let [a, b, c] = t.map(|p| p.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero()
}

/// A point of the first or second triangle, `height` above its front, rounded to `f32`; and the
/// normal there.
fn start(s: &Strip, height: f64, r: &mut Random) -> (Vec3, DVec3) {
    let t = &s.triangles[r.below(2)];
    let [a, b, c] = t.map(|p| p.as_dvec3());
    let (mut u, mut v) = (r.unit(), r.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let n = normal(t);
    ((a + (b - a) * u + (c - a) * v + n * height).as_vec3(), n)
}

struct Both;
impl HitFilter for Both {
    fn accept(&self, _: u32, _: f32, _: f32, _: &Ray) -> bool {
        true
    }
}

/// Whether any query of any version finds a hit; they must agree.
fn hits(forms: &[Bvh], ray: &Ray) -> bool {
    let first = forms[0].closest_hit(ray, &AcceptAll);
    for f in forms {
        assert_eq!(f.closest_hit(ray, &Both), first, "{ray:?}");
        assert_eq!(f.occluded(ray, &Both), first.is_some(), "{ray:?}");
    }
    first.is_some()
}

/// AVX2 (if available) and portable, unfiltered and filtered.
fn forms(s: &Strip) -> Vec<Bvh> {
    [false, true]
        .into_iter()
        .flat_map(|filtered| {
            let bvh =
                Bvh::build(&s.triangles, |_| filtered, &BuildOptions::default()).expect("finite");
            [bvh.clone(), bvh.into_portable()]
        })
        .collect()
}

#[test]
fn a_ray_that_leaves_a_sliver_does_not_meet_it_or_its_twin() {
    let mut r = Random(3);
    let mut wrong = vec![];
    for aspect in [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6] {
        let mut cast = 0;
        let mut met = 0;
        for _ in 0..200 {
            let s = strip(aspect, &mut r);
            let forms = forms(&s);
            // The offset of surface points in the crate `radiosity`.
            let size = s.triangles.as_flattened().iter();
            let size = size.fold(0f32, |m, p| m.max(p.abs().max_element()));
            for _ in 0..100 {
                let (origin, n) = start(&s, 1.2e-6 * f64::from(size), &mut r);
                let mut d = r.direction();
                // Away from both halves, and in front of both: rounding of the corners folds the
                // thinnest strips.
                if s.triangles.iter().any(|t| normal(t).dot(d) < 0.0) {
                    d = -d;
                }
                let clear = s.triangles.iter().all(|t| {
                    let m = normal(t);
                    m.dot(d) > 0.0
                        && m.dot(n) > 0.0
                        && m.dot(origin.as_dvec3() - t[0].as_dvec3()) > 0.0
                });
                if clear {
                    cast += 1;
                    met += u32::from(hits(&forms, &ray(origin, d.as_vec3())));
                }
            }
        }
        if met > 0 || cast < 500 {
            wrong.push(format!("aspect {aspect:e}: {met} of {cast}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn a_ray_that_starts_in_front_of_a_sliver_meets_it() {
    let mut r = Random(4);
    let mut wrong = vec![];
    for aspect in [1.0, 10.0, 100.0, 1e3, 1e4] {
        let (mut cast, mut met) = (0, 0);
        for _ in 0..200 {
            let s = strip(aspect, &mut r);
            let forms = forms(&s);
            for _ in 0..100 {
                let (target, n) = start(&s, 0.0, &mut r);
                let d = r.direction();
                let d = if d.dot(n) > 0.0 { -d } else { d };
                // 1e-5 along the normal; at most 1e-3 along the ray.
                let Some(back) = Some(1e-5 / -d.dot(n)).filter(|b| *b < 1e-3) else {
                    continue;
                };
                let origin = (target.as_dvec3() - d * back).as_vec3();
                // After rounding, the exact line must still cross one of the triangles, in front.
                if s.triangles.iter().any(|t| crosses(t, origin, d.as_vec3())) {
                    cast += 1;
                    met += u32::from(hits(&forms, &ray(origin, d.as_vec3())));
                }
            }
        }
        if met < cast || cast < 500 {
            wrong.push(format!("aspect {aspect:e}: {met} of {cast}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// Whether the ray crosses the triangle's interior in `f64`, 1e-6 inside its edges (the edges' own
/// rounding is 2⁻²⁴), in front.
fn crosses(t: &[Vec3; 3], origin: Vec3, d: Vec3) -> bool {
    let o = origin.as_dvec3();
    let [a, b, c] = t.map(|p| p.as_dvec3() - o);
    let d = d.as_dvec3();
    let n = (b - a).cross(c - a);
    let at = n.dot(a) / n.dot(d);
    let p = d * at;
    let inside = [(a, b), (b, c), (c, a)]
        .into_iter()
        .all(|(p0, p1)| n.normalize().cross(p1 - p0).dot(p - p0) > 1e-6 * (p1 - p0).length());
    at > 0.0 && inside
}
