//! The built-in flight controller: flies a whole hop on an estimate made from measurements alone.
//!
//! ```text
//! Measurement → navigation → sequence → reference → tracking control → allocation → ActuatorCommand
//!               (filter)     (phase)    (guidance)   (control)
//! ```
//!
//! It sees what a flight computer sees and knows what a flight computer is told in [`Parameters`]; neither
//! vehicle nor plant is in reach. One call of [`Autopilot::update`] per inertial sample (250 Hz) flies;
//! [`Autopilot::observe`] keeps filter and mass estimate alive while somebody else flies, and
//! [`Autopilot::take_over`] makes it the pilot from the state of that moment. The reference generator is
//! the place where optimal guidance goes, the tracking controller the place for predictive control.
//!
//! Position is local: the origin lies on the pad surface under the point where the vehicle was aligned, so
//! that the constant part of satellite navigation's error cancels.

pub mod abort;
pub mod alignment;
pub mod allocation;
pub mod control;
pub mod guidance;
pub mod navigation;
pub mod phase;
pub mod propellant;
pub mod roll;
pub mod trajectory;

use crate::frame::{Vec3, heading_rad, tilt_rad};
use crate::input::Invalid;
use crate::signal::{ActuatorCommand, Discrete, Measurement, Throttle};
use crate::time::SimTime;
pub use abort::AbortLimits;
use abort::{Abort, AbortKind, AbortWatch, Signs};
use allocation::{ActuatorParameters, Allocation, ThrustMap};
use control::{Controller, Gains, Integrate, Limits, Motion};
use guidance::{Reference, ReferenceGenerator};
use nalgebra::UnitQuaternion;
use navigation::{Navigation, NavigationHealth, NavigationParameters, Standing};
use phase::{Evidence, Sequence, SequenceParameters};
pub use phase::{MassKnowledge, Mission, MissionKind, Phase};
use propellant::{MassPoint, PropellantEstimate, PropellantParameters};

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
    /// Loop gains.
    pub gains: Gains,
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
    generator: ReferenceGenerator,
    controller: Controller,
    allocation: Allocation,
    command: ActuatorCommand,
    integrate: Integrate,
    time: SimTime,
    chamber_pa: Option<f64>,
    hovered_s: f64,
    demanded_s: f64,
    landed_s: f64,
    held_torque_xy_n_m: [f64; 2],
    drag_ne_m_s2: [f64; 2],
    air_ne_m_s2: [f64; 2],
}

/// Rise of the throttle from idle to lift-off (N/s): slow against the valve, short against the flight.
const LIFT_RAMP_N_S: f64 = 800.0;
/// Height above rest that only free flight reaches: legs give a centimetre (m).
const AIRBORNE_HEIGHT_M: f64 = 0.04;
/// A target farther than this from where a hand-over finds the vehicle is not worth the propellant (m).
const TARGET_REACH_M: f64 = 15.0;
/// Averaging of what another pilot holds: gimbal trim and drag (s).
const SHADOW_TIME_S: f64 = 1.0;
/// Averaging of the force of the air (s).
const AIR_TIME_S: f64 = 1.0;

impl Autopilot {
    /// On the pad, nothing known yet. Parameters are taken as they are: see [`Parameters::validate`].
    pub fn new(parameters: Parameters) -> Self {
        let rest = parameters.navigation.rest_ned_m;
        Self {
            navigation: Navigation::new(parameters.navigation.clone()),
            propellant: PropellantEstimate::new(&parameters.propellant),
            sequence: Sequence::default(),
            abort_watch: AbortWatch::new(&parameters.mission),
            generator: ReferenceGenerator::at_rest(rest, parameters.navigation.rest_heading_rad),
            controller: Controller::default(),
            allocation: Allocation::default(),
            command: ActuatorCommand::SAFE,
            integrate: Integrate { airborne: false, saturated: [false; 2] },
            time: SimTime::ZERO,
            chamber_pa: None,
            hovered_s: 0.0,
            demanded_s: 0.0,
            landed_s: 0.0,
            held_torque_xy_n_m: [0.0; 2],
            drag_ne_m_s2: [0.0; 2],
            air_ne_m_s2: [0.0; 2],
            parameters,
        }
    }

    /// Flies: one measurement in, one command out. Without an inertial sample the last command stands.
    pub fn update(&mut self, m: &Measurement) -> ActuatorCommand {
        let standing = match self.sequence.phase() {
            phase if phase.is_before_lift_off() => Standing::OnPad,
            Phase::Shutdown | Phase::Done | Phase::AbortCut if self.landed_s > 0.5 => Standing::Landed,
            _ => Standing::No,
        };
        let Some(dt_s) = self.sense(m, standing) else { return self.command };

        let phase = self.sequence.phase();
        let evidence = self.evidence();
        self.sequence.step(&self.parameters.mission, &self.parameters.sequence, &evidence, dt_s);
        self.watch_for_abort(dt_s);
        if self.sequence.phase() != phase {
            self.enter(self.sequence.phase());
        }
        self.command = self.fly(dt_s);
        self.command
    }

    /// Shadows another pilot, who had `applied` in force: filter, mass and trim go on, nothing is commanded.
    pub fn observe(&mut self, m: &Measurement, applied: &ActuatorCommand) {
        self.command = *applied;
        let demanded = applied.armed && self.demand_n() > self.parameters.propellant.thrust_shut_n;
        let standing = if self.integrate.airborne || self.demanded_s > 0.2 {
            if self.landed_s > 0.5 { Standing::Landed } else { Standing::No }
        } else {
            Standing::OnPad
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
            self.watch_pilot(dt_s);
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
        self.generator = ReferenceGenerator::moving(rest, &self.under_way());
        self.controller = Controller::resume(self.held_torque_xy_n_m, self.drag_ne_m_s2.map(|a| -a));
        self.allocation = self.allocation.resume(self.command.gimbal_x_rad, self.command.gimbal_y_rad);
        self.sequence.enter(phase, elapsed_s);
    }

    /// The motion of this moment as a reference, its acceleration within the mission's.
    fn under_way(&self) -> Reference {
        let (position_ned_m, velocity_ned_m_s) = self.navigation.point(Vec3::zeros());
        let q = self.navigation.q_ned_from_body();
        let mut acceleration = q * self.navigation.specific_force_body_m_s2();
        acceleration.z += self.parameters.navigation.gravity_m_s2;
        let mission = &self.parameters.mission;
        let most = Vec3::new(
            mission.lateral_acceleration_m_s2,
            mission.lateral_acceleration_m_s2,
            mission.acceleration_m_s2,
        );
        Reference {
            position_ned_m,
            velocity_ned_m_s,
            acceleration_ned_m_s2: acceleration.zip_map(&most, |a, most| a.clamp(-most, most)),
            heading_rad: heading_rad(&q),
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
        self.generator.reference()
    }

    /// The mission as it is being flown; the target moves at a hand-over far from it, and with an abort to
    /// where the vehicle can stop.
    pub const fn mission(&self) -> &Mission {
        &self.parameters.mission
    }

    /// What is believed now.
    pub fn estimate(&self) -> Estimate {
        let (position_ned_m, velocity_ned_m_s) = self.navigation.point(Vec3::zeros());
        let (_, com_velocity_ned_m_s) = self.navigation.point(self.mass_properties().com_body_m);
        let (gyro_bias_rad_s, accel_bias_m_s2, baro_offset_m) = self.navigation.biases();
        let [position_std_m, velocity_std_m_s, attitude_std_rad] = self.navigation.standard_deviations();
        Estimate {
            time: self.time,
            aligned: self.navigation.is_aligned(),
            position_ned_m,
            velocity_ned_m_s,
            com_velocity_ned_m_s,
            q_ned_from_body: self.navigation.q_ned_from_body(),
            rate_body_rad_s: self.navigation.rate_body_rad_s(),
            height_m: self.height_m(),
            gyro_bias_rad_s,
            accel_bias_m_s2,
            baro_offset_m,
            position_std_m,
            velocity_std_m_s,
            attitude_std_rad,
            mass_kg: self.propellant.mass_kg,
            oxidizer_used_kg: self.propellant.oxidizer_used_kg,
            fuel_used_kg: self.propellant.fuel_used_kg,
            thrust_n: self.propellant.thrust_n(),
            thrust_trim: self.propellant.trim,
            nitrogen_rcs_kg: self.allocation.nitrogen_rcs_kg(&self.parameters.actuators),
            health: self.navigation.health(),
        }
    }

    /// The filter, for consistency tests.
    pub const fn navigation(&self) -> &Navigation {
        &self.navigation
    }

    /// Filter and engine estimate; gives the length of the step, `None` without an inertial sample.
    fn sense(&mut self, m: &Measurement, standing: Standing) -> Option<f64> {
        if let Some(p) = m.pressures.chamber_pa.filter(|p| p.is_finite()) {
            self.chamber_pa = Some(p);
        }
        if self.navigation.is_aligned() {
            self.navigation.step(m, standing);
        } else {
            self.navigation.align(m, self.parameters.mission.alignment_s);
        }
        let imu = m.imu.as_ref()?;
        let dt_s = imu.interval_s.clamp(1e-4, 0.05);
        self.time = m.time;

        let lit = self.chamber_pa.map(|p| p >= 0.5 * self.parameters.sequence.lit_pressure_pa);
        let demand_n = if self.command.armed { self.demand_n() } else { 0.0 };
        if self.command.armed {
            self.allocation.count(&self.parameters.actuators, self.command.rcs_roll, dt_s);
        }
        self.propellant.step(&self.parameters.propellant, &self.parameters.thrust_map, demand_n, lit, dt_s);
        if self.parameters.mission.mass_knowledge == MassKnowledge::Liftoff {
            self.propellant.mass_kg = self.parameters.propellant.full.mass_kg;
        }
        if self.integrate.airborne && self.height_m() > 0.3 {
            let force_n = -self.navigation.specific_force_body_m_s2().z * self.propellant.mass_kg;
            self.propellant.trim_step(&self.parameters.propellant, force_n, dt_s);
        }

        self.watch_air(dt_s);

        let force = self.navigation.specific_force_body_m_s2();
        let quiet = (force.norm() - self.parameters.navigation.gravity_m_s2).abs() < 1.0
            && self.navigation.rate_body_rad_s().norm() < 0.1
            && demand_n <= self.parameters.propellant.thrust_shut_n;
        self.landed_s = if quiet { self.landed_s + dt_s } else { 0.0 };
        Some(dt_s)
    }

    fn evidence(&self) -> Evidence {
        let (position, velocity) = self.navigation.point(self.mass_properties().com_body_m);
        debug_assert!(position.iter().all(|x| x.is_finite()));
        let weight_n = self.propellant.mass_kg * self.parameters.navigation.gravity_m_s2;
        let force_n = -self.navigation.specific_force_body_m_s2().z * self.propellant.mass_kg;
        Evidence {
            aligned: self.navigation.is_aligned(),
            chamber_pa: self.chamber_pa,
            height_m: self.height_m(),
            descent_speed_m_s: velocity.z,
            unexplained_force: (force_n - self.propellant.thrust_n()) / weight_n.max(1.0),
            reference_at_hover: self.generator.is_at_hover(&self.parameters.mission),
            reference_over_target: self.generator.is_over_target(&self.parameters.mission),
        }
    }

    /// Leaves the mission where an abort is decided.
    fn watch_for_abort(&mut self, dt_s: f64) {
        let (limits, phase) = (&self.parameters.mission.abort, self.sequence.phase());
        let signs = self.signs();
        match self.abort_watch.step(limits, phase, &signs, self.time, dt_s).map(|abort| abort.kind) {
            Some(AbortKind::Land) => self.sequence.enter(Phase::AbortLand, 0.0),
            Some(AbortKind::Cut) => self.sequence.enter(Phase::AbortCut, 0.0),
            None => {}
        }
    }

    fn signs(&self) -> Signs {
        let seen = self.evidence();
        let sight = self.navigation.sight();
        let (position, _) = self.navigation.point(Vec3::zeros());
        let from_start = position - self.parameters.navigation.rest_ned_m;
        let gravity = self.parameters.navigation.gravity_m_s2;
        Signs {
            propellant_low: self.propellant_low(),
            tilt_rad: tilt_rad(&self.navigation.q_ned_from_body()),
            gnss_refused: sight.gnss_refused,
            gnss_silence_s: sight.gnss_silence_s,
            altimeter_silence_s: sight.altimeter_silence_s,
            air_m_s2: libm::hypot(self.air_ne_m_s2[0], self.air_ne_m_s2[1]),
            guidance_exhausted: false,
            off_reference_m: (position - self.generator.reference().position_ned_m).norm(),
            from_start_m: libm::hypot(from_start.x, from_start.y),
            height_m: seen.height_m,
            descent_speed_m_s: seen.descent_speed_m_s,
            full_thrust_m_s2: self.parameters.actuators.thrust_max_n / self.propellant.mass_kg.max(1e-3)
                - gravity,
            unexplained_force: seen.unexplained_force,
        }
    }

    /// Specific force across the long axis is the engine's, as far as the gimbal explains it, and the air's.
    fn watch_air(&mut self, dt_s: f64) {
        if !self.integrate.airborne {
            return;
        }
        let engine_m_s2 = self.propellant.thrust_n() / self.propellant.mass_kg.max(1e-3);
        let mut across = self.navigation.specific_force_body_m_s2();
        across.x -= engine_m_s2 * libm::sin(self.command.gimbal_y_rad);
        across.y += engine_m_s2 * libm::sin(self.command.gimbal_x_rad);
        across.z = 0.0;
        let across_ned = self.navigation.q_ned_from_body() * across;
        for (air, now) in self.air_ne_m_s2.iter_mut().zip([across_ned.x, across_ned.y]) {
            *air += (now - *air) * dt_s / AIR_TIME_S;
        }
    }

    /// Down from where the vehicle can come to a stop.
    fn land_here(&mut self) {
        let rest = self.parameters.navigation.rest_ned_m;
        let under_way = self.under_way();
        let v = under_way.velocity_ned_m_s;
        let stop_s = libm::hypot(v.x, v.y) / (2.0 * self.parameters.mission.lateral_acceleration_m_s2);
        let target = under_way.position_ned_m - rest + v * stop_s;
        self.parameters.mission.target_north_east_m = [target.x, target.y];
        self.generator = ReferenceGenerator::moving(rest, &under_way);
    }

    fn enter(&mut self, phase: Phase) {
        if phase == Phase::AbortLand {
            self.land_here();
        }
        if phase == Phase::Ascent {
            let heading = heading_rad(&self.navigation.q_ned_from_body());
            self.generator = ReferenceGenerator::at_rest(self.parameters.navigation.rest_ned_m, heading);
            self.controller = Controller::default();
            self.allocation = self.allocation.resume(0.0, 0.0);
        }
    }

    fn fly(&mut self, dt_s: f64) -> ActuatorCommand {
        let armed = ActuatorCommand {
            armed: true,
            throttle: self.throttle(0.0),
            discrete: Discrete {
                igniter: false,
                isolation_open: true,
                vent_shut: true,
                hold_down_released: false,
            },
            ..ActuatorCommand::SAFE
        };
        let idle_n = self.parameters.actuators.thrust_min_n;
        match self.sequence.phase() {
            Phase::Align | Phase::Done => ActuatorCommand::SAFE,
            Phase::Ready => armed,
            Phase::Ignition => {
                ActuatorCommand { throttle: self.throttle(idle_n), discrete: Discrete::FLIGHT, ..armed }
            }
            Phase::Ascent | Phase::Hover | Phase::Descent | Phase::Terminal | Phase::AbortLand => {
                self.track(dt_s)
            }
            Phase::Touchdown | Phase::Shutdown | Phase::AbortCut => {
                ActuatorCommand { discrete: Discrete { igniter: false, ..Discrete::FLIGHT }, ..armed }
            }
        }
    }

    /// Reference, tracking control, allocation.
    fn track(&mut self, dt_s: f64) -> ActuatorCommand {
        let phase = self.sequence.phase();
        let actuators = &self.parameters.actuators;
        let mass = self.mass_properties();
        let weight_n = mass.mass_kg * self.parameters.navigation.gravity_m_s2;
        // The climb begins once the ramp carries the weight; until then the reference stands on the pad.
        let ceiling_n = if self.integrate.airborne {
            actuators.thrust_max_n
        } else {
            actuators.thrust_min_n + LIFT_RAMP_N_S * self.sequence.time_in_phase_s()
        };
        if ceiling_n >= weight_n {
            self.generator.step(&self.parameters.mission, phase, dt_s);
        }
        self.integrate.airborne |= phase != Phase::Ascent || self.height_m() > AIRBORNE_HEIGHT_M;

        let reference = self.generator.reference();
        let (position_ned_m, velocity_ned_m_s) = self.navigation.point(mass.com_body_m);
        let motion = Motion {
            position_ned_m,
            velocity_ned_m_s,
            q_ned_from_body: self.navigation.q_ned_from_body(),
            rate_body_rad_s: self.navigation.rate_body_rad_s(),
        };
        let limits = Limits {
            tilt_rad: self.parameters.mission.tilt_limit_rad,
            thrust_min_n: actuators.thrust_min_n,
            thrust_max_n: actuators.thrust_max_n,
            gravity_m_s2: self.parameters.navigation.gravity_m_s2,
        };
        let demand = self.controller.step(
            &self.parameters.gains,
            &limits,
            &reference,
            &motion,
            &mass,
            self.integrate,
            dt_s,
        );
        let thrust_n = (demand.thrust_n.min(ceiling_n) / self.propellant.trim)
            .clamp(actuators.thrust_min_n, actuators.thrust_max_n);
        let allocated = self.allocation.step(
            actuators,
            demand.torque_body_n_m,
            self.propellant.thrust_n(),
            mass.com_body_m,
            dt_s,
        );
        self.integrate.saturated = allocated.saturated;
        let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
        ActuatorCommand {
            armed: true,
            throttle: self.throttle(if thrust_n.is_finite() { thrust_n } else { weight_n }),
            gimbal_x_rad: finite(allocated.gimbal_x_rad),
            gimbal_y_rad: finite(allocated.gimbal_y_rad),
            rcs_roll: finite(allocated.rcs_roll),
            discrete: Discrete::FLIGHT,
        }
    }

    /// What the other pilot has done and holds, for a hand-over.
    fn watch_pilot(&mut self, dt_s: f64) {
        let mission = &self.parameters.mission;
        let mass = self.mass_properties();
        let (_, velocity) = self.navigation.point(mass.com_body_m);
        if (self.height_m() - mission.hover_height_m).abs() < 2.0 && velocity.z.abs() < 1.0 {
            self.hovered_s += dt_s;
        }
        let share = dt_s / SHADOW_TIME_S;
        let thrust_n = self.propellant.thrust_n();
        let moment_n_m = thrust_n * -mass.com_body_m.z;
        let offset_n_m = allocation::thrust_line_torque_n_m(thrust_n, mass.com_body_m);
        let gimbal = [self.command.gimbal_x_rad, self.command.gimbal_y_rad];
        for (i, angle) in gimbal.into_iter().enumerate() {
            let held = &mut self.held_torque_xy_n_m[i];
            *held += (moment_n_m * libm::sin(angle) + offset_n_m[i] - *held) * share;
        }
        // Sideways specific force is what the air does: thrust is along the long axis.
        let mut across = self.navigation.specific_force_body_m_s2();
        across.z = 0.0;
        let across_ned = self.navigation.q_ned_from_body() * across;
        for (drag, now) in self.drag_ne_m_s2.iter_mut().zip([across_ned.x, across_ned.y]) {
            *drag += (now - *drag) * share;
        }
    }

    fn throttle(&self, thrust_n: f64) -> Throttle {
        self.parameters.actuators.throttle(
            &self.parameters.thrust_map,
            thrust_n,
            self.propellant.port_radius_m,
        )
    }

    /// Thrust that the command in force asks for (N).
    fn demand_n(&self) -> f64 {
        match self.command.throttle {
            Throttle::ThrustN(thrust_n) => thrust_n,
            Throttle::ValveRad(angle) => {
                self.parameters.thrust_map.thrust_at_valve_n(angle, self.propellant.port_radius_m)
            }
        }
    }

    fn mass_properties(&self) -> MassPoint {
        self.propellant.mass_properties(&self.parameters.propellant)
    }

    fn height_m(&self) -> f64 {
        self.parameters.navigation.rest_ned_m.z - self.navigation.point(Vec3::zeros()).0.z
    }

    fn propellant_low(&self) -> bool {
        let mission = &self.parameters.mission;
        let ramps_s = mission.descent_speed_m_s / mission.acceleration_m_s2;
        let down_s = self.height_m().max(0.0) / mission.descent_speed_m_s
            + ramps_s
            + mission.terminal_height_m / mission.terminal_speed_m_s;
        let gravity = self.parameters.navigation.gravity_m_s2;
        let left_s =
            self.propellant.endurance_s(&self.parameters.propellant, &self.parameters.thrust_map, gravity);
        left_s < down_s + mission.abort.reserve_s
    }
}
