//! Invariant: what the allocation asks of the valve, the engine gives back as thrust.
//!
//! The engine is the plant's own: a vehicle held fast, its engine lit and steady at a valve angle from the
//! autopilot's table, at ports and fills over their ranges. And what it asks of the roll thrusters is what
//! they use, whichever driver makes the pulses.

#![allow(clippy::disallowed_macros)] // figures of a run are printed for the record

use crate::fixture::faulty;
use crate::fixture::files;
use hopbench::plant::Plant;
use hopbench::propulsion::Drive;
use hopbench::scenario::{EngineStart, Place, Scenario, Schedule};
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};

const THRUSTS_N: [f64; 9] = [310.0, 390.0, 471.0, 560.0, 655.0, 733.0, 850.0, 941.0, 1049.0];

/// Thrust of the plant's engine, steady at a valve angle (N).
fn thrust_n(hop: &Scenario, valve_rad: f64, port_radius_m: f64, nitrous_kg: f64) -> f64 {
    let command = ActuatorCommand {
        armed: true,
        throttle: Throttle::ValveRad(valve_rad),
        discrete: Discrete::FLIGHT,
        ..ActuatorCommand::SAFE
    };
    let mut held = hop.clone();
    held.schedule = Some(Schedule::constant(command));
    held.file.initial.place = Place::Free;
    held.file.initial.clamped = true;
    held.file.initial.engine = EngineStart::Running;
    held.file.initial.port_radius_m = Some(port_radius_m);
    held.file.initial.nitrous_kg = Some(nitrous_kg);
    Plant::new(&held).unwrap().snapshot().thrust_n
}

#[test]
fn the_engine_gives_back_the_thrust_that_was_asked_for() {
    let hop = files::scenario("hop_50m", &[]);
    let map = faulty::parameters(&hop, 1).thrust_map;
    let grain = &hop.vehicle.engine_parameters.grain;
    let (mut worst, mut count) = (0.0f64, 0);
    for share in [0.0, 0.21, 0.5, 0.77, 1.0] {
        let radius_m = grain.port_radius_m + share * (grain.outer_radius_m - grain.port_radius_m);
        for fill in [1.0, 0.6, 0.25] {
            let nitrous_kg = fill * hop.vehicle.initial_nitrous_kg();
            for wanted_n in THRUSTS_N {
                let given_n = thrust_n(&hop, map.valve_angle_rad(wanted_n, radius_m), radius_m, nitrous_kg);
                let error = given_n / wanted_n - 1.0;
                // Bilinear interpolation between 24 thrusts and 8 radii, and the column of liquid over the
                // valve.
                assert!(error.abs() < 0.005, "{error} at {wanted_n} N, {radius_m} m, {nitrous_kg} kg");
                worst = worst.max(error.abs());
                count += 1;
            }
        }
    }
    eprintln!("worst of {count}: {worst:.2e}");
    assert!(count == 135 && worst > 0.0, "{count} {worst}");
}

#[test]
fn more_thrust_is_more_valve_more_flow_and_more_thrust() {
    let hop = files::scenario("hop_50m", &[]);
    let map = faulty::parameters(&hop, 1).thrust_map;
    let grain = &hop.vehicle.engine_parameters.grain;
    for i in 0..40 {
        let radius_m =
            grain.port_radius_m + f64::from(i) / 40.0 * (grain.outer_radius_m - grain.port_radius_m);
        let at = |thrust_n: f64| {
            let (oxidizer, fuel) = map.flows_kg_s(thrust_n, radius_m);
            [map.valve_angle_rad(thrust_n, radius_m), oxidizer, fuel]
        };
        let mut last = at(300.0);
        for thrust_n in (301..=1050).map(f64::from) {
            let now = at(thrust_n);
            assert!(now.iter().zip(last).all(|(now, last)| *now > last), "{thrust_n} N at {radius_m} m");
            last = now;
        }
    }
}

#[test]
fn pulses_are_made_once_and_their_nitrogen_is_known() {
    for drive in [Drive::PulseModulated, Drive::OnOff] {
        let mut hop = faulty::twisted(files::scenario("hop_50m", &[]), 0.5);
        hop.vehicle.reaction_control.drive = drive;
        let told = faulty::parameters(&hop, 1);
        let flown = faulty::fly(&hop, 1, told, faulty::sound_sensors, faulty::sound_actuators);
        let rolls = flown.commands.iter().map(|(_, _, command)| command.rcs_roll);
        let between = rolls.clone().filter(|roll| roll.fract() != 0.0).count();
        let used_kg = flown.report.propellant.nitrogen_rcs_kg;
        let known_kg = flown.autopilot.estimate().nitrogen_rcs_kg;
        eprintln!("{drive:?}: {used_kg} kg used, {known_kg} kg known, {between} partial commands");
        assert!(flown.report.expect.passed, "{drive:?}: {:?}", flown.report.expect.items);
        assert!(used_kg > 0.0);
        match drive {
            // The driver begins a period of 0.1 s with the command of that moment, a sample of what is
            // counted, and forgets what is owed when the sign turns: some of the thousand periods.
            Drive::PulseModulated => {
                assert!(between > 100 && (known_kg / used_kg - 1.0).abs() < 0.1, "{used_kg} {known_kg}");
            }
            // Whole pulses: known but for the thrust's rise and fall, which cancel.
            Drive::OnOff => {
                assert!(between == 0 && (known_kg / used_kg - 1.0).abs() < 0.01, "{used_kg} {known_kg}");
                let mut last = 0.0;
                for roll in rolls {
                    // A pair never starts while the other is on.
                    assert!(roll * last >= 0.0, "{roll} after {last}");
                    last = roll;
                }
            }
        }
    }
}
