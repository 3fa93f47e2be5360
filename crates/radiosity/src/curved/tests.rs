use glam::{DAffine3, DQuat, DVec3, Vec2};

use super::*;
use crate::fixtures::{add_quad, add_triangles, cube, material};
use crate::world::{World, WorldOptions};

/// A unit octahedron split `level` times, with vertices on the sphere, shared within each octant,
/// and the sphere's normals.
fn ball(level: u32, inside: bool) -> Scene {
    let mut scene = Scene::default();
    crate::fixtures::add_sphere(&mut scene, material(0.5, Vec3::ZERO), 1.0, level, inside);
    let primitive = &mut scene.meshes[0].primitives[0];
    let sign = if inside { -1.0 } else { 1.0 };
    primitive.normals = primitive.positions.iter().map(|p| *p * sign).collect();
    scene
}

/// One triangle with these normals.
fn triangle(corners: [Vec3; 3], normals: [Vec3; 3]) -> Scene {
    let mut scene = Scene::default();
    let grey = material(0.5, Vec3::ZERO);
    add_triangles(&mut scene, grey, corners.to_vec(), vec![[0, 1, 2]]);
    scene.meshes[0].primitives[0].normals = normals.map(Vec3::normalize).to_vec();
    scene
}

fn curved_faces(scene: &Scene) -> usize {
    let soup = Soup::build(scene);
    let curved = Curved::find(scene, &soup);
    (0..soup.len() as u32).filter(|&t| curved.is(t)).count()
}

/// Smooth points at a few places of each triangle.
fn points(scene: &Scene, back: bool) -> Vec<crate::SurfacePoint> {
    let soup = Soup::build(scene);
    let world = World::build(scene, &soup, WorldOptions::default()).expect("a tree");
    let places = [(0.3, 0.3), (0.05, 0.9), (0.5, 0.5), (0.0, 0.0)];
    (0..soup.len() as u32)
        .flat_map(|t| places.map(|(u, v)| world.surface_point(t, u, v, back, true)))
        .collect()
}

#[test]
fn points_of_a_sphere_lie_on_it_whatever_its_size_place_and_mirroring() {
    let spin = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, 1.1);
    for size in [1e-3, 1.0, 1e3] {
        for mirror in [1.0, -1.0] {
            let mut scene = ball(2, false);
            let stretch = DVec3::new(mirror, 1.0, 1.0) * size;
            scene.instances[0].transform =
                DAffine3::from_scale_rotation_translation(stretch, spin, DVec3::Y * size);
            let centre = Vec3::Y * size as f32;
            for p in points(&scene, false) {
                let r = p.origin - centre;
                // Some ten roundings of coordinates up to twice the radius, and the offset, each
                // 1e-6 of these.
                let off = (r.length() / size as f32 - 1.0).abs();
                assert!(off < 6e-6, "{size} {mirror}: {off}");
                assert!(p.normal.dot(r.normalize()) > 1.0 - 1e-6);
                assert_eq!(p.geometric, p.normal);
            }
        }
    }
}

#[test]
fn a_hollow_sphere_stays_on_its_facets_but_keeps_no_flat_horizon() {
    let scene = ball(2, true);
    let soup = Soup::build(&scene);
    for (k, p) in points(&scene, false).into_iter().enumerate() {
        let t = k / 4;
        let above = soup.normals[t].dot(p.origin - soup.triangles[t][0]);
        assert!(above > 0.0 && above < 3e-6, "{above}");
        assert_eq!(p.geometric, p.normal);
    }
    // From behind, it is a sphere as well.
    for p in points(&scene, true) {
        assert!((p.origin.length() - 1.0).abs() < 6e-6);
        assert!(p.normal.dot(p.origin) > 0.99);
    }
}

#[test]
fn a_tube_is_a_cylinder_whatever_its_length() {
    let at = |angle: f32, y: f32| {
        let d = Vec2::from_angle(angle);
        (Vec3::new(d.x, y, d.y), Vec3::new(d.x, 0.0, d.y))
    };
    for length in [0.5, 50.0] {
        // Clockwise as seen from above, so fronts are outside.
        let corners = [at(0.0, 0.0), at(0.0, length), at(0.7, 0.0)];
        for p in points(&triangle(corners.map(|c| c.0), corners.map(|c| c.1)), false) {
            let r = Vec2::new(p.origin.x, p.origin.z).length();
            // Offsets: 1.2e-6 of the length.
            assert!((r - 1.0).abs() < 6e-6 + 2e-6 * length, "{length}: {r}");
        }
    }
}

#[test]
fn smoothed_right_angles_stay_flat() {
    // A cube whose corners have the mean of three faces' normals.
    let mut scene = cube(0.5, Vec3::ZERO);
    let primitive = &mut scene.meshes[0].primitives[0];
    primitive.normals = primitive
        .positions
        .iter()
        .map(|p| (Vec3::splat(0.5) - *p).normalize())
        .collect();
    assert_eq!(curved_faces(&scene), 0);
    let soup = Soup::build(&scene);
    for (k, p) in points(&scene, false).into_iter().enumerate() {
        assert_eq!(p.geometric, soup.normals[k / 4]);
        let above = p.geometric.dot(p.origin - soup.triangles[k / 4][0]);
        assert!(above > 0.0 && above < 3e-6, "{above}");
    }
    // A wide cap and a narrow side with shared, area-weighted normals. They are 11° from those of
    // the cap, which alone would pass as a curve.
    let rim = Vec3::new(0.0, -0.2, 1.0).normalize();
    let mut scene = Scene::default();
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.5, 0.0, -0.2)];
    let grey = material(0.5, Vec3::ZERO);
    add_triangles(&mut scene, grey, positions, vec![[0, 1, 2], [1, 0, 3]]);
    scene.meshes[0].primitives[0].normals = vec![rim, rim, Vec3::Z, Vec3::NEG_Y];
    assert_eq!(curved_faces(&scene), 0);
    // Without the side, the cap is a curve.
    scene.meshes[0].primitives[0].triangles.pop();
    scene.meshes[0].primitives[0].source_triangles.pop();
    assert_eq!(curved_faces(&scene), 1);
}

#[test]
fn normals_that_say_nothing_cost_nothing() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    // Rounded to eight bits, turned away, or against the face.
    let rounded = [1.0, -1.0, 1.0].map(|s| Vec3::new(s * 0.5 / 127.0, -s * 0.5 / 127.0, 1.0));
    for normals in [rounded, [Vec3::X; 3], [Vec3::NEG_Z; 3]] {
        let scene = triangle(corners, normals);
        let soup = Soup::build(&scene);
        assert!(Curved::find(&scene, &soup).faces.is_empty(), "{normals:?}");
    }
    let mut flat = cube(0.5, Vec3::ZERO);
    let soup = Soup::build(&flat);
    assert!(Curved::find(&flat, &soup).faces.is_empty());
    // Curved and flat instances in one scene, and an instance without triangles.
    let ball = ball(1, false);
    let mut gone = flat.instances[0].clone();
    gone.transform.matrix3 = glam::DMat3::ZERO;
    flat.instances.push(gone);
    flat.materials.extend(ball.materials);
    flat.meshes.extend(ball.meshes);
    let mut instance = ball.instances[0].clone();
    instance.mesh = 1;
    flat.instances.push(instance);
    flat.meshes[1].primitives[0].material = 1;
    let soup = Soup::build(&flat);
    let curved = Curved::find(&flat, &soup);
    for t in 0..soup.len() as u32 {
        assert_eq!(curved.is(t), t >= 12, "{t}");
    }
}

#[test]
fn a_long_strip_tilted_along_itself_is_no_arch() {
    let corners = [Vec3::ZERO, Vec3::X * 100.0, Vec3::new(100.0, 0.01, 0.0)];
    let normals = [-1.0, 1.0, 1.0].map(|s| Vec3::new(0.5 * s, 0.0, 1.0));
    let scene = triangle(corners, normals);
    assert_eq!(curved_faces(&scene), 1);
    for p in points(&scene, false) {
        assert!(p.origin.z < 0.5 * 0.01 + 3e-4, "{}", p.origin);
    }
}

#[test]
fn what_is_in_the_way_is_approached_to_half_its_distance() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let bulge = corners.map(|c| c - Vec3::new(1.0, 1.0, 0.0) / 3.0 + Vec3::Z);
    let height_under = |cover: Option<f32>| {
        let mut scene = triangle(corners, bulge);
        if let Some(z) = cover {
            let corner = Vec3::new(-2.0, -2.0, z);
            let grey = material(0.5, Vec3::ZERO);
            add_quad(&mut scene, grey, corner, Vec3::X * 4.0, Vec3::Y * 4.0);
        }
        let soup = Soup::build(&scene);
        let world = World::build(&scene, &soup, WorldOptions::default()).expect("a tree");
        let third = 1.0 / 3.0;
        world.surface_point(0, third, third, false, true).position.z
    };
    let free = height_under(None);
    assert!(free > 0.05, "{free}");
    for z in [1e-4, 0.01, 1.9 * free, 2.1 * free, 10.0] {
        let h = height_under(Some(z));
        // Offsets: some 1e-6 of the cover's 2 m.
        assert!((h - free.min(0.5 * z)).abs() < 1e-5, "{z}: {h} {free}");
    }
}
