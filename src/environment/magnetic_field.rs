//! Earth's magnetic field at the pad, by the World Magnetic Model.
//!
//! Degree 12 spherical harmonics of Earth's main field and its secular change, computed in single
//! precision with `libm`, hence the same bits everywhere; rounding is below 1 nT, the model's own
//! uncertainty about 140 nT in each component. Source: Chulliat et al., "The US/UK World Magnetic Model
//! for 2025-2030", NOAA/NCEI 2025. The field is taken as uniform: 100 m of height change it by 3 nT.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::Date;
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;
use world_magnetic_model::uom::si::magnetic_flux_density::nanotesla;

use crate::frame::Vec3;
use crate::input::Invalid;

use super::Site;

/// Source of the magnetic field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MagneticModel {
    /// World Magnetic Model of 2025, valid from 2025.0 up to 2030.0.
    Wmm2025,
}

/// Field at the site in NED (T), at the date of the site to the day (a day is 0.3 nT).
///
/// # Errors
/// When date or place are outside the model.
pub fn field_ned_t(site: &Site) -> Result<Vec3, Invalid> {
    let MagneticModel::Wmm2025 = site.magnetic_model;
    let field = GeomagneticField::new(
        Length::new::<meter>(site.altitude_m as f32),
        Angle::new::<degree>(site.latitude_deg as f32),
        Angle::new::<degree>(site.longitude_deg as f32),
        date(site.magnetic_epoch_year)?,
    )
    .map_err(|error| Invalid::new("magnetic_model", error.to_string()))?;
    let field_nt = [field.x(), field.y(), field.z()].map(|b| f64::from(b.get::<nanotesla>()));
    Ok(Vec3::from(field_nt) * 1e-9) // nT -> T
}

/// The day that holds an instant given as a decimal year within the model's validity.
fn date(decimal_year: f64) -> Result<Date, Invalid> {
    let outside = || {
        Invalid::new("magnetic_epoch_year", format!("{decimal_year} is outside 2025.0..2030.0 of wmm2025"))
    };
    if !(2025.0..2030.0).contains(&decimal_year) {
        return Err(outside());
    }
    let year = decimal_year as i32; // truncates
    let days = if year % 4 == 0 { 366.0 } else { 365.0 };
    let ordinal = 1 + ((decimal_year - f64::from(year)) * days) as u16;
    Date::from_ordinal_date(year, ordinal).map_err(|_| outside())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_of_a_decimal_year() {
        let ordinal = |year| date(year).unwrap().to_ordinal_date();
        assert_eq!(ordinal(2025.0), (2025, 1));
        assert_eq!(ordinal(2026.5), (2026, 183));
        assert_eq!(ordinal(2028.9999), (2028, 366));
        for year in [2024.99, 2030.0, f64::NAN] {
            assert_eq!(date(year).unwrap_err().key, "magnetic_epoch_year");
        }
    }
}
