//! Gains from what a unit of command does, by bandwidths that flew.
//!
//! A stock PX4 v1.16.1 flew a 70 kg lander (687 N at hover, 8 deg of gimbal 0.9 m below the centre of mass, 25 kg m²:
//! 3.4 rad/s² per unit) with a rate bandwidth, gain times effect, of 7 rad/s, and each outer loop 2.4 to 2.9 times
//! slower than the next. Another lander gets the same bandwidths: its rate gain is 7 rad/s over its own effect. Servos
//! too slow for 7 rad/s get less, and every lateral loop slows down with it. Vertical gains are accelerations, which
//! PX4 turns into thrust by the hover throttle: they hold for any mass. They flew with thrust lags of 0.15 and 0.35 s.

use serde::Serialize;

use super::Lander;

/// Gains and limits, in PX4's units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tuning {
    /// What one unit of each torque servo does at hover, FRD x, y, z (rad/s²).
    pub unit_effect_rad_s2: [f64; 3],
    /// Bandwidth of the rate loops about x and y (rad/s).
    pub rate_bandwidth_rad_s: f64,
    /// Rate loops about x, y, z.
    pub rate: [RateGains; 3],
    /// Attitude loops about x, y, z (1/s).
    pub attitude_p_1_s: [f64; 3],
    /// Greatest rates about x, y, z (deg/s).
    pub rate_max_deg_s: [f64; 3],
    /// Horizontal velocity loop: acceleration per speed, per distance, per acceleration.
    pub velocity_xy: [f64; 3],
    /// Horizontal position loop (1/s).
    pub position_xy_1_s: f64,
    /// Vertical velocity loop.
    pub velocity_z: [f64; 3],
    /// Vertical position loop (1/s).
    pub position_z_1_s: f64,
    /// Greatest accelerations upward and downward (m/s²).
    pub acceleration_up_down_m_s2: [f64; 2],
    /// Hover throttle, and the least and the greatest throttle in flight.
    pub throttle_hover_min_max: [f64; 3],
}

/// A rate loop, in units of command.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RateGains {
    /// Per rate (s/rad).
    pub p: f64,
    /// Per angle (1/rad).
    pub i: f64,
    /// Per angular acceleration (s²/rad).
    pub d: f64,
    /// Limit of the integrator.
    pub integral_limit: f64,
}

/// Rate bandwidth that flew (rad/s).
pub const RATE_BANDWIDTH_RAD_S: f64 = 7.0;
/// Phase that servo and filters may cost at that bandwidth (rad): with 20 deg of it and 90 deg of the integrating
/// plant, 70 deg of margin are left at hover thrust, and 60 deg at 1.5 times that.
const PHASE_COST_RAD: f64 = 0.35;
/// Delay of PX4 itself: one period of 4 ms and the second-order gyro filter at 40 Hz, 2 (0.7)/(2π 40 Hz) (s).
const CONTROLLER_DELAY_S: f64 = 0.010;
/// Attitude, velocity and position gains that flew with that bandwidth (1/s).
const ATTITUDE_1_S: f64 = 2.4;
const VELOCITY_1_S: f64 = 1.0;
const POSITION_1_S: f64 = 0.4;
/// Integral and differential gain of the rate loops over the proportional one.
const INTEGRAL_SHARE_1_S: f64 = 0.2;
const DIFFERENTIAL_SHARE_S: f64 = 0.03;
/// Yaw: the thrusters' pulses last 0.1 s, so the loop about the long axis is slower.
const YAW_BANDWIDTH_RAD_S: f64 = 3.6;
const YAW_INTEGRAL_SHARE_1_S: f64 = 0.067;
const YAW_1_S: f64 = 1.0;
/// Limits of rate that flew (deg/s).
const RATE_MAX_DEG_S: [f64; 3] = [60.0, 60.0, 45.0];
/// Integrator limit that flew, and what stays beside the trim against an offset centre of mass.
const INTEGRAL_LIMIT: f64 = 0.15;
/// Accelerations that flew, and the share of what the engine has that a trajectory may use.
const ACCELERATION_UP_DOWN_M_S2: [f64; 2] = [2.0, 1.5];
const ACCELERATION_SHARE: f64 = 0.6;

impl Tuning {
    /// For a vehicle at hover.
    pub fn of(lander: &Lander) -> Self {
        let effect = lander.unit_effect_rad_s2();
        let delay_s = lander.gimbal_delay_s + CONTROLLER_DELAY_S;
        let bandwidth = RATE_BANDWIDTH_RAD_S.min(PHASE_COST_RAD / delay_s);
        let slower = bandwidth / RATE_BANDWIDTH_RAD_S;
        // The gimbal holds the thrust through a centre of mass beside the axis: offset y is trimmed about x.
        let trim = |offset_m: f64| {
            libm::atan(offset_m.abs() / lander.lever_m) / lander.gimbal_limit_rad
        };
        let lateral = |axis: usize| {
            let p = bandwidth / effect[axis];
            RateGains {
                p,
                i: INTEGRAL_SHARE_1_S * slower * p,
                d: DIFFERENTIAL_SHARE_S * p,
                integral_limit: (INTEGRAL_LIMIT + trim(lander.offset_m[1 - axis])).min(0.5),
            }
        };
        let yaw_p = YAW_BANDWIDTH_RAD_S / effect[2];
        let yaw = RateGains { p: yaw_p, i: YAW_INTEGRAL_SHARE_1_S * yaw_p, d: 0.0, integral_limit: INTEGRAL_LIMIT };
        let attitude = [ATTITUDE_1_S * slower, ATTITUDE_1_S * slower, YAW_1_S];
        // A rate that the attitude loop brakes by itself: gain times rate within the full command's effect.
        let rate_max = |axis: usize| RATE_MAX_DEG_S[axis].min((effect[axis] / attitude[axis]).to_degrees());
        let spare_up = lander.thrust_max_n / lander.mass_kg - lander.gravity_m_s2;
        let spare_down = lander.gravity_m_s2 - lander.thrust_min_n / lander.mass_kg;
        Self {
            unit_effect_rad_s2: effect,
            rate_bandwidth_rad_s: bandwidth,
            rate: [lateral(0), lateral(1), yaw],
            attitude_p_1_s: attitude,
            rate_max_deg_s: [rate_max(0), rate_max(1), rate_max(2)],
            velocity_xy: [VELOCITY_1_S * slower, 0.1 * slower * slower, 0.1],
            position_xy_1_s: POSITION_1_S * slower,
            velocity_z: [2.5, 0.8, 0.0],
            position_z_1_s: 0.7,
            acceleration_up_down_m_s2: [
                ACCELERATION_UP_DOWN_M_S2[0].min(ACCELERATION_SHARE * spare_up),
                ACCELERATION_UP_DOWN_M_S2[1].min(ACCELERATION_SHARE * spare_down),
            ],
            throttle_hover_min_max: [
                lander.hover_throttle(),
                lander.thrust_min_n / lander.thrust_rated_n,
                lander.thrust_max_n / lander.thrust_rated_n,
            ],
        }
    }
}
