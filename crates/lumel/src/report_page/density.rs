//! The histogram of lumels per metre. It is measured on the written glTF, so it shows what an
//! engine gets.

use glam::DVec3;
use mesh_ingest::{LoadOptions, Scene};
use serde_json::Value;

use super::Inputs;
use super::html::{list, note, number, percent, short};
use super::svg::{histogram, mark};
use crate::error::Error;

/// Number of bins over the decades in use.
const BINS: usize = 60;

pub(super) fn section(source: &Inputs<'_>) -> String {
    let mut out = String::new();
    let density = list(source.report, "/layout/density");
    if let [low, middle, high] = density
        && let (Some(low), Some(middle), Some(high)) =
            (low.as_f64(), middle.as_f64(), high.as_f64())
    {
        out += &format!(
            "<p>Minimum {}, median {}, maximum {}, weighted by area.</p>\n",
            short(low),
            short(middle),
            short(high)
        );
    }
    let wanted = number(source.report, "/layout/texels_per_unit");
    match measure(source) {
        Ok(samples) => out + &chart(&samples, wanted),
        Err(why) => out + &note(&format!("No histogram: {why}")),
    }
}

/// Lumels per metre and area of every triangle with a lightmap.
fn measure(source: &Inputs<'_>) -> Result<Vec<[f64; 2]>, Error> {
    let path = source.folder.expect_file(&source.manifest.scene)?;
    let scene = mesh_ingest::load(&path, &LoadOptions::default())?.scene;
    let places = source
        .folder
        .json(&format!("{}.lightmap.json", source.stem))?;
    Ok(triangles(&scene, &places))
}

fn triangles(scene: &Scene, manifest: &Value) -> Vec<[f64; 2]> {
    let mut out = Vec::new();
    for node in list(manifest, "/nodes") {
        let Some(size) = number(node, "/rect/w").zip(number(node, "/rect/h")) else {
            continue;
        };
        let index = node.get("node").and_then(Value::as_u64);
        for instance in scene
            .instances
            .iter()
            .filter(|i| Some(i.node as u64) == index)
        {
            for p in &scene.meshes[instance.mesh].primitives {
                let Some(uv) = p
                    .tex_coords
                    .get(1)
                    .filter(|uv| uv.len() == p.positions.len())
                else {
                    continue;
                };
                for t in &p.triangles {
                    let [a, b, c] = t.map(|v| {
                        instance
                            .transform
                            .transform_point3(p.positions[v as usize].as_dvec3())
                    });
                    let area = 0.5 * (b - a).cross(c - a).length();
                    let [a, b, c] = t.map(|v| {
                        let uv = uv[v as usize].as_dvec2();
                        DVec3::new(uv.x * size.0, uv.y * size.1, 0.0)
                    });
                    let texels = 0.5 * (b - a).cross(c - a).length();
                    if area > 0.0 && texels > 0.0 {
                        out.push([(texels / area).sqrt(), area]);
                    }
                }
            }
        }
    }
    out
}

fn chart(samples: &[[f64; 2]], wanted: Option<f64>) -> String {
    let least = samples.iter().map(|s| s[0]).fold(f64::INFINITY, f64::min);
    let most = samples.iter().map(|s| s[0]).fold(0.0, f64::max);
    if samples.is_empty() || !(least > 0.0 && most.is_finite()) {
        return note("No triangle has lightmap coordinates.");
    }
    // Whole factors of two give round labels.
    let (low, high) = (
        least.log2().floor(),
        most.log2().ceil().max(least.log2().floor() + 1.0),
    );
    let mut bins = vec![0.0; BINS];
    let all: f64 = samples.iter().map(|s| s[1]).sum();
    for [density, area] in samples {
        let at = (density.log2() - low) / (high - low) * BINS as f64;
        bins[(at as usize).min(BINS - 1)] += area / all;
    }
    let octaves = (high - low) as usize;
    let every = octaves.div_ceil(10).max(1);
    let labels: Vec<(usize, String)> = (0..=octaves)
        .step_by(every)
        .map(|k| (k * BINS / octaves, mark(2f64.powf(low + k as f64))))
        .collect();
    let mut out = histogram(
        "Area by lumels per metre",
        &bins,
        &labels,
        "lumels per metre, by area",
    );
    if let Some(wanted) = wanted {
        let near: f64 = samples
            .iter()
            .filter(|s| (s[0] / wanted).log2().abs() <= 0.5)
            .map(|s| s[1])
            .sum();
        out += &note(&format!(
            "{} of the area is within a factor of √2 of the requested {}.",
            percent(near / all),
            short(wanted)
        ));
    }
    out
}
