//! The oxidiser valve: open area against angle, from whatever its maker or user has measured.
//!
//! The area file is a table over `theta_deg` or `percent_open` (100 is `open_angle_rad`), of
//!
//! | columns | meaning | becomes area by |
//! |---|---|---|
//! | `area_analytic_mm2` or `area_mm2` | open area | itself |
//! | `pixels` | pixels of the opening in a picture | share of the last row's count, times `open_area_m2` |
//! | `cv` | flow coefficient, US gallons of water a minute at 1 psi | C_d A of 16.98 mm² per Cv, over C_d |
//! | `water_kg_s`, `drop_pa` | flow of water and the valve's pressure drop | C_d A = ṁ/√(2 ρ Δp), over C_d |
//!
//! C_d is `discharge_coefficient`. Cv and water flow give C_d A: divided and multiplied by the same
//! coefficient they give back the flow measured, whatever it is. Source of Cv: ISA-75.01.01 (IEC 60534-2-1),
//! water at 60 °F.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::injector::SinglePhase;
use crate::input::Invalid;
use crate::interpolate::{
    Monotone,
    table::{self, Table, TableError},
};

/// C_d A of a flow coefficient Cv of 1 (m²): 1 US gallon a minute is 6.309 019 64e-5 m³/s, 1 psi is
/// 6894.757 293 Pa, water at 60 °F has 999.0 kg/m³; Q √(ρ/(2 Δp)).
const AREA_PER_CV_M2: f64 = 1.698126871e-05;
/// Water of a flow test, 20 °C (kg/m³). 15 to 25 °C change the area by 0.06 %.
const WATER_KG_M3: f64 = 998.2;

/// Ball valve with a V-port, and its servo: the `[feed.valve]` table. The area and the discharge
/// coefficient are used here, the servo's numbers by the actuator.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Valve {
    /// Table of the opening against the angle, beside the vehicle file: `theta_deg` or `percent_open`, and one of
    /// `area_analytic_mm2`, `area_mm2`, `pixels`, `cv`, or `water_kg_s` with `drop_pa`.
    pub area_file: String,
    /// Fully open area (m²); only where the table counts pixels.
    #[serde(default)]
    #[schemars(range(min = 1e-8, max = 0.1))]
    pub open_area_m2: Option<f64>,
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
    /// Coulomb friction of servo and ball, as the error at which the position loop breaks away (rad).
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.2))]
    pub friction_rad: f64,
    /// Step of the servo's encoder (rad); 0 is none.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub encoder_resolution_rad: f64,
}

/// Open area against angle, strictly increasing. Near closed the area goes as the square of the angle, so
/// the square root of the area is interpolated, both ways by the same curve.
#[derive(Clone, Debug)]
pub struct ValveArea {
    root_area_m: Monotone<1>,
    /// Angle (rad) and root of the area (m) of each row.
    rows: Vec<(f64, f64)>,
    measure: &'static str,
}

/// Why a valve's table cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ValveAreaError {
    /// The table itself.
    #[error("valve area: {0}")]
    Table(#[from] TableError),
    /// A parameter that contradicts it; the key is relative to the vehicle file.
    #[error(transparent)]
    Parameter(#[from] Invalid),
}

/// How well a valve's table inverts, and how well its rows agree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ValveMapCheck {
    /// What the table holds: "area", "pixels", "Cv" or "water flow".
    pub measure: &'static str,
    /// Rows that count; leading rows of a valve still shut are one.
    pub rows: usize,
    /// Last angle of the shut valve (deg).
    pub shut_deg: f64,
    /// Fully open angle (deg).
    pub open_deg: f64,
    /// Fully open area (m²).
    pub open_area_m2: f64,
    /// Greatest difference of an angle and the angle of its area (deg).
    pub round_trip_deg: f64,
    /// The row that agrees least with the others; `None` of a table with fewer than four rows.
    pub worst_row: Option<WorstRow>,
}

/// A row against the curve through all others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WorstRow {
    /// Angle of the row (deg).
    pub angle_deg: f64,
    /// Its area (m²).
    pub area_m2: f64,
    /// Where the other rows put that area, less its angle (deg).
    pub error_deg: f64,
}

impl ValveArea {
    /// From the text of the area file.
    ///
    /// # Errors
    /// When it has no known column, or does not rise from a shut valve.
    pub fn read(text: &str, valve: &Valve) -> Result<Self, ValveAreaError> {
        let (line, names) = table::heading(text).unwrap_or((1, Vec::new()));
        let has = |name: &str| names.contains(&name);
        let missing = |column: &str| {
            let found = names.join(", ");
            ValveAreaError::Table(TableError::MissingColumn { column: column.to_owned(), line, found })
        };
        let (travel, rad_per_travel) = if has("theta_deg") {
            ("theta_deg", 1f64.to_radians())
        } else if has("percent_open") {
            ("percent_open", 0.01 * valve.open_angle_rad)
        } else {
            return Err(missing("theta_deg` or `percent_open"));
        };
        let per_flow_area = 1.0 / valve.discharge_coefficient;
        let of_column = |column: &'static str, area_m2: &dyn Fn(f64) -> f64| {
            let table = Table::read(text, [travel, column])?;
            opening_rows(&table, |[_, value]| area_m2(value), rad_per_travel)
        };
        let (measure, rows) = if has("area_analytic_mm2") {
            ("area", of_column("area_analytic_mm2", &|mm2| mm2 * 1e-6)?) // mm² -> m²
        } else if has("area_mm2") {
            ("area", of_column("area_mm2", &|mm2| mm2 * 1e-6)?) // mm² -> m²
        } else if has("pixels") {
            let Some(open_m2) = valve.open_area_m2 else {
                let message = "missing: the area file counts pixels, which need the fully open area";
                return Err(Invalid::new("feed.valve.open_area_m2", message).into());
            };
            let table = Table::read(text, [travel, "pixels"])?;
            let most = table.rows[table.rows.len() - 1].1[1];
            ("pixels", of_column("pixels", &|count| open_m2 * count / most)?)
        } else if has("cv") {
            ("Cv", of_column("cv", &|cv| cv * AREA_PER_CV_M2 * per_flow_area)?)
        } else if has("water_kg_s") && has("drop_pa") {
            let table = Table::read(text, [travel, "water_kg_s", "drop_pa"])?;
            table.require(2, "must be positive", |pa| pa > 0.0)?;
            let area =
                |[_, flow, drop_pa]: [f64; 3]| per_flow_area * flow / (2.0 * WATER_KG_M3 * drop_pa).sqrt();
            ("water flow", opening_rows(&table, area, rad_per_travel)?)
        } else {
            return Err(missing("area_mm2`, `pixels`, `cv` or `water_kg_s` with `drop_pa"));
        };
        if measure != "pixels" && valve.open_area_m2.is_some() {
            let message = format!("only beside a table of pixels; the area file has {measure}");
            return Err(Invalid::new("feed.valve.open_area_m2", message).into());
        }
        Ok(Self { root_area_m: curve(&rows), rows, measure })
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

    /// Checks the table: the error of the inverse, and the row that fits the others least.
    pub fn check(&self) -> ValveMapCheck {
        const SAMPLES: u32 = 5000;
        let (shut_rad, open_rad) = self.root_area_m.span();
        let round_trip_rad = (0..=SAMPLES)
            .map(|i| shut_rad + (open_rad - shut_rad) * f64::from(i) / f64::from(SAMPLES))
            .map(|angle_rad| (self.angle_rad(self.area_m2(angle_rad)) - angle_rad).abs())
            .fold(0.0, f64::max);
        let rows = &self.rows;
        let inner = if rows.len() < 4 { 0..0 } else { 1..rows.len() - 1 };
        let worst_row = inner
            .map(|left_out| {
                let others: Vec<_> =
                    rows.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, row)| *row).collect();
                let (angle_rad, root_m) = rows[left_out];
                (angle_rad, root_m, curve(&others).inverse(0, root_m) - angle_rad)
            })
            .max_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))
            .map(|(angle_rad, root_m, error_rad)| WorstRow {
                angle_deg: angle_rad.to_degrees(),
                area_m2: root_m * root_m,
                error_deg: error_rad.to_degrees(),
            });
        ValveMapCheck {
            measure: self.measure,
            rows: rows.len(),
            shut_deg: shut_rad.to_degrees(),
            open_deg: open_rad.to_degrees(),
            open_area_m2: self.fully_open().1,
            round_trip_deg: round_trip_rad.to_degrees(),
            worst_row,
        }
    }

    /// Checks the table against the angle that the vehicle file calls fully open.
    pub fn validate(&self, valve: &Valve) -> Result<(), Invalid> {
        let (last_rad, _) = self.fully_open();
        if (last_rad - valve.open_angle_rad).abs() > 1e-3 {
            let open_rad = valve.open_angle_rad;
            let message = format!("{open_rad} rad, but the last angle of the area file is {last_rad} rad");
            return Err(Invalid::new("open_angle_rad", message));
        }
        // A flow gives C_d A, and no coefficient exceeds 1.
        let (what, opening_m2) = match self.measure {
            "Cv" | "water flow" => ("C_d A", valve.discharge_coefficient * self.fully_open().1),
            _ => ("area", self.fully_open().1),
        };
        let seat_m2 = core::f64::consts::PI * valve.seat_radius_m * valve.seat_radius_m;
        // Measurement, and the digits of a nominal size.
        if opening_m2 > 1.05 * seat_m2 {
            let (opening_mm2, seat_mm2) = (opening_m2 * 1e6, seat_m2 * 1e6);
            let message = format!(
                "the seat is {seat_mm2:.4} mm2, but the area file opens up to {what} = {opening_mm2:.4} mm2"
            );
            return Err(Invalid::new("seat_radius_m", message));
        }
        Ok(())
    }
}

/// Angle (rad) and root of the area (m) of each row: from shut, strictly rising. Leading rows of a valve
/// that is still shut become one.
fn opening_rows<const N: usize>(
    table: &Table<N>,
    area_m2: impl Fn([f64; N]) -> f64,
    rad_per_travel: f64,
) -> Result<Vec<(f64, f64)>, TableError> {
    table.require(0, "must not be negative", |travel| travel >= 0.0)?;
    table.require_increasing(0)?;
    let areas: Vec<f64> = table.rows.iter().map(|(_, row)| area_m2(*row)).collect();
    let shut = areas.iter().take_while(|area| **area == 0.0).count();
    if shut == 0 {
        return Err(table.bad_value(table.rows[0], 1, "must be 0: the table begins with the valve shut"));
    }
    if areas.len() - shut < 1 {
        return Err(TableError::TooShort { expected: 2, found: 1 });
    }
    if let Some(i) = (shut..areas.len()).find(|&i| areas[i] <= areas[i - 1] || !areas[i].is_finite()) {
        return Err(table.bad_value(table.rows[i], 1, "must open the valve further than the row above"));
    }
    let rows = table.rows.iter().zip(areas).skip(shut - 1);
    Ok(rows.map(|((_, row), area_m2)| (row[0] * rad_per_travel, area_m2.sqrt())).collect())
}

fn curve(rows: &[(f64, f64)]) -> Monotone<1> {
    let knots: Vec<f64> = rows.iter().map(|row| row.0).collect();
    let roots: Vec<[f64; 1]> = rows.iter().map(|row| [row.1]).collect();
    Monotone::new(&knots, &roots)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = include_str!("../../scenarios/vehicles/valve_area_vs_angle.csv");

    /// Published flow coefficients of the GT lander's valve with a 60 degree V-port, 0 to 100 % open.
    const CV_60: [f64; 11] = [0.0, 0.0, 0.120, 0.236, 0.539, 0.643, 1.081, 1.587, 2.615, 3.664, 5.525];

    fn valve() -> Valve {
        Valve {
            area_file: String::new(),
            open_area_m2: None,
            discharge_coefficient: 0.8,
            seat_radius_m: 6.35e-3,
            ball_radius_m: 10e-3,
            v_angle_rad: 1.047,
            open_angle_rad: core::f64::consts::FRAC_PI_2,
            natural_frequency_rad_s: 31.4,
            damping_ratio: 0.8,
            rate_limit_rad_s: 2.0,
            delay_s: 0.0,
            backlash_rad: 0.0,
            friction_rad: 0.0,
            single_phase: SinglePhase::default(),
            encoder_resolution_rad: 0.0,
        }
    }

    fn table(heading: &str, rows: impl Iterator<Item = (usize, String)>) -> String {
        rows.fold(format!("{heading}\n"), |text, (i, row)| text + &format!("{},{row}\n", 10 * i))
    }

    #[test]
    fn area_rises_strictly_and_the_angle_inverts_it() {
        let area = ValveArea::read(TEXT, &valve()).unwrap();
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

    /// Cv: the flow of water through the area at 1 psi with the discharge coefficient is Cv gallons a minute.
    #[test]
    fn flow_coefficients_give_back_the_flow_they_were_measured_as() {
        let text = table("percent_open,cv", CV_60.iter().enumerate().map(|(i, cv)| (i, cv.to_string())));
        for cd in [0.45, 0.8] {
            let area = ValveArea::read(&text, &Valve { discharge_coefficient: cd, ..valve() }).unwrap();
            for (i, cv) in CV_60.iter().enumerate().skip(1) {
                let angle_rad = (9.0 * i as f64).to_radians();
                let flow_m3_s = cd * area.area_m2(angle_rad) * (2.0f64 * 6_894.757_293 / 999.0).sqrt();
                let gallons_a_minute = flow_m3_s / 3.785_411_784e-3 * 60.0;
                // The constant has eight digits.
                assert!((gallons_a_minute - cv).abs() <= 1e-7 * cv, "{i}: {gallons_a_minute} {cv}");
            }
            // 0 and 10 % are both shut: the curve starts at the second.
            let check = area.check();
            assert_eq!((check.measure, check.rows), ("Cv", 10));
            assert!((check.shut_deg - 9.0).abs() < 1e-12 && (check.open_deg - 90.0).abs() < 1e-12);
            assert_eq!(area.area_m2(0.1), 0.0);
            // Newton to 1e-15 of a segment; the slope of the root is 0.02 of the mean one at worst.
            assert!(check.round_trip_deg < 1e-9, "{check:?}");
            // 50 % is the row that a smooth V-port contradicts: 0.539, 0.643, 1.081.
            let worst = check.worst_row.unwrap();
            assert!(
                (worst.angle_deg - 45.0).abs() < 1e-9 || (worst.angle_deg - 36.0).abs() < 1e-9,
                "{worst:?}"
            );
            assert!((1.0..9.0).contains(&worst.error_deg.abs()), "{worst:?}");
        }
    }

    /// The same opening as pixels, as water flow and as area makes the same curve.
    #[test]
    fn pixels_water_and_area_of_one_valve_agree() {
        let areas_mm2: Vec<f64> = (0..=10).map(|i| 0.8 * f64::from(i * i)).collect();
        let each =
            |f: &dyn Fn(f64) -> String| areas_mm2.iter().map(|a| f(*a)).enumerate().collect::<Vec<_>>();
        let area = table("percent_open,area_mm2", each(&|a| a.to_string()).into_iter());
        let pixels = table("percent_open,pixels", each(&|a| (a * 1e4).to_string()).into_iter());
        let water = table(
            "percent_open,water_kg_s,drop_pa",
            each(&|a| format!("{:e},2e5", 0.8 * a * 1e-6 * (2.0f64 * 998.2 * 2e5).sqrt())).into_iter(),
        );
        let of_area = ValveArea::read(&area, &valve()).unwrap();
        let of_pixels = ValveArea::read(&pixels, &Valve { open_area_m2: Some(80e-6), ..valve() }).unwrap();
        let of_water = ValveArea::read(&water, &valve()).unwrap();
        for i in 0..=100 {
            let angle_rad = 0.015_7 * f64::from(i);
            let expected = of_area.area_m2(angle_rad);
            for other in [&of_pixels, &of_water] {
                // Round-off of products and square roots.
                assert!((other.area_m2(angle_rad) - expected).abs() <= 1e-14 * 80e-6, "{i}");
            }
        }
        let measures = [&of_area, &of_pixels, &of_water].map(|map| map.check().measure);
        assert_eq!(measures, ["area", "pixels", "water flow"]);
    }

    #[test]
    fn a_row_off_the_others_is_found() {
        let rows = (0..=9).map(|i| {
            let area_mm2 = f64::from(i * i) * if i == 6 { 1.1 } else { 1.0 };
            (10 * i as usize, area_mm2)
        });
        let text = rows.fold("theta_deg,area_mm2\n".to_owned(), |t, (d, a)| t + &format!("{d},{a}\n"));
        let worst = ValveArea::read(&text, &valve()).unwrap().check().worst_row.unwrap();
        // The root is linear in the angle: 10 % of area is 60 (sqrt(1.1) - 1) = 2.93 degrees.
        assert!(
            (worst.angle_deg - 60.0).abs() < 1e-9 && (worst.error_deg - 2.9286).abs() < 0.01,
            "{worst:?}"
        );
    }

    /// A spreadsheet's byte order mark is no part of the heading; an opening wider than its seat is a slip.
    #[test]
    fn a_spreadsheet_is_read_and_a_slip_of_units_is_not() {
        let valve = valve();
        let marked = ValveArea::read("\u{feff}percent_open,area_mm2\n0,0\n50,20\n100,80\n", &valve).unwrap();
        assert!((marked.fully_open().1 - 80e-6).abs() < 1e-15);
        assert_eq!(marked.validate(&valve), Ok(()));
        // The seat of 6.35 mm has 126.7 mm2; Cv 5.5 is C_d A of 93, and 10 is 170.
        let judged = |rows: &str| ValveArea::read(rows, &valve).unwrap().validate(&valve);
        assert_eq!(judged("theta_deg,cv\n0,0\n90,5.5\n"), Ok(()));
        for slip in
            ["theta_deg,cv\n0,0\n90,10\n", "theta_deg,cv\n0,0\n90,1e6\n", "theta_deg,area_mm2\n0,0\n90,140\n"]
        {
            assert_eq!(judged(slip).unwrap_err().key, "seat_radius_m", "{slip}");
        }
    }

    #[test]
    fn tables_that_cannot_be_used_are_refused_by_line_or_key() {
        let refused = |text: &str| ValveArea::read(text, &valve()).unwrap_err().to_string();
        assert_eq!(
            refused("theta_deg,area_analytic_mm2\n0,0\n10,2\n20,2\n"),
            "valve area: line 4, column `area_analytic_mm2`: 2 must open the valve further than the row above"
        );
        assert_eq!(
            refused("theta_deg,cv\n0,0.1\n10,2\n"),
            "valve area: line 2, column `cv`: 0.1 must be 0: the table begins with the valve shut"
        );
        assert!(refused("theta_deg,pixels\n0,0\n10,2\n").starts_with("feed.valve.open_area_m2: missing"));
        assert!(refused("theta,cv\n0,0\n").contains("column `theta_deg` or `percent_open` is missing"));
        assert!(refused("theta_deg,flow\n0,0\n").contains("`cv` or `water_kg_s` with `drop_pa` is missing"));
        assert!(refused("theta_deg,water_kg_s,drop_pa\n0,0,0\n9,1,1\n").contains("must be positive"));
        assert!(refused("theta_deg,cv\n0,0\n10,0\n").contains("at least 2 rows"));
        let double =
            ValveArea::read("theta_deg,cv\n0,0\n9,1\n", &Valve { open_area_m2: Some(1e-5), ..valve() });
        assert!(double.unwrap_err().to_string().contains("only beside a table of pixels"));
    }
}
