//! The clock of a run: when the next step may happen, how late it was, what it cost.
//!
//! Real time means absolute deadlines on the monotonic clock, so that a late wake-up does not shift the ones
//! after it. A run that is late catches up without skipping simulated time, or says by how much time slipped.

use hdrhistogram::Histogram;
use hopbench::simulation::report::{Overrun, Percentiles};
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

/// A run that is behind by no more than this catches up; beyond it lets time slip.
const CATCH_UP_NS: u64 = 50_000_000;
/// A run that is behind and has not slept for so long rests, lest a real-time thread starves everybody else
/// on its CPU.
const BURST_NS: u64 = 10_000_000;
const REST_NS: u64 = 1_000_000;
/// Late spells that are kept one by one: the worst.
const WORST: usize = 16;

/// Simulated time anchored to the monotonic clock.
///
/// A step that begins more than a step late is an overrun, and every overrun is counted. Behind by up to 50
/// ms the run catches up: no sample is left out, they leave late. Beyond that time slips: the present becomes
/// due now, and the length of the slip is kept. So the wall time of a run is its simulated time, its slips
/// and what it is late by at its end.
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
    overruns: Overruns,
    /// The overruns since the run was last on time.
    spell: Option<Spell>,
    anchor: Option<Anchor>,
    /// When it last slept, or began.
    rested_ns: u64,
}

/// Steps that began more than a step late, and what was done about them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overruns {
    /// All of them.
    pub count: u64,
    /// Made up for.
    pub caught_up: u64,
    /// Ended by a slip.
    pub slipped: u64,
    /// Times that time slipped.
    pub slips: u64,
    /// By how much altogether (ns).
    pub slipped_ns: u64,
    /// The worst spells, worst first.
    pub worst: Vec<Overrun>,
}

/// A row of late steps.
#[derive(Debug)]
struct Spell {
    from_us: u64,
    steps: u64,
    worst_ns: u64,
}

/// Where simulated time begins on the wall clock, and how far both have come.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    start_ns: u64,
    start_us: u64,
    /// What the simulated time before `start_us` took at its speed.
    before_ns: u64,
    woke_ns: u64,
    due_us: u64,
    late_ns: u64,
    slipped_before_ns: u64,
}

impl Anchor {
    /// What simulated time from the beginning to `time_us` takes at a speed (ns).
    fn simulated_ns(&self, time_us: u64, speed: f64) -> u64 {
        self.before_ns + (time_us.saturating_sub(self.start_us) as f64 * 1e3 / speed) as u64
    }

    /// Simulated time was at `from_us` and is at `to_us`, in no time.
    fn jump(&mut self, from_us: u64, to_us: u64, speed: f64) {
        self.before_ns = self.simulated_ns(from_us, speed);
        (self.start_us, self.due_us) = (to_us, to_us);
    }
}

/// Wall time against simulated time, from the anchor to the last step waited for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeBalance {
    /// Wall time (ns).
    pub wall_ns: u64,
    /// Simulated time, as long as it takes at its speed (ns).
    pub simulated_ns: u64,
    /// Slips (ns).
    pub slipped_ns: u64,
    /// Lateness at the end (ns).
    pub late_ns: u64,
}

impl TimeBalance {
    /// Wall time that nothing accounts for (ns).
    pub fn unaccounted_ns(&self) -> i64 {
        self.wall_ns as i64 - (self.simulated_ns + self.slipped_ns + self.late_ns) as i64
    }
}

impl RealTime {
    /// Anchors the present at `time_us` of simulated time. Later than `step_us` counts as an overrun.
    pub fn from_now(time_us: u64, step_us: u64) -> Self {
        let now = now_ns();
        Self {
            origin_ns: now,
            origin_us: time_us,
            speed: 1.0,
            step_us,
            lateness: Distribution::new(),
            recent: Distribution::new(),
            overruns: Overruns::default(),
            spell: None,
            anchor: None,
            rested_ns: now,
        }
    }

    /// Anchors the present at `time_us`, where simulated time stood still until now.
    pub fn start_at(&mut self, time_us: u64) {
        let now = now_ns();
        (self.origin_ns, self.origin_us) = (now, time_us);
        self.spell = None;
        self.anchor = Some(Anchor {
            start_ns: now,
            start_us: time_us,
            before_ns: 0,
            woke_ns: now,
            due_us: time_us,
            late_ns: 0,
            slipped_before_ns: self.overruns.slipped_ns,
        });
    }

    /// Lets what was lost slip, so that `time_us` is due now. Within a step of its time nothing was lost.
    pub fn rebase(&mut self, time_us: u64) {
        self.rebase_at(now_ns(), time_us);
    }

    fn rebase_at(&mut self, now: u64, time_us: u64) {
        let deadline_ns = self.deadline_ns(time_us);
        if now > deadline_ns + self.step_ns() {
            let late_ns = now - deadline_ns;
            if let Some(anchor) = &mut self.anchor {
                (anchor.woke_ns, anchor.due_us, anchor.late_ns) = (now, time_us, late_ns);
            }
            self.slip(late_ns);
        } else if deadline_ns > now + self.step_ns() {
            // Ahead of the clock, after a run that did not follow it.
            (self.origin_ns, self.origin_us) = (now, time_us);
        }
    }

    /// From `time_us` on, which is due when it was, simulated time runs at this multiple of the wall clock.
    pub fn set_speed(&mut self, speed: f64, time_us: u64) {
        (self.origin_ns, self.origin_us) = (self.deadline_ns(time_us), time_us);
        if let Some(anchor) = &mut self.anchor {
            anchor.jump(time_us, time_us, self.speed);
        }
        self.speed = speed;
    }

    /// Simulated time has stood at `from_us` until now on purpose, and goes on at `to_us`.
    pub fn resume_at(&mut self, from_us: u64, to_us: u64) {
        let (now, deadline_ns) = (now_ns(), self.deadline_ns(from_us));
        if let Some(anchor) = &mut self.anchor {
            let stood_ns = now.saturating_sub(deadline_ns);
            anchor.jump(from_us, to_us, self.speed);
            (anchor.start_ns, anchor.woke_ns) = (anchor.start_ns + stood_ns, anchor.woke_ns + stood_ns);
        }
        (self.origin_ns, self.origin_us) = (now.max(deadline_ns), to_us);
    }

    /// Simulated time to a second of the wall clock.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// When `time_us` is due on the monotonic clock (ns).
    pub fn deadline_ns(&self, time_us: u64) -> u64 {
        self.origin_ns + (time_us.saturating_sub(self.origin_us) as f64 * 1e3 / self.speed) as u64
    }

    /// Sleeps until `time_us` is due, and accounts for how late it has become.
    pub fn wait_until(&mut self, time_us: u64) {
        let deadline_ns = self.deadline_ns(time_us);
        let now = now_ns();
        if now < deadline_ns {
            sleep_until_ns(deadline_ns);
            self.has_rested();
        } else if now - self.rested_ns > BURST_NS {
            sleep_until_ns(now + REST_NS);
            self.has_rested();
        }
        let woke_ns = now_ns();
        self.account(time_us, woke_ns, woke_ns.saturating_sub(deadline_ns));
    }

    /// The run has waited elsewhere, for an answer.
    pub fn has_rested(&mut self) {
        self.rested_ns = now_ns();
    }

    fn account(&mut self, time_us: u64, woke_ns: u64, late_ns: u64) {
        self.lateness.record_ns(late_ns);
        self.recent.record_ns(late_ns);
        if let Some(anchor) = &mut self.anchor {
            (anchor.woke_ns, anchor.due_us, anchor.late_ns) = (woke_ns, time_us, late_ns);
        }
        if late_ns <= self.step_ns() {
            if let Some(spell) = self.spell.take() {
                self.overruns.caught_up += spell.steps;
                self.overruns.keep(&spell, None);
            }
            return;
        }
        self.overruns.count += 1;
        let spell = self.spell.get_or_insert(Spell { from_us: time_us, steps: 0, worst_ns: 0 });
        spell.steps += 1;
        spell.worst_ns = spell.worst_ns.max(late_ns);
        if late_ns > CATCH_UP_NS {
            self.slip(late_ns);
        }
    }

    fn slip(&mut self, by_ns: u64) {
        self.origin_ns += by_ns;
        self.overruns.slips += 1;
        self.overruns.slipped_ns += by_ns;
        if let Some(anchor) = &mut self.anchor {
            anchor.late_ns = anchor.late_ns.saturating_sub(by_ns);
        }
        let spell = self.spell.take().unwrap_or(Spell { from_us: self.due_us(), steps: 0, worst_ns: by_ns });
        self.overruns.slipped += spell.steps;
        self.overruns.keep(&spell, Some(by_ns));
    }

    fn due_us(&self) -> u64 {
        self.anchor.map_or(self.origin_us, |anchor| anchor.due_us)
    }

    fn step_ns(&self) -> u64 {
        self.step_us * 1000
    }

    /// What was done about steps that began more than a step late.
    pub fn overruns(&self) -> &Overruns {
        &self.overruns
    }

    /// When simulated time began to follow the clock (ns).
    pub fn anchored_ns(&self) -> Option<u64> {
        self.anchor.map(|anchor| anchor.start_ns)
    }

    /// Wall time against simulated time since they were last anchored.
    pub fn balance(&self) -> Option<TimeBalance> {
        self.anchor.map(|anchor| TimeBalance {
            wall_ns: anchor.woke_ns - anchor.start_ns,
            simulated_ns: anchor.simulated_ns(anchor.due_us, self.speed),
            slipped_ns: self.overruns.slipped_ns - anchor.slipped_before_ns,
            late_ns: anchor.late_ns,
        })
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

impl Overruns {
    fn keep(&mut self, spell: &Spell, slipped_ns: Option<u64>) {
        let overrun = Overrun {
            time_s: spell.from_us as f64 * 1e-6,
            steps: spell.steps,
            late_ms: spell.worst_ns as f64 / 1e6,
            slipped_ms: slipped_ns.map(|ns| ns as f64 / 1e6),
        };
        let place = self.worst.partition_point(|kept| kept.late_ms >= overrun.late_ms);
        self.worst.insert(place, overrun);
        self.worst.truncate(WORST);
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

    /// Durations it has taken.
    pub fn count(&self) -> u64 {
        self.0.len()
    }

    /// Median and tail; `None` of nothing.
    pub fn percentiles(&self) -> Option<Percentiles> {
        (!self.is_empty()).then(|| Percentiles {
            p50: self.quantile_us(0.5),
            p99: self.quantile_us(0.99),
            p999: self.quantile_us(0.999),
            max: self.max_us(),
        })
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
    fn pause_speed_and_reset_are_neither_late_nor_unaccounted_for() {
        let mut clock = RealTime::from_now(0, 1000);
        clock.start_at(0);
        let run = |clock: &mut RealTime, ms: std::ops::RangeInclusive<u64>| {
            ms.for_each(|ms| clock.wait_until(ms * 1000));
        };
        run(&mut clock, 1..=5);
        sleep_until_ns(now_ns() + 80_000_000);
        clock.resume_at(5000, 5000);
        clock.set_speed(2.0, 5000);
        run(&mut clock, 6..=25);
        // 20 ms at twice the speed take 10.
        clock.resume_at(25_000, 0);
        run(&mut clock, 1..=5);
        let balance = clock.balance().unwrap();
        // 5 ms, 10 ms and 2.5 ms; a microsecond for what is rounded.
        assert!(balance.simulated_ns.abs_diff(17_500_000) < 1000, "{balance:?}");
        assert!(balance.unaccounted_ns().abs() < 1000, "{balance:?}");
    }

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

    /// A clock whose steps 1, 2, … begin as late as this (us).
    fn late_by(late_us: impl IntoIterator<Item = u64>) -> RealTime {
        let mut clock = RealTime::from_now(0, 1000);
        clock.start_at(0);
        for (i, late_us) in late_us.into_iter().enumerate() {
            let time_us = 1000 * (i as u64 + 1);
            clock.account(time_us, clock.deadline_ns(time_us) + 1000 * late_us, 1000 * late_us);
            balanced(&clock);
        }
        clock
    }

    /// Every overrun and every nanosecond is in the balance.
    fn balanced(clock: &RealTime) {
        let (balance, overruns) = (clock.balance().unwrap(), clock.overruns());
        assert_eq!(balance.unaccounted_ns(), 0, "{balance:?}");
        let open = clock.spell.as_ref().map_or(0, |spell| spell.steps);
        assert_eq!(overruns.count, overruns.caught_up + overruns.slipped + open, "{overruns:?}");
    }

    #[test]
    fn a_run_that_is_late_counts_every_step_until_it_has_caught_up() {
        // A pause of 20 ms, made up for by a millisecond a step.
        let clock = late_by((0..=20).rev().map(|ms| 1000 * ms));
        let overruns = clock.overruns();
        assert_eq!((overruns.count, overruns.caught_up, overruns.slips), (19, 19, 0));
        assert_eq!(overruns.worst, [Overrun { time_s: 0.001, steps: 19, late_ms: 20.0, slipped_ms: None }]);
        assert_eq!(clock.lateness().count(), 21);
    }

    #[test]
    fn beyond_fifty_milliseconds_time_slips_by_as_much() {
        let clock = late_by([10, 30_000, 80_000, 20, 0]);
        let overruns = clock.overruns();
        assert_eq!((overruns.count, overruns.slipped, overruns.slips), (2, 2, 1));
        assert_eq!(overruns.slipped_ns, 80_000_000);
        assert_eq!(overruns.worst[0].slipped_ms, Some(80.0));
        // Five steps later the wall clock shows five milliseconds and the slip.
        assert_eq!(clock.balance().unwrap().wall_ns, 85_000_000);
    }

    #[test]
    fn time_slips_where_it_is_told_to_and_not_within_a_step() {
        let mut clock = late_by([0, 900]);
        let on_time_ns = clock.deadline_ns(2000);
        let before = clock.balance();
        // As late as a run is while its step is computed.
        clock.rebase_at(on_time_ns + 1_000_000, 2000);
        assert_eq!((clock.overruns().slips, clock.balance()), (0, before));
        clock.rebase_at(on_time_ns + 20_000_000, 2000);
        assert_eq!((clock.overruns().slips, clock.overruns().slipped_ns), (1, 20_000_000));
        assert_eq!(clock.deadline_ns(3000), on_time_ns + 21_000_000);
        balanced(&clock);
    }

    #[test]
    fn a_step_that_never_keeps_up_leaves_time_to_others() {
        let mut clock = RealTime::from_now(0, 1000);
        clock.start_at(0);
        // Three milliseconds of work in a step of one.
        let (start_ns, mut worked_ns, mut longest_ns) = (now_ns(), 0, 0);
        for step in 1..=60 {
            clock.wait_until(1000 * step);
            let begun_ns = now_ns();
            while now_ns() < begun_ns + 3_000_000 {}
            let took_ns = now_ns() - begun_ns;
            (worked_ns, longest_ns) = (worked_ns + took_ns, longest_ns.max(took_ns));
        }
        // Between two rests lie 10 ms and the step under way, whatever else this machine does.
        let rests = (worked_ns / (BURST_NS + longest_ns)).saturating_sub(1);
        let others_ns = now_ns() - start_ns - worked_ns;
        assert!(others_ns >= rests * REST_NS, "{others_ns} ns, {rests} rests");
        assert!(clock.overruns().slips >= 2, "{:?}", clock.overruns());
        balanced(&clock);
    }

    #[test]
    fn the_worst_spells_are_kept() {
        // Late by 2, 3, … 31 ms, on time in between.
        let clock = late_by((2..32).flat_map(|ms| [1000 * ms, 0]));
        let kept: Vec<f64> = clock.overruns().worst.iter().map(|overrun| overrun.late_ms).collect();
        assert_eq!(kept, (16..32).rev().map(f64::from).collect::<Vec<_>>());
        assert_eq!(clock.overruns().caught_up, 30);
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
