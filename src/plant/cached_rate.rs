//! The rate at the end of a step, which is the first stage of the next one unless something discrete has
//! changed since.

use nalgebra::Quaternion;

use super::discrete_state::{StepInputs, WarmStartPredictor};
use super::{Plant, Rate, State};
use crate::integrator::Integrable;

/// A rate and what it depends on. Not compared: time and wind, which move before the evaluation that ends a
/// step, and [`super::SolverState`]. Whoever changes wind or feed maps afterwards drops the rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct CachedRate {
    pub(super) state: State,
    pub(super) inputs: StepInputs,
    pub(super) rate: Rate,
    /// Where the solver began: for the guard alone, since another start gives other bits.
    pub(super) warm_start: WarmStartPredictor,
}

impl Plant {
    /// Keeps the rate of the present state.
    #[inline(always)]
    pub(super) fn cache_rate(&mut self, rate: &Rate) {
        match &mut self.cached_rate {
            // In place, field by field: it is large.
            Some(cached) => {
                cached.state = self.state;
                cached.inputs = self.inputs;
                cached.rate = *rate;
                cached.warm_start = self.solver.warm_start;
            }
            None => {
                let (state, inputs, warm_start) = (self.state, self.inputs, self.solver.warm_start);
                self.cached_rate = Some(CachedRate { state, inputs, rate: *rate, warm_start });
            }
        }
    }

    /// Rate at the beginning of a step.
    #[inline(always)]
    pub(super) fn first_rate(&mut self) -> Rate {
        match &self.cached_rate {
            Some(cached) if cached.state == self.state && cached.inputs == self.inputs => {
                let CachedRate { rate, warm_start, .. } = *cached;
                debug_assert!(
                    self.fresh_rate_agrees(&rate, warm_start),
                    "the rate is a function of more than state and step inputs"
                );
                rate
            }
            _ => self.rate(&self.state, 0.0),
        }
    }

    /// Whether an evaluation from a warm start gives the same rate to the bit.
    fn fresh_rate_agrees(&mut self, rate: &Rate, warm_start: WarmStartPredictor) -> bool {
        let now = std::mem::replace(&mut self.solver.warm_start, warm_start);
        let fresh = self.rate(&self.state, 0.0);
        self.solver.warm_start = now;
        let zero = State { q_ned_from_body: Quaternion::new(0.0, 0.0, 0.0, 0.0), ..State::EMPTY };
        let [a, b] = [rate, &fresh].map(|rate| zero.advanced(rate, 1.0));
        // Not a number counts as equal.
        !a.numbers().zip(b.numbers()).any(|(a, b)| (a - b).abs() > 0.0)
    }
}
