//! Writes scenes: `cargo run -p lumel-tests --bin make-assets [DIR]` those of `assets/` (the default folder),
//! `make-assets --closed-form DIR` the closed-form ones.
#![allow(clippy::print_stdout, reason = "a program that lists what it wrote")]

use std::path::PathBuf;

use lumel_tests::assets::{ASSETS, CLOSED_FORM};

fn main() -> std::io::Result<()> {
    let mut args: Vec<_> = std::env::args_os().skip(1).collect();
    let closed_form = args.iter().position(|a| a == "--closed-form");
    let list = match closed_form {
        Some(at) => {
            args.remove(at);
            CLOSED_FORM
        }
        None => ASSETS,
    };
    let dir = match (args.first(), closed_form) {
        (Some(dir), _) => PathBuf::from(dir),
        (None, None) => PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets")),
        (None, Some(_)) => {
            return Err(std::io::Error::other(
                "usage: make-assets --closed-form DIR",
            ));
        }
    };
    std::fs::create_dir_all(&dir)?;
    for asset in list {
        let bytes = (asset.make)();
        println!("{:9} {}", bytes.len(), asset.name);
        std::fs::write(dir.join(asset.name), bytes)?;
    }
    Ok(())
}
