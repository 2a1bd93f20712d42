//! The plant: what the vehicle does with its commands, from the valve to the feet.
//!
//! [`Plant::step`] is the block diagram. [`Plant::evaluate`] is its continuous part, pure, called once
//! per stage of the integrator: servos, feed and combustion, mass, loads, balance of momentum. Whatever
//! is discrete happens between steps: commands and their delays, the ignition sequence, strokes of the
//! isolation and vent valves, contact anchors, pulses of the thrusters, events.

mod sequence;
pub mod signs;
mod snapshot;
mod state;

pub use sequence::PlantEvent;
pub use snapshot::Snapshot;
pub use state::{Rate, State};

use nalgebra::{Quaternion, Vector2};

use crate::actuator::{DelayLine, ServoOutput, ServoState, StrokeValve};
use crate::dynamics::Load;
use crate::dynamics::landing_gear::{Anchors, Contact, Grip, MAX_LEGS, Motion};
use crate::dynamics::mass::{Contents, ContentsRate, FlowTerms, MassProperties, MassRate, Outflow};
use crate::dynamics::rigid_body::{self, Acceleration, Balance, GimbalMotion, SolveStatus, Swing};
use crate::dynamics::slosh::SloshState;
use crate::environment::Environment;
use crate::frame::{self, Vec3, quaternion_rate, structural_from_frd};
use crate::input::Invalid;
use crate::integrator::rk4_step;
use crate::propulsion::{
    BelowMinimum, ChamberGas, ChamberGasRate, ChamberModel, EngineCondition, FeedMap, Flame, FlameConditions,
    Guess, Modulator, NitrogenState, OperatingPoint, Pair, PairLevels,
};
use crate::scenario::{EngineStart, GimbalActuator, Place, Scenario};
use crate::sensor::Truth;
use crate::signal::{ActuatorCommand, Throttle};
use crate::time::SimTime;
use crate::vehicle::Vehicle;

use sequence::Sequence;

/// The plant's step, unless a test asks for another.
pub const STEP: SimTime = SimTime::from_us(1_000);

/// The engine controller solves for the valve angle at this interval, and at every new command.
const ENGINE_CONTROL: SimTime = SimTime::from_us(4_000);

/// The feed's tables are rebuilt when the tank pressure has moved by so much (Pa): 1e-3 of flow. A rebuild costs
/// some steps' time, so it waits until something flows.
const FEED_TOLERANCE_PA: f64 = 10_000.0;

/// Saturation that ended longer ago than this is over.
const SATURATION_MEMORY: SimTime = SimTime::from_us(1_000_000);

/// A valve that is told to shut and is nearer than this is shut (rad, rad/s): 2e-9 m2 of open area.
const SEATED_RAD: f64 = 1e-3;
const SEATED_RAD_S: f64 = 0.1;

/// Share of a thruster's level below which it is off.
const RCS_OFF: f64 = 1e-6;

/// Share of the flow below which a dying flame is out.
const FLICKER: f64 = 0.02;

/// A store that is nearly empty gives what it has within so long (s): a few steps, so that integration never
/// passes zero.
const DRAIN_S: f64 = 4e-3;

/// Nozzle, vent, and thrusters, at most: the vehicle file's schema allows no more thrusters.
const OUTFLOWS: usize = 2 + 16;

/// The vehicle in its world.
pub struct Plant {
    vehicle: Vehicle,
    environment: Environment,
    options: Options,
    pads_body_m: [Vec3; MAX_LEGS],
    outlets: Outlets,
    rest_height_m: f64,
    step: SimTime,
    time: SimTime,
    state: State,
    held: Held,
    sequence: Sequence,
    events: Vec<PlantEvent>,
    snapshot: Snapshot,
}

/// What a scenario idealises.
#[derive(Clone, Copy, Debug)]
struct Options {
    /// There is ground to stand on.
    ground: bool,
    /// A stand holds the vehicle for the whole run.
    clamped: bool,
    /// Commands come from a schedule and go to the valve as they are.
    open_loop: bool,
    /// Valve and thrusters follow at once.
    ideal: bool,
    /// The gimbal follows at once.
    ideal_gimbal: bool,
}

/// Where mass leaves, body FRD (m).
#[derive(Clone, Copy, Debug)]
struct Outlets {
    nozzle: Vec3,
    vent: Vec3,
}

/// Everything discrete: constant inside a step.
#[derive(Clone, Debug)]
struct Held {
    /// Valve angle and gimbal angles as they reach the servos (rad).
    valve_command_rad: f64,
    gimbal_command_rad: Vector2<f64>,
    valve_delay: DelayLine<f64>,
    gimbal_delay: DelayLine<[f64; 2]>,
    /// Angles behind the play (rad).
    valve_play_rad: f64,
    gimbal_play_rad: Vector2<f64>,
    /// Openings, 0 shut to 1 open.
    isolation: f64,
    vent: f64,
    grip: Grip,
    anchors: Anchors,
    feed: FeedMap,
    /// Where the engine's solver looks first, and how that moved in the last step.
    guess: Guess,
    guess_trend: Guess,
    modulator: Modulator,
    /// Share of the step in which the valves of each thruster pair are open.
    rcs_open: PairLevels,
    /// What the engine controller made of the throttle.
    demand: Demand,
    flame: Flame,
    igniter: bool,
    ignition: Option<SimTime>,
    /// Fuel flow of the fully burning oxidiser at the last step (kg/s).
    full_fuel_kg_s: f64,
    burnt_through: bool,
    nitrous_depleted: bool,
    bottle_low: bool,
    /// When the engine controller last could not give what was asked for.
    saturated: Option<SimTime>,
    /// The balance of momentum had no solution.
    singular: bool,
}

impl Held {
    /// Where the solver looks first, `share` of a step on: as it moved in the last step.
    fn guess_at(&self, share: f64) -> Guess {
        Guess {
            injector_inlet_pa: self.guess.injector_inlet_pa + share * self.guess_trend.injector_inlet_pa,
            log_chamber_pressure: self.guess.log_chamber_pressure
                + share * self.guess_trend.log_chamber_pressure,
            ..self.guess
        }
    }

    /// Takes in the solution at the end of a step.
    fn look_from(&mut self, next: Guess) {
        let settled = self.guess.injector_inlet_pa > 0.0 && next.injector_inlet_pa > 0.0;
        self.guess_trend = if settled {
            Guess {
                injector_inlet_pa: next.injector_inlet_pa - self.guess.injector_inlet_pa,
                log_chamber_pressure: next.log_chamber_pressure - self.guess.log_chamber_pressure,
                slope_kg_s_pa: 0.0,
            }
        } else {
            Guess::default()
        };
        self.guess = next;
    }
}

/// What the engine controller made of the throttle, and when.
#[derive(Clone, Copy, Debug)]
struct Demand {
    throttle: Throttle,
    solved: Option<SimTime>,
    valve_rad: f64,
    thrust_n: f64,
}

/// Everything that [`Plant::evaluate`] finds at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Evaluation {
    /// Time derivative of the state.
    pub rate: Rate,
    /// Engine.
    pub engine: OperatingPoint,
    /// Oxidiser valve behind the play (rad).
    pub valve_rad: f64,
    /// Open area of the oxidiser valve (m²).
    pub valve_area_m2: f64,
    /// Gimbal behind the play (rad).
    pub gimbal_rad: Vector2<f64>,
    /// Bottle and run tank.
    pub pressurant: NitrogenState,
    /// Mass properties about the pivot, liquid at rest, engine at zero gimbal.
    pub mass: MassProperties,
    /// Accelerations and slosh force.
    pub acceleration: Acceleration,
    /// Legs.
    pub contact: Contact,
    /// Velocity of the air (m/s).
    pub wind_ned_m_s: Vec3,
}

impl Plant {
    /// The plant at step 0 of a scenario.
    ///
    /// # Errors
    /// When the initial state contradicts the vehicle.
    pub fn new(scenario: &Scenario) -> Result<Self, Invalid> {
        Self::with_step(scenario, STEP)
    }

    /// The same with another step, to see what the integration contributes.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn with_step(scenario: &Scenario, step: SimTime) -> Result<Self, Invalid> {
        let vehicle = scenario.vehicle.clone();
        let start = &scenario.file.initial;
        let running = start.engine == EngineStart::Running;
        let actuators = scenario.file.actuators;
        let options = Options {
            ground: start.place == Place::Pad,
            clamped: start.clamped,
            open_loop: scenario.schedule.is_some(),
            ideal: actuators.ideal,
            ideal_gimbal: actuators.ideal && actuators.gimbal != Some(GimbalActuator::Servo),
        };
        if options.clamped && (start.velocity_ned_m_s != [0.0; 3] || start.rate_body_rad_s != [0.0; 3]) {
            return Err(Invalid::new("initial.clamped", "a clamped vehicle has neither velocity nor rate"));
        }
        if options.ideal_gimbal && vehicle.gimbal.engine_inertia {
            return Err(Invalid::new(
                "model.gimbal_inertia",
                "must be false with an ideal gimbal: a step in angle would have infinite acceleration",
            ));
        }
        let nitrous_kg = start.nitrous_kg.unwrap_or_else(|| vehicle.initial_nitrous_kg());
        if nitrous_kg > vehicle.tank_capacity_kg() {
            return Err(Invalid::new(
                "initial.nitrous_kg",
                format!(
                    "{nitrous_kg} is out of range; the tank holds 0 to {:.3}",
                    vehicle.tank_capacity_kg()
                ),
            ));
        }
        let port_radius_m = start.port_radius_m.unwrap_or(vehicle.engine_parameters.grain.port_radius_m);
        let burn_through_m = vehicle.engine_parameters.grain.burn_through_radius_m();
        if port_radius_m > burn_through_m {
            return Err(Invalid::new(
                "initial.port_radius_m",
                format!("{port_radius_m} is out of range; allowed up to burn-through at {burn_through_m}"),
            ));
        }
        let nitrogen_kg =
            start.nitrogen_kg.unwrap_or_else(|| vehicle.initial_nitrogen_kg(vehicle.initial_nitrous_kg()));
        let throat_radius_m =
            start.throat_radius_m.unwrap_or(0.5 * vehicle.engine_parameters.nozzle.throat_diameter_m);
        let widest_m = vehicle.engine.nozzle().greatest_throat_radius_m();
        if throat_radius_m > widest_m {
            return Err(Invalid::new(
                "initial.throat_radius_m",
                format!("{throat_radius_m} is out of range; allowed up to {widest_m:.6}, short of the exit"),
            ));
        }
        let environment = Environment::new(&scenario.site, &scenario.file.wind)?;
        let nitrogen = vehicle.nitrogen(nitrogen_kg, nitrous_kg, environment.atmosphere.pressure_pa);
        let q = start.q_ned_from_body;
        let state = State {
            position_ned_m: Vec3::from(start.position_ned_m),
            velocity_ned_m_s: Vec3::from(start.velocity_ned_m_s),
            q_ned_from_body: Quaternion::new(q[0], q[1], q[2], q[3]).normalize(),
            rate_body_rad_s: Vec3::from(start.rate_body_rad_s),
            nitrous_kg,
            nitrogen_kg,
            port_radius_m,
            throat_radius_m,
            ..State::EMPTY
        };
        let mut plant = Self {
            environment,
            options,
            pads_body_m: vehicle.landing_gear.pads_body_m(),
            outlets: Outlets {
                nozzle: Vec3::new(0.0, 0.0, -vehicle.engine_parameters.nozzle.exit_z_m),
                vent: Vec3::new(0.0, 0.0, -(vehicle.tank.floor_z_m + vehicle.tank.length_m)),
            },
            rest_height_m: 0.0,
            step,
            time: SimTime::ZERO,
            state,
            held: Held {
                valve_command_rad: 0.0,
                gimbal_command_rad: Vector2::zeros(),
                valve_delay: DelayLine::for_interval(SimTime::from_s(vehicle.valve_delay_s), 0.0, step),
                gimbal_delay: DelayLine::for_interval(
                    SimTime::from_s(vehicle.gimbal.delay_s),
                    [0.0; 2],
                    step,
                ),
                valve_play_rad: 0.0,
                gimbal_play_rad: Vector2::zeros(),
                isolation: if running { 1.0 } else { 0.0 },
                vent: 0.0,
                grip: if options.ground && !running { Grip::Held } else { Grip::Free },
                anchors: Anchors::default(),
                feed: FeedMap::new(nitrogen.tank_pa, vehicle.tank.temperature_k),
                guess: Guess::default(),
                guess_trend: Guess::default(),
                modulator: Modulator::default(),
                rcs_open: PairLevels::default(),
                demand: Demand {
                    throttle: Throttle::ValveRad(0.0),
                    solved: None,
                    valve_rad: 0.0,
                    thrust_n: 0.0,
                },
                flame: Flame { lit: running, was_lit: running, ..Flame::default() },
                igniter: false,
                ignition: running.then_some(SimTime::ZERO),
                full_fuel_kg_s: 0.0,
                burnt_through: false,
                nitrous_depleted: nitrous_kg <= vehicle.tank.unusable_nitrous_kg,
                bottle_low: false,
                saturated: None,
                singular: false,
            },
            sequence: Sequence::new(scenario, vehicle.hold_down.release_time_s),
            events: Vec::new(),
            snapshot: Snapshot::default(),
            vehicle,
        };
        let weight_n =
            plant.evaluate(&plant.state, 0.0).mass.mass_kg * plant.environment.gravity.magnitude_m_s2;
        plant.rest_height_m = plant.vehicle.landing_gear.rest_height_m(weight_n);
        if options.ground {
            plant.stand()?;
        }
        if let Some(schedule) = scenario.schedule.as_ref().filter(|_| running) {
            plant.run_steady(schedule.at(SimTime::ZERO));
        }
        plant.snapshot = plant.snapshot_of(&plant.evaluate(&plant.state, 0.0));
        Ok(plant)
    }

    /// Puts the vehicle on its legs, at rest and upright.
    fn stand(&mut self) -> Result<(), Invalid> {
        if frame::tilt_rad(&self.state.attitude()) > 1e-3 {
            return Err(Invalid::new("initial.q_ned_from_body", "on the pad the vehicle stands upright"));
        }
        self.state.position_ned_m.z = -self.rest_height_m;
        self.state.velocity_ned_m_s = Vec3::zeros();
        self.state.rate_body_rad_s = Vec3::zeros();
        let motion = motion(&self.state);
        let gear = &self.vehicle.landing_gear;
        self.held.anchors =
            gear.anchors_after(&self.pads_body_m, &motion, 0.0, &Anchors::default(), Grip::Free);
        Ok(())
    }

    /// Lights the engine and brings it to its steady state under a command, at step 0.
    fn run_steady(&mut self, command: &ActuatorCommand) {
        self.state.burning_fraction = 1.0;
        self.obey(command);
        self.state.valve_rad = self.held.demand.valve_rad;
        self.held.valve_command_rad = self.held.demand.valve_rad;
        self.held.valve_play_rad = self.held.demand.valve_rad;
        self.held.valve_delay = DelayLine::for_interval(
            SimTime::from_s(self.vehicle.valve_delay_s),
            self.state.valve_rad,
            self.step,
        );
        if self.vehicle.engine_parameters.chamber.model == ChamberModel::Filling {
            self.fill_chamber();
        }
    }

    /// Lets the chamber fill at the present valve angle until nothing changes any more.
    fn fill_chamber(&mut self) {
        let area_m2 = self.vehicle.engine.valve_area().area_m2(self.state.valve_rad);
        let at_rest = self.vehicle.engine.gas_at_rest(&self.condition(&self.state));
        let mut gas = at_rest;
        let rate = |gas: ChamberGas| {
            let condition = EngineCondition { chamber_gas: Some(gas), ..self.condition(&self.state) };
            self.vehicle
                .engine
                .operating_point(&self.held.feed, area_m2, &condition, self.held.guess)
                .chamber_gas_rate
        };
        let moved = |gas: ChamberGas, rate: ChamberGasRate, dt_s: f64| ChamberGas {
            oxidizer_kg: gas.oxidizer_kg + rate.oxidizer_kg_s * dt_s,
            fuel_kg: gas.fuel_kg + rate.fuel_kg_s * dt_s,
        };
        // Midpoint steps of 0.5 ms over a second: sixty time constants of the largest chamber.
        for _ in 0..2_000 {
            let half = moved(gas, rate(gas), 0.25e-3);
            gas = moved(gas, rate(half), 0.5e-3);
        }
        self.state.chamber_oxidizer_kg = gas.oxidizer_kg;
        self.state.chamber_fuel_kg = gas.fuel_kg;
    }

    /// One step under a command: the block diagram.
    pub fn step(&mut self, command: &ActuatorCommand) {
        self.obey(command);
        self.state = rk4_step(&self.state, self.step.s(), |state, share| self.evaluate(state, share).rate);
        self.state.q_ned_from_body.normalize_mut();
        self.time = self.time + self.step;
        self.settle();
    }

    /// Takes in a command: sequence, engine controller, delays, pulses.
    fn obey(&mut self, command: &ActuatorCommand) {
        let now = self.time;
        let throttle_on = self.throttle_on(command);
        let positions = self.sequence.obey(now, command, throttle_on);
        let held = &mut self.held;
        let stroke = |valve: StrokeValve, opening: f64, open: bool| {
            valve.opening_after(opening, if open { 1.0 } else { 0.0 }, self.step.s())
        };
        held.isolation = stroke(self.vehicle.isolation_stroke(), held.isolation, positions.isolation_open);
        held.vent = stroke(self.vehicle.vent_stroke(), held.vent, positions.vent_open);
        held.igniter = positions.igniter;
        held.grip = if held.grip == Grip::Held && !positions.released { Grip::Held } else { Grip::Free };

        self.control_engine(throttle_on, command.throttle);
        let limit = self.vehicle.gimbal.limit_rad;
        let gimbal = if command.armed {
            [command.gimbal_x_rad, command.gimbal_y_rad].map(|angle| angle.clamp(-limit, limit))
        } else {
            [0.0; 2]
        };
        let roll = if command.armed { command.rcs_roll.clamp(-1.0, 1.0) } else { 0.0 };

        let held = &mut self.held;
        let valve_rad = held.demand.valve_rad;
        if self.options.ideal {
            held.valve_command_rad = valve_rad;
            self.state.valve_rad = valve_rad;
            held.valve_play_rad = valve_rad;
            self.state.rcs_level = Vec3::new((-roll).max(0.0), roll.max(0.0), 0.0);
        } else {
            held.valve_delay.push(now, valve_rad);
            held.valve_command_rad = held.valve_delay.at(now);
            held.rcs_open = self.vehicle.reaction_control.modulate(&mut held.modulator, roll, now, self.step);
        }
        if self.options.ideal_gimbal {
            held.gimbal_command_rad = Vector2::from(gimbal);
            self.state.gimbal_rad = Vec3::new(gimbal[0], gimbal[1], 0.0);
            held.gimbal_play_rad = held.gimbal_command_rad;
        } else {
            held.gimbal_delay.push(now, gimbal);
            held.gimbal_command_rad = Vector2::from(held.gimbal_delay.at(now));
        }
    }

    /// Whether a command asks for a running engine: armed, and above the shutdown fraction.
    pub fn throttle_on(&self, command: &ActuatorCommand) -> bool {
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

    /// The engine controller: throttle to valve angle, holding the minimum. It knows the plant's own
    /// engine, as a well identified controller would.
    fn control_engine(&mut self, on: bool, throttle: Throttle) {
        let now = self.time;
        if !on {
            self.held.demand = Demand { throttle, solved: None, valve_rad: 0.0, thrust_n: 0.0 };
            return;
        }
        let demand = &self.held.demand;
        let fresh = demand.solved.is_some_and(|at| now.since(at) < ENGINE_CONTROL);
        if fresh && demand.throttle == throttle {
            return;
        }
        let engine = &self.vehicle.engine;
        // The demand is for the burning engine, whatever the flame is doing now.
        let condition =
            EngineCondition { burning_fraction: 1.0, chamber_gas: None, ..self.condition(&self.state) };
        let hold = self.vehicle.engine_parameters.ignition.below_minimum == BelowMinimum::Hold
            && !self.options.open_loop;
        let least_n = if hold { self.vehicle.rating.thrust_command_min_n } else { 0.0 };
        let feed = &self.held.feed;
        let (valve_rad, thrust_n, saturated) = match throttle {
            Throttle::ThrustN(thrust_n) => {
                let inverse = engine.inverse(feed, thrust_n.max(least_n), &condition, self.held.guess);
                (inverse.valve_rad, thrust_n.max(least_n), inverse.saturated)
            }
            Throttle::ValveRad(valve_rad) => {
                let valve_rad = valve_rad.min(self.vehicle.valve_servo.upper_rad);
                let area_m2 = engine.valve_area().area_m2(valve_rad);
                let point = engine.operating_point(feed, area_m2, &condition, self.held.guess);
                // Thrust rises with the angle, so the minimum is solved for only where it is undercut.
                if point.thrust_n < least_n {
                    let held = engine.inverse(feed, least_n, &condition, self.held.guess);
                    (held.valve_rad, least_n, held.saturated)
                } else {
                    (valve_rad, point.thrust_n, false)
                }
            }
        };
        if saturated && thrust_n > 0.0 {
            // Once per excursion: a demand that rides the limit is one.
            if self.held.saturated.is_none_or(|last| now.since(last) > SATURATION_MEMORY) {
                self.note("saturated", format!("{thrust_n:.0} N asked for"));
            }
            self.held.saturated = Some(now);
        }
        let valve_rad = if self.options.ideal { valve_rad } else { self.vehicle.encoded(valve_rad) };
        self.held.demand = Demand { throttle, solved: Some(now), valve_rad, thrust_n };
    }

    /// Conditions of the engine at a state.
    fn condition(&self, state: &State) -> EngineCondition {
        let parameters = &self.vehicle.engine_parameters;
        let tail_s = parameters.depletion.tail_time_constant_s;
        // Gas follows the liquid, and what fuel is left burns: each leaves within the tail's time constant,
        // so neither store reaches zero within a step.
        let drain_s = if self.held.nitrous_depleted { tail_s } else { DRAIN_S };
        let fuel_share = self.usable_fuel_kg(state) / (tail_s * self.held.full_fuel_kg_s);
        EngineCondition {
            port_radius_m: state.port_radius_m,
            throat_radius_m: state.throat_radius_m,
            // A share of 0/0, no flow yet, limits nothing.
            burning_fraction: if fuel_share < 1.0 {
                state.burning_fraction.min(fuel_share)
            } else {
                state.burning_fraction
            },
            ambient_pa: self.environment.atmosphere.pressure_pa,
            chamber_gas: (parameters.chamber.model == ChamberModel::Filling).then_some(ChamberGas {
                oxidizer_kg: state.chamber_oxidizer_kg,
                fuel_kg: state.chamber_fuel_kg,
            }),
            oxidizer_flow_limit_kg_s: state.nitrous_kg.max(0.0) / drain_s,
        }
    }

    /// The continuous part at a state, `share` of a step after the step's beginning. Pure.
    pub fn evaluate(&self, state: &State, share: f64) -> Evaluation {
        let (vehicle, held) = (&self.vehicle, &self.held);

        // Actuators.
        let (valve, valve_rate) = self.valve(state);
        let (gimbal, gimbal_rate) = self.gimbal(state);
        let rcs_rate = if self.options.ideal {
            Vec3::zeros()
        } else {
            let rate = vehicle.reaction_control.rate(&levels(state), &held.rcs_open);
            Vec3::new(rate.a, rate.b, 0.0)
        };

        // Feed and combustion.
        let valve_area_m2 = vehicle.engine.valve_area().area_m2(valve.angle_rad);
        let open_area_m2 = vehicle.isolation.limited_area_m2(valve_area_m2, held.isolation);
        let engine = vehicle.engine.operating_point(
            &held.feed,
            open_area_m2,
            &self.condition(state),
            held.guess_at(share),
        );

        // Pressurant.
        let ambient_pa = self.environment.atmosphere.pressure_pa;
        let pressurant = vehicle.nitrogen(state.nitrogen_kg, state.nitrous_kg, ambient_pa);
        let thrusters = vehicle.reaction_control.loads(&levels(state), pressurant.bottle_pa);
        let vent_kg_s = vehicle.vent_kg_s(&pressurant, held.vent, ambient_pa);

        // Mass.
        let contents = Contents {
            nitrous_kg: state.nitrous_kg,
            nitrous_density_kg_m3: vehicle.nitrous_density_kg_m3,
            port_radius_m: state.port_radius_m,
            nitrogen_run_tank_kg: pressurant.tank_kg,
            nitrogen_bottle_kg: pressurant.bottle_kg,
        };
        let nitrogen_kg_s = -(thrusters.nitrogen_kg_s + vent_kg_s);
        // What fills the room that the liquid leaves, at constant pressure.
        let ullage_m3 = vehicle.ullage_m3(state.nitrous_kg);
        let ullage_kg_m3 = if ullage_m3 > 0.0 { pressurant.tank_kg / ullage_m3 } else { 0.0 };
        let run_tank_kg_s = ullage_kg_m3 * engine.oxidizer_kg_s / vehicle.nitrous_density_kg_m3;
        let mass = vehicle.mass.evaluate(
            &contents,
            &ContentsRate {
                nitrous_kg_s: -engine.oxidizer_kg_s,
                port_radius_m_s: engine.regression_rate_m_s,
                nitrogen_run_tank_kg_s: run_tank_kg_s,
                nitrogen_bottle_kg_s: nitrogen_kg_s - run_tank_kg_s,
            },
        );
        // The gas in the chamber is in no mass property: what leaves liquid and grain leaves the vehicle. With
        // the nozzle's own flow the momentum of the internal flow would depend on the choice of origin.
        let burnt_kg_s = engine.oxidizer_kg_s + engine.fuel_kg_s;
        let flow = self.flow_terms(state, &mass.rate, burnt_kg_s, vent_kg_s, thrusters.nitrogen_kg_s);

        // Loads.
        let motion = motion(state);
        let body_from_ned = motion.ned_from_body.transpose();
        let wind_ned_m_s = self.environment.wind.velocity_ned_m_s(self.mission_s_at(share));
        let airspeed_body = body_from_ned * (state.velocity_ned_m_s - wind_ned_m_s);
        let drag = vehicle.aero.drag(
            self.environment.atmosphere.density_kg_m3,
            airspeed_body,
            state.rate_body_rad_s,
        );
        let contact = if self.options.ground {
            vehicle.landing_gear.contact(&self.pads_body_m, &motion, 0.0, &held.anchors, held.grip)
        } else {
            Contact::NONE
        };
        let thrust = Load {
            force_body_n: rigid_body::thrust_direction_body(gimbal.angle_rad) * engine.thrust_n,
            moment_body_n_m: Vec3::zeros(),
        };
        let load = thrust
            + Load { force_body_n: thrusters.force_body_n, moment_body_n_m: thrusters.moment_body_n_m }
            + drag
            + contact.load;

        // Slosh, and the balance of momentum.
        // A stand carries what the other forces leave: the liquid feels gravity alone.
        let gravity_ned = self.environment.gravity.acceleration_ned_m_s2();
        let axial_m_s2 = if self.options.clamped {
            (body_from_ned * gravity_ned).z
        } else {
            -load.force_body_n.z / mass.vehicle.mass_kg
        };
        let mode = vehicle.slosh.mode(
            vehicle.mass.tank(),
            state.nitrous_kg,
            vehicle.nitrous_density_kg_m3,
            axial_m_s2,
        );
        let slosh_state =
            SloshState { displacement_body_m: state.slosh_m.xy(), velocity_body_m_s: state.slosh_m_s.xy() };
        let balance = Balance {
            vehicle: &mass.vehicle,
            flow: &flow,
            rate_body_rad_s: state.rate_body_rad_s,
            load,
            slosh: mode.as_ref().map(|mode| (mode, &slosh_state)),
            swing: vehicle.gimbal.engine_inertia.then_some(Swing { part: &mass.swinging, gimbal }),
        };
        let acceleration = if self.options.clamped {
            rigid_body::clamped(&balance, body_from_ned * gravity_ned).0
        } else {
            rigid_body::accelerations(&balance)
        };

        let imu = Vec3::from(vehicle.sensors.imu.position_m);
        let lateral = |v: Vector2<f64>| Vec3::new(v.x, v.y, 0.0);
        let fixed = self.options.clamped;
        let rate = Rate {
            position_ned_m: if fixed { Vec3::zeros() } else { state.velocity_ned_m_s },
            velocity_ned_m_s: if fixed {
                Vec3::zeros()
            } else {
                motion.ned_from_body * acceleration.specific_force_body_m_s2 + gravity_ned
            },
            q_ned_from_body: quaternion_rate(&state.q_ned_from_body, state.rate_body_rad_s),
            rate_body_rad_s: acceleration.angular_body_rad_s2,
            slosh_m: state.slosh_m_s,
            slosh_m_s: lateral(acceleration.slosh_body_m_s2),
            nitrous_kg: -engine.oxidizer_kg_s,
            nitrogen_kg: nitrogen_kg_s,
            port_radius_m: engine.regression_rate_m_s,
            throat_radius_m: engine.throat_erosion_m_s,
            chamber_oxidizer_kg: engine.chamber_gas_rate.oxidizer_kg_s,
            chamber_fuel_kg: engine.chamber_gas_rate.fuel_kg_s,
            burning_fraction: vehicle.engine_parameters.ignition.burning_rate_1_s(
                state.burning_fraction,
                held.flame.lit,
                &vehicle.engine_parameters.depletion,
            ),
            valve_rad: valve_rate.angle_rad,
            valve_rad_s: valve_rate.rate_rad_s,
            gimbal_rad: lateral(gimbal_rate[0]),
            gimbal_rad_s: lateral(gimbal_rate[1]),
            rcs_level: rcs_rate,
            expelled_nozzle_kg: engine.nozzle_kg_s,
            expelled_rcs_kg: thrusters.nitrogen_kg_s,
            expelled_vent_kg: vent_kg_s,
            imu_velocity_body_m_s: acceleration.specific_force_at(imu, state.rate_body_rad_s),
            imu_angle_body_rad: state.rate_body_rad_s,
        };
        Evaluation {
            rate,
            engine,
            valve_rad: valve.angle_rad,
            valve_area_m2,
            gimbal_rad: gimbal.angle_rad,
            pressurant,
            mass: mass.vehicle,
            acceleration,
            contact,
            wind_ned_m_s,
        }
    }

    /// What moving contents and outflows add to the balance of momentum.
    fn flow_terms(
        &self,
        state: &State,
        rate: &MassRate,
        nozzle_kg_s: f64,
        vent_kg_s: f64,
        thrusters_kg_s: f64,
    ) -> FlowTerms {
        let rcs = &self.vehicle.reaction_control;
        let levels = levels(state);
        let level = |pair: Pair| match pair {
            Pair::A => levels.a,
            Pair::B => levels.b,
        };
        // All thrusters are alike, so each has its share of the flow by its level.
        let sum: f64 = rcs.thruster.iter().map(|thruster| level(thruster.pair)).sum();
        let per_level_kg_s = if sum > 0.0 { thrusters_kg_s / sum } else { 0.0 };
        let mut outflows =
            [Outflow { position_body_m: self.outlets.nozzle, mass_flow_kg_s: nozzle_kg_s }; OUTFLOWS];
        outflows[1] = Outflow { position_body_m: self.outlets.vent, mass_flow_kg_s: vent_kg_s };
        for (outflow, thruster) in outflows[2..].iter_mut().zip(&rcs.thruster) {
            *outflow = Outflow {
                position_body_m: Vec3::from(thruster.position_m),
                mass_flow_kg_s: level(thruster.pair) * per_level_kg_s,
            };
        }
        let count = 2 + rcs.thruster.len().min(OUTFLOWS - 2);
        FlowTerms::new(rate, &outflows[..count])
    }

    /// The oxidiser valve behind its play, and the rate of its servo.
    fn valve(&self, state: &State) -> (ServoOutput, ServoState) {
        if self.options.ideal {
            let output = ServoOutput { angle_rad: state.valve_rad, ..ServoOutput::default() };
            return (output, ServoState::default());
        }
        let servo = &self.vehicle.valve_servo;
        let at = ServoState { angle_rad: state.valve_rad, rate_rad_s: state.valve_rad_s };
        let rate = servo.rate(&at, self.held.valve_command_rad);
        let output = servo.output(&at, &rate, self.held.valve_play_rad);
        (output, ServoState { angle_rad: rate.rate_rad_s, rate_rad_s: rate.acceleration_rad_s2 })
    }

    /// Gimbal behind its play, and the rates of angles and rates of its servos.
    fn gimbal(&self, state: &State) -> (GimbalMotion, [Vector2<f64>; 2]) {
        if self.options.ideal_gimbal {
            let motion = GimbalMotion { angle_rad: state.gimbal_rad.xy(), ..GimbalMotion::default() };
            return (motion, [Vector2::zeros(); 2]);
        }
        let servo = &self.vehicle.gimbal_servo;
        let axis = |axis: usize| {
            let at = ServoState { angle_rad: state.gimbal_rad[axis], rate_rad_s: state.gimbal_rad_s[axis] };
            let rate = servo.rate(&at, self.held.gimbal_command_rad[axis]);
            (servo.output(&at, &rate, self.held.gimbal_play_rad[axis]), rate)
        };
        let ((x, x_rate), (y, y_rate)) = (axis(0), axis(1));
        let motion = GimbalMotion {
            angle_rad: Vector2::new(x.angle_rad, y.angle_rad),
            rate_rad_s: Vector2::new(x.rate_rad_s, y.rate_rad_s),
            acceleration_rad_s2: Vector2::new(x.acceleration_rad_s2, y.acceleration_rad_s2),
        };
        let rates = [
            Vector2::new(x_rate.rate_rad_s, y_rate.rate_rad_s),
            Vector2::new(x_rate.acceleration_rad_s2, y_rate.acceleration_rad_s2),
        ];
        (motion, rates)
    }

    /// Discrete events after a step.
    fn settle(&mut self) {
        let now = self.evaluate(&self.state, 0.0);
        self.snapshot = self.snapshot_of(&now);
        self.held.look_from(now.engine.guess);
        if now.acceleration.status == SolveStatus::Singular && !self.held.singular {
            self.held.singular = true;
            self.note("abort:singular", "mass or inertia is not that of a body".to_owned());
        }

        // What integration may leave a rounding below zero.
        self.state.nitrous_kg = self.state.nitrous_kg.max(0.0);
        self.state.nitrogen_kg = self.state.nitrogen_kg.max(0.0);
        self.state.burning_fraction = self.state.burning_fraction.clamp(0.0, 1.0);

        // A thruster that has died away is off; its first-order decay would never end.
        for (axis, open) in [(0, self.held.rcs_open.a), (1, self.held.rcs_open.b)] {
            if open == 0.0 && self.state.rcs_level[axis] < RCS_OFF {
                self.state.rcs_level[axis] = 0.0;
            }
        }

        // A ball that is told to shut seats; a servo alone would only ever come near.
        if self.held.valve_command_rad == 0.0
            && self.state.valve_rad.abs() < SEATED_RAD
            && self.state.valve_rad_s.abs() < SEATED_RAD_S
        {
            self.state.valve_rad = 0.0;
            self.state.valve_rad_s = 0.0;
            self.held.valve_play_rad = 0.0;
        }

        // Play.
        let state = &self.state;
        let at = |angle_rad: f64| ServoState { angle_rad, rate_rad_s: 0.0 };
        if state.valve_rad > 0.0 {
            self.held.valve_play_rad =
                self.vehicle.valve_servo.held_after(&at(state.valve_rad), self.held.valve_play_rad);
        }
        for axis in 0..2 {
            self.held.gimbal_play_rad[axis] = self
                .vehicle
                .gimbal_servo
                .held_after(&at(state.gimbal_rad[axis]), self.held.gimbal_play_rad[axis]);
        }

        self.settle_flame(&now);

        // Depletion.
        if !self.held.nitrous_depleted && self.state.nitrous_kg <= self.vehicle.tank.unusable_nitrous_kg {
            self.held.nitrous_depleted = true;
            self.note("nitrous_depleted", format!("{:.3} kg of gas left", self.state.nitrous_kg));
        }
        if now.pressurant.regulated {
            self.held.bottle_low = false;
        } else if !self.held.bottle_low {
            self.held.bottle_low = true;
            self.note("bottle_low", format!("bottle {:.1} bar", now.pressurant.bottle_pa * 1e-5));
        }
        let flows = self.held.isolation > 0.0 && self.held.demand.valve_rad > 0.0;
        if flows && (now.pressurant.tank_pa - self.held.feed.built_for().0).abs() > FEED_TOLERANCE_PA {
            self.held.feed.rebuild(now.pressurant.tank_pa, self.vehicle.tank.temperature_k);
        }

        // Feet.
        if self.options.ground {
            let motion = motion(&self.state);
            let gear = &self.vehicle.landing_gear;
            self.held.anchors =
                gear.anchors_after(&self.pads_body_m, &motion, 0.0, &self.held.anchors, self.held.grip);
        }
    }

    /// Lights or goes out; notices when fuel begins to limit the flame.
    fn settle_flame(&mut self, now: &Evaluation) {
        let tail_s = self.vehicle.engine_parameters.depletion.tail_time_constant_s;
        let burning = self.condition(&self.state).burning_fraction;
        if now.engine.fuel_kg_s > 0.0 && burning > 0.0 {
            self.held.full_fuel_kg_s = now.engine.fuel_kg_s / burning;
        }
        let chamber = || format!("chamber {:.1} bar", now.engine.chamber_pa * 1e-5);
        if !self.held.burnt_through
            && self.held.full_fuel_kg_s > 0.0
            && self.usable_fuel_kg(&self.state) < tail_s * self.held.full_fuel_kg_s
        {
            self.held.burnt_through = true;
            self.note("fuel_burn_through", chamber());
        }
        let flame = self.vehicle.engine_parameters.ignition.advance(
            &self.held.flame,
            &FlameConditions {
                time: self.time,
                igniter: self.held.igniter,
                oxidizer_kg_s: now.engine.oxidizer_kg_s,
                chamber_pa: now.engine.chamber_pa,
                // What burns goes on into its tail until it is a flicker; what is out stays out.
                fuel_left: !self.held.burnt_through || (self.held.flame.lit && burning > FLICKER),
            },
        );
        match (self.held.flame.lit, flame.lit) {
            (false, true) => {
                self.held.ignition.get_or_insert(self.time);
                self.note("ignition", chamber());
            }
            (true, false) => {
                self.state.burning_fraction = 0.0;
                self.note("shutdown", chamber());
            }
            _ => {}
        }
        self.held.flame = flame;
    }

    /// Fuel that can still burn: ports that meet leave slivers (kg).
    fn usable_fuel_kg(&self, state: &State) -> f64 {
        let grain = &self.vehicle.engine_parameters.grain;
        (self.fuel_kg(state) - grain.fuel_kg(grain.burn_through_radius_m())).max(0.0)
    }

    fn note(&mut self, name: &'static str, detail: String) {
        self.events.push(PlantEvent { time: self.time, name, detail });
    }

    fn fuel_kg(&self, state: &State) -> f64 {
        self.vehicle.engine_parameters.grain.fuel_kg(state.port_radius_m)
    }

    fn mission_s_at(&self, share: f64) -> f64 {
        match self.held.ignition {
            Some(ignition) => self.time.since(ignition).s() + share * self.step.s(),
            None => -1.0,
        }
    }

    /// Time since ignition (s).
    pub fn mission_s(&self) -> Option<f64> {
        self.held.ignition.map(|ignition| self.time.since(ignition).s())
    }

    /// Run time.
    pub fn time(&self) -> SimTime {
        self.time
    }

    /// The continuous state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The world.
    pub fn environment(&self) -> &Environment {
        &self.environment
    }

    /// Height of the pivot above the pad when the full vehicle rests on its legs (m).
    pub fn rest_height_m(&self) -> f64 {
        self.rest_height_m
    }

    /// Events since the last call.
    pub fn take_events(&mut self) -> std::vec::Drain<'_, PlantEvent> {
        self.events.drain(..)
    }

    /// The vehicle at the end of the last step.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    fn snapshot_of(&self, now: &Evaluation) -> Snapshot {
        let state = &self.state;
        let attitude = state.attitude();
        let com_body_m = now.mass.centre_of_mass_body_m();
        let com_velocity_ned_m_s =
            state.velocity_ned_m_s + attitude * state.rate_body_rad_s.cross(&com_body_m);
        let motion = motion(state);
        let deflection_m = |pad: &Vec3| motion.point_ned_m(*pad).z;
        let pads = &self.pads_body_m[..self.vehicle.landing_gear.legs()];
        let leg_deflection_m =
            if self.options.ground { pads.iter().map(deflection_m).fold(0.0, f64::max) } else { 0.0 };
        let hull_contact = self.options.ground
            && [self.outlets.nozzle, self.outlets.vent]
                .iter()
                .any(|point| motion.point_ned_m(*point).z > 0.0);
        let force = now.acceleration.slosh_force_body_n;
        Snapshot {
            time: self.time,
            position_ned_m: state.position_ned_m,
            velocity_ned_m_s: state.velocity_ned_m_s,
            q_ned_from_body: attitude,
            rate_body_rad_s: state.rate_body_rad_s,
            acceleration_ned_m_s2: now.rate.velocity_ned_m_s,
            specific_force_body_m_s2: now.acceleration.specific_force_body_m_s2,
            height_m: -state.position_ned_m.z - self.rest_height_m,
            mass_kg: now.mass.mass_kg,
            com_structural_m: structural_from_frd(com_body_m),
            com_velocity_ned_m_s,
            inertia_kg_m2: now.mass.inertia_about_com_kg_m2(),
            nitrous_kg: state.nitrous_kg,
            fuel_kg: self.fuel_kg(state),
            nitrogen_bottle_kg: now.pressurant.bottle_kg,
            nitrogen_ullage_kg: now.pressurant.tank_kg,
            chamber_gas_kg: state.chamber_oxidizer_kg + state.chamber_fuel_kg,
            port_radius_m: state.port_radius_m,
            throat_radius_m: state.throat_radius_m,
            oxidizer_kg_s: now.engine.oxidizer_kg_s,
            fuel_kg_s: now.engine.fuel_kg_s,
            of_ratio: now.engine.of_ratio,
            chamber_pa: now.engine.chamber_pa,
            injector_inlet_pa: now.engine.injector_inlet_pa,
            quality: now.engine.quality,
            tank_pa: now.pressurant.tank_pa,
            bottle_pa: now.pressurant.bottle_pa,
            valve_rad: now.valve_rad,
            valve_area_m2: now.valve_area_m2,
            thrust_command_n: self.held.demand.thrust_n,
            thrust_n: now.engine.thrust_n,
            gimbal_rad: [now.gimbal_rad.x, now.gimbal_rad.y],
            rcs_roll: state.rcs_level.y - state.rcs_level.x,
            slosh_m: [state.slosh_m.x, state.slosh_m.y],
            slosh_force_n: [force.x, force.y],
            wind_ned_m_s: now.wind_ned_m_s,
            pads_down: now.contact.pads_down as u32,
            leg_deflection_m,
            hull_contact,
            lit: self.held.flame.lit,
            singular: self.held.singular,
            expelled_kg: [state.expelled_nozzle_kg, state.expelled_rcs_kg, state.expelled_vent_kg],
        }
    }

    /// What sensors see now.
    pub fn truth(&self) -> Truth {
        let (state, now) = (&self.state, &self.snapshot);
        Truth {
            position_ned_m: state.position_ned_m,
            velocity_ned_m_s: state.velocity_ned_m_s,
            q_ned_from_body: now.q_ned_from_body,
            rate_body_rad_s: state.rate_body_rad_s,
            specific_force_integral_body_m_s: state.imu_velocity_body_m_s,
            rate_integral_body_rad: state.imu_angle_body_rad,
            wind_ned_m_s: now.wind_ned_m_s,
            tank_pa: now.tank_pa,
            bottle_pa: now.bottle_pa,
            injector_inlet_pa: now.injector_inlet_pa,
            chamber_pa: now.chamber_pa,
        }
    }
}

fn levels(state: &State) -> PairLevels {
    PairLevels { a: state.rcs_level.x, b: state.rcs_level.y }
}

fn motion(state: &State) -> Motion {
    Motion {
        position_ned_m: state.position_ned_m,
        velocity_ned_m_s: state.velocity_ned_m_s,
        ned_from_body: state.attitude().to_rotation_matrix().into_inner(),
        rate_body_rad_s: state.rate_body_rad_s,
    }
}
