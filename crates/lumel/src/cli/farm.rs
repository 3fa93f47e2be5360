//! `lumel solve`, `lumel gather` and `lumel merge`: a bake on many machines.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::{Args, Parser};
use lumel::{Beside, Error, Order, ProbeSource, Remark, ShardOf, SkySource, Told, WorkFolder};

use super::Failure;
use super::args::{Arguments, Bake, Command, ProgressArg};
use super::bake;
use super::config::Layered;
use super::interrupt;
use super::progress::Display;

#[derive(Debug, Args)]
pub(crate) struct Solve {
    /// The level, .gltf or .glb
    pub scene: PathBuf,
    #[command(flatten)]
    pub bake: Bake,
}

/// How a command runs and shows its progress.
#[derive(Debug, Args)]
pub(crate) struct Run {
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// How to show progress on standard error
    #[arg(long, value_enum, default_value = "auto")]
    pub progress: ProgressArg,
    /// Print errors only
    #[arg(short, long)]
    pub quiet: bool,
    /// Print details
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Gather {
    /// The folder that `lumel solve` wrote
    pub work: PathBuf,
    /// The shard to gather, and the number of shards, e.g. 3/8; an existing shard is kept
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    pub shard: ShardOf,
    #[command(flatten)]
    pub run: Run,
}

#[derive(Debug, Args)]
pub(crate) struct Merge {
    /// The folder that `lumel solve` wrote
    pub work: PathBuf,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Render the lit level to a picture, from its first camera if it has one
    #[arg(long, value_name = "FILE.png")]
    pub preview: Option<PathBuf>,
    /// Also write the report to this file
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Print the report to standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub run: Run,
}

/// Most shards of a bake.
const MOST: u32 = 100_000;

/// Parses I/N.
fn parse_shard(text: &str) -> Result<ShardOf, String> {
    let parsed = text.split_once('/').and_then(|(number, of)| {
        let (number, of) = (number.trim().parse().ok()?, of.trim().parse().ok()?);
        Some(ShardOf { number, of })
    });
    parsed
        .filter(|s| (1..=s.of).contains(&s.number) && s.of <= MOST)
        .ok_or_else(|| format!("expected I/N with I from 1 to N, and N at most {MOST}, e.g. 3/8"))
}

/// The `lumel solve` command of a work folder, and its settings.
struct Solved {
    bake: Bake,
    layered: Layered,
}

impl Solved {
    /// Parses the command that a work folder records. Its paths are relative to the folder in which
    /// it ran.
    fn of(told: &Told) -> Result<Solved, Failure> {
        let words = ["lumel", "solve"].map(str::to_owned);
        let words = words.into_iter().chain(told.arguments.iter().cloned());
        let command = Arguments::try_parse_from(words).map(|a| a.command);
        let Ok(Command::Solve(a)) = command else {
            let message = "the work folder has a command that is not `lumel solve`";
            return Err(Error::Setting(message.into()).into());
        };
        let base = Path::new(&told.folder);
        let mut bake = a.bake.of(&base.join(&a.scene));
        bake.config.config = bake.config.config.map(|path| base.join(path));
        bake.output = base.join(&bake.output);
        let mut layered = bake.settings()?;
        let settings = &mut layered.settings;
        if let SkySource::File(path) = &mut settings.sky {
            *path = base.join(&path);
        }
        if let Some(ProbeSource::File(path)) = &mut settings.probes {
            *path = base.join(&path);
        }
        Ok(Solved { bake, layered })
    }

    fn order(&self) -> Order<'_> {
        Order {
            scene: &self.bake.scene,
            settings: &self.layered.settings,
            provenance: &self.layered.provenance,
        }
    }

    /// Takes over this command's display options.
    fn run_as(&mut self, run: &Run) {
        self.bake.quiet = run.quiet;
        self.bake.verbose = run.verbose;
        self.bake.progress = run.progress;
    }
}

/// This command, recorded for other processes.
fn told() -> Result<Told, Error> {
    let setting = |message: &str| Error::Setting(message.into());
    let folder = std::env::current_dir().ok();
    let folder = folder.and_then(|path| path.into_os_string().into_string().ok());
    let folder = folder.ok_or_else(|| setting("the current folder has no name in UTF-8"))?;
    let arguments: Result<Vec<String>, _> = std::env::args_os()
        .skip(2)
        .map(|a| a.into_string())
        .collect();
    let arguments = arguments.map_err(|_| {
        setting(
            "found an argument that is not UTF-8, expected UTF-8, because other machines read it",
        )
    })?;
    Ok(Told { folder, arguments })
}

/// Refuses options about results, because `lumel merge` writes those.
fn refuse_results(a: &Bake) -> Result<(), Error> {
    let options = [
        ("--preview", a.preview.is_some()),
        ("--first-picture", a.first_picture.is_some()),
        ("--report", a.report.is_some()),
        ("--depfile", a.depfile.is_some()),
        ("--dry-run", a.dry_run),
        ("--skip-if-unchanged", a.skip_if_unchanged),
        ("--only", !a.only.is_empty()),
        ("--json", a.json),
        ("--cache", a.cache.is_some()),
    ];
    match options.iter().find(|(_, given)| *given) {
        Some((option, _)) => Err(Error::Setting(format!(
            "{option} is not for `lumel solve`, which writes no results: leave it out"
        ))),
        None => Ok(()),
    }
}

/// `lumel solve`.
pub(crate) fn solve(a: &Solve) -> Result<(), Failure> {
    refuse_results(&a.bake)?;
    bake::use_threads(a.bake.threads)?;
    let told = told()?;
    let solved = Solved::of(&told)?;
    interrupt::under_control(Some(solved.bake.output.clone()), || {
        let (bake, stop) = (&solved.bake, AtomicBool::new(false));
        let display = Display::new(bake, &solved.layered.settings, &stop);
        let tell = |remark: Remark<'_>| match remark {
            Remark::Note(note) => display.say(&format!("note: {note}")),
            Remark::Warning(warning) => display.warn(warning),
        };
        let beside = Beside {
            in_turn: bake.in_turn,
            tell: Some(&tell),
            ..Beside::default()
        };
        let done = lumel::solve(solved.order(), told, &bake.output, &beside, &display);
        display.finish();
        let done = done?;
        display.say(&format!(
            "solved {} patches, {} lumels to gather: {}",
            done.patches,
            done.lumels,
            bake.output.display()
        ));
        Ok(())
    })
}

/// `lumel gather`.
pub(crate) fn gather(a: &Gather) -> Result<(), Failure> {
    bake::use_threads(a.run.threads)?;
    let work = WorkFolder::open(&a.work)?;
    let mut solved = Solved::of(work.told())?;
    solved.run_as(&a.run);
    interrupt::under_control(None, || {
        let stop = AtomicBool::new(false);
        let display = Display::new(&solved.bake, &solved.layered.settings, &stop);
        let beside = Beside::default();
        let done = lumel::gather_work(solved.order(), &work, a.shard, &beside, &display);
        display.finish();
        let done = done?;
        let ShardOf { number, of } = a.shard;
        display.say(&match done.bytes {
            0 => format!("shard {number}/{of} exists already"),
            bytes => format!(
                "gathered shard {number}/{of}: {} lumels, {} KiB",
                done.lumels,
                bytes.div_ceil(1024)
            ),
        });
        Ok(())
    })
}

/// `lumel merge`.
pub(crate) fn merge(a: &Merge) -> Result<(), Failure> {
    bake::use_threads(a.run.threads)?;
    let work = WorkFolder::open(&a.work)?;
    let mut solved = Solved::of(work.told())?;
    solved.run_as(&a.run);
    let bake = Bake {
        output: a.output.clone(),
        preview: a.preview.clone(),
        report: a.report.clone(),
        json: a.json,
        ..solved.bake
    };
    interrupt::under_control(Some(a.output.clone()), || {
        bake::merge(&bake, &solved.layered, &work).map(drop)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_numbered_from_1() {
        assert_eq!(parse_shard("3/8"), Ok(ShardOf { number: 3, of: 8 }));
        for bad in ["0/8", "9/8", "8", "a/8", "1/0", "-1/8", "1/1000000"] {
            assert!(parse_shard(bad).is_err(), "{bad}");
        }
    }
}
