//! The built-in flight controller: flies a whole hop from measurements alone.
//!
//! ```text
//! Measurement → navigation → sequence → guidance → tracking → allocation → ActuatorCommand
//!               propellant    abort     planning   (mpc, or
//!               observer                (lcvx)      control)
//! ```
//!
//! It sees the measurements of a flight computer and knows the data sheet in [`Parameters`], but neither
//! vehicle nor plant. [`Autopilot::update`] flies, once per inertial sample (250 Hz). [`Autopilot::observe`]
//! keeps filter, mass estimate and disturbance observer running while another pilot flies, and
//! [`Autopilot::take_over`] continues from the state of that moment. Plans are ordered from the owner and
//! delivered back ([`planning`]), so that no plan delays a command.
//!
//! Failures are caught by two ladders of fallbacks: [`lcvx::Rung`] for plans, [`tracking::Rung`] for
//! commands, whose last rung is the cascaded loops of [`control`]. The use of each rung is counted.
//!
//! Position is local: the origin lies on the pad surface under the point where the vehicle was aligned, so
//! that the constant part of the satellite position error cancels.

// The flight as data.
pub mod mission;
pub mod phase;
pub mod trajectory;

// What ends a phase, and what ends a mission.
pub mod abort;
pub mod sequence;

// Vehicle and actuators.
pub mod rigid_body;
pub mod roll;

pub mod allocation;

pub mod propellant;

// Navigation.
pub mod alignment;

pub mod navigation;

// Guidance.
pub mod guidance;
pub mod lcvx;

// Control.
pub mod mpc;

pub mod tracking;

pub mod control;

pub mod parameters;

// The parts of the flight controller.
pub mod planning;

mod estimation;
mod flight_control;

use crate::frame::Vec3;
use crate::signal::{ActuatorCommand, Measurement};
use crate::time::SimTime;
use abort::{Abort, AbortReason, AbortWatch};
use allocation::Allocation;
use control::Controller;
pub use estimation::Estimate;
use guidance::Guidance;
pub use mission::{AbortLimits, ControlLaw, GuidanceLaw, MassKnowledge, Mission, MissionKind};
use navigation::{GroundState, Navigation};
pub use parameters::Parameters;
pub use phase::Phase;
use planning::Planning;
use propellant::PropellantEstimate;
use sequence::Sequence;
use tracking::Tracker;
use tracking::observer::Observer;
use trajectory::Reference;

/// The flight controller.
#[derive(Clone, Debug)]
pub struct Autopilot {
    parameters: Parameters,
    navigation: Navigation,
    propellant: PropellantEstimate,
    sequence: Sequence,
    abort_watch: AbortWatch,
    guidance: Guidance,
    planning: Planning,
    observer: Observer,
    tracker: Tracker,
    controller: Controller,
    allocation: Allocation,
    command: ActuatorCommand,
    /// Off the ground.
    airborne: bool,
    /// Gimbal axes x, y that could not give the torque demanded last.
    gimbal_saturated: [bool; 2],
    /// Time of the newest inertial sample.
    time: SimTime,
    chamber_pa: Option<f64>,
    /// Time that another pilot has spent at the hover height (s).
    hover_time_s: f64,
    /// Time since another pilot demanded thrust (s).
    demand_time_s: f64,
    /// Time at rest with the engine off (s).
    rest_time_s: f64,
}

/// Greatest distance to the landing point at a hand-over; farther, the vehicle lands where it is (m).
const TARGET_DISTANCE_MAX_M: f64 = 15.0;
/// The vehicle hovers within this of the hover height, slower than this climb or descent (m, m/s).
const HOVER_BAND_M: f64 = 2.0;
const HOVER_CLIMB_M_S: f64 = 1.0;
/// Time at rest that confirms a landing (s).
const REST_CONFIRMATION_S: f64 = 0.5;
/// Another pilot's thrust demand may lift the vehicle after this time (s).
const LIFTING_DEMAND_S: f64 = 0.2;

impl Autopilot {
    /// On the pad, before alignment. Parameters are not checked here: see [`Parameters::validate`].
    pub fn new(parameters: Parameters) -> Self {
        let rest = parameters.navigation.rest_ned_m;
        let (propellant, tracking) = (&parameters.propellant, &parameters.tracking);
        let tracker = Tracker::new(
            tracking,
            &tracking.airframe(&propellant.full, propellant.lag_s),
            &tracking.airframe(&propellant.empty, propellant.lag_s),
            parameters.navigation.gravity_m_s2,
        );
        Self {
            navigation: Navigation::new(parameters.navigation.clone()),
            propellant: PropellantEstimate::new(&parameters.propellant),
            sequence: Sequence::default(),
            abort_watch: AbortWatch::new(&parameters.mission),
            guidance: Guidance::at_rest(rest, parameters.navigation.rest_heading_rad),
            planning: Planning::default(),
            observer: Observer::default(),
            tracker,
            controller: Controller::default(),
            allocation: Allocation::default(),
            command: ActuatorCommand::SAFE,
            airborne: false,
            gimbal_saturated: [false; 2],
            time: SimTime::ZERO,
            chamber_pa: None,
            hover_time_s: 0.0,
            demand_time_s: 0.0,
            rest_time_s: 0.0,
            parameters,
        }
    }

    /// Flies one step: one measurement in, one command out.
    pub fn update(&mut self, m: &Measurement) -> ActuatorCommand {
        let ground = match self.sequence.phase() {
            phase if phase.is_before_lift_off() => GroundState::OnPad,
            Phase::Shutdown | Phase::Done | Phase::AbortCut if self.rest_time_s > REST_CONFIRMATION_S => {
                GroundState::Landed
            }
            _ => GroundState::Unknown,
        };
        let Some(dt_s) = self.update_estimate(m, ground) else { return self.without_inertial_sample(m.time) };

        let phase = self.sequence.phase();
        let inputs = self.sequence_inputs();
        self.sequence.step(&self.parameters.mission, &self.parameters.sequence, &inputs, dt_s);
        self.watch_for_abort(dt_s);
        if self.sequence.phase() != phase {
            self.enter(self.sequence.phase());
        }
        self.plan(dt_s);
        self.command = self.fly(dt_s);
        self.command
    }

    /// Without an inertial sample the last command stays in force for a short time, then the open-loop
    /// command, at last a cut.
    fn without_inertial_sample(&mut self, now: SimTime) -> ActuatorCommand {
        let silence_s = now.since(self.time).s();
        if !self.sequence.phase().is_flight() || silence_s <= tracking::OLDEST_PLAN_S {
            return self.command;
        }
        if silence_s > self.parameters.mission.abort.inertial_silence_s {
            self.abort_watch.declare(AbortReason::Inertial, now);
            self.sequence.enter(Phase::AbortCut, 0.0);
            self.command = ActuatorCommand::SAFE;
        } else {
            self.command = self.open_loop_command();
        }
        self.command
    }

    /// Follows another pilot, whose command `applied` is in force: updates filter, mass, trim and
    /// disturbances, commands nothing.
    pub fn observe(&mut self, m: &Measurement, applied: &ActuatorCommand) {
        self.command = *applied;
        let demanded = applied.armed && self.demand_n() > self.parameters.propellant.thrust_shut_n;
        let ground = if self.airborne || self.demand_time_s > LIFTING_DEMAND_S {
            if self.rest_time_s > REST_CONFIRMATION_S { GroundState::Landed } else { GroundState::Unknown }
        } else {
            GroundState::OnPad
        };
        if demanded && !self.navigation.is_aligned() {
            // The other pilot starts before the alignment is complete: use the averages so far.
            self.navigation.align(m, 0.0);
        }
        let Some(dt_s) = self.update_estimate(m, ground) else { return };
        self.demand_time_s = if demanded { self.demand_time_s + dt_s } else { 0.0 };
        if self.sequence.phase() == Phase::Align && self.navigation.is_aligned() {
            self.sequence.enter(Phase::Ready, 0.0);
        }
        let is_lifting = self.demand_time_s > LIFTING_DEMAND_S;
        if self.airborne {
            self.count_hover_time(dt_s);
        } else if self.height_m() > estimation::FREE_FLIGHT_HEIGHT_M && is_lifting {
            self.airborne = true;
        }
    }

    /// Becomes the pilot. In the air it continues the mission from where the vehicle is, if the propellant
    /// allows, else it lands; on the ground it shuts the engine down and does not start again.
    pub fn take_over(&mut self) {
        if !self.airborne || self.rest_time_s > REST_CONFIRMATION_S || !self.navigation.is_aligned() {
            let phase = if self.command.armed { Phase::Shutdown } else { Phase::Done };
            self.sequence.enter(phase, 0.0);
            return;
        }
        let mission = &self.parameters.mission;
        let rest = self.parameters.navigation.rest_ned_m;
        let pivot = self.navigation.pivot();
        let (height, climb) = (rest.z - pivot.position_ned_m.z, -pivot.velocity_ned_m_s.z);
        let near_hover = (height - mission.hover_height_m).abs() < HOVER_BAND_M;
        let (phase, elapsed_s) = if height < mission.terminal_height_m && climb < 0.5 {
            (Phase::Terminal, 0.0)
        } else if self.propellant_low() || self.hover_time_s >= mission.hover_time_s || climb < -1.5 {
            (Phase::Descent, 0.0)
        } else if near_hover && climb.abs() < HOVER_CLIMB_M_S {
            (Phase::Hover, self.hover_time_s)
        } else {
            (Phase::Ascent, 0.0)
        };
        let landing = rest + Vec3::new(mission.target_north_east_m[0], mission.target_north_east_m[1], 0.0);
        let position = pivot.position_ned_m;
        let away = position - landing;
        if libm::hypot(away.x, away.y) > TARGET_DISTANCE_MAX_M {
            self.parameters.mission.target_north_east_m = [position.x - rest.x, position.y - rest.y];
        }
        self.planning.reset();
        self.follow_ramps(phase, &self.present_motion());
        self.tracker.reset();
        self.controller = self.cascade_from_observer();
        self.allocation = self.allocation.resume(self.command.gimbal_x_rad, self.command.gimbal_y_rad);
        self.sequence.enter(phase, elapsed_s);
    }

    /// Counts the time that another pilot spends at the hover height.
    fn count_hover_time(&mut self, dt_s: f64) {
        let climb_m_s = self.motion().velocity_ned_m_s.z;
        if (self.height_m() - self.parameters.mission.hover_height_m).abs() < HOVER_BAND_M
            && climb_m_s.abs() < HOVER_CLIMB_M_S
        {
            self.hover_time_s += dt_s;
        }
    }

    /// The present phase.
    pub const fn phase(&self) -> Phase {
        self.sequence.phase()
    }

    /// The decision to abort, if there is one: the newest and gravest.
    pub const fn abort(&self) -> Option<Abort> {
        self.abort_watch.abort()
    }

    /// The reference being tracked.
    pub fn reference(&self) -> Reference {
        self.guidance.reference()
    }

    /// The mission as it is flown. A hand-over far from the target moves the target there, an abort to where
    /// the vehicle can stop.
    pub const fn mission(&self) -> &Mission {
        &self.parameters.mission
    }

    /// Predictive tracking.
    pub const fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The filter, for consistency tests.
    pub const fn navigation(&self) -> &Navigation {
        &self.navigation
    }
}
