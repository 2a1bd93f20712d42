//! Flights with everything that the feed system and the grain can store: the hop lands, mass is kept, a shut
//! valve ends in nothing, and throttle and fuel are as slow as linear theory says.

#![allow(clippy::disallowed_macros, clippy::disallowed_methods)] // figures for the record

use crate::fixture::bare_engine;
use crate::fixture::files;
use crate::fixture::files::scenario;
use hopbench::plant::column::COLUMNS;
use hopbench::plant::{Plant, Snapshot};
use hopbench::propulsion::{EngineCondition, FeedMap, WarmStart};
use hopbench::scenario::Outcome;
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};
use hopbench::simulation::{self, Report};

const IMPLICIT: (&str, &str) = ("vehicle.feed.manifold.model", "\"implicit\"");
const LINE: (&str, &str) =
    ("vehicle.feed.line", "{ length_m = 0.5, area_m2 = 1.267e-4, static_head = true, drop_m = 0.1 }");
const VALVE: (&str, &str) = ("vehicle.feed.valve.single_phase", "\"choked\"");
const INJECTOR: (&str, &str) = ("vehicle.feed.injector.single_phase", "\"choked\"");
const FUEL: (&str, &str) = ("vehicle.engine.grain.fuel_flow_lag_s", "0.1");
const FILLING: (&str, &str) = ("vehicle.engine.chamber.model", "\"filling\"");
/// Everything at once.
const ALL: [(&str, &str); 6] = [IMPLICIT, LINE, VALVE, INJECTOR, FUEL, FILLING];

/// The variants of the record, each by itself and all together.
fn variants() -> Vec<(&'static str, Vec<(&'static str, &'static str)>)> {
    vec![
        ("reference", vec![]),
        ("manifold", vec![IMPLICIT]),
        ("line", vec![LINE]),
        ("manifold, line", vec![IMPLICIT, LINE]),
        ("choked", vec![VALVE, INJECTOR]),
        ("choked injector", vec![INJECTOR]),
        ("fuel lag 0.1 s", vec![FUEL]),
        ("fuel lag 0.1 s, filling", vec![FUEL, FILLING]),
        ("all, filling", ALL.to_vec()),
    ]
}

fn command(thrust_n: f64) -> ActuatorCommand {
    ActuatorCommand {
        armed: true,
        throttle: Throttle::ThrustN(thrust_n),
        discrete: Discrete {
            igniter: thrust_n > 0.0,
            isolation_open: true,
            vent_shut: true,
            hold_down_released: false,
        },
        ..ActuatorCommand::SAFE
    }
}

/// Mass aboard and gone, against the start.
fn closure(plant: &Plant, start: &Snapshot) -> f64 {
    let end = plant.snapshot();
    let total =
        |s: &Snapshot| s.mass_kg + s.manifold_kg + s.chamber_gas_kg + s.expelled_kg.iter().sum::<f64>();
    (total(end) - total(start)).abs() / start.mass_kg
}

/// The clamped engine lit and settled at a thrust, then commanded to another: times (s) of 10 and 90 % after
/// the command, of valve area, P2 and thrust.
fn step_response(overrides: &[(&str, &str)], from_n: f64, to_n: f64) -> [(f64, f64); 3] {
    let mut overrides = overrides.to_vec();
    overrides.push(("initial.clamped", "true"));
    let scenario = scenario("hop_50m", &overrides);
    let mut plant = Plant::new(&scenario).unwrap();
    let start = *plant.snapshot();
    for _ in 0..7_000 {
        plant.step(&command(from_n));
    }
    assert!(plant.snapshot().lit, "{overrides:?}");
    let values = |s: &Snapshot| [s.valve_area_m2, s.injector_inlet_pa, s.thrust_n];
    let before = values(plant.snapshot());
    let mut record = Vec::new();
    for _ in 0..2_000 {
        plant.step(&command(to_n));
        record.push(values(plant.snapshot()));
    }
    assert!(closure(&plant, &start) < 1e-9, "{:e}", closure(&plant, &start));
    // The port grows and the controller follows: "final" is 1.2 s after the command.
    let after = record[1_200];
    std::array::from_fn(|k| {
        let share = |row: &[f64; 3]| (row[k] - before[k]) / (after[k] - before[k]);
        let time =
            |level: f64| 1e-3 * (1.0 + record.iter().position(|row| share(row) >= level).unwrap() as f64);
        (time(0.1), time(0.9))
    })
}

#[test]
fn throttle_steps() {
    let mut rises = Vec::new();
    for (from_n, to_n) in [(300.0, 700.0), (700.0, 300.0), (700.0, 1000.0)] {
        for (name, overrides) in variants() {
            let [valve, p2, thrust] = step_response(&overrides, from_n, to_n);
            println!(
                "{from_n} -> {to_n} N {name:24} 10-90 %: valve {:.0} ms, P2 {:.0} ms, thrust {:.0} ms; 90 % of thrust at {:.0} ms",
                1e3 * (valve.1 - valve.0),
                1e3 * (p2.1 - p2.0),
                1e3 * (thrust.1 - thrust.0),
                1e3 * thrust.1
            );
            if (from_n, to_n) == (300.0, 700.0) {
                rises.push((name, valve, p2, thrust));
            }
        }
    }
    // Linear theory: lags in series add the squares of their rise times, 2.2 τ for one of first order. The
    // manifold's lag is 32 ms at 300 N to 45 ms at 700 N.
    let (reference, manifold) = (&rises[0], &rises[1]);
    let rise = |x: &(f64, f64)| x.1 - x.0;
    let expected = |tau: f64| libm::hypot(rise(&reference.2), 2.2 * tau);
    let found = rise(&manifold.2);
    println!("P2 {found:.4} s, expected {:.4} to {:.4}", expected(0.032), expected(0.045));
    // Root of squares is a rule of thumb, good to 5 %.
    assert!(found > 0.95 * expected(0.032) && found < 1.05 * expected(0.045), "{found}");
    // First moments add exactly in series: the middle is later by the lag.
    let middle = |x: &(f64, f64)| 0.5 * (x.0 + x.1);
    let later = middle(&manifold.3) - middle(&reference.3);
    println!("thrust later by {later:.4} s");
    assert!((0.025..0.055).contains(&later), "{later}");
}

#[test]
fn a_shutdown_with_everything_stored_ends_in_nothing() {
    for (name, overrides) in variants() {
        let mut overrides = overrides;
        overrides.push(("initial.clamped", "true"));
        let scenario = scenario("hop_50m", &overrides);
        let mut plant = Plant::new(&scenario).unwrap();
        let start = *plant.snapshot();
        for _ in 0..6_000 {
            plant.step(&command(800.0));
        }
        let mut fuel_kg = plant.snapshot().fuel_kg;
        let mut off_ms = None;
        for ms in 0..3_000 {
            plant.step(&command(0.0));
            let now = plant.snapshot();
            assert!(
                now.thrust_n >= 0.0 && now.oxidizer_kg_s >= 0.0 && now.fuel_kg_s >= 0.0,
                "{name}: {now:?}"
            );
            assert!(now.fuel_kg <= fuel_kg, "{name}");
            fuel_kg = now.fuel_kg;
            if now.thrust_n == 0.0 {
                off_ms.get_or_insert(ms);
            }
        }
        let now = plant.snapshot();
        println!(
            "{name}: no thrust {off_ms:?} ms after the command, {:.2e} kg between valves",
            now.manifold_kg
        );
        assert_eq!((now.thrust_n, now.oxidizer_kg_s, now.fuel_kg_s), (0.0, 0.0, 0.0), "{name}");
        assert!(!now.lit && closure(&plant, &start) < 1e-9, "{name}: {:e}", closure(&plant, &start));
    }
}

#[test]
fn random_throttles_to_the_last_drop_keep_mass_and_numbers() {
    for (seed, (name, mut overrides)) in variants().into_iter().enumerate() {
        overrides.push(("initial.clamped", "true"));
        overrides.push(("initial.nitrous_kg", "2.5"));
        let scenario = scenario("hop_50m", &overrides);
        let mut plant = Plant::new(&scenario).unwrap();
        let start = *plant.snapshot();
        let mut random = 0x9e37_79b9_7f4a_7c15u64 ^ seed as u64;
        let mut thrust_n = 400.0;
        for step in 0..20_000 {
            if step > 5_000 && step % 70 == 0 {
                random =
                    random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                thrust_n = 1_300.0 * (random >> 40) as f64 / (1u64 << 24) as f64;
            }
            plant.step(&command(thrust_n));
            let now = plant.snapshot();
            assert!(COLUMNS.iter().all(|column| column.of(now).is_finite()), "{name}, {step}");
            assert!(now.nitrous_kg >= 0.0 && now.manifold_kg >= 0.0 && now.thrust_n >= 0.0, "{name}, {step}");
        }
        assert!(plant.snapshot().nitrous_kg < 0.15, "{name}: {}", plant.snapshot().nitrous_kg);
        let error = closure(&plant, &start);
        println!("{name}: closure {error:.1e}");
        assert!(error < 1e-9, "{name}: {error:e}");
    }
}

fn hop(overrides: &[(&str, &str)], seed: u32) -> Report {
    simulation::fly(&scenario("hop_50m", overrides), seed, |_| {}).unwrap().report()
}

#[test]
fn the_hop_lands_with_everything_on() {
    for (name, overrides) in variants() {
        let seeds = if overrides.len() == ALL.len() { 4 } else { 1 };
        for seed in 1..=seeds {
            let report = hop(&overrides, seed);
            let touchdown = report.touchdown.unwrap();
            let hover = report.hover.unwrap();
            println!(
                "{name}, seed {seed}: touchdown {:.3} m/s at {:.3} s, top {:.3} m, hover {:.3} m, nitrous {:.3} kg, \
                 fuel {:.3} kg, closure {:.1e}",
                touchdown.vertical_speed_m_s,
                touchdown.time_s,
                report.max_altitude_m,
                hover.altitude_rms_m,
                report.propellant.nitrous_used_kg,
                report.propellant.fuel_used_kg,
                report.mass.closure_error_kg.abs() / report.mass.initial_kg
            );
            assert_eq!(report.outcome, Outcome::Landed, "{name}");
            assert!(report.expect.passed, "{name}, {seed}: {:?}", report.expect.items);
        }
    }
}

/// The fuel's lag in closed form, at constant oxidiser: 1 - exp(-t/τ) of a step.
#[test]
fn fuel_follows_a_step_of_oxidiser_along_an_exponential() {
    let tau_s = 0.1;
    let mut vehicle = bare_engine::vehicle();
    vehicle.engine.grain.fuel_flow_lag_s = tau_s;
    let engine = bare_engine::engine_of(&vehicle);
    let grain = &vehicle.engine.grain;
    let feed = FeedMap::new(65e5, 290.0);
    // The outlet's limit, not the pressures, sets the flow: exactly constant.
    let point = |oxidizer_kg_s: f64, fuel_flow_kg_s: f64| {
        let condition = EngineCondition {
            oxidizer_flow_limit_kg_s: oxidizer_kg_s,
            fuel_flow_kg_s: Some(fuel_flow_kg_s),
            ..bare_engine::condition(30.0, 17.0)
        };
        let point = engine.operating_point(&feed, 1.2e-4, &condition, WarmStart::default());
        assert!((point.oxidizer_kg_s - oxidizer_kg_s).abs() < 1e-12, "{} kg/s", point.oxidizer_kg_s);
        point
    };
    let before = point(0.2, 0.0).steady_fuel_kg_s;
    let after = point(0.3, 0.0).steady_fuel_kg_s;
    // Marxman's law: as the oxidiser's flux to its exponent.
    let law = libm::pow(0.3 / 0.2, grain.regression_exponent);
    println!("{before:.5} to {after:.5} kg/s");
    assert!((after / before / law - 1.0).abs() < 1e-6, "{}", after / before);
    let rate = |fuel_kg_s: f64| {
        let now = point(0.3, fuel_kg_s);
        assert!((now.fuel_kg_s - fuel_kg_s).abs() < 1e-9, "what burns is what lags: {} kg/s", now.fuel_kg_s);
        grain.fuel_flow_rate_kg_s2(fuel_kg_s, now.steady_fuel_kg_s)
    };
    let (mut fuel_kg_s, mut worst, dt_s) = (before, 0.0f64, 1e-3);
    for step in 1..=500 {
        let k1 = rate(fuel_kg_s);
        let k2 = rate(fuel_kg_s + 0.5 * dt_s * k1);
        let k3 = rate(fuel_kg_s + 0.5 * dt_s * k2);
        let k4 = rate(fuel_kg_s + dt_s * k3);
        fuel_kg_s += dt_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
        let share = (fuel_kg_s - before) / (after - before);
        worst = worst.max((share - (1.0 - libm::exp(-1e-3 * f64::from(step) / tau_s))).abs());
    }
    println!("{worst:.1e} of the step off 1 - exp(-t/tau)");
    // RK4 at h = τ/100: t/τ h^4/120 exp(-t/τ), 3e-11 at the most, and round-off.
    assert!(worst < 1e-10, "{worst:e}");
}

#[test]
fn shortest_lag_is_a_step_and_shorter_ones_are_refused() {
    let refused = files::try_scenario("hop_50m", &[("vehicle.engine.grain.fuel_flow_lag_s", "0.0005")]);
    assert!(refused.unwrap_err().to_string().contains("allowed 0, or 0.001 and more"));
    let report = hop(&[("vehicle.engine.grain.fuel_flow_lag_s", "0.001")], 1);
    let reference = hop(&[], 1);
    assert_eq!(report.outcome, Outcome::Landed);
    let used = report.propellant.fuel_used_kg / reference.propellant.fuel_used_kg;
    assert!((used - 1.0).abs() < 1e-3, "{used}");
}
