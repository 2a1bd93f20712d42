//! The ground: a level plane through the origin of NED, which lies on the pad's surface.

use crate::frame::Vec3;

/// Flat ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terrain;

impl Terrain {
    /// Height of a point above the ground straight below it [m]; negative inside the ground.
    pub fn height_m(&self, position_ned_m: &Vec3) -> f64 {
        -position_ned_m.z
    }

    /// Distance from a point to the ground along a direction [m]; `None` when it points level or up.
    pub fn slant_range_m(&self, position_ned_m: &Vec3, direction_ned: &Vec3) -> Option<f64> {
        (direction_ned.z > 0.0).then(|| self.height_m(position_ned_m) / direction_ned.z)
    }
}
