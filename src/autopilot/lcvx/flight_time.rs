//! The flight time: the least one at which the problem has a solution, found by bisection.
//!
//! A longer flight costs more fuel, because the engine holds the weight for longer: the least-fuel time is the
//! edge of feasibility, and no minimum has to be searched. What is flown takes longer than that, to leave
//! tracking something to work with.

use super::conic::{Accuracy, Solver, Status};
use super::problem::Problem;
use super::transcription::{Objective, program};

/// What solving took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Programs solved, certified infeasible ones included.
    pub solves: u32,
    /// Iterations of the solver in all of them.
    pub iterations: u32,
}

/// How the least flight time is searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Nodes of the programs (1).
    pub nodes: usize,
    /// Accuracy of the answer, always on the feasible side (s).
    pub tolerance_s: f64,
    /// Iterations of the solver.
    pub iterations_max: u32,
}

/// Constraints are met to this; cost hardly matters, because a point is all that is asked for.
const FEASIBILITY: f64 = 1e-6;
/// Duality gap of those points, in units of the program.
const GAP: f64 = 0.1;
/// First step of the search (s), without a guess and with one.
const FIRST_STEP_S: f64 = 1.0;
const GUESSED_STEP_S: f64 = 0.3;
/// Share of the time that the propellant lasts which may be used: the tilt of the thrust costs the rest.
const BUDGET_SHARE: f64 = 0.98;

/// The least flight time at which the problem has a solution (s), to within the tolerance above it.
pub fn least_s(
    problem: &Problem,
    objective: Objective,
    search: &Search,
    guess_s: Option<f64>,
    effort: &mut Effort,
) -> Option<f64> {
    let problem = Problem { nodes: search.nodes, ..*problem };
    let iterations_max = search.iterations_max;
    let mut solver = Solver::new(Accuracy { feasibility: FEASIBILITY, gap: GAP, iterations_max });
    let mut is_feasible = |time_s: f64| {
        let solution = solver.solve(&program(&problem, objective, time_s));
        effort.solves += 1;
        effort.iterations += solution.iterations;
        solution.status == Status::Solved
    };
    let budget_s = budget_s(&problem)?;
    let mut low_s = shortest_s(&problem).min(budget_s);
    let mut step_s = FIRST_STEP_S;
    let mut high_s = None;
    if let Some(guess_s) = guess_s {
        let probe_s = (guess_s - GUESSED_STEP_S).clamp(low_s, budget_s);
        if is_feasible(probe_s) {
            high_s = Some(probe_s);
        } else {
            low_s = probe_s;
            step_s = 2.0 * GUESSED_STEP_S;
        }
    }
    // Outwards until something is feasible, the propellant's last second included.
    while high_s.is_none() {
        if low_s >= budget_s {
            return None;
        }
        let probe_s = (low_s + step_s).min(budget_s);
        if is_feasible(probe_s) {
            high_s = Some(probe_s);
        } else {
            low_s = probe_s;
            step_s *= 2.0;
        }
    }
    let mut high_s = high_s?;
    while high_s - low_s > search.tolerance_s {
        let middle_s = 0.5 * (low_s + high_s);
        if is_feasible(middle_s) {
            high_s = middle_s;
        } else {
            low_s = middle_s;
        }
    }
    Some(high_s)
}

/// The time to fly (s): longer than the least by a share, as far as the propellant lasts.
pub fn flown_s(problem: &Problem, least_s: f64, share: f64) -> f64 {
    (share * least_s).min(budget_s(problem).unwrap_or(least_s)).max(least_s)
}

/// The longest flight that the propellant carries (s). |∫ u dt| = |Δv - g t| can not exceed ∫ σ dt, and all of
/// the propellant gives ln(m₀/m_dry)/α.
fn budget_s(problem: &Problem) -> Option<f64> {
    let (g, engine) = (problem.gravity_m_s2, &problem.engine);
    let most_m_s = libm::log(problem.start.mass_kg / engine.dry_mass_kg) / engine.mass_flow_per_thrust_s_m;
    let change = problem.target.velocity_ned_m_s - problem.start.velocity_ned_m_s;
    let root = change.z * change.z - change.norm_squared() + most_m_s * most_m_s;
    let time_s = BUDGET_SHARE * (change.z + root.sqrt()) / g;
    // Without a root, and with no time left, nothing can be flown: NaN compares false.
    (time_s > 0.0).then_some(time_s)
}

/// A time in which nobody gets there (s), by the speed limits, and not nothing.
fn shortest_s(problem: &Problem) -> f64 {
    let way = problem.target.position_ned_m - problem.start.position_ned_m;
    let limits = &problem.limits;
    let vertical_m_s = if way.z > 0.0 { limits.sink_m_s } else { limits.climb_m_s };
    // Between nodes the speed may exceed its limit a little.
    0.95 * (way.norm() / limits.speed_m_s).max(way.z.abs() / vertical_m_s).max(0.5)
}
