//! The flight controller at the other end: what is known of it, what it says, when it counts as lost.

use std::time::Duration;

use hopbench::signal::ActuatorCommand;
use hopbench::time::SimTime;

use super::{Bench, Stage};
use crate::link::Notice;
use crate::mavlink::{ControlsFrame, Heartbeat, MODE_HIL};
use crate::pace::now_ns;

/// MAV_COMP_ID_AUTOPILOT1
const AUTOPILOT_COMPONENT: u8 = 1;
/// MAV_AUTOPILOT_INVALID: a component that is no flight controller.
const AUTOPILOT_INVALID: u8 = 8;

/// What is known of the other end.
#[derive(Debug, Default)]
pub(super) struct FlightController {
    /// Its HEARTBEAT was heard, and whether the last one carried the HIL flag.
    pub(super) heartbeat: Option<bool>,
    /// System and component that send controls.
    pub(super) sender: Option<(u8, u8)>,
    /// That controls came before the HIL flag has been said.
    pub(super) flag_missed: bool,
    /// First HIL_ACTUATOR_CONTROLS, simulated time.
    pub(super) first: Option<SimTime>,
    /// It answers HIL_SENSOR: lockstep may wait for it.
    pub(super) answers: bool,
    /// The answer that lockstep waits for has come.
    pub(super) answered: bool,
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
                self.live.notice(format!("{address}: lost, {why}"));
            }
            Notice::Refused(peer) => {
                self.live.notice(format!("{address}: {peer} refused, one flight controller at a time"));
            }
        }
    }

    /// Gimbals, cameras and ground stations have heartbeats too; the flight controller's is the one from
    /// whoever sends controls, and until then from the component that autopilots are by convention.
    pub(super) fn take_heartbeat(&mut self, beat: Heartbeat, sender: (u8, u8)) {
        let ours = match self.fc.sender {
            Some(known) => sender == known,
            None => sender.1 == AUTOPILOT_COMPONENT,
        };
        if ours && beat.autopilot != AUTOPILOT_INVALID {
            let in_the_loop = beat.base_mode & MODE_HIL != 0;
            self.fc.left_the_loop = self.options.profile.needs_hil_flag && !in_the_loop;
            self.fc.heartbeat = Some(in_the_loop);
        }
    }

    pub(super) fn take_controls(&mut self, frame: &ControlsFrame, sender: (u8, u8)) {
        self.fc.sender = Some(sender);
        if self.stage == Stage::Waiting && !self.may_stream() {
            // Its outputs may be live: nothing flies on them before it says that it is in the loop.
            if self.options.profile.needs_hil_flag && !self.fc.flag_missed {
                self.fc.flag_missed = true;
                self.live.notice(format!(
                    "{}: controls but no HEARTBEAT with the HIL flag: is SYS_HITL 1?",
                    self.link.address()
                ));
            }
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
            self.clock.rebase(now.us());
        }
        let (sent_us, sent_ns) = self.figures.sent[(frame.time_us / 1000) as usize % self.figures.sent.len()];
        if sent_us == frame.time_us && sent_us > 0 {
            self.figures.round_trip.record_ns(now_ns - sent_ns);
            // A second answer to the same sample is none.
            self.figures.sent[(sent_us / 1000) as usize % self.figures.sent.len()] = (0, 0);
        }
        // In lockstep a controller that repeats itself is as silent as one that says nothing.
        if frame.time_us == 0 || frame.time_us == now.us() {
            self.fc.answered = true;
            self.fc.waited = Duration::ZERO;
        }
        self.fc.heard = now;
        self.fc.heard_ns = now_ns;
        self.fc.armed = armed;
        self.fc.ever_armed |= armed;
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
            return self.fc.waited >= timeout;
        }
        // A bench that catches up runs faster than the controller can: both clocks must agree.
        let silent = Duration::from_micros(self.flight.time().since(self.fc.heard).us());
        silent >= timeout && Duration::from_nanos(now_ns().saturating_sub(self.fc.heard_ns)) >= timeout
    }
}
