//! The planning problem over a given flight time as a second-order cone program, and its answer as a motion.
//!
//! Variables of node k, all in units of 10 m, seconds and the logarithm of mass: position r, velocity v, w =
//! ln(m/m₀), thrust per mass u, and σ ≥ |u|, in which the mass flow is linear: w' = -α σ. Thrust per mass is
//! linear between nodes, so that the double integrator is discretised without error:
//!
//! ```text
//! r⁺ = r + v h + (u/3 + u⁺/6) h² + g h²/2        v⁺ = v + (u + u⁺) h/2 + g h        w⁺ = w - α (σ + σ⁺) h/2
//! ```
//!
//! The thrust band T_min ≤ m σ ≤ T_max is convex in σ and w after expansion about w₀(t), the mass under full
//! thrust: with d = w - w₀ ≥ 0 and μ = T e^(-w₀)/m₀,
//!
//! ```text
//! μ_min (1 - d + d²/2) ≤ σ ≤ μ_max (1 - d)
//! ```
//!
//! lies inside the band, since 1 - d ≤ e^(-d) ≤ 1 - d + d²/2 for d ≥ 0. Tilt is -u_z ≥ σ cos θ.
//!
//! Sources: Açıkmeşe and Ploen, "Convex Programming Approach to Powered Descent Guidance for Mars Landing",
//! J. Guidance 30-5, 2007, Eqs 29 to 37 (relaxation, logarithm of mass, bounds); Blackmore, Açıkmeşe and
//! Scharf, "Minimum-Landing-Error Powered-Descent Guidance", J. Guidance 33-4, 2010 (landing error, glide
//! slope). At the optimum σ = |u| under the conditions proven there; [`super::verification`] checks it.

use super::conic::{Program, Rows};
use super::problem::Problem;
use crate::frame::Vec3;

/// Unit of length in the program (m).
const LENGTH_M: f64 = 10.0;
/// Cost of the landing error, in (m/s) of thrust per mass for every metre.
const LANDING_ERROR_COST_1_S: f64 = 1e3;

/// The start may lie this far outside the position limits (m): the estimated position has an error.
const START_TOLERANCE_M: f64 = 0.5;

/// The quantity to minimise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// ∫ σ dt, which is the logarithm of the mass ratio: fuel.
    Fuel,
    /// A thousand times the horizontal distance from the target (m), plus ∫ σ dt (m/s).
    LandingError,
}

// Variables within a node.
const R: usize = 0;
const V: usize = 3;
const W: usize = 6;
const U: usize = 7;
const SIGMA: usize = 10;
const SIZE: usize = 11;

/// The program of a problem over a flight time (s).
pub fn program(problem: &Problem, objective: Objective, flight_time_s: f64) -> Program {
    let transcription = Transcription::new(problem, objective, flight_time_s);
    let (mut inequalities, mut conic, mut cones) = (Rows::default(), Rows::default(), Vec::new());
    for node in 0..problem.nodes {
        transcription.thrust_limits(node, &mut inequalities, &mut conic, &mut cones);
        if node > 0 && node + 1 < problem.nodes {
            transcription.speed_limits(node, &mut inequalities, &mut conic, &mut cones);
        }
        if node + 1 < problem.nodes {
            transcription.position_limits(node, &mut inequalities, &mut conic, &mut cones);
        }
    }
    if objective == Objective::LandingError {
        let error = transcription.landing_error_column();
        conic.push(&[(error + 2, -1.0)], 0.0);
        conic.push(&[(error, -1.0)], 0.0);
        conic.push(&[(error + 1, -1.0)], 0.0);
        cones.push(3);
    }
    Program::new(transcription.cost(), transcription.equalities(), inequalities, conic, cones)
}

struct Transcription<'a> {
    problem: &'a Problem,
    objective: Objective,
    step_s: f64,
}

impl<'a> Transcription<'a> {
    fn new(problem: &'a Problem, objective: Objective, flight_time_s: f64) -> Self {
        Self { problem, objective, step_s: flight_time_s / (problem.nodes - 1) as f64 }
    }

    /// First of the three variables of the landing error: north, east, and the bound of their length.
    fn landing_error_column(&self) -> usize {
        SIZE * self.problem.nodes
    }

    fn cost(&self) -> Vec<f64> {
        let last = self.problem.nodes - 1;
        let mut cost = vec![0.0; self.landing_error_column()];
        for node in 0..=last {
            let share = if node == 0 || node == last { 0.5 } else { 1.0 };
            cost[SIZE * node + SIGMA] = share * self.step_s;
        }
        if self.objective == Objective::LandingError {
            cost.extend([0.0, 0.0, LANDING_ERROR_COST_1_S]);
        }
        cost
    }

    fn equalities(&self) -> Rows {
        let mut rows = Rows::default();
        let (problem, h) = (self.problem, self.step_s);
        let (start, target) = (&problem.start, &problem.target);
        for axis in 0..3 {
            rows.push(&[(R + axis, 1.0)], start.position_ned_m[axis] / LENGTH_M);
            rows.push(&[(V + axis, 1.0)], start.velocity_ned_m_s[axis] / LENGTH_M);
        }
        rows.push(&[(W, 1.0)], 0.0);
        if let Some(u) = problem.initial_thrust_acceleration_ned_m_s2() {
            for axis in 0..3 {
                rows.push(&[(U + axis, 1.0)], u[axis] / LENGTH_M);
            }
        }
        let g = problem.gravity_ned_m_s2() / LENGTH_M;
        let flow = problem.engine.mass_flow_per_thrust_s_m * LENGTH_M;
        for node in 0..problem.nodes - 1 {
            let (now, next) = (SIZE * node, SIZE * (node + 1));
            for i in 0..3 {
                let (r, v, u) = (now + R + i, now + V + i, now + U + i);
                let (r_next, v_next, u_next) = (next + R + i, next + V + i, next + U + i);
                let (here, there) = (-h * h / 3.0, -h * h / 6.0);
                let terms = [(r_next, 1.0), (r, -1.0), (v, -h), (u, here), (u_next, there)];
                rows.push(&terms, 0.5 * h * h * g[i]);
                rows.push(&[(v_next, 1.0), (v, -1.0), (u, -0.5 * h), (u_next, -0.5 * h)], h * g[i]);
            }
            let burnt = 0.5 * h * flow;
            let terms = [(next + W, 1.0), (now + W, -1.0), (now + SIGMA, burnt), (next + SIGMA, burnt)];
            rows.push(&terms, 0.0);
        }
        let last = SIZE * (problem.nodes - 1);
        for axis in 0..3 {
            let place = target.position_ned_m[axis] / LENGTH_M;
            if self.objective == Objective::LandingError && axis < 2 {
                rows.push(&[(last + R + axis, 1.0), (self.landing_error_column() + axis, -1.0)], place);
            } else {
                rows.push(&[(last + R + axis, 1.0)], place);
            }
            rows.push(&[(last + V + axis, 1.0)], target.velocity_ned_m_s[axis] / LENGTH_M);
        }
        rows.push(&[(last + U, 1.0)], 0.0);
        rows.push(&[(last + U + 1, 1.0)], 0.0);
        rows
    }

    /// Thrust band, tilt, logarithm of mass, and the relaxation σ ≥ |u|.
    fn thrust_limits(&self, node: usize, linear: &mut Rows, conic: &mut Rows, cones: &mut Vec<usize>) {
        let (problem, at) = (self.problem, SIZE * node);
        let engine = &problem.engine;
        let (mass_kg, alpha) = (problem.start.mass_kg, engine.mass_flow_per_thrust_s_m);
        let time_s = self.step_s * node as f64;
        let burnt_kg = |thrust_n: f64| alpha * thrust_n * time_s;
        let least = (mass_kg - burnt_kg(engine.thrust_max_n)).max(engine.dry_mass_kg) / mass_kg;
        let w0 = libm::log(least);
        let unit = mass_kg * least * LENGTH_M;
        let (mu_min, mu_max) = (engine.thrust_min_n / unit, engine.thrust_max_n / unit);

        // σ ≤ μ_max (1 - d), divided by μ_max.
        linear.push(&[(at + SIGMA, 1.0 / mu_max), (at + W, 1.0)], 1.0 + w0);
        linear.push(&[(at + U + 2, 1.0), (at + SIGMA, libm::cos(problem.limits.tilt_rad))], 0.0);
        if node > 0 {
            linear.push(&[(at + W, -1.0)], -w0);
            let most = (mass_kg - burnt_kg(engine.thrust_min_n)).max(engine.dry_mass_kg) / mass_kg;
            linear.push(&[(at + W, 1.0)], libm::log(most));
        }

        // d²/2 ≤ t with t = σ/μ_min - 1 + d, as |(d, t - 1/2)| ≤ t + 1/2.
        let t = [(at + SIGMA, -1.0 / mu_min), (at + W, -1.0)];
        conic.push(&t, 0.5 - 1.0 - w0);
        conic.push(&[(at + W, -1.0)], -w0);
        conic.push(&t, -0.5 - 1.0 - w0);
        cones.push(3);
        conic.push(&[(at + SIGMA, -1.0)], 0.0);
        for axis in 0..3 {
            conic.push(&[(at + U + axis, -1.0)], 0.0);
        }
        cones.push(4);
    }

    fn speed_limits(&self, node: usize, linear: &mut Rows, conic: &mut Rows, cones: &mut Vec<usize>) {
        let (limits, at) = (&self.problem.limits, SIZE * node);
        linear.push(&[(at + V + 2, -1.0)], limits.climb_m_s / LENGTH_M);
        linear.push(&[(at + V + 2, 1.0)], limits.sink_m_s / LENGTH_M);
        conic.push(&[], limits.speed_m_s / LENGTH_M);
        for axis in 0..3 {
            conic.push(&[(at + V + axis, -1.0)], 0.0);
        }
        cones.push(4);
    }

    /// Glide slope, or the height of the lower end. The start may lie [`START_TOLERANCE_M`] outside.
    fn position_limits(&self, node: usize, linear: &mut Rows, conic: &mut Rows, cones: &mut Vec<usize>) {
        let (problem, at) = (self.problem, SIZE * node);
        let target = problem.target.position_ned_m / LENGTH_M;
        let spare = if node == 0 { START_TOLERANCE_M / LENGTH_M } else { 0.0 };
        let Some(glide) = problem.limits.glide_slope else {
            let lowest = target.z.max(problem.start.position_ned_m.z / LENGTH_M);
            linear.push(&[(at + R + 2, 1.0)], lowest + spare);
            return;
        };
        // |horizontal distance from the landing point| ≤ height above the apex / tan.
        let slope = 1.0 / libm::tan(glide.angle_rad);
        conic.push(&[(at + R + 2, slope)], slope * (target.z + glide.offset_m / LENGTH_M) + spare);
        for axis in 0..2 {
            if self.objective == Objective::LandingError {
                conic
                    .push(&[(at + R + axis, -1.0), (self.landing_error_column() + axis, 1.0)], -target[axis]);
            } else {
                conic.push(&[(at + R + axis, -1.0)], -target[axis]);
            }
        }
        cones.push(3);
    }
}

/// A solved motion at its nodes, evenly spaced, thrust per mass linear between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Time between nodes (s).
    pub step_s: f64,
    /// Position of the pivot (m).
    pub position_ned_m: Vec<Vec3>,
    /// Velocity (m/s).
    pub velocity_ned_m_s: Vec<Vec3>,
    /// Thrust per mass u (m/s²).
    pub thrust_acceleration_ned_m_s2: Vec<Vec3>,
    /// Bound σ of its length, proportional to the mass flow per mass (m/s²).
    pub bound_m_s2: Vec<f64>,
    /// Mass (kg).
    pub mass_kg: Vec<f64>,
}

impl Motion {
    /// From the variables of a program. Only u and σ are taken; the rest is rolled out from the start, so
    /// that the solver's residual does not stand between the nodes.
    pub fn new(problem: &Problem, flight_time_s: f64, x: &[f64]) -> Self {
        let h = flight_time_s / (problem.nodes - 1) as f64;
        let node = |k: usize| &x[SIZE * k..SIZE * (k + 1)];
        let thrust = |k: usize| LENGTH_M * Vec3::new(node(k)[U], node(k)[U + 1], node(k)[U + 2]);
        let thrust_acceleration_ned_m_s2: Vec<Vec3> = (0..problem.nodes).map(thrust).collect();
        let bound_m_s2: Vec<f64> = (0..problem.nodes).map(|k| LENGTH_M * node(k)[SIGMA]).collect();
        let g = problem.gravity_ned_m_s2();
        let (mut r, mut v) = (problem.start.position_ned_m, problem.start.velocity_ned_m_s);
        let mut w = 0.0;
        let (mut position_ned_m, mut velocity_ned_m_s) = (vec![r], vec![v]);
        let mut mass_kg = vec![problem.start.mass_kg];
        for k in 0..problem.nodes - 1 {
            let (u, next) = (thrust_acceleration_ned_m_s2[k], thrust_acceleration_ned_m_s2[k + 1]);
            r += v * h + (u / 3.0 + next / 6.0 + g * 0.5) * (h * h);
            v += ((u + next) * 0.5 + g) * h;
            let sigma = 0.5 * (bound_m_s2[k] + bound_m_s2[k + 1]);
            w -= problem.engine.mass_flow_per_thrust_s_m * sigma * h;
            position_ned_m.push(r);
            velocity_ned_m_s.push(v);
            mass_kg.push(problem.start.mass_kg * libm::exp(w));
        }
        Self {
            step_s: h,
            position_ned_m,
            velocity_ned_m_s,
            thrust_acceleration_ned_m_s2,
            bound_m_s2,
            mass_kg,
        }
    }

    /// Propellant burnt (kg).
    pub fn fuel_kg(&self) -> f64 {
        self.mass_kg[0] - self.mass_kg[self.mass_kg.len() - 1]
    }

    /// ∫ σ dt (m/s).
    pub fn cost_m_s(&self) -> f64 {
        self.bound_m_s2.windows(2).map(|pair| 0.5 * self.step_s * (pair[0] + pair[1])).sum()
    }
}
