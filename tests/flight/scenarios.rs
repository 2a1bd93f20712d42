//! Whole flights: the project's scenarios pass, end as they should when something runs out, and repeat to
//! the bit.

use crate::fixture::files;
use crate::fixture::files::scenario;
use hopbench::plant::Snapshot;
use hopbench::plant::column::COLUMNS;
use hopbench::scenario::Outcome;
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};
use hopbench::simulation::{self, Flight, Report, Source};

fn fly(name: &str, seed: u32, overrides: &[(&str, &str)]) -> Report {
    simulation::fly(&scenario(name, overrides), seed, |_| {}).unwrap().report()
}

fn event(report: &Report, name: &str) -> Option<f64> {
    report.events.iter().find(|e| e.kind.name() == name).map(|e| e.time_s)
}

#[test]
fn every_closed_loop_scenario_passes_on_several_seeds() {
    for name in ["hop_50m", "hover_5m", "hop_10m_px4", "wind_gust", "gusty_hop", "gusty_hop_gt"] {
        for seed in 1..=3 {
            let report = fly(name, seed, &[]);
            assert!(report.expect.passed, "{name}, seed {seed}: {:?}", report.expect.items);
            assert_eq!(report.outcome, Outcome::Landed);
            assert_eq!(report.flown_by.len(), 1);
            assert_eq!(report.flown_by[0].source, Source::Autopilot);
        }
    }
}

#[test]
fn the_hop_goes_through_its_phases_in_order() {
    let report = fly("hop_50m", 1, &[]);
    let names = [
        "phase:align",
        "armed",
        "phase:ignition",
        "ignition",
        "phase:ascent",
        "liftoff",
        "phase:hover",
        "phase:descent",
        "phase:terminal",
        "touchdown",
        "shutdown",
        "phase:done",
    ];
    let times: Vec<f64> = names
        .iter()
        .map(|n| event(&report, n).unwrap_or_else(|| panic!("no {n}: {:?}", report.events)))
        .collect();
    assert!(times.is_sorted(), "{:?}", names.iter().zip(&times).collect::<Vec<_>>());
    let hover = report.hover.unwrap();
    assert!((hover.duration_s - 10.0).abs() < 0.1 && hover.altitude_rms_m < 0.3 && hover.lateral_rms_m < 0.5);
}

#[test]
fn rtk_brings_the_true_position_within_a_metre() {
    for seed in 1..=3 {
        let report =
            fly("hop_50m", seed, &[("sensors.gnss", "\"rtk\""), ("expect.position_error_max_m", "1.0")]);
        assert!(report.expect.passed, "{:?}", report.expect.items);
        assert!(report.touchdown.unwrap().position_error_m < 0.3, "{:?}", report.touchdown);
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    let (a, b, other) = (fly("hover_5m", 7, &[]), fly("hover_5m", 7, &[]), fly("hover_5m", 8, &[]));
    assert_eq!(a.state_hash, b.state_hash);
    assert_eq!(a.touchdown, b.touchdown);
    assert_ne!(a.state_hash, other.state_hash);
}

#[test]
fn open_loop_runs_complete_with_their_mass_accounted_for() {
    for name in ["open_loop_a", "open_loop_b"] {
        let report = fly(name, 1, &[]);
        assert!(report.expect.passed, "{name}: {:?}", report.expect.items);
        assert_eq!(report.flown_by[0].source, Source::Commands);
    }
    // With the gas in the chamber on the books.
    let report = fly("open_loop_a", 1, &[("model.chamber", "\"filling\"")]);
    assert!(report.expect.passed, "{:?}", report.expect.items);
}

/// A flight on the pad under one command, for so many seconds; every snapshot is shown.
fn hold(flight: &mut Flight, command: &ActuatorCommand, seconds: f64, mut look: impl FnMut(&Snapshot)) {
    for _ in 0..(seconds / flight.step_s()).round() as usize {
        flight.step(command);
        look(flight.snapshot());
    }
}

fn armed(throttle: Throttle) -> ActuatorCommand {
    ActuatorCommand { armed: true, throttle, discrete: Discrete::SAFE, ..ActuatorCommand::SAFE }
}

#[test]
fn disarmed_on_the_pad_nothing_flows_and_nothing_moves() {
    let mut flight = Flight::new(&scenario("hover_5m", &[]), 1).unwrap();
    let start = *flight.snapshot();
    hold(&mut flight, &ActuatorCommand::SAFE, 120.0, |_| {});
    let now = flight.snapshot();
    assert_eq!(now.nitrous_kg, start.nitrous_kg);
    assert_eq!(now.expelled_kg, [0.0; 3]);
    assert_eq!(now.thrust_n, 0.0);
    assert!((now.tank_pa - 65e5).abs() < 1.0);
    // It settles by the lean that the centre of mass, 0.1 mm off the axis, gives four springs: 3e-6 m.
    assert!((now.position_ned_m - start.position_ned_m).norm() < 1e-5, "{}", now.position_ned_m);
    // Section "Sensors, actuators, gear" of the vehicle's sheet: the pivot stands 0.741 m over the pad.
    assert!((-now.position_ned_m.z - 0.741).abs() < 5e-4);
}

#[test]
fn arming_alone_opens_the_feed_but_lights_nothing() {
    let mut flight = Flight::new(&scenario("hover_5m", &[]), 1).unwrap();
    hold(&mut flight, &armed(Throttle::ThrustN(0.0)), 3.0, |now| {
        assert_eq!((now.thrust_n, now.oxidizer_kg_s), (0.0, 0.0));
    });
    assert!(flight.events().iter().any(|e| e.kind.name() == "armed"));
    assert!(!flight.events().iter().any(|e| e.kind.name() == "ignition"));
}

#[test]
fn a_throttle_below_the_minimum_holds_the_minimum_and_below_two_per_cent_shuts() {
    let mut flight = Flight::new(&scenario("hover_5m", &[]), 1).unwrap();
    hold(&mut flight, &armed(Throttle::ThrustN(0.0)), 1.5, |_| {});
    hold(&mut flight, &armed(Throttle::ThrustN(100.0)), 3.0, |_| {});
    // The rise is over to exp(-2.6/0.25); the encoder's step of 0.025 deg is 1.4 N at most.
    assert!((flight.snapshot().thrust_n - 300.0).abs() < 1.5, "{}", flight.snapshot().thrust_n);
    hold(&mut flight, &armed(Throttle::ThrustN(19.0)), 1.0, |_| {});
    assert_eq!(flight.snapshot().thrust_n, 0.0);
    assert!(flight.events().iter().any(|e| e.kind.name() == "shutdown"));
}

#[test]
fn thrust_rises_in_half_a_second_from_ten_to_ninety_per_cent() {
    let mut flight = Flight::new(&scenario("hover_5m", &[("initial.clamped", "true")]), 1).unwrap();
    hold(&mut flight, &armed(Throttle::ThrustN(0.0)), 1.5, |_| {});
    let mut rise = Vec::new();
    hold(&mut flight, &armed(Throttle::ThrustN(800.0)), 4.0, |now| rise.push((now.time.s(), now.thrust_n)));
    let plateau = rise.last().unwrap().1;
    let at = |share: f64| rise.iter().find(|(_, t)| *t > share * plateau).unwrap().0;
    // First-order rise: 0.25 s ln 9 = 0.549 s; unlit flow already gives a fifth.
    let first_order = 0.25 * libm::log(9.0);
    let took = at(0.9) - at(0.1).max(at(0.25));
    assert!(took > 0.7 * first_order && took < 1.05 * first_order, "{took}");
}

#[test]
fn disarming_in_the_air_cuts_and_the_fall_is_seen() {
    let scenario = scenario("hop_50m", &[]);
    let mut flight = Flight::new(&scenario, 1).unwrap();
    flight.set_source(Source::Autopilot);
    let mut command = ActuatorCommand::SAFE;
    let mut cut_s = None;
    while flight.outcome().is_none() {
        flight.step(&command);
        let climbing = flight.snapshot().height_m > 10.0;
        if climbing || cut_s.is_some() {
            cut_s.get_or_insert(flight.time().s());
            command = ActuatorCommand::SAFE;
        } else if let Some(next) = flight.autopilot_command() {
            command = next;
        }
        if cut_s.is_some_and(|t| flight.time().s() - t > 0.5) {
            assert_eq!(flight.snapshot().thrust_n, 0.0);
        }
    }
    assert_eq!(flight.outcome(), Some(Outcome::Crashed));
}

#[test]
fn an_igniter_that_never_fires_ends_as_no_ignition() {
    let scenario = scenario("hover_5m", &[("sequence.source", "\"controls\"")]);
    let mut flight = Flight::new(&scenario, 1).unwrap();
    let mut command = armed(Throttle::ThrustN(500.0));
    command.discrete = Discrete { isolation_open: true, vent_shut: true, ..Discrete::SAFE };
    while flight.outcome().is_none() {
        flight.step(&command);
        assert!(flight.time().s() < 20.0);
    }
    assert_eq!(flight.outcome(), Some(Outcome::NoIgnition));
    let now = flight.snapshot();
    // Nitrous flowed without a flame: cold thrust, held down.
    assert!(now.thrust_n > 0.0 && now.thrust_n < 150.0 && now.pads_down == 4, "{now:?}");
}

#[test]
fn running_out_of_anything_is_an_event_and_a_tail() {
    for (what, overrides) in [
        ("nitrous_depleted", vec![("initial.nitrous_kg", "1.0")]),
        ("fuel_burn_through", vec![("initial.port_radius_m", "0.0655")]),
        ("bottle_low", vec![("initial.nitrogen_kg", "0.95")]),
    ] {
        let mut overrides = overrides;
        overrides.push(("initial.clamped", "true"));
        let mut flight = Flight::new(&scenario("hover_5m", &overrides), 1).unwrap();
        hold(&mut flight, &armed(Throttle::ThrustN(0.0)), 1.5, |_| {});
        let mut least_fuel = f64::INFINITY;
        hold(&mut flight, &armed(Throttle::ThrustN(600.0)), 20.0, |now| {
            let all = COLUMNS.iter().all(|column| column.of(now).is_finite());
            assert!(all, "{what} at {}: {now:?}", now.time.s());
            assert!(now.nitrous_kg >= 0.0 && now.fuel_kg >= 0.0 && now.thrust_n >= 0.0);
            assert!(now.fuel_kg <= least_fuel + 1e-12, "fuel grew");
            least_fuel = now.fuel_kg;
        });
        let names: Vec<_> = flight.events().iter().map(|e| e.kind.name()).collect();
        assert!(names.iter().any(|name| name == what), "{what}: {names:?}");
        let report = flight.report();
        let closure = report.mass.closure_error_kg.abs() / report.mass.initial_kg;
        assert!(closure < 1e-9, "{what}: {closure}");
        match what {
            // Unlit nitrous at 40 s of specific impulse goes on while the valve is open.
            "fuel_burn_through" => assert!(!flight.snapshot().lit && flight.snapshot().thrust_n < 130.0),
            "nitrous_depleted" => assert!(flight.snapshot().thrust_n < 1.0),
            _ => {}
        }
    }
}

#[test]
fn an_engine_that_will_not_light_ends_the_flight_of_the_built_in_autopilot() {
    // The autopilot gives up and disarms before ten seconds are over; the verdict comes all the same.
    let report = fly("hover_5m", 1, &[("vehicle.engine.ignition.minimum_oxidizer_flow_kg_s", "10.0")]);
    assert_eq!(report.outcome, Outcome::NoIgnition, "{:?}", report.events);
    assert!(report.timing.simulated_s < 20.0);
}

#[test]
fn a_burnt_grain_neither_relights_nor_breaks_the_books() {
    let overrides = [("initial.port_radius_m", "0.0674"), ("initial.clamped", "true")];
    let mut flight = Flight::new(&scenario("hover_5m", &overrides), 1).unwrap();
    hold(&mut flight, &armed(Throttle::ThrustN(0.0)), 1.5, |_| {});
    for _ in 0..6 {
        // Throttle up, off, up again: after burn-through there is nothing to light.
        hold(&mut flight, &armed(Throttle::ThrustN(600.0)), 2.0, |now| assert!(now.fuel_kg >= 0.0));
        hold(&mut flight, &armed(Throttle::ThrustN(900.0)), 1.0, |_| {});
        hold(&mut flight, &armed(Throttle::ThrustN(0.0)), 0.5, |_| {});
    }
    let count = |name: &str| flight.events().iter().filter(|e| e.kind.name() == name).count();
    assert_eq!((count("ignition"), count("fuel_burn_through"), count("shutdown")), (1, 1, 1));
    let report = flight.report();
    assert!(report.mass.closure_error_kg.abs() / report.mass.initial_kg < 1e-9, "{:?}", report.mass);
}

#[test]
fn stores_that_start_empty_stay_empty() {
    for overrides in [
        [("initial.nitrous_kg", "0.0"), ("vehicle.feed.tank.unusable_nitrous_kg", "0.15")],
        [("initial.nitrous_kg", "0.5"), ("vehicle.feed.tank.unusable_nitrous_kg", "0.0")],
    ] {
        let report = fly("open_loop_a", 1, &overrides);
        assert!(
            report.mass.closure_error_kg.abs() / report.mass.initial_kg < 1e-9,
            "{overrides:?}: {:?}",
            report.mass
        );
        assert!(report.propellant.nitrous_left_kg >= 0.0);
    }
}

#[test]
fn a_schedule_commands_the_valves_it_names() {
    use hopbench::scenario::Schedule;
    let mut scenario = scenario("open_loop_a", &[]);
    let text = "time_s,valve_deg,oxidizer_isolation,vent\n0,25,1,1\n2,25,0,1\n5,25,0,0\n";
    scenario.schedule = Some(Schedule::parse(text).unwrap());
    let mut at = Vec::new();
    simulation::fly(&scenario, 1, |now| {
        if now.time.us() % 1_000_000 == 0 {
            at.push((now.oxidizer_kg_s, now.expelled_kg[2]));
        }
    })
    .unwrap();
    // The isolation valve takes a second to shut, and throttles at its end only.
    assert!(at[2].0 > 0.3 && at[4].0 == 0.0, "{at:?}");
    assert!(at[5].1 == 0.0 && at[8].1 > 0.05, "{at:?}");
}

#[test]
fn errors_are_counted_from_where_the_flight_starts() {
    let report = fly("hover_5m", 1, &[("initial.position_ned_m", "[5.0, -3.0, 0.0]")]);
    assert!(report.expect.passed, "{:?}", report.expect.items);
    let touchdown = report.touchdown.unwrap();
    assert!(touchdown.position_error_m < 1.0, "{touchdown:?}");
    assert!(touchdown.navigation_error_m.unwrap() < 1.0, "{touchdown:?}");
    assert!(report.hover.unwrap().lateral_rms_m < 0.5, "{:?}", report.hover);
}

#[test]
fn choices_that_no_model_serves_are_refused_with_their_key() {
    for (key, value) in [
        ("vehicle.engine.grain.fuel_flow_lag_s", "0.0005"),
        ("vehicle.component.0.inertia_kg_m2", "[[1.0, 100.0, 0.0], [100.0, 1.0, 0.0], [0.0, 0.0, 1.0]]"),
        ("initial.engine", "\"running\""),
        ("initial.place", "\"free\""),
    ] {
        let refusal = files::try_scenario("hover_5m", &[(key, value)]).err().map(|e| e.to_string());
        let refusal = refusal.unwrap_or_else(|| panic!("{key} = {value} was accepted"));
        let tail = key.trim_start_matches("vehicle.").split('.').next_back().unwrap();
        assert!(refusal.contains(tail), "{refusal}");
    }
}

/// The file that shows every key of a mission shows each at its default, so that it says what the other
/// scenarios fly.
#[test]
fn the_hop_shows_the_defaults_of_a_mission() {
    assert_eq!(scenario("hop_50m", &[]).file.mission, hopbench::autopilot::Mission::default());
}
