//! Gas as a state: bottle, regulator, ullage and liquid surface as balances of mass and energy.
//!
//! ```text
//!   wall ──Q──► bottle ──regulator──► ullage: N2 + N2O vapour ──► vent, outlet
//!                 └──► thrusters          ▲ │ P dV, Q, evaporation
//!                                      liquid and shell ──► outlet
//! ```
//!
//! The ullage obeys d(m u)/dt = ΣM h - P dV/dt + Q, the bottle the same at constant volume. Temperatures are
//! the states, their rates follow from u(ρ, T) of the tables, so nothing is inverted. Both gases fill the
//! ullage, each as if alone (Dalton). The liquid keeps the density it was filled with and one temperature
//! with its shell; its surface gives vapour in proportion to what the vapour pressure has above the partial
//! pressure, and boils when it has more than the whole.
//!
//! A regulator with a response time τ is a linear equation for its flow: P' = (P1(M) - P)/τ, with P1 the set
//! pressure less droop, plus the lock-up that a small flow uses up. Flow is never backward, and never more
//! than keeps the tank the minimum drop below the bottle: there the tank blows down with it. A tank above its
//! pressure shuts it, no more: there is no relief valve, so vapour that joins nitrogen at the set pressure
//! stays.
//!
//! Source: Zimmerman, Waxman, Cantwell and Zilliac, "Review and Evaluation of Models for Self-Pressurizing
//! Propellant Tank Dynamics", AIAA 2013-4045: tank in equilibrium, and with the balances of liquid, surface
//! and gas of Zilliac and Karabeyoglu and of Casalino and Pastrone; here with one surface conductance between
//! them, and nitrogen. Valid for gas of 130 to 430 K over liquid of 184 to 307 K.

use core::ops::{Add, Mul};

use super::pressurant::{BottleModel, NitrogenState, Pressurant, Regulator};
use super::tank::{Tank, Ullage, UllageModel};
use crate::fluid::{GasPoint, Interface, NitrousVapor, RealGas};

/// State of the gas beside the masses of all nitrogen and of the liquid; its rate has the same shape.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GasState {
    /// Nitrogen in the bottle (kg).
    pub bottle_kg: f64,
    /// Its temperature (K).
    pub bottle_k: f64,
    /// Temperature of the bottle's wall (K).
    pub wall_k: f64,
    /// Nitrous oxide vapour above the liquid (kg).
    pub vapor_kg: f64,
    /// Temperature of the gas above the liquid (K).
    pub ullage_k: f64,
    /// Temperature of liquid and shell (K).
    pub liquid_k: f64,
}

impl Add for GasState {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            bottle_kg: self.bottle_kg + other.bottle_kg,
            bottle_k: self.bottle_k + other.bottle_k,
            wall_k: self.wall_k + other.wall_k,
            vapor_kg: self.vapor_kg + other.vapor_kg,
            ullage_k: self.ullage_k + other.ullage_k,
            liquid_k: self.liquid_k + other.liquid_k,
        }
    }
}

impl Mul<f64> for GasState {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self {
            bottle_kg: self.bottle_kg * by,
            bottle_k: self.bottle_k * by,
            wall_k: self.wall_k * by,
            vapor_kg: self.vapor_kg * by,
            ullage_k: self.ullage_k * by,
            liquid_k: self.liquid_k * by,
        }
    }
}

impl GasState {
    /// Every number, in the order of the fields.
    pub fn numbers(&self) -> [f64; 6] {
        [self.bottle_kg, self.bottle_k, self.wall_k, self.vapor_kg, self.ullage_k, self.liquid_k]
    }
}

/// Shortest time in which a store of heat, vapour or gas gives what it has (s): some steps, so that
/// integration stays stable whatever the conductance.
const SHORTEST_S: f64 = 0.02;
/// Share of the tank that is gas at the least: a tank filled to the top has no pressure of its own.
const LEAST_ULLAGE: f64 = 1e-4;
/// Mass below which a store of gas has no temperature of its own (kg).
const LEAST_KG: f64 = 1e-7;

/// Temperatures that the tables know (K).
const GAS_K: (f64, f64) = (130.0, 430.0);
const LIQUID_K: (f64, f64) = (184.0, 307.0);

/// Parameters of the balances.
#[derive(Clone, Debug)]
pub struct GasBalance {
    pressurant: Pressurant,
    ullage: Ullage,
    tank_m3: f64,
    liquid_kg_m3: f64,
}

/// Contents of bottle and run tank, and how its regulator stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stores {
    /// All nitrogen, bottle and tank (kg).
    pub nitrogen_kg: f64,
    /// Liquid nitrous oxide (kg).
    pub nitrous_kg: f64,
    /// The rest.
    pub gas: GasState,
    /// Outlet of the regulator below its set pressure (Pa); 0: sound.
    pub regulator_sag_pa: f64,
}

/// Flows out of the stores.
#[derive(Clone, Copy, Debug, Default)]
pub struct Withdrawal {
    /// Liquid through the outlet (kg/s).
    pub liquid_kg_s: f64,
    /// Gas through the outlet and the vent (kg/s).
    pub gas_kg_s: f64,
    /// Nitrogen from the bottle to the thrusters (kg/s).
    pub thrusters_kg_s: f64,
}

/// How the stores change.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StoresRate {
    /// All nitrogen (kg/s).
    pub nitrogen_kg_s: f64,
    /// Gas above the liquid (kg/s).
    pub run_tank_kg_s: f64,
    /// All gas, nitrogen and vapour, in tank and bottle (kg/s).
    pub total_kg_s: f64,
    /// Liquid that becomes vapour; negative condenses (kg/s).
    pub evaporation_kg_s: f64,
    /// Rate of the rest.
    pub gas: GasState,
    /// Enthalpy that leaves (W).
    pub enthalpy_out_w: f64,
}

/// Pressures, masses and gas properties that follow from the stores.
#[derive(Clone, Copy, Debug)]
pub struct GasProperties {
    stores: Stores,
    /// Pressures and masses.
    pub nitrogen: NitrogenState,
    ullage_m3: f64,
    bottle: GasPoint,
    tank: GasPoint,
    vapor: GasPoint,
    interface: Interface,
}

impl GasProperties {
    /// Density of the gas above the liquid (kg/m³).
    pub(crate) fn ullage_density_kg_m3(&self) -> f64 {
        (self.nitrogen.tank_kg + self.nitrogen.vapor_kg) / self.ullage_m3
    }

    /// Mass share of vapour in that gas.
    pub(crate) fn vapor_share(&self) -> f64 {
        let NitrogenState { tank_kg, vapor_kg, .. } = self.nitrogen;
        if vapor_kg > 0.0 { vapor_kg / (tank_kg + vapor_kg) } else { 0.0 }
    }
}

impl GasBalance {
    /// For a tank and the density of the liquid in it (kg/m³).
    pub fn new(pressurant: &Pressurant, tank: &Tank, liquid_kg_m3: f64) -> Self {
        Self {
            pressurant: pressurant.clone(),
            ullage: tank.ullage.clone(),
            tank_m3: tank.volume_m3(),
            liquid_kg_m3,
        }
    }

    /// Partial pressure of the vapour at the start (Pa), at a temperature (K).
    pub fn initial_vapor_pa(&self, temperature_k: f64) -> f64 {
        match self.ullage.model {
            UllageModel::ConstantTemperature => 0.0,
            UllageModel::EnergyBalance => {
                let interface = NitrousVapor::tables().interface(temperature_k);
                self.ullage.vapor_saturation * interface.vapor_pressure_pa
            }
        }
    }

    /// State at the start, everything at rest: nitrogen in the bottle (kg), liquid (kg) and its temperature
    /// (K).
    pub fn initial(&self, bottle_kg: f64, nitrous_kg: f64, temperature_k: f64) -> GasState {
        let vapor = NitrousVapor::tables();
        let saturated = vapor.saturated_density_kg_m3(temperature_k);
        let vapor_pa = self.initial_vapor_pa(temperature_k);
        // The pressure rises with density up to saturation: halve the interval to round-off.
        let (mut low, mut high) = (0.0, saturated);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if vapor.at(middle, temperature_k).pressure_pa < vapor_pa { low = middle } else { high = middle }
        }
        let density = if vapor_pa > 0.0 { high } else { 0.0 };
        GasState {
            bottle_kg,
            bottle_k: self.pressurant.bottle.temperature_k,
            wall_k: self.pressurant.bottle.temperature_k,
            vapor_kg: density * self.ullage_m3(nitrous_kg),
            ullage_k: temperature_k,
            liquid_k: temperature_k,
        }
    }

    fn ullage_m3(&self, nitrous_kg: f64) -> f64 {
        (self.tank_m3 - nitrous_kg / self.liquid_kg_m3).max(LEAST_ULLAGE * self.tank_m3)
    }

    /// Evaluates the stores once, for all that depends on them.
    pub fn properties(&self, stores: &Stores) -> GasProperties {
        let gas = &stores.gas;
        let bottle_kg = gas.bottle_kg.max(0.0);
        let tank_kg = (stores.nitrogen_kg - bottle_kg).max(0.0);
        let vapor_kg = gas.vapor_kg.max(0.0);
        let ullage_m3 = self.ullage_m3(stores.nitrous_kg);
        let gas_table = RealGas::nitrogen();
        let bottle = gas_table.at(bottle_kg / self.pressurant.bottle.volume_m3, gas.bottle_k);
        let tank = gas_table.at(tank_kg / ullage_m3, gas.ullage_k);
        let (vapor, interface) = match self.ullage.model {
            UllageModel::ConstantTemperature => (GasPoint::default(), Interface::default()),
            UllageModel::EnergyBalance => {
                let n2o = NitrousVapor::tables();
                (n2o.at(vapor_kg / ullage_m3, gas.ullage_k), n2o.interface(gas.liquid_k))
            }
        };
        let regulator = &self.pressurant.regulator;
        let tank_pa = tank.pressure_pa + vapor.pressure_pa;
        let nitrogen = NitrogenState {
            tank_pa,
            bottle_pa: bottle.pressure_pa,
            tank_kg,
            bottle_kg,
            regulated: bottle.pressure_pa
                >= regulator.set_pressure_pa - stores.regulator_sag_pa + regulator.minimum_drop_pa
                && tank_pa <= regulator.greatest_pa(),
            vapor_kg,
            liquid_k: gas.liquid_k,
        };
        GasProperties { stores: *stores, nitrogen, ullage_m3, bottle, tank, vapor, interface }
    }

    /// How the stores change.
    pub fn rate(&self, properties: &GasProperties, out: &Withdrawal) -> StoresRate {
        let GasProperties { bottle, tank, vapor, .. } = properties;
        let state = &properties.stores.gas;
        let evaporation_kg_s = self.evaporation_kg_s(properties);
        let vapor_share = properties.vapor_share();
        let nitrogen_out_kg_s = (1.0 - vapor_share) * out.gas_kg_s;
        let vapor_out_kg_s = vapor_share * out.gas_kg_s;

        // Bottle: how its temperature and pressure answer to outflow and to heat.
        let bottle_m3 = self.pressurant.bottle.volume_m3;
        let bottle_kg = properties.nitrogen.bottle_kg;
        let bottle_j_k = bottle_kg.max(LEAST_KG) * bottle.energy_per_k;
        let (heat_w, cooling_j_kg) = match self.pressurant.bottle.model {
            BottleModel::Isothermal => (0.0, 0.0),
            BottleModel::EnergyBalance => {
                let wall = &self.pressurant.bottle;
                let most_w_k = bottle_j_k.min(wall.wall_heat_capacity_j_k) / SHORTEST_S;
                let density = bottle_kg / bottle_m3;
                (
                    wall.wall_conductance_w_k.min(most_w_k) * (state.wall_k - state.bottle_k),
                    bottle.enthalpy_j_kg - bottle.energy_j_kg - density * bottle.energy_per_density,
                )
            }
        };
        let bottle_pa_per_kg =
            bottle.pressure_per_density / bottle_m3 + bottle.pressure_per_k * cooling_j_kg / bottle_j_k;
        let bottle_pa_s = bottle.pressure_per_k * heat_w / bottle_j_k - bottle_pa_per_kg * out.thrusters_kg_s;

        // Ullage without the regulator, and what a unit of the regulator's flow does to it.
        let room_m3 = properties.ullage_m3;
        let room_m3_s = (out.liquid_kg_s + evaporation_kg_s) / self.liquid_kg_m3;
        let densities = [properties.nitrogen.tank_kg / room_m3, properties.nitrogen.vapor_kg / room_m3];
        let nitrogen_rate = (-nitrogen_out_kg_s - densities[0] * room_m3_s) / room_m3; // [kg/(m³ s)]
        let vapor_rate = (evaporation_kg_s - vapor_out_kg_s - densities[1] * room_m3_s) / room_m3;
        let tank_kg = properties.nitrogen.tank_kg.max(LEAST_KG);
        let vapor_kg = properties.nitrogen.vapor_kg;
        let ullage_j_k = tank_kg * tank.energy_per_k + vapor_kg * vapor.energy_per_k;
        let (to_gas_w, ullage_k_s, ullage_k_per_kg) = match self.ullage.model {
            UllageModel::ConstantTemperature => (0.0, 0.0, 0.0),
            UllageModel::EnergyBalance => {
                let conductance_w_k = self.ullage.heat_conductance_w_k.min(ullage_j_k / SHORTEST_S);
                let to_gas_w = conductance_w_k * (state.liquid_k - state.ullage_k);
                let surface = &properties.interface;
                let energy_w = to_gas_w - properties.nitrogen.tank_pa * room_m3_s
                    + evaporation_kg_s * (surface.vapor_enthalpy_j_kg - vapor.energy_j_kg)
                    - nitrogen_out_kg_s * (tank.enthalpy_j_kg - tank.energy_j_kg)
                    - vapor_out_kg_s * (vapor.enthalpy_j_kg - vapor.energy_j_kg)
                    - tank_kg * tank.energy_per_density * nitrogen_rate
                    - vapor_kg * vapor.energy_per_density * vapor_rate;
                let per_kg =
                    bottle.enthalpy_j_kg - tank.energy_j_kg - tank_kg * tank.energy_per_density / room_m3;
                (to_gas_w, energy_w / ullage_j_k, per_kg / ullage_j_k)
            }
        };
        let pressure_per_k = tank.pressure_per_k + vapor.pressure_per_k;
        let tank_pa_s = tank.pressure_per_density * nitrogen_rate
            + vapor.pressure_per_density * vapor_rate
            + pressure_per_k * ullage_k_s;
        let cold_pa_per_kg = tank.pressure_per_density / room_m3;
        // Nitrogen much colder than the gas it meets still raises the pressure.
        let tank_pa_per_kg = (cold_pa_per_kg + pressure_per_k * ullage_k_per_kg).max(0.1 * cold_pa_per_kg);

        let regulator_kg_s = self.pressurant.regulator.flow_kg_s(&Regulation {
            tank_pa: properties.nitrogen.tank_pa,
            tank_pa_s,
            tank_pa_per_kg,
            bottle_pa: properties.nitrogen.bottle_pa,
            bottle_pa_s,
            bottle_pa_per_kg,
            most_kg_s: bottle_kg / SHORTEST_S,
            sag_pa: properties.stores.regulator_sag_pa,
        });
        let from_bottle_kg_s = regulator_kg_s + out.thrusters_kg_s;

        // Liquid and shell give the heat of evaporation and the heat that goes into the gas.
        let liquid_k_s = match self.ullage.model {
            UllageModel::ConstantTemperature => 0.0,
            UllageModel::EnergyBalance => {
                let surface = &properties.interface;
                let capacity_j_k = properties.stores.nitrous_kg.max(0.0) * surface.liquid_energy_per_k
                    + self.ullage.shell_heat_capacity_j_k;
                let liquid_j_kg = self.liquid_enthalpy_j_kg(properties);
                (evaporation_kg_s * (liquid_j_kg - surface.vapor_enthalpy_j_kg) - to_gas_w) / capacity_j_k
            }
        };
        let bounded = |rate_k_s: f64, temperature_k: f64| {
            rate_k_s.clamp(-temperature_k / SHORTEST_S, temperature_k / SHORTEST_S)
        };
        StoresRate {
            nitrogen_kg_s: -nitrogen_out_kg_s - out.thrusters_kg_s,
            run_tank_kg_s: regulator_kg_s + evaporation_kg_s - out.gas_kg_s,
            total_kg_s: evaporation_kg_s - out.gas_kg_s - out.thrusters_kg_s,
            evaporation_kg_s,
            gas: GasState {
                bottle_kg: -from_bottle_kg_s,
                bottle_k: bounded((heat_w - from_bottle_kg_s * cooling_j_kg) / bottle_j_k, state.bottle_k),
                wall_k: -heat_w / self.pressurant.bottle.wall_heat_capacity_j_k,
                vapor_kg: evaporation_kg_s - vapor_out_kg_s,
                ullage_k: bounded(ullage_k_s + ullage_k_per_kg * regulator_kg_s, state.ullage_k),
                liquid_k: liquid_k_s,
            },
            enthalpy_out_w: out.liquid_kg_s * self.liquid_enthalpy_j_kg(properties)
                + nitrogen_out_kg_s * tank.enthalpy_j_kg
                + vapor_out_kg_s * vapor.enthalpy_j_kg
                + out.thrusters_kg_s * bottle.enthalpy_j_kg,
        }
    }

    /// The state clamped to the range of the tables, which integration may leave by a little.
    pub fn kept_in_range(&self, gas: &GasState, nitrogen_kg: f64) -> GasState {
        GasState {
            bottle_kg: gas.bottle_kg.clamp(0.0, nitrogen_kg.max(0.0)),
            bottle_k: gas.bottle_k.clamp(GAS_K.0, GAS_K.1),
            wall_k: gas.wall_k.clamp(GAS_K.0, GAS_K.1),
            vapor_kg: gas.vapor_kg.max(0.0),
            ullage_k: gas.ullage_k.clamp(GAS_K.0, GAS_K.1),
            liquid_k: gas.liquid_k.clamp(LIQUID_K.0, LIQUID_K.1),
        }
    }

    /// Energy of bottle, wall, ullage, liquid and shell (J).
    pub fn energy_j(&self, properties: &GasProperties) -> f64 {
        let gas = &properties.stores.gas;
        properties.nitrogen.bottle_kg * properties.bottle.energy_j_kg
            + self.pressurant.bottle.wall_heat_capacity_j_k * gas.wall_k
            + properties.nitrogen.tank_kg * properties.tank.energy_j_kg
            + properties.nitrogen.vapor_kg * properties.vapor.energy_j_kg
            + properties.stores.nitrous_kg * properties.interface.liquid_energy_j_kg
            + self.ullage.shell_heat_capacity_j_k * gas.liquid_k
    }

    /// Enthalpy of the liquid, incompressible at the density it was filled with (J/kg).
    fn liquid_enthalpy_j_kg(&self, properties: &GasProperties) -> f64 {
        properties.interface.liquid_energy_j_kg + properties.nitrogen.tank_pa / self.liquid_kg_m3
    }

    /// Vapour off the surface, and boiling where the vapour pressure exceeds the whole (kg/s).
    fn evaporation_kg_s(&self, properties: &GasProperties) -> f64 {
        if self.ullage.model == UllageModel::ConstantTemperature {
            return 0.0;
        }
        // Conductance at which the vapour reaches equilibrium in the shortest time.
        let r = NitrousVapor::tables().gas_constant_j_kg_k();
        let fastest = properties.ullage_m3 / (r * properties.stores.gas.ullage_k.max(1.0) * SHORTEST_S);
        let at_surface_pa = properties.interface.vapor_pressure_pa;
        let from_surface = self.ullage.vapor_conductance_kg_s_pa.min(fastest)
            * (at_surface_pa - properties.vapor.pressure_pa);
        let boiling = fastest * (at_surface_pa - properties.nitrogen.tank_pa).max(0.0);
        let most = properties.stores.nitrous_kg.max(0.0) / SHORTEST_S;
        (from_surface + boiling).clamp(-properties.nitrogen.vapor_kg / SHORTEST_S, most)
    }
}

/// Pressures on both sides of a regulator, and how they answer to its flow.
#[derive(Clone, Copy, Debug)]
pub(super) struct Regulation {
    tank_pa: f64,
    /// Rate of the tank's pressure without flow, and what flow adds to it (Pa/s, Pa/kg).
    tank_pa_s: f64,
    tank_pa_per_kg: f64,
    bottle_pa: f64,
    /// The same of the bottle; flow lowers it.
    bottle_pa_s: f64,
    bottle_pa_per_kg: f64,
    /// Flow that the bottle can give (kg/s).
    most_kg_s: f64,
    /// Outlet below the set pressure (Pa).
    sag_pa: f64,
}

impl Regulator {
    /// Flow (kg/s) at which the outlet approaches its own pressure with the response time; each case is one
    /// linear equation.
    fn flow_kg_s(&self, at: &Regulation) -> f64 {
        let per_s = 1.0 / self.response_time_s;
        let flow_toward = |outlet_pa: f64, fall_pa_s_kg: f64| {
            ((outlet_pa - at.tank_pa) * per_s - at.tank_pa_s) / (at.tank_pa_per_kg + fall_pa_s_kg * per_s)
        };
        let set_pa = self.set_pressure_pa - at.sag_pa;
        let mut flow_kg_s = flow_toward(set_pa, self.droop_pa_s_kg);
        if self.lockup_pa > 0.0 && flow_kg_s < self.lockup_flow_kg_s {
            let fall_pa_s_kg = self.droop_pa_s_kg + self.lockup_pa / self.lockup_flow_kg_s;
            flow_kg_s = flow_toward(set_pa + self.lockup_pa, fall_pa_s_kg);
        }
        let above_pa = at.bottle_pa - self.minimum_drop_pa - at.tank_pa;
        let blow_down_kg_s = (above_pa * per_s + at.bottle_pa_s - at.tank_pa_s)
            / (at.tank_pa_per_kg + at.bottle_pa_per_kg).max(f64::MIN_POSITIVE);
        flow_kg_s.min(blow_down_kg_s).min(at.most_kg_s).max(0.0)
    }
}
