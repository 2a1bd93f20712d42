//! What a run is measured by, and what its report says of time and link.

use hopbench::simulation::report::{LinkReport, Percentiles, TailPercentiles, Timing};

use super::Bench;
use crate::pace::{Distribution, now_ns};
use crate::profile::Pacing;

/// What the run is measured by.
#[derive(Debug)]
pub(super) struct Figures {
    pub(super) start_ns: u64,
    pub(super) step_cost: Distribution,
    pub(super) round_trip: Distribution,
    pub(super) steps: u64,
    pub(super) stalls: u64,
    /// Frames encoded before, taken by the link and thrown away.
    pub(super) encoded: u64,
    pub(super) taken: u64,
    pub(super) dropped: u64,
    /// HIL_SENSOR times and when they left, for the round trip.
    pub(super) sent: [(u64, u64); 64],
    pub(super) next_heartbeat_ns: u64,
    pub(super) next_message_ns: u64,
}

impl Figures {
    pub(super) fn begin() -> Self {
        let now = now_ns();
        Self {
            start_ns: now,
            step_cost: Distribution::new(),
            round_trip: Distribution::new(),
            steps: 0,
            stalls: 0,
            encoded: 0,
            taken: 0,
            dropped: 0,
            sent: [(0, 0); 64],
            next_heartbeat_ns: 0,
            next_message_ns: now + 1_000_000_000,
        }
    }
}

impl Bench<'_> {
    pub(super) fn flush(&mut self) {
        let taken = self.link.send(self.streams.bytes());
        self.streams.bytes().clear();
        let frames = self.streams.frames() - self.figures.encoded;
        self.figures.encoded += frames;
        *(if taken { &mut self.figures.taken } else { &mut self.figures.dropped }) += frames;
    }

    pub(super) fn note_sent(&mut self) {
        let time_us = self.wire_time().us();
        let slot = (time_us / 1000) as usize % self.figures.sent.len();
        self.figures.sent[slot] = (time_us, now_ns());
    }

    pub(super) fn finish(self) -> (Timing, LinkReport) {
        let wall_s = (now_ns() - self.figures.start_ns) as f64 * 1e-9;
        let simulated_s = self.flight.time().s();
        let counters = self.decoder.counters();
        let sent_bytes = self.link.counters().sent_bytes as f64;
        let paced = !(self.options.fast && self.options.pacing == Pacing::Lockstep);
        let timing = Timing {
            simulated_s,
            wall_s,
            realtime_factor: if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 },
            steps: self.figures.steps,
            overruns: self.clock.overruns(),
            step_us: percentiles(&self.figures.step_cost),
            lateness_us: if paced { tail(self.clock.lateness()) } else { None },
            round_trip_us: percentiles(&self.figures.round_trip),
        };
        let link = LinkReport {
            sent: self.figures.taken,
            dropped: self.figures.dropped,
            received: counters.frames,
            crc_errors: counters.crc_errors,
            lost: counters.lost,
            skipped_bytes: counters.skipped_bytes,
            refused: self.link.counters().refused,
            stalls: self.figures.stalls,
            // Ten symbols to a byte.
            wire_load_percent: self
                .options
                .baud
                .filter(|_| wall_s > 0.0)
                .map(|baud| sent_bytes * 10.0 / f64::from(baud) / wall_s * 100.0),
        };
        (timing, link)
    }
}

fn percentiles(distribution: &Distribution) -> Option<Percentiles> {
    (!distribution.is_empty()).then(|| Percentiles {
        p50: distribution.quantile_us(0.5),
        p99: distribution.quantile_us(0.99),
        max: distribution.max_us(),
    })
}

fn tail(distribution: &Distribution) -> Option<TailPercentiles> {
    (!distribution.is_empty()).then(|| TailPercentiles {
        p50: distribution.quantile_us(0.5),
        p99: distribution.quantile_us(0.99),
        p999: distribution.quantile_us(0.999),
        max: distribution.max_us(),
    })
}
