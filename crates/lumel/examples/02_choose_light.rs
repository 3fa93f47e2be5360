//! Chooses what lights a level, and bakes parts of the light separately.
//!
//!     cargo run --release -p lumel --example 02_choose_light
//!
//! The box's own lamp is dimmed to half, and a bluish sky shines in through the open front. Light
//! is additive, so the pages of the two groups sum to the whole lightmap. Next:
//! `03_progress_and_cancel`.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use lumel::{Baker, Page, Quality};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb");

fn main() -> Result<(), lumel::Error> {
    // Names to choose from: lights and their nodes, emissive materials, `sky` and `sun`.
    let inspection = Baker::new().texels_per_unit(DENSITY).inspect(SCENE)?;
    for source in &inspection.sources {
        println!("source {:?} ({:?})", source.name, source.kind);
    }

    let bake = Baker::new()
        .quality(Quality::Draft)
        .texels_per_unit(DENSITY)
        .light("*", 0.5)
        .sky([0.2, 0.3, 0.5])
        // The last match wins.
        .light("sky", 1.0)
        .group("outside", ["sky"])
        .bake(SCENE)?;

    println!("whole    mean {:.4}", mean(bake.pages()));
    let mut sum = 0.0;
    for (name, pages) in bake.groups() {
        println!("{name:<8} mean {:.4}", mean(pages));
        sum += mean(pages);
    }
    println!("sum of groups / whole {:.4}", sum / mean(bake.pages()));
    Ok(())
}

/// Lumels per unit of the scene; the unit is a centimetre here.
const DENSITY: f32 = 0.1;

/// Mean of R, G and B over the surface; texels are weighted by their coverage.
fn mean(pages: &[Page]) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for page in pages {
        for (value, coverage) in page.value.iter().zip(&page.coverage) {
            sum += f64::from(*coverage) * f64::from(value.iter().sum::<f32>()) / 3.0;
            weight += f64::from(*coverage);
        }
    }
    sum / weight
}
