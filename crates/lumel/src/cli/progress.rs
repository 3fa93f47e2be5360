//! Progress: one bar for the whole bake on a terminal, else a line per phase.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use lumel::{Monitor, Phase, Settings};

use super::args::{Bake, ProgressArg};
use super::course::Course;
use super::interrupt;

/// Interval between lines of progress.
const LINES_EVERY: Duration = Duration::from_millis(250);

/// Length of the bar, tenths of a percent.
const BAR: u64 = 1000;

/// Shows the progress of a bake.
pub(crate) struct Display<'s> {
    /// Another way to cancel the bake, besides Ctrl-C.
    stop: &'s AtomicBool,
    quiet: bool,
    /// Also shows residuals of the solve.
    verbose: bool,
    bar: Option<ProgressBar>,
    /// Prints lines for a program that shows progress itself.
    lines: bool,
    state: Mutex<State>,
}

struct State {
    phase: Option<Phase>,
    since: Instant,
    residual: Option<f64>,
    /// Warnings that were printed during the bake.
    warned: Vec<String>,
    start: Instant,
    course: Course,
    last_line: Option<Instant>,
}

impl State {
    /// The fraction done and, once it can be estimated, the remaining time in words.
    fn see(&mut self, phase: Phase, done: u64, total: u64) -> (f64, Option<String>) {
        let share = self.course.see(phase, done, total);
        let left = self.course.left(self.start.elapsed().as_secs_f64());
        (share, left.map(duration))
    }

    fn line_due(&mut self) -> bool {
        let due = self.last_line.is_none_or(|t| t.elapsed() >= LINES_EVERY);
        if due {
            self.last_line = Some(Instant::now());
        }
        due
    }
}

impl<'s> Display<'s> {
    /// For one bake, which is cancelled once `stop` is set. With `quiet` it shows nothing.
    pub(crate) fn new(a: &Bake, settings: &Settings, stop: &'s AtomicBool) -> Self {
        let (quiet, progress) = (a.quiet, a.progress);
        let lines = !quiet && progress == ProgressArg::Lines;
        let terminal = !quiet && !lines && std::io::stderr().is_terminal();
        Display {
            stop,
            quiet,
            verbose: a.verbose,
            bar: terminal.then(|| {
                let bar = ProgressBar::new(BAR);
                bar.set_style(style());
                bar
            }),
            lines,
            state: Mutex::new(State {
                phase: None,
                since: Instant::now(),
                residual: None,
                warned: Vec::new(),
                start: Instant::now(),
                course: Course::new(settings),
                last_line: None,
            }),
        }
    }

    /// Prints a line that stays on the screen.
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

    /// Prints a warning, unless it was printed before.
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
        // Threads may report an earlier phase late. Only the solve really goes back and forth.
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
    }
}

/// A time with two digits.
pub(super) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => format!("{s:.1} s"),
        // In whole minutes, 100 s would be 2 min: a jump of a fifth.
        s if s < 600.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Style of the bar: the bar and percentage of the whole bake, the phase, the remaining time.
fn style() -> ProgressStyle {
    ProgressStyle::with_template("  [{bar:32}] {percent:>3} %  {msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("=> ")
}

impl Monitor for Display<'_> {
    fn progress(&self, phase: Phase, done: u64, total: u64) {
        if self.quiet {
            return;
        }
        let current = self.state.lock().ok().and_then(|s| s.phase);
        if current != Some(phase) {
            self.enter(Some(phase));
        }
        let Ok(mut s) = self.state.lock() else { return };
        let (share, left) = s.see(phase, done, total);
        let residual = s.residual.map(|r| format!(", residual {r:.1e}"));
        let left = left.map(|l| format!(", {l} left"));
        let due = self.lines && s.line_due();
        let left = left.unwrap_or_default();
        if due {
            self.say(&format!(
                "progress {:.1} % {}{left}",
                100.0 * share,
                phase.name()
            ));
        }
        if let Some(bar) = &self.bar {
            bar.set_position((BAR as f64 * share) as u64);
            bar.set_message(format!(
                "{}{left}{}",
                phase.name(),
                residual.unwrap_or_default()
            ));
        }
        // Unlocked only now: of two threads, the one that saw less must not show it last.
        drop(s);
    }

    fn residual(&self, residual: f64) {
        if !self.verbose {
            return;
        }
        if let Ok(mut s) = self.state.lock() {
            s.residual = Some(residual);
        }
    }

    fn cancelled(&self) -> bool {
        interrupt::cancelled() || self.stop.load(Ordering::Relaxed)
    }
}
