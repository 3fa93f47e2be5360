//! Writes the scenes of `assets/`: `cargo run -p lumel-tests --bin make-assets [DIR]`.
#![allow(clippy::print_stdout, reason = "a program that lists what it wrote")]

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let default = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets"));
    let dir = std::env::args_os()
        .nth(1)
        .map_or_else(default, PathBuf::from);
    std::fs::create_dir_all(&dir)?;
    for asset in lumel_tests::assets::ASSETS {
        let bytes = (asset.make)();
        println!("{:8} {}", bytes.len(), asset.name);
        std::fs::write(dir.join(asset.name), bytes)?;
    }
    Ok(())
}
