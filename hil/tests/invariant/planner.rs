//! Plans solved on a thread beside the flight: the same flight as with plans solved in place, and no plan for
//! a flight that is over.

use std::path::Path;
use std::time::Duration;

use hopbench::scenario::Scenario;
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::{Flight, Source, fly_out};
use hopbench_hil::bench::planner::Planner;
use hopbench_hil::load;

/// Far more than a plan takes on any machine; only a planner that has lost it waits so long.
const PATIENCE: Duration = Duration::from_secs(60);

fn short_hop() -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/hover_5m.toml");
    let set = ["mission.alignment_s=1.0", "mission.hover_time_s=1.0"].map(str::to_owned);
    load::scenario(&path, &set, None).unwrap()
}

/// A flight with its autopilot at the controls.
fn flight() -> Flight {
    let mut flight = Flight::new(&short_hop(), 3).unwrap();
    flight.set_source(Source::Autopilot);
    flight
}

/// Flies until the first plan has been ordered.
fn until_ordered(flight: &mut Flight) -> ActuatorCommand {
    let mut command = ActuatorCommand::SAFE;
    while flight.autopilot().planning().begins().is_none() {
        assert!(flight.outcome().is_none() && flight.time().s() < 30.0, "no order");
        flight.step(&command);
        command = flight.autopilot_command().unwrap_or(command);
    }
    command
}

/// Flies until the plan awaited is due, the answers left to the planner; gives plans adopted and late.
fn until_adopted(flight: &mut Flight, planner: &mut Planner, mut command: ActuatorCommand) -> (u64, u64) {
    while flight.autopilot().planning().begins().is_some() {
        flight.step(&command);
        let now = flight.time();
        planner.deliver_within(flight.autopilot(), now, PATIENCE);
        command = flight.autopilot_command().unwrap_or(command);
    }
    let planning = flight.autopilot().planning();
    (planning.counts().iter().sum(), planning.late())
}

#[test]
fn a_flight_beside_its_planner_is_the_flight_with_plans_in_place() {
    let mut in_place = flight();
    fly_out(&mut in_place, |_| {});

    let mut planner = Planner::start().unwrap();
    let mut beside = flight();
    let mut command = ActuatorCommand::SAFE;
    while beside.outcome().is_none() {
        beside.step(&command);
        if let Some(measurement) = beside.measurement() {
            let now = measurement.time;
            planner.deliver_within(beside.autopilot(), now, PATIENCE);
        }
        if let Some(next) = beside.autopilot_command() {
            command = next;
            planner.take(beside.autopilot());
        }
    }
    // One up, one down at least.
    let planning = beside.autopilot().planning();
    assert!(planning.late() == 0 && planning.counts()[0] >= 2, "{planning:?}");
    assert_eq!(beside.report().state_hash, in_place.report().state_hash);
}

#[test]
fn an_answer_of_a_flight_that_is_over_is_dropped() {
    let mut planner = Planner::start().unwrap();
    // The first flight's plan is adopted by the first flight.
    let mut first = flight();
    let command = until_ordered(&mut first);
    planner.take(first.autopilot());
    assert_eq!(until_adopted(&mut first, &mut planner, command), (1, 0));

    // The second flight ends before its answer comes; the third's order has the same number.
    let mut second = flight();
    until_ordered(&mut second);
    planner.take(second.autopilot());
    planner.forget();
    let mut third = flight();
    let command = until_ordered(&mut third);
    assert_eq!(until_adopted(&mut third, &mut planner, command), (0, 1));

    // With that out of the way the next is served again.
    let mut fourth = flight();
    let command = until_ordered(&mut fourth);
    planner.take(fourth.autopilot());
    assert_eq!(until_adopted(&mut fourth, &mut planner, command), (1, 0));
}

/// What is solved afterwards is wanted.
#[test]
fn forgetting_while_nothing_is_solved_costs_nothing() {
    let mut planner = Planner::start().unwrap();
    planner.forget();
    let mut only = flight();
    let command = until_ordered(&mut only);
    planner.take(only.autopilot());
    assert_eq!(until_adopted(&mut only, &mut planner, command), (1, 0));
}
