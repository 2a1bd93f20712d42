//! What happens between steps: stops, play, flame, depletion, feet.

use super::{CachedRate, Evaluation, Plant, State};
use crate::actuator::ServoMemory;
use crate::dynamics::rigid_body::SolveStatus;
use crate::event::{Event, EventKind};
use crate::fluid::Nitrous;
use crate::propulsion::{FlameConditions, NitrogenState, UllageModel};
use crate::vehicle::GasModel;

/// Share of a thruster's level below which it is off.
const RCS_OFF: f64 = 1e-6;

/// Share of the flow below which a dying flame is out.
const FLICKER: f64 = 0.02;

/// A valve that is told to shut and is nearer than this is shut (rad, rad/s): 2e-9 m2 of open area.
const SEATED_RAD: f64 = 1e-3;
const SEATED_RAD_S: f64 = 0.1;

impl Plant {
    /// Turbulence and disturbances move on by a time (s).
    pub(super) fn disturb(&mut self, dt_s: f64) {
        let state = &self.state;
        self.environment.wind.advance(dt_s, -state.position_ned_m.z, state.velocity_ned_m_s);
        let (time_s, mission_s, events) = (self.time.s(), self.mission_s(), &mut self.events);
        self.discrete.disturbed = self.disturbances.advance(dt_s, mission_s, |name, begins| {
            let detail = format!("{name} {}", if begins { "begins" } else { "ends" });
            let kind = EventKind::Disturbance;
            events.push(Event { time_s, kind, detail: detail.trim_start().to_owned() });
        });
    }

    /// Discrete events after a step.
    pub(super) fn finish_step(&mut self) {
        // Play and friction: before the evaluation, which begins the next step.
        let state = &self.state;
        if state.valve_rad > 0.0 {
            self.discrete.valve_memory =
                self.discrete.faults.valve_servo.memory_after(state.valve_rad, &self.discrete.valve_memory);
        }
        self.take_up_gimbal();

        let now = self.evaluate_inline(&self.state, 0.0);
        let inputs = self.inputs(&self.state);
        let guess = (self.discrete.guess, self.discrete.trend_pa);
        match &mut self.settled {
            // In place: a rate is large.
            Some(settled) => (settled.inputs, settled.rate, settled.guess) = (inputs, now.rate, guess),
            None => self.settled = Some(CachedRate { inputs, rate: now.rate, guess }),
        }
        self.snapshot = self.snapshot_of(&now);
        self.discrete.update_warm_start(now.engine.guess);
        if now.acceleration.status == SolveStatus::Singular && !self.discrete.singular {
            self.discrete.singular = true;
            self.note(EventKind::Singular, "mass or inertia is not that of a body".to_owned());
        }

        // What integration may leave a rounding below zero.
        self.state.nitrous_kg = self.state.nitrous_kg.max(0.0);
        self.state.nitrogen_kg = self.state.nitrogen_kg.max(0.0);
        if let GasModel::Balanced(balance) = &self.vehicle.gas_model {
            self.state.gas = balance.kept_in_range(&self.state.gas, self.state.nitrogen_kg);
        }
        self.state.burning_fraction = self.state.burning_fraction.clamp(0.0, 1.0);
        self.state.fuel_flow_kg_s = self.state.fuel_flow_kg_s.max(0.0);

        // A thruster that has died away is off; its first-order decay would never end.
        for (axis, open) in [(0, self.discrete.rcs_open.a), (1, self.discrete.rcs_open.b)] {
            if open == 0.0 && self.state.rcs_level[axis] < RCS_OFF {
                self.state.rcs_level[axis] = 0.0;
            }
        }

        // A ball that is told to shut seats; a servo alone would only ever come near.
        if self.discrete.valve_command_rad <= 0.0
            && self.discrete.faults.valve_servo.drive_share > 0.0
            && self.state.valve_rad.abs() < SEATED_RAD
            && self.state.valve_rad_s.abs() < SEATED_RAD_S
        {
            self.state.valve_rad = 0.0;
            self.state.valve_rad_s = 0.0;
            self.discrete.valve_memory = ServoMemory::default();
        }

        self.finish_faults(&now);
        self.advance_flame(&now);

        // Depletion.
        if !self.discrete.nitrous_depleted && self.state.nitrous_kg <= self.vehicle.tank.unusable_nitrous_kg {
            self.discrete.nitrous_depleted = true;
            self.note(EventKind::NitrousDepleted, format!("{:.3} kg of gas left", self.state.nitrous_kg));
        }
        self.watch_the_tank(&now.pressurant);
        let asked = self.discrete.demand.valve_rad > 0.0;
        let flows = self.discrete.isolation > 0.0 && (asked || self.flows_unasked(&now));
        // A map costs some steps' time, so it waits until something flows.
        if flows {
            self.discrete.feed.follow(now.pressurant.tank_pa, now.pressurant.liquid_k);
        }

        // Feet.
        if self.options.ground {
            let (gear, discrete) = (&self.vehicle.landing_gear, &self.discrete);
            if !gear.clear_of_ground(&now.motion, 0.0) || discrete.anchors.count() > 0 {
                let anchors =
                    gear.anchors_after(&self.pads_body_m, &now.motion, 0.0, &discrete.anchors, discrete.grip);
                if anchors != discrete.anchors {
                    self.settled = None;
                    self.discrete.anchors = anchors;
                }
            }
        }
    }

    /// Notes a bottle that no longer feeds the regulator, and a tank above what the regulator keeps.
    fn watch_the_tank(&mut self, now: &NitrogenState) {
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
        let burning = (1.0 - self.outlet(&self.state).1) * self.burning_share(&self.state);
        if now.engine.steady_fuel_kg_s > 0.0 && burning > 0.0 {
            self.discrete.full_fuel_kg_s = now.engine.steady_fuel_kg_s / burning;
        }
        let chamber = || format!("chamber {:.1} bar", now.engine.chamber_pa * 1e-5);
        if !self.discrete.burnt_through
            && self.discrete.full_fuel_kg_s > 0.0
            && self.usable_fuel_kg(&self.state) < tail_s * self.discrete.full_fuel_kg_s
        {
            self.discrete.burnt_through = true;
            self.note(EventKind::FuelBurnThrough, chamber());
        }
        let flame = self.vehicle.engine_parameters.ignition.advance(
            &self.discrete.flame,
            &FlameConditions {
                time: self.time,
                igniter: self.discrete.igniter && !self.discrete.faults.effect.igniter_dead,
                oxidizer_kg_s: now.engine.oxidizer_kg_s,
                chamber_pa: now.engine.chamber_pa,
                // What burns goes on into its tail until it is a flicker; what is out stays out.
                fuel_left: !self.discrete.burnt_through || (self.discrete.flame.lit && burning > FLICKER),
                late_s: self.discrete.faults.effect.light_delay_s,
            },
        );
        match (self.discrete.flame.lit, flame.lit) {
            (false, true) => {
                self.discrete.ignition.get_or_insert(self.time);
                self.light_pool(now);
                self.note(EventKind::Ignition, chamber());
            }
            (true, false) => {
                self.state.burning_fraction = 0.0;
                self.state.fuel_flow_kg_s = 0.0;
                self.note(EventKind::Shutdown, chamber());
            }
            _ => {}
        }
        self.discrete.flame = flame;
    }

    /// Fuel that can still burn: ports that meet leave slivers (kg).
    pub(super) fn usable_fuel_kg(&self, state: &State) -> f64 {
        let grain = &self.vehicle.engine_parameters.grain;
        (self.fuel_kg(state) - grain.fuel_kg(grain.burn_through_radius_m())).max(0.0)
    }
}
