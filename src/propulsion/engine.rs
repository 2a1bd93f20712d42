//! The engine as one function of plain values: valve area and tank in, flow, pressures and thrust out.
//!
//! One unknown, the pressure P2 between valve and injector. The valve gives a flow, the flow a chamber
//! pressure, and the injector must pass the same flow into it: the residual rises with P2.
//!
//! Source: the seed paper's Eqs 14 to 16, driven from the valve instead of the thrust.

use super::chamber::ChamberGas;
use super::combustion::CombustionMap;
use super::feed::FeedStores;
use super::feed_grid::Feed;
use super::feed_map::FeedMap;
use super::grain::Grain;
use super::injector::SinglePhase;
use super::nozzle::Nozzle;
use super::operating_point::{EngineCondition, OperatingPoint, WarmStart};
use super::parameters::{EngineParameters, FeedParameters, PaperMode};
use super::thrust_chamber::{InletRoot, ThrustChamber};
use super::valve::{ValveArea, ValveAreaError};
use crate::input::Invalid;
use crate::interpolate::{Bracket, RootStatus, bracketed_root, table::TableError};

/// Why an engine cannot be made of its parameters.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The propulsion map's table.
    #[error("propulsion map: {0}")]
    Map(TableError),
    /// The valve's area table.
    #[error("valve area: {0}")]
    ValveArea(TableError),
    /// Parameters that contradict each other; the key is relative to the vehicle file.
    #[error(transparent)]
    Parameter(#[from] Invalid),
}

impl From<ValveAreaError> for EngineError {
    fn from(error: ValveAreaError) -> Self {
        match error {
            ValveAreaError::Table(e) => Self::ValveArea(e),
            ValveAreaError::Parameter(e) => Self::Parameter(e),
        }
    }
}

/// Everything of the engine that does not change in flight.
#[derive(Clone, Debug)]
pub struct Engine {
    pub(super) thrust_chamber: ThrustChamber,
    pub(super) valve_area: ValveArea,
    pub(super) valve_discharge_coefficient: f64,
    valve_single_phase: SinglePhase,
    pub(super) injector_area_m2: f64,
    injector_single_phase: SinglePhase,
    pub(super) stores: FeedStores,
    pub(super) demand_kg_s: (f64, f64),
}

/// Texts of the CSV files that a vehicle file names.
#[derive(Clone, Copy, Debug)]
pub struct EngineTexts<'a> {
    /// `engine.map.file`.
    pub map: &'a str,
    /// `feed.valve.area_file`.
    pub valve_area: &'a str,
}

/// Accuracy of P2, relative to the tank's pressure: 6.5 mPa in 65 bar, 1e-6 N of thrust at most.
pub(super) const INLET_TOLERANCE: f64 = 1e-9;

impl Engine {
    /// From the tables of a vehicle file and the texts of the two CSV files they name.
    pub fn new(
        engine: &EngineParameters,
        feed: &FeedParameters,
        paper: &PaperMode,
        texts: EngineTexts<'_>,
    ) -> Result<Self, EngineError> {
        engine.grain.validate().map_err(|e| e.within("engine.grain"))?;
        let demand_kg_s = paper.demand_kg_s()?;
        let map =
            CombustionMap::read(texts.map, engine.map.reference_pressure_pa).map_err(EngineError::Map)?;
        paper.validate_of_range(map.of_span())?;
        let valve_area = ValveArea::read(texts.valve_area, &feed.valve)?;
        valve_area.validate(&feed.valve).map_err(|e| e.within("feed.valve"))?;
        let thrust_chamber = ThrustChamber::new(engine, map);
        thrust_chamber.require_rising_thrust(demand_kg_s)?;
        Ok(Self {
            thrust_chamber,
            valve_area,
            valve_discharge_coefficient: feed.valve.discharge_coefficient,
            valve_single_phase: feed.valve.single_phase,
            injector_area_m2: feed.injector.effective_area_m2(),
            injector_single_phase: feed.injector.single_phase,
            stores: FeedStores::new(&feed.manifold, feed.line.as_ref()),
            demand_kg_s,
        })
    }

    /// Open area of the valve against its angle.
    pub fn valve_area(&self) -> &ValveArea {
        &self.valve_area
    }

    /// Least and greatest oxidiser flow that a thrust demand may ask for (kg/s).
    pub fn demand_kg_s(&self) -> (f64, f64) {
        self.demand_kg_s
    }

    /// Mixture ratios between which the propulsion map has data; beyond, its ends hold.
    pub fn mapped_of_ratios(&self) -> (f64, f64) {
        self.thrust_chamber.map.of_span()
    }

    /// The fuel grain.
    pub fn grain(&self) -> &Grain {
        &self.thrust_chamber.grain
    }

    /// The nozzle.
    pub fn nozzle(&self) -> &Nozzle {
        &self.thrust_chamber.nozzle
    }

    /// Gas of a chamber at rest: unburnt, at ambient pressure.
    pub fn gas_at_rest(&self, condition: &EngineCondition) -> ChamberGas {
        self.thrust_chamber.gas_at_rest(condition)
    }

    /// The feed system of a tank, with this vehicle's orifices.
    pub fn feed_map(&self, tank_pa: f64, tank_k: f64) -> FeedMap {
        FeedMap::new(tank_pa, tank_k).with_single_phase(self.valve_single_phase, self.injector_single_phase)
    }

    /// The forward problem: what the engine does with this much valve area open.
    pub fn operating_point<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        valve_area_m2: f64,
        condition: &EngineCondition,
        warm_start: WarmStart,
    ) -> OperatingPoint {
        self.operating_point_inline(&feed.into(), valve_area_m2, condition, warm_start)
    }

    /// The same, inlined into the innermost caller: what that does not use is not computed.
    #[inline(always)]
    pub(crate) fn operating_point_inline(
        &self,
        feed: &Feed<'_>,
        valve_area_m2: f64,
        condition: &EngineCondition,
        warm_start: WarmStart,
    ) -> OperatingPoint {
        let at_condition = self.thrust_chamber.at_condition(condition);
        let mut chamber = warm_start.chamber;
        let filled = condition.chamber_gas.map(|gas| at_condition.filled_chamber(gas, &mut chamber));
        let least_pa = filled.as_ref().map_or(condition.ambient_pa, |filled| filled.pressure.pa);
        let tank_pa = feed.tank().pressure_pa;
        let valve_m2 = self.valve_discharge_coefficient * valve_area_m2;
        let injector_m2 = self.injector_m2(condition);
        let limit_kg_s = condition.oxidizer_flow_limit_kg_s;
        if !(valve_m2 > 0.0 && limit_kg_s > 0.0 && tank_pa > least_pa) {
            return at_condition.no_flow_point(filled, chamber);
        }

        let (mut oxidizer_kg_s, mut outlet_gas_kg_s) = (0.0, 0.0);
        let (mut quality, mut hot) = (0.0, None);
        // Flow that the injector would pass less flow that the valve gives: rises with P2.
        let balance = |inlet_pa: f64| {
            let state = feed.inlet(inlet_pa);
            let density_kg_m3 = state.state.density_kg_m3;
            let outlet = condition.outlet.as_ref();
            let valve_flux = match outlet {
                None => state.valve_flux_kg_m2_s,
                Some(outlet) => outlet.valve_flux(state.valve_flux_kg_m2_s, inlet_pa, density_kg_m3),
            };
            // Counted as liquid of the same volume; what it weighs once gas is in it comes after.
            let passed_kg_s = (valve_m2 * valve_flux).min(limit_kg_s);
            oxidizer_kg_s = passed_kg_s;
            if let Some(outlet) = outlet {
                let [liquid, gas] = outlet.masses(inlet_pa, density_kg_m3);
                outlet_gas_kg_s = gas * passed_kg_s;
                oxidizer_kg_s = liquid * passed_kg_s + outlet_gas_kg_s;
            }
            let chamber_pa = match &filled {
                Some(filled) => filled.pressure.pa,
                None => {
                    hot = at_condition.hot_flow_if_lit(oxidizer_kg_s, &mut chamber);
                    at_condition.mixed_pa(oxidizer_kg_s, hot.as_ref())
                }
            };
            let mut injector_flux = feed.injector_flux_kg_m2_s(&state, chamber_pa);
            quality = state.quality;
            if let Some(outlet) = outlet {
                injector_flux = outlet.injector_flux(injector_flux, (inlet_pa, chamber_pa), density_kg_m3);
                quality = outlet.quality(inlet_pa, density_kg_m3, state.quality);
            }
            injector_m2 * injector_flux - passed_kg_s
        };
        let bracket = Bracket {
            low: least_pa,
            high: tank_pa,
            guess: warm_start.injector_inlet_pa,
            slope: Some(warm_start.slope_kg_s_pa),
            tolerance: INLET_TOLERANCE * tank_pa,
        };
        let root = bracketed_root(bracket, balance);
        let inlet = InletRoot {
            injector_inlet_pa: root.x,
            quality,
            solved: root.status != RootStatus::Invalid,
            warm_start: WarmStart { injector_inlet_pa: root.x, slope_kg_s_pa: root.slope, chamber },
        };
        let mut point = match filled {
            Some(filled) => at_condition.filling_point(oxidizer_kg_s, &filled, inlet),
            None => at_condition.steady_point(oxidizer_kg_s, hot, inlet),
        };
        point.outlet_gas_kg_s = outlet_gas_kg_s;
        point
    }

    /// Area of the injector that is open, discharge coefficient included (m²).
    #[inline]
    pub(super) fn injector_m2(&self, condition: &EngineCondition) -> f64 {
        self.injector_area_m2 * (1.0 - condition.damage.injector_blocked_share)
    }
}
