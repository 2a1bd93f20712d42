//! The continuous part of the plant: forces, flows and the rate of its state, once per stage of the
//! integrator. Pure.

use nalgebra::Vector2;

use super::supply::{Supply, levels};
use super::{Evaluation, Plant, Rate, State, motion};
use crate::actuator::{ServoOutput, ServoRate, ServoState};
use crate::disturbance::Effect;
use crate::dynamics::landing_gear::Contact;
use crate::dynamics::mass::{Contents, ContentsRate, FlowTerms, MassRate, MassState, Outflow};
use crate::dynamics::rigid_body::{self, Acceleration, Balance, GimbalMotion, Swing};
use crate::dynamics::slosh::SloshState;
use crate::dynamics::{Kinematics, Load};
use crate::frame::{Mat3, Vec3, frd_from_structural, quaternion_rate};
use crate::propulsion::{NitrogenState, Pair};

/// Servos and thruster valves: where they are and how fast they move.
struct Actuators {
    valve: ServoOutput,
    valve_rate: ServoRate,
    gimbal: GimbalMotion,
    gimbal_rate: GimbalRate,
    rcs_level_rate: Vec3,
}

/// Time derivative of the gimbal servos' angles and rates.
#[derive(Default)]
pub(super) struct GimbalRate {
    pub(super) rate_rad_s: Vector2<f64>,
    pub(super) acceleration_rad_s2: Vector2<f64>,
}

/// Mass properties, couplings held still where the scenario holds them.
struct Mass {
    properties: MassState,
    flow: FlowTerms,
    port_radius_m_s: f64,
}

/// What acts from outside, and where the vehicle meets it.
struct Loads {
    total: Load,
    motion: Kinematics,
    body_from_ned: Mat3,
    wind_ned_m_s: Vec3,
    contact: Contact,
}

impl Plant {
    /// The continuous part at a state, `step_fraction` of a step after the step's beginning. Pure.
    pub fn evaluate(&self, state: &State, step_fraction: f64) -> Evaluation {
        self.evaluate_inline(state, step_fraction)
    }

    /// The block diagram, inlined into each caller, so that a stage computes only what it uses.
    #[inline(always)]
    pub(super) fn evaluate_inline(&self, state: &State, step_fraction: f64) -> Evaluation {
        let actuators = self.actuators(state);
        let supply = self.supply(state, step_fraction, actuators.valve.angle_rad);
        let mass = self.mass(state, &supply);
        let loads = self.loads(state, step_fraction, &actuators, &supply);
        let acceleration = self.balance(state, &actuators, &supply, &mass, &loads);
        Evaluation {
            rate: self.state_rate(state, &actuators, &supply, &mass, &loads, &acceleration),
            engine: supply.engine,
            valve_rad: actuators.valve.angle_rad,
            valve_area_m2: supply.valve_area_m2,
            gimbal_rad: actuators.gimbal.angle_rad,
            pressurant: supply.pressurant,
            mass: mass.properties.vehicle,
            acceleration,
            contact: loads.contact,
            wind_ned_m_s: loads.wind_ned_m_s,
            motion: loads.motion,
        }
    }

    /// Servos and thruster valves.
    #[inline(always)]
    fn actuators(&self, state: &State) -> Actuators {
        let (valve, valve_rate) = self.valve(state);
        let (gimbal, gimbal_rate) = self.gimbal(state);
        Actuators { valve, valve_rate, gimbal, gimbal_rate, rcs_level_rate: self.rcs_level_rate(state) }
    }

    /// Mass properties of what is on board, how fast they change, and what moving contents add to the balance
    /// of momentum.
    #[inline(always)]
    fn mass(&self, state: &State, supply: &Supply) -> Mass {
        let Supply { engine, nitrous_kg, stores_rate, .. } = supply;
        let port_radius_m_s = match self.frozen.port_radius_m {
            None => engine.regression_rate_m_s,
            // The engine sees the frozen port, the mass model the real one: its growth follows from the fuel
            // burnt.
            Some(_) => {
                let grain = &self.vehicle.engine_parameters.grain;
                engine.fuel_kg_s / grain.fuel_per_regression_kg_m(state.port_radius_m)
            }
        };
        let (contents, run_tank_kg_s) =
            self.contents(state, *nitrous_kg, &supply.pressurant, stores_rate.run_tank_kg_s);
        let mut properties = self.vehicle.mass.evaluate(
            &contents,
            &ContentsRate {
                nitrous_kg_s: supply.nitrous_kg_s,
                port_radius_m_s,
                nitrogen_run_tank_kg_s: run_tank_kg_s,
                nitrogen_bottle_kg_s: stores_rate.total_kg_s - run_tank_kg_s,
            },
        );
        self.frozen.hold(&mut properties);
        // The paper's rigid body has neither jet damping nor a moving centre of mass.
        let flow = if self.paper.is_some() {
            FlowTerms::none()
        } else {
            self.flow_terms(state, &properties.rate, supply)
        };
        Mass { properties, flow, port_radius_m_s }
    }

    /// Forces and moments from outside: thrust, thrusters, drag, legs, disturbances.
    #[inline(always)]
    fn loads(&self, state: &State, step_fraction: f64, actuators: &Actuators, supply: &Supply) -> Loads {
        let (vehicle, inputs, atmosphere) = (&self.vehicle, &self.inputs, &self.environment.atmosphere);
        let motion = motion(state);
        let body_from_ned = motion.ned_from_body.transpose();
        let wind_ned_m_s =
            self.environment.wind.velocity_ned_m_s(self.mission_s_at(step_fraction), -state.position_ned_m.z);
        let airspeed_body_m_s = body_from_ned * (state.velocity_ned_m_s - wind_ned_m_s);
        let drag = vehicle.aero.drag(atmosphere.density_kg_m3, airspeed_body_m_s, state.rate_body_rad_s);
        let contact = if self.options.ground {
            vehicle.landing_gear.contact(&self.pads_body_m, &motion, 0.0, &inputs.anchors, inputs.grip)
        } else {
            Contact::NONE
        };
        let Effect { misalignment_rad, thrust_offset_m: [offset_x, offset_y], .. } = inputs.disturbance;
        let thrust_line =
            rigid_body::thrust_direction_body(actuators.gimbal.angle_rad + Vector2::from(misalignment_rad));
        let thrust = Load::at(Vec3::new(offset_x, offset_y, 0.0), thrust_line * supply.engine.thrust_n);
        let disturbance = Load {
            force_body_n: inputs.disturbance.force_body_n,
            moment_body_n_m: inputs.disturbance.moment_body_n_m,
        };
        let thrusters = Load {
            force_body_n: supply.thrusters.force_body_n,
            moment_body_n_m: supply.thrusters.moment_body_n_m,
        };
        Loads {
            total: thrust + disturbance + thrusters + drag + contact.load,
            motion,
            body_from_ned,
            wind_ned_m_s,
            contact,
        }
    }

    /// The balance of momentum of vehicle, liquid and swinging engine.
    #[inline(always)]
    fn balance(
        &self,
        state: &State,
        actuators: &Actuators,
        supply: &Supply,
        mass: &Mass,
        loads: &Loads,
    ) -> Acceleration {
        let vehicle = &self.vehicle;
        let gravity_body_m_s2 = || loads.body_from_ned * self.environment.gravity.acceleration_ned_m_s2();
        // On a stand the liquid feels gravity alone.
        let axial_m_s2 = if self.options.clamped {
            gravity_body_m_s2().z
        } else {
            -loads.total.force_body_n.z / mass.properties.vehicle.mass_kg
        };
        let (tank, density_kg_m3) = (vehicle.mass.tank(), vehicle.nitrous_density_kg_m3);
        let modes = vehicle.slosh.modes(tank, supply.nitrous_kg, density_kg_m3, axial_m_s2);
        let slosh_states = slosh_states(state);
        let sloshing = |n: usize| modes[n].as_ref().map(|mode| (mode, &slosh_states[n]));
        let swing = Swing { part: &mass.properties.swinging, gimbal: actuators.gimbal };
        let balance = Balance {
            vehicle: &mass.properties.vehicle,
            flow: &mass.flow,
            rate_body_rad_s: state.rate_body_rad_s,
            load: loads.total,
            slosh: [sloshing(0), sloshing(1)],
            swing: vehicle.gimbal.engine_inertia.then_some(swing),
        };
        if self.options.clamped {
            rigid_body::clamped(&balance, gravity_body_m_s2()).0
        } else {
            rigid_body::accelerations(&balance)
        }
    }

    /// How fast each field of the state changes: the list.
    #[inline(always)]
    fn state_rate(
        &self,
        state: &State,
        actuators: &Actuators,
        supply: &Supply,
        mass: &Mass,
        loads: &Loads,
        acceleration: &Acceleration,
    ) -> Rate {
        let engine = &supply.engine;
        let parameters = &self.vehicle.engine_parameters;
        let imu_body_m = frd_from_structural(self.vehicle.sensors.imu.position_m);
        let gravity_ned_m_s2 = self.environment.gravity.acceleration_ned_m_s2();
        let lateral = |v: Vector2<f64>| Vec3::new(v.x, v.y, 0.0);
        let clamped = self.options.clamped;
        Rate {
            position_ned_m: if clamped { Vec3::zeros() } else { state.velocity_ned_m_s },
            velocity_ned_m_s: if clamped {
                Vec3::zeros()
            } else {
                loads.motion.ned_from_body * acceleration.specific_force_body_m_s2 + gravity_ned_m_s2
            },
            q_ned_from_body: quaternion_rate(&state.q_ned_from_body, state.rate_body_rad_s),
            rate_body_rad_s: acceleration.angular_body_rad_s2,
            slosh_m: state.slosh_m_s,
            slosh_m_s: lateral(acceleration.slosh_body_m_s2[0]),
            second_slosh_m: state.second_slosh_m_s,
            second_slosh_m_s: lateral(acceleration.slosh_body_m_s2[1]),
            // What the manifold takes up leaves the tank when the step ends.
            nitrous_kg: supply.nitrous_kg_s + (engine.tank_kg_s - engine.oxidizer_kg_s),
            nitrogen_kg: supply.stores_rate.nitrogen_kg_s,
            gas: supply.stores_rate.gas,
            port_radius_m: mass.port_radius_m_s,
            throat_radius_m: if self.frozen.throat { 0.0 } else { engine.throat_erosion_m_s },
            chamber_oxidizer_kg: engine.chamber_gas_rate.oxidizer_kg_s,
            chamber_fuel_kg: engine.chamber_gas_rate.fuel_kg_s,
            manifold_kg: 0.0,
            line_kg_s: 0.0,
            fuel_flow_kg_s: parameters
                .grain
                .fuel_flow_rate_kg_s2(state.fuel_flow_kg_s, engine.steady_fuel_kg_s),
            burning_fraction: parameters.ignition.burning_rate_1_s(
                state.burning_fraction,
                self.inputs.lit,
                &parameters.depletion,
            ),
            valve_rad: actuators.valve_rate.rate_rad_s,
            valve_rad_s: actuators.valve_rate.acceleration_rad_s2,
            gimbal_rad: lateral(actuators.gimbal_rate.rate_rad_s),
            gimbal_rad_s: lateral(actuators.gimbal_rate.acceleration_rad_s2),
            rcs_level: actuators.rcs_level_rate,
            expelled_nozzle_kg: engine.nozzle_kg_s,
            expelled_rcs_kg: supply.thrusters.nitrogen_kg_s,
            expelled_vent_kg: supply.vent_kg_s,
            vented_vapor_kg: supply.vented_vapor_kg_s,
            burnt_kg: engine.fuel_kg_s,
            imu_velocity_body_m_s: acceleration.specific_force_at(imu_body_m, state.rate_body_rad_s),
            imu_angle_body_rad: state.rate_body_rad_s,
        }
    }

    /// Contents for the mass model with so much liquid in the tank (kg), frozen couplings applied, and the
    /// flow of gas into the run tank (kg/s), `transfer_kg_s` where nothing is frozen.
    #[inline(always)]
    pub(super) fn contents(
        &self,
        state: &State,
        nitrous_kg: f64,
        pressurant: &NitrogenState,
        transfer_kg_s: f64,
    ) -> (Contents, f64) {
        let (nitrogen_run_tank_kg, nitrogen_bottle_kg, run_tank_kg_s) =
            self.frozen.nitrogen(pressurant, transfer_kg_s);
        let contents = Contents {
            nitrous_kg,
            nitrous_density_kg_m3: self.vehicle.nitrous_density_kg_m3,
            port_radius_m: state.port_radius_m,
            nitrogen_run_tank_kg,
            nitrogen_bottle_kg,
        };
        (contents, run_tank_kg_s)
    }

    /// What moving contents and outflows add to the balance of momentum.
    #[inline]
    fn flow_terms(&self, state: &State, rate: &MassRate, supply: &Supply) -> FlowTerms {
        let rcs = &self.vehicle.reaction_control;
        let levels = levels(state);
        let level = |pair: Pair| match pair {
            Pair::A => levels.a,
            Pair::B => levels.b,
        };
        let outflow = |position_body_m, mass_flow_kg_s| Outflow { position_body_m, mass_flow_kg_s };
        // Gas in manifold and chamber has no mass in the model: what leaves tank and grain leaves the
        // vehicle. With the nozzle's own flow the momentum of the internal flow would depend on the choice of
        // origin.
        let from_tank_and_grain_kg_s = supply.engine.tank_kg_s + supply.engine.fuel_kg_s;
        let mut terms = FlowTerms::new(
            rate,
            &[
                outflow(self.exit_points.nozzle, from_tank_and_grain_kg_s),
                outflow(self.exit_points.vent, supply.vent_kg_s),
            ],
        );
        let thrusters_kg_s = supply.thrusters.nitrogen_kg_s;
        if thrusters_kg_s > 0.0 {
            // All thrusters are alike, so each has its share of the flow by its level.
            let sum: f64 = rcs.thruster.iter().map(|thruster| level(thruster.pair)).sum();
            for thruster in &rcs.thruster {
                let share = level(thruster.pair) / sum;
                terms.add(&outflow(frd_from_structural(thruster.position_m), share * thrusters_kg_s));
            }
        }
        terms
    }

    /// Rate of the thruster pairs' levels.
    #[inline(always)]
    pub(super) fn rcs_level_rate(&self, state: &State) -> Vec3 {
        if self.options.ideal {
            return Vec3::zeros();
        }
        let rate = self.vehicle.reaction_control.rate(&levels(state), &self.inputs.rcs_duty);
        Vec3::new(rate.a, rate.b, 0.0)
    }

    /// The oxidiser valve behind its play, and the rate of its servo.
    #[inline(always)]
    pub(super) fn valve(&self, state: &State) -> (ServoOutput, ServoRate) {
        if self.options.ideal {
            let output = ServoOutput { angle_rad: state.valve_rad, ..ServoOutput::default() };
            return (output, ServoRate::default());
        }
        let servo = &self.inputs.faults.valve_servo;
        let at = ServoState { angle_rad: state.valve_rad, rate_rad_s: state.valve_rad_s };
        let memory = &self.inputs.valve_memory;
        let rate = servo.rate(&at, self.inputs.valve_command_rad, memory);
        let output = servo.output(&at, &rate, memory);
        (output, rate)
    }

    /// Gimbal behind its play, and the rates of angles and rates of its servos.
    #[inline(always)]
    pub(super) fn gimbal(&self, state: &State) -> (GimbalMotion, GimbalRate) {
        if self.options.ideal_gimbal {
            let motion = GimbalMotion { angle_rad: state.gimbal_rad.xy(), ..GimbalMotion::default() };
            return (motion, GimbalRate::default());
        }
        let axis = |axis: usize| {
            let servo = &self.inputs.faults.gimbal_servo[axis];
            let at = ServoState { angle_rad: state.gimbal_rad[axis], rate_rad_s: state.gimbal_rad_s[axis] };
            let memory = &self.inputs.gimbal_memory[axis];
            let rate = servo.rate(&at, self.inputs.gimbal_command_rad[axis], memory);
            (servo.output(&at, &rate, memory), rate)
        };
        let ((x, x_rate), (y, y_rate)) = (axis(0), axis(1));
        let motion = GimbalMotion {
            angle_rad: Vector2::new(x.angle_rad, y.angle_rad),
            rate_rad_s: Vector2::new(x.rate_rad_s, y.rate_rad_s),
            acceleration_rad_s2: Vector2::new(x.acceleration_rad_s2, y.acceleration_rad_s2),
        };
        let rate = GimbalRate {
            rate_rad_s: Vector2::new(x_rate.rate_rad_s, y_rate.rate_rad_s),
            acceleration_rad_s2: Vector2::new(x_rate.acceleration_rad_s2, y_rate.acceleration_rad_s2),
        };
        (motion, rate)
    }
}

/// Both modes of the liquid.
pub(super) fn slosh_states(state: &State) -> [SloshState; 2] {
    [(&state.slosh_m, &state.slosh_m_s), (&state.second_slosh_m, &state.second_slosh_m_s)]
        .map(|(m, m_s)| SloshState { displacement_body_m: m.xy(), velocity_body_m_s: m_s.xy() })
}
