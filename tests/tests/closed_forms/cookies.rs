//! Lamps that project a picture.

use std::io::Cursor;

use glam::{DVec3, Vec2, Vec3};
use image::{ImageFormat, Rgb, RgbImage};
use lumel_tests::gltf::{Light, look_along};
use lumel_tests::scenes::closed_form::{Stage, point_irradiance};
use serde_json::json;

use super::{GOLDEN, golden};
use crate::common::{Seen, at, lumels_of};

/// Cells of the picture along a side, and pixels of a cell: bilinear filtering blurs the cells'
/// edges by 1/512 of the picture.
const CELLS: u32 = 8;
const PIXELS: u32 = 64;

/// RGB of a cell, from the left and from the top: a checker in red; green is the left half, blue
/// the top half, so that a turned or mirrored picture is a different one.
fn cell(column: u32, row: u32) -> [f64; 3] {
    let half = CELLS / 2;
    [(column + row).is_multiple_of(2), column < half, row < half].map(f64::from)
}

fn picture() -> String {
    let side = CELLS * PIXELS;
    let picture = RgbImage::from_fn(side, side, |x, y| {
        Rgb(cell(x / PIXELS, y / PIXELS).map(|c| (255.0 * c) as u8))
    });
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png).expect("PNG");
    let coded: String = png.get_ref().iter().map(|b| format!("%{b:02X}")).collect();
    format!("data:image/png,{coded}")
}

/// The picture at a coordinate, repeated.
fn seen([u, v]: [f64; 2]) -> [f64; 3] {
    let index = |x: f64| ((x.rem_euclid(1.0) * f64::from(CELLS)) as u32).min(CELLS - 1);
    cell(index(u), index(v))
}

/// Worst error of the lumels, relative to the unmasked irradiance `plain`. Those that lie inside a
/// cell, and those that a cell's edge crosses, for which bake and test use different points.
fn errors(
    lumels: &[Seen],
    coordinate: impl Fn(DVec3) -> [f64; 2],
    plain: impl Fn(DVec3) -> f64,
) -> [f64; 2] {
    let mut worst = [0f64; 2];
    let mut counts = [0; 2];
    for l in lumels {
        // Bilinear filtering reaches one pixel to each side, half of it into the next cell.
        let margin = 2.0 / f64::from(CELLS * PIXELS);
        let around = |p: DVec3| {
            let [u, v] = coordinate(p);
            let d = [-margin, margin];
            d.into_iter()
                .flat_map(move |x| d.map(|y| seen([u + x, v + y])))
        };
        let first = seen(coordinate(l.points[0]));
        let inside = l.all(|p| around(p).all(|c| c == first));
        let kind = usize::from(!inside);
        counts[kind] += 1;
        let unmasked = l.mean(&plain);
        for c in 0..3 {
            let exact = l.mean(|p| plain(p) * seen(coordinate(p))[c]);
            worst[kind] = worst[kind].max((l.irradiance[c] - exact).abs() / unmasked);
        }
    }
    assert!(counts.iter().all(|n| *n > 50), "{counts:?}");
    worst
}

/// Share of light by which a lumel may be off that an edge crosses: bake and test put at least 16
/// and 64 points on it. The standard deviation of the share of 16 jittered points on one side of a
/// straight line is about 16^(−3/4) × ½ = 0.06; this is three of them.
const CROSSED: f64 = 0.18;

#[test]
fn a_spot_projects_a_picture_over_the_square_of_its_cone() {
    for radius in [0.0, 0.05] {
        let mut s = Stage::new();
        s.floor(Vec2::splat(-1.0), Vec2::splat(1.0));
        let (outer, height) = (0.6f64, 2.0);
        let axis = Vec3::NEG_Y;
        let more = json!({"extras": {"lumel": {"cookie": picture(), "radius": radius}}});
        // Full intensity within 0.55 rad, which all of the lamp sees up to about 0.52.
        let spot = Light::Spot([20.0; 3], 0.55, outer as f32);
        s.lamp("lamp", spot, [Vec3::Y * height as f32, axis], more);
        let turn = look_along(axis, Vec3::Y).as_dquat().inverse();
        let coordinate = |p: DVec3| {
            let q = turn * (p - DVec3::Y * height);
            let t = -q.z * outer.tan();
            [0.5 + 0.5 * q.x / t, 0.5 - 0.5 * q.y / t]
        };
        let plain = |p: DVec3| point_irradiance(20.0, height, p.x.hypot(p.z));
        let lumels: Vec<Seen> = lumels_of(&golden(&s.finish(), &at(48.0)), "floor")
            .into_iter()
            .filter(|l| l.all(|p| p.x.hypot(p.z) < height * 0.5f64.tan()))
            .collect();
        let [inside, crossed] = errors(&lumels, coordinate, plain);
        assert!(inside < GOLDEN, "radius {radius}: {inside}");
        assert!(crossed < CROSSED, "radius {radius}: {crossed}");
    }
}

#[test]
fn a_sun_repeats_its_picture_on_tiles() {
    for angle in [0.0, 0.53] {
        let mut s = Stage::new();
        s.floor(Vec2::splat(-1.0), Vec2::splat(1.0));
        let (tile, lux) = (1.5f64, 3.0);
        let (place, axis) = (Vec3::new(0.3, 2.0, -0.2), Vec3::new(0.4, -1.0, 0.3));
        let extras = json!({"cookie": picture(), "cookieSize": tile, "angle": angle});
        let more = json!({"extras": {"lumel": extras}});
        s.lamp(
            "sun",
            Light::Directional([lux as f32; 3]),
            [place, axis],
            more,
        );
        let turn = look_along(axis, Vec3::Y).as_dquat().inverse();
        let coordinate = |p: DVec3| {
            let q = turn * (p - place.as_dvec3());
            [0.5 + q.x / tile, 0.5 - q.y / tile]
        };
        let cos = -axis.as_dvec3().normalize().y;
        let lumels = lumels_of(&golden(&s.finish(), &at(48.0)), "floor");
        let [inside, crossed] = errors(&lumels, coordinate, |_| lux * cos);
        assert!(inside < GOLDEN, "angle {angle}: {inside}");
        assert!(crossed < CROSSED, "angle {angle}: {crossed}");
    }
}
