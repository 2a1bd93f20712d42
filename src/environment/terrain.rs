//! The ground: a level plane through the origin of NED, which lies on the pad's surface.

use crate::frame::Vec3;

/// Flat ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terrain;

impl Terrain {
    /// Height of a point above the ground straight below it (m); negative inside the ground.
    pub fn height_m(&self, position_ned_m: &Vec3) -> f64 {
        -position_ned_m.z
    }

    /// Distance from a point to the ground along a direction (m); `None` when it points level or up.
    pub(crate) fn slant_range_m(&self, position_ned_m: &Vec3, direction_ned: &Vec3) -> Option<f64> {
        (direction_ned.z > 0.0).then(|| self.height_m(position_ned_m) / direction_ned.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beam_tilted_by_sixty_degrees_is_twice_the_height_and_a_level_one_never_lands() {
        let at = Vec3::new(3.0, 4.0, -10.0);
        let tilted = Vec3::new(0.75_f64.sqrt(), 0.0, 0.5);
        assert_eq!(Terrain.slant_range_m(&at, &tilted), Some(20.0));
        assert_eq!(Terrain.slant_range_m(&at, &Vec3::x()), None);
        assert_eq!(Terrain.slant_range_m(&at, &-Vec3::z()), None);
    }
}
