//! The estimated state of the vehicle, from filter, engine model and disturbance observer, and the inputs of
//! sequence and aborts derived from it.

use super::Autopilot;
use super::abort::AbortInputs;
use super::mission::MassKnowledge;
use super::navigation::{GroundState, NavigationHealth, PointMotion};
use super::rigid_body::{MassProperties, MotionEstimate};
use super::sequence::SequenceInputs;
use super::tracking::Control;
use super::tracking::model::Airframe;
use crate::frame::{Vec3, tilt_rad};
use crate::signal::{Measurement, Throttle};
use crate::time::SimTime;
use nalgebra::UnitQuaternion;

/// Estimated state of the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Time of the newest inertial sample.
    pub time: SimTime,
    /// The filter has been aligned; before, the rest is not valid.
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
    /// Mass of the vehicle (kg).
    pub mass_kg: f64,
    /// Oxidiser used (kg).
    pub oxidizer_used_kg: f64,
    /// Fuel used (kg).
    pub fuel_used_kg: f64,
    /// Thrust (N).
    pub thrust_n: f64,
    /// Measured thrust over the thrust of the engine model.
    pub thrust_trim: f64,
    /// Nitrogen that the roll thrusters have used (kg).
    pub nitrogen_rcs_kg: f64,
    /// Refused measurements and resets.
    pub health: NavigationHealth,
}

/// Height above rest at which the vehicle certainly flies free (m).
pub(super) const FREE_FLIGHT_HEIGHT_M: f64 = 0.3;
/// At rest: difference of specific force from gravity (m/s²) and body rate (rad/s).
const REST_FORCE_M_S2: f64 = 1.0;
const REST_RATE_RAD_S: f64 = 0.1;

impl Autopilot {
    /// The present estimate.
    pub fn estimate(&self) -> Estimate {
        let (pivot, biases) = (self.navigation.pivot(), self.navigation.biases());
        Estimate {
            time: self.time,
            aligned: self.navigation.is_aligned(),
            position_ned_m: pivot.position_ned_m,
            velocity_ned_m_s: pivot.velocity_ned_m_s,
            com_velocity_ned_m_s: self.com_motion().velocity_ned_m_s,
            q_ned_from_body: self.navigation.q_ned_from_body(),
            rate_body_rad_s: self.navigation.rate_body_rad_s(),
            height_m: self.height_m(),
            gyro_bias_rad_s: biases.gyro_rad_s,
            accel_bias_m_s2: biases.accel_m_s2,
            baro_offset_m: biases.baro_m,
            position_std_m: self.navigation.position_std_m(),
            mass_kg: self.propellant.mass_kg,
            oxidizer_used_kg: self.propellant.oxidizer_used_kg,
            fuel_used_kg: self.propellant.fuel_used_kg,
            thrust_n: self.propellant.thrust_n(),
            thrust_trim: self.propellant.trim,
            nitrogen_rcs_kg: self.allocation.nitrogen_rcs_kg(&self.parameters.actuators),
            health: self.navigation.health(),
        }
    }

    /// Updates filter, engine and disturbance estimate; returns the length of the step (s), `None` without an
    /// inertial sample.
    pub(super) fn update_estimate(&mut self, m: &Measurement, ground: GroundState) -> Option<f64> {
        if let Some(p) = m.pressures.chamber_pa.filter(|p| p.is_finite()) {
            self.chamber_pa = Some(p);
        }
        if self.navigation.is_aligned() {
            self.navigation.step(m, ground);
        } else {
            self.navigation.align(m, self.parameters.mission.alignment_s);
        }
        let imu = m.imu.as_ref()?;
        let dt_s = imu.interval_s.clamp(1e-4, 0.05);
        self.time = m.time;

        let lit = self.chamber_pa.map(|p| p >= 0.5 * self.parameters.sequence.lit_pressure_pa);
        let demand_n = if self.command.armed { self.demand_n() } else { 0.0 };
        if self.command.armed {
            self.allocation.count_nitrogen(&self.parameters.actuators, self.command.rcs_roll, dt_s);
        }
        self.propellant.step(&self.parameters.propellant, &self.parameters.thrust_map, demand_n, lit, dt_s);
        if self.parameters.mission.mass_knowledge == MassKnowledge::Liftoff {
            self.propellant.mass_kg = self.parameters.propellant.full.mass_kg;
        }
        if self.airborne && self.height_m() > FREE_FLIGHT_HEIGHT_M {
            let force_n = -self.navigation.specific_force_body_m_s2().z * self.propellant.mass_kg;
            self.propellant.trim_step(&self.parameters.propellant, force_n, dt_s);
        }

        self.update_observer(dt_s);

        let force = self.navigation.specific_force_body_m_s2();
        let at_rest = (force.norm() - self.parameters.navigation.gravity_m_s2).abs() < REST_FORCE_M_S2
            && self.navigation.rate_body_rad_s().norm() < REST_RATE_RAD_S
            && demand_n <= self.parameters.propellant.thrust_shut_n;
        self.rest_time_s = if at_rest { self.rest_time_s + dt_s } else { 0.0 };
        Some(dt_s)
    }

    /// Inputs of the mission sequence.
    pub(super) fn sequence_inputs(&self) -> SequenceInputs {
        let com = self.com_motion();
        debug_assert!(com.position_ned_m.iter().all(|x| x.is_finite()));
        let weight_n = self.propellant.mass_kg * self.parameters.navigation.gravity_m_s2;
        let force_n = -self.navigation.specific_force_body_m_s2().z * self.propellant.mass_kg;
        SequenceInputs {
            aligned: self.navigation.is_aligned(),
            chamber_pa: self.chamber_pa,
            height_m: self.height_m(),
            descent_speed_m_s: com.velocity_ned_m_s.z,
            unexplained_force: (force_n - self.propellant.thrust_n()) / weight_n.max(1.0),
            reference_at_hover: self.mission_profile().is_at_hover(&self.guidance.reference()),
            reference_over_target: self.mission_profile().is_over_target(&self.guidance.reference()),
        }
    }

    /// Inputs of the abort watch.
    pub(super) fn abort_inputs(&self) -> AbortInputs {
        let sequence = self.sequence_inputs();
        let aiding = self.navigation.aiding();
        let position = self.navigation.pivot().position_ned_m;
        let from_start = position - self.parameters.navigation.rest_ned_m;
        let gravity = self.parameters.navigation.gravity_m_s2;
        AbortInputs {
            propellant_low: self.propellant_low(),
            tilt_rad: tilt_rad(&self.navigation.q_ned_from_body()),
            gnss_refused: aiding.gnss_refused,
            gnss_silence_s: aiding.gnss_silence_s,
            altimeter_silence_s: aiding.altimeter_silence_s,
            wind_m_s2: libm::hypot(self.observer.force_ned_m_s2.x, self.observer.force_ned_m_s2.y),
            guidance_exhausted: self.planning.is_exhausted(),
            off_reference_m: (position - self.guidance.reference().position_ned_m).norm(),
            from_start_m: libm::hypot(from_start.x, from_start.y),
            height_m: sequence.height_m,
            descent_speed_m_s: sequence.descent_speed_m_s,
            full_thrust_m_s2: self.parameters.actuators.thrust_max_n / self.propellant.mass_kg.max(1e-3)
                - gravity,
            unexplained_force: sequence.unexplained_force,
        }
    }

    /// Updates the disturbance observer in free flight, whoever flies; on the ground it only follows the
    /// gimbal.
    fn update_observer(&mut self, dt_s: f64) {
        let control = self.control_in_force();
        let servo = &self.parameters.tracking.servo;
        if !self.airborne {
            self.observer.follow_gimbal(servo, control.gimbal_rad, dt_s);
            return;
        }
        let (airframe, motion) = (self.airframe(), self.motion());
        let gravity = self.parameters.navigation.gravity_m_s2;
        self.observer.step(servo, &airframe, gravity, &control, &motion, dt_s);
    }

    /// Motion of the centre of mass, attitude and thrust.
    pub(super) fn motion(&self) -> MotionEstimate {
        let com = self.com_motion();
        MotionEstimate {
            position_ned_m: com.position_ned_m,
            velocity_ned_m_s: com.velocity_ned_m_s,
            q_ned_from_body: self.navigation.q_ned_from_body(),
            rate_body_rad_s: self.navigation.rate_body_rad_s(),
            thrust_n: self.propellant.thrust_n(),
        }
    }

    /// The vehicle as predictive control models it.
    pub(super) fn airframe(&self) -> Airframe {
        let mass = self.mass_properties();
        self.parameters.tracking.airframe(&mass, self.parameters.propellant.lag_s)
    }

    /// The command in force as inputs of the model, thrust corrected by its trim.
    pub(super) fn control_in_force(&self) -> Control {
        Control {
            thrust_n: self.demand_n() * self.propellant.trim,
            gimbal_rad: [self.command.gimbal_x_rad, self.command.gimbal_y_rad],
            roll_torque_n_m: self.command.rcs_roll * self.parameters.actuators.roll.torque_n_m,
        }
    }

    /// Thrust demand of the command in force (N).
    pub(super) fn demand_n(&self) -> f64 {
        match self.command.throttle {
            Throttle::ThrustN(thrust_n) => thrust_n,
            Throttle::ValveRad(angle) => {
                self.parameters.thrust_map.thrust_at_valve_n(angle, self.propellant.port_radius_m)
            }
        }
    }

    /// Mass properties at the estimated mass.
    pub(super) fn mass_properties(&self) -> MassProperties {
        self.propellant.mass_properties(&self.parameters.propellant)
    }

    fn com_motion(&self) -> PointMotion {
        self.navigation.point(self.mass_properties().com_body_m)
    }

    /// Height of the pivot above rest (m).
    pub(super) fn height_m(&self) -> f64 {
        self.parameters.navigation.rest_ned_m.z - self.navigation.pivot().position_ned_m.z
    }

    /// The propellant lasts no longer than the way down and the reserve.
    pub(super) fn propellant_low(&self) -> bool {
        let mission = &self.parameters.mission;
        let ramps_s = mission.descent_speed_m_s / mission.acceleration_m_s2;
        // A climb has to be stopped first, and the descent begins where that is.
        let climb_m_s = (-self.navigation.pivot().velocity_ned_m_s.z).max(0.0);
        let stop_s = climb_m_s / mission.acceleration_m_s2;
        let down_s = stop_s
            + (self.height_m().max(0.0) + 0.5 * climb_m_s * stop_s) / mission.descent_speed_m_s
            + ramps_s
            + mission.terminal_height_m / mission.terminal_speed_m_s;
        let gravity = self.parameters.navigation.gravity_m_s2;
        let endurance_s =
            self.propellant.endurance_s(&self.parameters.propellant, &self.parameters.thrust_map, gravity);
        endurance_s < down_s + mission.abort.reserve_s
    }
}
