//! The first half of the block diagram: oxidiser and gas from the tanks through valve, injector and chamber,
//! and the thrust that they make.

use super::{Plant, State};
use crate::propulsion::{
    ChamberGas, ChamberModel, EngineCondition, Feed, GasIngestion, NitrogenState, OperatingPoint, Outlet,
    PairLevels, Stores, StoresRate, ThrusterLoads, Withdrawal,
};
use crate::vehicle::GasSupply;

/// A store that is nearly empty gives what it has within so long (s): a few steps, so that integration never
/// passes zero.
const DRAIN_S: f64 = 4e-3;

/// Feed, combustion and pressurant.
pub(super) struct Supply {
    pub(super) engine: OperatingPoint,
    /// Open area of the oxidiser valve (m²).
    pub(super) valve_area_m2: f64,
    pub(super) pressurant: NitrogenState,
    pub(super) thrusters: ThrusterLoads,
    pub(super) vent_kg_s: f64,
    /// Of that, nitrous oxide.
    pub(super) vented_vapor_kg_s: f64,
    /// Liquid in the tank, and how fast it changes.
    pub(super) nitrous_kg: f64,
    pub(super) nitrous_kg_s: f64,
    pub(super) stores_rate: StoresRate,
}

impl Plant {
    /// What leaves each store through an oxidiser valve at an angle (rad), and the thrust that it makes;
    /// `step_fraction` of a step on.
    #[inline(always)]
    pub(super) fn supply(&self, state: &State, step_fraction: f64, valve_rad: f64) -> Supply {
        let vehicle = &self.vehicle;
        let ambient_pa = self.environment.atmosphere.pressure_pa;
        let valve_area_m2 = self.valve_area_m2(valve_rad);
        let open_area_m2 = vehicle.isolation.limited_area_m2(valve_area_m2, self.inputs.isolation_opening);
        let mut gas_supply = vehicle.gas_supply(&self.stores(state), ambient_pa);
        let feed = self.solver.feed.at(gas_supply.nitrogen().tank_pa, gas_supply.nitrogen().liquid_k);
        let (engine, stored_kg) = self.engine_at(&feed, open_area_m2, state, step_fraction);

        // The state still counts what the manifold has taken up in this step; `advance_feed` moves it over.
        let nitrous_kg = state.nitrous_kg - stored_kg;
        let stores = Stores { nitrous_kg, ..self.stores(state) };
        if stored_kg != 0.0 {
            gas_supply = vehicle.gas_supply(&stores, ambient_pa);
        }
        let mut thrusters = vehicle.reaction_control.loads(&levels(state), gas_supply.nitrogen().bottle_pa);
        let mut vent_kg_s = vehicle.vent_kg_s(&gas_supply, self.inputs.vent_opening, ambient_pa);
        let [left, vented] =
            gas_supply.available_fractions(&stores, [thrusters.nitrogen_kg_s, vent_kg_s], DRAIN_S);
        if left < 1.0 {
            thrusters.force_body_n *= left;
            thrusters.moment_body_n_m *= left;
            thrusters.nitrogen_kg_s *= left;
        }
        if vented < 1.0 {
            vent_kg_s *= vented;
        }
        let liquid_kg_s = engine.tank_kg_s - engine.outlet_gas_kg_s;
        let out = Withdrawal {
            liquid_kg_s,
            gas_kg_s: vent_kg_s + engine.outlet_gas_kg_s,
            thrusters_kg_s: thrusters.nitrogen_kg_s,
        };
        let stores_rate = vehicle.gas_rate(&stores, &gas_supply, &out);
        Supply {
            engine,
            valve_area_m2,
            pressurant: *gas_supply.nitrogen(),
            thrusters,
            vent_kg_s,
            vented_vapor_kg_s: gas_supply.vapor_share() * vent_kg_s,
            nitrous_kg,
            nitrous_kg_s: -(liquid_kg_s + stores_rate.evaporation_kg_s),
            stores_rate,
        }
    }

    /// Conditions of the engine at a state.
    #[inline(always)] // so that nothing is written that the engine does not read
    pub(super) fn engine_condition(&self, state: &State) -> EngineCondition {
        let parameters = &self.vehicle.engine_parameters;
        let tail_s = parameters.depletion.tail_time_constant_s;
        // Gas follows the liquid, and what fuel is left burns: each leaves within the tail's time constant,
        // so neither store reaches zero within a step.
        let drain_s = if self.inputs.nitrous_depleted { tail_s } else { self.drain_s() };
        let two_phase = self.vehicle.gas_ingestion.is_some();
        let (outlet, inert_share) = self.tank_outlet(state);
        EngineCondition {
            port_radius_m: self.frozen.port_radius_m.unwrap_or(state.port_radius_m),
            throat_radius_m: state.throat_radius_m,
            // Nitrogen among the oxidiser does not burn.
            burning_fraction: (1.0 - inert_share) * self.burning_share(state),
            ambient_pa: self.environment.atmosphere.pressure_pa,
            chamber_gas: (parameters.chamber.model == ChamberModel::Filling).then_some(ChamberGas {
                oxidizer_kg: state.chamber_oxidizer_kg,
                fuel_kg: state.chamber_fuel_kg,
            }),
            fuel_flow_kg_s: (parameters.grain.fuel_flow_lag_s > 0.0 && self.paper.is_none())
                .then(|| state.fuel_flow_kg_s.min(self.usable_fuel_kg(state) / DRAIN_S)),
            // An outlet that uncovers limits its liquid itself.
            oxidizer_flow_limit_kg_s: if two_phase {
                f64::INFINITY
            } else {
                state.nitrous_kg.max(0.0) / drain_s
            },
            outlet,
            damage: self.inputs.faults.damage,
        }
    }

    /// Share of the oxidiser that burns: the flame's, as far as fuel is left.
    #[inline]
    pub(super) fn burning_share(&self, state: &State) -> f64 {
        let (fuel_kg, fading_kg) = (self.usable_fuel_kg(state), self.inputs.fading_fuel_kg);
        if fuel_kg < fading_kg {
            state.burning_fraction.min(fuel_kg / fading_kg)
        } else {
            state.burning_fraction
        }
    }

    /// What an uncovered outlet draws, and the share of nitrogen in it.
    #[inline]
    pub(super) fn tank_outlet(&self, state: &State) -> (Option<Outlet>, f64) {
        match &self.vehicle.gas_ingestion {
            None => (None, 0.0),
            Some(gas_ingestion) => self.ingesting_outlet(gas_ingestion, state),
        }
    }

    fn ingesting_outlet(&self, gas_ingestion: &GasIngestion, state: &State) -> (Option<Outlet>, f64) {
        let Some([valve_gas, injector_gas]) = gas_ingestion.gas_shares(state.nitrous_kg) else {
            return (None, 0.0);
        };
        let GasSupply::EnergyBalance(view) =
            self.vehicle.gas_supply(&self.stores(state), self.environment.atmosphere.pressure_pa)
        else {
            return (None, 0.0);
        };
        let outlet = Outlet {
            valve_gas,
            injector_gas,
            gas_pa: view.nitrogen.tank_pa,
            gas_kg_m3: view.ullage_density_kg_m3(),
        };
        // The inlet pressure of the last solution: it moves by some thousandths in a step.
        let solved_pa = self.solver.warm_start.last.injector_inlet_pa;
        let inlet_pa = if solved_pa > 0.0 { solved_pa } else { outlet.gas_pa };
        let inlet = self.solver.feed.at(outlet.gas_pa, view.nitrogen.liquid_k).inlet(inlet_pa);
        let gas_share = outlet.gas_mass_share(inlet_pa, inlet.state.density_kg_m3);
        (Some(outlet), gas_share * (1.0 - view.vapor_share()))
    }

    /// What the engine does with this much valve area open, `step_fraction` of a step on, and what the
    /// manifold has taken up since the step began (kg).
    #[inline(always)]
    fn engine_at(
        &self,
        feed: &Feed<'_>,
        valve_area_m2: f64,
        state: &State,
        step_fraction: f64,
    ) -> (OperatingPoint, f64) {
        let engine = &self.vehicle.engine;
        let (mut point, stored_kg) = match &self.paper {
            None if self.feed_stores() => self.feed_point(feed, state, valve_area_m2, step_fraction),
            None => {
                let warm_start = self.solver.warm_start.at(step_fraction);
                (
                    engine.operating_point_inline(
                        feed,
                        valve_area_m2,
                        &self.engine_condition(state),
                        warm_start,
                    ),
                    0.0,
                )
            }
            Some(paper) => match paper.point {
                Some(held) => return (held, 0.0),
                None => (
                    paper.engine.operating_point(engine, feed, valve_area_m2, &self.engine_condition(state)),
                    0.0,
                ),
            },
        };
        let pressure_spike = &self.inputs.faults.pressure_spike;
        point.chamber_pa += pressure_spike.chamber_pa;
        point.thrust_n = self.inputs.disturbance.thrust_n(point.thrust_n + pressure_spike.thrust_n());
        (point, stored_kg)
    }

    /// Time in which a nearly empty store gives what it has (s): a few steps.
    fn drain_s(&self) -> f64 {
        self.paper.as_ref().map_or(DRAIN_S, |paper| paper.step.s().max(DRAIN_S))
    }
}

/// Levels of the thruster pairs.
pub(super) fn levels(state: &State) -> PairLevels {
    PairLevels { a: state.rcs_level.x, b: state.rcs_level.y }
}
