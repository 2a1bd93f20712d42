//! Figures of a run: what steps cost, round trips, silences; the report says of timing what follows from
//! them.

use hopbench::simulation::report::{LinkReport, Timing};

use crate::bench::pace::{Distribution, TimeBalance, now_ns};
use crate::bench::run::Run;
use crate::wire::profile::Pacing;

/// What the run is measured by.
#[derive(Debug)]
pub(super) struct Figures {
    start_ns: u64,
    step_cost: Distribution,
    /// From a wake-up to the next sleep.
    cycle_cost: Distribution,
    round_trip: Distribution,
    echo: Distribution,
    steps: u64,
    samples: Samples,
    silences: Silences,
}

/// The samples of the last second: when they left, and which were answered.
#[derive(Debug)]
struct Samples {
    /// By the millisecond of their time within the second, which is what the echo channel holds.
    sent: Vec<SentSample>,
    /// No controls have come since the last.
    unanswered: bool,
    /// What the echo channel held last; a channel that never changes is no echo.
    last_echo_ms: Option<u64>,
    /// Time of the newest sample echoed (us).
    echoed_us: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct SentSample {
    time_us: u64,
    left_ns: u64,
    answered: bool,
}

/// Between two HIL_ACTUATOR_CONTROLS.
#[derive(Debug, Default)]
struct Silences {
    last_ns: Option<u64>,
    frames: u64,
    longest_ns: u64,
    gaps: u64,
}

impl Figures {
    pub(super) fn begin() -> Self {
        Self {
            start_ns: now_ns(),
            step_cost: Distribution::new(),
            cycle_cost: Distribution::new(),
            round_trip: Distribution::new(),
            echo: Distribution::new(),
            steps: 0,
            samples: Samples {
                sent: vec![SentSample::default(); 1000],
                unanswered: false,
                last_echo_ms: None,
                echoed_us: 0,
            },
            silences: Silences::default(),
        }
    }

    /// A step of the plant was made, begun at `start_ns`.
    pub(super) fn note_step(&mut self, start_ns: u64) {
        self.step_cost.record_ns(now_ns() - start_ns);
        self.steps += 1;
    }

    /// All between a wake-up at `start_ns` and the next sleep is done.
    pub(super) fn note_cycle(&mut self, start_ns: u64) {
        self.cycle_cost.record_ns(now_ns() - start_ns);
    }

    /// The sample of this time on the wire has left.
    pub(super) fn note_sent(&mut self, time_us: u64) {
        let sent = SentSample { time_us, left_ns: now_ns(), answered: false };
        self.samples.sent[(time_us / 1000) as usize % 1000] = sent;
        self.samples.unanswered = true;
    }

    /// Whether an answer may come any moment.
    pub(super) fn awaits_answer(&self) -> bool {
        self.samples.unanswered
    }

    /// HIL_ACTUATOR_CONTROLS has come: `time_us` is its time stamp, `echo_ms` what its echo channel holds. A
    /// silence longer than `gap_ns` before it is a gap.
    pub(super) fn note_controls(&mut self, time_us: u64, echo_ms: Option<u64>, gap_ns: u64) {
        let now_ns = now_ns();
        self.silences.end(now_ns, gap_ns);
        let samples = &mut self.samples;
        samples.unanswered = false;
        let sample = &mut samples.sent[(time_us / 1000) as usize % 1000];
        // A second answer to the same sample is none.
        if sample.time_us == time_us && time_us > 0 && !sample.answered {
            sample.answered = true;
            self.round_trip.record_ns(now_ns - sample.left_ns);
        }
        let changed = samples.last_echo_ms.is_some_and(|last| echo_ms.is_some_and(|ms| ms != last));
        samples.last_echo_ms = echo_ms;
        if let (true, Some(ms)) = (changed, echo_ms) {
            let sample = samples.sent[ms as usize];
            if sample.time_us > samples.echoed_us {
                samples.echoed_us = sample.time_us;
                self.echo.record_ns(now_ns - sample.left_ns);
            }
        }
    }

    /// The run ends: its last silence too. `gap_ns`: a silence longer than that is a gap.
    pub(super) fn close(&mut self, gap_ns: u64) {
        if self.silences.frames > 0 {
            self.silences.end(now_ns(), gap_ns);
        }
    }

    /// Adds the silences of the flight controller to the report of its link.
    pub(super) fn report_gaps(&self, link: &mut LinkReport) {
        link.gaps = self.silences.gaps;
        link.longest_gap_ms = (self.silences.frames > 1).then_some(self.silences.longest_ns as f64 * 1e-6);
    }

    pub(super) fn timing(&self, run: &Run) -> Timing {
        let wall_s = (now_ns() - self.start_ns) as f64 * 1e-9;
        // Of all flights of the process, as are the steps.
        let simulated_s = self.steps as f64 * run.flight.step_s();
        let overruns = run.clock.overruns();
        let fast = run.options.fast && run.options.pacing == Pacing::Lockstep;
        let paced = |distribution: &Distribution| if fast { None } else { distribution.percentiles() };
        let balance = run.clock.balance().filter(|_| !fast);
        let pacing = match run.options.pacing {
            Pacing::Lockstep if fast => "fast",
            Pacing::Lockstep => "lockstep",
            Pacing::RealTime => "realtime",
        };
        Timing {
            plant_mode: run.scenario.file.fidelity,
            plant_hz: 1.0 / run.flight.step_s(),
            pacing: Some(pacing.to_owned()),
            simulated_s,
            wall_s,
            realtime_factor: if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 },
            steps: self.steps,
            overruns: overruns.count,
            overruns_caught_up: overruns.caught_up,
            overruns_slipped: overruns.slipped,
            overruns_open: overruns.count - overruns.caught_up - overruns.slipped,
            worst_overruns: overruns.worst.clone(),
            slips: overruns.slips,
            slipped_s: overruns.slipped_ns as f64 * 1e-9,
            unaccounted_us: balance.map(|balance: TimeBalance| balance.unaccounted_ns() as f64 * 1e-3),
            step_budget_us: run.step_us() as f64,
            step_us: self.step_cost.percentiles(),
            cycle_us: paced(&self.cycle_cost),
            lateness_us: paced(run.clock.lateness()),
            round_trip_us: self.round_trip.percentiles(),
            echo_us: self.echo.percentiles(),
            // The rest is its owner's to fill in: what was asked of the kernel and what ran beside the bench.
            ..Timing::default()
        }
    }
}

impl Silences {
    fn end(&mut self, now_ns: u64, gap_ns: u64) {
        let silent_ns = self.last_ns.replace(now_ns).map_or(0, |last_ns| now_ns - last_ns);
        self.frames += 1;
        self.longest_ns = self.longest_ns.max(silent_ns);
        self.gaps += u64::from(silent_ns > gap_ns);
    }
}
