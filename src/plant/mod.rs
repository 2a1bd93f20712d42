//! The plant: what the vehicle does with its commands, from the valve to the feet.
//!
//! [`Plant::step`] is the block diagram. [`Plant::evaluate`] is its continuous part, pure, called once per
//! stage of the integrator: servos, feed and combustion, mass, loads, balance of momentum. Whatever is
//! discrete happens between steps: commands and their delays, the ignition sequence, strokes of the isolation
//! and vent valves, contact anchors, pulses of the thrusters, events (`step_end.rs`). The rate of the state
//! is a function of the state and of `StepInputs` (`discrete_state.rs`); forces are summed in `Plant::loads`
//! (`continuous.rs`).
//!
//! Beside it stand the seed paper's scheme, `fidelity = "paper"` (`paper.rs`), and couplings held still for
//! studies (`freeze.rs`).

mod cached_rate;
pub mod column;
mod command;
mod continuous;
mod discrete_state;
mod fault;
mod feed;
mod freeze;
mod paper;
mod play;
mod sequence;
mod setup;
pub mod signs;
mod snapshot;
mod state;
mod step_end;
mod supply;

pub use snapshot::Snapshot;
pub use state::{Rate, State};

use nalgebra::Vector2;

use crate::disturbance::{ConstantDisturbance, Disturbances};
use crate::dynamics::Kinematics;
use crate::dynamics::landing_gear::{Contact, MAX_LEGS};
use crate::dynamics::mass::MassProperties;
use crate::dynamics::rigid_body::Acceleration;
use crate::environment::Environment;
use crate::event::{Event, EventKind};
use crate::frame::Vec3;
use crate::input::Invalid;
use crate::integrator::{Integrable, rk4_step_from};
use crate::propulsion::{NitrogenState, OperatingPoint};
use crate::scenario::{IntegratorKind, Scenario};
use crate::sensor::Truth;
use crate::signal::ActuatorCommand;
use crate::time::SimTime;
use crate::vehicle::Vehicle;

use cached_rate::CachedRate;
use discrete_state::{DiscreteState, SolverState, StepInputs};
use freeze::Frozen;
use paper::Paper;
use sequence::Sequence;

/// The vehicle in its world.
pub struct Plant {
    vehicle: Vehicle,
    environment: Environment,
    options: Options,
    pads_body_m: [Vec3; MAX_LEGS],
    exit_points: ExitPoints,
    rest_height_m: f64,
    step: SimTime,
    time: SimTime,
    state: State,
    /// Discrete, read by the rate of the state.
    inputs: StepInputs,
    /// What solvers carry from step to step.
    solver: SolverState,
    /// Discrete, read by no stage of the integrator.
    discrete: DiscreteState,
    disturbances: Disturbances,
    sequence: Sequence,
    events: Vec<Event>,
    snapshot: Snapshot,
    frozen: Frozen,
    /// `None`: full fidelity.
    paper: Option<Paper>,
    cached_rate: Option<CachedRate>,
}

/// What somebody at a bench adds to the world in mid-run; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BenchDisturbance {
    /// Wind on top of the scenario's (m/s).
    pub wind_ned_m_s: Vec3,
    /// Disturbance on top of the scenario's.
    pub disturbance: ConstantDisturbance,
}

/// How a scenario runs the plant: place, idealised actuators, integrator.
#[derive(Clone, Copy, Debug)]
struct Options {
    /// There is ground to stand on.
    ground: bool,
    /// A stand holds the vehicle for the whole run.
    clamped: bool,
    /// Commands come from a schedule and go to the valve as they are.
    open_loop: bool,
    /// Valve and thrusters follow at once.
    ideal: bool,
    /// The gimbal follows at once.
    ideal_gimbal: bool,
    integrator: IntegratorKind,
}

/// Where mass leaves, body FRD (m).
#[derive(Clone, Copy, Debug)]
struct ExitPoints {
    nozzle: Vec3,
    vent: Vec3,
}

/// Everything that [`Plant::evaluate`] finds at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Evaluation {
    /// Time derivative of the state.
    pub rate: Rate,
    /// Engine.
    pub engine: OperatingPoint,
    /// Oxidiser valve behind the play (rad).
    pub valve_rad: f64,
    /// Open area of the oxidiser valve (m²).
    pub valve_area_m2: f64,
    /// Gimbal behind the play (rad).
    pub gimbal_rad: Vector2<f64>,
    /// Bottle and run tank.
    pub pressurant: NitrogenState,
    /// Mass properties about the pivot, liquid at rest, engine at zero gimbal.
    pub mass: MassProperties,
    /// Accelerations and slosh force.
    pub acceleration: Acceleration,
    /// Legs.
    pub contact: Contact,
    /// Velocity of the air (m/s).
    pub wind_ned_m_s: Vec3,
    /// Where the vehicle is and how it moves.
    pub motion: Kinematics,
}

impl Plant {
    /// The plant at step 0 of a scenario.
    ///
    /// # Errors
    /// When the initial state contradicts the vehicle.
    pub fn new(scenario: &Scenario) -> Result<Self, Invalid> {
        Self::seeded(scenario, scenario.file.seed)
    }

    /// The same under a seed that replaces the scenario's: turbulence and noisy disturbances follow from it.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub(crate) fn seeded(scenario: &Scenario, seed: u32) -> Result<Self, Invalid> {
        Self::at_step_zero(scenario, seed, SimTime::from_s(scenario.file.physics.step_s))
    }

    /// One step under a command: the block diagram.
    pub fn step(&mut self, command: &ActuatorCommand) {
        if self.paper.is_some() {
            self.step_paper(command);
        } else {
            self.latch_commands(command);
            self.latch_feed_inputs();
            self.integrate();
            self.advance_feed();
            self.state.q_ned_from_body.normalize_mut();
        }
        self.time = self.time + self.step;
        self.advance_disturbances(self.step.s());
        self.finish_step();
    }

    /// Sets wind and disturbance from the bench. Wind acts in the next step, the disturbance one step later.
    pub fn set_bench_disturbance(&mut self, bench_disturbance: &BenchDisturbance) {
        let BenchDisturbance { wind_ned_m_s, disturbance } = *bench_disturbance;
        self.environment.wind.add_ned_m_s((wind_ned_m_s != Vec3::zeros()).then_some(wind_ned_m_s));
        self.disturbances
            .set_constant((disturbance != ConstantDisturbance::default()).then_some(disturbance));
        // The evaluation at the end of the last step knows nothing of it.
        self.cached_rate = None;
    }

    /// The continuous state over one step.
    #[inline(always)]
    fn integrate(&mut self) {
        let dt_s = self.step.s();
        let first = self.first_rate();
        match self.options.integrator {
            IntegratorKind::Rk4 => {
                let before = self.state;
                self.state = rk4_step_from(&before, &first, dt_s, |state, at| self.rate(state, at));
                // The port radius follows from the burnt mass, so fuel is conserved to round-off; integrated
                // by itself it would leave the error of the method in its square.
                let burnt_kg = self.state.burnt_kg - before.burnt_kg;
                self.state.port_radius_m = self.port_radius_after_burning_m(&before, burnt_kg);
            }
            IntegratorKind::Euler => self.state = self.state.advanced(&first, dt_s),
        }
    }

    /// The rate alone: what else an evaluation finds need not be stored.
    #[inline(never)]
    fn rate(&self, state: &State, step_fraction: f64) -> Rate {
        self.evaluate_inline(state, step_fraction).rate
    }

    pub(super) fn note(&mut self, kind: EventKind, detail: String) {
        self.events.push(Event { time_s: self.time.s(), kind, detail });
    }

    pub(super) fn fuel_kg(&self, state: &State) -> f64 {
        self.vehicle.engine_parameters.grain.fuel_kg(state.port_radius_m)
    }

    /// Port radius (m) when so much more fuel has gone.
    fn port_radius_after_burning_m(&self, state: &State, burnt_kg: f64) -> f64 {
        let grain = &self.vehicle.engine_parameters.grain;
        if burnt_kg <= 0.0 {
            return state.port_radius_m;
        }
        grain.port_radius_of_fuel_m(grain.fuel_kg(state.port_radius_m) - burnt_kg).max(state.port_radius_m)
    }

    /// Mission time at a fraction of the step (s); -1 before ignition, when no gust blows.
    pub(super) fn mission_s_at(&self, step_fraction: f64) -> f64 {
        match self.inputs.ignition_time {
            Some(ignition) => self.time.since(ignition).s() + step_fraction * self.step.s(),
            None => -1.0,
        }
    }

    /// Time since ignition (s).
    pub fn mission_s(&self) -> Option<f64> {
        self.inputs.ignition_time.map(|ignition| self.time.since(ignition).s())
    }

    /// Run time.
    pub fn time(&self) -> SimTime {
        self.time
    }

    /// The continuous state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The world.
    pub fn environment(&self) -> &Environment {
        &self.environment
    }

    /// Height of the pivot above the pad when the full vehicle rests on its legs (m).
    pub fn rest_height_m(&self) -> f64 {
        self.rest_height_m
    }

    /// Events since the last call.
    pub fn take_events(&mut self) -> std::vec::Drain<'_, Event> {
        self.events.drain(..)
    }

    /// The vehicle at the end of the last step.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// What sensors see now.
    pub fn truth(&self) -> Truth {
        let (state, now) = (&self.state, &self.snapshot);
        Truth {
            position_ned_m: state.position_ned_m,
            velocity_ned_m_s: state.velocity_ned_m_s,
            q_ned_from_body: now.q_ned_from_body,
            rate_body_rad_s: state.rate_body_rad_s,
            specific_force_integral_body_m_s: state.imu_velocity_body_m_s,
            rate_integral_body_rad: state.imu_angle_body_rad,
            wind_ned_m_s: now.wind_ned_m_s,
            tank_pa: now.tank_pa,
            bottle_pa: now.bottle_pa,
            injector_inlet_pa: now.injector_inlet_pa,
            chamber_pa: now.chamber_pa,
        }
    }
}

fn motion(state: &State) -> Kinematics {
    Kinematics {
        position_ned_m: state.position_ned_m,
        velocity_ned_m_s: state.velocity_ned_m_s,
        ned_from_body: state.attitude().to_rotation_matrix().into_inner(),
        rate_body_rad_s: state.rate_body_rad_s,
    }
}
