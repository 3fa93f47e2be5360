//! Progress: a bar on a terminal, a line per step elsewhere.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};
use lumel::{Monitor, Phase};

use super::interrupt;

/// Shows where a bake is.
pub(crate) struct Display {
    quiet: bool,
    bar: Option<ProgressBar>,
    state: Mutex<State>,
}

struct State {
    phase: Option<Phase>,
    since: Instant,
    residual: Option<f64>,
    /// Warnings that were told before the end.
    warned: Vec<String>,
}

impl Display {
    /// `quiet` shows nothing.
    pub(crate) fn new(quiet: bool) -> Self {
        let terminal = !quiet && std::io::stderr().is_terminal();
        Display {
            quiet,
            bar: terminal.then(|| {
                let bar = ProgressBar::new(0);
                bar.set_style(style());
                bar
            }),
            state: Mutex::new(State {
                phase: None,
                since: Instant::now(),
                residual: None,
                warned: Vec::new(),
            }),
        }
    }

    /// Says a line that stays.
    pub(crate) fn say(&self, line: &str) {
        if self.quiet {
            return;
        }
        let line = super::line(line);
        match &self.bar {
            Some(bar) => bar.suspend(|| {
                let _ = writeln!(std::io::stderr(), "{line}");
            }),
            None => {
                let _ = writeln!(std::io::stderr(), "{line}");
            }
        }
    }

    /// Says a warning, once.
    pub(crate) fn warn(&self, text: &str) {
        let Ok(mut s) = self.state.lock() else { return };
        if s.warned.iter().any(|w| w == text) {
            return;
        }
        s.warned.push(text.into());
        drop(s);
        self.say(&format!("warning: {text}"));
    }

    /// Ends the last phase.
    pub(crate) fn finish(&self) {
        self.enter(None);
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn enter(&self, phase: Option<Phase>) {
        let Ok(mut s) = self.state.lock() else { return };
        if s.phase == phase {
            return;
        }
        // Work of several threads may report an old phase once more; only the solve goes back and forth.
        let line = s.phase.map(|old| {
            let residual = s
                .residual
                .take()
                .map(|r| format!(", residual {r:.1e}"))
                .unwrap_or_default();
            format!(
                "  {:<9} {:6.2} s{residual}",
                old.name(),
                s.since.elapsed().as_secs_f64()
            )
        });
        s.phase = phase;
        s.since = Instant::now();
        drop(s);
        if let Some(line) = line {
            self.say(&line);
        }
        if let (Some(bar), Some(phase)) = (&self.bar, phase) {
            bar.reset();
            bar.set_length(0);
            bar.set_message(phase.name());
        }
    }
}

/// Phase, bar, share done, time to go, and the residual while solving.
fn style() -> ProgressStyle {
    ProgressStyle::with_template("  {msg:<24} [{bar:32}] {percent:>3} %  eta {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("=> ")
}

impl Monitor for Display {
    fn progress(&self, phase: Phase, done: u64, total: u64) {
        if self.quiet {
            return;
        }
        let current = self.state.lock().ok().and_then(|s| s.phase);
        if current != Some(phase) {
            self.enter(Some(phase));
        }
        if let Some(bar) = &self.bar {
            bar.set_length(total);
            bar.set_position(done);
        }
    }

    fn residual(&self, residual: f64) {
        if self.quiet {
            return;
        }
        if let Ok(mut s) = self.state.lock() {
            s.residual = Some(residual);
        }
        if let Some(bar) = &self.bar {
            bar.set_message(format!("solve, residual {residual:.1e}"));
        }
    }

    fn warning(&self, text: &str) {
        self.warn(text);
    }

    fn cancelled(&self) -> bool {
        interrupt::cancelled()
    }
}
