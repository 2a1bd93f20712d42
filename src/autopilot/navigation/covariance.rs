//! Covariance of the error: its initial value after the alignment, and its prediction.

use super::parameters::NavigationParameters;
use super::state::{
    ACCEL_BIAS, ATTITUDE, BARO_OFFSET, Covariance, GNSS_DRIFT, GYRO_BIAS, HEADING_BIAS, POSITION, STATES,
    VELOCITY,
};
use crate::frame::{Mat3, Vec3, skew};
use nalgebra::UnitQuaternion;

/// Random walk of the magnetometer's heading error as the body tilts (rad per √s).
pub(super) const HEADING_WALK_RAD_SQRT_S: f64 = 1e-3;

/// After an alignment that averaged over so many satellite fixes.
pub(super) fn initial(
    p: &NavigationParameters,
    q_ned_from_body: UnitQuaternion<f64>,
    fixes: f64,
) -> Covariance {
    let mut c = Covariance::zeros();
    let mut set = |first: usize, count: usize, std: f64| {
        for i in first..first + count {
            c[(i, i)] = std * std;
        }
    };
    let gnss = &p.gnss;
    let accel_bias = p.accelerometer.bias_std_m_s2;
    set(POSITION, 3, 0.005);
    set(VELOCITY, 3, 0.02);
    set(GYRO_BIAS, 3, 0.2 * p.gyroscope.bias_std_rad_s);
    set(ACCEL_BIAS, 3, accel_bias);
    set(BARO_OFFSET, 1, 0.1);
    let drift = |position_std: f64, drift_std: f64| position_std / fixes.sqrt() + 0.1 * drift_std;
    set(GNSS_DRIFT, 2, drift(gnss.position_std_m.horizontal, gnss.drift_std_m.horizontal));
    set(GNSS_DRIFT + 2, 1, drift(gnss.position_std_m.vertical, gnss.drift_std_m.vertical));
    let dip = p.magnetic_field_ned_t.map_or(0.0, |b| b.z / libm::hypot(b.x, b.y).max(1e-6));
    let levelling = dip * accel_bias / p.gravity_m_s2;
    let heading_bias = libm::hypot(p.heading_std_rad(p.magnetometer.hard_iron_std_t), levelling);
    set(HEADING_BIAS, 1, heading_bias.max(1e-4));
    set(ATTITUDE, 3, 2e-3);
    c[(ATTITUDE + 2, ATTITUDE + 2)] = heading_bias * heading_bias + 1e-4;
    c[(ATTITUDE + 2, HEADING_BIAS)] = -heading_bias * heading_bias;
    c[(HEADING_BIAS, ATTITUDE + 2)] = -heading_bias * heading_bias;
    // Levelling mistakes bias for tilt: with specific force (0, 0, -g) in NED, θx = by/g and θy = -bx/g.
    let r = *q_ned_from_body.to_rotation_matrix().matrix();
    let g = p.gravity_m_s2;
    let mut tilt_from_bias = Mat3::zeros();
    for j in 0..3 {
        tilt_from_bias[(0, j)] = r[(1, j)] / g;
        tilt_from_bias[(1, j)] = -r[(0, j)] / g;
    }
    let bias = Mat3::identity() * (accel_bias * accel_bias);
    let cross = tilt_from_bias * bias;
    let tilt = cross * tilt_from_bias.transpose();
    for i in 0..3 {
        for j in 0..3 {
            c[(ATTITUDE + i, ATTITUDE + j)] += tilt[(i, j)];
            c[(ATTITUDE + i, ACCEL_BIAS + j)] = cross[(i, j)];
            c[(ACCEL_BIAS + j, ATTITUDE + i)] = cross[(i, j)];
        }
    }
    // The pivot does not move with a tilt error, but the inertial unit above it does, and so does the
    // antenna. The mean fix of the antenna defined the origin: the drift takes up the difference.
    add_tilt_displacement(&mut c, POSITION, -skew(q_ned_from_body * p.imu_body_m));
    add_tilt_displacement(&mut c, GNSS_DRIFT, skew(q_ned_from_body * gnss.antenna_body_m));
    c
}

/// Adds `from_tilt · θ` to the three error states at `first` of a covariance: both sides of `T C Tᵀ`.
fn add_tilt_displacement(c: &mut Covariance, first: usize, from_tilt: Mat3) {
    for j in 0..STATES {
        let moved = from_tilt * Vec3::new(c[(ATTITUDE, j)], c[(ATTITUDE + 1, j)], c[(ATTITUDE + 2, j)]);
        for i in 0..3 {
            c[(first + i, j)] += moved[i];
        }
    }
    for j in 0..STATES {
        let moved = from_tilt * Vec3::new(c[(j, ATTITUDE)], c[(j, ATTITUDE + 1)], c[(j, ATTITUDE + 2)]);
        for i in 0..3 {
            c[(j, first + i)] += moved[i];
        }
    }
}

/// Predicts over one inertial sample: its specific force in NED axes, and the rotation at the middle of its
/// interval.
pub(super) fn predict(
    c: &mut Covariance,
    p: &NavigationParameters,
    ned_from_body: &Mat3,
    specific_force_ned_m_s2: Vec3,
    dt_s: f64,
) {
    let r = *ned_from_body;
    let velocity_from_tilt = -skew(specific_force_ned_m_s2) * dt_s;
    // Transition of the error, with the half steps of the state. First F P, row blocks from the top, so that
    // every block still reads old rows below it; then (F P) Fᵀ.
    for j in 0..STATES {
        let mut column = c.column_mut(j);
        let (th, bg, ba) = (
            Vec3::new(column[ATTITUDE], column[ATTITUDE + 1], column[ATTITUDE + 2]),
            Vec3::new(column[GYRO_BIAS], column[GYRO_BIAS + 1], column[GYRO_BIAS + 2]),
            Vec3::new(column[ACCEL_BIAS], column[ACCEL_BIAS + 1], column[ACCEL_BIAS + 2]),
        );
        let dth = -(r * bg) * dt_s;
        let dv = velocity_from_tilt * (th + dth * 0.5) - r * ba * dt_s;
        for i in 0..3 {
            column[POSITION + i] += dt_s * (column[VELOCITY + i] + 0.5 * dv[i]);
            column[VELOCITY + i] += dv[i];
            column[ATTITUDE + i] += dth[i];
        }
    }
    for j in 0..STATES {
        let mut row = c.row_mut(j);
        let (th, bg, ba) = (
            Vec3::new(row[ATTITUDE], row[ATTITUDE + 1], row[ATTITUDE + 2]),
            Vec3::new(row[GYRO_BIAS], row[GYRO_BIAS + 1], row[GYRO_BIAS + 2]),
            Vec3::new(row[ACCEL_BIAS], row[ACCEL_BIAS + 1], row[ACCEL_BIAS + 2]),
        );
        let dth = -(r * bg) * dt_s;
        let dv = velocity_from_tilt * (th + dth * 0.5) - r * ba * dt_s;
        for i in 0..3 {
            row[POSITION + i] += dt_s * (row[VELOCITY + i] + 0.5 * dv[i]);
            row[VELOCITY + i] += dv[i];
            row[ATTITUDE + i] += dth[i];
        }
    }
    // Rounding must not make the halves differ.
    for j in 0..STATES {
        for i in j + 1..STATES {
            c[(j, i)] = c[(i, j)];
        }
    }
    // White noise of a sample, half as much again for vibration and integration; random walks of the slow
    // states.
    let velocity = 1.5 * p.accelerometer.noise_std_m_s2 * dt_s;
    let angle = 1.5 * p.gyroscope.noise_std_rad_s * dt_s;
    let (gyro_walk, accel_walk) =
        (p.gyroscope.random_walk_rad_s_sqrt_s, p.accelerometer.random_walk_m_s2_sqrt_s);
    let drift = |std: f64| 2.0 * std * std / p.gnss.drift_time_s.max(1.0) * dt_s;
    for i in 0..3 {
        c[(VELOCITY + i, VELOCITY + i)] += velocity * velocity;
        c[(ATTITUDE + i, ATTITUDE + i)] += angle * angle;
        c[(GYRO_BIAS + i, GYRO_BIAS + i)] += gyro_walk * gyro_walk * dt_s;
        c[(ACCEL_BIAS + i, ACCEL_BIAS + i)] += accel_walk * accel_walk * dt_s;
        c[(GNSS_DRIFT + i, GNSS_DRIFT + i)] += drift(p.gnss.drift_std_m.axis(i));
    }
    c[(HEADING_BIAS, HEADING_BIAS)] += HEADING_WALK_RAD_SQRT_S * HEADING_WALK_RAD_SQRT_S * dt_s;
    let baro_walk = p.barometer.random_walk_m_sqrt_s;
    c[(BARO_OFFSET, BARO_OFFSET)] += baro_walk * baro_walk * dt_s;
}
