//! A flight in memory: plant, sensors and built-in autopilot on one integer clock, with a referee.
//!
//! [`Flight`] is stepped by its owner: [`fly`] does it as fast as possible with the autopilot or a schedule
//! at the controls, [`fly_with`] with a law of the caller's own, the bench beside a link with whoever sits at
//! the other end. The built-in autopilot sees every measurement from the first on, so that it can take over
//! at any time.
//!
//! In a campaign the vehicle that flies is not the one of the data sheet: [`Flight::dispersed`] gives the
//! plant what was drawn, and the autopilot what [`data_sheet::nominal`] made of the scenario as written.

pub mod data_sheet;

mod flown_by;
mod referee;
mod state_hash;

mod bench_report;
pub mod report;

mod bench;
mod summary;

pub use bench::MODIFIED_KEPT;
pub use flown_by::{FlownBy, Source};
pub use report::{Ladders, Report};
pub use summary::TouchdownOffset;

use crate::autopilot::abort::{Abort, AbortKind};
use crate::autopilot::{Autopilot, Estimate, Parameters};
use crate::event::{Event, EventKind, Phase};
use crate::fault::{self, Faults};
use crate::frame::Vec3;
use crate::input::Invalid;
use crate::plant::{BenchDisturbance, Plant, Snapshot};
use crate::scenario::{Outcome, Place, Scenario};
use crate::sensor::{SensorSetup, SensorSuite};
use crate::signal::{ActuatorCommand, Measurement};
use crate::time::SimTime;

use referee::{Circumstances, Referee, Rules};
use report::Handover;
use state_hash::StateHash;

/// States are hashed at this interval [steps].
const HASH_EVERY: u64 = 100;

/// One flight of one scenario under one seed.
pub struct Flight {
    scenario: Scenario,
    seed: u32,
    instruments: Instrumentation,
    /// What the autopilot is told of the vehicle.
    parameters: Parameters,
    /// Length of a step.
    step: SimTime,
    plant: Plant,
    sensors: Option<SensorSuite>,
    faults: Faults,
    /// How many of the events the faults have heard of.
    events_heard: usize,
    modified: Vec<String>,
    modified_count: usize,
    autopilot: Autopilot,
    referee: Referee,
    measurement: Option<Measurement>,
    snapshot: Snapshot,
    initial: Snapshot,
    events: Vec<Event>,
    flown_by: Vec<FlownBy>,
    handovers: Vec<Handover>,
    source: Source,
    armed: bool,
    phase: Option<Phase>,
    abort: Option<Abort>,
    hash: StateHash,
    steps: u64,
    estimate_at_touchdown: Option<Vec3>,
    flown_elsewhere: bool,
    reference_elsewhere_ned_m: Option<Vec3>,
    bench_disturbance: BenchDisturbance,
    earlier: Vec<Report>,
}

/// What a bench may ask of the sensors beyond the scenario.
#[derive(Clone, Copy, Debug, Default)]
pub struct Instrumentation {
    /// Rate of the inertial unit (Hz).
    pub imu_rate_hz: Option<f64>,
    /// Delay of satellite navigation that a profile asks for; the scenario's own comes first (s).
    pub gnss_delay_s: Option<f64>,
}

/// Flies a scenario to its end, as fast as possible, with its schedule or the built-in autopilot.
/// `each_step` sees the truth at step 0 and after every step.
///
/// # Errors
/// As [`Flight::new`].
pub fn fly(scenario: &Scenario, seed: u32, each_step: impl FnMut(&Snapshot)) -> Result<Flight, Invalid> {
    let mut flight = Flight::new(scenario, seed)?;
    fly_out(&mut flight, each_step);
    Ok(flight)
}

/// Flies a scenario to its end under somebody else's law, which is asked for a command before every step. It
/// may look at the truth, [`Flight::snapshot`], or at what a flight computer gets, [`Flight::measurement`].
///
/// # Errors
/// As [`Flight::new`].
pub fn fly_with(
    scenario: &Scenario,
    seed: u32,
    mut law: impl FnMut(&Flight) -> ActuatorCommand,
) -> Result<Flight, Invalid> {
    let mut flight = Flight::new(scenario, seed)?;
    flight.set_source(Source::Fc);
    while flight.outcome().is_none() {
        let command = law(&flight);
        flight.step(&command);
        flight.end_in_time();
    }
    Ok(flight)
}

/// [`fly`] for a flight that is already set up.
pub fn fly_out(flight: &mut Flight, mut each_step: impl FnMut(&Snapshot)) {
    each_step(flight.snapshot());
    let schedule = flight.scenario.schedule.clone();
    flight.set_source(if schedule.is_some() { Source::Commands } else { Source::Autopilot });
    let mut command = ActuatorCommand::SAFE;
    while flight.outcome().is_none() {
        if let Some(schedule) = &schedule {
            command = *schedule.at(flight.time());
        }
        flight.step(&command);
        each_step(flight.snapshot());
        if schedule.is_none()
            && let Some(next) = flight.autopilot_command()
        {
            command = next;
            flight.plan_in_place();
        }
        flight.end_in_time();
    }
}

impl Flight {
    /// Sets the vehicle up for step 0.
    ///
    /// # Errors
    /// When vehicle, site and scenario contradict each other.
    pub fn new(scenario: &Scenario, seed: u32) -> Result<Self, Invalid> {
        Self::with(scenario, seed, &Instrumentation::default())
    }

    /// The same with sensors as a profile wants them.
    ///
    /// # Errors
    /// As [`Flight::new`].
    pub fn with(scenario: &Scenario, seed: u32, instruments: &Instrumentation) -> Result<Self, Invalid> {
        let plant = Plant::seeded(scenario, seed)?;
        let parameters = data_sheet::parameters(scenario, plant.environment(), instruments);
        if scenario.schedule.is_none() {
            data_sheet::throttle_band(&scenario.vehicle, plant.environment())?;
            parameters.validate()?;
        }
        Self::assemble(scenario, seed, instruments, plant, parameters)
    }

    /// A flight of what is in truth `actual` under an autopilot that was told something else: the parameters
    /// that [`data_sheet::nominal`] gives for the scenario before its values were dispersed.
    ///
    /// # Errors
    /// When vehicle, site and scenario contradict each other.
    pub fn dispersed(actual: &Scenario, seed: u32, told: &Parameters) -> Result<Self, Invalid> {
        let plant = Plant::seeded(actual, seed)?;
        Self::assemble(actual, seed, &Instrumentation::default(), plant, told.clone())
    }

    fn assemble(
        scenario: &Scenario,
        seed: u32,
        instruments: &Instrumentation,
        plant: Plant,
        parameters: Parameters,
    ) -> Result<Self, Invalid> {
        let step = SimTime::from_s(scenario.file.physics.step_s);
        let snapshot = *plant.snapshot();
        let sensors = sensors(scenario, seed, instruments, &plant)?;
        let [north_m, east_m] = scenario.target_north_east_m();
        let rules = Rules {
            target_ned_m: Vec3::new(north_m, east_m, 0.0),
            stroke_m: scenario.vehicle.landing_gear.stroke_m,
            timeout_s: scenario.file.timeout_s,
            has_ground: scenario.file.initial.place == Place::Pad && !scenario.file.initial.clamped,
            scheduled: scenario.schedule.is_some(),
        };
        Ok(Self {
            autopilot: Autopilot::new(parameters.clone()),
            parameters,
            instruments: *instruments,
            referee: Referee::new(rules),
            scenario: scenario.clone(),
            seed,
            step,
            plant,
            sensors,
            faults: Faults::new(&scenario.file.fault, u64::from(seed)),
            events_heard: 0,
            modified: Vec::new(),
            modified_count: 0,
            measurement: None,
            initial: snapshot,
            snapshot,
            events: Vec::new(),
            flown_by: Vec::new(),
            handovers: Vec::new(),
            source: Source::Autopilot,
            armed: false,
            phase: None,
            abort: None,
            hash: StateHash::default(),
            steps: 0,
            estimate_at_touchdown: None,
            flown_elsewhere: false,
            reference_elsewhere_ned_m: None,
            bench_disturbance: BenchDisturbance::default(),
            earlier: Vec::new(),
        })
    }

    /// Seed of its random streams.
    pub fn seed(&self) -> u32 {
        self.seed
    }

    /// Length of a step (s).
    pub fn step_s(&self) -> f64 {
        self.step.s()
    }

    /// Advances one step under a command.
    pub fn step(&mut self, command: &ActuatorCommand) {
        if command.armed && !self.armed {
            self.event(EventKind::Armed, String::new());
        }
        self.armed = command.armed;
        self.advance_faults();
        self.step_plant(command);
        self.sample_sensors();
        self.let_the_referee_watch(command);
        if self.steps.is_multiple_of(HASH_EVERY) {
            self.hash.add(self.plant.state());
        }
    }

    /// Begins and ends the faults that are due, and tells the plant which act.
    fn advance_faults(&mut self) {
        while let Some(event) = self.events.get(self.events_heard) {
            self.faults.hear(&event.kind);
            self.events_heard += 1;
        }
        let (time, events) = (self.plant.time(), &mut self.events);
        let now = fault::Circumstances {
            time,
            mission_s: self.plant.mission_s(),
            height_m: self.snapshot.height_m,
            lit: self.snapshot.lit,
            thrust_n: self.snapshot.thrust_n,
        };
        self.faults.advance(&now, |fault, begins| {
            let (name, time_s) = (fault.name(), time.s());
            events.push(if begins {
                Event { time_s, kind: EventKind::Fault(name), detail: fault.describe() }
            } else {
                Event { time_s, kind: EventKind::FaultOver(name), detail: String::new() }
            });
        });
        self.plant.set_faults(&self.faults.effects().plant);
    }

    /// Steps the plant, and takes over what it says has happened.
    fn step_plant(&mut self, command: &ActuatorCommand) {
        self.plant.step(command);
        self.steps += 1;
        self.snapshot = *self.plant.snapshot();
        self.events.extend(self.plant.take_events());
    }

    /// What the sensors that are due deliver, faults of theirs included.
    fn sample_sensors(&mut self) {
        let (truth, time) = (self.plant.truth(), self.plant.time());
        self.measurement = self.sensors.as_mut().and_then(|sensors| sensors.sample(&truth, time));
        if let Some(measurement) = &mut self.measurement {
            self.faults.spoil(measurement);
        }
    }

    /// Shows the step to the referee, and notes what it reached.
    fn let_the_referee_watch(&mut self, command: &ActuatorCommand) {
        let circumstances = Circumstances {
            armed: command.armed,
            aborted: self.abort.is_some(),
            throttle: self.plant.throttle_on(command),
            mission_s: self.plant.mission_s(),
            hover_reference_ned_m: self.hover_reference(),
            hover_control_error_ned_m: self.hover_control_error(),
            dt_s: self.step.s(),
        };
        let milestones = self.referee.watch(&self.snapshot, &circumstances);
        if milestones.liftoff {
            self.event(EventKind::Liftoff, String::new());
        }
        if milestones.touchdown {
            self.note_touchdown();
        }
    }

    /// Reference of the hover, while whoever carries the mission is in it: the autopilot at the controls.
    fn hover_reference(&self) -> Option<Vec3> {
        (self.source == Source::Autopilot && self.phase == Some(Phase::Hover)).then(|| {
            let reference =
                self.reference_elsewhere_ned_m.unwrap_or_else(|| self.autopilot.reference().position_ned_m);
            self.in_pad_frame(reference)
        })
    }

    /// How far the flight's own autopilot believes to be off the reference of its hover, at every
    /// measurement.
    fn hover_control_error(&self) -> Option<Vec3> {
        let own = self.source == Source::Autopilot && !self.flown_elsewhere;
        (own && self.phase == Some(Phase::Hover) && self.measurement.is_some())
            .then(|| self.autopilot.estimate().position_ned_m - self.autopilot.reference().position_ned_m)
    }

    /// A position in the autopilot's frame, whose origin is the start, in the frame of the pad.
    fn in_pad_frame(&self, position_ned_m: Vec3) -> Vec3 {
        let [north, east] = self.scenario.start_north_east_m();
        position_ned_m + Vec3::new(north, east, 0.0)
    }

    /// Notes first contact, and where the autopilot that flew believed to be.
    fn note_touchdown(&mut self) {
        let Some(touchdown) = self.referee.touchdown else { return };
        let own = self.source == Source::Autopilot && !self.flown_elsewhere;
        if own && self.estimate_at_touchdown.is_none() {
            self.estimate_at_touchdown = Some(self.autopilot.estimate().position_ned_m);
        }
        self.event(
            EventKind::Touchdown,
            format!(
                "{:.2} m/s down, {:.2} m/s across, tilt {:.1} deg",
                touchdown.vertical_speed_m_s, touchdown.lateral_speed_m_s, touchdown.tilt_deg
            ),
        );
    }

    /// The measurement that the last step produced, if the inertial unit had a sample.
    pub fn measurement(&self) -> Option<&Measurement> {
        self.measurement.as_ref()
    }

    /// Run time.
    pub fn time(&self) -> SimTime {
        self.plant.time()
    }

    /// Time since the first flame (s).
    pub fn mission_s(&self) -> Option<f64> {
        self.plant.mission_s()
    }

    /// The truth.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// The scenario flown.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// How the flight ended, once it has.
    pub fn outcome(&self) -> Option<Outcome> {
        self.referee.outcome()
    }

    /// Ends the flight from outside.
    pub fn end(&mut self, outcome: Outcome) {
        self.referee.end(outcome);
    }

    /// Ends a flight in memory whose duration is over, or that nothing ever lights.
    fn end_in_time(&mut self) {
        let file = &self.scenario.file;
        match file.duration_s.map(SimTime::from_s) {
            Some(end) if self.time() >= end => self.end(Outcome::Completed),
            None if self.mission_s().is_none() => {
                // Without a flame there is no mission time; this ends it all the same.
                let patience_s = file.timeout_s + file.mission.alignment_s + file.mission.ready_s;
                if self.time() > SimTime::from_s(patience_s) {
                    self.end(Outcome::Timeout);
                }
            }
            _ => {}
        }
    }

    /// The built-in autopilot.
    pub fn autopilot(&mut self) -> &mut Autopilot {
        &mut self.autopilot
    }

    /// What the built-in autopilot believes.
    pub fn estimate(&self) -> Estimate {
        self.autopilot.estimate()
    }

    /// Lets the built-in autopilot fly: what it commands on the newest measurement. Its phases and aborts
    /// become events. What it orders to be planned is the caller's to solve: [`Flight::plan_in_place`], or a
    /// thread.
    pub fn autopilot_command(&mut self) -> Option<ActuatorCommand> {
        let measurement = self.measurement.as_ref()?;
        let command = self.autopilot.update(measurement);
        self.note_abort(self.autopilot.abort());
        self.note_phase(self.autopilot.phase());
        Some(command)
    }

    /// Solves what the built-in autopilot has ordered, here and now.
    pub fn plan_in_place(&mut self) {
        if let Some(order) = self.autopilot.take_order() {
            self.autopilot.deliver(order.solve());
        }
    }

    /// Notes the phase of the mission, whoever carries it.
    pub fn note_phase(&mut self, phase: Phase) {
        if self.phase != Some(phase) {
            self.phase = Some(phase);
            self.event(EventKind::Phase(phase), String::new());
        }
    }

    /// Notes that whoever carries the mission has given it up.
    pub fn note_abort(&mut self, abort: Option<Abort>) {
        if self.abort != abort
            && let Some(Abort { kind, reason, time }) = abort
        {
            self.abort = abort;
            let how = match kind {
                AbortKind::Land => "lands where it is",
                AbortKind::Cut => "engine cut",
            };
            self.event(EventKind::Abort(reason), format!("{how}, decided at {:.3} s", time.s()));
        }
    }

    /// The phase noted last.
    pub fn phase(&self) -> Option<Phase> {
        self.phase
    }

    /// Adds an event.
    pub fn event(&mut self, kind: EventKind, detail: String) {
        self.events.push(Event { time_s: self.plant.time().s(), kind, detail });
    }

    /// Everything that happened so far.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// From now on `source` flies.
    pub fn set_source(&mut self, source: Source) {
        let now = self.plant.time().s();
        self.source = source;
        match self.flown_by.last_mut() {
            Some(last) if last.source == source => {}
            last => {
                if let Some(last) = last {
                    last.to_s = now;
                }
                self.flown_by.push(FlownBy { source, from_s: now, to_s: now });
            }
        }
    }

    /// Whether first contact has been seen.
    pub fn has_touched_down(&self) -> bool {
        self.referee.touchdown.is_some()
    }
}

/// The sensors of a scenario, unless it has none.
fn sensors(
    scenario: &Scenario,
    seed: u32,
    instruments: &Instrumentation,
    plant: &Plant,
) -> Result<Option<SensorSuite>, Invalid> {
    if !scenario.file.sensors.enabled {
        return Ok(None);
    }
    let mut parameters = scenario.vehicle.sensors.clone();
    if let Some(rate_hz) = instruments.imu_rate_hz {
        parameters.imu.rate_hz = rate_hz;
    }
    let setup = SensorSetup {
        environment: plant.environment(),
        seed: u64::from(seed),
        step: SimTime::from_s(scenario.file.physics.step_s),
        initial: &plant.truth(),
        gnss_delay_s: scenario.file.sensors.gnss_delay_s.or(instruments.gnss_delay_s),
    };
    SensorSuite::new(&parameters, &setup).map(Some)
}
