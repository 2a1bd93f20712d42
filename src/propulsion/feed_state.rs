//! State of the feed system between tank and chamber, what drives it, and one step of it: plain values.

use super::chamber::ChamberGas;
use super::operating_point::{EngineCondition, OperatingPoint};

/// State of the feed system between tank and chamber.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FeedState {
    /// Oxidiser between valve and injector (kg); 0 when that is quasi-steady.
    pub manifold_kg: f64,
    /// Flow of the liquid column before the valve (kg/s); 0 when it has no inertia.
    pub line_kg_s: f64,
}

/// What drives the feed system at one instant.
#[derive(Clone, Copy, Debug)]
pub struct FeedInput {
    /// Open area of the valve (m²).
    pub valve_area_m2: f64,
    /// Pressure of the liquid's weight at the valve (Pa).
    pub head_pa: f64,
    /// The engine.
    pub condition: EngineCondition,
}

/// Method by which a step of the feed system is integrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImplicitMethod {
    /// One stage, first order.
    BackwardEuler,
    /// Two stages, second order: Alexander's singly diagonally implicit Runge-Kutta method.
    Sdirk2,
}

/// The beginning of a step, and how the step is integrated.
#[derive(Clone, Copy, Debug)]
pub struct FeedStep {
    /// State at its beginning.
    pub from: FeedState,
    /// What drives it there, commands of this step included.
    pub start: FeedInput,
    /// Method.
    pub method: ImplicitMethod,
}

/// The engine and its feed system, some time into a step.
#[derive(Clone, Copy, Debug)]
pub struct FeedPoint {
    /// The engine.
    pub engine: OperatingPoint,
    /// The feed system.
    pub state: FeedState,
}

impl FeedState {
    /// Extrapolated from `self` toward another state by a multiple of their difference.
    pub(super) fn extrapolated(&self, to: &Self, share: f64) -> Self {
        Self {
            manifold_kg: self.manifold_kg + share * (to.manifold_kg - self.manifold_kg),
            line_kg_s: self.line_kg_s + share * (to.line_kg_s - self.line_kg_s),
        }
    }
}

impl FeedInput {
    /// A shut valve and no flow.
    pub(crate) const SHUT: Self = Self {
        valve_area_m2: 0.0,
        head_pa: 0.0,
        condition: EngineCondition {
            burning_fraction: 0.0,
            oxidizer_flow_limit_kg_s: 0.0,
            ..EngineCondition::burning(0.0, 0.0, 0.0)
        },
    };

    /// Interpolated linearly, a share of the way to a later instant.
    pub(super) fn interpolated(&self, end: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| if a == b { a } else { a + share * (b - a) };
        let (a, b) = (&self.condition, &end.condition);
        Self {
            valve_area_m2: mix(self.valve_area_m2, end.valve_area_m2),
            head_pa: mix(self.head_pa, end.head_pa),
            condition: EngineCondition {
                port_radius_m: mix(a.port_radius_m, b.port_radius_m),
                throat_radius_m: mix(a.throat_radius_m, b.throat_radius_m),
                burning_fraction: mix(a.burning_fraction, b.burning_fraction),
                ambient_pa: b.ambient_pa,
                chamber_gas: a.chamber_gas.zip(b.chamber_gas).map(|(a, b)| ChamberGas {
                    oxidizer_kg: mix(a.oxidizer_kg, b.oxidizer_kg),
                    fuel_kg: mix(a.fuel_kg, b.fuel_kg),
                }),
                fuel_flow_kg_s: a.fuel_flow_kg_s.zip(b.fuel_flow_kg_s).map(|(a, b)| mix(a, b)),
                oxidizer_flow_limit_kg_s: b.oxidizer_flow_limit_kg_s,
                outlet: b.outlet,
                damage: b.damage,
            },
        }
    }
}
