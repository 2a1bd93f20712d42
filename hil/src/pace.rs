//! The clock of a run: when the next step may happen, how late it was, what it cost.
//!
//! Real time means absolute deadlines on the monotonic clock, so that a late wake-up does not shift the
//! ones after it. A run that is late catches up without skipping simulated time.

use hdrhistogram::Histogram;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// The monotonic clock (ns).
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Sleeps until the monotonic clock shows `deadline_ns`.
pub fn sleep_until_ns(deadline_ns: u64) {
    let deadline = Timespec {
        tv_sec: (deadline_ns / 1_000_000_000) as i64,
        tv_nsec: (deadline_ns % 1_000_000_000) as i64,
    };
    // A signal ends the sleep early; the deadline still stands.
    while clock_nanosleep_absolute(ClockId::Monotonic, &deadline) == Err(rustix::io::Errno::INTR) {}
}

/// Simulated time tied to the monotonic clock.
#[derive(Debug)]
pub struct RealTime {
    origin_ns: u64,
    origin_us: u64,
    /// Simulated time to a second of the wall clock.
    speed: f64,
    step_us: u64,
    lateness: Distribution,
    /// The same since it was last asked for.
    recent: Distribution,
    overruns: u64,
}

impl RealTime {
    /// Ties the present to `time_us` of simulated time. Later than `step_us` counts as an overrun.
    pub fn from_now(time_us: u64, step_us: u64) -> Self {
        Self {
            origin_ns: now_ns(),
            origin_us: time_us,
            speed: 1.0,
            step_us,
            lateness: Distribution::new(),
            recent: Distribution::new(),
            overruns: 0,
        }
    }

    /// Ties the present to `time_us` again: what was lost is not caught up.
    pub fn rebase(&mut self, time_us: u64) {
        (self.origin_ns, self.origin_us) = (now_ns(), time_us);
    }

    /// From `time_us` on simulated time runs at this multiple of the wall clock.
    pub fn set_speed(&mut self, speed: f64, time_us: u64) {
        self.rebase(time_us);
        self.speed = speed;
    }

    /// Simulated time to a second of the wall clock.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// When `time_us` is due on the monotonic clock (ns).
    pub fn deadline_ns(&self, time_us: u64) -> u64 {
        self.origin_ns + (time_us.saturating_sub(self.origin_us) as f64 * 1e3 / self.speed) as u64
    }

    /// How far the wall clock is ahead of `time_us` (ns).
    pub fn behind_ns(&self, time_us: u64) -> u64 {
        now_ns().saturating_sub(self.deadline_ns(time_us))
    }

    /// Sleeps until `time_us` is due, and accounts for how late it has become.
    pub fn wait_until(&mut self, time_us: u64) {
        let deadline_ns = self.deadline_ns(time_us);
        if now_ns() < deadline_ns {
            sleep_until_ns(deadline_ns);
        }
        let late_ns = now_ns().saturating_sub(deadline_ns);
        self.lateness.record_ns(late_ns);
        self.recent.record_ns(late_ns);
        if late_ns > self.step_us * 1000 {
            self.overruns += 1;
        }
    }

    /// Steps that began more than a step late.
    pub fn overruns(&self) -> u64 {
        self.overruns
    }

    /// Lateness that 99 % of the steps since the last call stayed below (us).
    pub fn recent_lateness_us(&mut self) -> f64 {
        let late_us = self.recent.quantile_us(0.99);
        self.recent.clear();
        late_us
    }

    /// How late steps began.
    pub fn lateness(&self) -> &Distribution {
        &self.lateness
    }
}

/// How a duration is distributed, to three digits.
#[derive(Debug)]
pub struct Distribution(Histogram<u64>);

impl Distribution {
    /// Empty.
    #[allow(clippy::new_without_default)]
    pub fn new() -> Self {
        const LONGEST_NS: u64 = 100_000_000_000; // what is longer counts as this
        Self(Histogram::new_with_max(LONGEST_NS, 3).expect("three digits, and a maximum above 2"))
    }

    /// Takes one duration (ns).
    pub fn record_ns(&mut self, ns: u64) {
        self.0.saturating_record(ns);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.0.reset();
    }

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Duration that the share `quantile` stays below (us).
    pub fn quantile_us(&self, quantile: f64) -> f64 {
        self.0.value_at_quantile(quantile) as f64 * 1e-3
    }

    /// The longest (us).
    pub fn max_us(&self) -> f64 {
        self.0.max() as f64 * 1e-3
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deadlines_do_not_drift_and_lateness_is_never_negative() {
        let mut clock = RealTime::from_now(4000, 1000);
        let start_ns = clock.deadline_ns(4000);
        for step in 1..=20 {
            clock.wait_until(4000 + 1000 * step);
            assert!(now_ns() >= start_ns + 1_000_000 * step);
        }
        assert!(!clock.lateness().is_empty());
    }

    #[test]
    fn a_run_that_is_late_counts_every_step_until_it_has_caught_up() {
        let mut clock = RealTime::from_now(0, 1000);
        sleep_until_ns(now_ns() + 20_000_000);
        (1..=10).for_each(|step| clock.wait_until(1000 * step));
        // Each of the ten was due at least 10 ms ago.
        assert_eq!(clock.overruns(), 10);
        clock.rebase(10_000);
        assert!(clock.deadline_ns(11_000) > now_ns());
    }

    #[test]
    fn figures_come_from_the_recorded_durations() {
        let mut distribution = Distribution::new();
        assert!(distribution.is_empty());
        (1..=1000).for_each(|us| distribution.record_ns(us * 1000));
        // Three digits: 0.1 %.
        assert!((distribution.quantile_us(0.5) - 500.0).abs() <= 0.5);
        assert!((distribution.max_us() - 1000.0).abs() <= 1.0);
    }
}
