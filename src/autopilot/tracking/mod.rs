//! Predictive tracking: fifty times a second the optimal inputs for the next second and a half, between
//! solves their feedback, and a ladder of fallbacks.
//!
//! ```text
//! reference ahead ─┐
//! motion ──────────┼→ prediction over the servos' latency → deviation → quadratic program → thrust, gimbal, roll
//! disturbances ────┘                                         (model)     (transcription, mpc)
//! ```
//!
//! Solves are counted on each [`Rung`] of the ladder. The last rung is not here: when [`Tracker::step`] gives
//! nothing, the caller flies the cascaded controller. No plan is flown for longer than [`OLDEST_PLAN_S`].

pub mod model;

pub mod observer;

mod parameters;

mod transcription;

use super::mpc::{self, CostToGo, InfiniteHorizon, MAX_STAGES, Problem, STATES, Solution, Status};
use super::trajectory::Reference;
use crate::frame::Vec3;
pub use model::Control;
use model::{Airframe, ThrustAttitude};
pub use parameters::{TrackingParameters, WEIGHTS};
pub use transcription::TrackerInput;
use transcription::{deviation, fill};

/// Greatest age at which a plan is flown (s).
pub const OLDEST_PLAN_S: f64 = 0.06;
/// Tolerance for rounding in sums of steps (s).
const TIME_ROUNDING_S: f64 = 1e-6;
/// Constant feedback flies for so long without a new plan, then the cascaded controller takes over (s).
const FEEDBACK_TIME_MAX_S: f64 = 0.5;
/// Greatest primal residual of an iterate that may be flown though it is not optimal.
const USABLE_RESIDUAL: f64 = 1e-3;

/// The rung of the ladder that a command comes from, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// Optimal plan of the interior-point solver.
    Solved,
    /// Its last iterate, at the greatest number of iterations.
    Capped,
    /// Plan of the general solver.
    Oracle,
    /// The previous plan, shifted by its age.
    Shifted,
    /// Constant feedback about the reference.
    Feedback,
    /// The cascaded controller, without a plan.
    Cascade,
}

impl Rung {
    /// All of them, best first: the index in counters is `rung as usize`.
    pub const ALL: [Self; 6] =
        [Self::Solved, Self::Capped, Self::Oracle, Self::Shifted, Self::Feedback, Self::Cascade];

    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Capped => "capped",
            Self::Oracle => "oracle",
            Self::Shifted => "shifted",
            Self::Feedback => "feedback",
            Self::Cascade => "cascade",
        }
    }
}

/// State of predictive tracking.
#[derive(Clone, Debug)]
pub struct Tracker {
    problem: Box<Problem>,
    solution: Box<Solution>,
    candidate: Box<Solution>,
    workspace: mpc::Workspace,
    /// Masses (kg) and unconstrained optimal control, full and empty.
    horizons: Option<[(f64, InfiniteHorizon); 2]>,
    since_solve_s: f64,
    /// Age of the plan in `solution` (s); infinite without one.
    plan_age_s: f64,
    rung: Rung,
    counts: [u64; 6],
}

impl Tracker {
    /// For a vehicle that goes from `full` to `empty`.
    pub fn new(p: &TrackingParameters, full: &Airframe, empty: &Airframe, gravity_m_s2: f64) -> Self {
        let horizon = |airframe: &Airframe| {
            let hover = ThrustAttitude::of(Vec3::new(0.0, 0.0, -gravity_m_s2), airframe.mass_kg);
            let stage = model::stage_model(airframe, &hover, Vec3::zeros(), Vec3::zeros(), p.stage_s);
            Some((airframe.mass_kg, mpc::dare(&stage.linear, &p.weights)?))
        };
        let horizons = horizon(full).zip(horizon(empty)).map(|(full, empty)| [full, empty]);
        Self {
            problem: Box::default(),
            solution: Box::default(),
            candidate: Box::default(),
            workspace: mpc::Workspace::default(),
            horizons,
            since_solve_s: f64::INFINITY,
            plan_age_s: f64::INFINITY,
            rung: Rung::Cascade,
            counts: [0; 6],
        }
    }

    /// Discards the plan; the next step solves.
    pub fn reset(&mut self) {
        (self.since_solve_s, self.plan_age_s) = (f64::INFINITY, f64::INFINITY);
    }

    /// Rung of the newest command.
    pub const fn rung(&self) -> Rung {
        self.rung
    }

    /// Solves that ended on each rung, in the order of [`Rung::ALL`].
    pub const fn counts(&self) -> [u64; 6] {
        self.counts
    }

    /// One step. `ahead` gives the reference that many seconds from now. `None`: the cascaded controller
    /// flies.
    pub fn step(
        &mut self,
        p: &TrackingParameters,
        s: &TrackerInput,
        ahead: impl Fn(f64) -> Reference,
        dt_s: f64,
    ) -> Option<Control> {
        self.since_solve_s += dt_s;
        self.plan_age_s += dt_s;
        let latency_s = p.servo.latency_s();
        let now = deviation(p, s, &ahead, latency_s);
        if self.since_solve_s >= p.period_s - 0.5 * dt_s {
            fill(&mut self.problem, p, s, &now, latency_s, &ahead);
            self.problem.terminal = self.terminal_cost(s.airframe.mass_kg);
            self.since_solve_s = 0.0;
            self.rung = self.solve(p);
            self.counts[self.rung as usize] += 1;
        }
        let control = match self.rung {
            Rung::Cascade => None,
            Rung::Feedback => self.constant_feedback(p, s, &now, dt_s),
            _ => Some(self.planned_control(p, &now)),
        }?;
        control.is_finite().then(|| clamp_to_limits(p, s, control, dt_s))
    }

    /// Solves, and goes down the ladder as far as necessary.
    fn solve(&mut self, p: &TrackingParameters) -> Rung {
        let status =
            mpc::interior_point::solve(&self.problem, &p.solver, &mut self.workspace, &mut self.candidate);
        let usable = match status {
            Status::Solved => Some(Rung::Solved),
            Status::IterationLimit
                if self.candidate.primal_residual < USABLE_RESIDUAL && self.candidate.iterations > 0 =>
            {
                Some(Rung::Capped)
            }
            _ => {
                *self.candidate = mpc::oracle::solve_within(&self.problem, &p.fallback_solver);
                if let Some([full, _]) = &self.horizons {
                    // The general solver gives no feedback.
                    self.candidate.feedback = full.1.feedback;
                }
                (self.candidate.status == Status::Solved).then_some(Rung::Oracle)
            }
        };
        if let Some(rung) = usable {
            core::mem::swap(&mut self.solution, &mut self.candidate);
            self.plan_age_s = 0.0;
            return rung;
        }
        // The previous plan must not grow too old before the next solve.
        if self.plan_age_s + p.period_s <= OLDEST_PLAN_S + TIME_ROUNDING_S {
            Rung::Shifted
        } else if self.plan_age_s <= FEEDBACK_TIME_MAX_S && self.horizons.is_some() {
            Rung::Feedback
        } else {
            Rung::Cascade
        }
    }

    /// Cost to go after the horizon, interpolated between full and empty.
    fn terminal_cost(&self, mass_kg: f64) -> CostToGo {
        self.horizons.as_ref().map_or_else(CostToGo::default, |[full, empty]| {
            let span = full.0 - empty.0;
            let u = if span > 0.0 { ((full.0 - mass_kg) / span).clamp(0.0, 1.0) } else { 0.0 };
            interpolate(&full.1.cost, &empty.1.cost, u)
        })
    }

    /// The plan at its present age, corrected by the feedback of its first stage.
    fn planned_control(&self, p: &TrackingParameters, now: &[f64; STATES]) -> Control {
        let plan = &*self.solution;
        let at = (self.plan_age_s / p.stage_s).max(0.0);
        let k = (at as usize).min(MAX_STAGES - 1);
        let share = (at - k as f64).clamp(0.0, 1.0);
        let mut input = plan.inputs[k];
        for (j, row) in plan.feedback.iter().enumerate() {
            for i in 0..STATES {
                let expected = plan.states[k][i] + share * (plan.states[k + 1][i] - plan.states[k][i]);
                input[j] += row[i] * (now[i] - expected);
            }
        }
        Control::from_scaled(&input)
    }

    /// Feedback of the infinite horizon about the reference's trim.
    fn constant_feedback(
        &self,
        p: &TrackingParameters,
        s: &TrackerInput,
        now: &[f64; STATES],
        dt_s: f64,
    ) -> Option<Control> {
        let [(_, horizon), _] = self.horizons.as_ref()?;
        let trim = &self.problem.stages[0].input_reference;
        let previous = s.previous.scaled();
        // The feedback is designed for a whole stage: a step applies its share of the change.
        let share = dt_s / p.stage_s;
        let input = core::array::from_fn(|j| {
            let state: f64 = horizon.feedback[j].iter().zip(now).map(|(k, x)| k * x).sum();
            let off = previous.iter().zip(trim).map(|(u, trim)| u - trim);
            let memory: f64 = horizon.memory[j].iter().zip(off).map(|(m, u)| m * u).sum();
            previous[j] + share * (trim[j] + state + memory - previous[j])
        });
        Some(Control::from_scaled(&input))
    }
}

/// Linear interpolation between two costs.
fn interpolate(a: &CostToGo, b: &CostToGo, share: f64) -> CostToGo {
    let mut out = *a;
    let between = |x: &mut f64, y: &f64| *x += share * (*y - *x);
    out.state.as_flattened_mut().iter_mut().zip(b.state.as_flattened()).for_each(|(x, y)| between(x, y));
    out.cross.as_flattened_mut().iter_mut().zip(b.cross.as_flattened()).for_each(|(x, y)| between(x, y));
    out.input.as_flattened_mut().iter_mut().zip(b.input.as_flattened()).for_each(|(x, y)| between(x, y));
    out
}

/// Clamps a control to limits and rates.
fn clamp_to_limits(p: &TrackingParameters, s: &TrackerInput, c: Control, dt_s: f64) -> Control {
    let (low, high) = (s.thrust_min_n, s.thrust_max_n);
    let (gimbal, step) = (p.gimbal_limit_rad, p.gimbal_rate_rad_s * dt_s);
    let axis = |i: usize| {
        let last = s.previous.gimbal_rad[i];
        c.gimbal_rad[i].clamp(last - step, last + step).clamp(-gimbal, gimbal)
    };
    Control {
        thrust_n: c.thrust_n.clamp(low, high.max(low)),
        gimbal_rad: [axis(0), axis(1)],
        roll_torque_n_m: c.roll_torque_n_m.clamp(-p.roll_torque_n_m, p.roll_torque_n_m),
    }
}
