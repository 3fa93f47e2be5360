//! A uniform sky.

use std::f64::consts::PI;

use glam::DVec3;
use lumel::{Settings, SkySource};
use lumel_tests::scenes::closed_form as scenes;

use super::{HALF, SMOOTH};
use crate::common::{Seen, at, bake, lumels_of, mean, worst};

#[test]
fn a_uniform_sky_seen_from_an_open_box() {
    let (side, depth) = (2.0, 1.0);
    let settings = Settings {
        sky: SkySource::Color([1.0; 3]),
        ..at(12.0)
    };
    let b = bake(
        &scenes::sky_over_open_box(side as f32, depth as f32),
        &settings,
    );
    let mouth = scenes::mouth(side);
    let lumels = lumels_of(&b, "box");
    let exact = |l: &Seen| l.mean(|p| scenes::polygon_irradiance(1.0, &mouth, p, l.normal));
    let (mut square, mut n, mut sum, mut exact_sum) = (0.0, 0.0, 0.0, 0.0);
    for l in &lumels {
        let e = exact(l);
        if !e.is_finite() || l.coverage < 0.5 {
            continue; // on the line of the mouth's edge
        }
        square += (l.red() / e - 1.0).powi(2);
        sum += l.red();
        exact_sum += e;
        n += 1.0;
    }
    // Gathered by 128 to 256 Sobol rays, smoothed: preview's own estimate is about 1 %; the mean
    // over thousands is far better.
    let rms = (square / n).sqrt();
    assert!(rms < 0.02, "{rms}");
    assert!(
        (sum / exact_sum - 1.0f64).abs() < 2e-3,
        "{}",
        sum / exact_sum
    );
}

/// At the bottom of a shaft one gathering ray in thirty finds the sky.
#[test]
fn the_sky_at_the_bottom_of_a_shaft_is_sampled() {
    let (side, depth) = (1.0, 3.0);
    let settings = Settings {
        sky: SkySource::Color([1.0; 3]),
        ..at(16.0)
    };
    let b = bake(
        &scenes::sky_over_open_box(side as f32, depth as f32),
        &settings,
    );
    let mouth = scenes::mouth(side);
    let off: Vec<f64> = (lumels_of(&b, "box").iter())
        .filter(|l| l.normal.y > 0.5 && l.coverage > 0.5)
        .map(|l| l.red() / l.mean(|p| scenes::polygon_irradiance(1.0, &mouth, p, l.normal)) - 1.0)
        .collect();
    assert!(off.len() > 200, "{}", off.len());
    let rms = (off.iter().map(|x| x * x).sum::<f64>() / off.len() as f64).sqrt();
    // 3.0 % with shadow rays to the sky, 4.4 % without them.
    assert!(rms < 0.037, "{rms}");
}

#[test]
fn a_checker_screen_lets_half_of_the_sun_through() {
    let b = bake(&scenes::masked_checker_screen(4.0), &at(16.0));
    let lumels = lumels_of(&b, "floor");
    let under: Vec<_> = lumels
        .iter()
        .filter(|l| l.all(|p| p.x.abs() < 1.0 && p.z.abs() < 1.0))
        .collect();
    let mean = under.iter().map(|l| l.red()).sum::<f64>() / under.len() as f64;
    // 16 to 128 shadow rays in each of about 1000 lumels; an edge crosses a quarter of them:
    // 0.5/√(16·250) = 0.8 % at most.
    assert!((mean / 2.0 - 1.0).abs() < 0.01, "{mean}");
    let beside = lumels
        .iter()
        .find(|l| l.all(|p| p.x > 1.5))
        .expect("a lumel in the sun");
    assert!((beside.red() / 4.0 - 1.0).abs() < 1e-3);
}

fn under_a_sky(radiance: f32, density: f32) -> Settings {
    Settings {
        sky: SkySource::Color([radiance; 3]),
        ..at(density)
    }
}

#[test]
fn a_free_floor_receives_pi_l_whatever_the_sky() {
    for l in [1e-3f32, 1.0, 1e4] {
        let b = bake(&scenes::lone_floor(), &under_a_sky(l, 12.0));
        // All rays escape and see the same radiance.
        let w = worst(&lumels_of(&b, "floor"), 0.0, |_| PI * f64::from(l));
        assert!(w < HALF, "{l}: {w}");
    }
}

#[test]
fn a_wall_receives_half_of_that() {
    // All but the part that the floor hides: half of πL for an infinite floor; for one of 20 m, the
    // closed form gives the excess.
    let b = bake(&scenes::wall_on_floor(20.0), &under_a_sky(1.0, 6.0));
    let floor = [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)]
        .map(|(x, z)| DVec3::new(x, 0.0, z));
    let sky = |p: DVec3| {
        // The half of the floor in front of the wall: light from behind the wall is below its
        // horizon.
        let half = floor.map(|c| DVec3::new(c.x, 0.0, c.z.max(0.0)));
        PI - scenes::polygon_irradiance(1.0, &half, p, DVec3::Z)
    };
    let lumels = lumels_of(&b, "wall");
    assert!(lumels.iter().all(|l| l.normal.z > 0.99));
    let m = mean(&lumels);
    let exact = lumels.iter().map(|l| l.mean(sky)).sum::<f64>() / lumels.len() as f64;
    // A strip of β below the horizon adds 2βL: at a height of half a metre and a distance of 10 m,
    // 6 % of πL/2.
    assert!((exact / (0.5 * PI) - 1.064).abs() < 0.01, "{exact}");
    // At least 128 rays in each of 36 lumels, half of which escape: 1/√(128·36) = 1.5 % if
    // unstratified; Sobol points do better.
    assert!((m / exact - 1.0).abs() < SMOOTH, "{m} {exact}");
    // One lumel: three times 1/√128 = 9 %, about a third of it with stratification.
    let w = worst(&lumels, 0.0, |l| l.mean(sky));
    assert!(w < 0.03, "{w}");
}

#[test]
fn boxes_of_every_depth_under_a_sky() {
    for depth in [0.25, 1.0, 3.0] {
        let glb = scenes::sky_over_open_box(1.0, depth as f32);
        let b = bake(&glb, &under_a_sky(1.0, 8.0));
        // πL × 1 m² enters through the opening, and all of it is absorbed.
        let area = 1.0 + 4.0 * depth;
        let m = mean(&lumels_of(&b, "box")) * area / PI;
        // Walls are a whole number of lumels high, so that coverage is area. The mean is over more
        // than a hundred lumels.
        assert!((m - 1.0).abs() < SMOOTH, "depth {depth}: {m}");
    }
}
