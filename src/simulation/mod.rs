//! A flight in memory: plant, sensors and built-in autopilot on one integer clock, with a referee.
//!
//! [`Flight`] is stepped by its owner: [`fly`] does it as fast as possible with the autopilot or a
//! schedule at the controls, the bench does it beside a link with whoever sits at the other end. The
//! built-in autopilot sees every measurement from the first on, so that it can take over at any time.
//!
//! In a campaign the vehicle that flies is not the one of the data sheet: [`Flight::dispersed`] gives the plant
//! what was drawn, and the autopilot what [`data_sheet::nominal`] made of the scenario as written.

pub mod data_sheet;
mod referee;
pub mod report;

pub use referee::{Circumstances, Referee, Rules};
pub use report::{FlownBy, Ladders, Report, Source};

use crate::autopilot::abort::{Abort, AbortKind};
use crate::autopilot::{Autopilot, Estimate, Parameters, lcvx, tracking};
use crate::event::{Event, EventKind, Phase};
use crate::fault::{self, Acting, Component, Fault, Faults, Mode, WireEffect};
use crate::frame::Vec3;
use crate::hash::Fnv;
use crate::input::Invalid;
use crate::plant::{Interference, Plant, Snapshot, State};
use crate::scenario::{Outcome, Place, Scenario};
use crate::sensor::{SensorSetup, SensorSuite};
use crate::signal::{ActuatorCommand, Measurement};
use crate::time::SimTime;

use report::{Handover, MassBalance, Propellant, Timing, Verdict};

/// States are hashed at this interval [steps].
const HASH_EVERY: u64 = 100;

/// Changes from outside that are kept with their words; what comes on top is counted.
pub const MODIFIED_KEPT: usize = 100;

/// One flight of one scenario under one seed.
pub struct Flight {
    scenario: Scenario,
    seed: u32,
    instruments: Instrumentation,
    told: Parameters,
    step: SimTime,
    plant: Plant,
    sensors: Option<SensorSuite>,
    faults: Faults,
    /// Events that the faults have heard of.
    heard: usize,
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
    hash: Fnv,
    steps: u64,
    estimate_at_touchdown: Option<Vec3>,
    flown_elsewhere: bool,
    reference_elsewhere_ned_m: Option<Vec3>,
    interference: Interference,
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

/// First contact against the target, north and east (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchdownOffset {
    /// In truth.
    pub true_m: [f64; 2],
    /// By the estimate of the autopilot that flew; `None` when an outside one did.
    pub estimated_m: Option<[f64; 2]>,
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
        let parameters = data_sheet::autopilot(scenario, plant.environment(), instruments);
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
        told: Parameters,
    ) -> Result<Self, Invalid> {
        let step = SimTime::from_s(scenario.file.physics.step_s);
        let snapshot = *plant.snapshot();
        let mut parameters = scenario.vehicle.sensors.clone();
        if let Some(rate_hz) = instruments.imu_rate_hz {
            parameters.imu.rate_hz = rate_hz;
        }
        let sensors = if scenario.file.sensors.enabled {
            Some(SensorSuite::new(
                &parameters,
                &SensorSetup {
                    environment: plant.environment(),
                    seed: u64::from(seed),
                    step,
                    initial: &plant.truth(),
                    gnss_delay_s: scenario.file.sensors.gnss_delay_s.or(instruments.gnss_delay_s),
                },
            )?)
        } else {
            None
        };
        let target = Vec3::new(scenario.target_north_east_m()[0], scenario.target_north_east_m()[1], 0.0);
        let stroke_m = scenario.vehicle.landing_gear.stroke_m;
        let has_ground = scenario.file.initial.place == Place::Pad && !scenario.file.initial.clamped;
        let scheduled = scenario.schedule.is_some();
        Ok(Self {
            autopilot: Autopilot::new(told.clone()),
            told,
            instruments: *instruments,
            referee: Referee::new(Rules {
                target_ned_m: target,
                stroke_m,
                timeout_s: scenario.file.timeout_s,
                has_ground,
                scheduled,
            }),
            scenario: scenario.clone(),
            seed,
            step,
            plant,
            sensors,
            faults: Faults::new(&scenario.file.fault, u64::from(seed)),
            heard: 0,
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
            hash: Fnv::default(),
            steps: 0,
            estimate_at_touchdown: None,
            flown_elsewhere: false,
            reference_elsewhere_ned_m: None,
            interference: Interference::default(),
            earlier: Vec::new(),
        })
    }

    /// The same flight at step 0 again, as the scenario has it, under a seed.
    ///
    /// # Errors
    /// As [`Flight::new`].
    pub fn again(&self, seed: u32) -> Result<Self, Invalid> {
        let plant = Plant::seeded(&self.scenario, seed)?;
        let mut fresh = Self::assemble(&self.scenario, seed, &self.instruments, plant, self.told.clone())?;
        fresh.flown_elsewhere = self.flown_elsewhere;
        Ok(fresh)
    }

    /// Ends this flight's place in the process: its report is kept, and `fresh`, which [`Flight::again`] set up, begins.
    pub fn begin_again(&mut self, mut fresh: Self, fc_must_fly: bool) {
        fresh.earlier = std::mem::take(&mut self.earlier);
        fresh.earlier.push(self.report(fc_must_fly));
        *self = fresh;
    }

    /// Reports of the flights that came before this one in the process.
    pub fn earlier(&self) -> &[Report] {
        &self.earlier
    }

    /// Seed of its random streams.
    pub fn seed(&self) -> u32 {
        self.seed
    }

    /// What was asked of the sensors beyond the scenario.
    pub fn instruments(&self) -> &Instrumentation {
        &self.instruments
    }

    /// Wind and disturbances that somebody at a bench has added.
    pub fn interference(&self) -> &Interference {
        &self.interference
    }

    /// Adds wind and disturbances within two steps, instead of those added before. The caller notes
    /// that the run is modified.
    pub fn interfere(&mut self, interference: Interference) {
        self.interference = interference;
        self.plant.interfere(&interference);
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
        self.break_down();
        self.plant.step(command);
        self.steps += 1;
        self.snapshot = *self.plant.snapshot();
        self.events.extend(self.plant.take_events());
        let truth = self.plant.truth();
        let time = self.plant.time();
        self.measurement = self.sensors.as_mut().and_then(|sensors| sensors.sample(&truth, time));
        if let Some(measurement) = &mut self.measurement {
            self.faults.spoil(measurement);
        }
        let seen = self.referee.watch(
            &self.snapshot,
            &Circumstances {
                armed: command.armed,
                aborted: self.abort.is_some(),
                throttle: self.plant.throttle_on(command),
                mission_s: self.plant.mission_s(),
                hover_reference_ned_m: self.hover_reference(),
                hover_control_error_ned_m: self.hover_control_error(),
                dt_s: self.step.s(),
            },
        );
        if seen.liftoff {
            self.event(EventKind::Liftoff, String::new());
        }
        if seen.touchdown {
            self.touchdown_event();
        }
        if self.steps.is_multiple_of(HASH_EVERY) {
            hash_state(&mut self.hash, self.plant.state());
        }
    }

    /// Lets begin and end what breaks, and tells the plant.
    fn break_down(&mut self) {
        while let Some(event) = self.events.get(self.heard) {
            self.faults.hear(&event.kind);
            self.heard += 1;
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

    /// Breaks something now, without regard to a trigger; what acts of the same component and mode is replaced. The run is
    /// marked as modified.
    ///
    /// # Errors
    /// When the component cannot break so, or the value is out of range.
    pub fn inject(&mut self, fault: &Fault) -> Result<(), Invalid> {
        self.faults.inject(fault, self.plant.time())?;
        self.note_modified(&format!("fault {}", fault.describe()));
        self.event(EventKind::Fault(fault.name()), fault.describe());
        Ok(())
    }

    /// Mends what acts in a component, of one mode or of any, and says how much that was. The run is marked as modified if anything was.
    pub fn clear_fault(&mut self, component: Component, mode: Option<Mode>) -> usize {
        let mut ended = Vec::new();
        self.faults.clear(component, mode, |fault| ended.push((fault.name(), fault.describe())));
        let count = ended.len();
        for (name, what) in ended {
            self.note_modified(&format!("mended {what}"));
            self.event(EventKind::FaultOver(name), String::new());
        }
        count
    }

    /// The faults that act now.
    pub fn faults(&self) -> impl Iterator<Item = &Acting> {
        self.faults.acting()
    }

    /// What is broken between the bench and the flight controller.
    pub fn wire_effect(&self) -> &WireEffect {
        &self.faults.effects().wire
    }

    /// Notes that something was changed from outside: the run is no longer its scenario's.
    /// Beyond the first [`MODIFIED_KEPT`] they are only counted, so that somebody who sends without end fills no memory.
    pub fn note_modified(&mut self, what: &str) {
        self.modified_count += 1;
        if self.modified.len() < MODIFIED_KEPT {
            self.modified.push(format!("{:.3} s: {what}", self.plant.time().s()));
            self.event(EventKind::Modified, what.to_owned());
        }
    }

    /// What was changed from outside so far, the first of it.
    pub fn modified(&self) -> &[String] {
        &self.modified
    }

    /// Reference of the hover, while whoever carries the mission is in it: the autopilot at the controls.
    fn hover_reference(&self) -> Option<Vec3> {
        (self.source == Source::Autopilot && self.phase == Some(Phase::Hover)).then(|| {
            let reference =
                self.reference_elsewhere_ned_m.unwrap_or_else(|| self.autopilot.reference().position_ned_m);
            self.in_pad_frame(reference)
        })
    }

    /// How far the flight's own autopilot believes to be off the reference of its hover, at every measurement.
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

    /// The autopilot that flies is not this flight's own but one at the other end of a link: its estimate
    /// comes by [`Flight::set_estimate_at_touchdown`].
    pub fn set_flown_elsewhere(&mut self) {
        self.flown_elsewhere = true;
    }

    fn touchdown_event(&mut self) {
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

    /// The built-in autopilot.
    pub fn autopilot(&mut self) -> &mut Autopilot {
        &mut self.autopilot
    }

    /// What the built-in autopilot believes.
    pub fn estimate(&self) -> Estimate {
        self.autopilot.estimate()
    }

    /// Lets the built-in autopilot fly: what it commands on the newest measurement. Its phases and aborts
    /// become events. What it orders to be planned is the caller's to solve: [`Flight::plan_in_place`], or a thread.
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

    /// Keeps the built-in autopilot in step while another flies.
    pub fn shadow(&mut self, applied: &ActuatorCommand) {
        if let Some(measurement) = &self.measurement {
            self.autopilot.observe(measurement, applied);
        }
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

    /// Notes what a change of hands did.
    pub fn note_handover(&mut self, handover: Handover) {
        self.handovers.push(handover);
    }

    /// The estimate of the autopilot that flew, if that was not the flight's own but one at the other
    /// end of a link; used for the errors at touchdown.
    pub fn set_estimate_at_touchdown(&mut self, position_ned_m: Vec3) {
        self.estimate_at_touchdown.get_or_insert(position_ned_m);
    }

    /// Position that an autopilot at the other end of a link wants to hold; `None`: the flight's own flies.
    pub fn set_reference_elsewhere(&mut self, position_ned_m: Option<Vec3>) {
        self.reference_elsewhere_ned_m = position_ned_m;
    }

    /// Where the pivot was at first contact against the target, north and east (m): in truth, and by the
    /// estimate of the autopilot that flew.
    pub fn touchdown_offset_m(&self) -> Option<TouchdownOffset> {
        let [north, east] = self.scenario.target_north_east_m();
        let off = |p: Vec3| [p.x - north, p.y - east];
        let truth = off(self.true_at_touchdown()?);
        Some(TouchdownOffset {
            true_m: truth,
            estimated_m: self.estimate_at_touchdown.map(|e| off(self.in_pad_frame(e))),
        })
    }

    /// Greatest tilt between lift-off and first contact (deg).
    pub fn peak_tilt_deg(&self) -> Option<f64> {
        self.referee.peak_tilt_rad.map(f64::to_degrees)
    }

    /// Whether first contact has been seen.
    pub fn has_touched_down(&self) -> bool {
        self.referee.touchdown.is_some()
    }

    /// The report, judged. `fc_must_fly`: an outside flight controller was attached and no fallback is
    /// expected. Timing and link are the owner's to fill in.
    pub fn report(&self, fc_must_fly: bool) -> Report {
        let (start, end) = (&self.initial, &self.snapshot);
        let mut flown_by = self.flown_by.clone();
        if let Some(last) = flown_by.last_mut() {
            last.to_s = end.time.s();
        }
        let [nozzle, rcs, vent] = end.expelled_kg;
        let target = self.scenario.target_north_east_m();
        let touchdown = self.referee.touchdown.map(|mut touchdown| {
            if let Some(estimate) = self.estimate_at_touchdown.map(|e| self.in_pad_frame(e)) {
                touchdown.control_error_m = Some(libm::hypot(estimate.x - target[0], estimate.y - target[1]));
                touchdown.navigation_error_m =
                    self.true_at_touchdown().map(|p| libm::hypot(estimate.x - p.x, estimate.y - p.y));
            }
            touchdown
        });
        let mut hash = self.hash;
        hash_state(&mut hash, self.plant.state());
        let more = self.modified_count - self.modified.len();
        let more = (more > 0).then(|| format!("and {more} more"));
        let mut report = Report {
            scenario: self.scenario.name.clone(),
            seed: self.seed,
            outcome: self.outcome().unwrap_or(Outcome::Aborted),
            flown_by,
            handovers: self.handovers.clone(),
            expect: Verdict::default(),
            touchdown,
            max_altitude_m: self.referee.max_altitude_m,
            hover: self.referee.hover(),
            autopilot: self.ladders(),
            propellant: self.propellant(),
            mass: MassBalance {
                initial_kg: start.mass_kg,
                final_kg: end.mass_kg,
                closure_error_kg: (start.mass_kg + start.manifold_kg + start.chamber_gas_kg)
                    - (end.mass_kg + end.manifold_kg + end.chamber_gas_kg)
                    - (nozzle + rcs + vent),
            },
            timing: Timing {
                plant_mode: self.scenario.file.fidelity,
                plant_hz: 1.0 / self.step_s(),
                step_budget_us: self.step_s() * 1e6,
                simulated_s: end.time.s(),
                steps: self.steps,
                ..Timing::default()
            },
            link: None,
            events: self.events.clone(),
            state_hash: hash.hex(),
            run: None,
            overrides: Vec::new(),
            modified: self.modified.iter().cloned().chain(more).collect(),
            modified_count: self.modified_count,
            faults_idle: self.faults.idle().map(Fault::name).collect(),
            flights: self.earlier.clone(),
            ground: None,
        };
        let flight_time_s =
            self.referee.touchdown.zip(self.referee.liftoff_s).map(|(t, liftoff_s)| t.time_s - liftoff_s);
        report.judge(&self.scenario.file.expect, flight_time_s, fc_must_fly);
        report
    }

    /// What the own autopilot's ladders did, if it flew.
    fn ladders(&self) -> Option<Ladders> {
        let (tracker, planning) = (self.autopilot.tracker(), self.autopilot.planning());
        let stood_on = |counts: &[u64], name: &dyn Fn(usize) -> &'static str| {
            let rungs = counts.iter().enumerate().filter(|(_, count)| **count > 0);
            rungs.map(|(i, &count)| (name(i).to_owned(), count)).collect()
        };
        let flew = !self.flown_elsewhere && self.flown_by.iter().any(|f| f.source == Source::Autopilot);
        flew.then(|| Ladders {
            control: stood_on(&tracker.counts(), &|i| tracking::Rung::ALL[i].name()),
            guidance: stood_on(&planning.counts(), &|i| lcvx::Rung::ALL[i].name()),
            plans_late: planning.late(),
        })
    }

    /// What each fluid has come to. Everything that the vehicle's mass lost is in one of the figures.
    fn propellant(&self) -> Propellant {
        let (start, end) = (&self.initial, &self.snapshot);
        let nitrous_kg = |s: &Snapshot| s.nitrous_kg + s.nitrous_vapor_kg;
        let nitrogen_kg = |s: &Snapshot| s.nitrogen_bottle_kg + s.nitrogen_ullage_kg;
        let [_, rcs_kg, vent_kg] = end.expelled_kg;
        let nitrogen_vented_kg = vent_kg - end.vented_vapor_kg;
        Propellant {
            nitrous_used_kg: nitrous_kg(start) - nitrous_kg(end),
            nitrous_left_kg: end.nitrous_kg,
            nitrous_vapor_kg: end.nitrous_vapor_kg,
            fuel_used_kg: start.fuel_kg - end.fuel_kg,
            fuel_left_kg: end.fuel_kg,
            nitrogen_rcs_kg: rcs_kg,
            nitrogen_vented_kg,
            // Only an outlet that uncovers lets nitrogen into the engine; elsewhere the difference is round-off.
            nitrogen_nozzle_kg: if self.scenario.vehicle.uncovering.is_some() {
                nitrogen_kg(start) - nitrogen_kg(end) - rcs_kg - nitrogen_vented_kg
            } else {
                0.0
            },
        }
    }

    fn true_at_touchdown(&self) -> Option<Vec3> {
        self.referee.position_at_touchdown_ned_m()
    }
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

/// The same for a flight that is already set up.
pub fn fly_out(flight: &mut Flight, mut each_step: impl FnMut(&Snapshot)) {
    each_step(flight.snapshot());
    let file = &flight.scenario.file;
    let end = file.duration_s.map(SimTime::from_s);
    // A flight that nothing ever lights has no mission time; this ends it all the same.
    let patience = SimTime::from_s(file.timeout_s + file.mission.alignment_s + file.mission.ready_s);
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
        if end.is_some_and(|end| flight.time() >= end) {
            flight.end(Outcome::Completed);
        } else if end.is_none() && flight.mission_s().is_none() && flight.time() > patience {
            flight.end(Outcome::Timeout);
        }
    }
}

/// Takes in the bits of every number of a state.
fn hash_state(hash: &mut Fnv, state: &State) {
    for number in state.numbers() {
        hash.add(&number.to_bits().to_le_bytes());
    }
}
