//! The plant at step 0: on its legs, or in the air with the engine steady; and whether the fixed step
//! resolves chamber, drag and legs.

use nalgebra::{Quaternion, Vector2};

use super::discrete_state::{Demand, DiscreteState, FeedStart, SolverState, StepInputs, WarmStartPredictor};
use super::fault::{FaultMemory, FaultState};
use super::freeze::Frozen;
use super::paper::Paper;
use super::sequence::Sequence;
use super::{ExitPoints, Options, Plant, Snapshot, State, motion};
use crate::actuator::{DelayLine, ServoMemory};
use crate::disturbance::{Disturbances, Effect};
use crate::dynamics::landing_gear::{Anchors, Grip};
use crate::environment::Environment;
use crate::frame::{self, Vec3};
use crate::input::Invalid;
use crate::propulsion::{
    ChamberGas, ChamberGasRate, ChamberModel, EngineCondition, FeedGrid, FeedInput, FeedMap, Flame,
    ImplicitMethod, Modulator, PairLevels, PaperEngine, Stores, WarmStart,
};
use crate::scenario::{EngineStart, Fidelity, GimbalActuator, Place, Scenario};
use crate::signal::{ActuatorCommand, Throttle};
use crate::time::SimTime;

/// Airspeed up to which drag must be sound (m/s): Mach 0.3, where its model ends.
const CHECKED_AIRSPEED_M_S: f64 = 100.0;

/// Step at which a vehicle must be sound (s): that of every flight but studies of the step itself.
const CHECKED_STEP_S: f64 = 1e-3;

impl Plant {
    /// As [`Plant::new`], with another length of the step: for convergence studies.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub fn with_step(scenario: &Scenario, step: SimTime) -> Result<Self, Invalid> {
        Self::at_step_zero(scenario, scenario.file.seed, step)
    }

    pub(super) fn at_step_zero(scenario: &Scenario, seed: u32, step: SimTime) -> Result<Self, Invalid> {
        let seed = u64::from(seed);
        let vehicle = scenario.vehicle.clone();
        let options = Options::of(scenario)?;
        let environment = Environment::new(&scenario.site, &scenario.file.wind, seed)?;
        let (state, feed) = initial_state(scenario, &environment)?;
        let paper = (scenario.file.fidelity == Fidelity::Paper).then(|| {
            let mode = &vehicle.paper_mode;
            let engine = PaperEngine::new(&vehicle.engine, &vehicle.engine_parameters, mode);
            Paper::new(engine, SimTime::from_s(mode.step_s))
        });
        let mut plant = Self {
            environment,
            options,
            pads_body_m: vehicle.landing_gear.pads_body_m(),
            exit_points: ExitPoints {
                nozzle: Vec3::new(0.0, 0.0, -vehicle.engine_parameters.nozzle.exit_z_m),
                vent: Vec3::new(0.0, 0.0, -(vehicle.tank.floor_z_m + vehicle.tank.length_m)),
            },
            rest_height_m: 0.0,
            step,
            time: SimTime::ZERO,
            state,
            inputs: StepInputs::at_step_zero(scenario, &options, state.nitrous_kg),
            solver: SolverState::at_step_zero(feed),
            discrete: DiscreteState::at_step_zero(scenario, step),
            disturbances: Disturbances::new(&scenario.file.disturbance, seed),
            sequence: Sequence::new(scenario, vehicle.hold_down.release_time_s),
            events: Vec::new(),
            snapshot: Snapshot::default(),
            cached_rate: None,
            frozen: Frozen::default(),
            paper,
            vehicle,
        };
        let start = plant.evaluate(&plant.state, 0.0);
        plant.frozen = Frozen::new(&scenario.file.physics.freeze, &start, state.port_radius_m);
        let weight_n =
            plant.evaluate(&plant.state, 0.0).mass.mass_kg * plant.environment.gravity.magnitude_m_s2;
        plant.rest_height_m = plant.vehicle.landing_gear.rest_height_m(weight_n);
        plant.check_step_resolves_chamber()?;
        plant.check_step_resolves_drag()?;
        if options.ground {
            plant.check_step_resolves_legs()?;
            plant.place_on_legs()?;
        }
        let running = scenario.file.initial.engine == EngineStart::Running;
        if let Some(schedule) = scenario.schedule.as_ref().filter(|_| running) {
            plant.run_steady(schedule.at(SimTime::ZERO));
        }
        plant.advance_disturbances(0.0);
        plant.snapshot = plant.snapshot_of(&plant.evaluate(&plant.state, 0.0));
        Ok(plant)
    }

    /// A chamber that empties so fast that the fixed step would make its gas negative.
    fn check_step_resolves_chamber(&self) -> Result<(), Invalid> {
        if self.vehicle.engine_parameters.chamber.model != ChamberModel::Filling {
            return Ok(());
        }
        let nozzle = &self.vehicle.engine_parameters.nozzle;
        // A minute of erosion at its rated pressure leaves a wider throat, and less time.
        let eroded_m = self.state.throat_radius_m + 60.0 * nozzle.erosion_rate_m_s;
        let condition = EngineCondition {
            throat_radius_m: eroded_m.min(nozzle.greatest_throat_radius_m()),
            ..self.engine_condition(&self.state)
        };
        // Choked, whatever burns; the time constant of a choked chamber does not depend on its pressure.
        let gas_kg = 30.0 * self.vehicle.engine.gas_at_rest(&condition).oxidizer_kg;
        let emptying_s = |burning_fraction: f64, of_ratio: f64| {
            let fuel_kg = burning_fraction * gas_kg / (1.0 + of_ratio);
            let gas = ChamberGas { oxidizer_kg: gas_kg - fuel_kg, fuel_kg };
            let condition = EngineCondition { chamber_gas: Some(gas), burning_fraction, ..condition };
            let point = self.vehicle.engine.operating_point(
                self.feed_in(&self.state),
                0.0,
                &condition,
                WarmStart::default(),
            );
            gas_kg / point.nozzle_kg_s
        };
        let mixtures = (1..=15).map(|of_ratio| emptying_s(1.0, f64::from(of_ratio)));
        let shortest_s = mixtures.fold(emptying_s(0.0, 0.0), f64::min);
        // RK4 is stable up to 2.8 time constants a step; within one no stage empties the chamber.
        if shortest_s >= CHECKED_STEP_S {
            return Ok(());
        }
        let message = format!(
            "\"filling\": the chamber empties within {:.1e} s, the step resolves {:.1e} s; \"quasi_steady\" is as good",
            shortest_s, CHECKED_STEP_S
        );
        Err(Invalid::new("engine.chamber.model", message))
    }

    /// Drag so great for the body that the fixed step would throw it back faster than it came.
    fn check_step_resolves_drag(&self) -> Result<(), Invalid> {
        let (aero, dry) = (&self.vehicle.aero, self.vehicle.mass.dry());
        let Some(per_inertia) = dry.inertia_about_com_kg_m2().try_inverse() else { return Ok(()) };
        let lever = aero.centre_of_pressure_body_m() - dry.centre_of_mass_body_m();
        let gain_1_kg = |axis: Vec3| {
            let arm = lever.cross(&axis);
            1.0 / dry.mass_kg + arm.dot(&(per_inertia * arm))
        };
        let across_1_kg = gain_1_kg(Vec3::x()) + gain_1_kg(Vec3::y());
        let air_mass_flux_kg_m2_s = self.environment.atmosphere.density_kg_m3 * CHECKED_AIRSPEED_M_S;
        for (key, area_m2, gain_1_kg) in [
            ("aero.drag_area_lateral_m2", aero.drag_area_lateral_m2, across_1_kg),
            ("aero.drag_area_axial_m2", aero.drag_area_axial_m2, gain_1_kg(Vec3::z())),
        ] {
            let allowed_m2 = 2.5 / (CHECKED_STEP_S * air_mass_flux_kg_m2_s * gain_1_kg);
            if area_m2 > allowed_m2 {
                let message = format!(
                    "{area_m2} stops the dry vehicle at {CHECKED_AIRSPEED_M_S} m/s within less than the step \
                     resolves; allowed up to {allowed_m2:.3e}, with its centre of pressure where it is"
                );
                return Err(Invalid::new(key, message));
            }
        }
        Ok(())
    }

    /// Legs so stiff for the body on them that the fixed step would make it explode.
    fn check_step_resolves_legs(&self) -> Result<(), Invalid> {
        let fastest_1_s =
            self.vehicle.landing_gear.fastest_rate_1_s(&self.pads_body_m, self.vehicle.mass.dry());
        // RK4 is stable within 2.5 of the origin, anywhere in the left half of the plane.
        let allowed_1_s = 2.5 / CHECKED_STEP_S;
        if fastest_1_s <= allowed_1_s {
            return Ok(());
        }
        let message = format!(
            "the dry vehicle on these legs moves at up to {fastest_1_s:.0} 1/s, the step resolves {allowed_1_s:.0}: \
             softer springs or dampers, pads nearer to the centre of mass, or more inertia"
        );
        Err(Invalid::new("landing_gear", message))
    }

    /// Puts the vehicle on its legs, at rest and upright.
    fn place_on_legs(&mut self) -> Result<(), Invalid> {
        if frame::tilt_rad(&self.state.attitude()) > 1e-3 {
            return Err(Invalid::new("initial.q_ned_from_body", "on the pad the vehicle stands upright"));
        }
        self.state.position_ned_m.z = -self.rest_height_m;
        self.state.velocity_ned_m_s = Vec3::zeros();
        self.state.rate_body_rad_s = Vec3::zeros();
        let motion = motion(&self.state);
        let gear = &self.vehicle.landing_gear;
        self.inputs.anchors =
            gear.anchors_after(&self.pads_body_m, &motion, 0.0, &Anchors::default(), Grip::Free);
        Ok(())
    }

    /// Lights the engine and brings it to its steady state under a command, at step 0.
    pub(super) fn run_steady(&mut self, command: &ActuatorCommand) {
        self.state.burning_fraction = 1.0;
        self.latch_commands(command);
        self.state.valve_rad = self.discrete.demand.valve_rad;
        self.inputs.valve_command_rad = self.discrete.demand.valve_rad;
        self.inputs.valve_memory = ServoMemory::at(self.discrete.demand.valve_rad);
        self.discrete.valve_delay = DelayLine::for_interval(
            SimTime::from_s(self.vehicle.valve_delay_s),
            self.state.valve_rad,
            self.step,
        );
        if self.vehicle.engine_parameters.chamber.model == ChamberModel::Filling {
            self.fill_chamber();
        }
        self.fill_feed();
    }

    /// Lets the chamber fill at the present valve angle until nothing changes any more.
    fn fill_chamber(&mut self) {
        let area_m2 = self.vehicle.engine.valve_area().area_m2(self.state.valve_rad);
        let at_rest = self.vehicle.engine.gas_at_rest(&self.engine_condition(&self.state));
        let mut gas = at_rest;
        let rate = |gas: ChamberGas| {
            let condition = EngineCondition {
                chamber_gas: Some(gas),
                fuel_flow_kg_s: None,
                ..self.engine_condition(&self.state)
            };
            self.vehicle
                .engine
                .operating_point(self.feed_in(&self.state), area_m2, &condition, self.solver.warm_start.last)
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
}

impl Options {
    fn of(scenario: &Scenario) -> Result<Self, Invalid> {
        let (start, actuators) = (&scenario.file.initial, scenario.file.actuators);
        let options = Self {
            ground: start.place == Place::Pad,
            clamped: start.clamped,
            open_loop: scenario.schedule.is_some(),
            ideal: actuators.ideal,
            ideal_gimbal: actuators.ideal && actuators.gimbal != Some(GimbalActuator::Servo),
            integrator: scenario.file.physics.integrator,
        };
        if options.clamped && (start.velocity_ned_m_s != [0.0; 3] || start.rate_body_rad_s != [0.0; 3]) {
            return Err(Invalid::new("initial.clamped", "a clamped vehicle has neither velocity nor rate"));
        }
        if options.ideal_gimbal && scenario.vehicle.gimbal.engine_inertia {
            return Err(Invalid::new(
                "model.gimbal_inertia",
                "must be false with an ideal gimbal: a step in angle would have infinite acceleration",
            ));
        }
        Ok(options)
    }
}

/// The continuous state as the scenario has it, valves shut, and the feed system of its tank.
fn initial_state(scenario: &Scenario, environment: &Environment) -> Result<(State, FeedMap), Invalid> {
    let (vehicle, start) = (&scenario.vehicle, &scenario.file.initial);
    let (engine, parameters) = (&vehicle.engine, &vehicle.engine_parameters);
    let out_of_range = |key, message| Err(Invalid::new(key, message));
    let nitrous_kg = start.nitrous_kg.unwrap_or_else(|| vehicle.initial_nitrous_kg());
    let capacity_kg = vehicle.tank_capacity_kg();
    if nitrous_kg > capacity_kg {
        let message = format!("{nitrous_kg} is out of range; the tank holds 0 to {capacity_kg:.3}");
        return out_of_range("initial.nitrous_kg", message);
    }
    let port_radius_m = start.port_radius_m.unwrap_or(parameters.grain.port_radius_m);
    let burn_through_m = parameters.grain.burn_through_radius_m();
    if port_radius_m > burn_through_m {
        let message =
            format!("{port_radius_m} is out of range; allowed up to burn-through at {burn_through_m}");
        return out_of_range("initial.port_radius_m", message);
    }
    let nitrogen_kg =
        start.nitrogen_kg.unwrap_or_else(|| vehicle.initial_nitrogen_kg(vehicle.initial_nitrous_kg()));
    let throat_radius_m = start.throat_radius_m.unwrap_or(0.5 * parameters.nozzle.throat_diameter_m);
    let widest_m = engine.nozzle().greatest_throat_radius_m();
    if throat_radius_m > widest_m {
        let message =
            format!("{throat_radius_m} is out of range; allowed up to {widest_m:.6}, short of the exit");
        return out_of_range("initial.throat_radius_m", message);
    }
    let ambient_pa = environment.atmosphere.pressure_pa;
    let gas = vehicle.initial_gas(nitrogen_kg, nitrous_kg, ambient_pa);
    let stores = Stores { nitrogen_kg, nitrous_kg, gas, regulator_sag_pa: 0.0 };
    let nitrogen = *vehicle.gas_supply(&stores, ambient_pa).nitrogen();
    let feed = engine.feed_map(nitrogen.tank_pa, nitrogen.liquid_k);
    let [w, x, y, z] = start.q_ned_from_body;
    let state = State {
        position_ned_m: Vec3::from(start.position_ned_m),
        velocity_ned_m_s: Vec3::from(start.velocity_ned_m_s),
        q_ned_from_body: Quaternion::new(w, x, y, z).normalize(),
        rate_body_rad_s: Vec3::from(start.rate_body_rad_s),
        nitrous_kg,
        nitrogen_kg,
        gas,
        port_radius_m,
        throat_radius_m,
        manifold_kg: engine.feed_at_rest(&feed, ambient_pa).manifold_kg,
        ..State::EMPTY
    };
    Ok((state, feed))
}

impl StepInputs {
    fn at_step_zero(scenario: &Scenario, options: &Options, nitrous_kg: f64) -> Self {
        let vehicle = &scenario.vehicle;
        let running = scenario.file.initial.engine == EngineStart::Running;
        Self {
            valve_command_rad: 0.0,
            gimbal_command_rad: Vector2::zeros(),
            valve_memory: ServoMemory::default(),
            gimbal_memory: [ServoMemory::default(); 2],
            isolation_opening: if running { 1.0 } else { 0.0 },
            vent_opening: 0.0,
            rcs_duty: PairLevels::default(),
            grip: if options.ground && !running { Grip::Held } else { Grip::Free },
            anchors: Anchors::default(),
            lit: running,
            ignition_time: running.then_some(SimTime::ZERO),
            fading_fuel_kg: 0.0,
            nitrous_depleted: nitrous_kg <= vehicle.tank.unusable_nitrous_kg,
            static_head_pa: 0.0,
            disturbance: Effect::default(),
            faults: FaultState::none(vehicle.valve_servo, vehicle.gimbal_servo),
        }
    }
}

impl DiscreteState {
    fn at_step_zero(scenario: &Scenario, step: SimTime) -> Self {
        let vehicle = &scenario.vehicle;
        let running = scenario.file.initial.engine == EngineStart::Running;
        let (valve_delay, gimbal_delay) =
            (SimTime::from_s(vehicle.valve_delay_s), SimTime::from_s(vehicle.gimbal.delay_s));
        Self {
            valve_delay: DelayLine::for_interval(valve_delay, 0.0, step),
            gimbal_delay: DelayLine::for_interval(gimbal_delay, [0.0; 2], step),
            modulator: Modulator::default(),
            demand: Demand {
                throttle: Throttle::ValveRad(0.0),
                solved_at: None,
                valve_rad: 0.0,
                thrust_n: 0.0,
            },
            igniter_on: false,
            flame: Flame { lit: running, was_lit: running, ..Flame::default() },
            fully_lit_fuel_kg_s: 0.0,
            burnt_through: false,
            bottle_low: false,
            tank_high: false,
            last_saturation: None,
            balance_singular: false,
            fault_memory: FaultMemory::default(),
        }
    }
}

impl SolverState {
    fn at_step_zero(feed: FeedMap) -> Self {
        Self {
            feed: FeedGrid::new(feed),
            feed_start: FeedStart {
                input: FeedInput::SHUT,
                method: ImplicitMethod::Sdirk2,
                head_trend_pa: 0.0,
            },
            warm_start: WarmStartPredictor::default(),
        }
    }
}
