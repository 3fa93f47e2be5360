//! Time that work takes, without that of other programs.

use std::time::Instant;

use rayon::current_num_threads;

/// Times work of the current rayon pool by the processor time of this process. By wall time, a
/// machine with other work seems slow: with a tenth of it, estimates were ten times too long.
#[derive(Debug, Clone, Copy)]
pub struct WorkTime {
    start: Instant,
    used: Option<f64>,
}

impl WorkTime {
    /// Starts now.
    #[must_use]
    pub fn start() -> WorkTime {
        WorkTime {
            start: Instant::now(),
            used: processor_seconds(),
        }
    }

    /// Seconds that the work so far takes on an otherwise idle machine if it keeps all threads
    /// busy. At most the seconds that have passed.
    pub fn parallel(&self) -> f64 {
        self.shared_by(current_num_threads())
    }

    /// As [`WorkTime::parallel`], if the work keeps one thread busy.
    pub fn serial(&self) -> f64 {
        self.shared_by(1)
    }

    fn shared_by(&self, threads: usize) -> f64 {
        let passed = self.start.elapsed().as_secs_f64();
        match (self.used, processor_seconds()) {
            (Some(before), Some(now)) => passed.min((now - before) / threads.max(1) as f64),
            _ => passed,
        }
    }
}

/// Processor time of all threads of this process; `None` where the system does not tell, or, as
/// Windows, only in steps of 16 ms.
pub fn processor_seconds() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
    }
    #[cfg(not(unix))]
    None
}
