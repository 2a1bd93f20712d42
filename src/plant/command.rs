//! From a command to what the actuators are told: sequence, engine controller, delays, pulses.

use nalgebra::Vector2;

use super::Plant;
use super::discrete_state::Demand;
use super::sequence::Positions;
use crate::actuator::ServoMemory;
use crate::dynamics::landing_gear::Grip;
use crate::event::EventKind;
use crate::frame::Vec3;
use crate::propulsion::{BelowMinimum, Damage, EngineCondition, Inverse, PairLevels};
use crate::signal::{ActuatorCommand, Throttle};
use crate::time::SimTime;

/// The engine controller solves for the valve angle at this interval, and at every new command.
const ENGINE_CONTROL: SimTime = SimTime::from_us(4_000);

/// Saturation that ended longer ago than this is over.
const SATURATION_MEMORY: SimTime = SimTime::from_us(1_000_000);

impl Plant {
    /// Takes in a command: sequence, engine controller, delays, pulses.
    pub(super) fn latch_commands(&mut self, command: &ActuatorCommand) {
        let throttle_on = self.throttle_on(command);
        let positions = self.sequence.advance(self.time, command, throttle_on);
        self.move_valves(&positions);
        self.control_engine(throttle_on, command.throttle);

        let limit = self.vehicle.gimbal.limit_rad;
        let (gimbal_rad, roll) = if command.armed {
            let within = |angle: f64| angle.clamp(-limit, limit);
            ([command.gimbal_x_rad, command.gimbal_y_rad].map(within), command.rcs_roll.clamp(-1.0, 1.0))
        } else {
            ([0.0; 2], 0.0)
        };
        self.command_valve(self.discrete.demand.valve_rad);
        self.command_thrusters(roll);
        self.command_gimbal(gimbal_rad);
    }

    /// Isolation and vent valves on their way, igniter, hold-down.
    fn move_valves(&mut self, positions: &Positions) {
        let (step_s, inputs) = (self.step.s(), &mut self.inputs);
        let isolation = self.vehicle.isolation_stroke();
        inputs.isolation_opening = self.discrete.fault_memory.isolation_after(
            isolation,
            inputs.isolation_opening,
            positions.isolation_open,
            step_s,
        );
        let vented = if positions.vent_open { 1.0 } else { 0.0 };
        inputs.vent_opening = self.vehicle.vent_stroke().opening_after(inputs.vent_opening, vented, step_s);
        if positions.released {
            inputs.grip = Grip::Free;
        }
        self.discrete.igniter_on = positions.igniter;
    }

    fn command_valve(&mut self, valve_rad: f64) {
        let inputs = &mut self.inputs;
        if self.options.ideal {
            inputs.valve_command_rad =
                self.discrete.fault_memory.valve_target_rad(valve_rad, &inputs.faults.valve_servo);
            let servo = &inputs.faults.valve_servo;
            self.state.valve_rad = servo.at_once(self.state.valve_rad, inputs.valve_command_rad);
            inputs.valve_memory = ServoMemory::at(self.state.valve_rad);
        } else {
            let delay = &mut self.discrete.valve_delay;
            delay.push(self.time, valve_rad);
            inputs.valve_command_rad =
                self.discrete.fault_memory.valve_target_rad(delay.at(self.time), &inputs.faults.valve_servo);
        }
    }

    fn command_thrusters(&mut self, roll: f64) {
        let inputs = &mut self.inputs;
        if self.options.ideal {
            let pairs =
                self.discrete.fault_memory.pairs_open(PairLevels { a: (-roll).max(0.0), b: roll.max(0.0) });
            self.state.rcs_level = Vec3::new(pairs.a, pairs.b, 0.0);
        } else {
            let modulator = &mut self.discrete.modulator;
            let opened = self.vehicle.reaction_control.modulate(modulator, roll, self.time, self.step);
            inputs.rcs_duty = self.discrete.fault_memory.pairs_open(opened);
        }
    }

    fn command_gimbal(&mut self, gimbal_rad: [f64; 2]) {
        let inputs = &mut self.inputs;
        if self.options.ideal_gimbal {
            let servo_target_rad =
                self.discrete.fault_memory.gimbal_target_rad(gimbal_rad, &inputs.faults.gimbal_servo);
            inputs.gimbal_command_rad = Vector2::from(servo_target_rad);
            for (axis, servo_target_rad) in servo_target_rad.into_iter().enumerate() {
                let servo = &inputs.faults.gimbal_servo[axis];
                self.state.gimbal_rad[axis] = servo.at_once(self.state.gimbal_rad[axis], servo_target_rad);
                inputs.gimbal_memory[axis] = ServoMemory::at(self.state.gimbal_rad[axis]);
            }
        } else {
            let delay = &mut self.discrete.gimbal_delay;
            delay.push(self.time, gimbal_rad);
            let delayed_rad = delay.at(self.time);
            let servos = &inputs.faults.gimbal_servo;
            inputs.gimbal_command_rad =
                Vector2::from(self.discrete.fault_memory.gimbal_target_rad(delayed_rad, servos));
        }
    }

    /// Whether a command asks for a running engine: armed, and above the shutdown fraction.
    pub(crate) fn throttle_on(&self, command: &ActuatorCommand) -> bool {
        command.armed && self.throttle_share(command.throttle) >= self.shutdown_fraction()
    }

    /// Throttle as a share of the rated thrust or of the valve's travel.
    fn throttle_share(&self, throttle: Throttle) -> f64 {
        match throttle {
            Throttle::ThrustN(thrust_n) => thrust_n / self.vehicle.rating.thrust_rated_n,
            Throttle::ValveRad(valve_rad) => valve_rad / self.vehicle.valve_servo.upper_rad,
        }
    }

    fn shutdown_fraction(&self) -> f64 {
        if self.options.open_loop {
            f64::MIN_POSITIVE
        } else {
            self.vehicle.engine_parameters.ignition.shutdown_fraction
        }
    }

    /// The engine controller: throttle to valve angle, holding the minimum. It knows the plant's own engine,
    /// as a well identified controller would, and nothing of what is broken in it.
    fn control_engine(&mut self, on: bool, throttle: Throttle) {
        let now = self.time;
        if !on {
            self.discrete.demand = Demand { throttle, solved_at: None, valve_rad: 0.0, thrust_n: 0.0 };
            return;
        }
        let demand = &self.discrete.demand;
        let interval = self.paper.as_ref().map_or(ENGINE_CONTROL, |paper| paper.step);
        let fresh = demand.solved_at.is_some_and(|at| now.since(at) < interval);
        if fresh && demand.throttle == throttle {
            return;
        }
        // The demand is for the burning engine, whatever the flame is doing now.
        let condition = EngineCondition {
            burning_fraction: 1.0,
            chamber_gas: None,
            fuel_flow_kg_s: None,
            damage: Damage::NONE,
            ..self.engine_condition(&self.state)
        };
        let hold = self.vehicle.engine_parameters.ignition.below_minimum == BelowMinimum::Hold
            && !self.options.open_loop;
        let least_n = if hold { self.vehicle.rating.thrust_command_min_n } else { 0.0 };
        let (valve_rad, thrust_n, saturated) = match throttle {
            Throttle::ThrustN(thrust_n) => {
                let thrust_n = thrust_n.max(least_n);
                let inverse = self.inverse(thrust_n, &condition);
                (inverse.valve_rad, thrust_n, inverse.saturated)
            }
            Throttle::ValveRad(valve_rad) => {
                let valve_rad = valve_rad.min(self.vehicle.valve_servo.upper_rad);
                let thrust_at_angle_n = self.thrust_n(valve_rad, &condition);
                // Thrust rises with the angle, so the minimum is solved for only where it is undercut.
                if thrust_at_angle_n < least_n {
                    let at_minimum = self.inverse(least_n, &condition);
                    (at_minimum.valve_rad, least_n, at_minimum.saturated)
                } else {
                    (valve_rad, thrust_at_angle_n, false)
                }
            }
        };
        if saturated && thrust_n > 0.0 {
            // Once per excursion: a demand that rides the limit is one.
            if self.discrete.last_saturation.is_none_or(|last| now.since(last) > SATURATION_MEMORY) {
                self.note(EventKind::Saturated, format!("{thrust_n:.0} N asked for"));
            }
            self.discrete.last_saturation = Some(now);
        }
        let valve_rad =
            if self.options.ideal { valve_rad } else { self.vehicle.rounded_to_encoder(valve_rad) };
        self.discrete.demand = Demand { throttle, solved_at: Some(now), valve_rad, thrust_n };
    }

    /// Valve angle for a thrust (N), by the engine model that the plant flies.
    fn inverse(&self, thrust_n: f64, condition: &EngineCondition) -> Inverse {
        let (engine, feed) = (&self.vehicle.engine, &self.feed_in(&self.state));
        match &self.paper {
            None => engine.inverse(feed, thrust_n, condition, self.solver.warm_start.last),
            Some(paper) => paper.engine.inverse(engine, feed, thrust_n, condition),
        }
    }

    /// Thrust at a valve angle (N), by the same model.
    fn thrust_n(&self, valve_rad: f64, condition: &EngineCondition) -> f64 {
        let (engine, feed) = (&self.vehicle.engine, &self.feed_in(&self.state));
        let area_m2 = engine.valve_area().area_m2(valve_rad);
        let point = match &self.paper {
            None => engine.operating_point(feed, area_m2, condition, self.solver.warm_start.last),
            Some(paper) => paper.engine.operating_point(engine, feed, area_m2, condition),
        };
        point.thrust_n
    }
}
