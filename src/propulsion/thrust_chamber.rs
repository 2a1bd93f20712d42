//! The thrust chamber, from the injector's face to the nozzle's exit: oxidiser flow in, pressure and thrust
//! out.
//!
//! Grain, combustion chamber and nozzle as one. In a steady chamber the oxidiser flow sets the fuel flow,
//! both set the mixture, and the mixture sets pressure and thrust. Where the chamber's gas is a state,
//! pressure, thrust and nozzle flow follow from that gas, and the oxidiser flow changes it. Where only a
//! share of the flow burns, the rest passes cold: pressure and thrust of both are weighed by the burning
//! fraction.
//!
//! Source: the seed paper's Eqs 5, 8, 10, 11; each part names its own.

use core::f64::consts::PI;

use super::chamber::{
    Chamber, ChamberGas, ChamberGasRate, ColdGas, Vessel, filling_pressure, steady_pressure,
};
use super::combustion::{CombustionMap, Mixture};
use super::grain::Grain;
use super::nozzle::{ChamberPressure, Nozzle, NozzleFlow, Throat};
use super::operating_point::{ChamberWarmStart, EngineCondition, OperatingPoint, WarmStart};
use super::parameters::EngineParameters;
use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use crate::input::Invalid;
use crate::interpolate::Power;

/// What is reported of a mixture with hardly any fuel; far beyond every map.
const GREATEST_OF_RATIO: f64 = 1e6;
/// Ambient pressure at which a map is checked (Pa).
const STANDARD_AMBIENT_PA: f64 = 101_325.0;

/// Everything behind the injector that does not change in flight.
#[derive(Clone, Debug)]
pub(super) struct ThrustChamber {
    pub(super) grain: Grain,
    regression: Power,
    pub(super) chamber: Chamber,
    pub(super) nozzle: Nozzle,
    erosion: Power,
    cold_flow_isp_s: f64,
    cold: ColdGas,
    full_above: f64,
    pub(super) map: CombustionMap,
}

/// The thrust chamber at one condition: what every trial of a root shares.
pub(super) struct ThrustChamberAtCondition<'a> {
    thrust_chamber: &'a ThrustChamber,
    pub(super) condition: &'a EngineCondition,
    throat: Throat,
    /// Oxidiser flux in the ports per flow (1/m²).
    flux_per_flow_1_m2: f64,
    /// Fuel flow per flux to the exponent of regression.
    fuel_per_regression: f64,
    /// Pc per flow and c*: η/(A_t C_d).
    per_c_star: f64,
    /// The same of unburnt gas: 1/(A_t C_d).
    per_cold_c_star: f64,
}

/// Steady flow of which all oxidiser burns.
pub(super) struct HotFlow<'a> {
    fuel_kg_s: f64,
    of_ratio: f64,
    pub(super) mixture: Mixture<'a>,
    pub(super) pressure: ChamberPressure,
}

/// A chamber whose gas is given, and what leaves it.
pub(super) struct FilledChamber<'a> {
    gas: ChamberGas,
    of_ratio: f64,
    mixture: Mixture<'a>,
    pub(super) pressure: ChamberPressure,
    nozzle_kg_s: f64,
}

/// State before the injector: the root of the flow balance in P2.
pub(super) struct InletRoot {
    pub(super) injector_inlet_pa: f64,
    pub(super) quality: f64,
    pub(super) solved: bool,
    pub(super) warm_start: WarmStart,
}

impl ThrustChamber {
    pub(super) fn new(engine: &EngineParameters, map: CombustionMap) -> Self {
        Self {
            grain: engine.grain.clone(),
            regression: Power::new(engine.grain.regression_exponent),
            chamber: engine.chamber.clone(),
            nozzle: engine.nozzle.clone(),
            erosion: Power::new(engine.nozzle.erosion_exponent),
            cold_flow_isp_s: engine.ignition.cold_flow_isp_s,
            cold: ColdGas { c_star_m_s: engine.ignition.cold_flow_c_star_m_s },
            full_above: engine.nozzle.surely_full_above(map.gamma_span()),
            map,
        }
    }

    /// Thrust must rise with the flow over the whole range of demands (kg/s), fresh and nearly burnt through.
    pub(super) fn require_rising_thrust(&self, (least, most): (f64, f64)) -> Result<(), Invalid> {
        const SAMPLES: u32 = 200;
        for port_radius_m in [self.grain.port_radius_m, self.grain.burn_through_radius_m()] {
            let condition =
                EngineCondition::burning(port_radius_m, self.nozzle.throat_radius_m(), STANDARD_AMBIENT_PA);
            let at_condition = self.at_condition(&condition);
            let mut warm_start = ChamberWarmStart::default();
            let mut before_n = 0.0;
            for i in 0..=SAMPLES {
                let flow_kg_s = least + (most - least) * f64::from(i) / f64::from(SAMPLES);
                let hot = at_condition.hot_flow(flow_kg_s, &mut warm_start);
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

    /// Gas of a chamber at rest: unburnt, at ambient pressure.
    pub(super) fn gas_at_rest(&self, condition: &EngineCondition) -> ChamberGas {
        let volume_m3 = self.gas_volume_m3(condition);
        let oxidizer_kg = condition.ambient_pa * volume_m3 / self.cold.gas_constant_temperature_j_kg();
        ChamberGas { oxidizer_kg, fuel_kg: 0.0 }
    }

    /// Volume of the chamber's gas (m³), ports included.
    pub(super) fn gas_volume_m3(&self, condition: &EngineCondition) -> f64 {
        self.chamber.dead_volume_m3 + self.grain.port_volume_m3(condition.port_radius_m)
    }

    /// Growth of the throat (m/s) at a chamber pressure.
    pub(super) fn erosion_m_s(&self, condition: &EngineCondition, chamber_pa: f64) -> f64 {
        self.at_condition(condition).erosion_m_s(chamber_pa, &mut ChamberWarmStart::default())
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
    pub(super) fn at_condition<'a>(&'a self, condition: &'a EngineCondition) -> ThrustChamberAtCondition<'a> {
        let nozzle = &self.nozzle;
        let throat_radius_m = condition.throat_radius_m.min(nozzle.greatest_throat_radius_m());
        let area_m2 = PI * throat_radius_m * throat_radius_m;
        let fresh = throat_radius_m >= nozzle.throat_radius_m() * (1.0 - 1e-12);
        let port_radius_m = condition.port_radius_m.min(self.grain.burn_through_radius_m());
        let per_cold_c_star = 1.0 / (area_m2 * nozzle.discharge_coefficient);
        ThrustChamberAtCondition {
            thrust_chamber: self,
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
            per_c_star: self.c_star_efficiency(condition) * per_cold_c_star,
            per_cold_c_star,
        }
    }
}

impl<'a> ThrustChamberAtCondition<'a> {
    /// Steady state of an oxidiser flow of which all burns.
    #[inline(always)]
    pub(super) fn hot_flow(&self, oxidizer_kg_s: f64, warm_start: &mut ChamberWarmStart) -> HotFlow<'a> {
        let fuel_kg_s = match self.condition.fuel_flow_kg_s {
            None => self.steady_fuel_kg_s(oxidizer_kg_s, warm_start),
            Some(flow_kg_s) => self.lagged_fuel_kg_s(flow_kg_s, oxidizer_kg_s),
        };
        let of_ratio = oxidizer_kg_s / fuel_kg_s;
        let map = &self.thrust_chamber.map;
        let mixture = map.mixture(of_ratio);
        let per_c_star = (oxidizer_kg_s + fuel_kg_s) * self.per_c_star;
        let ambient_pa = self.condition.ambient_pa;
        let pressure = steady_pressure(map, &mixture, per_c_star, ambient_pa, &mut warm_start.pressure);
        HotFlow { fuel_kg_s, of_ratio, mixture, pressure }
    }

    /// The same where anything flows and burns.
    #[inline(always)]
    pub(super) fn hot_flow_if_lit(
        &self,
        oxidizer_kg_s: f64,
        warm_start: &mut ChamberWarmStart,
    ) -> Option<HotFlow<'a>> {
        (oxidizer_kg_s > 0.0 && self.condition.burning_fraction > 0.0)
            .then(|| self.hot_flow(oxidizer_kg_s, warm_start))
    }

    /// Fuel flow of oxidiser of which all burns, Eq (5R) as surface times rate of regression.
    #[inline]
    fn steady_fuel_kg_s(&self, oxidizer_kg_s: f64, warm_start: &mut ChamberWarmStart) -> f64 {
        let flux = oxidizer_kg_s * self.flux_per_flow_1_m2;
        self.fuel_per_regression * self.thrust_chamber.regression.of(flux, &mut warm_start.regression)
    }

    /// Fuel flow that belongs to the burning share when the grain gives `flow_kg_s` (kg/s). Less oxidiser
    /// than the map's rich end burns, or vaporises, no more fuel than that: a flow that stops stops the fuel.
    fn lagged_fuel_kg_s(&self, flow_kg_s: f64, oxidizer_kg_s: f64) -> f64 {
        let (rich, _) = self.thrust_chamber.map.of_span();
        let burning = self.condition.burning_fraction.clamp(0.0, 1.0);
        let full_kg_s = if burning > 0.0 { flow_kg_s.max(0.0) / burning } else { 0.0 };
        // A trace, so that there is a ratio; the map's lean end holds for it.
        full_kg_s.clamp(1e-9 * oxidizer_kg_s, oxidizer_kg_s / rich)
    }

    /// Pressure of unburnt flow.
    fn cold_pa(&self, oxidizer_kg_s: f64) -> f64 {
        (self.thrust_chamber.cold.c_star_m_s * oxidizer_kg_s * self.per_cold_c_star)
            .max(self.condition.ambient_pa)
    }

    /// Steady chamber pressure of a flow.
    pub(super) fn steady_pa(&self, oxidizer_kg_s: f64, warm_start: &mut ChamberWarmStart) -> f64 {
        let hot = self.hot_flow_if_lit(oxidizer_kg_s, warm_start);
        self.mixed_pa(oxidizer_kg_s, hot.as_ref())
    }

    /// Pressure of a flow of which some burns and the rest does not.
    #[inline]
    pub(super) fn mixed_pa(&self, oxidizer_kg_s: f64, hot: Option<&HotFlow<'_>>) -> f64 {
        let f = self.condition.burning_fraction;
        match hot {
            None => self.cold_pa(oxidizer_kg_s),
            Some(hot) if f >= 1.0 => hot.pressure.pa,
            Some(hot) => f * hot.pressure.pa + (1.0 - f) * self.cold_pa(oxidizer_kg_s),
        }
    }

    /// Thrust and nozzle state of an oxidiser flow, with the pressure it has.
    pub(super) fn thrust(&self, oxidizer_kg_s: f64, hot: &HotFlow<'_>) -> (f64, NozzleFlow) {
        let f = self.condition.burning_fraction.clamp(0.0, 1.0);
        let chamber = self.thrust_chamber;
        let (hot_n, flow) = chamber.nozzle.thrust(&self.throat, &hot.mixture, hot.pressure);
        let cold_n = STANDARD_GRAVITY_M_S2 * chamber.cold_flow_isp_s * oxidizer_kg_s;
        (f * hot_n + (1.0 - f) * cold_n, flow)
    }

    /// Whether fuel is left at this port radius.
    fn fuel_left(&self) -> bool {
        self.condition.port_radius_m < self.thrust_chamber.grain.burn_through_radius_m()
    }

    /// Share of the hot flow's fuel that comes off the grain.
    fn fuel_share(&self) -> f64 {
        if self.fuel_left() { self.condition.burning_fraction.clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Growth of the throat: hot flow erodes, cold flow does not.
    #[inline]
    fn erosion_m_s(&self, chamber_pa: f64, warm_start: &mut ChamberWarmStart) -> f64 {
        let nozzle = &self.thrust_chamber.nozzle;
        if self.condition.throat_radius_m >= nozzle.greatest_throat_radius_m()
            || nozzle.erosion_rate_m_s == 0.0
        {
            return 0.0;
        }
        let share =
            self.thrust_chamber.erosion.of(chamber_pa / nozzle.erosion_pressure_pa, &mut warm_start.erosion);
        self.condition.burning_fraction.clamp(0.0, 1.0) * nozzle.erosion_rate_m_s * share
    }

    fn regression_m_s(&self, fuel_kg_s: f64) -> f64 {
        fuel_kg_s / self.thrust_chamber.grain.fuel_per_regression_kg_m(self.condition.port_radius_m)
    }

    /// The quasi-steady chamber under an oxidiser flow.
    #[inline(always)]
    pub(super) fn steady_point(
        &self,
        oxidizer_kg_s: f64,
        hot: Option<HotFlow<'_>>,
        inlet: InletRoot,
    ) -> OperatingPoint {
        let mut warm_start = inlet.warm_start;
        if oxidizer_kg_s <= 0.0 {
            return self.no_flow_point(None, warm_start.chamber);
        }
        let chamber_pa = self.mixed_pa(oxidizer_kg_s, hot.as_ref());
        let hot = hot.unwrap_or_else(|| self.hot_flow(oxidizer_kg_s, &mut warm_start.chamber));
        let f = self.condition.burning_fraction.clamp(0.0, 1.0);
        let (thrust_n, nozzle_flow) = self.thrust(oxidizer_kg_s, &hot);
        let share = self.fuel_share();
        let fuel_kg_s = share * hot.fuel_kg_s;
        let lags = self.condition.fuel_flow_kg_s.is_some();
        let nozzle_kg_s = oxidizer_kg_s + fuel_kg_s;
        OperatingPoint {
            oxidizer_kg_s,
            tank_kg_s: oxidizer_kg_s,
            fuel_kg_s,
            steady_fuel_kg_s: if lags {
                share * self.steady_fuel_kg_s(oxidizer_kg_s, &mut warm_start.chamber)
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
            injector_inlet_pa: inlet.injector_inlet_pa,
            quality: inlet.quality,
            thrust_n,
            isp_s: thrust_n / (STANDARD_GRAVITY_M_S2 * nozzle_kg_s),
            regression_rate_m_s: self.regression_m_s(fuel_kg_s),
            throat_erosion_m_s: self.erosion_m_s(chamber_pa, &mut warm_start.chamber),
            nozzle_flow,
            solved: inlet.solved,
            ..OperatingPoint::no_flow(self.condition.ambient_pa, warm_start)
        }
    }

    /// Pressure and outflow of the gas in the chamber.
    #[inline(never)]
    pub(super) fn filled_chamber(
        &self,
        gas: ChamberGas,
        warm_start: &mut ChamberWarmStart,
    ) -> FilledChamber<'a> {
        let chamber = self.thrust_chamber;
        let (oxidizer_kg, fuel_kg) = (gas.oxidizer_kg.max(0.0), gas.fuel_kg.max(0.0));
        let burning_fraction = self.condition.burning_fraction.clamp(0.0, 1.0);
        // Of the oxidiser only the burning share takes part; without fuel the map's lean end stands in.
        let lean = chamber.map.of_span().1;
        // A last trace of fuel would make the ratio infinite.
        let of_ratio = if fuel_kg > 0.0 {
            (burning_fraction * oxidizer_kg / fuel_kg).min(GREATEST_OF_RATIO)
        } else {
            lean
        };
        let mixture = chamber.map.mixture(of_ratio.min(lean));
        let vessel = Vessel {
            volume_m3: chamber.gas_volume_m3(self.condition),
            c_star_efficiency: chamber.c_star_efficiency(self.condition),
            discharge_coefficient: chamber.nozzle.discharge_coefficient,
            burning_fraction,
            cold: chamber.cold,
        };
        let total_kg = oxidizer_kg + fuel_kg;
        let outflow = filling_pressure(
            &chamber.map,
            &mixture,
            total_kg,
            &vessel,
            &self.throat,
            &mut warm_start.pressure,
        );
        FilledChamber {
            gas: ChamberGas { oxidizer_kg, fuel_kg },
            of_ratio: ratio(oxidizer_kg, fuel_kg),
            mixture,
            pressure: outflow.pressure,
            nozzle_kg_s: outflow.nozzle_kg_s,
        }
    }

    /// A chamber whose gas is a state, under an oxidiser flow.
    #[inline(never)]
    pub(super) fn filling_point(
        &self,
        oxidizer_kg_s: f64,
        filled: &FilledChamber<'_>,
        inlet: InletRoot,
    ) -> OperatingPoint {
        let chamber = self.thrust_chamber;
        let f = self.condition.burning_fraction.clamp(0.0, 1.0);
        let mut warm_start = inlet.warm_start;
        let share = self.fuel_share();
        let steady_fuel_kg_s = share * self.steady_fuel_kg_s(oxidizer_kg_s.max(0.0), &mut warm_start.chamber);
        let fuel_kg_s = match self.condition.fuel_flow_kg_s {
            None => steady_fuel_kg_s,
            Some(flow_kg_s) => share * self.lagged_fuel_kg_s(flow_kg_s, oxidizer_kg_s),
        };
        let nozzle_kg_s = filled.nozzle_kg_s;
        let (hot_n, nozzle_flow) = chamber.nozzle.thrust(&self.throat, &filled.mixture, filled.pressure);
        let cold_n = STANDARD_GRAVITY_M_S2 * chamber.cold_flow_isp_s * nozzle_kg_s;
        let flows = nozzle_kg_s > 0.0;
        let thrust_n = if flows { f * hot_n + (1.0 - f) * cold_n } else { 0.0 };
        let total_kg = filled.gas.oxidizer_kg + filled.gas.fuel_kg;
        let out_1_s = if total_kg > 0.0 { nozzle_kg_s / total_kg } else { 0.0 };
        let chamber_pa = filled.pressure.pa;
        OperatingPoint {
            oxidizer_kg_s,
            tank_kg_s: oxidizer_kg_s,
            fuel_kg_s,
            steady_fuel_kg_s,
            nozzle_kg_s,
            of_ratio: filled.of_ratio,
            chamber_pa,
            injector_inlet_pa: inlet.injector_inlet_pa,
            quality: inlet.quality,
            thrust_n,
            isp_s: if flows { thrust_n / (STANDARD_GRAVITY_M_S2 * nozzle_kg_s) } else { 0.0 },
            regression_rate_m_s: self.regression_m_s(fuel_kg_s),
            throat_erosion_m_s: if flows {
                self.erosion_m_s(chamber_pa, &mut warm_start.chamber)
            } else {
                0.0
            },
            chamber_gas_rate: ChamberGasRate {
                oxidizer_kg_s: oxidizer_kg_s - out_1_s * filled.gas.oxidizer_kg,
                fuel_kg_s: fuel_kg_s - out_1_s * filled.gas.fuel_kg,
            },
            nozzle_flow: if flows { nozzle_flow } else { NozzleFlow::Off },
            solved: inlet.solved,
            ..OperatingPoint::no_flow(self.condition.ambient_pa, warm_start)
        }
    }

    /// No oxidiser flows; a chamber whose gas is a state empties.
    pub(super) fn no_flow_point(
        &self,
        filled: Option<FilledChamber<'_>>,
        chamber: ChamberWarmStart,
    ) -> OperatingPoint {
        let warm_start = WarmStart { chamber, ..WarmStart::default() };
        let Some(filled) = filled else {
            return OperatingPoint::no_flow(self.condition.ambient_pa, warm_start);
        };
        let injector_inlet_pa = filled.pressure.pa;
        let inlet = InletRoot { injector_inlet_pa, quality: 0.0, solved: true, warm_start };
        self.filling_point(0.0, &filled, inlet)
    }
}

/// Oxidiser over fuel, 0 without fuel.
fn ratio(oxidizer: f64, fuel: f64) -> f64 {
    if fuel > 0.0 { (oxidizer / fuel).min(GREATEST_OF_RATIO) } else { 0.0 }
}
