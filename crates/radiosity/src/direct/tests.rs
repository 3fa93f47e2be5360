use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use mesh_ingest::{Scene, Soup};

use super::*;
use crate::fixtures::{add_quad, light, material};
use crate::form_factor::form_factor_polygon;
use crate::world::WorldOptions;

mod many_lamps;

const FEW: DirectOptions = DirectOptions::every(4, 16);
const MANY: DirectOptions = DirectOptions::every(64, 1024);

fn with_light<R>(scene: &Scene, test: impl FnOnce(&DirectLight) -> R) -> R {
    let soup = Soup::build(scene);
    let world = World::build(scene, &soup, WorldOptions::default()).unwrap();
    let emitters = Emitters::collect(&world);
    test(&DirectLight::new(&world, &emitters))
}

/// A receiver that belongs to no triangle.
fn receiver(position: Vec3, normal: Vec3) -> SurfacePoint {
    SurfacePoint {
        position,
        origin: position + normal * 1e-6,
        normal,
        geometric: normal,
    }
}

fn estimate(scene: &Scene, point: SurfacePoint, options: &DirectOptions) -> DirectEstimate {
    with_light(scene, |l| l.irradiance(|_| point, 0.0, 1, options))
}

/// A black floor at z = 0 with room above it. It is large, so that a lamp over it is a small part
/// of the scene and is sampled.
fn floor() -> Scene {
    let mut scene = Scene::default();
    add_quad(
        &mut scene,
        material(0.0, Vec3::ZERO),
        Vec3::new(-5.0, -5.0, 0.0),
        Vec3::X * 10.0,
        Vec3::Y * 10.0,
    );
    scene
}

/// A rectangle |x| ≤ a/2, |y| ≤ b/2 at height z that faces down.
fn add_panel(scene: &mut Scene, a: f32, b: f32, z: f32, radiance: f32, double_sided: bool) {
    let mut m = material(0.0, Vec3::splat(radiance));
    m.double_sided = double_sided;
    add_quad(
        scene,
        m,
        Vec3::new(-0.5 * a, -0.5 * b, z),
        Vec3::Y * b,
        Vec3::X * a,
    );
}

/// Form factor of the rectangle of [`add_panel`] from the origin, axis up: four corner rectangles
/// (Howell, catalogue B-3).
fn panel_form_factor(a: f64, b: f64, z: f64) -> f64 {
    let (x, y) = (0.5 * a / z, 0.5 * b / z);
    let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    4.0 * (x / p * (y / p).atan() + y / q * (x / q).atan()) / (2.0 * PI)
}

fn close(e: Vec3, exact: f64, relative: f64) {
    for c in e.to_array() {
        assert!(
            (c as f64 / exact - 1.0).abs() <= relative,
            "{e}, not {exact}"
        );
    }
}

/// Six roundings of f32 and one cosine.
const ROUNDING: f64 = 2e-6;

#[test]
fn a_point_light_follows_the_cosine_and_the_inverse_square() {
    for position in [
        Vec3::new(0.0, 0.0, 2.0),
        Vec3::new(1.0, -2.0, 0.5),
        Vec3::new(-30.0, 4.0, 7.0),
    ] {
        let mut scene = floor();
        scene.lights.push(light(
            5.0,
            LightKind::Point {
                position,
                range: None,
                radius: 0.0,
            },
        ));
        let d = position.as_dvec3();
        let exact = 5.0 * d.z / d.length().powi(3);
        let e = estimate(&scene, receiver(Vec3::ZERO, Vec3::Z), &FEW);
        close(e.irradiance, exact, ROUNDING);
        // One point and one direction: a single ray is enough.
        assert_eq!((e.variance, e.rays), (0.0, 1));
        // Below the receiver's horizon: no light, and no rays.
        let away = estimate(&scene, receiver(Vec3::new(0.0, 0.0, 0.1), -Vec3::Z), &FEW);
        assert_eq!((away.irradiance, away.rays), (Vec3::ZERO, 0));
    }
}

#[test]
fn a_range_is_a_window_that_ends_there() {
    for (z, range) in [(1.0f32, 4.0f32), (2.0, 2.5), (3.0, 3.0), (3.0, 2.0)] {
        let mut scene = floor();
        scene.lights.push(light(
            5.0,
            LightKind::Point {
                position: Vec3::new(0.0, 0.0, z),
                range: Some(range),
                radius: 0.0,
            },
        ));
        let e = estimate(&scene, receiver(Vec3::ZERO, Vec3::Z), &FEW).irradiance;
        // KHR_lights_punctual: max(min(1 − (d/r)⁴, 1), 0) / d².
        let window = 1.0 - (z as f64 / range as f64).powi(4);
        if window <= 0.0 {
            assert_eq!(e, Vec3::ZERO);
        } else {
            close(e, 5.0 * window / (z * z) as f64, ROUNDING);
        }
    }
}

#[test]
fn a_spot_is_full_inside_falls_off_at_its_edge_and_ends() {
    let (inner, outer) = (0.3f64, 0.5f64);
    for angle in [0.0f64, 0.2, 0.29, 0.35, 0.4, 0.45, 0.51, 1.0, 2.5] {
        let mut scene = floor();
        scene.lights.push(light(
            5.0,
            LightKind::Spot {
                position: Vec3::new(0.0, 0.0, 2.0),
                direction: Vec3::new(angle.sin() as f32, 0.0, -angle.cos() as f32),
                range: None,
                radius: 0.0,
                inner: inner as f32,
                outer: outer as f32,
            },
        ));
        let e = estimate(&scene, receiver(Vec3::ZERO, Vec3::Z), &FEW).irradiance;
        let t = (angle.cos() - outer.cos()) / (inner.cos() - outer.cos());
        let cone = t.clamp(0.0, 1.0).powi(2);
        if cone == 0.0 {
            assert_eq!(e, Vec3::ZERO, "{angle}");
        } else {
            // cos θ − cos outer is off by 1e-7, divided by their difference of at least 0.01 and
            // squared.
            close(e, 5.0 / 4.0 * cone, 3e-5);
        }
    }
}

#[test]
fn a_directional_light_has_the_cosine_only_and_is_stopped_by_anything() {
    let mut scene = floor();
    scene.lights.push(light(
        5.0,
        LightKind::Directional {
            direction: Vec3::new(0.6, 0.0, -0.8),
            angle: 0.0,
        },
    ));
    let at = receiver(Vec3::ZERO, Vec3::Z);
    close(estimate(&scene, at, &FEW).irradiance, 4.0, ROUNDING);
    // An occluding sheet 1 km away: the light comes from (−750, 0, 1000).
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(-800.0, -50.0, 1000.0),
        Vec3::X * 100.0,
        Vec3::Y * 100.0,
    );
    let e = estimate(&scene, at, &FEW);
    assert_eq!((e.irradiance, e.variance), (Vec3::ZERO, 0.0));
}

#[test]
fn a_free_panel_is_exact_whatever_the_samples() {
    for (a, b, z) in [(1.0, 1.0, 1.0), (2.0, 0.5, 0.1), (0.2, 0.1, 0.5)] {
        let mut scene = floor();
        add_panel(&mut scene, a, b, z, 3.0, false);
        let exact = 3.0 * PI * panel_form_factor(a as f64, b as f64, z as f64);
        with_light(&scene, |l| {
            assert_eq!(l.emitters.len(), 2);
            for seed in 0..20 {
                let at = receiver(Vec3::ZERO, Vec3::Z);
                let e = l.irradiance(|_| at, 0.0, seed, &FEW);
                // The closed form is in f64; what remains is f32 sums of four weights and their
                // ratio.
                close(e.irradiance, exact, 1e-5);
                assert_eq!(e.variance, 0.0);
            }
        });
    }
}

#[test]
fn a_hidden_panel_gives_exactly_nothing() {
    let mut scene = floor();
    add_panel(&mut scene, 1.0, 1.0, 1.0, 3.0, false);
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(-1.0, -1.0, 0.5),
        Vec3::X * 2.0,
        Vec3::Y * 2.0,
    );
    let e = estimate(&scene, receiver(Vec3::ZERO, Vec3::Z), &MANY);
    assert_eq!((e.irradiance, e.variance), (Vec3::ZERO, 0.0));
    assert!(e.rays > 0);
}

#[test]
fn an_edge_over_the_middle_hides_half() {
    let mut scene = floor();
    add_panel(&mut scene, 1.0, 1.0, 1.0, 3.0, false);
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(-1.0, -1.0, 0.5),
        Vec3::X, // to x = 0
        Vec3::Y * 2.0,
    );
    let exact = 0.5 * 3.0 * PI * panel_form_factor(1.0, 1.0, 1.0);
    for options in [FEW, MANY] {
        for seed in 0..10 {
            let at = receiver(Vec3::ZERO, Vec3::Z);
            let e = with_light(&scene, |l| l.irradiance(|_| at, 0.0, seed, &options));
            // Each of the two triangles has `penumbra` rays, each a coin flip with a standard
            // deviation of ½ of that triangle's light. The sum of both has ½/√2 of it over
            // √penumbra. Four times that is allowed; stratification only helps.
            let sigma = 2.0 * exact * 0.5 / 2f64.sqrt() / (options.penumbra as f64).sqrt();
            let off = (e.irradiance.x as f64 - exact).abs();
            assert!(off < 4.0 * sigma, "{} {exact} {sigma}", e.irradiance);
            assert!(e.rays <= 2 * options.penumbra);
            // Once it has sampled both triangles fully, the estimator reports the same bound.
            if e.rays == 2 * options.penumbra {
                let claimed = (e.variance as f64).sqrt();
                assert!((0.5..1.3).contains(&(claimed / sigma)), "{claimed} {sigma}");
            }
        }
    }
}

#[test]
fn only_a_two_sided_panel_shines_backwards() {
    for double_sided in [false, true] {
        let mut scene = floor();
        add_panel(&mut scene, 1.0, 1.0, 1.0, 3.0, double_sided);
        let exact = 3.0 * PI * panel_form_factor(1.0, 1.0, 1.0);
        let below = estimate(&scene, receiver(Vec3::ZERO, Vec3::Z), &FEW);
        close(below.irradiance, exact, 1e-5);
        // Mirrored in the plane of the panel.
        let at = receiver(Vec3::new(0.0, 0.0, 2.0), -Vec3::Z);
        let above = estimate(&scene, at, &FEW);
        if double_sided {
            close(above.irradiance, exact, 1e-5);
        } else {
            assert_eq!((above.irradiance, above.rays), (Vec3::ZERO, 0));
        }
    }
}

#[test]
fn only_a_low_panel_beside_a_point_gives_nothing() {
    let mut scene = floor();
    add_panel(&mut scene, 1.0, 1.0, 0.01, 1.0, false);
    let at = receiver(Vec3::ZERO, Vec3::Z);
    let light = |beside: f32| {
        let known = Known {
            beside,
            ..Known::default()
        };
        let parts = &mut DirectParts::default();
        with_light(&scene, |l| {
            l.irradiance_parts(|_| at, 0.0, 1, &FEW, &known, parts)
                .irradiance
        })
    };
    assert_eq!(light(0.0099), light(0.0));
    assert!(light(0.0).x > 0.9 * std::f32::consts::PI);
    assert_eq!(light(0.0101), Vec3::ZERO);
    // As low, but a metre from the panel.
    let at = receiver(Vec3::new(1.5, 0.0, 0.0), Vec3::Z);
    let known = Known {
        beside: 0.5,
        ..Known::default()
    };
    let far = with_light(&scene, |l| {
        let parts = &mut DirectParts::default();
        l.irradiance_parts(|_| at, 0.0, 1, &FEW, &known, parts)
    });
    assert!(far.irradiance.x > 0.0);
}

#[test]
fn a_receiver_in_the_panels_plane_or_turned_away_gets_nothing() {
    let mut scene = floor();
    add_panel(&mut scene, 1.0, 1.0, 1.0, 3.0, false);
    for (p, n) in [
        (Vec3::new(2.0, 0.0, 1.0), -Vec3::X),
        (Vec3::new(0.0, 0.0, 0.5), -Vec3::Z),
        (Vec3::new(2.0, 0.0, 0.5), Vec3::X),
    ] {
        let e = estimate(&scene, receiver(p, n), &FEW);
        assert_eq!(e.irradiance, Vec3::ZERO, "{p} {n}");
    }
}

#[test]
fn a_wall_lamp_that_crosses_the_horizon_counts_its_upper_half() {
    // The receiver is below the centre of a panel and faces along x: half of the panel is behind
    // it.
    let mut scene = floor();
    add_panel(&mut scene, 1.0, 1.0, 1.0, 3.0, false);
    let at = receiver(Vec3::new(0.0, 0.1, 0.5), Vec3::X);
    let corners = [
        Vec3::new(0.0, -0.5, 1.0),
        Vec3::new(0.0, 0.5, 1.0),
        Vec3::new(0.5, 0.5, 1.0),
        Vec3::new(0.5, -0.5, 1.0),
    ]
    .map(|c| c.as_dvec3());
    let f = form_factor_polygon(at.position.as_dvec3(), DVec3::X, &corners);
    for seed in 0..20 {
        let e = with_light(&scene, |l| l.irradiance(|_| at, 0.0, seed, &FEW));
        // Nothing hides it, so the result is exact up to the f32 weights.
        close(e.irradiance, 3.0 * PI * f, 1e-5);
    }
}

#[test]
fn four_hundred_small_lamps_are_one_large_one_for_far_fewer_terms() {
    let mut one = floor();
    add_panel(&mut one, 1.0, 1.0, 2.0, 3.0, false);
    let mut many = floor();
    for i in 0..20 {
        for j in 0..10 {
            add_quad(
                &mut many,
                material(0.0, Vec3::splat(3.0)),
                Vec3::new(-0.5 + 0.05 * i as f32, -0.5 + 0.1 * j as f32, 2.0),
                Vec3::Y * 0.1,
                Vec3::X * 0.05,
            );
        }
    }
    let at = receiver(Vec3::new(0.5, 0.2, 0.0), Vec3::Z);
    let exact = estimate(&one, at, &FEW).irradiance.x as f64;
    let options = DirectOptions::every(16, 64);
    with_light(&many, |l| {
        assert_eq!(l.emitters.len(), 400);
        let mut terms = Vec::new();
        l.emitter_terms(&at, 0.0, 32, &mut terms);
        assert!(terms.len() <= 32, "{} terms", terms.len());
        // No emitter is counted twice or omitted.
        let mut taken: Vec<u32> = Vec::new();
        for (term, _) in &terms {
            match term {
                Term::Group(id, _) => {
                    let node = &l.emitters.nodes[*id as usize];
                    taken.extend(
                        (node.start..node.end).map(|k| l.emitters.emitters[k as usize].triangle),
                    )
                }
                Term::Triangle(e) => taken.push(e.triangle),
                Term::Lamp(..) | Term::Lamps(..) | Term::Sky(_) => panic!("there is none"),
            }
        }
        taken.sort_unstable();
        let all: Vec<u32> = (2..402).collect(); // after the floor's two
        assert_eq!(taken, all);
        let mut mean = 0.0;
        for seed in 0..64 {
            let e = l.irradiance(|_| at, 0.0, seed, &options);
            // 32 groups of 1/8 to 1/6 of a unit seen from a distance of 2: the kernel cos²/d²
            // varies by ±10 % over one, which some 64 samples reduce to 0.1/√64 = 1.2 %; four times
            // that.
            close(e.irradiance, exact, 0.05);
            assert!(e.rays <= 4 * 16 + 32, "{} rays", e.rays);
            mean += e.irradiance.x as f64 / 64.0;
        }
        // No bias: the mean of 64 estimates has an eighth of that error.
        assert!((mean / exact - 1.0).abs() < 0.006, "{mean} {exact}");
    });
}

/// Mean of `sample_one` over many seeds against `exact`, in standard errors, and relative.
fn one_sample(scene: &Scene, at: SurfacePoint, exact: f64) -> (f64, f64) {
    with_light(scene, |l| {
        let n = 40_000;
        let (mut sum, mut squares) = (0f64, 0f64);
        for k in 0..n {
            let e = l.sample_one(&at, hash_u32(k)).0.x as f64;
            sum += e;
            squares += e * e;
        }
        let mean = sum / n as f64;
        let variance = squares / n as f64 - mean * mean;
        let error = (variance / n as f64).sqrt();
        ((mean - exact) / error.max(1e-6 * exact), mean / exact - 1.0)
    })
}

#[test]
fn one_sample_is_right_on_average_where_all_is_seen() {
    let mut scene = floor();
    add_panel(&mut scene, 1.0, 2.0, 1.0, 3.0, false);
    for (x, intensity) in [(1.0, 2.0), (-2.0, 5.0)] {
        scene.lights.push(light(
            intensity,
            LightKind::Point {
                position: Vec3::new(x, 1.0, 0.9),
                range: None,
                radius: 0.0,
            },
        ));
    }
    for p in [Vec3::ZERO, Vec3::new(0.4, 1.5, 0.0)] {
        let at = receiver(p, Vec3::Z);
        let exact = estimate(&scene, at, &FEW).irradiance.x as f64;
        let (z, relative) = one_sample(&scene, at, exact);
        // |z| > 4 happens once in 16,000 cases.
        assert!(z.abs() < 4.0, "at {p}: {z} standard errors, {relative:+.4}");
    }
}

#[test]
fn one_sample_is_right_on_average_under_an_edge_and_at_the_horizon() {
    // An occluder over a part of the panel, which is seen obliquely, so the hidden part differs
    // from the visible one.
    let mut scene = floor();
    add_panel(&mut scene, 2.0, 2.0, 1.0, 3.0, false);
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(-2.0, -2.0, 0.5),
        Vec3::X * 2.2, // to x = 0.2
        Vec3::Y * 4.0,
    );
    // From the origin, x > 0.4 is visible.
    let upper = [
        Vec3::new(0.4, -1.0, 1.0),
        Vec3::new(0.4, 1.0, 1.0),
        Vec3::new(1.0, 1.0, 1.0),
        Vec3::new(1.0, -1.0, 1.0),
    ]
    .map(|c| c.as_dvec3());
    let at = receiver(Vec3::ZERO, Vec3::Z);
    let exact = 3.0 * PI * form_factor_polygon(DVec3::ZERO, DVec3::Z, &upper);
    let (z, relative) = one_sample(&scene, at, exact);
    assert!(z.abs() < 4.0, "edge: {z} standard errors, {relative:+.4}");

    let mut scene = floor();
    add_panel(&mut scene, 2.0, 2.0, 1.0, 3.0, false);
    let at = receiver(Vec3::new(0.0, 0.1, 0.5), Vec3::X);
    let front = [
        Vec3::new(0.0, -1.0, 1.0),
        Vec3::new(0.0, 1.0, 1.0),
        Vec3::new(1.0, 1.0, 1.0),
        Vec3::new(1.0, -1.0, 1.0),
    ]
    .map(|c| c.as_dvec3());
    let exact = 3.0 * PI * form_factor_polygon(at.position.as_dvec3(), DVec3::X, &front);
    let (z, relative) = one_sample(&scene, at, exact);
    assert!(
        z.abs() < 4.0,
        "horizon: {z} standard errors, {relative:+.4}"
    );
}

#[test]
fn a_choice_made_for_a_patch_is_right_on_average_at_its_points() {
    // Two lamps and a panel, with a board that hides one or the other from parts of the floor's
    // patches.
    let mut scene = floor();
    add_panel(&mut scene, 2.0, 2.0, 1.0, 3.0, false);
    for (x, intensity) in [(1.0, 2.0), (-2.0, 5.0)] {
        let position = Vec3::new(x, 1.0, 0.9);
        let kind = LightKind::Point {
            position,
            range: None,
            radius: 0.0,
        };
        scene.lights.push(light(intensity, kind));
    }
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(0.2, -2.0, 0.1),
        Vec3::Z * 0.6,
        Vec3::Y * 4.0,
    );
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
    let emitters = Emitters::collect(&world);
    let options = patch_subdivision::Options {
        patches: 40,
        ..patch_subdivision::Options::default()
    };
    let cut = Subdivision::build(&soup, |t| world.two_sided(t as u32), &options);
    let light = DirectLight::new(&world, &emitters).on_patches(&cut);
    for (k, (u, v)) in [(0.5, 0.25), (0.3, 0.4), (0.52, 0.2)]
        .into_iter()
        .enumerate()
    {
        let at = world.inset_point(0, u, v, false, false);
        let patch = cut.locate(0, at.position, false).unwrap().patch;
        let n = 40_000u32;
        let mean = |sample: &dyn Fn(u32) -> f32| {
            let (mut sum, mut squares) = (0f64, 0f64);
            for k in 0..n {
                let e = f64::from(sample(hash_u32(k)));
                sum += e;
                squares += e * e;
            }
            let mean = sum / f64::from(n);
            (mean, (squares / f64::from(n) - mean * mean) / f64::from(n))
        };
        // Compared with the choice at each single point, which other tests compare with closed
        // forms.
        let (one, a) = mean(&|seed| light.sample_one(&at, seed).0.x);
        let (on, b) = mean(&|seed| light.sample_on(&cut, patch, &at, seed ^ 0x55).0.x);
        let z = (one - on) / (a + b).sqrt();
        assert!(
            one > 0.0 && z.abs() < 4.0,
            "point {k}: {on} for {one}, {z} standard errors"
        );
    }
}

#[test]
fn scouts_that_agree_save_rays_and_change_nothing() {
    let mut scene = floor();
    let position = Vec3::new(0.3, 0.2, 1.0);
    let kind = LightKind::Point {
        position,
        range: None,
        radius: 0.0,
    };
    scene.lights.push(light(2.0, kind));
    let point = |i: u32| {
        let p = Vec3::new(0.1 * (i % 4) as f32, 0.1 * (i / 4 % 4) as f32, 0.0);
        receiver(p, Vec3::Z)
    };
    let few = DirectOptions {
        base: 16,
        penumbra: 64,
        scouts: 4,
    };
    let all = DirectOptions::every(16, 64);
    let at = |options: &DirectOptions, scene: &Scene| {
        with_light(scene, |l| l.irradiance(point, 0.3, 1, options))
    };
    let (a, b) = (at(&few, &scene), at(&all, &scene));
    assert_eq!((a.irradiance, a.mixed), (b.irradiance, 0));
    assert_eq!((a.rays, b.rays), (4, 16));
    assert_eq!((a.lit, a.hidden), (1, 0));
    // A board over half of the receiver: all points get a ray, and the light gets more samples.
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(0.17, -1.0, 0.01),
        Vec3::X,
        Vec3::Y * 3.0,
    );
    let (a, b) = (at(&few, &scene), at(&all, &scene));
    assert_eq!((a.irradiance, a.rays), (b.irradiance, b.rays));
    assert_eq!((a.mixed, a.lit, a.hidden), (1, 1, 1));
}

/// A thousand panels above each other, all nearer than they are wide: each group of them would be
/// split.
#[test]
fn the_number_of_terms_is_bounded() {
    let mut scene = floor();
    for k in 1..=1000u32 {
        add_panel(&mut scene, 0.1, 0.1, 1e-4 * k as f32, 1.0, false);
    }
    with_light(&scene, |l| {
        assert!(l.emitters.len() >= 2000, "{}", l.emitters.len());
        let mut nodes = Vec::new();
        l.emitter_nodes(&receiver(Vec3::ZERO, Vec3::Z), 0.0, 64, &mut nodes);
        assert!((200..=256).contains(&nodes.len()), "{}", nodes.len());
    });
}

#[test]
fn lamps_are_seen_as_expected_or_the_receiver_must_look() {
    let mut scene = floor();
    let lamps = [Vec3::new(-1.0, 0.0, 2.0), Vec3::new(1.0, 0.0, 2.0)];
    for position in lamps {
        let (range, radius) = (None, 0.0);
        let kind = LightKind::Point {
            position,
            range,
            radius,
        };
        scene.lights.push(light(5.0, kind));
    }
    // A board of 20 cm that hides the second lamp from the origin.
    add_quad(
        &mut scene,
        material(0.0, Vec3::ZERO),
        Vec3::new(0.4, -0.1, 1.0),
        Vec3::X * 0.2,
        Vec3::Y * 0.2,
    );
    let here = receiver(Vec3::ZERO, Vec3::Z);
    let aside = receiver(Vec3::new(0.0, 0.5, 0.0), Vec3::Z);
    with_light(&scene, |l| {
        let ask = |p, expected, least| l.lamps_seen_as(p, expected, least, 1);
        assert_eq!(ask(&here, [0b01, 0b10], 0.0), Some(2));
        // Neighbours see both lamps, as on either side of a thin object's shadow.
        assert_eq!(ask(&here, [0b11, 0b00], 0.0), None);
        assert_eq!(ask(&aside, [0b01, 0b10], 0.0), None);
        assert_eq!(ask(&aside, [0b11, 0b00], 0.0), Some(2));
        // A lamp that neither mask has, and one that only one mask has.
        assert_eq!(ask(&aside, [0b01, 0b00], 0.0), None);
        assert_eq!(ask(&aside, [0b11, 0b10], 0.0), None);
        // Each contributes 5 cosθ/d² = 0.89 at the origin; lamps below the requested limit are not
        // tested.
        assert_eq!(ask(&here, [0b11, 0b00], 1.0), Some(0));
    });
}
