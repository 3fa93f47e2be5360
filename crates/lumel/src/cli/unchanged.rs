//! `--skip-if-unchanged` and `--depfile`.

use std::io::Write;

use lumel::atlas_bake::OutputSet;
use lumel::{Current, Provenance, Settings};

use super::Failure;
use super::args::Bake;
use super::bake::{Done, Files};
use super::interrupt;
use super::progress::Display;

/// The files of the finished bake, if it is up to date. Side results are then restored, and the
/// user is told.
pub(crate) fn skip(
    a: &Bake,
    settings: &Settings,
    provenance: &Provenance,
    strict: bool,
    display: &Display<'_>,
) -> Result<Option<Files>, Failure> {
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
            return Ok(None);
        }
    };
    let mut outputs = current.outputs.clone();
    outputs.extend(a.report.iter().chain(&a.preview).cloned());
    let files = Files {
        inputs: current.inputs.clone(),
        outputs,
        read: Vec::new(),
    };
    restore(a, &current, &files)?;
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
    Ok(Some(files))
}

/// Tells that the nodes of `--only` are up to date. Nothing is written.
pub(crate) fn told(a: &Bake, display: &Display<'_>) -> Result<Done, Failure> {
    display.say(&format!(
        "unchanged: {} of {} is up to date with {}",
        a.only.join(", "),
        a.output.display(),
        a.scene.display()
    ));
    if a.json {
        let stem = a.scene.file_stem().unwrap_or_default().to_string_lossy();
        let report = a.output.join(format!("{stem}.report.json"));
        std::io::stdout()
            .lock()
            .write_all(&std::fs::read(report)?)?;
    }
    Ok(Done::Unchanged(Files::default()))
}

/// Writes the results that the report's record does not cover: the copy of the report, and the
/// dependency file, which ninja deletes after reading it. Files with equal contents are not
/// touched.
fn restore(a: &Bake, current: &Current, files: &Files) -> Result<(), Failure> {
    let depfile = a.own_depfile();
    if a.report.is_none() && depfile.is_none() {
        return Ok(());
    }
    let mut set = OutputSet::create(&a.output)?;
    if let Some(path) = &a.report {
        set.add_path(path, &current.report)?;
    }
    if let Some(path) = depfile {
        set.add_path(path, &dependencies(a, files)?)?;
    }
    interrupt::committing(|| set.commit())?;
    Ok(())
}

/// The contents of the dependency file.
pub(crate) fn dependencies(a: &Bake, files: &Files) -> Result<Vec<u8>, lumel::Error> {
    let targets = match &a.depfile_target[..] {
        [] => &files.outputs,
        given => given,
    };
    Ok(lumel::depfile(targets, &files.inputs)?.into_bytes())
}
