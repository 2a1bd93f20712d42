//! Nitrogen: bottle, regulator, and the pressure of the run tank.
//!
//! One mass of nitrogen, in the bottle and above the liquid; it falls only by what the thrusters and the
//! vent use (the seed paper's Eqs 12 and 13). Real-gas density, both at constant temperature. While the
//! bottle holds the regulator's minimum drop above the set point the tank is at the set point; then
//! it blows down, always that drop below the bottle. Pure nitrogen above the liquid: with nitrous vapour
//! mixed in, less nitrogen would be drawn.
//!
//! Valid above the vapour pressure of the liquid, 47 bar at 290 K: here the tank blows down past it, a real
//! one would boil and stay near it. That far, [`super::gas_balance`] with `[feed.tank.ullage] model =
//! "energy_balance"`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fluid::{Isotherm, Nitrogen};
use crate::input::Invalid;
use crate::interpolate::{Bracket, bracketed_root};

/// Bottle and regulator: the `[pressurant]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pressurant {
    /// The bottle.
    pub bottle: Bottle,
    /// The regulator.
    pub regulator: Regulator,
}

/// Nitrogen bottle: the `[pressurant.bottle]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bottle {
    /// Inner volume (m³).
    #[schemars(range(min = 1e-4, max = 1.0))]
    pub volume_m3: f64,
    /// Radius of the gas as a cylinder (m).
    #[schemars(range(min = 0.01, max = 1.0))]
    pub radius_m: f64,
    /// Height of its centre above the gimbal pivot (m).
    #[schemars(range(min = -10.0, max = 10.0))]
    pub centre_z_m: f64,
    /// Pressure at the start (Pa).
    #[schemars(range(min = 1e5, max = 350e5))]
    pub pressure_pa: f64,
    /// Temperature at the start (K).
    #[schemars(range(min = 200.0, max = 330.0))]
    pub temperature_k: f64,
    /// How the gas takes its expansion.
    pub model: BottleModel,
    /// Conductance from gas to wall (W/K); `energy_balance` only.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub wall_conductance_w_k: f64,
    /// Heat capacity of the wall (J/K); `energy_balance` only.
    #[schemars(range(min = 1.0, max = 1e6))]
    pub wall_heat_capacity_j_k: f64,
}

/// How the bottle's gas takes its expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BottleModel {
    /// Constant temperature.
    Isothermal,
    /// Adiabatic gas with heat from the wall.
    EnergyBalance,
}

/// Pressure regulator: the `[pressurant.regulator]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Regulator {
    /// Outlet pressure (Pa).
    #[schemars(range(min = 2e5, max = 80e5))]
    pub set_pressure_pa: f64,
    /// Fall of the outlet per flow of nitrogen (Pa s/kg).
    #[schemars(range(min = 0.0, max = 1e8))]
    pub droop_pa_s_kg: f64,
    /// Rise of the outlet without flow (Pa).
    #[schemars(range(min = 0.0, max = 10e5))]
    pub lockup_pa: f64,
    /// What the bottle must have above the outlet for the regulator to work (Pa).
    #[schemars(range(min = 0.0, max = 100e5))]
    pub minimum_drop_pa: f64,
    /// Flow at which nothing is left of the lock-up (kg/s).
    #[serde(default = "Regulator::default_lockup_flow_kg_s")]
    #[schemars(range(min = 1e-4, max = 10.0))]
    pub lockup_flow_kg_s: f64,
    /// Time in which the outlet follows; not used while nothing but the set pressure matters (s).
    #[serde(default = "Regulator::default_response_time_s")]
    #[schemars(range(min = 0.01, max = 1.0))]
    pub response_time_s: f64,
}

impl Regulator {
    // Neither is measured; without droop, lock-up or a balance of energy both are without effect.
    fn default_lockup_flow_kg_s() -> f64 {
        2e-3
    }

    fn default_response_time_s() -> f64 {
        0.02
    }

    /// Checks the keys against each other.
    ///
    /// # Errors
    /// When the outlet would pass what the feed is computed for.
    pub fn validate(&self) -> Result<(), Invalid> {
        const FEED_PA: f64 = 80e5;
        if self.lockup_pa > 0.0 && self.set_pressure_pa + self.lockup_pa > FEED_PA {
            let message = format!(
                "{} Pa above set_pressure_pa, {}, passes {FEED_PA} Pa",
                self.lockup_pa, self.set_pressure_pa
            );
            return Err(Invalid::new("lockup_pa", message));
        }
        Ok(())
    }

    /// Greatest outlet pressure that the regulator itself can cause, and half a bar (Pa).
    pub(crate) fn greatest_pa(&self) -> f64 {
        const MARGIN_PA: f64 = 0.5e5;
        self.set_pressure_pa + self.lockup_pa + MARGIN_PA
    }
}

/// The nitrogen at its two temperatures.
#[derive(Clone, Debug)]
pub struct PressurantGas {
    /// In the bottle.
    pub bottle: Isotherm,
    /// Above the liquid.
    pub ullage: Isotherm,
    /// Temperature of liquid and gas in the tank (K).
    pub ullage_k: f64,
    /// Density above the liquid at the regulator's set pressure (kg/m³).
    pub set_kg_m3: f64,
}

impl PressurantGas {
    /// Of a bottle and a regulator, with the liquid at a temperature (K).
    pub fn new(pressurant: &Pressurant, ullage_k: f64) -> Self {
        let ullage = Isotherm::new(ullage_k);
        let set_kg_m3 = ullage.density_kg_m3(pressurant.regulator.set_pressure_pa);
        Self { bottle: Isotherm::new(pressurant.bottle.temperature_k), ullage, ullage_k, set_kg_m3 }
    }
}

/// What the division of the nitrogen between bottle and tank depends on.
#[derive(Clone, Copy, Debug)]
pub struct NitrogenInventory {
    /// All nitrogen, bottle and tank (kg).
    pub total_kg: f64,
    /// Volume above the liquid in the run tank (m³).
    pub ullage_m3: f64,
    /// Ambient pressure, below which the tank does not fall (Pa).
    pub ambient_pa: f64,
    /// Outlet of the regulator below its set pressure (Pa); 0: sound.
    pub regulator_sag_pa: f64,
}

impl NitrogenInventory {
    /// Pressure that the regulator keeps (Pa).
    fn outlet_pa(&self, regulator: &Regulator) -> f64 {
        (regulator.set_pressure_pa - self.regulator_sag_pa)
            .max(self.ambient_pa.min(regulator.set_pressure_pa))
    }
}

/// Pressures of bottle and run tank, and how the nitrogen is divided between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NitrogenState {
    /// Pressure of the run tank (Pa).
    pub tank_pa: f64,
    /// Pressure of the bottle (Pa).
    pub bottle_pa: f64,
    /// Nitrogen above the liquid (kg).
    pub tank_kg: f64,
    /// Nitrogen in the bottle (kg).
    pub bottle_kg: f64,
    /// Whether the regulator holds its outlet: the bottle has the drop, and nothing else has raised the tank.
    pub regulated: bool,
    /// Nitrous oxide vapour above the liquid (kg).
    pub vapor_kg: f64,
    /// Temperature of the liquid (K).
    pub liquid_k: f64,
}

impl Pressurant {
    /// Nitrogen in a bottle as the file fills it (kg).
    pub fn initial_bottle_kg(&self) -> f64 {
        let bottle = &self.bottle;
        bottle.volume_m3 * Nitrogen::tables().density_kg_m3(bottle.pressure_pa, bottle.temperature_k)
    }

    /// Divides the nitrogen between bottle and tank.
    #[inline]
    pub fn distribute(&self, gas: &PressurantGas, inventory: &NitrogenInventory) -> NitrogenState {
        let NitrogenInventory { total_kg, ullage_m3, .. } = *inventory;
        let bottle_m3 = self.bottle.volume_m3;
        let drop_pa = self.regulator.minimum_drop_pa;
        let total_kg = total_kg.max(0.0);
        let outlet_pa = inventory.outlet_pa(&self.regulator);
        let sound = inventory.regulator_sag_pa == 0.0;
        let outlet_kg_m3 = if sound { gas.set_kg_m3 } else { gas.ullage.density_kg_m3(outlet_pa) };
        let tank_kg = ullage_m3.max(0.0) * outlet_kg_m3;
        let bottle_kg = total_kg - tank_kg;
        if bottle_kg > 0.0 {
            let bottle_pa = gas.bottle.pressure_pa(bottle_kg / bottle_m3);
            if bottle_pa >= outlet_pa + drop_pa {
                return NitrogenState {
                    tank_pa: outlet_pa,
                    bottle_pa,
                    tank_kg,
                    bottle_kg,
                    regulated: true,
                    vapor_kg: 0.0,
                    liquid_k: gas.ullage_k,
                };
            }
        }
        self.blow_down(gas, inventory)
    }

    /// Blow-down: the tank pressure at which both volumes hold the whole mass.
    #[inline(never)]
    fn blow_down(&self, gas: &PressurantGas, inventory: &NitrogenInventory) -> NitrogenState {
        let NitrogenInventory { total_kg, ullage_m3, ambient_pa, .. } = *inventory;
        let bottle_m3 = self.bottle.volume_m3;
        let drop_pa = self.regulator.minimum_drop_pa;
        let outlet_pa = inventory.outlet_pa(&self.regulator);
        let total_kg = total_kg.max(0.0);
        let in_tank_kg = |tank_pa: f64| ullage_m3.max(0.0) * gas.ullage.density_kg_m3(tank_pa);
        let excess_kg = |tank_pa: f64| {
            in_tank_kg(tank_pa) + bottle_m3 * gas.bottle.density_kg_m3(tank_pa + drop_pa) - total_kg
        };
        let low = ambient_pa.min(outlet_pa);
        let tank_pa = if excess_kg(low) >= 0.0 {
            low
        } else {
            let bracket = Bracket { low, high: outlet_pa, guess: f64::NAN, slope: None, tolerance: 1e-3 };
            bracketed_root(bracket, excess_kg).x
        };
        let tank_kg = in_tank_kg(tank_pa).min(total_kg);
        let bottle_kg = total_kg - tank_kg;
        let bottle_pa = gas.bottle.pressure_pa(bottle_kg / bottle_m3);
        NitrogenState {
            tank_pa,
            bottle_pa,
            tank_kg,
            bottle_kg,
            regulated: false,
            vapor_kg: 0.0,
            liquid_k: gas.ullage_k,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> Pressurant {
        Pressurant {
            bottle: Bottle {
                volume_m3: 9e-3,
                radius_m: 0.09,
                centre_z_m: 1.08,
                pressure_pa: 300e5,
                temperature_k: 290.0,
                model: BottleModel::Isothermal,
                wall_conductance_w_k: 6.0,
                wall_heat_capacity_j_k: 4700.0,
            },
            regulator: Regulator {
                set_pressure_pa: 65e5,
                droop_pa_s_kg: 0.0,
                lockup_pa: 0.0,
                minimum_drop_pa: 15e5,
                lockup_flow_kg_s: 2e-3,
                response_time_s: 0.02,
            },
        }
    }

    fn with(total_kg: f64, ullage_m3: f64) -> NitrogenState {
        let inventory =
            NitrogenInventory { total_kg, ullage_m3, ambient_pa: 101_325.0, regulator_sag_pa: 0.0 };
        let gas = PressurantGas::new(&reference(), 290.0);
        reference().distribute(&gas, &inventory)
    }

    #[test]
    fn the_hop_ends_with_the_bottle_pressure_of_the_vehicle_page() {
        let tank_m3 = core::f64::consts::PI * 0.095 * 0.095 * 0.67;
        let start_kg = reference().initial_bottle_kg() + 0.15 * tank_m3 * 76.049_069_4;
        assert!((start_kg - 2.972).abs() < 6e-4, "{start_kg}");
        let end = with(start_kg, tank_m3 - 2.89 / 834.318);
        assert!((end.tank_kg - 1.181).abs() < 1e-3 && (end.bottle_pa * 1e-5 - 177.0).abs() < 0.5, "{end:?}");
    }

    #[test]
    fn mass_is_kept_and_pressures_fall_without_a_step_as_nitrogen_is_used() {
        let mut before: Option<NitrogenState> = None;
        for i in 0..=3000 {
            let total = 3.0 - 0.001 * f64::from(i);
            let now = with(total, 0.012);
            assert!((now.tank_kg + now.bottle_kg - total).abs() < 1e-12);
            if let Some(before) = before {
                assert!(
                    now.tank_pa <= before.tank_pa + 1e-2 && now.bottle_pa <= before.bottle_pa + 1e-2,
                    "{now:?}"
                );
                // 1 g in 21 litres at most is 0.05 bar, in 9 litres of bottle 0.2 bar at 300 bar.
                assert!(before.tank_pa - now.tank_pa < 0.1e5 && before.bottle_pa - now.bottle_pa < 0.3e5);
            }
            before = Some(now);
        }
    }
}
