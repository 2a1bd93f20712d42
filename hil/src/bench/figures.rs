//! What a run is measured by, and what its report says of time and link.

use hopbench::simulation::report::{LinkReport, Timing};

use super::Bench;
use crate::bench::pace::{Account, Distribution, now_ns};
use crate::wire::disruption::Sample;
use crate::wire::profile::Pacing;

/// What the run is measured by.
#[derive(Debug)]
pub(super) struct Figures {
    pub(super) start_ns: u64,
    pub(super) step_cost: Distribution,
    /// From a wake-up to the next sleep.
    pub(super) cycle_cost: Distribution,
    round_trip: Distribution,
    echo: Distribution,
    pub(super) steps: u64,
    /// Frames encoded before, taken by the link and thrown away.
    encoded: u64,
    taken: u64,
    dropped: u64,
    samples: Samples,
    silences: Silences,
    pub(super) next_heartbeat_ns: u64,
    pub(super) next_message_ns: u64,
}

/// The samples of the last second: when they left, and which were answered.
#[derive(Debug)]
struct Samples {
    /// By the millisecond of their time within the second, which is what the echo channel holds.
    sent: Vec<Sent>,
    /// No controls have come since the last.
    unanswered: bool,
    /// What the echo channel held last; a channel that never changes is no echo.
    last_echo_ms: Option<u64>,
    /// Time of the newest sample echoed (us).
    echoed_us: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sent {
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
        let now = now_ns();
        Self {
            start_ns: now,
            step_cost: Distribution::new(),
            cycle_cost: Distribution::new(),
            round_trip: Distribution::new(),
            echo: Distribution::new(),
            steps: 0,
            encoded: 0,
            taken: 0,
            dropped: 0,
            samples: Samples {
                sent: vec![Sent::default(); 1000],
                unanswered: false,
                last_echo_ms: None,
                echoed_us: 0,
            },
            silences: Silences::default(),
            next_heartbeat_ns: 0,
            next_message_ns: now + 1_000_000_000,
        }
    }

    /// Whether an answer may come any moment.
    pub(super) fn awaits_answer(&self) -> bool {
        self.samples.unanswered
    }

    /// HIL_ACTUATOR_CONTROLS has come: `time_us` is its time stamp, `echo_ms` what its echo channel holds. A silence longer
    /// than `gap_ns` before it is a gap.
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
}

impl Silences {
    fn end(&mut self, now_ns: u64, gap_ns: u64) {
        let silent_ns = self.last_ns.replace(now_ns).map_or(0, |last_ns| now_ns - last_ns);
        self.frames += 1;
        self.longest_ns = self.longest_ns.max(silent_ns);
        self.gaps += u64::from(silent_ns > gap_ns);
    }
}

impl Bench<'_> {
    /// Sends what waits: through a bad wire, if it is one.
    pub(super) fn flush(&mut self) {
        if self.disruption.is_clear() {
            let sampled = self.flight.measurement().is_some();
            let time_us = self.wire_time().us();
            self.fc.awaited = sampled.then_some(Sample { time_us, lost: false });
            return self.send_straight();
        }
        let now = self.flight.time();
        let bytes = self.streams.bytes();
        let (frames, newest) = self.disruption.carry_to_fc(bytes, now);
        let taken = self.link.send(bytes);
        bytes.clear();
        self.figures.encoded = self.streams.frames();
        *(if taken { &mut self.figures.taken } else { &mut self.figures.dropped }) += frames;
        self.fc.await_answer(newest);
    }

    /// Sends what waits, whatever is broken.
    pub(super) fn send_straight(&mut self) {
        let taken = self.link.send(self.streams.bytes());
        self.streams.bytes().clear();
        let frames = self.streams.frames() - self.figures.encoded;
        self.figures.encoded += frames;
        *(if taken { &mut self.figures.taken } else { &mut self.figures.dropped }) += frames;
    }

    pub(super) fn note_sent(&mut self) {
        let time_us = self.wire_time().us();
        let samples = &mut self.figures.samples;
        samples.sent[(time_us / 1000) as usize % 1000] = Sent { time_us, left_ns: now_ns(), answered: false };
        samples.unanswered = true;
    }

    /// A silence of the flight controller that counts as a gap (ns).
    pub(super) fn gap_ns(&self) -> u64 {
        self.fc_timeout().as_nanos() as u64 / 10
    }

    pub(super) fn finish(mut self) -> (Timing, LinkReport) {
        let now_ns = now_ns();
        if let Some(text) = self.stalls.remaining(now_ns) {
            self.live.notice(text);
        }
        let (stalls, stalled) = self.stalls.report();
        let gap_ns = self.gap_ns();
        if self.figures.silences.frames > 0 {
            self.figures.silences.end(now_ns, gap_ns);
        }
        let figures = &self.figures;
        let wall_s = (now_ns - figures.start_ns) as f64 * 1e-9;
        let timing = self.timing(wall_s);
        let (heard, moved) = (self.decoder.counters(), self.link.counters());
        // From the first sample on; waiting for somebody is no use of the wire.
        let streamed_s = self.clock.tied_ns().map_or(0.0, |tied_ns| (now_ns - tied_ns) as f64 * 1e-9);
        let each_s = |count: u64| if streamed_s > 0.0 { count as f64 / streamed_s } else { 0.0 };
        // Ten symbols to a byte.
        let load = |bytes| self.options.baud.map(|baud| each_s(bytes) * 10.0 / f64::from(baud) * 100.0);
        let link = LinkReport {
            sent: figures.taken,
            dropped: figures.dropped,
            received: heard.frames,
            crc_errors: heard.crc_errors,
            lost: heard.lost,
            duplicates: heard.duplicates,
            out_of_order: heard.out_of_order,
            skipped_bytes: heard.skipped_bytes,
            refused: moved.refused,
            controls_refused: self.fc.rejected,
            controls_old: self.fc.old,
            stalls,
            stalled,
            disrupted: self.disruption.report(),
            gaps: figures.silences.gaps,
            longest_gap_ms: (figures.silences.frames > 1)
                .then_some(figures.silences.longest_ns as f64 * 1e-6),
            sent_bytes: moved.sent_bytes,
            received_bytes: moved.received_bytes,
            rate_out_hz: each_s(figures.taken),
            rate_in_hz: each_s(heard.frames),
            wire_load_percent: load(moved.sent_bytes),
            wire_load_in_percent: load(moved.received_bytes),
        };
        (timing, link)
    }

    fn timing(&self, wall_s: f64) -> Timing {
        // Of all flights of the process, as are the steps.
        let simulated_s = self.figures.steps as f64 * self.flight.step_s();
        let (figures, overruns) = (&self.figures, self.clock.overruns());
        let fast = self.options.fast && self.options.pacing == Pacing::Lockstep;
        let paced = |distribution: &Distribution| if fast { None } else { distribution.percentiles() };
        Timing {
            plant_mode: self.scenario.file.fidelity,
            plant_hz: 1.0 / self.flight.step_s(),
            pacing: Some(
                match self.options.pacing {
                    Pacing::Lockstep if fast => "fast",
                    Pacing::Lockstep => "lockstep",
                    Pacing::RealTime => "realtime",
                }
                .to_owned(),
            ),
            simulated_s,
            wall_s,
            realtime_factor: if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 },
            steps: figures.steps,
            overruns: overruns.count,
            overruns_caught_up: overruns.caught_up,
            overruns_slipped: overruns.slipped,
            overruns_open: overruns.count - overruns.caught_up - overruns.slipped,
            worst_overruns: overruns.worst.clone(),
            slips: overruns.slips,
            slipped_s: overruns.slipped_ns as f64 * 1e-9,
            unaccounted_us: self
                .clock
                .balance()
                .filter(|_| !fast)
                .map(|account: Account| account.unaccounted_ns() as f64 * 1e-3),
            step_budget_us: self.step_us() as f64,
            step_us: figures.step_cost.percentiles(),
            cycle_us: paced(&figures.cycle_cost),
            lateness_us: paced(self.clock.lateness()),
            round_trip_us: figures.round_trip.percentiles(),
            echo_us: figures.echo.percentiles(),
            // The rest is its owner's to fill in: what was asked of the kernel and what ran beside the bench.
            ..Timing::default()
        }
    }
}
