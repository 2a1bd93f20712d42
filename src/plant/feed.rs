//! The feed system's own steps inside a step of the plant, when it stores anything: see
//! [`crate::propulsion::FeedState`]. Every stage of the integrator sees it advanced from the beginning of the
//! step to the stage's instant; at the end it is advanced over the whole step, and what the manifold has
//! taken up leaves the tank.

use super::discrete_state::FeedStart;
use super::{Plant, State};
use crate::propulsion::{EngineCondition, Feed, FeedInput, FeedPoint, FeedState, FeedStep, OperatingPoint};

impl Plant {
    /// Whether the feed system has a state; the seed paper's has none.
    pub(super) fn feed_stores(&self) -> bool {
        self.paper.is_none() && self.vehicle.engine.feed_has_state()
    }

    /// The feed of the tank as it is in a state.
    pub(super) fn feed_in(&self, state: &State) -> Feed<'_> {
        let supply = self.vehicle.gas_supply(&self.stores(state), self.environment.atmosphere.pressure_pa);
        let tank = supply.nitrogen();
        self.solver.feed.at(tank.tank_pa, tank.liquid_k)
    }

    /// Notes what drives the feed system at the beginning of a step, once commands are latched.
    pub(super) fn latch_feed_inputs(&mut self) {
        if !self.feed_stores() {
            return;
        }
        let engine = &self.vehicle.engine;
        let (now, feed) = (&self.snapshot, self.feed_in(&self.state));
        let floor_m2 = core::f64::consts::PI * self.vehicle.tank.radius_m * self.vehicle.tank.radius_m;
        let liquid_m = self.state.nitrous_kg / (self.vehicle.nitrous_density_kg_m3 * floor_m2);
        let head_pa = engine.static_head_pa(feed, liquid_m, -now.specific_force_body_m_s2.z);
        let input = self.feed_input(&self.state, head_pa);
        // The feed does not feel a surge.
        let chamber_pa = now.chamber_pa - self.inputs.faults.pressure_spike.chamber_pa;
        let method = engine.implicit_method(feed, input.valve_area_m2, now.injector_inlet_pa, chamber_pa);
        // Within the step the head goes on as it went in the last one.
        let head_trend_pa =
            if self.inputs.static_head_pa > 0.0 { head_pa - self.inputs.static_head_pa } else { 0.0 };
        self.inputs.static_head_pa = head_pa;
        self.solver.feed_start = FeedStart { input, method, head_trend_pa };
    }

    /// The feed system's step.
    pub(super) fn advance_feed(&mut self) {
        if !self.feed_stores() {
            return;
        }
        let open_area_m2 = self.feed_input(&self.state, 0.0).valve_area_m2;
        let feed = self.feed_in(&self.state);
        let FeedPoint { engine, state: fed } = self.feed_after(&feed, &self.state, open_area_m2, 1.0);
        self.solver.warm_start.last.slope_kg_s_pa = engine.warm_start.slope_kg_s_pa;
        // Two methods of integration give what is injected and what is stored. Their difference must not draw
        // an empty tank below zero.
        let taken_kg = fed.manifold_kg - self.state.manifold_kg;
        let given_kg = taken_kg.min(self.state.nitrous_kg);
        self.state.nitrous_kg -= given_kg;
        self.state.manifold_kg = fed.manifold_kg - (taken_kg - given_kg);
        self.state.line_kg_s = fed.line_kg_s;
    }

    /// The engine at a stage, and what the manifold has taken up since the step began (kg).
    pub(super) fn feed_point(
        &self,
        feed: &Feed<'_>,
        state: &State,
        open_area_m2: f64,
        step_fraction: f64,
    ) -> (OperatingPoint, f64) {
        let FeedPoint { engine, state: fed } = self.feed_after(feed, state, open_area_m2, step_fraction);
        (engine, fed.manifold_kg - state.manifold_kg)
    }

    /// Brings what is stored to the steady state of the running engine at the present valve angle.
    pub(super) fn fill_feed(&mut self) {
        let engine = &self.vehicle.engine;
        let FeedInput { valve_area_m2, condition, .. } = self.feed_input(&self.state, 0.0);
        let feed = self.feed_in(&self.state);
        let steady = EngineCondition { fuel_flow_kg_s: None, ..condition };
        let point = engine.operating_point(feed, valve_area_m2, &steady, self.solver.warm_start.last);
        let fed = engine.feed_steady(feed, &point);
        self.state.manifold_kg = fed.manifold_kg;
        self.state.line_kg_s = fed.line_kg_s;
        self.state.fuel_flow_kg_s = point.fuel_kg_s;
    }

    fn feed_after(&self, feed: &Feed<'_>, state: &State, open_area_m2: f64, step_fraction: f64) -> FeedPoint {
        let FeedStart { input: start, method, head_trend_pa } = self.solver.feed_start;
        let from = FeedState { manifold_kg: state.manifold_kg, line_kg_s: state.line_kg_s };
        let head_pa = (self.inputs.static_head_pa + step_fraction * head_trend_pa).max(0.0);
        let now = FeedInput { valve_area_m2: open_area_m2, head_pa, condition: self.engine_condition(state) };
        let elapsed_s = step_fraction * self.step.s();
        let warm_start = self.solver.warm_start.at(step_fraction);
        self.vehicle.engine.feed_point(feed, &FeedStep { from, start, method }, &now, elapsed_s, warm_start)
    }

    fn feed_input(&self, state: &State, head_pa: f64) -> FeedInput {
        let (valve, _) = self.valve(state);
        let valve_area_m2 = self.valve_area_m2(valve.angle_rad);
        FeedInput {
            valve_area_m2: self
                .vehicle
                .isolation
                .limited_area_m2(valve_area_m2, self.inputs.isolation_opening),
            head_pa,
            condition: self.engine_condition(state),
        }
    }
}
