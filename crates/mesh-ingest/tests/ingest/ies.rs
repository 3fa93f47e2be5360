//! `EXT_lights_ies`: photometric files, distributions and orientation.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;

use glam::{DVec3, Vec3};
use mesh_ingest::{Error, LightKind, LoadOptions, Loaded, load};
use serde_json::{Value, json};

use super::build::{Doc, UNIT, paths};

/// A file of the 2002 edition with these angles and the intensities `value(vertical, horizontal)`.
fn ies(vertical: &[f64], horizontal: &[f64], value: impl Fn(f64, f64) -> f64) -> String {
    let mut s = String::from("IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] Lumel\nTILT=NONE\n");
    let (nv, nh) = (vertical.len(), horizontal.len());
    write!(s, "1 1000 2.0 {nv} {nh} 1 2 0.1 0.1 0\n1.0 1.0 50\n").unwrap();
    for list in [vertical, horizontal] {
        for x in list {
            write!(s, "{x} ").unwrap();
        }
        s.push('\n');
    }
    for &h in horizontal {
        for &v in vertical {
            write!(s, "{} ", value(v, h)).unwrap();
        }
        s.push('\n');
    }
    s
}

fn steps(from: f64, to: f64, n: usize) -> Vec<f64> {
    (0..=n)
        .map(|k| from + (to - from) * k as f64 / n as f64)
        .collect()
}

/// A document with the file on a separate node.
fn document(file: &[u8], node: Value) -> Doc {
    let mut doc = Doc::with_triangles(&UNIT);
    let view = doc.view(file);
    doc.json["extensions"]["EXT_lights_ies"]["lights"] =
        json!([{"bufferView": view, "mimeType": "application/x-ies-lm-63"}]);
    let mut node = node;
    if node["extensions"]["EXT_lights_ies"].is_null() {
        node["extensions"]["EXT_lights_ies"] = json!({"light": 0});
    }
    doc.root(node);
    doc
}

fn read(file: &str) -> Loaded {
    document(file.as_bytes(), json!({})).load().unwrap()
}

/// Candela in the profile's own axes, by the two angles in degrees.
fn candela(loaded: &Loaded, vertical: f64, horizontal: f64) -> f64 {
    let (t, p) = (vertical.to_radians(), horizontal.to_radians());
    let d = DVec3::new(t.sin() * p.cos(), -t.cos(), -t.sin() * p.sin());
    let factor = loaded.scene.profiles[0].value(d.as_vec3());
    f64::from(factor) * f64::from(loaded.scene.lights[0].intensity.x)
}

#[test]
fn intensity_times_profile_is_candela() {
    let loaded = read(&ies(&[0.0, 45.0, 90.0], &[0.0, 90.0], |v, h| 100.0 + v + h));
    let [light] = &loaded.scene.lights[..] else {
        panic!("{:?}", loaded.scene.lights)
    };
    assert!(matches!(
        light.kind,
        LightKind::Point {
            range: None,
            radius: 0.0,
            ..
        }
    ));
    // The file's multiplier is 2; its largest intensity is at (90, 90).
    assert_eq!(light.intensity, Vec3::splat(560.0));
    assert!(
        loaded.report.warnings.is_empty(),
        "{:?}",
        loaded.report.warnings
    );
    for (v, h, expected) in [
        (0.0, 0.0, 200.0),
        (45.0, 0.0, 290.0),
        (90.0, 90.0, 560.0),
        (22.5, 0.0, 245.0),
        (45.0, 45.0, 380.0),
        (30.0, 60.0, 380.0),
        // Mirrored quadrants.
        (45.0, 135.0, 380.0),
        (45.0, 225.0, 380.0),
        (45.0, 315.0, 380.0),
        (45.0, 180.0, 290.0),
        // Beyond the last vertical angle.
        (90.5, 0.0, 0.0),
        (180.0, 0.0, 0.0),
    ] {
        let got = candela(&loaded, v, h);
        // f32 angles and values: about 1e-6 of the largest.
        assert!(
            (got - expected).abs() < 2e-3,
            "{v} {h}: {got}, not {expected}"
        );
    }
}

#[test]
fn multiplier_and_color_scale_and_odd_ones_are_clamped() {
    let file = ies(&[0.0, 180.0], &[0.0], |_, _| 10.0);
    let with = |worn: Value| {
        document(
            file.as_bytes(),
            json!({"extensions": {"EXT_lights_ies": worn}}),
        )
        .load()
        .unwrap()
    };
    let loaded = with(json!({"light": 0, "multiplier": 0.5, "color": [1, 0.5, 0.25]}));
    assert_eq!(loaded.scene.lights[0].intensity, Vec3::new(10.0, 5.0, 2.5));
    let loaded = with(json!({"light": 0, "multiplier": -1}));
    assert_eq!(loaded.scene.lights[0].intensity, Vec3::ZERO);
    assert_eq!(loaded.report.counts["lights.clamped"], 1);
}

#[test]
fn a_profile_hangs_down_the_nodes_axis() {
    // Nadir 1; the plane at horizontal angle 0 bright, at 90 half, at 180 and 270 dim.
    let file = ies(
        &[0.0, 90.0],
        &[0.0, 90.0, 180.0, 270.0, 360.0],
        |v, h| match (v, h) {
            (0.0, _) => 8.0,
            (_, 90.0) => 4.0,
            (_, 180.0) => 2.0,
            (_, 270.0) => 1.0,
            _ => 6.0,
        },
    );
    let s = std::f32::consts::FRAC_1_SQRT_2;
    // The node's axes in the world: identity, rotated by 90° about X (−Z to +Y, Y to Z), scaled and
    // mirrored in X.
    let cases = [
        (json!({}), [Vec3::X, Vec3::Y, Vec3::Z]),
        (
            json!({"rotation": [s, 0, 0, s]}),
            [Vec3::X, Vec3::Z, Vec3::NEG_Y],
        ),
        (
            json!({"scale": [-2, 3, 5]}),
            [Vec3::NEG_X, Vec3::Y, Vec3::Z],
        ),
    ];
    for (node, [x, y, z]) in cases {
        let loaded = document(file.as_bytes(), node.clone()).load().unwrap();
        let light = &loaded.scene.lights[0];
        let got = |d: Vec3| loaded.scene.profile_factor(light, d) * light.intensity.x;
        for (d, expected) in [
            (-z, 16.0),
            (x, 12.0),
            (y, 8.0),
            (-x, 4.0),
            (-y, 2.0),
            (z, 0.0),
        ] {
            // 1e-6 of a right angle, in f32.
            assert!((got(d) - expected).abs() < 1e-3, "{node} {d}: {}", got(d));
        }
    }
}

#[test]
fn a_light_without_profile_shines_all_around() {
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([{"type": "point"}]);
    doc.root(json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
    let loaded = doc.load().unwrap();
    let light = &loaded.scene.lights[0];
    assert_eq!(loaded.scene.profile_factor(light, Vec3::ONE), 1.0);
}

#[test]
fn fluxes_have_their_closed_forms() {
    // A sphere and a hemisphere: the formula is exact, the angles are rounded to f32.
    let uniform = read(&ies(&[0.0, 180.0], &[0.0], |_, _| 7.0));
    assert_eq!(uniform.scene.lights[0].intensity, Vec3::splat(14.0));
    assert!((uniform.scene.profiles[0].flux() - 4.0 * PI).abs() < 1e-5);
    let half = read(&ies(&[0.0, 90.0], &steps(0.0, 360.0, 16), |_, _| 7.0));
    assert!((half.scene.profiles[0].flux() - TAU).abs() < 1e-5);
    // I = cos θ gives π. Linear interpolation of a cosine with step h underestimates it by h²/12.
    for n in [18, 90] {
        let lobe = ies(&steps(0.0, 90.0, n), &[0.0], |v, _| v.to_radians().cos());
        let h = PI / 2.0 / n as f64;
        let error = read(&lobe).scene.profiles[0].flux() / PI - 1.0;
        assert!(
            (error + h * h / 12.0).abs() < 0.05 * h * h / 12.0 + 1e-6,
            "{n}: {error}"
        );
    }
    // (1 + cos φ) cos θ: the same, because the cosine of the horizontal angle has mean 0. Its
    // largest value is 2.
    let turning = ies(&steps(0.0, 90.0, 90), &steps(0.0, 360.0, 36), |v, h| {
        (1.0 + h.to_radians().cos()) * v.to_radians().cos().max(0.0)
    });
    assert!((read(&turning).scene.profiles[0].flux() * 2.0 / PI - 1.0).abs() < 1e-4);
    // The same by brute force over `value`: midpoints of a grid that is not a multiple of the
    // file's.
    let loaded = read(&ies(&steps(0.0, 120.0, 8), &steps(0.0, 90.0, 3), |v, h| {
        v * v + 3.0 * h
    }));
    let profile = &loaded.scene.profiles[0];
    let (nt, np) = (1000, 700);
    let mut sum = 0.0;
    for i in 0..nt {
        let t = (i as f64 + 0.5) / nt as f64 * PI;
        for j in 0..np {
            let p = (j as f64 + 0.5) / np as f64 * TAU;
            let d = DVec3::new(t.sin() * p.cos(), -t.cos(), -t.sin() * p.sin());
            sum += f64::from(profile.value(d.as_vec3())) * t.sin();
        }
    }
    let brute = sum * PI / nt as f64 * TAU / np as f64;
    // The rim at 120° falls within one row of the grid, so up to half a row's light is gained or
    // lost, 1e-3.
    assert!(
        (profile.flux() / brute - 1.0).abs() < 2e-3,
        "{} {brute}",
        profile.flux()
    );
}

#[test]
fn symmetric_files_equal_their_unfolded_ones() {
    // Symmetric about both axes; about the 0–180 axis; about the 90–270 axis.
    let both = |_: f64, h: f64| 2.0 + (2.0 * h.to_radians()).cos();
    let along = |_: f64, h: f64| 2.0 + h.to_radians().cos();
    let across = |_: f64, h: f64| 2.0 + h.to_radians().sin();
    let vertical = [0.0, 30.0, 90.0];
    let scaled = |f: fn(f64, f64) -> f64| move |v: f64, h: f64| f(v, h) * (1.0 + v);
    let full = steps(0.0, 360.0, 24);
    for (what, part, value) in [
        (
            "quadrant",
            steps(0.0, 90.0, 6),
            scaled(both as fn(f64, f64) -> f64),
        ),
        ("half", steps(0.0, 180.0, 12), scaled(along)),
        ("half of 1995", steps(90.0, 270.0, 12), scaled(across)),
        (
            "all but the last plane",
            steps(0.0, 345.0, 23),
            scaled(along),
        ),
    ] {
        let short = read(&ies(&vertical, &part, value));
        let long = read(&ies(&vertical, &full, value));
        let (short, long) = (&short.scene.profiles[0], &long.scene.profiles[0]);
        assert_eq!(short.horizontal, long.horizontal, "{what}");
        // Cosines of mirrored angles differ in the last digit.
        for (a, b) in short.values.iter().zip(&long.values) {
            assert!((a - b).abs() < 1e-6, "{what}: {a} {b}");
        }
    }
    let round = read(&ies(&vertical, &[0.0], |v, _| 1.0 + v));
    assert_eq!(round.scene.profiles[0].horizontal, [0.0, 360.0]);
}

#[test]
fn editions_and_layouts_of_files_are_understood() {
    let numbers = "\n 1, 1000\n2 2 1 1 1 0 0 0 0.5 0.5 9 0 180\r\n0\n 10\n10 ";
    let read = |head: &str| read(&format!("{head}{numbers}"));
    // 1986 has no identification line, 1991 has another one; both multiply by the ballast-lamp
    // factor. A lone CR ends lines too.
    for (head, expected) in [
        ("A lamp\nmade by hand\nTILT=NONE", 5.0),
        ("IESNA91\n[TEST] 1\nTILT=NONE", 5.0),
        ("IESNA:LM-63-1995\r\n[TEST] 1\r\nTILT=NONE\r", 10.0),
        ("IESNA:LM-63-1995\r[TEST] 1\rTILT=NONE\r", 10.0),
        ("IES:LM-63-2019\n  tilt=none  ", 10.0),
    ] {
        let loaded = read(head);
        assert_eq!(loaded.scene.lights[0].intensity.x, expected, "{head:?}");
        assert!(
            loaded.report.warnings.is_empty(),
            "{:?}",
            loaded.report.warnings
        );
    }
    // Tilt is ignored with a remark.
    for head in ["TILT=INCLUDE\n1\n3\n0 90 180\n1 0.9 1", "TILT=lamp.tlt"] {
        let loaded = read(&format!("IESNA:LM-63-2002\n{head}"));
        assert_eq!(loaded.scene.lights[0].intensity.x, 10.0);
        let message = &loaded.report.warnings[0].message;
        assert!(message.contains("TILT"), "{message}");
    }
}

#[test]
fn one_file_is_read_once_and_listed() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("a lamp.ies"),
        ies(&[0.0, 90.0], &[0.0], |_, _| 5.0),
    )
    .unwrap();
    let mut doc = Doc::with_triangles(&UNIT);
    doc.json["extensions"]["EXT_lights_ies"]["lights"] =
        json!([{"uri": "a%20lamp.ies", "name": "lamp"}]);
    doc.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([
        {"type": "spot", "intensity": 7, "extras": {"lumel": {"ies": "a%20lamp.ies", "radius": 0.1}}}
    ]);
    for _ in 0..2 {
        doc.root(json!({
            "extensions": {"EXT_lights_ies": {"light": 0}},
            "extras": {"lumel": {"radius": 0.5}},
        }));
    }
    doc.root(json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
    let file = folder.path().join("scene.glb");
    std::fs::write(&file, doc.glb()).unwrap();
    let loaded = load(&file, &LoadOptions::default()).unwrap();
    assert_eq!(loaded.scene.profiles.len(), 1);
    let lights: Vec<_> = loaded
        .scene
        .lights
        .iter()
        .map(|l| (l.name.as_str(), l.intensity.x, l.profile.unwrap().profile))
        .collect();
    assert_eq!(lights, [("", 7.0, 0), ("lamp", 10.0, 0), ("lamp", 10.0, 0)]);
    assert!(matches!(
        loaded.scene.lights[1].kind,
        LightKind::Point { radius: 0.5, .. }
    ));
    assert_eq!(loaded.document.inputs().len(), 2);
    assert_eq!(loaded.report.files, ["a%20lamp.ies"]);
    // Without the file there is nothing to bake.
    std::fs::remove_file(folder.path().join("a lamp.ies")).unwrap();
    let error = load(&file, &LoadOptions::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
}

#[test]
fn broken_files_are_told_what_is_wrong() {
    let path = "extensions.EXT_lights_ies.lights[0].bufferView";
    let good = "TILT=NONE\n1 -1 1 2 2 1 1 0 0 0 1 1 9\n0 90\n0 90\n1 2 3 4";
    assert!(document(good.as_bytes(), json!({})).load().is_ok());
    for (from, to, words) in [
        ("TILT=NONE", "", "TILT="),
        ("3 4", "3", "the end of the file"),
        ("3 4", "3 x", "\"x\" instead of an intensity"),
        ("3 4", "3 inf", "\"inf\""),
        ("0 90\n0 90", "90 0\n0 90", "vertical angle of 0"),
        ("0 90\n0 90", "0 190\n0 90", "vertical angle of 190"),
        ("0 90\n0 90", "0 90\n0 70", "from 0 to 70"),
        ("0 90\n0 90", "0 90\n0 200", "from 0 to 200"),
        ("1 2 2 1", "1 1 2 1", "number of vertical angles 1"),
        ("1 2 2 1", "1 2.5 2 1", "number of vertical angles 2.5"),
        ("1 2 2 1", "1 2 4000000000 1", "number of horizontal angles"),
        ("1 2 2 1", "1 20 20 1", "20 × 20 angles"),
        ("1 2 2 1", "-1 2 2 1", "candela multiplier -1"),
        ("1 2 2 1", "1e39 2 2 1", "candela"),
        ("1 1 9", "-1 1 9", "ballast factor -1"),
        ("1 1 9", "1 -1 9", "ballast-lamp"),
    ] {
        let file = good.replace(from, to);
        assert_ne!(file, good);
        let error = document(file.as_bytes(), json!({})).load().unwrap_err();
        let [problem] = error.problems() else {
            panic!("{error}")
        };
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        assert_eq!(problem.path, path);
        assert!(
            problem.found.contains(words) || problem.expected.contains(words),
            "{error}"
        );
    }
    for (kind, words) in [("2", "type B"), ("3", "type A"), ("7", "type 7")] {
        let file = good.replace("2 2 1 1", &format!("2 2 {kind} 1"));
        let error = document(file.as_bytes(), json!({})).load().unwrap_err();
        assert_eq!(error.exit_code(), 4);
        assert!(error.to_string().contains(words), "{error}");
    }
    let error = document(&vec![b' '; 2 << 20], json!({}))
        .load()
        .unwrap_err();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    let mut doc = document(good.as_bytes(), json!({}));
    doc.json["extensions"]["EXT_lights_ies"]["lights"][0] = json!({});
    assert_eq!(paths(doc.load()), ["extensions.EXT_lights_ies.lights[0]"]);
    doc.json["extensions"]["EXT_lights_ies"]["lights"] = json!([]);
    assert_eq!(
        paths(doc.load()),
        ["nodes[1].extensions.EXT_lights_ies.light"]
    );
}

#[test]
fn repairs_are_said() {
    let loaded = read(&ies(&[0.0, 90.0], &[0.0], |v, _| 1.0 - v));
    let message = &loaded.report.warnings[0].message;
    assert!(message.contains("1 negative"), "{message}");
    assert_eq!(candela(&loaded, 90.0, 0.0), 0.0);
    let dark = read(&ies(&[0.0, 90.0], &[0.0], |_, _| 0.0));
    assert_eq!(dark.scene.lights[0].intensity, Vec3::ZERO);
    assert_eq!(dark.scene.profiles[0].flux(), 0.0);
}
