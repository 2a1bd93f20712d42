//! The gas in bottle and run tank, by either of two models: constant temperature, or balances of mass and
//! energy.

use super::file::VehicleFile;
use crate::propulsion::{
    BottleModel, DepletionModel, GasBalance, GasProperties, NitrogenState, Stores, UllageModel,
};

/// How the gas in bottle and tank is modelled: chosen once, by `GasModel::of`.
#[derive(Clone, Debug)]
pub enum GasModel {
    /// Every option is the simple one: one mass of nitrogen, distributed by algebra at constant temperature.
    Isothermal,
    /// Any option is not: masses and temperatures are states.
    EnergyBalance(Box<GasBalance>),
}

/// Bottle and tank at one instant, by either model.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant)] // lives on the stack for one evaluation
pub enum GasSupply {
    /// Distributed by algebra at constant temperature.
    Isothermal(NitrogenState),
    /// From masses and temperatures that are states.
    EnergyBalance(GasProperties),
}

impl GasModel {
    /// `Isothermal` if every option is the simple one, else `EnergyBalance`.
    pub(super) fn of(file: &VehicleFile, liquid_kg_m3: f64) -> Self {
        let (tank, regulator) = (&file.feed.tank, &file.pressurant.regulator);
        let isothermal = file.pressurant.bottle.model == BottleModel::Isothermal
            && tank.ullage.model == UllageModel::ConstantTemperature
            && regulator.droop_pa_s_kg == 0.0
            && regulator.lockup_pa == 0.0
            && regulator.set_pressure_pa == tank.pressure_pa
            && file.engine.depletion.model == DepletionModel::TimeConstant;
        if isothermal {
            return Self::Isothermal;
        }
        Self::EnergyBalance(Box::new(GasBalance::new(&file.pressurant, tank, liquid_kg_m3)))
    }
}

impl GasSupply {
    /// Pressures and masses.
    pub fn nitrogen(&self) -> &NitrogenState {
        match self {
            Self::Isothermal(nitrogen) => nitrogen,
            Self::EnergyBalance(view) => &view.nitrogen,
        }
    }

    /// Mass share of vapour in the gas above the liquid.
    #[inline]
    pub(crate) fn vapor_share(&self) -> f64 {
        match self {
            Self::Isothermal(_) => 0.0,
            Self::EnergyBalance(view) => view.vapor_share(),
        }
    }

    /// Shares of what thrusters and vent want (kg/s) that are there, where each takes `drain_s` at least to
    /// empty its store; 1 or above, or no number, where there is plenty.
    #[inline]
    pub(crate) fn available_fractions(
        &self,
        stores: &Stores,
        wanted_kg_s: [f64; 2],
        drain_s: f64,
    ) -> [f64; 2] {
        let [thrusters, vent] = wanted_kg_s;
        match self {
            Self::Isothermal(_) => [stores.nitrogen_kg.max(0.0) / (drain_s * (thrusters + vent)); 2],
            Self::EnergyBalance(view) => {
                let NitrogenState { tank_kg, vapor_kg, bottle_kg, .. } = view.nitrogen;
                [bottle_kg / (drain_s * thrusters), (tank_kg + vapor_kg) / (drain_s * vent)]
            }
        }
    }
}
