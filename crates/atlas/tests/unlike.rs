//! Density factors of nodes, and instances of one mesh that differ too much to share charts.

use crate::common::*;
use atlas::{LayoutOptions, layout, separate_unlike};
use glam::{DAffine3, DVec3, Vec3};
use mesh_ingest::{Scene, Soup};

fn at_density(texels_per_unit: f32) -> LayoutOptions {
    LayoutOptions {
        texels_per_unit: Some(texels_per_unit),
        ..LayoutOptions::default()
    }
}

fn scaled(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_scale(DVec3::new(x, y, z))
}

fn with_densities(mut scene: Scene, densities: &[f32]) -> Scene {
    for (instance, &density) in scene.instances.iter_mut().zip(densities) {
        instance.density = density;
    }
    scene
}

fn meshes(scene: &Scene) -> Vec<usize> {
    scene.instances.iter().map(|i| i.mesh).collect()
}

#[test]
fn a_floor_and_a_crate_made_of_one_cube_get_charts_of_their_own() {
    let transforms = [
        scaled(1.0, 1.0, 1.0),
        scaled(20.0, 0.2, 20.0),
        scaled(1.2, 1.0, 1.1) * DAffine3::from_rotation_y(0.5),
        scaled(18.0, 0.2, 22.0),
    ];
    let cube = || cuboid(Vec3::ONE);
    let instances = transforms.into_iter().map(|t| (0, t)).collect();
    let (mut scene, soup) = scene(vec![cube()], instances);
    // With shared charts the crate's four sides are one lumel high.
    let (shared, _) = layout(&scene, &soup, &at_density(4.0), &|_| true).expect("a layout");
    assert_eq!(shared.placements[0].rect.w, shared.placements[1].rect.w);
    assert_eq!(separate_unlike(&mut scene), 1);
    // The largest instance keeps the mesh; similar ones share it.
    assert_eq!(meshes(&scene), [1, 0, 1, 0]);
    let soup = Soup::build(&scene);
    let (apart, report) = layout(&scene, &soup, &at_density(4.0), &|_| true).expect("a layout");
    check_placements(&scene, &apart);
    // Six sides of 4 × 4 and the shear of the rotated one, padded: far below the floor's 80 × 80.
    let size = |i: usize| apart.placements[i].rect.w * apart.placements[i].rect.h;
    assert!(
        (6 * 16..6 * 100).contains(&size(0)),
        "{:?}",
        apart.placements[0]
    );
    assert!(size(1) > 2 * 80 * 80);
    assert!(report.density[0] > 4.0 * 0.7, "{:?}", report.density);
    assert!(report.density[2] < 4.0 * 6.0, "{:?}", report.density);
}

#[test]
fn instances_that_are_alike_go_on_sharing_a_mesh() {
    // Sizes within a factor of two, rotated and mirrored; a flat mesh may have any height.
    let transforms = [
        scaled(1.0, 1.0, 1.0),
        scaled(0.55, 0.55, 0.55) * DAffine3::from_rotation_x(1.0),
        scaled(-0.8, 0.8, 0.8),
        scaled(1.0, 9.0, 1.0),
    ];
    let instances = transforms.into_iter().map(|t| (0, t)).collect();
    let (mut scene, _) = scene(vec![plane(3.0, 2.0)], instances);
    // The second is rotated after scaling, so only its size differs.
    assert_eq!(separate_unlike(&mut scene), 0);
    assert_eq!(meshes(&scene), [0, 0, 0, 0]);
}

#[test]
fn copies_of_one_node_are_never_parted() {
    let instances = (0..6).map(|i| (0, scaled(1.0 + 9.0 * f64::from(i), 1.0, 1.0)));
    let (mut scene, _) = scene(vec![cuboid(Vec3::ONE)], instances.collect());
    for (i, instance) in scene.instances.iter_mut().enumerate().take(4) {
        (instance.node, instance.copy) = (0, Some(i as u32));
    }
    separate_unlike(&mut scene);
    let of = meshes(&scene);
    assert!(of[..4].iter().all(|&m| m == of[0]), "{of:?}");
    assert!(scene.meshes.len() <= 3);
}

#[test]
fn a_thousand_shapes_make_at_most_eight_copies() {
    let instances = (0..1000).map(|i| {
        let t = f64::from(i) * 0.01;
        (0, scaled(t.exp(), (10.0 - t).exp(), (0.7 * t).exp()))
    });
    let (mut scene, _) = scene(vec![cuboid(Vec3::ONE)], instances.collect());
    assert_eq!(separate_unlike(&mut scene), 7);
}

#[test]
fn a_factor_is_relative_to_the_scenes_density_and_changes_nobody_else() {
    let three = || {
        let instances = (0..3)
            .map(|i| (0, at(f64::from(i) * 9.0, 0.0, 0.0)))
            .collect();
        scene(vec![plane(4.0, 4.0)], instances).0
    };
    for options in [at_density(8.0), LayoutOptions::default()] {
        let options = LayoutOptions {
            block: 1,
            ..options
        };
        let plan = |densities: &[f32]| {
            let mut scene = with_densities(three(), densities);
            separate_unlike(&mut scene);
            let soup = Soup::build(&scene);
            let (layout, report) = layout(&scene, &soup, &options, &|_| true).expect("a layout");
            if densities.iter().all(|&d| d > 0.0) {
                check_placements(&scene, &layout);
            }
            let widths: Vec<u32> = layout.placements.iter().map(|p| p.rect.w).collect();
            (report.texels_per_unit, widths)
        };
        let (base, plain) = plan(&[1.0; 3]);
        let (same, widths) = plan(&[1.0, 0.6, 4.0]);
        assert_eq!(base, same, "factors do not move the scene's density");
        assert_eq!(widths[0], plain[0]);
        // The tolerance is a texel on both sides and the rounding of the chart to whole texels;
        // without blocks.
        for (width, factor) in [(widths[1], 0.6), (widths[2], 4.0)] {
            let wanted = 4.0 * base * factor;
            assert!(
                (width as f32 - 2.0 - wanted).abs() <= 1.0,
                "{width} {wanted}"
            );
        }
        let (_, gone) = plan(&[1.0, 0.0, 1.0]);
        assert_eq!(gone[1], 0, "no lumels");
    }
}

#[test]
fn coordinates_depend_on_neither_company_order_nor_unit() {
    let options = |unit: f64| at_density((9.0 / unit) as f32);
    let print = |scene: &mut Scene, unit: f64, mesh: usize| {
        separate_unlike(scene);
        let soup = Soup::build(scene);
        let (layout, _) = layout(scene, &soup, &options(unit), &|_| true).expect("a layout");
        let atlas = &layout.meshes[mesh];
        format!("{:?} {:?}", atlas.size, atlas.primitives)
    };
    let shapes = || {
        vec![
            sphere(12, 1.7),
            cuboid(Vec3::new(3.0, 2.0, 1.0)),
            moebius(32),
        ]
    };
    for i in 0..3 {
        let alone = print(&mut lone(shapes().remove(i)).0, 1.0, 0);
        let places = [
            at(0.0, 0.0, 0.0),
            at(7.0, 1.0, 0.0),
            at(0.0, 5.0, 9.0),
            at(1.0, 1.0, 1.0),
        ];
        for order in [[0, 1, 2, 0], [2, 1, 0, 2], [1, 1, 2, 0]] {
            let instances = order.into_iter().zip(places).collect();
            let mut many = scene(shapes(), instances).0;
            let same = print(&mut many, 1.0, i) == alone;
            assert!(same, "mesh {i} in order {order:?}");
        }
        // Millimetres and kilometres by the node's scale. (With scaled vertices, rounding would
        // differ.)
        for unit in [1e-3, 1e3] {
            let node = vec![(0, DAffine3::from_scale(DVec3::splat(unit)))];
            let mut by_node = scene(vec![shapes().remove(i)], node).0;
            let same = print(&mut by_node, unit, 0) == alone;
            assert!(same, "mesh {i} times {unit}");
        }
    }
}
