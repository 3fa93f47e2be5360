//! Image-based skies around a black cube: each of its faces sees half of the sky and nothing else.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DQuat, DVec3, Vec3};
use image::{Rgb, Rgba, RgbaImage};
use lumel::atlas_bake::{ExrOptions, Page, write_lightmap_exr};
use lumel::{Bake, Settings, SkySource};
use lumel_tests::scenes::closed_form::Stage;
use serde_json::json;

use super::{GOLDEN, golden};
use crate::common::{at, lumels_of, mean};

/// The faces of [`Stage::cube`] and their normals.
const FACES: [(&str, DVec3); 6] = [
    ("-x", DVec3::NEG_X),
    ("+x", DVec3::X),
    ("-y", DVec3::NEG_Y),
    ("+y", DVec3::Y),
    ("-z", DVec3::NEG_Z),
    ("+z", DVec3::Z),
];

fn cube() -> Vec<u8> {
    let mut s = Stage::new();
    s.cube(Vec3::splat(-0.5), Vec3::splat(0.5), s.black);
    s.finish()
}

/// A latitude-longitude picture, by its red channel.
struct Picture {
    width: u32,
    height: u32,
    /// Radiance of the pixel in this column and row.
    radiance: fn(u32, u32) -> f32,
}

impl Picture {
    /// ∫ L max(0, n·ω) dω with each pixel a patch of even radiance, and the sky rotated by
    /// `degrees` about +Y.
    fn irradiance(&self, n: DVec3, degrees: f64) -> f64 {
        // Light that came from d comes from R d, so n receives what R⁻¹ n received.
        let n = DQuat::from_rotation_y(-degrees.to_radians()) * n;
        let mut sum = 0.0;
        for row in 0..self.height {
            for column in 0..self.width {
                let l = f64::from((self.radiance)(column, row));
                if l > 0.0 {
                    sum += l * self.pixel(column, row, n);
                }
            }
        }
        sum
    }

    /// ∫ max(0, n·ω) dω over a pixel, by 8 × 8 points.
    fn pixel(&self, column: u32, row: u32, n: DVec3) -> f64 {
        let k = 8;
        let mut sum = 0.0;
        for i in 0..k * k {
            let (a, b) = (f64::from(i % k) + 0.5, f64::from(i / k) + 0.5);
            // docs/lights.md: row 0 is +Y; columns run from −X through −Z, +X and +Z.
            let theta = PI * (f64::from(row) + b / f64::from(k)) / f64::from(self.height);
            let turn = TAU * (f64::from(column) + a / f64::from(k)) / f64::from(self.width);
            let d = DVec3::new(
                -turn.cos() * theta.sin(),
                theta.cos(),
                -turn.sin() * theta.sin(),
            );
            sum += n.dot(d).max(0.0) * theta.sin();
        }
        let step = TAU / f64::from(self.width) * PI / f64::from(self.height);
        sum * step / f64::from(k * k)
    }

    /// Writes it as Radiance HDR: exact for numbers of eight bits.
    fn write_hdr(&self, path: &Path) {
        let mut pixels = Vec::new();
        for y in 0..self.height {
            for x in 0..self.width {
                let l = (self.radiance)(x, y);
                pixels.push(Rgb([l, 0.5 * l, 0.0]));
            }
        }
        let file = std::fs::File::create(path).expect("created");
        image::codecs::hdr::HdrEncoder::new(file)
            .encode(&pixels, self.width as usize, self.height as usize)
            .expect("encoded");
    }

    /// Writes it as EXR of half floats.
    fn write_exr(&self, path: &Path) {
        let n = (self.width * self.height) as usize;
        let pixels = (0..n as u32).map(|i| (self.radiance)(i % self.width, i / self.width));
        let page = Page {
            width: self.width,
            height: self.height,
            value: pixels.map(|l| [l, 0.5 * l, 0.0]).collect(),
            coverage: vec![1.0; n],
            layers: Vec::new(),
        };
        let (bytes, _) = write_lightmap_exr(&page, &ExrOptions::default()).expect("encoded");
        std::fs::write(path, bytes).expect("written");
    }

    /// Bakes the cube under it.
    fn bake(&self, file: &str, change: impl FnOnce(&mut Settings)) -> Bake {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join(file);
        if file.ends_with("exr") {
            self.write_exr(&path);
        } else {
            self.write_hdr(&path);
        }
        let mut settings = Settings {
            sky: SkySource::File(path),
            ..at(8.0)
        };
        change(&mut settings);
        golden(&cube(), &settings)
    }
}

/// Compares the means of all faces with E in units of `factor`.
#[track_caller]
fn check(bake: &Bake, exact: impl Fn(DVec3) -> f64, what: &str) {
    let all: Vec<f64> = FACES.iter().map(|f| exact(f.1)).collect();
    let most = all.iter().copied().fold(0.0, f64::max);
    for ((name, _), exact) in FACES.into_iter().zip(all) {
        let lumels = lumels_of(bake, name);
        let m = mean(&lumels);
        // A face turned away from the light sees the dim rest of the map, blurred by half a pixel:
        // 1e-4 of the others.
        let off = (m - exact).abs();
        assert!(
            off < GOLDEN * exact + 2e-4 * most,
            "{what}, {name}: {m} instead of {exact}"
        );
        for l in &lumels {
            let [r, g, b] = l.irradiance;
            assert!((g - 0.5 * r).abs() <= 1e-3 * r && b == 0.0, "colours");
        }
    }
}

/// A sun of one pixel, high over (−x, +z): in the last quarter of the columns.
const SUN: Picture = Picture {
    width: 256,
    height: 128,
    radiance: |x, y| if (x, y) == (220, 38) { 65536.0 } else { 0.0 },
};

#[test]
fn a_sun_in_the_map() {
    let bake = SUN.bake("sun.hdr", |_| {});
    check(&bake, |n| SUN.irradiance(n, 0.0), "a sun");
    // E = L Ω cosθ as one number, with Ω the pixel's solid angle.
    let theta = PI * 38.5 / 128.0;
    let omega = TAU / 256.0 * ((PI * 38.0 / 128.0).cos() - (PI * 39.0 / 128.0).cos());
    let golden = 65536.0 * omega * theta.cos();
    let m = mean(&lumels_of(&bake, "+y"));
    assert!((m / golden - 1.0).abs() < GOLDEN, "{m} {golden}");
    // It comes from −x and +z, not from the other sides.
    for (face, lit) in [("-x", true), ("+x", false), ("-z", false), ("+z", true)] {
        assert_eq!(mean(&lumels_of(&bake, face)) > 0.1 * golden, lit, "{face}");
    }
}

#[test]
fn a_sky_is_turned_and_dimmed() {
    for degrees in [90.0f32, -33.75, 200.0] {
        let bake = SUN.bake("sun.hdr", |s| {
            s.sky_rotation = degrees;
            s.sky_intensity = 0.25;
        });
        check(
            &bake,
            |n| 0.25 * SUN.irradiance(n, f64::from(degrees)),
            &format!("turned by {degrees}"),
        );
    }
}

#[test]
fn two_tones() {
    let two = Picture {
        width: 128,
        height: 64,
        radiance: |_, y| if y < 32 { 3.0 } else { 1.0 },
    };
    for file in ["two.hdr", "two.exr"] {
        let bake = two.bake(file, |_| {});
        // 3π from above, π from below, half of each from the sides.
        check(&bake, |n| PI * (2.0 + n.y), file);
        check(&bake, |n| two.irradiance(n, 0.0), file);
    }
}

#[test]
fn a_ramp_along_both_axes() {
    let ramp = Picture {
        width: 128,
        height: 64,
        radiance: |x, y| (16 + x.min(127 - x) + y) as f32,
    };
    let bake = ramp.bake("ramp.hdr", |_| {});
    check(&bake, |n| ramp.irradiance(n, 0.0), "a ramp");
}

/// Six faces, one colour each, in the order of the extension.
const COLOURS: [[u8; 3]; 6] = [
    [255, 188, 0],
    [99, 71, 0],
    [188, 137, 0],
    [64, 46, 0],
    [137, 99, 0],
    [225, 165, 0],
];

/// IEC 61966-2-1.
fn linear(c: u8) -> f64 {
    let c = f64::from(c) / 255.0;
    if c <= 0.04045 {
        c / 12.92
    } else {
        ((c + 0.055) / 1.055).powf(2.4)
    }
}

/// E on a surface with this normal under [`COLOURS`]: ∫ over the cube's faces, with 256² points
/// each.
fn under_the_cube(n: DVec3) -> f64 {
    let k = 256;
    let axes = [
        DVec3::X,
        DVec3::NEG_X,
        DVec3::Y,
        DVec3::NEG_Y,
        DVec3::Z,
        DVec3::NEG_Z,
    ];
    let mut sum = 0.0;
    for (axis, colour) in axes.into_iter().zip(COLOURS) {
        let (u, v) = axis.any_orthonormal_pair();
        for i in 0..k * k {
            let at = |j: i32| 2.0 * (f64::from(j) + 0.5) / f64::from(k) - 1.0;
            let p = axis + u * at(i % k) + v * at(i / k);
            let d2 = p.length_squared();
            // dω = dA cos/d² with cos = 1/d.
            let cos = n.dot(p).max(0.0) / d2.sqrt();
            sum += linear(colour[0]) * cos / (d2 * d2.sqrt());
        }
    }
    sum * 4.0 / f64::from(k * k)
}

fn image_based(rotation: [f32; 4]) -> Vec<u8> {
    let mut s = Stage::new();
    s.cube(Vec3::splat(-0.5), Vec3::splat(0.5), s.black);
    let faces = COLOURS.map(|[r, g, b]| {
        let picture = RgbaImage::from_pixel(8, 8, Rgba([r, g, b, 255]));
        s.builder.image("face", &picture)
    });
    let light = json!({
        "name": "studio",
        "intensity": 5.0,
        "rotation": rotation,
        "specularImageSize": 8,
        "specularImages": [faces],
        "irradianceCoefficients": vec![[0.0; 3]; 9],
    });
    s.builder
        .root_extension("EXT_lights_image_based", json!({"lights": [light]}));
    s.builder
        .scene_extension("EXT_lights_image_based", json!({"light": 0}));
    s.finish()
}

#[test]
fn the_documents_own_light() {
    let half = 0.5f32.sqrt();
    let turned = |degrees: f64| DQuat::from_rotation_y(degrees.to_radians());
    for (rotation, degrees, settings) in [
        ([0.0, 0.0, 0.0, 1.0], 0.0, at(8.0)),
        // A quarter turn about +Y by the document, and another 30° by the settings.
        ([0.0, half, 0.0, half], 90.0, at(8.0)),
        (
            [0.0, half, 0.0, half],
            120.0,
            Settings {
                sky_rotation: 30.0,
                sky_intensity: 2.0,
                ..at(8.0)
            },
        ),
    ] {
        let factor = 5.0 * f64::from(settings.sky_intensity);
        let bake = golden(&image_based(rotation), &settings);
        for (name, n) in FACES {
            let m = mean(&lumels_of(&bake, name));
            let exact = factor * under_the_cube(turned(-degrees) * n);
            // The mean over 64 lumels of 128 rays into six even areas.
            assert!(
                (m / exact - 1.0).abs() < GOLDEN,
                "{degrees}°, {name}: {m} {exact}"
            );
        }
    }
    // `--sky` takes precedence over it.
    let black = Settings {
        sky: SkySource::Color([0.0; 3]),
        ..at(8.0)
    };
    let bake = golden(&image_based([0.0, 0.0, 0.0, 1.0]), &black);
    assert_eq!(mean(&lumels_of(&bake, "+y")), 0.0);
}
