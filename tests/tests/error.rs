//! `--error`: the gather continues until the estimate reaches the target, or reports that it
//! cannot.

use std::path::Path;

use glam::Vec3;
use lumel::{Quality, Settings, Silent};
use lumel_tests::geometry::{cuboid, room};
use lumel_tests::gltf::{GltfBuilder, Material, Node};

use crate::common;

fn bake(error: f32, quality: Quality, density: f32) -> lumel::Bake {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/cornell_box.glb");
    let settings = Settings {
        quality,
        texels_per_unit: Some(density),
        error: Some(error),
        ..Settings::default()
    };
    lumel::bake(&file, &settings, &Silent).expect("the box bakes")
}

#[test]
fn an_error_is_reached_with_no_more_rays_than_it_takes() {
    // The first rays, `quick`'s, reach 0.041.
    let coarse = bake(0.1, Quality::Preview, 4.0).report.gather.light;
    assert_eq!(coarse.error_reached, Some(true));
    assert!(coarse.estimated_error <= 0.1);
    let mut rays = coarse.lumel_rays;
    for wanted in [0.03, 0.015, 0.0075] {
        let report = bake(wanted, Quality::Preview, 4.0).report.gather.light;
        assert_eq!(report.error_reached, Some(true), "{wanted}");
        assert!(report.estimated_error <= f64::from(wanted));
        assert!(
            report.lumel_rays > rays,
            "{wanted}: a smaller error takes more rays"
        );
        rays = report.lumel_rays;
    }
}

#[test]
fn each_preset_takes_more_rays_for_less_error() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/cornell_box.glb");
    let presets = [Quality::Draft, Quality::Quick, Quality::Preview];
    let reports = presets.map(|quality| {
        let settings = Settings {
            quality,
            texels_per_unit: Some(4.0),
            ..Settings::default()
        };
        let bake = lumel::bake(&file, &settings, &Silent).expect("the box bakes");
        bake.report.gather.light
    });
    for pair in reports.windows(2) {
        assert!(pair[1].lumel_rays >= 2 * pair[0].lumel_rays);
        // The inverse root of two.
        let share = pair[1].estimated_error / pair[0].estimated_error;
        assert!(share < 0.71, "{share}");
    }
}

#[test]
fn an_error_out_of_reach_is_a_warning() {
    // Below what 8192 rays per lumel can reach; with a draft's solve this is detected quickly.
    let bake = bake(1e-5, Quality::Draft, 1.0);
    let report = &bake.report.gather.light;
    assert_eq!(report.error_reached, Some(false));
    assert!(report.exhausted_lumels > 0 && report.estimated_error > 1e-5);
    // 8192 rays, two for each of half as many points at contacts, and as many at a penumbra.
    let most = 3 * 8192 * report.lumels;
    assert!(report.lumel_rays <= most, "{} of {most}", report.lumel_rays);
    let warned = |w: &String| w.contains("was not reached");
    assert!(
        bake.report.warnings.iter().any(warned),
        "{:?}",
        bake.report.warnings
    );
}

/// A room of 4 m with a glowing block and two boards, `slit` metres apart.
fn boards(slit: f32) -> Vec<u8> {
    let mut b = GltfBuilder::new();
    let grey = b.material(&Material::diffuse("grey", [0.5; 3]));
    let glow = b.material(&Material::emitter("glow", [5.0; 3], [0.0; 3]));
    let [x, z] = [1.5, 1.0];
    let shapes = [
        (room(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), 1), grey),
        (
            cuboid(Vec3::new(0.5, 2.2, 1.0), Vec3::new(1.0, 2.3, 3.0), 1),
            glow,
        ),
        (
            cuboid(Vec3::new(x - 0.1, 0.0, z), Vec3::new(x, 2.0, z + 2.0), 1),
            grey,
        ),
        (
            cuboid(
                Vec3::new(x + slit, 0.0, z),
                Vec3::new(x + slit + 0.1, 2.0, z + 2.0),
                1,
            ),
            grey,
        ),
    ];
    for (i, (shape, material)) in shapes.iter().enumerate() {
        let name = format!("shape_{i}");
        let mesh = b.mesh(&name, &[(&shape.clone().bare(), *material)]);
        b.node(Node::of_mesh(&name, mesh));
    }
    b.finish()
}

#[test]
fn what_nobody_sees_is_not_in_the_claim() {
    // The insides of a slit are dark and known badly. If they counted as all others do, they would
    // double the claim.
    let [slit, gap] = [0.01, 2.0].map(|apart| {
        let settings = Settings {
            quality: Quality::Draft,
            ..common::at(10.0)
        };
        let bake = common::bake(&boards(apart), &settings);
        bake.report.gather.light.estimated_error
    });
    assert!(slit < 1.25 * gap, "{slit} beside {gap}");
}

#[test]
fn lumels_as_wide_as_rooms_claim_an_error() {
    // No ray goes three lumels far in a room of two by two.
    let settings = Settings {
        quality: Quality::Draft,
        ..common::at(0.5)
    };
    let report = common::bake(&boards(2.0), &settings).report.gather.light;
    assert!(report.estimated_error > 0.0 && report.median_error > 0.0);
}
