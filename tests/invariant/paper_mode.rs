//! Invariants of the seed paper's mode, of frozen couplings, and of other steps than the plant's own.

#![allow(clippy::disallowed_macros, clippy::disallowed_methods)] // prints its figures for the record

use crate::fixture::files;
use hopbench::plant::column;
use hopbench::plant::{Plant, Snapshot};
use hopbench::propulsion::{EngineCondition, FeedMap, PaperEngine};
use hopbench::scenario::{Outcome, Scenario, Schedule};
use hopbench::simulation::fly;
use hopbench::time::SimTime;

fn flown(scenario: &Scenario, every_us: u64) -> Vec<Snapshot> {
    let mut rows = Vec::new();
    fly(scenario, 1, |now| {
        if now.time.us().is_multiple_of(every_us) {
            rows.push(*now);
        }
    })
    .unwrap();
    rows
}

fn paper_engine() -> (hopbench::vehicle::Vehicle, PaperEngine) {
    let vehicle = files::reference();
    let paper = PaperEngine::new(&vehicle.engine, &vehicle.engine_parameters, &vehicle.paper_mode);
    (vehicle, paper)
}

fn condition(port_radius_m: f64, throat_radius_m: f64) -> EngineCondition {
    EngineCondition::burning(port_radius_m, throat_radius_m, 101_325.0)
}

/// Least-squares polynomials of NASA CEA's ideal values at 20 bar, expansion 3, O/F 1 to 12, degree 8, made
/// with numpy from the table that the reference map was reduced from.
const CEA_ISP_SEA_LEVEL_S: [f64; 9] = [
    9.256334926060e+01,
    1.337666474147e+02,
    -9.817179805768e+01,
    4.135666050028e+01,
    -9.785179964292e+00,
    1.349847896630e+00,
    -1.083704794605e-01,
    4.701841403358e-03,
    -8.528824009843e-05,
];
const CEA_C_STAR_M_S: [f64; 9] = [
    7.321107968286e+02,
    7.209734195059e+02,
    -5.106234815706e+02,
    2.204325959855e+02,
    -5.304850612477e+01,
    7.350060253368e+00,
    -5.877541668179e-01,
    2.528350215179e-02,
    -4.537528543003e-04,
];

#[test]
fn the_polynomials_are_those_of_the_equilibrium_table() {
    let (_, paper) = paper_engine();
    let at = |c: &[f64; 9], of: f64| c.iter().rev().fold(0.0, |sum, c| sum * of + c);
    let mut worst = 0.0f64;
    for i in 0..=220 {
        let of = 1.0 + 0.05 * f64::from(i);
        worst = worst.max((paper.specific_impulse_s(of) / at(&CEA_ISP_SEA_LEVEL_S, of) - 1.0).abs());
        worst = worst.max((paper.c_star_m_s(of) / at(&CEA_C_STAR_M_S, of) - 1.0).abs());
    }
    println!("polynomials: {worst:.1e}");
    // The map keeps seven digits of that table at the same O/F, the coefficients thirteen.
    assert!(worst < 1e-6, "{worst:e}");
    assert_eq!(paper.c_star_m_s(40.0), paper.c_star_m_s(12.0));
}

#[test]
fn the_sweep_takes_the_nearest_flow_and_the_valve_gives_it_back() {
    let (vehicle, paper) = paper_engine();
    let feed = FeedMap::new(65e5, 290.0);
    let engine = &vehicle.engine;
    let points = vehicle.paper_mode.sweep_points;
    for (port_m, throat_m) in [(0.025, 0.0098), (0.045, 0.0102), (0.062, 0.0105)] {
        let condition = condition(port_m, throat_m);
        let mut before_rad = 0.0;
        for step in 0..40 {
            let thrust_n = 100.0 + 25.0 * f64::from(step);
            let chosen = paper.sweep(engine, &condition, thrust_n);
            let miss = |flow| (paper.sweep_point(engine, &condition, flow).thrust_n - thrust_n).abs();
            let nearest = (0..points).map(|p| miss(paper.flow_kg_s(p))).fold(f64::MAX, f64::min);
            assert_eq!(miss(chosen.oxidizer_kg_s), nearest);
            // Half the grid's 1 g/s at the slope of the thrust, under 2.9 N per g/s.
            assert!(nearest < 1.45, "{thrust_n} N: {nearest}");
            let inverse = paper.inverse(engine, &feed, thrust_n, &condition);
            assert!(!inverse.saturated && inverse.valve_rad >= before_rad);
            before_rad = inverse.valve_rad;
            let point = paper.operating_point(engine, &feed, inverse.valve_area_m2, &condition);
            assert_eq!(point.oxidizer_kg_s, chosen.oxidizer_kg_s, "{thrust_n} N");
            assert!((point.thrust_n / chosen.thrust_n - 1.0).abs() < 1e-15);
        }
        assert!(paper.inverse(engine, &feed, 5000.0, &condition).saturated);
    }
    let shut = paper.operating_point(engine, &feed, 0.0, &condition(0.03, 0.0098));
    assert_eq!((shut.thrust_n, shut.oxidizer_kg_s, shut.fuel_kg_s), (0.0, 0.0, 0.0));
}

#[test]
fn between_knots_the_rate_is_held_and_mass_is_closed() {
    let scenario = files::scenario("open_loop_a", &[("fidelity", "\"paper\"")]);
    let rows = flown(&scenario, 1_000);
    let mut worst = 0.0f64;
    for knot in rows.chunks_exact(20) {
        // Velocity moves in equal parts: round-off of 100 m/s.
        let parts: Vec<f64> =
            knot.windows(2).map(|pair| (pair[1].velocity_ned_m_s - pair[0].velocity_ned_m_s).z).collect();
        worst = worst.max(parts.iter().map(|part| (part - parts[0]).abs()).fold(0.0, f64::max));
    }
    assert!(worst < 1e-12, "{worst:e}");
    for pair in rows.windows(2) {
        assert!(pair[1].fuel_kg < pair[0].fuel_kg && pair[1].nitrous_kg < pair[0].nitrous_kg);
        assert_eq!(pair[1].tank_pa, 65e5);
        let gone: f64 = pair[1].expelled_kg.iter().sum();
        // 8000 sums of 73 kg.
        assert!((pair[1].mass_kg + gone - rows[0].mass_kg).abs() < 1e-10);
    }
}

#[test]
fn better_models_of_the_vehicle_file_do_not_reach_the_paper() {
    let mut keys = vec![("fidelity", "\"paper\""), ("duration_s", "2.0")];
    let plain = flown(&files::scenario("open_loop_a", &keys), 100_000);
    keys.extend([
        ("vehicle.slosh.second_mode", "true"),
        ("vehicle.slosh.hardening_law", "\"radial\""),
        ("vehicle.slosh.baffle_damping_ratio", "0.05"),
        ("vehicle.slosh.roll_inertia_factor", "0.0"),
        ("vehicle.engine.grain.fuel_flow_lag_s", "0.1"),
        ("vehicle.feed.manifold.model", "\"implicit\""),
        ("vehicle.feed.valve.single_phase", "\"choked\""),
        ("vehicle.feed.injector.single_phase", "\"choked\""),
        ("vehicle.feed.tank.ullage.model", "\"energy_balance\""),
        ("vehicle.pressurant.bottle.model", "\"energy_balance\""),
        ("vehicle.pressurant.regulator.droop_pa_s_kg", "3e6"),
        ("vehicle.pressurant.regulator.lockup_pa", "4e4"),
        ("model.chamber", "\"filling\""),
        ("model.gimbal_inertia", "true"),
    ]);
    let better = flown(&files::scenario("open_loop_a", &keys), 100_000);
    for (plain, better) in plain.iter().zip(&better) {
        for column in column::csv() {
            assert_eq!(column.of(plain), column.of(better), "{}", column.name);
        }
    }
    assert_eq!(plain.len(), better.len());
}

/// Without damping enough for the step, Euler's oscillator grows by |1 + λ dt|² = 1 - 2 ζ ω dt + ω² dt² a
/// step in the form ω² x² + v² + 2 ζ ω x v.
#[test]
fn slosh_grows_as_euler_lets_it() {
    let mut scenario = files::scenario("open_loop_a", &[("fidelity", "\"paper\""), ("duration_s", "2.4")]);
    // A doublet excites the liquid; then nothing but thrust, along the axis, so that nothing drives it.
    let rows = "time_s,valve_deg,gimbal_x_deg\n0.0,22.0,0.05\n0.2,22.0,-0.05\n0.4,22.0,0.0\n";
    scenario.schedule = Some(Schedule::parse(rows).unwrap());
    let mut plant = Plant::new(&scenario).unwrap();
    let schedule = scenario.schedule.clone().unwrap();
    let (zeta, radius) = (scenario.vehicle.slosh.damping_ratio, scenario.vehicle.tank.radius_m);
    let xi = 1.841_183_781_340_659_4;
    let mut sizes = Vec::new();
    let mut expected = 0.0;
    while plant.time() < SimTime::from_s(2.4) {
        plant.step(schedule.at(plant.time()));
        if plant.time().us().is_multiple_of(20_000) && plant.time() >= SimTime::from_s(0.6) {
            let state = plant.state();
            let height = state.nitrous_kg
                / (scenario.vehicle.nitrous_density_kg_m3 * std::f64::consts::PI * radius * radius);
            let omega2 = 9.80665 * xi / radius * libm::tanh(xi * height / radius);
            let (x, v) = (state.slosh_m.y, state.slosh_m_s.y);
            sizes.push(omega2 * x * x + v * v + 2.0 * zeta * omega2.sqrt() * x * v);
            let growth: f64 = 1.0 - 2.0 * zeta * omega2.sqrt() * 0.02 + omega2 * 4e-4;
            expected += growth.ln();
            if sizes.len() == 1 {
                expected = 0.0;
            }
        }
    }
    let steps = (sizes.len() - 1) as f64;
    let measured = (sizes[sizes.len() - 1] / sizes[0]).ln();
    println!(
        "amplitude grows {:.2} % a step, expected {:.2} %",
        100.0 * ((measured / (2.0 * steps)).exp() - 1.0),
        100.0 * ((expected / (2.0 * steps)).exp() - 1.0)
    );
    // The vehicle turns slowly in its drag, which drives the liquid by a hundredth of its growth.
    assert!((measured / expected - 1.0).abs() < 0.02, "{measured} {expected}");
}

#[test]
fn the_autopilot_lands_the_hop_in_paper_mode() {
    let scenario = files::scenario("hop_50m", &[("fidelity", "\"paper\"")]);
    let mut wall_m = 0.0f64;
    let flight = fly(&scenario, 1, |now| wall_m = wall_m.max(now.slosh_m[0].hypot(now.slosh_m[1]))).unwrap();
    let report = flight.report();
    println!("{:?}; slosh up to {:.1} mm", report.touchdown, 1e3 * wall_m);
    assert_eq!(report.outcome, Outcome::Landed);
    assert!(report.expect.passed);
    assert!(report.mass.closure_error_kg.abs() < 1e-9 * report.mass.initial_kg);
}

/// Greatest difference of a column between two runs.
fn apart(a: &[Snapshot], b: &[Snapshot], of: impl Fn(&Snapshot) -> f64) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (of(a) - of(b)).abs()).fold(0.0, f64::max)
}

/// Greatest change of a column within a run.
fn change(rows: &[Snapshot], of: impl Fn(&Snapshot) -> f64) -> f64 {
    rows.iter().map(|row| (of(row) - of(&rows[0])).abs()).fold(0.0, f64::max)
}

#[test]
fn a_frozen_coupling_stays_and_the_rest_moves() {
    let live = flown(&files::scenario("open_loop_a", &[]), 10_000);
    for coupling in ["com", "inertia", "port", "nitrogen", "slosh", "throat"] {
        let freeze = format!("[\"{coupling}\"]");
        let rows = flown(&files::scenario("open_loop_a", &[("physics.freeze", &freeze)]), 10_000);
        // What is free moves as far as it does live, within a fifth; what is frozen does not.
        let com = |row: &Snapshot| row.com_structural_m.z;
        let inertia = |row: &Snapshot| row.inertia_kg_m2[(0, 0)];
        let throat = |row: &Snapshot| row.throat_radius_m;
        let slosh = |row: &Snapshot| row.slosh_m[1];
        let like_live = |of: &dyn Fn(&Snapshot) -> f64| change(&rows, of) > 0.8 * change(&live, of);
        assert_eq!(change(&rows, com) < 1e-14, coupling == "com", "{coupling}");
        assert_eq!(change(&rows, inertia) < 1e-13, coupling == "inertia", "{coupling}");
        assert_eq!(change(&rows, throat) == 0.0, coupling == "throat", "{coupling}");
        assert_eq!(change(&rows, slosh) == 0.0, coupling == "slosh", "{coupling}");
        assert!(coupling == "com" || like_live(&com), "{coupling}");
        assert!(coupling == "inertia" || like_live(&inertia), "{coupling}");
        assert!(coupling == "throat" || like_live(&throat), "{coupling}");
        assert!(coupling == "slosh" || change(&rows, slosh) > 1e-4, "{coupling}");
        // Mass is the same function of time but for what port and throat do to the flow.
        let mass = apart(&rows, &live, |row| row.mass_kg);
        assert!(if matches!(coupling, "port" | "throat") { mass < 0.1 } else { mass < 1e-9 }, "{mass}");
        for row in &rows {
            let gone: f64 = row.expelled_kg.iter().sum();
            assert!((row.mass_kg + gone - rows[0].mass_kg).abs() < 1e-10, "{coupling}");
        }
        // And it is worth something.
        let moved = apart(&rows, &live, |row| row.position_ned_m.norm());
        println!("{coupling:10} {moved:.2e} m after 8 s");
        assert!(moved > 1e-6, "{coupling}: {moved}");
    }
}

#[test]
fn with_a_frozen_port_the_fuel_flow_knows_the_oxidiser_alone() {
    let mut scenario = files::scenario("open_loop_a", &[("physics.freeze", "[\"port\", \"throat\"]")]);
    scenario.schedule = Some(Schedule::parse("time_s,valve_deg\n0.0,25.0\n").unwrap());
    let rows = flown(&scenario, 10_000);
    // Nothing that the engine sees changes: round-off of the root in P2.
    assert!(change(&rows, |row| row.fuel_kg_s) < 1e-10);
    // The real port grows by what burns.
    let burnt_kg = rows[0].fuel_kg - rows[rows.len() - 1].fuel_kg;
    assert!((burnt_kg - 8.0 * rows[0].fuel_kg_s).abs() < 1e-9, "{burnt_kg}");
    assert!(change(&rows, |row| row.port_radius_m) > 0.01);
}

#[test]
fn frozen_nitrogen_stays_in_its_bottle() {
    let live = flown(&files::scenario("open_loop_a", &[]), 100_000);
    let held = flown(&files::scenario("open_loop_a", &[("physics.freeze", "[\"nitrogen\"]")]), 100_000);
    let vehicle = files::reference();
    let tank = &vehicle.tank;
    for (a, b) in live.iter().zip(&held) {
        // The share that went to the run tank, from the bottle's centre to the ullage's.
        let moved_kg = a.nitrogen_ullage_kg - live[0].nitrogen_ullage_kg;
        let height_m = tank.length_m * a.nitrous_kg / vehicle.tank_capacity_kg();
        let ullage_z_m = tank.floor_z_m + 0.5 * (tank.length_m + height_m);
        let bottle_z_m = vehicle.pressurant.bottle.centre_z_m;
        let expected_m = moved_kg * (ullage_z_m - bottle_z_m) / a.mass_kg;
        assert!((a.com_structural_m.z - b.com_structural_m.z - expected_m).abs() < 1e-12);
        assert!((a.tank_pa - b.tank_pa).abs() < 1e-6);
    }
}

#[test]
fn euler_is_of_first_order() {
    let run = |step_s: &str| {
        let keys = [
            ("physics.step_s", step_s),
            ("physics.integrator", "\"euler\""),
            ("physics.freeze", "[\"slosh\"]"),
        ];
        flown(&files::scenario("open_loop_a", &keys), 100_000)
    };
    let rows = [run("0.01"), run("0.005"), run("0.0025")];
    let [coarse, fine] = [0, 1].map(|i| apart(&rows[i], &rows[i + 1], |row| row.position_ned_m.z));
    println!("Euler: {coarse:.3} m, {fine:.3} m");
    // Halving the step halves the error, but for the second order: 10 ms against seconds.
    assert!((coarse / fine - 2.0).abs() < 0.05, "{}", coarse / fine);
}

#[test]
fn another_step_is_refused_where_sensors_measure() {
    for (name, key, value) in [
        ("hop_50m", "physics.step_s", "0.005"),
        ("open_loop_a", "physics.step_s", "0.0010005"),
        ("open_loop_a", "physics.step_s", "0.5"),
        ("open_loop_a", "physics.freeze", "[\"mass\"]"),
        ("open_loop_a", "fidelity", "\"exact\""),
    ] {
        let refusal = files::try_scenario(name, &[(key, value)]).unwrap_err().to_string();
        assert!(refusal.contains(key), "{refusal}");
    }
}

/// Whatever has no effect in paper mode is refused where the scenario asks for it, not passed over.
#[test]
fn paper_mode_refuses_a_step_and_an_integrator_of_the_full_model() {
    for (key, value) in [("physics.step_s", "0.005"), ("physics.integrator", "\"euler\"")] {
        let given = |fidelity| files::try_scenario("open_loop_a", &[("fidelity", fidelity), (key, value)]);
        assert!(given("\"full\"").is_ok());
        let refusal = given("\"paper\"").unwrap_err().to_string();
        assert!(refusal.contains(key) && refusal.contains("paper_mode.step_s"), "{refusal}");
    }
}

/// Polynomials need a range that rises and lies in the map.
#[test]
fn a_range_that_nothing_can_be_fitted_to_is_refused() {
    let given =
        |range| files::try_scenario("open_loop_a", &[("vehicle.paper_mode.polynomial_of_range", range)]);
    for range in ["[12.0, 1.0]", "[1.0, 1.01]", "[20.0, 40.0]"] {
        let refusal = given(range).unwrap_err().to_string();
        assert!(
            refusal.contains("paper_mode.polynomial_of_range") && refusal.contains("0.5 to 15"),
            "{refusal}"
        );
    }
    // Beyond one end of the map, the map's end serves.
    assert!(given("[2.0, 40.0]").is_ok());
}

#[test]
fn an_autopilot_told_nothing_believes_the_mass_it_was_loaded_with() {
    for (knowledge, falls) in [("\"live\"", true), ("\"liftoff\"", false)] {
        let scenario = files::scenario("hover_5m", &[("mission.mass_knowledge", knowledge), ("seed", "3")]);
        let mut flight = fly(&scenario, 3, |_| {}).unwrap();
        assert_eq!(flight.outcome(), Some(Outcome::Landed), "{knowledge}");
        let (loaded, end) = (scenario_mass_kg(&scenario), flight.autopilot().estimate().mass_kg);
        assert_eq!(end < loaded - 1.0, falls, "{end} {loaded}");
        assert_eq!(end == loaded, !falls, "{end} {loaded}");
    }
}

fn scenario_mass_kg(scenario: &Scenario) -> f64 {
    Plant::new(scenario).unwrap().snapshot().mass_kg
}
