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

pub mod pace;
pub mod realtime;

pub mod baseline;
pub mod planner;

pub mod failure;
pub mod ground;
pub mod live;
pub mod parameter;
pub mod pilot;

mod controller;
mod figures;
mod handover;
mod service;
mod show;
mod stall;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::controls::Scale;
use hopbench::environment::geodesy::Datum;
use hopbench::scenario::{OnFcLoss, Outcome, Scenario};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::report::{LinkReport, Timing};
use hopbench::simulation::{Flight, Source};
use hopbench::time::SimTime;

use crate::bench::ground::Ground;
use crate::bench::live::Live;
use crate::bench::pace::{RealTime, now_ns};
use crate::bench::pilot::scale;
use crate::bench::planner::Planner;
use crate::wire::disruption::{Disruption, Sample};
use crate::wire::link::Link;
use crate::wire::mavlink::{Decoder, FromFc};
use crate::wire::profile::{Heartbeat, Pacing, Profile, SensorRates};
use crate::wire::stream::Streams;

pub use pilot::Belief;

use controller::FlightController;
use figures::Figures;
use handover::HandoverMonitor;
use service::Services;
use stall::{NAMED_WITHIN, Stall, Stalls};

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

/// One run on one link.
pub struct Bench<'a> {
    flight: &'a mut Flight,
    link: &'a mut Link,
    ground: Option<&'a mut Ground>,
    services: Services,
    /// Whether the bench goes on after a flight, until it is stopped.
    stays: bool,
    options: Options,
    scenario: Scenario,
    scale: Scale,
    datum: Datum,
    live: Live,
    belief: Option<&'a dyn Fn() -> Option<Belief>>,
    decoder: Decoder,
    streams: Streams,
    disruption: Disruption,
    fc: FlightController,
    stage: Stage,
    command: ActuatorCommand,
    /// Stands by for the built-in autopilot; without it, it lands by ramps.
    planner: Option<Planner>,
    hands: HandoverMonitor,
    /// Time between the last two samples.
    sample: SimTime,
    sampled: SimTime,
    clock: RealTime,
    figures: Figures,
    stalls: Stalls,
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
        let rates = SensorRates::of(&scenario.vehicle.sensors, flight.instruments().imu_rate_hz);
        Self {
            services: Services::new(options.profile, &rates, options.baud),
            ground: None,
            stays: false,
            scale: scale(&scenario),
            datum,
            belief: None,
            decoder: Decoder::default(),
            streams: Streams::new(options.profile),
            disruption: Disruption::new(u64::from(flight.seed())),
            fc: FlightController {
                may_be_live: options.profile.needs_hil_flag,
                ..FlightController::default()
            },
            stage: Stage::Waiting,
            command: ActuatorCommand::SAFE,
            // Threads begin before the flight does.
            planner: Planner::start()
                .inspect_err(|e| live.notice(format!("no thread to plan on: a fallback lands by ramps: {e}")))
                .ok(),
            hands: HandoverMonitor::default(),
            sample: SimTime::ZERO,
            sampled: SimTime::ZERO,
            clock: RealTime::from_now(flight.time().us(), step_us),
            figures: Figures::begin(),
            stalls: Stalls::none(),
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

    /// Lets a ground station watch and ask.
    #[must_use]
    pub fn watched(mut self, ground: &'a mut Ground) -> Self {
        self.ground = Some(ground);
        self
    }

    /// Goes on after a flight: it waits for the next reset, until it is stopped.
    #[must_use]
    pub fn staying(mut self) -> Self {
        self.stays = true;
        self
    }

    /// Runs until the flight has ended or `stop` is set; then the flight's report is complete but for what
    /// is returned here.
    pub fn run(mut self, stop: &AtomicBool) -> (Timing, LinkReport) {
        loop {
            let over = self.flight.outcome().is_some();
            if stop.load(Ordering::Relaxed) || (over && !self.stays) {
                break;
            }
            if self.services.begins_again() {
                self.begin_again();
                continue;
            }
            if over || self.services.stands() {
                self.stand_by();
                continue;
            }
            match self.stage {
                Stage::Waiting => self.wait_for_somebody(),
                _ if self.in_lockstep() => self.step_and_await(stop),
                Stage::Fallback if self.options.fast => {
                    self.receive();
                    self.step_and_send();
                }
                _ => {
                    self.listen_until_next_step();
                    let begun_ns = now_ns();
                    self.receive();
                    self.step_and_send();
                    self.figures.cycle_cost.record_ns(now_ns() - begun_ns);
                }
            }
            self.serve_between_samples();
            self.judge();
        }
        if self.flight.outcome().is_none() {
            self.flight.event("abort:interrupted", "ended by the user".to_owned());
            self.flight.end(Outcome::Aborted);
        }
        if let Some(handover) = self.hands.unfinished() {
            self.flight.note_handover(handover);
        }
        self.serve();
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
        self.link.has_peer() && (!self.fc.may_be_live || self.fc.heartbeat == Some(true))
    }

    /// Until the next step is due. While an answer may come the wait is on the link: its arrival is timed, not the step
    /// that finds it there. What it commands holds from the next step on either way.
    fn listen_until_next_step(&mut self) {
        /// The last stretch belongs to the clock alone.
        const GUARD_NS: u64 = 100_000;
        /// A link that never falls silent must not keep the loop awake.
        const LOOKS: usize = 8;
        let next_us = self.flight.time().us() + self.step_us();
        let until_ns = self.clock.deadline_ns(next_us).saturating_sub(GUARD_NS);
        for _ in 0..LOOKS {
            let left_ns = until_ns.saturating_sub(now_ns());
            if left_ns == 0 || !self.figures.awaits_answer() {
                break;
            }
            self.link.wait(Instant::now() + Duration::from_nanos(left_ns));
            self.receive();
        }
        self.clock.wait_until(next_us);
    }

    /// Simulated time stands still until there is somebody to send to.
    fn wait_for_somebody(&mut self) {
        self.beat();
        self.serve();
        self.flush();
        self.link.wait(Instant::now() + Duration::from_millis(20));
        self.receive();
        if self.may_stream() {
            self.stage = Stage::Pad;
            self.clock.start_at(self.flight.time().us());
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
        self.send_what_is_due();
    }

    /// What the step gave to send, and what a bad wire has held back until now. The shadow follows while the
    /// flight controller thinks.
    fn send_what_is_due(&mut self) {
        let sampled = self.flight.measurement().is_some();
        if sampled {
            self.note_sent();
        }
        if sampled || !self.disruption.is_clear() {
            self.serve();
            self.flush();
        }
        if sampled {
            self.consult();
        }
    }

    fn step_and_await(&mut self, stop: &AtomicBool) {
        self.step();
        if self.flight.measurement().is_none() && self.disruption.is_clear() {
            return;
        }
        let time_us = self.flight.time().us();
        if !self.options.fast {
            // Never ahead of real time; what a slow answer cost is not made up for.
            self.clock.wait_until(time_us);
            self.clock.rebase(time_us);
        }
        self.fc.answered = false;
        self.send_what_is_due();
        let Some(Sample { time_us: sample_us, .. }) = self.fc.awaited else { return self.receive() };
        let start = Instant::now();
        let mut patience = self.options.lockstep_timeout;
        if self.fc.armed {
            // A long wait for one answer must not outlast the patience with a silent controller.
            patience = patience.min(self.patience().saturating_sub(self.fc.waited));
        }
        let deadline = start + patience;
        let mut named = start;
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
            if now - named >= NAMED_WITHIN {
                named = now;
                self.live.notice(format!(
                    "waiting for HIL_ACTUATOR_CONTROLS with time_usec {sample_us} on {}, {} s",
                    self.link.address(),
                    (now - start).as_secs()
                ));
            }
            self.link.wait(deadline.min(now + SLICE));
            self.clock.has_rested();
        }
        self.stall(sample_us, start.elapsed());
    }

    /// The wait for the answer to a sample was in vain.
    fn stall(&mut self, sample_us: u64, waited: Duration) {
        self.fc.waited += waited;
        let lost = match self.fc.awaited {
            Some(Sample { lost: true, .. }) => ": a fault of the wire lost it or its sample",
            _ => "",
        };
        let text = format!(
            "no HIL_ACTUATOR_CONTROLS with time_usec {sample_us} within {} ms on {}{lost}; the last command holds",
            waited.as_millis(),
            self.link.address()
        );
        if self.stalls.is_first() {
            self.flight.event("stall", text.clone());
        }
        let now = self.flight.time();
        self.stalls.count(&Stall { now, sample_us, waited, by_fault: !lost.is_empty() }, text);
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
        if self.disruption.set(self.flight.wire_effect()) && self.may_stream() {
            // Straight to it: a bad wire is another matter.
            self.streams.put_reboot(self.fc.address());
            self.send_straight();
        }
        if !self.may_stream() {
            self.beat();
            return;
        }
        let (time, on_wire) = (self.flight.time(), self.wire_time());
        self.streams.put_truth(on_wire, self.flight.snapshot(), &self.datum);
        if let Some(measurement) = self.flight.measurement() {
            (self.sample, self.sampled) = (time.since(self.sampled), time);
            let mut measurement = measurement.clone();
            self.options.profile.clamp(&mut measurement);
            measurement.time = on_wire;
            self.streams.put_measurement(&measurement);
        }
        self.streams.put_plant(on_wire, self.flight.snapshot());
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
        // What it believed of the flight before is past.
        if let Some(belief) = self.belief.and_then(|belief| belief()).filter(|b| !self.is_past(b.time)) {
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
        if !self.disruption.is_clear() {
            let fc = &mut self.fc;
            let now = self.flight.time();
            self.disruption.carry_from_fc(&mut self.received, now, |answer| fc.take_answer(answer));
        }
        if self.received.is_empty() {
            return;
        }
        self.decoder.push(&self.received);
        while let Some(frame) = self.decoder.next_frame_raw(|id, raw| {
            if let Some(ground) = &mut self.ground {
                ground.forward(id, raw);
            }
        }) {
            let said = frame.from_fc();
            let sender = frame.sender;
            match &said {
                FromFc::Controls(controls) => self.take_controls(controls, sender, frame.sequence),
                FromFc::Heartbeat(beat) => self.take_heartbeat(*beat, sender),
                _ => self.take_request(&said),
            }
        }
    }
}
