//! The path tracer against closed forms. Random numbers are fixed, so the tests are deterministic.
//! The bounds on z keep a correct estimator from failing when its random numbers change: of 20
//! values of z, one exceeds 4 once in 800 times.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec3};

use super::*;
use crate::scenes::closed_form as forms;
use crate::scenes::{FurnaceShape, cornell_box, furnace};

const WORST_Z: f64 = 4.0;

fn tracer(glb: &[u8]) -> PathTracer {
    PathTracer::new(Scene::from_glb(glb).expect("a scene that it models"))
}

/// A footprint of the point of the scene's first triangle pair (a floor) that lies at (x, z), and
/// that point.
fn floor_point(t: &PathTracer, x: f64, z: f64) -> Footprint {
    let p = DVec3::new(x, 0.0, z);
    for (i, triangle) in t.scene().triangles.iter().enumerate().take(2) {
        let [a, b, c] = triangle.corners;
        let n = triangle.cross();
        let (u, v) = (
            (c - a).cross(a - p).dot(n) / n.length_squared(),
            (b - a).cross(p - a).dot(n) / n.length_squared(),
        );
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            assert!(triangle.at(u, v).distance(p) < 1e-12);
            return Footprint::of_point(i, u, v);
        }
    }
    panic!("({x}, {z}) is not on the floor");
}

fn z(e: &Estimate, exact: f64) -> f64 {
    (e.mean.x - exact) / e.error.x
}

#[test]
fn a_point_light_has_no_noise() {
    let t = tracer(&forms::point_over_floor(100.0, 1.5));
    for r in [0.0, 0.5, 1.9] {
        let e = t.irradiance(&[floor_point(&t, r, 0.0)], Effort::new(2, 1))[0];
        let exact = forms::point_irradiance(100.0, 1.5, r);
        // f64 arithmetic on coordinates that f32 holds exactly or to 6e-8 (the candela are 100 ×
        // 1.0).
        assert!(
            (e.mean.x / exact - 1.0).abs() < 1e-7 && e.error.x == 0.0,
            "{e:?} {exact}"
        );
    }
}

#[test]
fn a_spot_and_a_sun_have_no_noise() {
    let (inner, outer) = (0.3f32, 0.6f32);
    let t = tracer(&forms::spot_over_floor(100.0, 2.0, inner, outer));
    for angle in [0.0, 0.2, 0.4, 0.5, 0.7f64] {
        let r = 2.0 * angle.tan();
        let ramp = (angle.cos() - f64::from(outer).cos())
            / (f64::from(inner).cos() - f64::from(outer).cos());
        let exact = forms::point_irradiance(100.0, 2.0, r) * ramp.clamp(0.0, 1.0).powi(2);
        let e = t.irradiance(&[floor_point(&t, r, 0.0)], Effort::new(2, 1))[0];
        // The node's rotation is stored as f32: 1e-7 radians, which the cone's slope of about 10
        // turns into 1e-6.
        assert!(
            (e.mean.x - exact).abs() < 1e-5 * 25.0,
            "{angle}: {e:?} {exact}"
        );
    }
    let direction = Vec3::new(0.4, -1.0, 0.3);
    let t = tracer(&forms::sun_over_floor(3.0, direction));
    let e = t.irradiance(&[floor_point(&t, 0.0, 0.1)], Effort::new(2, 1))[0];
    let exact = 3.0 / f64::from(direction.length());
    assert!((e.mean.x / exact - 1.0).abs() < 1e-6, "{e:?} {exact}");
}

#[test]
fn a_wide_sun_on_a_floor() {
    // The vector irradiance of a disc of even radiance lies along its axis.
    let turned = Vec3::new(3f32.sqrt(), -1.0, 0.0) / 2.0;
    let mut scene = Scene::from_glb(&forms::sun_over_floor(7.0, turned)).expect("a floor");
    for light in &mut scene.lights {
        let Light::Directional { radius, .. } = light else {
            panic!("{light:?}");
        };
        *radius = 0.4;
    }
    let t = PathTracer::new(scene);
    let e = t.irradiance(&[floor_point(&t, 0.25, 0.0)], Effort::new(20_000, 1))[0];
    assert!(e.error.x > 0.0 && z(&e, 3.5).abs() < WORST_Z, "{e:?}");
}

#[test]
fn a_rectangle_over_a_floor() {
    let t = tracer(&forms::rectangle_over_floor(2.0, 1.0, 0.7));
    let places = [(0.0, 0.0), (0.4, 0.1), (0.5, 0.5), (1.5, -0.3), (-1.9, 1.9)];
    let footprints: Vec<_> = places.iter().map(|p| floor_point(&t, p.0, p.1)).collect();
    for emitters in [
        EmitterSampling::Hits,
        EmitterSampling::Points,
        EmitterSampling::Both,
    ] {
        let effort = Effort {
            emitters,
            ..Effort::new(20_000, 7)
        };
        for ((x, z_), e) in places.iter().zip(t.irradiance(&footprints, effort)) {
            let exact = forms::polygon_irradiance(
                2.0,
                &forms::square(1.0, 0.7),
                DVec3::new(*x, 0.0, *z_),
                DVec3::Y,
            );
            assert!(
                z(&e, exact).abs() < WORST_Z,
                "{emitters:?} ({x}, {z_}): {e:?} {exact}"
            );
            // For points, the noise of a single path is some per cent of the value; a wrong
            // constant factor cannot hide in it.
            let limit = if emitters == EmitterSampling::Hits {
                0.2
            } else {
                0.02
            };
            assert!(
                e.error.x < limit * exact,
                "{emitters:?} ({x}, {z_}): {e:?} {exact}"
            );
        }
    }
}

#[test]
fn furnaces() {
    for (shape, rho) in [
        (FurnaceShape::Cube, 0.5),
        (FurnaceShape::NonConvex, 0.5),
        (FurnaceShape::NonConvex, 0.9),
        (FurnaceShape::Sphere, 0.99),
    ] {
        let t = tracer(&furnace(rho, 1.0, shape));
        let exact = PI / (1.0 - f64::from(rho));
        let footprints: Vec<_> = (0..8)
            .map(|i| Footprint::of_point(i, 0.3, 0.1 + 0.05 * i as f64))
            .collect();
        let paths = if rho < 0.9 { 10_000 } else { 2_000 };
        for (i, e) in t
            .irradiance(&footprints, Effort::new(paths, 3))
            .iter()
            .enumerate()
        {
            assert!(
                z(e, exact).abs() < WORST_Z,
                "{shape:?} {rho} {i}: {e:?} {exact}"
            );
        }
    }
}

#[test]
fn a_uniform_sky_and_the_mouth_of_a_box() {
    let mut scene = Scene::from_glb(&forms::sky_over_open_box(1.0, 0.5)).expect("a scene");
    scene.sky = DVec3::new(2.0, 1.0, 0.0);
    let t = PathTracer::new(scene);
    let footprints: Vec<_> = (0..t.scene().triangles.len())
        .map(|i| Footprint::of_point(i, 0.4, 0.2))
        .collect();
    for (i, e) in t
        .irradiance(&footprints, Effort::new(20_000, 5))
        .iter()
        .enumerate()
    {
        let triangle = &t.scene().triangles[i];
        let exact = forms::polygon_irradiance(
            1.0,
            &forms::mouth(1.0),
            triangle.at(0.4, 0.2),
            triangle.normal(),
        );
        assert!(
            ((e.mean.y - exact) / e.error.y).abs() < WORST_Z,
            "{i}: {e:?} {exact}"
        );
        assert!((e.mean.x - 2.0 * e.mean.y).abs() < 1e-12 && e.mean.z == 0.0);
    }
}

#[test]
fn an_indirectly_lit_sphere() {
    let (glb, share) = forms::sphere_interior(3.0, 0.6, 0.5, 3);
    let t = tracer(&glb);
    // In a sphere F_ij does not depend on i, so E = mean(M_e)/(1−ρ). With flat facets this holds
    // for the mean over the sphere only up to the order of their angle squared
    // (forms::sphere_interior), so every 16th facet is tested, with an additional tolerance of 4^−3
    // ≈ 1.6 % for the mean.
    let footprints: Vec<_> = (0..t.scene().triangles.len())
        .step_by(16)
        .map(|i| Footprint::of_point(i, 0.33, 0.33))
        .collect();
    let all = t.irradiance(&footprints, Effort::new(1_000, 11));
    let n = all.len() as f64;
    let mean = all.iter().map(|e| e.mean.x).sum::<f64>() / n;
    let error = all.iter().map(|e| e.error.x.powi(2)).sum::<f64>().sqrt() / n;
    let exact = 3.0 * PI * share / (1.0 - 0.6);
    assert!(
        (mean - exact).abs() < WORST_Z * error + 0.016 * exact,
        "{mean} ± {error}, {exact}"
    );
}

/// All three ways of finding emitters estimate the same quantity, where light has bounced and there
/// is no closed form.
#[test]
fn emitters_are_counted_once_however_they_are_found() {
    let t = tracer(&cornell_box());
    let footprints: Vec<_> = (0..24).map(|i| Footprint::of_point(i, 0.3, 0.3)).collect();
    let run = |emitters, paths, seed| {
        t.irradiance(
            &footprints,
            Effort {
                emitters,
                ..Effort::new(paths, seed)
            },
        )
    };
    let both = run(EmitterSampling::Both, 8_000, 1);
    let sum = |all: &[Estimate]| {
        let mean: f64 = all.iter().map(|e| luminance(e.mean)).sum();
        (
            mean,
            all.iter().map(|e| e.luminance_error.powi(2)).sum::<f64>(),
        )
    };
    for emitters in [EmitterSampling::Hits, EmitterSampling::Points] {
        let other = run(emitters, 8_000, 2);
        for (a, b) in both.iter().zip(&other) {
            let z = (luminance(a.mean) - luminance(b.mean))
                / a.luminance_error.hypot(b.luminance_error).max(1e-300);
            assert!(z.abs() < WORST_Z, "{emitters:?}: {z} {a:?} {b:?}");
        }
        let ((a, va), (b, vb)) = (sum(&both), sum(&other));
        assert!(
            (a - b).abs() < WORST_Z * (va + vb).sqrt(),
            "{emitters:?}: {a} {b}"
        );
        // The test would see an emitter counted twice: it adds far more than the noise of the sum.
        assert!(WORST_Z * (va + vb).sqrt() < 0.1 * a, "{emitters:?}");
    }
}

/// Over many seeds, estimates scatter by their standard errors.
#[test]
fn estimates_scatter_by_their_standard_errors() {
    let t = tracer(&cornell_box());
    // On the back wall.
    let footprint = [Footprint::of_point(2, 0.3, 0.3)];
    let n = 100;
    let all: Vec<Estimate> = (0..n)
        .map(|seed| t.irradiance(&footprint, Effort::new(500, seed))[0])
        .collect();
    let mean = all.iter().map(|e| luminance(e.mean)).sum::<f64>() / n as f64;
    let chi: f64 = all
        .iter()
        .map(|e| ((luminance(e.mean) - mean) / e.luminance_error).powi(2))
        .sum::<f64>()
        / (n - 1) as f64;
    // χ²/(n−1) has standard deviation √(2/99) = 0.14.
    assert!((chi - 1.0).abs() < WORST_Z * 0.14, "{chi}");
}

#[test]
fn the_tree_finds_what_looking_at_every_triangle_finds() {
    let scene = Scene::from_glb(&furnace(0.5, 1.0, FurnaceShape::Sphere)).expect("a scene");
    let tree = Tree::new(scene.triangles);
    // A low-discrepancy lattice of origins and directions; some start outside.
    let frac = |i: u32, k: f64| (f64::from(i) * k).fract() * 2.0 - 1.0;
    let mut hits = 0;
    for i in 0..4000 {
        let ray = Ray {
            origin: DVec3::new(frac(i, 0.618_034), frac(i, 0.754_878), frac(i, 0.569_840)) * 1.2,
            direction: DVec3::new(frac(i, 0.819_173), frac(i, 0.671_044), frac(i, 0.549_700)),
            t_max: if i % 3 == 0 { 1.0 } else { f64::INFINITY },
            skip: [i as usize % 7; 2],
        };
        let (found, all) = (tree.closest(&ray), tree.closest_of_all(&ray));
        assert_eq!(found.map(|h| h.t), all.map(|h| h.t), "{ray:?}");
        assert_eq!(tree.blocked(&ray), all.is_some());
        hits += u32::from(all.is_some());
    }
    assert!((1000..4000).contains(&hits), "{hits}");
}

#[test]
fn of_faces_in_one_place_the_first_is_met() {
    // A bed's headboard flush with a wall, a rounding of f32 in front of it or behind.
    let square = |z: f64, size: f64, surface| {
        let corner = |x: f64, y: f64| DVec3::new(x * size, y * size, z);
        let triangle = |corners| Triangle {
            corners,
            surface,
            node: 0,
            lightmap: None,
        };
        [
            triangle([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]),
            triangle([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]),
        ]
    };
    let ray = |origin, direction| Ray {
        origin,
        direction,
        t_max: f64::INFINITY,
        skip: [usize::MAX; 2],
    };
    // Rounding is 1.2e-7 of a coordinate, the scene 9 m wide.
    for (gap, first) in [(5e-8, 0), (-5e-8, 0), (1e-5, 2)] {
        let wall = square(0.0, 3.0, 0);
        let board = square(gap, 1.0, 1);
        let tree = Tree::new([wall, board].concat());
        for (x, y) in [(0.3, 0.2), (0.2, 0.3), (-0.7, 0.1)] {
            let toward = DVec3::new(0.1, 0.2, -1.0);
            let ahead = ray(
                DVec3::new(x, y, 2.0) - 2.0 * toward * DVec3::new(1.0, 1.0, 0.0),
                toward,
            );
            let hit = tree.closest(&ahead).expect("a wall");
            assert_eq!(hit.triangle / 2 * 2, first, "{gap}");
            // What leaves either does not meet the other.
            let back = ray(ahead.origin + toward * hit.t, -toward);
            assert_eq!(tree.closest(&back), None, "{gap}");
        }
    }
}

#[test]
fn footprints_cover_the_charts() {
    // A triangle of half a 10 × 10 page, another on a page that does not exist.
    let triangle = |page| Triangle {
        corners: [DVec3::ZERO, DVec3::X * 5.0, DVec3::Z * 5.0],
        surface: 0,
        node: 0,
        lightmap: Some((page, [DVec2::ZERO, DVec2::X, DVec2::Y])),
    };
    let scene = Scene {
        triangles: vec![triangle(0), triangle(1)],
        surfaces: vec![],
        ..Scene::default()
    };
    let all = footprints(&scene, &[[10, 10]]);
    assert_eq!(all.len(), 55);
    let (covered, area): (f64, f64) = all
        .iter()
        .fold((0.0, 0.0), |s, f| (s.0 + f.coverage, s.1 + f.area));
    // Rounding of some hundred operations in f64.
    assert!(
        (covered - 50.0).abs() < 1e-12 && (area - 12.5).abs() < 1e-12,
        "{covered} {area}"
    );
    for f in &all {
        let low = DVec3::new(f64::from(f.texel[0]), 0.0, f64::from(f.texel[1])) * 0.5;
        let mut mean = DVec3::ZERO;
        for i in 0..200 {
            let r = |k: f64| (f64::from(i) * k).fract();
            let (_, p) = f.point(&scene, r(0.819_173), [r(0.671_044), r(0.549_700)]);
            assert!(
                (p - low).min_element() > -1e-12
                    && (p - low).max_element() < 0.5 + 1e-12
                    && p.x + p.z < 5.0 + 1e-12
            );
            mean += p / 200.0;
        }
        // 200 lattice points hit the middle of half a metre to a few centimetres.
        assert!(
            mean.distance(f.centre(&scene)) < 0.05,
            "{mean} {}",
            f.centre(&scene)
        );
    }
}

#[test]
fn what_is_not_modelled_is_refused() {
    for (glb, what) in [
        (forms::masked_checker_screen(1.0), "texture"),
        (crate::scenes::demo_level(), "texture"),
        (b"glTF".to_vec(), "cut off"),
        (forms::point_over_floor(1.0, 1.0)[..200].to_vec(), "cut off"),
    ] {
        let message = Scene::from_glb(&glb).expect_err(what);
        assert!(message.contains(what), "{message}");
    }
}

/// A rotated, moved and mirrored child keeps its front outside, and a light's node rotates its
/// axis.
#[test]
fn nodes_place_what_they_hold() {
    use crate::geometry::cuboid;
    use crate::gltf::{GltfBuilder, Light as Written, Material, Node};
    use std::f32::consts::FRAC_PI_2;
    let mut b = GltfBuilder::new();
    let glow = b.material(&Material::emitter(
        "glow",
        [3.0, 2.0, 0.5],
        [0.25, 0.5, 0.75],
    ));
    let mesh = b.mesh(
        "box",
        &[(
            &cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), 1).bare(),
            glow,
        )],
    );
    let child = b.child(Node {
        translation: Vec3::X,
        scale: Vec3::new(-2.0, 1.0, 1.0),
        ..Node::of_mesh("box", mesh)
    });
    let lamp = b.light("lamp", Written::Directional([7.0, 0.0, 0.0]));
    b.node(Node {
        translation: Vec3::new(0.0, 0.0, 10.0),
        rotation: glam::Quat::from_rotation_y(FRAC_PI_2),
        light: Some(lamp),
        children: vec![child],
        ..Node::default()
    });
    let scene = Scene::from_glb(&b.finish()).expect("a scene");
    let volume: f64 = scene
        .triangles
        .iter()
        .map(|t| t.corners[0].dot(t.corners[1].cross(t.corners[2])) / 6.0)
        .sum();
    // 6 m³, twice as wide; f32 rotation.
    assert!((volume - 12.0).abs() < 1e-5, "{volume}");
    let (low, high) = scene
        .triangles
        .iter()
        .flat_map(|t| t.corners)
        .fold((DVec3::MAX, DVec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
    // x of −1..1 becomes z of 1..−1, z of 0..3 becomes x.
    assert!(
        low.distance(DVec3::new(0.0, 0.0, 9.0)) < 1e-6
            && high.distance(DVec3::new(3.0, 2.0, 11.0)) < 1e-6,
        "{low} {high}"
    );
    let surface = scene.surfaces[scene.triangles[0].surface];
    assert!(
        surface.emission.distance(DVec3::new(3.0, 2.0, 0.5)) < 1e-6
            && surface.reflectance.distance(DVec3::new(0.25, 0.5, 0.75)) < 1e-6
    );
    let [
        Light::Directional {
            direction,
            irradiance,
            radius,
        },
    ] = scene.lights[..]
    else {
        panic!("{:?}", scene.lights);
    };
    assert_eq!(radius, 0.0);
    assert!(direction.distance(DVec3::NEG_X) < 1e-6 && irradiance.distance(DVec3::X * 7.0) < 1e-6);
}

#[test]
fn points_find_their_surface() {
    let scene = Scene::from_glb(&cornell_box()).expect("a scene");
    for (i, t) in scene.triangles.iter().enumerate() {
        let f = Footprint::nearest(&scene, t.at(0.3, 0.4), t.normal()).expect("a surface");
        assert_eq!(f.triangle(), i);
        assert!(f.centre(&scene).distance(t.at(0.3, 0.4)) < 1e-12);
    }
    assert!(Footprint::nearest(&Scene::default(), DVec3::ZERO, DVec3::Y).is_none());
}

#[test]
fn a_choice_is_a_choice() {
    let all = || {
        (0..100)
            .map(|i| Footprint::of_point(i, 0.1, 0.1))
            .collect::<Vec<_>>()
    };
    let of = |count, seed| {
        choose(all(), count, seed)
            .iter()
            .map(Footprint::triangle)
            .collect::<Vec<_>>()
    };
    let some = of(10, 1);
    assert!(
        some.len() == 10 && some.windows(2).all(|w| w[0] < w[1]),
        "{some:?}"
    );
    assert!(some == of(10, 1) && some != of(10, 2));
    assert_eq!(of(1000, 1).len(), 100);
    // Every item has the same chance: 2000 of 20 in 100 draws of 20 each, ± 4 standard deviations
    // of √(2000·0.2·0.8) = 18.
    let mut hits = [0i32; 100];
    for seed in 0..2000 {
        for i in of(20, seed) {
            hits[i] += 1;
        }
    }
    assert!(hits.iter().all(|h| (h - 400).abs() < 72), "{hits:?}");
}
