//! Every fault of plant and actuators, each by the figure that its physics gives: one function for each row
//! of the catalogue, named after component and mode.
//!
//! Flights are of the reference vehicle: in the air with the engine running under a constant command, or on
//! the pad under commands of the test's own. What is broken goes the way of a scenario's entry, through the
//! catalogue.

#![allow(clippy::disallowed_macros)] // figures of a run are printed for the record

use crate::fixture::files::scenario;
use hopbench::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use hopbench::fault::{Component, Fault, Mode};
use hopbench::plant::Snapshot;
use hopbench::scenario::{Outcome, Scenario};
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};
use hopbench::simulation::{self, Flight};

const STEP_S: f64 = 1e-3;

fn armed(throttle: Throttle) -> ActuatorCommand {
    ActuatorCommand { armed: true, throttle, discrete: Discrete::FLIGHT, ..ActuatorCommand::SAFE }
}

fn thrust(thrust_n: f64) -> ActuatorCommand {
    armed(Throttle::ThrustN(thrust_n))
}

fn valve(valve_rad: f64) -> ActuatorCommand {
    armed(Throttle::ValveRad(valve_rad))
}

/// In the air, engine steady under the command.
fn in_flight(command: &ActuatorCommand) -> Flight {
    with(&[], command)
}

/// The same of a vehicle with other values.
fn with(overrides: &[(&str, &str)], command: &ActuatorCommand) -> Flight {
    Flight::new(&Scenario::free_flight(&scenario("hop_50m", overrides).vehicle, *command), 1).unwrap()
}

/// Cold, on the pad, its pressures measured.
fn on_pad() -> Flight {
    Flight::new(&scenario("hop_50m", &[]), 1).unwrap()
}

fn broken(component: Component, mode: Mode, value: Option<f64>) -> Fault {
    Fault { value, ..Fault::new(component, mode) }
}

fn breaks(flight: &mut Flight, component: Component, mode: Mode, value: impl Into<Option<f64>>) {
    flight.inject(&broken(component, mode, value.into())).unwrap();
}

/// Flies on and gives what was seen after every step.
fn run(flight: &mut Flight, command: &ActuatorCommand, seconds: f64) -> Vec<Snapshot> {
    let steps = (seconds / STEP_S).round() as usize;
    let mut step = || {
        flight.step(command);
        *flight.snapshot()
    };
    (0..steps).map(|_| step()).collect()
}

/// Flies on and gives what was seen at the end.
fn after(flight: &mut Flight, command: &ActuatorCommand, seconds: f64) -> Snapshot {
    *run(flight, command, seconds).last().unwrap()
}

fn event_s(flight: &Flight, name: &str) -> f64 {
    flight
        .events()
        .iter()
        .find(|event| event.kind.name() == name)
        .unwrap_or_else(|| panic!("no {name}"))
        .time_s
}

/// Thrust of a flow that does not burn.
fn cold_n(flight: &Flight, now: &Snapshot) -> f64 {
    let isp_s = flight.scenario().vehicle.engine_parameters.ignition.cold_flow_isp_s;
    STANDARD_GRAVITY_M_S2 * isp_s * now.oxidizer_kg_s
}

fn near(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * b.abs()
}

// ------------------------------------------------------------------------------------------------ igniter

#[test]
fn igniter_off() {
    let mut hop = scenario("hop_50m", &[]);
    hop.file.fault.push(broken(Component::Igniter, Mode::Off, None));
    let mut flowed_kg_s: f64 = 0.0;
    let isp_s = hop.vehicle.engine_parameters.ignition.cold_flow_isp_s;
    let flight = simulation::fly(&hop, 1, |now| {
        assert!(!now.lit);
        let cold_n = STANDARD_GRAVITY_M_S2 * isp_s * now.oxidizer_kg_s;
        assert!((now.thrust_n - cold_n).abs() < 1e-9, "{} {cold_n}", now.thrust_n);
        flowed_kg_s = flowed_kg_s.max(now.oxidizer_kg_s);
    })
    .unwrap();
    let report = flight.report();
    assert_eq!(report.outcome, Outcome::NoIgnition);
    // Nitrous leaves, unburnt.
    assert!(flowed_kg_s > 0.02 && report.propellant.nitrous_used_kg > 0.02, "{flowed_kg_s}");
    assert_eq!(flight.snapshot().fuel_kg, Flight::new(&hop, 1).unwrap().snapshot().fuel_kg);
}

/// On the pad: armed for 1.5 s, then throttle for as long as is asked for.
fn lit(faults: &[Fault], seconds: f64) -> (Flight, Vec<Snapshot>) {
    let mut flight = on_pad();
    for fault in faults {
        flight.inject(fault).unwrap();
    }
    run(&mut flight, &thrust(0.0), 1.5);
    let seen = run(&mut flight, &thrust(700.0), seconds);
    (flight, seen)
}

#[test]
fn igniter_delay() {
    let (sound, _) = lit(&[], 1.5);
    let (late, seen) = lit(&[broken(Component::Igniter, Mode::Delay, Some(0.4))], 1.5);
    let later_s = event_s(&late, "ignition") - event_s(&sound, "ignition");
    // Times of steps.
    assert!((later_s - 0.4).abs() < 1.5 * STEP_S, "{later_s}");
    assert!(seen.iter().filter(|now| !now.lit).all(|now| (now.thrust_n - cold_n(&late, now)).abs() < 1e-9));
    // Later than the igniter burns in the catalogue's range: it burns as long, only later.
    let (latest, _) = lit(&[broken(Component::Igniter, Mode::Delay, Some(3.0))], 3.6);
    let later_s = event_s(&latest, "ignition") - event_s(&sound, "ignition");
    assert!((later_s - 3.0).abs() < 1.5 * STEP_S, "{later_s}");
}

#[test]
fn igniter_hard_start() {
    let share = 0.05;
    let (sound, smooth) = lit(&[], 0.6);
    let (hard, rough) = lit(&[broken(Component::Igniter, Mode::HardStart, Some(share))], 0.6);
    assert_eq!(event_s(&sound, "ignition"), event_s(&hard, "ignition"));
    let pool_kg: f64 =
        rough.iter().take_while(|now| !now.lit).map(|now| share * now.oxidizer_kg_s * STEP_S).sum();
    let surge_pa = |k: usize| rough[k].chamber_pa - smooth[k].chamber_pa;
    let peak_pa = (0..rough.len()).map(surge_pa).fold(0.0, f64::max);
    let impulse_pa_s = (0..rough.len()).map(|k| surge_pa(k) * STEP_S).sum::<f64>();
    let impulse_n_s =
        (0..rough.len()).map(|k| (rough[k].thrust_n - smooth[k].thrust_n) * STEP_S).sum::<f64>();
    // What left through the throat is the pool: m = ∫P dt C_d A/(η c*), with c* between the map's 1000 and
    // 1650 m/s.
    let engine = &sound.scenario().vehicle.engine_parameters;
    let radius_m = 0.5 * engine.nozzle.throat_diameter_m;
    let throat_m2 = core::f64::consts::PI * radius_m * radius_m;
    let nozzle = &engine.nozzle;
    let c_star_m_s = impulse_pa_s * nozzle.discharge_coefficient * throat_m2
        / (engine.chamber.c_star_efficiency * pool_kg);
    eprintln!(
        "pool {:.2} g, peak {:.1} bar over {:.1}, c* {c_star_m_s:.0} m/s, {impulse_n_s:.2} N s",
        1e3 * pool_kg,
        1e-5 * peak_pa,
        1e-5 * smooth.last().unwrap().chamber_pa
    );
    assert!((1000.0..1650.0).contains(&c_star_m_s), "{c_star_m_s}");
    // The time constant of the fresh chamber, some milliseconds: the peak is the impulse over it.
    let time_constant_s = impulse_pa_s / peak_pa;
    assert!((1e-3..12e-3).contains(&time_constant_s), "{time_constant_s}");
    // Vacuum thrust coefficients of this nozzle lie about 1.5.
    let coefficient = impulse_n_s / (impulse_pa_s * throat_m2);
    assert!((1.2..1.8).contains(&coefficient), "{coefficient}");
    // The transducer behind its sense tube sees it too: more than anything in a sound start.
    let measured_pa = |faults: &[Fault]| {
        let (mut flight, mut most_pa) = (on_pad(), 0.0_f64);
        for fault in faults {
            flight.inject(fault).unwrap();
        }
        for step in 0..1900 {
            flight.step(&thrust(if step < 1500 { 0.0 } else { 700.0 }));
            let seen = flight.measurement().and_then(|m| m.pressures.chamber_pa);
            most_pa = most_pa.max(seen.unwrap_or(0.0));
        }
        most_pa
    };
    let (usual_pa, hard_pa) =
        (measured_pa(&[]), measured_pa(&[broken(Component::Igniter, Mode::HardStart, Some(share))]));
    assert!(hard_pa > usual_pa + 0.2 * peak_pa, "{usual_pa} {hard_pa} {peak_pa}");
}

// ------------------------------------------------------------------------------------------------ valve

#[test]
fn valve_stuck() {
    let moved = |stuck: bool| {
        let mut flight = in_flight(&thrust(700.0));
        let before = after(&mut flight, &thrust(700.0), 0.3);
        if stuck {
            breaks(&mut flight, Component::Valve, Mode::Stuck, None);
        }
        let now = after(&mut flight, &thrust(400.0), 1.0);
        (now.valve_rad - before.valve_rad, now.thrust_n / before.thrust_n)
    };
    // A servo that creeps after the port's growth stops within 1/k, 3 ms.
    let (stuck_rad, share) = moved(true);
    assert!(stuck_rad.abs() < 1e-4 && near(share, 1.0, 0.01), "{stuck_rad} {share}");
    let (sound_rad, share) = moved(false);
    assert!(sound_rad < -0.02 && near(share, 4.0 / 7.0, 0.03), "{sound_rad} {share}");
}

#[test]
fn valve_slow() {
    let share = 0.1;
    let travelled = |slow: bool| {
        let mut flight = in_flight(&valve(0.4));
        // The encoder's step: 0.4 rad is not quite.
        let from_rad = after(&mut flight, &valve(0.4), 0.2).valve_rad;
        if slow {
            breaks(&mut flight, Component::Valve, Mode::Slow, share);
        }
        run(&mut flight, &valve(1.2), 1.0).iter().map(|now| now.valve_rad - from_rad).collect::<Vec<_>>()
    };
    let fastest = |way: &[f64]| way.windows(2).map(|pair| (pair[1] - pair[0]) / STEP_S).fold(0.0, f64::max);
    let (sound, slow) = (travelled(false), travelled(true));
    let servo = scenario("hop_50m", &[]).vehicle.valve_servo;
    assert!(near(fastest(&sound), servo.rate_limit_rad_s, 0.01), "{}", fastest(&sound));
    assert!(near(fastest(&slow), share * servo.rate_limit_rad_s, 0.01), "{}", fastest(&slow));
    // A lag of second order from rest is never ahead of ω² A t²/2.
    let frequency = share * servo.natural_frequency_rad_s;
    for (k, way_rad) in slow.iter().enumerate() {
        let bound_rad = 0.5 * 0.801 * (frequency * STEP_S * (k + 1) as f64).powi(2);
        assert!(*way_rad <= bound_rad + 1e-12, "{k}: {way_rad} {bound_rad}");
    }
}

#[test]
fn valve_offset() {
    let flown = |offset: Option<f64>| {
        let mut flight = in_flight(&thrust(500.0));
        if let Some(offset_rad) = offset {
            breaks(&mut flight, Component::Valve, Mode::Offset, offset_rad);
        }
        let running = after(&mut flight, &thrust(500.0), 1.0);
        (running, after(&mut flight, &thrust(0.0), 1.5))
    };
    let (sound, shut) = flown(None);
    let (open, unshut) = flown(Some(0.05));
    // The demand differs by what a second at more flow does to the port.
    assert!((open.valve_rad - sound.valve_rad - 0.05).abs() < 2e-3, "{} {}", open.valve_rad, sound.valve_rad);
    assert!(
        near(sound.thrust_n, 500.0, 0.01) && open.thrust_n > 550.0,
        "{} {}",
        sound.thrust_n,
        open.thrust_n
    );
    assert_eq!(open.thrust_command_n, 500.0);
    assert_eq!((shut.valve_rad, shut.thrust_n), (0.0, 0.0));
    assert!((unshut.valve_rad - 0.05).abs() < 1e-6 && unshut.oxidizer_kg_s > 0.0, "{}", unshut.valve_rad);
    // The other way the stop is in between: it shuts before it is told to.
    let (less, shut) = flown(Some(-0.05));
    assert!(less.thrust_n < 450.0 && shut.valve_rad == 0.0 && shut.thrust_n == 0.0, "{}", less.thrust_n);
}

#[test]
fn valve_leak() {
    let share = 0.02;
    let mut flight = on_pad();
    breaks(&mut flight, Component::Valve, Mode::Leak, share);
    let cold = after(&mut flight, &ActuatorCommand::SAFE, 0.5);
    assert_eq!((cold.oxidizer_kg_s, cold.thrust_n), (0.0, 0.0), "isolation holds");
    let leaking = after(&mut flight, &thrust(0.0), 1.5);
    let (_, open_m2) = flight.scenario().vehicle.engine.valve_area().fully_open();
    assert_eq!(leaking.valve_rad, 0.0);
    assert!(near(leaking.valve_area_m2, share * open_m2, 1e-12), "{}", leaking.valve_area_m2);
    assert!(leaking.oxidizer_kg_s > 1e-3 && !leaking.lit);
    assert!((leaking.thrust_n - cold_n(&flight, &leaking)).abs() < 1e-9);
    let shut = after(&mut flight, &ActuatorCommand::SAFE, 1.2);
    assert_eq!((shut.oxidizer_kg_s, shut.thrust_n), (0.0, 0.0));
    // After shutdown too: so much feeds the flame, above the 2 bar at which it goes out; a tenth of it does
    // not.
    let shut_down = |share: f64| {
        let mut flight = in_flight(&thrust(500.0));
        breaks(&mut flight, Component::Valve, Mode::Leak, share);
        after(&mut flight, &thrust(0.0), 3.0)
    };
    let (fed, out) = (shut_down(share), shut_down(0.1 * share));
    assert!(fed.lit && fed.valve_rad == 0.0 && fed.chamber_pa > 2e5 && fed.thrust_n > 50.0, "{fed:?}");
    assert!(!out.lit && out.oxidizer_kg_s > 1e-3 && out.thrust_n > 0.0, "{out:?}");
    assert!((out.thrust_n - cold_n(&flight, &out)).abs() < 1e-9);
}

// ------------------------------------------------------------------------------------------------ isolation

#[test]
fn isolation_slow() {
    // All of the throttle valve's area leaks, so that the isolation valve alone holds.
    let flows = |factor: f64, seconds: f64| {
        let mut flight = on_pad();
        breaks(&mut flight, Component::Valve, Mode::Leak, 1.0);
        breaks(&mut flight, Component::Isolation, Mode::Slow, factor);
        after(&mut flight, &thrust(0.0), seconds).oxidizer_kg_s
    };
    for sound_s in [0.05, 0.1, 0.2] {
        let (sound, slow) = (flows(1.0, sound_s), flows(5.0, 5.0 * sound_s));
        // The same area over the same pressures; P2 is solved to 1e-9 of the tank's.
        assert!(sound > 0.0 && near(slow, sound, 1e-6), "{sound} {slow}");
    }
    assert!(flows(1.0, 0.05) > 3.0 * flows(5.0, 0.05));
}

#[test]
fn isolation_stuck() {
    let mut flight = on_pad();
    breaks(&mut flight, Component::Isolation, Mode::Stuck, None);
    assert!(run(&mut flight, &thrust(700.0), 3.0).iter().all(|now| now.thrust_n == 0.0 && !now.lit));
    // Stuck open: what leaks past the throttle valve goes on when the power is gone.
    let leaking = |stuck: bool| {
        let mut flight = in_flight(&thrust(500.0));
        breaks(&mut flight, Component::Valve, Mode::Leak, 0.02);
        if stuck {
            breaks(&mut flight, Component::Isolation, Mode::Stuck, None);
        }
        after(&mut flight, &ActuatorCommand::SAFE, 3.0).oxidizer_kg_s
    };
    assert!(leaking(true) > 1e-3);
    assert_eq!(leaking(false), 0.0);
}

// ------------------------------------------------------------------------------------------------ gimbal

fn axis_of(component: Component) -> usize {
    if component == Component::GimbalX { 0 } else { 1 }
}

fn tilted(component: Component, angle_rad: f64) -> ActuatorCommand {
    let mut command = thrust(700.0);
    if component == Component::GimbalX {
        command.gimbal_x_rad = angle_rad;
    } else {
        command.gimbal_y_rad = angle_rad;
    }
    command
}

/// Angles of one axis, half a second at one command and as long at another; what breaks does so in between.
fn swung(component: Component, [from, to]: [f64; 2], mode: Option<(Mode, Option<f64>)>) -> Vec<f64> {
    let mut flight = in_flight(&thrust(700.0));
    after(&mut flight, &tilted(component, from), 0.5);
    if let Some((mode, value)) = mode {
        breaks(&mut flight, component, mode, value);
    }
    let seen = run(&mut flight, &tilted(component, to), 0.5);
    // The other axis goes on as it is told.
    assert!(seen.iter().all(|now| now.gimbal_rad[1 - axis_of(component)].abs() < 1e-12));
    seen.iter().map(|now| now.gimbal_rad[axis_of(component)]).collect()
}

fn fastest_rad_s(angles: &[f64]) -> f64 {
    angles.windows(2).map(|pair| (pair[1] - pair[0]).abs() / STEP_S).fold(0.0, f64::max)
}

fn hard_over(component: Component) {
    let gimbal = scenario("hop_50m", &[]).vehicle.gimbal;
    for side in [1.0, -1.0] {
        let angles = swung(component, [0.0, 0.0], Some((Mode::HardOver, Some(side))));
        // A servo at ω = 50 1/s, ζ = 0.7 has settled to exp(-35 · 0.4) of its way after the slew.
        let last = angles[angles.len() - 1];
        assert!((last - side * gimbal.limit_rad).abs() < 1e-5, "{last}");
        assert!(near(fastest_rad_s(&angles), gimbal.rate_limit_rad_s, 0.05), "{}", fastest_rad_s(&angles));
        assert!(fastest_rad_s(&angles) <= gimbal.rate_limit_rad_s * (1.0 + 1e-9));
    }
}

fn stuck(component: Component) {
    let angles = swung(component, [0.03, -0.03], Some((Mode::Stuck, None)));
    // Half a second after its command it is there within exp(-35 · 0.5), and moves no faster.
    assert!(angles.iter().all(|angle| (angle - 0.03).abs() < 1e-8), "{:?}", angles.last());
    assert!((swung(component, [0.03, -0.03], None).last().unwrap() + 0.03).abs() < 1e-6);
}

fn slow(component: Component) {
    let gimbal = scenario("hop_50m", &[]).vehicle.gimbal;
    let share = 0.1;
    let angles = swung(component, [0.0, 0.1], Some((Mode::Slow, Some(share))));
    assert!(fastest_rad_s(&angles) <= share * gimbal.rate_limit_rad_s * (1.0 + 1e-9));
    let frequency = share * gimbal.natural_frequency_rad_s;
    for (k, angle) in angles.iter().enumerate() {
        let bound_rad = 0.5 * 0.1 * (frequency * STEP_S * (k + 1) as f64).powi(2);
        assert!(*angle <= bound_rad + 1e-9, "{k}: {angle} {bound_rad}");
    }
    assert!(fastest_rad_s(&swung(component, [0.0, 0.1], None)) > 5.0 * fastest_rad_s(&angles));
}

fn slack(component: Component) {
    let play_rad = 0.01;
    let loose = Some((Mode::Slack, Some(play_rad)));
    // Within the play the engine stands.
    let within = swung(component, [0.03, 0.026], loose);
    assert!(within.iter().all(|angle| (angle - 0.03).abs() < 1e-8), "{:?}", within.last());
    // Beyond it follows by half of it later; what the servo overshoots, exp(-π ζ/√(1 - ζ²)) = 4.6 % of its
    // way, stays.
    let beyond = swung(component, [0.03, -0.03], loose);
    let behind_rad = beyond.last().unwrap() + 0.03;
    let overshoot_rad = 0.047 * 0.06;
    assert!((0.5 * play_rad - overshoot_rad..0.5 * play_rad + 1e-6).contains(&behind_rad), "{behind_rad}");
}

fn offset(component: Component) {
    let gimbal = scenario("hop_50m", &[]).vehicle.gimbal;
    let off = Some((Mode::Offset, Some(0.02)));
    let angles = swung(component, [0.0, 0.03], off);
    assert!((angles.last().unwrap() - 0.05).abs() < 1e-6, "{:?}", angles.last());
    let at_stop = swung(component, [0.0, gimbal.limit_rad], off);
    assert!(at_stop.iter().all(|angle| *angle <= gimbal.limit_rad + 1e-6));
}

#[test]
fn gimbal_x_hard_over() {
    hard_over(Component::GimbalX);
}

#[test]
fn gimbal_y_hard_over() {
    hard_over(Component::GimbalY);
}

#[test]
fn gimbal_x_stuck() {
    stuck(Component::GimbalX);
}

#[test]
fn gimbal_y_stuck() {
    stuck(Component::GimbalY);
}

#[test]
fn gimbal_x_slow() {
    slow(Component::GimbalX);
}

#[test]
fn gimbal_y_slow() {
    slow(Component::GimbalY);
}

#[test]
fn gimbal_x_slack() {
    slack(Component::GimbalX);
}

#[test]
fn gimbal_y_slack() {
    slack(Component::GimbalY);
}

#[test]
fn gimbal_x_offset() {
    offset(Component::GimbalX);
}

#[test]
fn gimbal_y_offset() {
    offset(Component::GimbalY);
}

// ------------------------------------------------------------------------------------------------ thrusters

/// Nitrogen of one pair at full thrust (kg/s).
fn pair_kg_s() -> f64 {
    let rcs = scenario("hop_50m", &[]).vehicle.reaction_control;
    2.0 * rcs.thrust_n / (rcs.specific_impulse_s * STANDARD_GRAVITY_M_S2)
}

fn roll(sign: f64) -> ActuatorCommand {
    ActuatorCommand { rcs_roll: sign, ..thrust(700.0) }
}

fn dead(component: Component, sign: f64) {
    let used_kg = |sign: f64| {
        let mut flight = in_flight(&thrust(700.0));
        breaks(&mut flight, component, Mode::Off, None);
        let now = after(&mut flight, &roll(sign), 1.0);
        (now.expelled_kg[1], now.rate_body_rad_s.z)
    };
    let (used, rate) = used_kg(sign);
    // The liquid, a little off the axis, turns it a little.
    assert!(used == 0.0 && rate.abs() < 1e-3, "{used} {rate}");
    // The other pair is sound: a second less 5 ms of delay and the rise's 10 ms, and less what is left of the
    // modulator's period of 100 ms when the command comes.
    let (used, rate) = used_kg(-sign);
    assert!((0.883..=0.986).contains(&(used / pair_kg_s())) && rate * sign < -0.1, "{used} {rate}");
}

fn leaks(component: Component, sign: f64) {
    let share = 0.2;
    let mut flight = in_flight(&thrust(700.0));
    breaks(&mut flight, component, Mode::Leak, share);
    let now = after(&mut flight, &thrust(700.0), 2.0);
    assert!((now.rcs_roll - sign * share).abs() < 1e-9, "{}", now.rcs_roll);
    // Two seconds less the rise's 10 ms.
    assert!(near(now.expelled_kg[1], share * pair_kg_s() * 1.99, 1e-3), "{}", now.expelled_kg[1]);
    assert!(now.rate_body_rad_s.z * sign > 0.05, "{}", now.rate_body_rad_s.z);
    // A command opens it wholly all the same.
    assert!((after(&mut flight, &roll(sign), 0.5).rcs_roll - sign).abs() < 1e-6);
}

#[test]
fn rcs_positive_off() {
    dead(Component::RcsPositive, 1.0);
}

#[test]
fn rcs_negative_off() {
    dead(Component::RcsNegative, -1.0);
}

#[test]
fn rcs_positive_leak() {
    leaks(Component::RcsPositive, 1.0);
}

#[test]
fn rcs_negative_leak() {
    leaks(Component::RcsNegative, -1.0);
}

// ------------------------------------------------------------------------------------------------ feed and
// chamber

#[test]
fn regulator_droop() {
    let (command, droop_pa) = (valve(0.5), 5e5);
    let mut sound = in_flight(&command);
    let mut flight = in_flight(&command);
    breaks(&mut flight, Component::Regulator, Mode::Droop, droop_pa);
    let set_pa = flight.scenario().vehicle.pressurant.regulator.set_pressure_pa;
    let start = after(&mut flight, &command, STEP_S);
    let seen = run(&mut flight, &command, 3.0);
    let (mut before, mut falling) = (start, 0);
    for now in &seen {
        assert!(now.tank_pa <= before.tank_pa + 1e-6 && now.tank_pa >= set_pa - droop_pa - 1e-6);
        // The outlet is settled after each step: what the next step changes of a step's 30 mg comes and goes.
        let back_kg = now.nitrogen_bottle_kg - before.nitrogen_bottle_kg;
        assert!(back_kg <= 1e-6, "{back_kg} kg went back");
        if now.tank_pa > set_pa - droop_pa + 1.0 {
            // Shut in: its mass stays while it expands, but for the gas that a step of the old outlet lets
            // in.
            falling += 1;
            assert!(near(now.nitrogen_ullage_kg, start.nitrogen_ullage_kg, 1e-3), "{}", now.tank_pa);
        }
        before = *now;
    }
    // 2.85 litres of gas at 65 bar become 8 % more at 60: 0.24 litres, 0.2 kg of liquid.
    let end = seen.last().unwrap();
    let gone_kg = start.nitrous_kg - seen[falling].nitrous_kg;
    assert!((end.tank_pa - (set_pa - droop_pa)).abs() < 1e-3, "{}", end.tank_pa);
    assert!((0.15..0.25).contains(&gone_kg), "{gone_kg}");
    // The flux of the valve follows the root of a pressure drop that lost 5 of its 65 bar at least, of 25 at
    // most.
    let share = end.thrust_n / after(&mut sound, &command, 3.0 + STEP_S).thrust_n;
    assert!((0.85..0.97).contains(&share), "{share}");
    // Mended, it is back within its response time, 20 ms: exp(-15) of 5 bar is 0.2 Pa.
    flight.clear_fault(Component::Regulator, None);
    assert!((after(&mut flight, &command, 0.3).tank_pa - set_pa).abs() < 1.0);
}

/// Thrust at a valve angle, of an engine that has just broken and of one that was built so.
fn as_built(component: Component, mode: Mode, share: f64, (key, sound): (&str, f64)) {
    let command = valve(0.45);
    let mut flight = in_flight(&command);
    breaks(&mut flight, component, mode, share);
    let built = (sound * (1.0 - share)).to_string();
    let mut other = with(&[(key, &built)], &command);
    let (broken, built) = (run(&mut flight, &command, 0.5), run(&mut other, &command, 0.5));
    for (a, b) in broken.iter().zip(&built) {
        // Both are solved to 6.5 mPa, 1e-6 N.
        assert!(near(a.thrust_n, b.thrust_n, 1e-7) && near(a.chamber_pa, b.chamber_pa, 1e-7), "{a:?} {b:?}");
        assert!(near(a.oxidizer_kg_s, b.oxidizer_kg_s, 1e-7));
    }
    // The engine controller does not know: less thrust than is asked for, at once and for good.
    let mut flight = in_flight(&thrust(700.0));
    let sound = after(&mut flight, &thrust(700.0), 0.3);
    breaks(&mut flight, component, mode, share);
    let now = after(&mut flight, &thrust(700.0), 0.3);
    eprintln!("{:?} {:?} {share}: {:.0} N of {:.0} N", component, mode, now.thrust_n, now.thrust_command_n);
    assert!(
        near(sound.thrust_n, 700.0, 0.01) && now.thrust_n < 0.97 * now.thrust_command_n,
        "{}",
        now.thrust_n
    );
}

#[test]
fn injector_blocked() {
    as_built(Component::Injector, Mode::Blocked, 0.3, ("vehicle.feed.injector.discharge_coefficient", 0.70));
}

#[test]
fn combustion_efficiency_drop() {
    as_built(
        Component::Combustion,
        Mode::EfficiencyDrop,
        0.1,
        ("vehicle.engine.chamber.c_star_efficiency", 0.93),
    );
}
