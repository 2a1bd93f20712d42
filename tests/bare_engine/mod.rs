//! The reference vehicle's engine, read from its own files.
#![allow(dead_code)] // each test file uses its part

use hopbench::propulsion::{
    ChamberModel, Engine, EngineCondition, EngineParameters, EngineTexts, FeedMap, FeedParameters,
    OperatingPoint, PaperMode, Pressurant, ReactionControl, WarmStart,
};

#[allow(dead_code)]
pub const AMBIENT_PA: f64 = 101_325.0;

#[derive(serde::Deserialize)]
#[allow(dead_code)]
pub struct Vehicle {
    pub engine: EngineParameters,
    pub feed: FeedParameters,
    pub pressurant: Pressurant,
    pub rcs: ReactionControl,
    pub paper_mode: PaperMode,
}

pub fn vehicle() -> Vehicle {
    toml::from_str(include_str!("../../scenarios/vehicles/reference.toml")).unwrap()
}

pub fn engine_of(vehicle: &Vehicle) -> Engine {
    let texts = EngineTexts {
        map: include_str!("../../scenarios/vehicles/cea_reference_fit.csv"),
        valve_area: include_str!("../../scenarios/vehicles/valve_area_vs_angle.csv"),
    };
    Engine::new(&vehicle.engine, &vehicle.feed, &vehicle.paper_mode, texts).unwrap()
}

#[allow(dead_code)]
pub fn engine() -> Engine {
    engine_of(&vehicle())
}

#[allow(dead_code)]
pub fn filling_engine() -> Engine {
    let mut vehicle = vehicle();
    vehicle.engine.chamber.model = ChamberModel::Filling;
    engine_of(&vehicle)
}

/// The lit engine at a port and throat radius, quasi-steady.
#[allow(dead_code)]
pub fn condition(port_mm: f64, throat_mm: f64) -> EngineCondition {
    EngineCondition::burning(port_mm * 1e-3, throat_mm * 1e-3, AMBIENT_PA)
}

#[allow(dead_code)]
pub fn at_angle(
    engine: &Engine,
    feed: &FeedMap,
    degrees: f64,
    condition: &EngineCondition,
) -> OperatingPoint {
    let area_m2 = engine.valve_area().area_m2(degrees.to_radians());
    engine.operating_point(feed, area_m2, condition, WarmStart::default())
}

/// The valve fully open, the flow given by the outlet's limit.
#[allow(dead_code)]
pub fn at_flow(
    engine: &Engine,
    feed: &FeedMap,
    oxidizer_kg_s: f64,
    condition: &EngineCondition,
) -> OperatingPoint {
    let limited = EngineCondition { oxidizer_flow_limit_kg_s: oxidizer_kg_s, ..*condition };
    engine.operating_point(feed, engine.valve_area().fully_open().1, &limited, WarmStart::default())
}
