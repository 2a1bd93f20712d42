//! Predictive tracking: fifty times a second the best inputs for the next second and a half, in between
//! their feedback, and a ladder for when there are none.
//!
//! ```text
//! reference ahead ─┐
//! motion seen ─────┼→ prediction over the servo's latency → deviation → quadratic program → thrust, gimbal, roll
//! disturbances ────┘                                         (model)      (mpc)
//! ```
//!
//! Each rung of the [`Rung`] ladder is counted. The last one is not here: without an answer the caller flies the cascaded
//! controller. No plan is flown on for longer than [`OLDEST_PLAN_S`].

pub mod model;
pub mod observer;

use super::mpc::{self, CostToGo, InfiniteHorizon, Linear, Problem, Solution, StageCost, Status, Tilt};
use super::propellant::MassPoint;
use super::trajectory::Reference;
use crate::frame::{Mat3, Vec3};
use model::{ANGLE_RAD, Airframe, INPUTS, Pose, STATES, THRUST_N, TORQUE_N_M};
use nalgebra::UnitQuaternion;
use observer::{MotionEstimate, Observer, ServoParameters};

/// What predictive tracking is told before the flight.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackingParameters {
    /// Stages of the horizon.
    pub stages: usize,
    /// Length of a stage (s).
    pub stage_s: f64,
    /// Time between solves (s).
    pub period_s: f64,
    /// Costs of a stage, in the units of [`model`].
    pub weights: StageCost,
    /// Greatest change of thrust per second (N/s).
    pub thrust_rate_n_s: f64,
    /// Greatest gimbal rate (rad/s).
    pub gimbal_rate_rad_s: f64,
    /// Gimbal angle that may be used, per axis (rad).
    pub gimbal_limit_rad: f64,
    /// Roll torque that may be asked for (N m).
    pub roll_torque_n_m: f64,
    /// Tilt over which the cost rises steeply (rad).
    pub tilt_rad: f64,
    /// Gimbal servo.
    pub servo: ServoParameters,
    /// The engine's first moment about the pivot (kg m).
    pub engine_moment_kg_m: f64,
    /// The engine's inertia about the pivot, across the axis (kg m²).
    pub engine_inertia_kg_m2: f64,
    /// Own solver.
    pub solver: mpc::Settings,
    /// The general solver that stands in for it.
    pub stand_in: mpc::Settings,
}

/// Costs of a stage: metres, metres per second, 0.1 rad, 0.1 rad/s, kN; kN, 0.1 rad, 10 N m. Chosen on hops in gusts with a crooked
/// engine: place against gimbal activity (10 instead of 4 on position takes a sixth off the hover's error), roll dear enough that
/// the thrusters leave heading noise alone (a tenth of the nitrogen).
pub const WEIGHTS: StageCost = StageCost {
    state: [10.0, 10.0, 8.0, 2.0, 2.0, 4.0, 0.3, 0.3, 0.1, 0.02, 0.02, 0.02, 0.01],
    input: [2.0, 0.5, 0.5, 10.0],
    change: [1.0, 1.0, 1.0, 2.0],
};

/// A plan is flown on for so long without a new one (s).
pub const OLDEST_PLAN_S: f64 = 0.06;
/// Sums of steps are not round (s).
const TIME_ROUNDING_S: f64 = 1e-6;
/// Without any answer for so long (s), constant feedback gives way to the cascaded controller.
const FEEDBACK_PATIENCE_S: f64 = 0.5;
/// An iterate whose constraints are met this well may be flown though not optimal.
const USABLE_RESIDUAL: f64 = 1e-3;
/// Steps in which the latency is bridged.
const BRIDGE_STEPS: u32 = 8;

/// Where a command came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// Optimal plan of the own solver.
    Solved,
    /// Its last iterate, stopped at the cap.
    Capped,
    /// Plan of the general solver.
    Oracle,
    /// The plan before, flown on.
    Shifted,
    /// Constant feedback about the reference.
    Feedback,
    /// None: the cascaded controller.
    Cascade,
}

impl Rung {
    /// All of them, best first: the index in counters is `rung as usize`.
    pub const ALL: [Self; 6] =
        [Self::Solved, Self::Capped, Self::Oracle, Self::Shifted, Self::Feedback, Self::Cascade];

    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Capped => "capped",
            Self::Oracle => "oracle",
            Self::Shifted => "shifted",
            Self::Feedback => "feedback",
            Self::Cascade => "cascade",
        }
    }
}

/// Actuation in SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// Thrust (N).
    pub thrust_n: f64,
    /// Gimbal angles about x and y (rad).
    pub gimbal_rad: [f64; 2],
    /// Torque about the long axis (N m).
    pub roll_torque_n_m: f64,
}

/// What a step is given.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a> {
    /// Motion of the centre of mass, attitude, thrust.
    pub seen: &'a MotionEstimate,
    /// Disturbances and the gimbal.
    pub observer: &'a Observer,
    /// Vehicle as of now.
    pub airframe: &'a Airframe,
    /// Centre of mass along body z, negative above the pivot (m).
    pub com_z_m: f64,
    /// Gravity (m/s²).
    pub gravity_m_s2: f64,
    /// Thrust band (N).
    pub thrust_n: [f64; 2],
    /// What was commanded last.
    pub previous: Control,
}

/// The tracker's memory.
#[derive(Clone, Debug)]
pub struct Tracker {
    problem: Box<Problem>,
    solution: Box<Solution>,
    fresh: Box<Solution>,
    workspace: mpc::Workspace,
    /// Unconstrained optimal control when full and when empty, and the masses (kg).
    horizons: Option<[(f64, InfiniteHorizon); 2]>,
    since_solve_s: f64,
    /// Age of the plan in `solution` (s); infinite without one.
    plan_age_s: f64,
    rung: Rung,
    counts: [u64; 6],
}

impl TrackingParameters {
    /// The vehicle as the model wants it.
    pub fn airframe(&self, mass: &MassPoint, thrust_lag_s: f64) -> Airframe {
        let MassPoint { mass_kg, inertia_kg_m2, com_body_m } = *mass;
        let arm_m = -com_body_m.z;
        let share =
            |inertia: f64| (self.engine_inertia_kg_m2 + self.engine_moment_kg_m * arm_m) / inertia.max(1e-3);
        Airframe {
            mass_kg,
            inertia_kg_m2,
            lever_arm_m: arm_m + self.engine_moment_kg_m / mass_kg.max(1e-3),
            recoil: [share(inertia_kg_m2[0]), share(inertia_kg_m2[1])],
            thrust_lag_s,
        }
    }
}

impl Tracker {
    /// For a vehicle that goes from `full` to `empty`.
    pub fn new(p: &TrackingParameters, full: &Airframe, empty: &Airframe, gravity_m_s2: f64) -> Self {
        let horizon = |airframe: &Airframe| {
            let hover = Pose::of(Vec3::new(0.0, 0.0, -gravity_m_s2), airframe.mass_kg);
            let stage = model::stage(airframe, &hover, Vec3::zeros(), Vec3::zeros(), p.stage_s);
            Some((airframe.mass_kg, mpc::dare(&Linear { a: stage.a, b: stage.b }, &p.weights)?))
        };
        let horizons = horizon(full).zip(horizon(empty)).map(|(full, empty)| [full, empty]);
        Self {
            problem: Box::default(),
            solution: Box::default(),
            fresh: Box::default(),
            workspace: mpc::Workspace::default(),
            horizons,
            since_solve_s: f64::INFINITY,
            plan_age_s: f64::INFINITY,
            rung: Rung::Cascade,
            counts: [0; 6],
        }
    }

    /// Forgets the plan; the next step solves.
    pub fn reset(&mut self) {
        (self.since_solve_s, self.plan_age_s) = (f64::INFINITY, f64::INFINITY);
    }

    /// Rung of the newest command.
    pub const fn rung(&self) -> Rung {
        self.rung
    }

    /// Solves that ended on each rung, in the order of [`Rung::ALL`].
    pub const fn counts(&self) -> [u64; 6] {
        self.counts
    }

    /// One step. `ahead` gives the reference that many seconds from now. `None`: the cascaded controller flies.
    pub fn step(
        &mut self,
        p: &TrackingParameters,
        s: &Situation,
        ahead: impl Fn(f64) -> Reference,
        dt_s: f64,
    ) -> Option<Control> {
        self.since_solve_s += dt_s;
        self.plan_age_s += dt_s;
        let latency_s = p.servo.latency_s();
        let now = self.deviation(p, s, &ahead, latency_s);
        if self.since_solve_s >= p.period_s - 0.5 * dt_s {
            self.fill(p, s, &now, latency_s, &ahead);
            self.since_solve_s = 0.0;
            self.rung = self.climb_down(p);
            self.counts[self.rung as usize] += 1;
        }
        let control = match self.rung {
            Rung::Cascade => None,
            Rung::Feedback => self.constant_feedback(p, s, &now, dt_s),
            _ => Some(self.along_the_plan(p, &now)),
        }?;
        let finite = control.thrust_n.is_finite()
            && control.gimbal_rad.iter().all(|x| x.is_finite())
            && control.roll_torque_n_m.is_finite();
        finite.then(|| within(p, s, control, dt_s))
    }

    /// Solves, and goes down as far as needed.
    fn climb_down(&mut self, p: &TrackingParameters) -> Rung {
        let status =
            mpc::interior_point::solve(&self.problem, &p.solver, &mut self.workspace, &mut self.fresh);
        let usable = match status {
            Status::Solved => Some(Rung::Solved),
            Status::IterationLimit
                if self.fresh.primal_residual < USABLE_RESIDUAL && self.fresh.iterations > 0 =>
            {
                Some(Rung::Capped)
            }
            _ => {
                *self.fresh = mpc::oracle::solve_within(&self.problem, &p.stand_in);
                if let Some([full, _]) = &self.horizons {
                    // It has no feedback of its own.
                    self.fresh.feedback = full.1.feedback;
                }
                (self.fresh.status == Status::Solved).then_some(Rung::Oracle)
            }
        };
        if let Some(rung) = usable {
            core::mem::swap(&mut self.solution, &mut self.fresh);
            self.plan_age_s = 0.0;
            return rung;
        }
        // It must not grow too old before the next solve.
        if self.plan_age_s + p.period_s <= OLDEST_PLAN_S + TIME_ROUNDING_S {
            Rung::Shifted
        } else if self.plan_age_s <= FEEDBACK_PATIENCE_S && self.horizons.is_some() {
            Rung::Feedback
        } else {
            Rung::Cascade
        }
    }

    /// Deviation from the reference after the servo's latency, with what is already on its way.
    fn deviation(
        &self,
        p: &TrackingParameters,
        s: &Situation,
        ahead: &impl Fn(f64) -> Reference,
        latency_s: f64,
    ) -> [f64; STATES] {
        let a = s.airframe;
        let [kx, ky] = a.recoil;
        let [ix, iy, iz] = a.inertia_kg_m2;
        let mut servos = s.observer.servos;
        let mut position = s.seen.position_ned_m;
        let mut velocity = s.seen.velocity_ned_m_s;
        let mut rate = s.observer.momentum_rate(a, s.seen);
        let recoil = |servos: &[observer::Servo; 2]| {
            Vec3::new(kx * servos[0].angle_rad, ky * servos[1].angle_rad, 0.0)
        };
        let mut q = s.seen.q_ned_from_body * UnitQuaternion::from_scaled_axis(-recoil(&servos));
        let [offset_x, offset_y] = s.observer.thrust_offset_m;
        let h = latency_s / f64::from(BRIDGE_STEPS);
        let decay = libm::exp(-h / a.thrust_lag_s.max(1e-4));
        let mut thrust = s.seen.thrust_n;
        for _ in 0..BRIDGE_STEPS {
            for (servo, command) in servos.iter_mut().zip(s.previous.gimbal_rad) {
                servo.step(&p.servo, command, h);
            }
            thrust = s.previous.thrust_n + (thrust - s.previous.thrust_n) * decay;
            let sine = servos.map(|servo| libm::sin(servo.angle_rad));
            let turn = Vec3::new(
                thrust * (a.lever_arm_m * sine[0] + offset_x) / ix,
                thrust * (a.lever_arm_m * sine[1] + offset_y) / iy,
                (s.previous.roll_torque_n_m + s.observer.roll_moment_n_m) / iz,
            );
            let push = Vec3::new(sine[1], -sine[0], -1.0) * (thrust / a.mass_kg);
            let body = q * UnitQuaternion::from_scaled_axis(recoil(&servos));
            let change = body * push + Vec3::new(0.0, 0.0, s.gravity_m_s2) + s.observer.force_ned_m_s2;
            position += (velocity + change * (0.5 * h)) * h;
            velocity += change * h;
            q *= UnitQuaternion::from_scaled_axis((rate + turn * (0.5 * h)) * h);
            rate += turn * h;
        }

        let reference = ahead(latency_s);
        let heading_from_ned = heading_from_ned(reference.heading_rad);
        let pose = pose_for(s, &reference);
        let reference_rate = pose.rate_body_rad_s(&pose_for(s, &ahead(latency_s + p.stage_s)), p.stage_s);
        let com = reference.position_ned_m + Vec3::new(0.0, 0.0, s.com_z_m);
        let off = heading_from_ned * (position - com);
        let speed = heading_from_ned * (velocity - reference.velocity_ned_m_s);
        let ned_from_reference = heading_from_ned.transpose() * pose.heading_from_body;
        let reference_q = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(
            ned_from_reference,
        ));
        let stance = stance_rad(s);
        let turn = (reference_q.inverse() * q).scaled_axis() - Vec3::new(stance[0], stance[1], 0.0);
        let mut x = [0.0; STATES];
        for i in 0..3 {
            x[i] = off[i];
            x[3 + i] = speed[i];
            x[6 + i] = turn[i] / ANGLE_RAD;
            x[9 + i] = (rate[i] - reference_rate[i]) / ANGLE_RAD;
        }
        x[12] = (thrust - pose.thrust_n) / THRUST_N;
        x
    }

    /// The quadratic program of this moment.
    fn fill(
        &mut self,
        p: &TrackingParameters,
        s: &Situation,
        now: &[f64; STATES],
        latency_s: f64,
        ahead: &impl Fn(f64) -> Reference,
    ) {
        let (h, n) = (p.stage_s, p.stages.clamp(2, mpc::MAX_STAGES));
        let trim = s.observer.trim_rad(s.airframe);
        let stance = stance_rad(s);
        let pose_at = |k: usize| pose_for(s, &ahead(latency_s + k as f64 * h));
        let tilt_of = |pose: &Pose| Tilt {
            min: [0, 1].map(|i| (-p.tilt_rad - pose.tilt_rad[i] - stance[i]) / ANGLE_RAD),
            max: [0, 1].map(|i| (p.tilt_rad - pose.tilt_rad[i] - stance[i]) / ANGLE_RAD),
        };
        let mut pose = pose_at(0);
        let mut next = pose_at(1);
        let mut rate = pose.rate_body_rad_s(&next, h);
        let problem = &mut self.problem;
        problem.length = n;
        problem.initial_state = *now;
        problem.previous_input = scaled(&s.previous);
        let gimbal = p.gimbal_limit_rad / ANGLE_RAD;
        let roll = p.roll_torque_n_m / TORQUE_N_M;
        let thrust = s.thrust_n.map(|t| t / THRUST_N);
        let change = [
            p.thrust_rate_n_s / THRUST_N,
            p.gimbal_rate_rad_s / ANGLE_RAD,
            p.gimbal_rate_rad_s / ANGLE_RAD,
            1e3,
        ];
        for k in 0..n {
            let after = pose_at(k + 2);
            let rate_next = next.rate_body_rad_s(&after, h);
            let linear = model::stage(s.airframe, &pose, rate, rate_next - rate, h);
            // The thrust command that keeps a reference whose thrust rises at this pace.
            let rise = (next.thrust_n - pose.thrust_n) / h;
            let thrust_trim = 0.5 * (pose.thrust_n + next.thrust_n) + s.airframe.thrust_lag_s * rise;
            let input_trim = [
                thrust_trim / THRUST_N,
                trim[0] / ANGLE_RAD,
                trim[1] / ANGLE_RAD,
                -s.observer.roll_moment_n_m / TORQUE_N_M,
            ];
            let stage = &mut problem.stages[k];
            stage.model.a = linear.a;
            stage.model.b = linear.b;
            for i in 0..STATES {
                let held: f64 = linear.b[i].iter().zip(&input_trim).map(|(b, u)| b * u).sum();
                stage.offset[i] = linear.c[i] - held;
            }
            stage.state_weight = p.weights.state;
            stage.state_reference = [0.0; STATES];
            stage.input_weight = p.weights.input;
            stage.input_reference = input_trim;
            stage.change_weight = p.weights.change;
            stage.input_min = [thrust[0], -gimbal, -gimbal, -roll];
            stage.input_max = [thrust[1], gimbal, gimbal, roll];
            let interval_s = if k == 0 { p.period_s } else { h };
            stage.change_max = change.map(|c| c * interval_s);
            stage.tilt = tilt_of(&pose);
            problem.terminal_input_reference = input_trim;
            (pose, next, rate) = (next, after, rate_next);
        }
        problem.terminal = self.horizons.as_ref().map_or_else(CostToGo::default, |[full, empty]| {
            let span = full.0 - empty.0;
            let u = if span > 0.0 { ((full.0 - s.airframe.mass_kg) / span).clamp(0.0, 1.0) } else { 0.0 };
            blend(&full.1.cost, &empty.1.cost, u)
        });
        problem.terminal_state_reference = [0.0; STATES];
        problem.terminal_tilt = tilt_of(&pose);
    }

    /// The plan at its age, corrected by the feedback of its first stage.
    fn along_the_plan(&self, p: &TrackingParameters, now: &[f64; STATES]) -> Control {
        let plan = &*self.solution;
        let at = (self.plan_age_s / p.stage_s).max(0.0);
        let k = (at as usize).min(mpc::MAX_STAGES - 1);
        let share = (at - k as f64).clamp(0.0, 1.0);
        let mut input = plan.inputs[k];
        for (j, row) in plan.feedback.iter().enumerate() {
            for i in 0..STATES {
                let expected = plan.states[k][i] + share * (plan.states[k + 1][i] - plan.states[k][i]);
                input[j] += row[i] * (now[i] - expected);
            }
        }
        unscaled(&input)
    }

    /// Feedback of the infinite horizon about the reference's trim.
    fn constant_feedback(
        &self,
        p: &TrackingParameters,
        s: &Situation,
        now: &[f64; STATES],
        dt_s: f64,
    ) -> Option<Control> {
        let [(_, horizon), _] = self.horizons.as_ref()?;
        let trim = &self.problem.stages[0].input_reference;
        let previous = scaled(&s.previous);
        // Designed for a step of a stage, it is taken in the share of one that has passed.
        let share = dt_s / p.stage_s;
        let input = core::array::from_fn(|j| {
            let state: f64 = horizon.feedback[j].iter().zip(now).map(|(k, x)| k * x).sum();
            let off = previous.iter().zip(trim).map(|(u, trim)| u - trim);
            let memory: f64 = horizon.memory[j].iter().zip(off).map(|(m, u)| m * u).sum();
            previous[j] + share * (trim[j] + state + memory - previous[j])
        });
        Some(unscaled(&input))
    }
}

/// How the body stands so that the thrust, turned by the trim, points as the reference asks, the trim's recoil in it (rad).
fn stance_rad(s: &Situation) -> [f64; 2] {
    let trim = s.observer.trim_rad(s.airframe);
    [0, 1].map(|i| (1.0 - s.airframe.recoil[i]) * trim[i])
}

/// Attitude and thrust that a reference asks for, the known disturbance leant against.
fn pose_for(s: &Situation, reference: &Reference) -> Pose {
    let push =
        reference.acceleration_ned_m_s2 - Vec3::new(0.0, 0.0, s.gravity_m_s2) - s.observer.force_ned_m_s2;
    Pose::of(heading_from_ned(reference.heading_rad) * push, s.airframe.mass_kg)
}

/// NED turned about the vertical until x is the heading.
fn heading_from_ned(heading_rad: f64) -> Mat3 {
    let (sin, cos) = (libm::sin(heading_rad), libm::cos(heading_rad));
    Mat3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0)
}

fn scaled(c: &Control) -> [f64; INPUTS] {
    [
        c.thrust_n / THRUST_N,
        c.gimbal_rad[0] / ANGLE_RAD,
        c.gimbal_rad[1] / ANGLE_RAD,
        c.roll_torque_n_m / TORQUE_N_M,
    ]
}

fn unscaled(u: &[f64; INPUTS]) -> Control {
    Control {
        thrust_n: u[0] * THRUST_N,
        gimbal_rad: [u[1] * ANGLE_RAD, u[2] * ANGLE_RAD],
        roll_torque_n_m: u[3] * TORQUE_N_M,
    }
}

/// Between two costs, `share` of the way.
fn blend(a: &CostToGo, b: &CostToGo, share: f64) -> CostToGo {
    let mut out = *a;
    let between = |x: &mut f64, y: &f64| *x += share * (*y - *x);
    out.state.as_flattened_mut().iter_mut().zip(b.state.as_flattened()).for_each(|(x, y)| between(x, y));
    out.cross.as_flattened_mut().iter_mut().zip(b.cross.as_flattened()).for_each(|(x, y)| between(x, y));
    out.input.as_flattened_mut().iter_mut().zip(b.input.as_flattened()).for_each(|(x, y)| between(x, y));
    out
}

/// Inside limits and rates, whatever the feedback said.
fn within(p: &TrackingParameters, s: &Situation, c: Control, dt_s: f64) -> Control {
    let [low, high] = s.thrust_n;
    let (gimbal, step) = (p.gimbal_limit_rad, p.gimbal_rate_rad_s * dt_s);
    let axis = |i: usize| {
        let last = s.previous.gimbal_rad[i];
        c.gimbal_rad[i].clamp(last - step, last + step).clamp(-gimbal, gimbal)
    };
    Control {
        thrust_n: c.thrust_n.clamp(low, high.max(low)),
        gimbal_rad: [axis(0), axis(1)],
        roll_torque_n_m: c.roll_torque_n_m.clamp(-p.roll_torque_n_m, p.roll_torque_n_m),
    }
}
