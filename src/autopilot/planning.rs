//! Planning of climb and landing beside the control loop: orders, answers, deadlines.
//!
//! A plan takes milliseconds and must not delay the loop: the autopilot makes an [`Order`], its owner solves
//! it on any thread and delivers the answer. The plan begins [`LATENCY_S`] after the order and is adopted
//! exactly then, so that a flight in memory and one with a planning thread give the same bits as long as
//! answers come in time. A late answer is counted, and the trajectory in force is flown on.

use super::Autopilot;
use super::lcvx::{self, Engine, GlideSlope, Limits, Plan, PlanRequest, Problem, Rung, Start, Target};
use super::mission::GuidanceLaw;
use super::phase::Phase;
use super::trajectory::{Reference, Trajectory};
use crate::frame::{Vec3, heading_rad};
use crate::time::SimTime;

/// From an order to the beginning of its plan: the deadline of the answer (s).
pub const LATENCY_S: f64 = 0.2;
/// Time between plans during the descent (s).
const REPLAN_S: f64 = 1.0;
/// No new plan with less than this to go (s).
const FREEZE_S: f64 = 3.0;
/// A vehicle within this of its reference (m, m/s) is planned on from the reference, so that plans join
/// without a step. Wider than any tracking error by gusts: a plan from the disturbed motion would extend the
/// flight time each second, and the vehicle would never land.
const TUBE_M: f64 = 2.0;
const TUBE_M_S: f64 = 1.5;
/// A landing may climb this much faster than the vehicle climbs already (m/s): a climb costs no more than a
/// hover, but brings the vehicle no closer to the ground.
const LANDING_CLIMB_M_S: f64 = 0.5;
/// Time that a due plan waits for a trajectory clock that runs slow (s).
const JOIN_WAIT_S: f64 = 0.06;
/// Nodes of a plan.
const NODES: usize = 30;
/// The thrust band of plans, as multiples of the least and the greatest command: the rest is the margin of
/// control.
const BAND_LOW: f64 = 1.5;
const BAND_HIGH: f64 = 0.9;
/// Share of the tilt limit that plans may use.
const TILT_SHARE: f64 = 0.8;
/// Cone above the target that a landing stays inside.
const GLIDE_SLOPE: GlideSlope = GlideSlope { angle_rad: core::f64::consts::FRAC_PI_4, offset_m: 0.5 };

/// An order for a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    number: u64,
    request: PlanRequest,
    settings: lcvx::Settings,
}

/// The plan of an order.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    number: u64,
    plan: Plan,
}

impl Order {
    /// Solves the order: pure, some milliseconds.
    pub fn solve(&self) -> Answer {
        Answer { number: self.number, plan: lcvx::plan(&self.request, &self.settings) }
    }
}

/// State of planning: the order under way, and counters.
#[derive(Clone, Debug, Default)]
pub struct Planning {
    /// Orders so far: the number of the newest.
    ordered: u64,
    begins: Option<SimTime>,
    /// Time on the trajectory in force at which the plan joins it (s); `None`: the plan begins at the
    /// vehicle's motion.
    join_s: Option<f64>,
    outbox: Option<Order>,
    answer: Option<Plan>,
    /// Time to the next order of a descent (s).
    next_s: f64,
    counts: [u64; 7],
    late: u64,
    /// Of the plan in force; `None` without one.
    rung: Option<Rung>,
}

impl Planning {
    /// Plans adopted from each rung, in the order of [`Rung::ALL`].
    pub const fn counts(&self) -> [u64; 7] {
        self.counts
    }

    /// Plans that did not come in time.
    pub const fn late(&self) -> u64 {
        self.late
    }

    /// When the plan on order begins; `None` without an order.
    pub const fn begins(&self) -> Option<SimTime> {
        self.begins
    }

    /// The plan in force is of the last rungs, which may break limits.
    pub(super) fn is_exhausted(&self) -> bool {
        matches!(self.rung, Some(Rung::Ramp | Rung::Hold))
    }

    /// Discards order and plan.
    pub(super) fn reset(&mut self) {
        *self = Self { ordered: self.ordered, counts: self.counts, late: self.late, ..Self::default() };
    }

    fn take(&mut self, answer: Answer) {
        // An answer after its deadline is of no use.
        if answer.number == self.ordered && self.begins.is_some() {
            self.answer = Some(answer.plan);
        }
    }
}

impl Autopilot {
    /// The order to be solved, once.
    pub fn take_order(&mut self) -> Option<Order> {
        self.planning.outbox.take()
    }

    /// Delivers the answer to an order.
    pub fn deliver(&mut self, answer: Answer) {
        self.planning.take(answer);
    }

    /// State of planning.
    pub const fn planning(&self) -> &Planning {
        &self.planning
    }

    /// One step: orders the plan that the phase needs, adopts the plan that is due.
    pub(super) fn plan(&mut self, dt_s: f64) {
        if self.parameters.mission.guidance != GuidanceLaw::Lcvx {
            return;
        }
        self.planning.next_s -= dt_s;
        match self.sequence.phase() {
            Phase::Ignition if self.planning.ordered == 0 => self.order_climb(),
            Phase::Descent => {
                let to_go_s = self.guidance.trajectory().duration_s() - self.guidance.elapsed_s();
                let fresh = self.planning.rung.is_none();
                let due = self.planning.next_s <= 0.0 && (fresh || to_go_s > FREEZE_S);
                if self.planning.begins.is_none() && due {
                    self.order_landing();
                    self.planning.next_s = REPLAN_S;
                }
                self.adopt_landing();
            }
            _ => {}
        }
    }

    /// The climb that was ordered before lift-off, if it was delivered in time.
    pub(super) fn planned_climb(&mut self) -> Option<Trajectory> {
        self.planning.begins.take()?;
        let Some(plan) = self.planning.answer.take() else {
            self.planning.late += 1;
            return None;
        };
        self.planning.counts[plan.rung as usize] += 1;
        // The ramps of the mission climb better than those of the ladder's last rungs.
        (plan.rung < Rung::Ramp).then_some(plan.trajectory)
    }

    fn adopt_landing(&mut self) {
        let Some(begins) = self.planning.begins else { return };
        if self.time < begins {
            return;
        }
        let since_s = self.time.since(begins).s();
        // The trajectory clock has been shifted since: the plan joins at its place on the trajectory, not at
        // its time.
        let past_s = self.planning.join_s.map_or(since_s, |join_s| self.guidance.elapsed_s() - join_s);
        if past_s < 0.0 && since_s < JOIN_WAIT_S {
            return;
        }
        self.planning.begins = None;
        match self.planning.answer.take() {
            Some(plan) => {
                self.planning.counts[plan.rung as usize] += 1;
                self.planning.rung = Some(plan.rung);
                if plan.rung != Rung::Previous {
                    self.guidance.follow(plan.trajectory, past_s.max(0.0));
                }
            }
            None => {
                self.planning.late += 1;
                if self.planning.rung.is_none() {
                    // Without a first plan, ramps lead down until the next one.
                    self.follow_ramps(Phase::Descent, &self.guidance.reference());
                    self.planning.rung = Some(Rung::Previous);
                }
            }
        }
    }

    fn order_climb(&mut self) {
        let heading_rad = heading_rad(&self.navigation.q_ned_from_body());
        let position_ned_m = self.parameters.navigation.rest_ned_m;
        let from = Reference { position_ned_m, heading_rad, ..Reference::default() };
        let profile = self.mission_profile();
        // The climb is vertical; the horizontal transfer belongs to the hover.
        let above = Vec3::new(position_ned_m.x, position_ned_m.y, profile.hover_ned_m().z);
        let target = Target { position_ned_m: above, velocity_ned_m_s: Vec3::zeros() };
        self.order(&from, target, None, None);
    }

    fn order_landing(&mut self) {
        let ahead = self.guidance.ahead(LATENCY_S);
        let pivot = self.navigation.pivot();
        let now = self.guidance.reference();
        let close = (pivot.position_ned_m - now.position_ned_m).norm() < TUBE_M
            && (pivot.velocity_ned_m_s - now.velocity_ned_m_s).norm() < TUBE_M_S;
        let join_s = self.guidance.elapsed_s() + LATENCY_S;
        let from = if close {
            ahead
        } else {
            let present = self.present_motion();
            let (v, a) = (present.velocity_ned_m_s, present.acceleration_ned_m_s2);
            Reference {
                position_ned_m: present.position_ned_m + (v + a * (0.5 * LATENCY_S)) * LATENCY_S,
                velocity_ned_m_s: v + a * LATENCY_S,
                heading_rad: now.heading_rad,
                ..present
            }
        };
        let profile = self.mission_profile();
        let target = Target {
            position_ned_m: profile.terminal_ned_m(),
            velocity_ned_m_s: Vec3::new(0.0, 0.0, profile.final_speed_m_s()),
        };
        let previous = self.planning.rung.is_some().then(|| {
            // Its start, by the trajectory clock, which has been shifted to meet the vehicle.
            let elapsed = SimTime::from_s(self.guidance.elapsed_s());
            self.guidance.trajectory().clone().with_start(self.time.since(elapsed))
        });
        self.order(&from, target, Some(GLIDE_SLOPE), previous);
        self.planning.join_s = close.then_some(join_s);
    }

    fn order(
        &mut self,
        from: &Reference,
        target: Target,
        glide_slope: Option<GlideSlope>,
        previous: Option<Trajectory>,
    ) {
        let p = &self.parameters;
        let (mission, gravity) = (&p.mission, p.navigation.gravity_m_s2);
        let weight_n = self.propellant.mass_kg * gravity;
        let (oxidizer, fuel) = p.thrust_map.flows_kg_s(weight_n, self.propellant.port_radius_m);
        let flow_kg_s = oxidizer + fuel;
        let endurance_s = self.propellant.endurance_s(&p.propellant, &p.thrust_map, gravity);
        let usable_kg = flow_kg_s * (endurance_s - mission.abort.reserve_s).max(0.0);
        let dry_mass_kg = (self.propellant.mass_kg - usable_kg).max(p.propellant.empty.mass_kg);
        let begins = self.time + SimTime::from_s(LATENCY_S);
        let thrust_acceleration = from.acceleration_ned_m_s2 - Vec3::new(0.0, 0.0, gravity);
        let vertical_m_s = mission.ascent_speed_m_s.max(mission.descent_speed_m_s);
        // Only a landing has a glide slope.
        let climb_m_s = match glide_slope {
            Some(_) => LANDING_CLIMB_M_S + (-from.velocity_ned_m_s.z).max(0.0),
            None => mission.ascent_speed_m_s,
        };
        let problem = Problem {
            start: Start {
                position_ned_m: from.position_ned_m,
                velocity_ned_m_s: from.velocity_ned_m_s,
                thrust_acceleration_ned_m_s2: Some(thrust_acceleration),
                mass_kg: self.propellant.mass_kg,
            },
            target,
            engine: Engine {
                thrust_min_n: BAND_LOW * p.actuators.thrust_min_n,
                thrust_max_n: BAND_HIGH * p.actuators.thrust_max_n,
                mass_flow_per_thrust_s_m: flow_kg_s / weight_n.max(1.0),
                dry_mass_kg,
            },
            limits: Limits {
                tilt_rad: TILT_SHARE * mission.tilt_limit_rad,
                speed_m_s: libm::hypot(vertical_m_s, mission.lateral_speed_m_s),
                climb_m_s,
                sink_m_s: mission.descent_speed_m_s,
                glide_slope,
            },
            gravity_m_s2: gravity,
            nodes: NODES,
        };
        let request = PlanRequest { problem, start: begins, heading_rad: from.heading_rad, previous };
        self.planning.ordered += 1;
        self.planning.begins = Some(begins);
        self.planning.answer = None;
        self.planning.join_s = None;
        self.planning.outbox = Some(Order { number: self.planning.ordered, request, settings: p.planner });
    }
}
