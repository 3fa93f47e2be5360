use mesh_ingest::{Scene, Soup};

use super::*;
use crate::emitters::Emitters;
use crate::fixtures::{add_quad, material, without_ceiling};
use crate::monitor::Silent;
use crate::sampling::sample_2d;
use crate::sky::Sky;
use crate::solution::Solution;
use crate::solve::{SolveOptions, solve};
use crate::world::WorldOptions;

fn under_a_sky(scene: &Scene) -> Solution {
    let soup = Soup::build(scene);
    let options = WorldOptions {
        sky: Sky::Constant(Vec3::ONE),
        ..WorldOptions::default()
    };
    let world = World::build(scene, &soup, options).unwrap();
    let options = SolveOptions {
        rays: 32,
        ..SolveOptions::default()
    };
    solve(&world, &Emitters::collect(&world), &options, &Silent)
}

/// A shaft of one square metre, three metres deep, seen from inside.
fn shaft() -> Scene {
    without_ceiling(1.0, 3.0, 1.0)
}

/// The opening of the patch on triangle 0 at `p`.
fn opening_at(solution: &Solution, p: Vec3) -> Option<Opening<'_>> {
    let at = solution.cut.locate(0, p, false).unwrap();
    solution.openings.of(at.patch)
}

#[test]
fn rays_from_the_bottom_of_a_shaft_go_to_its_mouth() {
    let solution = under_a_sky(&shaft());
    let middle = Vec3::new(0.5, 0.0, 0.5);
    let opening = opening_at(&solution, middle).unwrap();
    let n = 256;
    let (mut through, mut same) = (0, 0);
    for i in 0..n {
        let [x, y] = sample_2d(i, 0, 7);
        let (direction, density) = opening.draw(x, y);
        assert!((direction.length() - 1.0).abs() < 1e-5);
        same += u32::from(opening.density(direction) == density);
        let at = middle + direction * (3.0 / direction.y.max(1e-3));
        through += u32::from((0.0..1.0).contains(&at.x) && (0.0..1.0).contains(&at.z));
    }
    // Rounding may put a direction on a border into the next one.
    assert!(same > n - 8, "{same}");
    // The mouth is one part in thirty of the patch's view. The other patches of the cube, up to half
    // a metre away, see it in other directions: 27 % of the rays go through.
    assert!(through > n / 5, "{through}");
}

#[test]
fn densities_add_up_to_one() {
    let solution = under_a_sky(&shaft());
    let opening = opening_at(&solution, Vec3::new(0.2, 0.0, 0.3)).unwrap();
    let mut sum = 0.0;
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let up = 2.0 * (row as f32 + 0.5) / ROWS as f32 - 1.0;
            let (sin, cos) = libm::sincosf(((column as f32 + 0.5) / COLUMNS as f32 - 0.5) * TAU);
            let level = (1.0 - up * up).sqrt();
            let direction = Vec3::new(level * cos, up, level * sin);
            assert_eq!(usize::from(number(direction)), row * COLUMNS + column);
            sum += opening.density(direction) * SOLID_ANGLE;
        }
    }
    assert!((sum - 1.0).abs() < 1e-4, "{sum}");
}

#[test]
fn outdoors_and_without_a_sky_there_are_none() {
    let mut plain = Scene::default();
    add_quad(
        &mut plain,
        material(0.5, Vec3::ZERO),
        Vec3::ZERO,
        Vec3::Z,
        Vec3::X,
    );
    let solution = under_a_sky(&plain);
    assert!(opening_at(&solution, Vec3::new(0.5, 0.0, 0.5)).is_none());
    assert!(Openings::default().of(PatchId(0)).is_none());
}
