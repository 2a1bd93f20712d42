//! Motion of the vehicle: its changing mass, the liquid that swings in it, the forces that act on it.
//!
//! [`mass`] turns contents into mass, first moment and inertia and their rates, [`mass_report`] reads dry
//! parts from a CAD program; [`slosh`] gives the sloshing modes of the liquid; [`aerodynamics`] and
//! [`landing_gear`] give loads; [`rigid_body`] balances momentum and answers with accelerations.
//! Everything is in body FRD about the gimbal pivot O; parameters are in the structural frame, and scalar
//! heights of the vehicle file (`..._z_m`) are positive toward the nose, so `z_frd = -z`.

pub mod aerodynamics;
pub mod landing_gear;
pub mod mass;
pub mod mass_report;
pub mod rigid_body;
pub mod slosh;

use crate::frame::{Mat3, Vec3};
use std::ops::{Add, AddAssign};

/// A force and its moment about the gimbal pivot O, body FRD.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Force (N).
    pub force_body_n: Vec3,
    /// Moment about O (N m).
    pub moment_body_n_m: Vec3,
}

impl Load {
    /// Nothing acts.
    pub const NONE: Self =
        Self { force_body_n: Vec3::new(0.0, 0.0, 0.0), moment_body_n_m: Vec3::new(0.0, 0.0, 0.0) };

    /// A force that acts at a point of the body.
    pub fn at(position_body_m: Vec3, force_body_n: Vec3) -> Self {
        Self { force_body_n, moment_body_n_m: position_body_m.cross(&force_body_n) }
    }
}

impl Add for Load {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            force_body_n: self.force_body_n + other.force_body_n,
            moment_body_n_m: self.moment_body_n_m + other.moment_body_n_m,
        }
    }
}

impl AddAssign for Load {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Where the vehicle is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// Position of the gimbal pivot (m).
    pub position_ned_m: Vec3,
    /// Its velocity (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Body axes to NED.
    pub ned_from_body: Mat3,
    /// Body rate (rad/s).
    pub rate_body_rad_s: Vec3,
}

impl Kinematics {
    /// Place of a body point in NED (m).
    pub fn point_ned_m(&self, position_body_m: Vec3) -> Vec3 {
        self.position_ned_m + self.ned_from_body * position_body_m
    }

    /// Velocity of a body point in NED (m/s).
    pub(crate) fn point_velocity_ned_m_s(&self, position_body_m: Vec3) -> Vec3 {
        self.velocity_ned_m_s + self.ned_from_body * self.rate_body_rad_s.cross(&position_body_m)
    }
}
