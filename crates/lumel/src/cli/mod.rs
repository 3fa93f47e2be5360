//! The commands, and the only code that prints and exits.

mod args;
mod bake;
mod config;
mod course;
mod diff;
mod dry_run;
mod farm;
mod interrupt;
mod manual;
mod progress;
mod report;
mod saves;
mod scenes;
mod unchanged;
mod view;
mod watch;

use std::borrow::Cow;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use lumel::atlas_bake::OutputSet;
use lumel::mesh_ingest::printable_within;

use args::{Arguments, Command};

/// Why a command failed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The pipeline failed.
    Lumel(lumel::Error),
    /// The bake succeeded, but `--strict` was given and there were this many warnings.
    Strict(usize),
    /// Standard output is closed, so nothing can be reported.
    Output(std::io::Error),
    /// One of several levels failed, and the error was printed; its exit code.
    Told(u8),
}

impl From<lumel::Error> for Failure {
    fn from(e: lumel::Error) -> Self {
        Failure::Lumel(e)
    }
}

impl From<atlas_bake::Error> for Failure {
    fn from(e: atlas_bake::Error) -> Self {
        Failure::Lumel(e.into())
    }
}

impl From<std::io::Error> for Failure {
    fn from(e: std::io::Error) -> Self {
        Failure::Output(e)
    }
}

/// Parses the command line, runs the command and reports a failure on stderr in one message.
pub(crate) fn run() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(a) => a,
        Err(e) => {
            // --help and --version are not errors. clap's own code for wrong usage is 2, ours is 1.
            let code = u8::from(e.use_stderr());
            let _ = e.print();
            return ExitCode::from(code);
        }
    };
    let outcome = match arguments.command {
        Command::Bake(a) => bake::run(&a),
        Command::Solve(a) => farm::solve(&a),
        Command::Gather(a) => farm::gather(&a),
        Command::Merge(a) => farm::merge(&a),
        Command::Watch(a) => watch::run(&a),
        Command::Inspect(a) => inspect(&a),
        Command::Diff(a) => diff::run(&a),
        Command::Config => manual::config(),
        Command::Completions(a) => manual::completions(&a),
        Command::Man(a) => manual::man(&a),
        Command::View(a) => view::run(&a),
        Command::Report(a) => report::run(&a),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => ExitCode::from(failure.tell()),
    }
}

impl Failure {
    /// Prints the error on stderr and returns the exit code.
    fn tell(&self) -> u8 {
        let mut err = std::io::stderr();
        match self {
            Failure::Lumel(e) => {
                let _ = writeln!(err, "error: {}", lines(&e.to_string()));
                e.exit_code() as u8
            }
            Failure::Strict(n) => {
                let _ = writeln!(err, "error: the bake has warnings (--strict): {n}");
                5
            }
            // A reader such as `head` may close the pipe early.
            Failure::Output(e) if e.kind() == std::io::ErrorKind::BrokenPipe => 0,
            Failure::Output(e) => {
                let _ = writeln!(err, "error: standard output: {e}");
                2
            }
            Failure::Told(code) => *code,
        }
    }
}

/// Warns on stderr about bakes in `folder` whose files do not belong together.
fn warn_of_strangers(folder: &lumel::BakeFolder) {
    for stem in folder.bakes() {
        if let Some(text) = folder.disagreement(&stem) {
            let _ = writeln!(std::io::stderr(), "warning: {}", line(&text));
        }
    }
}

/// Longest line printed, bytes: fits the longest path that systems allow.
const LINE: usize = 5000;

/// One line of text without control characters, which names of files and nodes may contain.
fn line(text: &str) -> Cow<'_, str> {
    printable_within(text, LINE)
}

/// An error message. Its own further lines are indented; line breaks from names are removed.
fn lines(text: &str) -> String {
    let mut parts = text.split("\n  ").map(line);
    let first = parts.next().unwrap_or_default().into_owned();
    parts.fold(first, |all, part| all + "\n  " + &part)
}

/// Writes all pictures or none.
fn write_pictures(dir: &Path, pictures: &[lumel::NamedFile]) -> Result<usize, Failure> {
    let mut set = OutputSet::create(dir)?;
    for (name, bytes) in pictures {
        set.add(name, bytes)?;
    }
    Ok(interrupt::committing(|| set.commit())?.files().count())
}

fn inspect(a: &args::Inspect) -> Result<(), Failure> {
    let settings = a.settings()?;
    let paint = a.pictures.as_ref().map(|_| a.paint.into());
    let (report, drawn) = interrupt::under_control(a.pictures.clone(), || {
        let (report, pictures, left) =
            lumel::inspect_and_draw(&a.scene, &settings, paint, &interrupt::Cancel)?;
        let written = match &a.pictures {
            Some(dir) => write_pictures(dir, &pictures)?,
            None => 0,
        };
        Ok::<_, Failure>((report, (written, left)))
    })?;
    if let (Some(dir), (written, left)) = (&a.pictures, drawn) {
        let more = match left {
            0 => String::new(),
            n => format!("; {n} more pages and meshes were skipped"),
        };
        let at = dir.display();
        let _ = writeln!(std::io::stderr(), "wrote {written} pictures to {at}{more}");
    }
    let mut out = std::io::stdout().lock();
    if a.json {
        let text = serde_json::to_string_pretty(&report).unwrap_or_default();
        writeln!(out, "{text}")?;
    } else {
        out.write_all(report.to_text().as_bytes())?;
    }
    Ok(())
}
