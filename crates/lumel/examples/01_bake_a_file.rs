//! Bakes a level and writes the results with as little code as possible.
//!
//!     cargo run --release -p lumel --example 01_bake_a_file [SCENE.glb [FOLDER]]
//!
//! View the results with `lumel view FOLDER`. Next: `02_choose_light`.
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::path::PathBuf;

use lumel::{Baker, Quality};

fn main() -> Result<(), lumel::Error> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| {
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/cornell_box.glb").into()
    });
    let folder = arguments.next().map_or_else(
        || std::env::temp_dir().join("lumel-examples/01"),
        PathBuf::from,
    );

    // The other settings have defaults: the lumel density follows from the scene's size.
    let bake = Baker::new().quality(Quality::Draft).bake(&scene)?;
    let files = bake.write(&folder)?;

    for file in files {
        println!("wrote {}", file.display());
    }
    let report = &bake.report;
    println!(
        "{} lumels on {} page(s), estimated error {:.2} % (median)",
        report.gather.light.lumels,
        report.layout.pages.len(),
        100.0 * report.gather.light.median_error
    );
    for warning in &report.warnings {
        println!("warning: {warning}");
    }
    Ok(())
}
