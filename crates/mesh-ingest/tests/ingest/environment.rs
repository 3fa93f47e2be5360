//! `EXT_lights_image_based`: orientation of faces, their amount of light, and fallbacks.

use std::f64::consts::{PI, TAU};
use std::io::Cursor;

use glam::{DQuat, DVec3, Vec3};
use image::{ImageFormat, Rgba, RgbaImage};
use mesh_ingest::{Environment, Error, Limits, LoadOptions, Loaded, load};
use serde_json::{Value, json};

use super::build::{Doc, UNIT, load_bytes, paths};

const NAME: &str = "EXT_lights_image_based";

fn png(image: &RgbaImage) -> Vec<u8> {
    let mut png = Cursor::new(Vec::new());
    image.write_to(&mut png, ImageFormat::Png).unwrap();
    png.into_inner()
}

/// A document with these faces, and further members of the light.
fn document(faces: &[RgbaImage; 6], light: Value) -> Doc {
    let mut doc = Doc::with_triangles(&UNIT);
    let mut light = light;
    let indices: Vec<usize> = faces
        .iter()
        .map(|face| {
            let view = doc.view(&png(face));
            doc.push(
                "images",
                json!({"bufferView": view, "mimeType": "image/png"}),
            )
        })
        .collect();
    light["specularImages"] = json!([indices]);
    light["specularImageSize"] = json!(faces[0].width());
    doc.json["extensions"][NAME]["lights"] = json!([light]);
    doc.json["scenes"][0]["extensions"][NAME] = json!({"light": 0});
    doc
}

fn sky(loaded: Loaded) -> Environment {
    loaded.scene.environment.expect("an environment")
}

fn black(size: u32) -> [RgbaImage; 6] {
    std::array::from_fn(|_| RgbaImage::from_pixel(size, size, Rgba([0, 0, 0, 255])))
}

/// The direction of the centre of pixel (i, j) in an `Environment`, and its solid angle.
fn pixel(sky: &Environment, i: u32, j: u32) -> (DVec3, f64) {
    let a = TAU * ((f64::from(i) + 0.5) / f64::from(sky.width) - 0.5);
    let t = |j: f64| PI * j / f64::from(sky.height);
    let (sin, cos) = t(f64::from(j) + 0.5).sin_cos();
    let solid_angle =
        TAU / f64::from(sky.width) * (t(f64::from(j)).cos() - t(f64::from(j) + 1.0).cos());
    (DVec3::new(sin * a.cos(), cos, sin * a.sin()), solid_angle)
}

/// ∫ f(direction) L dω.
fn integral(sky: &Environment, f: impl Fn(DVec3) -> f64) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for j in 0..sky.height {
        for i in 0..sky.width {
            let (d, w) = pixel(sky, i, j);
            sum += sky.pixels[(j * sky.width + i) as usize].as_dvec3() * (f(d) * w);
        }
    }
    sum
}

/// The mean direction of the map's light.
fn aim(sky: &Environment) -> DVec3 {
    let axis = |axis: DVec3| integral(sky, |d| d.dot(axis)).x;
    DVec3::new(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z)).normalize()
}

/// The direction of image position (x, y) in 0..1 for a camera at the centre with the given forward
/// and up vectors.
fn seen(forward: DVec3, up: DVec3, x: f64, y: f64) -> DVec3 {
    let right = forward.cross(up);
    (forward + right * (2.0 * x - 1.0) + up * (1.0 - 2.0 * y)).normalize()
}

/// Forward and up of the faces, in the extension's order: upright around the horizon; above and
/// below as seen by a viewer who looks along −Z and tilts the head (OpenGL's faces, flipped
/// horizontally).
const CAMERAS: [(DVec3, DVec3); 6] = [
    (DVec3::X, DVec3::Y),
    (DVec3::NEG_X, DVec3::Y),
    (DVec3::Y, DVec3::NEG_Z),
    (DVec3::NEG_Y, DVec3::Z),
    (DVec3::Z, DVec3::Y),
    (DVec3::NEG_Z, DVec3::Y),
];

#[test]
fn a_lit_texel_of_each_face_lands_where_it_should() {
    // Off centre in both axes, so that mirrored and rotated faces are distinguished.
    let (size, x, y) = (16, 3, 10);
    for (face, (forward, up)) in CAMERAS.into_iter().enumerate() {
        let mut faces = black(size);
        faces[face].put_pixel(x, y, Rgba([255; 4]));
        let sky = sky(document(&faces, json!({})).load().unwrap());
        let at = |k: u32| (f64::from(k) + 0.5) / f64::from(size);
        let expected = seen(forward, up, at(x), at(y));
        // The texel is 0.1 wide, and its centroid is within a hundredth of that from its centre.
        assert!(
            aim(&sky).dot(expected) > 1.0 - 1e-5,
            "face {face}: {} {expected}",
            aim(&sky)
        );
        // Its light is proportional to its solid angle, which is distributed exactly among pixels.
        // 1e-3 for the midpoint rule over the texel and pixels bounded by great circles.
        let ux = 2.0 * at(x) - 1.0;
        let uy = 2.0 * at(y) - 1.0;
        let solid_angle = (2.0 / f64::from(size)).powi(2) * (1.0 + ux * ux + uy * uy).powf(-1.5);
        let light = integral(&sky, |_| 1.0).x;
        assert!(
            (light / solid_angle - 1.0).abs() < 2e-3,
            "face {face}: {light} {solid_angle}"
        );
    }
}

#[test]
fn rotation_turns_the_sky_and_intensity_scales_it() {
    // Light around +X, rotated by 90° about Y: +X goes to −Z.
    let mut faces = black(8);
    for (x, y) in [(3, 3), (4, 3), (3, 4), (4, 4)] {
        faces[0].put_pixel(x, y, Rgba([255; 4]));
    }
    let q = DQuat::from_rotation_y(PI / 2.0);
    let light = json!({"rotation": q.to_array(), "intensity": 3.0, "name": "dusk"});
    let turned = sky(document(&faces, light).load().unwrap());
    assert_eq!(turned.name, "dusk");
    assert!(
        aim(&turned).distance(DVec3::NEG_Z) < 1e-6,
        "{}",
        aim(&turned)
    );
    let plain = sky(document(&faces, json!({})).load().unwrap());
    let ratio = integral(&turned, |_| 1.0).x / integral(&plain, |_| 1.0).x;
    // Both distribute the same texels exactly; only the outlines of pixels differ, by a few 1e-4.
    assert!((ratio - 3.0).abs() < 3e-3, "{ratio}");
    // A rotation about an axis without symmetry.
    let q = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -3.0).normalize(), 1.1);
    let tilted = sky(document(&faces, json!({"rotation": q.to_array()}))
        .load()
        .unwrap());
    assert!(
        aim(&tilted).distance(q * DVec3::X) < 1e-5,
        "{}",
        aim(&tilted)
    );
}

#[test]
fn light_is_kept_and_a_constant_stays_constant() {
    // sRGB 188 is 0.5029 (IEC 61966-2-1); divided by alpha 51/255 it is five times that.
    let grey = |alpha| -> [RgbaImage; 6] {
        std::array::from_fn(|_| RgbaImage::from_pixel(32, 32, Rgba([188, 0, 255, alpha])))
    };
    for (alpha, factor) in [(255, 1.0), (51, 5.0)] {
        let sky = sky(document(&grey(alpha), json!({})).load().unwrap());
        assert_eq!((sky.width, sky.height), (256, 128));
        for p in &sky.pixels {
            let expected = Vec3::new(0.502886, 0.0, 1.0) * factor;
            assert!(p.distance(expected) < 1e-5 * factor, "{p}");
        }
    }
    // Noise: the integral is compared with that over the cube's own texels with exact solid angles.
    let size = 64;
    let mut state = 1u32;
    let faces: [RgbaImage; 6] = std::array::from_fn(|_| {
        RgbaImage::from_fn(size, size, |_, _| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            let value = (state >> 24) as u8;
            Rgba([value, 255 - value, u8::from(value > 250) * 255, 255])
        })
    });
    // Solid angle of the corner rectangle from the centre to (x, y).
    let corner = |x: f64, y: f64| (x * y).atan2((1.0 + x * x + y * y).sqrt());
    let line = |k: u32| 2.0 * f64::from(k) / f64::from(size) - 1.0;
    let linear = |c: u8| {
        let s = f64::from(c) / 255.0;
        if s <= 0.04045 {
            s / 12.92
        } else {
            ((s + 0.055) / 1.055).powf(2.4)
        }
    };
    let mut expected = DVec3::ZERO;
    for face in &faces {
        for (x, y, p) in face.enumerate_pixels() {
            let [x0, x1, y0, y1] = [line(x), line(x + 1), line(y), line(y + 1)];
            let w = corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0);
            expected += DVec3::new(linear(p[0]), linear(p[1]), linear(p[2])) * w;
        }
    }
    let sky = sky(document(&faces, json!({})).load().unwrap());
    let got = integral(&sky, |_| 1.0);
    // The requirement is 1 %; the distribution of texels is exact except for the pixels' outlines.
    assert!(
        ((got / expected) - 1.0).abs().max_element() < 1e-4,
        "{got} {expected}"
    );
}

/// Coefficients by row, E_lm in the order of the extension.
fn coefficients(rows: [[f64; 3]; 9]) -> Value {
    json!(rows)
}

/// E(n) of the coefficients, by Ramamoorthi and Hanrahan's equations 3 and 4.
fn irradiance(rows: &[[f64; 3]; 9], n: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = n;
    let y = [
        0.282095,
        0.488603 * y,
        0.488603 * z,
        0.488603 * x,
        1.092548 * x * y,
        1.092548 * y * z,
        0.315392 * (3.0 * z * z - 1.0),
        1.092548 * x * z,
        0.546274 * (x * x - y * y),
    ];
    rows.iter()
        .zip(y)
        .map(|(&e, y)| DVec3::from_array(e) * y)
        .sum()
}

const SOFT_SKY: [[f64; 3]; 9] = [
    [8.0, 8.0, 9.0],
    [0.6, 0.8, 1.5],
    [0.3, 0.1, 0.0],
    [-0.4, 0.2, 0.1],
    [0.1, 0.05, 0.0],
    [0.05, -0.1, 0.1],
    [-0.1, 0.1, 0.05],
    [0.08, 0.0, -0.1],
    [0.1, 0.1, 0.1],
];

#[test]
fn irradiance_stands_in_for_missing_faces() {
    let mut doc = document(
        &black(2),
        json!({"irradianceCoefficients": coefficients(SOFT_SKY)}),
    );
    doc.json["images"][3] = json!({"uri": "missing.png"});
    let loaded = doc.load().unwrap();
    assert_eq!(loaded.report.counts["environment.from_irradiance"], 1);
    assert!(!loaded.report.counts.contains_key("environment.clamped"));
    let path = format!("extensions.{NAME}.lights[0]");
    assert!(loaded.report.warnings.iter().any(|w| w.path == path));
    let plain = sky(loaded);
    let q = DQuat::from_axis_angle(DVec3::new(2.0, -1.0, 1.0).normalize(), 2.0);
    doc.json["extensions"][NAME]["lights"][0]["rotation"] = json!(q.to_array());
    let turned = sky(doc.load().unwrap());
    for n in [
        DVec3::X,
        DVec3::NEG_Y,
        DVec3::new(1.0, 2.0, 3.0).normalize(),
        DVec3::NEG_Z,
    ] {
        let expected = irradiance(&SOFT_SKY, n);
        let got = integral(&plain, |d| d.dot(n).max(0.0));
        // The paper's constants have six digits, and the clamped cosine's kink costs about 1e-4 for
        // a row of 64.
        assert!(
            ((got / expected) - 1.0).abs().max_element() < 1e-3,
            "{n}: {got} {expected}"
        );
        let got = integral(&turned, |d| d.dot(q * n).max(0.0));
        assert!(
            ((got / expected) - 1.0).abs().max_element() < 1e-3,
            "{n}: {got} {expected}"
        );
    }
}

#[test]
fn negative_radiance_is_clamped_and_said() {
    let mut rows = SOFT_SKY;
    rows[1] = [4.0, 4.0, 4.0];
    let mut doc = document(
        &black(2),
        json!({"irradianceCoefficients": coefficients(rows)}),
    );
    doc.json["extensions"][NAME]["lights"][0]
        .as_object_mut()
        .unwrap()
        .remove("specularImages");
    let loaded = doc.load().unwrap();
    assert!(loaded.report.counts["environment.clamped"] > 0);
    assert!(sky(loaded).pixels.iter().all(|p| p.min_element() >= 0.0));
}

#[test]
fn what_is_no_sky_is_named() {
    // Faces of different sizes, and neither faces nor coefficients: dropped with the reason.
    let mut faces = black(4);
    faces[5] = RgbaImage::new(4, 2);
    let loaded = document(&faces, json!({})).load().unwrap();
    assert!(loaded.scene.environment.is_none());
    assert_eq!(loaded.report.counts["environment.dropped"], 1);
    assert!(loaded.report.warnings[0].message.contains("face 5"));

    let path = |member: &str| vec![format!("extensions.{NAME}.lights[0]{member}")];
    for (member, value) in [
        ("specularImages", json!([[0, 1, 2, 3, 4]])),
        ("specularImages", json!([[0, 1, 2, 3, 4, 6]])),
        ("specularImages", json!([vec!["0"; 6]])),
        ("specularImages", json!("none")),
        ("irradianceCoefficients", json!([[1, 2, 3]])),
        ("irradianceCoefficients", json!(vec![json!(["1", 2, 3]); 9])),
        ("intensity", json!("bright")),
        ("rotation", json!([0, 0, 1])),
    ] {
        let mut doc = document(&black(1), json!({}));
        doc.json["extensions"][NAME]["lights"][0][member] = value.clone();
        assert_eq!(paths(doc.load()), path(&format!(".{member}")), "{value}");
    }
    let mut doc = document(
        &black(1),
        json!({"rotation": [0, 0, 0, 0], "intensity": -1}),
    );
    let loaded = doc.load().unwrap();
    assert_eq!(loaded.report.warnings.len(), 2);
    doc.json["scenes"][0]["extensions"][NAME]["light"] = json!(1);
    assert_eq!(
        paths(doc.load()),
        [format!("scenes[0].extensions.{NAME}.light")]
    );
}

#[test]
fn only_the_chosen_scenes_sky_is_read_and_required_is_no_obstacle() {
    let mut doc = document(&black(1), json!({}));
    doc.json["extensionsRequired"] = json!([NAME]);
    doc.json["extensionsUsed"] = json!([NAME]);
    let roots = doc.json["scenes"][0]["nodes"].clone();
    doc.push("scenes", json!({"nodes": roots}));
    let second = LoadOptions {
        scene: Some(1),
        ..LoadOptions::default()
    };
    assert!(
        load_bytes(&doc.glb(), &second)
            .unwrap()
            .scene
            .environment
            .is_none()
    );
    let loaded = doc.load().unwrap();
    assert!(
        loaded.report.warnings.is_empty(),
        "{:?}",
        loaded.report.warnings
    );
    // Its images are not kept, because no surface shows them.
    assert!(loaded.scene.images.iter().all(Option::is_none));
    assert!(loaded.scene.environment.is_some());
}

#[test]
fn the_pixel_limit_counts_a_skys_faces() {
    let doc = document(
        &black(8),
        json!({"irradianceCoefficients": coefficients(SOFT_SKY)}),
    );
    let with = |pixels: u64| LoadOptions {
        limits: Limits {
            image_bytes: 4 * pixels,
            ..Limits::default()
        },
        ..LoadOptions::default()
    };
    assert!(load_bytes(&doc.glb(), &with(6 * 64)).is_ok());
    let error = load_bytes(&doc.glb(), &with(6 * 64 - 1)).unwrap_err();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
}

#[test]
fn face_files_are_listed_and_one_image_may_serve_twice() {
    let folder = tempfile::tempdir().unwrap();
    let image = RgbaImage::from_pixel(2, 2, Rgba([255, 255, 255, 255]));
    std::fs::write(folder.path().join("face.png"), png(&image)).unwrap();
    let mut doc = document(&black(2), json!({}));
    doc.json["images"] = json!([{"uri": "face.png"}]);
    doc.json["extensions"][NAME]["lights"][0]["specularImages"] = json!([[0, 0, 0, 0, 0, 0]]);
    let file = folder.path().join("scene.glb");
    std::fs::write(&file, doc.glb()).unwrap();
    let loaded = load(&file, &LoadOptions::default()).unwrap();
    assert_eq!(loaded.report.files, ["face.png"]);
    assert!(
        sky(loaded)
            .pixels
            .iter()
            .all(|p| p.distance(Vec3::ONE) < 1e-6)
    );
}
