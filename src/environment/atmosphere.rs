//! Air around the pad: hydrostatic pressure with the standard lapse of temperature, constant density.
//!
//! Source: ISO 2533, Standard Atmosphere, troposphere. The barometer reads the pressure; drag uses the
//! density of the site as it stands, since a hop changes it by less than 1 % (the reference).

use super::Site;

/// Temperature lapse of the troposphere (K/m).
pub(crate) const LAPSE_K_M: f64 = 6.5e-3;
/// Specific gas constant of dry air (J/(kg K)).
pub(crate) const GAS_CONSTANT_AIR_J_KG_K: f64 = 287.05287;
/// Standard sea-level pressure (Pa).
pub(crate) const STANDARD_PRESSURE_PA: f64 = 101_325.0;
/// Standard sea-level temperature (K).
pub(crate) const STANDARD_TEMPERATURE_K: f64 = 288.15;
/// Standard gravity (m/s²); turns specific impulse into velocity too.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Heights beyond this above or below the pad read as this: the end of the troposphere (m).
const HEIGHT_LIMIT_M: f64 = 11_000.0;

/// Standard-lapse atmosphere through the values measured at the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Atmosphere {
    /// At the pad (Pa).
    pub pressure_pa: f64,
    /// At the pad (K).
    pub temperature_k: f64,
    /// Everywhere (kg/m³).
    pub density_kg_m3: f64,
    /// Of the hydrostatic balance (m/s²).
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

    /// Static pressure at a height above the pad (Pa).
    pub(crate) fn static_pressure_pa(&self, height_m: f64) -> f64 {
        let exponent = self.gravity_m_s2 / (GAS_CONSTANT_AIR_J_KG_K * LAPSE_K_M);
        self.pressure_pa * libm::pow(self.air_temperature_k(height_m) / self.temperature_k, exponent)
    }

    /// Air temperature at a height above the pad (K).
    pub(crate) fn air_temperature_k(&self, height_m: f64) -> f64 {
        self.temperature_k - LAPSE_K_M * height_m.clamp(-HEIGHT_LIMIT_M, HEIGHT_LIMIT_M)
    }
}

/// Altitude at which the standard atmosphere has this pressure (m), the scale of an altimeter set to
/// 1013.25 hPa. Troposphere only; a negative pressure counts as zero.
pub fn pressure_altitude_m(pressure_pa: f64) -> f64 {
    let exponent = GAS_CONSTANT_AIR_J_KG_K * LAPSE_K_M / STANDARD_GRAVITY_M_S2;
    let ratio = libm::pow(pressure_pa.max(0.0) / STANDARD_PRESSURE_PA, exponent);
    STANDARD_TEMPERATURE_K / LAPSE_K_M * (1.0 - ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standard() -> Atmosphere {
        Atmosphere {
            pressure_pa: STANDARD_PRESSURE_PA,
            temperature_k: STANDARD_TEMPERATURE_K,
            density_kg_m3: 1.225,
            gravity_m_s2: STANDARD_GRAVITY_M_S2,
        }
    }

    /// Table 5 of ISO 2533 (geopotential altitude): 1000 m and 5000 m, given to five and six digits.
    #[test]
    fn pressure_follows_the_standard_table() {
        let pressure = |height_m| standard().static_pressure_pa(height_m);
        assert!((pressure(1000.0) - 89_874.6).abs() < 0.5);
        assert!((pressure(5000.0) - 54_019.9).abs() < 0.5);
        assert_eq!(pressure(0.0), STANDARD_PRESSURE_PA);
    }

    /// The two closed forms are inverse to each other: T0/L (1 - (p/p0)^(RL/g)). Rounding of a power near
    /// 1, 1e-16 relative, times T0/L = 4.4e4 m: 1e-11 m, and some headroom.
    #[test]
    fn pressure_altitude_inverts_the_standard_atmosphere() {
        for height_m in [-400.0, 0.0, 1.0, 50.0, 1000.0, 9000.0] {
            let back_m = pressure_altitude_m(standard().static_pressure_pa(height_m));
            assert!((back_m - height_m).abs() < 1e-9, "{height_m}: {back_m}");
        }
    }

    /// Hydrostatic balance dp/dh = -p g/(R T), by a central difference: 1 m is good to 1e-9 of it by the
    /// third derivative, cancellation 1e5 x 1e-16 / 1 m to 1e-11 Pa/m of 12.
    #[test]
    fn pressure_is_hydrostatic_at_any_site() {
        let air = Atmosphere { pressure_pa: 85e3, temperature_k: 305.0, gravity_m_s2: 9.79, ..standard() };
        for height_m in [0.0, 50.0, 500.0] {
            let slope =
                0.5 * (air.static_pressure_pa(height_m + 1.0) - air.static_pressure_pa(height_m - 1.0));
            let weight = air.static_pressure_pa(height_m) * air.gravity_m_s2
                / (GAS_CONSTANT_AIR_J_KG_K * air.air_temperature_k(height_m));
            assert!((slope + weight).abs() < 1e-7 * weight, "{height_m}: {slope} {weight}");
        }
    }

    #[test]
    fn absurd_heights_and_pressures_stay_finite() {
        for height_m in [-1e9, 1e9] {
            assert!(standard().static_pressure_pa(height_m).is_finite());
        }
        assert!(pressure_altitude_m(-5.0).is_finite());
    }
}
