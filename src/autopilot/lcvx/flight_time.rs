//! The flight time: the least one for which the problem has a solution, found by bisection.
//!
//! A longer flight costs more fuel, because the engine holds the weight for longer: the least-fuel time is
//! the edge of feasibility, and no minimum has to be searched. The plan takes longer than that, to leave
//! tracking a margin. The search begins at a lower bound, the time-optimal motion along each direction alone,
//! which is mostly within a second of the answer; so the previous plan is not needed to start it.

use super::conic::{Accuracy, Solver, Status};
use super::problem::Problem;
use super::transcription::{Objective, program};
use crate::frame::Vec3;

/// Effort of the solver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Programs solved, certified infeasible ones included.
    pub solves: u32,
    /// Iterations of the solver in all of them.
    pub iterations: u32,
}

/// Settings of the search for the least flight time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Nodes of the programs.
    pub nodes: usize,
    /// Tolerance of the answer, always on the feasible side (s).
    pub tolerance_s: f64,
    /// Greatest number of iterations of the solver.
    pub iterations_max: u32,
}

/// Tolerance of the feasibility checks. They have no cost, so their gap does not matter.
const ACCURACY: f64 = 1e-6;
/// First step up from the lower bound (s).
const FIRST_STEP_S: f64 = 0.5;
/// Shortest flight (s) and least acceleration (m/s²) that the lower bound assumes: divisions stay finite.
const SHORTEST_S: f64 = 0.5;
const LEAST_M_S2: f64 = 1e-3;
/// Share of the propellant's endurance that a flight may use: the tilt of the thrust costs the rest.
const ENDURANCE_SHARE: f64 = 0.98;

/// The least flight time at which the problem has a solution (s), to within the tolerance above it.
pub fn least_s(problem: &Problem, objective: Objective, search: &Search, effort: &mut Effort) -> Option<f64> {
    let problem = Problem { nodes: search.nodes, ..*problem };
    let iterations_max = search.iterations_max;
    let mut solver = Solver::new(Accuracy { feasibility: ACCURACY, gap: ACCURACY, iterations_max });
    let mut is_feasible = |time_s: f64| {
        let mut program = program(&problem, objective, time_s);
        program.cost.fill(0.0);
        let solution = solver.solve(&program);
        effort.solves += 1;
        effort.iterations += solution.iterations;
        solution.status == Status::Solved
    };
    let endurance_s = endurance_s(&problem)?;
    let mut low_s = lower_bound_s(&problem, objective).min(endurance_s);
    let mut step_s = FIRST_STEP_S;
    // Longer until feasible, up to the endurance.
    let mut high_s = loop {
        if low_s >= endurance_s {
            return None;
        }
        let probe_s = (low_s + step_s).min(endurance_s);
        if is_feasible(probe_s) {
            break probe_s;
        }
        low_s = probe_s;
        step_s *= 2.0;
    };
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

/// The planned flight time (s): longer than the least by a share, as far as the propellant lasts.
pub(super) fn planned_s(problem: &Problem, least_s: f64, share: f64) -> f64 {
    (share * least_s).min(endurance_s(problem).unwrap_or(least_s)).max(least_s)
}

/// The longest flight that the propellant carries (s). |∫ u dt| = |Δv - g t| can not exceed ∫ σ dt, and all
/// of the propellant gives ln(m₀/m_dry)/α.
fn endurance_s(problem: &Problem) -> Option<f64> {
    let (g, engine) = (problem.gravity_m_s2, &problem.engine);
    let most_m_s = libm::log(problem.start.mass_kg / engine.dry_mass_kg) / engine.mass_flow_per_thrust_s_m;
    let change = problem.target.velocity_ned_m_s - problem.start.velocity_ned_m_s;
    let root = change.z * change.z - change.norm_squared() + most_m_s * most_m_s;
    let time_s = ENDURANCE_SHARE * (change.z + root.sqrt()) / g;
    // Without a real root the time is NaN, which compares false.
    (time_s > 0.0).then_some(time_s)
}

/// A lower bound of the flight time (s): each direction alone, under the greatest acceleration that thrust
/// and tilt give it at any mass of the flight. For the least landing error only the vertical distance counts.
pub(super) fn lower_bound_s(problem: &Problem, objective: Objective) -> f64 {
    let (engine, limits, g) = (&problem.engine, &problem.limits, problem.gravity_m_s2);
    let distance = problem.target.position_ned_m - problem.start.position_ned_m;
    let (v0, v1) = (problem.start.velocity_ned_m_s, problem.target.velocity_ned_m_s);
    let most_m_s2 = engine.thrust_max_n / engine.dry_mass_kg;
    let up_m_s2 = (most_m_s2 - g).max(LEAST_M_S2);
    let down_m_s2 =
        (g - engine.thrust_min_n * libm::cos(limits.tilt_rad) / problem.start.mass_kg).max(LEAST_M_S2);
    let side_m_s2 = most_m_s2 * libm::sin(limits.tilt_rad);
    let vertical = if distance.z > 0.0 {
        LineMotion {
            distance_m: distance.z,
            v0_m_s: v0.z,
            v1_m_s: v1.z,
            speed_m_s: limits.sink_m_s,
            accelerate_m_s2: down_m_s2,
            brake_m_s2: up_m_s2,
        }
    } else {
        LineMotion {
            distance_m: -distance.z,
            v0_m_s: -v0.z,
            v1_m_s: -v1.z,
            speed_m_s: limits.climb_m_s,
            accelerate_m_s2: up_m_s2,
            brake_m_s2: down_m_s2,
        }
    };
    let side_m = libm::hypot(distance.x, distance.y);
    let along = |v: &Vec3| if side_m > 0.0 { (v.x * distance.x + v.y * distance.y) / side_m } else { 0.0 };
    let lateral = LineMotion {
        distance_m: side_m,
        v0_m_s: along(&v0),
        v1_m_s: along(&v1),
        speed_m_s: limits.speed_m_s,
        accelerate_m_s2: side_m_s2,
        brake_m_s2: side_m_s2,
    };
    // Speed is limited at nodes alone, and a little greater between them.
    let lateral_s = if objective == Objective::LandingError { 0.0 } else { lateral.time_s() };
    0.98 * vertical.time_s().max(lateral_s).max(SHORTEST_S)
}

/// Time-optimal motion along a line: accelerate, cruise, brake.
struct LineMotion {
    distance_m: f64,
    v0_m_s: f64,
    v1_m_s: f64,
    speed_m_s: f64,
    accelerate_m_s2: f64,
    brake_m_s2: f64,
}

impl LineMotion {
    fn time_s(&self) -> f64 {
        let (a, b) = (0.5 / self.accelerate_m_s2, 0.5 / self.brake_m_s2);
        let (v0, v1) = (self.v0_m_s, self.v1_m_s);
        let peak_m_s = ((self.distance_m + a * v0 * v0 + b * v1 * v1) / (a + b)).sqrt().min(self.speed_m_s);
        let (gain_m_s, loss_m_s) = ((peak_m_s - v0).max(0.0), (peak_m_s - v1).max(0.0));
        let ramps_m = a * gain_m_s * (peak_m_s + v0) + b * loss_m_s * (peak_m_s + v1);
        let cruise_s = (self.distance_m - ramps_m).max(0.0) / peak_m_s.max(1e-9);
        2.0 * (a * gain_m_s + b * loss_m_s) + cruise_s
    }
}
