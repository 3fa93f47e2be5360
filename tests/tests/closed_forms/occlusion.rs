//! Ambient occlusion and the sun mask.

use std::f64::consts::PI;

use glam::{Vec2, Vec3};
use lumel::{Layer, Settings};
use lumel_tests::gltf::Light;
use lumel_tests::scenes::closed_form::Stage;
use serde_json::json;

use super::{GOLDEN, golden, production};
use crate::common::{Seen, at, lumels_of};

fn ao(distance: f32, settings: Settings) -> Settings {
    Settings {
        layers: vec![Layer::Ao],
        ao_distance: Some(distance),
        ..settings
    }
}

/// Fraction of a disc beyond a chord at `s` radii from its centre.
fn segment(s: f64) -> f64 {
    let s = s.clamp(-1.0, 1.0);
    (s.acos() - s * (1.0 - s * s).sqrt()) / PI
}

#[test]
fn beside_a_wall() {
    // A wall at x = 0, wide and high, and a floor of 1 × 1 m in front of it. Rays that hit the wall
    // within r have ω_x < −x/r: projected onto the floor, where cosine-weighted directions are
    // uniform, they are the segment of the unit disc beyond a chord at x/r.
    let reach = 0.7;
    let mut s = Stage::new();
    s.floor(Vec2::ZERO, Vec2::ONE);
    s.panel(
        "wall",
        [Vec3::new(0.0, 0.0, -2.0), Vec3::Y * 1.5, Vec3::Z * 5.0],
        s.black,
    );
    let lumels = lumels_of(
        &golden(&s.finish(), &ao(reach as f32, production(12.0))),
        "floor",
    );
    let exact = |l: &Seen| l.mean(|p| 1.0 - segment(p.x / reach));
    let (mut sum, mut all) = (0.0, 0.0);
    for l in &lumels {
        let (open, exact) = (l.layer("ao.Y"), exact(l));
        // 512 rays: 2.2 % at a half, unstratified.
        assert!(
            (open - exact).abs() < 0.04,
            "{}: {open} {exact}",
            l.middle()
        );
        if l.all(|p| p.x > reach) {
            assert!((open - 1.0).abs() < 1e-3, "{open}");
        }
        sum += open;
        all += exact;
    }
    assert!((sum / all - 1.0).abs() < GOLDEN, "{}", sum / all);
}

#[test]
fn all_open_and_all_closed() {
    let mut s = Stage::new();
    s.floor(Vec2::ZERO, Vec2::ONE);
    for l in lumels_of(&golden(&s.finish(), &ao(0.5, at(6.0))), "floor") {
        assert!((l.layer("ao.Y") - 1.0).abs() < 1e-6, "{}", l.layer("ao.Y"));
    }
    let mut s = Stage::new();
    s.room(Vec3::ZERO, Vec3::ONE, s.black);
    let glb = s.finish();
    // Longer than the room's diagonal, and shorter than rays from the middle of one wall to all
    // others.
    for l in lumels_of(&golden(&glb, &ao(2.0, at(6.0))), "-y") {
        assert_eq!(l.layer("ao.Y"), 0.0);
    }
    let near = lumels_of(&golden(&glb, &ao(0.4, at(8.0))), "-y");
    for l in near
        .iter()
        .filter(|l| l.all(|p| (p.x - 0.5).abs().max((p.z - 0.5).abs()) < 0.1))
    {
        assert!((l.layer("ao.Y") - 1.0).abs() < 1e-3);
    }
}

#[test]
fn the_mask_of_the_sun() {
    // A disc of 5° overhead, and a blocker 2 m above the floor that ends at x = 0. Another lamp,
    // which is not a sun, does not count.
    let mut s = Stage::new();
    s.floor(Vec2::new(-0.25, -1.0), Vec2::new(0.25, 1.0));
    s.blocker([Vec3::new(-40.0, 2.0, -40.0), Vec3::Z * 80.0, Vec3::X * 40.0]);
    let more = json!({"extras": {"lumel": {"angle": 5.0}}});
    s.lamp(
        "sun",
        Light::Directional([10.0; 3]),
        [Vec3::Y, Vec3::NEG_Y],
        more,
    );
    let lamp = [Vec3::new(0.0, 1.0, 0.0), Vec3::NEG_Y];
    s.lamp("lamp", Light::Point([5.0; 3]), lamp, json!({}));
    let settings = Settings {
        layers: vec![Layer::SunMask],
        ..production(16.0)
    };
    let lumels = lumels_of(&golden(&s.finish(), &settings), "floor");
    let rim = 2.5f64.to_radians().sin();
    let share = |l: &Seen| l.mean(|p| segment(-p.x / p.x.hypot(2.0) / rim));
    let (mut sum, mut all, mut n) = (0.0, 0.0, 0);
    for l in &lumels {
        let (mask, exact) = (l.layer("sun_mask.Y"), share(l));
        if l.all(|p| p.x < -0.0875) {
            assert_eq!(mask, 0.0);
        } else if l.all(|p| p.x > 0.0875) {
            assert_eq!(mask, 1.0);
        } else {
            // One lumel of 512 points: four times the 0.85 % of sized_lights.rs.
            assert!(
                (mask - exact).abs() < 0.035,
                "{}: {mask} {exact}",
                l.middle()
            );
            n += 1;
        }
        sum += mask;
        all += exact;
    }
    assert!(n > 50);
    assert!((sum / all - 1.0).abs() < GOLDEN, "{}", sum / all);
    // Faces turned away have none.
    let mut s = Stage::new();
    s.panel("ceiling", [Vec3::ZERO, Vec3::X, Vec3::Z], s.black);
    s.lamp(
        "sun",
        Light::Directional([10.0; 3]),
        [Vec3::Y, Vec3::NEG_Y],
        json!({}),
    );
    for l in lumels_of(&golden(&s.finish(), &settings), "ceiling") {
        assert_eq!(l.layer("sun_mask.Y"), 0.0);
    }
}
