//! The built-in flight controller: flies a whole hop on an estimate made from measurements alone.
//!
//! ```text
//! Measurement → navigation → sequence → guidance → tracking → allocation → ActuatorCommand
//!               propellant    abort     planning   (mpc, or
//!               observer                (lcvx)      control)
//! ```
//!
//! It sees what a flight computer sees and knows what a flight computer is told in [`Parameters`]; neither
//! vehicle nor plant is in reach. One call of [`Autopilot::update`] per inertial sample (250 Hz) flies;
//! [`Autopilot::observe`] keeps filter, mass estimate and disturbance observer alive while somebody else flies, and
//! [`Autopilot::take_over`] makes it the pilot from the state of that moment. What has to be planned is ordered from its
//! owner and delivered back ([`planning`]), so that no plan holds up a command.
//!
//! Two ladders catch what fails: [`lcvx::Rung`] under the plans, [`tracking::Rung`] under the commands, which ends in the
//! cascaded loops of [`control`]. Both are counted.
//!
//! Position is local: the origin lies on the pad surface under the point where the vehicle was aligned, so
//! that the constant part of satellite navigation's error cancels.

// The flight as data.
pub mod mission;
pub mod phase;
pub mod trajectory;

// What ends a phase, and what ends a mission.
pub mod abort;
pub mod sequence;

// Actuators, engine, mass.
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

pub mod planning;

mod belief;
mod flying;

use crate::frame::Vec3;
use crate::input::Invalid;
use crate::signal::{ActuatorCommand, Measurement};
use crate::time::SimTime;
use abort::{Abort, AbortReason, AbortWatch};
use allocation::{ActuatorParameters, Allocation, ThrustMap};
use control::{Controller, Gains, Integrate};
use guidance::Guidance;
pub use mission::{AbortLimits, ControlLaw, GuidanceLaw, MassKnowledge, Mission, MissionKind};
use nalgebra::UnitQuaternion;
use navigation::{GroundState, Navigation, NavigationHealth, NavigationParameters};
pub use phase::Phase;
use planning::Planning;
use propellant::{PropellantEstimate, PropellantParameters};
use sequence::{Sequence, SequenceParameters};
use tracking::observer::Observer;
use tracking::{Tracker, TrackingParameters};
use trajectory::Reference;

/// Everything the flight controller is told before the flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// What to fly.
    pub mission: Mission,
    /// Times and thresholds of the sequence.
    pub sequence: SequenceParameters,
    /// Sensors and site.
    pub navigation: NavigationParameters,
    /// Engine and masses.
    pub propellant: PropellantParameters,
    /// The engine's inverse.
    pub thrust_map: ThrustMap,
    /// Limits of the actuators.
    pub actuators: ActuatorParameters,
    /// Gains of the cascaded controller.
    pub gains: Gains,
    /// Predictive tracking.
    pub tracking: TrackingParameters,
    /// Planning.
    pub planner: lcvx::Settings,
}

impl Parameters {
    /// Contradictions between parameters.
    pub fn validate(&self) -> Result<(), Invalid> {
        if !self.thrust_map.is_consistent() {
            return Err(Invalid::new(
                "vehicle.thrust_command_max_n",
                "from half of thrust_command_min_n up to this there is no thrust that the engine gives at every \
                 radius of its ports, with a valve angle that rises with it",
            ));
        }
        let (low, high) = (self.actuators.thrust_min_n, self.actuators.thrust_max_n);
        if !(low > 0.0 && low < high) {
            return Err(Invalid::new("actuators.thrust_min_n", format!("{low} N must lie under {high} N")));
        }
        let (full, empty) = (self.propellant.full.mass_kg, self.propellant.empty.mass_kg);
        if !(empty > 0.0 && empty < full) {
            return Err(Invalid::new(
                "propellant.empty.mass_kg",
                format!("{empty} kg must lie under {full} kg"),
            ));
        }
        if self.mission.terminal_height_m >= self.mission.hover_height_m {
            return Err(Invalid::new(
                "mission.terminal_height_m",
                format!(
                    "{} m must lie under the hover height of {} m",
                    self.mission.terminal_height_m, self.mission.hover_height_m
                ),
            ));
        }
        let abort = &self.mission.abort;
        if abort.cut_tilt_rad <= abort.tilt_rad {
            return Err(Invalid::new(
                "mission.abort.cut_tilt_rad",
                format!(
                    "{} rad must lie over mission.abort.tilt_rad = {} rad",
                    abort.cut_tilt_rad, abort.tilt_rad
                ),
            ));
        }
        if let Some(ceiling_m) = abort.ceiling_m.filter(|&c| c <= self.mission.hover_height_m) {
            return Err(Invalid::new(
                "mission.abort.ceiling_m",
                format!("{ceiling_m} m must lie over the hover height of {} m", self.mission.hover_height_m),
            ));
        }
        let [north, east] = self.mission.target_north_east_m;
        if let Some(radius_m) = abort.radius_m.filter(|&r| r <= libm::hypot(north, east)) {
            return Err(Invalid::new(
                "mission.abort.radius_m",
                format!(
                    "{radius_m} m must reach beyond the landing point at {:.1} m",
                    libm::hypot(north, east)
                ),
            ));
        }
        let (limit, abort) = (self.mission.tilt_limit_rad, self.mission.abort.tilt_rad);
        if abort <= limit {
            return Err(Invalid::new(
                "mission.abort.tilt_rad",
                format!("{abort} rad must lie over mission.tilt_limit_rad = {limit} rad"),
            ));
        }
        Ok(())
    }
}

/// What the flight controller believes.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Time of the newest inertial sample.
    pub time: SimTime,
    /// The filter has been aligned; before, the rest is a guess.
    pub aligned: bool,
    /// Position of the pivot, from the pad surface under the starting point (m).
    pub position_ned_m: Vec3,
    /// Velocity of the pivot (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Velocity of the centre of mass (m/s).
    pub com_velocity_ned_m_s: Vec3,
    /// Attitude.
    pub q_ned_from_body: UnitQuaternion<f64>,
    /// Body rate, bias removed (rad/s).
    pub rate_body_rad_s: Vec3,
    /// Height of the pivot above rest (m).
    pub height_m: f64,
    /// Gyroscope bias (rad/s).
    pub gyro_bias_rad_s: Vec3,
    /// Accelerometer bias (m/s²).
    pub accel_bias_m_s2: Vec3,
    /// Barometer offset (m).
    pub baro_offset_m: f64,
    /// Standard deviation of position (m).
    pub position_std_m: Vec3,
    /// Standard deviation of velocity (m/s).
    pub velocity_std_m_s: Vec3,
    /// Standard deviation of attitude, about NED axes (rad).
    pub attitude_std_rad: Vec3,
    /// Mass of the vehicle (kg).
    pub mass_kg: f64,
    /// Oxidiser used (kg).
    pub oxidizer_used_kg: f64,
    /// Fuel used (kg).
    pub fuel_used_kg: f64,
    /// Thrust (N).
    pub thrust_n: f64,
    /// Thrust over the thrust commanded, learnt in flight.
    pub thrust_trim: f64,
    /// Nitrogen that the roll thrusters have used (kg).
    pub nitrogen_rcs_kg: f64,
    /// Refused measurements and resets.
    pub health: NavigationHealth,
}

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
    integrate: Integrate,
    time: SimTime,
    chamber_pa: Option<f64>,
    hovered_s: f64,
    demanded_s: f64,
    landed_s: f64,
}

/// A target farther than this from where a hand-over finds the vehicle is not worth the propellant (m).
const TARGET_REACH_M: f64 = 15.0;

impl Autopilot {
    /// On the pad, nothing known yet. Parameters are taken as they are: see [`Parameters::validate`].
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
            integrate: Integrate { airborne: false, saturated: [false; 2] },
            time: SimTime::ZERO,
            chamber_pa: None,
            hovered_s: 0.0,
            demanded_s: 0.0,
            landed_s: 0.0,
            parameters,
        }
    }

    /// Flies: one measurement in, one command out.
    pub fn update(&mut self, m: &Measurement) -> ActuatorCommand {
        let standing = match self.sequence.phase() {
            phase if phase.is_before_lift_off() => GroundState::OnPad,
            Phase::Shutdown | Phase::Done | Phase::AbortCut if self.landed_s > 0.5 => GroundState::Landed,
            _ => GroundState::No,
        };
        let Some(dt_s) = self.sense(m, standing) else { return self.without_inertial_sample(m.time) };

        let phase = self.sequence.phase();
        let evidence = self.evidence();
        self.sequence.step(&self.parameters.mission, &self.parameters.sequence, &evidence, dt_s);
        self.watch_for_abort(dt_s);
        if self.sequence.phase() != phase {
            self.enter(self.sequence.phase());
        }
        self.plan(dt_s);
        self.command = self.fly(dt_s);
        self.command
    }

    /// Between inertial samples the last command stands, but not for long: then straight and level as far as that goes without
    /// knowing, and at last a cut.
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
            self.command = self.blind();
        }
        self.command
    }

    /// Shadows another pilot, who had `applied` in force: filter, mass, trim and disturbances go on, nothing is commanded.
    pub fn observe(&mut self, m: &Measurement, applied: &ActuatorCommand) {
        self.command = *applied;
        let demanded = applied.armed && self.demand_n() > self.parameters.propellant.thrust_shut_n;
        let standing = if self.integrate.airborne || self.demanded_s > 0.2 {
            if self.landed_s > 0.5 { GroundState::Landed } else { GroundState::No }
        } else {
            GroundState::OnPad
        };
        if demanded && !self.navigation.is_aligned() {
            // Somebody starts before the averages are as long as they should be: take what there is.
            self.navigation.align(m, 0.0);
        }
        let Some(dt_s) = self.sense(m, standing) else { return };
        self.demanded_s = if demanded { self.demanded_s + dt_s } else { 0.0 };
        if self.sequence.phase() == Phase::Align && self.navigation.is_aligned() {
            self.sequence.enter(Phase::Ready, 0.0);
        }
        if self.integrate.airborne {
            self.watch_hover(dt_s);
        } else if self.height_m() > 0.3 && self.demanded_s > 0.2 {
            self.integrate.airborne = true;
        }
    }

    /// Becomes the pilot. In the air it goes on with the mission from where it is, if the propellant allows,
    /// else it goes down; on the ground it shuts the engine down and does not start by itself.
    pub fn take_over(&mut self) {
        if !self.integrate.airborne || self.landed_s > 0.5 || !self.navigation.is_aligned() {
            let phase = if self.command.armed { Phase::Shutdown } else { Phase::Done };
            self.sequence.enter(phase, 0.0);
            return;
        }
        let mission = &self.parameters.mission;
        let rest = self.parameters.navigation.rest_ned_m;
        let (position, velocity) = self.navigation.point(Vec3::zeros());
        let (height, climb) = (rest.z - position.z, -velocity.z);
        let near_hover = (height - mission.hover_height_m).abs() < 2.0;
        let (phase, elapsed_s) = if height < mission.terminal_height_m && climb < 0.5 {
            (Phase::Terminal, 0.0)
        } else if self.propellant_low() || self.hovered_s >= mission.hover_time_s || climb < -1.5 {
            (Phase::Descent, 0.0)
        } else if near_hover && climb.abs() < 1.0 {
            (Phase::Hover, self.hovered_s)
        } else {
            (Phase::Ascent, 0.0)
        };
        let start = rest + Vec3::new(mission.target_north_east_m[0], mission.target_north_east_m[1], 0.0);
        let away = position - start;
        if libm::hypot(away.x, away.y) > TARGET_REACH_M {
            self.parameters.mission.target_north_east_m = [position.x - rest.x, position.y - rest.y];
        }
        self.planning.drop_all();
        self.follow_ramps(phase, &self.under_way());
        self.tracker.reset();
        self.controller = self.cascade_from_observer();
        self.allocation = self.allocation.resume(self.command.gimbal_x_rad, self.command.gimbal_y_rad);
        self.sequence.enter(phase, elapsed_s);
    }

    /// Time that another pilot has spent at the hover height.
    fn watch_hover(&mut self, dt_s: f64) {
        let climb_m_s = self.seen().velocity_ned_m_s.z;
        if (self.height_m() - self.parameters.mission.hover_height_m).abs() < 2.0 && climb_m_s.abs() < 1.0 {
            self.hovered_s += dt_s;
        }
    }

    /// The present phase.
    pub const fn phase(&self) -> Phase {
        self.sequence.phase()
    }

    /// The decision to end the mission early, if one has fallen: the newest and gravest.
    pub const fn abort(&self) -> Option<Abort> {
        self.abort_watch.abort()
    }

    /// The reference being tracked.
    pub fn reference(&self) -> Reference {
        self.guidance.reference()
    }

    /// The mission as it is being flown; the target moves at a hand-over far from it, and with an abort to
    /// where the vehicle can stop.
    pub const fn mission(&self) -> &Mission {
        &self.parameters.mission
    }

    /// Predictive tracking: where commands came from.
    pub const fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The filter, for consistency tests.
    pub const fn navigation(&self) -> &Navigation {
        &self.navigation
    }
}
