use super::*;
use crate::World;
use crate::fixtures::{add_quad, material};

/// Which quads of a scene are backed. Both triangles of a quad must say the same.
fn backed_quads(quads: &[[Vec3; 3]], double_sided: bool) -> Vec<bool> {
    let mut scene = Scene::default();
    for (k, [corner, x, y]) in quads.iter().enumerate() {
        let mut own = material(0.5, Vec3::ZERO);
        own.double_sided = double_sided && k > 0;
        add_quad(&mut scene, own, *corner, *x, *y);
    }
    let soup = Soup::build(&scene);
    let world = World::build(&scene, &soup, crate::WorldOptions::default()).unwrap();
    let mut of_quads = vec![None; quads.len()];
    for triangle in 0..soup.seen() {
        let quad = soup.source(triangle as u32).instance as usize;
        let own = world.backed[triangle];
        assert_eq!(*of_quads[quad].get_or_insert(own), own, "quad {quad}");
    }
    of_quads.into_iter().map(Option::unwrap).collect()
}

/// A leaning wall 40 m from the origin, so that positions are rounded.
const WALL: [Vec3; 3] = [
    Vec3::new(40.0, 7.3, -31.1),
    Vec3::new(3.1, 0.7, 0.4),
    Vec3::new(-0.3, 1.7, 2.9),
];

/// A quad in a grid on the wall, from (`u`, `v`), `w` wide and high, facing the other way.
fn behind(u: f32, v: f32, w: f32) -> [Vec3; 3] {
    let [corner, x, y] = WALL;
    [corner + x * u + y * v, y * w, x * w]
}

#[test]
fn a_wall_with_other_triangles_behind_it_is_backed() {
    assert_eq!(
        backed_quads(&[WALL, behind(0.0, 0.0, 1.0)], false),
        [true; 2]
    );
    assert_eq!(
        backed_quads(&[WALL, behind(0.2, 0.3, 0.5)], false),
        [true; 2]
    );
    // Double-sided ones show both sides, so nothing needs to be behind them.
    assert!(backed_quads(&[WALL, WALL], true)[0]);
    assert_eq!(
        backed_quads(&[WALL, behind(0.0, 0.0, 1.0)], true),
        [true, false]
    );
}

#[test]
fn what_is_beside_or_apart_or_across_backs_nothing() {
    let [corner, x, y] = WALL;
    let across = x.cross(y).normalize();
    for other in [
        behind(1.0, 0.0, 1.0),
        behind(0.0, -1.0, 1.0),
        [corner + across * 0.01, y, x],
        [corner + x * 0.5 - across, y, across * 2.0],
        // The same way round.
        [corner + x * 0.2, x * 0.5, y * 0.5],
    ] {
        assert_eq!(backed_quads(&[WALL, other], false), [false; 2], "{other:?}");
    }
}
