//! Progress of a whole bake across its phases.

use lumel::{Phase, Quality, Settings};

/// Parts of a bake with separate weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Stage {
    Plan,
    Light,
    Gather,
    Refine,
    Finish,
}

const STAGES: usize = 5;

/// Share of the gather spent in its first pass; the second fills in interpolated lumels.
const FIRST_PASS: f64 = 0.93;

/// Refined lumels as a share of gathered ones. The stage grows if a bake refines more.
const REFINED: f64 = 0.4;

/// Share of the gather after which the remaining time is shown.
const TELL_FROM: f64 = 0.05;

impl Stage {
    fn of(phase: Phase) -> Stage {
        match phase {
            Phase::Ingest | Phase::Atlas | Phase::Tree => Stage::Plan,
            Phase::Direct | Phase::Links | Phase::Solve | Phase::Picture => Stage::Light,
            Phase::Lumels | Phase::Gather => Stage::Gather,
            Phase::Refine => Stage::Refine,
            _ => Stage::Finish,
        }
    }
}

/// Combines the progress of all phases into one fraction that never decreases.
#[derive(Debug)]
pub(super) struct Course {
    /// Expected time of each stage, percent of the gather's.
    weights: [f64; STAGES],
    stage: Stage,
    /// Progress within the stage, 0..=1.
    within: f64,
    /// Work units of the stage's finished passes and of the current pass: done, total.
    finished: f64,
    pass: (f64, f64),
    passes: u32,
    /// Work units of the gather.
    gathered: f64,
    share: f64,
    /// When the gather began, in seconds, and the share of the bake before it.
    gather_began: Option<(f64, f64)>,
}

impl Course {
    /// Weights are times measured on bakes of the Cornell box, the demo level and godot_room at
    /// draft and preview (November 2026). They need not be accurate: each stage is corrected as it
    /// runs.
    pub(super) fn new(settings: &Settings) -> Course {
        let mut weights = match settings.quality {
            Quality::Draft => [10.0, 35.0, 100.0, 30.0, 20.0],
            Quality::Quick => [5.0, 25.0, 100.0, 40.0, 12.0],
            _ => [2.0, 20.0, 100.0, 60.0, 10.0],
        };
        if settings.error.is_some() {
            weights[Stage::Refine as usize] = 200.0;
        }
        if settings.probes.is_some() {
            weights[Stage::Finish as usize] += 20.0;
        }
        Course {
            weights,
            stage: Stage::Plan,
            within: 0.0,
            finished: 0.0,
            pass: (0.0, 0.0),
            passes: 0,
            gathered: 0.0,
            share: 0.0,
            gather_began: None,
        }
    }

    /// Fraction of the bake done, 0..=1, after `done` of `total` work units of a phase.
    pub(super) fn see(&mut self, phase: Phase, done: u64, total: u64) -> f64 {
        let stage = Stage::of(phase);
        if stage < self.stage {
            // Threads may report an earlier phase late.
            return self.share;
        }
        if stage > self.stage {
            self.enter(stage);
        }
        if total > 0 {
            self.count(done as f64, total as f64);
        }
        let before: f64 = self.weights[..stage as usize].iter().sum();
        let now = before + self.within * self.weights[stage as usize];
        self.share = self.share.max(now / self.total());
        self.share
    }

    /// Expected seconds to go, `now` seconds after the start of the bake. `None` until a twentieth
    /// of the gather is done: how long a level takes before the gather says nothing about the rest
    /// (from 2 to 30 % of a bake), so the gather's own pace counts.
    pub(super) fn left(&mut self, now: f64) -> Option<f64> {
        if self.stage < Stage::Gather {
            return None;
        }
        let (began, before) = *self.gather_began.get_or_insert((now, self.share));
        let done = self.share - before;
        let of_gather = done * self.total() / self.weights[Stage::Gather as usize];
        (of_gather >= TELL_FROM).then(|| (now - began) * (1.0 - self.share) / done)
    }

    fn total(&self) -> f64 {
        self.weights.iter().sum()
    }

    fn enter(&mut self, stage: Stage) {
        if self.stage == Stage::Gather {
            self.gathered = self.finished + self.pass.1;
        }
        self.stage = stage;
        self.within = 0.0;
        self.finished = 0.0;
        self.pass = (0.0, 0.0);
        self.passes = 0;
    }

    fn count(&mut self, done: f64, total: f64) {
        if total != self.pass.1 || done < self.pass.0 {
            self.finished += self.pass.1;
            self.passes += 1;
        }
        self.pass = (done, total);
        let share = done / total;
        let within = match self.stage {
            Stage::Gather if self.passes == 1 => FIRST_PASS * share,
            Stage::Gather => FIRST_PASS + (1.0 - FIRST_PASS) * share,
            Stage::Refine => {
                let known = self.finished + total;
                (self.finished + done) / known.max(REFINED * self.gathered)
            }
            // The number of passes is unknown, so each pass gets half of what is left.
            _ => 1.0 - 0.5_f64.powi(self.passes as i32 - 1) * (1.0 - 0.5 * share),
        };
        self.within = self.within.max(within.min(1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Phase, its units of work, start and end.
    type Event = (Phase, u64, f64, f64);

    /// Phases as a preview of the Cornell box reported them, with their start and end times in
    /// seconds.
    const CORNELL: &[Event] = &[
        (Phase::Direct, 20_000, 0.2, 1.6),
        (Phase::Links, 248_288, 1.7, 2.39),
        (Phase::Links, 744_864, 2.42, 2.79),
        (Phase::Gather, 67_180, 3.34, 10.68),
        (Phase::Gather, 125_826, 10.73, 14.04),
        (Phase::Refine, 4_030, 14.07, 14.92),
        (Phase::Refine, 1_181, 14.94, 15.13),
        (Phase::Refine, 50_286, 15.27, 19.30),
        (Phase::Vertices, 900, 20.0, 20.4),
    ];

    /// As [`CORNELL`], for godot_room, whose second gather pass is short.
    const ROOM: &[Event] = &[
        (Phase::Links, 1_009_872, 1.6, 2.3),
        (Phase::Gather, 192_254, 2.86, 30.03),
        (Phase::Gather, 30_303, 30.06, 30.14),
        (Phase::Refine, 960, 30.2, 31.6),
        (Phase::Refine, 172_836, 31.8, 59.92),
        (Phase::Vertices, 2_571, 64.78, 65.44),
    ];

    /// As [`CORNELL`], for the demo level, whose sheets with two sides are solved for twice.
    const DEMO_DRAFT: &[Event] = &[
        (Phase::Direct, 28_694, 0.25, 0.89),
        (Phase::Links, 459_104, 0.94, 1.11),
        (Phase::Direct, 28_771, 1.45, 2.09),
        (Phase::Links, 460_336, 2.13, 2.30),
        (Phase::Gather, 84_767, 2.72, 5.86),
        (Phase::Gather, 130_344, 5.87, 6.30),
        (Phase::Gather, 13_086, 6.30, 6.68),
        (Phase::Refine, 36_473, 6.77, 7.58),
        (Phase::Vertices, 1_696, 8.31, 8.35),
    ];
    const DEMO_QUICK: &[Event] = &[
        (Phase::Direct, 28_694, 0.30, 0.92),
        (Phase::Links, 459_104, 0.97, 1.14),
        (Phase::Direct, 28_771, 1.60, 2.23),
        (Phase::Links, 460_336, 2.28, 2.45),
        (Phase::Gather, 84_767, 2.98, 9.10),
        (Phase::Gather, 129_964, 9.11, 9.77),
        (Phase::Gather, 13_466, 9.78, 10.55),
        (Phase::Refine, 28_171, 10.57, 12.23),
        (Phase::Refine, 37_817, 12.32, 14.04),
        (Phase::Vertices, 1_792, 14.78, 14.90),
    ];

    /// With the least share at which each of them must end. The draft's ends lower, because
    /// stitching, of which nothing is told, takes a tenth of it.
    const BAKES: [(&[Event], Quality, f64); 4] = [
        (CORNELL, Quality::Preview, 0.9),
        (ROOM, Quality::Preview, 0.9),
        (DEMO_DRAFT, Quality::Draft, 0.8),
        (DEMO_QUICK, Quality::Quick, 0.9),
    ];

    /// Time, fraction, and seconds to go after each tenth of each phase.
    fn follow(events: &[Event], quality: Quality) -> Vec<(f64, f64, Option<f64>)> {
        let mut course = Course::new(&Settings {
            quality,
            ..Settings::default()
        });
        let mut out = Vec::new();
        for &(phase, total, from, to) in events {
            course.see(phase, 0, 0);
            course.left(from);
            for step in 1..=10 {
                let time = from + (to - from) * step as f64 / 10.0;
                let share = course.see(phase, total * step / 10, total);
                out.push((time, share, course.left(time)));
            }
        }
        out
    }

    #[test]
    fn it_never_falls_and_ends_near_the_end() {
        for (events, quality, least) in BAKES {
            let course = follow(events, quality);
            assert!(course.windows(2).all(|w| w[0].1 <= w[1].1), "{course:?}");
            let last = course.last().map_or(0.0, |c| c.1);
            assert!((least..=1.0).contains(&last), "{last}");
        }
    }

    #[test]
    fn time_to_go_does_not_jump_back_by_more_than_a_fifth() {
        for (events, quality, _) in BAKES {
            let shown: Vec<(f64, f64)> = (follow(events, quality).into_iter())
                .filter_map(|(t, _, left)| Some((t, left?)))
                .collect();
            assert!(shown.len() > 20, "{shown:?}");
            let mut least = f64::INFINITY;
            for (t, left) in shown {
                assert!(left <= 1.2 * least + 0.5, "{left} after {least} at {t}");
                least = least.min(left);
            }
        }
    }

    #[test]
    fn a_late_report_of_an_old_phase_changes_nothing() {
        let mut course = Course::new(&Settings::default());
        let half = course.see(Phase::Gather, 50, 100);
        assert_eq!(course.see(Phase::Links, 1, 100), half);
    }
}
