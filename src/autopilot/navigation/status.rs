//! What the filter reports of itself.

use crate::frame::Vec3;

/// Counters of refused measurements and resets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NavigationHealth {
    /// Measurements refused by a gate or because they were not finite.
    pub rejected: u64,
    /// Times the covariance was inflated because measurements contradicted the state.
    pub resets: u64,
}

/// How recently satellite navigation and the altimeter have aided the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AidingStatus {
    /// Satellite fixes refused, in part or whole, in succession.
    pub gnss_refused: u32,
    /// Time since the last fix that was used whole (s).
    pub gnss_silence_s: f64,
    /// Time since the last range that was used (s).
    pub altimeter_silence_s: f64,
}

/// Innovations relative to their expected variance: a consistent filter has a mean of one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InnovationTally {
    /// Scalars, refused ones included.
    pub count: u64,
    /// Sum of the squares, each over its variance; a refused scalar counts as its gate.
    pub normalised_squares: f64,
}

/// Biases of the sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorBiases {
    /// Gyroscope (rad/s).
    pub gyro_rad_s: Vec3,
    /// Accelerometer (m/s²).
    pub accel_m_s2: Vec3,
    /// Barometer offset (m).
    pub baro_m: f64,
}
