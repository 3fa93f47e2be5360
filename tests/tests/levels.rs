//! Generated small levels at `draft`: the cameras' views are compared with the path tracer.
//!
//! A pixel counts as dark if the bake shows less than half of the true light, and as bright if it
//! shows more than twice as much: a few such pixels in a row are a visible line. `tools/judge` does
//! the same with complete pictures of full levels.

use crate::common::bake;
use glam::{DQuat, DVec2, DVec3};
use lumel::atlas_bake::{ExrImage, read_exr};
use lumel::{Quality, Settings, SkySource};
use lumel_tests::levels::{Family, Level, Size, level};
use lumel_tests::path_tracer::{Effort, Footprint, PathTracer, Ray, Scene, Tree, luminance};
use serde_json::Value;

/// Columns and rows of pixels of each of a level's three views.
const PIXELS: [u32; 2] = [30, 20];

/// Paths per pixel.
const PATHS: u32 = 256;

/// Number of standard errors that the path tracer may be off by before a pixel counts. One pixel in
/// forty is farther off on one side, and the bake would also have to be off by nearly a factor of
/// two.
const SIGMAS: f64 = 2.0;

/// The share of a view's mean light below which a pixel is black on screen.
const BLACK: f64 = 0.02;

/// Largest fractions of dark and bright pixels. No level has dark ones, and greybox 1 has the most
/// bright ones, 0.6 %, in corners where lumels of 10 cm are wider than the shade. The limits are
/// twice that, and enough dark pixels to exclude noise of the truth.
const MOST: [f64; 2] = [0.002, 0.012];

struct View {
    eye: DVec3,
    turn: DQuat,
    yfov: f64,
}

impl View {
    /// The direction of a pixel's middle.
    fn direction(&self, x: u32, y: u32) -> DVec3 {
        let half = (self.yfov / 2.0).tan();
        let at = |k: u32, n: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0;
        let (x, y) = (at(x, PIXELS[0]) * half * 1.5, -at(y, PIXELS[1]) * half);
        self.turn * DVec3::new(x, y, -1.0).normalize()
    }
}

fn views(level: &Level) -> Vec<View> {
    let length = u32::from_le_bytes(level.glb[12..16].try_into().expect("a header")) as usize;
    let json: Value = serde_json::from_slice(&level.glb[20..20 + length]).expect("JSON");
    let numbers = |v: &Value| -> Vec<f64> {
        let all = v.as_array().into_iter().flatten();
        all.filter_map(Value::as_f64).collect()
    };
    let nodes = json["nodes"].as_array().expect("nodes").iter();
    nodes
        .filter_map(|n| {
            let camera = n["camera"].as_u64()? as usize;
            Some(View {
                eye: DVec3::from_slice(&numbers(&n["translation"])),
                turn: DQuat::from_slice(&numbers(&n["rotation"])),
                yfov: json["cameras"][camera]["perspective"]["yfov"].as_f64()?,
            })
        })
        .collect()
}

/// The sky of `sky = [r, g, b]`, black without it.
fn sky(settings: &str) -> [f32; 3] {
    let Some(line) = settings.lines().find_map(|l| l.strip_prefix("sky = [")) else {
        return [0.0; 3];
    };
    let mut numbers = (line.trim_end_matches(']').split(',')).map(|x| x.trim().parse());
    [0; 3].map(|_| numbers.next().expect("three numbers").expect("a number"))
}

/// A bilinear lookup, as engines read pages: v runs down, texels' values are at their middles,
/// borders are clamped.
fn lookup(page: &ExrImage, uv: DVec2) -> DVec3 {
    let size = [page.width, page.height];
    let at: [f64; 2] = [0, 1].map(|k| uv[k] * f64::from(size[k]) - 0.5);
    let mut sum = DVec3::ZERO;
    for corner in 0..4 {
        let mut weight = 1.0;
        let place = [0, 1].map(|k| {
            let step = f64::from(corner >> k & 1);
            let fraction = at[k] - at[k].floor();
            weight *= if step > 0.0 { fraction } else { 1.0 - fraction };
            (at[k].floor() + step).clamp(0.0, f64::from(size[k] - 1)) as u32
        });
        let texel = (place[1] * page.width + place[0]) as usize;
        let channel = |name| f64::from(page.channel(name).expect("a channel")[texel]);
        sum += DVec3::from_array(["R", "G", "B"].map(channel)) * weight;
    }
    sum
}

/// Shares of pixels that are dark, and bright.
fn shares(made: &Level) -> [f64; 2] {
    let sky = sky(&made.settings);
    let settings = Settings {
        quality: Quality::Draft,
        sky: SkySource::Color(sky),
        ..Settings::default()
    };
    let baked = bake(&made.glb, &settings);
    let dir = tempfile::tempdir().expect("a temporary folder");
    baked.write(dir.path()).expect("written");
    let glb = std::fs::read(dir.path().join("scene.glb")).expect("the lightmapped scene");
    let mut scene = Scene::from_glb(&glb).expect("a scene that the path tracer models");
    scene.sky = DVec3::from_array(sky.map(f64::from));
    let pages: Vec<ExrImage> = (baked.page_names().iter())
        .map(|name| read_exr(&dir.path().join(name)).expect("an EXR"))
        .collect();
    let tree = Tree::new(scene.triangles.clone());
    let (mut places, mut shown) = (Vec::new(), Vec::new());
    for view in views(made) {
        for (x, y) in (0..PIXELS[1]).flat_map(|y| (0..PIXELS[0]).map(move |x| (x, y))) {
            let ray = Ray {
                origin: view.eye,
                direction: view.direction(x, y),
                t_max: f64::INFINITY,
                skip: [usize::MAX; 2],
            };
            let Some(hit) = tree.closest(&ray) else {
                continue;
            };
            let triangle = &scene.triangles[hit.triangle];
            let Some((page, uv)) = triangle.lightmap else {
                continue;
            };
            // Lightmaps show fronts only.
            if triangle.normal().dot(ray.direction) >= 0.0 {
                continue;
            }
            let [a, b, c] = triangle.corners;
            let (p, n) = (ray.origin + ray.direction * hit.t - a, triangle.cross());
            let u = p.cross(c - a).dot(n) / n.length_squared();
            let v = (b - a).cross(p).dot(n) / n.length_squared();
            places.push(Footprint::of_point(hit.triangle, u, v));
            let at = uv[0] + (uv[1] - uv[0]) * u + (uv[2] - uv[0]) * v;
            shown.push(luminance(lookup(&pages[page], at)));
        }
    }
    let truth = PathTracer::new(scene).irradiance(&places, Effort::new(PATHS, 1));
    let light = |k: usize| luminance(truth[k].mean) / std::f64::consts::PI;
    let mean = (0..shown.len()).map(light).sum::<f64>() / shown.len() as f64;
    let (mut dark, mut bright) = (0, 0);
    for (k, shown) in shown.iter().enumerate() {
        assert!(shown.is_finite() && *shown >= 0.0);
        let unsure = SIGMAS * truth[k].luminance_error / std::f64::consts::PI;
        let black = BLACK * mean;
        dark += usize::from(light(k) > black && *shown < 0.5 * (light(k) - unsure));
        bright += usize::from(*shown > black && *shown > 2.0 * (light(k) + unsure));
    }
    [dark, bright].map(|n| n as f64 / shown.len() as f64)
}

fn check(family: Family, seed: u64) {
    let [dark, bright] = shares(&level(family, seed, Size::Small));
    assert!(
        dark <= MOST[0] && bright <= MOST[1],
        "{family} {seed}: {dark:.4} {bright:.4}"
    );
}

#[test]
fn rooms_of_overlapping_walls_have_no_lines() {
    check(Family::Greybox, 1);
    check(Family::Greybox, 2);
}

#[test]
fn stairs_under_vaults_have_no_stripes() {
    check(Family::Stairs, 1);
}

#[test]
fn coincident_panels_have_no_lines() {
    check(Family::Maze, 1);
}

#[test]
fn furniture_in_walls_and_in_itself_has_no_lines() {
    check(Family::Furniture, 1);
}
