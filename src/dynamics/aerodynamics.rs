//! Drag of a blunt body at hopping speeds: one drag area per body axis, acting at a centre of pressure.
//!
//! `F_i = -1/2 rho |v| (C_d A)_i v_i` with v the air-relative velocity of the centre of pressure, which
//! includes its motion by rotation: so drag also damps rotation. No lift, no ground effect; valid well
//! below Mach 0.3.

use super::Load;
use crate::frame::Vec3;

/// Drag areas, the `[aero]` table of a vehicle file.
#[derive(Clone, Debug, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Aerodynamics {
    /// Drag coefficient times area along the long axis (m²).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub drag_area_axial_m2: f64,
    /// Drag coefficient times area across the long axis, the same for x and y (m²).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub drag_area_lateral_m2: f64,
    /// Height of the centre of pressure above the gimbal pivot (m).
    #[schemars(range(min = -20.0, max = 20.0))]
    pub centre_of_pressure_z_m: f64,
}

impl Aerodynamics {
    /// Centre of pressure in body FRD (m).
    pub(crate) fn centre_of_pressure_body_m(&self) -> Vec3 {
        Vec3::new(0.0, 0.0, -self.centre_of_pressure_z_m)
    }

    /// Drag, given the air density (kg/m³) and the motion of the pivot relative to the air, body FRD.
    pub fn drag(&self, density_kg_m3: f64, airspeed_body_m_s: Vec3, rate_body_rad_s: Vec3) -> Load {
        let centre = self.centre_of_pressure_body_m();
        let v = airspeed_body_m_s + rate_body_rad_s.cross(&centre);
        let areas = Vec3::new(self.drag_area_lateral_m2, self.drag_area_lateral_m2, self.drag_area_axial_m2);
        Load::at(centre, v.component_mul(&areas) * (-0.5 * density_kg_m3 * v.norm()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REFERENCE: Aerodynamics =
        Aerodynamics { drag_area_axial_m2: 0.10, drag_area_lateral_m2: 0.45, centre_of_pressure_z_m: 0.62 };

    #[test]
    fn axial_drag_opposes_climb_and_gives_no_moment() {
        let load = REFERENCE.drag(1.225, Vec3::new(0.0, 0.0, -6.0), Vec3::zeros());
        assert!((load.force_body_n.z - 0.5 * 1.225 * 36.0 * 0.10).abs() < 1e-12);
        assert_eq!(load.moment_body_n_m, Vec3::zeros());
    }

    #[test]
    fn wind_from_the_front_pitches_the_nose_back() {
        // Air-relative velocity forward: force aft at a point above O, so a moment about +y (nose up
        // and back): (0, 0, -h) x (-F, 0, 0) = (0, h F, 0).
        let load = REFERENCE.drag(1.225, Vec3::new(10.0, 0.0, 0.0), Vec3::zeros());
        let force = 0.5 * 1.225 * 100.0 * 0.45;
        assert!((load.force_body_n.x + force).abs() < 1e-12);
        assert!((load.moment_body_n_m.y - 0.62 * force).abs() < 1e-12);
    }

    #[test]
    fn drag_takes_power_out_of_any_motion() {
        let cases = [
            (Vec3::new(3.0, -2.0, 5.0), Vec3::new(0.4, -0.7, 0.2)),
            (Vec3::zeros(), Vec3::new(0.0, 1.0, 0.0)),
            (Vec3::new(-1.0, 0.0, 0.1), Vec3::new(-2.0, 3.0, 0.0)),
        ];
        for (v, w) in cases {
            let load = REFERENCE.drag(1.225, v, w);
            assert!(load.force_body_n.dot(&v) + load.moment_body_n_m.dot(&w) < 0.0);
        }
        assert_eq!(REFERENCE.drag(1.225, Vec3::zeros(), Vec3::zeros()), Load::NONE);
    }
}
