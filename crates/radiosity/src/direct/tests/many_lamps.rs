//! More lamps than are treated one by one.

use super::*;
use crate::direct::lamp_tree::Lamps;

/// A street: 40 groups of eight lamps, ten metres apart, three metres above the floor, the nearest
/// ones at x = 0.
fn street() -> Scene {
    let mut scene = floor();
    for k in 0..320u32 {
        let (group, own) = ((k / 8) as f32, (k % 8) as f32);
        let position = Vec3::new(10.0 * group + 0.3 * own, own - 3.5, 3.0);
        scene.lights.push(light(
            1.0 + 0.1 * own,
            LightKind::Point {
                position,
                range: None,
                radius: 0.05 * (k % 2) as f32,
            },
        ));
    }
    scene
}

/// The lamps of a cut, and its number of lights.
fn lamps_of(l: &DirectLight, p: Vec3, scale: f32) -> (Vec<u32>, usize) {
    let cut = l.lamps.cut(&l.world.scene.lights, p, scale);
    let mut lamps: Vec<u32> = (cut.iter())
        .flat_map(|(lamps, _)| match *lamps {
            Lamps::One(k) => vec![k],
            Lamps::Group(id) => l.lamps.members(id),
        })
        .collect();
    lamps.sort_unstable();
    (lamps, cut.len())
}

#[test]
fn every_lamp_is_in_one_light_and_lights_are_few() {
    with_light(&street(), |l| {
        for x in [0.0, 55.0, 200.0, 395.0] {
            let (lamps, lights) = lamps_of(l, Vec3::new(x, 0.5, 0.0), 0.1);
            assert_eq!(lamps, (0..320).collect::<Vec<u32>>());
            // Some eight near ones, and what contributes 1 % or more of the rest.
            assert!((8..=64).contains(&lights), "{lights} lights at {x}");
        }
    });
}

#[test]
fn groups_of_lamps_bring_their_light_on_average() {
    let scene = street();
    let at = receiver(
        Vec3::new(4.0, 0.2, 0.0),
        Vec3::new(0.1, 0.0, 1.0).normalize(),
    );
    let single = |k: usize| {
        let mut one = floor();
        one.lights.push(scene.lights[k].clone());
        estimate(&one, at, &FEW).irradiance.x
    };
    let exact: f32 = (0..320).map(single).sum();
    with_light(&scene, |l| {
        let one = |seed| l.irradiance(|_| at, 0.0, seed, &FEW);
        let some: Vec<f32> = (1..=400).map(|seed| one(seed).irradiance.x).collect();
        let mean = some.iter().sum::<f32>() / 400.0;
        // Spread of one: less than SHARE for each of some dozens of lights, which are independent.
        let spread = (some.iter().map(|e| (e - mean).powi(2)).sum::<f32>() / 400.0).sqrt();
        assert!(spread < 0.02 * exact, "spread {spread} of {exact}");
        // Four standard errors of the mean, and rounding.
        let error = 4.0 * spread / 20.0 + 1e-5 * exact;
        assert!(
            (mean - exact).abs() < error,
            "{mean}, not {exact} ± {error}"
        );
        let rays = one(1).rays;
        assert!(rays < 64, "{rays} rays for 320 lamps");
    });
}

#[test]
fn a_candle_counts_beside_a_thousand_floodlights() {
    let mut scene = street();
    for of in &mut scene.lights {
        of.intensity *= 1e4;
    }
    // Farther from it than the others are from each other.
    let position = Vec3::new(0.0, 40.0, 0.4);
    scene.lights.push(light(
        1.0,
        LightKind::Point {
            position,
            range: Some(2.0),
            radius: 0.0,
        },
    ));
    with_light(&scene, |l| {
        let near = Vec3::new(0.0, 40.3, 0.0);
        let cut = l.lamps.cut(&scene.lights, near, 0.05);
        assert!(
            cut.iter().any(|(lamps, _)| *lamps == Lamps::One(320)),
            "{cut:?}"
        );
        // Out of its range it is in no light of its own.
        let cut = l.lamps.cut(&scene.lights, Vec3::new(100.0, 0.0, 0.0), 0.05);
        assert!(cut.iter().all(|(lamps, _)| *lamps != Lamps::One(320)));
    });
}

#[test]
fn lamps_above_a_limit_are_all_found() {
    with_light(&street(), |l| {
        let lights = &l.world.scene.lights;
        let p = Vec3::new(123.0, 1.0, 0.0);
        let at = receiver(p, Vec3::Z);
        for least in [0.0, 1e-4, 1e-2, 1.0] {
            let mut found = Vec::new();
            let _ = l.lamps.each_above(p, least, |k| {
                found.push(k);
                Some(())
            });
            for (k, light) in lights.iter().enumerate() {
                let above = l.weight_of_lamp(light, &at) > least;
                assert!(!above || found.contains(&(k as u32)), "{k} above {least}");
            }
            let most = if least >= 1e-2 { 100 } else { 320 };
            assert!(found.len() <= most, "{} above {least}", found.len());
        }
    });
}

#[test]
fn a_thousand_lamps_in_one_place_are_a_bounded_number_of_lights() {
    let mut scene = floor();
    for _ in 0..1000 {
        let position = Vec3::new(0.0, 0.0, 1.0);
        scene.lights.push(light(
            1.0,
            LightKind::Point {
                position,
                range: None,
                radius: 0.0,
            },
        ));
    }
    with_light(&scene, |l| {
        // So near, and so large, that every group is.
        let (lamps, lights) = lamps_of(l, Vec3::new(0.0, 0.1, 1.0), 0.5);
        assert_eq!(lamps.len(), 1000);
        assert!(lights <= 256, "{lights} lights");
    });
}
