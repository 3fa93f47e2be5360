use std::f64::consts::PI;

use glam::Vec3;
use mesh_ingest::{LightKind, Scene, Soup};
use patch_subdivision::Options as CutOptions;

use super::*;
use crate::emitters::Emitters;
use crate::fixtures::{add_quad, cube, light, material};
use crate::monitor::Silent;
use crate::sky::Sky;
use crate::solve::{SolveOptions, solve};
use crate::world::WorldOptions;

fn audit_of(scene: &Scene, sky: Sky, patches: u32, rays: u32) -> Audit {
    let soup = Soup::build(scene);
    let options = WorldOptions {
        sky,
        ..WorldOptions::default()
    };
    let world = World::build(scene, &soup, options).unwrap();
    let options = SolveOptions {
        cut: CutOptions {
            patches,
            ..CutOptions::default()
        },
        rays,
        ..SolveOptions::default()
    };
    let a = solve(&world, &Emitters::collect(&world), &options, &Silent)
        .report
        .audit;
    let parts = [
        a.bounds.rays,
        a.bounds.direct,
        a.bounds.lamps,
        a.bounds.residual,
        a.bounds.rounding,
    ];
    assert!(parts.iter().all(|p| p.is_finite() && *p >= 0.0), "{a:?}");
    assert!(
        a.bound <= parts.iter().sum::<f64>() * (1.0 + 1e-12),
        "{a:?}"
    );
    a
}

/// The cube without its face at z = 1, all faces with reflectance `rho` and radiance `l`.
fn open_cube(rho: f32, l: f32) -> Scene {
    let mut scene = cube(rho, Vec3::splat(l));
    let primitive = &mut scene.meshes[0].primitives[0];
    // The last of the fixture's six faces.
    primitive.triangles.truncate(10);
    primitive.source_triangles.truncate(10);
    scene
}

fn point(position: Vec3, intensity: f32, range: Option<f32>) -> mesh_ingest::Light {
    light(
        intensity,
        LightKind::Point {
            position,
            range,
            radius: 0.0,
        },
    )
}

#[test]
fn a_furnace_keeps_what_it_emits() {
    for rho in [0.0, 0.5, 0.9, 0.99, 0.999] {
        let a = audit_of(&cube(rho, Vec3::ONE), Sky::Black, 96, 64);
        // Exact: 6 m² of πL.
        assert!((a.flux_emitted[0] / (6.0 * PI) - 1.0).abs() < 1e-6, "{a:?}");
        assert_eq!(a.flux_escaped, [0.0; 3]);
        assert_eq!(a.flux_behind, [0.0; 3]);
        assert_eq!((a.rows_open, a.rows_beyond, a.rays_nowhere), (0, 0, 0));
        assert!(a.within_bound, "rho {rho}: {a:?}");
        // All patches are equally bright, so rays have no spread. What remains is the relaxation's
        // tolerance and rounding: 1e-4 × (1 − ρ) × E/(πL) = 1e-4, and (rays + 10) × 2⁻²⁴/(1 − ρ).
        // There are 64 rays, or four times as many where light arrives more than 8 times.
        let rays = if rho < 1.0 - 1.0 / 8.0 { 64.0 } else { 256.0 };
        let rounding = (rays + 10.0) * 2f64.powi(-24) * (1.0 + 1.0 / (1.0 - rho as f64));
        assert!(a.bound < 1.2e-4 + 1.1 * rounding, "rho {rho}: {a:?}");
    }
}

#[test]
fn an_open_box_loses_what_its_mouth_sees() {
    // Black walls of M = πL that see one another and the opening (area 1). The flux through the
    // opening is what would arrive on a black lid: π L Σ A_i F_i,lid = πL × (1 × Σ_i F_lid,i) = πL,
    // because the lid sees only the five walls.
    let a = audit_of(&open_cube(0.0, 1.0), Sky::Black, 400, 256);
    assert!((a.flux_emitted[0] / (5.0 * PI) - 1.0).abs() < 1e-6, "{a:?}");
    // 400 rows of 256 rays with shares near 1/5: σ = √(0.16/102400)/0.2 = 0.6 % of the escaped
    // light; three times that.
    assert!((a.flux_escaped[0] / PI - 1.0).abs() < 0.02, "{a:?}");
    assert!(a.within_bound && a.bound < 0.01, "{a:?}");
    assert!(a.rows_open > 300 && a.rows_beyond == 0, "{a:?}");
    assert!(a.gaps.is_empty(), "open everywhere is no gap");
}

#[test]
fn a_grey_open_box_gives_back_what_the_sky_sends_in() {
    // A box with reflectance ρ under a uniform sky, and the same box with its own emission chosen
    // so that B = πL everywhere: M = (1 − ρ)πL. Then E = πL everywhere, and the flux through the
    // opening is πL in both directions.
    let rho = 0.75;
    let a = audit_of(
        &open_cube(rho, 1.0 - rho),
        Sky::Constant(Vec3::ONE),
        400,
        256,
    );
    // As above, plus interreflection along the same rays.
    assert!((a.flux_escaped[0] / PI - 1.0).abs() < 0.02, "{a:?}");
    let emitted = 5.0 * PI * 0.25 + PI;
    assert!((a.flux_emitted[0] / emitted - 1.0).abs() < 0.01, "{a:?}");
    assert!(
        (a.flux_absorbed[0] / (5.0 * PI * 0.25) - 1.0).abs() < 0.01,
        "{a:?}"
    );
    assert!(a.within_bound, "{a:?}");
}

#[test]
fn lamps_send_what_their_kind_says() {
    // A point lamp over a very large floor: half of 4πI goes down, and from 0.1 m over 10 m × 10 m
    // nearly all of that arrives.
    let mut scene = Scene::default();
    add_quad(
        &mut scene,
        material(0.0, Vec3::ZERO),
        Vec3::new(-5.0, -5.0, 0.0),
        Vec3::X * 10.0,
        Vec3::Y * 10.0,
    );
    let lamps = |l: mesh_ingest::Light| {
        let mut scene = scene.clone();
        scene.lights.push(l);
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
        let f = LampFlux::measure(&world);
        let sigma = f.variance.sqrt();
        (
            f.emitted.x,
            f.emitted.x - f.behind.x - f.escaped.x,
            f.behind.x,
            sigma,
        )
    };
    let h = 0.1;
    let at = |z: f32| Vec3::new(0.0, 0.0, z);
    // The flux on a square of half side a from a lamp at height h over its centre: I × 4 atan(a²/(h
    // √(2a² + h²))).
    let square = |h: f64| 4.0 * (25.0 / (h * (50.0 + h * h).sqrt())).atan();
    let (emitted, front, _, sigma) = lamps(point(at(h), 2.0, None));
    assert!((emitted / (8.0 * PI) - 1.0).abs() < 1e-12);
    assert!(
        (front - 2.0 * square(0.1)).abs() < 4.0 * sigma && sigma < 0.01 * front,
        "{front} {sigma}"
    );
    // From below, that flux hits the back of the floor.
    let (_, front, behind, sigma) = lamps(point(at(-h), 2.0, None));
    assert!(front == 0.0 && sigma == 0.0);
    assert!(
        (behind / (2.0 * square(0.1)) - 1.0).abs() < 0.01,
        "{behind}"
    );
    // With a range of 1 m from 0.5 m: I ∫ 2π (1 − (h/(r cosθ))⁴) dcosθ from cosθ = h/r: 2π I (1 − q
    // − q(1 − q³)/3), q = h/r = ½.
    let (emitted, front, _, sigma) = lamps(point(at(0.5), 2.0, Some(1.0)));
    let exact = 4.0 * PI * (1.0 - 0.5 - 0.5 * (1.0 / 0.125 - 1.0) / 3.0 * 0.125);
    assert!(
        (front - exact).abs() < 4.0 * sigma + 1e-6 && emitted == front,
        "{front} {exact} {sigma}"
    );
    // A spot: 2πI ∫ cone.
    let (inner, outer) = (0.3f32, 0.6f32);
    let spot = LightKind::Spot {
        position: at(1.0),
        direction: -Vec3::Z,
        range: None,
        radius: 0.0,
        inner,
        outer,
    };
    let (emitted, front, _, _) = lamps(light(2.0, spot));
    let (i, o) = ((inner as f64).cos(), (outer as f64).cos());
    let exact = 4.0 * PI * (1.0 - i + (i - o) / 3.0);
    // All of it arrives.
    assert!((emitted / exact - 1.0).abs() < 1e-9 && (front / exact - 1.0).abs() < 1e-9);
    // A sun: E A cosθ.
    let sun = LightKind::Directional {
        direction: Vec3::new(0.6, 0.0, -0.8),
        angle: 0.0,
    };
    let (emitted, front, _, sigma) = lamps(light(2.0, sun));
    assert!(
        (front - 2.0 * 100.0 * 0.8).abs() < 4.0 * sigma && emitted == front,
        "{front} {sigma}"
    );
    assert!(sigma < 0.01 * front);
}

#[test]
fn backs_of_faces_take_light_and_are_named() {
    // A lit room with a single-sided plate below the lamp, front up: the floor sees its black
    // underside.
    let mut scene = cube(0.5, Vec3::ZERO);
    scene
        .lights
        .push(point(Vec3::new(0.5, 0.5, 0.9), 1.0, None));
    let floor = audit_of(&scene, Sky::Black, 400, 256);
    assert_eq!((floor.rays_behind, floor.rows_beyond), (0, 0));
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(0.2, 0.2, 0.1),
        Vec3::X * 0.6,
        Vec3::Y * 0.6,
    );
    scene.instances[0].name = "room".into();
    let a = audit_of(&scene, Sky::Black, 400, 256);
    assert!(a.rays_behind > 0 && a.rows_beyond > 50, "{a:?}");
    assert!(a.flux_behind[0] > 0.0 && a.flux_escaped == [0.0; 3]);
    assert!(a.within_bound, "{a:?}");
    // Rows of the room lose rays; the plate itself sees only fronts.
    assert_eq!(a.beyond.len(), 1, "{:?}", a.beyond);
    let room = &a.beyond[0];
    assert_eq!((room.node.as_str(), room.rows), ("room", a.rows_beyond));
    // The worst row is that of a patch of the floor below the plate.
    assert!(room.least < 0.5 && room.at[2] == 0.0, "{room:?}");
    assert!(
        (0.2..0.8).contains(&room.at[0]) && (0.2..0.8).contains(&room.at[1]),
        "{room:?}"
    );
}

#[test]
fn a_crack_in_a_closed_room_is_found() {
    // Another cube, one face of which ends 1 cm short of the edge.
    let mut scene = Scene::default();
    let m = || material(0.5, Vec3::ONE);
    for (corner, x, y) in [
        (Vec3::ZERO, Vec3::X, Vec3::Y),
        (Vec3::Z, Vec3::Y, Vec3::X),
        (Vec3::ZERO, Vec3::Y, Vec3::Z),
        (Vec3::X, Vec3::Z, Vec3::Y),
        (Vec3::ZERO, Vec3::Z, Vec3::X),
        (Vec3::Y, Vec3::X * 0.99, Vec3::Z), // the slit is at x > 0.99, y = 1
    ] {
        add_quad(&mut scene, m(), corner, x, y);
    }
    scene.instances[3].name = "right".into();
    let a = audit_of(&scene, Sky::Black, 600, 256);
    // The gap of 0.01 × 1 next to x = 1 transmits πL/(1 − ρ) on nearly all of its area: 0.01 of B =
    // 2π, of 6π emitted in total.
    assert!(
        a.flux_escaped[0] > 0.0 && a.flux_escaped[0] < 0.01 * 2.0 * PI * 1.5,
        "{a:?}"
    );
    assert!(
        a.row_sum_min < 1.0 && a.rays_behind == 0 && a.within_bound,
        "{a:?}"
    );
    // The patches with the worst row are on the wall x = 1, next to the gap (y = 1).
    let worst = a
        .gaps
        .iter()
        .min_by(|a, b| a.least.total_cmp(&b.least))
        .expect("gaps");
    assert_eq!((worst.node.as_str(), worst.least), ("right", a.row_sum_min));
    assert_eq!(a.gaps.iter().map(|n| n.rows).sum::<u64>(), a.rows_open);
}

#[test]
fn light_that_is_counted_twice_is_out_of_bound() {
    // A floor under a lamp in a room, and a rug in exactly the same plane. Both receive the lamp's
    // light, but other patches' rays hit only one of them. Elements receive more than the lamp
    // sends down.
    let mut scene = cube(0.5, Vec3::ZERO);
    scene
        .lights
        .push(point(Vec3::new(0.5, 0.5, 0.5), 1.0, None));
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        Vec3::new(0.1, 0.1, 0.0),
        Vec3::X * 0.8,
        Vec3::Y * 0.7,
    );
    let a = audit_of(&scene, Sky::Black, 600, 256);
    assert!(!a.within_bound && a.imbalance < -0.05, "{a:?}");
    // A lamp so close to a wall that no element is where its light falls: nearly half of the light
    // is missing.
    let mut scene = cube(0.5, Vec3::ZERO);
    scene
        .lights
        .push(point(Vec3::new(0.5, 0.5, 1e-4), 1.0, None));
    let a = audit_of(&scene, Sky::Black, 600, 256);
    assert!(!a.within_bound && a.imbalance > 0.4, "{a:?}");
}

#[test]
fn the_bound_holds_and_is_not_idle() {
    // Lit rooms of all kinds, coarse and fine: none of 24 balances exceeds its bound, and the bound
    // is not a hundred times too wide.
    let mut ratios = Vec::new();
    for rho in [0.2, 0.8, 0.95] {
        for (patches, rays) in [(60, 16), (200, 64), (800, 64), (300, 512)] {
            for lamp in [false, true] {
                let mut scene = cube(rho, Vec3::ZERO);
                if lamp {
                    scene
                        .lights
                        .push(point(Vec3::new(0.3, 0.6, 0.7), 1.0, None));
                } else {
                    let m = material(0.3, Vec3::splat(20.0));
                    add_quad(
                        &mut scene,
                        m,
                        Vec3::new(0.4, 0.4, 0.95),
                        Vec3::Y * 0.2,
                        Vec3::X * 0.2,
                    );
                }
                let a = audit_of(&scene, Sky::Black, patches, rays);
                assert!(
                    a.within_bound,
                    "rho {rho}, {patches} × {rays}, lamp {lamp}: {a:?}"
                );
                ratios.push(a.imbalance.abs() / a.bound);
            }
        }
    }
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    // Four standard errors of independent noise would give 0.2; stratified rays give less.
    assert!((0.02..0.3).contains(&mean), "{mean} {ratios:?}");
}

#[test]
fn a_lamp_that_is_half_there_sends_half() {
    // A blended panel with sampled light in a closed grey cube: it sends π L A α, all of which is
    // eventually absorbed.
    let mut scene = cube(0.5, Vec3::ZERO);
    let mut panel = material(0.3, Vec3::splat(20.0));
    panel.alpha = mesh_ingest::AlphaMode::Blend;
    panel.base_color.w = 0.25;
    add_quad(
        &mut scene,
        panel,
        Vec3::new(0.4, 0.8, 0.4),
        Vec3::X * 0.2,
        Vec3::Z * 0.2,
    );
    let a = audit_of(&scene, Sky::Black, 400, 256);
    let sent = 20.0 * PI * 0.04 * 0.25;
    // f32 areas and radiances.
    assert!((a.flux_emitted[0] / sent - 1.0).abs() < 1e-5, "{a:?}");
    assert!(a.within_bound, "{a:?}");
    assert!(a.bound < 0.05, "{}", a.bound);
}
