//! The gate between solver and flight: an answer passes that is optimal, tight, and flies where it says.
//!
//! "Solved" alone is not enough. Where the least thrust exceeds the weight the relaxation is not tight, and the
//! solver still reports an optimum: of a vehicle that burns more than its thrust. In discrete time a few loose
//! nodes may remain in other cases too (Luo, Echigo and Açıkmeşe, "Revisiting Lossless Convexification:
//! Theoretical Guarantees for Discrete-time Optimal Control Problems", 2024). So σ = |u| is measured, and the
//! thrust is flown through the exact mass equation m' = -α T by RK4.

use super::conic::Status;
use super::problem::Problem;
use super::transcription::{Motion, Objective};
use crate::frame::Vec3;
use crate::integrator::{Integrable, rk4_step};

/// Greatest (σ - |u|)/σ of a tight answer.
pub const GAP_MAX: f64 = 1e-3;
/// Farthest end of the flown motion from the target (m).
pub const MISS_MAX_M: f64 = 0.2;
/// Greatest error of its end velocity (m/s).
pub const MISS_MAX_M_S: f64 = 0.1;
/// Share of a thrust limit by which a node may pass it: solver accuracy.
const NODE_SHARE: f64 = 1e-3;
/// The same halfway between nodes. Direction turns there: between two thrusts on the floor at opposite tilts of
/// 12 deg it is short by 1 - cos 12 deg, 2.2 %.
const MIDPOINT_SHARE: f64 = 0.03;
/// Steps of the flown motion between two nodes.
const SUBSTEPS: usize = 4;

/// Figures of an answer that passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// Greatest (σ - |u|)/σ over the nodes.
    pub gap: f64,
    /// Distance of the flown end from the planned one (m).
    pub miss_m: f64,
    /// Difference of the flown end velocity from the planned one (m/s).
    pub miss_m_s: f64,
}

/// Why an answer did not pass.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Rejection {
    /// Not solved.
    #[error("the solver ended with {0:?}")]
    NotSolved(Status),
    /// The relaxation is not tight, and thrust leaves its band with it.
    #[error("bound of thrust exceeds thrust by {gap} of it, {GAP_MAX} is allowed; thrust leaves its band")]
    Loose {
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
    /// Flown with the exact mass equation it ends elsewhere.
    #[error("flown with exact mass it ends {miss_m} m and {miss_m_s} m/s off")]
    Missed {
        /// Distance (m).
        miss_m: f64,
        /// Difference of velocity (m/s).
        miss_m_s: f64,
    },
    /// It burns what is not there.
    #[error("it ends at {mass_kg} kg, below the dry {dry_mass_kg} kg")]
    TooLight {
        /// Mass at the end (kg).
        mass_kg: f64,
        /// Dry mass (kg).
        dry_mass_kg: f64,
    },
}

/// Checks a solved motion. Nodes may be loose if thrust lies in its band at all nodes and halfway between them: then
/// only the fuel is more than it need be, and what is flown is still what was planned.
pub fn check(problem: &Problem, objective: Objective, motion: &Motion) -> Result<Passed, Rejection> {
    let gap = gap(motion);
    if let Some(outside) = outside_band(problem, motion) {
        return Err(if gap <= GAP_MAX { outside } else { Rejection::Loose { gap } });
    }
    let (mass_kg, dry_mass_kg) = (problem.start.mass_kg - motion.fuel_kg(), problem.engine.dry_mass_kg);
    // The solver meets ln m to its accuracy.
    if mass_kg < dry_mass_kg * (1.0 - 1e-6) {
        return Err(Rejection::TooLight { mass_kg, dry_mass_kg });
    }
    let (position, velocity) = flown(problem, motion);
    let mut planned = problem.target.position_ned_m;
    if objective == Objective::LandingError {
        let landing = motion.position_ned_m[motion.position_ned_m.len() - 1];
        planned = Vec3::new(landing.x, landing.y, planned.z);
    }
    let miss_m = (position - planned).norm();
    let miss_m_s = (velocity - problem.target.velocity_ned_m_s).norm();
    if miss_m <= MISS_MAX_M && miss_m_s <= MISS_MAX_M_S {
        Ok(Passed { gap, miss_m, miss_m_s })
    } else {
        Err(Rejection::Missed { miss_m, miss_m_s })
    }
}

/// Greatest (σ - |u|)/σ over the nodes.
pub fn gap(motion: &Motion) -> f64 {
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
pub fn flown(problem: &Problem, motion: &Motion) -> (Vec3, Vec3) {
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

/// State, and its rate in the same fields, of a point that burns.
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
