//! Optimal guidance by lossless convexification: a least-fuel motion of the point mass under the engine's thrust
//! band, found in a few milliseconds by a second-order cone program, or the next best motion if there is none.
//!
//! ```text
//! Problem ─► flight time (bisection) ─► transcription ─► conic solver ─► gate ─► Trajectory
//!                                                                        │ not accepted
//!            ladder: previous plan ─► wider glide slope ─► beside the target ─► quintic ─► ramps
//! ```
//!
//! [`plan`] is a pure function of its arguments and always returns a motion; [`Plan::rung`] says which. Its
//! cost is bounded by the number of solves and their greatest number of iterations, never by a clock.

mod closed_form;
pub mod conic;
pub mod flight_time;
pub mod gate;
mod ladder;
mod problem;
mod transcription;

use super::trajectory::Trajectory;
use crate::time::SimTime;
use conic::{Accuracy, Solution, Status};
pub use flight_time::Effort;
use gate::{Passed, Rejection};
pub use ladder::plan;
pub use problem::{Engine, GlideSlope, Limits, Problem, Refusal, Start, THRUST_FLOOR_SHARE, Target};
pub use transcription::{Motion, Objective, program};

/// What to plan, and what is being flown meanwhile.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanRequest {
    /// The problem, its start at `start`.
    pub problem: Problem,
    /// Time at which the plan begins.
    pub start: SimTime,
    /// Heading to hold (rad).
    pub heading_rad: f64,
    /// The motion that is being flown.
    pub previous: Option<Trajectory>,
}

/// How to plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Accuracy of the solver on the plan.
    pub tolerance: f64,
    /// Iterations of the solver in each program; 0 shuts the optimal rungs.
    pub iterations_max: u32,
    /// Nodes of the programs that search the flight time.
    pub search_nodes: usize,
    /// Accuracy of the flight time (s).
    pub search_tolerance_s: f64,
    /// Flight time over the least one.
    pub flight_time_share: f64,
}

impl Settings {
    /// For flight.
    pub const FLIGHT: Self = Self {
        tolerance: 1e-6,
        iterations_max: 40,
        search_nodes: 20,
        search_tolerance_s: 0.1,
        flight_time_share: 1.2,
    };

    /// For proofs: the solver as accurate as it gets.
    pub const PROOF: Self = Self { tolerance: 1e-8, ..Self::FLIGHT };

    /// When the solver stops on a plan.
    pub fn accuracy(&self) -> Accuracy {
        let (tolerance, iterations_max) = (self.tolerance, self.iterations_max);
        Accuracy { feasibility: tolerance, gap: tolerance, iterations_max }
    }
}

/// Where a plan comes from, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// Least fuel, within all limits.
    Optimal,
    /// The previous plan, young and still close.
    Previous,
    /// Least fuel, within a wider glide slope.
    WideGlideSlope,
    /// Beside the target, as little as can be, within the wider glide slope.
    LandingError,
    /// A polynomial of fifth order that keeps thrust band and tilt limit.
    Quintic,
    /// Straight down or up by ramps: always there, whatever it can keep.
    Ramp,
    /// Numbers are missing: stand still.
    Hold,
}

impl Rung {
    /// All of them, best first: the index in counters is `rung as usize`.
    pub const ALL: [Self; 7] = [
        Self::Optimal,
        Self::Previous,
        Self::WideGlideSlope,
        Self::LandingError,
        Self::Quintic,
        Self::Ramp,
        Self::Hold,
    ];

    /// Name in events and logs.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Optimal => "optimal",
            Self::Previous => "previous",
            Self::WideGlideSlope => "wide_glide_slope",
            Self::LandingError => "landing_error",
            Self::Quintic => "quintic",
            Self::Ramp => "ramp",
            Self::Hold => "hold",
        }
    }
}

/// What is to be flown, and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The motion.
    pub trajectory: Trajectory,
    /// Its rung of the ladder.
    pub rung: Rung,
    /// Time from its beginning to its end (s).
    pub flight_time_s: f64,
    /// Least time in which the problem can be flown (s), of optimal rungs.
    pub least_time_s: Option<f64>,
    /// Propellant it burns (kg), of optimal rungs.
    pub fuel_kg: Option<f64>,
    /// What the gate measured, of optimal rungs.
    pub passed: Option<Passed>,
    /// Solves and iterations of all rungs tried.
    pub effort: Effort,
    /// Why the problem was not put to the solver.
    pub refusal: Option<Refusal>,
    /// Why the best answer did not pass the gate.
    pub rejection: Option<Rejection>,
}

/// Solves a problem over one flight time (s) and puts the answer before the gate.
pub fn solve(problem: &Problem, objective: Objective, flight_time_s: f64, accuracy: Accuracy) -> Answer {
    let solution = conic::solve(&program(problem, objective, flight_time_s), accuracy);
    if solution.status != Status::Solved {
        let verdict = Err(Rejection::NotSolved(solution.status));
        return Answer { solution, motion: None, verdict };
    }
    let motion = Motion::new(problem, flight_time_s, &solution.x);
    let verdict = gate::check(problem, objective, &motion);
    Answer { solution, motion: Some(motion), verdict }
}

/// What the solver found over one flight time.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Of the solver.
    pub solution: Solution,
    /// As a motion, if solved.
    pub motion: Option<Motion>,
    /// Of the gate.
    pub verdict: Result<Passed, Rejection>,
}
