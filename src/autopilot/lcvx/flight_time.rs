//! The flight time: the least one at which the problem has a solution, found by bisection.
//!
//! A longer flight costs more fuel, because the engine holds the weight for longer: the least-fuel time is the
//! edge of feasibility, and no minimum has to be searched. What is flown takes longer than that, to leave
//! tracking something to work with. The search begins at the time of a straight dash under the same limits,
//! mostly within a second of the answer, so that the last plan has nothing to add.

use super::conic::{Accuracy, Solver, Status};
use super::problem::Problem;
use super::transcription::{Objective, program};
use crate::frame::Vec3;

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

/// Accuracy of the points that show feasibility. Without a cost their gap is no matter.
const ACCURACY: f64 = 1e-6;
/// First step outwards from the lower bound (s).
const FIRST_STEP_S: f64 = 0.5;
/// No flight is shorter (s), and no acceleration that is asked for smaller (m/s²): divisions stay finite.
const SHORTEST_S: f64 = 0.5;
const LEAST_M_S2: f64 = 1e-3;
/// Share of the time that the propellant lasts which may be used: the tilt of the thrust costs the rest.
const BUDGET_SHARE: f64 = 0.98;

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
    let budget_s = budget_s(&problem)?;
    let mut low_s = dash_s(&problem, objective).min(budget_s);
    let mut step_s = FIRST_STEP_S;
    // Outwards until something is feasible, the propellant's last second included.
    let mut high_s = loop {
        if low_s >= budget_s {
            return None;
        }
        let probe_s = (low_s + step_s).min(budget_s);
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

/// A time in which nobody gets there (s): each direction alone, under the most that thrust and tilt give it at
/// any mass of the flight. Beside the target only the way down or up counts.
pub fn dash_s(problem: &Problem, objective: Objective) -> f64 {
    let (engine, limits, g) = (&problem.engine, &problem.limits, problem.gravity_m_s2);
    let way = problem.target.position_ned_m - problem.start.position_ned_m;
    let (v0, v1) = (problem.start.velocity_ned_m_s, problem.target.velocity_ned_m_s);
    let most_m_s2 = engine.thrust_max_n / engine.dry_mass_kg;
    let up_m_s2 = (most_m_s2 - g).max(LEAST_M_S2);
    let down_m_s2 =
        (g - engine.thrust_min_n * libm::cos(limits.tilt_rad) / problem.start.mass_kg).max(LEAST_M_S2);
    let side_m_s2 = most_m_s2 * libm::sin(limits.tilt_rad);
    let vertical = if way.z > 0.0 {
        Dash {
            way_m: way.z,
            v0_m_s: v0.z,
            v1_m_s: v1.z,
            speed_m_s: limits.sink_m_s,
            spurt_m_s2: down_m_s2,
            brake_m_s2: up_m_s2,
        }
    } else {
        Dash {
            way_m: -way.z,
            v0_m_s: -v0.z,
            v1_m_s: -v1.z,
            speed_m_s: limits.climb_m_s,
            spurt_m_s2: up_m_s2,
            brake_m_s2: down_m_s2,
        }
    };
    let side_m = libm::hypot(way.x, way.y);
    let along = |v: &Vec3| if side_m > 0.0 { (v.x * way.x + v.y * way.y) / side_m } else { 0.0 };
    let lateral = Dash {
        way_m: side_m,
        v0_m_s: along(&v0),
        v1_m_s: along(&v1),
        speed_m_s: limits.speed_m_s,
        spurt_m_s2: side_m_s2,
        brake_m_s2: side_m_s2,
    };
    // Speed is limited at nodes alone, and a little greater between them.
    let lateral_s = if objective == Objective::LandingError { 0.0 } else { lateral.time_s() };
    0.98 * vertical.time_s().max(lateral_s).max(SHORTEST_S)
}

/// A way along a line, as fast as can be.
struct Dash {
    way_m: f64,
    v0_m_s: f64,
    v1_m_s: f64,
    speed_m_s: f64,
    spurt_m_s2: f64,
    brake_m_s2: f64,
}

impl Dash {
    fn time_s(&self) -> f64 {
        let (a, b) = (0.5 / self.spurt_m_s2, 0.5 / self.brake_m_s2);
        let (v0, v1) = (self.v0_m_s, self.v1_m_s);
        let peak_m_s = ((self.way_m + a * v0 * v0 + b * v1 * v1) / (a + b)).sqrt().min(self.speed_m_s);
        let (spurt_m_s, brake_m_s) = ((peak_m_s - v0).max(0.0), (peak_m_s - v1).max(0.0));
        let ramps_m = a * spurt_m_s * (peak_m_s + v0) + b * brake_m_s * (peak_m_s + v1);
        let cruise_s = (self.way_m - ramps_m).max(0.0) / peak_m_s.max(1e-9);
        2.0 * (a * spurt_m_s + b * brake_m_s) + cruise_s
    }
}
