//! A solve of predictive control, ours beside Clarabel's, over the three hundred programs of two gusts.
//!
//!     cargo bench -p hopbench --bench mpc
//!     cargo bench -p hopbench --bench mpc -- --serve 20     answers to tools/compare/mpc_solvers.py
//!
//! Least of five repetitions of each program, ours and Clarabel's in turn. Clarabel's time holds building the
//! sparse matrices and its set-up, as a fallback in flight would.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a benchmark reads the clock and prints

#[path = "../tests/fixture/gusts.rs"]
#[allow(dead_code, unreachable_pub)] // the tests use the rest
mod gusts;

use std::hint::black_box;
use std::io::{BufRead, Write};
use std::time::Instant;

use hopbench::autopilot::mpc::{Problem, Settings, Solution, Workspace, interior_point, oracle};
use serde_json::json;

const REPETITIONS: usize = 5;

struct Bench {
    workspace: Workspace,
    solution: Solution,
}

/// Time a call takes (us).
fn time_us(call: impl FnOnce()) -> f64 {
    let start = Instant::now();
    call();
    start.elapsed().as_secs_f64() * 1e6
}

impl Bench {
    fn ours_us(&mut self, problem: &Problem) -> f64 {
        let settings = Settings::default();
        time_us(|| {
            interior_point::solve(black_box(problem), &settings, &mut self.workspace, &mut self.solution);
        })
    }
}

fn clarabel_us(problem: &Problem) -> f64 {
    time_us(|| {
        black_box(oracle::solve(black_box(problem), 1e-6));
    })
}

fn report(what: &str, mut times_us: Vec<f64>) {
    times_us.sort_by(f64::total_cmp);
    let at = |share: f64| times_us[((times_us.len() - 1) as f64 * share) as usize];
    println!("{what}: p50 {:.0} us, p99 {:.0} us, greatest {:.0} us", at(0.5), at(0.99), at(1.0));
}

fn measure(length: usize, bench: &mut Bench) {
    let programs = gusts::sequence(length);
    let (mut ours, mut clarabel, mut iterations) = (Vec::new(), Vec::new(), 0);
    for problem in &programs {
        let (mut a, mut b) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..REPETITIONS {
            a = a.min(bench.ours_us(problem));
            b = b.min(clarabel_us(problem));
        }
        iterations += bench.solution.iterations;
        ours.push(a);
        clarabel.push(b);
    }
    let each_us = ours.iter().sum::<f64>() / iterations as f64;
    report(&format!("{length} stages, ours"), ours);
    report(&format!("{length} stages, Clarabel"), clarabel);
    println!("{length} stages, ours: {each_us:.1} us an iteration");
}

/// For each number on standard input, the program of that number, our time and our first input, as one line.
fn serve(length: usize, bench: &mut Bench) {
    let programs = gusts::sequence(length);
    for line in std::io::stdin().lock().lines() {
        let Ok(number) = line.expect("standard input").trim().parse::<usize>() else { return };
        let p = &programs[number % programs.len()];
        let ours_us = bench.ours_us(p);
        let clarabel_us = clarabel_us(p);
        let stages: Vec<_> = p
            .stages()
            .iter()
            .map(|s| {
                json!({
                    "a": s.model.a, "b": s.model.b, "c": s.offset, "q": s.state_weight, "x": s.state_reference,
                    "r": s.input_weight, "u": s.input_reference, "s": s.change_weight, "min": s.input_min,
                    "max": s.input_max, "change": s.change_max, "tilt_min": s.tilt.min, "tilt_max": s.tilt.max,
                })
            })
            .collect();
        let answer = json!({
            "stages": stages, "pxx": p.terminal.state, "pxu": p.terminal.cross, "puu": p.terminal.input,
            "xn": p.terminal_state_reference, "un": p.terminal_input_reference,
            "tilt_min": p.terminal_tilt.min, "tilt_max": p.terminal_tilt.max,
            "l1": p.tilt_linear_cost, "l2": p.tilt_quadratic_cost, "x0": p.initial_state,
            "previous": p.previous_input, "ours_us": ours_us, "clarabel_us": clarabel_us,
            "first": bench.solution.inputs[0], "clarabel_first": oracle::solve(p, 1e-6).inputs[0],
        });
        println!("{answer}");
        std::io::stdout().flush().expect("standard output");
    }
}

fn main() {
    let mut bench = Bench { workspace: Workspace::default(), solution: Solution::default() };
    let mut arguments = std::env::args().skip_while(|a| a != "--serve").skip(1);
    match arguments.next().and_then(|length| length.parse().ok()) {
        Some(length) => serve(length, &mut bench),
        None => [20, 30].into_iter().for_each(|length| measure(length, &mut bench)),
    }
}
