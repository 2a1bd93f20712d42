//! The vehicle as a rigid body: what control knows of its mass and its motion.

use crate::frame::Vec3;
use nalgebra::UnitQuaternion;

/// Mass properties at one mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass in body FRD, from the pivot (m).
    pub com_body_m: Vec3,
    /// Principal moments about the centre of mass, FRD x, y, z (kg m²).
    pub inertia_kg_m2: [f64; 3],
}

/// Estimated motion of the vehicle, and its thrust.
#[derive(Clone, Copy, Debug)]
pub struct MotionEstimate {
    /// Position of the centre of mass (m).
    pub position_ned_m: Vec3,
    /// Velocity of the centre of mass (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Attitude.
    pub q_ned_from_body: UnitQuaternion<f64>,
    /// Body rate, bias removed (rad/s).
    pub rate_body_rad_s: Vec3,
    /// Thrust (N).
    pub thrust_n: f64,
}
