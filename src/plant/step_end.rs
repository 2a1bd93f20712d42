//! After a step: its last evaluation and snapshot, valve seats, faults, flame, depletion, feed maps, pads,
//! and the events of these; and the disturbances' own time.

use super::{Evaluation, Plant, State};
use crate::actuator::ServoMemory;
use crate::dynamics::rigid_body::SolveStatus;
use crate::event::{Event, EventKind};
use crate::fluid::Nitrous;
use crate::propulsion::{FlameConditions, NitrogenState, UllageModel};
use crate::vehicle::GasModel;

/// Level below which a thruster is off.
const RCS_OFF_LEVEL: f64 = 1e-6;

/// Share of the flow below which a dying flame is out.
const EXTINCT_SHARE: f64 = 0.02;

/// A valve that is told to shut and is nearer than this is shut (rad, rad/s): 2e-9 m2 of open area.
const SEATING_ANGLE_RAD: f64 = 1e-3;
const SEATING_RATE_RAD_S: f64 = 0.1;

impl Plant {
    /// Turbulence and disturbances move on by a time (s).
    pub(super) fn advance_disturbances(&mut self, dt_s: f64) {
        let state = &self.state;
        self.environment.wind.advance(dt_s, -state.position_ned_m.z, state.velocity_ned_m_s);
        let (time_s, mission_s, events) = (self.time.s(), self.mission_s(), &mut self.events);
        self.inputs.disturbance = self.disturbances.advance(dt_s, mission_s, |name, begins| {
            let detail = format!("{name} {}", if begins { "begins" } else { "ends" });
            let kind = EventKind::Disturbance;
            events.push(Event { time_s, kind, detail: detail.trim_start().to_owned() });
        });
    }

    /// What is discrete, after a step.
    pub(super) fn finish_step(&mut self) {
        // First, since the evaluation below is also the first stage of the next step.
        self.advance_servo_memory();

        let now = self.evaluate_inline(&self.state, 0.0);
        self.cache_rate(&now.rate);
        self.snapshot = self.snapshot_of(&now);
        self.solver.warm_start.update(now.engine.warm_start);
        if now.acceleration.status == SolveStatus::Singular && !self.discrete.balance_singular {
            self.discrete.balance_singular = true;
            self.note(EventKind::Singular, "mass or inertia is not that of a body".to_owned());
        }

        self.clear_round_off();
        self.seat_valves();
        self.advance_faults(&now);
        self.advance_flame(&now);
        self.detect_depletion(&now.pressurant);
        self.follow_tank(&now);
        self.advance_anchors(&now);
    }

    /// Play and friction of the servos.
    fn advance_servo_memory(&mut self) {
        let (angle_rad, inputs) = (self.state.valve_rad, &mut self.inputs);
        if angle_rad > 0.0 {
            inputs.valve_memory = inputs.faults.valve_servo.memory_after(angle_rad, &inputs.valve_memory);
        }
        self.advance_gimbal_memory();
    }

    /// Takes back what integration may leave a rounding out of range.
    fn clear_round_off(&mut self) {
        let state = &mut self.state;
        state.nitrous_kg = state.nitrous_kg.max(0.0);
        state.nitrogen_kg = state.nitrogen_kg.max(0.0);
        if let GasModel::EnergyBalance(balance) = &self.vehicle.gas_model {
            state.gas = balance.kept_in_range(&state.gas, state.nitrogen_kg);
        }
        state.burning_fraction = state.burning_fraction.clamp(0.0, 1.0);
        state.fuel_flow_kg_s = state.fuel_flow_kg_s.max(0.0);
    }

    /// Shuts what is almost shut: a decay never reaches zero by itself.
    fn seat_valves(&mut self) {
        let (state, inputs) = (&mut self.state, &mut self.inputs);
        for (axis, open) in [(0, inputs.rcs_duty.a), (1, inputs.rcs_duty.b)] {
            if open == 0.0 && state.rcs_level[axis] < RCS_OFF_LEVEL {
                state.rcs_level[axis] = 0.0;
            }
        }
        if inputs.valve_command_rad <= 0.0
            && inputs.faults.valve_servo.drive_share > 0.0
            && state.valve_rad.abs() < SEATING_ANGLE_RAD
            && state.valve_rad_s.abs() < SEATING_RATE_RAD_S
        {
            state.valve_rad = 0.0;
            state.valve_rad_s = 0.0;
            inputs.valve_memory = ServoMemory::default();
        }
    }

    /// Lets the feed system's maps follow the tank. A map costs some steps' time, so it waits until something
    /// flows.
    fn follow_tank(&mut self, now: &Evaluation) {
        let asked = self.discrete.demand.valve_rad > 0.0;
        let flows = self.inputs.isolation_opening > 0.0 && (asked || self.leaks(now));
        if flows && self.solver.feed.follow(now.pressurant.tank_pa, now.pressurant.liquid_k) {
            self.cached_rate = None;
        }
    }

    /// Where the pads stand.
    fn advance_anchors(&mut self, now: &Evaluation) {
        if !self.options.ground {
            return;
        }
        let (gear, inputs) = (&self.vehicle.landing_gear, &mut self.inputs);
        if !gear.clear_of_ground(&now.motion, 0.0) || inputs.anchors.count() > 0 {
            inputs.anchors =
                gear.anchors_after(&self.pads_body_m, &now.motion, 0.0, &inputs.anchors, inputs.grip);
        }
    }

    /// Notes a tank whose liquid is used up, a bottle that no longer feeds the regulator, and a tank above
    /// what the regulator keeps.
    fn detect_depletion(&mut self, now: &NitrogenState) {
        if !self.inputs.nitrous_depleted && self.state.nitrous_kg <= self.vehicle.tank.unusable_nitrous_kg {
            self.inputs.nitrous_depleted = true;
            self.note(EventKind::NitrousDepleted, format!("{:.3} kg of gas left", self.state.nitrous_kg));
        }
        let high = now.tank_pa > self.vehicle.pressurant.regulator.greatest_pa();
        let low = !now.regulated && !high;
        if low && !self.discrete.bottle_low {
            let mut detail = format!("bottle {:.1} bar", now.bottle_pa * 1e-5);
            if self.vehicle.tank.ullage.model == UllageModel::ConstantTemperature {
                let vapor_pa = Nitrous::tables().vapor_pressure_pa(now.liquid_k);
                detail += &format!(
                    "; a tank below the vapour pressure, {:.1} bar, would boil: see [feed.tank.ullage] energy_balance",
                    vapor_pa * 1e-5
                );
            }
            self.note(EventKind::BottleLow, detail);
        }
        if high && !self.discrete.tank_high {
            self.note(
                EventKind::TankHigh,
                format!("tank {:.1} bar, above its regulator; no relief valve", now.tank_pa * 1e-5),
            );
        }
        (self.discrete.bottle_low, self.discrete.tank_high) = (low, high);
    }

    /// Lights or goes out; notices when fuel begins to limit the flame.
    fn advance_flame(&mut self, now: &Evaluation) {
        let tail_s = self.vehicle.engine_parameters.depletion.tail_time_constant_s;
        let burning = (1.0 - self.tank_outlet(&self.state).1) * self.burning_share(&self.state);
        if now.engine.steady_fuel_kg_s > 0.0 && burning > 0.0 {
            self.discrete.fully_lit_fuel_kg_s = now.engine.steady_fuel_kg_s / burning;
        }
        let (usable_kg, tail_kg) =
            (self.usable_fuel_kg(&self.state), tail_s * self.discrete.fully_lit_fuel_kg_s);
        // Two tails ahead: no step burns as much as one.
        self.inputs.fading_fuel_kg = if usable_kg < 2.0 * tail_kg { tail_kg } else { 0.0 };
        let chamber = || format!("chamber {:.1} bar", now.engine.chamber_pa * 1e-5);
        if !self.discrete.burnt_through && self.discrete.fully_lit_fuel_kg_s > 0.0 && usable_kg < tail_kg {
            self.discrete.burnt_through = true;
            self.note(EventKind::FuelBurnThrough, chamber());
        }
        let flame = self.vehicle.engine_parameters.ignition.advance(
            &self.discrete.flame,
            &FlameConditions {
                time: self.time,
                igniter: self.discrete.igniter_on && !self.discrete.fault_memory.effect.igniter_dead,
                oxidizer_kg_s: now.engine.oxidizer_kg_s,
                chamber_pa: now.engine.chamber_pa,
                // What burns goes on into its tail until it is a flicker; what is out stays out.
                fuel_left: !self.discrete.burnt_through || (self.inputs.lit && burning > EXTINCT_SHARE),
                late_s: self.discrete.fault_memory.effect.light_delay_s,
            },
        );
        match (self.inputs.lit, flame.lit) {
            (false, true) => {
                self.inputs.ignition_time.get_or_insert(self.time);
                self.ignite_pool(now);
                self.note(EventKind::Ignition, chamber());
            }
            (true, false) => {
                self.state.burning_fraction = 0.0;
                self.state.fuel_flow_kg_s = 0.0;
                self.note(EventKind::Shutdown, chamber());
            }
            _ => {}
        }
        self.inputs.lit = flame.lit;
        self.discrete.flame = flame;
    }

    /// Fuel that can still burn: ports that meet leave slivers (kg).
    pub(super) fn usable_fuel_kg(&self, state: &State) -> f64 {
        let grain = &self.vehicle.engine_parameters.grain;
        (self.fuel_kg(state) - grain.fuel_kg(grain.burn_through_radius_m())).max(0.0)
    }
}
