//! Linear quadratic control with a cost on the change of the input, stage by stage from the end.
//!
//! The state of the recursion is (x, v), v being the input of the stage before. With the value
//! ½ (x, v)ᵀ P (x, v) of the stage after,
//!
//! ```text
//! F = Aᵀ P_xx A,   G = (P_xx B + P_xv)ᵀ A,   M = R + Bᵀ P_xx B + Bᵀ P_xv + P_vx B + P_vv
//! u = (M + S)⁻¹ (S v - G x)
//! P_xx ← Q + F - Gᵀ (M + S)⁻¹ G,   P_xv ← Gᵀ (M + S)⁻¹ S,   P_vv ← S (M + S)⁻¹ M
//! ```
//!
//! S and R are diagonal and may be large where a limit holds (they carry the weights of an interior-point
//! method); P_vv, the parallel sum of S and M, is written as a product for that reason: no difference of
//! large numbers. A and B of a flight vehicle are mostly zeros; products run over the others only,
//! and each is a row operation of fixed length. Source of the recursion: B. D. O. Anderson and J. B. Moore,
//! Optimal Control: Linear Quadratic Methods, 1990, section 2.4, with the state augmented as above.

use super::model::{CostToGo, INPUTS, Linear, STATES, StageCost};

/// A row over the states, padded to an even length.
pub type Row = [f64; STATES + 1];
/// SparseModel of A and B side by side.
const COLUMNS: usize = STATES + INPUTS;

/// Optimal control of a constant model without limits over an infinite horizon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InfiniteHorizon {
    /// Cost to go: solution of the discrete algebraic Riccati equation.
    pub cost: CostToGo,
    /// u = `feedback` x + `memory` v.
    pub feedback: [[f64; STATES]; INPUTS],
    /// Feedback of the input of the stage before; zero where changes cost nothing.
    pub memory: [[f64; INPUTS]; INPUTS],
}

/// Solves the discrete algebraic Riccati equation by running the recursion until it converges (relative
/// change 1e-14); `None` if it does not, as with a mode that no input reaches.
pub fn dare(model: &Linear, cost: &StageCost) -> Option<InfiniteHorizon> {
    let mut model_columns = SparseModel::default();
    model_columns.fill(model);
    let mut value = ValueFunction::default();
    let mut policy = Policy::default();
    for _ in 0..100_000 {
        let before = value.trace();
        policy.factorise(&model_columns, &value, cost)?;
        policy.value_before(&model_columns, &mut value, cost);
        let change = (value.trace() - before).abs();
        if !change.is_finite() {
            return None;
        }
        if change <= 1e-14 * before.abs() {
            return Some(InfiniteHorizon {
                cost: value.cost_to_go(),
                feedback: policy.state_feedback(),
                memory: policy.change,
            });
        }
    }
    None
}

/// A model arranged for the recursion. Products with matrices run over the entries of A and B that are not
/// zero, column by column; products with vectors are dense, since they are too short to profit.
#[derive(Clone, Debug)]
pub struct SparseModel {
    begin: [u8; COLUMNS + 1],
    row: [u8; COLUMNS * STATES],
    entry: [f64; COLUMNS * STATES],
    /// A by rows.
    rows: [Row; STATES],
    /// A by columns.
    columns: [Row; STATES],
    /// B by rows.
    input_rows: [[f64; INPUTS]; STATES],
    /// B by columns.
    input_columns: [Row; INPUTS],
}

impl Default for SparseModel {
    fn default() -> Self {
        Self {
            begin: [0; COLUMNS + 1],
            row: [0; COLUMNS * STATES],
            entry: [0.0; COLUMNS * STATES],
            rows: [Row::default(); STATES],
            columns: [Row::default(); STATES],
            input_rows: [[0.0; INPUTS]; STATES],
            input_columns: [Row::default(); INPUTS],
        }
    }
}

impl SparseModel {
    /// Copies a model.
    pub fn fill(&mut self, model: &Linear) {
        let mut count = 0;
        for column in 0..COLUMNS {
            self.begin[column] = count as u8;
            for row in 0..STATES {
                let entry =
                    if column < STATES { model.a[row][column] } else { model.b[row][column - STATES] };
                if entry != 0.0 {
                    self.row[count] = row as u8;
                    self.entry[count] = entry;
                    count += 1;
                }
            }
        }
        self.begin[COLUMNS] = count as u8;
        self.input_rows = model.b;
        for i in 0..STATES {
            for j in 0..STATES {
                self.rows[i][j] = model.a[i][j];
                self.columns[j][i] = model.a[i][j];
            }
            for j in 0..INPUTS {
                self.input_columns[j][i] = model.b[i][j];
            }
        }
    }

    #[inline(always)]
    fn column(&self, column: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.begin[column] as usize..self.begin[column + 1] as usize;
        // The minimum tells the compiler that a row is in range.
        let rows = self.row[range.clone()].iter().map(|&row| (row as usize).min(STATES - 1));
        rows.zip(self.entry[range].iter().copied())
    }

    /// The rows of a matrix times the entries of one column, added up: a row of Aᵀ M or Bᵀ M.
    #[inline(always)]
    fn combine<const N: usize>(&self, column: usize, matrix: &[[f64; N]; STATES]) -> [f64; N] {
        let mut sum = [0.0; N];
        for (i, entry) in self.column(column) {
            add(&mut sum, entry, &matrix[i]);
        }
        sum
    }

    /// Aᵀ M. Not inlined, so that each row of sums stays in registers.
    #[inline(never)]
    fn transposed_times(&self, matrix: &[Row; STATES], out: &mut [Row; STATES]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = self.combine(j, matrix);
        }
    }

    /// Bᵀ M.
    #[inline(never)]
    fn input_transposed_times(&self, matrix: &[Row; STATES], out: &mut [Row; INPUTS]) {
        for (j, out) in out.iter_mut().enumerate() {
            *out = self.combine(STATES + j, matrix);
        }
    }

    /// A x + B u.
    #[inline(always)]
    pub fn step(&self, x: &Row, u: &[f64; INPUTS]) -> Row {
        let mut next = Row::default();
        for j in 0..INPUTS {
            add(&mut next, u[j], &self.input_columns[j]);
        }
        for j in 0..STATES {
            add(&mut next, x[j], &self.columns[j]);
        }
        next
    }

    /// Aᵀ p.
    #[inline(always)]
    fn transposed_state(&self, p: &Row) -> Row {
        let mut out = Row::default();
        for i in 0..STATES {
            add(&mut out, p[i], &self.rows[i]);
        }
        out
    }

    /// Bᵀ p.
    #[inline(always)]
    fn transposed_input(&self, p: &Row) -> [f64; INPUTS] {
        let mut out = [0.0; INPUTS];
        for i in 0..STATES {
            add(&mut out, p[i], &self.input_rows[i]);
        }
        out
    }
}

/// The cost from a stage on: half this quadratic form in (x, v).
#[derive(Clone, Debug, Default)]
pub struct ValueFunction {
    state: [Row; STATES],
    cross: [[f64; INPUTS]; STATES],
    input: [[f64; INPUTS]; INPUTS],
}

impl ValueFunction {
    /// The value after the last stage: the terminal cost, and more on the diagonal of the state.
    pub fn terminal(cost: &CostToGo, more: &[f64; STATES]) -> Self {
        let mut value = Self { state: [Row::default(); STATES], cross: cost.cross, input: cost.input };
        for i in 0..STATES {
            value.state[i][..STATES].copy_from_slice(&cost.state[i]);
            value.state[i][i] += more[i];
        }
        value
    }

    fn cost_to_go(&self) -> CostToGo {
        let state = std::array::from_fn(|i| std::array::from_fn(|j| self.state[i][j]));
        CostToGo { state, cross: self.cross, input: self.input }
    }

    fn trace(&self) -> f64 {
        (0..STATES).map(|i| self.state[i][i]).sum::<f64>()
            + (0..INPUTS).map(|j| self.input[j][j]).sum::<f64>()
    }
}

/// Gradient of a value at (x, v) = 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct ValueGradient {
    /// In the state.
    pub state: Row,
    /// In the input of the stage before.
    pub input: [f64; INPUTS],
}

/// Linear costs of one stage in its input and in the change of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct InputGradient {
    /// In the input.
    pub input: [f64; INPUTS],
    /// In the change.
    pub change: [f64; INPUTS],
}

/// Control policy of one stage: u = `feed_forward` - `state` x + `change` v.
#[derive(Clone, Debug, Default)]
pub struct Policy {
    /// (M + S)⁻¹ G.
    state: [Row; INPUTS],
    /// (M + S)⁻¹ S.
    change: [[f64; INPUTS]; INPUTS],
    /// (M + S)⁻¹.
    inverse: [[f64; INPUTS]; INPUTS],
    feed_forward: [f64; INPUTS],
    /// M.
    curvature: [[f64; INPUTS]; INPUTS],
    /// L⁻¹ G, with L the lower root of M + S.
    half: [Row; INPUTS],
}

impl Policy {
    /// Optimal policy of one stage, given the value after it. `None`: M + S is not positive definite.
    pub(crate) fn factorise(
        &mut self,
        model: &SparseModel,
        after: &ValueFunction,
        cost: &StageCost,
    ) -> Option<()> {
        // P_xx B + P_xv, by rows of the state.
        let mut through = after.cross;
        let mut turned = [Row::default(); INPUTS];
        model.input_transposed_times(&after.state, &mut turned);
        for i in 0..STATES {
            for c in 0..INPUTS {
                through[i][c] += turned[c][i];
            }
        }
        for c in 0..INPUTS {
            let mut row = after.input[c];
            row[c] += cost.input[c];
            add(&mut row, 1.0, &model.combine(STATES + c, &through));
            self.curvature[c] = row;
        }
        for c in 0..INPUTS {
            let column = model.combine(STATES + c, &after.cross);
            for d in 0..INPUTS {
                self.curvature[d][c] += column[d];
            }
        }
        let root = cholesky(&self.curvature, &cost.change)?;
        // Gᵀ, then G.
        let mut turned = [[0.0; INPUTS]; STATES];
        for j in 0..STATES {
            turned[j] = model.combine(j, &through);
        }
        let mut g = [Row::default(); INPUTS];
        for c in 0..INPUTS {
            for j in 0..STATES {
                g[c][j] = turned[j][c];
            }
        }
        solve(&root, &g, &mut self.half, &mut self.state);
        let mut identity = [[0.0; INPUTS]; INPUTS];
        for c in 0..INPUTS {
            identity[c][c] = 1.0;
        }
        let mut half = identity;
        solve(&root, &identity, &mut half, &mut self.inverse);
        for c in 0..INPUTS {
            for d in 0..INPUTS {
                self.change[c][d] = self.inverse[c][d] * cost.change[d];
            }
        }
        Some(())
    }

    /// Carries the value from after the stage to before it, once the stage is factorised.
    pub(crate) fn value_before(&self, model: &SparseModel, value: &mut ValueFunction, cost: &StageCost) {
        let mut product = [Row::default(); STATES];
        model.transposed_times(&value.state, &mut product);
        let mut turned = [Row::default(); STATES];
        for i in 0..STATES {
            for j in 0..STATES {
                turned[i][j] = product[j][i];
            }
        }
        model.transposed_times(&turned, &mut value.state);
        for j in 0..STATES {
            let row = &mut value.state[j];
            for half in &self.half {
                add(row, -half[j], half);
            }
            row[j] += cost.state[j];
        }
        for i in 0..STATES {
            for c in 0..INPUTS {
                value.cross[i][c] = self.state[c][i] * cost.change[c];
            }
        }
        let mut share = [[0.0; INPUTS]; INPUTS];
        for c in 0..INPUTS {
            for d in 0..INPUTS {
                add(&mut share[c], self.inverse[c][d], &self.curvature[d]);
            }
        }
        for c in 0..INPUTS {
            for d in 0..INPUTS {
                value.input[c][d] = 0.5 * (cost.change[c] * share[c][d] + cost.change[d] * share[d][c]);
            }
        }
    }

    /// Carries the gradient from after the stage to before it, given the linear costs and the weights of
    /// change.
    #[inline(always)]
    pub(crate) fn gradient_before(
        &mut self,
        model: &SparseModel,
        slope: &mut ValueGradient,
        state: &Row,
        linear: &InputGradient,
        change_weight: &[f64; INPUTS],
    ) {
        let mut h = model.transposed_input(&slope.state);
        for c in 0..INPUTS {
            h[c] += linear.input[c] + linear.change[c] + slope.input[c];
        }
        let mut before = model.transposed_state(&slope.state);
        for i in 0..before.len() {
            before[i] += state[i];
        }
        for c in 0..INPUTS {
            add(&mut before, -h[c], &self.state[c]);
        }
        slope.state = before;
        // Symmetric: rows are columns.
        self.feed_forward = [0.0; INPUTS];
        for c in 0..INPUTS {
            add(&mut self.feed_forward, -h[c], &self.inverse[c]);
        }
        for c in 0..INPUTS {
            slope.input[c] = -linear.change[c] - change_weight[c] * self.feed_forward[c];
        }
    }

    /// The input of the stage.
    #[inline(always)]
    pub fn input(&self, x: &Row, v: &[f64; INPUTS]) -> [f64; INPUTS] {
        let mut u = self.feed_forward;
        for c in 0..INPUTS {
            for d in 0..INPUTS {
                u[c] += self.change[c][d] * v[d];
            }
            u[c] -= sum_of_products(&self.state[c], x);
        }
        u
    }

    /// du/dx.
    pub(crate) fn state_feedback(&self) -> [[f64; STATES]; INPUTS] {
        std::array::from_fn(|c| std::array::from_fn(|i| -self.state[c][i]))
    }
}

/// Gradient of the cost in one input, the states and inputs after it taken as they are; carries the costate.
#[inline(always)]
pub(crate) fn input_gradient(
    model: &SparseModel,
    costate: &mut ValueGradient,
    state: &Row,
    linear: &InputGradient,
) -> [f64; INPUTS] {
    let mut gradient = model.transposed_input(&costate.state);
    for c in 0..INPUTS {
        gradient[c] += linear.input[c] + linear.change[c] + costate.input[c];
        costate.input[c] = -linear.change[c];
    }
    costate.state = model.transposed_state(&costate.state);
    for i in 0..costate.state.len() {
        costate.state[i] += state[i];
    }
    gradient
}

#[inline(always)]
fn add<const N: usize>(to: &mut [f64; N], factor: f64, row: &[f64; N]) {
    for i in 0..N {
        to[i] += factor * row[i];
    }
}

/// Two sums side by side, so that they run in one register.
#[inline(always)]
fn sum_of_products(a: &Row, b: &Row) -> f64 {
    let (mut even, mut odd) = (0.0, 0.0);
    for i in 0..a.len() / 2 {
        even += a[2 * i] * b[2 * i];
        odd += a[2 * i + 1] * b[2 * i + 1];
    }
    even + odd
}

/// Lower triangle with reciprocals on its diagonal, of a symmetric matrix with more on its diagonal.
#[inline(always)]
fn cholesky(matrix: &[[f64; INPUTS]; INPUTS], more: &[f64; INPUTS]) -> Option<[[f64; INPUTS]; INPUTS]> {
    let mut l = [[0.0; INPUTS]; INPUTS];
    for j in 0..INPUTS {
        let mut pivot = matrix[j][j] + more[j];
        for k in 0..j {
            pivot -= l[j][k] * l[j][k];
        }
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let reciprocal = 1.0 / pivot.sqrt();
        l[j][j] = reciprocal;
        for i in j + 1..INPUTS {
            let mut x = matrix[i][j];
            for k in 0..j {
                x -= l[i][k] * l[j][k];
            }
            l[i][j] = x * reciprocal;
        }
    }
    Some(l)
}

/// L⁻¹ G and L⁻ᵀ L⁻¹ G, column by column: the loop runs along rows, several columns to a register.
#[inline(always)]
fn solve<const N: usize>(
    l: &[[f64; INPUTS]; INPUTS],
    g: &[[f64; N]; INPUTS],
    half: &mut [[f64; N]; INPUTS],
    full: &mut [[f64; N]; INPUTS],
) {
    let [half0, half1, half2, half3] = half;
    let [full0, full1, full2, full3] = full;
    for j in 0..N {
        let z0 = g[0][j] * l[0][0];
        let z1 = (g[1][j] - l[1][0] * z0) * l[1][1];
        let z2 = (g[2][j] - l[2][0] * z0 - l[2][1] * z1) * l[2][2];
        let z3 = (g[3][j] - l[3][0] * z0 - l[3][1] * z1 - l[3][2] * z2) * l[3][3];
        let k3 = z3 * l[3][3];
        let k2 = (z2 - l[3][2] * k3) * l[2][2];
        let k1 = (z1 - l[3][1] * k3 - l[2][1] * k2) * l[1][1];
        let k0 = (z0 - l[3][0] * k3 - l[2][0] * k2 - l[1][0] * k1) * l[0][0];
        (half0[j], half1[j], half2[j], half3[j]) = (z0, z1, z2, z3);
        (full0[j], full1[j], full2[j], full3[j]) = (k0, k1, k2, k3);
    }
}
