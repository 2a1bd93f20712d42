//! The inverse problem: which valve angle gives a thrust.
//!
//! Thrust → oxidiser flow (the thrust rises with it: one bracketed root, where the seed paper sweeps) →
//! chamber pressure → P2 from the injector → valve area → angle. What cannot be had is clamped and flagged.

use super::engine::{Engine, INLET_TOLERANCE};
use super::feed_grid::Feed;
use super::operating_point::{ChamberWarmStart, EngineCondition, OperatingPoint, WarmStart};
use super::thrust_chamber::ThrustChamberAtCondition;
use crate::interpolate::{Bracket, RootStatus, bracketed_root};

/// Answer of the inverse problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inverse {
    /// Angle of the valve (rad).
    pub valve_rad: f64,
    /// Open area at that angle (m²).
    pub valve_area_m2: f64,
    /// What the engine does there, quasi-steady.
    pub point: OperatingPoint,
    /// Whether the demand lay outside what flow limits and the fully open valve allow.
    pub saturated: bool,
}

/// Accuracy of the oxidiser flow (kg/s): 2.5e-6 N.
const FLOW_TOLERANCE_KG_S: f64 = 1e-9;

impl Engine {
    /// Valve angle for a steady thrust. The answer is for the steady engine, whatever gas is in the chamber
    /// and whatever fuel comes off the grain.
    pub fn inverse<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        thrust_n: f64,
        condition: &EngineCondition,
        warm_start: WarmStart,
    ) -> Inverse {
        let feed = &feed.into();
        let steady = EngineCondition { chamber_gas: None, fuel_flow_kg_s: None, outlet: None, ..*condition };
        let at_condition = self.thrust_chamber.at_condition(&steady);
        let (least_kg_s, most_kg_s) = self.demand_kg_s;
        let mut chamber = warm_start.chamber;
        let excess_n = |oxidizer_kg_s: f64| {
            let hot = at_condition.hot_flow(oxidizer_kg_s, &mut chamber);
            at_condition.thrust(oxidizer_kg_s, &hot).0 - thrust_n
        };
        let bracket = Bracket {
            low: least_kg_s,
            high: most_kg_s,
            // Near 2.4 kN per kg/s over most of the range.
            guess: thrust_n / 2400.0,
            slope: Some(2500.0),
            tolerance: FLOW_TOLERANCE_KG_S,
        };
        let root = bracketed_root(bracket, excess_n);
        let beyond = !matches!(root.status, RootStatus::Solved);
        let (_, open_m2) = self.valve_area.fully_open();
        let inlet = self.inlet_of_flow(feed, root.x, &at_condition, warm_start, &mut chamber);
        let (area_m2, injector_inlet_pa) = inlet.unwrap_or((f64::INFINITY, warm_start.injector_inlet_pa));
        let saturated = beyond || area_m2 > open_m2;
        let valve_rad = self.valve_area.angle_rad(area_m2.min(open_m2));
        let valve_area_m2 = self.valve_area.area_m2(valve_rad);
        let start = WarmStart { injector_inlet_pa, chamber, ..warm_start };
        let point = self.operating_point(feed, valve_area_m2, &steady, start);
        Inverse { valve_rad, valve_area_m2, point, saturated }
    }

    /// Valve area (m²) and P2 (Pa) that pass a flow; `None` when the injector cannot at the tank's pressure.
    fn inlet_of_flow(
        &self,
        feed: &Feed<'_>,
        oxidizer_kg_s: f64,
        at_condition: &ThrustChamberAtCondition<'_>,
        warm_start: WarmStart,
        chamber: &mut ChamberWarmStart,
    ) -> Option<(f64, f64)> {
        let tank_pa = feed.tank().pressure_pa;
        let chamber_pa = at_condition.steady_pa(oxidizer_kg_s, chamber);
        let injector_m2 = self.injector_m2(at_condition.condition);
        let excess_kg_s = |inlet_pa: f64| {
            injector_m2 * feed.injector_flux_kg_m2_s(&feed.inlet(inlet_pa), chamber_pa) - oxidizer_kg_s
        };
        if chamber_pa >= tank_pa || excess_kg_s(tank_pa) <= 0.0 {
            return None;
        }
        let bracket = Bracket {
            low: chamber_pa,
            high: tank_pa,
            guess: warm_start.injector_inlet_pa,
            slope: Some(warm_start.slope_kg_s_pa),
            tolerance: INLET_TOLERANCE * tank_pa,
        };
        let inlet_pa = bracketed_root(bracket, excess_kg_s).x;
        let flux = feed.inlet(inlet_pa).valve_flux_kg_m2_s;
        (flux > 0.0).then(|| (oxidizer_kg_s / (self.valve_discharge_coefficient * flux), inlet_pa))
    }
}
