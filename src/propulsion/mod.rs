//! The propulsion system: tank → valve → injector → chamber → nozzle, solved from the valve's side.
//!
//! [`Engine`] is the whole as one function of plain values. Forward, [`Engine::operating_point`]: given the
//! valve's area and the tank ([`FeedMap`]), one bracketed root in the pressure P2 between valve and injector
//! gives flow, chamber pressure and thrust. Backward, [`Engine::inverse`]: thrust → flow → chamber
//! pressure → P2 → area → angle. [`PaperEngine`] is the seed paper's own way to the same, kept for comparison.
//!
//! Source: the seed paper, "Analytical Modeling of Oxidizer Motion and Fuel Regression in Hybrid Rockets for
//! In-Flight Mass Evolution", Eqs 1 to 16, with its errata set right; each part names its own sources.

mod chamber;
mod combustion;
mod engine;
mod feed;
mod feed_grid;
mod feed_map;
mod gas_balance;
mod gas_orifice;
mod grain;
mod hard_start;
mod ignition;
mod injector;
mod inverse;
mod manifold;
mod nozzle;
mod outlet;
mod paper;
mod pressurant;
mod reaction_control;
mod valve;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use chamber::{Chamber, ChamberGas, ChamberGasRate, ChamberModel};
pub use combustion::{CombustionMap, Map};
pub use engine::{Damage, Engine, EngineCondition, EngineError, EngineTexts, OperatingPoint, WarmStart};
pub use feed::{Isolation, Line, Manifold, ManifoldModel, Tank, Vent, VentedGas};
pub use feed_grid::{Feed, FeedGrid, Triangle};
pub use feed_map::{FeedMap, Inlet};
pub use gas_balance::{GasBalance, GasState, GasView, Stores, StoresRate, Ullage, UllageModel, Withdrawal};
pub use grain::Grain;
pub use hard_start::Surge;
pub use ignition::{BelowMinimum, Depletion, DepletionModel, Flame, FlameConditions, Ignition};
pub use injector::{Injector, SinglePhase};
pub use inverse::Inverse;
pub use manifold::{FeedInput, FeedPoint, FeedState, FeedStep, Stages};
pub use nozzle::{Nozzle, NozzleFlow};
pub use outlet::{GasIngestion, Outlet};
pub use paper::{Candidate, PaperEngine};
pub use pressurant::{
    Bottle, BottleModel, NitrogenInventory, NitrogenState, Pressurant, PressurantGas, Regulator,
};
pub use reaction_control::{Drive, Modulator, Pair, PairLevels, ReactionControl, Thruster, ThrusterLoads};
pub use valve::{Valve, ValveArea, ValveMapCheck, WorstRow};

/// The engine proper: the `[engine]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EngineParameters {
    /// Fuel grain.
    pub grain: Grain,
    /// Propulsion map.
    pub map: Map,
    /// Combustion chamber.
    pub chamber: Chamber,
    /// Nozzle.
    pub nozzle: Nozzle,
    /// Ignition and extinction.
    pub ignition: Ignition,
    /// Ends of propellant.
    pub depletion: Depletion,
}

/// The feed system: the `[feed]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeedParameters {
    /// Run tank.
    pub tank: Tank,
    /// Throttle valve and its servo.
    pub valve: Valve,
    /// Pipe between tank and valve; without it no inertia and no static head.
    #[serde(default)]
    pub line: Option<Line>,
    /// Pipe between valve and injector.
    pub manifold: Manifold,
    /// Injector.
    pub injector: Injector,
    /// Isolation valve.
    pub isolation: Isolation,
    /// Vent of the run tank.
    pub vent: Vent,
}

/// Limits of the inverse problem, and the seed paper's scheme: the `[paper_mode]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PaperMode {
    /// Least oxidiser flow of a thrust demand (kg/s).
    #[schemars(range(min = 1e-6, max = 100.0))]
    pub oxidizer_flow_min_kg_s: f64,
    /// Greatest oxidiser flow of a thrust demand (kg/s).
    #[schemars(range(min = 1e-5, max = 100.0))]
    pub oxidizer_flow_max_kg_s: f64,
    /// Step of the explicit Euler scheme (s).
    #[schemars(range(min = 1e-4, max = 1.0))]
    pub step_s: f64,
    /// Points of the flow sweep.
    #[schemars(range(min = 2, max = 1000000))]
    pub sweep_points: u32,
    /// Degree of the polynomials Isp(O/F) and c*(O/F), fitted to the vehicle's own map at its reference pressure.
    #[serde(default = "polynomial_degree")]
    #[schemars(range(min = 1, max = 12))]
    pub polynomial_degree: u32,
    /// O/F between which they are fitted, rising and at least 0.25 of it inside the map's own range; held at the ends beyond.
    #[serde(default = "polynomial_of_range")]
    #[schemars(inner(range(min = 0.1, max = 40.0)))]
    pub polynomial_of_range: [f64; 2],
    /// Factor on the ideal sea-level Isp of Eq 10: 1 as in the print; `c_star_efficiency` times `thrust_efficiency` makes thrust and chamber pressure agree.
    #[serde(default = "one")]
    #[schemars(range(min = 0.5, max = 1.0))]
    pub specific_impulse_efficiency: f64,
}

fn polynomial_degree() -> u32 {
    8
}

fn polynomial_of_range() -> [f64; 2] {
    [1.0, 12.0]
}

fn one() -> f64 {
    1.0
}
