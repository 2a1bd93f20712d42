//! What a planner is asked, and what it answers.

use super::conic::Accuracy;
use super::flight_time::Effort;
use super::problem::{Problem, Refusal};
use super::verification::{Quality, Rejection};
use crate::autopilot::trajectory::Trajectory;
use crate::time::SimTime;

/// What to plan, and the plan in force.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanRequest {
    /// The problem, its start at `start`.
    pub problem: Problem,
    /// Time at which the plan begins.
    pub start: SimTime,
    /// Heading to hold (rad).
    pub heading_rad: f64,
    /// The trajectory in force.
    pub previous: Option<Trajectory>,
}

/// Settings of the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Tolerance of the solver: residuals and duality gap.
    pub tolerance: f64,
    /// Greatest number of iterations in each program; 0 disables the optimal rungs.
    pub iterations_max: u32,
    /// Nodes of the programs in the search for the flight time.
    pub search_nodes: usize,
    /// Tolerance of the flight time (s).
    pub search_tolerance_s: f64,
    /// Flight time as a multiple of the least one.
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

    /// For proofs: the least tolerance that the solver reaches.
    pub const PROOF: Self = Self { tolerance: 1e-8, ..Self::FLIGHT };

    /// Stopping rule of the solver.
    pub fn accuracy(&self) -> Accuracy {
        let (tolerance, iterations_max) = (self.tolerance, self.iterations_max);
        Accuracy { feasibility: tolerance, gap: tolerance, iterations_max }
    }
}

/// The rung of the ladder that a plan comes from, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// Least fuel, within all limits.
    Optimal,
    /// The previous plan, recent and still close to the vehicle.
    Previous,
    /// Least fuel, within a wider glide slope.
    WideGlideSlope,
    /// Least landing error, within the wider glide slope.
    LandingError,
    /// A polynomial of fifth order that keeps thrust band and tilt limit.
    Quintic,
    /// Straight down or up by ramps: always exists, and may break limits.
    Ramp,
    /// The problem has numbers that are not finite or out of range: hold position.
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

/// A planned trajectory, and how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The trajectory.
    pub trajectory: Trajectory,
    /// Its rung of the ladder.
    pub rung: Rung,
    /// Time from its beginning to its end (s).
    pub flight_time_s: f64,
    /// Least time in which the problem can be flown (s), of optimal rungs.
    pub least_time_s: Option<f64>,
    /// Propellant burnt (kg), of optimal rungs.
    pub fuel_kg: Option<f64>,
    /// Figures of the verification, of optimal rungs.
    pub quality: Option<Quality>,
    /// Solves and iterations on all rungs that were tried.
    pub effort: Effort,
    /// Why the problem was not put to the solver.
    pub refusal: Option<Refusal>,
    /// Why the first solution was rejected.
    pub rejection: Option<Rejection>,
}
