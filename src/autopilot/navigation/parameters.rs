//! Parameters of the filter: sensors, their noise, and the site.

use crate::frame::Vec3;

/// One figure for both horizontal axes, one for the vertical.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HorizontalVertical {
    /// North and east, each.
    pub horizontal: f64,
    /// Down.
    pub vertical: f64,
}

impl HorizontalVertical {
    /// The figure of a NED axis.
    pub(super) const fn axis(&self, axis: usize) -> f64 {
        if axis == 2 { self.vertical } else { self.horizontal }
    }
}

/// Errors of the accelerometer, per axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AccelerometerNoise {
    /// White noise of one sample (m/s²).
    pub noise_std_m_s2: f64,
    /// Bias (m/s²).
    pub bias_std_m_s2: f64,
    /// Random walk of the bias (m/s² per √s).
    pub random_walk_m_s2_sqrt_s: f64,
}

/// Errors of the gyroscope, per axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GyroscopeNoise {
    /// White noise of one sample (rad/s).
    pub noise_std_rad_s: f64,
    /// Bias before the alignment (rad/s).
    pub bias_std_rad_s: f64,
    /// Random walk of the bias (rad/s per √s).
    pub random_walk_rad_s_sqrt_s: f64,
}

/// Errors of the barometer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BarometerNoise {
    /// White noise of one sample (m).
    pub noise_std_m: f64,
    /// Random walk of the offset (m per √s).
    pub random_walk_m_sqrt_s: f64,
}

/// Errors of the altimeter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AltimeterNoise {
    /// Noise of one sample (m).
    pub noise_std_m: f64,
    /// More noise as a fraction of the range.
    pub noise_fraction: f64,
}

/// Errors of the magnetometer, per axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MagnetometerNoise {
    /// White noise of one sample (T).
    pub noise_std_t: f64,
    /// Hard iron left after calibration (T).
    pub hard_iron_std_t: f64,
}

/// Satellite receiver as the flight computer knows it.
#[derive(Clone, Debug, PartialEq)]
pub struct GnssParameters {
    /// From the instant of the fix to its delivery (s).
    pub delay_s: f64,
    /// Antenna, body FRD from the pivot (m).
    pub antenna_body_m: Vec3,
    /// White noise of position (m).
    pub position_std_m: HorizontalVertical,
    /// Slow drift of position (m).
    pub drift_std_m: HorizontalVertical,
    /// Correlation time of the drift (s).
    pub drift_time_s: f64,
    /// White noise of velocity (m/s).
    pub velocity_std_m_s: HorizontalVertical,
}

/// Parameters of the filter.
#[derive(Clone, Debug, PartialEq)]
pub struct NavigationParameters {
    /// Inertial unit, body FRD from the pivot (m).
    pub imu_body_m: Vec3,
    /// Accelerometer errors.
    pub accelerometer: AccelerometerNoise,
    /// Gyroscope errors.
    pub gyroscope: GyroscopeNoise,
    /// Satellite navigation.
    pub gnss: GnssParameters,
    /// Barometer errors.
    pub barometer: BarometerNoise,
    /// Delay of the barometer (s).
    pub barometer_delay_s: f64,
    /// Altimeter errors.
    pub altimeter: AltimeterNoise,
    /// Altimeter, body FRD from the pivot (m); it looks along +z.
    pub altimeter_body_m: Vec3,
    /// Delay of the altimeter (s).
    pub altimeter_delay_s: f64,
    /// Magnetic field at the site from a field model, NED (T). `None`: the heading on the pad is
    /// `rest_heading_rad`.
    pub magnetic_field_ned_t: Option<Vec3>,
    /// Magnetometer errors.
    pub magnetometer: MagnetometerNoise,
    /// Heading on the pad where no field is known (rad).
    pub rest_heading_rad: f64,
    /// Pivot at rest, from the local origin on the pad surface (m).
    pub rest_ned_m: Vec3,
    /// Gravity at the site (m/s²).
    pub gravity_m_s2: f64,
}

impl NavigationParameters {
    /// Heading error by an error of the magnetic field across it (rad).
    pub(super) fn heading_std_rad(&self, field_std_t: f64) -> f64 {
        let field = self.magnetic_field_ned_t.unwrap_or(Vec3::new(2.0e-5, 0.0, 0.0));
        field_std_t / libm::hypot(field.x, field.y).max(1e-6)
    }
}
