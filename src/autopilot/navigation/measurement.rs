//! Measurement models of the filter: the innovation of each sensor, its sensitivity to the error, and its
//! noise.
//!
//! A measurement is one or more [`Scalar`]s, all of the state before it; the filter fuses them one after the
//! other.

use super::history::PastMotion;
use super::parameters::NavigationParameters;
use super::state::{
    ATTITUDE, BARO_OFFSET, ErrorVector, GNSS_DRIFT, GYRO_BIAS, HEADING_BIAS, NominalState, POSITION, VELOCITY,
};
use crate::environment::geodesy::{Datum, Geodetic};
use crate::frame::{Vec3, skew};
use crate::signal::{AltimeterSample, BarometerSample, GnssFix};
use nalgebra::UnitQuaternion;

/// Where an innovation comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Position of a satellite fix.
    GnssPosition,
    /// Velocity of a satellite fix.
    GnssVelocity,
    /// Pressure altitude.
    Barometer,
    /// Heading from the magnetic field.
    Magnetometer,
    /// Range to the ground.
    Altimeter,
    /// Standstill on the ground.
    Rest,
}

impl Source {
    /// How many there are.
    pub(crate) const COUNT: usize = 6;
}

/// One scalar measurement: `innovation = sensitivity · error + noise`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scalar {
    pub(super) source: Source,
    pub(super) sensitivity: ErrorVector,
    pub(super) innovation: f64,
    /// Of the noise.
    pub(super) variance: f64,
    /// Gate in standard deviations: beyond, the scalar is refused.
    pub(super) gate: f64,
}

/// Velocity is zero.
pub(super) fn zero_velocity(state: &NominalState) -> [Scalar; 3] {
    core::array::from_fn(|i| {
        let mut sensitivity = ErrorVector::zeros();
        sensitivity[VELOCITY + i] = 1.0;
        let innovation = -state.velocity_ned_m_s[i];
        Scalar { source: Source::Rest, sensitivity, innovation, variance: square(0.03), gate: 10.0 }
    })
}

/// The pivot is where it was aligned; the inertial unit above it moves with the tilt.
pub(super) fn pad_position(p: &NavigationParameters, state: &NominalState) -> [Scalar; 3] {
    let arm_ned = state.q_ned_from_body * p.imu_body_m;
    let expected = p.rest_ned_m + arm_ned;
    let arm = skew(arm_ned);
    core::array::from_fn(|i| {
        let mut sensitivity = ErrorVector::zeros();
        sensitivity[POSITION + i] = 1.0;
        for j in 0..3 {
            sensitivity[ATTITUDE + j] = arm[(i, j)];
        }
        let innovation = expected[i] - state.position_ned_m[i];
        Scalar { source: Source::Rest, sensitivity, innovation, variance: square(0.005), gate: 10.0 }
    })
}

/// Position and velocity of the antenna, axis by axis.
pub(super) fn gnss(
    parameters: &NavigationParameters,
    state: &NominalState,
    past: &PastMotion,
    specific_force_body_m_s2: Vec3,
    datum: &Datum,
    fix: &GnssFix,
) -> [Scalar; 6] {
    let p = &parameters.gnss;
    let lever = p.antenna_body_m - parameters.imu_body_m;
    let arm_ned = past.q_ned_from_body * lever;
    let swing_ned = past.q_ned_from_body * past.rate_body_rad_s.cross(&lever);
    let position = past.position_ned_m + arm_ned + state.gnss_drift_ned_m;
    let velocity = past.velocity_ned_m_s + swing_ned;
    let measured = datum.position_ned_m(&Geodetic {
        latitude_rad: fix.latitude_rad,
        longitude_rad: fix.longitude_rad,
        altitude_m: fix.altitude_m,
    });
    let f_ned = state.q_ned_from_body * specific_force_body_m_s2;
    // A tilt error turns the lever arm, and has misdirected the specific force since the fix was taken; the
    // gyroscope's bias adds a velocity of the antenna.
    let (arm, late) = (-skew(arm_ned), skew(f_ned) * p.delay_s - skew(swing_ned));
    let swing = state.q_ned_from_body.to_rotation_matrix().matrix() * skew(lever);
    core::array::from_fn(|k| {
        let i = k / 2;
        let mut sensitivity = ErrorVector::zeros();
        if k % 2 == 0 {
            sensitivity[POSITION + i] = 1.0;
            sensitivity[VELOCITY + i] = -p.delay_s;
            sensitivity[GNSS_DRIFT + i] = 1.0;
            for j in 0..3 {
                sensitivity[ATTITUDE + j] = arm[(i, j)];
            }
            let variance = square(p.position_std_m.axis(i)) + 2.5e-5;
            let innovation = measured[i] - position[i];
            return Scalar { source: Source::GnssPosition, sensitivity, innovation, variance, gate: 5.0 };
        }
        sensitivity[VELOCITY + i] = 1.0;
        for j in 0..3 {
            sensitivity[ATTITUDE + j] = late[(i, j)];
            sensitivity[GYRO_BIAS + j] = swing[(i, j)];
        }
        let variance = square(p.velocity_std_m_s.axis(i)) + 1e-4;
        let innovation = fix.velocity_ned_m_s[i] - velocity[i];
        Scalar { source: Source::GnssVelocity, sensitivity, innovation, variance, gate: 5.0 }
    })
}

/// Pressure altitude.
pub(super) fn barometer(
    p: &NavigationParameters,
    state: &NominalState,
    past: &PastMotion,
    sample: &BarometerSample,
) -> Scalar {
    let expected = -past.position_ned_m.z + state.baro_offset_m;
    let mut sensitivity = ErrorVector::zeros();
    sensitivity[POSITION + 2] = -1.0;
    sensitivity[VELOCITY + 2] = p.barometer_delay_s;
    sensitivity[BARO_OFFSET] = 1.0;
    Scalar {
        source: Source::Barometer,
        sensitivity,
        innovation: sample.pressure_altitude_m - expected,
        variance: square(1.3 * p.barometer.noise_std_m),
        gate: 5.0,
    }
}

/// Heading only. A tilt error turns the horizontal part of the dipping field too, but then hard iron that
/// turns with the body would pass for tilt: the heading bias, prior and random walk, carries both.
pub(super) fn magnetometer(
    p: &NavigationParameters,
    state: &NominalState,
    field_body_t: &Vec3,
) -> Option<Scalar> {
    let reference = p.magnetic_field_ned_t?;
    let m = state.q_ned_from_body * field_body_t;
    if m.x * m.x + m.y * m.y < 1e-12 {
        return None;
    }
    let angle = libm::atan2(reference.y * m.x - reference.x * m.y, reference.x * m.x + reference.y * m.y);
    let mut sensitivity = ErrorVector::zeros();
    sensitivity[ATTITUDE + 2] = 1.0;
    sensitivity[HEADING_BIAS] = 1.0;
    Some(Scalar {
        source: Source::Magnetometer,
        sensitivity,
        innovation: angle - state.heading_bias_rad,
        variance: square(1.3 * p.heading_std_rad(p.magnetometer.noise_std_t)),
        gate: 5.0,
    })
}

/// Range that the altimeter should measure over flat ground (m).
pub(super) fn expected_range_m(
    p: &NavigationParameters,
    imu_ned_m: Vec3,
    q_ned_from_body: &UnitQuaternion<f64>,
) -> f64 {
    let lever = p.altimeter_body_m - p.imu_body_m;
    let height = -(imu_ned_m + q_ned_from_body * lever).z;
    let cosine = (q_ned_from_body * Vec3::z()).z;
    height / cosine.max(0.5)
}

/// Range to the ground, inside the altimeter's limits and at a small tilt. The sensitivity to tilt is left
/// out on purpose: a millimetre of offset or slope would be taken for milliradians of tilt, and its real
/// effect is within the centimetre added to the noise.
pub(super) fn altimeter(
    p: &NavigationParameters,
    past: &PastMotion,
    offset_m: f64,
    sample: &AltimeterSample,
) -> Option<Scalar> {
    let range_m = sample.range_m?;
    if range_m < sample.minimum_m || range_m > sample.maximum_m {
        return None;
    }
    let cosine = (past.q_ned_from_body * Vec3::z()).z;
    if cosine < 0.85 {
        return None;
    }
    let expected = expected_range_m(p, past.position_ned_m, &past.q_ned_from_body) + offset_m;
    let mut sensitivity = ErrorVector::zeros();
    sensitivity[POSITION + 2] = -1.0 / cosine;
    sensitivity[VELOCITY + 2] = p.altimeter_delay_s / cosine;
    Some(Scalar {
        source: Source::Altimeter,
        sensitivity,
        innovation: range_m - expected,
        variance: square(p.altimeter.noise_std_m) + square(p.altimeter.noise_fraction * range_m) + 1e-4,
        gate: 6.0,
    })
}

fn square(x: f64) -> f64 {
    x * x
}
