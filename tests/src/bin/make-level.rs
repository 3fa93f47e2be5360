//! Writes generated levels: `make-level FAMILY|all SEED[..SEED_END] -o DIR [--small]` (the end is
//! exclusive); `make-level --list`.
//!
//! Each level is `DIR/FAMILY_SEED.glb` with `DIR/FAMILY_SEED.lumel.toml` for its sky, which
//! `lumel bake` reads automatically.
#![allow(clippy::print_stdout, reason = "a program that lists what it wrote")]

use std::error::Error;
use std::ops::Range;
use std::path::PathBuf;

use lumel_tests::levels::{Family, Size, level};

const USAGE: &str =
    "usage: make-level FAMILY|all SEED[..SEED_END] -o DIR [--small], or make-level --list";

fn seeds(text: &str) -> Result<Range<u64>, Box<dyn Error>> {
    Ok(match text.split_once("..") {
        Some((a, b)) => a.parse()?..b.parse()?,
        None => {
            let one: u64 = text.parse()?;
            one..one + 1
        }
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = Vec::new();
    let (mut dir, mut size) = (None, Size::Full);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--list" => {
                for family in Family::ALL {
                    println!("{:10} {}", family.name(), family.what());
                }
                return Ok(());
            }
            "--small" => size = Size::Small,
            "-o" => dir = Some(PathBuf::from(args.next().ok_or(USAGE)?)),
            other if other.starts_with('-') => return Err(USAGE.into()),
            _ => words.push(arg),
        }
    }
    let ([family, range], Some(dir)) = (words.as_slice(), dir) else {
        return Err(USAGE.into());
    };
    let families = if family == "all" {
        Family::ALL.to_vec()
    } else {
        vec![family.parse()?]
    };
    std::fs::create_dir_all(&dir)?;
    for family in families {
        for seed in seeds(range)? {
            let made = level(family, seed, size);
            let path = dir.join(format!("{family}_{seed}.glb"));
            println!("{:9} {}", made.glb.len(), path.display());
            std::fs::write(&path, made.glb)?;
            std::fs::write(path.with_extension("lumel.toml"), made.settings)?;
        }
    }
    Ok(())
}
