//! What holds over whole flights: pressure, fuel, nitrogen and mass of the hop, and how far a flight at 5 ms lies
//! from the converged one.

// The test prints its figures for the record.
#![allow(clippy::disallowed_macros)]

mod files;

use hopbench::plant::{Plant, Snapshot};
use hopbench::scenario::Scenario;
use hopbench::simulation::fly;
use hopbench::time::SimTime;

/// Every step of a scenario flown to its end.
fn watch(scenario: &Scenario, mut look: impl FnMut(&Snapshot, &Snapshot)) {
    let mut before: Option<Snapshot> = None;
    fly(scenario, 1, |now| {
        if let Some(before) = &before {
            look(before, now);
        }
        before = Some(*now);
    })
    .unwrap();
}

const BOTTLE: (&str, &str) = ("vehicle.pressurant.bottle.model", "\"energy_balance\"");
const ULLAGE: (&str, &str) = ("vehicle.feed.tank.ullage.model", "\"energy_balance\"");
const VAPOR: (&str, &str) = ("vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa", "1e-8");
const SATURATED: (&str, &str) = ("vehicle.feed.tank.ullage.vapor_saturation", "1.0");

/// The default model sets the tank's pressure; where it is a state, stratified or with vapour, the regulator must.
#[test]
fn regulated_tank_burning_fuel_nitrogen_and_mass_over_the_hop() {
    let variants: [&[(&str, &str)]; 3] = [&[], &[BOTTLE, ULLAGE], &[BOTTLE, ULLAGE, VAPOR, SATURATED]];
    let ranges = variants.map(regulated_hop);
    assert_eq!(ranges[0], [65e5, 65e5], "set, not computed");
    for [low, high] in &ranges[1..] {
        assert!(low < high && *low > 64.5e5 && *high < 65.5e5, "{low} {high}");
    }
}

/// Least and greatest pressure of the run tank while the regulator feeds it (Pa). After landing nothing is drawn, and gas
/// that the liquid warms passes the set pressure: to 65.3 bar stratified, 65.9 bar with vapour.
fn regulated_hop(overrides: &[(&str, &str)]) -> [f64; 2] {
    let scenario = files::scenario("hop_50m", overrides);
    let (mut low, mut high, mut regulated) = (f64::MAX, f64::MIN, 0u32);
    let (mut burning, mut slowest_kg) = (0u32, f64::MAX);
    let (mut open, mut leak, mut start) = (0.0f64, 0.0f64, None);
    watch(&scenario, |before, now| {
        if now.bottle_pa >= 80e5 && now.oxidizer_kg_s > 0.0 {
            low = low.min(now.tank_pa);
            high = high.max(now.tank_pa);
            regulated += 1;
        }
        // Burning throughout the step.
        if before.fuel_kg_s > 1e-6 && now.fuel_kg_s > 1e-6 {
            assert!(now.fuel_kg < before.fuel_kg, "fuel {} at {}", now.fuel_kg, now.time.s());
            slowest_kg = slowest_kg.min(before.fuel_kg - now.fuel_kg);
            burning += 1;
        }
        // Vapour may condense, but the two together only leave.
        let nitrous = |s: &Snapshot| s.nitrous_kg + s.nitrous_vapor_kg;
        assert!(now.fuel_kg <= before.fuel_kg && nitrous(now) <= nitrous(before) + 1e-14);
        let nitrogen = |s: &Snapshot| s.nitrogen_bottle_kg + s.nitrogen_ullage_kg;
        let gone = |k: usize| now.expelled_kg[k] - before.expelled_kg[k];
        let lost = nitrogen(before) - nitrogen(now) - gone(1);
        // Vapour leaves by the vent with it, by its share.
        let share = |s: &Snapshot| s.nitrogen_ullage_kg / (s.nitrogen_ullage_kg + s.nitrous_vapor_kg);
        let (least, most) = (share(before).min(share(now)), share(before).max(share(now)));
        leak = leak.max(lost - most * gone(2)).max(least * gone(2) - lost);
        assert!(now.expelled_kg.iter().zip(before.expelled_kg).all(|(now, before)| *now >= before));
        let all = |s: &Snapshot| s.mass_kg + s.chamber_gas_kg + s.expelled_kg.iter().sum::<f64>();
        let start = *start.get_or_insert_with(|| all(before));
        open = open.max((all(now) / start - 1.0).abs());
    });
    println!("{overrides:?}\nrun tank {low:.1} to {high:.1} Pa in {regulated} steps");
    println!("fuel falls in {burning} burning steps, by {slowest_kg:.1e} kg or more");
    println!("nitrogen unaccounted {leak:.1e} kg in a step; mass closure {open:.1e}");
    assert!(regulated > 30_000 && burning > 20_000, "a whole flight");
    // Round-off of 3 kg, some of it through the gas table's inversion, and of 73 kg over 1e5 steps.
    assert!(leak < 1e-14 && open < 1e-12, "{leak:e} {open:e}");
    [low, high]
}

/// States of an open-loop run at its rows and at the end.
fn stepped(scenario: &Scenario, step_us: u64, every_us: u64) -> Vec<Snapshot> {
    let mut plant = Plant::with_step(scenario, SimTime::from_us(step_us)).unwrap();
    let end = SimTime::from_s(scenario.file.duration_s.unwrap());
    let schedule = scenario.schedule.as_ref().unwrap();
    let mut states = Vec::new();
    while plant.time() < end {
        plant.step(schedule.at(plant.time()));
        if plant.time().us().is_multiple_of(every_us) {
            states.push(*plant.snapshot());
        }
    }
    states
}

/// Greatest difference of position (m) and attitude (rad).
fn apart(a: &[Snapshot], b: &[Snapshot]) -> (f64, f64) {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold((0.0, 0.0), |(position, angle): (f64, f64), (a, b)| {
        let turned = (a.q_ned_from_body.coords - b.q_ned_from_body.coords).norm();
        let turned = turned.min((a.q_ned_from_body.coords + b.q_ned_from_body.coords).norm());
        (position.max((a.position_ned_m - b.position_ned_m).norm()), angle.max(2.0 * turned))
    })
}

#[test]
fn scripted_motion_at_five_milliseconds_is_converged() {
    let scenario = files::scenario("open_loop_a", &[]);
    let converged = stepped(&scenario, 250, 50_000);
    for step_us in [10_000, 5_000, 2_500, 1_000] {
        let (position, angle) = apart(&stepped(&scenario, step_us, 50_000), &converged);
        println!("{step_us} us: {position:.1e} m, {angle:.1e} rad");
        if step_us == 5_000 {
            assert!(position < 1e-6 && angle < 1e-6, "{position:e} m, {angle:e} rad");
        }
    }
}

/// The seed paper calls its motion monotonic. Liquid and fuel leave from above and below the dry centre in turn.
#[test]
fn the_centre_of_mass_falls_and_rises_again() {
    let scenario = files::scenario("hop_50m", &[]);
    let (mut first, mut last, mut least) = (None, 0.0, (f64::MAX, 0.0));
    watch(&scenario, |_, now| {
        let z = now.com_structural_m.z;
        first.get_or_insert(z);
        last = z;
        if z < least.0 {
            least = (z, now.time.s());
        }
    });
    let first = first.unwrap();
    println!(
        "centre of mass {first:.4} m at first, {:.4} m at {:.1} s, {last:.4} m at the end",
        least.0, least.1
    );
    assert!(least.0 < first - 5e-3 && least.0 < last - 1e-3, "{first} {least:?} {last}");
}
