//! Bevy: pictures by the program that tools/engines/bevy builds (`LUMEL_BEVY`).

use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

use image::RgbImage;
use serde_json::{Value, json};

use super::balls::{
    BALL, BALL_CAMERA, MIRROR, NORMALS, assert_mirror, cornell_with_capture, cornell_with_probes,
    mirror_camera, probe_diffuse,
};
use super::{STEM, VIEWS, assert_pixel, bake_scene, scene_with_sun, squares, srgb};
use crate::common::quads::points;

const SIZE: [f64; 2] = [640.0, 480.0];

/// The program; prints a message if there is none.
fn program(test: &str) -> Option<OsString> {
    let program = std::env::var_os("LUMEL_BEVY");
    if program.is_none() {
        eprintln!(
            "SKIPPED {test}: LUMEL_BEVY does not name the program that tools/engines/bevy builds (docs/engines/bevy.md)"
        );
    }
    program
}

/// A picture of a bake at exposure 1.
fn picture(program: &OsString, glb: &Path, cam: &str, more: &[&str]) -> RgbImage {
    tried_picture(program, glb, cam, more).expect("a device that can show it")
}

/// As [`picture`]; `None` where the device cannot show reflection captures.
fn tried_picture(program: &OsString, glb: &Path, cam: &str, more: &[&str]) -> Option<RgbImage> {
    let picture = glb.with_extension("bevy.png");
    let run = Command::new(program)
        .arg(glb)
        .arg(&picture)
        .args(["--size", "640,480", "--exposure", "1", "--cam", cam])
        .args(more)
        .output()
        .expect("LUMEL_BEVY starts");
    let said = String::from_utf8_lossy(&run.stderr);
    if run.status.code() == Some(3) {
        eprintln!("{said}");
        return None;
    }
    assert!(run.status.success(), "{more:?}: {said}");
    Some(image::open(&picture).expect("a picture").to_rgb8())
}

/// The pixel at a point.
pub(super) fn pixel(picture: &RgbImage, cam: &str, at: [f64; 3]) -> [u8; 3] {
    let [x, y] = project(cam, at, SIZE);
    picture.get_pixel(x as u32, y as u32).0
}

/// Projects a point into a picture of `size` from `cam`, with the camera of tools/engines/bevy.
fn project(cam: &str, at: [f64; 3], size: [f64; 2]) -> [f64; 2] {
    let c: Vec<f64> = cam
        .split(',')
        .map(|x| x.parse().expect("a number"))
        .collect();
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let unit = |a: [f64; 3]| a.map(|x| x / dot(a, a).sqrt());
    let from = [c[0], c[1], c[2]];
    let ahead = unit(minus([c[3], c[4], c[5]], from));
    let right = unit(cross(ahead, [0.0, 1.0, 0.0]));
    let up = cross(right, ahead);
    let d = minus(at, from);
    let scale = 0.5 * size[1] / (0.5 * c[6].to_radians()).tan() / dot(d, ahead);
    [
        0.5 * size[0] + dot(d, right) * scale,
        0.5 * size[1] - dot(d, up) * scale,
    ]
}

#[test]
fn bevy_shows_closed_form_pixels() {
    let Some(program) = program("Bevy") else {
        return;
    };
    for (options, flags, share) in [
        ("", &[][..], 0.0),
        ("--ktx2 rgb9e5", &["--ktx2"], 1.0 / 512.0),
        ("--ktx2 bc6h --block-charts", &["--ktx2"], 1.0 / 512.0),
    ] {
        let (_t, out) = squares(options);
        for (cam, range) in VIEWS {
            let picture = picture(&program, &out.join(format!("{STEM}.glb")), cam, flags);
            for (at, albedo, r) in points().into_iter().take(range.end).skip(range.start) {
                let found = pixel(&picture, cam, at);
                let what = format!("Bevy {options} {at:?}");
                assert_pixel(found, albedo.map(|a| a * r), &srgb(share), &what);
            }
        }
    }
}

/// Without gloss, which Bevy adds to the light of its lamps.
fn matt(scene: &mut Value) {
    for material in scene["materials"].as_array_mut().expect("materials") {
        material["extensions"] = json!({"KHR_materials_specular": {"specularFactor": 0.0}});
    }
    let used = scene["extensionsUsed"].as_array_mut().expect("a list");
    used.push(json!("KHR_materials_specular"));
}

#[test]
fn bevy_adds_mixed_lamps_through_shadow_masks() {
    let Some(program) = program("Bevy with shadow masks") else {
        return;
    };
    for (options, flags) in [("", &[][..]), ("--ktx2 rgb9e5", &["--ktx2"])] {
        for glossy in [false, true] {
            let mut scene = scene_with_sun();
            if !glossy {
                matt(&mut scene);
            }
            let (_t, out) = bake_scene(&scene, &format!("--mode shadowmask {options}"));
            for (cam, range) in VIEWS {
                let picture = picture(&program, &out.join(format!("{STEM}.glb")), cam, flags);
                for (at, albedo, r) in points().into_iter().take(range.end).skip(range.start) {
                    // Gloss is masked too: in the shadow there is none.
                    if glossy && r > 0.0 {
                        continue;
                    }
                    let found = pixel(&picture, cam, at);
                    let what = format!("Bevy {options} glossy {glossy} {at:?}");
                    // As in three.js.
                    assert_pixel(found, albedo.map(|a| a * r), &srgb(1.0 / 128.0), &what);
                }
            }
        }
    }
}

/// A mixed point lamp and a mixed spot show the full bake, shadows and falloff included, although
/// Bevy ends lamps without a range at 20 m.
#[test]
fn bevy_shows_the_full_bake_with_mixed_lamps() {
    let Some(program) = program("Bevy with mixed lamps") else {
        return;
    };
    let mut scene = scene_with_sun();
    matt(&mut scene);
    let nodes = scene["nodes"].as_array_mut().expect("nodes");
    nodes[4]["translation"] = json!([0.2, 16.0, 0.3]);
    nodes.push(json!({
        "name": "point", "translation": [-3.0, 1.5, 1.0],
        "extensions": {"KHR_lights_punctual": {"light": 1}},
        "extras": {"lumel": {"mode": "mixed"}},
    }));
    scene["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4, 5]);
    scene["extensions"]["KHR_lights_punctual"]["lights"] = json!([
        {"type": "spot", "intensity": 256.0, "color": [1.0, 0.8, 0.6],
         "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}},
        {"type": "point", "intensity": 3.0},
    ]);
    for (cam, _) in VIEWS {
        let of = |mode: &str| {
            let (_t, out) = bake_scene(&scene, mode);
            picture(&program, &out.join(format!("{STEM}.glb")), cam, &[])
        };
        let (full, mixed) = (of(""), of("--mode shadowmask"));
        let mut steps: Vec<u8> = (full.as_raw().iter().zip(mixed.as_raw()))
            .map(|(a, b)| a.abs_diff(*b))
            .collect();
        steps.sort_unstable();
        let lit = full.as_raw().iter().filter(|v| **v > 100).count();
        assert!(lit > 5_000, "{cam}: {lit} channels are lit");
        // The exceptions lie on the borders of shadows and of the squares.
        let at = |share: f64| steps[(share * (steps.len() - 1) as f64) as usize];
        assert!(at(0.99) <= 2, "{cam}: {} {}", at(0.99), at(1.0));
    }
}

/// As in three.js; Bevy's irradiance volume is an ambient cube: the light of six directions,
/// weighted by the squares of the normal.
#[test]
fn bevy_lights_moving_objects_by_the_volume() {
    let Some(program) = program("Bevy with probes") else {
        return;
    };
    let (_t, out, grid) = cornell_with_probes("--probe-volume");
    let ([x, y, z], radius) = BALL;
    let ball = format!("{x},{y},{z},{radius}");
    let glb = out.join("cornell_box.glb");
    let picture = picture(&program, &glb, BALL_CAMERA, &["--ball", &ball]);
    for n in NORMALS {
        let on: [f64; 3] = std::array::from_fn(|i| BALL.0[i] + radius * n[i]);
        let sh = grid.around(on);
        let mut light = [0.0; 3];
        for axis in 0..3 {
            let mut side = [0.0; 3];
            side[axis] = n[axis].signum();
            let seen = probe_diffuse(&sh, side);
            light = std::array::from_fn(|c| light[c] + n[axis] * n[axis] * seen[c]);
        }
        // A pixel's normal is up to 1 degree from n.
        let found = pixel(&picture, BALL_CAMERA, on);
        assert_pixel(found, light, &srgb(0.02), &format!("Bevy {n:?}"));
    }
}

/// The light probes that the plug-in makes of captures, and what Bevy reflects of them.
#[test]
fn bevy_shows_reflection_captures() {
    let Some(program) = program("Bevy with reflections") else {
        return;
    };
    let (_t, out, cube) = cornell_with_capture();
    let ([x, y, z], radius) = MIRROR;
    let ball = format!("{x},{y},{z},{radius}");
    let cam = mirror_camera();
    let glb = out.join("box.glb");
    let Some(picture) = tried_picture(&program, &glb, &cam, &["--mirror", &ball]) else {
        eprintln!(
            "SKIPPED Bevy with reflections: needs a Vulkan driver with arrays of textures, such as \
             lavapipe of Mesa 26 (tools/engines/bevy/README.md)"
        );
        return;
    };
    assert_mirror(&cube, |on| pixel(&picture, &cam, on));
}
