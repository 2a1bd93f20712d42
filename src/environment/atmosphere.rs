//! Air around the pad: hydrostatic pressure with the standard lapse of temperature, constant density.
//!
//! Source: ISO 2533, Standard Atmosphere, troposphere. The barometer reads the pressure; drag uses the
//! density of the site as it stands, since a hop changes it by less than 1 % (the reference).

use super::Site;

/// Temperature lapse of the troposphere [K/m].
pub const LAPSE_K_M: f64 = 6.5e-3;
/// Specific gas constant of dry air [J/(kg K)].
pub const GAS_CONSTANT_AIR_J_KG_K: f64 = 287.05287;
/// Standard sea-level pressure [Pa].
pub const STANDARD_PRESSURE_PA: f64 = 101_325.0;
/// Standard sea-level temperature [K].
pub const STANDARD_TEMPERATURE_K: f64 = 288.15;
/// Standard gravity [m/s²].
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Heights beyond this above or below the pad read as this: the end of the troposphere [m].
const HEIGHT_LIMIT_M: f64 = 11_000.0;

/// Standard-lapse atmosphere through the values measured at the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Atmosphere {
    /// At the pad [Pa].
    pub pressure_pa: f64,
    /// At the pad [K].
    pub temperature_k: f64,
    /// Everywhere [kg/m³].
    pub density_kg_m3: f64,
    /// Of the hydrostatic balance [m/s²].
    pub gravity_m_s2: f64,
}

impl Atmosphere {
    /// With the values of the site.
    pub fn new(site: &Site) -> Self {
        Self {
            pressure_pa: site.pressure_pa,
            temperature_k: site.temperature_k,
            density_kg_m3: site.air_density_kg_m3,
            gravity_m_s2: site.gravity_m_s2,
        }
    }

    /// Static pressure at a height above the pad [Pa].
    pub fn static_pressure_pa(&self, height_m: f64) -> f64 {
        let exponent = self.gravity_m_s2 / (GAS_CONSTANT_AIR_J_KG_K * LAPSE_K_M);
        self.pressure_pa * libm::pow(self.air_temperature_k(height_m) / self.temperature_k, exponent)
    }

    /// Air temperature at a height above the pad [K].
    pub fn air_temperature_k(&self, height_m: f64) -> f64 {
        self.temperature_k - LAPSE_K_M * height_m.clamp(-HEIGHT_LIMIT_M, HEIGHT_LIMIT_M)
    }
}

/// Altitude at which the standard atmosphere has this pressure [m], the scale of an altimeter set to
/// 1013.25 hPa. Troposphere only; a negative pressure counts as zero.
pub fn pressure_altitude_m(pressure_pa: f64) -> f64 {
    let exponent = GAS_CONSTANT_AIR_J_KG_K * LAPSE_K_M / STANDARD_GRAVITY_M_S2;
    let ratio = libm::pow(pressure_pa.max(0.0) / STANDARD_PRESSURE_PA, exponent);
    STANDARD_TEMPERATURE_K / LAPSE_K_M * (1.0 - ratio)
}
