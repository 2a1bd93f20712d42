//! Invariant: whatever it is given, predictive control answers finite inputs inside their limits, or says
//! that it cannot; it never panics, and the same program gives the same bits.

#![allow(clippy::needless_range_loop)] // in linear algebra several arrays run along one index

use crate::fixture::gusts;
use hopbench::autopilot::mpc::problem::InputLimits;
use hopbench::autopilot::mpc::{
    INPUTS, Problem, STATES, Settings, Solution, Status, Workspace, interior_point, oracle,
};
use proptest::prelude::*;

fn solve(problem: &Problem) -> Solution {
    let (mut workspace, mut solution) = (Workspace::default(), Solution::default());
    interior_point::solve(problem, &Settings::default(), &mut workspace, &mut solution);
    solution
}

/// Finite, and inside the limits as they are once contradictions are settled.
fn check(problem: &Problem, solution: &Solution) {
    assert!(solution.inputs.as_flattened().iter().all(|x| x.is_finite()));
    assert!(solution.states.as_flattened().iter().all(|x| x.is_finite()));
    assert!(solution.feedback.as_flattened().iter().all(|x| x.is_finite()));
    if solution.status == Status::NumericalFailure {
        return;
    }
    let mut limits = InputLimits::default();
    problem.consistent_limits(&mut limits);
    let mut previous = limits.previous_input;
    for (k, input) in solution.inputs[..problem.length].iter().enumerate() {
        for j in 0..INPUTS {
            assert!((limits.min[k][j]..=limits.max[k][j]).contains(&input[j]), "{input:?}");
            // The difference of two inputs is rounded once more than the limit was.
            let rounding = 1e-15 * (input[j].abs() + previous[j].abs());
            let allowed = limits.change[k][j] + rounding + 1e-5;
            assert!((input[j] - previous[j]).abs() <= allowed, "stage {k}: {} {}", input[j], previous[j]);
        }
        previous = *input;
    }
}

#[test]
fn an_input_in_force_outside_its_limits_is_led_back() {
    let mut problem = gusts::at_hover(20, &gusts::hover());
    problem.previous_input = [2.0, -3.0, 5.0, 1.0];
    let solution = solve(&problem);
    assert_eq!(solution.status, Status::Solved);
    check(&problem, &solution);
    let first = &problem.stages[0];
    let expected = [first.input_max[0], first.input_min[1], first.input_max[2], first.input_max[3]];
    for j in 0..INPUTS {
        assert!((solution.inputs[0][j] - expected[j]).abs() <= first.change_max[j] + 1e-12);
    }
    assert_eq!(oracle::solve(&problem, 1e-6).status, Status::Solved);
}

#[test]
fn contradicting_limits_are_settled() {
    let mut problem = gusts::at_hover(20, &gusts::hover());
    // A band that jumps faster than the input may change, one in the wrong order, one without width.
    problem.stages[8].input_min[0] = 0.93;
    problem.stages[4].input_min[1] = 0.5;
    problem.stages[4].input_max[1] = 0.3;
    (problem.stages[5].input_min[2], problem.stages[5].input_max[2]) = (0.1, 0.1);
    problem.stages[6].change_max = [0.0; INPUTS];
    let solution = solve(&problem);
    assert_ne!(solution.status, Status::NumericalFailure);
    check(&problem, &solution);
    assert!(solution.inputs[8][0] >= 0.93);
    assert!((solution.inputs[4][1] - 0.4).abs() < 1e-5 && (solution.inputs[5][2] - 0.1).abs() < 1e-5);
}

#[test]
fn what_is_no_number_or_too_large_is_refused() {
    let places: [fn(&mut Problem) -> &mut f64; 14] = [
        |p| &mut p.stages[3].model.a[2][5],
        |p| &mut p.stages[3].model.b[2][1],
        |p| &mut p.stages[0].offset[12],
        |p| &mut p.stages[9].state_weight[0],
        |p| &mut p.stages[9].state_reference[0],
        |p| &mut p.stages[9].input_weight[0],
        |p| &mut p.stages[9].input_reference[0],
        |p| &mut p.stages[9].change_weight[3],
        |p| &mut p.stages[19].input_min[0],
        |p| &mut p.stages[19].tilt.max[1],
        |p| &mut p.terminal.state[4][4],
        |p| &mut p.terminal_tilt.min[0],
        |p| &mut p.initial_state[7],
        |p| &mut p.previous_input[2],
    ];
    let sound = gusts::at_hover(20, &gusts::hover());
    for (number, place) in places.iter().enumerate() {
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
            let mut problem = sound.clone();
            *place(&mut problem) = wrong;
            let solution = solve(&problem);
            assert_eq!(solution.status, Status::NumericalFailure, "place {number}, {wrong}");
            check(&problem, &solution);
            assert_eq!(oracle::solve(&problem, 1e-6).status, Status::NumericalFailure);
        }
    }
    for length in [0, 31, usize::MAX] {
        let problem = Problem { length, ..sound.clone() };
        assert_eq!(solve(&problem).status, Status::NumericalFailure);
        assert_eq!(oracle::solve(&problem, 1e-6).status, Status::NumericalFailure);
    }
    // Beyond what is used nothing is looked at.
    let mut problem = sound.clone();
    problem.stages[20].offset[0] = f64::NAN;
    assert_eq!(solve(&problem).status, Status::Solved);
}

#[test]
fn the_same_program_gives_the_same_bits_whatever_was_solved_before() {
    let programs = gusts::sequence(20);
    let (mut workspace, mut solution) = (Workspace::default(), Solution::default());
    for (number, problem) in programs.iter().enumerate().step_by(23) {
        let other = &programs[(number + 100) % programs.len()];
        interior_point::solve(other, &Settings::default(), &mut workspace, &mut solution);
        interior_point::solve(problem, &Settings::default(), &mut workspace, &mut solution);
        assert_eq!(solution, solve(problem));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_departure_in_any_scale_is_answered(
        departure in prop::array::uniform13(-1.0..1.0_f64),
        previous in prop::array::uniform4(-2.0..2.0_f64),
        exponent in -3.0..7.0_f64,
        entry in (0..STATES, 0..STATES, -1.0..1.0_f64),
        length in 1..=30_usize,
    ) {
        let mut problem = gusts::at_hover(length, &gusts::hover());
        let scale = libm::pow(10.0, exponent);
        for i in 0..STATES {
            problem.initial_state[i] += scale * departure[i];
        }
        problem.previous_input = previous;
        problem.stages[length / 2].model.a[entry.0][entry.1] += scale * entry.2;
        let solution = solve(&problem);
        check(&problem, &solution);
        // A flight's departures are solved.
        if scale < 1.0 {
            prop_assert_ne!(solution.status, Status::NumericalFailure);
        }
    }
}
