//! Predictive control against Clarabel, a general conic solver that shares no code with ours.
//!
//! Three hundred programs of a loop closed over 6 s with two gusts, the last hundred with a model of its own
//! in every stage; for 20 and for 30 stages.

#![allow(clippy::needless_range_loop)] // in linear algebra several arrays run along one index

use crate::fixture::gusts;
use hopbench::autopilot::mpc::{
    INPUTS, Problem, Settings, Solution, Status, Workspace, interior_point, oracle,
};

/// Clarabel's tolerance for the comparison.
const TIGHT: f64 = 1e-9;

fn difference(a: &[f64; INPUTS], b: &[f64; INPUTS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Greatest excess over the limits of input and change. The tilt's limits are soft: their excess is in the
/// cost.
fn excess(problem: &Problem, solution: &Solution) -> f64 {
    let mut previous = problem.previous_input;
    let mut excess = 0.0_f64;
    for (stage, input) in problem.stages().iter().zip(&solution.inputs) {
        for j in 0..INPUTS {
            excess = excess
                .max(stage.input_min[j] - input[j])
                .max(input[j] - stage.input_max[j])
                .max((input[j] - previous[j]).abs() - stage.change_max[j]);
        }
        previous = *input;
    }
    excess
}

/// Solves the sequence with both; the histogram of our iterations, from none to fifteen.
fn compare(length: usize) -> [usize; 16] {
    let (mut workspace, mut solution) = (Workspace::default(), Solution::default());
    let mut errors = Vec::new();
    let mut histogram = [0; 16];
    let mut busiest = 0;
    for (number, problem) in gusts::sequence(length).iter().enumerate() {
        interior_point::solve(problem, &Settings::default(), &mut workspace, &mut solution);
        let reference = oracle::solve(problem, TIGHT);
        assert_eq!(reference.status, Status::Solved, "Clarabel, program {number}");
        assert_eq!(solution.status, Status::Solved, "program {number}");
        histogram[solution.iterations] += 1;
        errors.push(difference(&solution.inputs[0], &reference.inputs[0]));
        // Round-off of the differences between limits of order one.
        assert!(excess(problem, &solution) < 1e-12, "program {number}: {:e}", excess(problem, &solution));
        // Products of slack and multiplier of 1e-6 over some ten active limits, with 1e-9 of the reference.
        let ours = problem.cost(&solution.inputs, &solution.states);
        let best = problem.cost(&reference.inputs, &reference.states);
        let worse = (ours - best).abs() / best.max(1.0);
        assert!(worse < 1e-6, "program {number}: cost {ours} against {best}");
        busiest = busiest.max(gusts::active(problem, &reference));
    }
    errors.sort_by(f64::total_cmp);
    let (median, greatest) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    // Scaled inputs: 5e-3 is 5 N of thrust, 0.03 degrees of gimbal. Found: median 2e-7, greatest 1.1e-4.
    assert!(median < 1e-5 && greatest < 5e-3, "median {median:e}, greatest {greatest:e}");
    assert!(busiest >= 35, "the sequence should be hard: at most {busiest} limits hold");
    histogram
}

#[test]
fn twenty_stages_through_two_gusts() {
    assert_eq!(compare(20), [0, 0, 0, 0, 0, 5, 68, 28, 48, 76, 23, 34, 11, 6, 1, 0]);
}

#[test]
fn thirty_stages_through_two_gusts() {
    assert_eq!(compare(30), [0, 0, 0, 0, 0, 5, 36, 54, 43, 75, 28, 26, 22, 8, 3, 0]);
}

#[test]
fn the_fallback_tolerance_is_good_enough_to_fly() {
    for problem in gusts::sequence(20).iter().step_by(5) {
        let (fallback, reference) = (oracle::solve(problem, 1e-6), oracle::solve(problem, TIGHT));
        assert_eq!(fallback.status, Status::Solved);
        let error = difference(&fallback.inputs[0], &reference.inputs[0]);
        assert!(error < 5e-3, "{error:e}");
        assert!(excess(problem, &fallback) < 1e-12);
    }
}
