//! Irradiance at given points, by the tests' path tracer:
//! `path-trace SCENE.glb POINTS.csv [PATHS [SEED [R,G,B]]]`.
//!
//! POINTS.csv has a line per point: x,y,z (metres) and the unit normal's x,y,z. For each, a line on
//! stdout gives E in R, G and B (W/m²), their standard errors, and that of the luminance. R,G,B is
//! the sky's radiance. `tools/second_method.py` uses it. `path-trace --scenes DIR` writes the rooms
//! of `tests/tests/second_method.rs` as files.
#![allow(clippy::print_stdout, reason = "a program whose output is a table")]

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use lumel_tests::path_tracer::{Effort, Footprint, PathTracer, Scene};
use lumel_tests::scenes::second_method;

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

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, dir] = args.as_slice()
        && flag == "--scenes"
    {
        return write_scenes(Path::new(dir));
    }
    let [scene, points, rest @ ..] = args.as_slice() else {
        return Err("usage: path-trace SCENE.glb POINTS.csv [PATHS [SEED [R,G,B]]]".into());
    };
    let paths: u32 = rest.first().map_or(Ok(16_384), |s| s.parse())?;
    let seed: u64 = rest.get(1).map_or(Ok(1), |s| s.parse())?;
    let mut scene = Scene::from_glb(&std::fs::read(scene)?)?;
    if let Some(sky) = rest.get(2) {
        scene.sky = DVec3::from_array(numbers(sky)?);
    }
    let mut footprints = Vec::new();
    for line in std::fs::read_to_string(points)?.lines() {
        let [x, y, z, nx, ny, nz] = numbers(line)?;
        let at = Footprint::nearest(&scene, DVec3::new(x, y, z), DVec3::new(nx, ny, nz));
        footprints.push(at.ok_or_else(|| format!("no surface faces along the normal: {line}"))?);
    }
    let tracer = PathTracer::new(scene);
    for e in tracer.irradiance(&footprints, Effort::new(paths.max(2), seed)) {
        let [m, s] = [e.mean, e.error];
        println!(
            "{},{},{},{},{},{},{}",
            m.x, m.y, m.z, s.x, s.y, s.z, e.luminance_error
        );
    }
    Ok(())
}
