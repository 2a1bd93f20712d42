//! The flight controller at the other end: what is known of it, what it says, when it counts as lost.

use std::time::Duration;

use hopbench::signal::ActuatorCommand;
use hopbench::time::SimTime;

use crate::bench::pace::now_ns;
use crate::wire::disruption::Sample;
use crate::wire::request::{ControlsInput, Status};

/// A controller's clock that goes back by more than this has been set anew; by less, the frame is an old one
/// (us).
const REORDERED_US: u64 = 1_000_000;

/// What is known of the other end.
#[derive(Debug)]
pub(super) struct FlightController {
    /// Longest time without controls that are obeyed or replaced.
    timeout: Duration,
    /// Its HEARTBEAT was heard, and whether the last one carried the HIL flag.
    heartbeat: Option<bool>,
    /// That controls came before the HIL flag has been said.
    flag_missed: bool,
    /// First HIL_ACTUATOR_CONTROLS, simulated time.
    first: Option<SimTime>,
    /// It answers HIL_SENSOR: lockstep may wait for it.
    answers: bool,
    /// The sample whose answer lockstep waits for, and whether that has come.
    awaited: Option<Sample>,
    answered: bool,
    /// Newest sample that has reached it, as far as is known (us).
    newest_us: u64,
    /// Time and counter of its last controls.
    last: Option<(u64, u8)>,
    /// It was in the loop, and says that it no longer is.
    left_the_loop: bool,
    /// What it commanded last, whether or not it is obeyed.
    command: Option<ActuatorCommand>,
    /// The last frame was armed, and any before it was.
    armed: bool,
    ever_armed: bool,
    /// Last good HIL_ACTUATOR_CONTROLS: simulated and wall time.
    heard: SimTime,
    heard_ns: u64,
    /// Wall time that lockstep has waited in vain since then.
    waited: Duration,
    /// Frames whose controls held no number.
    rejected: u64,
    /// Frames that came again or too late, or belong to the flight before.
    old: u64,
    /// Its profile, or what it says of itself, makes it a board whose outputs may be live: it must be in the
    /// loop.
    may_be_live: bool,
    /// When its silence is named next, while it lasts (ns).
    next_silence_ns: Option<u64>,
}

/// How the run goes on, for the judgement on its silence.
#[derive(Clone, Copy, Debug)]
pub(super) struct Progress {
    pub(super) now: SimTime,
    /// Time of the last sample.
    pub(super) sampled: SimTime,
    /// Time between the last two samples.
    pub(super) sample_interval: SimTime,
    pub(super) in_lockstep: bool,
    /// Simulated time to a second of the wall clock.
    pub(super) speed: f64,
}

impl FlightController {
    /// One that nobody has heard; `may_be_live`: its profile makes it a board whose outputs may be live.
    pub(super) fn new(may_be_live: bool, timeout: Duration) -> Self {
        Self {
            timeout,
            heartbeat: None,
            flag_missed: false,
            first: None,
            answers: false,
            awaited: None,
            answered: false,
            newest_us: 0,
            last: None,
            left_the_loop: false,
            command: None,
            armed: false,
            ever_armed: false,
            heard: SimTime::ZERO,
            heard_ns: 0,
            waited: Duration::ZERO,
            rejected: 0,
            old: 0,
            may_be_live,
            next_silence_ns: None,
        }
    }

    /// Another flight begins on the same link.
    pub(super) fn begin_again(&mut self) {
        *self = Self {
            heartbeat: self.heartbeat,
            flag_missed: self.flag_missed,
            left_the_loop: self.left_the_loop,
            rejected: self.rejected,
            old: self.old,
            answers: self.answers,
            heard_ns: now_ns(),
            ..Self::new(self.may_be_live, self.timeout)
        };
    }

    /// It has hung up.
    pub(super) fn disconnect(&mut self) {
        self.answers = false;
        self.heartbeat = None;
        self.last = None;
    }

    /// Its HEARTBEAT. `is_told`: the bench's services are open to it.
    pub(super) fn take_status(&mut self, status: Status, is_told: bool) {
        // A PX4 on a board keeps its outputs live until it is told otherwise, whatever the link; in software
        // it has none. Out of the loop it sends no HIL_ACTUATOR_CONTROLS: after the first a stray frame does
        // not stop the flight.
        self.may_be_live |= is_told && status.is_px4 && self.first.is_none();
        self.left_the_loop = self.may_be_live && !status.in_the_loop;
        self.heartbeat = Some(status.in_the_loop);
    }

    /// Controls that were understood; whether they are the first.
    pub(super) fn take_controls(
        &mut self,
        controls: &ControlsInput,
        command: ActuatorCommand,
        now: SimTime,
    ) -> bool {
        let is_first = self.first.is_none();
        self.first.get_or_insert(now);
        if !self.answers {
            self.answers = true;
            self.waited = Duration::ZERO;
        }
        self.last = Some((controls.time_us, controls.sequence));
        self.heard = now;
        self.heard_ns = now_ns();
        self.next_silence_ns = None;
        self.armed = controls.armed;
        self.ever_armed |= controls.armed;
        self.command = Some(command);
        is_first
    }

    /// Controls that held no number; whether they are the first such.
    pub(super) fn reject_controls(&mut self) -> bool {
        self.rejected += 1;
        self.rejected == 1
    }

    /// Controls that came again or too late.
    pub(super) fn count_old(&mut self) {
        self.old += 1;
    }

    /// Controls came before the HIL flag: whether that is to be said.
    pub(super) fn misses_flag(&mut self) -> bool {
        self.may_be_live && !std::mem::replace(&mut self.flag_missed, true)
    }

    /// Whether anything but heartbeats may be sent to it.
    pub(super) fn may_be_fed(&self) -> bool {
        !self.may_be_live || self.heartbeat == Some(true)
    }

    /// Whether its outputs may be live, and it says that it is not in the loop.
    pub(super) fn is_live_board(&self) -> bool {
        self.may_be_live && self.heartbeat == Some(false)
    }

    pub(super) fn may_be_live(&self) -> bool {
        self.may_be_live
    }

    pub(super) fn has_heartbeat(&self) -> bool {
        self.heartbeat.is_some()
    }

    /// First controls, simulated time.
    pub(super) fn first(&self) -> Option<SimTime> {
        self.first
    }

    pub(super) fn is_armed(&self) -> bool {
        self.armed
    }

    pub(super) fn was_ever_armed(&self) -> bool {
        self.ever_armed
    }

    pub(super) fn has_left_the_loop(&self) -> bool {
        self.left_the_loop
    }

    /// Whether it answers samples.
    pub(super) fn answers(&self) -> bool {
        self.answers
    }

    /// It no longer answers samples: nobody waits for it.
    pub(super) fn stop_waiting(&mut self) {
        self.answers = false;
    }

    /// What it commanded last, whether or not it is obeyed.
    pub(super) fn command(&self) -> Option<ActuatorCommand> {
        self.command
    }

    /// Last good controls: simulated and wall time.
    pub(super) fn heard(&self) -> (SimTime, u64) {
        (self.heard, self.heard_ns)
    }

    /// Frames whose controls held no number, and frames that came again or too late.
    pub(super) fn refused(&self) -> (u64, u64) {
        (self.rejected, self.old)
    }

    /// The wire is sound: a sample that is sent is there.
    pub(super) fn await_answer_to(&mut self, sample: Option<Sample>) {
        self.awaited = sample;
    }

    /// What a bad wire has delivered or lost by now: its newest sample. Nobody answers one that a newer one
    /// has overtaken.
    pub(super) fn await_answer_to_delivered(&mut self, delivered: Option<Sample>) {
        self.awaited = delivered.filter(|sample| sample.time_us > self.newest_us);
        if let Some(Sample { time_us, lost: false }) = self.awaited {
            self.newest_us = time_us;
        }
    }

    /// An answer to a sample, 0: to any. In lockstep a controller that repeats itself is as silent as one
    /// that says nothing.
    pub(super) fn take_answer(&mut self, answer: Sample) {
        let awaited = self.awaited.as_mut();
        if let Some(awaited) = awaited.filter(|a| answer.time_us == 0 || answer.time_us == a.time_us) {
            if answer.lost {
                awaited.lost = true;
            } else {
                self.answered = true;
                self.waited = Duration::ZERO;
            }
        }
    }

    /// The sample whose answer lockstep waits for.
    pub(super) fn awaited(&self) -> Option<Sample> {
        self.awaited
    }

    pub(super) fn has_answered(&self) -> bool {
        self.answered
    }

    /// A step begins: its answer has not come.
    pub(super) fn begin_step(&mut self) {
        self.answered = false;
    }

    /// Lockstep has waited in vain.
    pub(super) fn add_wait(&mut self, waited: Duration) {
        self.waited += waited;
    }

    /// It flies again: what was waited for is past.
    pub(super) fn forgive_wait(&mut self) {
        self.waited = Duration::ZERO;
    }

    /// Wall time that lockstep may still wait for it.
    pub(super) fn patience_left(&self, sample_interval: SimTime) -> Duration {
        self.patience(sample_interval).saturating_sub(self.waited)
    }

    /// Whether controls have been overtaken or have come before: a wire may reorder and repeat. Without a
    /// time the counter alone tells a repetition.
    pub(super) fn is_old(&self, controls: &ControlsInput) -> bool {
        let ControlsInput { time_us, sequence, .. } = *controls;
        match self.last {
            Some((_, last)) if time_us == 0 => sequence == last,
            Some(last) if last == (time_us, sequence) => true,
            Some((last_us, _)) => time_us < last_us && last_us - time_us <= REORDERED_US,
            None => false,
        }
    }

    /// A silence that counts as a gap (ns).
    pub(super) fn gap_ns(&self) -> u64 {
        self.timeout.as_nanos() as u64 / 10
    }

    /// Whether it has said nothing for half its timeout, by the wall clock.
    pub(super) fn is_silent(&self) -> bool {
        now_ns().saturating_sub(self.heard_ns) > self.timeout.as_nanos() as u64 / 2
    }

    /// Silence after which it counts as lost: whoever replaces it commands on the next sample, and that is
    /// within the timeout.
    fn patience(&self, sample_interval: SimTime) -> Duration {
        self.timeout.saturating_sub(Duration::from_micros(sample_interval.us())).max(self.timeout / 2)
    }

    pub(super) fn is_lost(&self, run: &Progress) -> bool {
        let patience = self.patience(run.sample_interval);
        if run.in_lockstep {
            // On a slow wire every answer is late by simulated time, though none is waited for.
            let silent = run.sampled.since(self.heard);
            return self.waited >= patience || Duration::from_micros(silent.us()) >= patience;
        }
        // A bench that catches up runs faster than the controller can: both clocks must agree, the wall clock
        // at the speed that was asked for.
        let silent = Duration::from_micros(run.now.since(self.heard).us());
        let by_the_wall = Duration::from_nanos(now_ns().saturating_sub(self.heard_ns));
        silent >= patience && by_the_wall >= patience.div_f64(run.speed.max(1.0))
    }

    /// How long nothing that could be obeyed has come.
    pub(super) fn silence(&self, run: &Progress) -> String {
        let silent = if run.in_lockstep && self.waited >= self.patience(run.sample_interval) {
            format!("{} ms waited in lockstep", self.waited.as_millis())
        } else {
            format!("{:.0} ms without HIL_ACTUATOR_CONTROLS", run.now.since(self.heard).s() * 1e3)
        };
        match (self.rejected, self.old) {
            (0, 0) => silent,
            (rejected, old) => format!("{silent}, {rejected} frames refused, {old} old or repeated"),
        }
    }

    /// On the pad or after the flight its silence is named at once and every second: what of it, if it is
    /// time, and whether the silence begins.
    pub(super) fn name_silence(&mut self) -> Option<(String, bool)> {
        let now_ns = now_ns();
        let begins = self.next_silence_ns.is_none();
        if self.next_silence_ns.is_some_and(|next_ns| now_ns < next_ns) {
            return None;
        }
        self.next_silence_ns = Some(now_ns + 1_000_000_000);
        let silent_s = now_ns.saturating_sub(self.heard_ns) as f64 * 1e-9;
        let why = if self.left_the_loop { ", its HEARTBEAT lacks the HIL flag" } else { "" };
        Some((format!("{silent_s:.1} s without HIL_ACTUATOR_CONTROLS that count{why}"), begins))
    }
}
