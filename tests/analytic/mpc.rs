//! Predictive control where its answer is known: without limits, mirrored, at its limits.

#![allow(clippy::needless_range_loop)] // in linear algebra several arrays run along one index

use crate::fixture::gusts;
use hopbench::autopilot::mpc::{
    INPUTS, Linear, Problem, STATES, Settings, Solution, StageCost, Status, Tilt, Workspace, dare,
    interior_point,
};
use nalgebra::{DMatrix, SMatrix};

const ALL: usize = STATES + INPUTS;

fn solve(problem: &Problem, tolerance: f64) -> Solution {
    let (mut workspace, mut solution) = (Workspace::default(), Solution::default());
    let settings = Settings { tolerance, iterations: 30 };
    interior_point::solve(problem, &settings, &mut workspace, &mut solution);
    solution
}

/// Takes all limits away.
fn set_free(problem: &mut Problem) {
    for stage in &mut problem.stages {
        stage.input_min = [-1e6; INPUTS];
        stage.input_max = [1e6; INPUTS];
        stage.change_max = [1e6; INPUTS];
        stage.tilt = Tilt::FREE;
    }
    problem.terminal_tilt = Tilt::FREE;
}

#[test]
fn the_value_of_the_infinite_horizon_solves_the_algebraic_riccati_equation() {
    let infinite = gusts::hover();
    let model = gusts::model(&gusts::HOVER, gusts::STAGE_S).0;
    // The textbook's form with a cross term: state [x; v], v following u.
    let mut a = SMatrix::<f64, ALL, ALL>::zeros();
    let mut b = SMatrix::<f64, ALL, INPUTS>::zeros();
    let mut p = SMatrix::<f64, ALL, ALL>::zeros();
    let mut q = SMatrix::<f64, ALL, ALL>::zeros();
    let mut n = SMatrix::<f64, ALL, INPUTS>::zeros();
    let mut r = SMatrix::<f64, INPUTS, INPUTS>::zeros();
    for i in 0..STATES {
        for j in 0..STATES {
            a[(i, j)] = model.a[i][j];
            p[(i, j)] = infinite.cost.state[i][j];
        }
        for j in 0..INPUTS {
            b[(i, j)] = model.b[i][j];
            p[(i, STATES + j)] = infinite.cost.cross[i][j];
            p[(STATES + j, i)] = infinite.cost.cross[i][j];
        }
        q[(i, i)] = gusts::COST.state[i];
    }
    for j in 0..INPUTS {
        b[(STATES + j, j)] = 1.0;
        q[(STATES + j, STATES + j)] = gusts::COST.change[j];
        n[(STATES + j, j)] = -gusts::COST.change[j];
        r[(j, j)] = gusts::COST.input[j] + gusts::COST.change[j];
        for l in 0..INPUTS {
            p[(STATES + j, STATES + l)] = infinite.cost.input[j][l];
        }
    }
    let coupling = a.transpose() * p * b + n;
    let curvature = (r + b.transpose() * p * b).try_inverse().unwrap();
    let residual = a.transpose() * p * a + q - coupling * curvature * coupling.transpose() - p;
    // The recursion stops at a relative change of 1e-14 a step; its slowest mode takes a hundred steps or so.
    assert!(residual.amax() < 1e-11 * p.amax(), "{:e} of {:e}", residual.amax(), p.amax());

    // And it is the stabilising solution.
    let gain = -curvature * coupling.transpose();
    let closed = a + b * gain;
    let closed = DMatrix::from_column_slice(ALL, ALL, closed.as_slice());
    let radius = closed.complex_eigenvalues().iter().map(|z| z.norm()).fold(0.0, f64::max);
    assert!(radius < 1.0 - 1e-3, "{radius}");
    for c in 0..INPUTS {
        for i in 0..STATES {
            assert!((gain[(c, i)] - infinite.feedback[c][i]).abs() < 1e-9 * gain.amax());
        }
        for d in 0..INPUTS {
            assert!((gain[(c, STATES + d)] - infinite.memory[c][d]).abs() < 1e-9 * gain.amax());
        }
    }
}

#[test]
fn without_limits_it_is_the_linear_quadratic_regulator() {
    let infinite = gusts::hover();
    for length in [1, 7, 30] {
        let mut problem = gusts::at_hover(length, &infinite);
        set_free(&mut problem);
        let departure: [f64; STATES] = std::array::from_fn(|i| 0.1 * (i as f64 - 5.0));
        for i in 0..STATES {
            problem.initial_state[i] += departure[i];
        }
        let moved = [0.02, -0.1, 0.2, 0.05];
        for j in 0..INPUTS {
            problem.previous_input[j] += moved[j];
        }
        let solution = solve(&problem, 1e-9);
        assert_eq!(solution.status, Status::Solved);
        for c in 0..INPUTS {
            let by_state: f64 = infinite.feedback[c].iter().zip(&departure).map(|(k, x)| k * x).sum();
            let by_memory: f64 = infinite.memory[c].iter().zip(&moved).map(|(k, v)| k * v).sum();
            let expected = problem.stages[0].input_reference[c] + by_state + by_memory;
            assert!((solution.inputs[0][c] - expected).abs() < 1e-8, "{} {expected}", solution.inputs[0][c]);
            for i in 0..STATES {
                assert!((solution.feedback[c][i] - infinite.feedback[c][i]).abs() < 1e-8, "{c} {i}");
            }
        }
    }
}

#[test]
fn without_weights_on_change_the_equation_is_the_ordinary_one() {
    // A double integrator with unit weights: the value is [[w, 1], [1, w]] with w = sqrt(3) as the step goes
    // to zero; at a step of 1e-3 the sampled value differs by half a step, in relative terms.
    let step_s = 1e-3;
    let mut model = Linear::default();
    for i in 0..STATES {
        model.a[i][i] = 0.5;
    }
    (model.a[0][0], model.a[0][1], model.a[1][1]) = (1.0, step_s, 1.0);
    (model.b[0][0], model.b[1][0]) = (0.5 * step_s * step_s, step_s);
    let mut cost = StageCost { input: [step_s; INPUTS], ..StageCost::default() };
    (cost.state[0], cost.state[1]) = (step_s, step_s);
    let value = dare(&model, &cost).unwrap().cost.state;
    assert!((value[0][0] / 3.0_f64.sqrt() - 1.0).abs() < step_s, "{}", value[0][0]);
    assert!((value[0][1] - 1.0).abs() < step_s, "{}", value[0][1]);
    assert!((value[1][1] / 3.0_f64.sqrt() - 1.0).abs() < step_s, "{}", value[1][1]);
}

#[test]
fn a_mode_out_of_reach_has_no_infinite_horizon() {
    let mut model = Linear::default();
    model.a[4][4] = 1.1;
    let cost = StageCost { state: [1.0; STATES], input: [1.0; INPUTS], change: [0.0; INPUTS] };
    assert!(dare(&model, &cost).is_none());
}

/// Signs under a reflection of east: position, velocity and thrust are vectors, rotations are not.
const MIRROR: [f64; STATES] = [1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0];
const MIRROR_INPUT: [f64; INPUTS] = [1.0, -1.0, 1.0, -1.0];

fn mirrored(problem: &Problem) -> Problem {
    let mut m = problem.clone();
    let tilt = |tilt: &Tilt| Tilt { min: [-tilt.max[0], tilt.min[1]], max: [-tilt.min[0], tilt.max[1]] };
    for stage in &mut m.stages {
        for i in 0..STATES {
            for j in 0..STATES {
                stage.model.a[i][j] *= MIRROR[i] * MIRROR[j];
            }
            for j in 0..INPUTS {
                stage.model.b[i][j] *= MIRROR[i] * MIRROR_INPUT[j];
            }
            stage.offset[i] *= MIRROR[i];
            stage.state_reference[i] *= MIRROR[i];
        }
        for j in 0..INPUTS {
            stage.input_reference[j] *= MIRROR_INPUT[j];
            if MIRROR_INPUT[j] < 0.0 {
                (stage.input_min[j], stage.input_max[j]) = (-stage.input_max[j], -stage.input_min[j]);
            }
        }
        stage.tilt = tilt(&stage.tilt);
    }
    for i in 0..STATES {
        for j in 0..STATES {
            m.terminal.state[i][j] *= MIRROR[i] * MIRROR[j];
        }
        for j in 0..INPUTS {
            m.terminal.cross[i][j] *= MIRROR[i] * MIRROR_INPUT[j];
        }
        m.terminal_state_reference[i] *= MIRROR[i];
        m.initial_state[i] *= MIRROR[i];
    }
    for i in 0..INPUTS {
        for j in 0..INPUTS {
            m.terminal.input[i][j] *= MIRROR_INPUT[i] * MIRROR_INPUT[j];
        }
        m.terminal_input_reference[i] *= MIRROR_INPUT[i];
        m.previous_input[i] *= MIRROR_INPUT[i];
    }
    m.terminal_tilt = tilt(&m.terminal_tilt);
    m
}

#[test]
fn a_mirrored_program_has_the_mirrored_answer() {
    let mut moved = 0.0_f64;
    for problem in gusts::sequence(20).iter().step_by(7) {
        let (plain, mirror) = (solve(problem, 1e-6), solve(&mirrored(problem), 1e-6));
        assert_eq!(plain.status, Status::Solved);
        assert_eq!(plain.iterations, mirror.iterations);
        for k in 0..problem.length {
            for j in 0..INPUTS {
                let error = plain.inputs[k][j] - MIRROR_INPUT[j] * mirror.inputs[k][j];
                // The same arithmetic but for the order of sums; conditioning of the last step 1e9.
                assert!(error.abs() < 1e-7, "stage {k} input {j}: {error:e}");
            }
            moved = moved.max(plain.inputs[k][1].abs());
        }
    }
    assert!(moved > 0.5, "gimbals should have moved: {moved}");
}

#[test]
fn an_input_at_its_limit_does_not_answer_to_the_state() {
    let infinite = gusts::hover();
    let mut problem = gusts::at_hover(20, &infinite);
    // Far too low and sinking: full thrust at the fastest change, come what may.
    problem.initial_state[2] += 5.0;
    problem.initial_state[5] += 4.0;
    let solution = solve(&problem, 1e-6);
    assert_eq!(solution.status, Status::Solved);
    let expected = problem.previous_input[0] + problem.stages[0].change_max[0];
    assert!((solution.inputs[0][0] - expected).abs() < 1e-6);
    for i in 0..STATES {
        let held = solution.feedback[0][i].abs();
        assert!(held < 1e-4, "thrust answers to state {i}: {held:e}");
    }
    // The others are free and answer.
    assert!((solution.feedback[1][6] / infinite.feedback[1][6] - 1.0).abs() < 0.5);
}

#[test]
fn the_soft_limit_gives_way_by_what_it_costs() {
    // A gust that asks for more tilt: a linear cost above what leaving is worth holds the limit exactly,
    // which a quadratic cost alone would not.
    let mut problem = gusts::at_hover(30, &gusts::hover());
    problem.initial_state[3] += 2.0;
    problem.tilt_linear_cost = 500.0;
    let solution = solve(&problem, 1e-6);
    assert_eq!(solution.status, Status::Solved);
    let limit = problem.terminal_tilt.max[1];
    let greatest = solution.states[..=30].iter().map(|x| x[7]).fold(0.0, f64::max);
    let held = solution.states[..=30].iter().filter(|x| (x[7] - limit).abs() < 1e-5).count();
    assert!(greatest < limit + 1e-5 && held >= 2, "greatest {greatest}, limit {limit}, held {held} stages");
    let mut soft = problem.clone();
    soft.tilt_linear_cost = 0.0;
    soft.tilt_quadratic_cost = 1.0;
    let solution = solve(&soft, 1e-6);
    let greatest = solution.states[..=30].iter().map(|x| x[7]).fold(0.0, f64::max);
    assert!(greatest > limit + 0.05, "a cheap limit gives way: {greatest}");
}
