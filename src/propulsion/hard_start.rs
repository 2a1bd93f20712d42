//! A hard start: oxidiser that has pooled in the cold chamber burns at once when the flame comes.
//!
//! A pool of mass m becomes gas at the steady engine's mixture in less time than the chamber takes to empty,
//! so the pressure rises by `P = m R T/V` and falls through the choked throat with `τ = V η c*/(R T C_d
//! A_t)`: the mass balance of the filling chamber ([`super::Chamber`]) linearised about its steady state,
//! exact in its impulse, `∫ P C_d A_t/(η c*) dt = m`. Thrust follows the pressure as that of a nozzle flowing
//! full.
//!
//! Valid above the pressure at which the nozzle flows full. A pool that takes longer than τ, some
//! milliseconds, to burn peaks lower. The pool was counted as expelled when it passed the injector; the fuel
//! that burns with it is not counted and gives no gas, so peak and impulse lack a share of one over the
//! mixture ratio, about a sixth. The spike neither drives back the feed nor bursts the casing. Under
//! `fidelity = "paper"` a spike in flight shows only at the ends of the scheme's steps.
//!
//! Source: balance of mass of a chamber with a choked throat, `chamber.rs`.

use super::chamber::UNIVERSAL_GAS;
use super::engine::Engine;
use super::operating_point::{ChamberWarmStart, EngineCondition};
use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;

/// Below this the spike has ended (Pa).
const ENDED_PA: f64 = 1.0;

/// Chamber pressure above that of the steady flow, as it decays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressureSpike {
    /// Mean over the present step (Pa).
    pub chamber_pa: f64,
    /// Thrust for it (N/Pa).
    thrust_n_pa: f64,
    /// Time constant of its decay (s).
    time_constant_s: f64,
}

impl PressureSpike {
    /// No spike.
    pub const NONE: Self = Self { chamber_pa: 0.0, thrust_n_pa: 0.0, time_constant_s: 1.0 };

    /// Thrust (N).
    pub fn thrust_n(&self) -> f64 {
        self.thrust_n_pa * self.chamber_pa
    }

    /// The spike a step later.
    pub fn after(&self, step_s: f64) -> Self {
        if self.chamber_pa < ENDED_PA {
            return Self::NONE;
        }
        Self { chamber_pa: self.chamber_pa * libm::exp(-step_s / self.time_constant_s), ..*self }
    }
}

impl Engine {
    /// Spike of a pool of oxidiser (kg) that burns now, while oxidiser flows (kg/s), over its first step (s).
    pub fn hard_start(
        &self,
        condition: &EngineCondition,
        oxidizer_kg_s: f64,
        pool_kg: f64,
        step_s: f64,
    ) -> PressureSpike {
        if !(pool_kg > 0.0 && oxidizer_kg_s > 0.0) {
            return PressureSpike::NONE;
        }
        let steady = EngineCondition { burning_fraction: 1.0, fuel_flow_kg_s: None, ..*condition };
        let chamber = &self.thrust_chamber;
        let hot = chamber.at_condition(&steady).hot_flow(oxidizer_kg_s, &mut ChamberWarmStart::default());
        let (mixture, log) = (&hot.mixture, hot.pressure.log);
        let efficiency = chamber.c_star_efficiency(condition);
        let rt_j_kg = efficiency * efficiency * UNIVERSAL_GAS / mixture.molar_mass_kg_mol(log)
            * mixture.temperature_k(log);
        let volume_m3 = chamber.gas_volume_m3(condition);
        let throat_m2 = chamber.open_throat_m2(condition);
        let time_constant_s = volume_m3 * efficiency * mixture.c_star_m_s(log) / (rt_j_kg * throat_m2);
        // The mean over the first step keeps the impulse.
        let share = time_constant_s / step_s * -libm::expm1(-step_s / time_constant_s);
        PressureSpike {
            chamber_pa: share * pool_kg * rt_j_kg / volume_m3,
            thrust_n_pa: self.nozzle().thrust_efficiency
                * throat_m2
                * STANDARD_GRAVITY_M_S2
                * mixture.vacuum_isp_s(log)
                / mixture.c_star_m_s(log),
            time_constant_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_decays_and_ends() {
        let mut spike = PressureSpike { chamber_pa: 1e6, thrust_n_pa: 5e-4, time_constant_s: 4e-3 };
        assert_eq!(spike.thrust_n(), 500.0);
        let mut impulse_pa_s = 0.0;
        for _ in 0..100 {
            impulse_pa_s += spike.chamber_pa * 1e-3;
            spike = spike.after(1e-3);
        }
        // A geometric series, short of what 1 Pa still holds: 4e-3 Pa s.
        assert!((impulse_pa_s - 1e3 / (1.0 - libm::exp(-0.25))).abs() < 5e-3, "{impulse_pa_s}");
        assert_eq!(spike, PressureSpike::NONE);
    }
}
