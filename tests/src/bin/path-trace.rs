//! Irradiance at given points, by the tests' path tracer:
//! `path-trace SCENE.glb POINTS.csv [PATHS [SEED [R,G,B]]]`.
//!
//! POINTS.csv has a line per point: x,y,z (metres) and the unit normal's x,y,z. For each, a line on
//! stdout gives E in R, G and B (W/m²), their standard errors, and that of the luminance. R,G,B is
//! the sky's radiance. `tools/second_method.py` uses it. `path-trace --scenes DIR` writes the rooms
//! of `tests/tests/second_method.rs` as files.
//!
//! `path-trace --lumels BAKED.glb WxH[,WxH…] COUNT [PATHS [SEED [R,G,B]]]` draws COUNT lumels of a
//! bake whose pages have these sizes. For each, a line gives page, column, row, coverage (0 to 1);
//! E in R, G and B of the part of its surface that can be seen, the standard error of its
//! luminance, this part's fraction, and the fraction of rays that go far
//! ([`Seen`](lumel_tests::path_tracer::Seen)); and whether a camera of the scene sees the lumel in
//! full, in whatever direction it looks (0 or 1). `tools/true_error.py` uses it.
#![allow(clippy::print_stdout, reason = "a program whose output is a table")]

use std::error::Error;
use std::path::Path;

use glam::{DVec2, DVec3};
use lumel_tests::path_tracer::{
    Effort, Estimate, Footprint, PathTracer, Ray, Scene, Tree, choose, footprints,
};
use lumel_tests::scenes::second_method;
use serde_json::Value;

fn numbers<const N: usize>(line: &str) -> Result<[f64; N], Box<dyn Error>> {
    let all = line
        .split(',')
        .map(|x| x.trim().parse())
        .collect::<Result<Vec<f64>, _>>()?;
    <[f64; N]>::try_from(all).map_err(|_| format!("{N} numbers expected: {line}").into())
}

fn write_scenes(dir: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(dir)?;
    for (name, glb) in [
        ("skylit_room.glb", second_method::skylit_room()),
        ("coloured_room.glb", second_method::coloured_room()),
        (
            "two_rooms_with_a_door.glb",
            second_method::two_rooms_with_a_door(),
        ),
    ] {
        std::fs::write(dir.join(name), glb)?;
    }
    Ok(())
}

/// What follows the input: paths per footprint, seed and sky, as far as given.
fn effort(rest: &[String], scene: &mut Scene) -> Result<Effort, Box<dyn Error>> {
    let paths: u32 = rest.first().map_or(Ok(16_384), |s| s.parse())?;
    let seed: u64 = rest.get(1).map_or(Ok(1), |s| s.parse())?;
    if let Some(sky) = rest.get(2) {
        scene.sky = DVec3::from_array(numbers(sky)?);
    }
    Ok(Effort::new(paths.max(2), seed))
}

/// E in R, G and B, their standard errors, and that of the luminance.
fn values(e: &Estimate) -> String {
    let [m, s] = [e.mean, e.error];
    let all = [m.x, m.y, m.z, s.x, s.y, s.z, e.luminance_error];
    all.map(|x| x.to_string()).join(",")
}

/// Where the cameras of a level are; they have no parents.
fn eyes(glb: &[u8]) -> Result<Vec<DVec3>, Box<dyn Error>> {
    let length = u32::from_le_bytes(glb[12..16].try_into()?) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + length])?;
    let nodes = json["nodes"].as_array().into_iter().flatten();
    let eye = |n: &Value| {
        n.get("camera")?;
        let at = n["translation"].as_array()?;
        Some(DVec3::from_slice(
            &at.iter().filter_map(Value::as_f64).collect::<Vec<_>>(),
        ))
    };
    Ok(nodes.filter_map(eye).collect())
}

/// Whether nothing is between `eye` and the front of a lumel: its corners, its middle, and halfway.
/// Corners are moved slightly towards their piece's middle, because neighbouring faces meet there;
/// a narrow lamp may stand between them.
fn sees(eye: DVec3, lumel: &Footprint, scene: &Scene, tree: &Tree) -> bool {
    lumel.outlines().all(|(triangle, outline)| {
        let t = &scene.triangles[triangle];
        let middle = outline.iter().sum::<DVec2>() / outline.len() as f64;
        t.normal().dot(eye - t.corners[0]) > 0.0
            && outline
                .iter()
                .flat_map(|p| [0.05, 0.5, 1.0].map(|x| p.lerp(middle, x)))
                .all(|p| {
                    let ray = Ray {
                        origin: eye,
                        direction: t.at(p.x, p.y) - eye,
                        t_max: 1.0 - 1e-9,
                        skip: [triangle, usize::MAX],
                    };
                    tree.closest(&ray).is_none()
                })
    })
}

/// The light of `count` lumels of a bake.
fn lumels(baked: &str, sizes: &str, count: &str, rest: &[String]) -> Result<(), Box<dyn Error>> {
    let bytes = std::fs::read(baked)?;
    let mut scene = Scene::from_glb(&bytes)?;
    let eyes = eyes(&bytes)?;
    let effort = effort(rest, &mut scene)?;
    let mut pages = Vec::new();
    for size in sizes.split(',') {
        let (width, height) = size.split_once('x').ok_or("WIDTHxHEIGHT expected")?;
        pages.push([width.parse()?, height.parse()?]);
    }
    let tree = Tree::new(scene.triangles.clone());
    let drawn = choose(footprints(&scene, &pages), count.parse()?, effort.seed);
    let watched: Vec<bool> = drawn
        .iter()
        .map(|lumel| eyes.iter().any(|eye| sees(*eye, lumel, &scene, &tree)))
        .collect();
    let seen = PathTracer::new(scene).seen(&drawn, effort);
    for ((lumel, seen), watched) in drawn.iter().zip(&seen).zip(&watched) {
        let [column, row] = lumel.texel;
        let (page, coverage, watched) = (lumel.page, lumel.coverage, u8::from(*watched));
        let ([r, g, b], noise) = (seen.light.to_array(), seen.luminance_error);
        let (part, far) = (seen.part, seen.far);
        println!("{page},{column},{row},{coverage},{r},{g},{b},{noise},{part},{far},{watched}");
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, dir] = args.as_slice()
        && flag == "--scenes"
    {
        return write_scenes(Path::new(dir));
    }
    if let [flag, baked, sizes, count, rest @ ..] = args.as_slice()
        && flag == "--lumels"
    {
        return lumels(baked, sizes, count, rest);
    }
    let [scene, points, rest @ ..] = args.as_slice() else {
        return Err("usage: path-trace SCENE.glb POINTS.csv [PATHS [SEED [R,G,B]]]".into());
    };
    let mut scene = Scene::from_glb(&std::fs::read(scene)?)?;
    let effort = effort(rest, &mut scene)?;
    let mut at = Vec::new();
    for line in std::fs::read_to_string(points)?.lines() {
        let [x, y, z, nx, ny, nz] = numbers(line)?;
        let nearest = Footprint::nearest(&scene, DVec3::new(x, y, z), DVec3::new(nx, ny, nz));
        at.push(nearest.ok_or_else(|| format!("no surface faces along the normal: {line}"))?);
    }
    let tracer = PathTracer::new(scene);
    for e in tracer.irradiance(&at, effort) {
        println!("{}", values(&e));
    }
    Ok(())
}
