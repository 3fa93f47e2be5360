//! `--skip-if-unchanged` and `--depfile`.

use std::io::Write;
use std::path::PathBuf;

use lumel::atlas_bake::OutputSet;
use lumel::{Current, Provenance, Settings};

use super::Failure;
use super::args::Bake;
use super::interrupt;
use super::progress::Display;

/// Whether nothing needs to be baked. If so, all side results are restored and the user is told.
pub(crate) fn skip(
    a: &Bake,
    settings: &Settings,
    provenance: &Provenance,
    strict: bool,
    display: &Display,
) -> Result<bool, Failure> {
    let found = lumel::find_current(
        &a.scene,
        settings,
        provenance,
        &a.output,
        a.preview.as_deref(),
    );
    let current = match found {
        Ok(current) => current,
        Err(why) => {
            if a.verbose {
                display.say(&format!("  baking because {why}"));
            }
            return Ok(false);
        }
    };
    restore(a, &current)?;
    display.say(&format!(
        "unchanged: {} is up to date with {}",
        a.output.display(),
        a.scene.display()
    ));
    if a.json {
        std::io::stdout().lock().write_all(&current.report)?;
    }
    if strict && !current.warnings.is_empty() {
        return Err(Failure::Strict(current.warnings.len()));
    }
    Ok(true)
}

/// Writes the results that the report's record does not cover: the copy of the report, and the
/// dependency file, which ninja deletes after reading it. Files with equal contents are not
/// touched.
fn restore(a: &Bake, current: &Current) -> Result<(), Failure> {
    if a.report.is_none() && a.depfile.is_none() {
        return Ok(());
    }
    let mut set = OutputSet::create(&a.output)?;
    if let Some(path) = &a.report {
        set.add_path(path, &current.report)?;
    }
    if let Some(path) = &a.depfile {
        let mut outputs = current.outputs.clone();
        outputs.extend(a.report.iter().chain(&a.preview).cloned());
        set.add_path(path, &dependencies(a, outputs, &current.inputs)?)?;
    }
    interrupt::committing(|| set.commit())?;
    Ok(())
}

/// The contents of the dependency file.
pub(crate) fn dependencies(
    a: &Bake,
    outputs: Vec<PathBuf>,
    inputs: &[PathBuf],
) -> Result<Vec<u8>, lumel::Error> {
    let targets = if a.depfile_target.is_empty() {
        outputs
    } else {
        a.depfile_target.clone()
    };
    Ok(lumel::depfile(&targets, inputs)?.into_bytes())
}
