//! `lumel report`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use lumel::atlas_bake::{Committed, OutputSet};
use lumel::{BakeFolder, report_page};

use super::Failure;

/// Options of `lumel report`.
#[derive(Debug, Args)]
pub(crate) struct Report {
    /// A folder written by `lumel bake`, or the .lightmap.json of one bake in it
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Output file, or - for standard output [default: SCENE.report.html in that folder]
    #[arg(short, long, value_name = "FILE.html")]
    pub output: Option<PathBuf>,
}

/// Writes a page for each bake.
pub(crate) fn run(a: &Report) -> Result<(), Failure> {
    let folder = BakeFolder::open(&a.folder)?;
    let bakes = folder.bakes();
    if a.output.is_some() && bakes.len() > 1 {
        return Err(lumel::Error::Setting(format!(
            "{}: -o names one page, but the folder contains several bakes ({}); pass the .lightmap.json of one of them instead",
            a.folder.display(),
            bakes.join(", ")
        ))
        .into());
    }
    let pages = (bakes.iter())
        .map(|stem| Ok((stem, report_page(&folder, stem)?)))
        .collect::<Result<Vec<_>, lumel::Error>>()?;
    super::warn_of_strangers(&folder);
    match &a.output {
        Some(path) if path == Path::new("-") => {
            for (_, page) in &pages {
                std::io::stdout().lock().write_all(page.as_bytes())?;
            }
            return Ok(());
        }
        Some(path) => {
            let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
            let mut set = OutputSet::create(parent.unwrap_or(Path::new(".")))?;
            for (_, page) in &pages {
                set.add_path(path, page.as_bytes())?;
            }
            say(&set.commit()?);
        }
        None => {
            let mut set = OutputSet::create(folder.dir())?;
            for (stem, page) in &pages {
                set.add(&format!("{stem}.report.html"), page.as_bytes())?;
            }
            say(&set.commit()?);
        }
    }
    Ok(())
}

fn say(done: &Committed) {
    let mut out = std::io::stderr();
    for path in &done.written {
        let _ = writeln!(out, "wrote {}", path.display());
    }
    for path in &done.unchanged {
        let _ = writeln!(out, "{} is unchanged", path.display());
    }
}
