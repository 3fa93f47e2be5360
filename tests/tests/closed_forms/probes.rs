//! Light probes under light from all directions, from a hemisphere, and from one direction.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use lumel::{ProbeSource, Settings, SkySource, Sun};
use lumel_tests::scenes::closed_form::Stage;
use lumel_tests::scenes::{FurnaceShape, furnace};

use super::{GOLDEN, golden};
use crate::common::at;

/// The harmonics of red at these points.
fn probes(glb: &[u8], points: &[[f64; 3]], settings: Settings) -> Vec<[f64; 9]> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("points.json");
    std::fs::write(&path, serde_json::json!({"points": points}).to_string()).expect("written");
    let settings = Settings {
        probes: Some(ProbeSource::File(path)),
        ..settings
    };
    let file = golden(glb, &settings)
        .probes
        .expect("probes were asked for");
    assert_eq!(file.probes.len(), points.len());
    (file.probes.iter().zip(points))
        .map(|(p, at)| {
            assert!(p.valid && p.position == *at, "{at:?}");
            p.sh.map(|c| f64::from(c[0]))
        })
        .collect()
}

/// Y_lm in the order of the probe file.
fn harmonics(d: DVec3) -> [f64; 9] {
    let (a, b) = ((3.0 / (4.0 * PI)).sqrt(), 0.5 * (15.0 / PI).sqrt());
    [
        0.5 / PI.sqrt(),
        a * d.y,
        a * d.z,
        a * d.x,
        b * d.x * d.y,
        b * d.y * d.z,
        0.25 * (5.0 / PI).sqrt() * (3.0 * d.z * d.z - 1.0),
        b * d.x * d.z,
        0.5 * b * (d.x * d.x - d.y * d.y),
    ]
}

#[track_caller]
fn close(found: &[f64; 9], exact: &[f64; 9], tolerance: f64) {
    for (k, (f, e)) in found.iter().zip(exact).enumerate() {
        assert!(
            (f - e).abs() < tolerance * exact[0],
            "{k}: {found:?} {exact:?}"
        );
    }
}

#[test]
fn in_a_furnace() {
    for rho in [0.5f32, 0.9] {
        let points = [[0.0, 0.0, 0.0], [0.7, -0.5, 0.9]];
        let found = probes(&furnace(rho, 1.0, FurnaceShape::Cube), &points, at(4.0));
        // L = 1/(1 − ρ) from everywhere: ∫ Y00 dω = 2√π; all others are 0.
        let exact = [
            2.0 * PI.sqrt() / f64::from(1.0 - rho),
            0.,
            0.,
            0.,
            0.,
            0.,
            0.,
            0.,
            0.,
        ];
        for f in found {
            close(&f, &exact, GOLDEN);
        }
    }
}

/// A black floor of 200 m, and nothing else.
fn plain() -> Vec<u8> {
    let mut s = Stage::new();
    s.floor(Vec2::splat(-100.0), Vec2::splat(100.0));
    s.finish()
}

#[test]
fn under_a_sky() {
    let settings = Settings {
        sky: SkySource::Color([2.0; 3]),
        ..at(0.1)
    };
    let found = probes(&plain(), &[[0.0, 0.1, 0.0], [5.0, 0.05, -3.0]], settings);
    // L over the upper half: ∫ Y00 = √π, ∫ Y1−1 = √(3/4π) π; the second order is 0.
    let mut exact = [0.0; 9];
    exact[0] = 2.0 * PI.sqrt();
    exact[1] = 2.0 * PI * (3.0 / (4.0 * PI)).sqrt();
    for f in found {
        // 1024 rays; the floor's end leaves a strip of 1e-3 below the horizon.
        close(&f, &exact, GOLDEN);
    }
}

#[test]
fn in_the_sun() {
    let to = DVec3::new(0.3, 0.8, -0.5).normalize();
    for angle in [0.0, 0.53] {
        let settings = Settings {
            suns: vec![Sun {
                direction: (-to.as_vec3()).to_array(),
                lux: 7.0,
                angle,
            }],
            ..at(0.1)
        };
        let found = probes(&plain(), &[[1.0, 1.0, 1.0]], settings);
        // E⊥ Y(to).
        close(&found[0], &harmonics(to).map(|y| 7.0 * y), GOLDEN);
    }
    // A grid over the floor has one layer, and the sun is the same at each probe.
    let settings = Settings {
        suns: vec![Sun {
            direction: Vec3::NEG_Y.to_array(),
            lux: 1.0,
            angle: 0.0,
        }],
        probes: Some(ProbeSource::Spacing(40.0)),
        ..at(0.1)
    };
    let file = golden(&plain(), &settings).probes.expect("probes");
    let grid = file.grid.expect("a grid");
    assert_eq!(
        grid.dims[0] * grid.dims[1] * grid.dims[2],
        file.probes.len() as u32
    );
    for p in &file.probes {
        close(&p.sh.map(|c| f64::from(c[0])), &harmonics(DVec3::Y), GOLDEN);
    }
}
