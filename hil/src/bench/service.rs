//! What a flight controller or a ground station may ask of the bench, and the truthful answer.
//!
//! Requests come as MAVLink commands and parameters, become a [`Request`], and one function carries them out. Whatever
//! changes a run in its course is an event, and marks the run as modified.
//!
//! | asked by | means |
//! |---|---|
//! | MAV_CMD_DO_PAUSE_CONTINUE 0, 1; SIM_PAUSE | simulated time stands; runs on |
//! | SIM_STEP n | while it stands: n steps of the plant |
//! | SIM_SPEED x | simulated seconds to a second |
//! | MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN 1, to the bench itself; SIM_RESET 1 | a new flight |
//! | MAV_CMD_NAV_GUIDED_ENABLE 1 | controls back to the flight controller |
//! | MAV_CMD_INJECT_FAILURE; F_* | a fault, or its end |
//! | WIND_*, THRUST_BIAS, MISALIGN_*, FORCE_* | wind and disturbance on top of the scenario's |
//! | MAV_CMD_SET_MESSAGE_INTERVAL | how often a message comes |

use std::collections::VecDeque;

use hopbench::fault::{Component, Fault, Mode, Row};
use hopbench::scenario::Outcome;
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::report::CUT_SHORT;
use hopbench::simulation::{Flight, Source};
use hopbench::time::SimTime;

use super::controller::FlightController;
use super::handover::HandoverMonitor;
use super::{Bench, Stage};
use crate::bench::failure::{Failure, failure};
use crate::bench::ground::{FromGround, GROUND_ADDRESS, View};
use crate::bench::pace::now_ns;
use crate::bench::parameter::{Parameter, What, as_typed, parameters};
use crate::wire::disruption::Disruption;
use crate::wire::link::{Hold, Notice};
use crate::wire::mavlink::{
    Command, FromFc, GUIDED_ENABLE, INJECT_FAILURE, MavMessage, PAUSE_CONTINUE, ParameterKey, REBOOT,
    RESULT_ACCEPTED, RESULT_DENIED, RESULT_UNSUPPORTED, SET_MESSAGE_INTERVAL, Severity, parameter_value,
};
use crate::wire::profile::{Profile, SensorRates};
use crate::wire::reply::{ByteBudget, ReplyQueue};
use crate::wire::stream::{self, Refusal};

/// Frames of a ground station that wait for room on the flight controller's wire.
const QUEUE: usize = 64;
/// STATUSTEXT's number: the flight controller hears of events once it asks for it.
const STATUS_TEXT_ID: u32 = 253;
/// Without a sample for this long, services no longer wait for one.
const QUIET: SimTime = SimTime::from_us(40_000);
/// No message comes oftener when it is asked for (us): a sample is 4 ms at the usual 250 Hz.
const LEAST_INTERVAL_US: u64 = 4_000;
/// After a reset, answers to the flight before are not obeyed for this long (ns).
const STALE_NS: u64 = 200_000_000;

/// Where a request comes from, and its answer goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Port {
    Fc,
    Ground,
}

/// Something that the bench can do.
#[derive(Clone, Debug, PartialEq)]
enum Request {
    Reset,
    Pause,
    Resume,
    Step(u64),
    Speed(f64),
    Seed(u32),
    GiveBack,
    Break(Vec<Fault>),
    /// What acts in these components; all modes, or one.
    Mend(Vec<Component>, Option<Mode>),
    /// A parameter of wind or disturbance.
    Interfere(What, f64),
}

/// MAV_RESULT, and why if it is not accepted.
type Answer = Result<(), (u8, String)>;

/// What is open between the bench and those who ask.
pub(super) struct Services {
    parameters: Vec<Parameter>,
    replies: ReplyQueue,
    budget: ByteBudget,
    /// What the profile's streams leave of the line (byte/s).
    spare_bytes_s: f64,
    tells_events: bool,
    /// Events told so far.
    told: usize,
    /// Frames of a ground station on their way to the flight controller.
    to_fc: VecDeque<Vec<u8>>,
    paused: bool,
    steps: u64,
    next_seed: Option<u32>,
    /// The flight that somebody has asked for and that could be set up.
    fresh: Option<Box<Flight>>,
    /// Added to the time of the flight, so that time on the wire never goes back.
    offset: SimTime,
    /// Until this wall time answers to the flight before are not obeyed.
    stale_ns: u64,
}

impl Services {
    pub(super) fn new(profile: &Profile, rates: &SensorRates, baud: Option<u32>) -> Self {
        let spare_bytes_s = baud.map(|baud| profile.spare_bytes_s(rates, baud));
        Self {
            parameters: parameters(),
            replies: ReplyQueue::default(),
            budget: spare_bytes_s.map_or_else(ByteBudget::socket, ByteBudget::new),
            spare_bytes_s: spare_bytes_s.unwrap_or(f64::INFINITY),
            tells_events: false,
            told: 0,
            to_fc: VecDeque::new(),
            paused: false,
            steps: 0,
            next_seed: None,
            fresh: None,
            offset: SimTime::ZERO,
            stale_ns: 0,
        }
    }

    /// Whether somebody has asked for a new flight since.
    pub(super) fn begins_again(&self) -> bool {
        self.fresh.is_some()
    }

    /// Whether simulated time stands until somebody lets it go on; a step that was asked for is taken off.
    pub(super) fn stands(&mut self) -> bool {
        if !self.paused {
            return false;
        }
        let stands = self.steps == 0;
        self.steps = self.steps.saturating_sub(1);
        stands
    }
}

fn denied<T>(why: impl Into<String>) -> Result<T, (u8, String)> {
    Err((RESULT_DENIED, why.into()))
}

fn unsupported<T>(why: impl Into<String>) -> Result<T, (u8, String)> {
    Err((RESULT_UNSUPPORTED, why.into()))
}

impl Bench<'_> {
    /// Time on the wire: that of the flights before, and of this one.
    pub(super) fn wire_time(&self) -> SimTime {
        self.services.offset + self.flight.time()
    }

    /// Whether a time on the wire belongs to a flight before.
    pub(super) fn is_past(&self, time: SimTime) -> bool {
        time < self.services.offset
    }

    /// Whether controls answer a sample of the flight before.
    pub(super) fn is_stale(&self, time_us: u64) -> bool {
        time_us > 0 && self.is_past(SimTime::from_us(time_us)) && now_ns() < self.services.stale_ns
    }

    /// What the flight controller says, unless it is about flying.
    pub(super) fn take_request(&mut self, said: &FromFc) {
        let reaches = |to: crate::wire::mavlink::Address| to.reaches(stream::ADDRESS);
        match said {
            FromFc::Command(command) if reaches(command.to) => self.take_command(command, Port::Fc),
            FromFc::ParameterList(to) | FromFc::ParameterRead(to, _) | FromFc::ParameterSet(to, ..)
                if self.options.profile.answers && reaches(*to) =>
            {
                self.take_parameter(said, Port::Fc);
            }
            _ => {}
        }
    }

    /// Hears the ground station, tells what happened, and puts out what waits, as far as the wires have room. After
    /// the samples of an instant, which go first.
    pub(super) fn serve(&mut self) {
        self.hear_ground();
        self.tell_events();
        let now_ns = now_ns();
        // A board that is not in the loop gets nothing but heartbeats, from a ground station neither.
        if self.may_stream() {
            let mut replies = std::mem::take(&mut self.services.replies);
            while self.services.budget.is_open(now_ns)
                && let Some(message) = replies.next(|i| self.parameter_message(i))
            {
                let bytes = self.streams.put_service(&message);
                self.services.budget.spend(bytes);
            }
            self.services.replies = replies;
            while self.services.budget.is_open(now_ns)
                && let Some(raw) = self.services.to_fc.pop_front()
            {
                self.streams.put_raw(&raw);
                self.services.budget.spend(raw.len());
                if let Some(ground) = &mut self.ground {
                    ground.note_forwarded();
                }
            }
        }
        if let Some(ground) = self.ground.take() {
            let view = View {
                flight: self.flight,
                datum: &self.datum,
                time_us: self.wire_time().us(),
                is_armed: self.command.armed,
            };
            ground.speak(now_ns, &view, |i| self.parameter_message(i));
            self.ground = Some(ground);
        }
    }

    /// A broken inertial unit ends the samples, but not the services.
    pub(super) fn serve_between_samples(&mut self) {
        if self.flight.measurement().is_none() && self.flight.time().since(self.sampled) >= QUIET {
            self.serve();
            self.flush();
        }
    }

    /// Simulated time stands: heartbeats and services go on.
    pub(super) fn stand_by(&mut self) {
        let now_ns = now_ns();
        // To everyone, lest a long pause looks like the end.
        if self.link.has_peer() && now_ns >= self.figures.next_heartbeat_ns {
            self.figures.next_heartbeat_ns = now_ns + 1_000_000_000;
            self.streams.put_heartbeat();
        }
        self.serve();
        self.flush();
        self.link.wait(std::time::Instant::now() + std::time::Duration::from_millis(20));
        self.receive();
        let now_us = self.flight.time().us();
        self.clock.resume_at(now_us, now_us);
    }

    /// Nobody takes the place of a controller that has a vehicle in its hands or waits while time stands.
    pub(super) fn hold_peer(&mut self) {
        let flies = self.fc.armed && self.stage != Stage::Fallback;
        self.link.keep_peer(if flies || self.services.paused { Hold::Kept } else { Hold::Free });
    }

    /// Begins a new flight.
    pub(super) fn begin_again(&mut self) {
        let Some(fresh) = self.services.fresh.take() else { return };
        let flown = self.flight.time();
        if let Some(handover) = self.hands.unfinished() {
            self.flight.note_handover(handover);
        }
        self.flight.event("reset", "a new flight begins".to_owned());
        self.tell_events();
        if self.flight.outcome().is_none() {
            self.flight.event(CUT_SHORT, "ended by the reset".to_owned());
            self.flight.end(Outcome::Aborted);
        }
        // The answer to whoever asked, and how the flight ended, go before the mark of the new one.
        self.serve();
        self.flush();
        let fc_must_fly = self.options.source == Source::Fc && !self.scenario.file.fallback_expected;
        let seed = fresh.seed();
        self.flight.begin_again(*fresh, fc_must_fly);
        self.live.notice(format!("reset: flight {} begins, seed {seed}", self.flight.earlier().len() + 1));
        // A sample's place on the wire passes: the mark of the new flight takes it.
        let services = &mut self.services;
        services.offset = services.offset + flown + self.sample.max(SimTime::from_us(1_000));
        (services.told, services.steps) = (0, 0);
        services.stale_ns = now_ns() + STALE_NS;
        self.fc = FlightController {
            heartbeat: self.fc.heartbeat,
            sender: self.fc.sender,
            flag_missed: self.fc.flag_missed,
            left_the_loop: self.fc.left_the_loop,
            may_be_live: self.fc.may_be_live,
            rejected: self.fc.rejected,
            old: self.fc.old,
            answers: self.fc.answers,
            heard_ns: now_ns(),
            ..FlightController::default()
        };
        if self.stage != Stage::Waiting {
            self.stage = Stage::Pad;
        }
        self.command = ActuatorCommand::SAFE;
        self.hold_peer();
        self.hands = HandoverMonitor::default();
        self.sampled = SimTime::ZERO;
        if let Some(planner) = &mut self.planner {
            planner.forget();
        }
        self.disruption = Disruption::new(u64::from(seed));
        self.clock.resume_at(flown.us(), self.flight.time().us());
        if self.clock.speed() != 1.0 {
            self.flight.note_modified(&format!("SIM_SPEED {}", self.clock.speed()));
        }
        if self.may_stream() {
            self.streams.put_reset(self.wire_time());
            self.flush();
        }
    }

    fn hear_ground(&mut self) {
        let Some(ground) = self.ground.take() else { return };
        let (heard, notices) = ground.receive();
        let address = ground.address().to_owned();
        self.ground = Some(ground);
        for notice in notices {
            self.live.notice(match notice {
                Notice::Connected(peer) => format!("ground station on {address}: {peer} is there"),
                Notice::Disconnected(why) => format!("ground station on {address}: lost, {why}"),
                Notice::Refused(peer) => {
                    format!("ground station on {address}: {peer} refused, one at a time")
                }
            });
        }
        for said in heard {
            match said {
                FromGround::Forward(raw) => {
                    if self.may_stream() && self.services.to_fc.len() < QUEUE {
                        self.services.to_fc.push_back(raw);
                    } else if let Some(ground) = &mut self.ground {
                        ground.note_dropped();
                    }
                }
                FromGround::Request(frame) => match frame.from_fc() {
                    // What is for everybody is the flight controller's to answer.
                    FromFc::Command(command) if command.to.system == GROUND_ADDRESS.system => {
                        self.take_command(&command, Port::Ground);
                    }
                    said @ (FromFc::ParameterList(to)
                    | FromFc::ParameterRead(to, _)
                    | FromFc::ParameterSet(to, ..))
                        if to.system == GROUND_ADDRESS.system || matches!(said, FromFc::ParameterList(_)) =>
                    {
                        self.take_parameter(&said, Port::Ground);
                    }
                    _ => {}
                },
            }
        }
    }

    /// What has happened since, as text.
    fn tell_events(&mut self) {
        let events = &self.flight.events()[self.services.told.min(self.flight.events().len())..];
        if events.is_empty() {
            return;
        }
        for event in events {
            let text = format!("{:.3} s {} {}", event.time_s, event.name, event.detail);
            let severity = severity(&event.name);
            if let Some(ground) = &mut self.ground
                && ground.has_listener()
            {
                ground.replies.tell(severity, &format!("SIMULATED {}", text.trim_end()));
            }
            if self.services.tells_events {
                self.services.replies.tell(severity, text.trim_end());
            }
        }
        self.services.told = self.flight.events().len();
    }

    fn take_command(&mut self, command: &Command, port: Port) {
        let answer = self.obey(command, port);
        if port == Port::Fc && !self.options.profile.answers {
            return;
        }
        let result = match answer {
            Ok(()) => RESULT_ACCEPTED,
            Err((result, why)) => {
                self.tell(port, Severity::MAV_SEVERITY_WARNING, &why);
                result
            }
        };
        if let Some(replies) = self.replies(port) {
            replies.acknowledge(command, result);
        }
    }

    fn obey(&mut self, command: &Command, port: Port) -> Answer {
        let [first, second, third, ..] = command.parameters;
        if command.command == SET_MESSAGE_INTERVAL {
            return self.set_interval(port, first, second);
        }
        if port == Port::Fc && !self.options.profile.answers {
            return unsupported("");
        }
        let to_itself = command.to.system != 0 && command.to.component != 0;
        let request = match command.command {
            PAUSE_CONTINUE if first == 0.0 => Request::Pause,
            PAUSE_CONTINUE if first == 1.0 => Request::Resume,
            PAUSE_CONTINUE => return denied("pause is 0, continue 1"),
            REBOOT if first == 1.0 && to_itself => Request::Reset,
            REBOOT => return unsupported("the bench resets at 1, addressed to itself"),
            GUIDED_ENABLE if first == 1.0 => Request::GiveBack,
            GUIDED_ENABLE => return unsupported("the bench takes over when the FC is lost"),
            INJECT_FAILURE => match failure(first, second, third) {
                Failure::Break(broken) if broken.iter().all(|(component, _)| self.carries(*component)) => {
                    Request::Break(
                        broken.into_iter().map(|(component, mode)| Fault::new(component, mode)).collect(),
                    )
                }
                Failure::Break(_) => return denied("this profile sends nothing of that sensor"),
                Failure::Mend(components) => Request::Mend(components, None),
                Failure::NoSuchInstance(count) => {
                    return denied(format!("instances are 1 to {count}, 0 all"));
                }
                Failure::Unsupported => return unsupported("no such failure in the catalogue"),
            },
            other => return unsupported(format!("command {other} is none of the bench's")),
        };
        self.carry_out(request)
    }

    /// Whether a fault of a component can be seen on the wire.
    fn carries(&self, component: Component) -> bool {
        component != Component::Tracking || self.options.profile.odometry_hz.is_some()
    }

    fn set_interval(&mut self, port: Port, message: f32, interval_us: f32) -> Answer {
        // `as` saturates and turns NaN into 0.
        let interval = if interval_us < 0.0 { None } else { Some(interval_us as u64) };
        let id = message as u32;
        if (1..LEAST_INTERVAL_US).contains(&interval.unwrap_or(0)) {
            return denied(format!("the least interval is {LEAST_INTERVAL_US} us"));
        }
        let none = || unsupported(format!("the rate of message {message} is not in the bench's hand"));
        let refused = |answer: Result<(), Refusal>| match answer {
            Ok(()) => Ok(()),
            Err(Refusal::NotInHand) => none(),
            Err(Refusal::NoRoom { taken_bytes_s, left_bytes_s }) => {
                denied(format!("{taken_bytes_s:.0} byte/s would be taken, the line has {left_bytes_s:.0}"))
            }
        };
        if id as f32 != message {
            return none();
        }
        match (port, &mut self.ground) {
            (Port::Ground, Some(ground)) => refused(ground.set_interval(id, interval)),
            (Port::Fc, _) if id == STATUS_TEXT_ID && self.options.profile.answers => {
                self.services.tells_events = interval.is_some();
                self.services.told = self.flight.events().len();
                Ok(())
            }
            _ => {
                let (now, spare_bytes_s) = (self.wire_time(), self.services.spare_bytes_s);
                match self.streams.set_interval(id, interval, now, spare_bytes_s) {
                    Ok(()) => {
                        let left = (spare_bytes_s - self.streams.asked_bytes_s()).max(0.0);
                        if left.is_finite() {
                            self.services.budget.set_rate(left);
                        }
                        Ok(())
                    }
                    refusal => refused(refusal),
                }
            }
        }
    }

    fn take_parameter(&mut self, said: &FromFc, port: Port) {
        match said {
            FromFc::ParameterList(_) => {
                if let Some(replies) = self.replies(port) {
                    replies.list_parameters();
                }
            }
            FromFc::ParameterRead(_, ParameterKey::Index(index)) => match self.parameter_message(*index) {
                Some(message) => self.say(port, message),
                None => self.tell(
                    port,
                    Severity::MAV_SEVERITY_WARNING,
                    &format!("no parameter {index}; there are {}", self.services.parameters.len()),
                ),
            },
            FromFc::ParameterRead(_, ParameterKey::Name(name)) => {
                if let Some(index) = self.place(name, port) {
                    self.say_parameter(port, index);
                }
            }
            FromFc::ParameterSet(_, name, value) => {
                let Some(index) = self.place(name, port) else { return };
                let answer = self.set_parameter(usize::from(index), as_typed(*value));
                self.say_parameter(port, index);
                if let Err((_, why)) = answer {
                    self.tell(port, Severity::MAV_SEVERITY_WARNING, &why);
                }
            }
            _ => {}
        }
    }

    /// Place of a parameter in the list; says so where there is none.
    fn place(&mut self, name: &str, port: Port) -> Option<u16> {
        let place = self.services.parameters.iter().position(|p| p.name == name);
        if place.is_none() {
            self.tell(port, Severity::MAV_SEVERITY_WARNING, &format!("no parameter {name}"));
        }
        place.and_then(|place| u16::try_from(place).ok())
    }

    fn set_parameter(&mut self, place: usize, value: f64) -> Answer {
        let parameter = &self.services.parameters[place];
        if !parameter.allows(value) {
            let Parameter { name, least, greatest, unit, .. } = parameter;
            return denied(format!("{name} {value}: allowed {least} to {greatest} ({unit})"));
        }
        let what = parameter.what;
        if self.is_in_force(&what, value) {
            return Ok(());
        }
        let request = match what {
            What::Speed => Request::Speed(value),
            What::Pause if value == 0.0 => Request::Resume,
            What::Pause => Request::Pause,
            What::Step => Request::Step(value as u64),
            What::Reset if value == 0.0 => return Ok(()),
            What::Reset => Request::Reset,
            What::Seed => Request::Seed(value as u32),
            What::Fault(row) if value == 0.0 => Request::Mend(vec![row.component], Some(row.mode)),
            What::Fault(row) => {
                let value = row.value.map(|_| value);
                Request::Break(vec![Fault { value, ..Fault::new(row.component, row.mode) }])
            }
            what => Request::Interfere(what, value),
        };
        self.carry_out(request)
    }

    /// Whether a parameter has this value already: then setting it changes nothing, and marks nothing.
    fn is_in_force(&self, what: &What, value: f64) -> bool {
        match what {
            What::Step | What::Reset => false,
            // 0 is said both of one that does not act and of one that acts with 0; an ended flight answers for itself.
            What::Fault(_) if value == 0.0 || self.flight.outcome().is_some() => false,
            _ => value == self.value(what),
        }
    }

    /// The one place where a request has its effect.
    fn carry_out(&mut self, request: Request) -> Answer {
        match request {
            Request::Reset => {
                if self.fc.armed && !self.options.profile.resets_armed {
                    return denied("no reset while the flight controller is armed");
                }
                let seed = self.services.next_seed.unwrap_or_else(|| self.flight.seed());
                let fresh =
                    self.flight.again(seed).or_else(|fault| denied(format!("no new flight: {fault}")))?;
                self.services.fresh = Some(Box::new(fresh));
            }
            Request::Pause if !self.services.paused => {
                (self.services.paused, self.services.steps) = (true, 0);
                self.hold_peer();
                self.modified("paused");
            }
            Request::Resume if self.services.paused => {
                self.services.paused = false;
                self.hold_peer();
                self.modified("resumed");
            }
            Request::Pause | Request::Resume => {}
            Request::Step(_) if !self.services.paused => return denied("steps are made while paused"),
            Request::Step(count) => self.services.steps = count,
            Request::Speed(_) if self.options.fast => return denied("--fast has no pace to change"),
            Request::Speed(speed) => {
                self.clock.set_speed(speed, self.flight.time().us());
                self.modified(&format!("SIM_SPEED {speed}"));
            }
            Request::Seed(seed) => self.services.next_seed = Some(seed),
            Request::GiveBack => self.give_back().or_else(denied)?,
            Request::Break(_) | Request::Mend(..) if self.flight.outcome().is_some() => {
                return denied("the flight has ended: reset first");
            }
            Request::Break(faults) => {
                for fault in &faults {
                    fault.validate().or_else(|fault| denied(fault.to_string()))?;
                }
                for fault in &faults {
                    self.flight.inject(fault).or_else(|fault| denied(fault.to_string()))?;
                }
            }
            Request::Mend(components, mode) => {
                for component in components {
                    self.flight.clear_fault(component, mode);
                }
            }
            Request::Interfere(what, value) => {
                let mut now = *self.flight.interference();
                match what {
                    What::WindNorth => now.wind_ned_m_s.x = value,
                    What::WindEast => now.wind_ned_m_s.y = value,
                    What::ThrustBias => now.standing.thrust_bias = value,
                    What::Misalignment(axis) => now.standing.misalignment_rad[axis] = value,
                    What::Force(axis) => now.standing.force_body_n[axis] = value,
                    _ => return unsupported("not a disturbance"),
                }
                self.flight.interfere(now);
                let name = self.services.parameters.iter().find(|p| p.what == what).map(|p| p.name.clone());
                self.modified(&format!("{} {value}", name.unwrap_or_default()));
            }
        }
        Ok(())
    }

    fn modified(&mut self, what: &str) {
        self.flight.note_modified(what);
        self.live.notice(format!("{:.3} s: {what}", self.flight.time().s()));
    }

    /// Value in force.
    fn value(&self, what: &What) -> f64 {
        let interference = self.flight.interference();
        match what {
            What::Speed => self.clock.speed(),
            What::Pause => f64::from(u8::from(self.services.paused)),
            What::Step => self.services.steps as f64,
            What::Reset => f64::from(u8::from(self.services.fresh.is_some())),
            What::Seed => f64::from(self.services.next_seed.unwrap_or_else(|| self.flight.seed())),
            What::WindNorth => interference.wind_ned_m_s.x,
            What::WindEast => interference.wind_ned_m_s.y,
            What::ThrustBias => interference.standing.thrust_bias,
            What::Misalignment(axis) => interference.standing.misalignment_rad[*axis],
            What::Force(axis) => interference.standing.force_body_n[*axis],
            What::Fault(Row { component, mode, value, .. }) => self
                .flight
                .faults()
                .filter(|fault| fault.component == *component && fault.mode == *mode)
                .last()
                .map_or(0.0, |fault| if value.is_some() { fault.value } else { 1.0 }),
        }
    }

    fn parameter_message(&self, index: u16) -> Option<MavMessage> {
        let parameters = &self.services.parameters;
        let parameter = parameters.get(usize::from(index))?;
        let count = u16::try_from(parameters.len()).unwrap_or(u16::MAX);
        Some(parameter_value(&parameter.name, self.value(&parameter.what), index, count))
    }

    fn say_parameter(&mut self, port: Port, index: u16) {
        if let Some(message) = self.parameter_message(index) {
            self.say(port, message);
        }
    }

    fn replies(&mut self, port: Port) -> Option<&mut ReplyQueue> {
        match port {
            Port::Fc => Some(&mut self.services.replies),
            Port::Ground => self.ground.as_mut().map(|ground| &mut ground.replies),
        }
    }

    fn say(&mut self, port: Port, message: MavMessage) {
        if let Some(replies) = self.replies(port) {
            replies.say(message);
        }
    }

    fn tell(&mut self, port: Port, severity: Severity, text: &str) {
        let text = if port == Port::Ground { format!("SIMULATED {text}") } else { text.to_owned() };
        if let Some(replies) = self.replies(port) {
            replies.tell(severity, &text);
        }
    }
}

/// How grave an event is.
fn severity(event: &str) -> Severity {
    let kind = event.split(':').next().unwrap_or(event);
    match kind {
        "abort" | "fc_lost" => Severity::MAV_SEVERITY_CRITICAL,
        "redline" | "nitrous_depleted" | "fuel_burn_through" => Severity::MAV_SEVERITY_ERROR,
        "fault" | "handover" | "bottle_low" | "modified" | "saturated" => Severity::MAV_SEVERITY_WARNING,
        "fault_over" | "reset" | "handback" => Severity::MAV_SEVERITY_NOTICE,
        _ => Severity::MAV_SEVERITY_INFO,
    }
}
