//! The engine as one function of plain values: valve area and tank in, flow, pressures and thrust out.
//!
//! One unknown, the pressure P2 between valve and injector. The valve gives a flow, the flow a chamber
//! pressure, and the injector must pass the same flow into it: the residual rises with P2.
//!
//! Source: the seed paper's Eqs 5, 8, 10, 11, 14 to 16, driven from the valve instead of the thrust.

use core::f64::consts::PI;

use super::chamber::{
    Chamber, ChamberGas, ChamberGasRate, ColdGas, NearPressure, Vessel, held_pressure, steady_pressure,
};
use super::combustion::{CombustionMap, Mixture};
use super::feed_grid::Feed;
use super::grain::Grain;
use super::manifold::FeedStores;
use super::nozzle::{ChamberPressure, Nozzle, NozzleFlow, Throat};
use super::outlet::Outlet;
use super::valve::ValveArea;
use super::{EngineParameters, FeedParameters, PaperMode};
use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use crate::input::Invalid;
use crate::interpolate::{Anchor, Bracket, Power, RootStatus, bracketed_root, table::TableError};

/// What is reported of a mixture with hardly any fuel; far beyond every map.
const GREATEST_OF_RATIO: f64 = 1e6;

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

/// Everything of the engine that does not change in flight.
#[derive(Clone, Debug)]
pub struct Engine {
    pub(super) grain: Grain,
    regression: Power,
    pub(super) chamber: Chamber,
    nozzle: Nozzle,
    erosion: Power,
    cold_flow_isp_s: f64,
    cold: ColdGas,
    pub(super) map: CombustionMap,
    pub(super) valve_area: ValveArea,
    pub(super) valve_discharge_coefficient: f64,
    pub(super) injector_area_m2: f64,
    pub(super) stores: FeedStores,
    pub(super) demand_kg_s: (f64, f64),
    full_above: f64,
}

/// What the engine's answer depends on beside tank and valve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EngineCondition {
    /// Radius of the ports (m).
    pub port_radius_m: f64,
    /// Radius of the throat (m).
    pub throat_radius_m: f64,
    /// Share of the oxidiser that burns at the steady O/F, 0..1.
    pub burning_fraction: f64,
    /// Ambient pressure (Pa).
    pub ambient_pa: f64,
    /// Gas in the chamber, when that is a state; `None` is quasi-steady.
    pub chamber_gas: Option<ChamberGas>,
    /// Fuel that comes off the grain, when that lags the oxidiser and is a state (kg/s); `None` follows at once.
    pub fuel_flow_kg_s: Option<f64>,
    /// Flow that the tank's outlet can give (kg/s); infinite but in a depletion's tail.
    pub oxidizer_flow_limit_kg_s: f64,
    /// What the tank's outlet draws once liquid alone no longer covers it.
    pub outlet: Option<Outlet>,
    /// What is broken.
    pub damage: Damage,
}

/// What is broken in injector and chamber, as shares of what a sound engine has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damage {
    /// Share of the injector's area that is blocked: flux is what it was, area is not.
    pub injector_blocked_share: f64,
    /// Share of c* that is lost, on pressure and thrust.
    pub efficiency_drop_share: f64,
}

impl Damage {
    /// A sound engine.
    pub const NONE: Self = Self { injector_blocked_share: 0.0, efficiency_drop_share: 0.0 };
}

impl EngineCondition {
    /// All of the oxidiser burns, the chamber is quasi-steady, the fuel follows at once, and liquid covers the outlet.
    pub const fn burning(port_radius_m: f64, throat_radius_m: f64, ambient_pa: f64) -> Self {
        Self {
            port_radius_m,
            throat_radius_m,
            burning_fraction: 1.0,
            ambient_pa,
            chamber_gas: None,
            fuel_flow_kg_s: None,
            oxidizer_flow_limit_kg_s: f64::INFINITY,
            outlet: None,
            damage: Damage::NONE,
        }
    }
}

/// Where to look first; from the last answer. It changes the time an answer takes, and the answer within
/// the solver's tolerance only.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WarmStart {
    /// P2 (Pa).
    pub injector_inlet_pa: f64,
    /// Slope of the flow balance there (kg/(s Pa)).
    pub slope_kg_s_pa: f64,
    /// In the chamber.
    pub near: ChamberWarmStart,
}

/// What the chamber was like, so that what it is like now is a short way off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChamberWarmStart {
    /// Chamber pressure of what burns.
    pub pressure: NearPressure,
    /// Flux in the ports to the exponent of regression.
    pub regression: Anchor,
    /// Chamber pressure to the exponent of erosion.
    pub erosion: Anchor,
}

/// The engine's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatingPoint {
    /// What passes the injector (kg/s).
    pub oxidizer_kg_s: f64,
    /// What leaves the tank (kg/s): the same, unless something between them stores.
    pub tank_kg_s: f64,
    /// Of that, gas from above the liquid (kg/s).
    pub outlet_gas_kg_s: f64,
    /// Fuel off the grain (kg/s).
    pub fuel_kg_s: f64,
    /// Fuel flow to which a lagging one tends (kg/s); without a lag the same.
    pub steady_fuel_kg_s: f64,
    /// Flow out of the nozzle (kg/s).
    pub nozzle_kg_s: f64,
    /// Oxidiser over fuel, of the flow, or of the chamber's gas when that is a state; 0 without fuel.
    pub of_ratio: f64,
    /// Chamber pressure (Pa).
    pub chamber_pa: f64,
    /// Pressure between valve and injector, P2 (Pa).
    pub injector_inlet_pa: f64,
    /// Vapour mass fraction there.
    pub quality: f64,
    /// Thrust (N), never negative.
    pub thrust_n: f64,
    /// Thrust over weight flow of the nozzle (s); 0 without flow.
    pub isp_s: f64,
    /// Growth of the port radius (m/s).
    pub regression_rate_m_s: f64,
    /// Growth of the throat radius (m/s).
    pub throat_erosion_m_s: f64,
    /// Rate of the chamber's gas; zero when quasi-steady.
    pub chamber_gas_rate: ChamberGasRate,
    /// State of the nozzle's hot flow.
    pub nozzle_flow: NozzleFlow,
    /// Whether the root was found; without it the numbers are the best known.
    pub solved: bool,
    /// WarmStart for the next call.
    pub guess: WarmStart,
}

/// Accuracy of P2, relative to the tank's pressure: 6.5 mPa in 65 bar, 1e-6 N of thrust at most.
pub(super) const INLET_TOLERANCE: f64 = 1e-9;

/// Ambient pressure at which a map is checked (Pa).
const STANDARD_AMBIENT_PA: f64 = 101_325.0;

/// Quantities of one condition that every trial of the root shares.
pub(super) struct EngineAtCondition<'a> {
    pub(super) engine: &'a Engine,
    pub(super) condition: &'a EngineCondition,
    throat: Throat,
    /// Oxidiser flux in the ports per flow (1/m²).
    flux_per_flow_1_m2: f64,
    /// Area of the injector that is open, discharge coefficient included (m²).
    pub(super) injector_m2: f64,
    /// Fuel flow per flux to the exponent of regression.
    fuel_per_regression: f64,
    /// Pc per flow and c*: η/(A_t C_d).
    per_c_star: f64,
    /// The same of unburnt gas: 1/(A_t C_d).
    per_cold_c_star: f64,
}

/// Hot flow of some oxidiser, all of it burning at the steady O/F.
pub(super) struct Burning<'a> {
    fuel_kg_s: f64,
    of_ratio: f64,
    pub(super) mixture: Mixture<'a>,
    pub(super) pressure: ChamberPressure,
}

impl Engine {
    /// From the tables of a vehicle file and the texts of the two CSV files they name.
    pub fn new(
        engine: &EngineParameters,
        feed: &FeedParameters,
        paper: &PaperMode,
        texts: EngineTexts<'_>,
    ) -> Result<Self, EngineError> {
        engine.grain.validate().map_err(|e| e.within("engine.grain"))?;
        let demand_kg_s = (paper.oxidizer_flow_min_kg_s, paper.oxidizer_flow_max_kg_s);
        if demand_kg_s.0 >= demand_kg_s.1 {
            let message = format!(
                "{} kg/s is not above oxidizer_flow_min_kg_s = {} kg/s",
                demand_kg_s.1, demand_kg_s.0
            );
            return Err(Invalid::new("paper_mode.oxidizer_flow_max_kg_s", message).into());
        }
        let map =
            CombustionMap::read(texts.map, engine.map.reference_pressure_pa).map_err(EngineError::Map)?;
        super::paper::validate_range(paper, map.of_span())?;
        let valve_area = ValveArea::read(texts.valve_area, &feed.valve)?;
        valve_area.validate(&feed.valve).map_err(|e| e.within("feed.valve"))?;
        let engine = Self {
            grain: engine.grain.clone(),
            regression: Power::new(engine.grain.regression_exponent),
            chamber: engine.chamber.clone(),
            nozzle: engine.nozzle.clone(),
            erosion: Power::new(engine.nozzle.erosion_exponent),
            cold_flow_isp_s: engine.ignition.cold_flow_isp_s,
            cold: ColdGas { c_star_m_s: engine.ignition.cold_flow_c_star_m_s },
            full_above: engine.nozzle.surely_full_above(map.gamma_span()),
            map,
            valve_area,
            valve_discharge_coefficient: feed.valve.discharge_coefficient,
            injector_area_m2: feed.injector.effective_area_m2(),
            stores: FeedStores::new(feed),
            demand_kg_s,
        };
        engine.require_rising_thrust()?;
        Ok(engine)
    }

    /// Thrust must rise with the flow over the whole range of demands, fresh and nearly burnt through.
    fn require_rising_thrust(&self) -> Result<(), Invalid> {
        const SAMPLES: u32 = 200;
        let (least, most) = self.demand_kg_s;
        for port_radius_m in [self.grain.port_radius_m, self.grain.burn_through_radius_m()] {
            let condition =
                EngineCondition::burning(port_radius_m, self.nozzle.throat_radius_m(), STANDARD_AMBIENT_PA);
            let at_condition = self.at_condition(&condition);
            let mut near = ChamberWarmStart::default();
            let mut before_n = 0.0;
            for i in 0..=SAMPLES {
                let flow_kg_s = least + (most - least) * f64::from(i) / f64::from(SAMPLES);
                let hot = at_condition.burning(flow_kg_s, &mut near);
                let (thrust_n, _) = at_condition.thrust(flow_kg_s, &hot);
                if thrust_n <= before_n {
                    let of = hot.of_ratio;
                    let message = format!(
                        "thrust does not rise with oxidiser flow near {flow_kg_s} kg/s \
                         (port radius {port_radius_m} m, O/F {of:.3}): a thrust would have no one valve angle"
                    );
                    return Err(Invalid::new("engine.map.file", message));
                }
                before_n = thrust_n;
            }
        }
        Ok(())
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
        self.map.of_span()
    }

    /// The fuel grain.
    pub fn grain(&self) -> &Grain {
        &self.grain
    }

    /// The nozzle.
    pub fn nozzle(&self) -> &Nozzle {
        &self.nozzle
    }

    /// Combustion products.
    pub(super) fn map(&self) -> &CombustionMap {
        &self.map
    }

    /// Growth of the throat (m/s) at a chamber pressure.
    pub(super) fn erosion_m_s(&self, condition: &EngineCondition, chamber_pa: f64) -> f64 {
        self.at_condition(condition).erosion_m_s(chamber_pa, &mut ChamberWarmStart::default())
    }

    /// The engine without flow, quasi-steady.
    pub(super) fn at_rest(&self, ambient_pa: f64) -> OperatingPoint {
        let condition = EngineCondition {
            port_radius_m: self.grain.port_radius_m,
            throat_radius_m: self.nozzle.throat_radius_m(),
            burning_fraction: 0.0,
            ambient_pa,
            chamber_gas: None,
            fuel_flow_kg_s: None,
            oxidizer_flow_limit_kg_s: 0.0,
            outlet: None,
            damage: Damage::NONE,
        };
        self.at_condition(&condition).closed(None, ChamberWarmStart::default())
    }

    /// Gas of a chamber at rest: unburnt, at ambient pressure.
    pub fn gas_at_rest(&self, condition: &EngineCondition) -> ChamberGas {
        let volume_m3 = self.chamber.dead_volume_m3 + self.grain.port_volume_m3(condition.port_radius_m);
        let oxidizer_kg = condition.ambient_pa * volume_m3 / self.cold.gas_constant_temperature_j_kg();
        ChamberGas { oxidizer_kg, fuel_kg: 0.0 }
    }

    /// The forward problem: what the engine does with this much valve area open.
    pub fn operating_point<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        valve_area_m2: f64,
        condition: &EngineCondition,
        guess: WarmStart,
    ) -> OperatingPoint {
        self.operating_point_inline(&feed.into(), valve_area_m2, condition, guess)
    }

    /// The same for the innermost caller, which computes nothing of it that it does not use.
    #[inline(always)]
    pub fn operating_point_inline(
        &self,
        feed: &Feed<'_>,
        valve_area_m2: f64,
        condition: &EngineCondition,
        guess: WarmStart,
    ) -> OperatingPoint {
        let at_condition = self.at_condition(condition);
        let mut near = guess.near;
        let held = condition.chamber_gas.map(|gas| at_condition.held(gas, &mut near));
        let least_pa = held.as_ref().map_or(condition.ambient_pa, |held| held.pressure.pa);
        let tank_pa = feed.tank().pressure_pa;
        let valve_m2 = self.valve_discharge_coefficient * valve_area_m2;
        let limit_kg_s = condition.oxidizer_flow_limit_kg_s;
        if !(valve_m2 > 0.0 && limit_kg_s > 0.0 && tank_pa > least_pa) {
            return at_condition.closed(held, near);
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
            let chamber_pa = match &held {
                Some(held) => held.pressure.pa,
                None => {
                    hot = at_condition.burning_share_of(oxidizer_kg_s, &mut near);
                    at_condition.mixed_pa(oxidizer_kg_s, hot.as_ref())
                }
            };
            let mut injector_flux = feed.injector_flux_kg_m2_s(&state, chamber_pa);
            quality = state.quality;
            if let Some(outlet) = outlet {
                injector_flux = outlet.injector_flux(injector_flux, (inlet_pa, chamber_pa), density_kg_m3);
                quality = outlet.quality(inlet_pa, density_kg_m3, state.quality);
            }
            at_condition.injector_m2 * injector_flux - passed_kg_s
        };
        let bracket = Bracket {
            low: least_pa,
            high: tank_pa,
            guess: guess.injector_inlet_pa,
            slope: Some(guess.slope_kg_s_pa),
            tolerance: INLET_TOLERANCE * tank_pa,
        };
        let root = bracketed_root(bracket, balance);
        let next = WarmStart { injector_inlet_pa: root.x, slope_kg_s_pa: root.slope, near };
        let found = InletRoot {
            injector_inlet_pa: root.x,
            quality,
            solved: root.status != RootStatus::Invalid,
            guess: next,
        };
        let mut point = match held {
            Some(held) => at_condition.filling_point(oxidizer_kg_s, &held, found),
            None => at_condition.steady_point(oxidizer_kg_s, hot, found),
        };
        point.outlet_gas_kg_s = outlet_gas_kg_s;
        point
    }

    /// Throat area times discharge coefficient (m²).
    pub(super) fn open_throat_m2(&self, condition: &EngineCondition) -> f64 {
        let radius_m = condition.throat_radius_m.min(self.nozzle.greatest_throat_radius_m());
        PI * radius_m * radius_m * self.nozzle.discharge_coefficient
    }

    /// Efficiency of c*, damage included.
    #[inline]
    pub(super) fn c_star_efficiency(&self, condition: &EngineCondition) -> f64 {
        self.chamber.c_star_efficiency * (1.0 - condition.damage.efficiency_drop_share)
    }

    #[inline(always)]
    pub(super) fn at_condition<'a>(&'a self, condition: &'a EngineCondition) -> EngineAtCondition<'a> {
        let nozzle = &self.nozzle;
        let throat_radius_m = condition.throat_radius_m.min(nozzle.greatest_throat_radius_m());
        let area_m2 = PI * throat_radius_m * throat_radius_m;
        let fresh = throat_radius_m >= nozzle.throat_radius_m() * (1.0 - 1e-12);
        let port_radius_m = condition.port_radius_m.min(self.grain.burn_through_radius_m());
        let per_cold_c_star = 1.0 / (area_m2 * nozzle.discharge_coefficient);
        EngineAtCondition {
            engine: self,
            condition,
            throat: Throat {
                area_m2,
                exit_area_m2: nozzle.exit_area_m2(),
                ambient_pa: condition.ambient_pa,
                full_above: if fresh { self.full_above } else { f64::INFINITY },
            },
            flux_per_flow_1_m2: self.grain.flux_per_flow_1_m2(port_radius_m),
            fuel_per_regression: self.grain.fuel_per_regression_kg_m(port_radius_m)
                * self.grain.coefficient_si(),
            injector_m2: self.injector_area_m2 * (1.0 - condition.damage.injector_blocked_share),
            per_c_star: self.c_star_efficiency(condition) * per_cold_c_star,
            per_cold_c_star,
        }
    }
}

/// Texts of the CSV files that a vehicle file names.
#[derive(Clone, Copy, Debug)]
pub struct EngineTexts<'a> {
    /// `engine.map.file`.
    pub map: &'a str,
    /// `feed.valve.area_file`.
    pub valve_area: &'a str,
}

/// What the root in P2 has found.
pub(super) struct InletRoot {
    pub(super) injector_inlet_pa: f64,
    pub(super) quality: f64,
    pub(super) solved: bool,
    pub(super) guess: WarmStart,
}

/// State of a chamber whose gas is given.
pub(super) struct FilledChamber<'a> {
    gas: ChamberGas,
    of_ratio: f64,
    mixture: Mixture<'a>,
    pub(super) pressure: ChamberPressure,
    nozzle_kg_s: f64,
}

impl<'a> EngineAtCondition<'a> {
    /// Steady state of an oxidiser flow that burns altogether.
    #[inline(always)]
    pub(super) fn burning(&self, oxidizer_kg_s: f64, near: &mut ChamberWarmStart) -> Burning<'a> {
        let fuel_kg_s = match self.condition.fuel_flow_kg_s {
            None => self.steady_fuel_kg_s(oxidizer_kg_s, near),
            Some(flow_kg_s) => self.lagged_fuel_kg_s(flow_kg_s, oxidizer_kg_s),
        };
        let of_ratio = oxidizer_kg_s / fuel_kg_s;
        let mixture = self.engine.map.mixture(of_ratio);
        let per_c_star = (oxidizer_kg_s + fuel_kg_s) * self.per_c_star;
        let ambient_pa = self.condition.ambient_pa;
        let pressure =
            steady_pressure(&self.engine.map, &mixture, per_c_star, ambient_pa, &mut near.pressure);
        Burning { fuel_kg_s, of_ratio, mixture, pressure }
    }

    /// Fuel flow of oxidiser that burns altogether, Eq (5R) as surface times rate of regression.
    #[inline]
    pub(super) fn steady_fuel_kg_s(&self, oxidizer_kg_s: f64, near: &mut ChamberWarmStart) -> f64 {
        let flux = oxidizer_kg_s * self.flux_per_flow_1_m2;
        self.fuel_per_regression * self.engine.regression.of(flux, &mut near.regression)
    }

    /// Pressure of unburnt flow.
    fn cold_pa(&self, oxidizer_kg_s: f64) -> f64 {
        (self.engine.cold.c_star_m_s * oxidizer_kg_s * self.per_cold_c_star).max(self.condition.ambient_pa)
    }

    /// Chamber pressure of a flow.
    pub(super) fn chamber_pa(&self, oxidizer_kg_s: f64, near: &mut ChamberWarmStart) -> f64 {
        let hot = self.burning_share_of(oxidizer_kg_s, near);
        self.mixed_pa(oxidizer_kg_s, hot.as_ref())
    }

    /// The burning flow if anything burns.
    #[inline(always)]
    pub(super) fn burning_share_of(
        &self,
        oxidizer_kg_s: f64,
        near: &mut ChamberWarmStart,
    ) -> Option<Burning<'a>> {
        (oxidizer_kg_s > 0.0 && self.condition.burning_fraction > 0.0)
            .then(|| self.burning(oxidizer_kg_s, near))
    }

    /// Pressure of a flow of which some burns and the rest does not.
    #[inline]
    pub(super) fn mixed_pa(&self, oxidizer_kg_s: f64, hot: Option<&Burning<'_>>) -> f64 {
        let f = self.condition.burning_fraction;
        match hot {
            None => self.cold_pa(oxidizer_kg_s),
            Some(hot) if f >= 1.0 => hot.pressure.pa,
            Some(hot) => f * hot.pressure.pa + (1.0 - f) * self.cold_pa(oxidizer_kg_s),
        }
    }

    /// Thrust and nozzle state of an oxidiser flow, with the pressure it has.
    pub(super) fn thrust(&self, oxidizer_kg_s: f64, hot: &Burning<'_>) -> (f64, NozzleFlow) {
        let f = self.condition.burning_fraction.clamp(0.0, 1.0);
        let (hot_n, flow) = self.engine.nozzle.thrust(&self.throat, &hot.mixture, hot.pressure);
        let cold_n = STANDARD_GRAVITY_M_S2 * self.engine.cold_flow_isp_s * oxidizer_kg_s;
        (f * hot_n + (1.0 - f) * cold_n, flow)
    }

    /// Whether fuel is left at this port radius.
    fn fuel_left(&self) -> bool {
        self.condition.port_radius_m < self.engine.grain.burn_through_radius_m()
    }

    /// Share of the fuel flow that burns off the grain.
    pub(super) fn burning_share(&self) -> f64 {
        if self.fuel_left() { self.condition.burning_fraction.clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Growth of the throat: hot flow erodes, cold flow does not.
    #[inline]
    fn erosion_m_s(&self, chamber_pa: f64, near: &mut ChamberWarmStart) -> f64 {
        let nozzle = &self.engine.nozzle;
        if self.condition.throat_radius_m >= nozzle.greatest_throat_radius_m()
            || nozzle.erosion_rate_m_s == 0.0
        {
            return 0.0;
        }
        let share = self.engine.erosion.of(chamber_pa / nozzle.erosion_pressure_pa, &mut near.erosion);
        self.condition.burning_fraction.clamp(0.0, 1.0) * nozzle.erosion_rate_m_s * share
    }

    fn regression_m_s(&self, fuel_kg_s: f64) -> f64 {
        fuel_kg_s / self.engine.grain.fuel_per_regression_kg_m(self.condition.port_radius_m)
    }

    #[inline(always)]
    pub(super) fn steady_point(
        &self,
        oxidizer_kg_s: f64,
        hot: Option<Burning<'_>>,
        found: InletRoot,
    ) -> OperatingPoint {
        let mut guess = found.guess;
        if oxidizer_kg_s <= 0.0 {
            return self.closed(None, guess.near);
        }
        let chamber_pa = self.mixed_pa(oxidizer_kg_s, hot.as_ref());
        let hot = hot.unwrap_or_else(|| self.burning(oxidizer_kg_s, &mut guess.near));
        let f = self.condition.burning_fraction.clamp(0.0, 1.0);
        let (thrust_n, nozzle_flow) = self.thrust(oxidizer_kg_s, &hot);
        let share = self.burning_share();
        let fuel_kg_s = share * hot.fuel_kg_s;
        let lags = self.condition.fuel_flow_kg_s.is_some();
        let nozzle_kg_s = oxidizer_kg_s + fuel_kg_s;
        OperatingPoint {
            oxidizer_kg_s,
            tank_kg_s: oxidizer_kg_s,
            outlet_gas_kg_s: 0.0,
            fuel_kg_s,
            steady_fuel_kg_s: if lags {
                share * self.steady_fuel_kg_s(oxidizer_kg_s, &mut guess.near)
            } else {
                fuel_kg_s
            },
            nozzle_kg_s,
            of_ratio: if f >= 1.0 && fuel_kg_s > 0.0 {
                hot.of_ratio
            } else {
                ratio(oxidizer_kg_s, fuel_kg_s)
            },
            chamber_pa,
            injector_inlet_pa: found.injector_inlet_pa,
            quality: found.quality,
            thrust_n,
            isp_s: thrust_n / (STANDARD_GRAVITY_M_S2 * nozzle_kg_s),
            regression_rate_m_s: self.regression_m_s(fuel_kg_s),
            throat_erosion_m_s: self.erosion_m_s(chamber_pa, &mut guess.near),
            chamber_gas_rate: ChamberGasRate::default(),
            nozzle_flow,
            solved: found.solved,
            guess,
        }
    }

    /// Pressure and outflow of the gas in the chamber.
    #[inline(never)]
    pub(super) fn held(&self, gas: ChamberGas, near: &mut ChamberWarmStart) -> FilledChamber<'a> {
        let engine = self.engine;
        let (oxidizer_kg, fuel_kg) = (gas.oxidizer_kg.max(0.0), gas.fuel_kg.max(0.0));
        let burning_fraction = self.condition.burning_fraction.clamp(0.0, 1.0);
        // Of the oxidiser only the burning share takes part; without fuel the map's lean end stands in.
        let lean = engine.map.of_span().1;
        // A last trace of fuel would make the ratio infinite.
        let of_ratio = if fuel_kg > 0.0 {
            (burning_fraction * oxidizer_kg / fuel_kg).min(GREATEST_OF_RATIO)
        } else {
            lean
        };
        let mixture = engine.map.mixture(of_ratio.min(lean));
        let vessel = Vessel {
            volume_m3: engine.chamber.dead_volume_m3
                + engine.grain.port_volume_m3(self.condition.port_radius_m),
            c_star_efficiency: engine.c_star_efficiency(self.condition),
            discharge_coefficient: engine.nozzle.discharge_coefficient,
            burning_fraction,
            cold: engine.cold,
        };
        let total_kg = oxidizer_kg + fuel_kg;
        let held = held_pressure(&engine.map, &mixture, total_kg, &vessel, &self.throat, &mut near.pressure);
        FilledChamber {
            gas: ChamberGas { oxidizer_kg, fuel_kg },
            of_ratio: ratio(oxidizer_kg, fuel_kg),
            mixture,
            pressure: held.pressure,
            nozzle_kg_s: held.nozzle_kg_s,
        }
    }

    #[inline(never)]
    pub(super) fn filling_point(
        &self,
        oxidizer_kg_s: f64,
        held: &FilledChamber<'_>,
        found: InletRoot,
    ) -> OperatingPoint {
        let f = self.condition.burning_fraction.clamp(0.0, 1.0);
        let mut guess = found.guess;
        let share = self.burning_share();
        let steady_fuel_kg_s = share * self.steady_fuel_kg_s(oxidizer_kg_s.max(0.0), &mut guess.near);
        let fuel_kg_s = match self.condition.fuel_flow_kg_s {
            None => steady_fuel_kg_s,
            Some(flow_kg_s) => share * self.lagged_fuel_kg_s(flow_kg_s, oxidizer_kg_s),
        };
        let (hot_n, nozzle_flow) = self.engine.nozzle.thrust(&self.throat, &held.mixture, held.pressure);
        let cold_n = STANDARD_GRAVITY_M_S2 * self.engine.cold_flow_isp_s * held.nozzle_kg_s;
        let thrust_n = if held.nozzle_kg_s > 0.0 { f * hot_n + (1.0 - f) * cold_n } else { 0.0 };
        let total_kg = held.gas.oxidizer_kg + held.gas.fuel_kg;
        let out_1_s = if total_kg > 0.0 { held.nozzle_kg_s / total_kg } else { 0.0 };
        let burns = held.nozzle_kg_s > 0.0;
        OperatingPoint {
            oxidizer_kg_s,
            tank_kg_s: oxidizer_kg_s,
            outlet_gas_kg_s: 0.0,
            fuel_kg_s,
            steady_fuel_kg_s,
            nozzle_kg_s: held.nozzle_kg_s,
            of_ratio: held.of_ratio,
            chamber_pa: held.pressure.pa,
            injector_inlet_pa: found.injector_inlet_pa,
            quality: found.quality,
            thrust_n,
            isp_s: if burns { thrust_n / (STANDARD_GRAVITY_M_S2 * held.nozzle_kg_s) } else { 0.0 },
            regression_rate_m_s: self.regression_m_s(fuel_kg_s),
            throat_erosion_m_s: if burns { self.erosion_m_s(held.pressure.pa, &mut guess.near) } else { 0.0 },
            chamber_gas_rate: ChamberGasRate {
                oxidizer_kg_s: oxidizer_kg_s - out_1_s * held.gas.oxidizer_kg,
                fuel_kg_s: fuel_kg_s - out_1_s * held.gas.fuel_kg,
            },
            nozzle_flow: if burns { nozzle_flow } else { NozzleFlow::Off },
            solved: found.solved,
            guess,
        }
    }

    /// No oxidiser flows; a chamber that still holds gas empties.
    pub(super) fn closed(&self, held: Option<FilledChamber<'_>>, near: ChamberWarmStart) -> OperatingPoint {
        let ambient_pa = self.condition.ambient_pa;
        if let Some(held) = held {
            let guess = WarmStart { near, ..WarmStart::default() };
            let found = InletRoot { injector_inlet_pa: held.pressure.pa, quality: 0.0, solved: true, guess };
            return self.filling_point(0.0, &held, found);
        }
        OperatingPoint {
            oxidizer_kg_s: 0.0,
            tank_kg_s: 0.0,
            outlet_gas_kg_s: 0.0,
            fuel_kg_s: 0.0,
            steady_fuel_kg_s: 0.0,
            nozzle_kg_s: 0.0,
            of_ratio: 0.0,
            chamber_pa: ambient_pa,
            injector_inlet_pa: ambient_pa,
            quality: 0.0,
            thrust_n: 0.0,
            isp_s: 0.0,
            regression_rate_m_s: 0.0,
            throat_erosion_m_s: 0.0,
            chamber_gas_rate: ChamberGasRate::default(),
            nozzle_flow: NozzleFlow::Off,
            solved: true,
            guess: WarmStart { near, ..WarmStart::default() },
        }
    }
}

/// Quotient that is 0 where it has no meaning.
fn ratio(oxidizer: f64, fuel: f64) -> f64 {
    if fuel > 0.0 { (oxidizer / fuel).min(GREATEST_OF_RATIO) } else { 0.0 }
}
