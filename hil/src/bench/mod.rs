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
pub(crate) mod realtime;

pub(crate) mod baseline;
pub mod planner;

pub mod live;
pub mod parameter;
pub mod pilot;

pub mod ground;

mod controller;
mod handover;
mod options;
mod stall;
mod timeline;

mod run;

mod carry_out;
mod figures;
mod status_line;

mod service;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::environment::geodesy::Datum;
use hopbench::event::EventKind;
use hopbench::simulation::report::{LinkReport, Timing};
use hopbench::simulation::{Flight, Source};
use hopbench::time::SimTime;

use crate::wire::disruption::Sample;
use crate::wire::fc_link::{FcLink, FcMessage};
use crate::wire::link::{Link, Notice};
use crate::wire::profile::{Heartbeat, SensorRates};
use crate::wire::request::ControlsInput;

pub use options::Options;
pub use pilot::Belief;

use figures::Figures;
use ground::{FromGround, Ground, View};
use live::Live;
use pace::now_ns;
use run::{Run, Stage};
use service::{Port, Services};
use stall::{NAMED_WITHIN, Stall, Stalls};
use status_line::StatusLine;

/// Longest wait without a look at the request to stop.
const SLICE: Duration = Duration::from_millis(50);
/// Longest wait while simulated time stands.
const IDLE: Duration = Duration::from_millis(20);
/// Without a sample for this long, services no longer wait for one.
const QUIET: SimTime = SimTime::from_us(40_000);
/// Between two heartbeats, and between two to a controller that has not answered yet (ns).
const HEARTBEAT_NS: u64 = 1_000_000_000;
const EAGER_HEARTBEAT_NS: u64 = 100_000_000;

/// One run on one link.
pub struct Bench<'a> {
    run: Run<'a>,
    wire: FcLink<'a>,
    services: Services,
    ground: Option<&'a mut Ground>,
    datum: Datum,
    figures: Figures,
    stalls: Stalls,
    status_line: StatusLine,
    /// Whether the bench goes on after a flight, until it is stopped.
    stays: bool,
}

impl<'a> Bench<'a> {
    /// A bench around a flight at step 0.
    pub fn new(flight: &'a mut Flight, link: &'a mut Link, options: Options, live: Live) -> Self {
        let site = &flight.scenario().site;
        let datum =
            Datum::new(site.latitude_deg.to_radians(), site.longitude_deg.to_radians(), site.altitude_m);
        let rates = SensorRates::of(&flight.scenario().vehicle.sensors, flight.instruments().imu_rate_hz);
        let wire = FcLink::new(link, options.profile, flight.seed());
        Self {
            services: Services::new(options.profile, &rates, options.baud),
            run: Run::new(flight, options, live, wire.address()),
            wire,
            ground: None,
            datum,
            figures: Figures::begin(),
            stalls: Stalls::none(),
            status_line: StatusLine::begin(),
            stays: false,
        }
    }

    /// Lets the report know what the autopilot at the other end believes.
    #[must_use]
    pub fn with_belief(mut self, belief: &'a dyn Fn() -> Option<Belief>) -> Self {
        if self.run.options.source == Source::Autopilot {
            self.run.flight.set_flown_elsewhere();
        }
        self.run.belief = Some(belief);
        self
    }

    /// Lets a ground station watch and ask.
    #[must_use]
    pub fn with_ground(mut self, ground: &'a mut Ground) -> Self {
        self.ground = Some(ground);
        self
    }

    /// Goes on after a flight: it waits for the next reset, until it is stopped.
    #[must_use]
    pub fn until_stopped(mut self) -> Self {
        self.stays = true;
        self
    }

    /// Runs until the flight has ended or `stop` is set; then the flight's report is complete but for what
    /// is returned here.
    pub fn run(mut self, stop: &AtomicBool) -> (Timing, LinkReport) {
        loop {
            let over = self.run.is_over();
            if stop.load(Ordering::Relaxed) || (over && !self.stays) {
                break;
            }
            if self.run.timeline.has_next_flight() {
                self.begin_again();
            } else if over || self.run.timeline.stands() {
                self.stand_by();
            } else {
                self.advance(stop);
                self.serve_between_samples();
                self.judge();
            }
        }
        self.run.interrupt();
        self.run.close_handover();
        self.serve();
        self.finish()
    }

    /// One step, unless nobody is there to step for.
    fn advance(&mut self, stop: &AtomicBool) {
        match self.run.stage {
            Stage::Waiting => self.wait_for_somebody(),
            _ if self.run.in_lockstep() => self.step_and_await(stop),
            Stage::Fallback if self.run.options.fast => {
                self.receive();
                self.step();
                self.send();
            }
            _ => {
                self.listen_until_next_step();
                let begun_ns = now_ns();
                self.receive();
                self.step();
                self.send();
                self.figures.note_cycle(begun_ns);
            }
        }
    }

    // ---------------------------------------------------------------------------------------------- receive

    /// Takes everything that has arrived.
    fn receive(&mut self) {
        let (hold, now, controller) = (self.run.hold(), self.run.flight.time(), &mut self.run.controller);
        for notice in self.wire.receive(hold, now, |answer| controller.take_answer(answer)) {
            self.run.take_notice(notice);
        }
        while let Some(message) = self.wire.next_message(|id, raw| {
            if let Some(ground) = &mut self.ground {
                ground.forward(id, raw);
            }
        }) {
            match message {
                FcMessage::Controls(controls) => self.take_controls(&controls),
                FcMessage::Status(status) => {
                    self.run.controller.take_status(status, self.run.options.profile.answers);
                }
                FcMessage::Inquiry(inquiry) => {
                    self.services.answer(inquiry, &mut self.run, Port::Fc(&mut self.wire));
                }
            }
        }
    }

    fn take_controls(&mut self, controls: &ControlsInput) {
        self.stalls.answered(controls.time_us);
        let is_fed = self.may_stream();
        if !self.run.take_controls(controls, is_fed) {
            return;
        }
        let echo_ms = self.run.scenario.vehicle.controls.echo_ms(&controls.channels);
        self.figures.note_controls(controls.time_us, echo_ms, self.run.controller.gap_ns());
        if self.wire.is_sound() {
            self.run.controller.take_answer(Sample { time_us: controls.time_us, lost: false });
        }
    }

    /// Simulated time stands still until there is somebody to send to.
    fn wait_for_somebody(&mut self) {
        self.beat();
        self.serve();
        self.flush();
        self.wire.wait(Instant::now() + IDLE);
        self.receive();
        if self.may_stream() {
            self.run.stage = Stage::Pad;
            self.run.clock.start_at(self.run.flight.time().us());
        }
    }

    /// Simulated time stands: heartbeats and services go on.
    fn stand_by(&mut self) {
        // To everyone, lest a long pause looks like the end.
        self.wire.beat(now_ns(), HEARTBEAT_NS);
        self.serve();
        self.flush();
        self.wire.wait(Instant::now() + IDLE);
        self.receive();
        let now_us = self.run.flight.time().us();
        self.run.clock.resume_at(now_us, now_us);
    }

    /// Until the next step is due. While an answer may come the wait is on the link: its arrival is timed,
    /// not the step that finds it there. What it commands holds from the next step on either way.
    fn listen_until_next_step(&mut self) {
        /// The last stretch belongs to the clock alone.
        const GUARD_NS: u64 = 100_000;
        /// A link that never falls silent must not keep the loop awake.
        const LOOKS: usize = 8;
        let next_us = self.run.flight.time().us() + self.run.step_us();
        let until_ns = self.run.clock.deadline_ns(next_us).saturating_sub(GUARD_NS);
        for _ in 0..LOOKS {
            let left_ns = until_ns.saturating_sub(now_ns());
            if left_ns == 0 || !self.figures.awaits_answer() {
                break;
            }
            self.wire.wait(Instant::now() + Duration::from_nanos(left_ns));
            self.receive();
        }
        self.run.clock.wait_until(next_us);
    }

    // ------------------------------------------------------------------------------------------------- step

    /// One step of the plant under the command in force, and what it gives to send.
    fn step(&mut self) {
        let start_ns = now_ns();
        self.run.step();
        self.figures.note_step(start_ns);
        self.run.watch_handover();
        if self.wire.set_effect(self.run.flight.wire_effect()) && self.may_stream() {
            self.wire.send_reboot();
        }
        if !self.may_stream() {
            self.beat();
            return;
        }
        let (now, on_wire) = (self.run.flight.time(), self.run.wire_time());
        let streams = &mut self.wire.streams;
        streams.put_truth(on_wire, self.run.flight.snapshot(), &self.datum);
        if let Some(measurement) = self.run.flight.measurement() {
            self.run.timeline.note_sample(now);
            let mut measurement = measurement.clone();
            self.run.options.profile.clamp(&mut measurement);
            measurement.time = on_wire;
            streams.put_measurement(&measurement);
        }
        streams.put_plant(on_wire, self.run.flight.snapshot());
    }

    fn step_and_await(&mut self, stop: &AtomicBool) {
        self.step();
        if self.run.flight.measurement().is_none() && self.wire.is_sound() {
            return;
        }
        let time_us = self.run.flight.time().us();
        if !self.run.options.fast {
            // Never ahead of real time; what a slow answer cost is not made up for.
            self.run.clock.wait_until(time_us);
            self.run.clock.rebase(time_us);
        }
        self.run.controller.begin_step();
        self.send();
        match self.run.controller.awaited() {
            Some(sample) => self.await_answer(sample.time_us, stop),
            None => self.receive(),
        }
    }

    /// Waits for the answer to the sample of this time on the wire.
    fn await_answer(&mut self, sample_us: u64, stop: &AtomicBool) {
        let start = Instant::now();
        let mut patience = self.run.options.lockstep_timeout;
        if self.run.controller.is_armed() {
            // A long wait for one answer must not outlast the patience with a silent controller.
            let interval = self.run.timeline.sample_interval();
            patience = patience.min(self.run.controller.patience_left(interval));
        }
        let deadline = start + patience;
        let mut named = start;
        loop {
            self.receive();
            // A controller that has gone and come back starts from the beginning.
            let controller = &self.run.controller;
            if controller.has_answered() || !controller.answers() || stop.load(Ordering::Relaxed) {
                return;
            }
            let now = Instant::now();
            if now >= deadline {
                break;
            }
            if now - named >= NAMED_WITHIN {
                named = now;
                self.run.live.notice(format!(
                    "waiting for HIL_ACTUATOR_CONTROLS with time_usec {sample_us} on {}, {} s",
                    self.run.address(),
                    (now - start).as_secs()
                ));
            }
            self.wire.wait(deadline.min(now + SLICE));
            self.run.clock.has_rested();
        }
        self.stall(sample_us, start.elapsed());
    }

    /// The wait for the answer to a sample was in vain.
    fn stall(&mut self, sample_us: u64, waited: Duration) {
        self.run.controller.add_wait(waited);
        let lost = match self.run.controller.awaited() {
            Some(Sample { lost: true, .. }) => ": a fault of the wire lost it or its sample",
            _ => "",
        };
        let text = format!(
            "no HIL_ACTUATOR_CONTROLS with time_usec {sample_us} within {} ms on {}{lost}; \
             the last command holds",
            waited.as_millis(),
            self.run.address()
        );
        if self.stalls.is_first() {
            self.run.flight.event(EventKind::Stall, text.clone());
        }
        let now = self.run.flight.time();
        self.stalls.count(&Stall { now, sample_us, waited, by_fault: !lost.is_empty() }, text);
    }

    // ------------------------------------------------------------------------------------------------- send

    /// What the step gave to send, and what a bad wire has held back until now. The shadow follows while the
    /// flight controller thinks.
    fn send(&mut self) {
        let sampled = self.run.flight.measurement().is_some();
        if sampled {
            self.figures.note_sent(self.run.wire_time().us());
        }
        if sampled || !self.wire.is_sound() {
            self.serve();
            self.flush();
        }
        if sampled {
            self.run.consult();
        }
    }

    /// Sends what waits: through a bad wire, if it is one.
    fn flush(&mut self) {
        if self.wire.is_sound() {
            let time_us = self.run.wire_time().us();
            let sampled = self.run.flight.measurement().is_some();
            self.run.controller.await_answer_to(sampled.then_some(Sample { time_us, lost: false }));
            self.wire.send();
        } else {
            let newest = self.wire.send_through_disruption(self.run.flight.time());
            self.run.controller.await_answer_to_delivered(newest);
        }
    }

    /// Whether anything but heartbeats may be sent.
    fn may_stream(&self) -> bool {
        self.wire.has_peer() && self.run.controller.may_be_fed()
    }

    /// Heartbeats by the wall clock, while nothing else is sent.
    fn beat(&mut self) {
        let interval_ns = match self.run.options.profile.heartbeat {
            Heartbeat::Never => return,
            Heartbeat::EagerUntilAnswered if !self.run.controller.has_heartbeat() => EAGER_HEARTBEAT_NS,
            Heartbeat::EagerUntilAnswered | Heartbeat::EverySecond => HEARTBEAT_NS,
        };
        self.wire.beat(now_ns(), interval_ns);
    }

    // ------------------------------------------------------------------------------------ services, verdicts

    /// Hears the ground station, tells what happened, and puts out what waits, as far as the wires have room.
    /// After the samples of an instant, which go first.
    fn serve(&mut self) {
        self.hear_ground();
        self.tell_events();
        let now_ns = now_ns();
        // A board that is not in the loop gets nothing but heartbeats, from a ground station neither.
        if self.may_stream() {
            let forwarded = self.services.put_out(now_ns, &self.run, &mut self.wire);
            if let Some(ground) = &mut self.ground {
                ground.note_forwarded(forwarded);
            }
        }
        if let Some(ground) = &mut self.ground {
            let view = View {
                flight: self.run.flight,
                datum: &self.datum,
                time_us: self.run.wire_time().us(),
                is_armed: self.run.command.armed,
            };
            ground.speak(now_ns, &view, |index| self.services.parameter(&self.run, index));
        }
    }

    /// A broken inertial unit ends the samples, but not the services.
    fn serve_between_samples(&mut self) {
        let flight = &self.run.flight;
        if flight.measurement().is_none() && flight.time().since(self.run.timeline.sampled()) >= QUIET {
            self.serve();
            self.flush();
        }
    }

    fn hear_ground(&mut self) {
        let may_stream = self.may_stream();
        let Some(ground) = &mut self.ground else { return };
        let (heard, notices) = ground.receive();
        for notice in notices {
            let what = match notice {
                Notice::Connected(peer) => format!("{peer} is there"),
                Notice::Disconnected(why) => format!("lost, {why}"),
                Notice::Refused(peer) => format!("{peer} refused, one at a time"),
            };
            self.run.live.notice(format!("ground station on {}: {what}", ground.address()));
        }
        for message in heard {
            match message {
                FromGround::Forward(raw) => {
                    if !may_stream || !self.services.forward(raw) {
                        ground.note_dropped();
                    }
                }
                FromGround::Inquiry(inquiry) => {
                    self.services.answer(inquiry, &mut self.run, Port::Ground(ground));
                }
            }
        }
    }

    fn tell_events(&mut self) {
        self.services.tell_events(self.run.flight, self.ground.as_deref_mut());
    }

    /// Whether the flight controller is lost, whether anybody will ever arm, and what a person should know.
    fn judge(&mut self) {
        self.run.judge();
        if let Some(text) = self.stalls.notice(now_ns()) {
            self.run.live.notice(text);
        }
        self.status_line.inform(&mut self.run, &self.wire);
    }

    /// Begins a new flight.
    fn begin_again(&mut self) {
        let Some(next) = self.run.timeline.take_next_flight() else { return };
        self.run.close_handover();
        self.run.flight.event(EventKind::Reset, "a new flight begins".to_owned());
        self.tell_events();
        self.run.cut_short();
        // The answer to whoever asked, and how the flight ended, go before the mark of the new one.
        self.serve();
        self.flush();
        self.wire.begin_again(next.seed());
        self.services.begin_again();
        self.run.begin_again(*next);
        if self.may_stream() {
            self.wire.streams.put_reset(self.run.wire_time());
            self.flush();
        }
    }

    fn finish(mut self) -> (Timing, LinkReport) {
        let now_ns = now_ns();
        if let Some(text) = self.stalls.remaining(now_ns) {
            self.run.live.notice(text);
        }
        self.figures.close(self.run.controller.gap_ns());
        let timing = self.figures.timing(&self.run);
        // From the first sample on; waiting for somebody is no use of the wire.
        let streamed_s =
            self.run.clock.anchored_ns().map_or(0.0, |anchored_ns| (now_ns - anchored_ns) as f64 * 1e-9);
        let mut link = self.wire.report(streamed_s, self.run.options.baud);
        (link.controls_refused, link.controls_old) = self.run.controller.refused();
        (link.stalls, link.stalled) = self.stalls.report();
        self.figures.report_gaps(&mut link);
        (timing, link)
    }
}
