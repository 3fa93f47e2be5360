//! Writes scenes. `cargo run -p lumel-tests --bin make-assets [DIR]` writes those of `assets/` (the
//! default folder), `make-assets --closed-form DIR` the closed-form ones, `make-assets --dense DIR`
//! those with many triangles, and `make-assets --leaks DIR` the leak suite with `leaks.json`, which
//! lists its dark regions.
#![allow(clippy::print_stdout, reason = "a program that lists what it wrote")]

use std::path::{Path, PathBuf};

use lumel_tests::assets::{ASSETS, CLOSED_FORM, DENSE};
use lumel_tests::scenes::leaks::{self, LEAKS};

fn write_leaks(dir: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(dir)?;
    let scenes: Vec<_> = LEAKS.iter().map(|make| make()).collect();
    for scene in &scenes {
        println!("{:9} {}.glb", scene.glb.len(), scene.name);
        std::fs::write(dir.join(scene.name).with_extension("glb"), &scene.glb)?;
    }
    let text = serde_json::to_string_pretty(&leaks::description(&scenes))?;
    std::fs::write(dir.join("leaks.json"), text + "\n")
}

fn main() -> std::io::Result<()> {
    let mut args: Vec<_> = std::env::args_os().skip(1).collect();
    if let [flag, dir] = args.as_slice()
        && flag == "--leaks"
    {
        return write_leaks(Path::new(dir));
    }
    let list = match args.first().and_then(|a| a.to_str()) {
        Some("--closed-form") => Some(CLOSED_FORM),
        Some("--dense") => Some(DENSE),
        _ => None,
    };
    if list.is_some() {
        args.remove(0);
    }
    let is_flag = |a: &std::ffi::OsString| a.to_string_lossy().starts_with('-');
    let dir = match (args.first(), list) {
        // `--help` must not be taken for a folder.
        (Some(dir), _) if !is_flag(dir) => PathBuf::from(dir),
        (None, None) => PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets")),
        _ => {
            return Err(std::io::Error::other(
                "usage: make-assets [--closed-form DIR | --dense DIR | --leaks DIR | DIR]",
            ));
        }
    };
    let list = list.unwrap_or(ASSETS);
    std::fs::create_dir_all(&dir)?;
    for asset in list {
        let bytes = (asset.make)();
        println!("{:9} {}", bytes.len(), asset.name);
        std::fs::write(dir.join(asset.name), bytes)?;
    }
    Ok(())
}
