//! Bakes from memory to memory: glTF bytes in; pages, vertex colours and glTF bytes out.
//!
//!     cargo run --release -p lumel --example 04_results_in_memory [PICTURE.png]
//!
//! The scene is a furnace: every wall emits L = 1 and reflects ρ = 0.5, so the radiance is L/(1 −
//! ρ) = 2 everywhere, whatever the shape. Next: `05_scene_in_code`.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;

use lumel::{Baker, MemoryDocument, Page, Quality};

fn main() -> Result<(), Box<dyn Error>> {
    // The bytes could come from an archive or the network. If a .gltf references buffers and
    // images, `beside(folder)` or `resolve_with(|name| …)` provides them.
    let file = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../assets/furnace_cube_50.glb"
    );
    let document = MemoryDocument::new("furnace.glb", std::fs::read(file)?);

    let bake = Baker::new()
        .quality(Quality::Draft)
        .texels_per_unit(8.0)
        .bake(&document)?;

    // Lightmap: R = E/π per texel, which an engine multiplies by the albedo.
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

    // Each node's rectangle on the page.
    for node in &bake.manifest()?.nodes {
        println!(
            "node {:?} on page {}: offset {:.3?}, scale {:.3?}",
            node.name, node.page, node.uv.offset, node.uv.scale
        );
    }

    // Vertices hold irradiance E, which is π times as much.
    for lit in bake.vertex_colors() {
        let mean = lit.irradiance.iter().map(|e| e[1]).sum::<f32>() / lit.irradiance.len() as f32;
        println!(
            "{} vertices of mesh {} hold E = {mean:.3}, {:.3} times pi",
            lit.irradiance.len(),
            lit.mesh,
            mean / std::f32::consts::PI
        );
    }

    // The files of `lumel bake`, as bytes.
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

/// The page as 8-bit sRGB, scaled by `exposure` and clipped at 1.
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
