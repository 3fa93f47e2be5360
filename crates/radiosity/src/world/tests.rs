use glam::Vec3;
use mesh_ingest::{AlphaMode, LightKind, Scene};

use super::*;
use crate::fixtures::{add_quad, cube, light, material};
use crate::{Emitters, Silent, SolveOptions, solve};

/// A black floor around the origin.
fn floor() -> Scene {
    let mut scene = Scene::default();
    let corner = Vec3::new(-5.0, 0.0, -5.0);
    add_quad(
        &mut scene,
        material(0.0, Vec3::ZERO),
        corner,
        Vec3::Z * 10.0,
        Vec3::X * 10.0,
    );
    scene
}

/// Whether a wall stands between two points of the floor of `scene`, tested at 2 cm.
fn walled(scene: &Scene, a: [f32; 2], b: [f32; 2]) -> bool {
    let soup = Soup::build(scene);
    let world = World::build(scene, &soup, WorldOptions::default()).unwrap();
    let point = |[x, z]: [f32; 2]| {
        let position = Vec3::new(x, 0.0, z);
        SurfacePoint {
            position,
            origin: position + Vec3::Y * world.offset(position),
            normal: Vec3::Y,
            geometric: Vec3::Y,
        }
    };
    world.wall_between(&point(a), &point(b), 0.02)
}

#[test]
fn a_wall_stands_between_what_it_parts() {
    let mut scene = floor();
    // At x = 0.1 from z = −1 to 1, 5 cm high, leaning by 45° towards +X.
    let corner = Vec3::new(0.1, 0.0, -1.0);
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        corner,
        Vec3::new(0.05, 0.05, 0.0),
        Vec3::Z * 2.0,
    );
    assert!(walled(&scene, [0.0, 0.0], [0.2, 0.1]));
    assert!(walled(&scene, [0.2, 0.1], [0.0, 0.0]));
    // A point right behind it, closer than the wall overhangs at the tested height.
    assert!(walled(&scene, [0.1 - 1e-4, 0.0], [0.2, 0.0]));
    assert!(!walled(&scene, [0.0, 0.0], [0.05, 0.2]));
    assert!(!walled(&scene, [0.0, 2.0], [0.2, 2.0]), "it ends before");
}

#[test]
fn a_threshold_is_no_wall_and_neither_is_a_grille() {
    let mut scene = floor();
    let corner = Vec3::new(0.1, 0.0, -1.0);
    add_quad(
        &mut scene,
        material(0.5, Vec3::ZERO),
        corner,
        Vec3::Y * 0.01,
        Vec3::Z * 2.0,
    );
    assert!(!walled(&scene, [0.0, 0.0], [0.2, 0.0]));
    let mut scene = floor();
    let mut grille = material(0.5, Vec3::ZERO);
    grille.alpha = AlphaMode::Mask { cutoff: 0.5 };
    add_quad(&mut scene, grille, corner, Vec3::Y, Vec3::Z * 2.0);
    assert!(!walled(&scene, [0.0, 0.0], [0.2, 0.0]));
}

#[test]
fn a_room_beyond_a_sheet_on_the_same_floor_is_dark() {
    let mut scene = cube(0.8, Vec3::ZERO);
    // Askew, so that it cuts patches, through the whole of floor, ceiling and walls.
    let mut sheet = material(0.8, Vec3::ZERO);
    sheet.double_sided = true;
    let x = |z: f32| 0.47 + 0.06 * z;
    let (near, far) = (Vec3::new(x(-0.1), -0.1, -0.1), Vec3::new(x(1.1), -0.1, 1.1));
    add_quad(&mut scene, sheet, near, Vec3::Y * 1.2, far - near);
    let position = Vec3::new(0.2, 0.6, 0.5);
    let kind = LightKind::Point {
        position,
        range: None,
        radius: 0.0,
    };
    scene.lights.push(light(1.0, kind));
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
    let emitters = Emitters::collect(&world);
    let mut options = SolveOptions {
        rays: 64,
        ..SolveOptions::default()
    };
    options.cut.patches = 600;
    let solution = solve(&world, &emitters, &options, &Silent);
    assert!(solution.report.walled_elements > 0);
    let cut = &solution.cut;
    let (mut dark, mut lit) = (0, 0);
    for (i, patch) in cut.patches().iter().enumerate().filter(|(_, p)| !p.hidden) {
        let e = cut.elements()[patch.first_element as usize];
        let p = world
            .surface_point(e.triangle, e.u, e.v, patch.back, false)
            .position;
        if soup.sources[e.triangle as usize].instance == 1 {
            continue; // the sheet itself
        }
        let light = luminance(solution.indirect[i] + solution.direct_mean[i]);
        if p.x > x(p.z) {
            assert_eq!(light, 0.0, "{p}");
            dark += 1;
        } else {
            assert!(light > 0.0, "{p}");
            lit += 1;
        }
    }
    assert!(dark > 200 && lit > 200, "{dark} {lit}");
}

#[test]
fn what_rises_above_a_floor_is_found_and_what_lies_in_it_is_not() {
    let above = |corner: Vec3, x: Vec3, y: Vec3| {
        let mut scene = floor();
        add_quad(&mut scene, material(0.5, Vec3::ZERO), corner, x, y);
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
        let p = SurfacePoint {
            position: Vec3::ZERO,
            origin: Vec3::Y * 1e-5,
            normal: Vec3::Y,
            geometric: Vec3::Y,
        };
        world.anything_above(&p, 0.5)
    };
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    // A needle inside the box, one that passes through it, one beside it, and one under the floor.
    assert!(above(Vec3::new(0.4, 0.0, 0.4), y * 0.1, x * 1e-3));
    assert!(above(Vec3::new(-9.0, 0.3, 0.2), x * 20.0, y * 1e-3));
    assert!(!above(Vec3::new(0.6, 0.0, 0.4), y * 0.1, x * 1e-3));
    assert!(!above(Vec3::new(0.1, -0.3, 0.1), y * 0.2, x * 0.1));
    // A large triangle whose box overlaps but which misses the corner.
    assert!(!above(
        Vec3::new(2.1, 0.0, -1.0),
        Vec3::new(-3.0, 0.0, 3.0),
        y * 3.0
    ));
    assert!(above(
        Vec3::new(1.7, 0.0, -1.0),
        Vec3::new(-3.0, 0.0, 3.0),
        y * 3.0
    ));
    // A second floor within rounding, and a mat.
    assert!(!above(Vec3::new(-1.0, 1e-6, -1.0), z * 2.0, x * 2.0));
    assert!(above(Vec3::new(-1.0, 0.01, -1.0), z * 2.0, x * 2.0));
}
