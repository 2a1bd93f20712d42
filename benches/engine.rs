//! Time of one evaluation of the engine: `cargo bench --bench engine`.

#![allow(clippy::disallowed_macros, clippy::disallowed_methods)] // A benchmark reads the clock and prints.

use std::hint::black_box;
use std::time::Instant;

use hopbench::propulsion::{
    Engine, EngineCondition, EngineParameters, EngineTexts, FeedMap, FeedParameters, PaperMode, WarmStart,
};

#[derive(serde::Deserialize)]
struct Vehicle {
    engine: EngineParameters,
    feed: FeedParameters,
    paper_mode: PaperMode,
}

fn engine() -> Engine {
    let vehicle: Vehicle = toml::from_str(include_str!("../scenarios/vehicles/reference.toml")).unwrap();
    let texts = EngineTexts {
        map: include_str!("../scenarios/vehicles/cea_reference_fit.csv"),
        valve_area: include_str!("../scenarios/vehicles/valve_area_vs_angle.csv"),
    };
    Engine::new(&vehicle.engine, &vehicle.feed, &vehicle.paper_mode, texts).unwrap()
}

/// Least time of many short batches, so that other work on the machine does not count.
fn ns_per_call(batches: u32, mut call: impl FnMut(u32)) -> f64 {
    const CALLS: u32 = 500;
    (0..batches)
        .map(|_| {
            let start = Instant::now();
            (0..CALLS).for_each(&mut call);
            start.elapsed().as_secs_f64() * 1e9 / f64::from(CALLS)
        })
        .fold(f64::MAX, f64::min)
}

fn main() {
    let engine = engine();
    let mut feed = FeedMap::new(65e5, 290.0);
    let condition = EngineCondition::burning(0.035, 0.010, 101_325.0);
    for degrees in [8.0f64, 15.0, 21.0, 25.0, 28.9] {
        let area = engine.valve_area().area_m2(degrees.to_radians());
        let mut guess = engine.operating_point(&feed, area, &condition, WarmStart::default()).warm_start;
        let warm = ns_per_call(400, |i| {
            // The valve moves by 0.01 % between calls, as within a step of a brisk throttle.
            let area = area * (1.0 + 1e-4 * f64::from(i % 3));
            guess = engine.operating_point(&feed, black_box(area), &condition, guess).warm_start;
        });
        let still = ns_per_call(400, |_| {
            guess = engine.operating_point(&feed, black_box(area), &condition, guess).warm_start;
        });
        let cold = ns_per_call(200, |_| {
            black_box(engine.operating_point(&feed, black_box(area), &condition, WarmStart::default()));
        });
        println!(
            "operating_point at {degrees:4.1} deg: moving {warm:6.0} ns, still {still:6.0} ns, cold {cold:6.0} ns"
        );
    }
    let mut guess = WarmStart::default();
    let inverse = ns_per_call(200, |i| {
        let inverse = engine.inverse(&feed, black_box(600.0 + 0.1 * f64::from(i % 7)), &condition, guess);
        guess = inverse.point.warm_start;
    });
    println!("inverse: {inverse:6.0} ns");
    let mut k = 0;
    let rebuild = ns_per_call(2, |_| {
        k += 1;
        feed.rebuild(65e5 - 10.0 * f64::from(k), 290.0);
    });
    println!("FeedMap::rebuild: {:.0} us", rebuild * 1e-3);
    let boiling = ns_per_call(2, |_| {
        k += 1;
        feed.rebuild(40e5 - 10.0 * f64::from(k), 290.0);
    });
    println!("FeedMap::rebuild, boiling tank: {:.0} us", boiling * 1e-3);
}
