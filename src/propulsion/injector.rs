//! Flashing orifices: mass flux of nitrous oxide that boils on its way through.
//!
//! Two limits bound the flux: single-phase incompressible (SPI, no time to boil) and homogeneous
//! equilibrium (HEM, boils at once). The non-homogeneous non-equilibrium model weighs them by
//! κ² = (P_u - P_d)/(P_v - P_d).
//!
//! Source: Dyer, Zilliac, Sadhwani, Karabeyoglu and Cantwell, AIAA 2007-5702, with the weights as corrected
//! by Solomon, Utah State University, 2011. Added here: the HEM part is held at its greatest value below
//! the critical pressure, since a back pressure cannot reduce a choked flow.
//!
//! The SPI part still grows without limit as the back pressure falls. [`SinglePhase::Choked`] evaluates it,
//! and κ, at max(P_d, P_critical): below the critical pressure the whole flux is constant, which is what
//! injectors of nitrous oxide do (Waxman, Zimmerman, Cantwell and Zilliac, AIAA 2013-3636: flow independent
//! of the back pressure below a critical one; not checked in the original). Taken in SPI alone the weights
//! would still move with P_d, toward the lesser HEM, and a falling back pressure would reduce the flow.
//! The choking pressure is that of homogeneous equilibrium, so this bounds the flux from below as the
//! unlimited form does from above.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Showerhead injector: the `[feed.injector]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Injector {
    /// Number of equal holes.
    #[schemars(range(min = 1, max = 1000))]
    pub hole_count: u32,
    /// Diameter of a hole (m).
    #[schemars(range(min = 1e-4, max = 0.01))]
    pub hole_diameter_m: f64,
    /// Discharge coefficient, of the holes' area.
    #[schemars(range(min = 0.1, max = 1.0))]
    pub discharge_coefficient: f64,
    /// Single-phase part of the flux below the critical pressure.
    #[serde(default)]
    pub single_phase: SinglePhase,
}

/// What the single-phase part of an orifice's flux does below the critical pressure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SinglePhase {
    /// It grows as the back pressure falls: Dyer's form.
    #[default]
    Incompressible,
    /// It stays what it is at the critical pressure.
    Choked,
}

impl SinglePhase {
    /// Back pressure that sets the flux (Pa).
    #[inline]
    pub(super) fn effective_back_pressure_pa(self, downstream_pa: f64, critical_pa: f64) -> f64 {
        match self {
            Self::Incompressible => downstream_pa,
            Self::Choked => downstream_pa.max(critical_pa),
        }
    }
}

impl Injector {
    /// Effective area, discharge coefficient included (m²).
    pub fn effective_area_m2(&self) -> f64 {
        let hole_m2 = 0.25 * core::f64::consts::PI * self.hole_diameter_m * self.hole_diameter_m;
        self.discharge_coefficient * f64::from(self.hole_count) * hole_m2
    }
}

/// Pressures that decide how SPI and HEM are weighed.
#[derive(Clone, Copy, Debug)]
pub(super) struct OrificePressures {
    /// Upstream (Pa).
    pub(super) upstream_pa: f64,
    /// Downstream (Pa).
    pub(super) downstream_pa: f64,
    /// Vapour pressure upstream (Pa); the upstream pressure itself when that is two-phase.
    pub(super) vapor_pa: f64,
}

/// Flux (kg/(m² s)) through an orifice. `equilibrium_flux` is called only where something boils.
#[inline]
pub(super) fn flashing_flux_kg_m2_s(
    pressures: OrificePressures,
    density_kg_m3: f64,
    equilibrium_flux: impl FnOnce() -> f64,
) -> f64 {
    let OrificePressures { upstream_pa, downstream_pa, vapor_pa } = pressures;
    let drop_pa = upstream_pa - downstream_pa;
    if drop_pa <= 0.0 {
        return 0.0;
    }
    let g_spi = (2.0 * density_kg_m3 * drop_pa).sqrt(); // [kg/(m² s)]
    let superheat_pa = vapor_pa - downstream_pa;
    if superheat_pa <= 0.0 {
        return g_spi; // κ → ∞: nothing boils.
    }
    let kappa = if vapor_pa == upstream_pa { 1.0 } else { (drop_pa / superheat_pa).sqrt() };
    (kappa * g_spi + equilibrium_flux()) / (1.0 + kappa)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flux(upstream_pa: f64, downstream_pa: f64, vapor_pa: f64) -> f64 {
        let pressures = OrificePressures { upstream_pa, downstream_pa, vapor_pa };
        flashing_flux_kg_m2_s(pressures, 800.0, || 1000.0)
    }

    #[test]
    fn at_saturation_the_flux_is_the_mean_of_both_limits() {
        let spi = (2.0f64 * 800.0 * 20e5).sqrt();
        assert_eq!(flux(40e5, 20e5, 40e5), 0.5 * (spi + 1000.0));
    }

    #[test]
    fn above_the_vapour_pressure_nothing_boils_and_against_the_pressure_nothing_flows() {
        assert_eq!(flux(40e5, 30e5, 25e5), (2.0f64 * 800.0 * 10e5).sqrt());
        assert_eq!(flux(40e5, 41e5, 25e5), 0.0);
    }
}
