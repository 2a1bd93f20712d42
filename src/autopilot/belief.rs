//! What the flight controller believes, from filter, engine model and disturbance observer, and what it concludes.

use super::abort::AbortInputs;
use super::mission::MassKnowledge;
use super::navigation::GroundState;
use super::propellant::MassPoint;
use super::sequence::Evidence;
use super::tracking::Control;
use super::tracking::model::Airframe;
use super::tracking::observer::MotionEstimate;
use super::{Autopilot, Estimate};
use crate::frame::{Vec3, tilt_rad};
use crate::signal::{Measurement, Throttle};

impl Autopilot {
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

    /// Filter and engine estimate; gives the length of the step, `None` without an inertial sample.
    pub(super) fn sense(&mut self, m: &Measurement, standing: GroundState) -> Option<f64> {
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

        self.learn_disturbances(dt_s);

        let force = self.navigation.specific_force_body_m_s2();
        let quiet = (force.norm() - self.parameters.navigation.gravity_m_s2).abs() < 1.0
            && self.navigation.rate_body_rad_s().norm() < 0.1
            && demand_n <= self.parameters.propellant.thrust_shut_n;
        self.landed_s = if quiet { self.landed_s + dt_s } else { 0.0 };
        Some(dt_s)
    }

    pub(super) fn evidence(&self) -> Evidence {
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
            reference_at_hover: self.course().is_at_hover(&self.guidance.reference()),
            reference_over_target: self.course().is_over_target(&self.guidance.reference()),
        }
    }

    pub(super) fn abort_inputs(&self) -> AbortInputs {
        let seen = self.evidence();
        let sight = self.navigation.sight();
        let (position, _) = self.navigation.point(Vec3::zeros());
        let from_start = position - self.parameters.navigation.rest_ned_m;
        let gravity = self.parameters.navigation.gravity_m_s2;
        AbortInputs {
            propellant_low: self.propellant_low(),
            tilt_rad: tilt_rad(&self.navigation.q_ned_from_body()),
            gnss_refused: sight.gnss_refused,
            gnss_silence_s: sight.gnss_silence_s,
            altimeter_silence_s: sight.altimeter_silence_s,
            air_m_s2: libm::hypot(self.observer.force_ned_m_s2.x, self.observer.force_ned_m_s2.y),
            guidance_exhausted: self.planning.is_exhausted(),
            off_reference_m: (position - self.guidance.reference().position_ned_m).norm(),
            from_start_m: libm::hypot(from_start.x, from_start.y),
            height_m: seen.height_m,
            descent_speed_m_s: seen.descent_speed_m_s,
            full_thrust_m_s2: self.parameters.actuators.thrust_max_n / self.propellant.mass_kg.max(1e-3)
                - gravity,
            unexplained_force: seen.unexplained_force,
        }
    }

    /// Disturbances show in free flight, whoever flies; on the ground only the gimbal is followed.
    fn learn_disturbances(&mut self, dt_s: f64) {
        let control = self.control_in_force();
        let servo = &self.parameters.tracking.servo;
        if !self.integrate.airborne {
            self.observer.follow_gimbal(servo, control.gimbal_rad, dt_s);
            return;
        }
        let (airframe, seen) = (self.airframe(), self.seen());
        let gravity = self.parameters.navigation.gravity_m_s2;
        let command = (control.gimbal_rad, control.roll_torque_n_m);
        self.observer.step(&self.parameters.tracking.servo, &airframe, gravity, command, &seen, dt_s);
    }

    /// Motion of the centre of mass, and thrust.
    pub(super) fn seen(&self) -> MotionEstimate {
        let (position_ned_m, velocity_ned_m_s) = self.navigation.point(self.mass_properties().com_body_m);
        MotionEstimate {
            position_ned_m,
            velocity_ned_m_s,
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

    /// What the command in force asks of the actuators, thrust as it is expected to come.
    pub(super) fn control_in_force(&self) -> Control {
        Control {
            thrust_n: self.demand_n() * self.propellant.trim,
            gimbal_rad: [self.command.gimbal_x_rad, self.command.gimbal_y_rad],
            roll_torque_n_m: self.command.rcs_roll * self.parameters.actuators.roll.torque_n_m,
        }
    }

    /// Thrust that the command in force asks for (N).
    pub(super) fn demand_n(&self) -> f64 {
        match self.command.throttle {
            Throttle::ThrustN(thrust_n) => thrust_n,
            Throttle::ValveRad(angle) => {
                self.parameters.thrust_map.thrust_at_valve_n(angle, self.propellant.port_radius_m)
            }
        }
    }

    pub(super) fn mass_properties(&self) -> MassPoint {
        self.propellant.mass_properties(&self.parameters.propellant)
    }

    pub(super) fn height_m(&self) -> f64 {
        self.parameters.navigation.rest_ned_m.z - self.navigation.point(Vec3::zeros()).0.z
    }

    pub(super) fn propellant_low(&self) -> bool {
        let mission = &self.parameters.mission;
        let ramps_s = mission.descent_speed_m_s / mission.acceleration_m_s2;
        // Who still climbs has to stop first, and comes down from where that is.
        let climb_m_s = (-self.navigation.point(Vec3::zeros()).1.z).max(0.0);
        let stop_s = climb_m_s / mission.acceleration_m_s2;
        let down_s = stop_s
            + (self.height_m().max(0.0) + 0.5 * climb_m_s * stop_s) / mission.descent_speed_m_s
            + ramps_s
            + mission.terminal_height_m / mission.terminal_speed_m_s;
        let gravity = self.parameters.navigation.gravity_m_s2;
        let left_s =
            self.propellant.endurance_s(&self.parameters.propellant, &self.parameters.thrust_map, gravity);
        left_s < down_s + mission.abort.reserve_s
    }
}
