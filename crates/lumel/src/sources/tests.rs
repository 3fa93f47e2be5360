use glam::Vec3;
use mesh_ingest::{Environment, Instance, Light, LightKind, Material, Mesh, Primitive, Scene};
use serde_json::json;

use super::*;

fn light(name: &str, node: Option<usize>) -> Light {
    Light {
        name: name.into(),
        node,
        intensity: Vec3::splat(2.0),
        kind: LightKind::Point {
            position: Vec3::ZERO,
            range: None,
            radius: 0.0,
        },
        profile: None,
        cookie: None,
    }
}

fn material(name: &str, emissive: f32) -> Material {
    Material {
        name: name.into(),
        emissive: Vec3::splat(emissive),
        ..Material::default()
    }
}

/// Lamps "lamp" on the nodes "left" and "right", an unnamed lamp on an unnamed node and a sun of
/// the command line; the materials "wall" (dark), and "neon", "spare" (unused) and an unnamed one,
/// which are emissive.
fn scene() -> (Scene, Value) {
    let wears = |material| Primitive {
        material,
        ..Primitive::default()
    };
    let scene = Scene {
        meshes: vec![Mesh {
            primitives: [0, 1, 3].map(wears).to_vec(),
            ..Mesh::default()
        }],
        instances: vec![Instance {
            node: 9,
            name: String::new(),
            copy: None,
            mesh: 0,
            occluder: false,
            density: 1.0,
            stands_in: None,
            transform: Default::default(),
            extras: None,
        }],
        materials: vec![
            material("wall", 0.0),
            material("neon", 1.0),
            material("spare", 1.0),
            material("", 1.0),
            material("", 0.0),
        ],
        lights: vec![
            light("lamp", Some(0)),
            light("lamp", Some(1)),
            light("", Some(2)),
            light("sun", None),
        ],
        ..Scene::default()
    };
    let document = json!({"nodes": [{"name": "left"}, {"name": "right"}, {}]});
    (scene, document)
}

fn scale(name: &str, factor: f32) -> LightScale {
    LightScale {
        name: name.into(),
        factor,
    }
}

fn group(name: &str, sources: &[&str]) -> LightGroup {
    LightGroup {
        name: name.into(),
        sources: sources.iter().map(|s| s.to_string()).collect(),
    }
}

fn with(lights: &[LightScale], groups: &[LightGroup]) -> Settings {
    Settings {
        lights: lights.to_vec(),
        groups: groups.to_vec(),
        ..Settings::default()
    }
}

fn apply(settings: &Settings) -> Result<(Scene, Chosen), String> {
    let (mut scene, document) = scene();
    check(settings).map_err(|e| e.to_string())?;
    let chosen = Sources::find(&scene, &document, true).apply(&mut scene, settings);
    chosen.map(|c| (scene, c)).map_err(|e| e.to_string())
}

/// Names and intensities of the remaining lights, and emissions of the remaining materials.
fn shining(scene: &Scene) -> (Vec<(String, f32)>, Vec<f32>) {
    let lights = scene.lights.iter();
    (
        lights.map(|l| (l.name.clone(), l.intensity.x)).collect(),
        scene.materials.iter().map(|m| m.emissive.x).collect(),
    )
}

#[test]
fn sources_are_what_shines_in_the_scene() {
    let (scene, document) = scene();
    let list = Sources::find(&scene, &document, true).list();
    let names: Vec<_> = list
        .iter()
        .map(|s| (s.name.as_str(), s.node.as_deref()))
        .collect();
    assert_eq!(
        names,
        [
            ("lamp", Some("left")),
            ("lamp", Some("right")),
            ("nodes[2]", None),
            ("sun", None),
            ("neon", None),
            ("materials[3]", None),
            ("sky", None)
        ]
    );
    let without = Sources::find(&scene, &document, false).list();
    assert_eq!(without.len(), list.len() - 1, "no sky was given");
}

#[test]
fn a_light_goes_by_its_own_and_its_nodes_name() {
    let (s, _) = apply(&with(&[scale("lamp", 0.5), scale("right", 3.0)], &[])).unwrap();
    let lights = [("lamp", 1.0), ("lamp", 6.0), ("", 2.0), ("sun", 2.0)];
    assert_eq!(shining(&s).0, lights.map(|(n, x)| (n.to_owned(), x)));
}

#[test]
fn the_last_pattern_counts_so_that_one_light_can_be_seen_alone() {
    let (s, c) = apply(&with(&[scale("*", 0.0), scale("left", 1.0)], &[])).unwrap();
    let alone = vec![("lamp".to_owned(), 2.0)];
    // "spare" is unused, so it is not a source and stays as it is.
    assert_eq!(shining(&s), (alone, vec![0.0, 0.0, 1.0, 0.0, 0.0]));
    assert_eq!(c.sky_factor, 0.0);
    assert!(c.groups.is_none() && c.report.is_empty());
}

#[test]
fn wild_cards_stand_for_characters_and_case_counts() {
    for (pattern, hits) in [
        ("la*", 2),
        ("*", 7),
        ("?eon", 1),
        ("s??", 2),
        ("*3]", 1),
        ("*i*t", 1),
    ] {
        let (scene, document) = scene();
        let sources = Sources::find(&scene, &document, true);
        let found = sources.matching("--light", pattern).unwrap();
        assert_eq!(found.len(), hits, "{pattern}");
    }
    for pattern in ["Lamp", "lam", "amp", "?lamp", "", "spare", "wall", "[ls]un"] {
        let e = apply(&with(&[scale(pattern, 0.5)], &[])).unwrap_err();
        assert!(e.contains(&format!("{pattern:?}")), "{e}");
        let names = r#""lamp", "left", "materials[3]", "neon", "nodes[2]", "right", "sky", "sun""#;
        assert!(e.ends_with(names), "{e}");
    }
}

#[test]
fn a_message_lists_twenty_names_and_counts_the_rest() {
    let scene = Scene {
        lights: (10..33).map(|i| light(&format!("l{i}"), None)).collect(),
        ..Scene::default()
    };
    let sources = Sources::find(&scene, &Value::Null, false);
    let e = sources.matching("--light", "x").unwrap_err().to_string();
    assert!(e.ends_with(r#""l28", "l29" and 3 more"#), "{e}");
    let none = Sources::find(&Scene::default(), &Value::Null, false);
    let e = none.matching("--light", "*").unwrap_err().to_string();
    assert!(e.ends_with("the scene has none"), "{e}");
}

#[test]
fn groups_are_those_of_what_still_shines() {
    let off = [scale("left", 0.0), scale("neon", 0.0)];
    let groups = [group("in", &["lamp", "neon"]), group("out", &["s*"])];
    let (s, c) = apply(&with(&off, &groups)).unwrap();
    assert_eq!(s.lights.len(), 3);
    let (g, names) = c.groups.unwrap();
    assert_eq!(names, ["in", "out", REST]);
    assert_eq!((g.count, g.sky), (3, 1));
    // The light on "right", the unnamed light, the sun.
    assert_eq!(g.lights, [0, 2, 1]);
    assert_eq!(g.materials, [0, 0, 0, 2, 0]);
    let of = |i: usize| c.report[i].sources.join(" ");
    assert_eq!(
        [of(0), of(1), of(2)],
        ["right", "sun sky", "nodes[2] materials[3]"]
    );
}

#[test]
fn there_is_no_rest_where_all_are_named_or_off() {
    let all = with(&[], &[group("all", &["*"])]);
    let (_, c) = apply(&all).unwrap();
    assert_eq!(c.groups.unwrap().1, ["all"]);
    let rest_off = with(
        &[scale("*", 0.0), scale("lamp", 1.0)],
        &[group("a", &["left"]), group("b", &["right", "sky"])],
    );
    let (_, c) = apply(&rest_off).unwrap();
    let (g, names) = c.groups.unwrap();
    assert_eq!(names, ["a", "b"]);
    assert_eq!((g.count, g.lights), (2, vec![0, 1]));
}

#[test]
fn a_source_in_two_groups_is_refused_by_name() {
    let both = [group("a", &["lamp"]), group("b", &["sky", "right"])];
    let e = apply(&with(&[], &both)).unwrap_err();
    assert_eq!(
        e,
        "\"right\" is in the groups a and b, expected it in only one"
    );
    // A source may be named twice in the same group.
    assert!(apply(&with(&[], &[group("a", &["lamp", "l*"])])).is_ok());
}

#[test]
fn names_of_groups_are_parts_of_file_names() {
    for bad in [
        "",
        "a b",
        "a/b",
        "..",
        ".a",
        "a.",
        "ä",
        "12",
        "Rest",
        &"x".repeat(65),
    ] {
        let e = apply(&with(&[], &[group(bad, &["*"])])).unwrap_err();
        assert!(e.contains("name of a group"), "{e}");
    }
    for good in ["a", "A.b_c-9", "1st", &"x".repeat(64)] {
        assert!(apply(&with(&[], &[group(good, &["*"])])).is_ok(), "{good}");
    }
    let twins = [group("a", &["left"]), group("A", &["right"])];
    assert!(apply(&with(&[], &twins)).is_err());
    assert!(apply(&with(&[], &[group("a", &[])])).is_err());
    let many: Vec<_> = (0..255).map(|i| group(&format!("g{i}"), &["*"])).collect();
    let e = apply(&with(&[], &many)).unwrap_err();
    assert!(e.contains("at most 254"), "{e}");
}

#[test]
fn factors_that_are_none_are_refused() {
    for bad in [-1.0, f32::NAN, f32::INFINITY] {
        assert!(apply(&with(&[scale("*", bad)], &[])).is_err(), "{bad}");
    }
    let e = apply(&with(&[scale("lamp", 3e38)], &[])).unwrap_err();
    assert!(e.contains("overflows"), "{e}");
}

#[test]
fn the_scenes_own_environment_is_the_sky_too() {
    let environment = Environment {
        name: "hall".into(),
        width: 1,
        height: 1,
        pixels: vec![Vec3::ONE],
    };
    for (factor, left) in [(0.5, Some(0.5)), (0.0, None)] {
        let mut scene = Scene {
            environment: Some(environment.clone()),
            ..Scene::default()
        };
        let sources = Sources::find(&scene, &Value::Null, false);
        let settings = with(&[scale("sky", factor)], &[]);
        sources.apply(&mut scene, &settings).unwrap();
        let pixel = scene.environment.map(|e| e.pixels[0].x);
        assert_eq!(pixel, left);
    }
}
