//! Cascaded tracking control: position → velocity → acceleration → thrust and tilt; attitude → rate → torque.
//! It flies until the vehicle is free of its legs, as the last rung under predictive tracking, and with
//! `mission.control = "cascaded"`.
//!
//! The swinging engine causes a pair of zeros of torque over gimbal angle at √(T (l + s_e/m)/(I_e + s_e l)),
//! with I_e and s_e the engine's inertia and first moment about the pivot: near 13 rad/s for this class of
//! vehicle. The liquid sloshes near 14 rad/s with 3 % damping. The rate loop therefore crosses over near a
//! third of that. Above the zeros the gimbal's inertial reaction has the sign of a rate feedback, so that the
//! loop stays stable, but a higher bandwidth gains nothing. The controlled point is the centre of mass: at
//! the pivot the side force would first act in the wrong direction.

use super::rigid_body::{MassProperties, MotionEstimate};
use super::trajectory::Reference;
use crate::frame::{Vec3, heading_rad};

/// Gains, as rates of the loops (1/s) so that they do not depend on mass or inertia.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// Height error to climb speed (1/s).
    pub height_1_s: f64,
    /// Climb speed error to acceleration (1/s).
    pub climb_1_s: f64,
    /// Horizontal position error to speed (1/s).
    pub position_1_s: f64,
    /// Horizontal speed error to acceleration (1/s).
    pub velocity_1_s: f64,
    /// Integral of the horizontal speed error (1/s²).
    pub velocity_integral_1_s2: f64,
    /// Tilt error to body rate (1/s).
    pub attitude_1_s: f64,
    /// Body rate error to angular acceleration (1/s).
    pub rate_1_s: f64,
    /// Integral of the tilt error, as a share of the proportional path per second (1/s).
    pub attitude_integral_1_s: f64,
    /// Heading error to roll rate (1/s).
    pub heading_1_s: f64,
    /// Roll rate error to angular acceleration (1/s).
    pub roll_rate_1_s: f64,
}

impl Default for Gains {
    /// For a valve of 5 Hz, a gimbal of 8 Hz, zeros at 12 rad/s: each loop has half the bandwidth of the next
    /// inner one or less.
    fn default() -> Self {
        Self {
            height_1_s: 1.0,
            climb_1_s: 2.5,
            position_1_s: 0.6,
            velocity_1_s: 1.3,
            velocity_integral_1_s2: 0.45,
            attitude_1_s: 2.5,
            rate_1_s: 5.0,
            attitude_integral_1_s: 0.4,
            heading_1_s: 0.6,
            roll_rate_1_s: 1.2,
        }
    }
}

/// Limits of the demand.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Greatest tilt commanded (rad).
    pub tilt_rad: f64,
    /// Least thrust (N).
    pub thrust_min_n: f64,
    /// Greatest thrust (N).
    pub thrust_max_n: f64,
    /// Gravity (m/s²).
    pub gravity_m_s2: f64,
}

/// Inputs of one step of the controller.
#[derive(Clone, Copy, Debug)]
pub struct ControlInput<'a> {
    /// Limits of the demand.
    pub limits: Limits,
    /// Reference of the pivot.
    pub reference: Reference,
    /// Motion of the centre of mass, attitude, rate.
    pub motion: &'a MotionEstimate,
    /// Mass properties.
    pub mass: &'a MassProperties,
    /// Off the ground. On it the integrators hold: the force of the legs is no error.
    pub airborne: bool,
    /// Gimbal axes x, y at their limit: their integrators hold.
    pub gimbal_saturated: [bool; 2],
}

/// Demand of the controller on the actuators.
#[derive(Clone, Copy, Debug)]
pub struct Demand {
    /// Thrust (N).
    pub thrust_n: f64,
    /// Torque about the centre of mass (N m).
    pub torque_body_n_m: Vec3,
}

/// Greatest vertical speed that the height error adds to the reference (m/s).
const CLIMB_CORRECTION_M_S: f64 = 1.5;
/// Greatest horizontal speed that the position error adds to the reference (m/s).
const LATERAL_CORRECTION_M_S: f64 = 1.5;
/// Bound of the velocity integral: an 18 m/s wind, and a gimbal trim of a degree (m/s²).
const INTEGRAL_LIMIT_M_S2: f64 = 1.4;
/// Bound of the attitude integral, as thrust misalignment (rad).
const TRIM_ANGLE_LIMIT_RAD: f64 = 0.05;
/// Greatest body rate across the long axis, and about it (rad/s).
const RATE_LIMIT_RAD_S: f64 = 0.5;
const ROLL_RATE_LIMIT_RAD_S: f64 = 0.3;

/// Integrators of the cascade.
#[derive(Clone, Copy, Debug, Default)]
pub struct Controller {
    acceleration_ne_m_s2: [f64; 2],
    torque_xy_n_m: [f64; 2],
}

impl Controller {
    /// Continues from another controller's trim: at zero error the first demand is the torque `torque_xy_n_m`
    /// and the horizontal acceleration `acceleration_ne_m_s2`.
    pub const fn resume(torque_xy_n_m: [f64; 2], acceleration_ne_m_s2: [f64; 2]) -> Self {
        Self { acceleration_ne_m_s2, torque_xy_n_m }
    }

    /// One step.
    pub fn step(&mut self, gains: &Gains, input: &ControlInput, dt_s: f64) -> Demand {
        let ControlInput { limits, motion, mass, .. } = input;
        let acceleration = self.acceleration(gains, input, dt_s);
        let up_force = acceleration - Vec3::new(0.0, 0.0, limits.gravity_m_s2); // thrust over mass, NED
        let axis_up = motion.q_ned_from_body * -Vec3::z();
        // The vertical force must be right: the loss by the tilt is compensated, up to 45 deg.
        let cosine = (-axis_up.z).max(0.7);
        let thrust_n = (mass.mass_kg * -up_force.z / cosine).clamp(limits.thrust_min_n, limits.thrust_max_n);
        let torque_body_n_m = self.torque(gains, input, up_force, thrust_n, dt_s);
        Demand { thrust_n, torque_body_n_m }
    }

    /// Acceleration demand of position and velocity loop, NED (m/s²).
    fn acceleration(&mut self, gains: &Gains, input: &ControlInput, dt_s: f64) -> Vec3 {
        let ControlInput { limits, reference, motion, mass, .. } = input;
        // The reference is the pivot of an upright vehicle, the motion that of the centre of mass above it.
        let above = Vec3::new(0.0, 0.0, mass.com_body_m.z);
        let position_error = reference.position_ned_m + above - motion.position_ned_m;
        let mut correction = position_error * gains.position_1_s;
        let lateral = libm::hypot(correction.x, correction.y);
        if lateral > LATERAL_CORRECTION_M_S {
            correction *= LATERAL_CORRECTION_M_S / lateral;
        }
        correction.z =
            (position_error.z * gains.height_1_s).clamp(-CLIMB_CORRECTION_M_S, CLIMB_CORRECTION_M_S);
        let velocity_error = reference.velocity_ned_m_s + correction - motion.velocity_ned_m_s;

        let mut a = reference.acceleration_ned_m_s2;
        a.x += gains.velocity_1_s * velocity_error.x + self.acceleration_ne_m_s2[0];
        a.y += gains.velocity_1_s * velocity_error.y + self.acceleration_ne_m_s2[1];
        a.z += gains.climb_1_s * velocity_error.z;
        a.z = a.z.clamp(-0.5 * limits.gravity_m_s2, 0.5 * limits.gravity_m_s2);

        let lateral = libm::hypot(a.x, a.y);
        let most = (limits.gravity_m_s2 - a.z) * libm::tan(limits.tilt_rad);
        if lateral > most {
            a.x *= most / lateral;
            a.y *= most / lateral;
        } else if input.airborne {
            for (i, error) in [velocity_error.x, velocity_error.y].into_iter().enumerate() {
                let next = self.acceleration_ne_m_s2[i] + gains.velocity_integral_1_s2 * error * dt_s;
                self.acceleration_ne_m_s2[i] = next.clamp(-INTEGRAL_LIMIT_M_S2, INTEGRAL_LIMIT_M_S2);
            }
        }
        a
    }

    /// Torque demand of attitude and rate loop, body axes (N m), from the demanded force per mass.
    fn torque(
        &mut self,
        gains: &Gains,
        input: &ControlInput,
        up_force: Vec3,
        thrust_n: f64,
        dt_s: f64,
    ) -> Vec3 {
        let ControlInput { reference, motion, mass, .. } = input;
        // Tilt error: the shortest rotation of the body's up axis onto the demanded force, in body axes.
        let wanted_up = motion.q_ned_from_body.inverse() * up_force;
        let wanted_up = wanted_up / wanted_up.norm().max(1e-6);
        let up = -Vec3::z();
        let turn = up.cross(&wanted_up);
        let sine = turn.norm();
        let angle = libm::atan2(sine, up.dot(&wanted_up));
        let tilt_error = if sine > 1e-9 { turn * (angle / sine) } else { Vec3::zeros() };

        let mut rate = tilt_error * gains.attitude_1_s;
        let size = libm::hypot(rate.x, rate.y);
        if size > RATE_LIMIT_RAD_S {
            rate *= RATE_LIMIT_RAD_S / size;
        }
        let heading_error = wrap(reference.heading_rad - heading_rad(&motion.q_ned_from_body));
        rate.z = (gains.heading_1_s * heading_error).clamp(-ROLL_RATE_LIMIT_RAD_S, ROLL_RATE_LIMIT_RAD_S);

        let rate_error = rate - motion.rate_body_rad_s;
        let inertia = mass.inertia_kg_m2;
        let lever_arm_m = -mass.com_body_m.z;
        let most = thrust_n * lever_arm_m * TRIM_ANGLE_LIMIT_RAD;
        for (i, (inertia, error)) in
            [(inertia[0], rate_error.x), (inertia[1], rate_error.y)].into_iter().enumerate()
        {
            if input.airborne && !input.gimbal_saturated[i] {
                let gain = inertia * gains.rate_1_s * gains.attitude_integral_1_s;
                self.torque_xy_n_m[i] = (self.torque_xy_n_m[i] + gain * error * dt_s).clamp(-most, most);
            }
        }
        Vec3::new(
            inertia[0] * gains.rate_1_s * rate_error.x + self.torque_xy_n_m[0],
            inertia[1] * gains.rate_1_s * rate_error.y + self.torque_xy_n_m[1],
            inertia[2] * gains.roll_rate_1_s * rate_error.z,
        )
    }
}

/// An angle moved by a turn into -π..π.
fn wrap(angle_rad: f64) -> f64 {
    use core::f64::consts::{PI, TAU};
    if angle_rad > PI {
        angle_rad - TAU
    } else if angle_rad < -PI {
        angle_rad + TAU
    } else {
        angle_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    const LIMITS: Limits =
        Limits { tilt_rad: 0.2, thrust_min_n: 300.0, thrust_max_n: 1050.0, gravity_m_s2: 9.80665 };

    fn mass() -> MassProperties {
        MassProperties {
            mass_kg: 70.0,
            com_body_m: Vec3::new(0.0, 0.0, -0.4),
            inertia_kg_m2: [22.0, 22.0, 2.4],
        }
    }

    fn motion(position: Vec3) -> MotionEstimate {
        MotionEstimate {
            position_ned_m: position,
            velocity_ned_m_s: Vec3::zeros(),
            q_ned_from_body: UnitQuaternion::identity(),
            rate_body_rad_s: Vec3::zeros(),
            thrust_n: 0.0,
        }
    }

    fn demand(motion: &MotionEstimate) -> Demand {
        let input = ControlInput {
            limits: LIMITS,
            reference: Reference::default(),
            motion,
            mass: &mass(),
            airborne: true,
            gimbal_saturated: [false; 2],
        };
        Controller::default().step(&Gains::default(), &input, 0.004)
    }

    #[test]
    fn at_the_reference_it_carries_the_weight_and_nothing_else() {
        let d = demand(&motion(Vec3::new(0.0, 0.0, -0.4)));
        assert!((d.thrust_n - 70.0 * LIMITS.gravity_m_s2).abs() < 1e-9);
        assert!(d.torque_body_n_m.norm() < 1e-9);
    }

    #[test]
    fn too_far_north_tilts_south_and_too_low_gives_thrust() {
        // A positive turn about east leans the nose, which is body -z, to the south.
        let d = demand(&motion(Vec3::new(1.0, 0.0, -0.4)));
        assert!(d.torque_body_n_m.y > 1.0 && d.torque_body_n_m.x.abs() < 1e-9);
        let d = demand(&motion(Vec3::new(0.0, 0.0, 0.1)));
        assert!(d.thrust_n > 70.0 * LIMITS.gravity_m_s2);
    }
}
