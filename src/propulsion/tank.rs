//! The run tank: its shape, its fill and what stands above the liquid.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pressurant::Regulator;
use crate::fluid::NitrousVapor;
use crate::input::Invalid;

/// Run tank: the `[feed.tank]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tank {
    /// Pressure at the start (Pa).
    #[schemars(range(min = 2e5, max = 80e5))]
    pub pressure_pa: f64,
    /// Temperature of liquid and ullage (K).
    #[schemars(range(min = 240.0, max = 306.0))]
    pub temperature_k: f64,
    /// Inner radius; the tank is a flat-ended cylinder (m).
    #[schemars(range(min = 0.01, max = 2.0))]
    pub radius_m: f64,
    /// Inner length (m).
    #[schemars(range(min = 0.02, max = 10.0))]
    pub length_m: f64,
    /// Height of the floor above the gimbal pivot (m).
    #[schemars(range(min = -10.0, max = 10.0))]
    pub floor_z_m: f64,
    /// Share of the volume that is gas at the start.
    #[schemars(range(min = 0.01, max = 0.99))]
    pub ullage_fraction: f64,
    /// Liquid below which the outlet draws gas (kg).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub unusable_nitrous_kg: f64,
    /// What stands above the liquid.
    #[serde(default)]
    pub ullage: Ullage,
}

impl Tank {
    /// Inner volume (m³).
    pub fn volume_m3(&self) -> f64 {
        core::f64::consts::PI * self.radius_m * self.radius_m * self.length_m
    }
}

/// What stands above the liquid: the `[feed.tank.ullage]` table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Ullage {
    /// How the gas above the liquid takes its expansion.
    pub model: UllageModel,
    /// Conductance from gas to liquid and shell (W/K); `energy_balance` only.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub heat_conductance_w_k: f64,
    /// Heat capacity of the tank's shell, at the liquid's temperature (J/K); `energy_balance` only.
    #[schemars(range(min = 100.0, max = 1e6))]
    pub shell_heat_capacity_j_k: f64,
    /// Vapour that the surface gives per pressure it lacks (kg/(s Pa)); 0 is a stratified gas without
    /// vapour, 1 is equilibrium; `energy_balance` only. Above 0, the tank must have room below its set pressure for
    /// the vapour that `vapor_saturation` lacks: no relief valve is modelled.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub vapor_conductance_kg_s_pa: f64,
    /// Partial pressure of the vapour at the start, as a share of the vapour pressure; `energy_balance` only.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub vapor_saturation: f64,
}

impl Default for Ullage {
    fn default() -> Self {
        Self {
            model: UllageModel::ConstantTemperature,
            heat_conductance_w_k: 0.0,
            // 8.2 kg of aluminium, 900 J/(kg K); without effect at constant temperature.
            shell_heat_capacity_j_k: 7400.0,
            vapor_conductance_kg_s_pa: 0.0,
            vapor_saturation: 0.0,
        }
    }
}

impl Ullage {
    /// Refuses a tank that its own vapour would raise above what the regulator keeps: pressure (Pa) and temperature
    /// (K) at the start.
    ///
    /// # Errors
    /// With the pressure that it would reach.
    pub fn validate(&self, tank_pa: f64, tank_k: f64, regulator: &Regulator) -> Result<(), Invalid> {
        if self.model == UllageModel::ConstantTemperature || self.vapor_conductance_kg_s_pa <= 0.0 {
            return Ok(());
        }
        let vapor_pa = NitrousVapor::tables().interface(tank_k).vapor_pressure_pa;
        let start_pa = tank_pa.max(self.vapor_saturation * vapor_pa);
        let reached_pa = start_pa + (1.0 - self.vapor_saturation) * vapor_pa;
        let allowed_pa = regulator.greatest_pa().max(start_pa);
        if reached_pa <= allowed_pa {
            return Ok(());
        }
        let message = format!(
            "{}: vapour would raise the tank from {:.1} to {:.1} bar, above {:.1}; allowed 0, or vapor_saturation = 1",
            self.vapor_conductance_kg_s_pa,
            start_pa * 1e-5,
            reached_pa * 1e-5,
            allowed_pa * 1e-5
        );
        Err(Invalid::new("vapor_conductance_kg_s_pa", message))
    }
}

/// How the gas above the liquid takes its expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum UllageModel {
    /// Nitrogen at the tank's temperature.
    ConstantTemperature,
    /// Nitrogen and vapour with a balance of energy; the liquid cools as it evaporates.
    EnergyBalance,
}
