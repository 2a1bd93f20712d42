//! Gas as a state over whole flights: they land, the tank holds its pressure, nothing is lost, and an outlet that
//! uncovers gives a spike and a tail.
#![allow(clippy::disallowed_macros)] // prints what it measured

mod files;

use files::scenario;
use hopbench::plant::Snapshot;
use hopbench::scenario::Outcome;
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};
use hopbench::simulation::{self, Flight};

const BOTTLE: (&str, &str) = ("vehicle.pressurant.bottle.model", "\"energy_balance\"");
const ULLAGE: (&str, &str) = ("vehicle.feed.tank.ullage.model", "\"energy_balance\"");
const VAPOR: (&str, &str) = ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1e-8");
const SATURATED: (&str, &str) = ("vehicle.feed.tank.ullage.vapor_saturation", "1.0");
const DROOP: (&str, &str) = ("vehicle.pressurant.regulator.droop_pa_s_kg", "3.3e6");
const LOCKUP: (&str, &str) = ("vehicle.pressurant.regulator.lockup_pa", "0.4e5");
const TWO_PHASE: (&str, &str) = ("vehicle.engine.depletion.model", "\"two_phase\"");
const SET: (&str, &str) = ("vehicle.pressurant.regulator.set_pressure_pa", "60e5");

/// End of a hop, and the run tank's least and greatest pressure while thrust is made (Pa).
fn hop(overrides: &[(&str, &str)]) -> (Snapshot, [f64; 2]) {
    let (mut last, mut tank_pa) = (None, [f64::INFINITY, 0.0f64]);
    let report = simulation::fly(&scenario("hop_50m", overrides), 1, |s| {
        if s.thrust_n > 0.0 {
            tank_pa = [tank_pa[0].min(s.tank_pa), tank_pa[1].max(s.tank_pa)];
        }
        last = Some(*s);
    })
    .unwrap()
    .report(false);
    assert_eq!(report.outcome, Outcome::Landed, "{overrides:?}");
    let (open, all) = (report.mass.closure_error_kg.abs(), report.mass.initial_kg);
    assert!(open / all < 1e-9, "{overrides:?}: {open} kg of {all} kg unaccounted");
    let s = last.unwrap();
    println!(
        "{overrides:?}\n  bottle {:.1} bar {:.1} K, tank {:.2} bar ({:.2} to {:.2} under thrust) {:.1} K, liquid {:.2} K, \
         liquid {:.3} kg, vapour {:.3} kg, nitrogen in tank {:.3} kg",
        s.bottle_pa * 1e-5,
        s.gas_k[0],
        s.tank_pa * 1e-5,
        tank_pa[0] * 1e-5,
        tank_pa[1] * 1e-5,
        s.gas_k[1],
        s.liquid_k,
        s.nitrous_kg,
        s.nitrous_vapor_kg,
        s.nitrogen_ullage_kg
    );
    (s, tank_pa)
}

/// Every gram that the vehicle lost stands under one key of the report: nitrogen that followed the liquid through the
/// engine, vapour that is still on board and so is not used.
#[test]
fn the_report_says_where_the_mass_went() {
    let stand = ("duration_s", "8.0");
    let vapor = ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1");
    let vented = ("vehicle.feed.tank.ullage.vapor_saturation", "0.5");
    for (name, overrides) in [
        ("static_fire_100", vec![stand]),
        ("static_fire_100", vec![stand, ULLAGE, vapor, SATURATED]),
        ("hover_5m", vec![ULLAGE, vapor, vented]),
        ("hover_5m", vec![TWO_PHASE]),
        ("hover_5m", vec![]),
    ] {
        let (mut first, mut last, mut gas_alone) = (None, None, 0.0);
        let report = simulation::fly(&scenario(name, &overrides), 1, |s| {
            first.get_or_insert(*s);
            last = Some(*s);
            if s.nitrous_kg < 1e-4 && s.oxidizer_kg_s > 0.01 {
                gas_alone = s.quality;
            }
        })
        .unwrap()
        .report(false);
        let (p, m) = (report.propellant, report.mass);
        println!("{name} {overrides:?}: {p:?}, {m:?}");
        let gone = p.nitrous_used_kg
            + p.fuel_used_kg
            + p.nitrogen_rcs_kg
            + p.nitrogen_vented_kg
            + p.nitrogen_nozzle_kg;
        // Mass closure, and the rounding of a few sums.
        assert!((m.initial_kg - m.final_kg - gone).abs() < 1e-9 * m.initial_kg, "{name}: {gone} {m:?}");
        let (first, last) = (first.unwrap(), last.unwrap());
        assert_eq!(p.nitrous_vapor_kg, last.nitrous_vapor_kg);
        let on_board_kg = first.nitrous_kg + first.nitrous_vapor_kg;
        let accounted = p.nitrous_used_kg + p.nitrous_left_kg + p.nitrous_vapor_kg;
        assert!((on_board_kg - accounted).abs() < 1e-12 * on_board_kg);
        let stand = name == "static_fire_100";
        assert_eq!(p.nitrogen_nozzle_kg > 0.1, stand, "{name}: {p:?}");
        // Once gas alone flows, all of it is gas.
        assert!(!stand || gas_alone > 0.999, "{gas_alone}");
    }
}

#[test]
fn the_hop_lands_with_each_model_and_with_all() {
    let (reference, _) = hop(&[]);
    // The same physics as states: constant temperature, no droop.
    let (states, held) = hop(&[TWO_PHASE]);
    assert!((states.bottle_pa - reference.bottle_pa).abs() < 1e3, "{}", states.bottle_pa);
    // The regulator's law is exact up to the tables and its own step.
    assert!((held[0] - 65e5).abs() < 1e3 && (held[1] - 65e5).abs() < 1e3, "{held:?}");

    let (cold, _) = hop(&[BOTTLE]);
    assert!(cold.bottle_pa < 0.75 * reference.bottle_pa && cold.gas_k[0] < 235.0);
    let (cooled, held) = hop(&[ULLAGE]);
    assert!(cooled.nitrogen_ullage_kg > reference.nitrogen_ullage_kg && held[0] > 64.5e5 && held[1] < 65.5e5);
    // Vapour stands in for nitrogen.
    let (vapor, held) = hop(&[ULLAGE, VAPOR, SATURATED]);
    assert!(vapor.nitrogen_ullage_kg < 0.8 * reference.nitrogen_ullage_kg && vapor.nitrous_vapor_kg > 0.5);
    assert!(held[0] > 64.5e5 && held[1] < 65.5e5, "{held:?}");
    // 1 bar of droop at the greatest flow, 0.03 kg/s.
    let (_, held) = hop(&[DROOP]);
    assert!(held[0] < 64.3e5 && held[0] > 63.3e5 && held[1] < 65.01e5, "{held:?}");
    let (locked, _) = hop(&[LOCKUP]);
    // The last of it comes slowly: seconds.
    assert!(locked.tank_pa > 65.1e5 && locked.tank_pa < 65.41e5, "{}", locked.tank_pa);
    let (other, _) = hop(&[SET]);
    assert!((other.tank_pa - 60e5).abs() < 1e3, "{}", other.tank_pa);

    hop(&[BOTTLE, ULLAGE, VAPOR, SATURATED, DROOP, LOCKUP, TWO_PHASE]);
}

/// Thrust over time of a clamped burn until after the liquid is gone.
fn burn_out(overrides: &[(&str, &str)], seconds: f64) -> Vec<Snapshot> {
    let common = [("initial.clamped", "true"), ("initial.nitrous_kg", "1.2"), ULLAGE, SATURATED, VAPOR];
    let all: Vec<_> = common.into_iter().chain(overrides.iter().copied()).collect();
    let mut flight = Flight::new(&scenario("hover_5m", &all), 1).unwrap();
    let command = ActuatorCommand {
        armed: true,
        throttle: Throttle::ValveRad(f64::to_radians(25.0)),
        discrete: Discrete::SAFE,
        ..ActuatorCommand::SAFE
    };
    let steps = (seconds / flight.step_s()).round() as usize;
    let all: Vec<Snapshot> = (0..steps)
        .map(|_| {
            flight.step(&command);
            *flight.snapshot()
        })
        .collect();
    for pair in all.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        let numbers =
            [b.thrust_n, b.tank_pa, b.nitrous_kg, b.nitrous_vapor_kg, b.nitrogen_ullage_kg, b.bottle_pa];
        assert!(numbers.iter().all(|x| x.is_finite() && *x >= 0.0), "{b:?}");
        assert!(
            b.nitrogen_bottle_kg + b.nitrogen_ullage_kg
                <= a.nitrogen_bottle_kg + a.nitrogen_ullage_kg + 1e-12
        );
        let (before, after) = (a.mass_kg + a.expelled_kg[0], b.mass_kg + b.expelled_kg[0]);
        assert!((after + b.expelled_kg[2] - before - a.expelled_kg[2]).abs() < 1e-9);
    }
    all
}

#[test]
fn an_uncovered_outlet_gives_a_spike_and_a_tail() {
    let run = burn_out(&[TWO_PHASE, ("vehicle.feed.tank.unusable_nitrous_kg", "0.05")], 14.0);
    let plateau_n = run.iter().rfind(|s| s.nitrous_kg > 0.3).unwrap().thrust_n;
    let peak_n = run.iter().filter(|s| s.nitrous_kg < 0.1).map(|s| s.thrust_n).fold(0.0, f64::max);
    let spike = peak_n / plateau_n;
    let end = run.last().unwrap();
    let start_kg = run[0].nitrogen_bottle_kg + run[0].nitrogen_ullage_kg;
    let nitrogen_gone_kg = start_kg - end.nitrogen_bottle_kg - end.nitrogen_ullage_kg;
    println!(
        "plateau {plateau_n:.0} N, spike {spike:.3}, end {:.0} N, nitrogen {nitrogen_gone_kg:.3} kg",
        end.thrust_n
    );
    assert!(spike > 1.05 && spike < 1.6, "{spike}");
    assert!(end.nitrous_kg < 1e-6 && end.thrust_n > 0.0 && end.thrust_n < 0.5 * plateau_n);
    // After depletion nitrogen leaves by the nozzle too.
    assert!(nitrogen_gone_kg > 0.05);
    // No jump: the thrust moves by less than a tenth of the plateau in a millisecond.
    let lit: Vec<f64> = run.iter().filter(|s| s.lit && s.nitrous_kg < 0.3).map(|s| s.thrust_n).collect();
    let jump = lit.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    assert!(jump < 0.1 * plateau_n, "{jump} N");
}

/// Without nitrogen the liquid boils: the tank follows the vapour pressure of a liquid that cools.
#[test]
fn without_nitrogen_the_tank_follows_its_vapour_pressure() {
    let run = burn_out(&[("initial.nitrous_kg", "12.0"), ("initial.nitrogen_kg", "0.02")], 12.0);
    let vapor = hopbench::fluid::NitrousVapor::tables();
    let (mut worst, mut coldest) = (0.0f64, 400.0f64);
    for s in run.iter().filter(|s| s.time.s() > 4.0) {
        let boiling_pa = vapor.interface(s.liquid_k).vapor_pressure_pa;
        worst = worst.max((s.tank_pa / boiling_pa - 1.0).abs());
        coldest = coldest.min(s.liquid_k);
    }
    println!("within {worst:.1e} of the vapour pressure, liquid down to {coldest:.2} K");
    // Nitrogen's share of the pressure, 0.02 kg in 5 litres, is 3 bar at the most.
    assert!(worst < 0.1 && coldest < 289.0, "{worst} {coldest}");
}

/// A valve that is open without power opens when power goes, not before it has ever been there.
#[test]
fn valves_without_power_stand_where_the_file_says() {
    let run = |overrides: &[(&str, &str)]| {
        let mut flight = Flight::new(&scenario("hover_5m", overrides), 1).unwrap();
        let armed = ActuatorCommand { armed: true, ..ActuatorCommand::SAFE };
        for (command, steps) in [(&ActuatorCommand::SAFE, 500), (&armed, 500), (&ActuatorCommand::SAFE, 2000)]
        {
            for _ in 0..steps {
                flight.step(command);
            }
        }
        flight.snapshot().expelled_kg[2]
    };
    assert!(run(&[]) > 0.01, "a vent that is open without power lets the gas out after disarming");
    assert_eq!(run(&[("vehicle.feed.vent.open_without_power", "false")]), 0.0);
}
