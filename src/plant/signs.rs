//! The table of signs, computed from the plant itself: deflect one command at a time in hover and see
//! which way the vehicle begins to turn.

use serde::Serialize;

use crate::frame::Vec3;
use crate::input::Invalid;
use crate::scenario::Scenario;
use crate::signal::{ActuatorCommand, Discrete, Throttle};
use crate::vehicle::Vehicle;

use super::Plant;

/// One command and what it does.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The command, at a positive value.
    pub command: &'static str,
    /// What the conventions say it does.
    pub convention: &'static str,
    /// How the vehicle begins to turn against the same flight without the command, body FRD (rad/s²).
    pub angular_acceleration_rad_s2: [f64; 3],
    /// How its pivot begins to move against the same flight without the command, NED (m/s²).
    pub acceleration_ned_m_s2: [f64; 3],
    /// Whether the plant does what the conventions say.
    pub agrees: bool,
}

/// Steps until the actuators have followed: ten time constants of the reference vehicle's slowest.
const FOLLOW_STEPS: usize = 400;

/// Computes the table for a vehicle with full tanks in hover.
///
/// # Errors
/// When the vehicle contradicts itself.
pub fn table(vehicle: &Vehicle) -> Result<Vec<Row>, Invalid> {
    let mut neutral = ActuatorCommand {
        armed: true,
        throttle: Throttle::ThrustN(vehicle.rating.thrust_command_min_n),
        gimbal_x_rad: 0.0,
        gimbal_y_rad: 0.0,
        rcs_roll: 0.0,
        discrete: Discrete::FLIGHT,
    };
    let plant = Plant::new(&Scenario::free_flight(vehicle, neutral))?;
    let weight_n = plant.snapshot().mass_kg * plant.environment().gravity.magnitude_m_s2;
    neutral.throttle = Throttle::ThrustN(weight_n);
    let hover = &Scenario::free_flight(vehicle, neutral);
    let small_rad = 0.25 * hover.vehicle.gimbal.limit_rad;
    let cases = [
        (
            "throttle",
            "more thrust, upward (NED -z)",
            ActuatorCommand { throttle: Throttle::ThrustN(1.05 * weight_n), ..neutral },
            None,
        ),
        (
            "gimbal_x",
            "positive moment about FRD x",
            ActuatorCommand { gimbal_x_rad: small_rad, ..neutral },
            Some(0),
        ),
        (
            "gimbal_y",
            "positive moment about FRD y",
            ActuatorCommand { gimbal_y_rad: small_rad, ..neutral },
            Some(1),
        ),
        ("rcs_roll", "positive moment about FRD z", ActuatorCommand { rcs_roll: 1.0, ..neutral }, Some(2)),
    ];
    let base = accelerations(hover, &neutral)?;
    cases
        .into_iter()
        .map(|(command, convention, deflected, axis)| {
            let [turn, motion] = accelerations(hover, &deflected)?;
            let (turn, motion) = (turn - base[0], motion - base[1]);
            let agrees = match axis {
                None => motion.z < 0.0,
                // The right axis, the right way, and by far the most.
                Some(axis) => {
                    turn[axis] > 0.0
                        && turn[axis] > 5.0 * (turn.norm_squared() - turn[axis] * turn[axis]).max(0.0).sqrt()
                }
            };
            Ok(Row {
                command,
                convention,
                angular_acceleration_rad_s2: turn.into(),
                acceleration_ned_m_s2: motion.into(),
                agrees,
            })
        })
        .collect()
}

/// Angular acceleration in the body and acceleration over ground, when the actuators have followed a
/// command and the vehicle is put back to rest, upright.
fn accelerations(hover: &Scenario, command: &ActuatorCommand) -> Result<[Vec3; 2], Invalid> {
    let mut plant = Plant::new(hover)?;
    let rest = *plant.state();
    for _ in 0..FOLLOW_STEPS {
        plant.step(command);
    }
    let mut state = *plant.state();
    state.q_ned_from_body = rest.q_ned_from_body;
    state.rate_body_rad_s = rest.rate_body_rad_s;
    state.velocity_ned_m_s = rest.velocity_ned_m_s;
    state.slosh_m = rest.slosh_m;
    state.slosh_m_s = rest.slosh_m_s;
    state.second_slosh_m = rest.second_slosh_m;
    state.second_slosh_m_s = rest.second_slosh_m_s;
    state.gimbal_rad_s = Vec3::zeros();
    let rate = plant.evaluate(&state, 0.0).rate;
    Ok([rate.rate_body_rad_s, rate.velocity_ned_m_s])
}
