//! Disturbance observers: a force and an offset of the thrust line, estimated from the motion.
//!
//! Two Luenberger observers, each with a constant unknown: velocity with a force per mass (wind,
//! accelerometer bias, wrong mass), angular momentum with an offset of the thrust line from the centre of
//! mass (mass off the axis, misaligned thrust). As part of the model they make predictive control free of
//! steady-state error, since in a steady state such an observer reproduces the measured motion. The offset is
//! a length because its effect scales with thrust. Source: Pannocchia and Rawlings, "Disturbance models for
//! offset-free model-predictive control", 2003.

use super::model::{Airframe, Control};
use crate::autopilot::rigid_body::MotionEstimate;
use crate::frame::Vec3;

/// Second-order servo of one gimbal axis, as the flight computer models it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoParameters {
    /// Natural frequency (rad/s).
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Rate limit (rad/s).
    pub rate_limit_rad_s: f64,
    /// From command to motion (s).
    pub delay_s: f64,
}

impl ServoParameters {
    /// Delay in following a slow command (s).
    pub(crate) fn latency_s(&self) -> f64 {
        self.delay_s + 2.0 * self.damping_ratio / self.natural_frequency_rad_s.max(1.0)
    }
}

/// Angle and rate of one servo.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Servo {
    /// Angle (rad).
    pub angle_rad: f64,
    /// Rate (rad/s).
    pub rate_rad_s: f64,
}

impl Servo {
    /// Advances toward a command, in steps that a servo of 20 Hz still resolves; a command that is not finite
    /// moves nothing.
    pub fn step(&mut self, p: &ServoParameters, command_rad: f64, dt_s: f64) {
        const SUBSTEPS: u32 = 4;
        let h = dt_s / f64::from(SUBSTEPS);
        let w = p.natural_frequency_rad_s;
        let command_rad = if command_rad.is_finite() { command_rad } else { self.angle_rad };
        for _ in 0..SUBSTEPS {
            // Implicit in the rate: stable for every stiffness.
            let pull = w * w * (command_rad - self.angle_rad - h * self.rate_rad_s);
            let rate = (self.rate_rad_s + h * pull) / (1.0 + 2.0 * p.damping_ratio * w * h);
            self.rate_rad_s = rate.clamp(-p.rate_limit_rad_s, p.rate_limit_rad_s);
            self.angle_rad += h * self.rate_rad_s;
        }
    }
}

/// Poles of the observers (rad/s): the force at the pace of the wind, the moment under the liquid's 14 rad/s,
/// about the long axis at the pace of the thrusters' pulses.
const MOMENT_POLES_RAD_S: [f64; 3] = [4.0, 4.0, 1.0];
const FORCE_POLE_RAD_S: f64 = 1.5;
/// Bounds of the estimates: a sixth of gravity, five centimetres.
const FORCE_LIMIT_M_S2: f64 = 1.6;
const OFFSET_LIMIT_M: f64 = 0.05;
/// Bound of the roll moment (N m).
const ROLL_LIMIT_N_M: f64 = 2.0;

/// Estimated disturbances and gimbal angles.
#[derive(Clone, Copy, Debug, Default)]
pub struct Observer {
    /// Disturbance force per mass (m/s²).
    pub force_ned_m_s2: Vec3,
    /// Lever arms of the thrust about body x and y with the gimbal at zero (m).
    pub thrust_offset_m: [f64; 2],
    /// Disturbance moment about the long axis (N m).
    pub roll_moment_n_m: f64,
    /// Gimbal servos, x and y.
    pub servos: [Servo; 2],
    velocity_ned_m_s: Vec3,
    rate_body_rad_s: Vec3,
    running: bool,
}

impl Observer {
    /// Follows the gimbal alone: on the ground no disturbance is estimated.
    pub fn follow_gimbal(&mut self, servo: &ServoParameters, command_rad: [f64; 2], dt_s: f64) {
        for (axis, command) in self.servos.iter_mut().zip(command_rad) {
            axis.step(servo, command, dt_s);
        }
        self.running = false;
    }

    /// One step in free flight with the command in force.
    pub fn step(
        &mut self,
        servo: &ServoParameters,
        airframe: &Airframe,
        gravity_m_s2: f64,
        command: &Control,
        motion: &MotionEstimate,
        dt_s: f64,
    ) {
        let momentum_rate = self.momentum_rate(airframe, motion);
        if !self.running {
            self.velocity_ned_m_s = motion.velocity_ned_m_s;
            self.rate_body_rad_s = momentum_rate;
            self.running = true;
        }
        let [x, y] = self.servos;
        let (sin_x, sin_y) = (libm::sin(x.angle_rad), libm::sin(y.angle_rad));
        let push = Vec3::new(sin_y, -sin_x, -1.0) * (motion.thrust_n / airframe.mass_kg.max(1.0));
        let expected =
            motion.q_ned_from_body * push + Vec3::new(0.0, 0.0, gravity_m_s2) + self.force_ned_m_s2;
        let error = motion.velocity_ned_m_s - self.velocity_ned_m_s;
        let w = FORCE_POLE_RAD_S;
        self.velocity_ned_m_s += (expected + error * (2.0 * w)) * dt_s;
        self.force_ned_m_s2 = (self.force_ned_m_s2 + error * (w * w * dt_s))
            .map(|a| a.clamp(-FORCE_LIMIT_M_S2, FORCE_LIMIT_M_S2));

        let [ix, iy, iz] = airframe.inertia_kg_m2;
        let (t, l) = (motion.thrust_n, airframe.lever_arm_m);
        let [offset_x, offset_y] = self.thrust_offset_m;
        let moment = Vec3::new(
            t * (l * sin_x + offset_x),
            t * (l * sin_y + offset_y),
            command.roll_torque_n_m + self.roll_moment_n_m,
        );
        let spin = Vec3::new(ix * momentum_rate.x, iy * momentum_rate.y, iz * momentum_rate.z);
        let torque = moment - momentum_rate.cross(&spin);
        let error = momentum_rate - self.rate_body_rad_s;
        let [wx, wy, wz] = MOMENT_POLES_RAD_S;
        let acceleration = Vec3::new(torque.x / ix, torque.y / iy, torque.z / iz);
        let pull = Vec3::new(2.0 * wx * error.x, 2.0 * wy * error.y, 2.0 * wz * error.z);
        self.rate_body_rad_s += (acceleration + pull) * dt_s;
        // The offset is moment over thrust; at low thrust the gain stays bounded.
        let per_thrust = dt_s / t.max(100.0);
        self.thrust_offset_m = [
            (offset_x + error.x * ix * wx * wx * per_thrust).clamp(-OFFSET_LIMIT_M, OFFSET_LIMIT_M),
            (offset_y + error.y * iy * wy * wy * per_thrust).clamp(-OFFSET_LIMIT_M, OFFSET_LIMIT_M),
        ];
        self.roll_moment_n_m =
            (self.roll_moment_n_m + error.z * iz * wz * wz * dt_s).clamp(-ROLL_LIMIT_N_M, ROLL_LIMIT_N_M);
        for (axis, command) in self.servos.iter_mut().zip(command.gimbal_rad) {
            axis.step(servo, command, dt_s);
        }
        if !(self.velocity_ned_m_s.iter().chain(self.rate_body_rad_s.iter()).all(|x| x.is_finite())
            && self.force_ned_m_s2.iter().chain(self.thrust_offset_m.iter()).all(|x| x.is_finite())
            && self.roll_moment_n_m.is_finite())
        {
            *self = Self { servos: self.servos, ..Self::default() };
        }
    }

    /// Gimbal angles that balance the offset of the thrust line (rad).
    pub(crate) fn trim_rad(&self, airframe: &Airframe) -> [f64; 2] {
        self.thrust_offset_m.map(|offset| -offset / airframe.lever_arm_m.max(0.05))
    }

    /// Body rate less the recoil of the gimbal's motion (rad/s).
    pub(crate) fn momentum_rate(&self, airframe: &Airframe, motion: &MotionEstimate) -> Vec3 {
        let [kx, ky] = airframe.recoil;
        let [x, y] = self.servos;
        motion.rate_body_rad_s - Vec3::new(kx * x.rate_rad_s, ky * y.rate_rad_s, 0.0)
    }
}
