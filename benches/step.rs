//! One full step of the plant: four stages of the integrator and the events between steps.
//!
//!     cargo bench -p hopbench --bench step
//!
//! Rounds of 8 s of the open-loop reference run a; the yardstick is 3.3 us a step.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a benchmark reads the clock and prints

#[path = "../tests/files/mod.rs"]
mod files;

use hopbench::plant::Plant;
use std::time::Instant;

const STEPS: u32 = 8_000;
const ROUNDS: usize = 9;

fn main() {
    let scenario = files::scenario("open_loop_a", &[]);
    let schedule = scenario.schedule.as_ref().expect("the run names its schedule");
    let mut rounds_us: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let mut plant = Plant::new(&scenario).expect("the run is sound");
            let start = Instant::now();
            for _ in 0..STEPS {
                plant.step(schedule.at(plant.time()));
            }
            start.elapsed().as_secs_f64() * 1e6 / f64::from(STEPS)
        })
        .collect();
    rounds_us.sort_by(f64::total_cmp);
    println!(
        "plant step: least {:.2} us, median {:.2} us, greatest {:.2} us over {ROUNDS} rounds of {STEPS} steps",
        rounds_us[0],
        rounds_us[ROUNDS / 2],
        rounds_us[ROUNDS - 1]
    );
}
