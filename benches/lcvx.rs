//! Optimal guidance: one program of 20, 50 and 100 nodes, and a whole plan with its flight time.
//!
//!     cargo bench -p hopbench --bench lcvx
//!     cargo bench -p hopbench --bench lcvx -- --serve
//!
//! Served, it writes its programs as one JSON object a line, ends them with an empty line, and answers each
//! line of input, the number of a program, by the times in microseconds of set-up with solve and of solve
//! alone, and the iterations: `tools/compare/lcvx_solvers.py` asks it in turn with other solvers.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a benchmark reads the clock and prints

#[path = "../tests/fixture/lcvx.rs"]
#[allow(dead_code, unreachable_pub)] // the tests use the rest
mod lcvx;

use std::hint::black_box;
use std::io::BufRead;
use std::time::Instant;

use hopbench::autopilot::lcvx::conic::{Program, Solver};
use hopbench::autopilot::lcvx::{Objective, PlanRequest, Problem, Settings, plan, program};
use hopbench::time::SimTime;

const NODES: [usize; 3] = [20, 50, 100];
const ROUNDS: usize = 101;

/// The three flights, and the time of each (s): about 1.2 times the least.
fn flights() -> [(&'static str, Problem, f64); 3] {
    [
        ("descent", lcvx::descent(50.0), 11.8),
        ("divert", lcvx::divert(), 10.9),
        ("ascent", lcvx::ascent(), 12.6),
    ]
}

fn programs() -> Vec<(&'static str, usize, Program)> {
    let of_flight = |(name, problem, flight_time_s)| {
        NODES.map(|nodes| {
            (name, nodes, program(&Problem { nodes, ..problem }, Objective::Fuel, flight_time_s))
        })
    };
    flights().into_iter().flat_map(of_flight).collect()
}

/// Times of set-up with solve and of solve alone (us), and iterations.
fn times_us(program: &Program) -> (f64, f64, u32) {
    let mut solver = Solver::new(Settings::PROOF.accuracy());
    let start = Instant::now();
    black_box(solver.solve(program));
    let whole_us = start.elapsed().as_secs_f64() * 1e6;
    let start = Instant::now();
    let iterations = black_box(solver.solve(program)).iterations;
    (whole_us, start.elapsed().as_secs_f64() * 1e6, iterations)
}

/// Median and 99th hundredth.
fn spread(mut times_us: Vec<f64>) -> (f64, f64) {
    times_us.sort_by(f64::total_cmp);
    (times_us[times_us.len() / 2], times_us[times_us.len() * 99 / 100])
}

fn measure() {
    for (name, nodes, program) in programs() {
        let rounds: Vec<_> = (0..ROUNDS).map(|_| times_us(&program)).collect();
        let (whole, whole_99) = spread(rounds.iter().map(|r| r.0).collect());
        let (solve, solve_99) = spread(rounds.iter().map(|r| r.1).collect());
        println!(
            "{name}, {nodes} nodes: solve p50 {solve:.0} us, p99 {solve_99:.0} us; with set-up p50 {whole:.0} us, \
             p99 {whole_99:.0} us; {} iterations",
            rounds[0].2
        );
    }
    for (name, problem, _) in flights() {
        let request = PlanRequest { problem, start: SimTime::ZERO, heading_rad: 0.0, previous: None };
        let time_us = |_| {
            let start = Instant::now();
            black_box(plan(&request, &Settings::FLIGHT));
            start.elapsed().as_secs_f64() * 1e6
        };
        let (p50, p99) = spread((0..ROUNDS).map(time_us).collect());
        let effort = plan(&request, &Settings::FLIGHT).effort;
        println!("{name}, plan with flight time: p50 {p50:.0} us, p99 {p99:.0} us; {effort:?}");
    }
}

fn serve() {
    let programs = programs();
    for (name, nodes, p) in &programs {
        // Rust prints finite numbers and lists of them as JSON has them.
        println!(
            "{{\"name\":\"{name}\",\"nodes\":{nodes},\"cost\":{:?},\"column_starts\":{:?},\"rows\":{:?},\"values\":{:?},\
             \"right\":{:?},\"equalities\":{},\"inequalities\":{},\"cones\":{:?}}}",
            p.cost, p.column_starts, p.rows, p.values, p.right, p.equalities, p.inequalities, p.cones
        );
    }
    println!();
    for line in std::io::stdin().lock().lines() {
        let line = line.expect("the other end writes text");
        let (whole_us, solve_us, iterations) =
            times_us(&programs[line.trim().parse::<usize>().expect("a number")].2);
        println!("{whole_us} {solve_us} {iterations}");
    }
}

fn main() {
    if std::env::args().any(|argument| argument == "--serve") { serve() } else { measure() }
}
