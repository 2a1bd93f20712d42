//! Time of a run: where it stands, what has been asked of it, and its place on the wire, where it never goes
//! back.

use hopbench::simulation::Flight;
use hopbench::time::SimTime;

use crate::bench::pace::now_ns;

/// After a reset, answers to the flight before are not obeyed for this long (ns).
const STALE_NS: u64 = 200_000_000;
/// Least time on the wire that the mark of a new flight takes.
const LEAST_MARK: SimTime = SimTime::from_us(1_000);

/// Pauses, steps, samples and the flights before.
#[derive(Default)]
pub(super) struct Timeline {
    /// Time of the flights before, on the wire.
    offset: SimTime,
    /// Until this wall time answers to the flight before are not obeyed.
    stale_ns: u64,
    paused: bool,
    /// Steps to make while it is paused.
    steps: u64,
    next_seed: Option<u32>,
    /// The flight that somebody has asked for and that could be set up.
    next_flight: Option<Box<Flight>>,
    /// Time of the last sample, and between the last two.
    sampled: SimTime,
    sample_interval: SimTime,
}

impl Timeline {
    /// Time on the wire: that of the flights before, and of this one.
    pub(super) fn on_wire(&self, now: SimTime) -> SimTime {
        self.offset + now
    }

    /// Whether a time on the wire belongs to a flight before.
    pub(super) fn is_past(&self, time: SimTime) -> bool {
        time < self.offset
    }

    /// Whether controls answer a sample of the flight before.
    pub(super) fn is_stale(&self, time_us: u64) -> bool {
        time_us > 0 && self.is_past(SimTime::from_us(time_us)) && now_ns() < self.stale_ns
    }

    pub(super) fn note_sample(&mut self, now: SimTime) {
        (self.sample_interval, self.sampled) = (now.since(self.sampled), now);
    }

    /// Time of the last sample.
    pub(super) fn sampled(&self) -> SimTime {
        self.sampled
    }

    pub(super) fn sample_interval(&self) -> SimTime {
        self.sample_interval
    }

    pub(super) fn is_paused(&self) -> bool {
        self.paused
    }

    /// Simulated time stands from now on.
    pub(super) fn pause(&mut self) {
        (self.paused, self.steps) = (true, 0);
    }

    pub(super) fn resume(&mut self) {
        self.paused = false;
    }

    /// Makes so many steps while it is paused.
    pub(super) fn set_steps(&mut self, count: u64) {
        self.steps = count;
    }

    /// Steps left to make while it is paused.
    pub(super) fn steps(&self) -> u64 {
        self.steps
    }

    /// Whether simulated time stands until somebody lets it go on; a step that was asked for is taken off.
    pub(super) fn stands(&mut self) -> bool {
        if !self.paused {
            return false;
        }
        let stands = self.steps == 0;
        self.steps = self.steps.saturating_sub(1);
        stands
    }

    pub(super) fn next_seed(&self) -> Option<u32> {
        self.next_seed
    }

    pub(super) fn set_next_seed(&mut self, seed: u32) {
        self.next_seed = Some(seed);
    }

    /// Whether somebody has asked for a new flight.
    pub(super) fn has_next_flight(&self) -> bool {
        self.next_flight.is_some()
    }

    pub(super) fn set_next_flight(&mut self, flight: Flight) {
        self.next_flight = Some(Box::new(flight));
    }

    /// The flight that somebody has asked for, which begins now.
    pub(super) fn take_next_flight(&mut self) -> Option<Box<Flight>> {
        self.next_flight.take()
    }

    /// A flight that lasted until `flown` is over. A sample's place on the wire passes: the mark of the new
    /// one takes it.
    pub(super) fn begin_again(&mut self, flown: SimTime) {
        self.offset = self.offset + flown + self.sample_interval.max(LEAST_MARK);
        self.steps = 0;
        self.stale_ns = now_ns() + STALE_NS;
        self.sampled = SimTime::ZERO;
    }
}
