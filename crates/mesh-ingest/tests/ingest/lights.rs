//! Extensions of lights in `extras.lumel`.

use std::f32::consts::PI;

use mesh_ingest::{Light, LightKind, Loaded};
use serde_json::{Value, json};

use super::build::{Doc, UNIT};

/// One light with its extras and those of its node.
fn with_light(light: Value, node_extras: Value) -> Loaded {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([light]);
    doc.root(json!({
        "scale": [3, 3, 3], "extras": node_extras,
        "extensions": {"KHR_lights_punctual": {"light": 0}}
    }));
    doc.load().unwrap()
}

fn radius(light: &Light) -> f32 {
    match light.kind {
        LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } => radius,
        LightKind::Directional { .. } => panic!("a directional light"),
    }
}

fn warnings(loaded: &Loaded) -> Vec<&str> {
    loaded
        .report
        .warnings
        .iter()
        .map(|w| w.path.as_str())
        .collect()
}

#[test]
fn radius_comes_from_the_node_else_the_light_and_is_not_scaled() {
    for kind in ["point", "spot"] {
        let plain = with_light(json!({"type": kind}), json!(null));
        assert_eq!(radius(&plain.scene.lights[0]), 0.0);
        let own = json!({"type": kind, "extras": {"lumel": {"radius": 0.25}}});
        let loaded = with_light(own.clone(), json!({"other": 1}));
        assert_eq!(radius(&loaded.scene.lights[0]), 0.25);
        let loaded = with_light(own, json!({"lumel": {"radius": 0.5}}));
        assert_eq!(radius(&loaded.scene.lights[0]), 0.5);
        assert!(loaded.report.warnings.is_empty());
    }
}

#[test]
fn angle_is_the_diameter_in_degrees() {
    let sun = json!({"type": "directional", "extras": {"lumel": {"angle": 2}}});
    let loaded = with_light(sun, json!(null));
    let LightKind::Directional { angle, .. } = loaded.scene.lights[0].kind else {
        panic!("{:?}", loaded.scene.lights)
    };
    // Two f32 roundings.
    assert!((angle - PI / 180.0).abs() < 1e-8, "{angle}");
}

#[test]
fn wrong_sizes_are_ignored_with_a_warning() {
    for wrong in [
        json!("1"),
        json!(-1),
        json!([1]),
        json!(true),
        json!(1e300),
        json!(null),
    ] {
        let light = json!({"type": "point", "extras": {"lumel": {"radius": 0.25}}});
        let loaded = with_light(light, json!({"lumel": {"radius": wrong}}));
        assert_eq!(radius(&loaded.scene.lights[0]), 0.25, "{wrong}");
        assert_eq!(warnings(&loaded), ["nodes[1].extras.lumel.radius"]);
        let message = &loaded.report.warnings[0].message;
        assert!(
            message.contains("found") && message.contains("expected"),
            "{message}"
        );
        assert_eq!(loaded.report.counts["lights.extras_ignored"], 1);

        let light = json!({"type": "directional", "extras": {"lumel": {"angle": wrong}}});
        let loaded = with_light(light, json!(null));
        let LightKind::Directional { angle, .. } = loaded.scene.lights[0].kind else {
            panic!("{:?}", loaded.scene.lights)
        };
        assert_eq!(angle, 0.0);
        assert_eq!(
            warnings(&loaded),
            ["extensions.KHR_lights_punctual.lights[0].extras.lumel.angle"]
        );
    }
}

#[test]
fn sizes_of_other_kinds_of_light_are_named() {
    let loaded = with_light(
        json!({"type": "directional"}),
        json!({"lumel": {"radius": 1}}),
    );
    assert_eq!(warnings(&loaded), ["nodes[1].extras.lumel.radius"]);
    let loaded = with_light(json!({"type": "spot"}), json!({"lumel": {"angle": 1}}));
    assert_eq!(warnings(&loaded), ["nodes[1].extras.lumel.angle"]);
    // Extras that are not an object, or contain no `lumel`, are ignored.
    for extras in [json!("text"), json!([1]), json!({"radius": 1})] {
        assert_eq!(
            warnings(&with_light(json!({"type": "spot"}), extras)),
            [""; 0]
        );
    }
}

#[test]
fn a_profile_without_direction_is_ignored_and_said() {
    let mut doc = Doc::with_triangles(&UNIT);
    let file = "data:,TILT=NONE%0A1 1 1 2 1 1 1 0 0 0 1 1 9 0 90 0 5 5";
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] =
        json!([{"type": "point", "extras": {"lumel": {"ies": file}}}]);
    let node = doc.root(json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
    assert!(doc.load().unwrap().scene.lights[0].profile.is_some());
    doc.json["nodes"][node]["scale"] = json!([1, 1, 0]);
    let loaded = doc.load().unwrap();
    assert!(loaded.scene.lights[0].profile.is_none());
    assert_eq!(
        warnings(&loaded),
        ["extensions.KHR_lights_punctual.lights[0].extras.lumel.ies"]
    );
}

/// A PNG of one white pixel.
const PIXEL: &str = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGP4DwABAQEAsTj2FAAAAABJRU5ErkJggg==";

#[test]
fn cookies_come_from_textures_and_files_once_each() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["images"] = json!([{ "uri": PIXEL }]);
    doc.json["textures"] = json!([{ "source": 0 }]);
    let cookie = |value: Value| json!({"lumel": {"cookie": value}});
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([
        {"type": "spot", "extras": cookie(json!(0))},
        {"type": "directional", "extras": cookie(json!(PIXEL))},
        {"type": "point", "extras": cookie(json!(0))},
        {"type": "spot", "extras": cookie(json!(1))},
        {"type": "spot", "spot": {"outerConeAngle": 1.57}, "extras": cookie(json!(0))},
    ]);
    for light in 0..5 {
        doc.root(json!({"extensions": {"KHR_lights_punctual": {"light": light}}}));
    }
    doc.root(json!({
        "extensions": {"KHR_lights_punctual": {"light": 0}},
        "extras": {"lumel": {"cookie": PIXEL, "cookieSize": 2}},
    }));
    let loaded = doc.load().unwrap();
    let worn: Vec<Option<usize>> = (loaded.scene.lights.iter())
        .map(|l| l.cookie.map(|c| c.cookie))
        .collect();
    assert_eq!(worn, [Some(0), Some(1), None, None, None, Some(1)]);
    assert_eq!(loaded.scene.cookies.len(), 2);
    let at = |light: usize, key: &str| {
        format!("extensions.KHR_lights_punctual.lights[{light}].extras.lumel.{key}")
    };
    let expected = [at(2, "cookie"), at(3, "cookie"), at(4, "cookie")];
    let more = ["nodes[6].extras.lumel.cookieSize".to_string()];
    assert_eq!(
        warnings(&loaded),
        expected.iter().chain(&more).collect::<Vec<_>>()
    );

    // A picture that cannot be read is an error, as for IES files.
    doc.json["images"] = json!([{ "uri": "data:image/png;base64,iVBORw0KGgo=" }]);
    assert!(doc.load().is_err());
}

#[test]
fn damaged_lights_end_in_an_answer() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["images"] = json!([{ "uri": PIXEL }]);
    doc.json["textures"] = json!([{ "source": 0 }]);
    doc.json["extensions"] = json!({
        "KHR_lights_punctual": {"lights": [{"type": "spot", "extras": {"lumel": {"radius": 1, "angle": 2, "cookie": 0}}}]},
        "EXT_lights_ies": {"lights": [{"uri": "data:,TILT=NONE%0A1 1 1 2 1 1 1 0 0 0 1 1 9 0 90 0 5 5"}]},
        "EXT_lights_image_based": {"lights": [{
            "rotation": [0, 0, 0, 1], "intensity": 1, "specularImages": [[0, 0, 0, 0, 0, 0]],
            "irradianceCoefficients": vec![[1, 1, 1]; 9], "specularImageSize": 1,
        }]},
    });
    doc.json["scenes"][0]["extensions"]["EXT_lights_image_based"] = json!({"light": 0});
    doc.root(json!({
        "extensions": {"KHR_lights_punctual": {"light": 0}, "EXT_lights_ies": {"light": 0, "color": [1, 1, 1]}},
        "extras": {"lumel": {"radius": 2}}, "rotation": [0, 0, 0, 1], "scale": [1, 2, 3],
    }));
    assert!(doc.load().is_ok());
    let whole = serde_json::to_string(&doc.json).unwrap();
    // Corrupts every number in turn, and every name.
    let number = |c: char| c.is_ascii_digit();
    for (at, c) in whole.char_indices().filter(|&(_, c)| number(c) || c == '"') {
        for wrong in ["-7", "1e38", "null", "[]", "x"] {
            let mut damaged = whole.clone();
            damaged.replace_range(at..at + c.len_utf8(), wrong);
            if let Ok(json) = serde_json::from_str(&damaged) {
                doc.json = json;
                let _ = doc.load();
            }
        }
    }
}
