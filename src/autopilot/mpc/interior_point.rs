//! Interior-point method that exploits the stages of the program: a few microseconds a stage.
//!
//! Primal-dual with Mehrotra's predictor and corrector. Inequalities are a z + t = b with slack t > 0 and
//! multiplier λ > 0; Newton's step of their products leaves a program without inequalities whose weights
//! carry λ/t, and that is a Riccati recursion ([`super::riccati`]), factorised once an iteration and swept
//! twice. The states follow the inputs exactly at every iterate, so that dynamics leave no residual. The
//! slack of a tilt limit is eliminated in closed form before the recursion.
//!
//! Sources: S. Mehrotra, On the implementation of a primal-dual interior point method, SIAM J. Optim. 2(4),
//! 1992; C. Rao, S. Wright, J. Rawlings, Application of interior-point methods to model predictive
//! control, JOTA 99(3), 1998; starting point and step rules after G. Frison and M. Diehl, HPIPM, IFAC 2020.

use super::model::{INPUTS, STATES, StageCost};
use super::problem::{InputLimits, MAX_STAGES, Problem, Settings, Solution, Status, TILT};
use super::riccati::{InputGradient, Policy, Row, SparseModel, ValueFunction, ValueGradient, input_gradient};

/// Inequalities of one stage: limits of its input and of its change, tilt limits of the state it leads to.
const INEQUALITIES: usize = 4 * INPUTS + 6;
// First index of each kind.
const INPUT_LOW: usize = 0;
const INPUT_HIGH: usize = INPUTS;
const CHANGE_LOW: usize = 2 * INPUTS;
const CHANGE_HIGH: usize = 3 * INPUTS;
const TILT_HIGH: usize = 4 * INPUTS;
const TILT_LOW: usize = TILT_HIGH + 2;
const SLACK: usize = TILT_LOW + 2;
/// Distance at the start: of the inputs from their limits, and of the tilt slack from zero.
const MARGIN: f64 = 0.1;
/// Least slack at the start. Wide, since a point close to a limit has a long way to any other; inputs need
/// not keep their limits on the way.
const START_SLACK: f64 = 1.0;
/// Slack times multiplier at the start: at least so much, and this share of the gradient that multipliers
/// will have to balance. Too small a product leaves them too short, and every step of theirs ends at a limit.
const START_PRODUCT: f64 = 10.0;
const START_SHARE: f64 = 0.03;
/// Share of the step to the boundary that is taken.
const STEP_SHARE: f64 = 0.998;

type PerInequality = [f64; INEQUALITIES];

/// A point, or a step from one, at one stage: its input, the state it leads to, the slack of that state.
#[derive(Clone, Debug)]
struct Point {
    input: [f64; INPUTS],
    state: Row,
    slack: [f64; 2],
}

impl Default for Point {
    fn default() -> Self {
        Self { input: [0.0; INPUTS], state: Row::default(), slack: [0.0; 2] }
    }
}

/// One stage of the iteration.
#[derive(Clone, Debug)]
struct StageWork {
    columns: SparseModel,
    policy: Policy,
    at: Point,
    step: Point,
    /// Gradient of the costs at the iterate, in the state at the beginning of the stage.
    state_gradient: Row,
    /// In input and change.
    gradient: InputGradient,
    /// Weights of the factorised program.
    weight: StageCost,
    bound: PerInequality,
    slack: PerInequality,
    multiplier: PerInequality,
    residual: PerInequality,
    reciprocal: PerInequality,
    target: PerInequality,
    slack_step: PerInequality,
    multiplier_step: PerInequality,
    /// Of the tilt slack in the factorised program: reciprocal of its weight, and its derivative in the tilt.
    flexibility: [f64; 2],
    coupling: [f64; 2],
}

impl Default for StageWork {
    fn default() -> Self {
        Self {
            columns: SparseModel::default(),
            policy: Policy::default(),
            at: Point::default(),
            step: Point::default(),
            state_gradient: Row::default(),
            gradient: InputGradient::default(),
            weight: StageCost::default(),
            bound: [0.0; INEQUALITIES],
            slack: [0.0; INEQUALITIES],
            multiplier: [0.0; INEQUALITIES],
            residual: [0.0; INEQUALITIES],
            reciprocal: [0.0; INEQUALITIES],
            target: [0.0; INEQUALITIES],
            slack_step: [0.0; INEQUALITIES],
            multiplier_step: [0.0; INEQUALITIES],
            flexibility: [0.0; 2],
            coupling: [0.0; 2],
        }
    }
}

/// Memory of a solve (about 300 kB), allocated once. It carries nothing from one solve to the next.
#[derive(Clone, Debug)]
pub struct Workspace {
    work: Vec<StageWork>,
    limits: InputLimits,
}

impl Default for Workspace {
    fn default() -> Self {
        Self { work: vec![StageWork::default(); MAX_STAGES], limits: InputLimits::default() }
    }
}

/// Residuals of an iterate.
#[derive(Clone, Copy, Debug)]
struct Residuals {
    primal: f64,
    dual: f64,
    gap: f64,
    /// Mean of slack times multiplier.
    mean: f64,
}

/// Solves a program from a cold start; the solution depends on nothing but the arguments.
pub fn solve(
    problem: &Problem,
    settings: &Settings,
    workspace: &mut Workspace,
    solution: &mut Solution,
) -> Status {
    *solution = Solution::default();
    if !problem.is_sound() {
        return Status::NumericalFailure;
    }
    problem.consistent_limits(&mut workspace.limits);
    let limits = &workspace.limits;
    let work = &mut workspace.work[..problem.length];
    initialise(problem, limits, work);
    let status = loop {
        let now = residuals(problem, limits, work);
        (solution.primal_residual, solution.dual_residual, solution.gap) = (now.primal, now.dual, now.gap);
        let worst = now.primal.max(now.dual).max(now.gap);
        if !worst.is_finite() {
            return Status::NumericalFailure;
        }
        // The second condition gives a feedback even to a program solved at its starting point.
        if worst <= settings.tolerance && solution.iterations > 0 {
            break Status::Solved;
        }
        if solution.iterations == settings.iterations {
            break Status::IterationLimit;
        }
        solution.iterations += 1;
        if iterate(problem, work, now.mean).is_none() {
            return Status::NumericalFailure;
        }
    };
    write_solution(problem, limits, work, solution);
    let finite = |x: &[f64]| x.iter().all(|x| x.is_finite());
    if finite(solution.inputs.as_flattened()) && finite(solution.states.as_flattened()) {
        solution.status = status;
    }
    solution.status
}

/// Sets a point inside the limits, with equal products of slack and multiplier.
fn initialise(problem: &Problem, limits: &InputLimits, work: &mut [StageWork]) {
    let mut input = limits.previous_input;
    let mut state = Row::default();
    state[..STATES].copy_from_slice(&problem.initial_state);
    for (k, w) in work.iter_mut().enumerate() {
        let stage = &problem.stages[k];
        w.columns.fill(&stage.model);
        let tilt = problem.tilt_after(k);
        for j in 0..INPUTS {
            let margin = MARGIN.min(0.25 * (limits.max[k][j] - limits.min[k][j]));
            input[j] = input[j].clamp(limits.min[k][j] + margin, limits.max[k][j] - margin);
            w.bound[INPUT_LOW + j] = -limits.min[k][j];
            w.bound[INPUT_HIGH + j] = limits.max[k][j];
            w.bound[CHANGE_LOW + j] = limits.change[k][j];
            w.bound[CHANGE_HIGH + j] = limits.change[k][j];
        }
        state = w.columns.step(&state, &input);
        for i in 0..STATES {
            state[i] += stage.offset[i];
        }
        w.at = Point { input, state, slack: [0.0; 2] };
        for i in 0..2 {
            let x = state[TILT[i]];
            w.bound[TILT_HIGH + i] = tilt.max[i];
            w.bound[TILT_LOW + i] = -tilt.min[i];
            w.at.slack[i] = (x - tilt.max[i]).max(tilt.min[i] - x).max(0.0) + MARGIN;
        }
    }
    let mut previous = limits.previous_input;
    for w in work.iter_mut() {
        let left = left_sides(&w.at, &previous);
        for i in 0..INEQUALITIES {
            w.slack[i] = (w.bound[i] - left[i]).max(START_SLACK);
        }
        w.multiplier = [0.0; INEQUALITIES];
        previous = w.at.input;
    }
    let product = START_PRODUCT.max(START_SHARE * residuals(problem, limits, work).dual);
    for w in work {
        for i in 0..INEQUALITIES {
            w.multiplier[i] = product / w.slack[i];
        }
    }
}

/// Left sides a z of the inequalities.
#[inline(always)]
fn left_sides(point: &Point, previous: &[f64; INPUTS]) -> PerInequality {
    let mut left = [0.0; INEQUALITIES];
    for j in 0..INPUTS {
        let change = point.input[j] - previous[j];
        left[INPUT_LOW + j] = -point.input[j];
        left[INPUT_HIGH + j] = point.input[j];
        left[CHANGE_LOW + j] = -change;
        left[CHANGE_HIGH + j] = change;
    }
    for i in 0..2 {
        let x = point.state[TILT[i]];
        left[TILT_HIGH + i] = x - point.slack[i];
        left[TILT_LOW + i] = -x - point.slack[i];
        left[SLACK + i] = -point.slack[i];
    }
    left
}

/// Gradient in input and change with the multipliers' aᵀ m.
#[inline(always)]
fn with_multipliers(gradient: &InputGradient, m: &PerInequality) -> InputGradient {
    let mut sum = InputGradient::default();
    for j in 0..INPUTS {
        sum.input[j] = gradient.input[j] + m[INPUT_HIGH + j] - m[INPUT_LOW + j];
        sum.change[j] = gradient.change[j] + m[CHANGE_HIGH + j] - m[CHANGE_LOW + j];
    }
    sum
}

/// Gradients and residuals at the iterate.
fn residuals(problem: &Problem, limits: &InputLimits, work: &mut [StageWork]) -> Residuals {
    let (mut primal, mut gap, mut sum) = ([0.0; INEQUALITIES], [0.0; INEQUALITIES], [0.0; INEQUALITIES]);
    let mut dual = 0.0;
    let mut previous = limits.previous_input;
    for (k, w) in work.iter_mut().enumerate() {
        let stage = &problem.stages[k];
        let left = left_sides(&w.at, &previous);
        for i in 0..INEQUALITIES {
            w.residual[i] = left[i] + w.slack[i] - w.bound[i];
            w.reciprocal[i] = 1.0 / w.slack[i];
            let product = w.slack[i] * w.multiplier[i];
            sum[i] += product;
            gap[i] = greater(gap[i], product);
            primal[i] = greater(primal[i], w.residual[i].abs());
        }
        for j in 0..INPUTS {
            w.gradient.input[j] = stage.input_weight[j] * (w.at.input[j] - stage.input_reference[j]);
            w.gradient.change[j] = stage.change_weight[j] * (w.at.input[j] - previous[j]);
        }
        for i in 0..2 {
            let lambda = &w.multiplier;
            let gradient = problem.tilt_linear_cost + problem.tilt_quadratic_cost * w.at.slack[i]
                - (lambda[TILT_HIGH + i] + lambda[TILT_LOW + i] + lambda[SLACK + i]);
            dual = greater(dual, gradient.abs());
        }
        previous = w.at.input;
    }
    for k in 1..work.len() {
        let stage = &problem.stages[k];
        for i in 0..STATES {
            work[k].state_gradient[i] =
                stage.state_weight[i] * (work[k - 1].at.state[i] - stage.state_reference[i]);
        }
    }

    let mut costate = terminal_gradient(problem, work);
    for w in work.iter().rev() {
        for i in 0..2 {
            costate.state[TILT[i]] += w.multiplier[TILT_HIGH + i] - w.multiplier[TILT_LOW + i];
        }
        let linear = with_multipliers(&w.gradient, &w.multiplier);
        for g in input_gradient(&w.columns, &mut costate, &w.state_gradient, &linear) {
            dual = greater(dual, g.abs());
        }
    }
    // Maxima ignore NaN; the sum does not.
    let mean = sum.iter().sum::<f64>() / (INEQUALITIES * work.len()) as f64;
    Residuals {
        primal: greatest(&primal),
        dual: if mean.is_finite() { dual } else { mean },
        gap: greatest(&gap),
        mean,
    }
}

/// Gradient of the terminal cost.
fn terminal_gradient(problem: &Problem, work: &[StageWork]) -> ValueGradient {
    let last = &work[work.len() - 1].at;
    let x = std::array::from_fn(|i| last.state[i] - problem.terminal_state_reference[i]);
    let u = std::array::from_fn(|j| last.input[j] - problem.terminal_input_reference[j]);
    let (state, input) = problem.terminal.gradient(&x, &u);
    let mut gradient = ValueGradient { state: Row::default(), input };
    gradient.state[..STATES].copy_from_slice(&state);
    gradient
}

/// One step of Mehrotra's method.
fn iterate(problem: &Problem, work: &mut [StageWork], mean: f64) -> Option<()> {
    factorise(problem, work)?;
    let terminal = terminal_gradient(problem, work);
    for w in work.iter_mut() {
        w.target = [0.0; INEQUALITIES];
    }
    let affine = newton_step(problem, work, terminal);
    // The mean product after the affine step, in which λ ds + s dλ = -s λ.
    let count = (INEQUALITIES * work.len()) as f64;
    let (primal, dual) = (affine.primal, affine.dual);
    let after = (1.0 - dual) * mean
        + ((primal - dual) * affine.slack_products + primal * dual * affine.products) / count;
    let ratio = (after / mean).max(0.0);
    let target = ratio * ratio * mean;
    for w in work.iter_mut() {
        for i in 0..INEQUALITIES {
            w.target[i] = target - w.slack_step[i] * w.multiplier_step[i];
        }
    }
    // One length for both: with two, the gradient of a quadratic program would not decrease.
    let step = newton_step(problem, work, terminal);
    let length = step.primal.min(step.dual);
    for w in work.iter_mut() {
        for i in 0..INEQUALITIES {
            w.slack[i] += length * w.slack_step[i];
            w.multiplier[i] += length * w.multiplier_step[i];
        }
        for j in 0..INPUTS {
            w.at.input[j] += length * w.step.input[j];
        }
        for i in 0..w.at.state.len() {
            w.at.state[i] += length * w.step.state[i];
        }
        for i in 0..2 {
            w.at.slack[i] += length * w.step.slack[i];
        }
    }
    Some(())
}

/// Riccati recursion with the weights of this iterate.
fn factorise(problem: &Problem, work: &mut [StageWork]) -> Option<()> {
    let mut value = ValueFunction::default();
    for k in (0..work.len()).rev() {
        let stage = &problem.stages[k];
        let w = &mut work[k];
        let mut weight = [0.0; INEQUALITIES];
        for i in 0..INEQUALITIES {
            weight[i] = w.multiplier[i] * w.reciprocal[i];
        }
        for j in 0..INPUTS {
            w.weight.input[j] = stage.input_weight[j] + weight[INPUT_LOW + j] + weight[INPUT_HIGH + j];
            w.weight.change[j] = stage.change_weight[j] + weight[CHANGE_LOW + j] + weight[CHANGE_HIGH + j];
        }
        // The state that this stage leads to: weights of the next stage, and tilt limits without their slack.
        let mut tilt = [0.0; STATES];
        for i in 0..2 {
            let (high, low) = (weight[TILT_HIGH + i], weight[TILT_LOW + i]);
            let rest = problem.tilt_quadratic_cost + weight[SLACK + i];
            let curvature = high + low + rest;
            w.flexibility[i] = 1.0 / curvature;
            w.coupling[i] = (low - high) / curvature;
            tilt[TILT[i]] = (4.0 * high * low + (high + low) * rest) / curvature;
        }
        if let Some(next) = work.get_mut(k + 1) {
            next.weight.state = problem.stages[k + 1].state_weight;
            for i in TILT {
                next.weight.state[i] += tilt[i];
            }
            next.policy.value_before(&next.columns, &mut value, &next.weight);
        } else {
            value = ValueFunction::terminal(&problem.terminal, &tilt);
        }
        let w = &mut work[k];
        w.policy.factorise(&w.columns, &value, &w.weight)?;
    }
    Some(())
}

/// Length and products of a Newton step.
#[derive(Clone, Copy, Debug)]
struct NewtonStep {
    /// Greatest part of the step, at most one, that leaves all slacks positive.
    primal: f64,
    /// The same for the multipliers.
    dual: f64,
    /// Sum of slack step times multiplier.
    slack_products: f64,
    /// Sum of slack step times multiplier step.
    products: f64,
}

/// Newton's step towards the targets of the products.
fn newton_step(problem: &Problem, work: &mut [StageWork], terminal: ValueGradient) -> NewtonStep {
    let mut gradient = terminal;
    for w in work.iter_mut().rev() {
        // Multipliers after the step, for an unchanged z.
        let mut m = [0.0; INEQUALITIES];
        for i in 0..INEQUALITIES {
            m[i] = (w.multiplier[i] * w.residual[i] + w.target[i]) * w.reciprocal[i];
        }
        for i in 0..2 {
            let slack = problem.tilt_linear_cost + problem.tilt_quadratic_cost * w.at.slack[i]
                - (m[TILT_HIGH + i] + m[TILT_LOW + i] + m[SLACK + i]);
            gradient.state[TILT[i]] += m[TILT_HIGH + i] - m[TILT_LOW + i] - w.coupling[i] * slack;
            w.step.slack[i] = -slack * w.flexibility[i];
        }
        let linear = with_multipliers(&w.gradient, &m);
        w.policy.gradient_before(&w.columns, &mut gradient, &w.state_gradient, &linear, &w.weight.change);
    }

    let mut state = Row::default();
    let mut previous = [0.0; INPUTS];
    let (mut primal, mut dual) = ([STEP_SHARE; INEQUALITIES], [STEP_SHARE; INEQUALITIES]);
    let (mut slack_products, mut products) = ([0.0; INEQUALITIES], [0.0; INEQUALITIES]);
    for w in work {
        let input = w.policy.input(&state, &previous);
        state = w.columns.step(&state, &input);
        w.step.input = input;
        w.step.state = state;
        for i in 0..2 {
            w.step.slack[i] -= w.coupling[i] * state[TILT[i]];
        }
        let left = left_sides(&w.step, &previous);
        for i in 0..INEQUALITIES {
            let slack_step = -w.residual[i] - left[i];
            let multiplier_step =
                (w.target[i] - w.multiplier[i] * slack_step) * w.reciprocal[i] - w.multiplier[i];
            w.slack_step[i] = slack_step;
            w.multiplier_step[i] = multiplier_step;
            products[i] += slack_step * multiplier_step;
            slack_products[i] += slack_step * w.multiplier[i];
            primal[i] = greater(primal[i], -slack_step * w.reciprocal[i]);
            dual[i] = greater(dual[i], -multiplier_step / w.multiplier[i]);
        }
        previous = input;
    }
    NewtonStep {
        primal: STEP_SHARE / greatest(&primal),
        dual: STEP_SHARE / greatest(&dual),
        slack_products: slack_products.iter().sum(),
        products: products.iter().sum(),
    }
}

/// The greatest of values that are not negative.
fn greatest(values: &PerInequality) -> f64 {
    values.iter().fold(0.0, |a, &b| greater(a, b))
}

/// The greater of two; the first if the second is NaN. One instruction, unlike `max`.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// The solution from the last iterate: inputs inside their limits, and the states that follow from them.
fn write_solution(problem: &Problem, limits: &InputLimits, work: &[StageWork], solution: &mut Solution) {
    for (input, w) in solution.inputs.iter_mut().zip(work) {
        *input = w.at.input;
    }
    limits.enforce(problem.length, &mut solution.inputs);
    problem.roll_out(&solution.inputs, &mut solution.states);
    solution.feedback = work[0].policy.state_feedback();
}
