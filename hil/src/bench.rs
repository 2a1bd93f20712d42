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

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::controls::Scale;
use hopbench::environment::geodesy::Datum;
use hopbench::scenario::{OnFcLoss, Outcome, Scenario};
use hopbench::signal::{ActuatorCommand, Throttle};
use hopbench::simulation::report::{LinkReport, Percentiles, TailPercentiles, Timing};
use hopbench::simulation::{Flight, Source};
use hopbench::time::SimTime;

use crate::link::{Link, Notice};
use crate::live::Live;
use crate::mavlink::measurement::TrueState;
use crate::mavlink::{ControlsFrame, Decoder, FromFc, Heartbeat as HeartbeatFrame, MODE_HIL};
use crate::pace::{Distribution, RealTime, now_ns};
use crate::planner::Planner;
use crate::profile::{Heartbeat, Pacing, Profile};
use crate::stream::Streams;

/// MAV_COMP_ID_AUTOPILOT1
const AUTOPILOT_COMPONENT: u8 = 1;
/// MAV_AUTOPILOT_INVALID: a component that is no flight controller.
const AUTOPILOT_INVALID: u8 = 8;
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
    /// From the hand-over on.
    planner: Option<Planner>,
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

/// What is known of the other end.
#[derive(Debug, Default)]
struct FlightController {
    /// Its HEARTBEAT was heard, and whether the last one carried the HIL flag.
    heartbeat: Option<bool>,
    /// System and component that send controls.
    sender: Option<(u8, u8)>,
    /// That controls came before the HIL flag has been said.
    flag_missed: bool,
    /// First HIL_ACTUATOR_CONTROLS, simulated time.
    first: Option<SimTime>,
    /// It answers HIL_SENSOR: lockstep may wait for it.
    answers: bool,
    /// The answer that lockstep waits for has come.
    answered: bool,
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
}

/// What the run is measured by.
#[derive(Debug)]
struct Figures {
    start_ns: u64,
    step_cost: Distribution,
    round_trip: Distribution,
    steps: u64,
    stalls: u64,
    /// Frames encoded before, taken by the link and thrown away.
    encoded: u64,
    taken: u64,
    dropped: u64,
    /// HIL_SENSOR times and when they left, for the round trip.
    sent: [(u64, u64); 64],
    next_heartbeat_ns: u64,
    next_message_ns: u64,
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
            planner: None,
            clock: RealTime::from_now(flight.time().us(), step_us),
            figures: Figures {
                start_ns: now_ns(),
                step_cost: Distribution::new(),
                round_trip: Distribution::new(),
                steps: 0,
                stalls: 0,
                encoded: 0,
                taken: 0,
                dropped: 0,
                sent: [(0, 0); 64],
                next_heartbeat_ns: 0,
                next_message_ns: now_ns() + 1_000_000_000,
            },
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
            patience = patience.min(self.fc_timeout().saturating_sub(self.fc.waited));
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
        if !self.may_stream() {
            self.beat();
            return;
        }
        let time = self.flight.time();
        let (flight, datum) = (&*self.flight, &self.datum);
        self.streams.put_truth(time, || true_state(flight, datum));
        if let Some(measurement) = self.flight.measurement() {
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

    fn flush(&mut self) {
        let taken = self.link.send(self.streams.bytes());
        self.streams.bytes().clear();
        let frames = self.streams.frames() - self.figures.encoded;
        self.figures.encoded += frames;
        *(if taken { &mut self.figures.taken } else { &mut self.figures.dropped }) += frames;
    }

    fn note_sent(&mut self) {
        let time_us = self.flight.time().us();
        let slot = (time_us / 1000) as usize % self.figures.sent.len();
        self.figures.sent[slot] = (time_us, now_ns());
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

    fn take_notice(&mut self, notice: Notice) {
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
    fn take_heartbeat(&mut self, beat: HeartbeatFrame, sender: (u8, u8)) {
        let ours = match self.fc.sender {
            Some(known) => sender == known,
            None => sender.1 == AUTOPILOT_COMPONENT,
        };
        if ours && beat.autopilot != AUTOPILOT_INVALID {
            self.fc.heartbeat = Some(beat.base_mode & MODE_HIL != 0);
        }
    }

    fn take_controls(&mut self, frame: &ControlsFrame, sender: (u8, u8)) {
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
        if self.stage == Stage::Fallback {
            return;
        }
        if armed {
            self.stage = Stage::Flying;
        }
        self.command = command;
    }

    /// Whether the flight controller is lost, whether anybody will ever arm, and what a person should know.
    fn judge(&mut self) {
        let wait_s = self.scenario.file.arm_wait_s;
        if let (Some(first), false) = (self.fc.first, self.fc.ever_armed)
            && wait_s > 0.0
            && self.flight.time().since(first).s() >= wait_s
        {
            self.flight.end(Outcome::Timeout);
        }
        if self.is_lost() {
            if self.stage == Stage::Flying && self.fc.armed {
                self.hand_over();
            } else if self.in_lockstep() {
                self.fc.answers = false;
                self.clock.rebase(self.flight.time().us());
                self.live.notice(format!("{}: silent, going on in real time", self.link.address()));
            }
        }
        self.inform();
    }

    /// Silence after which the flight controller counts as lost.
    fn fc_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.scenario.file.fc_timeout_ms * 1e-3)
    }

    fn is_lost(&self) -> bool {
        let timeout = self.fc_timeout();
        if self.in_lockstep() {
            return self.fc.waited >= timeout;
        }
        // A bench that catches up runs faster than the controller can: both clocks must agree.
        let silent = Duration::from_micros(self.flight.time().since(self.fc.heard).us());
        silent >= timeout && Duration::from_nanos(now_ns().saturating_sub(self.fc.heard_ns)) >= timeout
    }

    fn hand_over(&mut self) {
        let silent = if self.in_lockstep() {
            format!("{} ms waited in lockstep", self.fc.waited.as_millis())
        } else {
            format!(
                "{:.0} ms without HIL_ACTUATOR_CONTROLS",
                self.flight.time().since(self.fc.heard).s() * 1e3
            )
        };
        let silent = match self.fc.rejected {
            0 => silent,
            rejected => format!("{silent}, {rejected} frames refused"),
        };
        self.live.notice(format!("FC lost on {}: {silent}", self.link.address()));
        self.flight.event("fc_lost", silent);
        self.stage = Stage::Fallback;
        self.clock.rebase(self.flight.time().us());
        match self.scenario.file.on_fc_loss {
            OnFcLoss::Cut => self.command = ActuatorCommand::SAFE,
            OnFcLoss::Autopilot => {
                self.flight.autopilot().take_over();
                match Planner::start() {
                    Ok(planner) => self.planner = Some(planner),
                    Err(e) => self.live.notice(format!("no thread to plan on, landing by ramps: {e}")),
                }
                self.flight.set_reference_elsewhere(None);
                self.flight.set_source(Source::Autopilot);
                self.flight.event("handover", "the built-in autopilot flies".to_owned());
                self.live.notice("the built-in autopilot flies".to_owned());
            }
        }
    }

    fn inform(&mut self) {
        let now = now_ns();
        if self.fc.first.is_none() {
            if now >= self.figures.next_message_ns {
                self.figures.next_message_ns = now + 1_000_000_000;
                let bytes = self.link.counters().received_bytes;
                let nonsense = bytes > 0 && self.decoder.counters().frames == 0;
                let hint = match (nonsense, self.options.baud) {
                    (true, Some(_)) => ", no MAVLink in them: wrong baud rate?",
                    (true, None) => ", no MAVLink in them",
                    _ => "",
                };
                self.live.notice(format!("waiting for FC on {}, {bytes} bytes{hint}", self.link.address()));
            }
            return;
        }
        let (flight, command, stage) = (&*self.flight, &self.command, self.stage);
        let (source, clock, ever_armed) = (self.options.source, &mut self.clock, self.fc.ever_armed);
        let idle = if ever_armed { "disarmed" } else { "pad" };
        self.live.show(now, || live_line(flight, command, stage, source, idle, clock.recent_lateness_us()));
    }

    fn finish(self) -> (Timing, LinkReport) {
        let wall_s = (now_ns() - self.figures.start_ns) as f64 * 1e-9;
        let simulated_s = self.flight.time().s();
        let counters = self.decoder.counters();
        let sent_bytes = self.link.counters().sent_bytes as f64;
        let paced = !(self.options.fast && self.options.pacing == Pacing::Lockstep);
        let timing = Timing {
            simulated_s,
            wall_s,
            realtime_factor: if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 },
            steps: self.figures.steps,
            overruns: self.clock.overruns(),
            step_us: percentiles(&self.figures.step_cost),
            lateness_us: if paced { tail(self.clock.lateness()) } else { None },
            round_trip_us: percentiles(&self.figures.round_trip),
        };
        let link = LinkReport {
            sent: self.figures.taken,
            dropped: self.figures.dropped,
            received: counters.frames,
            crc_errors: counters.crc_errors,
            lost: counters.lost,
            skipped_bytes: counters.skipped_bytes,
            refused: self.link.counters().refused,
            stalls: self.figures.stalls,
            // Ten symbols to a byte.
            wire_load_percent: self
                .options
                .baud
                .filter(|_| wall_s > 0.0)
                .map(|baud| sent_bytes * 10.0 / f64::from(baud) / wall_s * 100.0),
        };
        (timing, link)
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

fn live_line(
    flight: &Flight,
    command: &ActuatorCommand,
    stage: Stage,
    source: Source,
    idle: &'static str,
    late_us: f64,
) -> String {
    let now = flight.snapshot();
    let who = match (stage, source) {
        (Stage::Fallback, _) => "fallback",
        (_, Source::Fc) => "FC",
        (_, Source::Autopilot) => "autopilot",
        (_, Source::Commands) => "commands",
    };
    let asked_n = match command.throttle {
        Throttle::ThrustN(thrust_n) => thrust_n,
        Throttle::ValveRad(_) => now.thrust_command_n,
    };
    let phase = flight.phase().unwrap_or(if command.armed { "armed" } else { idle });
    format!(
        "{:7.2} s {phase:<9} h {:6.2} m  v {:+5.2} m/s  thrust {:4.0}/{asked_n:4.0} N  valve {:4.1} deg  \
         Pc {:4.1} bar  N2O {:5.2} kg  {who}  late {late_us:.0} us",
        now.time.s(),
        now.height_m,
        -now.velocity_ned_m_s.z,
        now.thrust_n,
        now.valve_rad.to_degrees(),
        now.chamber_pa * 1e-5,
        now.nitrous_kg,
    )
}

fn percentiles(distribution: &Distribution) -> Option<Percentiles> {
    (!distribution.is_empty()).then(|| Percentiles {
        p50: distribution.quantile_us(0.5),
        p99: distribution.quantile_us(0.99),
        max: distribution.max_us(),
    })
}

fn tail(distribution: &Distribution) -> Option<TailPercentiles> {
    (!distribution.is_empty()).then(|| TailPercentiles {
        p50: distribution.quantile_us(0.5),
        p99: distribution.quantile_us(0.99),
        p999: distribution.quantile_us(0.999),
        max: distribution.max_us(),
    })
}
