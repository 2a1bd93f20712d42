//! Gains from what a unit of command does, by bandwidths that flew.
//!
//! A stock PX4 v1.16.1 flew a 70 kg lander (687 N at hover, 8 deg of gimbal 0.9 m below the centre of mass,
//! 25 kg m²: 3.4 rad/s² per unit) with a rate bandwidth, gain times effect, of 7 rad/s, and each outer loop
//! 2.4 to 2.9 times slower than the next. Another lander gets the same bandwidths: its rate gain is 7 rad/s
//! over its own effect. Servos too slow for 7 rad/s get less, and every lateral loop slows down with it.
//!
//! That plant's gimbal moved no mass. An engine that swings pushes the body the other way while it is turned:
//! the moment on the vehicle is T l δ + (J + S l) δ'', with its inertia J about the pivot and its first
//! moment S below it, so from sqrt(T l / (J + S l)) on, 12 rad/s for the reference vehicle, a gimbal works
//! backward and ever stronger. A loop with a differential part then oscillates at 20 Hz. [`Tuning::of`] looks
//! at the loop with this term, takes the gyro filter's cutoff down and the differential part out until it has
//! a gain margin of 2, and only then bandwidth. Vertical gains are accelerations, which PX4 turns into thrust
//! by the hover throttle: they hold for any mass. They flew with thrust lags of 0.15 and 0.35 s.

use std::f64::consts::TAU;

use nalgebra::Complex;
use serde::Serialize;

use super::lander::Lander;

/// Gains and limits, in PX4's units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tuning {
    /// What one unit of each torque servo does at hover, FRD x, y, z (rad/s²).
    pub unit_effect_rad_s2: [f64; 3],
    /// Bandwidth of the rate loops about x and y (rad/s).
    pub rate_bandwidth_rad_s: f64,
    /// Where the swinging engine cancels its own thrust (rad/s); `None`: nothing swings.
    pub swing_zero_rad_s: Option<f64>,
    /// Cutoff of the second-order gyro filter (Hz).
    pub gyro_cutoff_hz: f64,
    /// What the gain of the rate loops may still be multiplied by.
    pub gain_margin: f64,
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
/// Least factor on the gain of the rate loops at which they would oscillate: 6 dB.
const GAIN_MARGIN: f64 = 2.0;
/// Cutoffs of the gyro filter (Hz), PX4's own first: it costs the least phase.
const GYRO_CUTOFFS_HZ: [f64; 4] = [40.0, 20.0, 10.0, 5.0];
/// Phase that servo and filters may cost at the bandwidth (rad): of 90 deg of an integrating plant, 60 deg
/// remain.
const PHASE_COST_RAD: f64 = 0.52;
/// Delay of controller and link: one period of 4 ms, and half of one for which a command holds (s).
const CONTROLLER_DELAY_S: f64 = 0.006;
/// Cutoff of PX4's first-order filter of the angular acceleration (Hz).
pub const DIFFERENTIAL_CUTOFF_HZ: f64 = 30.0;
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
    /// Gains and limits for a vehicle at hover.
    pub fn of(lander: &Lander) -> Self {
        let effect = lander.unit_effect_rad_s2();
        let loop_shape = RateLoop::of(lander);
        let bandwidth = loop_shape.bandwidth_rad_s;
        let slower = bandwidth / RATE_BANDWIDTH_RAD_S;
        // The gimbal holds the thrust through a centre of mass beside the axis: offset y is trimmed about x.
        let trim = |offset_m: f64| libm::atan(offset_m.abs() / lander.lever_m) / lander.gimbal_limit_rad;
        let lateral = |axis: usize| {
            let p = bandwidth / effect[axis];
            RateGains {
                p,
                i: INTEGRAL_SHARE_1_S * slower * p,
                d: loop_shape.differential_s * p,
                integral_limit: (INTEGRAL_LIMIT + trim(lander.offset_m[1 - axis])).min(0.5),
            }
        };
        let yaw_p = YAW_BANDWIDTH_RAD_S / effect[2];
        let yaw =
            RateGains { p: yaw_p, i: YAW_INTEGRAL_SHARE_1_S * yaw_p, d: 0.0, integral_limit: INTEGRAL_LIMIT };
        let attitude = [ATTITUDE_1_S * slower, ATTITUDE_1_S * slower, YAW_1_S];
        // A rate that the attitude loop brakes by itself: gain times rate within the full command's effect.
        let rate_max = |axis: usize| RATE_MAX_DEG_S[axis].min((effect[axis] / attitude[axis]).to_degrees());
        let spare_up = lander.thrust_max_n / lander.mass_kg - lander.gravity_m_s2;
        let spare_down = lander.gravity_m_s2 - lander.thrust_min_n / lander.mass_kg;
        Self {
            unit_effect_rad_s2: effect,
            rate_bandwidth_rad_s: bandwidth,
            swing_zero_rad_s: (loop_shape.swing_s2 > 0.0).then(|| 1.0 / loop_shape.swing_s2.sqrt()),
            gyro_cutoff_hz: loop_shape.gyro_cutoff_hz,
            gain_margin: loop_shape.gain_margin(),
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

/// The open rate loop about a lateral axis: integrator, differential part, gimbal servo, swinging engine,
/// delay, gyro filter.
#[derive(Clone, Copy, Debug)]
struct RateLoop {
    bandwidth_rad_s: f64,
    differential_s: f64,
    gyro_cutoff_hz: f64,
    servo_rad_s: f64,
    servo_damping: f64,
    dead_time_s: f64,
    /// Inertia of the swinging engine against its thrust, (J + S l)/(T l) (s²).
    swing_s2: f64,
}

impl RateLoop {
    /// The fastest loop with the margins asked for: PX4's gyro filter and a differential part where they are
    /// allowed.
    fn of(lander: &Lander) -> Self {
        let swing = &lander.swinging;
        let base = Self {
            bandwidth_rad_s: RATE_BANDWIDTH_RAD_S,
            differential_s: DIFFERENTIAL_SHARE_S,
            gyro_cutoff_hz: GYRO_CUTOFFS_HZ[0],
            servo_rad_s: lander.gimbal_servo_rad_s,
            servo_damping: lander.gimbal_servo_damping,
            dead_time_s: lander.gimbal_dead_time_s + CONTROLLER_DELAY_S,
            swing_s2: (swing.inertia_kg_m2 + swing.moment_kg_m * lander.lever_m)
                / (lander.weight_n() * lander.lever_m),
        };
        let differentials = [DIFFERENTIAL_SHARE_S, 0.0];
        let candidates = differentials.into_iter().flat_map(|differential_s| {
            GYRO_CUTOFFS_HZ.map(|gyro_cutoff_hz| Self { differential_s, gyro_cutoff_hz, ..base })
        });
        if let Some(enough) = candidates.clone().find(Self::has_margins) {
            return enough;
        }
        // Otherwise the shape that keeps the most bandwidth.
        candidates
            .map(Self::with_less_bandwidth)
            .max_by(|a, b| a.bandwidth_rad_s.total_cmp(&b.bandwidth_rad_s))
            .unwrap_or(base)
    }

    /// The same loop with as much bandwidth as the margins allow.
    fn with_less_bandwidth(self) -> Self {
        let (mut low, mut high) = (0.0, self.bandwidth_rad_s);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            let holds = Self { bandwidth_rad_s: middle, ..self }.has_margins();
            (low, high) = if holds { (middle, high) } else { (low, middle) };
        }
        Self { bandwidth_rad_s: low, ..self }
    }

    fn has_margins(&self) -> bool {
        let w = self.bandwidth_rad_s;
        w > 0.0 && self.gain_margin() >= GAIN_MARGIN && self.lag_s() * w <= PHASE_COST_RAD
    }

    /// Delay at low frequency (s).
    fn lag_s(&self) -> f64 {
        self.dead_time_s
            + 2.0 * self.servo_damping / self.servo_rad_s
            + core::f64::consts::SQRT_2 / (TAU * self.gyro_cutoff_hz)
    }

    /// The loop at i w.
    fn at(&self, w: f64) -> Complex<f64> {
        let s = Complex::new(0.0, w);
        let second_order =
            |w0: f64, damping: f64| Complex::from(w0 * w0) / (s * s + s * (2.0 * damping * w0) + w0 * w0);
        let differential = s * self.differential_s / (s / (TAU * DIFFERENTIAL_CUTOFF_HZ) + 1.0);
        let delay = Complex::new(libm::cos(w * self.dead_time_s), -libm::sin(w * self.dead_time_s));
        (differential + 1.0) / s
            * self.bandwidth_rad_s
            * second_order(self.servo_rad_s, self.servo_damping)
            * (s * s * self.swing_s2 + 1.0)
            * second_order(TAU * self.gyro_cutoff_hz, core::f64::consts::FRAC_1_SQRT_2)
            * delay
    }

    /// One over the greatest gain where the loop is real and negative, over all frequencies that matter.
    fn gain_margin(&self) -> f64 {
        let mut greatest = 0.0_f64;
        let mut w = 0.5;
        let mut before = self.at(w);
        while w < 1000.0 {
            w *= 1.004;
            let now = self.at(w);
            if before.im * now.im < 0.0 && now.re < 0.0 {
                greatest = greatest.max(now.norm()).max(before.norm());
            }
            before = now;
        }
        if greatest > 0.0 { 1.0 / greatest } else { f64::INFINITY }
    }
}
