//! Gravity: constant and straight down. Over 100 m of height the real one changes by 3e-5 of itself.

use crate::frame::Vec3;

/// Uniform gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gravity {
    /// Magnitude (m/s²).
    pub magnitude_m_s2: f64,
}

impl Gravity {
    /// Acceleration of free fall in NED (m/s²).
    pub fn acceleration_ned_m_s2(&self) -> Vec3 {
        Vec3::new(0.0, 0.0, self.magnitude_m_s2)
    }
}
