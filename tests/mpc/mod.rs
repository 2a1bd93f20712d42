//! Programs as a hop gives rise to them: a lander of 75 kg near hover, kicked twice by 3 m/s in a loop closed over
//! 6 s at 50 Hz.
//!
//! State, in metres, metres a second, tenths of a radian and kilonewtons: position and velocity (NED), small rotation
//! and rate about FRD x, y, z, thrust. Input: thrust demanded (kN), gimbal about x and y (0.1 rad), torque about z
//! (10 N m). Everything follows from the numbers below; no file, no random number.

#![allow(clippy::needless_range_loop)] // in linear algebra several arrays run along one index
#![allow(dead_code)] // not every test uses all of it

use hopbench::autopilot::mpc::{
    INPUTS, InfiniteHorizon, Linear, Problem, STATES, Settings, Solution, Stage, StageCost, Tilt, Workspace,
    dare, interior_point,
};

pub const STAGE_S: f64 = 0.05;
pub const PERIOD_S: f64 = 0.02;
const MASS_KG: f64 = 75.0;
const GRAVITY_M_S2: f64 = 9.81;
/// From gimbal to centre of mass.
const LEVER_M: f64 = 0.40;
const INERTIA_KG_M2: [f64; 3] = [9.0, 9.5, 2.2];
const THRUST_LAG_S: f64 = 0.12;
/// Drag per mass and speed (1/s).
const DRAG_1_S: f64 = 0.03;

/// In tenths of a radian.
const DEGREE: f64 = 0.174_533;

pub const COST: StageCost = StageCost {
    state: [4.0, 4.0, 8.0, 2.0, 2.0, 4.0, 0.3, 0.3, 0.1, 0.02, 0.02, 0.01, 0.01],
    input: [2.0, 0.5, 0.5, 0.1],
    change: [1.0, 1.0, 1.0, 0.1],
};

/// Where a model is made linear.
#[derive(Clone, Copy)]
pub struct Around {
    pub mass_kg: f64,
    pub thrust_n: f64,
    /// Tilt about x and y (rad).
    pub tilt_rad: [f64; 2],
}

pub const HOVER: Around = Around { mass_kg: MASS_KG, thrust_n: MASS_KG * GRAVITY_M_S2, tilt_rad: [0.0; 2] };

/// Rates of the states: Jacobians and the constant that makes them exact at the point.
fn continuous(around: &Around) -> ([[f64; STATES]; STATES], [[f64; INPUTS]; STATES], [f64; STATES]) {
    let (mut a, mut b, mut c) = ([[0.0; STATES]; STATES], [[0.0; INPUTS]; STATES], [0.0; STATES]);
    let (m, thrust, [tx, ty]) = (around.mass_kg, around.thrust_n, around.tilt_rad);
    for i in 0..3 {
        a[i][3 + i] = 1.0;
        a[3 + i][3 + i] = -DRAG_1_S;
        a[6 + i][9 + i] = 1.0;
    }
    // v' = T/m (-ty, tx, -1) + g; the gimbal pushes sideways where it turns: Fx = T gy, Fy = -T gx.
    let acceleration = thrust / m;
    a[3][7] = -0.1 * acceleration;
    a[4][6] = 0.1 * acceleration;
    a[5][6] = 0.1 * acceleration * tx;
    a[5][7] = 0.1 * acceleration * ty;
    a[3][12] = -1e3 * ty / m;
    a[4][12] = 1e3 * tx / m;
    a[5][12] = -1e3 / m;
    b[3][2] = 0.1 * acceleration;
    b[4][1] = -0.1 * acceleration;
    c[5] = GRAVITY_M_S2 - acceleration * (tx * tx + ty * ty);
    c[3] = acceleration * ty;
    c[4] = -acceleration * tx;
    b[9][1] = thrust * LEVER_M / INERTIA_KG_M2[0];
    b[10][2] = thrust * LEVER_M / INERTIA_KG_M2[1];
    b[11][3] = 100.0 / INERTIA_KG_M2[2];
    a[12][12] = -1.0 / THRUST_LAG_S;
    b[12][0] = 1.0 / THRUST_LAG_S;
    (a, b, c)
}

/// Exact model over an interval with the input held: Taylor's series of the matrix exponential.
pub fn model(around: &Around, interval_s: f64) -> (Linear, [f64; STATES]) {
    const ALL: usize = STATES + INPUTS + 1;
    let (a, b, c) = continuous(around);
    let mut rate = [[0.0; ALL]; ALL];
    for i in 0..STATES {
        rate[i][..STATES].copy_from_slice(&a[i]);
        rate[i][STATES..STATES + INPUTS].copy_from_slice(&b[i]);
        rate[i][ALL - 1] = c[i];
    }
    let mut sum = [[0.0; ALL]; ALL];
    let mut term = [[0.0; ALL]; ALL];
    for i in 0..ALL {
        (sum[i][i], term[i][i]) = (1.0, 1.0);
    }
    // (0.05 s / 0.12 s)^16 / 16! is below round-off.
    for order in 1..=16 {
        let mut next = [[0.0; ALL]; ALL];
        for i in 0..ALL {
            for j in 0..ALL {
                next[i][j] =
                    (0..ALL).map(|k| term[i][k] * rate[k][j]).sum::<f64>() * interval_s / order as f64;
                sum[i][j] += next[i][j];
            }
        }
        term = next;
    }
    let linear = Linear {
        a: std::array::from_fn(|i| std::array::from_fn(|j| sum[i][j])),
        b: std::array::from_fn(|i| std::array::from_fn(|j| sum[i][STATES + j])),
    };
    (linear, std::array::from_fn(|i| sum[i][ALL - 1]))
}

/// Optimal control of the hover without limits.
pub fn hover() -> InfiniteHorizon {
    dare(&model(&HOVER, STAGE_S).0, &COST).expect("hover can be held")
}

/// A program at hover with the limits of the vehicle, at rest where it should be.
pub fn at_hover(length: usize, infinite: &InfiniteHorizon) -> Problem {
    let mut problem = Problem { length, ..Problem::default() };
    let mut state_reference = [0.0; STATES];
    state_reference[12] = 1e-3 * HOVER.thrust_n;
    let input_reference = [state_reference[12], 0.0, 0.0, 0.0];
    let tilt = Tilt { min: [-12.0 * DEGREE; 2], max: [12.0 * DEGREE; 2] };
    let (linear, offset) = model(&HOVER, STAGE_S);
    let stage = Stage {
        model: linear,
        offset,
        state_weight: COST.state,
        state_reference,
        input_weight: COST.input,
        input_reference,
        change_weight: COST.change,
        input_min: [0.40, -6.0 * DEGREE, -6.0 * DEGREE, -0.2],
        input_max: [0.95, 6.0 * DEGREE, 6.0 * DEGREE, 0.2],
        change_max: [1.5 * STAGE_S, 8.0 * STAGE_S, 8.0 * STAGE_S, 0.4],
        tilt,
    };
    problem.stages.fill(stage);
    for change in &mut problem.stages[0].change_max[..3] {
        *change *= PERIOD_S / STAGE_S;
    }
    problem.terminal = infinite.cost;
    problem.terminal_state_reference = state_reference;
    problem.terminal_input_reference = input_reference;
    problem.terminal_tilt = tilt;
    problem.initial_state = state_reference;
    problem.previous_input = input_reference;
    problem
}

/// Gives every stage a model of its own: a reference that leans up to 10 degrees to and fro while it loses mass.
fn lean(problem: &mut Problem, time_s: f64) {
    for k in 0..problem.length {
        let phase = 1.7 * (time_s + STAGE_S * k as f64);
        let tilt_rad = [0.17 * libm::sin(phase), 0.12 * libm::cos(0.8 * phase)];
        let mass_kg = MASS_KG - 0.4 * phase;
        let around = Around { mass_kg, thrust_n: mass_kg * GRAVITY_M_S2, tilt_rad };
        let stage = &mut problem.stages[k];
        (stage.model, stage.offset) = model(&around, STAGE_S);
        stage.state_reference[6] = 10.0 * tilt_rad[0];
        stage.state_reference[7] = 10.0 * tilt_rad[1];
        stage.state_reference[12] = 1e-3 * around.thrust_n;
        stage.input_reference[0] = 1e-3 * around.thrust_n;
    }
}

/// Three hundred programs of a closed loop. The last hundred follow a leaning reference, each stage its own model.
pub fn sequence(length: usize) -> Vec<Problem> {
    let infinite = hover();
    let mut problem = at_hover(length, &infinite);
    let (plant, offset) = model(&HOVER, PERIOD_S);
    let (mut workspace, mut solution) = (Workspace::default(), Solution::default());
    let mut programs = Vec::new();
    for step in 0..300 {
        if step == 5 {
            problem.initial_state[3] += 3.0;
        }
        if step == 130 {
            problem.initial_state[3] -= 1.5;
            problem.initial_state[4] -= 2.6;
        }
        if step >= 200 {
            lean(&mut problem, PERIOD_S * f64::from(step));
        }
        programs.push(problem.clone());
        interior_point::solve(&problem, &Settings::default(), &mut workspace, &mut solution);
        let input = solution.inputs[0];
        problem.initial_state = plant.step(&problem.initial_state, &input);
        for (x, c) in problem.initial_state.iter_mut().zip(&offset) {
            *x += c;
        }
        problem.previous_input = input;
    }
    programs
}

/// Constraints that hold with equality at a solution, to 1e-5.
pub fn active(problem: &Problem, solution: &Solution) -> usize {
    let near = |a: f64, b: f64| usize::from((a - b).abs() < 1e-5);
    let mut previous = problem.previous_input;
    let mut count = 0;
    for (k, stage) in problem.stages().iter().enumerate() {
        let input = solution.inputs[k];
        for j in 0..INPUTS {
            count += near(input[j], stage.input_min[j]) + near(input[j], stage.input_max[j]);
            count += near((input[j] - previous[j]).abs(), stage.change_max[j]);
        }
        let tilt = problem.tilt_after(k);
        for i in 0..2 {
            let x = solution.states[k + 1][6 + i];
            count += usize::from(x >= tilt.max[i] - 1e-5 || x <= tilt.min[i] + 1e-5);
        }
        previous = input;
    }
    count
}
