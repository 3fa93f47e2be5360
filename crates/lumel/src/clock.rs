//! Wall time of a bake by phase.

use std::time::Instant;

use radiosity::{Monitor, Phase};

use crate::error::Error;
use crate::report::PhaseTime;

/// Wall time by phase.
#[derive(Debug, Clone)]
pub(crate) struct Clock {
    pub start: Instant,
    pub last: Instant,
    pub phases: Vec<PhaseTime>,
}

impl Clock {
    pub(crate) fn new() -> Self {
        let now = Instant::now();
        Clock {
            start: now,
            last: now,
            phases: Vec::new(),
        }
    }

    pub(crate) fn lap(&mut self, phase: Phase) {
        let now = Instant::now();
        self.phases.push(PhaseTime {
            phase: phase.name(),
            seconds: (now - self.last).as_secs_f64(),
        });
        self.last = now;
    }
}

/// Begins a phase: reports it to the monitor, and stops if the monitor asks to.
pub(crate) fn begin(monitor: &dyn Monitor, phase: Phase) -> Result<(), Error> {
    monitor.progress(phase, 0, 0);
    if monitor.cancelled() {
        return Err(Error::Cancelled);
    }
    Ok(())
}
