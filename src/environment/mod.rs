//! The world that a flight happens in: air, gravity, wind, ground, magnetic field and the place on Earth.
//!
//! Flat and local: NED with its origin on the pad, constant gravity, terrain at zero height. A hop
//! stays within some hundred metres, where Earth's curvature is below a millimetre of height; only the
//! geodetic coordinates of a fix account for it.

pub mod atmosphere;
pub mod geodesy;
pub mod gravity;
pub mod magnetic_field;
pub mod terrain;
pub mod turbulence;
pub mod wind;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frame::Vec3;
use crate::input::Invalid;

use atmosphere::Atmosphere;
use geodesy::Datum;
use gravity::Gravity;
use magnetic_field::MagneticModel;
use terrain::Terrain;
use wind::{Wind, WindParameters};

/// Everything outside the vehicle.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Pressure, temperature, density.
    pub atmosphere: Atmosphere,
    /// Acceleration of free fall.
    pub gravity: Gravity,
    /// Mean wind, turbulence and gusts.
    pub wind: Wind,
    /// Height of the ground.
    pub terrain: Terrain,
    /// Where the pad is on Earth.
    pub datum: Datum,
    /// Magnetic field at the pad, NED (T).
    pub magnetic_field_ned_t: Vec3,
}

impl Environment {
    /// Evaluates the magnetic model once; everything else is cheap arithmetic. Turbulence follows from the seed.
    ///
    /// # Errors
    /// When `site` or `wind` contradicts itself or leaves the validity of its models.
    pub fn new(site: &Site, wind: &WindParameters, seed: u64) -> Result<Self, Invalid> {
        wind.validate().map_err(|invalid| invalid.within("wind"))?;
        Ok(Self {
            atmosphere: Atmosphere::new(site),
            gravity: Gravity { magnitude_m_s2: site.gravity_m_s2 },
            wind: Wind::new(wind, seed),
            terrain: Terrain,
            datum: Datum::new(
                site.latitude_deg.to_radians(),
                site.longitude_deg.to_radians(),
                site.altitude_m,
            ),
            magnetic_field_ned_t: magnetic_field::field_ned_t(site)
                .map_err(|invalid| invalid.within("site"))?,
        })
    }
}

/// Place, air and field: the `[site]` table of a vehicle file or of a scenario.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Geodetic latitude of the pad (deg), positive north.
    #[schemars(range(min = -89.9, max = 89.9))]
    pub latitude_deg: f64,
    /// Longitude of the pad (deg), positive east.
    #[schemars(range(min = -180.0, max = 180.0))]
    pub longitude_deg: f64,
    /// Height of the pad above mean sea level (m). The geoid is taken as the ellipsoid.
    #[schemars(range(min = -450.0, max = 6000.0))]
    pub altitude_m: f64,
    /// Acceleration of free fall (m/s²).
    #[schemars(range(min = 0.0, max = 20.0))]
    pub gravity_m_s2: f64,
    /// Air pressure at the pad (Pa).
    #[schemars(range(min = 30000.0, max = 110000.0))]
    pub pressure_pa: f64,
    /// Air temperature at the pad (K).
    #[schemars(range(min = 200.0, max = 340.0))]
    pub temperature_k: f64,
    /// Air density at the pad (kg/m³), constant over a hop; 0 is no drag.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub air_density_kg_m3: f64,
    /// Source of the magnetic field.
    pub magnetic_model: MagneticModel,
    /// Date for the magnetic model, a decimal year.
    #[schemars(range(min = 2025.0, max = 2029.999))]
    pub magnetic_epoch_year: f64,
}
