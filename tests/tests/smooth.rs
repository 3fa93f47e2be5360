//! Coarse meshes with smooth normals are lit like the round shapes that they approximate.

#![allow(
    clippy::print_stderr,
    reason = "figures for lab/smooth.md, with --nocapture"
)]

use std::f64::consts::PI;

use crate::common::{Seen, at, bake, lumels_of, worst};
use glam::{DVec2, DVec3, Vec3};
use lumel::atlas_bake::read_exr;
use lumel::{Settings, SkySource};
use lumel_tests::geometry::{Geometry, cuboid, room};
use lumel_tests::gltf::{GltfBuilder, Light, Material, Node};
use lumel_tests::path_tracer::{Scene, footprints};
use lumel_tests::scenes::smooth::{averaged, glowing, lit, tube, uv_sphere};

/// Meridians and bands.
const TESSELLATIONS: [[u32; 2]; 3] = [[8, 6], [16, 12], [32, 24]];

/// Compares lumels with `exact`, a function of the point on the ideal surface with maximum `scale`.
/// Prints the largest and the root mean square difference, relative to `scale`.
///
/// Only the mean over a lumel is sampled, with sixteen points (`DirectOptions::base` of the
/// preview), fewer if little of the lumel is on the surface. Values distributed evenly over a range
/// have a standard deviation of 1/√12 of it. The mean of sixteen independent ones has a quarter of
/// that, the reference's sixty-four an eighth, and four deviations of the difference are 0.32 of
/// the range. Half floats round by 2⁻¹¹. For the RMS: one deviation, where the range is the
/// variation over a lumel of 1/8 m on a unit sphere: 1/8 of `scale` or, near a lamp, more.
fn holds(name: &str, lumels: &[Seen], scale: f64, exact: impl Fn(DVec3) -> f64) {
    let (mut most, mut squares, mut n) = (0f64, 0.0, 0.0);
    for l in lumels.iter().filter(|l| l.points.len() >= 32) {
        let values: Vec<f64> = l.points.iter().map(|p| exact(*p)).collect();
        let lo = values.iter().copied().fold(f64::INFINITY, f64::min);
        let hi = values.iter().copied().fold(0.0, f64::max);
        let d = l.red() - values.iter().sum::<f64>() / values.len() as f64;
        most = most.max(d.abs() / scale);
        squares += d * d / (scale * scale);
        n += 1.0;
        assert!(
            d.abs() <= 0.32 * (hi - lo) + 5e-4 * scale,
            "{name}: off by {d} at {}, where E is {lo} to {hi}",
            l.points[0]
        );
    }
    let rms = (squares / n).sqrt();
    eprintln!("{name}: max {most:.5}, RMS {rms:.5}, {n} lumels");
    assert!(n > 100.0, "{name}: {n} lumels");
    assert!(rms <= 3e-3, "{name}: RMS {rms}");
}

fn all_dark(lumels: &[Seen]) {
    for l in lumels {
        assert_eq!(l.red(), 0.0, "{}", l.points[0]);
    }
}

/// A density, and lumels as gathered, i.e. means over their surface. Stitching changes border
/// lumels for lookups, which [`error_of_lookups`] compares with the truth.
fn means(texels_per_unit: f32) -> Settings {
    Settings {
        stitch: false,
        ..at(texels_per_unit)
    }
}

/// The same under a uniform sky of radiance 1.
fn under_the_sky(texels_per_unit: f32) -> Settings {
    Settings {
        sky: SkySource::Color([1.0; 3]),
        ..means(texels_per_unit)
    }
}

/// Root mean square difference between bilinear lookups and `exact` over the whole surface, by
/// area.
fn error_of_lookups(glb: &[u8], settings: &Settings, exact: impl Fn(DVec3) -> f64) -> f64 {
    let (mut squares, mut area) = (0.0, 0.0);
    for (place, seen, weight) in lookups(glb, settings) {
        squares += weight * (seen - exact(place)).powi(2);
        area += weight;
    }
    assert!(area > 0.0);
    (squares / area).sqrt()
}

/// Bilinear lookups all over the surface: where, the red irradiance that engines see there, and the
/// area that it stands for.
pub(crate) fn lookups(glb: &[u8], settings: &Settings) -> Vec<(DVec3, f64, f64)> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let baked = bake(glb, settings);
    baked.write(dir.path()).expect("written");
    let image = read_exr(&dir.path().join(&baked.page_names()[0])).expect("an EXR");
    let red = image.channel("R").expect("a colour channel");
    let (w, h) = (i64::from(image.width), i64::from(image.height));
    let texel = |x: i64, y: i64| {
        let at = y.clamp(0, h - 1) * w + x.clamp(0, w - 1);
        PI * f64::from(red[at as usize])
    };
    let written = std::fs::read(dir.path().join("scene.glb")).expect("the written scene");
    let scene = Scene::from_glb(&written).expect("a scene");
    let mut lookups = Vec::new();
    for footprint in footprints(&scene, &[[image.width, image.height]]) {
        for (triangle, outline) in footprint.outlines() {
            let t = &scene.triangles[triangle];
            let (_, uv) = t.lightmap.expect("a lightmapped triangle");
            let middle = outline.iter().sum::<DVec2>() / outline.len() as f64;
            let uv = uv[0] + (uv[1] - uv[0]) * middle.x + (uv[2] - uv[0]) * middle.y;
            let p = uv * DVec2::new(w as f64, h as f64) - 0.5;
            let (x, y) = (p.x.floor() as i64, p.y.floor() as i64);
            let f = p - p.floor();
            let row = |y| texel(x, y) * (1.0 - f.x) + texel(x + 1, y) * f.x;
            let seen = row(y) * (1.0 - f.y) + row(y + 1) * f.y;
            let weight = footprint.area / footprint.outlines().count() as f64;
            lookups.push((t.at(middle.x, middle.y), seen, weight));
        }
    }
    lookups
}

#[test]
fn lookups_on_a_sphere_are_as_near_to_the_truth_as_lumels_allow() {
    let from = Vec3::new(0.48, 0.6, 0.64);
    let exact = |p: DVec3| p.normalize().dot(from.as_dvec3()).max(0.0);
    for n in TESSELLATIONS {
        let glb = lit(&[("sphere", &uv_sphere(1.0, n))], 0.0, &[sun(from)]);
        for stitch in [false, true] {
            let settings = Settings { stitch, ..at(8.0) };
            let off = error_of_lookups(&glb, &settings, exact);
            eprintln!("lookups {n:?}, stitched {stitch}: RMS {off:.5}");
            // A lookup at a border is up to half a lumel of 1/8 m from the centres of the lumels
            // that it reads, over which E changes by at most 1/16; borders are at most an eighth of
            // the surface: 1/16 · √(1/8)/√3 = 0.013.
            assert!(off < 0.013, "{n:?}, stitched {stitch}: {off}");
        }
    }
}

fn sun(from: Vec3) -> (Light, Vec3) {
    (Light::Directional([1.0; 3]), from)
}

fn lamp(place: Vec3) -> (Light, Vec3) {
    (Light::Point([1.0; 3]), place)
}

/// E of a lamp of 1 cd at `place` on the unit sphere.
fn lamp_on_sphere(place: Vec3) -> impl Fn(DVec3) -> f64 {
    let place = place.as_dvec3();
    move |p| {
        let n = p.normalize();
        (place - n).dot(n).max(0.0) / (place - n).length().powi(3)
    }
}

#[test]
fn a_sphere_in_the_sun_is_round_at_any_tessellation() {
    let from = Vec3::new(0.48, 0.6, 0.64);
    for n in TESSELLATIONS {
        let glb = lit(&[("sphere", &uv_sphere(1.0, n))], 0.0, &[sun(from)]);
        let seen = lumels_of(&bake(&glb, &means(8.0)), "sphere");
        let exact = |p: DVec3| p.normalize().dot(from.as_dvec3()).max(0.0);
        holds(&format!("sun {n:?}"), &seen, 1.0, exact);
    }
}

#[test]
fn a_sphere_under_a_uniform_sky_is_even_at_any_tessellation() {
    for n in TESSELLATIONS {
        let glb = lit(&[("sphere", &uv_sphere(1.0, n))], 0.0, &[]);
        let seen = lumels_of(&bake(&glb, &under_the_sky(8.0)), "sphere");
        // Every ray escapes, so only half floats round.
        holds(&format!("sky {n:?}"), &seen, PI, |_| PI);
    }
}

#[test]
fn a_sphere_beside_a_lamp_is_as_far_from_it_as_the_round_one() {
    // 0.25 m off the sphere at the nearest point, where facets of the coarsest are 0.09 m farther.
    let place = Vec3::new(0.6, 0.75, 0.8);
    let most = 1.0 / (f64::from(place.length()) - 1.0).powi(2);
    for n in TESSELLATIONS {
        let glb = lit(&[("sphere", &uv_sphere(1.0, n))], 0.0, &[lamp(place)]);
        let seen = lumels_of(&bake(&glb, &means(8.0)), "sphere");
        holds(&format!("lamp {n:?}"), &seen, most, lamp_on_sphere(place));
    }
}

#[test]
fn a_tube_is_round_outside() {
    let from = Vec3::new(0.6, 0.48, 0.64);
    for faces in [6, 12] {
        let glb = lit(&[("tube", &tube(1.0, 1.0, faces, 1))], 0.0, &[sun(from)]);
        let seen = lumels_of(&bake(&glb, &means(8.0)), "tube");
        let exact = |p: DVec3| {
            let n = DVec3::new(p.x, 0.0, p.z).normalize();
            n.dot(from.as_dvec3()).max(0.0)
        };
        holds(&format!("tube in the sun {faces}"), &seen, 1.0, exact);
        let glb = lit(&[("tube", &tube(1.0, 1.0, faces, 1))], 0.0, &[]);
        let bake = bake(&glb, &under_the_sky(8.0));
        // It is open above and below: nothing hides the sky from any point.
        let name = format!("tube in the sky {faces}");
        holds(&name, &lumels_of(&bake, "tube"), PI, |_| PI);
    }
}

#[test]
fn a_hollow_furnace_loses_no_light_between_the_horizons() {
    // B = πL/(1 − ρ) everywhere on the walls of a closed shape, and E is the same around any axis.
    // If light were cut off at the facets' horizons, corners of the coarsest would lack (1 − cos
    // 27°)/2 = 5 %.
    let (rho, radiance) = (0.5, 1.0);
    for n in &TESSELLATIONS[..2] {
        let hollow = uv_sphere(1.0, *n).flipped();
        let bake = bake(&glowing("hollow", &hollow, radiance, rho), &means(4.0));
        let seen = lumels_of(&bake, "hollow");
        let off = worst(&seen, 0.0, |_| PI / (1.0 - f64::from(rho)));
        eprintln!("hollow {n:?}: {off:.5}");
        // f32 and half rounding, and the solve's residual.
        assert!(off <= 2e-3, "{n:?}: {off}");
    }
}

#[test]
fn a_bright_ball_does_not_light_itself() {
    // In a black hall so large that the ball counts as a lamp, with closed forms and shadow rays:
    // its own facets are below its horizons.
    let hall = room(Vec3::splat(-2.0), Vec3::splat(2.0), 1).bare();
    for n in &TESSELLATIONS[..2] {
        let ball = uv_sphere(1.0, *n);
        let mut b = GltfBuilder::new();
        let glow = b.material(&Material::emitter("glow", [1.0; 3], [0.5; 3]));
        let black = b.material(&Material::diffuse("black", [0.0; 3]));
        for (name, g, m) in [("ball", &ball, glow), ("hall", &hall, black)] {
            let mesh = b.mesh(name, &[(g, m)]);
            b.node(Node::of_mesh(name, mesh));
        }
        all_dark(&lumels_of(&bake(&b.finish(), &means(4.0)), "ball"));
    }
}

#[test]
fn a_closed_sphere_lets_no_light_out_or_in() {
    for n in TESSELLATIONS {
        let ball = uv_sphere(1.0, n);
        let glb = lit(&[("ball", &ball)], 0.5, &[lamp(Vec3::new(0.2, 0.1, 0.5))]);
        all_dark(&lumels_of(&bake(&glb, &means(4.0)), "ball"));
        let lights = [
            lamp(Vec3::new(0.7, 0.6, 0.7)),
            sun(Vec3::new(0.48, -0.6, 0.64)),
        ];
        let glb = lit(&[("hollow", &ball.flipped())], 0.5, &lights);
        all_dark(&lumels_of(&bake(&glb, &under_the_sky(4.0)), "hollow"));
    }
}

#[test]
fn shells_a_millimetre_apart_keep_their_gap_dark() {
    // The ideal surface of the inner facets is up to 9 cm outside the outer shell's.
    for n in TESSELLATIONS {
        let inner = uv_sphere(1.0, n);
        let outer = uv_sphere(1.001, n).flipped();
        let lights = [
            lamp(Vec3::ZERO),
            lamp(Vec3::new(0.7, 0.6, 0.7)),
            sun(Vec3::new(0.48, -0.6, 0.64)),
        ];
        let glb = lit(&[("inner", &inner), ("outer", &outer)], 0.5, &lights);
        let bake = bake(&glb, &under_the_sky(4.0));
        all_dark(&lumels_of(&bake, "inner"));
        all_dark(&lumels_of(&bake, "outer"));
    }
}

#[test]
fn a_sphere_that_rests_in_a_closed_box_is_lit_as_in_the_open_and_lets_nothing_in() {
    let ball = uv_sphere(1.0, [16, 12]);
    // A corner of it touches the floor and one of the walls.
    let walls = room(Vec3::new(-1.0, -1.0, -2.0), Vec3::new(2.0, 2.0, 2.0), 1).bare();
    let parts: [(&str, &Geometry); 2] = [("ball", &ball), ("walls", &walls)];
    let place = Vec3::new(0.9, 1.2, 1.1);
    let most = 1.0 / (f64::from(place.length()) - 1.0).powi(2);
    let glb = lit(&parts, 0.0, &[lamp(place), sun(Vec3::new(0.48, 0.6, 0.64))]);
    let bake_lit = bake(&glb, &under_the_sky(8.0));
    let seen = lumels_of(&bake_lit, "ball");
    holds("in a box", &seen, most, lamp_on_sphere(place));
    let dark = lit(&parts, 0.0, &[sun(Vec3::new(0.48, 0.6, 0.64))]);
    let bake_dark = bake(&dark, &under_the_sky(4.0));
    all_dark(&lumels_of(&bake_dark, "ball"));
    all_dark(&lumels_of(&bake_dark, "walls"));
}

#[test]
fn a_cube_with_averaged_normals_keeps_its_horizons() {
    // Low light from one side: normals at the top's rim lean towards it, but the top's faces do not
    // see it.
    let cube = averaged(&cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 1));
    let low = Vec3::new(0.96, -0.28, 0.0);
    let glb = lit(&[("cube", &cube)], 0.0, &[sun(low)]);
    let mut top = lumels_of(&bake(&glb, &means(8.0)), "cube");
    top.retain(|l| l.all(|p| p.y > 0.4999));
    assert!(top.len() >= 64, "{}", top.len());
    all_dark(&top);
}
