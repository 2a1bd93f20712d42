//! The states of a run and the loop that steps the plant: receive -> step -> send.
//!
//! `waiting -> pad -> flying -> (fallback) -> ended`. Waiting: nobody is at the other end, and simulated time
//! stands still. Pad: time runs, the flight controller is heard or not, nothing is armed. Flying: armed.
//! Fallback: the controller is lost, and the built-in autopilot, which has shadowed the measurements,
//! flies. The loop is the same in real time and in lockstep; they differ in what it waits for:
//!
//! * real time: the deadline of each step on the wall clock, then whatever has been received;
//! * lockstep: after each HIL_SENSOR the answer with its time. Before the first answer, and when the other
//!   end has gone on the pad, the run goes on in real time, since nobody would answer.

mod controller;
mod figures;
mod handover;
mod show;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::controls::Scale;
use hopbench::environment::geodesy::Datum;
use hopbench::scenario::{OnFcLoss, Outcome, Scenario};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::report::{LinkReport, Timing};
use hopbench::simulation::{Flight, Source};
use hopbench::time::SimTime;

use crate::link::Link;
use crate::live::Live;
use crate::mavlink::measurement::TrueState;
use crate::mavlink::{Decoder, FromFc};
use crate::pace::{RealTime, now_ns};
use crate::planner::Planner;
use crate::profile::{Heartbeat, Pacing, Profile};
use crate::stream::Streams;

use controller::FlightController;
use figures::Figures;
use handover::Hands;

/// Longest wait without a look at the request to stop.
const SLICE: Duration = Duration::from_millis(50);

/// How a run is to be made.
#[derive(Clone, Debug)]
pub struct Options {
    /// What the flight controller expects.
    pub profile: &'static Profile,
    /// Who waits for whom.
    pub pacing: Pacing,
    /// Lockstep may run ahead of real time.
    pub fast: bool,
    /// Longest wait for one answer in lockstep.
    pub lockstep_timeout: Duration,
    /// Who sits at the other end.
    pub source: Source,
    /// Symbols a second, where the link has such a rate.
    pub baud: Option<u32>,
}

/// What the autopilot at the other end of the built-in link believes, for the report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// Phase of the mission.
    pub phase: &'static str,
    /// Where it wants it to be (m).
    pub reference_ned_m: hopbench::frame::Vec3,
    /// Where it takes it to be (m).
    pub estimate_ned_m: hopbench::frame::Vec3,
    /// Whether and why it has given the mission up.
    pub abort: Option<hopbench::autopilot::abort::Abort>,
}

/// One run on one link.
pub struct Bench<'a> {
    flight: &'a mut Flight,
    link: &'a mut Link,
    options: Options,
    scenario: Scenario,
    scale: Scale,
    datum: Datum,
    live: Live,
    belief: Option<&'a dyn Fn() -> Option<Belief>>,
    decoder: Decoder,
    streams: Streams,
    fc: FlightController,
    stage: Stage,
    command: ActuatorCommand,
    /// Stands by for the built-in autopilot; without it, it lands by ramps.
    planner: Option<Planner>,
    hands: Hands,
    /// Time between the last two samples.
    sample: SimTime,
    sampled: SimTime,
    clock: RealTime,
    figures: Figures,
    received: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Waiting,
    Pad,
    Flying,
    Fallback,
}

impl<'a> Bench<'a> {
    /// A bench around a flight at step 0.
    pub fn new(flight: &'a mut Flight, link: &'a mut Link, options: Options, live: Live) -> Self {
        let scenario = flight.scenario().clone();
        let site = &scenario.site;
        let datum =
            Datum::new(site.latitude_deg.to_radians(), site.longitude_deg.to_radians(), site.altitude_m);
        let step_us = (flight.step_s() * 1e6).round() as u64;
        Self {
            scale: scale(&scenario),
            datum,
            belief: None,
            decoder: Decoder::default(),
            streams: Streams::new(options.profile),
            fc: FlightController::default(),
            stage: Stage::Waiting,
            command: ActuatorCommand::SAFE,
            // Threads begin before the flight does.
            planner: Planner::start()
                .inspect_err(|e| live.notice(format!("no thread to plan on: a fallback lands by ramps: {e}")))
                .ok(),
            hands: Hands::default(),
            sample: SimTime::ZERO,
            sampled: SimTime::ZERO,
            clock: RealTime::from_now(flight.time().us(), step_us),
            figures: Figures::begin(),
            received: Vec::with_capacity(64 * 1024),
            scenario,
            flight,
            link,
            options,
            live,
        }
    }

    /// Lets the report know what the autopilot at the other end believes.
    #[must_use]
    pub fn believing(mut self, belief: &'a dyn Fn() -> Option<Belief>) -> Self {
        if self.options.source == Source::Autopilot {
            self.flight.set_flown_elsewhere();
        }
        self.belief = Some(belief);
        self
    }

    /// Runs until the flight has ended or `stop` is set; then the flight's report is complete but for what
    /// is returned here.
    pub fn run(mut self, stop: &AtomicBool) -> (Timing, LinkReport) {
        while self.flight.outcome().is_none() {
            if stop.load(Ordering::Relaxed) {
                self.flight.event("abort:interrupted", "ended by the user".to_owned());
                self.flight.end(Outcome::Aborted);
                break;
            }
            match self.stage {
                Stage::Waiting => self.wait_for_somebody(),
                _ if self.in_lockstep() => self.step_and_await(stop),
                Stage::Fallback if self.options.fast => {
                    self.receive();
                    self.step_and_send();
                }
                _ => {
                    let next_us = self.flight.time().us() + self.step_us();
                    self.clock.wait_until(next_us);
                    self.receive();
                    self.step_and_send();
                }
            }
            self.judge();
        }
        if let Some(handover) = self.hands.unfinished() {
            self.flight.note_handover(handover);
        }
        self.finish()
    }

    fn step_us(&self) -> u64 {
        (self.flight.step_s() * 1e6).round() as u64
    }

    /// Whether the next step waits for an answer rather than for the clock.
    fn in_lockstep(&self) -> bool {
        self.options.pacing == Pacing::Lockstep && self.fc.answers && self.stage != Stage::Fallback
    }

    /// Whether anything but heartbeats may be sent.
    fn may_stream(&self) -> bool {
        self.link.has_peer() && (!self.options.profile.needs_hil_flag || self.fc.heartbeat == Some(true))
    }

    /// Simulated time stands still until there is somebody to send to.
    fn wait_for_somebody(&mut self) {
        self.beat();
        self.flush();
        self.link.wait(Instant::now() + Duration::from_millis(20));
        self.receive();
        if self.may_stream() {
            self.stage = Stage::Pad;
            self.clock.rebase(self.flight.time().us());
        }
    }

    /// Heartbeats by the wall clock, while nothing else is sent.
    fn beat(&mut self) {
        let now = now_ns();
        if self.options.profile.heartbeat == Heartbeat::Never
            || now < self.figures.next_heartbeat_ns
            || !self.link.has_peer()
        {
            return;
        }
        let eager =
            self.options.profile.heartbeat == Heartbeat::EagerUntilAnswered && self.fc.heartbeat.is_none();
        self.figures.next_heartbeat_ns = now + if eager { 100_000_000 } else { 1_000_000_000 };
        self.streams.put_heartbeat();
    }

    fn step_and_send(&mut self) {
        self.step();
        if self.flight.measurement().is_some() {
            self.note_sent();
            self.flush();
            self.consult();
        }
    }

    fn step_and_await(&mut self, stop: &AtomicBool) {
        self.step();
        if self.flight.measurement().is_none() {
            return;
        }
        let time_us = self.flight.time().us();
        if !self.options.fast {
            // Never ahead of real time; what a slow answer cost is not made up for.
            self.clock.wait_until(time_us);
            if self.clock.behind_ns(time_us) > 1_000_000 {
                self.clock.rebase(time_us);
            }
        }
        self.fc.answered = false;
        self.note_sent();
        self.flush();
        // While the flight controller thinks.
        self.consult();
        let start = Instant::now();
        let mut patience = self.options.lockstep_timeout;
        if self.fc.armed {
            // A long wait for one answer must not outlast the patience with a silent controller.
            patience = patience.min(self.patience().saturating_sub(self.fc.waited));
        }
        let deadline = start + patience;
        loop {
            self.receive();
            // A controller that has gone and come back starts from the beginning.
            if self.fc.answered || !self.fc.answers || stop.load(Ordering::Relaxed) {
                return;
            }
            let now = Instant::now();
            if now >= deadline {
                break;
            }
            self.link.wait(deadline.min(now + SLICE));
        }
        self.fc.waited += start.elapsed();
        self.figures.stalls += 1;
        self.live.notice(format!(
            "stall: no HIL_ACTUATOR_CONTROLS with time_usec {time_us} within {} ms on {}; the last command holds",
            patience.as_millis(),
            self.link.address()
        ));
    }

    /// One step of the plant under the command in force, and what it gives to send.
    fn step(&mut self) {
        let start_ns = now_ns();
        self.flight.step(&self.command);
        self.figures.step_cost.record_ns(now_ns() - start_ns);
        self.figures.steps += 1;
        if let Some(handover) = self.hands.watch(self.flight.snapshot()) {
            self.flight.note_handover(handover);
        }
        if !self.may_stream() {
            self.beat();
            return;
        }
        let time = self.flight.time();
        let (flight, datum) = (&*self.flight, &self.datum);
        self.streams.put_truth(time, || true_state(flight, datum));
        if let Some(measurement) = self.flight.measurement() {
            (self.sample, self.sampled) = (time.since(self.sampled), time);
            let mut measurement = measurement.clone();
            self.options.profile.clamp(&mut measurement);
            self.streams.put_measurement(&measurement);
        }
    }

    /// The built-in autopilot: flies in the fallback, shadows before, and is asked what it believes.
    /// After the samples have left: the other end need not wait for it.
    fn consult(&mut self) {
        if self.stage == Stage::Fallback && self.scenario.file.on_fc_loss == OnFcLoss::Autopilot {
            let now = self.flight.time();
            if let Some(planner) = &mut self.planner {
                planner.deliver(self.flight.autopilot(), now);
            }
            if let Some(command) = self.flight.autopilot_command() {
                self.hands.commanded(&command, now);
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
        if let Some(belief) = self.belief.and_then(|belief| belief()) {
            self.flight.note_abort(belief.abort);
            self.flight.note_phase(belief.phase);
            self.flight.set_reference_elsewhere(Some(belief.reference_ned_m));
            if self.flight.has_touched_down() {
                self.flight.set_estimate_at_touchdown(belief.estimate_ned_m);
            }
        }
    }

    /// Takes everything that has arrived.
    fn receive(&mut self) {
        self.received.clear();
        self.link.receive(&mut self.received);
        for notice in self.link.take_notices() {
            self.take_notice(notice);
        }
        if self.received.is_empty() {
            return;
        }
        self.decoder.push(&self.received);
        while let Some(frame) = self.decoder.next_frame() {
            let said = frame.from_fc();
            let sender = (frame.system_id, frame.component_id);
            match &said {
                FromFc::Controls(controls) => self.take_controls(controls, sender),
                FromFc::Heartbeat(beat) => self.take_heartbeat(*beat, sender),
                _ => self.streams.answer(&said, self.flight.time()),
            }
        }
    }
}

/// What a normalised command is worth on the scenario's vehicle.
pub fn scale(scenario: &Scenario) -> Scale {
    let vehicle = &scenario.vehicle;
    Scale {
        thrust_rated_n: vehicle.rating.thrust_rated_n,
        valve_open_rad: vehicle.valve_servo.upper_rad,
        gimbal_limit_rad: vehicle.gimbal.limit_rad,
    }
}

fn true_state(flight: &Flight, datum: &Datum) -> TrueState {
    let now = flight.snapshot();
    let place = datum.geodetic(&now.position_ned_m);
    TrueState {
        q_ned_from_body: now.q_ned_from_body,
        rate_body_rad_s: now.rate_body_rad_s,
        latitude_rad: place.latitude_rad,
        longitude_rad: place.longitude_rad,
        altitude_m: place.altitude_m,
        velocity_ned_m_s: now.velocity_ned_m_s,
        airspeed_m_s: (now.velocity_ned_m_s - now.wind_ned_m_s).norm(),
        specific_force_body_m_s2: now.specific_force_body_m_s2,
    }
}
