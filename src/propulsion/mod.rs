//! The propulsion system: tank → valve → injector → chamber → nozzle, solved from the valve's side.
//!
//! [`Engine`] is the whole as one function of plain values. Forward, [`Engine::operating_point`]: given the
//! valve's area and the tank ([`FeedMap`]), one bracketed root in the pressure P2 between valve and injector
//! gives flow, chamber pressure and thrust. Backward, [`Engine::inverse`]: thrust → flow → chamber pressure →
//! P2 → area → angle. Where the feed system stores, [`Engine::feed_point`] takes the place of the forward
//! problem. [`PaperEngine`] is the seed paper's own way to the same, kept for comparison.
//!
//! Modules stand in dependency order; a module imports only from above itself.
//!
//! Source: the seed paper, "Analytical Modeling of Oxidizer Motion and Fuel Regression in Hybrid Rockets for
//! In-Flight Mass Evolution", Eqs 1 to 16, with its errata set right; each part names its own sources.

// Single parts and laws: combustion products, orifices, grain, flame, nozzle.
mod combustion;
mod gas_orifice;
mod grain;
mod ignition;
mod injector;
mod nozzle;

// Parts that use these.
mod chamber;
mod outlet;
mod reaction_control;
mod valve;

// Pressurant and run tank.
mod pressurant;
mod tank;

mod gas_balance;

// The feed system.
mod feed;
mod feed_map;

mod feed_grid;

// The engine: its parameters and values, its thrust chamber, the whole.
mod operating_point;
mod parameters;
mod thrust_chamber;

mod engine;
mod feed_state;

// What else is asked of it: hard start, inverse problem, a feed system that stores.
mod hard_start;
mod inverse;
mod manifold;

// The seed paper's engine.
mod paper;

pub use chamber::{Chamber, ChamberGas, ChamberGasRate, ChamberModel};
pub use combustion::{CombustionMap, Map};
pub use engine::{Engine, EngineError, EngineTexts};
pub use feed::{Isolation, Line, Manifold, ManifoldModel, Vent, VentedGas};
pub use feed_grid::{Feed, FeedGrid};
pub use feed_map::{FeedMap, Inlet};
pub use feed_state::{FeedInput, FeedPoint, FeedState, FeedStep, ImplicitMethod};
pub use gas_balance::{GasBalance, GasProperties, GasState, Stores, StoresRate, Withdrawal};
pub use grain::Grain;
pub use hard_start::PressureSpike;
pub use ignition::{BelowMinimum, Depletion, DepletionModel, Flame, FlameConditions, Ignition};
pub use injector::{Injector, SinglePhase};
pub use inverse::Inverse;
pub use nozzle::{Nozzle, NozzleFlow};
pub use operating_point::{ChamberWarmStart, Damage, EngineCondition, OperatingPoint, WarmStart};
pub use outlet::{GasIngestion, Outlet};
pub use paper::{PaperEngine, SweepPoint};
pub use parameters::{EngineParameters, FeedParameters, PaperMode};
pub use pressurant::{
    Bottle, BottleModel, NitrogenInventory, NitrogenState, Pressurant, PressurantGas, Regulator,
};
pub use reaction_control::{Drive, Modulator, Pair, PairLevels, ReactionControl, Thruster, ThrusterLoads};
pub use tank::{Tank, Ullage, UllageModel};
pub use valve::{Valve, ValveArea, ValveAreaError, ValveMapCheck, WorstRow};
