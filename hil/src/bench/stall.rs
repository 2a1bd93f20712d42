//! Waits in lockstep that ran into their limit: counted, and named within a second however many there are.

use std::collections::BTreeSet;
use std::time::Duration;

use hopbench::simulation::report::Stalled;
use hopbench::time::SimTime;

/// Least time between two notices, and longest that a stall waits for its own.
pub(super) const NAMED_WITHIN: Duration = Duration::from_secs(1);
/// Stalls whose answer may still come.
const REMEMBERED: usize = 4096;

/// A wait in vain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stall {
    /// Run time.
    pub(super) now: SimTime,
    /// Time of the sample on the wire (us).
    pub(super) sample_us: u64,
    /// Wall time.
    pub(super) waited: Duration,
    /// A fault of the wire lost the sample or its answer.
    pub(super) by_fault: bool,
}

/// The stalls of a run.
#[derive(Debug)]
pub(super) struct Stalls {
    count: u64,
    figures: Stalled,
    /// Times on the wire of the samples not answered since.
    samples_us: BTreeSet<u64>,
    /// Since the last notice, when that was, and the newest.
    unnamed: u64,
    named_ns: Option<u64>,
    newest: String,
}

impl Stalls {
    pub(super) fn none() -> Self {
        Self {
            count: 0,
            figures: Stalled::default(),
            samples_us: BTreeSet::new(),
            unnamed: 0,
            named_ns: None,
            newest: String::new(),
        }
    }

    pub(super) fn is_first(&self) -> bool {
        self.count == 0
    }

    /// Counts one; `text` names it.
    pub(super) fn count(&mut self, stall: &Stall, text: String) {
        let waited_ms = stall.waited.as_secs_f64() * 1e3;
        if self.is_first() {
            self.figures.first_s = stall.now.s();
        }
        if self.samples_us.len() >= REMEMBERED {
            self.samples_us.pop_first();
        }
        self.samples_us.insert(stall.sample_us);
        self.count += 1;
        self.figures.last_s = stall.now.s();
        self.figures.lost_by_fault += u64::from(stall.by_fault);
        self.figures.longest_ms = self.figures.longest_ms.max(waited_ms);
        self.figures.total_ms += waited_ms;
        self.unnamed += 1;
        self.newest = text;
    }

    /// An answer to a sample, which may have been given up.
    pub(super) fn answered(&mut self, sample_us: u64) {
        self.figures.answered_late += u64::from(self.samples_us.remove(&sample_us));
    }

    /// What is to be said of the stalls since the last notice, if one is due.
    pub(super) fn notice(&mut self, now_ns: u64) -> Option<String> {
        let due = self.named_ns.is_none_or(|named| now_ns >= named + NAMED_WITHIN.as_nanos() as u64);
        if due { self.remaining(now_ns) } else { None }
    }

    /// The same whenever the last notice was.
    pub(super) fn remaining(&mut self, now_ns: u64) -> Option<String> {
        let text = match std::mem::take(&mut self.unnamed) {
            0 => return None,
            1 => format!("stall: {}", self.newest),
            many => format!("stall: {many} since the last notice, the newest: {}", self.newest),
        };
        self.named_ns = Some(now_ns);
        Some(text)
    }

    pub(super) fn report(&self) -> (u64, Option<Stalled>) {
        (self.count, (self.count > 0).then_some(self.figures))
    }
}
