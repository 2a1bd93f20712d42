//! Alignment at rest: averages of all sensors while the vehicle stands still.
//!
//! The accelerometer gives the level (its bias passes for tilt, which the filter accounts for), the gyroscope
//! its own bias, the magnetometer the heading, satellite navigation the local origin, barometer and altimeter
//! their offsets at a known height. Any motion restarts the averages.

use crate::environment::geodesy::Geodetic;
use crate::frame::Vec3;
use crate::signal::Measurement;

/// Rate above which the vehicle is not at rest (rad/s).
const STILL_RATE_RAD_S: f64 = 0.05;
/// Difference of specific force from gravity above which the vehicle is not at rest (m/s²).
const STILL_FORCE_M_S2: f64 = 0.8;

/// Running averages.
#[derive(Clone, Debug, Default)]
pub struct Alignment {
    /// Time averaged over (s).
    pub duration_s: f64,
    specific_force: Mean,
    rate: Mean,
    field: Mean,
    fix: Mean,
    /// Latitude (rad), longitude (rad), altitude (m) of the first fix; `fix` is the mean relative to it.
    first_fix: Option<Vec3>,
    baro: Mean,
    range: Mean,
}

/// Averages of an alignment; absent where a sensor was silent.
#[derive(Clone, Debug)]
pub struct AlignmentResult {
    /// Mean specific force (m/s²).
    pub specific_force_body_m_s2: Vec3,
    /// Mean rate (rad/s).
    pub rate_body_rad_s: Vec3,
    /// Mean magnetic field (T).
    pub field_body_t: Option<Vec3>,
    /// Mean satellite position.
    pub fix: Option<Geodetic>,
    /// Number of fixes in the mean.
    pub fixes: f64,
    /// Mean pressure altitude (m).
    pub pressure_altitude_m: Option<f64>,
    /// Mean altimeter range (m).
    pub range_m: Option<f64>,
}

impl Alignment {
    /// Adds one measurement.
    pub fn add(&mut self, m: &Measurement, gravity_m_s2: f64) {
        if let Some(imu) = &m.imu {
            let moving = imu.rate_body_rad_s.norm() > STILL_RATE_RAD_S
                || (imu.specific_force_body_m_s2.norm() - gravity_m_s2).abs() > STILL_FORCE_M_S2;
            if moving {
                *self = Self::default();
                return;
            }
            self.duration_s += imu.interval_s.clamp(0.0, 0.1);
            self.specific_force.add(imu.specific_force_body_m_s2);
            self.rate.add(imu.rate_body_rad_s);
        }
        if let Some(field) = m.magnetic_field_body_t {
            self.field.add(field);
        }
        if let Some(fix) = &m.gnss {
            let point = Vec3::new(fix.latitude_rad, fix.longitude_rad, fix.altitude_m);
            // Averaged about the first fix: microradians lose nothing in the sum.
            let first = *self.first_fix.get_or_insert(point);
            self.fix.add(point - first);
        }
        if let Some(baro) = &m.barometer {
            self.baro.add(Vec3::new(baro.pressure_altitude_m, 0.0, 0.0));
        }
        if let Some(range) = m.altimeter.as_ref().and_then(|a| a.range_m) {
            self.range.add(Vec3::new(range, 0.0, 0.0));
        }
    }

    /// The averages so far; `None` before the first inertial sample.
    pub fn result(&self) -> Option<AlignmentResult> {
        Some(AlignmentResult {
            specific_force_body_m_s2: self.specific_force.value()?,
            rate_body_rad_s: self.rate.value()?,
            field_body_t: self.field.value(),
            fix: self.fix.value().zip(self.first_fix).map(|(mean, first)| {
                let fix = first + mean;
                Geodetic { latitude_rad: fix.x, longitude_rad: fix.y, altitude_m: fix.z }
            }),
            fixes: self.fix.count,
            pressure_altitude_m: self.baro.value().map(|v| v.x),
            range_m: self.range.value().map(|v| v.x),
        })
    }
}

#[derive(Clone, Debug, Default)]
struct Mean {
    sum: Vec3,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: Vec3) {
        if value.iter().all(|x| x.is_finite()) {
            self.sum += value;
            self.count += 1.0;
        }
    }

    fn value(&self) -> Option<Vec3> {
        (self.count > 0.0).then(|| self.sum / self.count)
    }
}
