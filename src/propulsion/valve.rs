//! The oxidiser valve: open area against angle.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::injector::SinglePhase;
use crate::input::Invalid;
use crate::interpolate::{
    Monotone,
    table::{Table, TableError},
};

/// Ball valve with a V-port, and its servo: the `[feed.valve]` table. The area and the discharge
/// coefficient are used here, the servo's numbers by the actuator.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Valve {
    /// Table of open area against angle, columns `theta_deg`, `area_analytic_mm2`; beside the vehicle file.
    pub area_file: String,
    /// Discharge coefficient, of the open area.
    #[schemars(range(min = 0.1, max = 1.0))]
    pub discharge_coefficient: f64,
    /// Single-phase part of the flux below the critical pressure.
    #[serde(default)]
    pub single_phase: SinglePhase,
    /// Radius of the seat (m).
    #[schemars(range(min = 1e-3, max = 0.1))]
    pub seat_radius_m: f64,
    /// Radius of the ball (m).
    #[schemars(range(min = 1e-3, max = 0.2))]
    pub ball_radius_m: f64,
    /// Angle of the V-port (rad).
    #[schemars(range(min = 0.05, max = 3.15))]
    pub v_angle_rad: f64,
    /// Angle at which the valve is fully open (rad).
    #[schemars(range(min = 0.1, max = 3.15))]
    pub open_angle_rad: f64,
    /// Natural frequency of the servo, second order (rad/s).
    #[schemars(range(min = 0.5, max = 600.0))]
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of the servo.
    #[schemars(range(min = 0.05, max = 5.0))]
    pub damping_ratio: f64,
    /// Greatest rate of the servo (rad/s).
    #[schemars(range(min = 0.01, max = 100.0))]
    pub rate_limit_rad_s: f64,
    /// Time from a command to the first motion (s).
    #[schemars(range(min = 0.0, max = 0.1))]
    pub delay_s: f64,
    /// Lost motion between servo and ball (rad).
    #[schemars(range(min = 0.0, max = 0.2))]
    pub backlash_rad: f64,
    /// Step of the servo's encoder (rad); 0 is none.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub encoder_resolution_rad: f64,
}

/// Open area against angle, strictly increasing. Near closed the area goes as the square of the angle, so
/// the square root of the area is interpolated, both ways by the same curve.
#[derive(Clone, Debug)]
pub struct ValveArea {
    root_area_m: Monotone<1>,
}

impl ValveArea {
    /// From the text of the area file.
    pub fn read(text: &str) -> Result<Self, TableError> {
        let table = Table::read(text, ["theta_deg", "area_analytic_mm2"])?;
        table.require(0, "must not be negative", |angle_deg| angle_deg >= 0.0)?;
        table.require(1, "must not be negative", |area_mm2| area_mm2 >= 0.0)?;
        table.require_increasing(0)?;
        table.require_increasing(1)?;
        let knots: Vec<f64> = table.rows.iter().map(|(_, row)| row[0].to_radians()).collect();
        // mm² -> m², then the root.
        let rows: Vec<[f64; 1]> = table.rows.iter().map(|(_, row)| [(row[1] * 1e-6).sqrt()]).collect();
        Ok(Self { root_area_m: Monotone::new(&knots, &rows) })
    }

    /// Open area (m²) at an angle; closed below the table, fully open above.
    #[inline]
    pub fn area_m2(&self, angle_rad: f64) -> f64 {
        let root_m = self.root_area_m.at(0, angle_rad);
        root_m * root_m
    }

    /// Angle (rad) that opens an area: the inverse of [`Self::area_m2`], clamped to the table.
    pub fn angle_rad(&self, area_m2: f64) -> f64 {
        self.root_area_m.inverse(0, area_m2.max(0.0).sqrt())
    }

    /// Angle (rad) and area (m²) of the last row, fully open.
    pub fn fully_open(&self) -> (f64, f64) {
        let angle_rad = self.root_area_m.span().1;
        (angle_rad, self.area_m2(angle_rad))
    }

    /// Checks the table against the angle that the vehicle file calls fully open.
    pub fn validate(&self, valve: &Valve) -> Result<(), Invalid> {
        let (last_rad, _) = self.fully_open();
        if (last_rad - valve.open_angle_rad).abs() > 1e-3 {
            let open_rad = valve.open_angle_rad;
            let message = format!("{open_rad} rad, but the last angle of the area file is {last_rad} rad");
            return Err(Invalid::new("open_angle_rad", message));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = include_str!("../../scenarios/vehicles/valve_area_vs_angle.csv");

    #[test]
    fn area_rises_strictly_and_the_angle_inverts_it() {
        let area = ValveArea::read(TEXT).unwrap();
        let (open_rad, open_m2) = area.fully_open();
        assert_eq!(area.area_m2(0.0), 0.0);
        assert!((open_m2 * 1e6 - 77.145_932_6).abs() < 1e-9);
        let mut before = 0.0;
        for i in 1..=20_000 {
            let angle = open_rad * f64::from(i) / 20_000.0;
            let a = area.area_m2(angle);
            assert!(a > before, "{i}");
            assert!((area.angle_rad(a) - angle).abs() < 1e-9, "{i}");
            before = a;
        }
    }

    #[test]
    fn a_table_that_does_not_rise_is_refused_by_line() {
        let error = ValveArea::read("theta_deg,area_analytic_mm2\n0,0\n10,2\n20,2\n").unwrap_err();
        assert_eq!(error.to_string(), "line 4, column `area_analytic_mm2`: 2 must exceed the row above");
    }
}
