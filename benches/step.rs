//! One full step of the plant: four stages of the integrator and the events between steps.
//!
//!     cargo bench -p hopbench --bench step
//!
//! Rounds of 8 s of the open-loop reference run a and of the whole hop; the yardstick is 3.3 us a step.
//! Beside them, in the same run, one evaluation and the integrator alone, and the navigation filter.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a benchmark reads the clock and prints

#[path = "../tests/fixture/files.rs"]
#[allow(dead_code, unreachable_pub)] // the tests use the rest
mod files;

use std::hint::black_box;
use std::time::Instant;

use hopbench::autopilot::navigation::{GroundState, Navigation};
use hopbench::environment::Environment;
use hopbench::integrator::rk4_step;
use hopbench::plant::Plant;
use hopbench::signal::Measurement;
use hopbench::simulation::{Flight, Instrumentation, data_sheet};

const STEPS: u32 = 8_000;
const ROUNDS: usize = 9;

/// Least, median and greatest time of a step over some rounds (us); setting up is not counted.
fn report<S>(what: &str, steps: usize, set_up: impl Fn() -> S, round: impl Fn(S)) {
    let mut rounds_us: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let subject = set_up();
            let start = Instant::now();
            round(subject);
            start.elapsed().as_secs_f64() * 1e6 / steps as f64
        })
        .collect();
    rounds_us.sort_by(f64::total_cmp);
    println!(
        "{what}: least {:.2} us, median {:.2} us, greatest {:.2} us over {ROUNDS} rounds of {steps} steps",
        rounds_us[0],
        rounds_us[ROUNDS / 2],
        rounds_us[ROUNDS - 1]
    );
}

fn main() {
    let scenario = files::scenario("open_loop_a", &[]);
    let schedule = scenario.schedule.as_ref().expect("the run names its schedule");
    let at_start = || Plant::new(&scenario).expect("the run is sound");
    report("plant step, open loop a", STEPS as usize, at_start, |mut plant| {
        for _ in 0..STEPS {
            plant.step(schedule.at(plant.time()));
        }
    });
    // From outside and at step 0: everything that a snapshot shows, and a solver without the last step's
    // answer.
    report("one evaluation from a cold start", STEPS as usize, at_start, |plant| {
        for _ in 0..STEPS {
            black_box(plant.evaluate(black_box(plant.state()), 0.0));
        }
    });
    // What the same integrator takes for the same state without a plant: the machine's own speed.
    let rate = at_start().evaluate(at_start().state(), 0.0).rate;
    report("bare integrator", STEPS as usize, at_start, |plant| {
        let mut state = *plant.state();
        for _ in 0..STEPS {
            state = rk4_step(&state, 1e-3, |_, _| black_box(rate));
        }
        black_box(state);
    });
    let hop = files::scenario("hop_50m", &[]);
    let commands = files::commands_of_the_hop();
    let on_the_pad = || Plant::new(&hop).expect("the hop is sound");
    report("plant step, hop of 50 m", commands.len(), on_the_pad, |mut plant| {
        for command in &commands {
            plant.step(command);
        }
    });
    // The filter on what the sensors of that hop say: a prediction every 4 ms, updates as they come.
    let mut flight = Flight::new(&hop, 1).expect("the hop is sound");
    let measurements: Vec<Measurement> = commands
        .iter()
        .filter_map(|command| {
            flight.step(command);
            flight.measurement().cloned()
        })
        .collect();
    let environment = Environment::new(&hop.site, &hop.file.wind, 1).expect("the hop is sound");
    let told = data_sheet::parameters(&hop, &environment, &Instrumentation::default()).navigation;
    report(
        "navigation, prediction and updates",
        measurements.len(),
        || Navigation::new(told.clone()),
        |mut filter| {
            for measurement in &measurements {
                if filter.is_aligned() {
                    filter.step(black_box(measurement), GroundState::Unknown);
                } else {
                    filter.align(measurement, 3.0);
                }
            }
            black_box(filter);
        },
    );
}
