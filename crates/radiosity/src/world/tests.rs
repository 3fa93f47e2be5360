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
fn a_wall_stands_half_way_between_two_points_wherever_they_are() {
    // Walls of a grid of 40 cm, 20 to 24 m from the origin, and lumels of 20 cm on both sides.
    for k in 0..100 {
        let x = 20.0 + 0.041 * k as f32;
        let mut scene = floor();
        let corner = Vec3::new(x, -0.5, -1.0);
        let grey = material(0.5, Vec3::ZERO);
        add_quad(&mut scene, grey, corner, Vec3::Y, Vec3::Z * 2.0);
        for d in [0.1, 0.01, 0.3] {
            assert!(walled(&scene, [x - d, 0.0], [x + d, 0.03]), "{x}, {d}");
        }
    }
}

#[test]
fn of_faces_back_to_back_each_side_sees_a_front() {
    // A leaning wall, 40 m from the origin so that positions are rounded: one quad shows one side,
    // and three that share no triangle with it the other.
    let [corner, x, y] = [
        Vec3::new(40.0, 7.3, -31.1),
        Vec3::new(3.1, 0.7, 0.4),
        Vec3::new(-0.3, 1.7, 2.9),
    ];
    let mut scene = floor();
    let mut add = |corner, x, y| add_quad(&mut scene, material(0.5, Vec3::ZERO), corner, x, y);
    add(corner, x, y);
    for k in 0..3 {
        add(corner + x * (k as f32 / 3.0), y, x / 3.0);
    }
    // Half of the wall has a face on one side only.
    add(corner + x * 2.0, y, x);
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, WorldOptions::default()).unwrap();
    let normal = x.cross(y).normalize();
    let sees = |along: f32, side: f32, k: u32| {
        let [u, v, a, b] = crate::sampling::sample_4d(k, 0, 5);
        let target = corner + x * (along + u) + y * v;
        let aside = (x * (a - 0.5) + y * (b - 0.5)) * 2.0;
        let origin = target + normal * (side * 4.0) + aside;
        world.incoming(origin, (target - origin).normalize()).0
    };
    for k in 0..2000 {
        for side in [1.0, -1.0] {
            let Incoming::Surface(hit) = sees(0.0, side, k) else {
                panic!("ray {k} from side {side} sees a back");
            };
            let facing = soup.normals[hit.triangle as usize].dot(normal) * side;
            assert!(!hit.back && facing > 0.0, "ray {k}, side {side}: {hit:?}");
            // The same point of the other face.
            let [a, b, c] = soup.triangles[hit.triangle as usize];
            let at = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            let [u, v, ..] = crate::sampling::sample_4d(k, 0, 5);
            assert!(at.distance(corner + x * u + y * v) < 1e-4, "ray {k}: {at}");
        }
    }
    // What it is the side of remains open, at half of the hits.
    let either = |along, side, k| {
        let [u, v, ..] = crate::sampling::sample_4d(k, 0, 5);
        let target = corner + x * (along + u) + y * v;
        let origin = target + normal * (side * 4.0);
        world.side_met(origin, -normal * side)
    };
    let met = |along, side| {
        let mut met = [0; 3];
        for k in 0..500 {
            met[match either(along, side, k) {
                Side::Shown(_) => 0,
                Side::Either(_) => 1,
                Side::Back => 2,
            }] += 1;
        }
        met
    };
    for side in [1.0, -1.0] {
        let [shown, either, back] = met(0.0, side);
        assert!(back == 0 && shown + either == 500);
    }
    assert_eq!(met(2.0, 1.0), [0, 0, 500]);
    // Where nothing is behind, a back is a back.
    let shown = |side: f32| {
        (0..100)
            .filter(|&k| matches!(sees(2.0, side, k), Incoming::Surface(_)))
            .count()
    };
    assert_eq!([shown(1.0), shown(-1.0)], [0, 100]);
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
