//! The same program handed to Clarabel, a general sparse conic solver: the reference in tests, the fallback
//! in flight.
//!
//! It does not exploit stages: one sparse matrix of all equations and inequalities, entries that are zero
//! left out, since its factorisation pays for each. Iterative refinement is off: it doubles the time and
//! changes no digit that matters here. It allocates. Source of the solver: P. Goulart and Y. Chen, Clarabel:
//! An interior-point solver for conic programs with quadratic objectives, arXiv 2405.12762.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT::NonnegativeConeT,
    SupportedConeT::ZeroConeT,
};

use super::model::{INPUTS, STATES};
use super::problem::{InputLimits, Problem, Settings, Solution, Status, TILT};

/// Variables of a stage: its input, the state it leads to, the slack of that state's tilt limits.
const BLOCK: usize = INPUTS + STATES + 2;

/// Solves to a tolerance of residuals and duality gap. The feedback is zero.
pub fn solve(problem: &Problem, tolerance: f64) -> Solution {
    solve_within(problem, &Settings { iterations: 200, tolerance })
}

/// The same with a greatest number of iterations.
pub(crate) fn solve_within(problem: &Problem, settings: &Settings) -> Solution {
    let Settings { iterations, tolerance } = *settings;
    let mut solution = Solution::default();
    if !problem.is_sound() {
        return solution;
    }
    let mut limits = InputLimits::default();
    problem.consistent_limits(&mut limits);
    let program = Program::new(problem, &limits);
    let settings = DefaultSettings {
        verbose: false,
        max_iter: iterations as u32,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        iterative_refinement_enable: false,
        ..DefaultSettings::default()
    };
    let variables = BLOCK * problem.length;
    let cones =
        [ZeroConeT(program.equations), NonnegativeConeT(program.rows.bounds.len() - program.equations)];
    let cost = program.cost.matrix(variables, variables);
    let rows = program.rows.triplets.matrix(program.rows.bounds.len(), variables);
    let Ok(mut solver) =
        DefaultSolver::new(&cost, &program.linear, &rows, &program.rows.bounds, &cones, settings)
    else {
        return solution;
    };
    solver.solve();
    let found = &solver.solution;
    solution.status = match found.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => Status::Solved,
        SolverStatus::MaxIterations | SolverStatus::MaxTime | SolverStatus::InsufficientProgress => {
            Status::IterationLimit
        }
        _ => return solution,
    };
    solution.iterations = found.iterations as usize;
    solution.primal_residual = found.r_prim;
    solution.dual_residual = found.r_dual;
    solution.gap = (found.obj_val - found.obj_val_dual).abs();
    for (k, input) in solution.inputs[..problem.length].iter_mut().enumerate() {
        input.copy_from_slice(&found.x[input_at(k)..input_at(k) + INPUTS]);
    }
    limits.enforce(problem.length, &mut solution.inputs);
    problem.roll_out(&solution.inputs, &mut solution.states);
    if !solution.states.as_flattened().iter().all(|x| x.is_finite()) {
        solution.status = Status::NumericalFailure;
    }
    solution
}

/// Index of the first component of u_k.
fn input_at(k: usize) -> usize {
    BLOCK * k
}

/// Index of the first component of x_k, for k from 1.
fn state_at(k: usize) -> usize {
    BLOCK * (k - 1) + INPUTS
}

/// Index of the first slack of x_k, for k from 1.
fn slack_at(k: usize) -> usize {
    BLOCK * (k - 1) + INPUTS + STATES
}

/// Entries of a sparse matrix; entries at one place are added.
#[derive(Default)]
struct Triplets {
    row: Vec<usize>,
    column: Vec<usize>,
    entry: Vec<f64>,
}

impl Triplets {
    fn push(&mut self, row: usize, column: usize, entry: f64) {
        if entry != 0.0 {
            self.row.push(row);
            self.column.push(column);
            self.entry.push(entry);
        }
    }

    fn matrix(self, rows: usize, columns: usize) -> CscMatrix<f64> {
        CscMatrix::new_from_triplets(rows, columns, self.row, self.column, self.entry)
    }
}

/// Rows of constraints with their right sides.
#[derive(Default)]
struct Rows {
    triplets: Triplets,
    bounds: Vec<f64>,
}

impl Rows {
    fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>, bound: f64) {
        for (column, entry) in entries {
            self.triplets.push(self.bounds.len(), column, entry);
        }
        self.bounds.push(bound);
    }
}

/// ½ zᵀ P z + qᵀ z with the upper triangle of P, under rows of which the first are equations.
struct Program {
    cost: Triplets,
    linear: Vec<f64>,
    rows: Rows,
    equations: usize,
}

impl Program {
    fn new(problem: &Problem, limits: &InputLimits) -> Self {
        let mut program = Self {
            cost: Triplets::default(),
            linear: vec![0.0; BLOCK * problem.length],
            rows: Rows::default(),
            equations: 0,
        };
        program.add_costs(problem, limits);
        program.add_model(problem);
        program.equations = program.rows.bounds.len();
        program.add_limits(problem, limits);
        program
    }

    /// ½ w (z - z̄)².
    fn add_square(&mut self, at: usize, weight: f64, reference: f64) {
        self.cost.push(at, at, weight);
        self.linear[at] -= weight * reference;
    }

    fn add_costs(&mut self, problem: &Problem, limits: &InputLimits) {
        let n = problem.length;
        for (k, stage) in problem.stages().iter().enumerate() {
            for j in 0..INPUTS {
                let at = input_at(k) + j;
                self.add_square(at, stage.input_weight[j], stage.input_reference[j]);
                let weight = stage.change_weight[j];
                if k == 0 {
                    self.add_square(at, weight, limits.previous_input[j]);
                } else {
                    self.cost.push(at, at, weight);
                    self.cost.push(at - BLOCK, at - BLOCK, weight);
                    self.cost.push(at - BLOCK, at, -weight);
                }
            }
            for i in 0..STATES {
                if k > 0 {
                    self.add_square(state_at(k) + i, stage.state_weight[i], stage.state_reference[i]);
                }
            }
            for i in 0..2 {
                let at = slack_at(k + 1) + i;
                self.cost.push(at, at, problem.tilt_quadratic_cost);
                self.linear[at] += problem.tilt_linear_cost;
            }
        }
        // Terminal: the state stands behind the input in the order of the variables.
        let (x, u) = (state_at(n), input_at(n - 1));
        let terminal = &problem.terminal;
        for i in 0..STATES {
            for l in i..STATES {
                self.cost.push(x + i, x + l, terminal.state[i][l]);
            }
            for j in 0..INPUTS {
                self.cost.push(u + j, x + i, terminal.cross[i][j]);
            }
        }
        for j in 0..INPUTS {
            for l in j..INPUTS {
                self.cost.push(u + j, u + l, terminal.input[j][l]);
            }
        }
        let (px, pu) =
            terminal.gradient(&problem.terminal_state_reference, &problem.terminal_input_reference);
        for i in 0..STATES {
            self.linear[x + i] -= px[i];
        }
        for j in 0..INPUTS {
            self.linear[u + j] -= pu[j];
        }
    }

    fn add_model(&mut self, problem: &Problem) {
        for (k, stage) in problem.stages().iter().enumerate() {
            for i in 0..STATES {
                let mut bound = stage.offset[i];
                let mut entries = vec![(state_at(k + 1) + i, 1.0)];
                entries.extend((0..INPUTS).map(|j| (input_at(k) + j, -stage.model.b[i][j])));
                for l in 0..STATES {
                    if k == 0 {
                        bound += stage.model.a[i][l] * problem.initial_state[l];
                    } else {
                        entries.push((state_at(k) + l, -stage.model.a[i][l]));
                    }
                }
                self.rows.push(entries, bound);
            }
        }
    }

    fn add_limits(&mut self, problem: &Problem, limits: &InputLimits) {
        for k in 0..problem.length {
            for j in 0..INPUTS {
                let at = input_at(k) + j;
                self.rows.push([(at, -1.0)], -limits.min[k][j]);
                self.rows.push([(at, 1.0)], limits.max[k][j]);
                let change = limits.change[k][j];
                if k == 0 {
                    self.rows.push([(at, -1.0)], change - limits.previous_input[j]);
                    self.rows.push([(at, 1.0)], change + limits.previous_input[j]);
                } else {
                    self.rows.push([(at - BLOCK, 1.0), (at, -1.0)], change);
                    self.rows.push([(at - BLOCK, -1.0), (at, 1.0)], change);
                }
            }
            let tilt = problem.tilt_after(k);
            for i in 0..2 {
                let (x, s) = (state_at(k + 1) + TILT[i], slack_at(k + 1) + i);
                self.rows.push([(x, 1.0), (s, -1.0)], tilt.max[i]);
                self.rows.push([(x, -1.0), (s, -1.0)], -tilt.min[i]);
                self.rows.push([(s, -1.0)], 0.0);
            }
        }
    }
}
