//! Fixed-step integration of a state that knows how to move along a rate.

/// A state with a rate of the same shape.
pub trait Integrable: Clone {
    /// Time derivative of every component.
    type Rate: Clone;
    /// `self + rate * dt`.
    fn advanced(&self, rate: &Self::Rate, dt_s: f64) -> Self;
    /// Weighted sum `k1 + 2 k2 + 2 k3 + k4`, divided by 6.
    fn rk4_mean(k1: &Self::Rate, k2: &Self::Rate, k3: &Self::Rate, k4: &Self::Rate) -> Self::Rate;
}

/// One step of the classical Runge-Kutta method of fourth order; `f` is given the state and the
/// fraction of the step at which it is evaluated (0, 1/2, 1/2, 1).
pub fn rk4_step<S: Integrable>(state: &S, dt_s: f64, mut f: impl FnMut(&S, f64) -> S::Rate) -> S {
    let k1 = f(state, 0.0);
    rk4_step_from(state, &k1, dt_s, f)
}

/// The same when the rate at the beginning of the step is known; `f` is asked for the other three.
#[inline]
pub(crate) fn rk4_step_from<S: Integrable>(
    state: &S,
    k1: &S::Rate,
    dt_s: f64,
    mut f: impl FnMut(&S, f64) -> S::Rate,
) -> S {
    let k2 = f(&state.advanced(k1, 0.5 * dt_s), 0.5);
    let k3 = f(&state.advanced(&k2, 0.5 * dt_s), 0.5);
    let k4 = f(&state.advanced(&k3, dt_s), 1.0);
    state.advanced(&S::rk4_mean(k1, &k2, &k3, &k4), dt_s)
}
