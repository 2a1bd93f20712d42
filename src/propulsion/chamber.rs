//! The combustion chamber: pressure from flow, or from the gas it holds.
//!
//! Quasi-steady: `Pc = ṁ c*(OF, Pc) η/(A_t C_d)`, the seed paper's Eq 11 (ideal flow through the throat,
//! so the discharge coefficient divides), and its unchoked continuation down to ambient pressure.
//! Filling: the masses of oxidiser and fuel in the chamber are states; pressure, mixture and nozzle flow
//! follow from them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::combustion::{CombustionMap, Mixture};
use super::nozzle::{ChamberPressure, PerfectGas, Throat};
use crate::interpolate::Anchor;

/// Universal gas constant (J/(mol K)).
pub(super) const UNIVERSAL_GAS: f64 = 8.314_462_618;
/// Passes of the fixed point in Pc; each gains two to three digits, four are usual.
const PASSES: usize = 12;
/// Above this Pc/pa the throat of every perfect gas is choked: ((γ+1)/2)^(γ/(γ-1)) at γ = 1.67 is 2.054.
const SURELY_CHOKED: f64 = 2.1;

/// Combustion chamber: the `[engine.chamber]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Chamber {
    /// Whether the chamber's gas is a state.
    pub model: ChamberModel,
    /// Volume before and behind the grain (m³); that of the port is added.
    #[schemars(range(min = 1e-6, max = 1.0))]
    pub dead_volume_m3: f64,
    /// Efficiency of c*, on pressure and thrust.
    #[schemars(range(min = 0.3, max = 1.0))]
    pub c_star_efficiency: f64,
}

/// What the chamber pressure follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChamberModel {
    /// Pressure follows the flow at once.
    QuasiSteady,
    /// Oxidiser and fuel in the chamber are states.
    Filling,
}

/// Gas in the chamber: the state of the filling model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChamberGas {
    /// Mass that came as oxidiser.
    pub oxidizer_kg: f64,
    /// Mass that came as fuel.
    pub fuel_kg: f64,
}

/// Rate of [`ChamberGas`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChamberGasRate {
    /// Rate of the mass that came as oxidiser.
    pub oxidizer_kg_s: f64,
    /// Rate of the mass that came as fuel.
    pub fuel_kg_s: f64,
}

/// Gas that does not burn, from the measured c* of cold flow.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColdGas {
    /// Characteristic velocity (m/s).
    pub(super) c_star_m_s: f64,
}

/// Isentropic exponent of warm nitrous oxide vapour.
const COLD_GAMMA: f64 = 1.28;

impl ColdGas {
    /// R T (J/kg) that belongs to c*: c* = sqrt(R T)/Γ, Γ² = γ (2/(γ+1))^((γ+1)/(γ-1)).
    pub(super) fn gas_constant_temperature_j_kg(&self) -> f64 {
        let g = COLD_GAMMA;
        let vandenkerckhove2 = g * libm::pow(2.0 / (g + 1.0), (g + 1.0) / (g - 1.0));
        self.c_star_m_s * self.c_star_m_s * vandenkerckhove2
    }
}

/// Steady chamber pressure for a mixture, from `choked_per_c_star` = ṁ η/(A_t C_d) (Pa s/m).
///
/// `warm_start` is a pressure near the answer, and becomes the answer.
#[inline]
pub(super) fn steady_pressure(
    map: &CombustionMap,
    mixture: &Mixture<'_>,
    choked_per_c_star: f64,
    ambient_pa: f64,
    warm_start: &mut PressureWarmStart,
) -> ChamberPressure {
    let mut pa =
        if warm_start.pa > 0.0 { warm_start.pa } else { choked_per_c_star * mixture.c_star_m_s(0.0) };
    let mut log = 0.0;
    for _ in 0..PASSES {
        log = map.log_pressure_near(pa, &mut warm_start.log);
        let c_star = mixture.c_star_m_s(log);
        let change = (choked_per_c_star * c_star - pa) / (1.0 - mixture.c_star_exponent(c_star));
        let share = change / pa;
        // From a start far too high Newton's chord may overshoot: the pressure stays positive.
        pa = (pa + change).max(0.1 * pa);
        // Newton on a function this straight: the error left is (share · k/c*)², below round-off.
        if share.abs() < 1e-7 {
            log += share;
            break;
        }
    }
    let pa = choked_per_c_star * mixture.c_star_m_s(log);
    let pressure = if pa >= SURELY_CHOKED * ambient_pa {
        ChamberPressure { pa, log }
    } else {
        steady_pressure_near_ambient(map, mixture, choked_per_c_star, ambient_pa)
    };
    warm_start.pa = pressure.pa;
    pressure
}

/// A chamber pressure near the answer, and a logarithm near its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PressureWarmStart {
    /// Pressure (Pa); 0: not known.
    pub pa: f64,
    /// ln(P/P_ref) of the map near there.
    pub log: Anchor,
}

/// The same where the throat may be unchoked, (11S).
#[inline(never)]
fn steady_pressure_near_ambient(
    map: &CombustionMap,
    mixture: &Mixture<'_>,
    choked_per_c_star: f64,
    ambient_pa: f64,
) -> ChamberPressure {
    let gas = PerfectGas { gamma: mixture.gamma() };
    let critical_ratio = gas.total_over_static(1.0);
    let mut pa = ambient_pa;
    let mut log = map.log_pressure(pa);
    for _ in 0..PASSES {
        let choked_ratio = choked_per_c_star * mixture.c_star_m_s(log) / ambient_pa;
        let ratio = if choked_ratio >= critical_ratio {
            choked_ratio
        } else {
            gas.unchoked_pressure_ratio(choked_ratio)
        };
        let change = ratio * ambient_pa - pa;
        pa = ratio * ambient_pa;
        log = map.log_pressure(pa);
        if change.abs() <= 1e-13 * pa {
            break;
        }
    }
    ChamberPressure { pa, log }
}

/// Pressure of the gas in a chamber, and what it drives through the nozzle.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChamberOutflow {
    /// Chamber pressure (Pa).
    pub(super) pressure: ChamberPressure,
    /// Flow through the nozzle (kg/s).
    pub(super) nozzle_kg_s: f64,
}

/// Geometry and efficiency that the filling model needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vessel {
    /// Volume of gas (m³).
    pub(super) volume_m3: f64,
    /// Efficiency of c*.
    pub(super) c_star_efficiency: f64,
    /// Discharge coefficient of the throat.
    pub(super) discharge_coefficient: f64,
    /// Share of the gas that burns, 0..1.
    pub(super) burning_fraction: f64,
    /// Gas that does not burn.
    pub(super) cold: ColdGas,
}

/// Pressure and outflow of a mass of gas in the chamber: P = m R T/V with the flame temperature times η², and the
/// nozzle's flow at that pressure, zero at ambient pressure.
pub(super) fn filling_pressure(
    map: &CombustionMap,
    mixture: &Mixture<'_>,
    gas_kg: f64,
    vessel: &Vessel,
    throat: &Throat,
    warm_start: &mut PressureWarmStart,
) -> ChamberOutflow {
    let f = vessel.burning_fraction;
    let cold_rt = vessel.cold.gas_constant_temperature_j_kg();
    let eta = vessel.c_star_efficiency;
    let per_rt_pa = gas_kg.max(0.0) / vessel.volume_m3; // P = this · R T
    let mut log = 0.0;
    let mut pa = 0.0;
    for _ in 0..PASSES {
        let hot_rt = eta * eta * UNIVERSAL_GAS / mixture.molar_mass_kg_mol(log) * mixture.temperature_k(log);
        let next = per_rt_pa * (f * hot_rt + (1.0 - f) * cold_rt);
        let change = next - pa;
        pa = next;
        log = map.log_pressure_near(pa.max(1.0), &mut warm_start.log);
        if change.abs() <= 1e-13 * pa {
            break;
        }
    }
    let ratio = pa / throat.ambient_pa;
    let pressure = ChamberPressure { pa: pa.max(throat.ambient_pa), log };
    if ratio <= 1.0 {
        return ChamberOutflow { pressure, nozzle_kg_s: 0.0 };
    }
    let per_c_star = vessel.discharge_coefficient * pa * throat.area_m2;
    let flow = |c_star_m_s: f64, gamma: f64| per_c_star / c_star_m_s * unchoked_share(gamma, ratio);
    let hot = flow(eta * mixture.c_star_m_s(log), mixture.gamma());
    let cold = flow(vessel.cold.c_star_m_s, COLD_GAMMA);
    ChamberOutflow { pressure, nozzle_kg_s: f * hot + (1.0 - f) * cold }
}

/// Flow of the throat over its choked flow at this Pc/pa, 1/ε(M); 1 when choked.
fn unchoked_share(gamma: f64, ratio: f64) -> f64 {
    if ratio >= SURELY_CHOKED {
        return 1.0;
    }
    let gas = PerfectGas { gamma };
    if ratio >= gas.total_over_static(1.0) {
        return 1.0;
    }
    let mach2 = 2.0 / (gamma - 1.0) * libm::expm1((gamma - 1.0) / gamma * libm::log(ratio));
    let mach = mach2.max(0.0).sqrt();
    if mach > 0.0 { (1.0 / gas.area_ratio(mach)).min(1.0) } else { 0.0 }
}
