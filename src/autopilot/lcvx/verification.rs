//! Verification between solver and flight: a solution is accepted if it is optimal, tight, and reaches its
//! target.
//!
//! "Solved" alone is not enough. Where the least thrust exceeds the weight the relaxation is not tight, and
//! the solver still reports an optimum: of a vehicle whose mass flow exceeds what its thrust needs. In
//! discrete time a few loose nodes may remain in other cases too (Luo, Echigo and Açıkmeşe, "Revisiting
//! Lossless Convexification: Theoretical Guarantees for Discrete-time Optimal Control Problems", 2024). So σ
//! = |u| is checked, and the planned thrust is integrated with the exact mass equation m' = -α T by RK4.

use super::conic::{self, Accuracy, Solution, Status};
use super::problem::Problem;
use super::transcription::{Motion, Objective, program};
use crate::frame::Vec3;
use crate::integrator::{Integrable, rk4_step};

/// Greatest (σ - |u|)/σ of a tight solution.
const GAP_MAX: f64 = 1e-3;
/// Greatest distance of the integrated end from the target (m).
const MISS_MAX_M: f64 = 0.2;
/// Greatest error of the end velocity (m/s).
const MISS_MAX_M_S: f64 = 0.1;
/// Share of a thrust limit by which a node may exceed it: solver accuracy.
const NODE_SHARE: f64 = 1e-3;
/// The same halfway between nodes. Direction turns there: between two thrusts on the floor at opposite tilts
/// of 12 deg it is short by 1 - cos 12 deg, 2.2 %.
const MIDPOINT_SHARE: f64 = 0.03;
/// Integration steps between two nodes.
const SUBSTEPS: usize = 4;

/// Figures of an accepted solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Greatest (σ - |u|)/σ over the nodes.
    pub gap: f64,
    /// Distance of the integrated end from the planned one (m).
    pub miss_m: f64,
    /// Difference of the integrated end velocity from the planned one (m/s).
    pub miss_m_s: f64,
}

/// Why a solution is rejected.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Rejection {
    /// Not solved.
    #[error("the solver ended with {0:?}")]
    NotSolved(Status),
    /// The relaxation is not tight, and thrust leaves its band with it.
    #[error("bound of thrust exceeds thrust by {gap} of it, {GAP_MAX} is allowed; thrust leaves its band")]
    NotTight {
        /// Greatest (σ - |u|)/σ.
        gap: f64,
    },
    /// Tight, but thrust leaves its band.
    #[error("thrust {thrust_n} N lies outside {low_n} to {high_n} N")]
    OutsideBand {
        /// Thrust (N).
        thrust_n: f64,
        /// Lower end with its tolerance (N).
        low_n: f64,
        /// Upper end with its tolerance (N).
        high_n: f64,
    },
    /// Integrated with the exact mass equation it ends beside the target.
    #[error("flown with exact mass it ends {miss_m} m and {miss_m_s} m/s off")]
    TargetMissed {
        /// Distance (m).
        miss_m: f64,
        /// Difference of velocity (m/s).
        miss_m_s: f64,
    },
    /// It burns more propellant than is on board.
    #[error("it ends at {mass_kg} kg, below the dry {dry_mass_kg} kg")]
    BelowDryMass {
        /// Mass at the end (kg).
        mass_kg: f64,
        /// Dry mass (kg).
        dry_mass_kg: f64,
    },
}

/// A problem solved over one flight time.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedTimeSolution {
    /// Solution of the cone program.
    pub solution: Solution,
    /// The same as a motion, if solved.
    pub motion: Option<Motion>,
    /// Of the verification.
    pub verdict: Result<Quality, Rejection>,
}

/// Solves a problem over one flight time (s) and verifies the solution.
pub fn solve(
    problem: &Problem,
    objective: Objective,
    flight_time_s: f64,
    accuracy: Accuracy,
) -> FixedTimeSolution {
    let solution = conic::solve(&program(problem, objective, flight_time_s), accuracy);
    if solution.status != Status::Solved {
        let verdict = Err(Rejection::NotSolved(solution.status));
        return FixedTimeSolution { solution, motion: None, verdict };
    }
    let motion = Motion::new(problem, flight_time_s, &solution.x);
    let verdict = check(problem, objective, &motion);
    FixedTimeSolution { solution, motion: Some(motion), verdict }
}

/// Checks a solved motion. Nodes need not be tight if thrust lies in its band at all nodes and halfway
/// between them: then the motion costs more fuel than necessary, but can be flown as planned.
fn check(problem: &Problem, objective: Objective, motion: &Motion) -> Result<Quality, Rejection> {
    let gap = gap(motion);
    if let Some(outside) = outside_band(problem, motion) {
        return Err(if gap <= GAP_MAX { outside } else { Rejection::NotTight { gap } });
    }
    let (mass_kg, dry_mass_kg) = (problem.start.mass_kg - motion.fuel_kg(), problem.engine.dry_mass_kg);
    // The solver meets ln m to its accuracy.
    if mass_kg < dry_mass_kg * (1.0 - 1e-6) {
        return Err(Rejection::BelowDryMass { mass_kg, dry_mass_kg });
    }
    let (position, velocity) = integrated_end(problem, motion);
    let mut planned = problem.target.position_ned_m;
    if objective == Objective::LandingError {
        let landing = motion.position_ned_m[motion.position_ned_m.len() - 1];
        planned = Vec3::new(landing.x, landing.y, planned.z);
    }
    let miss_m = (position - planned).norm();
    let miss_m_s = (velocity - problem.target.velocity_ned_m_s).norm();
    if miss_m <= MISS_MAX_M && miss_m_s <= MISS_MAX_M_S {
        Ok(Quality { gap, miss_m, miss_m_s })
    } else {
        Err(Rejection::TargetMissed { miss_m, miss_m_s })
    }
}

/// Greatest (σ - |u|)/σ over the nodes.
fn gap(motion: &Motion) -> f64 {
    let pairs = motion.bound_m_s2.iter().zip(&motion.thrust_acceleration_ned_m_s2);
    pairs.map(|(sigma, u)| (sigma - u.norm()) / sigma).fold(0.0, f64::max)
}

/// The first thrust outside its band, at nodes and halfway between them.
fn outside_band(problem: &Problem, motion: &Motion) -> Option<Rejection> {
    let (low_n, high_n) = (problem.engine.thrust_min_n, problem.engine.thrust_max_n);
    let (u, m) = (&motion.thrust_acceleration_ned_m_s2, &motion.mass_kg);
    let at_nodes = u.iter().zip(m).map(|(u, m)| (u.norm() * m, NODE_SHARE));
    let halfway = u
        .windows(2)
        .zip(m.windows(2))
        .map(|(u, m)| ((u[0] + u[1]).norm() * 0.25 * (m[0] + m[1]), MIDPOINT_SHARE));
    at_nodes.chain(halfway).find_map(|(thrust_n, share)| {
        let (low_n, high_n) = (low_n * (1.0 - share), high_n * (1.0 + share));
        let inside = low_n <= thrust_n && thrust_n <= high_n;
        (!inside).then_some(Rejection::OutsideBand { thrust_n, low_n, high_n })
    })
}

/// End of the motion under the planned thrust, its mass by the exact equation: position (m), velocity (m/s).
fn integrated_end(problem: &Problem, motion: &Motion) -> (Vec3, Vec3) {
    let alpha = problem.engine.mass_flow_per_thrust_s_m;
    let g = problem.gravity_ned_m_s2();
    let h = motion.step_s / SUBSTEPS as f64;
    let start = &problem.start;
    let mut state = PointMass {
        position_ned_m: start.position_ned_m,
        velocity_ned_m_s: start.velocity_ned_m_s,
        mass_kg: start.mass_kg,
    };
    for k in 0..motion.bound_m_s2.len() - 1 {
        let (u, sigma) = (&motion.thrust_acceleration_ned_m_s2[k..k + 2], &motion.bound_m_s2[k..k + 2]);
        for step in 0..SUBSTEPS {
            state = rk4_step(&state, h, |now, fraction| {
                // Planned thrust: u is linear between nodes, the planned mass the exponential of a parabola.
                let t = h * (step as f64 + fraction);
                let share = t / motion.step_s;
                let burnt = alpha * (sigma[0] + 0.5 * (sigma[1] - sigma[0]) * share) * t;
                let force_n = u[0].lerp(&u[1], share) * (motion.mass_kg[k] * libm::exp(-burnt));
                PointMass {
                    position_ned_m: now.velocity_ned_m_s,
                    velocity_ned_m_s: force_n / now.mass_kg + g,
                    mass_kg: -alpha * force_n.norm(),
                }
            });
        }
    }
    (state.position_ned_m, state.velocity_ned_m_s)
}

/// State of a point of changing mass, and its rate in the same fields.
#[derive(Clone, Copy)]
struct PointMass {
    position_ned_m: Vec3,
    velocity_ned_m_s: Vec3,
    mass_kg: f64,
}

impl Integrable for PointMass {
    type Rate = Self;
    fn advanced(&self, rate: &Self, dt_s: f64) -> Self {
        Self {
            position_ned_m: self.position_ned_m + rate.position_ned_m * dt_s,
            velocity_ned_m_s: self.velocity_ned_m_s + rate.velocity_ned_m_s * dt_s,
            mass_kg: self.mass_kg + rate.mass_kg * dt_s,
        }
    }
    fn rk4_mean(a: &Self, b: &Self, c: &Self, d: &Self) -> Self {
        let zero = Self { position_ned_m: Vec3::zeros(), velocity_ned_m_s: Vec3::zeros(), mass_kg: 0.0 };
        zero.advanced(a, 1.0 / 6.0).advanced(b, 1.0 / 3.0).advanced(c, 1.0 / 3.0).advanced(d, 1.0 / 6.0)
    }
}
