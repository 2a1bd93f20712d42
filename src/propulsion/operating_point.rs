//! What the engine's answer depends on, the answer, and where to begin to look for the next one: plain
//! values.

use super::chamber::{ChamberGas, ChamberGasRate, PressureWarmStart};
use super::nozzle::NozzleFlow;
use super::outlet::Outlet;
use crate::interpolate::Anchor;

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
    /// Fuel that comes off the grain, when that lags the oxidiser and is a state (kg/s); `None` follows at
    /// once.
    pub fuel_flow_kg_s: Option<f64>,
    /// Flow that the tank's outlet can give (kg/s); infinite except while the thrust decays after depletion.
    pub oxidizer_flow_limit_kg_s: f64,
    /// What the tank's outlet draws once liquid alone no longer covers it.
    pub outlet: Option<Outlet>,
    /// What is broken.
    pub damage: Damage,
}

/// What is broken in injector and chamber, as shares of what a sound engine has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damage {
    /// Share of the injector's area that is blocked; the flux through the rest is unchanged.
    pub injector_blocked_share: f64,
    /// Share of c* that is lost, on pressure and thrust.
    pub efficiency_drop_share: f64,
}

impl Damage {
    /// A sound engine.
    pub const NONE: Self = Self { injector_blocked_share: 0.0, efficiency_drop_share: 0.0 };
}

impl EngineCondition {
    /// All of the oxidiser burns, the chamber is quasi-steady, the fuel follows at once, and liquid covers
    /// the outlet.
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

/// The last answer, from which the solver starts. It changes the time an answer takes, and the answer itself
/// only within the solver's tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WarmStart {
    /// P2 (Pa).
    pub injector_inlet_pa: f64,
    /// Slope of the flow balance there (kg/(s Pa)).
    pub slope_kg_s_pa: f64,
    /// Of the thrust chamber.
    pub chamber: ChamberWarmStart,
}

/// Where the thrust chamber's own iterations and series start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChamberWarmStart {
    /// Chamber pressure of the hot flow.
    pub pressure: PressureWarmStart,
    /// Oxidiser flux in the ports, to the exponent of regression.
    pub regression: Anchor,
    /// Chamber pressure, to the exponent of erosion.
    pub erosion: Anchor,
}

/// The engine's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatingPoint {
    /// Oxidiser through the injector (kg/s).
    pub oxidizer_kg_s: f64,
    /// Oxidiser out of the tank (kg/s): the same, unless something between them stores.
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
    /// Whether the solver has found the answer; without it the numbers are the best known.
    pub solved: bool,
    /// Warm start for the next call.
    pub warm_start: WarmStart,
}

impl OperatingPoint {
    /// The engine without flow, every pressure ambient. Every other point is an update of this one.
    #[inline]
    pub(super) const fn no_flow(ambient_pa: f64, warm_start: WarmStart) -> Self {
        Self {
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
            chamber_gas_rate: ChamberGasRate { oxidizer_kg_s: 0.0, fuel_kg_s: 0.0 },
            nozzle_flow: NozzleFlow::Off,
            solved: true,
            warm_start,
        }
    }
}
