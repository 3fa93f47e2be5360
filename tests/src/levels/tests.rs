//! Levels are deterministic, cameras are in free space, and the baker can read the files.

use glam::DVec3;

use super::{Family, Level, Size, level};
use crate::path_tracer::{Ray, Scene, Tree};

fn json(level: &Level) -> serde_json::Value {
    let length = u32::from_le_bytes(level.glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&level.glb[20..20 + length]).unwrap()
}

fn cameras(level: &Level) -> Vec<(DVec3, glam::DQuat, f64)> {
    let json = json(level);
    let nodes = json["nodes"].as_array().unwrap().iter();
    let cameras = nodes.filter_map(|n| {
        let camera = n["camera"].as_u64()?;
        let p = &json["cameras"][camera as usize]["perspective"];
        assert_eq!(p["aspectRatio"], 1.5);
        let number = |v: &serde_json::Value, k: usize| v[k].as_f64().unwrap();
        let at = DVec3::from_array([0, 1, 2].map(|k| number(&n["translation"], k)));
        let turn = [0, 1, 2, 3].map(|k| number(&n["rotation"], k));
        let yfov = p["yfov"].as_f64().unwrap();
        Some((at, glam::DQuat::from_array(turn), yfov))
    });
    cameras.collect()
}

/// What is wrong with a level's cameras, judged by the path tracer's reader.
fn wrong_views(level: &Level) -> Option<String> {
    let scene = Scene::from_glb(&level.glb).unwrap();
    let tree = Tree::new(scene.triangles.clone());
    let cast = |origin: DVec3, direction: DVec3| {
        tree.closest(&Ray {
            origin,
            direction,
            t_max: f64::INFINITY,
            skip: [usize::MAX; 2],
        })
    };
    let cameras = cameras(level);
    if cameras.len() != 3 {
        return Some(format!("{} cameras", cameras.len()));
    }
    for (k, (eye, turn, yfov)) in cameras.iter().enumerate() {
        for i in 0..200 {
            let mut rng = super::Random::new(i, 7);
            let hit = cast(*eye, rng.direction().as_dvec3());
            if hit.is_some_and(|h| h.t < 0.2) {
                return Some(format!("view {k} touches something"));
            }
        }
        let half = (yfov / 2.0).tan();
        let (mut good, mut all) = (0, 0);
        for j in 0..16 {
            for i in 0..24 {
                let x = ((f64::from(i) + 0.5) / 12.0 - 1.0) * half * 1.5;
                let y = ((f64::from(j) + 0.5) / 8.0 - 1.0) * half;
                let d = *turn * DVec3::new(x, y, -1.0).normalize();
                all += 1;
                good += match cast(*eye, d) {
                    None => i32::from(level.settings.contains("sky")),
                    Some(h) => {
                        let t = &scene.triangles[h.triangle];
                        let both = scene.surfaces[t.surface].double_sided;
                        i32::from(both || t.normal().dot(d) < 0.0)
                    }
                };
            }
        }
        if good * 10 < all * 9 {
            return Some(format!("view {k} sees {good} of {all}"));
        }
    }
    None
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    for family in Family::ALL {
        let one = level(family, 1, Size::Small);
        assert_eq!(one, level(family, 1, Size::Small), "{family}");
        assert_ne!(one.glb, level(family, 2, Size::Small).glb, "{family}");
    }
}

#[test]
fn names_are_families() {
    for family in Family::ALL {
        assert_eq!(family.name().parse(), Ok(family));
    }
    assert!("castle".parse::<Family>().is_err());
}

#[test]
fn cameras_stand_in_free_space() {
    let mut wrong = Vec::new();
    for family in Family::ALL {
        for seed in 1..4 {
            let made = level(family, seed, Size::Small);
            if let Some(what) = wrong_views(&made) {
                wrong.push(format!("{family} {seed}: {what}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// All families except foliage, whose cards the path tracer does not support.
#[test]
#[ignore = "takes a minute; for whoever changes a family"]
fn cameras_of_full_levels_stand_in_free_space() {
    let mut wrong = Vec::new();
    for family in Family::ALL {
        for seed in 1..25 {
            if family == Family::Foliage {
                continue;
            }
            let made = level(family, seed, Size::Full);
            if let Some(what) = wrong_views(&made) {
                wrong.push(format!("{family} {seed}: {what}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn small_levels_are_small_and_finite() {
    for family in Family::ALL {
        for seed in 1..4 {
            let made = level(family, seed, Size::Small);
            let scene = Scene::from_glb(&made.glb).unwrap();
            let finite = |t: &crate::path_tracer::Triangle| t.corners.iter().all(|c| c.is_finite());
            assert!(scene.triangles.iter().all(finite), "{family} {seed}");
            let n = scene.triangles.len();
            assert!((20..5000).contains(&n), "{family} {seed}: {n} triangles");
            let lit = !scene.lights.is_empty()
                || made.settings.contains("sky")
                || scene.surfaces.iter().any(|s| s.emission != DVec3::ZERO);
            assert!(lit, "{family} {seed} is dark");
        }
    }
}
