//! One run: the flight, its clock, and who flies it.
//!
//! The built-in autopilot has shadowed measurements and commands, so it takes over from the motion under way
//! and from the command in force. It keeps the controls until somebody asks for them to be given back.

use std::time::Duration;

use hopbench::controls::Scale;
use hopbench::event::EventKind;
use hopbench::scenario::{OnFcLoss, Outcome, Scenario};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::{Flight, Source};
use hopbench::time::SimTime;

use crate::bench::controller::{FlightController, Progress};
use crate::bench::handover::{HandoverMonitor, Situation};
use crate::bench::live::Live;
use crate::bench::options::Options;
use crate::bench::pace::RealTime;
use crate::bench::pilot::{Belief, scale};
use crate::bench::planner::Planner;
use crate::bench::timeline::Timeline;
use crate::wire::link::{Hold, Notice};
use crate::wire::profile::Pacing;
use crate::wire::request::ControlsInput;

/// States of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    Waiting,
    Pad,
    Flying,
    Fallback,
}

/// A flight, its clock, and who flies it.
pub(super) struct Run<'a> {
    pub(super) flight: &'a mut Flight,
    pub(super) options: Options,
    pub(super) scenario: Scenario,
    scale: Scale,
    /// Where the flight controller is.
    address: String,
    pub(super) stage: Stage,
    /// The command in force.
    pub(super) command: ActuatorCommand,
    pub(super) clock: RealTime,
    pub(super) timeline: Timeline,
    pub(super) controller: FlightController,
    /// What the autopilot at the other end believes, if that is the built-in one.
    pub(super) belief: Option<&'a dyn Fn() -> Option<Belief>>,
    /// Stands by for the built-in autopilot; without it, it lands by ramps.
    planner: Option<Planner>,
    monitor: HandoverMonitor,
    pub(super) live: Live,
}

impl<'a> Run<'a> {
    /// At step 0; `address`: where the flight controller is.
    pub(super) fn new(flight: &'a mut Flight, options: Options, live: Live, address: &str) -> Self {
        let scenario = flight.scenario().clone();
        let step_us = (flight.step_s() * 1e6).round() as u64;
        let fc_timeout = Duration::from_secs_f64(scenario.file.fc_timeout_ms * 1e-3);
        Self {
            scale: scale(&scenario),
            address: address.to_owned(),
            stage: Stage::Waiting,
            command: ActuatorCommand::SAFE,
            clock: RealTime::from_now(flight.time().us(), step_us),
            timeline: Timeline::default(),
            controller: FlightController::new(options.profile.needs_hil_flag, fc_timeout),
            belief: None,
            // Threads begin before the flight does.
            planner: Planner::start()
                .inspect_err(|e| live.notice(format!("no thread to plan on: a fallback lands by ramps: {e}")))
                .ok(),
            monitor: HandoverMonitor::default(),
            scenario,
            flight,
            options,
            live,
        }
    }

    pub(super) fn address(&self) -> &str {
        &self.address
    }

    pub(super) fn step_us(&self) -> u64 {
        (self.flight.step_s() * 1e6).round() as u64
    }

    /// Time on the wire.
    pub(super) fn wire_time(&self) -> SimTime {
        self.timeline.on_wire(self.flight.time())
    }

    pub(super) fn is_over(&self) -> bool {
        self.flight.outcome().is_some()
    }

    /// Whether the next step waits for an answer rather than for the clock.
    pub(super) fn in_lockstep(&self) -> bool {
        self.options.pacing == Pacing::Lockstep && self.controller.answers() && self.stage != Stage::Fallback
    }

    /// Nobody takes the place of a controller that has a vehicle in its hands or waits while time stands.
    pub(super) fn hold(&self) -> Hold {
        let flies = self.controller.is_armed() && self.stage != Stage::Fallback;
        if flies || self.timeline.is_paused() { Hold::Keep } else { Hold::Release }
    }

    /// One step of the plant under the command in force.
    pub(super) fn step(&mut self) {
        self.flight.step(&self.command);
    }

    /// What the step did to a vehicle whose controls have changed hands.
    pub(super) fn watch_handover(&mut self) {
        if let Some(handover) = self.monitor.watch(self.flight.snapshot()) {
            self.flight.note_handover(handover);
        }
    }

    /// The other end has come or gone.
    pub(super) fn take_notice(&mut self, notice: Notice) {
        let address = &self.address;
        match notice {
            Notice::Connected(peer) => self.live.notice(format!("{address}: {peer} is there")),
            Notice::Disconnected(why) => {
                self.live.notice(format!("{address}: lost, {why}"));
                self.controller.disconnect();
            }
            Notice::Refused(peer) => {
                self.live.notice(format!("{address}: {peer} refused, one flight controller at a time"));
            }
        }
    }

    /// Controls of the flight controller, obeyed while it flies. `is_fed`: it gets more than heartbeats.
    /// Whether they count.
    pub(super) fn take_controls(&mut self, controls: &ControlsInput, is_fed: bool) -> bool {
        if self.controller.is_old(controls) {
            self.controller.count_old();
            return false;
        }
        if (self.stage == Stage::Waiting || self.controller.may_be_live()) && !is_fed {
            // Its outputs may be live: nothing flies on them before it says that it is in the loop.
            if self.controller.misses_flag() {
                let address = &self.address;
                self.live.notice(format!(
                    "{address}: controls but no HEARTBEAT with the HIL flag: is SYS_HITL 1?"
                ));
            }
            return false;
        }
        if self.timeline.is_stale(controls.time_us) {
            self.controller.count_old();
            return false;
        }
        let channels = &self.scenario.vehicle.controls;
        let throttle = self.options.profile.throttle;
        let command = match channels.command(&controls.channels, controls.armed, throttle, &self.scale) {
            // Disarmed, the channels mean nothing.
            _ if !controls.armed => ActuatorCommand::SAFE,
            Ok(command) => command,
            Err(invalid) => {
                if self.controller.reject_controls() {
                    self.live.notice(format!("controls refused, the last command holds: {invalid}"));
                }
                return false;
            }
        };
        if self.controller.take_controls(controls, command, self.flight.time()) {
            self.flight.event(EventKind::FcFirst, format!("HIL_ACTUATOR_CONTROLS on {}", self.address));
            self.flight.set_source(self.options.source);
        }
        if self.stage != Stage::Fallback {
            if controls.armed {
                self.stage = Stage::Flying;
            }
            self.command = command;
        }
        true
    }

    /// The built-in autopilot: flies in the fallback, shadows before, and is asked what it believes.
    /// After the samples have left: the other end need not wait for it.
    pub(super) fn consult(&mut self) {
        if self.stage == Stage::Fallback && self.scenario.file.on_fc_loss == OnFcLoss::Autopilot {
            let now = self.flight.time();
            if let Some(planner) = &mut self.planner {
                planner.deliver(self.flight.autopilot(), now);
            }
            if let Some(command) = self.flight.autopilot_command() {
                self.monitor.commanded(&command, now);
                self.command = command;
            }
            if let Some(planner) = &mut self.planner {
                planner.take(self.flight.autopilot());
            }
            if self.flight.has_touched_down() {
                let estimate_ned_m = self.flight.autopilot().estimate().position_ned_m;
                self.flight.set_estimate_at_touchdown(estimate_ned_m);
            }
            return;
        }
        self.flight.shadow(&self.command);
        // What it believed of the flight before is past.
        let belief = self.belief.and_then(|belief| belief());
        if let Some(belief) = belief.filter(|belief| !self.timeline.is_past(belief.time)) {
            self.flight.note_abort(belief.abort);
            self.flight.note_phase(belief.phase);
            self.flight.set_reference_elsewhere(Some(belief.reference_ned_m));
            if self.flight.has_touched_down() {
                self.flight.set_estimate_at_touchdown(belief.estimate_ned_m);
            }
        }
    }

    fn progress(&self) -> Progress {
        Progress {
            now: self.flight.time(),
            sampled: self.timeline.sampled(),
            sample_interval: self.timeline.sample_interval(),
            in_lockstep: self.in_lockstep(),
            speed: self.clock.speed(),
        }
    }

    /// Whether the flight controller is lost, and whether anybody will ever arm.
    pub(super) fn judge(&mut self) {
        let wait_s = self.scenario.file.arm_wait_s;
        if let (Some(first), false) = (self.controller.first(), self.controller.was_ever_armed())
            && wait_s > 0.0
            && self.flight.time().since(first).s() >= wait_s
        {
            self.flight.end(Outcome::Timeout);
        }
        let progress = self.progress();
        let flies = self.stage == Stage::Flying && self.controller.is_armed();
        if self.controller.is_lost(&progress) {
            if flies {
                let why = self.controller.silence(&progress);
                self.hand_over(why);
            } else if progress.in_lockstep {
                self.controller.stop_waiting();
                self.clock.rebase(self.flight.time().us());
                self.live.notice(format!("{}: silent, going on in real time", self.address));
            } else if self.controller.first().is_some()
                && let Some((text, begins)) = self.controller.name_silence()
            {
                self.live.notice(format!("FC silent on {}: {text}", self.address));
                if begins {
                    self.flight.event(EventKind::FcSilent, text);
                }
            }
        } else if self.controller.has_left_the_loop() && flies {
            self.hand_over("HEARTBEAT without the HIL flag: its outputs may be live".to_owned());
        }
    }

    fn hand_over(&mut self, why: String) {
        self.live.notice(format!("FC lost on {}: {why}", self.address));
        self.flight.event(EventKind::FcLost, why);
        self.stage = Stage::Fallback;
        match self.scenario.file.on_fc_loss {
            OnFcLoss::Cut => {
                self.watch_change(None);
                self.command = ActuatorCommand::SAFE;
                self.monitor.commanded(&self.command, self.flight.time());
            }
            OnFcLoss::Autopilot => {
                self.watch_change(Some(Source::Autopilot));
                self.flight.autopilot().take_over();
                self.flight.set_reference_elsewhere(None);
                self.flight.set_source(Source::Autopilot);
                self.flight.event(EventKind::Handover, "the built-in autopilot flies".to_owned());
                self.live.notice("the built-in autopilot flies".to_owned());
            }
        }
        self.clock.rebase(self.flight.time().us());
    }

    /// Gives the controls back to the flight controller, on somebody's request.
    ///
    /// # Errors
    /// When it does not fly the vehicle anyway, or cannot.
    pub(super) fn give_back(&mut self) -> Result<(), &'static str> {
        if self.stage != Stage::Fallback {
            return Err("the flight controller has not been replaced");
        }
        if self.scenario.file.on_fc_loss == OnFcLoss::Cut {
            return Err("the engine was cut");
        }
        let Some(command) = self.controller.command().filter(|command| command.armed) else {
            return Err("the flight controller is not armed");
        };
        // In lockstep nobody has waited for it since; in real time a silent one would be lost again at once.
        if self.controller.is_silent() {
            return Err("the flight controller is silent");
        }
        if self.controller.has_left_the_loop() {
            return Err("the flight controller's HEARTBEAT lacks the HIL flag");
        }
        self.watch_change(Some(self.options.source));
        self.stage = Stage::Flying;
        self.controller.forgive_wait();
        self.command = command;
        self.monitor.commanded(&command, self.flight.time());
        if let Some(planner) = &mut self.planner {
            planner.forget();
        }
        self.flight.set_source(self.options.source);
        self.flight.event(EventKind::Handback, "the flight controller flies".to_owned());
        self.live.notice("the flight controller flies again".to_owned());
        self.clock.rebase(self.flight.time().us());
        Ok(())
    }

    /// Begins to watch what a hand-over does.
    fn watch_change(&mut self, to: Option<Source>) {
        let (heard, heard_ns) = self.controller.heard();
        let before = Situation { vehicle: self.flight.snapshot(), command: self.command, heard, heard_ns };
        if let Some(overtaken) = self.monitor.begin(&before, to) {
            self.flight.note_handover(overtaken);
        }
    }

    /// The hand-over that is still watched is complete.
    pub(super) fn close_handover(&mut self) {
        if let Some(handover) = self.monitor.unfinished() {
            self.flight.note_handover(handover);
        }
    }

    /// Somebody stopped the run.
    pub(super) fn interrupt(&mut self) {
        if !self.is_over() {
            self.flight.event(EventKind::Interrupted, "ended by the user".to_owned());
            self.flight.end(Outcome::Aborted);
        }
    }

    /// A reset ends the flight, if nothing else has.
    pub(super) fn cut_short(&mut self) {
        if !self.is_over() {
            self.flight.event(EventKind::CutShort, "ended by the reset".to_owned());
            self.flight.end(Outcome::Aborted);
        }
    }

    /// Another flight takes the place of the one that is over.
    pub(super) fn begin_again(&mut self, next: Flight) {
        let flown = self.flight.time();
        let mut report = self.flight.report();
        if self.options.source == Source::Fc && !self.scenario.file.fallback_expected {
            report.require_fc();
        }
        let seed = next.seed();
        self.flight.begin_again(next, report);
        self.live.notice(format!("reset: flight {} begins, seed {seed}", self.flight.earlier().len() + 1));
        self.timeline.begin_again(flown);
        self.controller.begin_again();
        if self.stage != Stage::Waiting {
            self.stage = Stage::Pad;
        }
        self.command = ActuatorCommand::SAFE;
        self.monitor = HandoverMonitor::default();
        if let Some(planner) = &mut self.planner {
            planner.forget();
        }
        self.clock.resume_at(flown.us(), self.flight.time().us());
        if self.clock.speed() != 1.0 {
            self.flight.note_modified(&format!("SIM_SPEED {}", self.clock.speed()));
        }
    }
}
