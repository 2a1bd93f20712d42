//! The state of the filter: the nominal state, and where the components of its error stand in vectors and
//! covariance.

use crate::frame::Vec3;
use nalgebra::{SMatrix, SVector, UnitQuaternion};

/// Number of error states.
pub(super) const STATES: usize = 20;
// First component of each error. Attitude is a small rotation about NED axes.
pub(super) const POSITION: usize = 0;
pub(super) const VELOCITY: usize = 3;
pub(super) const ATTITUDE: usize = 6;
pub(super) const GYRO_BIAS: usize = 9;
pub(super) const ACCEL_BIAS: usize = 12;
pub(super) const BARO_OFFSET: usize = 15;
pub(super) const GNSS_DRIFT: usize = 16;
pub(super) const HEADING_BIAS: usize = 19;

/// Covariance of the error.
pub(super) type Covariance = SMatrix<f64, STATES, STATES>;
/// An error, or the sensitivity of a scalar to it.
pub(super) type ErrorVector = SVector<f64, STATES>;

/// Nominal state. Position and velocity are those of the inertial unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct NominalState {
    pub(super) position_ned_m: Vec3,
    pub(super) velocity_ned_m_s: Vec3,
    pub(super) q_ned_from_body: UnitQuaternion<f64>,
    pub(super) gyro_bias_rad_s: Vec3,
    pub(super) accel_bias_m_s2: Vec3,
    pub(super) baro_offset_m: f64,
    pub(super) gnss_drift_ned_m: Vec3,
    pub(super) heading_bias_rad: f64,
}

impl NominalState {
    /// Upright and at rest, biases zero.
    pub(super) fn at_rest(position_ned_m: Vec3) -> Self {
        Self {
            position_ned_m,
            velocity_ned_m_s: Vec3::zeros(),
            q_ned_from_body: UnitQuaternion::identity(),
            gyro_bias_rad_s: Vec3::zeros(),
            accel_bias_m_s2: Vec3::zeros(),
            baro_offset_m: 0.0,
            gnss_drift_ned_m: Vec3::zeros(),
            heading_bias_rad: 0.0,
        }
    }

    /// Adds an error.
    pub(super) fn add(&mut self, error: &ErrorVector) {
        self.position_ned_m += block(error, POSITION);
        self.velocity_ned_m_s += block(error, VELOCITY);
        self.q_ned_from_body =
            UnitQuaternion::from_scaled_axis(block(error, ATTITUDE)) * self.q_ned_from_body;
        self.gyro_bias_rad_s += block(error, GYRO_BIAS);
        self.accel_bias_m_s2 += block(error, ACCEL_BIAS);
        self.baro_offset_m += error[BARO_OFFSET];
        self.gnss_drift_ned_m += block(error, GNSS_DRIFT);
        self.heading_bias_rad += error[HEADING_BIAS];
    }

    /// Every component is finite.
    pub(super) fn is_finite(&self) -> bool {
        let vectors = [
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.gyro_bias_rad_s,
            self.accel_bias_m_s2,
            self.gnss_drift_ned_m,
        ];
        vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
            && self.q_ned_from_body.coords.iter().all(|x| x.is_finite())
            && self.baro_offset_m.is_finite()
            && self.heading_bias_rad.is_finite()
    }
}

/// Three components of an error.
pub(super) fn block(error: &ErrorVector, first: usize) -> Vec3 {
    Vec3::new(error[first], error[first + 1], error[first + 2])
}
