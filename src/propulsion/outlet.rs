//! Gas ingestion: the tank's outlet when liquid no longer covers it. Gas passes the valve first, the injector
//! later.
//!
//! The gas's share of the volume flow rises linearly as the last liquid goes. The valve sees it at once, the
//! injector when the liquid between them has passed. While gas passes the valve and liquid still the
//! injector, the valve costs less pressure, the injector stands nearer the tank's pressure, and the
//! flow peaks: the spike at liquid depletion. Then gas passes the injector too: the tail.
//!
//! Each phase takes its share of an orifice's area at its own flux: the flashing liquid's, and that of a
//! perfect gas with γ = 1.4 and the gas's density. Between valve and injector volume is conserved, not mass,
//! so flows are counted as liquid of the same volume. What little gas fills the pipe is not counted.

use super::gas_orifice::gas_flux_kg_m2_s;

/// When the outlet ingests gas: parameters.
#[derive(Clone, Copy, Debug)]
pub struct GasIngestion {
    /// Liquid below which gas enters the outlet (kg).
    pub covered_kg: f64,
    /// Liquid between valve and injector (kg).
    pub pipe_kg: f64,
}

impl GasIngestion {
    /// Gas begins at `unusable_kg` left in the tank. The liquid must last some steps at the greatest flow
    /// that the injector passes (kg/s), so that integration never passes zero.
    pub fn new(unusable_kg: f64, pipe_kg: f64, greatest_kg_s: f64) -> Self {
        const LAST_S: f64 = 4e-3;
        Self { covered_kg: unusable_kg.max(pipe_kg + LAST_S * greatest_kg_s), pipe_kg }
    }

    /// Gas shares of the volume flow through valve and injector, none while the outlet is covered.
    pub fn gas_shares(&self, liquid_kg: f64) -> Option<[f64; 2]> {
        if liquid_kg >= self.covered_kg {
            return None;
        }
        let span_kg = self.covered_kg - self.pipe_kg;
        let share = |gone_kg: f64| (gone_kg / span_kg).clamp(0.0, 1.0);
        let gone_kg = self.covered_kg - liquid_kg;
        Some([share(gone_kg), share(gone_kg - self.pipe_kg)])
    }
}

/// What an outlet draws that liquid no longer covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlet {
    /// Gas share of the volume flow through the valve.
    pub valve_gas: f64,
    /// Gas share of the volume flow through the injector.
    pub injector_gas: f64,
    /// Pressure of the gas in the tank (Pa).
    pub gas_pa: f64,
    /// Its density (kg/m³).
    pub gas_kg_m3: f64,
}

impl Outlet {
    /// Flux through the valve, counted as liquid (kg/(m² s)), from that of liquid alone.
    pub(super) fn valve_flux(&self, liquid_flux: f64, inlet_pa: f64, liquid_kg_m3: f64) -> f64 {
        let gas = gas_flux_kg_m2_s(self.gas_pa, self.gas_kg_m3, inlet_pa);
        two_phase_flux(self.valve_gas, liquid_flux, gas, self.relative_density(inlet_pa, liquid_kg_m3))
    }

    /// Flux through the injector, counted as liquid (kg/(m² s)), from that of liquid alone.
    pub(super) fn injector_flux(
        &self,
        liquid_flux: f64,
        (inlet_pa, chamber_pa): (f64, f64),
        liquid_kg_m3: f64,
    ) -> f64 {
        let relative = self.relative_density(inlet_pa, liquid_kg_m3);
        let gas = gas_flux_kg_m2_s(inlet_pa, relative * liquid_kg_m3, chamber_pa);
        two_phase_flux(self.injector_gas, liquid_flux, gas, relative)
    }

    /// Mass of liquid and of gas into the chamber, per mass counted as liquid.
    pub(super) fn masses(&self, inlet_pa: f64, liquid_kg_m3: f64) -> [f64; 2] {
        [1.0 - self.injector_gas, self.injector_gas * self.relative_density(inlet_pa, liquid_kg_m3)]
    }

    /// Share of the mass into the chamber that is gas, at a pressure before the injector and the density
    /// there of what is no gas.
    pub(crate) fn gas_mass_share(&self, inlet_pa: f64, liquid_kg_m3: f64) -> f64 {
        let [liquid, gas] = self.masses(inlet_pa, liquid_kg_m3);
        if gas > 0.0 { gas / (liquid + gas) } else { 0.0 }
    }

    /// Mass share of vapour and gas in what enters the injector, from that in the flashing liquid.
    pub(super) fn quality(&self, inlet_pa: f64, liquid_kg_m3: f64, liquid_quality: f64) -> f64 {
        let [liquid, gas] = self.masses(inlet_pa, liquid_kg_m3);
        if gas > 0.0 { (gas + liquid * liquid_quality) / (gas + liquid) } else { liquid_quality }
    }

    /// Density of the gas over that of the fluid between valve and injector, at its pressure.
    fn relative_density(&self, inlet_pa: f64, liquid_kg_m3: f64) -> f64 {
        if self.gas_pa > 0.0 && liquid_kg_m3 > 0.0 {
            self.gas_kg_m3 * inlet_pa / (self.gas_pa * liquid_kg_m3)
        } else {
            0.0
        }
    }
}

/// Flux of two phases that share an area, counted as liquid: 1/G = (1 - ε)/G_liquid + ε r/G_gas.
fn two_phase_flux(gas_share: f64, liquid_flux: f64, gas_flux: f64, relative_density: f64) -> f64 {
    if gas_share <= 0.0 {
        return liquid_flux;
    }
    if gas_flux <= 0.0 || (gas_share < 1.0 && liquid_flux <= 0.0) {
        return 0.0;
    }
    let liquid = if gas_share < 1.0 { (1.0 - gas_share) / liquid_flux } else { 0.0 };
    let resistance = liquid + gas_share * relative_density / gas_flux;
    if resistance > 0.0 { 1.0 / resistance } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_phase_alone_has_its_own_flux() {
        assert_eq!(two_phase_flux(0.0, 4e4, 1e4, 0.1), 4e4);
        let only_gas = two_phase_flux(1.0, 0.0, 1e4, 0.1);
        assert!((only_gas * 0.1 - 1e4).abs() < 1e-9, "counted as liquid times relative density is gas");
        let half = two_phase_flux(0.5, 4e4, 1e4, 0.1);
        assert!(half > 4e4 && half < only_gas);
    }

    /// Half the volume gas of 100 kg/m3 at 65 bar, expanded to 47 bar: 72.3 of 834 kg, by hand.
    #[test]
    fn gas_weighs_what_it_weighs_before_the_injector() {
        let outlet = Outlet { valve_gas: 0.5, injector_gas: 0.5, gas_pa: 65e5, gas_kg_m3: 100.0 };
        let gas_kg_m3 = 100.0 * 47.0 / 65.0;
        let share = outlet.gas_mass_share(47e5, 834.0);
        assert!((share - gas_kg_m3 / (gas_kg_m3 + 834.0)).abs() < 1e-15, "{share}");
        let [liquid, gas] = outlet.masses(47e5, 834.0);
        assert!(
            (share - gas / (liquid + gas)).abs() < 1e-15,
            "the mass that flows and the share that burns agree"
        );
    }

    #[test]
    fn gas_alone_has_quality_one() {
        let outlet = |injector_gas| Outlet { valve_gas: 1.0, injector_gas, gas_pa: 60e5, gas_kg_m3: 70.0 };
        assert_eq!(outlet(0.0).quality(50e5, 800.0, 0.1), 0.1);
        assert_eq!(outlet(1.0).quality(50e5, 800.0, 0.1), 1.0);
        // Half the volume: 0.5 of liquid, 0.5 × 70 × (50/60)/800 of gas.
        let gas = 0.5 * 70.0 * (50.0 / 60.0) / 800.0;
        let mixed = outlet(0.5).quality(50e5, 800.0, 0.1);
        assert!((mixed - (gas + 0.05) / (gas + 0.5)).abs() < 1e-15, "{mixed}");
    }

    #[test]
    fn gas_reaches_the_injector_when_the_pipe_has_emptied() {
        let outlet = GasIngestion::new(0.15, 0.02, 0.9);
        assert_eq!(outlet.gas_shares(0.15), None);
        let [valve, injector] = outlet.gas_shares(0.13).unwrap();
        assert!((valve - 0.02 / 0.13).abs() < 1e-12 && injector == 0.0);
        assert_eq!(outlet.gas_shares(0.0), Some([1.0, 1.0]));
        // No pipe to speak of and no unusable liquid: still a few steps' time.
        let sudden = GasIngestion::new(0.0, 1e-6, 0.9);
        assert!(sudden.covered_kg - sudden.pipe_kg >= 0.9 * 4e-3 - 1e-15);
    }
}
