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

/// Asserts that the light at a receiver is `exact` on average over seeds, and never far from it.
fn on_average(l: &DirectLight, at: SurfacePoint, exact: f32) {
    let one = |seed| l.irradiance(|_| at, 0.0, seed, &FEW);
    let some: Vec<f32> = (1..=400).map(|seed| one(seed).irradiance.x).collect();
    let mean = some.iter().sum::<f32>() / 400.0;
    // Spread of one: less than SHARE for each of some dozens of lights, which are independent, and
    // less than REST for those of which at most one is drawn.
    let spread = (some.iter().map(|e| (e - mean).powi(2)).sum::<f32>() / 400.0).sqrt();
    assert!(spread < 0.02 * exact, "spread {spread} of {exact}");
    // Four standard errors of the mean, and rounding.
    let error = 4.0 * spread / 20.0 + 1e-5 * exact;
    assert!(
        (mean - exact).abs() < error,
        "{mean}, not {exact} ± {error}"
    );
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
        on_average(l, at, exact);
        let rays = l.irradiance(|_| at, 0.0, 1, &FEW).rays;
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

#[test]
fn the_weakest_groups_are_drawn_as_often_as_they_say() {
    // ((number, whether it is a group), weight). Number 1 is weak but no group, number 5 is a group
    // but not weak.
    let lights = [
        ((0, true), 0.004),
        ((1, false), 0.001),
        ((2, true), 0.002),
        ((3, false), 0.6),
        ((4, true), 0.003),
        ((5, true), 0.39),
    ];
    let mut drawn = [0u32; 6];
    let draws = 10_000;
    for seed in 0..draws {
        let mut left = lights.to_vec();
        let rest = draw_rest(&mut left, |l: (usize, bool)| l.1, 1.0, seed);
        let mut kept: Vec<usize> = left.iter().map(|l| l.0.0).collect();
        kept.sort_unstable();
        assert_eq!(kept, [1, 3, 5]);
        // It stands for 1 % of the light.
        if let Some(((k, _), chance)) = rest {
            assert!((chance * 0.01 - lights[k].1).abs() < 1e-6);
            drawn[k] += 1;
        }
    }
    // Together they bring 0.9 %, so one receiver in ten draws none.
    for (k, share) in [(0, 0.4), (2, 0.2), (4, 0.3)] {
        // Four standard deviations of a binomial distribution.
        let n = f64::from(draws);
        let error = 4.0 * (n * share * (1.0 - share)).sqrt();
        assert!((f64::from(drawn[k]) - n * share).abs() < error, "{drawn:?}");
    }
    // One weak group alone stays, and so do groups of which each is too much.
    for (number, weight) in [(1, 0.004), (4, 0.0101)] {
        let mut left = vec![((0, true), 0.9)];
        left.extend((0..number).map(|k| ((k, true), weight)));
        let before = left.len();
        assert!(draw_rest(&mut left, |l: (usize, bool)| l.1, 1.0, 3).is_none());
        assert_eq!(left.len(), before);
    }
}

#[test]
fn far_panels_bring_their_light_on_average() {
    // Rooms with a panel above the receiver's and 60 more at distances of 30 m and more.
    let mut scene = Scene::default();
    let corner = Vec3::new(-100.0, -100.0, 0.0);
    let black = material(0.0, Vec3::ZERO);
    add_quad(&mut scene, black, corner, Vec3::X * 200.0, Vec3::Y * 200.0);
    let mut add = |x: f32, y: f32, size: f32| {
        let corner = Vec3::new(x, y, 2.5);
        let glow = material(0.0, Vec3::splat(2.0));
        add_quad(&mut scene, glow, corner, Vec3::Y * size, Vec3::X * size);
    };
    add(-0.5, -0.5, 1.0);
    for k in 0..60u32 {
        let (x, y) = ((k % 8) as f32 - 3.5, (k / 8) as f32 - 3.5);
        let far = Vec3::new(x, y, 0.0).normalize() * 30.0;
        add(far.x + 9.0 * x, far.y + 9.0 * y, 1.0 + 0.1 * (k % 5) as f32);
    }
    let at = receiver(Vec3::ZERO, Vec3::new(0.1, 0.0, 1.0).normalize());
    with_light(&scene, |l| {
        let exact: f32 = (l.emitters.emitters.iter())
            .map(|e| std::f32::consts::PI * l.form_factor(e, &at) * luminance(e.radiance))
            .sum();
        on_average(l, at, exact);
    });
}
