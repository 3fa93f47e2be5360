//! Bakes from memory into memory: a glTF's bytes in, pages, vertex colours and glTF bytes out.
//!
//!     cargo run --release -p lumel --example 04_results_in_memory [PICTURE.png]
//!
//! The scene is a furnace: every wall emits L = 1 and reflects ρ = 0.5, so its light is L/(1 − ρ) =
//! 2 at every place, whatever its shape. Next: `05_scene_in_code`.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;

use lumel::{Baker, MemoryDocument, Page, Quality};

fn main() -> Result<(), Box<dyn Error>> {
    // From an archive, a network, another program: here from a file. A .gltf whose buffers and
    // images are elsewhere would get them by `beside(folder)` or `resolve_with(|name| …)`.
    let file = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../assets/furnace_cube_50.glb"
    );
    let document = MemoryDocument::new("furnace.glb", std::fs::read(file)?);

    let bake = Baker::new()
        .quality(Quality::Draft)
        .texels_per_unit(8.0)
        .bake(&document)?;

    // Lightmap: R = E/π by texel, what an engine multiplies with the albedo.
    let page = &bake.pages()[0];
    let lumels =
        || (page.value.iter().zip(&page.coverage)).filter(|(_, coverage)| **coverage > 0.0);
    let worst = lumels()
        .map(|(v, _)| (v[1] - 2.0).abs())
        .fold(0.0, f32::max);
    println!(
        "page of {} x {}, {} lumels, farthest from L/(1 - rho) = 2: {worst:.4}",
        page.width,
        page.height,
        lumels().count()
    );

    // Where each node finds its light on the page.
    for node in &bake.manifest()?.nodes {
        println!(
            "node {:?} on page {}: offset {:.3?}, scale {:.3?}",
            node.name, node.page, node.uv.offset, node.uv.scale
        );
    }

    // The same at vertices: irradiance E, so π times as much.
    for lit in bake.vertex_colors() {
        let mean = lit.irradiance.iter().map(|e| e[1]).sum::<f32>() / lit.irradiance.len() as f32;
        println!(
            "{} vertices of mesh {} hold E = {mean:.3}, {:.3} times pi",
            lit.irradiance.len(),
            lit.mesh,
            mean / std::f32::consts::PI
        );
    }

    // What `lumel bake` would write, as bytes.
    println!(
        "level.glb would have {} bytes, level.vertex.glb {}",
        bake.lightmapped_glb()?.len(),
        bake.vertex_glb()?.len()
    );

    if let Some(path) = std::env::args().nth(1) {
        to_png(page, 0.25)?.save(&path)?;
        println!("wrote {path}");
    }
    Ok(())
}

/// The page as 8-bit sRGB: times `exposure`, what is above 1 cut off.
fn to_png(page: &Page, exposure: f32) -> Result<image::RgbImage, &'static str> {
    let encode = |x: f32| {
        let x = (x * exposure).clamp(0.0, 1.0);
        let s = if x <= 0.003_130_8 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        };
        (255.0 * s + 0.5) as u8
    };
    let bytes = page.value.iter().flatten().map(|x| encode(*x)).collect();
    image::RgbImage::from_raw(page.width, page.height, bytes)
        .ok_or("a page's size and texels belong together")
}
