//! The flight controller at the other end: what is known of it, what it says, when it counts as lost.

use std::time::Duration;

use hopbench::signal::ActuatorCommand;
use hopbench::time::SimTime;

use super::{Bench, Stage};
use crate::bench::pace::now_ns;
use crate::wire::disruption::Sample;
use crate::wire::link::Notice;
use crate::wire::mavlink::{
    AUTOPILOT_COMPONENT, AUTOPILOT_INVALID, AUTOPILOT_PX4, Address, ControlsFrame, Heartbeat, MODE_HIL,
};

/// A controller's clock that goes back by more than this has been set anew; by less, the frame is an old one (us).
const REORDERED_US: u64 = 1_000_000;

/// What is known of the other end.
#[derive(Debug, Default)]
pub(super) struct FlightController {
    /// Its HEARTBEAT was heard, and whether the last one carried the HIL flag.
    pub(super) heartbeat: Option<bool>,
    /// System and component that send controls.
    pub(super) sender: Option<Address>,
    /// That controls came before the HIL flag has been said.
    pub(super) flag_missed: bool,
    /// First HIL_ACTUATOR_CONTROLS, simulated time.
    pub(super) first: Option<SimTime>,
    /// It answers HIL_SENSOR: lockstep may wait for it.
    pub(super) answers: bool,
    /// The sample whose answer lockstep waits for, and whether that has come.
    pub(super) awaited: Option<Sample>,
    pub(super) answered: bool,
    /// Newest sample that has reached it, as far as is known (us).
    pub(super) newest_us: u64,
    /// Time and counter of its last controls.
    pub(super) last: Option<(u64, u8)>,
    /// It was in the loop, and says that it no longer is.
    pub(super) left_the_loop: bool,
    /// What it commanded last, whether or not it is obeyed.
    pub(super) command: Option<ActuatorCommand>,
    /// The last frame was armed, and any before it was.
    pub(super) armed: bool,
    pub(super) ever_armed: bool,
    /// Last good HIL_ACTUATOR_CONTROLS: simulated and wall time.
    pub(super) heard: SimTime,
    pub(super) heard_ns: u64,
    /// Wall time that lockstep has waited in vain since then.
    pub(super) waited: Duration,
    /// Frames whose controls held no number.
    pub(super) rejected: u64,
    /// Frames that came again or too late, or belong to the flight before.
    pub(super) old: u64,
    /// Its profile, or what it says of itself, makes it a board whose outputs may be live: it must be in the loop.
    pub(super) may_be_live: bool,
    /// When its silence is named next, while it lasts (ns).
    pub(super) next_silence_ns: Option<u64>,
}

impl FlightController {
    /// Where it is addressed: as whoever sends controls, and until then as autopilots are by convention.
    pub(super) fn address(&self) -> Address {
        self.sender.unwrap_or(Address { system: 1, component: AUTOPILOT_COMPONENT })
    }

    /// From a bad wire comes the newest sample that is there now, or would be. One that an even newer one has
    /// overtaken is not answered.
    pub(super) fn await_answer(&mut self, delivered: Option<Sample>) {
        self.awaited = delivered.filter(|sample| sample.time_us > self.newest_us);
        if let Some(Sample { time_us, lost: false }) = self.awaited {
            self.newest_us = time_us;
        }
    }

    /// An answer to a sample, 0: to any. In lockstep a controller that repeats itself is as silent as one that
    /// says nothing.
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

    /// Whether a frame with this time and counter has been overtaken or has come before: a wire may reorder and
    /// repeat. Without a time the counter alone tells a repetition.
    fn is_old(&self, time_us: u64, sequence: u8) -> bool {
        match self.last {
            Some((_, last)) if time_us == 0 => sequence == last,
            Some(last) if last == (time_us, sequence) => true,
            Some((last_us, _)) => time_us < last_us && last_us - time_us <= REORDERED_US,
            None => false,
        }
    }
}

impl Bench<'_> {
    pub(super) fn take_notice(&mut self, notice: Notice) {
        let address = self.link.address().to_owned();
        match notice {
            Notice::Connected(peer) => {
                self.decoder.forget_senders();
                self.live.notice(format!("{address}: {peer} is there"));
            }
            Notice::Disconnected(why) => {
                self.decoder.forget_senders();
                self.fc.answers = false;
                self.fc.heartbeat = None;
                self.fc.sender = None;
                self.fc.last = None;
                self.disruption.forget_tails();
                self.live.notice(format!("{address}: lost, {why}"));
            }
            Notice::Refused(peer) => {
                self.live.notice(format!("{address}: {peer} refused, one flight controller at a time"));
            }
        }
    }

    /// Gimbals, cameras and ground stations have heartbeats too; the flight controller's is the one from
    /// whoever sends controls, and until then from the component that autopilots are by convention.
    pub(super) fn take_heartbeat(&mut self, beat: Heartbeat, sender: Address) {
        let ours = match self.fc.sender {
            Some(known) => sender == known,
            None => sender.component == AUTOPILOT_COMPONENT,
        };
        if ours && beat.autopilot != AUTOPILOT_INVALID {
            let in_the_loop = beat.base_mode & MODE_HIL != 0;
            // A PX4 on a board keeps its outputs live until it is told otherwise, whatever the link; in software it has none.
            // Out of the loop it sends no HIL_ACTUATOR_CONTROLS: after the first a stray frame does not stop the flight.
            self.fc.may_be_live |=
                self.options.profile.answers && beat.autopilot == AUTOPILOT_PX4 && self.fc.first.is_none();
            self.fc.left_the_loop = self.fc.may_be_live && !in_the_loop;
            self.fc.heartbeat = Some(in_the_loop);
        }
    }

    pub(super) fn take_controls(&mut self, frame: &ControlsFrame, sender: Address, sequence: u8) {
        self.fc.sender = Some(sender);
        self.stalls.answered(frame.time_us);
        if self.fc.is_old(frame.time_us, sequence) {
            self.fc.old += 1;
            return;
        }
        if (self.stage == Stage::Waiting || self.fc.may_be_live) && !self.may_stream() {
            // Its outputs may be live: nothing flies on them before it says that it is in the loop.
            if self.fc.may_be_live && !self.fc.flag_missed {
                self.fc.flag_missed = true;
                self.live.notice(format!(
                    "{}: controls but no HEARTBEAT with the HIL flag: is SYS_HITL 1?",
                    self.link.address()
                ));
            }
            return;
        }
        if self.is_stale(frame.time_us) {
            self.fc.old += 1;
            return;
        }
        let controls = &self.scenario.vehicle.controls;
        let armed = frame.armed();
        let command =
            match controls.command(&frame.controls, armed, self.options.profile.throttle, &self.scale) {
                // Disarmed, the channels mean nothing.
                _ if !armed => ActuatorCommand::SAFE,
                Ok(command) => command,
                Err(fault) => {
                    if self.fc.rejected == 0 {
                        self.live.notice(format!("controls refused, the last command holds: {fault}"));
                    }
                    self.fc.rejected += 1;
                    return;
                }
            };
        let (now, now_ns) = (self.flight.time(), now_ns());
        if self.fc.first.is_none() {
            self.fc.first = Some(now);
            self.flight.event("fc_first", format!("HIL_ACTUATOR_CONTROLS on {}", self.link.address()));
            self.flight.set_source(self.options.source);
        }
        if !self.fc.answers {
            self.fc.answers = true;
            self.fc.waited = Duration::ZERO;
        }
        let echo_ms = self.scenario.vehicle.controls.echo_ms(&frame.controls);
        self.figures.note_controls(frame.time_us, echo_ms, self.gap_ns());
        if self.disruption.is_clear() {
            self.fc.take_answer(Sample { time_us: frame.time_us, lost: false });
        }
        self.fc.last = Some((frame.time_us, sequence));
        self.fc.heard = now;
        self.fc.heard_ns = now_ns;
        self.fc.next_silence_ns = None;
        self.fc.armed = armed;
        self.fc.ever_armed |= armed;
        self.hold_peer();
        self.fc.command = Some(command);
        if self.stage == Stage::Fallback {
            return;
        }
        if armed {
            self.stage = Stage::Flying;
        }
        self.command = command;
    }

    /// Longest time without controls that are obeyed or replaced.
    pub(super) fn fc_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.scenario.file.fc_timeout_ms * 1e-3)
    }

    /// Silence after which the flight controller counts as lost: whoever replaces it commands on the next sample, and
    /// that is within the timeout.
    pub(super) fn patience(&self) -> Duration {
        let timeout = self.fc_timeout();
        timeout.saturating_sub(Duration::from_micros(self.sample.us())).max(timeout / 2)
    }

    pub(super) fn is_lost(&self) -> bool {
        let timeout = self.patience();
        if self.in_lockstep() {
            // On a slow wire every answer is late by simulated time, though none is waited for.
            let silent = self.sampled.since(self.fc.heard);
            return self.fc.waited >= timeout || Duration::from_micros(silent.us()) >= timeout;
        }
        // A bench that catches up runs faster than the controller can: both clocks must agree, the wall clock at the
        // speed that was asked for.
        let silent = Duration::from_micros(self.flight.time().since(self.fc.heard).us());
        let by_the_wall = Duration::from_nanos(now_ns().saturating_sub(self.fc.heard_ns));
        silent >= timeout && by_the_wall >= timeout.div_f64(self.clock.speed().max(1.0))
    }
}
