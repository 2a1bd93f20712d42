//! A small Monte Carlo in memory: the hop of 50 m under the built-in autopilot, with thrust bias and wind
//! drawn anew.
//!
//! ```text
//! cargo run --release -p hopbench --example monte_carlo
//! ```
//! The autopilot is told of the vehicle as it is written down; the plant flies what was drawn. Sensor noise
//! follows from the seed too, and the same seed gives the same bits on every machine. For hundreds of flights
//! with statistics that are proven, bounds and pictures: `hopbench campaign`.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a program that reads files and prints

use std::error::Error;

use hopbench::disturbance::Disturbance;
use hopbench::input::Invalid;
use hopbench::noise;
use hopbench::scenario::Scenario;
use hopbench::simulation::report::Touchdown;
use hopbench::simulation::{Flight, Report, data_sheet, fly_out};

/// What one flight meets, drawn from streams of its seed that have names: another draw moves none of these.
fn dispersed(nominal: &Scenario, seed: u32) -> Scenario {
    let mut actual = nominal.clone();
    let bias = 0.02 * noise::stream(seed.into(), "thrust_bias").normal();
    actual.file.disturbance.push(Disturbance { thrust_bias: bias, ..Disturbance::default() });
    let mut wind = noise::stream(seed.into(), "wind");
    actual.file.wind.mean_speed_m_s = 5.0 * wind.uniform();
    actual.file.wind.from_deg = 360.0 * wind.uniform();
    actual
}

/// Reports of so many flights, in the order of their seeds, from 1; as many at once as there are cores.
pub fn flights(count: u32) -> Result<Vec<Report>, Box<dyn Error>> {
    let nominal = Scenario::load("scenarios/hop_50m.toml", |file| std::fs::read_to_string(file))?;
    let told = data_sheet::nominal(&nominal)?;
    let fly = |seed: u32| -> Result<Report, Invalid> {
        let mut flight = Flight::dispersed(&dispersed(&nominal, seed), seed, &told)?;
        fly_out(&mut flight, |_| {});
        Ok(flight.report())
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut reports = std::thread::scope(|threads| {
        let fly = &fly;
        let share = move |first: u32| (first..=count).step_by(cores).map(fly).collect::<Result<Vec<_>, _>>();
        let workers: Vec<_> = (1..=cores as u32).map(|first| threads.spawn(move || share(first))).collect();
        let shares = workers.into_iter().map(|worker| worker.join().expect("a flight does not panic"));
        shares.collect::<Result<Vec<_>, _>>()
    })?
    .concat();
    reports.sort_by_key(|report| report.seed);
    Ok(reports)
}

fn main() -> Result<(), Box<dyn Error>> {
    let reports = flights(32)?;
    let passed = reports.iter().filter(|report| report.expect.passed).count();
    println!("{passed} of {} flights as the scenario expects", reports.len());
    let touchdowns: Vec<_> = reports.iter().filter_map(|report| report.touchdown).collect();
    let table = |name: &str, figure: fn(&Touchdown) -> f64| {
        let mut sorted: Vec<f64> = touchdowns.iter().map(figure).collect();
        sorted.sort_by(f64::total_cmp);
        if let (Some(median), Some(worst)) = (sorted.get(sorted.len() / 2), sorted.last()) {
            println!("{name:22} median {median:5.2}, worst {worst:5.2}");
        }
    };
    table("speed down, m/s", |t| t.vertical_speed_m_s);
    table("speed across, m/s", |t| t.lateral_speed_m_s);
    table("tilt, deg", |t| t.tilt_deg);
    table("off the target, m", |t| t.position_error_m);
    Ok(())
}
