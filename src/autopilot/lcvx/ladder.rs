//! The ladder: the optimal plan or, if there is none, the next best, down to one that always exists.

use super::closed_form;
use super::flight_time::{Effort, Search, least_s, lower_bound_s, planned_s};
use super::plan::{Plan, PlanRequest, Rung, Settings};
use super::problem::{GlideSlope, Limits, Problem, Refusal};
use super::transcription::{Motion, Objective};
use super::verification::{Quality, Rejection, solve};
use crate::autopilot::trajectory::{Node, Trajectory};

/// Glide slope of the lower rungs: 10 deg above the ground, its apex a metre below the target.
const WIDE_GLIDE_SLOPE: GlideSlope = GlideSlope { angle_rad: 0.17, offset_m: 1.0 };
/// The previous plan is flown on up to this age (s),
const PREVIOUS_AGE_MAX_S: f64 = 3.0;
/// and while position (m), velocity (m/s) and target (m) lie this close to it.
const TUBE_M: f64 = 1.0;
const TUBE_M_S: f64 = 1.0;
/// Flight times tried for the least landing error, as multiples of the lower bound to the target.
const LANDING_ERROR_SHARES: [f64; 3] = [1.2, 1.5, 2.0];

/// Plans a flight. Pure: the same arguments give the same bits. No argument makes it panic or return NaN.
pub fn plan(request: &PlanRequest, settings: &Settings) -> Plan {
    let problem = &request.problem;
    let heading_rad = if request.heading_rad.is_finite() { request.heading_rad } else { 0.0 };
    let mut ladder = Ladder {
        request,
        heading_rad,
        settings,
        effort: Effort::default(),
        refusal: problem.refusal(),
        rejection: None,
    };
    if let Some(best) = ladder.least_fuel(problem) {
        return ladder.optimal_plan(Rung::Optimal, best);
    }
    if let Some(previous) = usable_previous(request) {
        return ladder.finish(Rung::Previous, previous);
    }
    let mut wide = *problem;
    if problem.limits.glide_slope.is_some() {
        wide.limits = Limits { glide_slope: Some(WIDE_GLIDE_SLOPE), ..problem.limits };
        if let Some(best) = ladder.least_fuel(&wide) {
            return ladder.optimal_plan(Rung::WideGlideSlope, best);
        }
    }
    if let Some(best) = ladder.least_landing_error(&wide) {
        return ladder.optimal_plan(Rung::LandingError, best);
    }
    if problem.out_of_range().is_some() {
        let at = closed_form::known_position(problem);
        return ladder.finish(Rung::Hold, Trajectory::hold(request.start, at, heading_rad));
    }
    let (rung, nodes) = match closed_form::quintic(problem) {
        Some(nodes) => (Rung::Quintic, nodes),
        None => (Rung::Ramp, closed_form::ramps(problem)),
    };
    ladder.finish(rung, Trajectory::new(request.start, heading_rad, nodes))
}

/// The previous plan, if it is recent, leads to the target and the vehicle is still close to it.
fn usable_previous(request: &PlanRequest) -> Option<Trajectory> {
    let previous = request.previous.as_ref()?;
    let off_target = previous.last().position_ned_m - request.problem.target.position_ned_m;
    let age_s = request.start.since(previous.start()).s();
    let (now, start) = (previous.after(age_s), &request.problem.start);
    let off_m = (now.position_ned_m - start.position_ned_m).norm();
    let off_m_s = (now.velocity_ned_m_s - start.velocity_ned_m_s).norm();
    let leads_to_target = age_s < previous.duration_s() && off_target.norm() <= TUBE_M;
    let is_close = age_s <= PREVIOUS_AGE_MAX_S && off_m <= TUBE_M && off_m_s <= TUBE_M_S;
    (leads_to_target && is_close).then(|| previous.clone())
}

/// An accepted solution.
struct Candidate {
    motion: Motion,
    quality: Quality,
    least_time_s: f64,
    cost: f64,
}

struct Ladder<'a> {
    request: &'a PlanRequest,
    heading_rad: f64,
    settings: &'a Settings,
    effort: Effort,
    refusal: Option<Refusal>,
    rejection: Option<Rejection>,
}

impl Ladder<'_> {
    fn least_fuel(&mut self, problem: &Problem) -> Option<Candidate> {
        let least_s = self.least_s(problem, Objective::Fuel)?;
        self.best(problem, Objective::Fuel, least_s, self.settings.flight_time_share)
    }

    /// The best of a few flight times: the one of least landing error is not known beforehand.
    fn least_landing_error(&mut self, problem: &Problem) -> Option<Candidate> {
        let least_s = self.least_s(problem, Objective::LandingError)?;
        let bound_s = lower_bound_s(problem, Objective::Fuel).max(least_s);
        let shortest = self.best(problem, Objective::LandingError, least_s, self.settings.flight_time_share);
        let longer = LANDING_ERROR_SHARES.map(|share| {
            let share = share * bound_s / least_s;
            self.best(problem, Objective::LandingError, least_s, share)
        });
        let all = longer.into_iter().chain([shortest]);
        all.flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    fn least_s(&mut self, problem: &Problem, objective: Objective) -> Option<f64> {
        let settings = self.settings;
        if self.refusal.is_some() || settings.iterations_max == 0 {
            return None;
        }
        let search = Search {
            nodes: settings.search_nodes,
            tolerance_s: settings.search_tolerance_s,
            iterations_max: settings.iterations_max,
        };
        least_s(problem, objective, &search, &mut self.effort)
    }

    fn best(
        &mut self,
        problem: &Problem,
        objective: Objective,
        least_time_s: f64,
        share: f64,
    ) -> Option<Candidate> {
        let flight_time_s = planned_s(problem, least_time_s, share);
        let answer = solve(problem, objective, flight_time_s, self.settings.accuracy());
        self.effort.solves += 1;
        self.effort.iterations += answer.solution.iterations;
        let cost = answer.solution.cost;
        match answer.verdict {
            Ok(quality) => Some(Candidate { motion: answer.motion?, quality, least_time_s, cost }),
            Err(rejection) => {
                self.rejection = self.rejection.or(Some(rejection));
                None
            }
        }
    }

    fn optimal_plan(self, rung: Rung, best: Candidate) -> Plan {
        let nodes = nodes(self.request, &best.motion);
        let trajectory = Trajectory::new(self.request.start, self.heading_rad, nodes);
        Plan {
            least_time_s: Some(best.least_time_s),
            fuel_kg: Some(best.motion.fuel_kg()),
            quality: Some(best.quality),
            ..self.finish(rung, trajectory)
        }
    }

    fn finish(self, rung: Rung, trajectory: Trajectory) -> Plan {
        let elapsed_s = self.request.start.since(trajectory.start()).s();
        Plan {
            flight_time_s: trajectory.duration_s() - elapsed_s,
            trajectory,
            rung,
            least_time_s: None,
            fuel_kg: None,
            quality: None,
            effort: self.effort,
            refusal: self.refusal,
            rejection: self.rejection,
        }
    }
}

fn nodes(request: &PlanRequest, motion: &Motion) -> Vec<Node> {
    let gravity = request.problem.gravity_ned_m_s2();
    let node = |k: usize| Node {
        time_s: motion.step_s * k as f64,
        position_ned_m: motion.position_ned_m[k],
        velocity_ned_m_s: motion.velocity_ned_m_s[k],
        acceleration_ned_m_s2: motion.thrust_acceleration_ned_m_s2[k] + gravity,
    };
    (0..motion.bound_m_s2.len()).map(node).collect()
}
