//! The quadratic program of predictive control, and its solution.
//!
//! Over stages k = 0 … N-1 with x₀ and u₋₁ given, minimise
//!
//! ```text
//! Σ  ½ (xₖ - x̄ₖ)ᵀ Qₖ (xₖ - x̄ₖ) + ½ (uₖ - ūₖ)ᵀ Rₖ (uₖ - ūₖ) + ½ (uₖ - uₖ₋₁)ᵀ Sₖ (uₖ - uₖ₋₁)
//! + ½ [x_N - x̄_N; u_N₋₁ - ū_N]ᵀ P [x_N - x̄_N; u_N₋₁ - ū_N]  +  Σ  l₁ s + ½ l₂ s²
//!
//! xₖ₊₁ = Aₖ xₖ + Bₖ uₖ + cₖ
//! input_min ≤ uₖ ≤ input_max,   |uₖ - uₖ₋₁| ≤ change_max
//! tilt_min - s ≤ xₖ[TILT] ≤ tilt_max + s,  s ≥ 0      for k = 1 … N
//! ```
//!
//! with Q, R, S diagonal. The tilt limits being soft, a program has a solution as soon as the limits of the
//! input leave one; [`Problem::consistent_limits`] resolves contradictions among those.

use super::model::{CostToGo, INPUTS, Linear, STATES, dot};

/// Greatest number of stages.
pub const MAX_STAGES: usize = 30;
/// Indices of the two states with soft limits.
pub const TILT: [usize; 2] = [6, 7];

/// Bound of every number of a program: a billion after scaling is a mistake, and its
/// products with others must not overflow. A limit of a thousand is as good as none.
pub const GREATEST: f64 = 1e9;
/// Least distance of opposite limits of an input: an interior point needs an interior.
pub const LEAST_WIDTH: f64 = 1e-5;

/// Soft limits of the two tilt states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Lower limits.
    pub min: [f64; 2],
    /// Upper limits.
    pub max: [f64; 2],
}

impl Tilt {
    /// Practically no limit.
    pub const FREE: Self = Self { min: [-1e3; 2], max: [1e3; 2] };
}

/// One stage: the costs of state and input at its beginning, the model to the next stage, limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// A and B from this stage to the next.
    pub model: Linear,
    /// The constant c of the model.
    pub offset: [f64; STATES],
    /// Diagonal of Q. Without effect on stage 0, whose state is given.
    pub state_weight: [f64; STATES],
    /// x̄.
    pub state_reference: [f64; STATES],
    /// Diagonal of R.
    pub input_weight: [f64; INPUTS],
    /// ū.
    pub input_reference: [f64; INPUTS],
    /// Diagonal of S, on the change from the input before.
    pub change_weight: [f64; INPUTS],
    /// Lower limits of the input.
    pub input_min: [f64; INPUTS],
    /// Upper limits of the input.
    pub input_max: [f64; INPUTS],
    /// Greatest change from the input before; stage 0 counts from `previous_input`.
    pub change_max: [f64; INPUTS],
    /// Soft limits of the state at this stage; without effect on stage 0.
    pub tilt: Tilt,
}

impl Default for Stage {
    fn default() -> Self {
        Self {
            model: Linear::default(),
            offset: [0.0; STATES],
            state_weight: [0.0; STATES],
            state_reference: [0.0; STATES],
            input_weight: [1.0; INPUTS],
            input_reference: [0.0; INPUTS],
            change_weight: [0.0; INPUTS],
            input_min: [-1e3; INPUTS],
            input_max: [1e3; INPUTS],
            change_max: [1e3; INPUTS],
            tilt: Tilt::FREE,
        }
    }
}

/// One quadratic program. Large (70 kB): keep it in a box and reuse it.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Stages in use, at most [`MAX_STAGES`].
    pub length: usize,
    /// The stages; those from `length` on are ignored.
    pub stages: [Stage; MAX_STAGES],
    /// Cost at the end.
    pub terminal: CostToGo,
    /// x̄ at the end.
    pub terminal_state_reference: [f64; STATES],
    /// ū at the end.
    pub terminal_input_reference: [f64; INPUTS],
    /// Soft limits of the last state.
    pub terminal_tilt: Tilt,
    /// Linear cost l₁ of leaving the tilt limits: more than the limit is worth, and it holds exactly.
    pub tilt_linear_cost: f64,
    /// Quadratic cost l₂ of leaving them.
    pub tilt_quadratic_cost: f64,
    /// x₀.
    pub initial_state: [f64; STATES],
    /// u₋₁, the input in force.
    pub previous_input: [f64; INPUTS],
}

impl Default for Problem {
    fn default() -> Self {
        Self {
            length: MAX_STAGES,
            stages: [Stage::default(); MAX_STAGES],
            terminal: CostToGo::default(),
            terminal_state_reference: [0.0; STATES],
            terminal_input_reference: [0.0; INPUTS],
            terminal_tilt: Tilt::FREE,
            tilt_linear_cost: 50.0,
            tilt_quadratic_cost: 200.0,
            initial_state: [0.0; STATES],
            previous_input: [0.0; INPUTS],
        }
    }
}

/// Exit status of a solver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// Optimal to the tolerance asked for.
    Solved,
    /// The best iterate when the iterations ran out: inside all limits, and as good as its residuals say.
    IterationLimit,
    /// The program is not sound (not finite, too large, wrong sign) or the arithmetic broke down. Nothing
    /// else in the answer is to be used.
    #[default]
    NumericalFailure,
}

/// Stopping rule of a solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Greatest number of iterations.
    pub iterations: usize,
    /// Allowed violation of constraints, gradient of the Lagrangian, and slack times multiplier.
    pub tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { iterations: 15, tolerance: 1e-6 }
    }
}

/// Solution of a program. Unless the status is a failure, the inputs keep their limits exactly.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Exit status.
    pub status: Status,
    /// u₀ … u_N₋₁; zero beyond.
    pub inputs: [[f64; INPUTS]; MAX_STAGES],
    /// x₀ … x_N as the model predicts them from the inputs; zero beyond.
    pub states: [[f64; STATES]; MAX_STAGES + 1],
    /// Change of u₀ with x₀, du₀/dx₀, from the last factorisation. Limits that hold an input make its row
    /// vanish.
    pub feedback: [[f64; STATES]; INPUTS],
    /// Iterations taken.
    pub iterations: usize,
    /// Greatest violation of a constraint with its slack.
    pub primal_residual: f64,
    /// Greatest component of the Lagrangian's gradient.
    pub dual_residual: f64,
    /// Greatest product of a slack with its multiplier.
    pub gap: f64,
}

impl Default for Solution {
    fn default() -> Self {
        Self {
            status: Status::NumericalFailure,
            inputs: [[0.0; INPUTS]; MAX_STAGES],
            states: [[0.0; STATES]; MAX_STAGES + 1],
            feedback: [[0.0; STATES]; INPUTS],
            iterations: 0,
            primal_residual: f64::INFINITY,
            dual_residual: f64::INFINITY,
            gap: f64::INFINITY,
        }
    }
}

/// Limits of the inputs for which a program has a strictly feasible point.
#[derive(Clone, Debug)]
pub struct InputLimits {
    /// u₋₁ inside the limits of stage 0.
    pub previous_input: [f64; INPUTS],
    /// Lower limits, stage by stage.
    pub min: [[f64; INPUTS]; MAX_STAGES],
    /// Upper limits.
    pub max: [[f64; INPUTS]; MAX_STAGES],
    /// Greatest changes.
    pub change: [[f64; INPUTS]; MAX_STAGES],
}

impl Default for InputLimits {
    fn default() -> Self {
        Self {
            previous_input: [0.0; INPUTS],
            min: [[0.0; INPUTS]; MAX_STAGES],
            max: [[0.0; INPUTS]; MAX_STAGES],
            change: [[0.0; INPUTS]; MAX_STAGES],
        }
    }
}

impl InputLimits {
    /// Clamps inputs that exceed the limits by rounding.
    pub(crate) fn enforce(&self, length: usize, inputs: &mut [[f64; INPUTS]; MAX_STAGES]) {
        let mut previous = self.previous_input;
        for k in 0..length {
            for j in 0..INPUTS {
                let least = (previous[j] - self.change[k][j]).max(self.min[k][j]);
                let most = (previous[j] + self.change[k][j]).min(self.max[k][j]);
                inputs[k][j] = inputs[k][j].max(least).min(most);
            }
            previous = inputs[k];
        }
    }
}

impl Problem {
    /// The stages in use.
    pub fn stages(&self) -> &[Stage] {
        &self.stages[..self.length.min(MAX_STAGES)]
    }

    /// Tilt limits of the state that a stage leads to.
    pub fn tilt_after(&self, stage: usize) -> &Tilt {
        self.stages().get(stage + 1).map_or(&self.terminal_tilt, |next| &next.tilt)
    }

    /// Whether a solver accepts it: at least one stage, numbers finite and not greater than [`GREATEST`],
    /// input weights positive, the other weights and the changes not negative, tilt limits in order.
    pub fn is_sound(&self) -> bool {
        let bounded = |values: &[f64]| values.iter().all(|x| x.abs() <= GREATEST);
        let weight = |values: &[f64]| values.iter().all(|x| (0.0..=GREATEST).contains(x));
        let ordered = |t: &Tilt| {
            bounded(&t.min) && bounded(&t.max) && t.min.iter().zip(&t.max).all(|(low, high)| low <= high)
        };
        let stage = |s: &Stage| {
            bounded(s.model.a.as_flattened())
                && bounded(s.model.b.as_flattened())
                && bounded(&s.offset)
                && weight(&s.state_weight)
                && bounded(&s.state_reference)
                && weight(&s.input_weight)
                && s.input_weight.iter().all(|&r| r > 0.0)
                && bounded(&s.input_reference)
                && weight(&s.change_weight)
                && bounded(&s.input_min)
                && bounded(&s.input_max)
                && weight(&s.change_max)
                && ordered(&s.tilt)
        };
        (1..=MAX_STAGES).contains(&self.length)
            && self.stages().iter().all(stage)
            && bounded(self.terminal.state.as_flattened())
            && bounded(self.terminal.cross.as_flattened())
            && bounded(self.terminal.input.as_flattened())
            && bounded(&self.terminal_state_reference)
            && bounded(&self.terminal_input_reference)
            && ordered(&self.terminal_tilt)
            && weight(&[self.tilt_linear_cost, self.tilt_quadratic_cost])
            && bounded(&self.initial_state)
            && bounded(&self.previous_input)
    }

    /// Limits of the inputs with contradictions resolved; without contradiction they are those of the
    /// program.
    ///
    /// Limits of the input go before limits of its change: an input in force outside its limits counts as
    /// standing on the nearest, and a change that could not reach the next interval is widened until it
    /// can. Limits closer than [`LEAST_WIDTH`], or in the wrong order, are moved apart about their mean. A
    /// sequence inside the limits exists if and only if the interval reachable from the stages before,
    /// carried from stage to stage, is nowhere empty.
    pub fn consistent_limits(&self, limits: &mut InputLimits) {
        limits.previous_input = self.input_in_force();
        for j in 0..INPUTS {
            let (mut low, mut high) = (limits.previous_input[j], limits.previous_input[j]);
            for (k, stage) in self.stages().iter().enumerate() {
                let (min, max) = separated(stage.input_min[j], stage.input_max[j]);
                // At least so much that the interval reachable at this stage has the least width.
                let reach = (min - high).max(low - max) + 0.5 * LEAST_WIDTH;
                let change = stage.change_max[j].max(0.5 * LEAST_WIDTH).max(reach);
                (low, high) = ((low - change).max(min), (high + change).min(max));
                limits.min[k][j] = min;
                limits.max[k][j] = max;
                limits.change[k][j] = change;
            }
        }
    }

    /// The states that the model predicts from the initial state under the inputs.
    pub(crate) fn roll_out(
        &self,
        inputs: &[[f64; INPUTS]; MAX_STAGES],
        states: &mut [[f64; STATES]; MAX_STAGES + 1],
    ) {
        *states = [[0.0; STATES]; MAX_STAGES + 1];
        states[0] = self.initial_state;
        for (k, stage) in self.stages().iter().enumerate() {
            states[k + 1] = stage.model.step(&states[k], &inputs[k]);
            for (x, c) in states[k + 1].iter_mut().zip(&stage.offset) {
                *x += c;
            }
        }
    }

    /// Cost of inputs and the states that the model predicts from them; changes count from the input in
    /// force.
    pub fn cost(
        &self,
        inputs: &[[f64; INPUTS]; MAX_STAGES],
        states: &[[f64; STATES]; MAX_STAGES + 1],
    ) -> f64 {
        let weighed = |weights: &[f64], x: &[f64], reference: &[f64]| -> f64 {
            weights.iter().zip(x.iter().zip(reference)).map(|(w, (x, r))| 0.5 * w * (x - r) * (x - r)).sum()
        };
        let left = |tilt: &Tilt, state: &[f64; STATES]| -> f64 {
            (0..2)
                .map(|i| {
                    let x = state[TILT[i]];
                    let s = (x - tilt.max[i]).max(tilt.min[i] - x).max(0.0);
                    (self.tilt_linear_cost + 0.5 * self.tilt_quadratic_cost * s) * s
                })
                .sum()
        };
        let n = self.stages().len();
        let mut cost = left(&self.terminal_tilt, &states[n]);
        let mut previous = self.input_in_force();
        for (k, stage) in self.stages().iter().enumerate() {
            cost += weighed(&stage.state_weight, &states[k], &stage.state_reference)
                + weighed(&stage.input_weight, &inputs[k], &stage.input_reference)
                + weighed(&stage.change_weight, &inputs[k], &previous);
            if k > 0 {
                cost += left(&stage.tilt, &states[k]);
            }
            previous = inputs[k];
        }
        let x: [f64; STATES] = std::array::from_fn(|i| states[n][i] - self.terminal_state_reference[i]);
        let u: [f64; INPUTS] = std::array::from_fn(|j| previous[j] - self.terminal_input_reference[j]);
        let (px, pu) = self.terminal.gradient(&x, &u);
        cost + 0.5 * (dot(&x, &px) + dot(&u, &pu))
    }

    /// u₋₁, on the nearest limit of stage 0 where it stands outside.
    fn input_in_force(&self) -> [f64; INPUTS] {
        std::array::from_fn(|j| {
            let (min, max) = separated(self.stages[0].input_min[j], self.stages[0].input_max[j]);
            self.previous_input[j].clamp(min, max)
        })
    }
}

/// Limits moved at least [`LEAST_WIDTH`] apart.
fn separated(min: f64, max: f64) -> (f64, f64) {
    if max - min >= LEAST_WIDTH {
        return (min, max);
    }
    let middle = 0.5 * (min + max);
    (middle - 0.5 * LEAST_WIDTH, middle + 0.5 * LEAST_WIDTH)
}
