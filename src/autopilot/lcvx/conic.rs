//! Second-order cone programs, and the interior-point solver behind them.
//!
//! Least q·x subject to A x + s = b, s in a product of cones: zeros, then nonnegative numbers, then
//! second-order cones. The solver is Clarabel (Goulart and Chen, "Clarabel: An interior-point solver for
//! conic programs with quadratic objectives", 2024) with its QDLDL factorisation on one thread. Its iterative
//! refinement is off: the iterates agree and it would cost half of the time. Without a limit in time the
//! answer depends on the data alone.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};

/// A set of rows, `terms · x + s = right`, of one kind of cone.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    entries: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
}

impl Rows {
    /// Adds a row. Columns may not repeat; a zero is kept, so that the pattern does not depend on values.
    pub(super) fn push(&mut self, terms: &[(usize, f64)], right: f64) {
        let row = self.right.len();
        self.entries.extend(terms.iter().map(|&(column, value)| (row, column, value)));
        self.right.push(right);
    }
}

/// A program in compressed columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// Cost of each variable.
    pub cost: Vec<f64>,
    /// Start of each column in `rows` and `values`, and their length at the end.
    pub column_starts: Vec<usize>,
    /// Row of each entry, rising within a column.
    pub rows: Vec<usize>,
    /// Value of each entry.
    pub values: Vec<f64>,
    /// Right side b.
    pub right: Vec<f64>,
    /// Leading rows whose slack is zero.
    pub equalities: usize,
    /// Rows after them whose slack is not negative.
    pub inequalities: usize,
    /// Sizes of the second-order cones that follow, each (t, y) with t ≥ |y|.
    pub cones: Vec<usize>,
}

impl Program {
    pub(super) fn new(
        cost: Vec<f64>,
        equalities: Rows,
        inequalities: Rows,
        conic: Rows,
        cones: Vec<usize>,
    ) -> Self {
        let groups = [&equalities, &inequalities, &conic];
        let mut column_starts = vec![0; cost.len() + 1];
        for (_, column, _) in groups.iter().flat_map(|g| &g.entries) {
            column_starts[column + 1] += 1;
        }
        for column in 0..cost.len() {
            column_starts[column + 1] += column_starts[column];
        }
        let mut next = column_starts.clone();
        let count = column_starts[cost.len()];
        let (mut rows, mut values, mut right) = (vec![0; count], vec![0.0; count], Vec::new());
        for group in groups {
            for &(row, column, value) in &group.entries {
                rows[next[column]] = right.len() + row;
                values[next[column]] = value;
                next[column] += 1;
            }
            right.extend_from_slice(&group.right);
        }
        let (equalities, inequalities) = (equalities.right.len(), inequalities.right.len());
        Self { cost, column_starts, rows, values, right, equalities, inequalities, cones }
    }

    fn is_finite(&self) -> bool {
        [&self.cost, &self.values, &self.right].iter().all(|v| v.iter().all(|x| x.is_finite()))
    }

    fn matrix(&self) -> CscMatrix<f64> {
        CscMatrix::new(
            self.right.len(),
            self.cost.len(),
            self.column_starts.clone(),
            self.rows.clone(),
            self.values.clone(),
        )
    }

    fn cone_types(&self) -> Vec<SupportedConeT<f64>> {
        let mut types = vec![
            SupportedConeT::ZeroConeT(self.equalities),
            SupportedConeT::NonnegativeConeT(self.inequalities),
        ];
        types.extend(self.cones.iter().map(|&size| SupportedConeT::SecondOrderConeT(size)));
        types
    }
}

/// Stopping rule of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// Residuals of constraints and of the dual, relative to the data.
    pub feasibility: f64,
    /// Duality gap, absolute and relative.
    pub gap: f64,
    /// Greatest number of iterations.
    pub iterations_max: u32,
}

/// Exit status of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Optimal to the accuracy asked for.
    Solved,
    /// Certified: no point satisfies the constraints.
    Infeasible,
    /// Stopped at the greatest number of iterations.
    IterationLimit,
    /// Anything else: no progress, numbers that are not finite.
    Failed,
}

/// Solution of a program; the vectors are valid if it is solved.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Exit status.
    pub status: Status,
    /// Iterations taken.
    pub iterations: u32,
    /// Cost at the solution.
    pub cost: f64,
    /// Variables.
    pub x: Vec<f64>,
    /// Slacks, in the cones.
    pub s: Vec<f64>,
    /// Multipliers, in the dual cones.
    pub z: Vec<f64>,
}

/// Solves one program.
pub fn solve(program: &Program, accuracy: Accuracy) -> Solution {
    Solver::new(accuracy).solve(program)
}

/// A solver for programs of one sparsity pattern: ordering and memory are set up once.
pub struct Solver {
    accuracy: Accuracy,
    solver: Option<DefaultSolver<f64>>,
}

impl Solver {
    /// Not set up yet.
    pub fn new(accuracy: Accuracy) -> Self {
        Self { accuracy, solver: None }
    }

    /// Solves a program. A new sparsity pattern sets the solver up again.
    pub fn solve(&mut self, program: &Program) -> Solution {
        let nothing = Vec::new;
        let failed = Solution {
            status: Status::Failed,
            iterations: 0,
            cost: 0.0,
            x: nothing(),
            s: nothing(),
            z: nothing(),
        };
        if !program.is_finite() {
            return failed;
        }
        if !self.solver.as_mut().is_some_and(|solver| update(solver, program)) {
            self.solver = set_up(program, self.accuracy);
        }
        let Some(solver) = &mut self.solver else { return failed };
        solver.solve();
        let found = &solver.solution;
        let status = match found.status {
            SolverStatus::Solved => Status::Solved,
            SolverStatus::PrimalInfeasible => Status::Infeasible,
            SolverStatus::MaxIterations => Status::IterationLimit,
            _ => Status::Failed,
        };
        Solution {
            status,
            iterations: found.iterations,
            cost: found.obj_val,
            x: found.x.clone(),
            s: found.s.clone(),
            z: found.z.clone(),
        }
    }
}

fn set_up(program: &Program, accuracy: Accuracy) -> Option<DefaultSolver<f64>> {
    let settings = DefaultSettings {
        verbose: false,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        iterative_refinement_enable: false,
        presolve_enable: false,
        input_sparse_dropzeros: false,
        equilibrate_enable: true,
        max_iter: accuracy.iterations_max,
        tol_feas: accuracy.feasibility,
        tol_gap_abs: accuracy.gap,
        tol_gap_rel: accuracy.gap,
        ..DefaultSettings::default()
    };
    let variables = program.cost.len();
    DefaultSolver::new(
        &CscMatrix::zeros((variables, variables)),
        &program.cost,
        &program.matrix(),
        &program.right,
        &program.cone_types(),
        settings,
    )
    .ok()
}

/// Replaces the numbers of a program; false if the sparsity pattern is another one.
fn update(solver: &mut DefaultSolver<f64>, program: &Program) -> bool {
    let same = solver.data.A.colptr == program.column_starts && solver.data.A.rowval == program.rows;
    same && solver.update_q(&program.cost).is_ok()
        && solver.update_A(&program.values).is_ok()
        && solver.update_b(&program.right).is_ok()
}
