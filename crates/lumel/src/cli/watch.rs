//! `lumel watch`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use lumel::view::{Status, Viewer};
use lumel::{Error, ProbeSource, Quality, SkySource};

use super::args::Bake;
use super::bake::{self, Done};
use super::config::Layered;
use super::saves::{LOOK, Saves, listing};
use super::view::Serve;
use super::{Failure, interrupt};

/// Options of `lumel watch`: those of `lumel bake` and of the page.
#[derive(Debug, Args)]
pub(crate) struct Watch {
    /// The level, .gltf or .glb
    pub scene: PathBuf,
    #[command(flatten)]
    pub bake: Bake,
    #[command(flatten)]
    pub serve: Serve,
}

/// Bakes on every save until Ctrl-C, which is a success.
pub(crate) fn run(command: &Watch) -> Result<(), Failure> {
    let a = command.bake.of(&command.scene);
    refuse(&a)?;
    bake::use_threads(a.threads)?;
    interrupt::under_control(Some(a.output.clone()), || {
        let mut session = Session {
            a: &a,
            serve: &command.serve,
            saves: Saves::default(),
            page: None,
        };
        session.run()
    })
}

/// Refuses options that only make sense for a single bake.
fn refuse(a: &Bake) -> Result<(), Error> {
    let options = [
        ("--dry-run", a.dry_run),
        ("--skip-if-unchanged", a.skip_if_unchanged),
        ("--only", !a.only.is_empty()),
        ("--depfile", a.depfile.is_some()),
        ("--json", a.json),
    ];
    match options.iter().find(|(_, given)| *given) {
        Some((option, _)) => Err(Error::Setting(format!(
            "{option} is for single bakes: leave it out of lumel watch"
        ))),
        None => Ok(()),
    }
}

struct Session<'a> {
    a: &'a Bake,
    serve: &'a Serve,
    saves: Saves,
    /// The viewer's server, once there is a bake to show.
    page: Option<Arc<Viewer>>,
}

impl Session<'_> {
    fn run(&mut self) -> Result<(), Failure> {
        let a = self.a;
        let folder = folder_of(&a.scene);
        let place = a.config.place(&a.scene);
        self.saves.note([a.scene.clone()].into_iter().chain(place));
        while self.saves.settle(interrupt::cancelled) {
            self.saves.note(self.saves.paths());
            let before = listing(folder);
            let outcome = self.bake();
            if interrupt::cancelled() {
                break;
            }
            let mended = || listing(folder) != before;
            match outcome {
                Ok(()) => {
                    self.show("", false);
                    self.say("up to date; waiting for the next save, press Ctrl-C to stop");
                    self.wait(|| false);
                }
                Err(Failure::Lumel(Error::Cancelled)) => self.say("saved again: starting over"),
                Err(failure) => {
                    failure.tell();
                    if let Failure::Lumel(e) = &failure {
                        self.show(&super::lines(&e.to_string()), true);
                    }
                    self.say("keeping the last good bake; waiting for the next save");
                    self.wait(mended);
                }
            }
        }
        Ok(())
    }

    /// Bakes the level as it is now, first as a draft and then as requested.
    fn bake(&mut self) -> Result<(), Failure> {
        let asked = settings(self.a)?;
        self.saves.note(files_of_settings(&asked));
        if self.is_current(&asked) {
            return self.open_page();
        }
        if let Some(coarse) = coarse(self.a)? {
            self.show("baking a draft", false);
            self.one(&coarse)?;
        }
        self.show(&format!("baking: {}", self.a.scene.display()), false);
        self.one(&asked)
    }

    /// Whether the folder already holds the results.
    fn is_current(&mut self, asked: &Layered) -> bool {
        let Layered {
            settings,
            provenance,
            ..
        } = asked;
        let (a, preview) = (self.a, self.a.preview.as_deref());
        let found = lumel::find_current(&a.scene, settings, provenance, &a.output, preview);
        let current = found.map(|current| self.saves.note(current.inputs));
        current.is_ok()
    }

    /// Runs one bake, which is cancelled when an input is saved again.
    fn one(&mut self, layered: &Layered) -> Result<(), Failure> {
        let (stop, over) = (AtomicBool::new(false), AtomicBool::new(false));
        let mut saves = self.saves.clone();
        let outcome = std::thread::scope(|scope| {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) && !stop.load(Ordering::Relaxed) {
                    stop.fetch_or(saves.changed(), Ordering::Relaxed);
                    std::thread::sleep(LOOK);
                }
            });
            let outcome = bake::one_until(self.a, layered, &stop);
            over.store(true, Ordering::Relaxed);
            outcome
        });
        if let Done::Baked(files, _) = outcome? {
            self.saves.note_read(&files.read);
        }
        self.open_page()
    }

    /// Starts the viewer's server, unless it runs already.
    fn open_page(&mut self) -> Result<(), Failure> {
        if self.page.is_some() {
            return Ok(());
        }
        let stem = self
            .a
            .scene
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy();
        let manifest = self.a.output.join(format!("{stem}.lightmap.json"));
        let page = Arc::new(self.serve.start(&manifest)?);
        self.page = Some(page.clone());
        std::thread::spawn(move || page.serve());
        Ok(())
    }

    /// Waits until an input changes, `or` is true, or the user presses Ctrl-C.
    fn wait(&mut self, or: impl Fn() -> bool) {
        while !interrupt::cancelled() && !self.saves.changed() && !or() {
            std::thread::sleep(LOOK);
        }
    }

    /// Shows a status on the page; an empty `text` removes it.
    fn show(&self, text: &str, fault: bool) {
        if let Some(page) = &self.page {
            let text = text.to_owned();
            page.set_status((!text.is_empty()).then_some(Status { text, fault }));
        }
    }

    fn say(&self, text: &str) {
        if !self.a.quiet {
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    }
}

/// The folder of a scene.
fn folder_of(scene: &Path) -> &Path {
    let parent = scene.parent();
    let named = parent.filter(|p| !p.as_os_str().is_empty());
    named.unwrap_or(Path::new("."))
}

/// The current settings. Warnings are printed but never end a watch, so `strict` is off.
fn settings(a: &Bake) -> Result<Layered, Error> {
    let mut layered = a.settings()?;
    layered.strict = false;
    Ok(layered)
}

/// Files that settings name. The scene's own inputs are only known once it was read.
fn files_of_settings(layered: &Layered) -> Vec<PathBuf> {
    let settings = &layered.settings;
    let mut all = Vec::new();
    if let SkySource::File(path) = &settings.sky {
        all.push(path.clone());
    }
    if let Some(ProbeSource::File(path)) = &settings.probes {
        all.push(path.clone());
    }
    all
}

/// Settings of the draft; `None` if the user asked for a draft.
fn coarse(a: &Bake) -> Result<Option<Layered>, Error> {
    let mut layered = settings(a)?;
    let settings = &mut layered.settings;
    if settings.quality == Quality::Draft && settings.error.is_none() {
        return Ok(None);
    }
    settings.quality = Quality::Draft;
    settings.error = None;
    Ok(Some(layered))
}
