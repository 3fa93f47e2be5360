use mesh_ingest::{Light, Material, Scene, Soup};

use super::*;
use crate::fixtures::{add_triangles, material};

/// A box with the given `faces` of its six (−x, +x, −y, +y, −z, +z), facing inwards if `inwards`.
fn block(
    scene: &mut Scene,
    material: Material,
    low: [f32; 3],
    high: [f32; 3],
    inwards: bool,
    faces: std::ops::Range<usize>,
) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for face in faces {
        let (axis, top) = (face / 2, face % 2 == 1);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let first = positions.len() as u32;
        for (a, b) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
            let mut p = low;
            (p[axis], p[u], p[v]) = (
                if top { high[axis] } else { low[axis] },
                if a == 1 { high[u] } else { low[u] },
                if b == 1 { high[v] } else { low[v] },
            );
            positions.push(Vec3::from_array(p));
        }
        let quad = if top != inwards { [1, 2, 3] } else { [3, 2, 1] };
        triangles.push([first, first + quad[0], first + quad[1]]);
        triangles.push([first, first + quad[1], first + quad[2]]);
    }
    add_triangles(scene, material, positions, triangles);
}

fn grey(double_sided: bool) -> Material {
    Material {
        double_sided,
        ..material(0.5, Vec3::ZERO)
    }
}

fn solids(scene: &Scene) -> Solids {
    let soup = Soup::build(scene);
    Solids::find(scene, &soup, &BuildOptions::default(), |_| 1e-6).expect("finite")
}

fn hides(scene: &Scene, points: &[[f32; 3]]) -> Vec<bool> {
    let solids = solids(scene);
    let hide = |p: &[f32; 3]| solids.hide(Vec3::from_array(*p), Vec3::Y);
    points.iter().map(hide).collect()
}

const ALL: std::ops::Range<usize> = 0..6;

#[test]
fn walls_hide_what_is_in_them_whatever_they_overlap_or_touch() {
    for double_sided in [false, true] {
        let mut scene = Scene::default();
        let grey = || grey(double_sided);
        // Two overlap. The third shares a whole face with the second, which the soup keeps once.
        block(&mut scene, grey(), [0.0; 3], [2.0, 2.0, 0.1], false, ALL);
        block(
            &mut scene,
            grey(),
            [1.9, 0.0, 0.0],
            [2.0, 2.0, 2.0],
            false,
            ALL,
        );
        block(
            &mut scene,
            grey(),
            [2.0, 0.0, 0.0],
            [2.1, 2.0, 2.0],
            false,
            ALL,
        );
        let found = hides(
            &scene,
            &[
                [1.0, 1.0, 0.05],
                [1.95, 1.0, 0.05],
                [1.95, 1.0, 1.0],
                [2.05, 1.0, 1.0],
                [1.0, 1.0, 0.5],
                [2.2, 1.0, 1.0],
            ],
        );
        assert_eq!(found, [true, true, true, true, false, false]);
    }
}

#[test]
fn rooms_hide_nothing() {
    // A shell that faces inwards, with a pillar in it.
    let mut scene = Scene::default();
    block(&mut scene, grey(false), [-2.0; 3], [2.0; 3], true, ALL);
    block(
        &mut scene,
        grey(false),
        [-0.2, -2.0, -0.2],
        [0.2, 2.0, 0.2],
        false,
        ALL,
    );
    let points = [[1.0; 3], [0.0; 3], [3.0; 3]];
    assert_eq!(hides(&scene, &points), [false, true, false]);
    // A double-sided shell, wound either way, with a lamp that is not inside the pillar.
    for (lamp, inwards) in [(true, false), (false, false), (false, true)] {
        let mut scene = Scene::default();
        block(&mut scene, grey(true), [-2.0; 3], [2.0; 3], inwards, ALL);
        block(
            &mut scene,
            grey(true),
            [-0.2, -2.0, -0.2],
            [0.2, 2.0, 0.2],
            false,
            ALL,
        );
        if lamp {
            scene.lights.push(Light {
                name: String::new(),
                node: None,
                intensity: Vec3::ONE,
                kind: LightKind::Point {
                    position: Vec3::new(1.0, 1.5, 1.0),
                    range: None,
                    radius: 0.0,
                },
                profile: None,
                cookie: None,
            });
        } else {
            let glow = material(0.5, Vec3::ONE);
            // It stands in the floor.
            let (low, high) = ([1.0, -2.01, 1.0], [1.1, -1.8, 1.1]);
            block(&mut scene, glow, low, high, false, ALL);
        }
        assert_eq!(hides(&scene, &points), [false, true, false]);
    }
}

#[test]
fn a_panel_sunk_in_a_ceiling_does_not_make_it_a_room() {
    let mut scene = Scene::default();
    block(
        &mut scene,
        grey(true),
        [0.0, 2.5, 0.0],
        [4.0, 2.8, 4.0],
        false,
        ALL,
    );
    let glow = material(0.5, Vec3::ONE);
    block(
        &mut scene,
        glow,
        [1.0, 2.45, 1.0],
        [2.0, 2.55, 2.0],
        false,
        ALL,
    );
    assert_eq!(hides(&scene, &[[3.0, 2.6, 3.0]]), [true]);
}

#[test]
fn hollow_bodies_hide_their_walls_alone() {
    // One instance with the outer and the inner shell of a house.
    let mut scene = Scene::default();
    block(&mut scene, grey(true), [-2.0; 3], [2.0; 3], false, ALL);
    block(&mut scene, grey(true), [-1.8; 3], [1.8; 3], true, ALL);
    let (inner, outer) = (scene.meshes.pop(), scene.meshes.last_mut());
    scene.instances.pop();
    if let (Some(inner), Some(outer)) = (inner, outer) {
        outer.primitives.extend(inner.primitives);
    }
    assert_eq!(
        hides(&scene, &[[1.0; 3], [1.9; 3], [3.0; 3]]),
        [false, true, false]
    );
}

#[test]
fn open_shells_and_sheets_hide_nothing() {
    let mut scene = Scene::default();
    // Without a lid; and a sheet of two faces back to back.
    block(&mut scene, grey(false), [0.0; 3], [1.0; 3], false, 0..5);
    block(
        &mut scene,
        grey(false),
        [2.0, 0.0, 0.0],
        [2.0, 1.0, 1.0],
        false,
        0..2,
    );
    assert_eq!(hides(&scene, &[[0.5; 3], [2.0, 0.5, 0.5]]), [false, false]);
}

#[test]
fn a_sky_dome_hides_nothing_but_a_lamp_does() {
    // A hull that glows on both sides, and a crate. The same hull is a third of the second scene.
    for (crate_at, hides_all) in [([0.0; 3], false), ([35.0; 3], true)] {
        let mut scene = Scene::default();
        let glow = Material {
            double_sided: true,
            ..material(0.5, Vec3::ONE)
        };
        block(&mut scene, glow, [-9.0; 3], [9.0; 3], false, ALL);
        let high = crate_at.map(|x| x + 10.0);
        block(&mut scene, grey(true), crate_at, high, false, ALL);
        let in_crate = crate_at.map(|x| x + 5.0);
        let found = hides(&scene, &[[-5.0; 3], in_crate]);
        assert_eq!(found, [hides_all, true]);
    }
}
