//! `lumel bake` of several levels, and of folders of them.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use lumel::Error;
use lumel::atlas_bake::OutputSet;

use super::Failure;
use super::args::Bake;
use super::bake::{self, Done, Files};
use super::interrupt;
use super::progress::duration;
use super::unchanged::dependencies;

/// The levels to bake, in order: files as given, and every .glb and .gltf of a folder, sorted by
/// name. A file given twice is baked once.
///
/// # Errors
/// [`Error::Folder`] if a folder cannot be read or contains no level, [`Error::Setting`] if the
/// results of two levels would have the same names.
pub(crate) fn find(given: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut all: Vec<PathBuf> = Vec::new();
    for path in given {
        if path.is_dir() {
            all.extend(levels_in(path)?);
        } else {
            all.push(path.clone());
        }
    }
    let place = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let mut known: BTreeMap<String, PathBuf> = BTreeMap::new();
    let mut found = Vec::new();
    for path in all {
        // Some file systems ignore case.
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        match known.get(&stem.to_lowercase()) {
            None => {
                known.insert(stem.to_lowercase(), path.clone());
                found.push(path);
            }
            Some(other) if place(other) == place(&path) => {}
            Some(other) => {
                return Err(Error::Setting(format!(
                    "{} and {} would have the same results: bake them into folders of their own",
                    other.display(),
                    path.display()
                )));
            }
        }
    }
    Ok(found)
}

/// The levels in a folder, sorted by name, without results of earlier bakes.
fn levels_in(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let failed = |message: String| Error::Folder {
        path: folder.to_owned(),
        message,
        io: true,
    };
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|e| failed(e.to_string()))?;
    let mut levels: Vec<PathBuf> = entries
        .into_iter()
        .map(|e| e.path())
        .filter(|path| is_level(path) && path.is_file())
        .collect();
    levels.sort();
    if levels.is_empty() {
        let message = "found no level, expected .glb or .gltf files in this folder";
        return Err(failed(message.into()));
    }
    Ok(levels)
}

/// Whether a file is named like a level and is not the result of a bake in the same folder.
fn is_level(path: &Path) -> bool {
    let Some(name) = path.file_name().and_then(|n| n.to_str()) else {
        return false;
    };
    let lower = name.to_lowercase();
    let Some(end) = [".glb", ".gltf"].iter().find(|end| lower.ends_with(**end)) else {
        return false;
    };
    let stem = &name[..name.len() - end.len()];
    let stem = stem.strip_suffix(".vertex").unwrap_or(stem);
    !path
        .with_file_name(format!("{stem}.lightmap.json"))
        .exists()
}

/// Bakes levels one after the other. A level that fails does not stop the others.
///
/// # Errors
/// [`Failure::Told`] with the exit code of the first level that failed, or of Ctrl-C.
pub(crate) fn run(scenes: &[PathBuf], a: &Bake) -> Result<(), Failure> {
    refuse_single_files(scenes.len(), a)?;
    let all = Bake {
        one_of_many: true,
        ..a.clone()
    };
    let mut outcomes: Vec<Result<Done, u8>> = Vec::new();
    for (i, scene) in scenes.iter().enumerate() {
        say(
            a,
            &format!("[{}/{}] {}", i + 1, scenes.len(), scene.display()),
        );
        let one = all.of(scene);
        let outcome = one.settings().map_err(Failure::from);
        let outcome = outcome.and_then(|layered| bake::one(&one, &layered));
        outcomes.push(outcome.map_err(|failure| failure.tell()));
        if interrupt::cancelled() {
            break;
        }
    }
    if !a.dry_run {
        summarise(scenes, &outcomes, a);
    }
    let cancelled = interrupt::cancelled().then_some(Error::Cancelled.exit_code() as u8);
    let first = outcomes.iter().find_map(|o| o.as_ref().err().copied());
    if let Some(code) = cancelled.or(first) {
        return Err(Failure::Told(code));
    }
    write_depfile(a, outcomes.into_iter().flatten())
}

/// Refuses options that name one file for one level.
fn refuse_single_files(levels: usize, a: &Bake) -> Result<(), Error> {
    let options = [
        ("--preview", &a.preview),
        ("--first-picture", &a.first_picture),
        ("--report", &a.report),
    ];
    if !a.only.is_empty() {
        return Err(Error::Setting(format!(
            "--only names nodes of one level, and there are {levels} levels: bake them one by one"
        )));
    }
    match options.iter().find(|(_, path)| path.is_some()) {
        Some((option, _)) => Err(Error::Setting(format!(
            "{option} names one file, and there are {levels} levels: leave it out, or bake them one by one"
        ))),
        None => Ok(()),
    }
}

/// Writes one rule for all levels: every result depends on every input.
fn write_depfile(a: &Bake, done: impl Iterator<Item = Done>) -> Result<(), Failure> {
    let Some(path) = &a.depfile else {
        return Ok(());
    };
    let mut all = Files::default();
    for done in done {
        if let Done::Unchanged(files) | Done::Baked(files, _) = done {
            all.inputs.extend(files.inputs);
            all.outputs.extend(files.outputs);
        }
    }
    let mut set = OutputSet::create(&a.output)?;
    set.add_path(path, &dependencies(a, &all)?)?;
    interrupt::committing(|| set.commit())?;
    Ok(())
}

fn summarise(scenes: &[PathBuf], outcomes: &[Result<Done, u8>], a: &Bake) {
    let count = |f: fn(&Result<Done, u8>) -> bool| outcomes.iter().filter(|o| f(o)).count();
    let counts = [
        (count(|o| matches!(o, Ok(Done::Baked(..)))), "baked"),
        (count(|o| matches!(o, Ok(Done::Unchanged(_)))), "unchanged"),
        (count(Result::is_err), "failed"),
        (scenes.len() - outcomes.len(), "not begun"),
    ];
    let told: Vec<String> = (counts.iter())
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{n} {what}"))
        .collect();
    say(a, &format!("{} levels: {}", scenes.len(), told.join(", ")));
    for (i, scene) in scenes.iter().enumerate() {
        let state = match outcomes.get(i) {
            None => "not begun".into(),
            Some(Ok(Done::Planned)) => "planned".into(),
            Some(Ok(Done::Unchanged(_))) => "unchanged".into(),
            Some(Ok(Done::Baked(_, seconds))) => format!("baked in {}", duration(*seconds)),
            Some(Err(code)) => format!("failed, code {code}"),
        };
        say(a, &format!("  {state:<16}{}", scene.display()));
    }
    if counts[0].0 + counts[1].0 > 0 {
        say(
            a,
            &format!("view them with: lumel view {}", a.output.display()),
        );
    }
}

fn say(a: &Bake, text: &str) {
    if !a.quiet {
        let _ = writeln!(std::io::stderr(), "{}", super::line(text));
    }
}
