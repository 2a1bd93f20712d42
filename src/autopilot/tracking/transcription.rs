//! The quadratic program of predictive tracking: the deviation now, and the stages along the reference ahead.

use super::model::{ANGLE_RAD, Airframe, Control, THRUST_N, TORQUE_N_M, ThrustAttitude, stage_model};
use super::observer::{Observer, Servo};
use super::parameters::TrackingParameters;
use crate::autopilot::mpc::{MAX_STAGES, Problem, STATES, Tilt};
use crate::autopilot::rigid_body::MotionEstimate;
use crate::autopilot::trajectory::Reference;
use crate::frame::{Mat3, Vec3};
use nalgebra::UnitQuaternion;

/// Integration steps over the latency.
const LATENCY_STEPS: u32 = 8;

/// Inputs of one step of the tracker.
#[derive(Clone, Copy, Debug)]
pub struct TrackerInput<'a> {
    /// Motion of the centre of mass, attitude, thrust.
    pub motion: &'a MotionEstimate,
    /// Disturbances and the gimbal.
    pub observer: &'a Observer,
    /// The vehicle at its present mass.
    pub airframe: &'a Airframe,
    /// Centre of mass along body z, negative above the pivot (m).
    pub com_z_m: f64,
    /// Gravity (m/s²).
    pub gravity_m_s2: f64,
    /// Lower end of the thrust band (N).
    pub thrust_min_n: f64,
    /// Upper end of the thrust band (N).
    pub thrust_max_n: f64,
    /// The command in force.
    pub previous: Control,
}

/// Deviation from the reference after the latency of the servos, predicted under the command in force.
pub(super) fn deviation(
    p: &TrackingParameters,
    s: &TrackerInput,
    ahead: &impl Fn(f64) -> Reference,
    latency_s: f64,
) -> [f64; STATES] {
    let a = s.airframe;
    let [kx, ky] = a.recoil;
    let [ix, iy, iz] = a.inertia_kg_m2;
    let mut servos = s.observer.servos;
    let mut position = s.motion.position_ned_m;
    let mut velocity = s.motion.velocity_ned_m_s;
    let mut rate = s.observer.momentum_rate(a, s.motion);
    let recoil = |servos: &[Servo; 2]| Vec3::new(kx * servos[0].angle_rad, ky * servos[1].angle_rad, 0.0);
    let mut q = s.motion.q_ned_from_body * UnitQuaternion::from_scaled_axis(-recoil(&servos));
    let [offset_x, offset_y] = s.observer.thrust_offset_m;
    let h = latency_s / f64::from(LATENCY_STEPS);
    let decay = libm::exp(-h / a.thrust_lag_s.max(1e-4));
    let mut thrust = s.motion.thrust_n;
    for _ in 0..LATENCY_STEPS {
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
    let wanted = reference_attitude(s, &reference);
    let reference_rate =
        wanted.rate_body_rad_s(&reference_attitude(s, &ahead(latency_s + p.stage_s)), p.stage_s);
    let com = reference.position_ned_m + Vec3::new(0.0, 0.0, s.com_z_m);
    let off = heading_from_ned * (position - com);
    let speed = heading_from_ned * (velocity - reference.velocity_ned_m_s);
    let ned_from_reference = heading_from_ned.transpose() * wanted.heading_from_body;
    let reference_q =
        UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(ned_from_reference));
    let trim = trim_attitude_rad(s);
    let turn = (reference_q.inverse() * q).scaled_axis() - Vec3::new(trim[0], trim[1], 0.0);
    let mut x = [0.0; STATES];
    for i in 0..3 {
        x[i] = off[i];
        x[3 + i] = speed[i];
        x[6 + i] = turn[i] / ANGLE_RAD;
        x[9 + i] = (rate[i] - reference_rate[i]) / ANGLE_RAD;
    }
    x[12] = (thrust - wanted.thrust_n) / THRUST_N;
    x
}

/// Fills in the quadratic program of this moment, all but its terminal cost.
pub(super) fn fill(
    problem: &mut Problem,
    p: &TrackingParameters,
    s: &TrackerInput,
    now: &[f64; STATES],
    latency_s: f64,
    ahead: &impl Fn(f64) -> Reference,
) {
    let (h, n) = (p.stage_s, p.stages.clamp(2, MAX_STAGES));
    let trim = s.observer.trim_rad(s.airframe);
    let trim_attitude = trim_attitude_rad(s);
    let attitude_at = |k: usize| reference_attitude(s, &ahead(latency_s + k as f64 * h));
    let tilt_of = |attitude: &ThrustAttitude| Tilt {
        min: [0, 1].map(|i| (-p.tilt_rad - attitude.tilt_rad[i] - trim_attitude[i]) / ANGLE_RAD),
        max: [0, 1].map(|i| (p.tilt_rad - attitude.tilt_rad[i] - trim_attitude[i]) / ANGLE_RAD),
    };
    let mut attitude = attitude_at(0);
    let mut next = attitude_at(1);
    let mut rate = attitude.rate_body_rad_s(&next, h);
    problem.length = n;
    problem.initial_state = *now;
    problem.previous_input = s.previous.scaled();
    let gimbal = p.gimbal_limit_rad / ANGLE_RAD;
    let roll = p.roll_torque_n_m / TORQUE_N_M;
    let thrust = [s.thrust_min_n, s.thrust_max_n].map(|t| t / THRUST_N);
    let change =
        [p.thrust_rate_n_s / THRUST_N, p.gimbal_rate_rad_s / ANGLE_RAD, p.gimbal_rate_rad_s / ANGLE_RAD, 1e3];
    for k in 0..n {
        let after = attitude_at(k + 2);
        let rate_next = next.rate_body_rad_s(&after, h);
        let model = stage_model(s.airframe, &attitude, rate, rate_next - rate, h);
        // The thrust command that keeps a reference whose thrust rises at this pace.
        let rise = (next.thrust_n - attitude.thrust_n) / h;
        let thrust_trim = 0.5 * (attitude.thrust_n + next.thrust_n) + s.airframe.thrust_lag_s * rise;
        let input_trim = [
            thrust_trim / THRUST_N,
            trim[0] / ANGLE_RAD,
            trim[1] / ANGLE_RAD,
            -s.observer.roll_moment_n_m / TORQUE_N_M,
        ];
        let stage = &mut problem.stages[k];
        stage.model = model.linear;
        for i in 0..STATES {
            let trimmed: f64 = model.linear.b[i].iter().zip(&input_trim).map(|(b, u)| b * u).sum();
            stage.offset[i] = model.constant[i] - trimmed;
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
        stage.tilt = tilt_of(&attitude);
        problem.terminal_input_reference = input_trim;
        (attitude, next, rate) = (next, after, rate_next);
    }
    problem.terminal_state_reference = [0.0; STATES];
    problem.terminal_tilt = tilt_of(&attitude);
}

/// Rotation of the body that points the thrust, deflected by the trim angles, along the reference; less their
/// recoil (rad).
fn trim_attitude_rad(s: &TrackerInput) -> [f64; 2] {
    let trim = s.observer.trim_rad(s.airframe);
    [0, 1].map(|i| (1.0 - s.airframe.recoil[i]) * trim[i])
}

/// Attitude and thrust of a reference, the known disturbance force balanced.
fn reference_attitude(s: &TrackerInput, reference: &Reference) -> ThrustAttitude {
    let push =
        reference.acceleration_ned_m_s2 - Vec3::new(0.0, 0.0, s.gravity_m_s2) - s.observer.force_ned_m_s2;
    ThrustAttitude::of(heading_from_ned(reference.heading_rad) * push, s.airframe.mass_kg)
}

/// From NED to the heading frame.
fn heading_from_ned(heading_rad: f64) -> Mat3 {
    let (sin, cos) = (libm::sin(heading_rad), libm::cos(heading_rad));
    Mat3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0)
}
