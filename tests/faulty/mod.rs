//! Flights over the real plant with an autopilot of the test's own, between which a test may break things: what the
//! sensors say, what the actuators hear, what the autopilot was told.
#![allow(dead_code)] // each test binary uses its part

use hopbench::autopilot::{Autopilot, Parameters, Phase};
use hopbench::disturbance::Disturbance;
use hopbench::environment::Environment;
use hopbench::scenario::{Outcome, Scenario};
use hopbench::signal::{ActuatorCommand, Measurement, Throttle};
use hopbench::simulation::{Flight, Instrumentation, Report, Source, data_sheet};
use hopbench::time::SimTime;

/// What a flight left behind.
pub struct Flown {
    pub report: Report,
    /// Every command of the autopilot, before anything broke it.
    pub commands: Vec<(SimTime, Phase, ActuatorCommand)>,
    /// True thrust and time at every step (s, N).
    pub thrust_n: Vec<(f64, f64)>,
    pub autopilot: Autopilot,
}

impl Flown {
    /// Reasons of the aborts, in the order they were decided.
    pub fn aborts(&self) -> Vec<String> {
        let aborts = self.report.events.iter().filter(|e| e.kind.is_abort());
        aborts.map(|e| e.kind.name().replace("abort:", "")).collect()
    }

    /// Time of the first event of this name (s).
    pub fn time_of(&self, event: &str) -> Option<f64> {
        self.report.events.iter().find(|e| e.kind.name() == event).map(|e| e.time_s)
    }
}

/// What the autopilot of a scenario is told before anybody changes it.
pub fn parameters(scenario: &Scenario, seed: u32) -> Parameters {
    let environment = Environment::new(&scenario.site, &scenario.file.wind, u64::from(seed)).unwrap();
    data_sheet::parameters(scenario, &environment, &Instrumentation::default())
}

/// Flies `scenario`; `sensed` and `commanded` break measurements and commands, at a mission time (s, zero before the
/// flame). Every command must be a number within limits and rates.
pub fn fly(
    scenario: &Scenario,
    seed: u32,
    parameters: Parameters,
    mut sensed: impl FnMut(f64, &mut Measurement),
    mut commanded: impl FnMut(f64, &mut ActuatorCommand),
) -> Flown {
    let limits = parameters.actuators.clone();
    let valve_open_rad = scenario.vehicle.valve_servo.upper_rad;
    let mut autopilot = Autopilot::new(parameters);
    let mut flight = Flight::new(scenario, seed).unwrap();
    flight.set_flown_elsewhere();
    flight.set_source(Source::Autopilot);
    let mut command = ActuatorCommand::SAFE;
    let (mut commands, mut thrust_n) = (Vec::new(), Vec::new());
    let patience = SimTime::from_s(scenario.file.timeout_s);
    let mut last: Option<(SimTime, Phase, ActuatorCommand)> = None;
    while flight.outcome().is_none() {
        let mission_s = flight.mission_s().unwrap_or(0.0);
        let mut broken = command;
        commanded(mission_s, &mut broken);
        flight.step(&broken);
        thrust_n.push((flight.time().s(), flight.snapshot().thrust_n));
        if let Some(measurement) = flight.measurement() {
            let mut measurement = measurement.clone();
            sensed(mission_s, &mut measurement);
            command = autopilot.update(&measurement);
            flight.note_abort(autopilot.abort());
            flight.note_phase(autopilot.phase());
            flight.set_reference_elsewhere(Some(autopilot.reference().position_ned_m));
            if flight.has_touched_down() {
                flight.set_estimate_at_touchdown(autopilot.estimate().position_ned_m);
            }
            let now = (flight.time(), autopilot.phase(), command);
            let throttle = match command.throttle {
                Throttle::ThrustN(thrust_n) => thrust_n / limits.thrust_max_n,
                Throttle::ValveRad(angle_rad) => angle_rad / valve_open_rad,
            };
            assert!((0.0..=1.0).contains(&throttle), "{now:?}");
            assert!(command.rcs_roll.abs() <= 1.0, "{now:?}");
            let gimbal = [command.gimbal_x_rad, command.gimbal_y_rad];
            assert!(gimbal.iter().all(|angle| angle.abs() <= limits.gimbal_limit_rad), "{now:?}");
            // Between a controller that steers and one that has shut the engine the angles may jump.
            if let Some((before, phase, held)) = last
                && phase.is_flight()
                && now.1.is_flight()
            {
                let most_rad = limits.gimbal_rate_limit_rad_s * now.0.since(before).s() + 1e-12;
                let moved = [gimbal[0] - held.gimbal_x_rad, gimbal[1] - held.gimbal_y_rad];
                assert!(moved.iter().all(|angle| angle.abs() <= most_rad), "{now:?} after {held:?}");
            }
            last = Some(now);
            commands.push(now);
        }
        if flight.mission_s().is_none() && flight.time() > patience {
            flight.end(Outcome::Timeout);
        }
    }
    Flown { report: flight.report(), commands, thrust_n, autopilot }
}

/// The scenario with something in it that turns the vehicle about its long axis (N m, FRD z), one way from 5 to 20 s of
/// mission time and the other way after.
pub fn twisted(mut scenario: Scenario, torque_n_m: f64) -> Scenario {
    for (start_s, sign) in [(5.0, 1.0), (20.0, -1.0)] {
        scenario.file.disturbance.push(Disturbance {
            start_s,
            duration_s: Some(15.0),
            moment_body_n_m: [0.0, 0.0, sign * torque_n_m],
            ..Default::default()
        });
    }
    scenario
}

/// Sensors as they are.
pub fn sound_sensors(_: f64, _: &mut Measurement) {}

/// Actuators that do as they are told.
pub fn sound_actuators(_: f64, _: &mut ActuatorCommand) {}
