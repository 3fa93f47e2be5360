use std::f64::consts::PI;

use glam::{DAffine3, Vec4};
use mesh_ingest::{Instance, Light, LightKind, Material, Mesh, Primitive, Scene, Soup};
use radiosity::{Emitters, Silent, Sky, SolveOptions, WorldOptions};

use super::*;

/// L00 of a constant radiance of 1: 4π · ½ √(1/π).
const ALL: f64 = 3.544_907_701_811_032;

fn material(reflectance: f32, emissive: f32) -> Material {
    Material {
        base_color: Vec4::new(reflectance, reflectance, reflectance, 1.0),
        emissive: Vec3::splat(emissive),
        ..Material::default()
    }
}

fn add_mesh(scene: &mut Scene, material: Material, positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) {
    scene.materials.push(material);
    scene.instances.push(Instance {
        node: scene.instances.len(),
        name: String::new(),
        copy: None,
        mesh: scene.meshes.len(),
        occluder: false,
        density: 1.0,
        stands_in: None,
        transform: DAffine3::IDENTITY,
        extras: None,
    });
    scene.meshes.push(Mesh {
        primitives: vec![Primitive {
            positions,
            source_triangles: (0..triangles.len() as u32).collect(),
            triangles,
            material: scene.materials.len() - 1,
            ..Primitive::default()
        }],
        ..Mesh::default()
    });
}

/// The parallelogram `corner`, `corner + x`, `corner + x + y`, `corner + y`; its front is `x × y`.
fn add_quad(scene: &mut Scene, material: Material, corner: Vec3, x: Vec3, y: Vec3) {
    let positions = vec![corner, corner + x, corner + x + y, corner + y];
    add_mesh(scene, material, positions, vec![[0, 1, 2], [0, 2, 3]]);
}

/// A box seen from outside, or from inside.
fn add_box(scene: &mut Scene, material: &Material, low: Vec3, high: Vec3, inside: bool) {
    let size = high - low;
    for axis in 0..3 {
        let mut u = Vec3::ZERO;
        let mut v = Vec3::ZERO;
        u[(axis + 1) % 3] = size[(axis + 1) % 3];
        v[(axis + 2) % 3] = size[(axis + 2) % 3];
        let mut far = low;
        far[axis] = high[axis];
        for (corner, out) in [(low, false), (far, true)] {
            let (x, y) = if out != inside { (u, v) } else { (v, u) };
            add_quad(scene, material.clone(), corner, x, y);
        }
    }
}

fn lamp(kind: LightKind, intensity: Vec3) -> Light {
    Light {
        name: String::new(),
        node: None,
        intensity,
        kind,
        profile: None,
        cookie: None,
    }
}

/// A small black object far below, because a scene must not be empty.
fn nothing() -> Scene {
    let mut scene = Scene::default();
    let corner = Vec3::new(0.0, -1000.0, 0.0);
    add_quad(
        &mut scene,
        material(0.0, 0.0),
        corner,
        Vec3::Z * 0.01,
        Vec3::X * 0.01,
    );
    scene
}

const OPTIONS: ProbeOptions = ProbeOptions {
    rays: 4096,
    samples: 4096,
};

/// Few patches, because only the probes are tested.
fn few_patches() -> SolveOptions {
    SolveOptions {
        cut: patch_subdivision::Options {
            patches: 600,
            ..Default::default()
        },
        rays: 128,
        ..SolveOptions::default()
    }
}

fn bake_in(scene: &Scene, sky: Sky, at: &[Vec3], options: &ProbeOptions) -> Vec<Probe> {
    let soup = Soup::build(scene);
    let options_of_world = WorldOptions {
        sky,
        ..WorldOptions::default()
    };
    let world = World::build(scene, &soup, options_of_world).unwrap();
    let emitters = Emitters::collect(&world);
    let solution = radiosity::solve(&world, &emitters, &few_patches(), &Silent);
    let probe_scene = ProbeScene {
        world: &world,
        solution: &solution,
        direct: &DirectLight::new(&world, &emitters),
    };
    bake_probes(&probe_scene, at, options, &Silent).unwrap()
}

/// Asserts all coefficients within `tolerance`.
#[track_caller]
fn assert_sh(got: &Sh2, expected: [Vec3; 9], tolerance: f32) {
    for (i, (a, b)) in got.0.iter().zip(expected).enumerate() {
        assert!(
            (*a - b).abs().max_element() <= tolerance,
            "coefficient {i}: {a}, expected {b}"
        );
    }
}

/// The light from one direction: flux · Y.
fn from_one(direction: Vec3, flux: Vec3) -> [Vec3; 9] {
    basis(direction.normalize()).map(|y| flux * y)
}

fn constant(radiance: Vec3) -> [Vec3; 9] {
    let mut c = [Vec3::ZERO; 9];
    c[0] = radiance * ALL as f32;
    c
}

#[test]
fn a_furnace_is_the_same_from_everywhere() {
    // L = L_e/(1 − ρ) everywhere inside.
    let mut scene = Scene::default();
    add_box(
        &mut scene,
        &material(0.5, 0.75),
        Vec3::ZERO,
        Vec3::new(2.0, 1.0, 3.0),
        true,
    );
    let at = [
        Vec3::new(1.0, 0.5, 1.5),
        Vec3::new(0.2, 0.9, 2.5),
        Vec3::new(0.01, 0.01, 0.01),
    ];
    for p in bake_in(&scene, Sky::Black, &at, &OPTIONS) {
        assert!(p.valid && p.backfaces == 0.0);
        // The solve stops when at most 1e-4 of the light is undistributed. Directions add no error,
        // because their error for a constant is subtracted.
        assert_sh(&p.sh, constant(Vec3::splat(1.5)), 1.5e-4 * ALL as f32);
    }
}

#[test]
fn a_constant_sky_has_one_coefficient() {
    let sky = Sky::Constant(Vec3::new(1.0, 2.0, 0.5));
    let at = [Vec3::ZERO, Vec3::new(5.0, 1.0, -7.0)];
    for rays in [64, 4096] {
        let options = ProbeOptions { rays, ..OPTIONS };
        for p in bake_in(&nothing(), sky.clone(), &at, &options) {
            // Only rounding.
            assert_sh(&p.sh, constant(Vec3::new(1.0, 2.0, 0.5)), 1e-6);
            assert!(p.error < 1e-6, "{}", p.error);
            assert!(p.valid);
        }
    }
}

#[test]
fn a_sky_is_integrated_against_each_harmonic() {
    let (w, h) = (64u32, 32u32);
    let pixels = (0..w * h).map(|i| {
        let (x, y) = (
            (i % w) as f32 * std::f32::consts::TAU / w as f32,
            (i / w) as f32 / h as f32,
        );
        let l = 2.0 - y + (x + 0.7).sin() + y * (2.0 * x + 0.3).cos();
        Vec3::new(l, 0.5 * l, 3.0 - l)
    });
    let sky = Sky::from((w, h, pixels.map(|p| p.max(Vec3::ZERO)).collect()));
    // The midpoint rule in height and longitude, both far finer than the map.
    let (n, m) = (1024, 512);
    let mut expected = [DVec3::ZERO; 9];
    for i in 0..n * m {
        let (u, v) = ((i / m) as f32 + 0.5, (i % m) as f32 + 0.5);
        let d = on_sphere(u / n as f32, v / m as f32);
        let l = sky.radiance(d).as_dvec3();
        add(&mut expected, d, l * (4.0 * PI / f64::from(n * m)));
    }
    let p = bake_in(&nothing(), sky, &[Vec3::ZERO], &OPTIONS)[0];
    // Independent rays would have an error of 4π · 0.282 · σ/√4096 = 0.05 with σ near 0.9. The
    // points are stratified in both dimensions, which leaves less than a tenth for such a smooth
    // function.
    assert_sh(&p.sh, expected.map(|c| c.as_vec3()), 0.005);
}

#[test]
fn a_point_light_is_the_closed_form() {
    let mut scene = nothing();
    let position = Vec3::new(1.0, 2.0, -0.5);
    let intensity = Vec3::new(10.0, 5.0, 1.0);
    scene.lights = vec![lamp(
        LightKind::Point {
            position,
            range: None,
            radius: 0.0,
        },
        intensity,
    )];
    let at = [Vec3::ZERO, Vec3::new(-1.0, 2.0, 3.0), position];
    let probes = bake_in(&scene, Sky::Black, &at, &OPTIONS);
    for (p, at) in probes.iter().zip(&at[..2]) {
        let to = position - *at;
        let flux = intensity / to.length_squared();
        // f32 rounding of sums of up to 10.
        assert_sh(&p.sh, from_one(to, flux), 1e-5);
        // Facing the light E = I/d²; second-order harmonics give 17/16 of that (Ramamoorthi and
        // Hanrahan 2001): (1 + 2 + 5/4)/4.
        let e = p.sh.irradiance(to.normalize());
        assert!((e / flux - 17.0 / 16.0).abs().max_element() < 1e-5, "{e}");
        assert!(p.error < 1e-6);
    }
    assert_sh(&probes[2].sh, [Vec3::ZERO; 9], 0.0);
}

#[test]
fn lamps_cast_shadows() {
    let mut scene = nothing();
    let corner = Vec3::new(-1.0, 1.0, -1.0);
    add_quad(
        &mut scene,
        material(0.0, 0.0),
        corner,
        Vec3::X * 2.0,
        Vec3::Z * 2.0,
    );
    let position = Vec3::new(0.0, 2.0, 0.0);
    scene.lights = vec![lamp(
        LightKind::Point {
            position,
            range: None,
            radius: 0.0,
        },
        Vec3::ONE,
    )];
    let at = [Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0)];
    let [shadow, light] = bake_in(&scene, Sky::Black, &at, &OPTIONS)[..] else {
        panic!("two probes");
    };
    assert_sh(&shadow.sh, [Vec3::ZERO; 9], 0.0);
    let to = position - at[1];
    let flux = Vec3::ONE / to.length_squared();
    assert_sh(&light.sh, from_one(to, flux), 1e-6);
}

#[test]
fn a_sun_arrives_against_its_direction() {
    let mut scene = nothing();
    let direction = Vec3::new(0.48, -0.6, 0.64);
    let lux = Vec3::new(3.0, 2.0, 1.0);
    scene.lights = vec![lamp(
        LightKind::Directional {
            direction,
            angle: 0.0,
        },
        lux,
    )];
    let p = bake_in(&scene, Sky::Black, &[Vec3::ZERO], &OPTIONS)[0];
    assert_sh(&p.sh, from_one(-direction, lux), 1e-6);
    assert!(p.sh.0[1].x > 0.0, "from above: L1−1 is along +Y");
}

#[test]
fn a_spot_lights_its_cone_only() {
    let mut scene = nothing();
    scene.lights = vec![lamp(
        LightKind::Spot {
            position: Vec3::Y,
            direction: Vec3::NEG_Y,
            range: Some(3.0),
            radius: 0.0,
            inner: 0.3,
            outer: 0.5,
        },
        Vec3::splat(8.0),
    )];
    let at = [
        Vec3::ZERO,
        Vec3::NEG_Y,
        Vec3::new(0.0, -2.5, 0.0),
        Vec3::new(1.0, 0.0, 0.0),
    ];
    let probes = bake_in(&scene, Sky::Black, &at, &OPTIONS);
    // I/d² · (1 − (d/range)⁴), KHR_lights_punctual.
    for (p, d) in probes.iter().zip([1f32, 2.0]) {
        let flux = Vec3::splat(8.0 / (d * d) * (1.0 - (d / 3.0).powi(4)));
        assert_sh(&p.sh, from_one(Vec3::Y, flux), 1e-5);
    }
    for p in &probes[2..] {
        assert_sh(&p.sh, [Vec3::ZERO; 9], 0.0);
    }
}

#[test]
fn a_small_bright_surface_fills_its_solid_angle() {
    // A square of 1 m² at ½ m, centred: one side of a cube around the probe, 4π/6 sr. Large black
    // walls elsewhere make it an emitter that gathering rays must not count again.
    let mut scene = nothing();
    let black = material(0.0, 0.0);
    add_box(
        &mut scene,
        &black,
        Vec3::splat(-20.0),
        Vec3::splat(20.0),
        true,
    );
    let corner = Vec3::new(-0.5, 0.5, -0.5);
    add_quad(&mut scene, material(0.0, 6.0), corner, Vec3::X, Vec3::Z);
    let p = bake_in(&scene, Sky::Black, &[Vec3::ZERO], &OPTIONS)[0];
    let expected = 6.0 * ALL / 6.0;
    let error = f64::from(p.error);
    // Counted once, to rounding if directions are drawn uniformly by solid angle, else to four
    // estimated deviations.
    let off = (f64::from(p.sh.0[0].x) - expected).abs();
    assert!(off < 4.0 * error + 1e-5 * expected, "{p:?}");
    assert!(error < 0.02 * expected, "{error}");
    // E(n) − E(−n) = ∫ L ω·n dω is in the first order alone: form factor of the square, F = 4/π ·
    // k/√(1 + k²) · atan(k/√(1 + k²)) with k = 1 (half a side over the distance), times π L.
    let net = p.sh.irradiance(Vec3::Y) - p.sh.irradiance(Vec3::NEG_Y);
    let k = std::f64::consts::FRAC_1_SQRT_2;
    let e = 4.0 / PI * k * k.atan() * PI * 6.0;
    assert!((f64::from(net.x) / e - 1.0).abs() < 0.02, "{net}, {e}");
}

#[test]
fn light_bounces_into_probes() {
    // A closed grey room with a lamp in it.
    let mut scene = Scene::default();
    add_box(
        &mut scene,
        &material(0.5, 0.0),
        Vec3::splat(-1.0),
        Vec3::splat(1.0),
        true,
    );
    let position = Vec3::new(0.0, 0.5, 0.0);
    scene.lights = vec![lamp(
        LightKind::Point {
            position,
            range: None,
            radius: 0.0,
        },
        Vec3::ONE,
    )];
    let at = Vec3::new(0.0, -0.5, 0.0);
    let p = bake_in(&scene, Sky::Black, &[at], &OPTIONS)[0];
    let direct = from_one(Vec3::Y, Vec3::ONE);
    // Mean radiance of the walls: M = ρE, E = Φ/A/(1 − ρ) with Φ = 4π, A = 24: L = ρ/(1 − ρ) · 4/24
    // = 1/6. As seen from here it may differ by as much as the walls do, 15 %.
    let indirect = f64::from(p.sh.0[0].x - direct[0].x);
    assert!((indirect / (ALL / 6.0) - 1.0).abs() < 0.15, "{indirect}");
}

#[test]
fn probes_in_solid_things_are_found_and_filled() {
    let mut scene = Scene::default();
    let white = material(0.8, 0.0);
    add_box(
        &mut scene,
        &white,
        Vec3::ZERO,
        Vec3::new(4.0, 2.0, 4.0),
        true,
    );
    // It stands on the floor: downward rays from inside hit its bottom or the floor's front, which
    // coincide.
    let (low, high) = (Vec3::new(1.0, 0.0, 1.0), Vec3::new(2.0, 1.0, 3.0));
    add_box(&mut scene, &white, low, high, false);
    scene.lights = vec![lamp(
        LightKind::Point {
            position: Vec3::new(3.0, 1.9, 3.0),
            range: None,
            radius: 0.0,
        },
        Vec3::ONE,
    )];
    let grid = ProbeGrid::over(DVec3::ZERO, DVec3::new(4.0, 2.0, 4.0), 0.5).unwrap();
    let at: Vec<Vec3> = (0..grid.len())
        .map(|i| grid.position(i).as_vec3())
        .collect();
    let options = ProbeOptions {
        rays: 256,
        samples: 8,
    };
    let mut probes = bake_in(&scene, Sky::Black, &at, &options);
    let inside = |p: Vec3| p.cmpgt(low).all() && p.cmplt(high).all();
    for (p, at) in probes.iter().zip(&at) {
        assert_eq!(p.valid, !inside(*at), "{at}: {}", p.backfaces);
    }
    let report = report_probes(&probes, Some(&grid), &options);
    assert_eq!((report.probes, report.invalid), (8 * 4 * 8, 2 * 2 * 4));
    assert_eq!(report.dims, Some([8, 4, 8]));
    assert!(report.estimated_error > 0.0 && report.estimated_error < 0.1);
    grid.fill(&mut probes);
    let lit = |p: &Probe| p.sh.0[0].x;
    let open: Vec<f32> = probes.iter().filter(|p| p.valid).map(lit).collect();
    let (least, most) = open
        .iter()
        .fold((f32::MAX, 0f32), |(a, b), x| (a.min(*x), b.max(*x)));
    for p in probes.iter().filter(|p| !p.valid) {
        assert!((least..=most).contains(&lit(p)), "{}", lit(p));
    }
}

#[test]
fn threads_and_neighbours_change_nothing() {
    let mut scene = Scene::default();
    let (low, high) = (Vec3::ZERO, Vec3::splat(2.0));
    add_box(&mut scene, &material(0.7, 0.1), low, high, true);
    let at: Vec<Vec3> = (0..37)
        .map(|i| Vec3::splat(0.1) + Vec3::new(0.04, 0.02, 0.05) * i as f32)
        .collect();
    let options = ProbeOptions {
        rays: 64,
        samples: 16,
    };
    let with = |threads, at: &[Vec3]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| bake_in(&scene, Sky::Black, at, &options))
    };
    let all = with(1, &at);
    assert_eq!(all, with(3, &at));
    assert_eq!(all[20..23], with(1, &at[20..23]));
}

/// A monitor that cancels at once.
struct Stop;

impl Monitor for Stop {
    fn cancelled(&self) -> bool {
        true
    }
}

#[test]
fn a_cancelled_bake_ends() {
    let scene = nothing();
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
    let emitters = Emitters::collect(&world);
    let solution = radiosity::solve(&world, &emitters, &few_patches(), &Silent);
    let probe_scene = ProbeScene {
        world: &world,
        solution: &solution,
        direct: &DirectLight::new(&world, &emitters),
    };
    let at = vec![Vec3::ZERO; 100];
    assert_eq!(
        bake_probes(&probe_scene, &at, &OPTIONS, &Stop),
        Err(Cancelled)
    );
}

#[test]
fn a_probe_on_a_face_sees_what_is_in_front_of_it() {
    // Grids of round numbers put probes right on floors.
    let mut scene = nothing();
    let corner = Vec3::new(-5.0, 0.0, -5.0);
    let (x, z) = (Vec3::X * 10.0, Vec3::Z * 10.0);
    add_quad(&mut scene, material(0.5, 0.0), corner, z, x);
    scene.lights = vec![lamp(
        LightKind::Point {
            position: Vec3::new(0.3, 1.0, 0.2),
            range: None,
            radius: 0.0,
        },
        Vec3::ONE,
    )];
    let at = [1e-3, -1e-6, 0.0, 1e-7, 1e-5, -0.01].map(|y| Vec3::new(0.1, y, 0.0));
    let probes = bake_in(&scene, Sky::Black, &at, &OPTIONS);
    let above = probes[0].sh.0[0].x;
    // Of which the lamp gives about 0.9 · Y00, and the floor the half of all directions.
    assert!(above > 0.28, "{above}");
    for p in &probes[1..5] {
        assert!(p.valid, "{p:?}");
        let x = p.sh.0[0].x;
        // A millimetre from the floor the lamp is 0.2 % nearer.
        assert!((x / above - 1.0).abs() < 5e-3, "{x}, {above}");
    }
    assert!(!probes[5].valid && probes[5].backfaces > 0.4);
}
