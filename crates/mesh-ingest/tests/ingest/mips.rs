//! Mean reflectance around a point, compared with exactly known averages.

use std::f32::consts::PI;

use glam::Vec3;
use image::{Rgba, RgbaImage};
use mesh_ingest::{Pyramids, Scene, Soup};
use serde_json::{Value, json};

use super::build::Doc;
use super::materials::textured;

/// 16-bit storage of a level's colour and presence: three roundings (colour, presence, sum) of half
/// a step each.
const STORED: f32 = 1.5 / 65535.0 + 1e-6;

struct Baked {
    scene: Scene,
    soup: Soup,
    pyramids: Pyramids,
}

impl Baked {
    fn new(doc: &Doc) -> Baked {
        let scene = doc.load().unwrap().scene;
        Baked::of(scene)
    }

    fn of(scene: Scene) -> Baked {
        let soup = Soup::build(&scene);
        let pyramids = Pyramids::build(&scene, &soup);
        Baked {
            scene,
            soup,
            pyramids,
        }
    }

    /// On the unit quad's first triangle (0,0), (1,0), (0,1), whose barycentrics are x and y.
    fn at(&self, x: f32, y: f32, area: f32) -> Vec3 {
        self.pyramids
            .reflectance(&self.scene, &self.soup, 0, x, y, area)
    }
}

/// A quad whose base texture is `image`, with `extra` members in the material.
fn quad(image: &RgbaImage, extra: Value) -> Doc {
    let mut material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    for (key, value) in extra.as_object().into_iter().flatten() {
        material[key] = value.clone();
    }
    textured(material, Some(image))
}

fn repeated(image: &RgbaImage, times: f32, extra: Value) -> Doc {
    let mut doc = quad(image, extra);
    doc.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({"KHR_texture_transform": {"scale": [times, times]}});
    doc
}

fn checker(size: u32, a: [u8; 4], b: [u8; 4]) -> RgbaImage {
    RgbaImage::from_fn(size, size, |x, y| {
        Rgba(if (x + y) % 2 == 0 { a } else { b })
    })
}

/// sRGB byte to linear, IEC 61966-2-1.
fn linear(byte: u8) -> f32 {
    let x = f64::from(byte) / 255.0;
    (if x <= 0.04045 {
        x / 12.92
    } else {
        ((x + 0.055) / 1.055).powf(2.4)
    }) as f32
}

fn byte(linear: f32) -> u8 {
    let x = f64::from(linear);
    let s = if x <= 0.003_130_8 {
        x * 12.92
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    };
    (s * 255.0).round() as u8
}

#[test]
fn a_checkerboard_is_the_mean_of_its_decoded_colours() {
    let image = checker(64, [100, 0, 255, 255], [200, 255, 0, 255]);
    let baked = Baked::new(&quad(&image, json!({})));
    let mean = Vec3::new((linear(100) + linear(200)) * 0.5, 0.5, 0.5);
    // From 8 texels per side on, the blur is that of level 1, whose texels are all equal.
    for side in [8.0f32, 13.0, 20.0, 40.0] {
        for (x, y) in [(0.3, 0.3), (0.11, 0.52), (0.5, 0.017)] {
            let got = baked.at(x, y, (side / 64.0).powi(2));
            assert!(
                (got - mean).abs().max_element() < STORED,
                "{side} texels at {x}, {y}: {got} for {mean}"
            );
        }
    }
}

#[test]
fn what_a_mask_cuts_out_does_not_bleed_in() {
    let green = Vec3::new(0.0, linear(200), linear(90));
    let image = checker(32, [0, 200, 90, 255], [255, 0, 0, 0]);
    for extra in [
        json!({"alphaMode": "MASK", "alphaCutoff": 0.5}),
        json!({"alphaMode": "BLEND"}),
    ] {
        let baked = Baked::new(&quad(&image, extra.clone()));
        for area in [0.0, 1e-4, 0.002, 0.01, 0.1, 2.0] {
            let got = baked.at(0.31, 0.22, area);
            assert!(
                (got - green).abs().max_element() < STORED,
                "{extra}, {area} m²: {got} for {green}"
            );
        }
    }
    // Half transparent counts half: colours 1 and 0 at alphas 1 and 0.5 (128/255) average to 1 / (1
    // + 0.502).
    let image = checker(32, [255, 255, 255, 255], [0, 0, 0, 128]);
    let baked = Baked::new(&quad(&image, json!({"alphaMode": "BLEND"})));
    let mean = 1.0 / (1.0 + 128.0 / 255.0);
    assert!((baked.at(0.3, 0.3, 0.1).x - mean).abs() < STORED);
    // An absent surface reflects nothing.
    let holes = RgbaImage::from_fn(32, 32, |x, _| Rgba([255, 255, 255, 255 * u8::from(x < 2)]));
    let baked = Baked::new(&quad(&holes, json!({"alphaMode": "MASK"})));
    assert_eq!(baked.at(0.5, 0.3, 0.01), Vec3::ZERO);
}

#[test]
fn a_rare_opaque_texel_keeps_its_colour() {
    // One texel of 1024² is present. Its presence, 1e-6, is below a 16-bit step, and its colour
    // must survive.
    let image = RgbaImage::from_fn(1024, 1024, |x, y| {
        let there = (x, y) == (700, 300);
        Rgba(if there {
            [0, 128, 0, 255]
        } else {
            [255, 0, 255, 0]
        })
    });
    let baked = Baked::new(&repeated(&image, 16.0, json!({"alphaMode": "MASK"})));
    let expected = Vec3::new(0.0, linear(128), 0.0);
    let got = baked.at(0.3, 0.3, 1.0);
    assert!((got - expected).abs().max_element() < STORED, "{got}");
}

#[test]
fn gradients_keep_their_place() {
    let image = RgbaImage::from_fn(128, 128, |x, y| {
        let at = (x as f32 + 0.5) / 128.0;
        let up = (y as f32 + 0.5) / 128.0;
        Rgba([byte(at), byte(up), 0, 255])
    });
    let baked = Baked::new(&quad(&image, json!({})));
    for side in [0.02f32, 0.1, 0.25, 0.4] {
        for (x, y) in [(0.3, 0.4), (0.42, 0.3), (0.25, 0.5)] {
            // The mean of a linear ramp is its value in the middle. Bytes round by at most half a
            // step, with slope ≤ 2.3/255 at white.
            let got = baked.at(x, y, side * side);
            let tolerance = 0.5 * 2.3 / 255.0;
            assert!(
                (got.x - x).abs() < tolerance && (got.y - y).abs() < tolerance,
                "{side} at {x}, {y}: {got}"
            );
        }
    }
}

/// The filter is a square whose border is soft by an eighth of its side, so its variance is 9/8 of
/// the square's s²/12. For a function with second derivative f'' the error is s²/96 · f''/2; twice
/// that where two levels meet.
fn softness(side: f32, curvature: f32) -> f32 {
    2.0 * side * side / 96.0 * curvature / 2.0
}

#[test]
fn mirrored_and_plain_repeats_go_on_as_the_sampler_says() {
    // cos πx is smoothly continued by mirroring.
    let wave = |x: f32| 0.5 + 0.4 * (PI * x).cos();
    let image = RgbaImage::from_fn(64, 64, |x, _| {
        let b = byte(wave((x as f32 + 0.5) / 64.0));
        Rgba([b, b, b, 255])
    });
    let rounding = 0.5 * 2.3 / 255.0;
    for (mode, mirrored) in [(33648, true), (10497, false)] {
        let mut doc = repeated(&image, 3.0, json!({}));
        doc.json["samplers"][0] = json!({"wrapS": mode, "wrapT": mode});
        let baked = Baked::new(&doc);
        for (s, side) in [
            (1.0f32, 0.25f32),
            (1.0, 0.5),
            (2.0, 0.4),
            (1.5, 0.5),
            (0.7, 0.3),
        ] {
            let got = baked.at(s / 3.0, 0.2, (side / 3.0).powi(2)).x;
            let exact = if mirrored {
                0.5 + 0.4 * (PI * s).cos() * (PI * side / 2.0).sin() / (PI * side / 2.0)
            } else if s.fract() == 0.0 {
                // Half of the square is before the seam and half behind it; wave is odd about 0.5.
                0.5
            } else {
                let (f, h) = (s.fract(), side / 2.0);
                0.5 + 0.4 * ((PI * (f + h)).sin() - (PI * (f - h)).sin()) / (PI * side)
            };
            let tolerance = rounding + softness(side, 0.4 * PI * PI);
            assert!(
                (got - exact).abs() < tolerance,
                "mirrored {mirrored}, {side} at {s}: {got} for {exact} ± {tolerance}"
            );
        }
    }
}

#[test]
fn odd_sizes_keep_the_mean_of_the_whole() {
    for (w, h) in [(5, 3), (7, 1), (1, 9), (6, 10), (37, 23), (1, 1), (3, 64)] {
        let image = RgbaImage::from_fn(w, h, |x, y| {
            let n = (x * 7919 + y * 104_729 + x * y * 31) % 251;
            Rgba([n as u8, (n * 3 % 256) as u8, 255 - n as u8, 255])
        });
        let mut mean = [0.0f64; 3];
        for pixel in image.pixels() {
            for (m, &p) in mean.iter_mut().zip(&pixel.0) {
                *m += f64::from(linear(p)) / f64::from(w * h);
            }
        }
        let mean = Vec3::from_array(mean.map(|m| m as f32));
        // 22 repeats in the square: the top level everywhere.
        let baked = Baked::new(&repeated(&image, 16.0, json!({})));
        for (x, y) in [(0.3, 0.3), (0.123, 0.456)] {
            let got = baked.at(x, y, 2.0);
            assert!(
                (got - mean).abs().max_element() < STORED,
                "{w} × {h}: {got} for {mean}"
            );
        }
    }
}

#[test]
fn a_point_is_the_base_colour() {
    let image = checker(8, [30, 90, 200, 255], [250, 10, 100, 255]);
    for sampler in [json!({}), json!({"magFilter": 9728})] {
        let mut doc = quad(&image, json!({}));
        doc.json["samplers"][0] = sampler;
        let baked = Baked::new(&doc);
        for (x, y) in [(0.3, 0.3), (0.77, 0.2), (0.01, 0.98)] {
            let exact = baked.scene.base_color(&baked.soup, 0, x, y).truncate();
            let got = baked.at(x, y, 0.0);
            assert!((got - exact).abs().max_element() < 1e-5, "{got} {exact}");
        }
    }
}

#[test]
fn area_is_the_worlds() {
    let image = RgbaImage::from_fn(64, 64, |x, _| {
        let b = byte((0.5 + 0.4 * (PI * (x as f32 + 0.5) / 16.0).cos()).clamp(0.0, 1.0));
        Rgba([b, b, b, 255])
    });
    let plain = Baked::new(&quad(&image, json!({})));
    let mut doc = quad(&image, json!({}));
    doc.json["nodes"][0]["scale"] = json!([10, 10, 10]);
    let large = Baked::new(&doc);
    for side in [0.05f32, 0.1, 0.2, 0.5] {
        let (a, b) = (
            plain.at(0.25, 0.25, side * side),
            large.at(0.25, 0.25, side * side * 100.0),
        );
        // Levels differ by the rounding of f32 areas.
        assert!((a - b).abs().max_element() < 1e-4, "{side}: {a} {b}");
    }
    // Stretched 4 : 1 across the waves, a square of 0.2 m varies by a quarter of one wavelength.
    doc.json["nodes"][0]["scale"] = json!([4, 1, 1]);
    let wide = Baked::new(&doc);
    let (u, side) = (0.25f32, 0.2f32);
    let k = PI * 4.0;
    let width = side / 4.0;
    let exact = 0.5 + 0.4 * (k * u).cos() * (k * width / 2.0).sin() / (k * width / 2.0);
    let got = wide.at(u, 0.25, side * side).x;
    let tolerance = 0.5 * 2.3 / 255.0 + softness(2.0 * width, 0.4 * k * k);
    assert!((got - exact).abs() < tolerance, "{got} for {exact}");
}

#[test]
fn factors_limits_and_vertex_colours_apply() {
    let image = checker(32, [255, 255, 255, 255], [0, 0, 0, 255]);
    let mut doc = quad(&image, json!({}));
    let colors = doc.floats(&[[1.0, 0.5, 0.25]; 4]);
    doc.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    doc.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.8, 1, 1, 1]);
    let mut scene = doc.load().unwrap().scene;
    let got = Baked::of(scene.clone()).at(0.3, 0.3, 0.1);
    assert!((got - Vec3::new(0.4, 0.25, 0.125)).abs().max_element() < STORED);
    // Texels are clamped to the limit before averaging: 0.9 and 0 have the mean 0.45.
    scene.materials[0].max_reflectance = 0.9;
    scene.meshes[0].primitives[0].colors.clear();
    let got = Baked::of(scene.clone()).at(0.3, 0.3, 0.1);
    assert!((got - Vec3::new(0.4, 0.45, 0.45)).abs().max_element() < STORED);
    // Occluders reflect nothing, whether by material or by node.
    scene.instances[0].occluder = true;
    assert_eq!(Baked::of(scene.clone()).at(0.3, 0.3, 0.1), Vec3::ZERO);
    scene.instances[0].occluder = false;
    scene.materials[0].occluder_only = true;
    let baked = Baked::of(scene);
    assert_eq!(baked.at(0.3, 0.3, 0.1), Vec3::ZERO);
    assert_eq!(baked.pyramids.bytes(), 0);
}

#[test]
fn without_a_texture_the_point_counts() {
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 1]}});
    let baked = Baked::new(&textured(material, None));
    let got = baked.at(0.3, 0.3, 1.0);
    assert!((got - Vec3::new(0.2, 0.4, 0.6)).abs().max_element() < 1e-6);
    assert_eq!(baked.pyramids.bytes(), 0);
}

#[test]
fn glass_does_not_tint_its_frame() {
    // Left half: red glass; right half: a blue frame. Transmitted light is not reflected.
    let base = RgbaImage::from_fn(32, 32, |x, _| {
        Rgba(if x < 16 {
            [255, 0, 0, 255]
        } else {
            [0, 0, 255, 255]
        })
    });
    let glass = RgbaImage::from_fn(16, 16, |x, _| {
        Rgba([if x < 8 { 255 } else { 0 }, 0, 0, 255])
    });
    let mut doc = quad(
        &base,
        json!({"extensions": {"KHR_materials_transmission":
            {"transmissionFactor": 1, "transmissionTexture": {"index": 1}}}}),
    );
    let mut png = std::io::Cursor::new(Vec::new());
    glass.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let view = doc.view(png.get_ref());
    doc.push(
        "images",
        json!({"bufferView": view, "mimeType": "image/png"}),
    );
    // Nearest, so that no texel in between is half glass.
    doc.push("samplers", json!({"magFilter": 9728}));
    doc.push("textures", json!({"source": 1, "sampler": 1}));
    let baked = Baked::new(&doc);
    let got = baked.at(0.5, 0.25, 0.25);
    assert!((got - Vec3::Z).abs().max_element() < STORED, "{got}");
}

#[test]
fn images_are_shared_between_materials_that_see_them_alike() {
    let image = checker(64, [200, 200, 200, 255], [10, 10, 10, 0]);
    let mut doc = quad(&image, json!({}));
    let one = Baked::new(&doc).pyramids.bytes();
    // 32² + 16² + … + 1 texels of 8 bytes.
    assert_eq!(one, 8 * 1365);
    let mut primitive = doc.json["meshes"][0]["primitives"][0].clone();
    let materials = doc.json["materials"].as_array_mut().unwrap();
    let mut masked = materials[0].clone();
    masked["alphaMode"] = json!("MASK");
    materials.push(materials[0].clone());
    materials.push(masked);
    for (i, bytes) in [(1, one), (2, 2 * one)] {
        primitive["material"] = json!(i);
        let mesh = doc.mesh(json!([primitive]));
        doc.root(json!({"mesh": mesh, "translation": [i, 0, 0]}));
        assert_eq!(Baked::new(&doc).pyramids.bytes(), bytes);
    }
}
