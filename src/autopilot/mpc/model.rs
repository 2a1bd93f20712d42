//! Vocabulary of the solvers: dimensions, the linear model of one stage, quadratic costs.

/// States of the model.
pub const STATES: usize = 13;
/// Inputs of the model.
pub const INPUTS: usize = 4;

/// A linear model from one stage to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Linear {
    /// On the state, by rows.
    pub a: [[f64; STATES]; STATES],
    /// On the input, by rows.
    pub b: [[f64; INPUTS]; STATES],
}

impl Linear {
    /// A x + B u.
    pub fn step(&self, x: &[f64; STATES], u: &[f64; INPUTS]) -> [f64; STATES] {
        std::array::from_fn(|i| {
            let free: f64 = self.a[i].iter().zip(x).map(|(a, x)| a * x).sum();
            free + self.b[i].iter().zip(u).map(|(b, u)| b * u).sum::<f64>()
        })
    }
}

/// Diagonal weights of one stage.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageCost {
    /// Q.
    pub state: [f64; STATES],
    /// R.
    pub input: [f64; INPUTS],
    /// S.
    pub change: [f64; INPUTS],
}

/// A quadratic form in the last state and the last input: what everything after the horizon costs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CostToGo {
    /// On the state; symmetric, positive semidefinite together with the rest.
    pub state: [[f64; STATES]; STATES],
    /// Between state and input; zero where changes of the input cost nothing.
    pub cross: [[f64; INPUTS]; STATES],
    /// On the input; symmetric.
    pub input: [[f64; INPUTS]; INPUTS],
}

impl CostToGo {
    /// Gradient of half the form: P (x, u).
    pub(crate) fn gradient(&self, x: &[f64; STATES], u: &[f64; INPUTS]) -> ([f64; STATES], [f64; INPUTS]) {
        let state = std::array::from_fn(|i| dot(&self.state[i], x) + dot(&self.cross[i], u));
        let input = std::array::from_fn(|j| {
            dot(&self.input[j], u) + self.cross.iter().zip(x).map(|(row, x)| row[j] * x).sum::<f64>()
        });
        (state, input)
    }
}

/// Scalar product of two vectors of one length.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
