//! Invariant: a step of the plant asks the allocator for nothing, whatever it passes through, and neither
//! does an update of the autopilot between its plans.
//!
//! Every allocation of this thread is counted (crate `allocation-counter`). Steps at which an event is noted
//! are left out: an event carries text.

use crate::fixture::files;
use allocation_counter::measure;
use hopbench::autopilot::tracking::Rung;
use hopbench::plant::Plant;
use hopbench::signal::{ActuatorCommand, Discrete, Throttle};
use hopbench::simulation::Flight;

/// Steps the plant; allocations, or `None` when an event was noted.
fn allocations(plant: &mut Plant, command: &ActuatorCommand) -> Option<u64> {
    let counted = measure(|| plant.step(command)).count_total;
    let quiet = plant.take_events().count() == 0;
    quiet.then_some(counted)
}

#[test]
fn the_counter_counts() {
    assert_eq!(measure(|| drop(std::hint::black_box(vec![0u8; 100]))).count_total, 1);
}

#[test]
fn no_step_of_a_hop_allocates() {
    let mut plant = Plant::new(&files::scenario("hop_50m", &[])).unwrap();
    let (mut counted, mut throttled, mut swung, mut standing, mut flying) = (0, 0, 0, 0, 0);
    for command in files::commands_of_the_hop() {
        let before = *plant.snapshot();
        let Some(allocations) = allocations(&mut plant, &command) else { continue };
        let now = plant.snapshot();
        assert_eq!(allocations, 0, "at {} s", now.time.s());
        counted += 1;
        throttled += usize::from(now.lit && now.valve_rad != before.valve_rad);
        swung += usize::from(now.gimbal_rad != before.gimbal_rad);
        standing += usize::from(now.pads_down > 0);
        flying += usize::from(now.pads_down == 0);
    }
    // The stretch holds what it is meant to hold: more than a second of each.
    let least = [counted, throttled, swung, standing, flying].into_iter().min().unwrap();
    assert!(least > 1_000, "{counted} {throttled} {swung} {standing} {flying}");
}

#[test]
fn no_step_of_thruster_pulses_blow_down_and_depletion_allocates() {
    let overrides =
        [("initial.nitrous_kg", "3.0"), ("initial.nitrogen_kg", "1.5"), ("initial.clamped", "true")];
    let mut plant = Plant::new(&files::scenario("hover_5m", &overrides)).unwrap();
    let start_pa = plant.snapshot().tank_pa;
    let (mut empty, mut pulsed) = (0, 0);
    for step in 0..25_000 {
        let throttle = Throttle::ThrustN(if step < 1_500 { 0.0 } else { 600.0 });
        let command = ActuatorCommand {
            armed: true,
            throttle,
            rcs_roll: 0.3,
            discrete: Discrete::FLIGHT,
            ..ActuatorCommand::SAFE
        };
        let Some(allocations) = allocations(&mut plant, &command) else { continue };
        assert_eq!(allocations, 0, "at {} s", plant.time().s());
        empty += usize::from(plant.snapshot().nitrous_kg < 0.05);
        pulsed += usize::from(plant.snapshot().rcs_roll > 0.0);
    }
    // The tank blew down by far more than what rebuilds the feed's tables, and ran dry.
    let fallen_pa = start_pa - plant.snapshot().tank_pa;
    assert!(fallen_pa > 5e5 && empty > 100 && pulsed > 1_000, "{fallen_pa} {empty} {pulsed}");
}

/// Filter, sequence, predictive control with its solver: everything but making and taking in plans, which is
/// once a second.
#[test]
fn no_update_of_the_autopilot_between_plans_allocates() {
    let mut flight = Flight::new(&files::scenario("hop_50m", &[]), 1).unwrap();
    let mut command = ActuatorCommand::SAFE;
    let (mut counted, mut left_out) = (0, 0);
    while flight.outcome().is_none() {
        flight.step(&command);
        let Some(measurement) = flight.measurement().cloned() else { continue };
        let autopilot = flight.autopilot();
        let phase = autopilot.phase();
        let allocations = measure(|| command = autopilot.update(&measurement)).count_total;
        let order = autopilot.take_order();
        if order.is_some() || autopilot.phase() != phase {
            left_out += 1;
        } else if phase.is_flight() {
            assert_eq!(allocations, 0, "{phase:?} at {} s", measurement.time.s());
            counted += 1;
        }
        if let Some(order) = order {
            autopilot.deliver(order.solve());
        }
    }
    // Half a minute of flight at 250 Hz, every fifth update with a solve; some plans and changes of phase.
    let solves = flight.autopilot().tracker().counts()[Rung::Solved as usize];
    assert!(counted > 7_500 && solves > 1_500 && left_out < 40, "{counted} {solves} {left_out}");
}
