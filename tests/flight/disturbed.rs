//! Disturbed flights: what a disturbance does to the plant, in closed form, and that the autopilot lands
//! through it.

use crate::fixture::files::scenario;
use hopbench::disturbance::Disturbance;
use hopbench::frame::Vec3;
use hopbench::plant::Plant;
use hopbench::scenario::{Outcome, Scenario};
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};
use hopbench::simulation;

#[test]
fn the_autopilot_lands_with_a_crooked_noisy_engine_in_turbulence() {
    for seed in 1..=4 {
        let report = simulation::fly(&scenario("disturbed_hop", &[]), seed, |_| {}).unwrap().report();
        assert!(report.expect.passed, "seed {seed}: {:?}", report.expect.items);
        assert_eq!(report.outcome, Outcome::Landed);
        let seen: Vec<_> = report.events.iter().filter(|e| e.kind.name() == "disturbance").collect();
        let details: Vec<_> = seen.iter().map(|e| e.detail.as_str()).collect();
        assert_eq!(details, ["engine begins", "push begins", "push ends"]);
        assert!((seen[2].time_s - seen[1].time_s - 0.5).abs() < 1e-9);
    }
}

/// Braking at the end of the descent, with thrust that the autopilot's engine model follows late, is no
/// contact: seed 6 once had its engine cut 1.5 m up.
#[test]
fn the_autopilot_does_not_take_braking_for_contact() {
    let energy = "\"energy_balance\"";
    let better = [
        ("vehicle.feed.tank.ullage.model", energy),
        ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1"),
        ("vehicle.feed.tank.ullage.vapor_saturation", "1"),
        ("vehicle.pressurant.bottle.model", energy),
        ("vehicle.pressurant.regulator.droop_pa_s_kg", "3.3e6"),
        ("vehicle.pressurant.regulator.lockup_pa", "2e5"),
        ("vehicle.feed.valve.single_phase", "\"choked\""),
        ("vehicle.feed.injector.single_phase", "\"choked\""),
        ("vehicle.feed.valve.friction_rad", "0.005"),
        ("vehicle.feed.valve.backlash_rad", "0.005"),
        ("vehicle.engine.chamber.model", "\"filling\""),
    ];
    for seed in [1, 6] {
        let flight = simulation::fly(&scenario("disturbed_hop", &better), seed, |_| {}).unwrap();
        let report = flight.report();
        let touchdown = report.touchdown.unwrap();
        let cut = report.events.iter().find(|event| event.kind.name() == "phase:touchdown").unwrap();
        assert!(cut.time_s > touchdown.time_s - 0.1, "seed {seed}: {} {}", cut.time_s, touchdown.time_s);
        assert!(touchdown.vertical_speed_m_s <= 1.0, "seed {seed}: {touchdown:?}");
        assert_eq!(report.outcome, Outcome::Landed, "seed {seed}");
    }
}

#[test]
fn turbulence_follows_from_the_seed_of_the_run() {
    let wind = |seed| {
        let mut last = Vec3::zeros();
        let overrides = [("mission.hover_height_m", "3.0"), ("timeout_s", "10.0")];
        let flight = simulation::fly(&scenario("disturbed_hop", &overrides), seed, |s| last = s.wind_ned_m_s);
        (last, flight.unwrap().report().state_hash)
    };
    assert_eq!(wind(3), wind(3));
    assert_ne!(wind(3).0, wind(4).0);
}

/// Free flight in still air of no density under 700 N, for a second, with a disturbance or without.
fn flown(disturbance: Option<Disturbance>) -> Plant {
    let vehicle = scenario("hop_50m", &[]).vehicle;
    let command = ActuatorCommand {
        armed: true,
        throttle: Throttle::ThrustN(700.0),
        gimbal_x_rad: 0.0,
        gimbal_y_rad: 0.0,
        rcs_roll: 0.0,
        discrete: Discrete::FLIGHT,
    };
    let mut scenario = Scenario::free_flight(&vehicle, command);
    scenario.site.air_density_kg_m3 = 0.0;
    scenario.file.disturbance.extend(disturbance);
    let mut plant = Plant::new(&scenario).unwrap();
    for _ in 0..1000 {
        plant.step(&command);
    }
    plant
}

#[test]
fn a_pulse_has_its_impulse_and_a_bias_its_share() {
    let calm = flown(None);
    // 40 N across for 0.25 s, at the height of the centre of mass: the vehicle hardly turns, so the velocity
    // of its centre differs by impulse over mass. What turns, 1e-3 rad, tilts 700 N by less than 0.5 % of it.
    let at_com_m = -calm.snapshot().com_structural_m.z;
    let push = Disturbance {
        start_s: 0.5,
        duration_s: Some(0.25),
        force_body_n: [0.0, 40.0, 0.0],
        point_m: [0.0, 0.0, at_com_m],
        ..Default::default()
    };
    let pushed = flown(Some(push));
    let (a, b) = (calm.snapshot(), pushed.snapshot());
    let gained = (b.com_velocity_ned_m_s - a.com_velocity_ned_m_s).y;
    let expected = 40.0 * 0.25 / b.mass_kg;
    assert!((gained / expected - 1.0).abs() < 0.02, "{gained} against {expected}");

    // 3 % more thrust is 3 % more of what the calm flight's thrust adds to its fall.
    let strong = flown(Some(Disturbance { thrust_bias: 0.03, ..Default::default() }));
    let s = strong.snapshot();
    assert!((s.thrust_n / a.thrust_n - 1.03).abs() < 1e-9, "{} against {}", s.thrust_n, a.thrust_n);
    let lifted = |plant: &Plant| 9.80665 - plant.snapshot().com_velocity_ned_m_s.z;
    assert!((lifted(&strong) / lifted(&calm) - 1.03).abs() < 1e-4, "{}", lifted(&strong) / lifted(&calm));
}

#[test]
fn a_misaligned_thrust_line_turns_the_vehicle_as_the_gimbal_would() {
    // Moment T l sin δ about the centre of mass for an angle, T e for an offset e; what Ixz, Iyz and the
    // liquid do to it is a few per cent.
    let calm = flown(None);
    let (l, thrust_n) = (calm.snapshot().com_structural_m.z, calm.snapshot().thrust_n);
    let inertia = calm.snapshot().inertia_kg_m2;
    let rate = |d: Disturbance| flown(Some(d)).snapshot().rate_body_rad_s - calm.snapshot().rate_body_rad_s;
    let tilted = rate(Disturbance { misalignment_rad: [0.002, -0.002], ..Default::default() });
    let expected = thrust_n * l * libm::sin(0.002) / inertia[(0, 0)];
    assert!((tilted.x / expected - 1.0).abs() < 0.05, "{tilted} against {expected}");
    assert!((tilted.y / expected + 1.0).abs() < 0.05, "{tilted} against {expected}");
    let shifted = rate(Disturbance { thrust_offset_m: [0.002, 0.0], ..Default::default() });
    // (e, 0, 0) x (0, 0, -T) = (0, e T, 0)
    let expected = thrust_n * 0.002 / inertia[(1, 1)];
    assert!((shifted.y / expected - 1.0).abs() < 0.05, "{shifted} against {expected}");
}
